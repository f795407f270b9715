"""The points nearest to rays: in mm, without projecting anything."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from ..errors import ShapeError
from ..geometry import NearestPoint, Rays, nearest_point
from ..rigs import ViewLike
from .points import Points, as_correspondences, as_noise, kept


def midpoint(views: Sequence[ViewLike], pixels: ArrayLike, sigma: ArrayLike = 0.1) -> Points:
    """The middle of the shortest segment between the rays of two views.

    Parameters
    ----------
    views : sequence of 2 views
        A rig of two, or any two views.
    pixels : (..., 2, 2) array
        The same point as each view sees it.
    sigma : float or (..., 2) array
        Standard deviation of each pixel coordinate, px.

    Returns
    -------
    Points
        With the covariance of the midpoint itself, to first order in the noise. It is that of `triangulate` where both
        views are equally far and equally magnified, and larger where they are not.

    References
    ----------
    Beardsley, Zisserman, Murray 1994, Navigation using affine structure from motion; Hartley and Sturm 1997,
    Triangulation, section 5.1.
    """
    if len(views) != 2:
        raise ShapeError(f"a midpoint is that of 2 rays, got {len(views)} views; nearest_to_rays takes any number")
    return nearest_to_rays(views, pixels, sigma, weighted=False)


def nearest_to_rays(
    views: Sequence[ViewLike], pixels: ArrayLike, sigma: ArrayLike = 0.1, weighted: bool = True
) -> Points:
    """The point that is nearest to the rays of n views, by least squares in mm.

    Parameters
    ----------
    views : sequence of V views
        A rig, or any views.
    pixels : (..., V, 2) array
        The same point as each view sees it; NaN where a view does not.
    sigma : float or (..., V) array
        Standard deviation of each pixel coordinate, px.
    weighted : bool
        Weigh each ray by one over its variance (mm^2) where it passes the point; equal weights without.

    Returns
    -------
    Points
        With the covariance of this estimate, to first order in the noise.

    Notes
    -----
    A ray moves across itself by T times the error of its pixel, where T (3, 2) is the pseudo-inverse of the
    derivative of the pixel to the point. The point moves by the solution of the normal equations for that; weights do
    not move it to first order, for they multiply distances that are zero without noise.

    References
    ----------
    Slabaugh, Schafer, Livingston 2001, Optimal ray intersection for computing 3D points from N-view correspondences.
    """
    pixels = as_correspondences(pixels, len(views))
    noise = as_noise(sigma, pixels)
    rays = [view.rays(pixels[..., k, :]) for k, view in enumerate(views)]
    bundle = Rays(np.stack([r.origins for r in rays], -2), np.stack([r.directions for r in rays], -2))
    seen = np.isfinite(bundle.directions).all(-1) & np.isfinite(pixels).all(-1)
    found, weights = nearest_point(bundle), np.ones(seen.shape)
    _, moves, _ = _at_points(views, found.points)
    if weighted:
        variance = noise**2 * (moves**2).sum((-1, -2)) / 2
        weights = np.where(seen & np.isfinite(variance), 1 / np.maximum(variance, 1e-300), 0.0)
        found = nearest_point(bundle, weights)
    predicted, moves, ahead = _at_points(views, found.points)
    count = seen.sum(-1)
    miss = np.where(seen[..., None], pixels - predicted, 0.0)
    residual = np.sqrt((miss**2).sum((-1, -2)) / np.maximum(2 * count, 1))
    good = (count >= 2) & (ahead | ~seen).all(-1) & np.isfinite(found.points).all(-1)
    covariance = _propagated(found, np.where(seen, weights, 0.0), moves, noise)
    return kept(found.points, covariance, residual, count, good)


def _at_points(views, points):
    """Pixels (..., V, 2) of points, how rays move across themselves (..., V, 3, 2) mm/px, who sees points (..., V)."""
    derivatives = [view.unbounded().pixel_derivatives(points) for view in views]
    pixels = np.stack([d.pixels for d in derivatives], -2)
    jacobian = np.stack([d.to_point for d in derivatives], -3)
    seen = np.isfinite(jacobian).all((-1, -2))
    safe = np.where(seen[..., None, None], jacobian, np.eye(2, 3))
    square = np.einsum("...ij,...kj->...ik", safe, safe)
    moves = np.einsum("...ji,...jk->...ik", safe, np.linalg.inv(square))
    return pixels, np.where(seen[..., None, None], moves, np.nan), seen


def _propagated(found: NearestPoint, weights, moves, noise):
    """Covariance (..., 3, 3) of nearest points; `found.covariance` is the inverse of the normal matrix."""
    steps = np.where(weights[..., None, None] > 0, weights[..., None, None] * noise[..., None, None] * moves, 0.0)
    steps = np.einsum("...ij,...vjk->...vik", found.covariance, steps)
    return np.einsum("...vik,...vjk->...ij", steps, steps)
