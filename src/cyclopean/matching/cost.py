"""How badly the views disagree at each pixel and hypothesis: zero-mean normalised cross-correlation or census."""

import numpy as np
from numba import njit, prange

from .bands import store
from .places import FAST, MARGIN, row_of_polynomials

TILE = 64  # px, rows and columns worked on together
MARGINS = {"zncc": 1, "census": 2}  # px, half widths of windows but for the pixel in the middle
_WIDE, _BROAD = TILE + 2, TILE + 4  # with the margin of the windows of ZNCC, of census
_NOISE = np.float32(1)  # variance of a grey level below which windows count as blank
_CEILING = np.float32(0.7)  # 1 - ZNCC of views that show something else
_BY_WINDOW, _BY_PIXEL = np.float32(0.5), np.float32(0.5)  # shares of the cost: ZNCC of windows, difference of pixels
_PER_UNLIKE, _PER_GREY = _BY_WINDOW / _CEILING, _BY_PIXEL / np.float32(30)  # grey levels apart: something else
_BEST = np.float32(0.5)  # share of the better half of the views, because something may hide the pixel from the others
_BAND, _PER_BIT = np.float32(1), _BY_WINDOW / np.float32(24)  # grey levels alike; of 48 bits, half: something else
_FAR = np.float32(100)  # a cost above all
_ENOUGH = 100  # pixels that tell how bright views are
_SAME_MEAN, _SAME, _MOST_GAIN = 12, 1.25, 3  # grey levels and contrast apart that are left alone; largest gain
_UNSEEN = np.float32(0.55)  # cost, of 0 to 1, of what no view sees: neither good nor bad
_ZERO, _HALF, _ONE, _TWO = np.float32(0), np.float32(0.5), np.float32(1), np.float32(2)
_SHARE = np.float32(1 / 16)  # of a window whose weights are 1 2 1 down and across


@njit(cache=True, fastmath=FAST, error_model="numpy")
def _last(line, out):
    for x in range(len(out)):
        out[x] = line[x]


@njit(cache=True, fastmath=FAST, error_model="numpy")
def _horner(line, s, out):
    for x in range(len(out)):
        out[x] = out[x] * s + line[x]


@njit(cache=True, fastmath=FAST, error_model="numpy")
def _nearest(u, v, frame, at):
    """Flat index of the nearest pixel of a picture, clamped to its rim."""
    left, top, width, height, scale = frame
    for x in range(len(at)):
        a = min(max((u[x] - left) * scale + _HALF, _ZERO), width - _ONE)
        b = min(max((v[x] - top) * scale + _HALF, _ZERO), height - _ONE)
        at[x] = np.int32(b) * np.int32(width) + np.int32(a)


@njit(cache=True, fastmath=FAST, error_model="numpy")
def _take(flat, at, out):
    for x in range(len(out)):
        out[x] = flat[np.uint32(at[x])]


@njit(cache=True, fastmath=FAST, error_model="numpy")
def _look(place, s, frame, flat, work, at, out):
    """One row of what another view shows at one hypothesis."""
    count = place.shape[0] // 2
    u, v = work[0], work[1]
    _last(place[count - 1], u)
    _last(place[2 * count - 1], v)
    for c in range(count - 2, -1, -1):
        _horner(place[c], s, u)
        _horner(place[count + c], s, v)
    _nearest(u, v, (frame[0], frame[1], frame[2], frame[3], frame[4]), at)
    _take(flat, at, out)


@njit(cache=True, fastmath=FAST, error_model="numpy")
def _down(w, r, columns):
    """Weighted sums down three rows, which lie one after the other: w, w w, r w."""
    for x in range(_WIDE):
        a, b, c = w[x], w[_WIDE + x], w[2 * _WIDE + x]
        columns[x] = a + _TWO * b + c
        columns[_WIDE + x] = a * a + _TWO * b * b + c * c
        columns[2 * _WIDE + x] = a * r[x] + _TWO * b * r[_WIDE + x] + c * r[2 * _WIDE + x]


@njit(cache=True, fastmath=FAST, error_model="numpy")
def _across(columns, sums):
    """Weighted sums across three columns, of each of the three numbers."""
    for x in range(TILE):
        sums[x] = columns[x] + _TWO * columns[x + 1] + columns[x + 2]
    for x in range(TILE):
        y = _WIDE + x
        sums[TILE + x] = columns[y] + _TWO * columns[y + 1] + columns[y + 2]
    for x in range(TILE):
        y = 2 * _WIDE + x
        sums[2 * TILE + x] = columns[y] + _TWO * columns[y + 1] + columns[y + 2]


@njit(cache=True, fastmath=FAST, error_model="numpy")
def _moments(sums, mean, power):
    for x in range(TILE):
        mean[x] = sums[x] * _SHARE
        power[x] = sums[TILE + x] * _SHARE - mean[x] * mean[x] + _NOISE


