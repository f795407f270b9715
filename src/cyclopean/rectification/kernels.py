"""Compiled loops of rectification."""

import math

from numba import njit, prange


@njit(cache=True, inline="always")
def _fold(i, count):
    """The pixel that stands for one beyond the border, mirrored at the border's pixel; the border's own far away."""
    if i < 0:
        i = -i
    if i >= count:
        i = 2 * count - 2 - i
    return min(max(i, 0), count - 1)


@njit(cache=True, parallel=True, nogil=True)
def resample(spline, mask, nodes, left, top, spacing, largest, out):
    """Move a picture by shifts between lattice nodes, with cubic B-splines.

    Parameters
    ----------
    spline : (H, W) float32 array
        B-spline coefficients, mirrored at the borders.
    mask : (H, W) bool array
        Pixels to fill; they lie inside the lattice.
    nodes : (Ny, Nx, 2) array
        Shifts (x, y) px of pixels left + i spacing, top + j spacing; bilinear between them, NaN leaves a pixel out.
    left, top, spacing : int
        px.
    largest : float
        Of whole numbers, which are rounded and kept between 0 and it; negative for real numbers.
    out : (H, W) array
    """
    height, width = mask.shape
    for j in prange(height):
        row, v = (j - top) // spacing, (j - top) % spacing / spacing
        for i in range(width):
            if not mask[j, i]:
                continue
            column, u = (i - left) // spacing, (i - left) % spacing / spacing
            w00, w01, w10, w11 = (1 - v) * (1 - u), (1 - v) * u, v * (1 - u), v * u
            corners = nodes[row : row + 2, column : column + 2]
            x = i + w00 * corners[0, 0, 0] + w01 * corners[0, 1, 0] + w10 * corners[1, 0, 0] + w11 * corners[1, 1, 0]
            y = j + w00 * corners[0, 0, 1] + w01 * corners[0, 1, 1] + w10 * corners[1, 0, 1] + w11 * corners[1, 1, 1]
            if not (abs(x) < 1e9 and abs(y) < 1e9):
                continue
            p, q = math.floor(x), math.floor(y)
            t, s = x - p, y - q
            left_most, right_most = (1 - t) ** 3 / 6, t**3 / 6
            a, b = 2 / 3 - t * t * (1 - t / 2), 2 / 3 - (1 - t) ** 2 * (1 + t) / 2
            c0, c1, c2, c3 = _fold(p - 1, width), _fold(p, width), _fold(p + 1, width), _fold(p + 2, width)
            value = 0.0
            for k in range(4):
                if k == 0:
                    weight = (1 - s) ** 3 / 6
                elif k == 1:
                    weight = 2 / 3 - s * s * (1 - s / 2)
                elif k == 2:
                    weight = 2 / 3 - (1 - s) ** 2 * (1 + s) / 2
                else:
                    weight = s**3 / 6
                r = _fold(q - 1 + k, height)
                value += weight * (
                    left_most * spline[r, c0] + a * spline[r, c1] + b * spline[r, c2] + right_most * spline[r, c3]
                )
            if largest >= 0:
                value = min(max(round(value), 0.0), largest)
            out[j, i] = value
