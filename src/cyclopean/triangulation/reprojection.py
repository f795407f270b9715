"""The points that explain corresponding pixels best, and the covariance of points."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from ..geometry import Rays, nearest_point
from ..rigs import ViewLike
from .points import Points, as_correspondences, as_noise, kept, symmetric_inverse


def triangulate(views: Sequence[ViewLike], pixels: ArrayLike, sigma: ArrayLike = 0.1) -> Points:
    """The points that explain corresponding pixels best.

    Starts from the point nearest to the rays, each weighted by its distance, and then minimises the
    reprojection error through the optic (Gauss-Newton), which is the maximum-likelihood point for
    independent pixels.

    Parameters
    ----------
    views : sequence of V views
        A rig, or any views that can `rays`, `project` and give `pixel_derivatives`.
    pixels : (..., V, 2) array
        The same point as each view sees it; NaN where a view does not.
    sigma : float or (..., V) array
        Standard deviation of each pixel coordinate, px. One number only scales the covariance; different ones weigh
        the pixels.

    Returns
    -------
    Points
        (...,) points with covariance and residual.

    References
    ----------
    Hartley and Zisserman, Multiple View Geometry, section 12.3.
    """
    pixels = as_correspondences(pixels, len(views))
    noise = as_noise(sigma, pixels)
    rays = [view.rays(pixels[..., k, :]) for k, view in enumerate(views)]
    bundle = Rays(np.stack([r.origins for r in rays], -2), np.stack([r.directions for r in rays], -2))
    seen = np.isfinite(bundle.directions).all(-1) & np.isfinite(pixels).all(-1)
    points = nearest_point(bundle).points
    distance = np.linalg.norm(points[..., None, :] - bundle.origins, axis=-1)
    points = nearest_point(bundle, 1 / (noise * np.maximum(distance, 1e-9)) ** 2).points
    weights = 1 / noise**2
    for _ in range(3):
        miss, jacobian, _ = _miss(views, points, pixels, seen)
        normal = np.einsum("...v,...vij,...vik->...jk", weights, jacobian, jacobian)
        gradient = np.einsum("...v,...vij,...vi->...j", weights, jacobian, miss)
        step = _solve(normal, gradient)
        points = points + np.where(np.isfinite(step), step, 0.0)
    miss, jacobian, good = _miss(views, points, pixels, seen)
    count = seen.sum(-1)
    residual = np.sqrt((miss**2).sum((-1, -2)) / np.maximum(2 * count, 1))
    found = (count >= 2) & (good == seen).all(-1) & np.isfinite(points).all(-1)  # not where rays cross behind the glass
    covariance = symmetric_inverse(np.einsum("...v,...vij,...vik->...jk", weights, jacobian, jacobian))
    return kept(points, covariance, residual, count, found)


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
    return symmetric_inverse(information) * np.asarray(sigma)[..., None, None] ** 2


def _miss(views, points, pixels, seen):
    """Pixel errors (..., V, 2), their derivatives (..., V, 2, 3) and which views count (..., V); zero where not."""
    derivatives = [view.unbounded().pixel_derivatives(points) for view in views]
    miss = pixels - np.stack([d.pixels for d in derivatives], -2)
    jacobian = np.stack([d.to_point for d in derivatives], -3)
    good = seen & np.isfinite(miss).all(-1)
    return np.where(good[..., None], miss, 0.0), np.where(good[..., None, None], jacobian, 0.0), good


def _solve(matrices, vectors):
    return np.einsum("...ij,...j->...i", symmetric_inverse(matrices), vectors)
