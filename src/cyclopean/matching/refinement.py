"""Sub-step inverse depth: Gauss-Newton on windows of all views at once.

Around each pixel the scene is taken to be a plane in inverse depth. Its height and two slopes, and for each
view and channel a gain and an offset, are fitted so that the other views' windows look like the reference's.
The other views are sampled once per pixel, at the pixel's own inverse depth, and are linear around it; so a
window costs sums of products only. Neighbours of a clearly different depth do not take part.

Lucas and Kanade, IJCAI 1981; Baker and Matthews, Lucas-Kanade 20 years on, IJCV 56(3), 2004.
"""

import numpy as np
from numba import njit, prange
from scipy.ndimage import gaussian_filter, spline_filter

from .views import FAST, UNKNOWN, sample

N = 128  # neighbouring pixels whose sums are built together
_PAIRS = 10  # numbers kept per view: 6 of the 3x3 matrix, 3 of the right side, 1 energy

_BLUR = 0.6  # px: without it, noise passes for texture and keeps the fit from moving
_ALIKE = 1.5  # variance of the height, because the blur makes the noise of neighbours alike
_RADIUS = 5  # half width of the window, px
_WIDTH = 2.5  # standard deviation of the window's Gaussian weights, px
_REACH = 1.0  # neighbours count up to this difference of inverse depth, in steps
_GAIN_WEIGHT = 100.0  # grey levels squared: noise of 1 level, gains within 10 %
_STIFFNESS = 100.0  # grey levels squared: noise of 1 level, slopes of about 0.1 steps per px
_NOISE = 0.2  # least variance of a grey level: 2 / 12 of the rounding, and some
_MARGIN = 0.15  # a view whose likeness is this far below the best view's does not see the point
ITERATIONS = 3
_MAX_CHANGE = 0.3  # steps in the last iteration: more has not converged
_MAX_SIGMA = 0.5  # steps, a quarter of a pixel: more is a window without texture
_MIN_SCORE = 0.6  # less is something else


@njit(cache=True, fastmath=FAST)
def _add(s, reference, values, slopes, seen, depth, middle, window, reach, di, dj):
    """Add one neighbour of each of N pixels to the 21 sums of one view and channel.

    The sums lie one after the other in one array with steps known to the compiler: only so does it vectorise.
    """
    for x in range(N):
        away = depth[x] - middle[x]
        near = max(np.float32(0), np.float32(1) - away * away * reach)
        w = window * near * near * seen[x]
        r, g = reference[x], slopes[x]
        e = values[x] - r - g * away
        wr, wg, we = w * r, w * g, w * e
        gr, gg, ge = wg * r, wg * g, wg * e
        s[x] += w
        s[N + x] += wr
        s[2 * N + x] += wr * r
        s[3 * N + x] += we
        s[4 * N + x] += we * r
        s[5 * N + x] += we * e
        s[6 * N + x] += wg
        s[7 * N + x] += wg * di
        s[8 * N + x] += wg * dj
        s[9 * N + x] += gr
        s[10 * N + x] += gr * di
        s[11 * N + x] += gr * dj
        s[12 * N + x] += gg
        s[13 * N + x] += gg * di
        s[14 * N + x] += gg * dj
        s[15 * N + x] += gg * di * di
        s[16 * N + x] += gg * di * dj
        s[17 * N + x] += gg * dj * dj
        s[18 * N + x] += ge
        s[19 * N + x] += ge * di
        s[20 * N + x] += ge * dj


