"""The prism of a setup as a dimensioned drawing and as a solid, with the measures a workshop asks for."""

import sys
from pathlib import Path

import numpy as np

from cyclopean import Camera, Prism, Setup
from cyclopean.files.meshes import write_mesh
from cyclopean.optics.dimensions import prism_dimensions
from cyclopean.optics.solid import prism_solid
from cyclopean.plotting.workshop import Page, workshop_drawing
from cyclopean.plotting.workshop_sheet import degrees_text

folder = Path(sys.argv[1] if len(sys.argv) > 1 else ".")
prism = Prism(facets=3, apex_deg=12, glass="N-BK7", distance=60, thickness=7, radius=26)
workshop_drawing(Setup(Camera((1280, 960), 2400), prism), Page(name="Three-facet filter")).savefig(folder / "prism.pdf")
solid = prism_solid(prism)
write_mesh(folder / "prism.stl", solid.vertices, solid.triangles)

measures = prism_dimensions(prism)
print("dihedral angle", degrees_text(measures.dihedral_angles[0]))
print("edge to flat face", degrees_text(measures.edge_angles[0]))
print(f"rim {measures.rim[0]:.2f} to {measures.rim[1]:.2f} mm, volume {measures.volume / 1000:.2f} cm^3")
print(f"facet angle {np.degrees(measures.facet_angles[0]):.4f} degrees, mesh of {len(solid.triangles)} triangles")
