"""The points that explain corresponding pixels best, and the covariance of points."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from ..errors import ShapeError
from ..geometry import Rays, nearest_point
from ..rigs import ViewLike


@dataclass(frozen=True, eq=False)
class Points:
    """Triangulated points in the rig frame."""

    points: np.ndarray  # (..., 3) mm; NaN where fewer than two views see the point, or their rays part
    covariance: np.ndarray  # (..., 3, 3) mm^2
    residual: np.ndarray  # (...,) px, root mean square over the coordinates of the pixels
    views: np.ndarray  # (...,) int, how many views were used


def triangulate(views: Sequence[ViewLike], pixels: ArrayLike, sigma: float = 0.1) -> Points:
    """The points that explain corresponding pixels best.

    Starts from the point nearest to the rays, each weighted by its distance, and then minimises the
    reprojection error through the optic (Gauss-Newton), which is the maximum-likelihood point for
    independent, equally noisy pixels.

    Parameters
    ----------
    views : sequence of V views
        A rig, or any views that can `rays`, `project` and give `pixel_derivatives`.
    pixels : (..., V, 2) array
        The same point as each view sees it; NaN where a view does not.
    sigma : float
        Standard deviation of each pixel coordinate, px; scales the covariance.

    Returns
    -------
    Points
        (...,) points with covariance and residual.

    References
    ----------
    Hartley and Zisserman, Multiple View Geometry, section 12.3.
    """
    pixels = np.asarray(pixels, dtype=float)
    if pixels.shape[-2:] != (len(views), 2):
        raise ShapeError(f"pixels must have shape (..., {len(views)}, 2), one pixel for each view, got {pixels.shape}")
    rays = [view.rays(pixels[..., k, :]) for k, view in enumerate(views)]
    bundle = Rays(np.stack([r.origins for r in rays], -2), np.stack([r.directions for r in rays], -2))
    seen = np.isfinite(bundle.directions).all(-1) & np.isfinite(pixels).all(-1)
    points = nearest_point(bundle).points
    distance = np.linalg.norm(points[..., None, :] - bundle.origins, axis=-1)
    points = nearest_point(bundle, 1 / np.maximum(distance, 1e-9) ** 2).points
    for _ in range(3):
        miss, jacobian, _ = _miss(views, points, pixels, seen)
        normal = np.einsum("...vij,...vik->...jk", jacobian, jacobian)
        gradient = np.einsum("...vij,...vi->...j", jacobian, miss)
        step = _solve(normal, gradient)
        points = points + np.where(np.isfinite(step), step, 0.0)
    miss, jacobian, good = _miss(views, points, pixels, seen)
    count = seen.sum(-1)
    residual = np.sqrt((miss**2).sum((-1, -2)) / np.maximum(2 * count, 1))
    lost = (count < 2) | (good != seen).any(-1) | ~np.isfinite(points).all(-1)  # also rays that cross behind the glass
    covariance = _invert(np.einsum("...vij,...vik->...jk", jacobian, jacobian)) * sigma**2
    points = np.where(lost[..., None], np.nan, points)
    return Points(points, np.where(lost[..., None, None], np.nan, covariance), np.where(lost, np.nan, residual), count)


def point_covariance(
    views: Sequence[ViewLike], points: ArrayLike, sigma: float | np.ndarray = 0.1, seen: ArrayLike | None = None
) -> np.ndarray:
    """Covariance (..., 3, 3) mm^2 of points (..., 3) that views see with noise of `sigma` px a coordinate.

    `sigma` is one number or (...,); `seen` (..., V) says which views count, all that see the point where it
    is not given. NaN where fewer than two do.
    """
    points = np.asarray(points, dtype=float)
    jacobian = np.stack([view.pixel_derivatives(points).to_point for view in views], -3)  # (..., V, 2, 3)
    good = np.isfinite(jacobian).all((-1, -2))
    if seen is not None:
        good &= np.asarray(seen, dtype=bool)
    jacobian = np.where(good[..., None, None], jacobian, 0.0)
    information = np.einsum("...vij,...vik->...jk", jacobian, jacobian)
    information = np.where((good.sum(-1) >= 2)[..., None, None], information, np.nan)
    return _invert(information) * np.asarray(sigma)[..., None, None] ** 2


def _miss(views, points, pixels, seen):
    """Pixel errors (..., V, 2), their derivatives (..., V, 2, 3) and which views count (..., V); zero where not."""
    derivatives = [view.unbounded().pixel_derivatives(points) for view in views]
    miss = pixels - np.stack([d.pixels for d in derivatives], -2)
    jacobian = np.stack([d.to_point for d in derivatives], -3)
    good = seen & np.isfinite(miss).all(-1)
    return np.where(good[..., None], miss, 0.0), np.where(good[..., None, None], jacobian, 0.0), good


def _invert(matrices):
    """Inverses of symmetric (..., 3, 3) matrices; NaN where they are singular or hold NaN."""
    values = np.linalg.eigvalsh(np.where(np.isfinite(matrices), matrices, 0.0))
    good = np.isfinite(matrices).all((-1, -2)) & (values[..., 0] > 1e-15 * values[..., 2])
    inverses = np.linalg.inv(np.where(good[..., None, None], matrices, np.eye(3)))
    return np.where(good[..., None, None], inverses, np.nan)


def _solve(matrices, vectors):
    return np.einsum("...ij,...j->...i", _invert(matrices), vectors)