@njit(cache=True, fastmath=FAST, error_model="numpy")
def _unlike(sums, mean, power, one):
    """Add 1 - ZNCC of every window, cut off at the ceiling; NaN where something of it is unseen."""
    for x in range(TILE):
        w = sums[x] * _SHARE
        variance = sums[TILE + x] * _SHARE - w * w + _NOISE
        both = sums[2 * TILE + x] * _SHARE - w * mean[x]
        cost = _ONE - both / np.sqrt(max(variance * power[x], np.float32(1e-6)))
        one[x] += (cost if cost < _CEILING else _CEILING) * _PER_UNLIKE if cost == cost else cost


@njit(cache=True, fastmath=FAST, error_model="numpy")
def _order(w, w0, r, r0, bits):
    """Add how differently two pictures order a neighbour and the pixel in the middle: 0 to 2; NaN stays."""
    for x in range(TILE):
        a, b = w[x] - w0[x], r[x] - r0[x]
        a = _ONE if a > _BAND else _ZERO if a >= -_BAND else -_ONE if a < -_BAND else a
        b = _ONE if b > _BAND else _ZERO if b >= -_BAND else -_ONE if b < -_BAND else b
        bits[x] += abs(a - b)


@njit(cache=True, fastmath=FAST, error_model="numpy")
def _census(w, r, bits, one):
    """Add the Hamming distance of 5x5 windows (Stein, DAGM 2004), cut off; NaN where something of them is unseen."""
    bits[:TILE] = 0
    middle = 2 * _BROAD + 2
    for j in range(5):
        for i in range(5):
            at = j * _BROAD + i
            if at != middle:
                _order(w[at:], w[middle:], r[at:], r[middle:], bits)
    for x in range(TILE):
        cost = bits[x] * _PER_BIT
        one[x] += (cost if cost < _BY_WINDOW else _BY_WINDOW) if cost == cost else cost


@njit(cache=True, fastmath=FAST, error_model="numpy")
def _apart(w, r, one):
    """Add the difference of every pixel, cut off."""
    for x in range(TILE):
        apart = abs(w[x] - r[x]) * _PER_GREY
        one[x] += apart if apart < _BY_PIXEL else _BY_PIXEL


@njit(cache=True, fastmath=FAST, error_model="numpy")
def _add_cost(one, share, total, count):
    for x in range(TILE):
        seen = one[x] == one[x]
        total[x] += share * one[x] if seen else _ZERO
        count[x] += _ONE if seen else _ZERO


@njit(cache=True, fastmath=FAST, error_model="numpy")
def _known(one):
    for x in range(TILE):
        one[x] = one[x] if one[x] == one[x] else _FAR


@njit(cache=True, fastmath=FAST, error_model="numpy")
def _insert(one, slot):
    """Leave the smaller of two costs in the slot, hand on the larger one."""
    for x in range(TILE):
        a, b = slot[x], one[x]
        slot[x] = a if a < b else b
        one[x] = b if a < b else a


@njit(cache=True, fastmath=FAST, error_model="numpy")
def _add(a, b):
    for x in range(TILE):
        a[x] += b[x]


@njit(cache=True, fastmath=FAST, error_model="numpy")
def _blend(few, share, total, count):
    """Replace sums over all views by means of those and of the sums over the best half, where so many see the pixel."""
    for x in range(TILE):
        mixed = total[x] * (_ONE - _BEST) + few[x] * share * _BEST * count[x]
        total[x] = mixed if few[x] < _FAR else total[x]


@njit(cache=True, fastmath=FAST, error_model="numpy")
def _levels(total, count, plane):
    for x in range(TILE):
        cost = total[x] / count[x] if count[x] > _ZERO else _UNSEEN
        plane[x] = np.int32(max(cost, _ZERO) * np.float32(255) + _HALF) & 255


@njit(cache=True, fastmath=FAST, error_model="numpy")
def _prepared(own, lines, spacing, stride, y0, x0, rows, margin, places, r, mean, power):
    """The reference's part of a tile: its places' polynomials, its pixels, its windows' means and variances."""
    wide = TILE + 2 * margin
    for j in range(rows + 2 * margin):
        for c in range(own.shape[0]):
            r[c, j * wide : (j + 1) * wide] = own[c, y0 + j, x0 : x0 + wide]
        for look in range(len(lines)):
            y = max((y0 + j - margin) * stride, 0)
            row_of_polynomials(lines[look], spacing, y, x0 + MARGIN - margin, places[look, j])
    columns, sums = np.empty(3 * _WIDE, np.float32), np.empty(3 * TILE, np.float32)
    for c in range(own.shape[0] if margin == 1 else 0):
        for j in range(rows):
            _down(r[c, j * _WIDE :], r[c, j * _WIDE :], columns)
            _across(columns, sums)
            _moments(sums, mean[c, j], power[c, j])


