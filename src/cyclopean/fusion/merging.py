"""What all views together say about the pixels of each."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.ndimage import map_coordinates

from ..errors import OpticError, SetupError, ShapeError
from ..matching import DepthMap
from ..rigs import Rig
from . import kernels
from .continuity import connected

TOLERANCE_PX = 0.5  # by which matches of one point may differ beside their sigma: half a pixel is hardly two surfaces
DEVIATIONS = 3.0  # of the difference of two maps
CORRELATION = 1.0  # of the errors that two views make at one point
_SPACING = 16  # px between the nodes at which the motion of matches is found
_NUDGE = 1e-3  # relative change of inverse depth that shows how matches move


@dataclass(frozen=True, eq=False)
class Merged:
    """A depth map after all other views have been asked about each of its points."""

    origin: tuple[int, int]  # (x, y) of the box's top-left pixel in the photograph
    inverse_depth: np.ndarray  # (h, w) float32, 1/mm; NaN unknown
    sigma: np.ndarray  # (h, w) float32, 1/mm; NaN unknown
    motion: np.ndarray  # (h, w) float32, px for 1/mm: how the match moves in the most sensitive other view
    slack: np.ndarray  # (h, w) float32, 1/mm, by which maps of one surface may differ beside their sigma
    views: np.ndarray  # (h, w) uint8, views that have the point, this one included; 0 unknown
    repeated: np.ndarray  # (h, w) bool, an earlier view has the point already


def merge(rig: Rig, maps: Sequence[DepthMap], tolerance_px: float, correlation: float) -> list[Merged]:
    """Depth maps of all views, each pixel weighted with what the other views have where they see its point."""
    if len(rig) < 2:
        raise OpticError(f"fusion needs the depth maps of at least two views, but this rig has {len(rig)}")
    if len(maps) != len(rig):
        raise ShapeError(f"fusion wants one depth map a view, {len(rig)} in all, got {len(maps)}")
    if not 0 <= tolerance_px < np.inf:
        raise SetupError(f"the tolerance of fusion is a number of px, 0 or more, got {tolerance_px}")
    if not 0 <= correlation <= 1:
        raise SetupError(f"the correlation of two views' errors lies between 0 and 1, got {correlation}")
    edges = [connected(one.inverse_depth, one.sigma, np.zeros_like(one.sigma)) for one in maps]
    return [_merge_one(rig, maps, edges, k, tolerance_px, correlation) for k in range(len(rig))]


def _merge_one(rig, maps, edges, k, tolerance_px, correlation):
    """`merge` for view k."""
    own = maps[k]
    rows, columns = np.nonzero((own.inverse_depth > 0) & (own.sigma >= 0))
    pixels = np.stack([columns, rows], -1) + own.origin
    depth, sigma = (values[rows, columns].astype(float) for values in (own.inverse_depth, own.sigma))
    motion = _motion(rig, k, pixels, depth)
    points = rig[k].unbounded().rays(pixels).at_depth(1 / depth)
    slack = tolerance_px / motion
    weights = 1 / np.fmax(sigma, _least_sigma(depth)) ** 2
    total, moment, roots = weights.copy(), np.zeros_like(depth), np.sqrt(weights)
    views, repeated = np.ones(len(depth), np.uint8), np.zeros(len(depth), bool)
    found, agree = np.empty((len(depth), 2)), np.empty(len(depth), bool)
    for j, other in enumerate(maps):
        if j == k:
            continue
        place = rig[j].unbounded().project(points)
        kernels.look_up(
            place, depth, sigma, slack, *other.origin, other.inverse_depth, other.sigma, *edges[j], DEVIATIONS,
            found, agree,
        )  # fmt: skip
        exact = np.isfinite(found[:, 0])
        weight = np.where(exact, 1 / np.fmax(found[:, 1], _least_sigma(depth)) ** 2, 0)
        total += weight
        moment += weight * np.where(exact, found[:, 0] - depth, 0)
        roots += np.sqrt(weight)
        views += agree
        if j < k:
            repeated |= agree
    together = np.sqrt((1 - correlation) * total + correlation * roots**2) / total
    columns_of = (depth + moment / total, together, motion, slack, views, repeated)
    types = (np.float32,) * 4 + (np.uint8, bool)
    return Merged(own.origin, *(_spread(own, rows, columns, *pair) for pair in zip(columns_of, types, strict=True)))


def _least_sigma(depth):
    """What float32 can tell apart of inverse depths (N,): weights stay finite where a sigma of 0 is stated."""
    return 1e-7 * depth


def _motion(rig, k, pixels, depth):
    """How the matches of pixels (N, 2) at inverse depths (N,) move in the most sensitive other view: (N,) px for 1/mm.

    It is smooth: found on a lattice of pixels at three inverse depths, linear between pixels, quadratic in depth.
    """
    if not len(depth):
        return np.empty(0)
    first, last = pixels.min(0), pixels.max(0)
    x, y = (np.arange(start, end + _SPACING, _SPACING) for start, end in zip(first, last, strict=True))
    nodes = np.stack(np.meshgrid(x, y), -1)
    low, high = depth.min(), max(depth.max(), depth.min() * (1 + _NUDGE))
    levels = np.array([low, (low + high) / 2, high])
    layers = [_exact_motion(rig, k, nodes, level) for level in levels]
    place = ((pixels - first) / _SPACING).T[::-1]
    layers = [map_coordinates(layer, place, order=1) for layer in layers]
    t = (depth - low) / (high - low)
    motion = (1 - t) * (1 - 2 * t) * layers[0] + 4 * t * (1 - t) * layers[1] + t * (2 * t - 1) * layers[2]
    lost = ~np.isfinite(motion)  # beside a node that no other view sees
    motion[lost] = _exact_motion(rig, k, pixels[lost], depth[lost])
    return motion


def _exact_motion(rig, k, pixels, depth):
    """`_motion` (...) of pixels (..., 2) at inverse depths (...), with nothing interpolated."""
    rays = rig[k].unbounded().rays(pixels)
    points, nearer = rays.at_depth(1 / depth), rays.at_depth(1 / (depth * (1 + _NUDGE)))
    views = [view.unbounded() for j, view in enumerate(rig) if j != k]
    moves = [np.linalg.norm(view.project(nearer) - view.project(points), axis=-1) for view in views]
    return np.fmax.reduce(moves, initial=np.nan) / (_NUDGE * depth)


def _spread(own, rows, columns, values, kind):
    """Values (N,) of pixels in a grid (h, w) of a depth map; NaN, 0 or False elsewhere."""
    grid = np.full(own.inverse_depth.shape, np.nan if kind is np.float32 else 0, kind)
    grid[rows, columns] = values
    return grid
