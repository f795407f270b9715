"""Which points of several views could be one point of the scene: pairs in the epipolar band, and what the rest says."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..epipolar.curves import inverse_depth_samples
from ..rigs import Rig
from .kernels import CELL, AllPoints, First, Noise, extend, pair_candidates, unlikeness
from .kernels import UNLIKE as _UNLIKE

_SAMPLES = 33  # of each curve: bent by 5 px they leave chords by 0.001 px
_STEP = 0.5  # px, for derivatives
_NEIGHBOURS = 10  # points within reach where the density is taken, on average
_BACKGROUND = 20_000  # pairs of unrelated descriptors
_PRIOR = 10  # wrong pairs without any that is confirmed, which stand for no knowledge
_REGULAR = 0.02  # share of wrong pairs that chance confirms at most; more means a regular pattern
_SEED = 20  # of the pairs drawn


@dataclass(frozen=True, eq=False)
class Hypotheses:
    """M sets of points, the best first; no set twice."""

    rows: np.ndarray  # (M, V) int, rows of the list of all points, -1 where a view has none
    evidence: np.ndarray  # (M,) log of how much likelier one point of the scene is than chance
    views: np.ndarray  # (M,) int, views that agree
    expected: np.ndarray  # (M,) int, views that should see the point
    pairs: int  # that were compared
    in_band: int
    alike: int


def gather(rig: Rig, points: Sequence[np.ndarray], descriptors: Sequence[np.ndarray] | None) -> AllPoints:
    """The points (N, 2) px of each view as one list with what the search asks of it.

    Descriptors are (N, D) float32 for each view, or None.
    """
    starts = np.concatenate([[0], np.cumsum([len(view) for view in points])]).astype(np.int64)
    masks = rig.masks
    density = [_density(view, mask.sum()) for view, mask in zip(points, masks, strict=True)]
    cells = [_cells(view, rig.size) for view in points]
    begins, grids, offset = [], [], 0
    for start, (view_begins, _, columns, rows) in zip(starts, cells, strict=False):
        grids.append((offset, columns, rows))
        begins.append(view_begins + start)
        offset += len(view_begins)
    looks = np.zeros((starts[-1], 0), np.float32) if descriptors is None else np.concatenate(descriptors)
    return AllPoints(
        starts,
        np.ascontiguousarray(np.concatenate(points)),
        np.ones(starts[-1], bool),
        np.concatenate(density),
        np.concatenate(begins),
        np.concatenate([order + start for start, (_, order, _, _) in zip(starts, cells, strict=False)]),
        np.array(grids),
        masks,
        np.ascontiguousarray(looks, np.float32),
        _background(looks, starts),
    )


def trace(rig: Rig, view: int, pixels: np.ndarray, depths: tuple[float, float]) -> First:
    """What pixels (N, 2) of a view stand for: their epipolar curves, and how these move with the pixels."""
    inverse_depths = inverse_depth_samples(depths, _SAMPLES)
    endless = rig.unbounded()
    here, right, below = (
        np.stack([other.project(points) for other in endless], 1)
        for points in (
            endless[view].rays((pixels + move)[:, None]).at_depth(1 / inverse_depths)
            for move in np.array([[0, 0], [_STEP, 0], [0, _STEP]])
        )
    )
    paths = np.concatenate([here, (right - here) / _STEP, (below - here) / _STEP], -1)
    inside = np.isfinite(rig[view].rays(pixels).directions[:, 0])
    paths[~inside] = np.nan
    span = inverse_depths[-1] - inverse_depths[0]
    return First(view, paths, span / (_SAMPLES - 1), span)


def find_hypotheses(all_points: AllPoints, firsts: Sequence[First], noise: Noise, similar: float) -> Hypotheses:
    """All sets of free points that agree, grown from every pair of views.

    `similar` is how many times the squared distance of the most similar candidate in the band another one may have.
    """
    views = len(all_points.starts) - 1
    parts, in_band, alike, pairs = [], 0, 0, 0
    sizes = np.diff(all_points.starts)
    for first in firsts:
        for second in range(first.number + 1, views):
            found = _pairs(all_points, first, second, noise)
            pairs, in_band = pairs + int(sizes[first.number] * sizes[second]), in_band + len(found)
            found = _alike(all_points, first.number, second, found, similar)
            alike += len(found)
            out, rows = np.empty((len(found), 3)), np.empty((len(found), views), np.int64)
            extend(all_points, first, second, found, noise, out, rows)
            confirmed = _wrongly_confirmed(found[:, 0].astype(int), out)
            if confirmed > _REGULAR:
                extend(all_points, first, second, found, noise._replace(confirmed=confirmed), out, rows)
            good = np.isfinite(out[:, 0])
            parts.append((rows[good], out[good]))
    rows, out = (np.concatenate(part) for part in zip(*parts, strict=True))
    best_first = np.argsort(-out[:, 0], kind="stable")
    rows, out = rows[best_first], out[best_first]
    single = np.sort(_first_of_each(rows))
    return Hypotheses(
        rows[single], out[single, 0], out[single, 1].astype(int), out[single, 2].astype(int), pairs, in_band, alike
    )


def _pairs(all_points, first, second, noise):
    """Candidates (K, 4) of one pair of views, see `pair_candidates`."""
    found = np.empty((4 * len(first.paths) + 64, 4))
    count = pair_candidates(all_points, first, second, noise, found)
    if count > len(found):
        found = np.empty((count, 4))
        pair_candidates(all_points, first, second, noise, found)
    return found[:count]


def _alike(all_points, first, second, pairs, similar):
    """The candidates that look alike, and not much less so than the best one of each of the two points."""
    if not len(all_points.background) or not len(pairs):
        return pairs
    squared = np.empty(len(pairs), np.float32)
    unlikeness(all_points, first, second, pairs, squared)
    shares = np.searchsorted(all_points.background, squared, side="right") / len(all_points.background)
    keep = shares <= _UNLIKE
    for column, view in ((0, first), (1, second)):
        best = np.full(all_points.starts[view + 1] - all_points.starts[view], np.inf, np.float32)
        rows = pairs[:, column].astype(int)
        np.minimum.at(best, rows, squared)
        keep &= squared <= similar * best[rows]
    return pairs[keep]


def _wrongly_confirmed(points, out):
    """Share of wrong pairs that other views seem to confirm.

    Of the pairs (K,) of one point all but one are wrong: when several are confirmed, points repeat regularly, and a
    view that agrees says little. `out` (K, 3) is that of `extend`.
    """
    asked = out[:, 2] > 2
    points, shares = points[asked], (out[asked, 1] - 2) / (out[asked, 2] - 2)
    count = np.bincount(points)
    total, best = np.bincount(points, shares), np.zeros(len(count))
    np.maximum.at(best, points, shares)
    return float((total - best).sum() / (np.maximum(count - 1, 0).sum() + _PRIOR))


def _first_of_each(rows):
    """Index of the first of each set of equal rows (M, V)."""
    factors = np.random.default_rng(_SEED).integers(1, 2**62, rows.shape[1]) | 1
    with np.errstate(over="ignore"):
        keys = ((rows + 2) * factors).sum(1)  # wraps round: a hash
    return np.unique(keys, return_index=True)[1]


def _density(pixels, area):
    """Points per px^2 around each of the points (N, 2) of a view of some area, px^2."""
    from scipy.spatial import KDTree

    if not len(pixels):
        return np.zeros(0)
    radius = np.sqrt(_NEIGHBOURS * area / (np.pi * len(pixels)))
    known = np.isfinite(pixels).all(1)
    counts = np.ones(len(pixels))
    if known.any():
        counts[known] = KDTree(pixels[known]).query_ball_point(pixels[known], radius, return_length=True)
    return counts / (np.pi * radius**2)


def _cells(pixels, size):
    """Where the points of each cell begin, the points by cell, and the columns and rows of cells."""
    columns, rows = (int(np.ceil((length + 1) / CELL)) for length in size)
    place = np.nan_to_num(pixels / CELL, nan=0.0)
    column, row = (np.clip(place.T.astype(int).T, 0, [columns - 1, rows - 1])).T
    cell = row * columns + column
    order = np.argsort(cell, kind="stable")
    return np.searchsorted(cell[order], np.arange(columns * rows + 1)), order, columns, rows


def _background(descriptors, starts):
    """Sorted squared distances of descriptors of points that were drawn by chance from two views each."""
    if not descriptors.shape[1] or np.count_nonzero(np.diff(starts)) < 2:
        return np.zeros(0, np.float32)
    random = np.random.default_rng(_SEED)
    pairs = random.integers(0, len(descriptors), (3 * _BACKGROUND, 2))
    views = np.searchsorted(starts, pairs, side="right")
    first, second = pairs[views[:, 0] != views[:, 1]][:_BACKGROUND].T
    return np.sort(((descriptors[first] - descriptors[second]) ** 2).sum(1).astype(np.float32))
