"""What a measurement gives, and the checks that all kinds share."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from ..errors import MeasurementError, ShapeError


@dataclass(frozen=True, eq=False)
class Measured:
    """A measured value and how well it is known.

    The standard deviation is that of the points' covariances, which are taken to be independent, to first order.
    """

    value: np.ndarray  # (...,) mm, mm^2 or rad
    sigma: np.ndarray  # (...,) its standard deviation, in the same unit
    gradient: np.ndarray  # (..., N, 3) derivative of the value to every coordinate of the N points
    flatness: np.ndarray | None = None  # (...,) mm, root mean square distance of the points from their plane


def as_group(points: ArrayLike, covariance: ArrayLike | None, least: int, most: int | None, what: str):
    """Points (..., N, 3) and covariances (..., N, 3, 3), zeros where not given, or a ShapeError."""
    points = np.asarray(points, dtype=float)
    count = points.shape[-2] if points.ndim >= 2 else 0
    if points.shape[-1:] != (3,) or count < least or (most is not None and count > most):
        wanted = str(least) if most == least else f"{least} or more"
        raise ShapeError(f"{what} wants points (..., {wanted}, 3) in mm, got shape {points.shape}")
    if covariance is None:
        return points, np.zeros((*points.shape, 3))
    covariance = np.asarray(covariance, dtype=float)
    if covariance.shape != (*points.shape, 3):
        raise ShapeError(f"{what}: covariances must have shape {(*points.shape, 3)} in mm^2, got {covariance.shape}")
    return points, covariance


def measured(value, gradient, covariance, flatness=None) -> Measured:
    """A value with its standard deviation, from gradients (..., N, 3) and covariances (..., N, 3, 3)."""
    variance = np.einsum("...ni,...nij,...nj->...", gradient, covariance, gradient)
    return Measured(np.asarray(value), np.sqrt(np.maximum(variance, 0.0)), gradient, flatness)


def unit(vectors: np.ndarray, what: str) -> tuple[np.ndarray, np.ndarray]:
    """Unit vectors (..., 3) and lengths (...,); a MeasurementError where a length is zero."""
    lengths = np.linalg.norm(vectors, axis=-1)
    if (lengths == 0).any():
        raise MeasurementError(f"{what}: two points are the same; take points that lie apart")
    return vectors / lengths[..., None], lengths
