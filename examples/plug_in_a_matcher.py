"""A matcher of one's own in the place of cyclopean's: OpenCV's block matcher, on rectified pairs of sub-images."""

import sys
from pathlib import Path

import cv2
import numpy as np

import cyclopean
from cyclopean.files import write_ply
from cyclopean.jobs.reconstruction import demo_files
from cyclopean.matching.pairwise import sgbm
from cyclopean.pipeline import reconstruct_by_pairs


def blocks(left, right, disparities):
    """Disparity (h, w) of two rectified pictures, px, NaN unknown: all that a matcher must be."""
    left, right = (cv2.cvtColor(picture, cv2.COLOR_RGB2GRAY) for picture in (left, right))
    found = cv2.StereoBM.create(disparities, 15).compute(left, right)
    return np.where(found >= 0, found / 16.0, np.nan)  # it gives 16 times the disparity, and -16 for unknown


# the photograph that comes with the package, made small
photo, setup_file = demo_files()
full = cyclopean.read_setup(setup_file)
size = tuple(n // 4 for n in full.camera.size)
setup = cyclopean.Setup(cyclopean.Camera(size, full.camera.focal[0] / 4), full.optic)
photograph = cyclopean.read_photograph(photo, full.camera.size)
photograph = cv2.resize(photograph, size, interpolation=cv2.INTER_AREA)

results = {
    name: reconstruct_by_pairs(photograph, setup.rig(), full.depths, matcher, scale=2)
    for name, matcher in (("blocks", blocks), ("sgbm", sgbm()))
}
for name, result in results.items():
    print(f"{name}: {len(result.points):,} points, median depth {np.median(result.points[:, 2]):.1f} mm")

output = Path(sys.argv[1]) if len(sys.argv) > 1 else Path("out")
output.mkdir(parents=True, exist_ok=True)
write_ply(output / "points.ply", results["blocks"].points, colors=results["blocks"].colours)
