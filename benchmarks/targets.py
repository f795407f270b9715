"""Boards in the renderer's photographs: true corners with noise, or corners that our own detector finds."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np

from benchmarks.data import data_folder, renderer_setup
from cyclopean import read_photograph
from cyclopean.jobs.experiment_photographs import RenderedSet, rendered_set
from cyclopean.targets import Board, Observations, observe


@dataclass(frozen=True, eq=False)
class Corners:
    """Observations of one set of photographs, and what is true about them."""

    board: Board
    observations: Observations
    truth: np.ndarray  # (N, 2) px, true pixel of each row; NaN where the renderer knows none
    points: np.ndarray  # (N, 3) mm, true place of each row in the camera's frame
    depths: np.ndarray  # (B,) mm, of the plane in `targets_*`; NaN elsewhere
    visible: int  # true corners in all photographs together
    notes: tuple[str, ...] = ()


def renderer_corners(name: str, noise: float = 0.0, seed: int = 1) -> Corners:
    """True corners of a set of photographs, such as `calib_n3`, with Gaussian noise of so many px."""
    given, truth = _set(name)
    rng = np.random.default_rng(seed)
    pixels = truth["uv"] + rng.normal(0, noise, truth["uv"].shape) if noise else truth["uv"]
    observations = Observations(truth["view"], truth["facet"], truth["corner_id"], pixels, given.files, 0.05)
    return Corners(given.board, observations, truth["uv"], truth["xyz_cam"], given.depths, len(truth["uv"]))


@cache
def detected_corners(name: str) -> Corners:
    """What our detector finds in a set of photographs, looking in the renderer's true sub-images."""
    given, truth = _set(name)
    photographs = [(path.name, read_photograph(path)) for path in given.paths]
    masks = None if name == "camera_only" else renderer_setup(rig_of(name)).rig().masks
    observations, notes = observe(photographs, given.board, masks)
    keys = zip(truth["view"], truth["facet"], truth["corner_id"], strict=True)
    known = {tuple(int(k) for k in key): row for row, key in enumerate(keys)}
    found = zip(observations.photo, observations.view, observations.point, strict=True)
    rows = np.array([known.get((int(p), int(v), int(c)), -1) for p, v, c in found])
    pixels, points = (np.where(rows[:, None] >= 0, truth[key][rows], np.nan) for key in ("uv", "xyz_cam"))
    return Corners(given.board, observations, pixels, points, given.depths, len(truth["uv"]), tuple(notes))


def rig_of(name: str) -> str:
    """The rig that took a set: `n3_pose` of `calib_n3_pose`."""
    rig = name.split("_", 1)[1]
    return rig.removesuffix("_chroma").removesuffix("_ghosts")


def _set(name) -> tuple[RenderedSet, dict[str, np.ndarray]]:
    given = rendered_set(data_folder("mitsuba"), name)
    with np.load(given.folder / "corners.npz") as truth:
        return given, {key: truth[key] for key in ("view", "facet", "corner_id", "uv", "xyz_cam")}
