"""Dense matching: every view of a photograph is the reference once, all others vote."""

import itertools
from dataclasses import dataclass

import cv2
import numpy as np

from ..errors import SetupError, ShapeError
from .aggregation import search, strip_bytes
from .agreement import agreement
from .bands import Bands
from .cost import MARGINS, TILE, filler
from .jumps import placed
from .pictures import prepare
from .places import ALONE
from .plans import Plan
from .refinement import refined
from .surfaces import doubled, enlarged, median, smooth

_CLEAR = 0.15  # second best, of the ridge before it: less is doubtful, as in repeated texture
_AROUND, _DOUBT = 9, 0.4  # px of half resolution around a pixel, and their doubtful share that takes its depth away
_ABOUT = 3  # hypotheses tried on both sides of what the coarser level found
_SMALL, _LARGE = 24, 160  # penalties for a change of depth between neighbours: by one step, by more
_EDGE, _LEAST = 30, 60  # grey levels a px of change in the picture that halve _LARGE; its least
_ALIKE = 1.5  # variance of the depth, because smoothing makes the noise of neighbours alike
_MAX_SIGMA, _MIN_SCORE = 0.3, 0.6  # px, more is a window without texture; correlation, less is something else
_LOOSE_SIGMA, _LOOSE_SCORE = 0.7, 0.3  # the same at half resolution, where its neighbours may tell a pixel's depth
_BEFORE = 0.4  # steps, standard deviation of the depth from half resolution where there is little texture
_OWN, _WINDOW = 3, 9  # px: width of what is near a pixel, and of the last windows
_SHARE = 0.03  # mean energy of the slopes near a pixel, of that in its window: less is borrowed texture
_AGREE, _LOOSE_AGREE = 0.5, 1.0  # px between maps of two views that agree


@dataclass(frozen=True, eq=False)
class DepthMap:
    """Inverse depth at every pixel of a reference view's box."""

    origin: tuple[int, int]  # (x, y) of the box's top-left pixel in the photograph
    inverse_depth: np.ndarray  # (h, w) float32, 1/mm; NaN unknown
    sigma: np.ndarray  # (h, w) float32, standard deviation of inverse_depth, 1/mm; NaN unknown
    score: np.ndarray  # (h, w) float32, correlation of the views, 0 to 1; 0 unknown

    def at(self, pixels):
        """Inverse depth of the pixels nearest to some places of the photograph.

        Parameters
        ----------
        pixels : (..., 2) array
            Places; NaN allowed.

        Returns
        -------
        (...) float32 array
            1/mm, NaN outside the box or where the map knows nothing.
        """
        places = np.rint(np.asarray(pixels, dtype=float)) - self.origin
        height, width = self.inverse_depth.shape
        inside = np.all((places >= 0) & (places < (width, height)), axis=-1)
        x, y = np.moveaxis(np.where(inside[..., None], places, 0).astype(int), -1, 0)
        return np.where(inside, self.inverse_depth[y, x], np.float32(np.nan))

    def where(self, good):
        """The same map without the pixels that are not good, (h, w) bool."""
        nothing = np.float32(np.nan)
        return DepthMap(
            self.origin,
            np.where(good, self.inverse_depth, nothing),
            np.where(good, self.sigma, nothing),
            np.where(good, self.score, np.float32(0)),
        )


