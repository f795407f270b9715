"""Compiled loops of fusion: looking points up in another view's map, and planes through the neighbours of a pixel."""

import math

import numpy as np
from numba import njit

OPTIONS = {"cache": True, "error_model": "numpy"}

# What triangles a cell of four nodes has; a b is its upper row, c d its lower one.
NONE, BOTH, ABC, BDC, ABD, ADC = range(6)


@njit(**OPTIONS)
def look_up(
    places, inverse_depth, sigma, slack, left, top, other_depth, other_sigma, right, down, deviations, out, agree
):
    """What another view's map has of points: out (N, 2), inverse depth and its sigma; agree (N,) bool, if it has them.

    places (N, 2) px are where the other view would see the points of inverse_depth (N,) with sigma (N,); slack (N,)
    is what maps may differ by beside `deviations` sigma. The map other_depth (h, w), other_sigma (h, w) begins at
    pixel (left, top); right and down (h, w) bool say which of its pixels are connected to their right and lower
    neighbours. Between four connected pixels it is bilinear. Elsewhere, at edges, one of the four that agrees
    shows that the point is there, but not how deep exactly: out is NaN.
    """
    rows, columns = other_depth.shape
    for n in range(places.shape[0]):
        out[n, 0], out[n, 1], agree[n] = np.nan, np.nan, False
        x, y = places[n, 0] - left, places[n, 1] - top
        if not (-1 < x < columns and -1 < y < rows):
            continue
        c, r = math.floor(x), math.floor(y)
        x, y = x - c, y - r
        if (
            0 <= c < columns - 1
            and 0 <= r < rows - 1
            and right[r, c]
            and right[r + 1, c]
            and down[r, c]
            and down[r, c + 1]
        ):
            depth = (1 - y) * ((1 - x) * other_depth[r, c] + x * other_depth[r, c + 1])
            depth += y * ((1 - x) * other_depth[r + 1, c] + x * other_depth[r + 1, c + 1])
            spread = (1 - y) * ((1 - x) * other_sigma[r, c] + x * other_sigma[r, c + 1])
            spread += y * ((1 - x) * other_sigma[r + 1, c] + x * other_sigma[r + 1, c + 1])
            if abs(depth - inverse_depth[n]) <= deviations * math.sqrt(sigma[n] ** 2 + spread**2) + slack[n]:
                out[n, 0], out[n, 1], agree[n] = depth, spread, True
            continue
        for row in range(max(r, 0), min(r + 2, rows)):
            for column in range(max(c, 0), min(c + 2, columns)):
                noise = deviations * math.sqrt(sigma[n] ** 2 + other_sigma[row, column] ** 2)
                if abs(other_depth[row, column] - inverse_depth[n]) <= noise + slack[n]:  # false for NaN
                    agree[n] = True


@njit(**OPTIONS)
def extent(connected, start, radius):
    """First and last index that can be reached from `start` along a line whose items connected (n,) to the next."""
    first = last = start
    while first > max(start - radius, 0) and connected[first - 1]:
        first -= 1
    while last < min(start + radius, len(connected) - 1) and connected[last]:
        last += 1
    return first, last


