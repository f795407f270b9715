"""Sub-step inverse depth: Lucas and Kanade's method on the whole picture at once, all views together.

Each pixel of the reference is looked up in every other view at its own inverse depth, which may slope. What is
left of the difference within a window, after a gain and an offset for each view, tells how far the inverse depth
is off. Products of differences and slopes are summed down, then across, and serve all windows that hold them;
only near a jump in depth has each pixel sums of its own, of neighbours of like depth.

Lucas and Kanade, IJCAI 1981; Baker and Matthews, Lucas-Kanade 20 years on, IJCV 56(3), 2004.
"""

import numpy as np
from numba import njit, prange

from .places import BLOCK, FAST, MARGIN
from .sampling import WIDE, look, workspace
from .surfaces import extremes

SUB = 16  # columns that have windows of their own if one of them is near a jump
_TALL = 128  # rows worked on together
_SUMS = 10  # w r rr e er ee g gr gg ge
_FAR = 1e6  # stands for the inverse depth (in steps) of pixels that have none: no neighbour resembles it
_GAIN = np.float32(100)  # grey levels squared: noise of 1 level, gains within 10 %
_NOISE = np.float32(0.06)  # least variance of a grey level: 2 / 12 of the rounding, a little smoothed
_DROP = np.float32(0.15)  # a view whose likeness is this far below the best view's does not see the point
_ZERO, _ONE, _TWO, _FOUR, _SIX, _TINY = (np.float32(x) for x in (0, 1, 2, 4, 6, 1e-6))


@njit(cache=True, fastmath=FAST, error_model="numpy")
def _products(own, look, scale, out):
    """The ten products of one row, which lie one after the other: only so does the loop vectorise."""
    for x in range(WIDE):
        w, e, g, r = scale * look[x], scale * look[WIDE + x], scale * look[2 * WIDE + x], own[x]
        out[x] = w
        out[WIDE + x] = w * r
        out[2 * WIDE + x] = w * r * r
        out[3 * WIDE + x] = e
        out[4 * WIDE + x] = e * r
        out[5 * WIDE + x] = e * look[WIDE + x]
        out[6 * WIDE + x] = g
        out[7 * WIDE + x] = g * r
        out[8 * WIDE + x] = g * look[2 * WIDE + x]
        out[9 * WIDE + x] = g * look[WIDE + x]


@njit(cache=True, fastmath=FAST, error_model="numpy")
def _down3(a, b, c, out):
    """Weights 1 2 1 down three rows of sums."""
    for x in range(_SUMS * WIDE):
        out[x] = a[x] + _TWO * b[x] + c[x]


@njit(cache=True, fastmath=FAST, error_model="numpy")
def _down5(a, b, c, d, e, out):
    """Weights 1 4 6 4 1 down five rows of sums."""
    for x in range(_SUMS * WIDE):
        out[x] = (a[x] + e[x]) + _FOUR * (b[x] + d[x]) + _SIX * c[x]


@njit(cache=True, fastmath=FAST, error_model="numpy")
def _across3(sums, apart, out):
    """Weights 1 2 1 across three columns, ``apart`` from each other; runs over the ends of the ten sums."""
    a, b, c, to = sums[: -2 * apart], sums[apart:], sums[2 * apart :], out[apart:]
    for x in range(len(a)):
        to[x] = a[x] + _TWO * b[x] + c[x]


@njit(cache=True, fastmath=FAST, error_model="numpy")
def _across5(sums, out):
    """Weights 1 4 6 4 1 across every other of nine columns."""
    to = out[4:]
    for x in range(_SUMS * WIDE - 8):
        to[x] = (sums[x] + sums[x + 8]) + _FOUR * (sums[x + 2] + sums[x + 6]) + _SIX * sums[x + 4]


@njit(cache=True, fastmath=FAST, error_model="numpy")
def _gather(sums, out):
    for m in range(_SUMS):
        for x in range(BLOCK):
            out[m * BLOCK + x] = sums[m * WIDE + MARGIN + x]