def match(
    image, plan: Plan, *, cost="zncc", memory_mib=1024.0, strict=True, progress=None, keep=None
) -> list[DepthMap]:
    """Find the inverse depth of every pixel of every view.

    At half the resolution the other views are brought into the reference at every hypothesis and compared (ZNCC), the
    costs aggregated semi-globally; wide ranges are narrowed down at coarser resolutions first. Then all views that
    see a point refine it by Lucas and Kanade's method, at half and at full resolution; pixels near a jump in depth
    choose their side. Last, the maps of all views must agree. What has no texture stays unknown: no depth is invented.

    Parameters
    ----------
    image : (H, W) or (H, W, C) array
        Photograph, unsigned integers or real numbers, linear in light or not.
    plan : Plan
        What is known of the rig, from `plan`.
    cost : str
        What the windows of the search are compared by: "zncc", 3x3 px, or "census", 5x5 px. Half of the cost; the other
        is the difference of the pixels themselves.
    memory_mib : float
        Memory for the search, MiB; the results do not depend on it.
    strict : bool
        Keep only pixels whose own window tells their depth and that another view confirms. Otherwise also those with
        little texture, whose depth half resolution and their neighbours tell, and those that other views may not see: a
        fuller map with more that is wrong.
    progress : callable, optional
        Called as ``progress(done, total)`` now and then.
    keep : callable, optional
        Called with the number of each view and its map, before the maps are compared.

    Returns
    -------
    list of DepthMap
        Of each view.
    """
    if cost not in MARGINS:
        raise SetupError(f"cost must be one of {sorted(MARGINS)}, got {cost!r}")
    prepared = prepare(image, plan)
    ticks = itertools.count(1)

    def tick():
        if progress is not None:
            progress(next(ticks), plan.steps)

    maps = []
    for reference in plan.references:
        with ALONE:
            coarse = _searched(prepared, reference, cost, memory_mib, strict, tick)
            maps.append(_sharpened(prepared, plan, reference, coarse, strict, tick))
        if keep is not None:
            keep(reference.number, maps[-1])
    return checked(plan, maps, strict)


def checked(plan: Plan, maps, strict=True) -> list[DepthMap]:
    """Depth maps of all views with only those pixels left that the other views' maps agree with.

    Parameters
    ----------
    plan : Plan
        Maps between the views.
    maps : sequence of DepthMap
        Of each view, its box that of the plan.
    strict : bool
        Whether a pixel needs another view that confirms it, to half a px; otherwise to a px, and a view in which
        something nearer hides it will do.
    """
    if len(maps) != len(plan.warps) or any(
        one.inverse_depth.shape != warps.size[::-1] for one, warps in zip(maps, plan.warps, strict=False)
    ):
        shapes = [one.inverse_depth.shape for one in maps]
        raise ShapeError(f"wanted a map for each view's box, {[w.size[::-1] for w in plan.warps]} px, got {shapes}")
    tolerances = [(_AGREE if strict else _LOOSE_AGREE) / _motion(warps) for warps in plan.warps]
    first, step = np.float32(plan.warps[0].inverse_depths[0]), np.float32(plan.warps[0].step)
    with ALONE:
        agreed = agreement(plan, [(one.inverse_depth - first) / step for one in maps], tolerances, hidden=not strict)
    return [one.where(good) for one, good in zip(maps, agreed, strict=True)]


