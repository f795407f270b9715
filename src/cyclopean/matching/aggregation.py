"""Semi-global aggregation: agreement with the neighbours along eight (or four) straight paths.

Hirschmueller, Stereo processing by semiglobal matching and mutual information, PAMI 30(2), 2008. Two sweeps over the
picture, each along half of the paths at once: down from the top left, then up from the bottom right. Sheared blocks
of pixels that lie on one diagonal do not depend on one another and run in parallel.
"""

from typing import NamedTuple

import numpy as np
from numba import get_num_threads, njit, prange

from ..errors import ShapeError
from .vectors import FAR, LANES, NOTHING, advance, smallest

LARGEST = 7000  # penalty: eight sums of costs and penalties must fit into 16 bits
_ROWS, _COLUMNS = 16, 128  # of a block, with more than two threads
_DOWN, _UP = 1, -1  # ways of the sweeps
_ZERO = 2 * LANES  # where the state lies that begins a path


class _Strip(NamedTuple):
    """All that a sweep reads and writes; rows and columns count in the box, places in the strip."""

    volume: np.ndarray  # flat uint8, costs
    totals: np.ndarray  # (1 or 2, places) uint16, their sums over all paths, or over those of each sweep
    firsts: np.ndarray  # (Ty, Tx) int32, bands of the whole box
    counts: np.ndarray  # (Ty, Tx) int32
    starts: np.ndarray  # (Ty, Tx) int64, place of each tile
    tile: int  # px
    alive: np.ndarray  # (h + 2, w + 2) bool, mask with a rim
    small: int
    large: np.ndarray  # (h, w) uint16
    states: np.ndarray  # (2, places) uint16, records of the paths of each sweep
    record: int  # places of a record
    steps: np.ndarray  # (h, w) float32, results
    margin: np.ndarray  # (h, w) float32
    ridge: np.ndarray  # (h, w) float32
    paths: int  # 4 or 8
    top: int  # first row
    height: int  # rows


