"""Compiled search for points of several views that belong together.

A pixel of one view and an inverse depth w stand for a point. Around the pixel and a depth, every view's pixel is linear
in the three unknowns (dx, dy, dw), so that views are added one after the other by the Kalman filter's update.

Tables of one first view, made by `hypotheses.trace`: `paths` (N, V, D, 6) holds pixel x and y in view v of pixel n at
depth d, and their derivatives to x and to y of the first pixel: x_x, y_x, x_y, y_y. Points of all views stand in one
list; `starts` (V + 1,) says where each view's begin.
"""

import math
from typing import NamedTuple

import numpy as np
from numba import njit

CELL = 16.0  # px, side of a cell in which points are looked up
WIDEST = 4.0  # times the noise that a pixel may be off: the widest band around a curve, where its own noise is large
UNLIKE = 0.1  # points that look less alike than this share of unrelated ones cannot be the same
LEAST = 1e-3  # shares of unrelated points below this are not told apart
CHARGE = 1 + math.log(UNLIKE / LEAST)  # what the choice of a small share costs, see `chance_of`
OPTIONS = {"cache": True, "error_model": "numpy", "nogil": True}


class AllPoints(NamedTuple):
    """The points of all views in one list of T."""

    starts: np.ndarray  # (V + 1,) int, where each view's begin
    pixels: np.ndarray  # (T, 2)
    free: np.ndarray  # (T,) bool, not matched yet
    density: np.ndarray  # (T,) points per px^2 around each
    begins: np.ndarray  # where the points of each cell of each view begin in `order`
    order: np.ndarray  # (T,) int, rows of the list by view and cell
    grids: np.ndarray  # (V, 3) int: each view's first cell, its columns and rows of cells
    masks: np.ndarray  # (V, H, W) bool
    descriptors: np.ndarray  # (T, D) float32; D = 0: none
    background: np.ndarray  # sorted squared distances of unrelated descriptors; empty: none


class First(NamedTuple):
    """What the pixels of a view stand for; `paths` as above."""

    number: int  # of the view
    paths: np.ndarray  # (N, V, D, 6)
    depth_step: float  # 1/mm, between samples
    depth_range: float  # 1/mm


class Noise(NamedTuple):
    """How far pixels may be off."""

    sigma: float  # px
    limit: float  # of a pixel's squared Mahalanobis distance from its prediction
    detection: float  # share of the points a view should show that were detected
    limits: np.ndarray  # of the chi-square of tuples, by number of views
    confirmed: float  # share of wrong pairs that another view seems to confirm, where points repeat regularly


@njit(**OPTIONS)
def nearest_on_path(path, x, y):
    """Squared distance (px^2) of a pixel from a polyline (D, 6), and where its foot lies, 0 to D - 1."""
    best, place = np.inf, 0.0
    for d in range(len(path) - 1):
        x0, y0 = path[d, 0], path[d, 1]
        dx, dy = path[d + 1, 0] - x0, path[d + 1, 1] - y0
        length = dx * dx + dy * dy
        t = ((x - x0) * dx + (y - y0) * dy) / length if length > 0 else 0.0
        t = min(max(t, 0.0), 1.0)
        ex, ey = x - x0 - t * dx, y - y0 - t * dy
        distance = ex * ex + ey * ey
        if distance < best:  # False for NaN
            best, place = distance, d + t
    return best, place


@njit(**OPTIONS)
def linearised(path, place, depth_step, out):
    """Pixel (x, y) and derivatives (2, 3) to dx, dy, dw at a place of a path, in out (2, 4)."""
    d = min(int(place), len(path) - 2)
    t = place - d
    for row in range(2):
        out[row, 0] = path[d, row] + t * (path[d + 1, row] - path[d, row])
        for column in range(2):
            k = 2 + 2 * column + row
            out[row, 1 + column] = path[d, k] + t * (path[d + 1, k] - path[d, k])
        out[row, 3] = (path[d + 1, row] - path[d, row]) / depth_step


