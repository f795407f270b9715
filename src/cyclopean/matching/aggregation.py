"""Semi-global aggregation: agreement with the neighbours along eight straight paths.

Hirschmueller, Stereo processing by semiglobal matching and mutual information, PAMI 30(2), 2008.
"""

import numpy as np
from numba import njit, prange

DIRECTIONS = ((1, 0), (-1, 0), (0, 1), (0, -1), (1, 1), (-1, -1), (1, -1), (-1, 1))  # (dx, dy)

_LANES = 16  # neighbouring paths that walk side by side, so that memory is read in order


@njit(cache=True)
def _extend(costs, before, after, small, large, total):
    """Go one pixel on along a path: ``before`` and ``after`` hold D values, a margin of one, and the least."""
    depths = costs.shape[0]
    least = before[depths + 2]
    jump = np.uint16(least + large)
    same, down, up = before[1 : depths + 1], before[:depths], before[2 : depths + 2]
    out = after[1 : depths + 1]
    new_least = np.uint16(65535)
    for k in range(depths):
        stay = min(same[k], jump)
        move = np.uint16(min(down[k], up[k]) + small)
        value = np.uint16(np.uint16(costs[k]) + np.uint16(min(stay, move) - least))
        out[k] = value
        total[k] = np.uint16(total[k] + value)
        new_least = min(new_least, value)
    after[0] = after[depths + 1] = np.uint16(30000)  # nothing beyond the first and the last hypothesis
    after[depths + 2] = new_least


@njit(parallel=True, cache=True)
def _sweep(volume, mask, small, large, dx, dy, total):
    """Add the costs of all paths of one direction to ``total``."""
    height, width, depths = volume.shape
    steps = width if dy == 0 else height
    first = -(height - 1) if dx * dy != 0 else 0
    paths = height if dy == 0 else width - first
    for block in prange((paths + _LANES - 1) // _LANES):
        state = np.zeros((2, _LANES, depths + 3), np.uint16)
        state[:, :, 0] = state[:, :, depths + 1] = np.uint16(30000)
        for step in range(steps):
            now, then = step % 2, 1 - step % 2
            for lane in range(min(_LANES, paths - block * _LANES)):
                path = block * _LANES + lane
                if dy == 0:
                    y, x = path, step if dx > 0 else width - 1 - step
                else:
                    y = step if dy > 0 else height - 1 - step
                    x = path + first + dx * dx * step
                    x = x if dx >= 0 else width - 1 - x
                if x < 0 or x >= width:
                    continue
                if mask[y, x]:
                    before, after = state[then, lane], state[now, lane]
                    _extend(volume[y, x], before, after, small, large[y, x], total[y, x])
                else:
                    state[now, lane, 1 : depths + 1] = np.uint16(0)
                    state[now, lane, depths + 2] = np.uint16(0)


def aggregate(volume, mask, small, large):
    """Sum the costs of the best smooth paths that end at each pixel, over eight directions.

    Parameters
    ----------
    volume : (h, w, D) uint8 array
        Cost of every hypothesis.
    mask : (h, w) bool array
        Pixels that take part; paths begin anew behind the others.
    small : int
        Penalty for a change by one hypothesis between neighbours.
    large : (h, w) uint16 array
        Penalty for a larger change on entering each pixel, up to 7000.

    Returns
    -------
    (h, w, D) uint16 array
        Sums of costs, 0 outside of the mask.
    """
    total = np.zeros(volume.shape, np.uint16)
    for dx, dy in DIRECTIONS:
        _sweep(volume, mask, np.uint16(small), large, dx, dy, total)
    return total


@njit(parallel=True, cache=True)
def winner(total, mask):
    """The hypothesis of least cost at each pixel, with a parabola through its neighbours.

    Returns
    -------
    (h, w) float32 array
        Hypothesis number, fractions included; NaN outside of the mask.
    """
    height, width, depths = total.shape
    best = np.full((height, width), np.nan, np.float32)
    for y in prange(height):
        for x in range(width):
            if not mask[y, x]:
                continue
            k = np.argmin(total[y, x])
            best[y, x] = k
            if 0 < k < depths - 1:
                left = np.float32(total[y, x, k - 1]) - np.float32(total[y, x, k])
                right = np.float32(total[y, x, k + 1]) - np.float32(total[y, x, k])
                if left + right > 0:
                    best[y, x] += np.float32(0.5) * (left - right) / (left + right)
    return best
