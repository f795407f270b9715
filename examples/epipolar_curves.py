"""Where the partners of a pixel lie: the true curve through a prism, and the straight line of virtual cameras."""

from cyclopean import Camera, Prism, Setup
from cyclopean.epipolar import distance_to_curves, epipolar_curves, line_departure

rig = Setup(Camera((1280, 960), 2400), Prism(facets=3, apex_deg=12, glass="N-BK7", distance=60)).rig()
depths = (600, 1500)  # mm
pixel = rig[0].region.centre
curves = epipolar_curves(rig, 0, pixel, depths, sigma=0.1)

print(f"pixel {pixel.round(1)} of view 0 is seen by view 1 at")
for sample in (0, 32, 64):
    place, sigma = curves.pixels[1, sample], curves.sigma[1, sample]
    print(f"  {place.round(2)} if it is {curves.depths[sample]:.0f} mm away; across the curve +- {sigma:.3f} px")

partner = rig.project(rig[0].rays(pixel).at_depth(900))  # what a matcher would find
partner[1] += [0.0, 0.3]
distance, inverse_depth = distance_to_curves(curves, partner)
print(f"a partner that lies {distance[1]:.2f} px beside the curve stands for a depth of {1 / inverse_depth[1]:.0f} mm")

departure = line_departure(rig, 0, 1, depths)
print(
    f"over the whole sub-image the curves are straight to {departure.straight_max:.3f} px, "
    f"but off the lines of two virtual cameras by up to {departure.virtual_max:.2f} px"
)