@njit(**OPTIONS)
def planes(rows, columns, inverse_depth, sigma, right, down, radius, out):
    """Planes through the neighbourhoods of pixels: out (N, 3), inverse depth 1/mm at the pixel and its gradient a px.

    A plane in inverse depth is fitted, weighted by one over the variance, to the pixels within `radius` that can be
    reached from the pixel along its row, then along their columns, without crossing an edge. right and down (h, w)
    bool say which pixels are connected to their right and lower neighbours. NaN where they are too few.
    """
    for n in range(len(rows)):
        row, column = rows[n], columns[n]
        centre, spread = inverse_depth[row, column], sigma[row, column]
        count, total, sx, sy, sxx, sxy, syy, sd, sxd, syd = 0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
        left, end = extent(right[row], column, radius)
        for c in range(left, end + 1):
            top, bottom = extent(down[:, c], row, radius)
            x = float(c - column)
            for r in range(top, bottom + 1):
                y, d = float(r - row), float(inverse_depth[r, c] - centre)
                weight = (spread / sigma[r, c]) ** 2
                wx, wy = weight * x, weight * y
                count, total = count + 1, total + weight
                sx, sy, sd = sx + wx, sy + wy, sd + weight * d
                sxx, sxy, syy = sxx + wx * x, sxy + wx * y, syy + wy * y
                sxd, syd = sxd + wx * d, syd + wy * d
        sxx, sxy, syy = sxx - sx * sx / total, sxy - sx * sy / total, syy - sy * sy / total
        sxd, syd = sxd - sx * sd / total, syd - sy * sd / total
        determinant = sxx * syy - sxy * sxy
        known = count >= 4 and determinant > 0.05 * total * total  # pixels that lie on no line; 2 x 2 do not
        out[n, 1] = (syy * sxd - sxy * syd) / determinant if known else np.nan
        out[n, 2] = (sxx * syd - sxy * sxd) / determinant if known else np.nan
        out[n, 0] = centre + (sd - out[n, 1] * sx - out[n, 2] * sy) / total


@njit(**OPTIONS)
def on_triangle(kind, x, y, a, b, c, d):
    """What triangles of a cell have at the place (x, y), 0 to 1 in it, from its corners a to d; NaN beside them."""
    if kind == BOTH:
        return (1 - y) * ((1 - x) * a + x * b) + y * ((1 - x) * c + x * d)
    if kind == ABC and x + y <= 1:
        return a + x * (b - a) + y * (c - a)
    if kind == BDC and x + y >= 1:
        return d + (1 - x) * (c - d) + (1 - y) * (b - d)
    if kind == ABD and y <= x:
        return b + (1 - x) * (a - b) + y * (d - b)
    if kind == ADC and x <= y:
        return c + x * (d - c) + (1 - y) * (a - c)
    return np.nan


@njit(**OPTIONS)
def nearest_corner(kind, x, y):
    """The corner, 0 to 3 for a to d, of a cell's triangles that lies nearest to the place (x, y) in it."""
    missing = -1
    if kind == ABC:
        missing = 3
    elif kind == BDC:
        missing = 0
    elif kind == ABD:
        missing = 2
    elif kind == ADC:
        missing = 1
    nearest, best = 9.0, 0
    for corner in range(4):
        away = (x - corner % 2) ** 2 + (y - corner // 2) ** 2
        if corner != missing and away < nearest:
            nearest, best = away, corner
    return best


@njit(**OPTIONS)
def cover(places, inverse_depth, limit, other_depth, cells, out):
    """The node out (N,) of another view's mesh that lies nearest to points on its triangles; -1 for other points.

    places (N, 2) are columns and rows of its lattice of nodes, at which the points of inverse_depth (N,) would be
    seen. A point is on a triangle if its inverse depth differs by no more than limit (N,). other_depth (h, w) is at
    the nodes, cells (h-1, w-1) say what triangles there are.
    """
    rows, columns = cells.shape
    for n in range(places.shape[0]):
        out[n] = -1
        x, y = places[n, 0], places[n, 1]
        if not (0 <= x <= columns and 0 <= y <= rows) or rows * columns == 0:
            continue
        column, row = min(int(x), columns - 1), min(int(y), rows - 1)
        x, y, kind = x - column, y - row, cells[row, column]
        upper, lower = other_depth[row], other_depth[row + 1]
        value = on_triangle(kind, x, y, upper[column], upper[column + 1], lower[column], lower[column + 1])
        if abs(value - inverse_depth[n]) <= limit[n]:
            corner = nearest_corner(kind, x, y)
            out[n] = (row + corner // 2) * (columns + 1) + column + corner % 2
