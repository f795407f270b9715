"""Compiled foot points on sampled curves."""

import math

import numpy as np
from numba import njit, prange

CHUNK = 256
STRIDE = 8  # samples from one to the next where a nearest one is first sought
STEPS = 6  # Newton on a cubic that is nearly straight: 3 do


@njit(cache=True, error_model="numpy")
def slope_at(curve, i, axis):
    """Slope of one coordinate at sample i of curve (D, 2) per step: a parabola through its known neighbours."""
    count = curve.shape[0]
    here = curve[i, axis]
    before = i > 0 and math.isfinite(curve[i - 1, 0])
    behind = i < count - 1 and math.isfinite(curve[i + 1, 0])
    if before and behind:
        return 0.5 * (curve[i + 1, axis] - curve[i - 1, axis])
    if behind:
        if i < count - 2 and math.isfinite(curve[i + 2, 0]):
            return -1.5 * here + 2 * curve[i + 1, axis] - 0.5 * curve[i + 2, axis]
        return curve[i + 1, axis] - here
    if i > 1 and math.isfinite(curve[i - 2, 0]):
        return 1.5 * here - 2 * curve[i - 1, axis] + 0.5 * curve[i - 2, axis]
    return here - curve[i - 1, axis]


@njit(cache=True, error_model="numpy")
def ends_of(curve, band, i, length):
    """How far, in steps, a foot may lie before sample i and behind sample i + 1, which bound a segment.

    Not at all where the curve goes on; up to a band at its ends; and one step more where a border cuts it, for the
    curve goes on up to there.
    """
    count = curve.shape[0]
    low, high = 0.0, 1.0
    if i == 0:
        low = -band[0] / length
    elif not math.isfinite(curve[i - 1, 0]):
        low = -band[i] / length - 1
    if i == count - 2:
        high = 1 + band[i + 1] / length
    elif not math.isfinite(curve[i + 2, 0]):
        high = 2 + band[i + 1] / length
    return low, high


@njit(cache=True, error_model="numpy")
def nearest_sample(curve, x, y):
    """Number of the sample of curve (D, 2), of every STRIDE-th and those beside gaps, that is nearest to (x, y)."""
    best, found, count = np.inf, -1, curve.shape[0]
    for i in range(count):
        whole = i % STRIDE == 0 or i == count - 1
        if whole or not (math.isfinite(curve[i - 1, 0]) and math.isfinite(curve[i + 1, 0])):
            ex, ey = curve[i, 0] - x, curve[i, 1] - y
            square = ex * ex + ey * ey
            if square < best:  # never where it is NaN
                best, found = square, i
    return found


@njit(cache=True, error_model="numpy")
def nearest_segment(curve, band, x, y):
    """Number, place and its bounds of the chord of curve (D, 2) that is nearest to (x, y); number -1 for none.

    Sought around the nearest of a few samples: a curve that is not bent by a quarter turn has one nearest place.
    """
    best, found, place, lowest, highest = np.inf, -1, 0.0, 0.0, 0.0
    near = nearest_sample(curve, x, y)
    for i in range(max(near - STRIDE, 0), min(near + STRIDE, curve.shape[0] - 1)):
        ax, ay = curve[i, 0], curve[i, 1]
        dx, dy = curve[i + 1, 0] - ax, curve[i + 1, 1] - ay
        square = dx * dx + dy * dy
        if not square > 0:  # also where it is NaN
            continue
        low, high = ends_of(curve, band, i, math.sqrt(square))
        t = min(max(((x - ax) * dx + (y - ay) * dy) / square, low), high)
        ex, ey = ax + t * dx - x, ay + t * dy - y
        if ex * ex + ey * ey < best:
            best, found, place, lowest, highest = ex * ex + ey * ey, i, t, low, high
    return found, place, lowest, highest


