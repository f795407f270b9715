"""How badly the views disagree at each pixel and hypothesis."""

import numpy as np
from numba import njit, prange

UNSEEN = np.float32(4)  # cost planes hold 0..2; this marks a pixel that a view does not see

_FAST = {"contract", "reassoc", "nsz", "arcp"}  # no "nnan": NaN has a meaning here


@njit(cache=True, fastmath=_FAST)
def _column_sums(reference, warped, seen, top, bottom, pad, sums):
    """Sums over rows top..bottom of one channel: seen, r, w, r r, w w, r w, each with a margin of zeros."""
    sums[:] = 0
    width = seen.shape[1]
    inner = sums[:, pad : pad + width]
    count, r_sum, w_sum, rr, ww, rw = inner[0], inner[1], inner[2], inner[3], inner[4], inner[5]
    for row in range(top, bottom):
        m, r_row, w_row = seen[row], reference[row], warped[row]
        for x in range(width):
            r = m[x] * r_row[x]
            w = m[x] * w_row[x]
            count[x] += m[x]
            r_sum[x] += r
            w_sum[x] += w
            rr[x] += r * r
            ww[x] += w * w
            rw[x] += r * w


@njit(cache=True, fastmath=_FAST)
def _row_sums(sums, radius, out):
    """Add up 2 radius + 1 neighbours along the rows of ``sums``."""
    width = out.shape[1]
    for k in range(sums.shape[0]):
        line = out[k]
        line[:] = 0
        for shift in range(2 * radius + 1):
            part = sums[k, shift : shift + width]
            for x in range(width):
                line[x] += part[x]


@njit(parallel=True, cache=True, fastmath=_FAST)
def dissimilarity(reference, warped, seen, radius, floor):
    """1 - ZNCC of square windows, all channels together.

    Parameters
    ----------
    reference, warped : (C, h, w) float32 arrays
        The two pictures; finite everywhere.
    seen : (h, w) float32 array
        1 where both pictures count, else 0.
    radius : int
        Half width of the window, px.
    floor : float
        Variance of a pixel's noise; windows with less contrast than that look alike to nothing.

    Returns
    -------
    (h, w) float32 array
        0 (same) to 2 (opposite); UNSEEN where the pixel itself or half of its window is not seen.
    """
    channels, height, width = reference.shape
    cost = np.empty((height, width), np.float32)
    for y in prange(height):
        sums = np.empty((6, width + 2 * radius), np.float32)
        window = np.empty((6, width), np.float32)
        total = np.zeros((3, width), np.float32)
        top, bottom = max(0, y - radius), min(height, y + radius + 1)
        for c in range(channels):
            _column_sums(reference[c], warped[c], seen, top, bottom, radius, sums)
            _row_sums(sums, radius, window)
            count, r, w, rr, ww, rw = window[0], window[1], window[2], window[3], window[4], window[5]
            for x in range(width):
                share = np.float32(1) / max(count[x], np.float32(1))
                noise = np.float32(floor) * count[x]
                total[0, x] += rw[x] - r[x] * w[x] * share
                total[1, x] += rr[x] - r[x] * r[x] * share + noise
                total[2, x] += ww[x] - w[x] * w[x] * share + noise
        enough = np.float32((2 * radius + 1) ** 2) / np.float32(2)
        m, out = seen[y], cost[y]
        for x in range(width):
            power = np.sqrt(max(total[1, x], np.float32(1e-12)) * max(total[2, x], np.float32(1e-12)))
            unlike = np.float32(1) - total[0, x] / power
            out[x] = unlike if m[x] > 0 and window[0, x] >= enough else UNSEEN
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