@njit(cache=True, fastmath=FAST)
def _without_gain(sums, gain_weight, pairs):
    """Take offset and gain out of the sums of one view and channel, and add the rest to the view's pairs.

    ``pairs`` holds the matrix (00 01 02 11 12 22), the right side (0 1 2) and the energy before the fit; then
    come the variance of the other view and the sum of the weights.
    """
    sums = sums.reshape(21, N)
    for x in range(N):
        w = sums[0, x]
        share = np.float32(1) / max(w, np.float32(1e-6))
        r, e = sums[1, x] * share, sums[3, x] * share
        rr, er, ee = sums[2, x] - r * sums[1, x], sums[4, x] - e * sums[1, x], sums[5, x] - e * sums[3, x]
        per = np.float32(1) / (max(rr, np.float32(0)) + np.float32(gain_weight))
        g0, g1, g2 = sums[6, x], sums[7, x], sums[8, x]
        r0, r1, r2 = sums[9, x] - g0 * r, sums[10, x] - g1 * r, sums[11, x] - g2 * r
        pairs[0, x] += sums[12, x] - g0 * g0 * share - r0 * r0 * per
        pairs[1, x] += sums[13, x] - g0 * g1 * share - r0 * r1 * per
        pairs[2, x] += sums[14, x] - g0 * g2 * share - r0 * r2 * per
        pairs[3, x] += sums[15, x] - g1 * g1 * share - r1 * r1 * per
        pairs[4, x] += sums[16, x] - g1 * g2 * share - r1 * r2 * per
        pairs[5, x] += sums[17, x] - g2 * g2 * share - r2 * r2 * per
        pairs[6, x] -= sums[18, x] - g0 * e - r0 * er * per
        pairs[7, x] -= sums[19, x] - g1 * e - r1 * er * per
        pairs[8, x] -= sums[20, x] - g2 * e - r2 * er * per
        pairs[9, x] += max(ee - er * er * per, np.float32(0))
        pairs[10, x] += max(rr, np.float32(0)) + np.float32(2) * er + ee
        pairs[11, x] += w


@njit(cache=True, fastmath=FAST)
def _solve(pairs, stiffness, x, fit):
    """Find height and slopes of the plane at pixel x, and the variance factor of the height; NaN if none."""
    a, b, c = pairs[0, x], pairs[1, x], pairs[2, x]
    d, e, f = pairs[3, x] + stiffness, pairs[4, x], pairs[5, x] + stiffness
    m0, m1, m2 = d * f - e * e, c * e - b * f, b * e - c * d
    det = a * m0 + b * m1 + c * m2
    if not det > np.float32(1e-6) * m0:
        fit[:] = np.nan
        return
    p, q, r = pairs[6, x], pairs[7, x], pairs[8, x]
    fit[0] = (m0 * p + m1 * q + m2 * r) / det
    fit[1] = (m1 * p + (a * f - c * c) * q + (b * c - a * e) * r) / det
    fit[2] = (m2 * p + (b * c - a * e) * q + (a * d - b * b) * r) / det
    fit[3] = m0 / det


@njit(cache=True, fastmath=FAST)
def _energy(pairs, x, fit):
    """What is left of the energy with the plane in place."""
    u, v, w = fit[0], fit[1], fit[2]
    square = pairs[0, x] * u * u + pairs[3, x] * v * v + pairs[5, x] * w * w
    cross = pairs[1, x] * u * v + pairs[2, x] * u * w + pairs[4, x] * v * w
    gain = pairs[6, x] * u + pairs[7, x] * v + pairs[8, x] * w
    return max(pairs[9, x] + square + np.float32(2) * (cross - gain), np.float32(0))


@njit(cache=True, fastmath=FAST)
def _view_sums(reference, looks, depth, window, reach, gain_weight, y, left, sums, pairs):
    """Sums of one view around N pixels of row y: ``pairs`` (12, N), the last two its power and weight."""
    values, slopes, seen = looks
    radius = window.shape[0] // 2
    middle = depth[y + radius, left + radius : left + radius + N]
    pairs[:] = 0
    for c in range(reference.shape[0]):
        sums[:] = 0
        for j in range(2 * radius + 1):
            for i in range(2 * radius + 1):
                if window[j, i] > 0:
                    at, to = y + j, slice(left + i, left + i + N)
                    r, v, g = reference[c, at, to], values[c, at, to], slopes[c, at, to]
                    di, dj = np.float32(i - radius), np.float32(j - radius)
                    _add(sums, r, v, g, seen[at, to], depth[at, to], middle, window[j, i], reach, di, dj)
        _without_gain(sums, gain_weight, pairs)