@njit(cache=True, fastmath=FAST, error_model="numpy")
def _plane(s, others, frames, starts, values, places, rows, margin, r, mean, power, room, plane):
    """Costs of one hypothesis for one tile."""
    total, count, w, work, at, columns, sums, ones, slots = room
    total[:] = 0
    count[:] = 0
    ones[:] = 0
    slots[:] = _FAR
    channels, best, wide = len(values), (len(others) + 1) // 2, TILE + 2 * margin
    share = _ONE / np.float32(channels)
    for look in range(len(places)):
        view, c = others[look // channels], look % channels
        flat = values[c, starts[view] : starts[view + 1]]
        for j in range(rows + 2 * margin):
            _look(places[look, j], s, frames[view], flat, work, at, w[j * wide : (j + 1) * wide])
        for j in range(rows):
            here = (j + margin) * wide + margin
            if margin == 1:
                _down(w[j * _WIDE :], r[c, j * _WIDE :], columns)
                _across(columns, sums)
                _unlike(sums, mean[c, j], power[c, j], ones[j])
            else:
                _census(w[j * _BROAD :], r[c, j * _BROAD :], sums, ones[j])
            _apart(w[here:], r[c, here:], ones[j])
            if c == channels - 1:
                _add_cost(ones[j], share, total[j], count[j])
                if best < len(others):
                    _known(ones[j])
                    for k in range(best):
                        _insert(ones[j], slots[j, k])
                ones[j] = 0
    for j in range(rows):
        if best < len(others):
            for k in range(1, best):
                _add(slots[j, 0], slots[j, k])
            _blend(slots[j, 0], share / np.float32(best), total[j], count[j])
        _levels(total[j], count[j], plane[j])


@njit(parallel=True, cache=True, fastmath=FAST, error_model="numpy")
def fill(
    own, lines, spacing, stride, half, others, frames, starts, values, first, count, start, size, top, volume, margin
):
    """Costs of every hypothesis of every tile of a strip.

    Parameters
    ----------
    own : (C, h + 2 margin + TILE, w + 2 margin + TILE) float32 array
        The reference with a margin and room for whole tiles, NaN outside of the view.
    lines : ((V-1) C, Ny, 2 K, ...) float32 array
        Polynomials of the places, from `lines_of`.
    spacing, stride : int
        Pixels between lines; pixels of the photograph between those of the reference.
    half : float
        Half of the last hypothesis number.
    others : (V-1,) int array
        The other views.
    frames, starts, values : arrays
        `Pictures` of all views, twice as fine as the reference; NaN outside of a view.
    first, count, start : (Ty, Tx) arrays
        The bands of the strip's tiles, and where their costs begin in ``volume``.
    size : (int, int)
        Columns of the box, last row of the strip.
    top : int
        First row of the strip.
    volume : flat uint8 array, written
        0 (all views alike) to 255 (nothing alike); see `Bands`.
    margin : int
        1 for ZNCC, 2 for census; see `MARGINS`.
    """
    across = first.shape[1]
    for tile in prange(first.size):
        ty, tx = tile // across, tile % across
        y0, x0 = top + ty * TILE, tx * TILE
        rows, columns = min(TILE, size[1] - y0), min(TILE, size[0] - x0)
        channels, depths, wide = own.shape[0], count[ty, tx], TILE + 2 * margin
        places = np.empty((len(lines), wide, lines.shape[2], wide), np.float32)
        r = np.empty((channels, wide * wide), np.float32)
        mean = np.empty((channels, TILE, TILE), np.float32)
        power = np.empty((channels, TILE, TILE), np.float32)
        room = (
            np.empty((TILE, TILE), np.float32),
            np.empty((TILE, TILE), np.float32),
            np.empty(wide * wide, np.float32),
            np.empty((2, wide), np.float32),
            np.empty(wide, np.int32),
            np.empty(3 * _WIDE, np.float32),
            np.empty(3 * TILE, np.float32),
            np.empty((TILE, TILE), np.float32),
            np.empty((TILE, (len(others) + 1) // 2, TILE), np.float32),
        )
        planes = np.empty((depths, TILE, TILE), np.uint8)
        _prepared(own, lines, spacing, stride, y0, x0, rows, margin, places, r, mean, power)
        for k in range(depths):
            s = np.float32(first[ty, tx] + k) / half - _ONE
            _plane(s, others, frames, starts, values, places, rows, margin, r, mean, power, room, planes[k])
        store(planes[:, :rows, :columns], volume, start[ty, tx])


@njit(parallel=True, cache=True, fastmath=FAST, error_model="numpy")
def _visible(lines, spacing, stride, every, others, frames, starts, weights, mask):
    """Leave those pixels of a mask (h, w) that some other view sees at one of every few hypotheses."""
    height, width = mask.shape
    channels = len(lines) // len(others)
    for band in prange((height + 15) // 16):
        place = np.empty((lines.shape[2], _WIDE), np.float32)
        work, at, seen = np.empty((2, _WIDE), np.float32), np.empty(_WIDE, np.int32), np.empty(_WIDE, np.float32)
        for y in range(band * 16, min(height, band * 16 + 16)):
            for x0 in range(0, width, TILE):  # lines are long enough for _WIDE from each tile on
                count, found = min(TILE, width - x0), np.zeros(_WIDE, np.float32)
                for v in range(len(others)):
                    view = others[v]
                    flat = weights[starts[view] : starts[view + 1]]
                    row_of_polynomials(lines[v * channels], spacing, y * stride, x0 + MARGIN, place)
                    for k in range(every + 1):
                        s = np.float32(2 * k) / np.float32(every) - _ONE
                        _look(place, s, frames[view], flat, work, at, seen)
                        for x in range(_WIDE):
                            found[x] += seen[x]
                for x in range(count):
                    mask[y, x0 + x] = mask[y, x0 + x] and found[x] > 0


def visible(layout, reference, stride):
    """Pixels of the reference, ``stride`` apart, that some other view sees at some depth, (h, w) bool.

    The layout is that of the pictures twice as fine.
    """
    mask = np.ascontiguousarray(layout.inner(layout.weights, reference.number)[::2, ::2] > 0)
    every = max(4, reference.depths // stride // 4)
    maps = reference.lines[stride], reference.spacing, stride, every, reference.others
    _visible(*maps, layout.frames, layout.starts, layout.weights, mask)
    return mask


def filler(pictures, reference, level, bands, cost="zncc"):
    """A function of rows that computes their costs at a level: see `aggregation.search`.

    Parameters
    ----------
    pictures : sequence of Pictures
        Of all views by level; every other pixel of the level before is the reference.
    reference : Reference
        Its maps into the other views.
    level : int
        1 for every other pixel of the photograph, 2 for every fourth.
    bands : Bands
        Hypotheses of each tile, 2^level of the reference's apart.
    cost : str
        What windows are compared by: "zncc" or "census".
    """
    margin = MARGINS[cost]
    (width, height), finer, stride = bands.size, pictures[level - 1], 2**level
    values = finer.own(reference.number)[:, ::2, ::2]
    alike = _levelled(finer, reference, stride, values)
    own = np.full((len(values), height + 2 * margin + TILE, width + 2 * margin + TILE), np.nan, np.float32)
    own[:, margin : height + margin, margin : width + margin] = values
    maps = reference.lines[stride], reference.spacing, stride, reference.half(stride), reference.others

    def costs(rows):
        tiles = bands.tiles(rows)
        start = bands.start[tiles] - bands.start[tiles][0, 0]
        volume = np.empty(bands.places(rows), np.uint8)
        layout = bands.first[tiles], bands.count[tiles], start, (width, rows.stop), rows.start, volume
        fill(own, *maps, finer.layout.frames, finer.layout.starts, alike, *layout, margin)
        return volume

    return costs


def _levelled(pictures, reference, stride, own):
    """Grey levels (C, N) of all pictures, each with the gain and the offset that suit the reference's own (C, h, w).

    They are those that give what both views see at the middle of the depths the same mean and standard deviation.
    """
    layout, lines = pictures.layout, reference.lines[stride]
    (height, width), channels, axis = own.shape[1:], len(own), lines.shape[2] // 2
    rows = np.arange(0, height, max(reference.spacing // stride, 1))
    values, mine = pictures.values.copy(), own[:, rows]
    middle = lines[:, :: max(stride // reference.spacing, 1), :, MARGIN : MARGIN + width][:, : len(rows)]
    for look in range(len(lines)):
        view, c = reference.others[look // channels], look % channels
        left, top, wide, high, scale = layout.frames[view]
        x = np.clip(np.rint((middle[look, :, 0] - left) * scale), 0, wide - 1).astype(np.int64)
        y = np.clip(np.rint((middle[look, :, axis] - top) * scale), 0, high - 1).astype(np.int64)
        part = values[c, layout.starts[view] : layout.starts[view + 1]]
        there = part[y * int(wide) + x]
        both = np.isfinite(there) & np.isfinite(mine[c])
        if both.sum() > _ENOUGH:
            r, w = mine[c][both], there[both]
            if abs(r.mean() - w.mean()) < _SAME_MEAN and 1 / _SAME < (r.std() + 1) / (w.std() + 1) < _SAME:
                continue
            gain = np.clip(r.std() / max(w.std(), 1e-3), 1 / _MOST_GAIN, _MOST_GAIN)
            part *= gain
            part += r.mean() - gain * w.mean()
    return values