@njit(cache=True, fastmath=FAST, error_model="numpy")
def _add_near(own, look, depth, middle, weight, reach, sums):
    """Add seven neighbours in a row of each of SUB pixels to their sums, those of like depth."""
    for x in range(SUB):
        s0, s1, s2, s3, s4 = _ZERO, _ZERO, _ZERO, _ZERO, _ZERO
        s5, s6, s7, s8, s9 = _ZERO, _ZERO, _ZERO, _ZERO, _ZERO
        for i in range(7):
            away = (depth[x + i] - middle[x]) * reach
            near = max(_ONE - away * away, _ZERO)
            near = near * near * weight * np.float32((4 - abs(i - 3)) / 4)
            e, g, r = look[WIDE + x + i], look[2 * WIDE + x + i], own[x + i]
            w, we, wg = near * look[x + i], near * e, near * g
            s0, s1, s2 = s0 + w, s1 + w * r, s2 + w * r * r
            s3, s4, s5 = s3 + we, s4 + we * r, s5 + we * e
            s6, s7, s8, s9 = s6 + wg, s7 + wg * r, s8 + wg * g, s9 + wg * e
        sums[x] += s0
        sums[BLOCK + x] += s1
        sums[2 * BLOCK + x] += s2
        sums[3 * BLOCK + x] += s3
        sums[4 * BLOCK + x] += s4
        sums[5 * BLOCK + x] += s5
        sums[6 * BLOCK + x] += s6
        sums[7 * BLOCK + x] += s7
        sums[8 * BLOCK + x] += s8
        sums[9 * BLOCK + x] += s9


@njit(cache=True, fastmath=FAST, error_model="numpy")
def _near(own, looks, depth, reach, y, row, x0, left, sums):
    """Sums of SUB pixels near a jump, of 7 x 7 neighbours by themselves."""
    for m in range(_SUMS):
        sums[m * BLOCK : m * BLOCK + SUB] = 0
    middle = depth[y, x0 + left : x0 + left + SUB]
    for j in range(-3, 4):
        weight = np.float32((4 - abs(j)) / 4)
        at = left - 3
        _add_near(own[y + j, x0 + at :], looks[row + j, at:], depth[y + j, x0 + at :], middle, weight, reach, sums)


@njit(cache=True, fastmath=FAST, error_model="numpy")
def _without_gain(s, pair):
    """Take gain and offset out of a view's sums: matrix, right side, energy, power and weight of each window."""
    for x in range(BLOCK):
        w = s[x]
        share = _ONE / max(w, _TINY)
        r, e, g = s[BLOCK + x] * share, s[3 * BLOCK + x] * share, s[6 * BLOCK + x] * share
        rr = max(s[2 * BLOCK + x] - r * s[BLOCK + x], _ZERO)
        er, ee = s[4 * BLOCK + x] - e * s[BLOCK + x], s[5 * BLOCK + x] - e * s[3 * BLOCK + x]
        gr, gg = s[7 * BLOCK + x] - g * s[BLOCK + x], s[8 * BLOCK + x] - g * s[6 * BLOCK + x]
        ge = s[9 * BLOCK + x] - g * s[3 * BLOCK + x]
        per = _ONE / (rr + _GAIN)
        pair[x] = gg - gr * gr * per
        pair[BLOCK + x] = gr * er * per - ge
        pair[2 * BLOCK + x] = max(ee - er * er * per, _ZERO)
        pair[3 * BLOCK + x] = max(rr + _TWO * er + ee, np.float32(1e-3))
        pair[4 * BLOCK + x] = w
        pair[5 * BLOCK + x] = gr + ge
        pair[6 * BLOCK + x] = gg