def _searched(prepared, reference, cost, memory_mib, strict, tick):
    """Inverse depth in steps of every other pixel, coarse to fine; if strict, NaN where several depths fit alike."""
    steps = doubtful = np.zeros((1, 1), np.float32)
    coarsest = len(reference.lines) - 1
    for level in range(coarsest, 0, -1):
        mask = reference.masks[2**level]
        size, depths = mask.shape[::-1], -(-(reference.depths - 1) // 2**level) + 1
        if level == coarsest:
            bands = Bands.full(size, depths, TILE, mask)
        else:
            bands = Bands.around(2 * doubled(steps, size), mask, _ABOUT, depths, TILE).rounded()
            doubtful = doubled(doubtful, size)
        grey = prepared.search[level - 1].own(reference.number)[:, ::2, ::2].mean(0)
        fill = filler(prepared.search, reference, level, bands, cost)
        ridge, rows = np.full(mask.shape, np.nan, np.float32), _rows(bands, memory_mib)
        steps, margin = search(fill, bands, mask, _SMALL, _penalties(grey), rows_per_strip=rows, ridge=ridge)
        doubtful = np.maximum(_doubtful(margin, ridge), doubtful)
        tick()
    return np.where((doubtful > _DOUBT) & strict, np.float32(np.nan), 2 * steps)


def _doubtful(margin, ridge):
    """Share of the pixels around each, (h, w), for which another depth, behind a ridge, fits as well."""
    doubt = (margin < _CLEAR * ridge).astype(np.float32)
    return cv2.boxFilter(doubt, -1, (_AROUND, _AROUND))


def _rows(bands, memory_mib):
    """Rows that the search may hold in memory at once."""
    rows = bands.size[1]
    while rows > bands.tile and strip_bytes(bands, rows) > memory_mib * 2**20:
        rows = -(-(rows // 2) // bands.tile) * bands.tile
    return rows


def _own_texture(picture):
    """Pixels (h, w) bool that have texture of their own, not only something in a corner of their window."""
    energy = np.zeros(picture.shape[1:], np.float32)
    for plane in picture:
        for direction in ((1, 0), (0, 1)):
            cv2.accumulateSquare(cv2.Sobel(plane, cv2.CV_32F, *direction, ksize=1), energy)
    near, window = (cv2.boxFilter(energy, -1, (side, side)) for side in (_OWN, _WINDOW))
    return near >= _SHARE * window


def _penalties(grey):
    """Penalty for a jump in depth at each pixel, lower where the picture changes, (h, w) uint16."""
    grey = np.nan_to_num(grey)
    change = np.zeros_like(grey)
    for axis in (0, 1):
        ahead = np.abs(np.diff(grey, axis=axis, append=np.take(grey, [-1], axis=axis)))
        change = np.maximum(change, np.maximum(ahead, np.roll(ahead, 1, axis=axis)))
    return np.maximum(_LARGE / (1 + change / _EDGE), _LEAST).astype(np.uint16)


def _sharpened(prepared, plan, reference, steps, strict, tick):
    """Inverse depth of every pixel, its standard deviation and correlation, from that of every other pixel."""
    smooths, splines = prepared.smooth, prepared.splines
    steps = smooth(steps, 2, np.float32(2))
    for prior in (1.0, 0.5):
        steps, *half = refined(smooths[1], splines[1], reference, steps, passes=2, reach=2.0, prior=prior)
        steps = smooth(steps, 2, np.float32(1.5))
    tick()
    size = plan.warps[reference.number].size
    steps = median(placed(smooths[0], reference, doubled(steps, size)))
    tick()
    steps = smooth(steps, 2, np.float32(1))
    steps, sigma, score = refined(smooths[0], splines[0], reference, steps, passes=3, reach=1.5, prior=0.2)
    tick()
    warps, motion = plan.warps[reference.number], np.float32(_motion(plan.warps[reference.number]))
    sigma *= np.float32(np.sqrt(_ALIKE))
    good = (sigma * motion <= _MAX_SIGMA / np.sqrt(plan.channels)) & (score >= _MIN_SCORE)
    good &= _own_texture(smooths[0].own(reference.number))
    sigma = sigma / np.sqrt(1 + (sigma / np.float32(_BEFORE)) ** 2)  # of both, what was known before and the pictures
    if not strict:
        coarse_sigma, coarse_score = (enlarged(one, size) for one in half)
        sigma = np.where(good, sigma, coarse_sigma * np.float32(np.sqrt(_ALIKE)))
        good |= (coarse_sigma * motion <= _LOOSE_SIGMA) & (coarse_score >= _LOOSE_SCORE)
    good &= warps.reference_mask() & (steps >= 0) & (steps <= reference.depths - 1)
    inverse = np.float32(warps.inverse_depths[0]) + steps * np.float32(warps.step)
    return DepthMap(warps.origin, inverse, sigma * np.float32(warps.step), score).where(good)


def _motion(warps):
    """Pixels that a step between hypotheses moves another view's picture, where it moves most inside the photograph."""
    middle = (len(warps.inverse_depths) - 1) / 2
    place, move = warps.nodes(middle), warps.nodes(middle + 0.5) - warps.nodes(middle - 0.5)
    height, width = warps.masks.shape[1:]
    inside = ((place >= 0) & (place <= (width - 1, height - 1))).all(-1)  # elsewhere it may move at any speed
    return float(np.max(np.linalg.norm(move, axis=-1), where=inside, initial=1e-6))
