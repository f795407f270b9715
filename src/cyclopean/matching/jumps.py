"""Jumps in depth put in their place: each pixel near one chooses between the surfaces on its two sides."""

import numpy as np
from numba import njit, prange

from .places import FAST, MARGIN, place
from .surfaces import extremes

RADIUS = 2  # px about a pixel in which other surfaces are looked for
REACH = np.float32(1.5)  # hypotheses: more is another surface
_SPAN = 8  # px over which the maps' slopes are taken, and for which they serve
_NOISE = np.float32(1)  # variance of a grey level
_CEILING = np.float32(0.7)  # 1 - ZNCC of views that show something else
_UNSEEN = np.float32(0.4)  # of what no view sees
_ZERO, _ONE = np.float32(0), np.float32(1)


@njit(cache=True, fastmath=FAST, error_model="numpy")
def _slopes(lines, spacing, y, x, out):
    """How far the place in another view moves for a pixel across and one down, halfway through the range: out (4,)."""
    for axis in range(2):
        here = place(lines, spacing, y, x, _ZERO, axis)
        out[axis] = (place(lines, spacing, y, x + _SPAN, _ZERO, axis) - here) / np.float32(_SPAN)
        out[2 + axis] = (place(lines, spacing, y + _SPAN, x, _ZERO, axis) - here) / np.float32(_SPAN)


@njit(cache=True, fastmath=FAST, error_model="numpy")
def _sample(values, weights, width, height, u, v):
    """Bilinear value of a picture, NaN where it is not the view's."""
    if not (u >= _ONE and v >= _ONE and u < width - 2 and v < height - 2):
        return np.float32(np.nan)
    i, j = int(u), int(v)
    a, b, at = u - np.float32(i), v - np.float32(j), j * width + i
    if weights[at] == 0:
        return np.float32(np.nan)
    upper = values[at] + a * (values[at + 1] - values[at])
    lower = values[at + width] + a * (values[at + width + 1] - values[at + width])
    return upper + b * (lower - upper)


@njit(cache=True, fastmath=FAST, error_model="numpy")
def _unlike(own, y, x, left, top, slopes, values, weights, width, height):
    """1 - ZNCC of 3 x 3 pixels about a place in a view's picture, NaN where the view does not see all of them."""
    w, ww, r, rr, rw = np.float32(0), np.float32(0), np.float32(0), np.float32(0), np.float32(0)
    for j in range(-1, 2):
        for i in range(-1, 2):
            di, dj = np.float32(i), np.float32(j)
            u, v = left + di * slopes[0] + dj * slopes[2], top + di * slopes[1] + dj * slopes[3]
            a, b = _sample(values, weights, width, height, u, v), own[y + j, x + i]
            w, r = w + a, r + b
            ww, rr, rw = ww + a * a, rr + b * b, rw + a * b
    share = np.float32(1 / 9)
    w, r = w * share, r * share
    power = (ww * share - w * w + _NOISE) * (rr * share - r * r + _NOISE)
    return _ONE - (rw * share - w * r) / np.sqrt(power)


@njit(cache=True, fastmath=FAST, error_model="numpy")
def _cost(own, y, x, depth, lines, spacing, half, others, frames, starts, values, weights, slopes):
    """Cost of a pixel at an inverse depth: mean over the views that see it, each cut off at the ceiling."""
    total, count, s = np.float32(0), 0, depth / half - _ONE
    for k in range(len(lines)):
        view, c = others[k // len(values)], k % len(values)
        part = slice(starts[view], starts[view + 1])
        left = place(lines[k], spacing, y, x + MARGIN, s, 0) - frames[view, 0]
        top = place(lines[k], spacing, y, x + MARGIN, s, 1) - frames[view, 1]
        width, height = int(frames[view, 2]), int(frames[view, 3])
        unlike = _unlike(own[c], y + 1, x + 1, left, top, slopes[k], values[c, part], weights[part], width, height)
        if unlike == unlike:
            total, count = total + min(unlike, _CEILING), count + 1
    return total / np.float32(count) if count > 0 else _UNSEEN


@njit(parallel=True, cache=True, fastmath=FAST, error_model="numpy")
def _chosen(own, depth, low, high, lines, spacing, half, others, frames, starts, values, weights):
    height, width = depth.shape
    out = depth.copy()
    for y in prange(height):
        slopes, block = np.empty((len(lines), 4), np.float32), -1
        for x in range(width):
            if not high[y, x] - low[y, x] > REACH or np.isnan(depth[y, x]):
                continue
            if x // _SPAN != block:
                block = x // _SPAN
                for k in range(len(lines)):
                    _slopes(lines[k], spacing, y, min(block * _SPAN, max(width - 1 - _SPAN, 0)) + MARGIN, slopes[k])
            least = np.float32(np.inf)
            for candidate in (depth[y, x], low[y, x], high[y, x]):
                if least < np.inf and abs(candidate - depth[y, x]) <= REACH:
                    continue
                cost = _cost(
                    own, y, x, candidate, lines, spacing, half, others, frames, starts, values, weights, slopes
                )
                if cost < least:
                    least, out[y, x] = cost, candidate
    return out


def placed(pictures, reference, depth):
    """Let each pixel near a jump choose the surface that looks most like it.

    Parameters
    ----------
    pictures : Pictures
        Of all views, at full scale.
    reference : Reference
        Its maps into the other views.
    depth : (h, w) float32 array
        Inverse depth in hypotheses; NaN unknown.

    Returns
    -------
    (h, w) float32 array
        Each its own, or the least or the largest within RADIUS px.
    """
    own = np.pad(pictures.own(reference.number), ((0, 0), (1, 1), (1, 1)), mode="edge")
    low, high = extremes(depth, RADIUS)
    maps = reference.lines[1], reference.spacing, reference.half(1), reference.others
    return _chosen(own, depth, low, high, *maps, *pictures.arrays, pictures.layout.weights)