@njit(cache=True, fastmath=FAST, error_model="numpy")
def _together(pairs, usable, prior, total, change):
    """Add the usable views up, and solve for the change of inverse depth."""
    total[:] = 0
    for k in range(len(pairs)):
        for m in range(7):
            for x in range(BLOCK):
                total[m * BLOCK + x] += usable[k, x] * pairs[k, m * BLOCK + x]
    for x in range(BLOCK):
        spread = max(total[2 * BLOCK + x] / max(total[4 * BLOCK + x], _ONE), _NOISE)
        change[x] = total[BLOCK + x] / (total[x] + spread * prior)


@njit(cache=True, fastmath=FAST, error_model="numpy")
def _likeness(pair, change, like):
    """Correlation coefficient of one view after the change."""
    for x in range(BLOCK):
        d = change[x]
        left = pair[2 * BLOCK + x] + d * (d * pair[x] - _TWO * pair[BLOCK + x])
        power = max(pair[3 * BLOCK + x] + d * (d * pair[6 * BLOCK + x] + _TWO * pair[5 * BLOCK + x]), np.float32(1e-3))
        like[x] = np.sqrt(max(_ONE - max(left, _ZERO) / power, _ZERO))


@njit(cache=True, fastmath=FAST, error_model="numpy")
def _keep_alike(pairs, change, usable, like, best):
    """Drop the views that are much less like the reference than the best one."""
    best[:] = 0
    for k in range(len(pairs)):
        _likeness(pairs[k], change, like[k])
        for x in range(BLOCK):
            best[x] = max(best[x], like[k, x] * usable[k, x])
    for k in range(len(pairs)):
        for x in range(BLOCK):
            usable[k, x] = usable[k, x] if like[k, x] >= best[x] - _DROP else _ZERO


@njit(cache=True, fastmath=FAST, error_model="numpy")
def _result(total, change, middle, count, depth, sigma, score):
    """Inverse depth, its standard deviation by the pictures alone, and the correlation coefficient."""
    for x in range(count):
        a, b, d = total[x], total[BLOCK + x], change[x]
        left = max(total[2 * BLOCK + x] + d * (d * a - _TWO * b), _ZERO)
        spread = max(left / max(total[4 * BLOCK + x] - np.float32(3), _ONE), _NOISE)
        known = a > 0 and middle[x] < np.float32(_FAR)
        depth[x] = middle[x] + min(max(d, -_ONE), _ONE) if known else np.float32(np.nan)
        sigma[x] = np.sqrt(spread / max(a, _TINY))
        power = total[3 * BLOCK + x] + d * (d * total[6 * BLOCK + x] + _TWO * total[5 * BLOCK + x])
        score[x] = np.sqrt(max(_ONE - left / max(power, np.float32(1e-3)), _ZERO))


@njit(cache=True, fastmath=FAST, error_model="numpy")
def _scaled(depth, half, s, known):
    for x in range(WIDE):
        there = depth[x] < np.float32(_FAR)
        known[x] = _ONE if there else _ZERO
        s[x] = (depth[x] if there else _ZERO) / half - _ONE


