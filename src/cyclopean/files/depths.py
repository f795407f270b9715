"""Depth maps as NPZ: one value for every pixel of the photograph."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from ..errors import ImageError, ShapeError
from .disk import PathLike, read_arrays, replacing

_TYPES = {"depth": np.float32, "confidence": np.float32, "sigma": np.float32, "view": np.int8}
CONVENTIONS = """\
Every array is [y, x], one value for each pixel of the photograph, (0, 0) the top-left one.
depth: mm, z of what the pixel shows, in the camera frame (x right, y down, z forward); NaN unknown
confidence: 0 to 1, higher is surer
sigma: mm, standard deviation of depth; NaN unknown
view: number of the view that the pixel belongs to, counted from 0; -1 none
"""


def write_depths(path: PathLike, **arrays: ArrayLike) -> None:
    """Write a depth map and what belongs to it as compressed NPZ.

    Parameters
    ----------
    path : path
        Where to write.
    depth : (H, W) array
        mm, z in the camera's frame; NaN unknown.
    confidence, sigma : (H, W) array, optional
        0 to 1, and the standard deviation of depth in mm.
    view : (H, W) array of int, optional
        Number of the view that each pixel belongs to; -1 none.
    """
    unknown = ", ".join(sorted(set(arrays) - set(_TYPES)))
    if unknown or "depth" not in arrays:
        raise ShapeError(f"a depth file holds depth and, if known, confidence, sigma and view; got {', '.join(arrays)}")
    shape = np.shape(arrays["depth"])
    stored = {name: _as_stored(name, values, shape) for name, values in arrays.items()}
    with replacing(path) as file:
        np.savez_compressed(file, conventions=np.array(CONVENTIONS), **stored)


def _as_stored(name, values, shape):
    values = np.asarray(values)
    if len(shape) != 2 or values.shape != shape:
        raise ShapeError(f"depth must have shape (H, W) and {name} the same, got {shape} and {values.shape}")
    if name == "view" and not (values.dtype.kind in "iu" and ((values >= -1) & (values < 128)).all()):
        raise ShapeError(f"view must hold whole numbers from -1 to 127, got {values.dtype}")
    return values.astype(_TYPES[name])


def read_depths(path: PathLike) -> dict[str, np.ndarray]:
    """The arrays that `write_depths` wrote, by name.

    Raises
    ------
    ImageError
        When the file is missing, damaged, or no depth map.
    """
    arrays = read_arrays(path, _TYPES, "depth map")
    if "depth" not in arrays:
        raise ImageError(f"{path}: this NPZ file holds no array named depth, so it is no depth map")
    return arrays
