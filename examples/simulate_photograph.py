"""See the photograph before the prism is bought: simulate it, and reconstruct it with our own command's function.

A stand of two parts before a wall, through three facets and an open aperture, with a camera's noise.
"""

import sys
from pathlib import Path

import numpy as np

import cyclopean
from cyclopean import Camera, Prism, Setup
from cyclopean.files import write_image
from cyclopean.geometry import Pose
from cyclopean.simulation import Lamp, Scene, render, trace_truth
from cyclopean.simulation.paints import Speckle
from cyclopean.simulation.sensor import Sensor
from cyclopean.simulation.shapes import cylinder, plane, sphere

camera = Camera((480, 360), 900, pixel_pitch=0.0147)  # px, px, mm
prism = Prism(facets=3, apex_deg=12, glass="N-BK7", distance=60, azimuth_deg=90)
setup = Setup(camera, prism, f_number=11, focus_distance=800, depths=(600, 1100))

wall = plane(900, 700).painted(
    Speckle(5.0), Pose.from_rotation_vector([0, np.deg2rad(15), 0], [0, 0, 1000]), name="wall"
)
ball = sphere(35).painted(Speckle(4.0, seed=1, dimensions=3), Pose(np.eye(3), np.array([20, -25, 720])), name="ball")
post = cylinder(18, 90).painted(
    Speckle(4.0, seed=2, dimensions=3), Pose(np.eye(3), np.array([-25, 20, 760])), name="post"
)
scene = Scene((wall, ball, post), ambient=0.7, lamps=(Lamp(direction=(0.5, 0.7, 1.0), strength=0.3),))

light = render(setup, scene, samples=8)
photograph = Sensor(bits=8, full_well_electrons=10_000, read_noise_electrons=8).expose(light)
truth = trace_truth(setup, scene)
points, pixels, _ = truth.matches(1000)
print(f"depths {np.nanmin(truth.depth):.1f} to {np.nanmax(truth.depth):.1f} mm; "
      f"{np.isfinite(pixels).all((1, 2)).mean():.0%} of the points are seen in all {len(truth.rig)} views")  # fmt: skip

found = cyclopean.reconstruct(photograph, setup.rig(), setup.depths)
off = found.depth - truth.depth
known = np.isfinite(off)
print(f"reconstructed: {known.mean():.0%} of the pixels, half of them within {np.median(abs(off[known])):.2f} mm, "
      f"68 % within {np.percentile(abs(off[known]) / found.sigma[known], 68):.2f} of their stated sigma")  # fmt: skip

output = Path(sys.argv[1]) if len(sys.argv) > 1 else Path("out")
output.mkdir(parents=True, exist_ok=True)
write_image(output / "simulated.png", photograph)
