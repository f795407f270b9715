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


def as_rgb(image: ArrayLike) -> np.ndarray:
    """A picture of any depth, (H, W) or (H, W, C), as (H, W, 3) uint8 for showing.

    Unsigned integers keep their type's scale, real numbers are scaled to the largest; NaN becomes black.
    """
    picture = np.asarray(image)
    if picture.dtype != np.uint8:
        known = picture[np.isfinite(picture)]
        top = np.iinfo(picture.dtype).max if picture.dtype.kind == "u" else max(float(known.max(initial=0)), 1e-12)
        picture = np.nan_to_num(picture.astype(np.float32), posinf=0, neginf=0) * np.float32(255 / top)
        picture = np.clip(picture, 0, 255).astype(np.uint8)
    if picture.ndim == 2:
        picture = picture[..., None]
    return picture[..., :3] if picture.shape[-1] >= 3 else np.repeat(picture[..., :1], 3, axis=-1)


def _with_last_axis(values, size, name):
    values = np.asarray(values, dtype=float)
    if values.ndim == 0 or values.shape[-1] != size:
        hint = f"; did you mean {name}.T?" if values.ndim == 2 and values.shape[0] == size else ""
        raise ShapeError(f"{name} must have shape (..., {size}), got {values.shape}{hint}")
    return values
