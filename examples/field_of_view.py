"""What n facets see together: the class in closed form, and the traced volume as a mesh."""

import sys
from pathlib import Path

import numpy as np

from cyclopean import Camera, Prism, Setup
from cyclopean.analysis.common_volume import CommonField
from cyclopean.analysis.field_of_view import FieldOfView
from cyclopean.files.meshes import write_mesh
from cyclopean.plotting.field_of_view import classes_picture, sections_picture

folder = Path(sys.argv[1] if len(sys.argv) > 1 else "out")
folder.mkdir(parents=True, exist_ok=True)
camera = Camera((640, 480), 1600)

for facets in (2, 3, 4, 5):
    setup = Setup(camera, Prism(facets, apex_deg=12, glass="N-BK7", distance=60, azimuth_deg=90 if facets > 2 else 0))
    closed, common = FieldOfView.of(setup), CommonField.of(setup.rig(), samples=200)
    volume = common.volumes((300, 900))[-1]
    radius = common.sections(600)[-1].clearance([[0, 0]])[0]
    print(
        f"{facets} facets: {closed.kind}, omega1 {np.degrees(closed.omega1.min()):.2f} deg, gamma "
        f"{np.degrees(closed.gamma):.2f} deg, from {closed.near:.1f} to {closed.far:.0f} mm; all see "
        f"{volume.volume / 1e3:.0f} cm3 from 300 to 900 mm, at 600 mm {radius:.1f} mm "
        f"around the axis (closed form {closed.half_width(600):.1f})"
    )

write_mesh(folder / "volume.stl", volume.vertices, volume.faces)
sections_picture({"five facets": [common.sections(depth) for depth in (300, 600, 900)]}).savefig(
    folder / "sections.png"
)
gamma = np.deg2rad(12)
fields = [FieldOfView.from_angles(share * gamma, gamma, baseline=40) for share in (0.7, 1.5, 2.4)]
classes_picture(fields).savefig(folder / "classes.png")