@njit(cache=True, fastmath=FAST, error_model="numpy")
def _looks(own, depth, lines, spacing, stride, half, others, frames, starts, splines, weights, y0, x0, rows, looks):
    """Compare all rows of a tile and its margin with every other view."""
    room, s, known = workspace(lines.shape[2]), np.empty(WIDE, np.float32), np.empty(WIDE, np.float32)
    channels = len(splines)
    for row in range(rows):
        y = y0 + row
        _scaled(depth[y, x0 : x0 + WIDE], half, s, known)
        line = max((y - MARGIN) * stride, 0)
        for k in range(len(lines)):
            view, c = others[k // channels], k % channels
            part = slice(starts[view], starts[view + 1])
            mine, out = own[c, y, x0 : x0 + WIDE], looks[k, row]
            spline = splines[c, part]
            look(lines[k], spacing, line, x0, s, known, half, frames[view], spline, weights[part], mine, room, out)


@njit(cache=True, fastmath=FAST, error_model="numpy")
def _advance(own, look, scale, passes, n, rows, line, spare):
    """Take row n of a tile into the running windows of one view: ``line`` holds them from row 4 passes - 2 on.

    ``rows`` (12, 10 WIDE) holds the last three rows of products, and nine of the sums down three rows.
    """
    _products(own, look, scale, rows[n % 3])
    if n >= 2:
        _down3(rows[(n - 2) % 3], rows[(n - 1) % 3], rows[n % 3], rows[3 + n % 9])
    if n < 4 * passes - 2:
        return
    a, b, c = rows[3 + (n - 4) % 9], rows[3 + (n - 2) % 9], rows[3 + n % 9]
    if passes == 2:
        _down3(a, b, c, spare)
        _across3(spare, 1, rows[(n + 1) % 3])
        _across3(rows[(n + 1) % 3], 2, line)
    else:
        _down5(rows[3 + (n - 8) % 9], rows[3 + (n - 6) % 9], a, b, c, spare)
        _across3(spare, 1, rows[(n + 1) % 3])
        _across5(rows[(n + 1) % 3], line)


@njit(cache=True, fastmath=FAST, error_model="numpy")
def _solved(pairs, usable, prior, middle, count, like, rest, result):
    """Inverse depth, its standard deviation and correlation of one row of a tile, from all views' windows."""
    change, best, total = rest[:BLOCK], rest[BLOCK : 2 * BLOCK], rest[2 * BLOCK :]
    _together(pairs, usable, prior, total, change)
    if len(pairs) > 1:
        _keep_alike(pairs, change, usable, like, best)
        _together(pairs, usable, prior, total, change)
    _result(total, change, middle, count, result[0], result[1], result[2])


@njit(parallel=True, cache=True, fastmath=FAST, error_model="numpy")
def improve(
    own, depth, lines, spacing, stride, half, others, frames, starts, splines, weights, passes, scale, near, result
):
    """One step at every pixel.

    Parameters
    ----------
    own : (C, h', w') float32 array
        The reference with MARGIN on all sides and room for whole tiles.
    depth : (h', w') float32 array
        Inverse depth in hypotheses; _FAR where unknown.
    lines : ((V-1) C, Ny, 2 K, w') float32 array
        Polynomials of the places, from `lines_of`.
    spacing, stride : int
        Rows between lines; pixels of the photograph between those of the reference.
    half : float
        Half of the last hypothesis number.
    others : (V-1,) int array
        The other views.
    frames, starts, splines, weights : arrays
        `Pictures` of the B-spline coefficients of all views, at the scale of the reference.
    passes : int
        2 or 3: windows 7 or 11 px wide, standard deviation 1.58 or 2.12 px.
    scale : float
        What makes the weight in the middle of a window 1.
    near : (jumps, reach, prior)
        Whether one of SUB pixels is near a jump, (h, w / SUB) bool; 1 / the difference at which a neighbour stops
        to count; 1 / the variance that changes are expected to have.
    result : (3, h, w) float32 array, written
        Inverse depth, its standard deviation, correlation coefficient.
    """
    height, width = result.shape[1:]
    jumps, reach, prior = near
    many, radius, channels = len(lines), 2 * passes - 1, len(splines)
    across = (width + BLOCK - 1) // BLOCK
    for tile in prange(across * ((height + _TALL - 1) // _TALL)):
        y0, x0 = (tile // across) * _TALL, (tile % across) * BLOCK
        tall, top = min(_TALL, height - y0) + 2 * radius, y0 + MARGIN - radius
        if not np.any(depth[y0 + MARGIN : y0 + tall - 2 * radius + MARGIN, x0 + MARGIN : x0 + MARGIN + BLOCK] < _FAR):
            result[:, y0 : y0 + tall - 2 * radius, x0 : x0 + BLOCK] = np.nan
            continue
        looks = np.empty((many, tall, 3 * WIDE), np.float32)
        _looks(own, depth, lines, spacing, stride, half, others, frames, starts, splines, weights, top, x0, tall, looks)
        rows, lined = np.zeros((many, 12, _SUMS * WIDE), np.float32), np.zeros((2, _SUMS * WIDE), np.float32)
        sums, pairs = np.empty(_SUMS * BLOCK, np.float32), np.empty((many, 7 * BLOCK), np.float32)
        usable, like = np.empty((2, many, BLOCK), np.float32)
        rest, count = np.empty(9 * BLOCK, np.float32), min(BLOCK, width - x0)
        for n in range(tall):
            row = n - 2 * radius  # of the result that the windows are complete for
            y = y0 + row + MARGIN
            for k in range(many):
                mine = own[k % channels]
                _advance(mine[top + n, x0 : x0 + WIDE], looks[k, n], scale, passes, n, rows[k], lined[0], lined[1])
                if row < 0:
                    continue
                _gather(lined[0], sums)
                for sub in range(BLOCK // SUB):
                    if jumps[y0 + row, x0 // SUB + sub]:
                        left = MARGIN + sub * SUB
                        _near(mine, looks[k], depth, reach, y, row + radius, x0, left, sums[sub * SUB :])
                _without_gain(sums, pairs[k])
                for x in range(BLOCK):
                    usable[k, x] = _ONE if looks[k, row + radius, MARGIN + x] > 0 else _ZERO
            if row >= 0:
                middle, to = depth[y, x0 + MARGIN : x0 + MARGIN + BLOCK], slice(x0, x0 + count)
                _solved(pairs, usable, prior, middle, count, like, rest, result[:, y0 + row, to])


def refined(pictures, splines, reference, depth, *, passes, reach, prior):
    """Improve a depth map by one step.

    Parameters
    ----------
    pictures, splines : Pictures
        Of all views at the scale of the map, and their B-spline coefficients.
    reference : Reference
        Its maps into the other views.
    depth : (h, w) float32 array
        Inverse depth in hypotheses, good to about one; NaN unknown.
    passes : int
        2 or 3: windows 7 or 11 px wide, standard deviation 1.58 or 2.12 px.
    reach : float
        Difference of inverse depth, in hypotheses, at which a neighbour stops to count.
    prior : float
        Standard deviation that changes are expected to have, hypotheses.

    Returns
    -------
    depth, sigma, score : (h, w) float32 arrays
        Inverse depth and its standard deviation in hypotheses, by the pictures alone; correlation coefficient of
        all views. NaN where no other view sees the pixel.
    """
    (height, width), values = depth.shape, pictures.own(reference.number)
    room = (height + 2 * MARGIN, -(-width // BLOCK) * BLOCK + 2 * MARGIN)
    inner = (slice(MARGIN, MARGIN + height), slice(MARGIN, MARGIN + width))
    own, padded = np.zeros((len(values), *room), np.float32), np.full(room, 2 * _FAR, np.float32)
    own[:, *inner], padded[inner] = values, np.where(np.isnan(depth), np.float32(2 * _FAR), depth)
    low, high = extremes(depth, 2 * passes - 1)
    jump = np.zeros((height, room[1] - 2 * MARGIN), bool)
    jump[:, :width] = high - low > reach
    near = jump.reshape(height, -1, SUB).any(-1), np.float32(1 / reach), np.float32(1 / prior**2)
    stride = round(1 / pictures.layout.scale)
    maps = reference.lines[stride], reference.spacing, stride, reference.half(1), reference.others
    scale = np.float32(1 / 16 if passes == 2 else 1 / 144)
    result = np.empty((3, height, width), np.float32)
    improve(own, padded, *maps, *splines.arrays, splines.layout.weights, passes, scale, near, result)
    return tuple(result)
