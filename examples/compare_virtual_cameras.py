"""Virtual cameras three ways: by ray sketching with two choices of boundary ray, and by best fit."""

from cyclopean import Camera, Prism, Setup
from cyclopean.rigs import fit, sketch

rig = Setup(Camera((1280, 960), 2400), Prism(facets=2, apex_deg=10, glass="N-BK7", distance=60)).rig()
depths = (600, 1300)  # mm
view = rig[0]

for camera in (
    sketch(view, depths, boundary="edge"),
    sketch(view, depths, boundary="middle"),
    fit(view, depths, distortion=False),
    fit(view, depths),
):
    print(
        f"{camera.method:24s} centre {camera.centre.round(2)} mm, focal length {camera.camera.focal[0]:.0f} px, "
        f"departs by {camera.departure_rms:.2f} px rms, {camera.departure_max:.2f} px at most"
    )
