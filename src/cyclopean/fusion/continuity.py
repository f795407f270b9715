"""Where a depth map is one continuous surface, and where it jumps."""

from __future__ import annotations

import numpy as np

DEVIATIONS = 4.0  # of the difference of two pixels: noise hardly ever tears a surface
_STEEPER = 1.5  # than its neighbours on one side may a surface become from one pixel to the next
_LARGEST_GRADIENT = 1.0  # px of motion a px: what is steeper is hidden from one of the two views


def connected(
    inverse_depth: np.ndarray, sigma: np.ndarray, motion: np.ndarray, step: int = 1
) -> tuple[np.ndarray, np.ndarray]:
    """Which pixels of a depth map lie on one surface with their right and with their lower neighbour.

    Two neighbours differ by noise and by slope. The noise is what their sigma allows. The slope is what the map
    shows just beside them: of the two differences before, the two after, or the one before and the one after, the
    smaller where both have the same sign, and half as much again. One odd pixel, or one that mixes both sides of a
    step, makes no slope. No surface is so steep that its match moves by more than a pixel from one pixel to the
    next: one of the two views would see it from behind.

    Parameters
    ----------
    inverse_depth, sigma : (h, w) arrays
        A depth map and its standard deviation, 1/mm; NaN unknown.
    motion : (h, w) array
        How far the match of each pixel moves in the most sensitive other view, px for 1/mm of inverse depth.
    step : int
        Pixels between neighbours of the map.

    Returns
    -------
    right, down : (h, w) bool arrays
        False in the last column of `right` and in the last row of `down`.

    References
    ----------
    Burt, Julesz 1980, A disparity gradient limit for binocular fusion.
    """
    right, down = np.zeros((2, *inverse_depth.shape), dtype=bool)
    right[:, :-1] = _along_rows(inverse_depth, sigma, motion, step)
    down[:-1] = _along_rows(inverse_depth.T, sigma.T, motion.T, step).T
    return right, down


def _along_rows(inverse_depth, sigma, motion, step):
    """True (h, w - 1) where a pixel and the next one in its row lie on one surface."""
    change = np.diff(inverse_depth, axis=1)
    towards, size = np.sign(change), np.abs(change)
    padded = np.pad(change, ((0, 0), (2, 2)), constant_values=0)
    count = change.shape[1]
    with np.errstate(invalid="ignore", divide="ignore"):
        beside = [padded[:, start : start + count] * towards for start in (0, 1, 3, 4)]  # below 0: the other way
        pairs = [np.minimum(beside[i], beside[j]) for i, j in ((0, 1), (1, 2), (2, 3))]
        slope = _STEEPER * np.fmax.reduce(pairs)
        steepest = _LARGEST_GRADIENT * step / np.fmax(motion[:, :-1], motion[:, 1:])
        noise = DEVIATIONS * np.sqrt(sigma[:, :-1] ** 2 + sigma[:, 1:] ** 2)
        return size <= noise + np.fmax(np.fmin(slope, steepest), 0)
