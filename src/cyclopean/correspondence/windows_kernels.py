"""Pictures between their pixels, and how alike windows are: the compiled part of `windows`."""

from __future__ import annotations

import numpy as np
from numba import njit, prange


@njit(cache=True)
def _weights(t, weights, slopes):
    """Cubic B-spline and its derivative at the four pixels around a fraction t of a pixel."""
    s = 1.0 - t
    weights[0], weights[3] = s * s * s / 6, t * t * t / 6
    weights[1] = 2 / 3 - 0.5 * t * t * (2 - t)
    weights[2] = 2 / 3 - 0.5 * s * s * (2 - s)
    slopes[0], slopes[3] = -0.5 * s * s, 0.5 * t * t
    slopes[1] = 0.5 * t * (3 * t - 4)
    slopes[2] = -0.5 * s * (3 * s - 4)


@njit(cache=True)
def _inside(usable, x, y):
    """Whether the spline reaches around a place and its nearest pixel may be used."""
    if not (x >= 1 and y >= 1 and x < usable.shape[1] - 2 and y < usable.shape[0] - 2):
        return False
    return usable[int(y + 0.5), int(x + 0.5)]


@njit(cache=True)
def sample(spline, usable, places, values, slopes):
    """Values and slopes of a picture at places.

    Parameters
    ----------
    spline : (H, W, C) float32 array
        Cubic B-spline coefficients of the picture.
    usable : (H, W) bool array
        Pixels that may be used.
    places : (N, 2) array
        Pixels (x, y).
    values : (N, C) array, written
        NaN where the picture cannot be used.
    slopes : (N, C, 2) array, written
        Derivatives to x and y.
    """
    wx, wy, gx, gy = np.empty((4, 4))
    for n in range(places.shape[0]):
        x, y = places[n]
        if not _inside(usable, x, y):
            values[n], slopes[n] = np.nan, np.nan
            continue
        i, j = int(x), int(y)
        _weights(x - i, wx, gx)
        _weights(y - j, wy, gy)
        values[n], slopes[n] = 0.0, 0.0
        for row in range(4):
            for column in range(4):
                flat = wy[row] * wx[column]
                along, down = wy[row] * gx[column], gy[row] * wx[column]
                for c in range(spline.shape[2]):
                    coefficient = spline[j + row - 1, i + column - 1, c]
                    values[n, c] += flat * coefficient
                    slopes[n, c, 0] += along * coefficient
                    slopes[n, c, 1] += down * coefficient


@njit(cache=True)
def _value(spline, x, y, wx, wy, unused, out):
    """Values (C,) of a picture at one place."""
    i, j = int(x), int(y)
    _weights(x - i, wx, unused)
    _weights(y - j, wy, unused)
    out[:] = 0.0
    for row in range(4):
        for column in range(4):
            flat = wy[row] * wx[column]
            for c in range(out.shape[0]):
                out[c] += flat * spline[j + row - 1, i + column - 1, c]


@njit(cache=True, parallel=True)
def correlate(spline, usable, nodes, shapes, reference, weights, least, scores):
    """Correlation of a window with where each hypothesis puts it in the other views.

    Parameters
    ----------
    spline : (H, W, C) float32 array
        Cubic B-spline coefficients of the picture.
    usable : (V, H, W) bool array
        Pixels of each of the other views that may be used.
    nodes : (D, V, K, 2) array
        Where the window's nodes are seen at each hypothesis, px; NaN where they are not.
    shapes : (N, K) array
        Shares of the nodes in the place of each pixel of the window.
    reference : (N, C) array
        The window.
    weights : (N,) array
        Weight of each of its pixels; 0 does not count.
    least : float
        Share of the weight that must be seen.
    scores : (D, V) array, written
        Zero-mean normalised correlation over all channels; NaN where too little is seen.
    """
    total = weights.sum()
    channels = reference.shape[1]
    views = nodes.shape[1]
    for job in prange(nodes.shape[0] * views):
        d, v = job // views, job % views
        scores[d, v] = np.nan
        if np.isnan(nodes[d, v]).any():
            continue
        sums = np.zeros((5, channels))
        look, wx, wy, unused = np.empty(channels), np.empty(4), np.empty(4), np.empty(4)
        seen = 0.0
        for n in range(shapes.shape[0]):
            if weights[n] == 0:
                continue
            x = y = 0.0
            for k in range(shapes.shape[1]):
                x += shapes[n, k] * nodes[d, v, k, 0]
                y += shapes[n, k] * nodes[d, v, k, 1]
            if not _inside(usable[v], x, y):
                continue
            _value(spline, x, y, wx, wy, unused, look)
            seen += weights[n]
            for c in range(channels):
                wr, wl = weights[n] * reference[n, c], weights[n] * look[c]
                sums[0, c] += wr
                sums[1, c] += wl
                sums[2, c] += wr * reference[n, c]
                sums[3, c] += wl * look[c]
                sums[4, c] += wr * look[c]
        if seen < least * total or seen == 0:
            continue
        cross = own = other = 0.0
        for c in range(channels):
            cross += sums[4, c] - sums[0, c] * sums[1, c] / seen
            own += sums[2, c] - sums[0, c] ** 2 / seen
            other += sums[3, c] - sums[1, c] ** 2 / seen
        if own > 1e-9 * seen and other > 1e-9 * seen:
            scores[d, v] = cross / np.sqrt(own * other)
