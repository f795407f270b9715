"""Measurements along lines: places, distances, lengths, angles."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from ..geometry import as_points
from .measured import Measured, as_group, measured, unit


def point(points: ArrayLike, covariance: ArrayLike | None = None) -> Measured:
    """Depths z (...,) of points (..., 3) mm; `sigma` is that of the depth.

    Parameters
    ----------
    points : (..., 3) array
        mm, in the rig's frame.
    covariance : (..., 3, 3) array, optional
        mm^2; 0 where not given.
    """
    single = as_points(points)[..., None, :]
    noise = None if covariance is None else np.asarray(covariance, dtype=float)[..., None, :, :]
    single, noise = as_group(single, noise, 1, 1, "a point")
    gradient = np.broadcast_to(np.array([0.0, 0.0, 1.0]), single.shape)
    return measured(single[..., 0, 2], gradient, noise)


def distance(points: ArrayLike, covariance: ArrayLike | None = None) -> Measured:
    """Distances (...,) mm between pairs of points.

    Parameters
    ----------
    points : (..., 2, 3) array
        mm.
    covariance : (..., 2, 3, 3) array, optional
        mm^2; 0 where not given.

    Raises
    ------
    MeasurementError
        When two points are the same.
    """
    pair, noise = as_group(points, covariance, 2, 2, "a distance")
    return length(pair, noise)


def length(points: ArrayLike, covariance: ArrayLike | None = None) -> Measured:
    """Lengths (...,) mm of lines of several segments through points (..., N, 3) mm.

    The derivative to a point is the unit vector of the segment before it less that of the segment behind it.

    Raises
    ------
    MeasurementError
        When two neighbouring points are the same.
    """
    chain, noise = as_group(points, covariance, 2, None, "a length")
    directions, lengths = unit(np.diff(chain, axis=-2), "a length")
    gradient = np.zeros_like(chain)
    gradient[..., 1:, :] += directions
    gradient[..., :-1, :] -= directions
    return measured(lengths.sum(-1), gradient, noise)


def point_to_line(points: ArrayLike, covariance: ArrayLike | None = None) -> Measured:
    """Distances (...,) mm of points from straight lines through two others.

    Parameters
    ----------
    points : (..., 3, 3) array
        The point, then the two points of the line, mm. The line runs on beyond them.
    covariance : (..., 3, 3, 3) array, optional
        mm^2; 0 where not given.

    Returns
    -------
    Measured
        On the line itself, where a distance has no derivative, `sigma` is that across the line in the worst direction.

    Raises
    ------
    MeasurementError
        When the two points of the line are the same.
    """
    group, noise = as_group(points, covariance, 3, 3, "point to line")
    along, span = unit(group[..., 2, :] - group[..., 1, :], "point to line")
    arm = group[..., 0, :] - group[..., 1, :]
    place = np.sum(arm * along, -1)
    across = arm - place[..., None] * along
    away = np.linalg.norm(across, axis=-1)
    share = (place / span)[..., None]
    on_line = away <= 1e-12 * span
    normal = np.where(on_line[..., None], 0.0, across / np.where(on_line, 1.0, away)[..., None])
    found = measured(away, np.stack([normal, -(1 - share) * normal, -share * normal], -2), noise)
    if not on_line.any():
        return found
    shares = np.concatenate([np.ones_like(share), share - 1, -share], -1)
    total = np.einsum("...n,...nij->...ij", shares**2, noise)
    flat = np.eye(3) - along[..., :, None] * along[..., None, :]
    worst = np.sqrt(np.maximum(np.linalg.eigvalsh(np.nan_to_num(flat @ total @ flat))[..., -1], 0.0))
    return Measured(found.value, np.where(on_line, worst, found.sigma), found.gradient)


def angle(points: ArrayLike, covariance: ArrayLike | None = None) -> Measured:
    """Angles (...,) rad, 0 to pi, at the second of three points.

    Parameters
    ----------
    points : (..., 3, 3) array
        A point on one leg, the vertex, a point on the other leg, mm.
    covariance : (..., 3, 3, 3) array, optional
        mm^2; 0 where not given.

    Returns
    -------
    Measured
        NaN for `sigma` where the legs lie on one line: an angle has no derivative there.

    Raises
    ------
    MeasurementError
        When a leg has no length.
    """
    group, noise = as_group(points, covariance, 3, 3, "an angle")
    first, length_1 = unit(group[..., 0, :] - group[..., 1, :], "an angle")
    second, length_2 = unit(group[..., 2, :] - group[..., 1, :], "an angle")
    cosine = np.sum(first * second, -1)
    sine = np.linalg.norm(np.cross(first, second), axis=-1)
    straight = np.where(sine > 1e-12, sine, np.nan)[..., None]
    turn_1 = (cosine[..., None] * first - second) / (straight * length_1[..., None])
    turn_2 = (cosine[..., None] * second - first) / (straight * length_2[..., None])
    value = np.arctan2(sine, cosine)
    return measured(value, np.stack([turn_1, -turn_1 - turn_2, turn_2], -2), noise)
