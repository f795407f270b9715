"""Where the pixels of a row are seen in another view."""

import threading

import numpy as np
from numba import njit

BLOCK = 128  # columns worked on together
MARGIN = 8  # px that windows may reach beyond them on either side
_NOWHERE = -1e6  # px, where pixels are seen that have no place: rows between them and others lie outside, too
_FARTHEST = 1e8  # px: a larger coefficient is no place either, sums of such may be infinite or NaN
ALONE = threading.RLock()  # one of numba's threading layers aborts when two threads start kernels at once
FAST = {"contract", "reassoc", "nsz", "arcp"}  # no "nnan": NaN has a meaning here


@njit(cache=True, fastmath=FAST, error_model="numpy")
def _between(upper, lower, t, out):
    for x in range(len(out)):
        out[x] = upper[x] + t * (lower[x] - upper[x])


@njit(cache=True, fastmath=FAST, error_model="numpy")
def row_of_polynomials(lines, spacing, y, left, out):
    """Interpolate between the rows of a lattice.

    Parameters
    ----------
    lines : (Ny, M, width) float32 array
        M numbers at each column, on every ``spacing``-th row.
    spacing, y, left : int
        Rows between lines; the row and the first column wanted.
    out : (M, w) float32 array, written
        The numbers of that row, from that column on.
    """
    j = min(y // spacing, lines.shape[0] - 2)
    t = np.float32(y - j * spacing) / np.float32(spacing)
    right = left + out.shape[1]
    for m in range(lines.shape[1]):
        _between(lines[j, m, left:right], lines[j + 1, m, left:right], t, out[m])


@njit(cache=True, fastmath=FAST, error_model="numpy")
def place(lines, spacing, y, x, s, axis):
    """One coordinate of where pixel (x, y) is seen at s: axis 0 or 1."""
    count = lines.shape[1] // 2
    j = min(y // spacing, lines.shape[0] - 2)
    t = np.float32(y - j * spacing) / np.float32(spacing)
    value = np.float32(0)
    for m in range((axis + 1) * count - 1, axis * count - 1, -1):
        value = value * s + lines[j, m, x] + t * (lines[j + 1, m, x] - lines[j, m, x])
    return value


@njit(cache=True, fastmath=FAST, error_model="numpy")
def _horner(coefficient, s, value):
    for x in range(len(value)):
        value[x] = value[x] * s[x] + coefficient[x]


@njit(cache=True, fastmath=FAST, error_model="numpy")
def follow(polynomials, s, value):
    """Evaluate polynomials (K, w) at s (w,): written to value (w,)."""
    last = len(polynomials) - 1
    value[:] = polynomials[last]
    for k in range(last - 1, -1, -1):
        _horner(polynomials[k], s, value)


def lines_of(warps, stride, channels):
    """The polynomials of all maps at every ``stride``-th column, on the rows of the lattice.

    Parameters
    ----------
    warps : Warps
        Maps into the other views, V-1 of them.
    stride : int
        1 for every pixel of the box, 2 for every other.
    channels : int
        Colour channels to be matched: as many as the maps have, or any number where one map serves all.

    Returns
    -------
    ((V-1) C, Ny, 2 K, width) float32 array
        The coefficients of x, then of y; maps of one view and its channels lie side by side. There are MARGIN
        columns before the box's first, and room for whole blocks of BLOCK columns and a margin behind; those
        beyond the box repeat its last. What has no place (NaN, infinite) lies far outside of all pictures.
    """
    coefficients = warps.coefficients
    count = -(-warps.size[0] // stride)
    width = -(-count // BLOCK) * BLOCK + 2 * MARGIN
    columns = np.clip((np.arange(width) - MARGIN) * stride, 0, warps.size[0] - 1)
    cell = np.minimum(columns // warps.spacing, coefficients.shape[3] - 2)
    t = (columns / warps.spacing - cell).astype(np.float32)
    flat = np.moveaxis(coefficients, 3, -1)  # (V-1, C, Ny, 2, K, Nx)
    with np.errstate(invalid="ignore", over="ignore"):
        lines = flat[..., cell] * (1 - t) + flat[..., cell + 1] * t
    nowhere = ~(np.abs(lines) < _FARTHEST).all((3, 4), keepdims=True)
    lines = np.where(nowhere, np.float32(_NOWHERE) * (np.arange(flat.shape[4]) == 0)[:, None], lines)
    lines = np.repeat(lines, channels // lines.shape[1], axis=1)
    return np.ascontiguousarray(lines.reshape(-1, flat.shape[2], 2 * flat.shape[4], width))
