"""What is true in a simulated photograph, as NPZ."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from ..errors import ImageError
from ..simulation.truth import Matches, Truth
from .disk import PathLike, read_arrays, replacing

CONVENTIONS = """\
All of it holds for the central ray of each pixel, through the closed aperture, at the setup's wavelength.
depth, xyz, facet and object are [y, x], one value for each pixel of the photograph, (0, 0) the top-left one.
Camera frame: x right, y down, z forward, the pinhole at the origin; mm; pixels are (x, y).
depth: mm, z of what the pixel shows, float64; NaN none
xyz: mm, the point that the pixel shows, rounded to float32; NaN none
facet: number of the view that the pixel belongs to, counted from 0; -1 none
object: number of the object that the pixel shows, a row of object_names, counted from 0; -1 none
match_xyz: (N, 3) mm, points of the scene
match_uv: (N, V, 2) px, where each view shows them; NaN where they are hidden from it or outside its sub-image
match_from: (N,) the view that each point was drawn from
"""
_KEYS = ("depth", "xyz", "facet", "object", "match_xyz", "match_uv", "match_from", "object_names")


def write_truth(path: PathLike, truth: Truth, matches: Matches, names: Sequence[str]) -> None:
    """Write what is true in a simulated photograph as compressed NPZ.

    Parameters
    ----------
    path : path
        Where to write.
    truth : Truth
        Of the photograph.
    matches : Matches
        Points and where every view shows them.
    names : sequence of str
        Of the scene's surfaces.
    """
    arrays: dict[str, Any] = {
        "depth": truth.depth,
        "xyz": truth.points.astype(np.float32),
        "facet": truth.facet.astype(np.int8),
        "object": truth.surface.astype(np.int16),
        "match_xyz": matches.points,
        "match_uv": matches.pixels,
        "match_from": matches.first.astype(np.int8),
        "object_names": np.array(names, dtype=str),
    }
    with replacing(path) as file:
        np.savez_compressed(file, conventions=np.array(CONVENTIONS), **arrays)


def read_truth(path: PathLike) -> dict[str, np.ndarray]:
    """The arrays that `write_truth` wrote, by name.

    Raises
    ------
    ImageError
        When the file is missing, damaged, or no truth of a simulated photograph.
    """
    arrays = read_arrays(path, _KEYS, "truth of a simulated photograph")
    missing = [name for name in _KEYS if name not in arrays]
    if missing:
        raise ImageError(f"{path}: this is no truth of a simulated photograph: it holds no {', '.join(missing)}")
    return arrays
