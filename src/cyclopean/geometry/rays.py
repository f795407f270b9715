"""Bundles of rays, and the points that lie nearest to them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike


@dataclass(frozen=True, eq=False)
class Rays:
    """Half-lines in the rig frame; NaN where there is no ray."""

    origins: np.ndarray  # (..., 3) mm
    directions: np.ndarray  # (..., 3) unit

    def at(self, distance: ArrayLike) -> np.ndarray:
        """Points this far along each ray, (...,) mm -> (..., 3) mm."""
        return self.origins + np.asarray(distance)[..., None] * self.directions

    def at_depth(self, depth: ArrayLike) -> np.ndarray:
        """Points (..., 3) mm where each ray reaches this z (...,) mm; NaN where it points away from there."""
        distance = (np.asarray(depth) - self.origins[..., 2]) / self.directions[..., 2]
        return self.at(np.where(distance >= 0, distance, np.nan))

    def __getitem__(self, index) -> Rays:
        return Rays(self.origins[index], self.directions[index])

    @property
    def shape(self) -> tuple[int, ...]:
        """Shape of the bundle, without the axis of the components."""
        return self.directions.shape[:-1]


@dataclass(frozen=True, eq=False)
class NearestPoint:
    """The points that lie nearest to bundles of rays."""

    points: np.ndarray  # (..., 3) mm, NaN where fewer than two rays cross there
    covariance: np.ndarray  # (..., 3, 3) mm^2, for the stated weights
    rms: np.ndarray  # (...,) mm, weighted root mean square distance from the point to its rays


def nearest_point(rays: Rays, weights: ArrayLike | None = None) -> NearestPoint:
    """The point that minimises the weighted sum of squared distances to n rays.

    Parameters
    ----------
    rays : Rays
        (..., N) rays; NaN rays do not count.
    weights : (..., N) array, optional
        One over the variance (1/mm^2) of each ray across its own direction; 1 where not given.

    Returns
    -------
    NearestPoint
        Points (..., 3), NaN where fewer than two rays are left or all of them are parallel.

    References
    ----------
    Slabaugh, Schafer, Livingston 2001, Optimal ray intersection for computing 3D points from N-view
    correspondences, eq. 5.
    """
    origins, directions = rays.origins, rays.directions
    good = np.isfinite(directions).all(-1) & np.isfinite(origins).all(-1)
    weights = np.broadcast_to(1.0 if weights is None else np.asarray(weights, float), good.shape)
    weights = np.where(good & (weights > 0), weights, 0.0)
    directions = np.where(good[..., None], directions, 0.0)
    centre = np.where(good[..., None], origins, 0.0)
    count = np.maximum(good.sum(-1), 1)[..., None]
    shift = centre.sum(-2) / count  # work near the rays: no digits lost to a far origin
    centre = np.where(good[..., None], centre - shift[..., None, :], 0.0)
    across = np.eye(3) - directions[..., :, None] * directions[..., None, :]  # projects on a ray's normal plane
    information = np.einsum("...n,...nij->...ij", weights, across)
    moment = np.einsum("...n,...nij,...nj->...i", weights, across, centre)
    values = np.linalg.eigvalsh(information)
    solvable = (np.count_nonzero(weights, axis=-1) >= 2) & (values[..., 0] > 1e-14 * values[..., 2])
    safe = np.where(solvable[..., None, None], information, np.eye(3))
    covariance = np.where(solvable[..., None, None], np.linalg.inv(safe), np.nan)
    points = np.where(solvable[..., None], np.linalg.solve(safe, moment[..., None])[..., 0], np.nan)
    miss = np.einsum("...nij,...nj->...ni", across, points[..., None, :] - centre)
    total = np.maximum(weights.sum(-1), np.finfo(float).tiny)
    rms = np.sqrt((weights * (miss**2).sum(-1)).sum(-1) / total)
    return NearestPoint(points + shift, covariance, rms)


def shortest_segment(first: Rays, second: Rays) -> tuple[np.ndarray, np.ndarray]:
    """End points of the shortest segment between two lines.

    Parameters
    ----------
    first, second : Rays
        (...,) rays each, taken as lines that run on to both sides.

    Returns
    -------
    on_first, on_second : (..., 3) arrays
        Where the segment touches each line, mm; NaN where the lines are parallel.

    References
    ----------
    Eberly, Robust computation of distance between line segments, section 2 (lines).
    """
    between = first.origins - second.origins
    a = np.sum(first.directions**2, -1)
    b = np.sum(first.directions * second.directions, -1)
    c = np.sum(second.directions**2, -1)
    d = np.sum(first.directions * between, -1)
    e = np.sum(second.directions * between, -1)
    # |cross|^2 instead of a c - b^2, which cancels for nearly parallel lines
    determinant = np.sum(np.cross(first.directions, second.directions) ** 2, -1)
    with np.errstate(divide="ignore", invalid="ignore"):
        determinant = np.where(determinant > 1e-28, determinant, np.nan)
        return first.at((b * e - c * d) / determinant), second.at((a * e - b * d) / determinant)
