"""Compiled lens distortion, on blocks of normalised image coordinates (x / z, y / z).

lens : (9,) focal x, focal y, centre x, centre y (px), then k1, k2, p1, p2, k3.
"""

import math

import numpy as np
from numba import njit, prange

LANES = 128
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
def normalise_block(x, y, lens, fold):
    """Turn pixels x, y (L,) into undistorted normalised coordinates, in place; NaN beyond the lens's fold.

    Newton on the distortion with its analytic Jacobian; `fold` is the largest radius the model is one-to-one
    at (`Camera.fold_radius`).
    """
    for i in range(x.size):
        x[i] = (x[i] - lens[2]) / lens[0]
        y[i] = (y[i] - lens[3]) / lens[1]
    if is_straight(lens):
        return
    for i in range(x.size):
        goal_x, goal_y = x[i], y[i]
        a, b = goal_x, goal_y
        step = np.inf
        for _ in range(50):
            xd, yd, xx, xy, yy = distort_one(a, b, lens)
            determinant = xx * yy - xy * xy
            ex, ey = xd - goal_x, yd - goal_y
            da, db = (yy * ex - xy * ey) / determinant, (xx * ey - xy * ex) / determinant
            size = math.sqrt(da * da + db * db)
            damping = min(1.0, 0.2 * fold / size) if size > 0 else 1.0  # do not jump over the fold
            a -= damping * da
            b -= damping * db
            if not size > 1e-15:
                step = size
                break
            step = size
        good = step < 1e-12 and a * a + b * b < fold * fold
        x[i] = a if good else np.nan
        y[i] = b if good else np.nan


@njit(**OPTIONS)
def pixel_block(x, y, lens, fold):
    """Turn undistorted normalised coordinates (L,) into pixels, in place; NaN beyond the lens's fold."""
    straight = is_straight(lens)
    for i in range(x.size):
        a, b = x[i], y[i]
        if not straight:
            xd, yd, _, _, _ = distort_one(a, b, lens)
            inside = a * a + b * b < fold * fold
            a = xd if inside else np.nan
            b = yd if inside else np.nan
        x[i] = lens[0] * a + lens[2]
        y[i] = lens[1] * b + lens[3]


@njit(parallel=True, **OPTIONS)
def convert(pairs, lens, fold, to_pixels, out):
    """`pixel_block` or `normalise_block` on rows (N, 2) -> out (N, 2)."""
    count = pairs.shape[0]
    for block in prange((count + LANES - 1) // LANES):
        start = block * LANES
        lanes = min(LANES, count - start)
        x, y = np.empty(lanes), np.empty(lanes)
        for i in range(lanes):
            x[i], y[i] = pairs[start + i, 0], pairs[start + i, 1]
        if to_pixels:
            pixel_block(x, y, lens, fold)
        else:
            normalise_block(x, y, lens, fold)
        for i in range(lanes):
            out[start + i, 0], out[start + i, 1] = x[i], y[i]
