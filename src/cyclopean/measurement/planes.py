"""Measurements on planes: depth below a surface, area of a polygon."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from ..errors import MeasurementError
from .measured import Measured, as_group, measured

_NARROW = 2.0  # points of a plane must spread by more than so many times their own noise, in every direction


class Plane(NamedTuple):
    """The plane that is nearest to points by least squares."""

    centre: np.ndarray  # (..., 3) mm
    normal: np.ndarray  # (..., 3) unit, away from the camera (z > 0)
    axes: np.ndarray  # (..., 2, 3) unit vectors in the plane, the direction of the smaller spread first
    spreads: np.ndarray  # (..., 2) mm^2, sums of squares along them
    rest: np.ndarray  # (...,) mm^2, sum of squares across the plane


def best_plane(points: ArrayLike, covariance: ArrayLike | None = None) -> Plane:
    """The plane of least squared distances from points (..., N, 3) mm, N 3 or more.

    Raises
    ------
    MeasurementError
        When the points lie on one line, or do so within their noise.

    References
    ----------
    Pearson, Philosophical Magazine 2(11), 1901: the normal is the direction of the least moment.
    """
    points, noise = as_group(points, covariance, 3, None, "a plane")
    centre = points.mean(-2)
    arms = points - centre[..., None, :]
    known = np.isfinite(arms).all((-1, -2))
    values, vectors = np.linalg.eigh(np.where(known[..., None, None], np.swapaxes(arms, -1, -2) @ arms, np.eye(3)))
    axes = np.swapaxes(vectors, -1, -2)
    normal = axes[..., 0, :] * np.where(axes[..., 0, 2] < 0, -1.0, 1.0)[..., None]
    _refuse_lines(values, axes[..., 1, :], noise, points.shape[-2])
    lost = np.where(known, 0.0, np.nan)[..., None]
    return Plane(centre, normal + lost, axes[..., 1:, :] + lost[..., None], values[..., 1:] + lost, values[..., 0])


def _refuse_lines(values, narrow, noise, count):
    """Raise MeasurementError where points lie on one line; `narrow` is the direction of their smaller spread."""
    if (values[..., 2] <= 0).any():
        raise MeasurementError("all points of the plane are the same; take three or more that lie apart")
    if (values[..., 1] <= 1e-16 * values[..., 2]).any():
        raise MeasurementError("the points of the plane lie on one line; take one well beside it")
    own = np.einsum("...i,...nij,...j->...n", narrow, noise, narrow).mean(-1)
    width = values[..., 1] / count
    if (width < _NARROW**2 * own).any():
        raise MeasurementError(
            f"the points of the plane lie on one line within their noise ({np.sqrt(np.max(own)):.2g} mm); "
            "take points farther apart"
        )


def _tilts(plane: Plane, points: np.ndarray) -> np.ndarray:
    """(..., 2, N, 3): derivative of the normal, along each axis of the plane, to every coordinate of its points.

    Perturbation of an eigenvector of the matrix of moments (Stewart and Sun, Matrix Perturbation Theory, 1990).
    """
    arms = points - plane.centre[..., None, :]
    heights = np.einsum("...ni,...i->...n", arms, plane.normal)
    along = np.einsum("...ni,...ki->...kn", arms, plane.axes)
    change = plane.axes[..., :, None, :] * heights[..., None, :, None]
    change = change + along[..., None] * plane.normal[..., None, None, :]
    return change / (plane.rest[..., None] - plane.spreads)[..., None, None]


def point_to_plane(points: ArrayLike, covariance: ArrayLike | None = None) -> Measured:
    """Signed distances (...,) mm of points from planes: positive behind the plane, as a pit is, negative before it.

    Parameters
    ----------
    points : (..., N, 3) array
        The point, then three or more points of the plane, mm.
    covariance : (..., N, 3, 3) array, optional
        mm^2; 0 where not given.

    Returns
    -------
    Measured
        `flatness` is the root mean square distance of the plane's points from it.

    Raises
    ------
    MeasurementError
        When the points of the plane lie on one line, or do so within their noise.
    """
    group, noise = as_group(points, covariance, 4, None, "point to plane")
    surface = group[..., 1:, :]
    plane = best_plane(surface, noise[..., 1:, :, :])
    count = surface.shape[-2]
    arm = group[..., 0, :] - plane.centre
    height = np.sum(arm * plane.normal, -1)
    along = np.einsum("...i,...ki->...k", arm, plane.axes)
    tilt = np.einsum("...k,...kni->...ni", along, _tilts(plane, surface))
    own = -plane.normal[..., None, :] / count + tilt
    gradient = np.concatenate([plane.normal[..., None, :], own], -2)
    return measured(height, gradient, noise, np.sqrt(np.maximum(plane.rest, 0.0) / count))


def area(points: ArrayLike, covariance: ArrayLike | None = None) -> Measured:
    """Areas (...,) mm^2 of polygons through points (..., N, 3) mm in order, N 3 or more, in their best plane.

    Returns
    -------
    Measured
        `flatness` is the root mean square distance of the corners from the plane.

    Raises
    ------
    MeasurementError
        When the corners lie on one line (or do so within their noise), or the outline crosses itself.
    """
    corners, noise = as_group(points, covariance, 3, None, "an area")
    plane = best_plane(corners, noise)
    flat = np.einsum("...ni,...ki->...nk", corners - plane.centre[..., None, :], plane.axes)
    if _crosses_itself(flat):
        raise MeasurementError("the outline of the area crosses itself; give its corners in order around it")
    arms = corners - plane.centre[..., None, :]
    before, behind = np.roll(arms, 1, axis=-2), np.roll(arms, -1, axis=-2)
    whole = 0.5 * np.cross(arms, behind).sum(-2)  # vector area
    signed = np.sum(whole * plane.normal, -1)
    sides = 0.5 * np.cross(behind - before, plane.normal[..., None, :])
    leaning = np.einsum("...i,...ki->...k", whole, plane.axes)
    gradient = sides + np.einsum("...k,...kni->...ni", leaning, _tilts(plane, corners))
    gradient = gradient * np.sign(signed)[..., None, None]
    return measured(np.abs(signed), gradient, noise, np.sqrt(np.maximum(plane.rest, 0.0) / corners.shape[-2]))


def _crosses_itself(flat: np.ndarray) -> bool:
    """Whether any of the closed outlines (..., N, 2) has two sides, not neighbours, that cross or touch."""
    count = flat.shape[-2]
    start, end = flat, np.roll(flat, -1, axis=-2)

    def side(a, b, c):
        u, w = b - a, c - a
        return u[..., 0] * w[..., 1] - u[..., 1] * w[..., 0]

    for i in range(count):
        for j in range(i + 2, count - (i == 0)):
            a, b, c, d = start[..., i, :], end[..., i, :], start[..., j, :], end[..., j, :]
            apart = (side(a, b, c) * side(a, b, d) > 0) | (side(c, d, a) * side(c, d, b) > 0)
            known = np.isfinite(side(a, b, c) + side(c, d, a))
            if (known & ~apart & (np.linalg.norm(b - a, axis=-1) > 0)).any():
                return True
    return False
