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


def check_inside(pixels: ArrayLike, size: tuple[int, int]) -> None:
    """A ShapeError where pixels (..., 2) lie more than a pixel outside a picture of a size (width, height) px."""
    pixels = as_pixels(pixels).reshape(-1, 2)
    known = pixels[np.isfinite(pixels).all(-1)]
    width, height = size
    outside = (known < -1.5).any(-1) | (known > [width + 0.5, height + 0.5]).any(-1)
    if not outside.any():
        return
    (left, top), (right, bottom) = known.min(0), known.max(0)
    fits = min(left, top) > -1.5 and right <= height + 0.5 and bottom <= width + 0.5
    hint = "did you swap width and height?" if fits else "are they those of this camera, at full size?"
    raise ShapeError(
        f"{outside.sum()} of {len(known)} pixels lie outside a picture of {width} x {height} px: x goes from "
        f"{left:.6g} to {right:.6g}, y from {top:.6g} to {bottom:.6g}; {hint}"
    )


def white_level(image: ArrayLike) -> float:
    """The value that stands for white in a picture.

    255 for 8 bits. A camera may use only 10, 12 or 14 of 16 bits: the smallest power of two (less one) that holds
    the picture. For real numbers the 99.9th percentile, which hot pixels do not move.
    """
    picture = np.asarray(image)
    if picture.dtype == np.uint8:
        return 255.0
    known = picture[np.isfinite(picture)]
    if picture.dtype.kind == "u":
        return float(2 ** max(8, int(known.max(initial=0)).bit_length()) - 1)
    positive = known[known > 0]
    return float(np.percentile(positive, 99.9)) if positive.size else 1.0


def as_rgb(image: ArrayLike) -> np.ndarray:
    """A picture of any depth, (H, W) or (H, W, C), as (H, W, 3) uint8 for showing.

    Scaled by its `white_level`; NaN becomes black.
    """
    picture = np.asarray(image)
    if picture.dtype != np.uint8:
        scale = np.float32(255 / white_level(picture))
        picture = np.nan_to_num(picture.astype(np.float32), posinf=0, neginf=0) * scale
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
