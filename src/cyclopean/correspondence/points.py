"""Unlabelled points of n views, matched by where they lie."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from ..errors import SetupError, ShapeError
from ..rigs import Rig
from ..triangulation import triangulate
from .matches import Counts, Matches, check_views, pixels_of

if TYPE_CHECKING:
    from .hypotheses import Hypotheses

GATE = 3.5  # standard deviations that a pixel may be off
_FIRM = 0.1  # a match whose rivals are less likely than this takes its points from the others
_PASSES = 5
_BELIEVED = 10  # points that are believed to have a partner as often as stated, before any is seen


def match_points(
    rig: Rig,
    points: Sequence[ArrayLike],
    depths: tuple[float, float] | None = None,
    *,
    sigma: float = 0.1,
    descriptors: Sequence[ArrayLike] | None = None,
    ratio: float = 0.8,
    detection: float = 0.9,
    min_views: int = 2,
    max_ambiguity: float = 0.2,
    progress: Callable[[str, int, int], None] | None = None,
) -> Matches:
    """Find which points of the sub-images show the same point of the scene.

    Each pair of points that fits in two views (epipolar band and depth range) stands for a point in space. Every
    other view is asked for a point where it should show that one, the third view already at the crossing of two
    epipolar curves. A set of points is rated by how much likelier it is to be one point of the scene than chance;
    where sets claim the same point, the likelier one has it.

    Parameters
    ----------
    rig : Rig
        V views, two or more.
    points : sequence of V (N, 2) arrays
        Points found in each view, px in the photograph, in any order. NaN, and points outside the view, match none.
    depths : (near, far), optional
        Depths between which the scene lies, z of the rig frame, mm; the rig's working depths without it.
    sigma : float
        Standard deviation of each pixel coordinate, px: noise of the points, and what the setup may be off.
    descriptors : sequence of V (N, D) arrays, optional
        What the points look like: numbers compared by their Euclidean distance, or uint8 whose bits are counted.
    ratio : float
        A candidate may be less alike than the best one in the band by one over this ratio (Lowe 2004); for
        descriptors only.
    detection : float
        Share of the points that a view should show that are among its points.
    min_views : int
        Views that must show a match.
    max_ambiguity : float
        Matches more ambiguous than this are left out; 1 keeps all.
    progress : callable, optional
        Called as ``progress(what, done, total)``.

    Returns
    -------
    Matches
        Ordered by their ambiguity; no point is used twice.

    Raises
    ------
    SetupError
        For a rig of one view, or options out of range.
    ShapeError
        When points or descriptors do not fit the views.

    References
    ----------
    Ayache and Lustman 1991 (a third view verifies pairs); Maas 1992 (crossing epipolar lines for
    particles); Reid 1979 (likelihood of a track against clutter); Lowe 2004 (ratio test).
    """
    from .hypotheses import gather, trace

    check_views(rig, min_views)
    depths = rig.check_depths(rig.working_depths if depths is None else depths)
    detected = checked_points(rig, points)
    looks, power = _checked_descriptors(descriptors, detected)
    noise = _noise(rig, sigma, detection, max_ambiguity, ratio)
    all_points = gather(rig, detected, looks)
    tell = progress or (lambda *_: None)
    firsts = []
    for view in range(len(rig) - 1):
        firsts.append(trace(rig, view, detected[view], depths))
        tell("epipolar curves", view + 1, len(rig) - 1)
    rows, ambiguity, expected, first = _search(all_points, firsts, noise, ratio**-power, tell)
    source = np.where(rows >= 0, rows - all_points.starts[:-1], -1)
    counts = first.pairs, first.in_band, first.alike, int((first.views >= 3).sum())
    return _finished(rig, depths, noise, source, ambiguity, expected, detected, counts, (min_views, max_ambiguity))


def _search(all_points, firsts, noise, similar, tell):
    """Rows (P, V), ambiguity and expected views (P,) of all matches, and the hypotheses that they started from.

    What is certain is taken out of the points, and the rest is searched again, until nothing is certain any more.
    """
    from .hypotheses import find_hypotheses

    passes, parts = [], []
    for number in range(_PASSES):
        found = find_hypotheses(all_points, firsts, noise, similar)
        if not number:
            chance = -np.log(shown_share(found, len(all_points.pixels), noise.detection) / noise.detection)
        chosen, ambiguity, certain = _choose(found, len(all_points.pixels), chance, number == _PASSES - 1)
        rows = found.rows[chosen]
        all_points.free[rows[rows >= 0]] = False
        passes.append(found)
        parts.append((rows, ambiguity, found.expected[chosen]))
        tell("matching", number + 1, _PASSES)
        if not certain:
            break
    tell("matching", _PASSES, _PASSES)
    return *(np.concatenate(part) for part in zip(*parts, strict=True)), passes[0]


def shown_share(found: Hypotheses, total: int, detection: float) -> float:
    """Share of `total` points that have a partner, at most `detection`.

    Evidence weighs one set against the chance candidates of its points, as if `detection` of the points had partners.
    Where the points are unrelated, hardly any have, and the few sets that agree best are the tail of chance. The share
    that makes all evidence likeliest is found by expectation and maximisation (Dempster, Laird, Rubin 1977).
    """
    best = np.full(total, -np.inf)
    for column in found.rows.T:
        shown = column >= 0
        np.maximum.at(best, column[shown], found.evidence[shown])
    odds = np.exp(np.clip(best, -50, 50)) / detection
    share = detection
    for _ in range(100):
        partner = share * odds / (1 - share + share * odds)
        share = (_BELIEVED * detection + partner.sum()) / (_BELIEVED + total)
    return min(share, detection)


def _choose(found, total, chance, last):
    """Indices of the accepted hypotheses, their ambiguity, and whether they were taken for certain.

    `chance` is the evidence of coincidence. Certain ones first; when there is none left, or at the last, whatever is
    left, the best first.
    """
    from .resolution_kernels import resolve, take_rest

    order = np.argsort(found.rows.ravel(), kind="stable")  # best first within each point
    claimed = found.rows.ravel()[order]
    begins = np.searchsorted(claimed, np.arange(total + 1))
    members = order // max(found.rows.shape[1], 1)
    alive, ambiguity = np.ones(len(found.rows), bool), np.full(len(found.rows), np.nan)
    certain = resolve(found.rows, found.evidence, begins, members, _FIRM, chance, alive, ambiguity)
    if not certain or last:
        take_rest(found.rows, found.evidence, begins, members, chance, alive, ambiguity)
    chosen = np.flatnonzero(np.isfinite(ambiguity))
    return chosen, ambiguity[chosen], certain


def _finished(rig, depths, noise, source, ambiguity, expected, detected, counts, limits):
    """Triangulate exactly, leave out what does not hold, and order what is left."""
    min_views, max_ambiguity = limits
    pixels = pixels_of(source, detected)
    solved = triangulate(rig, pixels, noise.sigma)
    chi2 = solved.residual**2 * 2 * solved.views / noise.sigma**2
    good = (chi2 <= noise.limits[solved.views]) & (solved.views >= min_views)
    good &= depth_fits(solved.points, solved.covariance, depths)
    clear = ambiguity <= max_ambiguity
    keep = np.flatnonzero(good & clear)
    keep = keep[np.argsort(ambiguity[keep], kind="stable")]
    refused = source[good & ~clear]
    pairs, in_band, alike, verified = counts
    sizes = np.array([len(view) for view in detected])
    return Matches(
        pixels[keep], solved.points[keep], solved.covariance[keep], solved.residual[keep], solved.views[keep],
        expected[keep], ambiguity[keep], np.full(len(keep), np.nan), source[keep], np.full(len(keep), -1), refused,
        detected, Counts(sizes, pairs, in_band, alike, verified, len(keep), len(refused)),
    )  # fmt: skip


def depth_fits(points: np.ndarray, covariance: np.ndarray, depths: tuple[float, float]) -> np.ndarray:
    """Which points (P, 3) lie in a range of depths, or outside by no more than their noise."""
    slack = GATE * np.sqrt(np.maximum(covariance[:, 2, 2], 0))
    return (points[:, 2] >= depths[0] - slack) & (points[:, 2] <= depths[1] + slack)


def within(matches: Matches, depths: tuple[float, float]) -> Matches:
    """The matches in a range of depths, mm."""
    good = depth_fits(matches.points, matches.covariance, depths)
    return replace(matches.select(good), counts=replace(matches.counts, matched=int(good.sum())))


def checked_points(rig: Rig, points: Sequence[ArrayLike]) -> tuple[np.ndarray, ...]:
    """The points of each view as (N, 2) arrays, or an error that says what is wrong with them."""
    if len(points) != len(rig):
        raise ShapeError(f"points must be {len(rig)} arrays, one for each view, got {len(points)}")
    checked = []
    for number, (view, given) in enumerate(zip(rig, points, strict=True)):
        pixels = np.asarray(given, dtype=float)
        pixels = pixels.reshape(0, 2) if not pixels.size else pixels
        if pixels.ndim != 2 or pixels.shape[1] != 2:
            raise ShapeError(f"the points of view {number} must have shape (N, 2), got {pixels.shape}")
        known = pixels[np.isfinite(pixels).all(1)]
        if len(known) and not np.isfinite(view.rays(known).directions).any():
            raise ShapeError(
                f"none of the {len(known)} points given for view {number} lies in it: are the points those of the "
                "photograph, (x, y), and the lists in the order of the views?"
            )
        checked.append(pixels)
    return tuple(checked)


def _checked_descriptors(descriptors, detected):
    """Descriptors as float32 for each view, and the power of a ratio of distances that stands for squared ones."""
    if descriptors is None:
        return None, 2
    arrays = [np.asarray(given) for given in descriptors]
    wanted = [len(pixels) for pixels in detected]
    if len(arrays) != len(detected) or any(a.ndim != 2 or len(a) != n for a, n in zip(arrays, wanted, strict=False)):
        got = ", ".join(str(array.shape) for array in arrays)
        raise ShapeError(f"descriptors must be (N, D) arrays for {wanted} points of the views, got {got}")
    if len({array.shape[1] for array in arrays}) > 1:
        raise ShapeError(f"descriptors must be equally long, got {[array.shape[1] for array in arrays]}")
    binary = all(array.dtype == np.uint8 for array in arrays)
    if binary:  # the squared distance of bits is the number that differ
        arrays = [np.unpackbits(array, axis=1) for array in arrays]
    return [array.astype(np.float32) for array in arrays], 1 if binary else 2


def _noise(rig, sigma, detection, max_ambiguity, ratio):
    from scipy.stats import chi2, norm

    from .kernels import Noise

    bounds = (
        ("sigma", sigma, 0 < sigma < np.inf, "a number of px above 0"),
        ("detection", detection, 0 < detection < 1, "a share between 0 and 1"),
        ("max_ambiguity", max_ambiguity, 0 <= max_ambiguity <= 1, "a number from 0 to 1"),
        ("ratio", ratio, 0 < ratio <= 1, "a number above 0, at most 1"),
    )
    for name, value, good, wanted in bounds:
        if not good:
            raise SetupError(f"{name} must be {wanted}, got {value}")
    tail = 2 * norm.sf(GATE)
    limits = np.array([0.0, 0.0, *(chi2.isf(tail, 2 * views - 3) for views in range(2, len(rig) + 1))])
    return Noise(float(sigma), float(chi2.isf(tail, 2)), float(detection), limits, 0.0)
