"""A prism, its three views, a point seen by all of them, and the point found again from its pixels."""

from cyclopean import Camera, Prism, Setup, triangulate

camera = Camera(size=(1280, 960), focal=2400)
prism = Prism(facets=3, apex_deg=12, glass="N-BK7", distance=60)
rig = Setup(camera, prism).rig()

pixels = rig.project([10.0, -5.0, 900.0])
for view, pixel in zip(rig, pixels, strict=True):
    print(f"{view.name}: seen at ({pixel[0]:.2f}, {pixel[1]:.2f}) px")

found = triangulate(rig, pixels, sigma=0.1)
print("found at", found.points.round(6), "mm, +-", (found.covariance.diagonal() ** 0.5).round(2), "mm")
