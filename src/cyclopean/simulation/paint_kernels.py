"""Compiled look-ups of paints: one loop over places each.

Random textures without end need no memory: space is cut into cells, and the dots of a cell follow from a hash of its
numbers and the seed. A place asks the cells that can reach it.
"""

import math

import numpy as np
from numba import njit, prange

from ..optics.kernels import OPTIONS

STEP = np.uint64(0x9E3779B97F4A7C15)  # 2^64 over the golden ratio: keeps neighbouring numbers far apart
_UNIT = 1.0 / 2**21  # three coordinates of 21 bits come from one hash


@njit(**OPTIONS)
def mixed(number):
    """A well mixed number of 64 bits (Steele, Lea, Flood 2014, SplitMix)."""
    number = (number ^ (number >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    number = (number ^ (number >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return number ^ (number >> np.uint64(31))


@njit(**OPTIONS)
def _of_row(j, k, seed):
    """The random number of a row of cells."""
    return mixed(np.uint64(j) * np.uint64(0xC2B2AE3D27D4EB4F) + np.uint64(k) * np.uint64(0x165667B19E3779F9) + seed)


@njit(**OPTIONS)
def _of_cell(row, i):
    """The random number of a cell of a row."""
    return mixed(row + np.uint64(i) * STEP)


@njit(**OPTIONS)
def _part(number, which):
    """One of three parts of a random number, 0 to 1."""
    return ((number >> np.uint64(21 * which)) & np.uint64(0x1FFFFF)) * _UNIT


@njit(**OPTIONS)
def _dot_cover(x, y, z, solid, seed, radius, spread, soft):
    """How much of a place the dots of all cells around cover, 0 to 1; x, y, z and radius in cells."""
    reach = radius * (1 + spread) + soft / 2
    bottom, top = (math.floor(z - reach), math.floor(z + reach)) if solid else (0, 0)
    left, right = math.floor(x - reach), math.floor(x + reach)
    cover = 0.0
    for k in range(bottom, top + 1):
        for j in range(math.floor(y - reach), math.floor(y + reach) + 1):
            row = _of_row(j, k, seed)
            for i in range(left, right + 1):
                number = _of_cell(row, i)
                across, down = i + _part(number, 0) - x, j + _part(number, 1) - y
                square = across * across + down * down
                if solid:
                    along = k + _part(number, 2) - z
                    square += along * along
                if square < reach * reach:
                    size = radius * (1 + spread * (2 * _part(mixed(number), 0) - 1))
                    cover = max(cover, (size - math.sqrt(square)) / soft + 0.5)
        if cover >= 1:
            break
    return min(cover, 1.0)


@njit(parallel=True, **OPTIONS)
def speckle(places, cell, seed, radius, spread, soft, dark, bright, out):
    """Dots at places (N, 2 or 3): fills out (N,); `cell` in mm, radius and the softness of its rim in cells."""
    solid = places.shape[1] == 3
    for n in prange(len(places)):
        z = places[n, 2] / cell if solid else 0.0
        cover = _dot_cover(places[n, 0] / cell, places[n, 1] / cell, z, solid, seed, radius, spread, soft)
        out[n] = bright + (dark - bright) * cover


@njit(**OPTIONS)
def _bump_sum(x, y, z, solid, seed, reach):
    """Sum of random bumps (1 - r^2)^2, r = distance / reach, of either sign; lengths in cells."""
    bottom, top = (math.floor(z - reach), math.floor(z + reach)) if solid else (0, 0)
    left, right = math.floor(x - reach), math.floor(x + reach)
    total, scale = 0.0, 1 / (reach * reach)
    for k in range(bottom, top + 1):
        for j in range(math.floor(y - reach), math.floor(y + reach) + 1):
            row = _of_row(j, k, seed)
            for i in range(left, right + 1):
                number = _of_cell(row, i)
                across, down = i + _part(number, 0) - x, j + _part(number, 1) - y
                square = across * across + down * down
                if solid:
                    along = k + _part(number, 2) - z
                    square += along * along
                inside = max(1 - square * scale, 0.0)
                sign = 1.0 if number >> np.uint64(63) else -1.0
                total += sign * inside * inside
    return total


@njit(parallel=True, **OPTIONS)
def noise(places, cell, seed, reach, gain, dark, bright, out):
    """Smooth noise at places (N, 2 or 3): fills out (N,), the sum of bumps times `gain` between dark and bright."""
    solid = places.shape[1] == 3
    for n in prange(len(places)):
        z = places[n, 2] / cell if solid else 0.0
        level = 0.5 + gain * _bump_sum(places[n, 0] / cell, places[n, 1] / cell, z, solid, seed, reach)
        out[n] = dark + (bright - dark) * min(max(level, 0.0), 1.0)


@njit(parallel=True, **OPTIONS)
def checker(places, size, dark, bright, out):
    """Squares, or cubes, of a size in mm at places (N, 2 or 3): fills out (N,).

    The sides of cubes lie a hair beside whole steps, where the sides of boxes often are.
    """
    solid = places.shape[1] == 3
    hair = 1e-6 if solid else 0.0
    for n in prange(len(places)):
        steps = math.floor(places[n, 0] / size + hair) + math.floor(places[n, 1] / size + hair)
        if solid:
            steps += math.floor(places[n, 2] / size + hair)
        out[n] = dark if steps % 2 == 0 else bright


@njit(**OPTIONS)
def _neighbours(place, count, repeat):
    """Two pixels beside a place (px) along an axis, and the share of the second."""
    first = math.floor(place)
    share = place - first
    if repeat:
        first = first % count
        second = first + 1
        return first, second if second < count else 0, share
    return min(max(first, 0), count - 1), min(max(first + 1, 0), count - 1), share


@njit(parallel=True, **OPTIONS)
def picture(places, image, corner_x, corner_y, scale_x, scale_y, repeat, out):
    """Bilinear values of an image (H, W, C) at places (N, 2): fills out (N, C); the scale in px for each mm."""
    height, width, channels = image.shape
    for n in prange(len(places)):
        x0, x1, across = _neighbours((places[n, 0] - corner_x) * scale_x - 0.5, width, repeat)
        y0, y1, down = _neighbours((places[n, 1] - corner_y) * scale_y - 0.5, height, repeat)
        for c in range(channels):
            upper = image[y0, x0, c] + across * (image[y0, x1, c] - image[y0, x0, c])
            lower = image[y1, x0, c] + across * (image[y1, x1, c] - image[y1, x0, c])
            out[n, c] = upper + down * (lower - upper)


@njit(**OPTIONS)
def _cell_of(place, breaks, starts, scale):
    """Number of the breaks (B,) at or below a place: 0 before the first one, B behind the last."""
    count = len(breaks)
    if not place >= breaks[0]:
        return 0
    if place >= breaks[count - 1]:
        return count
    number = starts[min(int((place - breaks[0]) * scale), len(starts) - 1)]
    while breaks[number] <= place:
        number += 1
    return number


@njit(parallel=True, **OPTIONS)
def printed_cells(places, x_breaks, x_starts, x_scale, y_breaks, y_starts, y_scale, white, levels, out):
    """A print that is black or white between lines: fills out (N,).

    white : (B_y + 1, B_x + 1) bool, the cells between the breaks, those outside included; starts : for even steps of
    1 / scale mm from the first break, the number of the first break that may lie behind; levels : (2,) black, white
    """
    for n in prange(len(places)):
        column = _cell_of(places[n, 0], x_breaks, x_starts, x_scale)
        row = _cell_of(places[n, 1], y_breaks, y_starts, y_scale)
        out[n] = levels[1] if white[row, column] else levels[0]


@njit(parallel=True, **OPTIONS)
def printed_circles(places, lattice, spacing, square_radius, levels, out):
    """Black circles about those points of a lattice (rows, columns) bool, `spacing` mm apart, that are set."""
    rows, columns = lattice.shape
    for n in prange(len(places)):
        x, y = places[n, 0], places[n, 1]
        white = True
        first_column, first_row = math.floor(x / spacing), math.floor(y / spacing)
        for row in range(max(first_row, 0), min(first_row + 2, rows)):
            for column in range(max(first_column, 0), min(first_column + 2, columns)):
                if lattice[row, column]:
                    across, down = x - column * spacing, y - row * spacing
                    white = white and across * across + down * down >= square_radius
        out[n] = levels[1] if white else levels[0]
