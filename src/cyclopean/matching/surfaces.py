"""Depth maps as surfaces: smooth where the scene is, with jumps where it jumps."""

import cv2
import numpy as np
from numba import njit, prange

from .places import FAST

_ZERO, _ONE = np.float32(0), np.float32(1)
_FAR = np.float32(1e6)


@njit(cache=True, fastmath=FAST, error_model="numpy")
def _add_like(depth, middle, reach, total, count):
    for x in range(len(middle)):
        away = depth[x] - middle[x]
        like = abs(away) < reach
        total[x] += away if like else _ZERO
        count[x] += _ONE if like else _ZERO


@njit(parallel=True, cache=True, fastmath=FAST, error_model="numpy")
def smooth(depth, radius, reach):
    """Mean of the neighbours of like depth.

    Parameters
    ----------
    depth : (h, w) float32 array
        Inverse depth in hypotheses; NaN unknown.
    radius : int
        Half width of the square of neighbours.
    reach : float
        Largest difference that is like.

    Returns
    -------
    (h, w) float32 array
        NaN where the pixel itself is unknown.
    """
    height, width = depth.shape
    out = np.empty((height, width), np.float32)
    for y in prange(height):
        total, count = np.zeros(width, np.float32), np.zeros(width, np.float32)
        middle = depth[y]
        for j in range(max(0, y - radius), min(height, y + radius + 1)):
            for i in range(-radius, radius + 1):
                left, right = max(0, -i), min(width, width - i)
                _add_like(
                    depth[j, left + i : right + i], middle[left:right], reach, total[left:right], count[left:right]
                )
        for x in range(width):
            out[y, x] = middle[x] + total[x] / max(count[x], _ONE)
    return out


def extremes(depth, radius):
    """Least and largest depth around each pixel, (h, w) each; the larger is less only where all is unknown."""
    kernel = np.ones((2 * radius + 1, 2 * radius + 1), np.uint8)
    unknown = np.isnan(depth)
    low = cv2.erode(np.where(unknown, _FAR, depth), kernel)
    high = cv2.dilate(np.where(unknown, -_FAR, depth), kernel)
    return low, high


def doubled(depth, size):
    """A map of twice the size: each pixel as the nearest of the coarse ones, holes of one pixel closed."""
    return enlarged(np.where(np.isnan(depth), _known_mean(depth), depth), size)


def enlarged(values, size):
    """An array (h, w) of twice the size, cut to (width, height): each pixel as the nearest of the coarse ones."""
    return np.ascontiguousarray(np.repeat(np.repeat(values, 2, 0), 2, 1)[: size[1], : size[0]])


def _known_mean(depth):
    """Mean of the known of each pixel's eight neighbours; NaN where there is none."""
    known = ~np.isnan(depth)
    box = {"ksize": (3, 3), "normalize": False, "borderType": cv2.BORDER_CONSTANT}
    total, count = (
        cv2.boxFilter(np.where(known, depth, 0), -1, **box),
        cv2.boxFilter(known.astype(np.float32), -1, **box),
    )
    return np.where(count > 0, total / np.maximum(count, 1), np.float32(np.nan))


def median(depth):
    """Median of 5 x 5 pixels, unknown ones standing for the farthest; NaN where the pixel itself is unknown."""
    unknown = np.isnan(depth)
    out = cv2.medianBlur(np.where(unknown, np.float32(-1), depth), 5)
    return np.where(unknown | (out < 0), depth, out)
