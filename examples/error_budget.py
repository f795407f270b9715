"""What makes the depths of a biprism uncertain, what warmth and colour do, and which filter to use."""

import sys
from pathlib import Path

import numpy as np

from cyclopean import Camera, Prism, Setup
from cyclopean.analysis.budget import error_budget
from cyclopean.analysis.chromatic import filter_advice
from cyclopean.analysis.thermal import depth_per_kelvin
from cyclopean.plotting.errors import budget_picture

folder = Path(sys.argv[1] if len(sys.argv) > 1 else ".")
setup = Setup(Camera((1280, 960), 2400), Prism(facets=2, apex_deg=10, glass="N-BK7", distance=120))

# a prism measured on a bench: the angle to 10 arcsec, the index from the melt's data sheet
measured = {"optic.apex": np.deg2rad(10 / 3600), "optic.facets": np.deg2rad(10 / 3600), "optic.index": 1e-5}
for title, tolerances in (("as drawn", {}), ("glass measured", measured)):
    budget = error_budget(setup, [400, 600, 900], tolerances=tolerances)
    print(f"{title}, at {budget.depths[1]:g} mm:")
    for row in (*budget.table()[:3], budget.table()[-1]):
        print(f"  {row.name:22s} {row.size:24s} {row.sigma:6.2f} mm  {100 * row.share:5.1f} % of the variance")

middle = np.array([0.0, 0.0, 600.0])
bias = depth_per_kelvin(setup, middle)["all"]
print(f"one kelvin warmer, in aluminium: {1000 * bias:+.0f} um at 600 mm")
for advice in filter_advice(setup, middle, (450, 550, 650), blur=0.3, bias_percent=0.1):
    print(
        f"filter at {advice.centre_nm:g} nm: {advice.width_for_blur:.1f} nm wide leaves 0.3 px of blur, "
        f"{advice.width_for_bias:.1f} nm leaves 0.1 % of depth"
    )
budget_picture(budget).savefig(folder / "budget.png")
