"""Measure in one photograph: points are given in one sub-image and found in the others."""

import cyclopean
from cyclopean.jobs.reconstruction import demo_files
from cyclopean.measurement.images import measure

photo, setup_file = demo_files()
setup = cyclopean.read_setup(setup_file)
rig = setup.rig()
photograph = cyclopean.read_photograph(photo, setup.camera.size)

WANTED = {
    "length": [(745, 640), (740, 760), (735, 880)],  # along the rod, with a corner on the way
    "point-to-plane": [(548, 735), (600, 560), (400, 640), (380, 860), (640, 890)],  # the ball, before the wall
    "angle": [(500, 735), (548, 735), (548, 680)],  # on the ball
}
for kind, points in WANTED.items():
    found = measure(photograph, rig, kind, points, setup.depths)
    print(f"{kind}: {found.value:.3f} +- {found.accuracy:.3f} {found.unit}, match {found.strength:.2f}, {found.grade}")
    for reason in found.reasons:
        print("   ", reason)
