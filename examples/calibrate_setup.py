"""Calibrate a prism from corners of a board, look how far it can be trusted, and ask what to photograph next.

The corners come from a setup that stands for the real one, with noise. With photographs, `observe` finds them:

    board = Board("charuco", columns=14, rows=10, square=20.0, marker=15.0, dictionary="DICT_5X5_250")
    observations, notes = observe([("a.png", read_photograph("a.png")), ...], board, nominal.rig().masks)
"""

from dataclasses import replace

import numpy as np

from cyclopean import Board, Camera, Observations, Prism, Setup, calibrate
from cyclopean.calibration.guidance import guide
from cyclopean.calibration.trust import depth_errors, undetermined, warnings_of
from cyclopean.geometry import Pose

NOISE = 0.05  # px

real = Setup(Camera((1280, 960), 2400), Prism(3, 12, 1.5168, 60, 8.0, tilt_deg=(0.8, -0.5, 0.3), azimuth_deg=90))
nominal = replace(real, optic=Prism(3, 12.3, 1.5168, 62, 8.0, azimuth_deg=90))  # what the drawing says
board = Board("charuco", columns=14, rows=10, square=20.0, marker=15.0, dictionary="DICT_5X5_250")

rng = np.random.default_rng(1)
rows = []
for photo, depth in enumerate((600, 800, 1000, 1200)):
    turn = Pose.from_rotation_vector(rng.normal(0, 0.4, 3)).rotation
    pose = Pose(turn, np.array([0, 0, depth]) - turn @ board.points.mean(0))
    pixels = real.rig().project(pose @ board.points)  # (points, views, 2)
    for point, view in np.argwhere(np.isfinite(pixels).all(-1)):
        rows.append((photo, view, point, *(pixels[point, view] + rng.normal(0, NOISE, 2))))
table = np.array(rows)
names = tuple(f"photograph {k}" for k in range(4))
observations = Observations(*table[:, :3].T.astype(int), table[:, 3:], names, NOISE)

found = calibrate(observations, board, nominal)
print(f"{len(observations)} corners, residuals {found.rms:.3f} px rms, {found.outliers.sum()} outliers")
for name, start, value, sigma, unit in found.table():
    print(f"  {name:16} {start:9.4f} -> {value:9.4f} +- {sigma:.4f} {unit}")
for text in (*warnings_of(found), *(direction.text for direction in undetermined(found))):
    print("  note:", text)

for depth, noise, calibration, total, _ in depth_errors(found, (600, 900, 1200), pixel_sigma=0.1).table():
    print(
        f"at {depth:g} mm: depth +- {total:.2f} mm, {calibration:.2f} mm of it by the calibration (noise: {noise:.2f})"
    )
print("next:", guide(found, (600, 900, 1200)).advice[0].text)
