"""Triangulated points: what every method gives, and what the methods share."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from ..errors import SetupError, ShapeError


@dataclass(frozen=True, eq=False)
class Points:
    """Triangulated points in the rig frame."""

    points: np.ndarray  # (..., 3) mm; NaN where fewer than two views see the point, or their rays part
    covariance: np.ndarray  # (..., 3, 3) mm^2
    residual: np.ndarray  # (...,) px, root mean square over the coordinates of the pixels
    views: np.ndarray  # (...,) int, how many views were used


def as_correspondences(pixels: ArrayLike, views: int) -> np.ndarray:
    """Pixels as a float64 array (..., V, 2), or a ShapeError that says what came instead."""
    pixels = np.asarray(pixels, dtype=float)
    if pixels.shape[-2:] != (views, 2):
        raise ShapeError(f"pixels must have shape (..., {views}, 2), one pixel for each view, got {pixels.shape}")
    return pixels


def as_noise(sigma: ArrayLike, pixels: np.ndarray) -> np.ndarray:
    """Standard deviations (..., V) px of pixels (..., V, 2), from one number or an array that broadcasts to them.

    They may be NaN where the pixel is.
    """
    sigma = np.asarray(sigma, dtype=float)
    try:
        noise = np.broadcast_to(sigma, pixels.shape[:-1])
    except ValueError:
        wanted = f"one number or an array for pixels of shape {pixels.shape[:-1]}"
        raise ShapeError(f"sigma must be {wanted}, got {sigma.shape}") from None
    unknown = np.isnan(pixels).any(-1)
    if not ((np.isfinite(noise) & (noise > 0)) | unknown).all():
        raise SetupError("the noise of each pixel (sigma, px) must be positive and finite where the pixel is known")
    return np.where(unknown, 1.0, noise)


def kept(points, covariance, residual, views, good) -> Points:
    """Points, with NaN for all of them but the good (...,) ones."""
    return Points(
        np.where(good[..., None], points, np.nan),
        np.where(good[..., None, None], covariance, np.nan),
        np.where(good, residual, np.nan),
        views,
    )


def symmetric_inverse(matrices: np.ndarray) -> np.ndarray:
    """Inverses of symmetric (..., 3, 3) matrices; NaN where they are singular or hold NaN."""
    values = np.linalg.eigvalsh(np.where(np.isfinite(matrices), matrices, 0.0))
    good = np.isfinite(matrices).all((-1, -2)) & (values[..., 0] > 1e-15 * values[..., 2])
    inverses = np.linalg.inv(np.where(good[..., None, None], matrices, np.eye(3)))
    return np.where(good[..., None, None], inverses, np.nan)