@njit(cache=True, fastmath=FAST)
def _judge(pairs, usable, x, stiffness, noise, fit, out, likeness):
    """Fit the plane at pixel x to the usable views, and say how well: change, sigma, score; likeness."""
    views = pairs.shape[0]
    total = np.zeros((_PAIRS, 1), np.float32)
    weight, power, used = np.float32(0), np.float32(0), 0
    for v in range(views):
        if usable[v]:
            total[:, 0] += pairs[v, :_PAIRS, x]
            power += pairs[v, _PAIRS, x]
            weight += pairs[v, _PAIRS + 1, x]
            used += 1
    out[:] = np.nan
    if used == 0:
        return
    _solve(total, stiffness, 0, fit)
    if not fit[3] > 0:
        return
    left = _energy(total, 0, fit)
    spread = max(left / max(weight - np.float32(3 + 2 * used), np.float32(1)), np.float32(noise))
    out[0], out[1] = fit[0], np.sqrt(spread * fit[3])
    out[2] = np.sqrt(max(np.float32(1) - left / max(power, np.float32(1e-6)), np.float32(0)))
    for v in range(views):
        share = _energy(pairs[v], x, fit) / max(pairs[v, _PAIRS, x], np.float32(1e-6))
        likeness[v] = np.sqrt(max(np.float32(1) - share, np.float32(0)))


@njit(parallel=True, cache=True, fastmath=FAST)
def improve(reference, values, slopes, seen, depth, window, reach, gain_weight, stiffness, noise, margin):
    """One Gauss-Newton step at every pixel.

    Every array but the window has a margin of the window's radius around the h x w pixels.

    Parameters
    ----------
    reference : (C, h, w) float32 array
        Picture in grey levels.
    values, slopes : (V-1, C, h, w) float32 arrays
        The other views and their change per step of inverse depth, at ``depth``.
    seen : (V-1, h, w) float32 array
        Which pixels count in each view: 0 to 1.
    depth : (h, w) float32 array
        Inverse depth in steps; a large number where unknown.
    window : (2 r + 1, 2 r + 1) float32 array
        Weights of the neighbours.
    reach : float
        1 / (difference of inverse depth, in steps, at which a neighbour stops to count) squared.
    gain_weight, stiffness : float
        How firmly gains are held at 1 and slopes at 0: noise variance over the variance expected of them.
    noise : float
        Least variance of a grey level.
    margin : float
        Views whose likeness falls this far below the best view's do not take part.

    Returns
    -------
    change, sigma, score : (h, w) float32 arrays
        Change of inverse depth and its standard deviation in steps, correlation coefficient; NaN where the
        window does not determine them.
    likeness : (V-1, h, w) float32 array
        Correlation coefficient with each view.
    """
    radius = window.shape[0] // 2
    views, height, width = seen.shape[0], depth.shape[0] - 2 * radius, depth.shape[1] - 2 * radius
    result = np.full((3, height, width), np.nan, np.float32)
    likeness = np.zeros((views, height, width), np.float32)
    for y in prange(height):
        sums, pairs = np.empty(21 * N, np.float32), np.empty((views, _PAIRS + 2, N), np.float32)
        fit, out, like = np.empty(4, np.float32), np.empty(3, np.float32), np.empty(views, np.float32)
        usable = np.empty(views, np.bool_)
        for left in range(0, width, N):
            if not np.any(depth[y + radius, left + radius : left + radius + N] < UNKNOWN):
                continue
            for v in range(views):
                looks = values[v], slopes[v], seen[v]
                _view_sums(reference, looks, depth, window, reach, gain_weight, y, left, sums, pairs[v])
            for x in range(N):
                if not depth[y + radius, left + radius + x] < UNKNOWN:
                    continue
                for v in range(views):
                    usable[v] = seen[v, y + radius, left + radius + x] > 0 and pairs[v, _PAIRS + 1, x] > 0
                like[:] = 0
                _judge(pairs, usable, x, stiffness, noise, fit, out, like)
                best = np.max(like)
                dropped = False
                for v in range(views):
                    if usable[v] and like[v] < best - margin:
                        usable[v], dropped = False, True
                if dropped:
                    _judge(pairs, usable, x, stiffness, noise, fit, out, like)
                result[:, y, left + x] = out
                likeness[:, y, left + x] = like
    return result[0], result[1], result[2], likeness


