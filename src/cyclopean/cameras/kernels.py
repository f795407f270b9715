"""Compiled lens distortion, of normalised image coordinates (x / z, y / z).

lens : (9,) focal x, focal y, centre x, centre y (px), then k1, k2, p1, p2, k3.
"""

import math

import numpy as np
from numba import njit, prange

OPTIONS = {"cache": True, "error_model": "numpy", "fastmath": {"reassoc", "contract", "arcp", "nsz"}}


@njit(**OPTIONS)
def distort_one(x, y, lens):
    """Distorted coordinates of one undistorted point, and the 2x2 Jacobian: xd, yd, xx, xy, yy.

    The Jacobian is symmetric: xx = d xd/dx, xy = d xd/dy = d yd/dx, yy = d yd/dy (Brown 1966; OpenCV's order).
    """
    k1, k2, p1, p2, k3 = lens[4], lens[5], lens[6], lens[7], lens[8]
    r2 = x * x + y * y
    radial = 1 + r2 * (k1 + r2 * (k2 + r2 * k3))
    slope = 2 * (k1 + r2 * (2 * k2 + r2 * 3 * k3))  # d radial / d r2, twice
    xd = x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x * x)
    yd = y * radial + p1 * (r2 + 2 * y * y) + 2 * p2 * x * y
    xx = radial + x * x * slope + 2 * p1 * y + 6 * p2 * x
    xy = x * y * slope + 2 * p1 * x + 2 * p2 * y
    yy = radial + y * y * slope + 6 * p1 * y + 2 * p2 * x
    return xd, yd, xx, xy, yy


@njit(**OPTIONS)
def is_straight(lens):
    """True when the lens does not distort."""
    return lens[4] == 0 and lens[5] == 0 and lens[6] == 0 and lens[7] == 0 and lens[8] == 0


@njit(**OPTIONS)
def normalise_one(x, y, lens, fold):
    """Undistorted normalised coordinates of distorted ones; NaN beyond the lens's fold.

    Newton on the distortion with its analytic Jacobian; `fold` is the largest radius the model is one-to-one
    at (`Camera.fold_radius`).
    """
    a, b, step = x, y, np.inf
    for _ in range(50):
        xd, yd, xx, xy, yy = distort_one(a, b, lens)
        determinant = xx * yy - xy * xy
        ex, ey = xd - x, yd - y
        da, db = (yy * ex - xy * ey) / determinant, (xx * ey - xy * ex) / determinant
        step = math.sqrt(da * da + db * db)
        damping = min(1.0, 0.2 * fold / step) if step > 0 else 1.0  # do not jump over the fold
        a -= damping * da
        b -= damping * db
        if not step > 1e-15:
            break
    if step < 1e-12 and a * a + b * b < fold * fold:
        return a, b
    return np.nan, np.nan


@njit(**OPTIONS)
def pixel_one(x, y, lens, fold, straight):
    """Pixel of undistorted normalised coordinates; NaN beyond the lens's fold."""
    if not straight:
        inside = x * x + y * y < fold * fold
        x, y, xx, xy, yy = distort_one(x, y, lens)
        inside &= (xx > 0) & (xx * yy > xy * xy)  # tangential terms can fold the picture earlier
        if not inside:
            x, y = np.nan, np.nan
    return lens[0] * x + lens[2], lens[1] * y + lens[3]


@njit(parallel=True, **OPTIONS)
def convert(pairs, lens, fold, to_pixels, out):
    """Normalised coordinates to pixels, or pixels to normalised coordinates, on rows (N, 2) -> out (N, 2)."""
    straight = is_straight(lens)
    for i in prange(pairs.shape[0]):
        x, y = pairs[i, 0], pairs[i, 1]
        if to_pixels:
            x, y = pixel_one(x, y, lens, fold, straight)
        else:
            x, y = (x - lens[2]) / lens[0], (y - lens[3]) / lens[1]
            if not straight:
                x, y = normalise_one(x, y, lens, fold)
        out[i, 0], out[i, 1] = x, y