@njit(**OPTIONS)
def innovation(model, state, covariance, variance, x, y, gain):
    """Squared Mahalanobis distance of a pixel from its prediction, and log |S|; gain (3, 2) and S's inverse for later.

    `model` (2, 4) is that of `linearised`, `state` (3,) and `covariance` (3, 3) what the views so far say.
    """
    s00, s01, s11 = variance, 0.0, variance
    for i in range(3):
        p0 = p1 = 0.0
        for j in range(3):
            p0 += covariance[i, j] * model[0, 1 + j]
            p1 += covariance[i, j] * model[1, 1 + j]
        gain[i, 0], gain[i, 1] = p0, p1
        s00 += model[0, 1 + i] * p0
        s01 += model[0, 1 + i] * p1
        s11 += model[1, 1 + i] * p1
    determinant = s00 * s11 - s01 * s01
    rx, ry = x - model[0, 0], y - model[1, 0]
    for i in range(3):
        rx -= model[0, 1 + i] * state[i]
        ry -= model[1, 1 + i] * state[i]
    distance = (s11 * rx * rx - 2 * s01 * rx * ry + s00 * ry * ry) / determinant
    gain[3, 0], gain[3, 1], gain[4, 0], gain[4, 1], gain[5, 0] = s00, s01, s11, determinant, rx
    gain[5, 1] = ry
    return distance, math.log(determinant)


@njit(**OPTIONS)
def update(state, covariance, gain):
    """Take the pixel of the last `innovation` into state and covariance."""
    s00, s01, s11, determinant = gain[3, 0], gain[3, 1], gain[4, 0], gain[4, 1]
    rx, ry = gain[5, 0], gain[5, 1]
    for i in range(3):
        k0 = (gain[i, 0] * s11 - gain[i, 1] * s01) / determinant
        k1 = (gain[i, 1] * s00 - gain[i, 0] * s01) / determinant
        state[i] += k0 * rx + k1 * ry
        for j in range(3):
            covariance[i, j] -= k0 * gain[j, 0] + k1 * gain[j, 1]


@njit(**OPTIONS)
def pair_candidates(all_points, first, view, noise, found):
    """Pairs of points of the first view and of another one within the epipolar band.

    Returns their number; `found` (K, 4) takes the first K: row in the first view, row in the other, place on the
    path, squared distance from it in standard deviations.
    """
    starts, model, count = all_points.starts, np.empty((2, 4)), 0
    limit = noise.limits[2]
    reach = WIDEST * math.sqrt(limit) * noise.sigma
    for i in range(len(first.paths)):
        path = first.paths[i, view]
        if not all_points.free[starts[first.number] + i]:
            continue
        left, top, right, bottom = np.inf, np.inf, -np.inf, -np.inf
        for d in range(len(path)):
            left, right = min(left, path[d, 0]), max(right, path[d, 0])
            top, bottom = min(top, path[d, 1]), max(bottom, path[d, 1])
        for j in range(starts[view + 1] - starts[view]):
            x, y = all_points.pixels[starts[view] + j]
            inside = left - reach <= x <= right + reach and top - reach <= y <= bottom + reach
            if not (inside and all_points.free[starts[view] + j]):
                continue
            squared, place = nearest_on_path(path, x, y)
            if not squared <= reach * reach:
                continue
            linearised(path, place, first.depth_step, model)
            distance = squared / (noise.sigma**2 * noise_gain(model, x, y))
            if distance <= limit:
                if count < len(found):
                    found[count, 0], found[count, 1], found[count, 2], found[count, 3] = i, j, place, distance
                count += 1
    return count


