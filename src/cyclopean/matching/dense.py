"""Dense matching of one reference view with all other views of the same photograph."""

import itertools
import threading
from dataclasses import dataclass

import numpy as np

from ..errors import ImageError
from ..geometry import Warps, white_level
from .aggregation import aggregate, winner
from .cost import cost_volume
from .refinement import ITERATIONS, prepare, refine

_OVERLAP = 48  # rows beyond a strip on each side that are worked on too, so that no seam shows
_LEAST_ROWS = 16  # of a strip without its overlaps
_SMALL, _LARGE = 8, 120  # penalties for a change of depth between neighbours: by one step, by more
_EDGE, _LEAST = 12, 30  # grey levels a px of change in the picture that halve _LARGE; its least
_ALONE = threading.Lock()  # one of numba's threading layers aborts when two threads start kernels at once


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


def match(image, warps: Warps, *, memory_mib=1024, progress=None) -> DepthMap:
    """Find the inverse depth of every pixel of a reference view.

    The other views are brought into the reference view at every hypothesis and compared window by window
    (ZNCC over all channels); the costs are aggregated semi-globally; the winner is refined by Gauss-Newton on
    slanted windows of all views that see the point. What has no texture stays unknown: no depth is invented.

    Parameters
    ----------
    image : (H, W) or (H, W, C) array
        Photograph, unsigned integers or real numbers, linear in light or not.
    warps : Warps
        Maps from the reference view into the others.
    memory_mib : float
        Memory to use, MiB; large photographs are worked through in strips.
    progress : callable, optional
        Called as ``progress(done, total)`` now and then.

    Returns
    -------
    DepthMap
        Of the reference view.
    """
    levels = grey_levels(image)
    if levels.shape[:2] != warps.masks.shape[1:]:
        raise ImageError(
            f"the maps want an image of {warps.masks.shape[1:]} rows and columns, got {levels.shape[:2]}; "
            "make the maps for the camera that took it"
        )
    width, height = warps.size
    result = np.full((3, height, width), np.nan, np.float32)
    strips = _strips(warps, levels, memory_mib)
    ticks, total = itertools.count(1), len(strips) * (len(warps.inverse_depths) + 1 + ITERATIONS)

    def tick():
        if progress is not None:
            progress(next(ticks), total)

    smooth, spline = prepare(levels)
    with _ALONE:
        for keep, rows in strips:
            inner = slice(keep.start - rows.start, keep.stop - rows.start)
            guess = _search(levels, warps, rows, tick)
            result[:, keep] = np.stack(refine(smooth, spline, warps, rows, guess, tick))[:, inner]
    steps, sigma, score = result
    unknown = np.isnan(steps)
    inverse_depth = (warps.inverse_depths[0] + steps.astype(float) * warps.step).astype(np.float32)
    sigma[unknown], score[unknown] = np.nan, 0
    return DepthMap(warps.origin, inverse_depth, sigma * np.float32(warps.step), score)


def grey_levels(image):
    """Scale a picture so that its white level is 255: (H, W, C) float32."""
    image = np.asarray(image)
    if image.ndim not in (2, 3) or image.size == 0:
        raise ImageError(f"an image must have shape (H, W) or (H, W, C), got {image.shape}")
    if image.dtype.kind not in "uf":
        raise ImageError(f"an image must hold unsigned integers or real numbers, got {image.dtype}")
    levels = np.nan_to_num(image.astype(np.float32) * np.float32(255 / white_level(image)), posinf=0, neginf=0)
    return levels.reshape(*image.shape[:2], -1)


def _strips(warps, levels, memory_mib):
    """Strips of the box that fit into memory: (rows to keep, rows to work on)."""
    (width, height), views, channels = warps.size, len(warps.masks), levels.shape[-1]
    volume = 3 * len(warps.inverse_depths) + 4 * (views + 2 * channels)  # bytes a pixel, while aggregating
    windows = 4 * (2 * views * (channels + 1) + channels + 12)  # and while refining
    left = memory_mib * 2**20 - 3 * levels.nbytes
    rows = int(left / (width * max(volume, windows))) - 2 * _OVERLAP
    rows = height if rows + 2 * _OVERLAP >= height else max(rows, _LEAST_ROWS)
    keep = [slice(top, min(top + rows, height)) for top in range(0, height, rows)]
    return [(k, slice(max(k.start - _OVERLAP, 0), min(k.stop + _OVERLAP, height))) for k in keep]


def _search(levels, warps, rows, tick):
    """Inverse depth in steps of some rows of the box, good to a fraction of a step."""
    (x0, y0), (width, _) = warps.origin, warps.size
    mask = np.ascontiguousarray(warps.reference_mask()[rows])
    volume = cost_volume(levels, warps, rows, tick)
    grey = levels[y0 + rows.start : y0 + rows.stop, x0 : x0 + width].mean(axis=-1)
    guess = winner(aggregate(volume, mask, _SMALL, _penalties(grey)), mask)
    tick()
    return guess


def _penalties(grey):
    """Penalty for a jump in depth at each pixel, lower where the picture changes, (h, w) uint16."""
    change = np.zeros_like(grey)
    for axis in (0, 1):
        ahead = np.abs(np.diff(grey, axis=axis, append=np.take(grey, [-1], axis=axis)))
        change = np.maximum(change, np.maximum(ahead, np.roll(ahead, 1, axis=axis)))
    return np.maximum(_LARGE / (1 + change / _EDGE), _LEAST).astype(np.uint16)
