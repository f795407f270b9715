"""How badly the views disagree at each pixel and hypothesis."""

import numpy as np
from numba import njit, prange

N = 128                 # neighbouring pixels whose windows are summed together
REACH = 8               # margin beside them, and so the largest half width of a window
UNSEEN = np.float32(4)  # costs of a view lie in 0..2; this marks a pixel that the view does not see

_M = N + 2 * REACH
_FAST = {"contract", "reassoc", "nsz", "arcp"}  # no "nnan": NaN has a meaning here


def padded(width):
    """Columns that `look` and `dissimilarity` want for a box of this width: whole blocks and two margins."""
    return -(-width // N) * N + 2 * REACH


@njit(parallel=True, cache=True, fastmath=_FAST)
def look(image, mask, nodes, spacing, top, own, warped, seen):
    """What another view shows where reference pixels of one hypothesis are seen, by bilinear interpolation.

    Parameters
    ----------
    image : (H, W, C) float32 array
        Photograph.
    mask : (H, W) bool array
        Pixels of the other view.
    nodes : (Ny, Nx, 2) float32 array
        Where the nodes of the lattice are seen, px.
    spacing, top : int
        Pixels between nodes; row of the box that is row 0 of ``own``.
    own : (h, w) bool array
        Pixels of the reference view.
    warped : (C, h, padded(w)) float32 array, written
        The other view's picture; column REACH is column 0 of the box.
    seen : (h, padded(w)) float32 array, written
        1 where both views count, else 0.
    """
    height, width = own.shape
    for y in prange(height):
        j = (top + y) // spacing
        below = min(j + 1, nodes.shape[0] - 1)
        t = np.float32((top + y) % spacing) / np.float32(spacing)
        line = nodes[j] + t * (nodes[below] - nodes[j]) if t > 0 else nodes[j].copy()
        seen[y] = 0
        warped[:, y] = 0
        for x in range(width):
            if not own[y, x]:
                continue
            i = x // spacing
            s = np.float32(x - i * spacing) / np.float32(spacing)
            right = i + 1 if s > 0 else i
            u = line[i, 0] + s * (line[right, 0] - line[i, 0])
            v = line[i, 1] + s * (line[right, 1] - line[i, 1])
            if not (u >= 0 and v >= 0 and u < mask.shape[1] - 1 and v < mask.shape[0] - 1):
                continue
            if not mask[int(v + np.float32(0.5)), int(u + np.float32(0.5))]:
                continue
            a, b = int(u), int(v)
            u, v = u - np.float32(a), v - np.float32(b)
            seen[y, x + REACH] = 1
            for c in range(image.shape[2]):
                upper = image[b, a, c] + u * (image[b, a + 1, c] - image[b, a, c])
                lower = image[b + 1, a, c] + u * (image[b + 1, a + 1, c] - image[b + 1, a, c])
                warped[c, y, x + REACH] = upper + v * (lower - upper)


@njit(cache=True, fastmath=_FAST)
def _add_row(s, reference, warped, seen):
    """Add one row of one channel to the column sums: seen, r, w, r r, w w, r w.

    The sums lie one after the other in one array with steps known to the compiler: only so does it vectorise.
    """
    for x in range(_M):
        m = seen[x]
        r, w = m * reference[x], m * warped[x]
        s[x] += m
        s[_M + x] += r
        s[2 * _M + x] += w
        s[3 * _M + x] += r * r
        s[4 * _M + x] += w * w
        s[5 * _M + x] += r * w


@njit(cache=True, fastmath=_FAST)
def _add_columns(window, s):
    """Add the N leading column sums to the windows."""
    for x in range(N):
        window[x] += s[x]
        window[N + x] += s[_M + x]
        window[2 * N + x] += s[2 * _M + x]
        window[3 * N + x] += s[3 * _M + x]
        window[4 * N + x] += s[4 * _M + x]
        window[5 * N + x] += s[5 * _M + x]


@njit(cache=True, fastmath=_FAST)
def _add_channel(total, window, floor):
    """Add one channel's covariance and the two variances of every window."""
    for x in range(N):
        count, r, w = window[x], window[N + x], window[2 * N + x]
        share = np.float32(1) / max(count, np.float32(1))
        noise = floor * count
        total[x] += window[5 * N + x] - r * w * share
        total[N + x] += window[3 * N + x] - r * r * share + noise
        total[2 * N + x] += window[4 * N + x] - w * w * share + noise


@njit(parallel=True, cache=True, fastmath=_FAST)
def dissimilarity(reference, warped, seen, radius, floor, width):
    """1 - ZNCC of square windows, all channels together.

    Parameters
    ----------
    reference, warped : (C, h, padded(width)) float32 arrays
        The two pictures; finite everywhere; column REACH is column 0 of the box.
    seen : (h, padded(width)) float32 array
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
    enough = np.float32((2 * radius + 1) ** 2) / np.float32(2)
    for y in prange(height):
        columns, window, total = np.empty(6 * _M, np.float32), np.empty(6 * N, np.float32), np.empty(3 * N, np.float32)
        for left in range(0, width, N):
            part = slice(left, left + _M)
            total[:] = 0
            for c in range(channels):
                columns[:] = 0
                for row in range(max(0, y - radius), min(height, y + radius + 1)):
                    _add_row(columns, reference[c, row, part], warped[c, row, part], seen[row, part])
                window[:] = 0
                for shift in range(REACH - radius, REACH + radius + 1):
                    _add_columns(window, columns[shift:])
                _add_channel(total, window, np.float32(floor))
            for x in range(min(N, width - left)):
                power = np.sqrt(max(total[N + x], np.float32(1e-12)) * max(total[2 * N + x], np.float32(1e-12)))
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
