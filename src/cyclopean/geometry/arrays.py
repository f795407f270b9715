"""Checks on arrays that users hand in."""

import numpy as np
from numpy.typing import ArrayLike

from ..errors import ShapeError


def as_pixels(pixels: ArrayLike) -> np.ndarray:
    """Pixels as a float64 array (..., 2), or a ShapeError that says what came instead."""
    return _with_last_axis(pixels, 2, "pixels")


def as_points(points: ArrayLike) -> np.ndarray:
    """Points as a float64 array (..., 3) mm, or a ShapeError that says what came instead."""
    return _with_last_axis(points, 3, "points")


def _with_last_axis(values, size, name):
    values = np.asarray(values, dtype=float)
    if values.ndim == 0 or values.shape[-1] != size:
        hint = f"; did you mean {name}.T?" if values.ndim == 2 and values.shape[0] == size else ""
        raise ShapeError(f"{name} must have shape (..., {size}), got {values.shape}{hint}")
    return values
