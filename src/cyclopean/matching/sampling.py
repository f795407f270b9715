"""What another view shows at given places: value and gradient of a cubic B-spline, for a row of pixels at a time.

Unser, Splines: a perfect fit for signal and image processing, IEEE Signal Processing Magazine 16(6), 1999.
"""

import numpy as np
from numba import njit

from .places import BLOCK, FAST, MARGIN, row_of_polynomials

WIDE = BLOCK + 2 * MARGIN
_ZERO, _SIXTH, _HALF, _ONE, _TWO, _THREE = (np.float32(x) for x in (0, 1 / 6, 0.5, 1, 2, 3))
_TWO_THIRDS, _FOUR = np.float32(2 / 3), np.float32(4)


@njit(cache=True, fastmath=FAST, error_model="numpy")
def _last(line, out):
    for x in range(WIDE):
        out[x] = line[x]
        out[WIDE + x] = _ZERO


@njit(cache=True, fastmath=FAST, error_model="numpy")
def _horner(line, s, out):
    """One step of Horner's scheme for a polynomial and its derivative."""
    for x in range(WIDE):
        out[WIDE + x] = out[WIDE + x] * s[x] + out[x]
        out[x] = out[x] * s[x] + line[x]


@njit(cache=True, fastmath=FAST, error_model="numpy")
def _split(place, corner, scale, size, cell, part):
    """Whole and fractional parts of places in a picture of the view, clamped inside its rim."""
    for x in range(WIDE):
        a = min(max((place[x] - corner) * scale, _ONE), size - _THREE)
        k = np.int32(a)
        cell[x] = k
        part[x] = a - np.float32(k)


@njit(cache=True, fastmath=FAST, error_model="numpy")
def _weights(part, w):
    """The B-spline at the four pixels around fractions of a pixel, then its derivative."""
    for x in range(WIDE):
        t, s = part[x], _ONE - part[x]
        w[x] = _SIXTH * s * s * s
        w[WIDE + x] = _TWO_THIRDS - _HALF * t * t * (_TWO - t)
        w[2 * WIDE + x] = _TWO_THIRDS - _HALF * s * s * (_TWO - s)
        w[3 * WIDE + x] = _SIXTH * t * t * t
        w[4 * WIDE + x] = -_HALF * s * s
        w[5 * WIDE + x] = _HALF * t * (_THREE * t - _FOUR)
        w[6 * WIDE + x] = -_HALF * s * (_THREE * s - _FOUR)
        w[7 * WIDE + x] = _HALF * t * t


@njit(cache=True, fastmath=FAST, error_model="numpy")
def _corner(i, j, width, at):
    for x in range(WIDE):
        at[x] = (j[x] - 1) * width + i[x] - 1


@njit(cache=True, fastmath=FAST, error_model="numpy")
def _taps(flat, at, step, tap):
    for x in range(WIDE):
        k = np.uint32(at[x] + step)
        tap[x] = flat[k]
        tap[WIDE + x] = flat[k + np.uint32(1)]
        tap[2 * WIDE + x] = flat[k + np.uint32(2)]
        tap[3 * WIDE + x] = flat[k + np.uint32(3)]


@njit(cache=True, fastmath=FAST, error_model="numpy")
def _combine(tap, across, down, out):
    """Add one row of the four by four pixels to value, x slope and y slope."""
    for x in range(WIDE):
        a, b, c, d = tap[x], tap[WIDE + x], tap[2 * WIDE + x], tap[3 * WIDE + x]
        flat = across[x] * a + across[WIDE + x] * b + across[2 * WIDE + x] * c + across[3 * WIDE + x] * d
        tilt = across[4 * WIDE + x] * a + across[5 * WIDE + x] * b + across[6 * WIDE + x] * c + across[7 * WIDE + x] * d
        out[x] += down[x] * flat
        out[WIDE + x] += down[x] * tilt
        out[2 * WIDE + x] += down[4 * WIDE + x] * flat


@njit(cache=True, fastmath=FAST, error_model="numpy")
def _seen(weights, i, j, a, b, width, known, out):
    for x in range(WIDE):
        at = np.uint32((j[x] + np.int32(b[x] + _HALF)) * width + i[x] + np.int32(a[x] + _HALF))
        out[x] = weights[at] * known[x]


@njit(cache=True, fastmath=FAST, error_model="numpy")
def _difference(value, u, v, own, seen, per, out):
    """Weight, weighted difference from the reference, weighted slope per hypothesis."""
    for x in range(WIDE):
        w = seen[x]
        out[x] = w
        out[WIDE + x] = w * (value[x] - own[x])
        out[2 * WIDE + x] = w * per * (value[WIDE + x] * u[WIDE + x] + value[2 * WIDE + x] * v[WIDE + x])


@njit(cache=True)
def workspace(coefficients):
    """Room for `look`, of one thread."""
    return (
        np.empty((coefficients, WIDE), np.float32),
        np.empty((2, 2 * WIDE), np.float32),
        np.empty((3, WIDE), np.int32),
        np.empty((3, WIDE), np.float32),
        np.empty((2, 8 * WIDE), np.float32),
        np.empty(4 * WIDE, np.float32),
        np.empty(3 * WIDE, np.float32),
    )


@njit(cache=True, fastmath=FAST, error_model="numpy")
def look(lines, spacing, y, left, s, known, half, frame, spline, weights, own, room, out):
    """Compare one row of the reference with what another view shows at each pixel's own hypothesis.

    Parameters
    ----------
    lines : (Ny, 2 K, width) float32 array
        Polynomials of the places.
    spacing, y, left : int
        Rows of the photograph between lines; the row and the first column wanted.
    s, known : (WIDE,) float32 arrays
        Hypotheses scaled to -1..1; 1 where they are known, else 0.
    half : float
        Half of the last hypothesis number.
    frame : (5,) float32 array
        Of the other view's picture, see `Pictures`.
    spline, weights : flat float32 arrays
        B-spline coefficients and weights of that picture.
    own : (WIDE,) float32 array
        The reference.
    room : tuple of arrays
        From `workspace`.
    out : (3 WIDE,) float32 array, written
        Weights, weighted differences, weighted slopes (grey levels per hypothesis).
    """
    polynomials, uv, cells, parts, splines, tap, value = room
    count = lines.shape[1] // 2
    row_of_polynomials(lines, spacing, y, left, polynomials)
    for axis in range(2):
        first = axis * count
        _last(polynomials[first + count - 1], uv[axis])
        for c in range(count - 2, -1, -1):
            _horner(polynomials[first + c], s, uv[axis])
        _split(uv[axis], frame[axis], frame[4], frame[2 + axis], cells[axis], parts[axis])
        _weights(parts[axis], splines[axis])
    width = np.int32(frame[2])
    _corner(cells[0], cells[1], width, cells[2])
    value[:] = 0
    for row in range(4):
        _taps(spline, cells[2], np.int32(row) * width, tap)
        _combine(tap, splines[0], splines[1][row * WIDE :], value)
    _seen(weights, cells[0], cells[1], parts[0], parts[1], width, known, parts[2])
    _difference(value, uv[0], uv[1], own, parts[2], frame[4] / half, out)
