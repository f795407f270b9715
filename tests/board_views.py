"""Synthetic photographs of a flat board: where a setup's views show its points, with noise."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from cyclopean import Camera, Prism, Setup
from cyclopean.geometry import Pose
from cyclopean.targets import Observations


@dataclass(frozen=True, eq=False)
class Grid:
    """A board of columns x rows points, `square` mm apart."""

    columns: int = 9
    rows: int = 7
    square: float = 20.0

    @property
    def points(self):
        x, y = np.meshgrid(np.arange(self.columns), np.arange(self.rows))
        return self.square * np.stack([x, y, 0 * x], -1).reshape(-1, 3).astype(float)


BOARD = Grid()
CAMERA = Camera((640, 480), 1200)
NOISE = 0.05  # px


def prism_setup(facets=3, **changes) -> Setup:
    given = {"apex_deg": 12.0, "glass": "N-BK7", "distance": 60.0, "thickness": 8.0, "azimuth_deg": 90.0}
    given |= {"azimuth_deg": 0.0} if facets == 2 else {}
    return Setup(CAMERA, Prism(facets, **(given | changes)), depths=(450.0, 900.0))


def pose_at(x, y, depth, tilt_x=0.0, tilt_y=0.0, board=BOARD) -> Pose:
    """The board with its middle at (x, y, depth) mm, tilted by degrees about x and y."""
    turn = Pose.from_rotation_vector(np.deg2rad([tilt_x, tilt_y, 3.0])).rotation
    return Pose(turn, np.array([x, y, depth]) - turn @ board.points.mean(0))


POSES = (
    pose_at(0, 0, 500, 25, 0),
    pose_at(30, -20, 600, 0, -30),
    pose_at(-40, 20, 700, -25, 20),
    pose_at(10, 30, 850, 20, 25),
    pose_at(-20, -30, 550, -10, -35),
)


def observe_exactly(setup, poses, board=BOARD) -> Observations:
    """Exact pixels of the board's points in the sub-images that show them."""
    photo, view, point, pixels = [], [], [], []
    for k, pose in enumerate(poses):
        for number, sub in enumerate(setup.rig()):
            here = sub.project(pose @ board.points)
            shown = np.flatnonzero(sub.region.contains(here))
            photo += [k] * len(shown)
            view += [number] * len(shown)
            point += list(shown)
            pixels.append(here[shown])
    names = tuple(f"photo {k}" for k in range(len(poses)))
    return Observations(photo, view, point, np.concatenate(pixels), names, NOISE)


def with_noise(observations, seed=0, sigma=NOISE) -> Observations:
    noise = np.random.default_rng(seed).normal(0, sigma, observations.pixels.shape)
    return replace(observations, pixels=observations.pixels + noise)