@njit(**OPTIONS)
def noise_gain(model, x, y):
    """Variance of a pixel's distance from the curve, for unit variance of both pixels' coordinates."""
    nx, ny = x - model[0, 0], y - model[1, 0]
    norm = math.hypot(nx, ny)
    if norm < 1e-12:
        nx, ny = -model[1, 3], model[0, 3]
        norm = math.hypot(nx, ny)
    if norm == 0:
        return 2.0
    nx, ny = nx / norm, ny / norm
    a, b = model[0, 1] * nx + model[1, 1] * ny, model[0, 2] * nx + model[1, 2] * ny
    return 1 + a * a + b * b


@njit(**OPTIONS)
def squared_distance(first, second):
    """Squared Euclidean distance of two descriptors."""
    total = np.float32(0.0)
    for i in range(len(first)):
        difference = first[i] - second[i]
        total += difference * difference
    return total


@njit(**OPTIONS)
def unlikeness(all_points, first, second, pairs, out):
    """Squared distances (K,) of the descriptors of pairs (K, 4) of points of two views."""
    for k in range(len(pairs)):
        a, b = all_points.starts[first] + int(pairs[k, 0]), all_points.starts[second] + int(pairs[k, 1])
        out[k] = squared_distance(all_points.descriptors[a], all_points.descriptors[b])


@njit(**OPTIONS)
def rank_share(background, value):
    """Share of the sorted background that does not exceed a value, at least `LEAST`."""
    return max((np.searchsorted(background, value, side="right") + 1.0) / (len(background) + 1.0), LEAST)


@njit(**OPTIONS)
def chance_of(all_points, a, b):
    """How much likelier unrelated points look as much alike as a and b than equal ones do; 1 without descriptors.

    Of unrelated points a share s looks as much alike or more. That of equal ones is small, with a density like 1 / s
    from `LEAST` to `UNLIKE`, and its integral is `CHARGE` (Sellke, Bayarri and Berger 2001 on p-values as likelihoods).
    """
    if not len(all_points.background):
        return 1.0
    return CHARGE * rank_share(
        all_points.background, squared_distance(all_points.descriptors[a], all_points.descriptors[b])
    )


@njit(**OPTIONS)
def find_near(all_points, view, first_point, prediction, noise):
    """The point of a view that agrees best with a prediction, and its chance; -1 where none is within the limit."""
    model, state, covariance, gain = prediction
    variance, limit = noise.sigma**2, noise.limit
    innovation(model, state, covariance, variance, 0.0, 0.0, gain)
    x, y = -gain[5, 0], -gain[5, 1]
    wide, high = math.sqrt(limit * gain[3, 0]), math.sqrt(limit * gain[4, 0])
    offset, columns, rows = all_points.grids[view]
    best, chosen, share = -np.inf, -1, 1.0
    for row in range(max(int((y - high) / CELL), 0), min(int((y + high) / CELL), rows - 1) + 1):
        for column in range(max(int((x - wide) / CELL), 0), min(int((x + wide) / CELL), columns - 1) + 1):
            cell = offset + row * columns + column
            for k in range(all_points.begins[cell], all_points.begins[cell + 1]):
                point = all_points.order[k]
                if not all_points.free[point]:
                    continue
                px, py = all_points.pixels[point]
                distance, _ = innovation(model, state, covariance, variance, px, py, gain)
                if not distance <= limit:
                    continue
                chance = chance_of(all_points, first_point, point)
                score = -0.5 * distance - math.log(chance)
                if score > best and (chance <= CHARGE * UNLIKE or not len(all_points.background)):
                    best, chosen, share = score, point, chance
    return chosen, share


@njit(**OPTIONS)
def pair_evidence(model, density, chance, distance, depth_range, noise):
    """Log of how much likelier a pair is one point of the scene than two that lie so by chance.

    Across the curve the second pixel is normal, along it anywhere in the range of depths.
    """
    tx, ty = model[0, 3], model[1, 3]
    tangent, ratio = math.hypot(tx, ty), 1.0
    if tangent > 0:
        a = (tx * model[1, 1] - ty * model[0, 1]) / tangent
        b = (tx * model[1, 2] - ty * model[0, 2]) / tangent
        ratio += a * a + b * b
    length = max(tangent * depth_range, noise.sigma)
    across = math.sqrt(2 * math.pi * ratio) * noise.sigma
    return math.log(noise.detection / (density * chance * length * across)) - 0.5 * distance


