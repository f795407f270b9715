"""The main job in Python: the photograph that comes with the package, from file to point cloud."""

import sys
from pathlib import Path

import numpy as np

import cyclopean
from cyclopean.files import write_ply
from cyclopean.jobs.reconstruction import demo_files

photo, setup_file = demo_files()
setup = cyclopean.read_setup(setup_file)
photograph = cyclopean.read_photograph(photo, setup.camera.size)

result = cyclopean.reconstruct(photograph, setup.rig(), setup.depths)

sigma = np.sqrt(result.covariance[:, 2, 2])
print(f"{len(result.points):,} points, median depth {np.median(result.points[:, 2]):.1f} mm, "
      f"median sigma of depth {np.median(sigma):.2f} mm")  # fmt: skip

output = Path(sys.argv[1]) if len(sys.argv) > 1 else Path("out")
output.mkdir(parents=True, exist_ok=True)
write_ply(
    output / "points.ply",
    result.points,
    colors=result.colours,
    normals=result.normals,
    sigma=sigma,
    views=result.views,  # how many views have each point
)