def search(fill, bands, mask, small, large, *, rows_per_strip=None, paths=8, ridge=None):
    """The hypothesis of each pixel that agrees best with its costs and with its neighbours.

    The result is the same to the last bit for any number of threads and any height of the strips. With more than one
    strip all costs but those of the last are asked for twice. Not to be started in two threads at once.

    Parameters
    ----------
    fill : callable
        ``fill(rows)`` returns the flat uint8 array of the costs of some rows, a slice, laid out as ``Bands`` says.
    bands : Bands
        Hypotheses of each tile.
    mask : (h, w) bool array
        Pixels that take part; paths begin anew behind the others.
    small : int
        Penalty for a change by one hypothesis between neighbours.
    large : (h, w) uint16 array
        Penalty for a larger change on entering each pixel, up to 7000. Hypotheses that the pixel before does not have
        are entered from its best one, for this penalty.
    rows_per_strip : int, optional
        Rows in memory at once, a multiple of the tile; all by default. See ``strip_bytes``.
    paths : int
        8, or 4: along rows and columns only.
    ridge : (h, w) float32 array, optional, written
        How much worse than the best the worst hypothesis between the best and the second best is, in the units of
        the margin. A second valley as deep as the first has a margin of 0 behind a ridge; within one broad valley
        the ridge is no higher than the margin. 0 without a second.

    Returns
    -------
    steps : (h, w) float32 array
        Number of the best hypothesis, fractions by a parabola through its neighbours (none at the ends of a band);
        NaN outside of the mask.
    margin : (h, w) float32 array
        How much worse the second best is, direct neighbours of the best left out: difference of the sums for each
        path, in units of the largest cost of a pixel. 0 is undecided; infinite without a second; NaN outside of the
        mask.
    """
    large = np.ascontiguousarray(large)
    _check(bands, mask, small, large, paths)
    (width, height), rows = bands.size, rows_per_strip or bands.size[1]
    if rows < 1 or (rows < height and rows % bands.tile):
        raise ShapeError(f"a strip must have a multiple of {bands.tile} rows, the height of a tile, got {rows}")
    strips = [slice(top, min(top + rows, height)) for top in range(0, height, rows)]
    totals = np.empty((1 + (get_num_threads() > 1), max(bands.places(strip) for strip in strips)), np.uint16)
    states, alive = _states(bands, min(rows, height)), np.pad(np.asarray(mask, bool), 1)
    steps, margin = np.full((2, height, width), np.nan, np.float32)
    ridge = np.empty((height, width), np.float32) if ridge is None else ridge

    def work(rows):
        volume, start = _costs(fill, bands, rows), bands.start - bands.start[rows.start // bands.tile, 0]
        layout = (bands.first, bands.count, start, bands.tile, alive, int(small), large, states)
        rest = _record(bands), steps, margin, ridge, paths
        return _Strip(volume, totals, *layout, *rest, rows.start, rows.stop - rows.start)

    above = []
    for rows in strips[:-1]:
        _sweep(work(rows), _DOWN)
        above.append(_border(states[0], bands, rows.stop - 1).copy())
    for rows in reversed(strips):
        strip = work(rows)
        if above:
            _border(states[0], bands, rows.start - 1)[:] = above.pop()
        _sweep(strip, _DOWN, _UP)  # the states that lead up still are those of the strip below
        _choose(strip)
    return steps, margin


def strip_bytes(bands, rows):
    """Memory that a search needs with strips of some rows, bytes: costs, sums, states of paths and results.

    It needs less where only one thread runs, because both sweeps then add to the same sums.
    """
    width, height = bands.size
    strips = [slice(top, min(top + rows, height)) for top in range(0, height, rows)]
    place = 1 + 2 * (1 + (get_num_threads() > 1))
    states = 2 * 2 * _states_length(bands, min(rows, height)) + 2 * 3 * width * _record(bands) * (len(strips) - 1)
    return place * max(bands.places(strip) for strip in strips) + states + 9 * width * height


def _check(bands, mask, small, large, paths):
    shape = bands.size[::-1]
    if mask.shape != shape or large.shape != shape or large.dtype != np.uint16:
        raise ShapeError(
            f"mask and large must have shape {shape} as the bands, large as uint16; "
            f"got {mask.shape}, {large.shape} and {large.dtype}"
        )
    if not 0 <= small <= LARGEST or large.max() > LARGEST:
        raise ShapeError(f"penalties must lie between 0 and {LARGEST}, got {small} and {large.max()}")
    if paths not in (4, 8):
        raise ShapeError(f"there are 4 or 8 paths, got {paths}")


def _costs(fill, bands, rows):
    """Ask for the costs of some rows."""
    volume = fill(rows)
    if volume.dtype != np.uint8 or volume.shape != (bands.places(rows),):
        raise ShapeError(
            f"costs of rows {rows.start} to {rows.stop} must be {bands.places(rows)} of uint8 in a flat array, "
            f"got {volume.dtype} of shape {volume.shape}"
        )
    return volume


# States of paths lie in records of one flat array: a margin of LANES places, then one value for each hypothesis. The
# record that begins a path comes first and is zero. Then come two rows of pixels with three records each, for the
# paths that enter from above, above before and above behind; two records for each row, for the path along it; and
# last, four for each row of blocks, for states that are moved to another band.


def _record(bands):
    return int(bands.stride.max()) + 3 * LANES


def _states_length(bands, rows):
    return (1 + 6 * bands.size[0] + 2 * rows + 4 * -(-rows // _ROWS)) * _record(bands)


def _states(bands, rows):
    """Room for the states of a strip."""
    states = np.zeros((2, _states_length(bands, rows)), np.uint16)
    states[:, _record(bands) + _ZERO - 1 :: _record(bands)] = FAR  # before the first hypothesis
    return states


def _border(states, bands, row):
    """The states of all paths that leave a row up or down."""
    length = 3 * bands.size[0] * _record(bands)
    begin = _record(bands) + (row % 2) * length
    return states[begin : begin + length]


def _sweep(strip, *ways):
    """Walk along the paths that lead down, up, or both."""
    whole = strip.height, strip.height + strip.large.shape[1]
    if len(strip.totals) == 1:  # one thread: upwards adds to what downwards found
        for way in ways:
            _walk_blocks(strip, np.array([way]), *whole)
    elif len(ways) == get_num_threads():
        _walk_blocks(strip, np.array(ways), *whole)
    else:
        _walk_blocks(strip, np.array(ways), _ROWS, _COLUMNS)


@njit(parallel=True, cache=True)
def _walk_blocks(strip, ways, rows, columns):
    """Sweep in blocks of some rows and columns, sheared by one column a row: no path runs against their order."""
    width, height = strip.large.shape[1], strip.height
    down, across = -(-height // rows), -(-(width + height) // columns)
    for front in range(down + across - 1):
        low = max(0, front - across + 1, (front * columns - width - rows) // (rows + columns) + 1)
        jobs = min(down, ((front + 1) * columns - 1) // (rows + columns) + 1) - low
        for job in prange(ways.size * jobs):
            block = low + job % jobs
            left = (front - block) * columns
            for i in range(block * rows, min((block + 1) * rows, height)):
                _walk(strip, ways[job // jobs], i, block, max(0, left - i), min(width, left + columns - i))


@njit(cache=True)
def _walk(strip, way, i, block, begin, end):
    """Walk along a piece of row ``i`` of a strip, from column begin to end, both counted the way of the sweep."""
    width, tile, record = strip.large.shape[1], strip.tile, strip.record
    y = strip.top + (i if way > 0 else strip.height - 1 - i)
    ty, column = y // tile, begin
    along = _ZERO + (1 + 6 * width + 2 * i) * record
    row, above = _ZERO + (1 + 3 * width * (y % 2)) * record, _ZERO + (1 + 3 * width * (1 - y % 2)) * record
    states, totals = strip.states[(1 - way) // 2], strip.totals[(1 - way) // 2 % len(strip.totals)]
    add = way < 0 and len(strip.totals) == 1
    places = (along, row, above, _ZERO + states.size - 4 * (block + 1) * record, record)
    while column < end:
        tx = (column if way > 0 else width - 1 - column) // tile
        left, right = tx * tile, min(tx * tile + tile, width)
        stop = min(end, right if way > 0 else width - left)
        count = strip.counts[ty, tx]
        stride = (count + LANES - 1) // LANES * LANES
        line = strip.starts[ty, tx] + ((y - ty * tile) * (right - left) - left) * stride
        low, high = (column, stop) if way > 0 else (width - stop, width - column)
        bands = (strip.firsts, strip.counts, tile, tx, ty, (y - way) // tile)
        piece = (low, high, line, stride, strip.large[y], strip.alive[y + 1], strip.alive[y + 1 - way])
        _run(strip.volume, totals, states, bands, piece, places, (way, strip.small, strip.paths, add))
        column = stop


@njit(cache=True)
def _run(volume, totals, states, bands, piece, places, rules):
    """Walk along the pixels low to high - 1 of one tile and row, in either order."""
    first, counts, tile, tx, ty, ty_before = bands
    low, high, line, stride, large, alive, alive_before = piece
    along, row, above, spare, record = places
    way, small, paths, add = rules
    count, width = np.int64(counts[ty, tx]), large.size
    small = np.uint16(small)
    left, right = tx * tile, min(tx * tile + tile, width) - 1
    for j in range(high - low):
        x = low + j if way > 0 else high - 1 - j
        if not alive[x + 1]:
            continue
        odd = (x if way > 0 else width - 1 - x) % 2
        here, over, at = row + 3 * x * record, above + 3 * x * record, line + x * stride
        a = along + (1 - odd) * record if alive[x + 1 - way] else _ZERO
        b = over if alive_before[x + 1] else _ZERO
        c = over + (1 - 3 * way) * record if alive_before[x + 1 - way] else _ZERO
        d = over + (2 + 3 * way) * record if alive_before[x + 1 + way] else _ZERO
        if ty_before != ty or x in (left, right):
            before, behind = (x - way) // tile, (x + way) // tile
            a = _moved(states, a, first, counts, (ty, before), (ty, tx), spare)
            b = _moved(states, b, first, counts, (ty_before, tx), (ty, tx), spare + record)
            c = _moved(states, c, first, counts, (ty_before, before), (ty, tx), spare + 2 * record)
            d = _moved(states, d, first, counts, (ty_before, behind), (ty, tx), spare + 3 * record)
        e = along + odd * record
        if paths == 8:
            after = (e, here, here + record, here + 2 * record)
            advance(volume, at, count, states, (a, b, c, d), after, small, large[x], totals, add)
        else:
            advance(volume, at, count, states, (a, b), (e, here), small, large[x], totals, add)


@njit(cache=True)
def _moved(states, state, first, count, tile, to, spare):
    """Place of a state for the band of another tile: what is not in the band of its own is far."""
    if state == _ZERO:
        return state
    shift, own, wanted = first[to] - first[tile], count[tile], count[to]
    if shift == 0 and own == wanted:
        return state
    low = min(max(-shift, -1), wanted + 1)
    high = max(min(own - shift, wanted + 1), low)
    states[spare - 1 : spare + low] = FAR
    _copy(states[state + shift + low : state + shift + high], states[spare + low : spare + high])
    states[spare + high : spare + wanted + 1] = FAR
    _copy(states[state - 2 * LANES : state - LANES], states[spare - 2 * LANES : spare - LANES])
    return spare


@njit(cache=True)
def _copy(source, target):
    for k in range(target.size):
        target[k] = source[k]


@njit(parallel=True, cache=True)
def _choose(strip):
    """Add up the sums of both sweeps and find the winners of all pixels."""
    width, tile, counts = strip.large.shape[1], strip.tile, strip.counts
    for i in prange(strip.height):
        y = strip.top + i
        ty = y // tile
        for tx in range(counts.shape[1]):
            left, right, count = tx * tile, min(tx * tile + tile, width), counts[ty, tx]
            stride = (count + LANES - 1) // LANES * LANES
            begin = strip.starts[ty, tx] + (y - ty * tile) * (right - left) * stride
            totals = strip.totals[0, begin : begin + (right - left) * stride]
            if len(strip.totals) == 2:
                _add(totals, strip.totals[1, begin : begin + (right - left) * stride])
            results = strip.steps[y, left:right], strip.margin[y, left:right], strip.ridge[y, left:right]
            alive = strip.alive[y + 1, left + 1 : right + 1]
            _decide(totals, alive, stride, strip.firsts[ty, tx], count, strip.paths, *results)


@njit(cache=True)
def _add(totals, others):
    for k in range(totals.size):
        totals[k] += others[k]


@njit(cache=True)
def _highest(totals, place, a, b):
    """The largest of the sums from hypothesis a to b, in either order."""
    highest = np.int64(0)
    for k in range(min(a, b), max(a, b) + 1):
        highest = max(highest, np.int64(totals[place + k]))
    return highest


@njit(cache=True)
def _decide(totals, alive, stride, first, count, paths, steps, margin, ridge):
    """The best hypotheses of some pixels, how far off the second best are, and what lies between."""
    scale = np.float32(1) / np.float32(255 * paths)
    for x in range(alive.size):
        if alive[x]:
            place = x * stride
            best = smallest(totals, place, count, -LANES)
            least, k = best >> 16, best & 65535
            following = smallest(totals, place, count, k)
            second = following >> 16
            fraction = np.float32(0)
            if 0 < k < count - 1:
                left, right = np.int64(totals[place + k - 1]) - least, np.int64(totals[place + k + 1]) - least
                fraction = np.float32(0.5) * np.float32(left - right) / np.float32(max(left + right, 1))
            steps[x] = np.float32(first + k) + fraction
            margin[x], ridge[x] = np.float32(np.inf), np.float32(0)
            if second < NOTHING:
                margin[x] = np.float32(second - least) * scale
                ridge[x] = np.float32(_highest(totals, place, k, following & 65535) - least) * scale
