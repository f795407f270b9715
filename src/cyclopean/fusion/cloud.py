"""One cloud of points from the depth maps of all views."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..errors import SetupError
from ..geometry import Rays
from ..matching import DepthMap
from ..rigs import Rig, ViewLike
from . import kernels
from .continuity import connected
from .merging import CORRELATION, TOLERANCE_PX, merge

NORMAL_RADIUS = 6  # px around a pixel whose depths make its normal


@dataclass(frozen=True, eq=False)
class Cloud:
    """Points of a scene, each surface element once."""

    points: np.ndarray  # (N, 3) mm, rig frame
    covariance: np.ndarray  # (N, 3, 3) float32 mm^2
    normals: np.ndarray  # (N, 3) float32 unit, towards the camera; NaN unknown
    views: np.ndarray  # (N,) uint8, how many views have the point
    view: np.ndarray  # (N,) int8, the first of them
    pixels: np.ndarray  # (N, 2) int, its pixel in that view


def fuse(
    rig: Rig,
    maps: Sequence[DepthMap],
    *,
    tolerance_px: float = TOLERANCE_PX,
    correlation: float = CORRELATION,
    normal_radius: int = NORMAL_RADIUS,
) -> Cloud:
    """One cloud of points from the depth maps of all views, in which each surface element is there once.

    Each point of a map is projected into all other views along true rays, and their maps are looked up there.
    Views that have the same inverse depth are merged, weighted by one over the variance. The point stays with
    the first of the views that have it, on the ray of its pixel there; in the others it is left out. So every
    part of a surface has the sampling of one view, and no point is there twice.

    Parameters
    ----------
    rig : Rig
        The views.
    maps : sequence of DepthMap
        One for each view, cross-checked or not.
    tolerance_px : float
        What two maps of one surface may differ by beside three sigma, as motion of the match in the most sensitive
        view, px.
    correlation : float
        Of the errors that two views make at one point, 0 to 1. Depths of both come from the same photograph: with
        two views, from the same two windows. So nothing is gained by default (1), and a merged sigma is the
        mean of those merged.
    normal_radius : int
        Normals come from planes through the depths up to so many px around each pixel.

    Returns
    -------
    Cloud
        Points ordered by view, row and column.

    Raises
    ------
    ShapeError, OpticError, SetupError
        When there is not one map a view, or only one view, or an option is out of range.
    """
    if normal_radius < 1:
        raise SetupError(f"normals need the depths of 1 px around each pixel, or more, got {normal_radius}")
    merged = merge(rig, maps, tolerance_px, correlation)
    parts = [_part(rig[k].unbounded(), k, one, normal_radius) for k, one in enumerate(merged)]
    return Cloud(*(np.concatenate(columns) for columns in zip(*parts, strict=True)))


def _part(view, k, merged, radius):
    """What view k adds to the cloud: the columns of `Cloud`."""
    rows, columns = np.nonzero((merged.views > 0) & ~merged.repeated)
    depth, sigma, motion = (
        grid[rows, columns].astype(float) for grid in (merged.inverse_depth, merged.sigma, merged.motion)
    )
    pixels = np.stack([columns, rows], -1) + merged.origin
    rays = view.rays(pixels)
    along, across = _local_frame(view, pixels, rays, depth)
    covariance = _covariance(along, across, sigma, motion)
    slope = _gradients(merged, rows, columns, radius)
    normals = _normals(rays.directions, across + along * slope.T[..., None])
    return (
        rays.at_depth(1 / depth),
        covariance,
        normals,
        merged.views[rows, columns],
        np.full(len(rows), k, np.int8),
        pixels,
    )


def _local_frame(
    view: ViewLike, pixels: np.ndarray, rays: Rays, inverse_depth: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """How the points of pixels (N, 2), on their rays (N,) at inverse depths (N,), move: (N, 3) mm^2, (2, N, 3) mm.

    First along the ray, for a change of inverse depth by 1/mm (the point is linear in its depth); then across it,
    for a pixel to the right and a pixel down at the same depth.
    """
    depth = 1 / inverse_depth
    along = rays.directions * (-(depth**2) / rays.directions[:, 2])[:, None]
    halves = np.array([[0.5, 0.0], [0.0, 0.5]])
    across = [view.rays(pixels + half).at_depth(depth) - view.rays(pixels - half).at_depth(depth) for half in halves]
    return along, np.stack(across)


def _covariance(along, across, sigma, motion):
    """Covariance (N, 3, 3) float32 of points whose inverse depths have sigma (N,).

    A correspondence is as uncertain in the reference view as in the others: along the ray by the spread of
    inverse depth, across it by the pixels that this spread stands for in the most sensitive other view.
    """
    vectors = (along * sigma[:, None], *(across * (sigma * motion)[:, None]))
    vectors = [np.ascontiguousarray(vector.T, dtype=np.float32) for vector in vectors]
    covariance = np.empty((len(along), 3, 3), np.float32)
    for i in range(3):
        for j in range(i + 1):
            covariance[:, i, j] = covariance[:, j, i] = sum(vector[i] * vector[j] for vector in vectors)
    return covariance


def _gradients(merged, rows, columns, radius):
    """Gradients (N, 2) of inverse depth at pixels of a merged map, 1/mm a px; NaN where too few are connected.

    A plane is linear in inverse depth over the pixels of a pinhole, and nearly so over those of any view.
    """
    right, down = connected(merged.inverse_depth, merged.sigma, merged.motion)
    fitted = np.empty((len(rows), 3))
    kernels.planes(rows, columns, merged.inverse_depth, merged.sigma, right, down, radius, fitted)
    return fitted[:, 1:]


def _normals(directions, tangents):
    """Unit normals (N, 3) float32 across two tangents (2, N, 3), against rays of directions (N, 3)."""
    normals = np.cross(tangents[0], tangents[1])
    with np.errstate(invalid="ignore"):
        normals *= -np.sign((normals * directions).sum(-1) / np.linalg.norm(normals, axis=-1))[:, None]
        normals /= np.linalg.norm(normals, axis=-1)[:, None]
    return normals.astype(np.float32)