@njit(cache=True, error_model="numpy")
def strip_of(curve, out):
    """A strip out (4,), a x + b y + c within +-out[3], that curve (D, 2) lies in, and goes on in for some steps."""
    first, last = -1, -1
    for i in range(curve.shape[0]):
        if math.isfinite(curve[i, 0]):
            first = i if first < 0 else first
            last = i
    out[:3] = 0.0
    out[3] = np.inf
    if first == last:
        return
    dx, dy = curve[last, 0] - curve[first, 0], curve[last, 1] - curve[first, 1]
    length = math.sqrt(dx * dx + dy * dy)
    if not length > 0:
        return
    out[0], out[1] = -dy / length, dx / length
    out[2] = -out[0] * curve[first, 0] - out[1] * curve[first, 1]
    widest = 0.0
    for i in range(first, last + 1):
        off = abs(out[0] * curve[i, 0] + out[1] * curve[i, 1] + out[2])
        widest = off if off > widest else widest  # never NaN
    out[3] = 2 * widest + 0.01


@njit(cache=True, error_model="numpy")
def foot_one(curve, band, x, y):
    """Signed distance of (x, y) from curve (D, 2) and the foot's place in samples; NaN beyond the curve's ends."""
    i, t, low, high = nearest_segment(curve, band, x, y)
    if i < 0:
        return np.nan, np.nan
    ax, ay, bx, by = curve[i, 0], curve[i, 1], curve[i + 1, 0], curve[i + 1, 1]
    ux, uy, vx, vy = slope_at(curve, i, 0), slope_at(curve, i, 1), slope_at(curve, i + 1, 0), slope_at(curve, i + 1, 1)
    # the cubic a + u t + c t^2 + e t^3 with these ends and slopes
    cx, cy = 3 * (bx - ax) - 2 * ux - vx, 3 * (by - ay) - 2 * uy - vy
    ex, ey = 2 * (ax - bx) + ux + vx, 2 * (ay - by) + uy + vy
    for _ in range(STEPS):
        mx, my = x - (ax + t * (ux + t * (cx + t * ex))), y - (ay + t * (uy + t * (cy + t * ey)))
        sx, sy = ux + t * (2 * cx + 3 * t * ex), uy + t * (2 * cy + 3 * t * ey)
        move = (mx * sx + my * sy) / (sx * sx + sy * sy)
        t += min(max(move, -0.5), 0.5)
        if abs(move) < 1e-9:
            break
    inner_low, inner_high = (-0.5 if low == 0 else low), (1.5 if high == 1 else high)  # next chord's foot is as good
    if not inner_low <= t <= inner_high:
        return np.nan, np.nan
    mx, my = x - (ax + t * (ux + t * (cx + t * ex))), y - (ay + t * (uy + t * (cy + t * ey)))
    sx, sy = ux + t * (2 * cx + 3 * t * ex), uy + t * (2 * cy + 3 * t * ey)
    return (sx * my - sy * mx) / math.sqrt(sx * sx + sy * sy), i + t


@njit(parallel=True, cache=True, error_model="numpy")
def strips(curves, out):
    """The strips out (C, V, 4) of curves (C, V, D, 2)."""
    for n in prange(curves.shape[0]):
        for v in range(curves.shape[1]):
            strip_of(curves[n, v], out[n, v])


@njit(parallel=True, cache=True, error_model="numpy")
def feet(curves, strip, bands, pixels, within, curve_of, pixel_of, out):
    """Signed distances and places out (N, V, 2) of pixels[pixel_of] from curves[curve_of]; NaN where not `within` px.

    curves (C, V, D, 2) and pixels (Q, V, 2) in px, their strips (C, V, 4), bands (C, V, D) px.
    """
    count, views = out.shape[0], out.shape[1]
    for chunk in prange((count + CHUNK - 1) // CHUNK):
        for n in range(chunk * CHUNK, min(count, (chunk + 1) * CHUNK)):
            for v in range(views):
                x, y = pixels[pixel_of[n], v, 0], pixels[pixel_of[n], v, 1]
                out[n, v, 0], out[n, v, 1] = np.nan, np.nan
                a, b, c, half = strip[curve_of[n], v]
                if abs(a * x + b * y + c) <= half + within:  # never where it is NaN
                    distance, place = foot_one(curves[curve_of[n], v], bands[curve_of[n], v], x, y)
                    if abs(distance) <= within:
                        out[n, v, 0], out[n, v, 1] = distance, place