def refine(smooth, spline, warps, rows, guess, tick):
    """Sharpen the inverse depths of some rows of the reference box.

    Parameters
    ----------
    smooth, spline : (H, W, C) float32 arrays
        Photograph in grey levels and its spline, from `prepare`.
    warps : Warps
        Maps into the other views.
    rows : slice
        Rows of the box.
    guess : (h, w) float32 array
        Inverse depth in steps, good to about a step; NaN unknown.
    tick : callable
        Called after each iteration.

    Returns
    -------
    depth, sigma, score : (h, w) float32 arrays
        Inverse depth and its standard deviation in steps, correlation coefficient of all views; depth is NaN
        where there is too little texture, too little likeness or no convergence.
    """
    (x0, y0), (width, _), views = warps.origin, warps.size, len(warps.nodes)
    edges = (_RADIUS, _RADIUS), (_RADIUS, _RADIUS + -width % N)
    box = smooth[y0 + rows.start : y0 + rows.stop, x0 : x0 + width]
    reference = np.pad(np.moveaxis(box, -1, 0), ((0, 0), *edges))
    values, slopes = np.zeros((2, views, *reference.shape), np.float32)
    seen = np.zeros((views, *reference.shape[1:]), np.float32)
    likeness = np.ones((views, *guess.shape), np.float32)
    window, inner = _window(), (slice(None), slice(_RADIUS, -_RADIUS), slice(_RADIUS, _RADIUS + width))
    for _ in range(ITERATIONS):
        for v in range(views):
            sample(
                spline,
                warps.masks[v + 1],
                warps.nodes[v],
                warps.spacing,
                rows.start,
                guess,
                _RADIUS,
                values[v],
                slopes[v],
                seen[v],
            )
        seen[inner] *= likeness >= likeness.max(axis=0) - _MARGIN
        depth = np.pad(np.nan_to_num(guess, nan=UNKNOWN), edges, constant_values=UNKNOWN)
        found = improve(
            reference,
            values,
            slopes,
            seen,
            depth,
            window,
            np.float32(1 / _REACH**2),
            _GAIN_WEIGHT,
            _STIFFNESS,
            _NOISE,
            _MARGIN,
        )
        change, sigma, score, likeness = (a[..., :width] for a in found)
        sigma = np.sqrt(np.float32(_ALIKE)) * sigma
        guess = guess + np.clip(np.nan_to_num(change), -1, 1)
        tick()
    good = (np.abs(change) <= _MAX_CHANGE) & (sigma <= _MAX_SIGMA) & (score >= _MIN_SCORE)
    good &= (guess >= 0) & (guess <= len(warps.inverse_depths) - 1)
    return np.where(good, guess, np.float32(np.nan)), sigma, score


def prepare(levels):
    """Smooth a photograph (H, W, C) a little; also its cubic B-spline coefficients, both float32."""
    smooth = gaussian_filter(levels, (_BLUR, _BLUR, 0))
    planes = [spline_filter(smooth[..., c], order=3, output=np.float32) for c in range(levels.shape[-1])]
    return smooth, np.stack(planes, axis=-1)


def _window():
    """Weights of the neighbours, (2 r + 1, 2 r + 1) float32, 1 in the middle."""
    line = np.exp(-0.5 * (np.arange(-_RADIUS, _RADIUS + 1) / _WIDTH) ** 2)
    return np.outer(line, line).astype(np.float32)
