"""How badly the views disagree at each pixel and hypothesis."""

import numpy as np
from numba import njit, prange

from .views import FAST, look

N = 128  # neighbouring pixels whose windows are summed together
REACH = 8  # margin beside them, and so the largest half width of a window
UNSEEN = np.float32(4)  # costs of a view lie in 0..2; this marks a pixel that the view does not see

_RADIUS = 2  # half width of the windows that are compared, px
_NOISE = 1.0  # variance of a grey level below which windows count as blank
_CEILING = 0.7  # 1 - ZNCC of views that show something else

_M = N + 2 * REACH


@njit(cache=True, fastmath=FAST)
def _add_row(s, weight, reference, warped, seen):
    """Add one row of one channel to the column sums: seen, r, w, r r, w w, r w.

    The sums lie one after the other in one array with steps known to the compiler: only so does it vectorise.
    """
    for x in range(_M):
        m = weight * seen[x]
        r, w = m * reference[x], m * warped[x]
        s[x] += m
        s[_M + x] += r
        s[2 * _M + x] += w
        s[3 * _M + x] += r * reference[x]
        s[4 * _M + x] += w * warped[x]
        s[5 * _M + x] += r * warped[x]


@njit(cache=True, fastmath=FAST)
def _add_columns(window, weight, s):
    """Add the N leading column sums to the windows."""
    for x in range(N):
        window[x] += weight * s[x]
        window[N + x] += weight * s[_M + x]
        window[2 * N + x] += weight * s[2 * _M + x]
        window[3 * N + x] += weight * s[3 * _M + x]
        window[4 * N + x] += weight * s[4 * _M + x]
        window[5 * N + x] += weight * s[5 * _M + x]


@njit(cache=True, fastmath=FAST)
def _add_channel(total, window, floor):
    """Add one channel's covariance and the two variances of every window."""
    for x in range(N):
        count, r, w = window[x], window[N + x], window[2 * N + x]
        share = np.float32(1) / max(count, np.float32(1))
        noise = floor * count
        total[x] += window[5 * N + x] - r * w * share
        total[N + x] += window[3 * N + x] - r * r * share + noise
        total[2 * N + x] += window[4 * N + x] - w * w * share + noise


@njit(parallel=True, cache=True, fastmath=FAST)
def dissimilarity(reference, warped, seen, radius, floor, width):
    """1 - ZNCC of square windows, all channels together.

    Weights fall off linearly from the middle of a window, which keeps the edges of things in place.

    Parameters
    ----------
    reference, warped : (C, h, wide) float32 arrays
        The two pictures; finite everywhere. Column REACH is column 0 of the box, and there are whole blocks
        of N columns with a margin of REACH on both sides.
    seen : (h, wide) float32 array
        1 where both pictures count, else 0.
    radius : int
        Half width of the window, px, up to REACH.
    floor : float
        Variance of a pixel's noise; windows with less contrast than that look alike to nothing.
    width : int
        Width of the box.

    Returns
    -------
    (h, width) float32 array
        0 (same) to 2 (opposite); UNSEEN where the pixel itself or half of its window is not seen.
    """
    channels, height, _ = reference.shape
    cost = np.empty((height, width), np.float32)
    enough = np.float32((radius + 1) ** 4) / np.float32(2)
    for y in prange(height):
        columns, window = np.empty(6 * _M, np.float32), np.empty(6 * N, np.float32)
        total = np.empty(3 * N, np.float32)
        for left in range(0, width, N):
            part = slice(left, left + _M)
            total[:] = 0
            for c in range(channels):
                columns[:] = 0
                for row in range(max(0, y - radius), min(height, y + radius + 1)):
                    weight = np.float32(radius + 1 - abs(row - y))
                    _add_row(columns, weight, reference[c, row, part], warped[c, row, part], seen[row, part])
                window[:] = 0
                for dx in range(-radius, radius + 1):
                    _add_columns(window, np.float32(radius + 1 - abs(dx)), columns[REACH + dx :])
                _add_channel(total, window, np.float32(floor))
            for x in range(min(N, width - left)):
                power = np.sqrt(max(total[N + x] * total[2 * N + x], np.float32(1e-12)))
                known = seen[y, left + x + REACH] > 0 and window[x] >= enough
                cost[y, left + x] = np.float32(1) - total[x] / power if known else UNSEEN
    return cost


@njit(parallel=True, cache=True)
def fuse(costs, ceiling):
    """One cost from those of all other views, robust to views that do not see the point.

    Each view that sees the pixel counts with at most ``ceiling``, so that a view in which the point is hidden
    by something else says nothing for or against any hypothesis.

    Parameters
    ----------
    costs : (V-1, h, w) float32 array
        Costs of the single views.
    ceiling : float
        Where a view's cost is cut off.

    Returns
    -------
    (h, w) uint8 array
        0 (all alike) to 255 (nothing alike, or seen by no view).
    """
    views, height, width = costs.shape
    fused = np.empty((height, width), np.uint8)
    for y in prange(height):
        for x in range(width):
            total, count = np.float32(0), 0
            for v in range(views):
                if costs[v, y, x] < UNSEEN:
                    total += min(costs[v, y, x], np.float32(ceiling))
                    count += 1
            mean = total / (count * np.float32(ceiling)) if count > 0 else np.float32(1)
            fused[y, x] = np.uint8(np.float32(255) * max(mean, np.float32(0)) + np.float32(0.5))
    return fused


@njit(parallel=True, cache=True)
def hypotheses_last(planes):
    """Turn (D, h, w) into a contiguous (h, w, D): one pixel's costs side by side."""
    depths, height, width = planes.shape
    volume = np.empty((height, width, depths), planes.dtype)
    for y in prange(height):
        for k in range(depths):
            line = planes[k, y]
            for x in range(width):
                volume[y, x, k] = line[x]
    return volume


def cost_volume(levels, warps, rows, tick):
    """Cost of every hypothesis at every pixel of some rows of the reference box.

    Parameters
    ----------
    levels : (H, W, C) float32 array
        Photograph in grey levels.
    warps : Warps
        Maps into the other views.
    rows : slice
        Rows of the box.
    tick : callable
        Called after each hypothesis.

    Returns
    -------
    (h, w, D) uint8 array
        0 (all views alike) to 255.
    """
    (x0, y0), (width, _), views, channels = warps.origin, warps.size, len(warps.nodes), levels.shape[-1]
    top, own = rows.start, np.ascontiguousarray(warps.reference_mask()[rows])
    height, wide = len(own), -(-width // N) * N + 2 * REACH
    reference, warped = np.zeros((2, channels, height, wide), np.float32)
    box = levels[y0 + rows.start : y0 + rows.stop, x0 : x0 + width]
    reference[..., REACH : REACH + width] = np.moveaxis(box, -1, 0)
    seen = np.zeros((height, wide), np.float32)
    costs = np.empty((views, height, width), np.float32)
    planes = np.empty((len(warps.inverse_depths), height, width), np.uint8)
    for k in range(len(planes)):
        for v in range(views):
            look(levels, warps.masks[v + 1], warps.nodes[v, k], warps.spacing, top, own, REACH, warped, seen)
            costs[v] = dissimilarity(reference, warped, seen, _RADIUS, _NOISE, width)
        planes[k] = fuse(costs, _CEILING)
        tick()
    return hypotheses_last(planes)