@njit(**OPTIONS)
def ask_view(all_points, view, first_point, prediction, noise):
    """Take a view's point near its prediction into the state: the point, evidence, chi-square; -1 for none.

    The evidence is that of a missing point where the view should show one and does not, 0 where it need not.
    """
    model, state, covariance, gain = prediction
    x, y = model[0, 0], model[1, 0]
    for i in range(3):
        x += model[0, 1 + i] * state[i]
        y += model[1, 1 + i] * state[i]
    height, width = all_points.masks.shape[1:]
    if not (-0.5 <= x < width - 0.5 and -0.5 <= y < height - 0.5):
        return -1, 0.0, 0.0
    point, chance = find_near(all_points, view, first_point, prediction, noise)
    if point < 0:
        missing = all_points.masks[view, int(y + 0.5), int(x + 0.5)]
        return -1, math.log(1 - noise.detection) if missing else 0.0, 0.0
    px, py = all_points.pixels[point]
    distance, logarithm = innovation(model, state, covariance, noise.sigma**2, px, py, gain)
    update(state, covariance, gain)
    # points per unit of the normal density: what is there by chance, or what a regular pattern puts there
    clutter = all_points.density[point] * chance * 2 * math.pi * math.exp(0.5 * logarithm)
    clutter = max(clutter, 2 * noise.confirmed / noise.limit)
    return point, math.log(noise.detection / clutter) - 0.5 * distance, distance


@njit(**OPTIONS)
def extend(all_points, first, second, pairs, noise, out, rows):
    """Grow each pair of points into a tuple: ask every other view that should see the point.

    Parameters
    ----------
    all_points : AllPoints
    first : First
        What the pixels of the pairs' first view stand for.
    second : int
        The other view of the pairs.
    pairs : (K, 4) array
        From `pair_candidates`.
    noise : Noise
    out : (K, 3) array
        Evidence, -inf where the views contradict each other; views that agree, views that should see the point.
    rows : (K, V) array of int
        Row in the list of all points for each view, -1 where there is none.
    """
    starts = all_points.starts
    model, gain, state, covariance = np.empty((2, 4)), np.empty((6, 2)), np.empty(3), np.empty((3, 3))
    prediction = (model, state, covariance, gain)
    for k in range(len(pairs)):
        path, place, chi2 = first.paths[int(pairs[k, 0])], pairs[k, 2], pairs[k, 3]
        a, b = starts[first.number] + int(pairs[k, 0]), starts[second] + int(pairs[k, 1])
        rows[k] = -1
        rows[k, first.number], rows[k, second] = a, b
        state[:], covariance[:] = 0.0, 0.0
        covariance[0, 0] = covariance[1, 1] = noise.sigma**2
        covariance[2, 2] = first.depth_range**2
        linearised(path[second], place, first.depth_step, model)
        innovation(
            model, state, covariance, noise.sigma**2, all_points.pixels[b, 0], all_points.pixels[b, 1], gain
        )  # fmt: skip
        update(state, covariance, gain)
        chance = chance_of(all_points, a, b)
        evidence = pair_evidence(model, all_points.density[b], chance, chi2, first.depth_range, noise)
        agree, expected = 2, 2
        for view in range(len(starts) - 1):
            if view in (first.number, second):
                continue
            linearised(path[view], place, first.depth_step, model)
            rows[k, view], more, distance = ask_view(all_points, view, a, prediction, noise)
            evidence, chi2 = evidence + more, chi2 + distance
            agree += rows[k, view] >= 0
            expected += more != 0.0
        out[k, 0] = evidence if chi2 <= noise.limits[agree] else -np.inf
        out[k, 1], out[k, 2] = agree, expected
