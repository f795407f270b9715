"""Compiled pixel -> ray and point -> pixel, over whole arrays.

Blocks are those of optics/kernels.py, with a few rows more.
"""

import math

import numpy as np
from numba import njit, prange

from ..cameras.kernels import distort_one, is_straight, normalise_one, pixel_one
from ..optics.kernels import (
    CHUNK,
    LANES,
    MARGIN,
    OPTIONS,
    PX,
    PY,
    PZ,
    ROWS,
    TANGENT,
    TANGENTS,
    VX,
    VY,
    VZ,
    finish_block,
    store_block,
    trace_block,
    trace_block_with_tangents,
    trace_one_with_parameters,
)

X, Y, GX, GY, GZ, MOVE = (LANES * row for row in range(ROWS, ROWS + 6))  # coordinates, goals, squared Newton step
ALL_ROWS = ROWS + 6
TX, TY, TZ, TVX, TVY, TVZ = (TANGENTS + LANES * row for row in range(6))  # tangents to x; those to y follow

STEP_SQUARED = 1e-16  # a Newton step below 1e-8 leaves an error of about its square
ITERATIONS = 8  # 3 do for all but hard points
HARD_ITERATIONS = 40


@njit(**OPTIONS)
def start_block(b, index):
    """Rays from the pinhole through the block's normalised coordinates."""
    for i in range(LANES):
        x, y = b[X + i], b[Y + i]
        scale = index / math.sqrt(1 + x * x + y * y)
        b[PX + i] = 0.0
        b[PY + i] = 0.0
        b[PZ + i] = 0.0
        b[VX + i] = x * scale
        b[VY + i] = y * scale
        b[VZ + i] = scale
        b[MARGIN + i] = np.inf


@njit(**OPTIONS)
def start_tangents(b, index):
    """Tangents of `start_block` to x and to y."""
    for i in range(2 * 6 * LANES):
        b[TANGENTS + i] = 0.0
    for i in range(LANES):
        x, y = b[X + i], b[Y + i]
        square = 1 / (1 + x * x + y * y)
        scale = index * math.sqrt(square)
        shrink = scale * square
        b[TVX + i] = scale - shrink * x * x
        b[TVY + i] = -shrink * x * y
        b[TVZ + i] = -shrink * x
        b[TANGENT + TVX + i] = -shrink * x * y
        b[TANGENT + TVY + i] = scale - shrink * y * y
        b[TANGENT + TVZ + i] = -shrink * y


@njit(**OPTIONS)
def load_pixels(b, pixels, start, lens, fold, straight):
    """Fill a block with the normalised coordinates of pixels (N, 2) from row `start` on."""
    count = pixels.shape[0]
    for i in range(min(LANES, count - start)):
        b[X + i] = pixels[start + i, 0]
        b[Y + i] = pixels[start + i, 1]
    for i in range(count - start, LANES):
        b[X + i] = pixels[count - 1, 0]
        b[Y + i] = pixels[count - 1, 1]
    scale_x, scale_y = 1 / lens[0], 1 / lens[1]
    centre_x, centre_y = lens[2], lens[3]
    for i in range(LANES):
        b[X + i] = (b[X + i] - centre_x) * scale_x
        b[Y + i] = (b[Y + i] - centre_y) * scale_y
    if not straight:
        for i in range(LANES):
            b[X + i], b[Y + i] = normalise_one(b[X + i], b[Y + i], lens, fold)


@njit(parallel=True, **OPTIONS)
def trace_pixels(pixels, lens, fold, index, planes, first_bound, bounds, discs, out_origins, out_directions):
    """Rays (N, 3), (N, 3) behind the optic of pixels (N, 2), NaN where one is lost."""
    count = pixels.shape[0]
    straight = is_straight(lens)
    for chunk in prange((count + CHUNK - 1) // CHUNK):
        b = np.empty(ALL_ROWS * LANES)
        for start in range(chunk * CHUNK, min(count, (chunk + 1) * CHUNK), LANES):
            load_pixels(b, pixels, start, lens, fold, straight)
            start_block(b, index)
            trace_block(b, planes, first_bound, bounds, discs)
            finish_block(b)
            store_block(b, start, count, out_origins, out_directions)


@njit(parallel=True, **OPTIONS)
def pixel_clearance(pixels, lens, fold, index, planes, first_bound, bounds, discs, out):
    """Smallest clearance (N,) mm that the rays of pixels (N, 2) have from the path's bounds; NaN for no ray."""
    count = pixels.shape[0]
    straight = is_straight(lens)
    for chunk in prange((count + CHUNK - 1) // CHUNK):
        b = np.empty(ALL_ROWS * LANES)
        for start in range(chunk * CHUNK, min(count, (chunk + 1) * CHUNK), LANES):
            load_pixels(b, pixels, start, lens, fold, straight)
            start_block(b, index)
            trace_block(b, planes, first_bound, bounds, discs)
            for i in range(min(LANES, count - start)):
                exists = abs(b[VX + i] + b[VY + i] + b[VZ + i]) < np.inf
                out[start + i] = b[MARGIN + i] if exists else np.nan


@njit(**OPTIONS)
def newton_block(b, frame, index, planes, first_bound, bounds, discs):
    """One Newton step on a block's normalised coordinates towards the rays that pass through its goals.

    The miss is measured in the plane through each goal with normal frame[2], along frame[0] and frame[1].
    The move row becomes the square of the step made, the margin row the clearance of the ray before it.
    """
    start_block(b, index)
    start_tangents(b, index)
    trace_block_with_tangents(b, planes, first_bound, bounds, discs)
    ax, ay, az = frame[0]
    bx, by, bz = frame[1]
    wx, wy, wz = frame[2]
    for i in range(LANES):
        vx, vy, vz = b[VX + i], b[VY + i], b[VZ + i]
        ahead = 1 / (wx * vx + wy * vy + wz * vz)
        dx, dy, dz = b[GX + i] - b[PX + i], b[GY + i] - b[PY + i], b[GZ + i] - b[PZ + i]
        t = (wx * dx + wy * dy + wz * dz) * ahead
        mx, my, mz = t * vx - dx, t * vy - dy, t * vz - dz
        va, vb = ax * vx + ay * vy + az * vz, bx * vx + by * vy + bz * vz
        ux, uy, uz = b[TX + i] + t * b[TVX + i], b[TY + i] + t * b[TVY + i], b[TZ + i] + t * b[TVZ + i]
        slide = (wx * ux + wy * uy + wz * uz) * ahead
        j00 = ax * ux + ay * uy + az * uz - slide * va
        j10 = bx * ux + by * uy + bz * uz - slide * vb
        ux = b[TANGENT + TX + i] + t * b[TANGENT + TVX + i]
        uy = b[TANGENT + TY + i] + t * b[TANGENT + TVY + i]
        uz = b[TANGENT + TZ + i] + t * b[TANGENT + TVZ + i]
        slide = (wx * ux + wy * uy + wz * uz) * ahead
        j01 = ax * ux + ay * uy + az * uz - slide * va
        j11 = bx * ux + by * uy + bz * uz - slide * vb
        r0, r1 = ax * mx + ay * my + az * mz, bx * mx + by * my + bz * mz
        scale = 1 / (j00 * j11 - j01 * j10)
        sx, sy = (j11 * r0 - j01 * r1) * scale, (j00 * r1 - j10 * r0) * scale
        b[X + i] -= sx
        b[Y + i] -= sy
        b[MOVE + i] = sx * sx + sy * sy
        b[MARGIN + i] = b[MARGIN + i] if b[MARGIN + i] < t else t


@njit(**OPTIONS)
def load_points(b, points, start):
    """Fill a block's goals with points (N, 3) from row `start` on."""
    count = points.shape[0]
    for i in range(min(LANES, count - start)):
        b[GX + i] = points[start + i, 0]
        b[GY + i] = points[start + i, 1]
        b[GZ + i] = points[start + i, 2]
    for i in range(count - start, LANES):
        b[GX + i] = points[count - 1, 0]
        b[GY + i] = points[count - 1, 1]
        b[GZ + i] = points[count - 1, 2]


@njit(**OPTIONS)
def aim_block(b, aim):
    """Coordinates at which the virtual camera `aim` (7, 3) sees the block's goals."""
    cx, cy, cz = aim[0]
    h = aim[4:] @ aim[1:4]
    h00, h01, h02 = h[0]
    h10, h11, h12 = h[1]
    h20, h21, h22 = h[2]
    for i in range(LANES):
        dx, dy, dz = b[GX + i] - cx, b[GY + i] - cy, b[GZ + i] - cz
        scale = 1 / (h20 * dx + h21 * dy + h22 * dz)
        b[X + i] = (h00 * dx + h01 * dy + h02 * dz) * scale
        b[Y + i] = (h10 * dx + h11 * dy + h12 * dz) * scale


@njit(**OPTIONS)
def largest_move(b):
    """Largest squared Newton step of a block, or inf where one is not a number."""
    largest = 0.0
    for i in range(LANES):
        move = b[MOVE + i]
        largest = largest if move <= largest else move  # also taken when move is NaN
        largest = largest if largest >= 0 else np.inf
    return largest


@njit(**OPTIONS)
def search_point(b, point, seeds, frame, index, planes, first_bound, bounds, discs):
    """The coordinates at which one hard point is seen, sought from each of seeds (LANES, 2); NaN if it is not."""
    for i in range(LANES):
        b[X + i], b[Y + i] = seeds[i, 0], seeds[i, 1]
        b[GX + i], b[GY + i], b[GZ + i] = point[0], point[1], point[2]
    for _ in range(HARD_ITERATIONS):
        newton_block(b, frame, index, planes, first_bound, bounds, discs)
        for i in range(LANES):
            if b[MOVE + i] < STEP_SQUARED and b[MARGIN + i] >= 0:
                return b[X + i], b[Y + i]
    return np.nan, np.nan


@njit(parallel=True, **OPTIONS)
def project_points(points, aim, seeds, lens, fold, limits, index, planes, first_bound, bounds, discs, out):
    """Pixels out (N, 2) at which points (N, 3) are seen; NaN where they are not.

    aim (7, 3) is the virtual camera that Newton starts from: its centre, its axes as rows, and a homography
    from its coordinates to the normalised ones. limits (5,) are the smallest and largest x and y of the image,
    and the smallest clearance (mm) from the bounds of the path.
    """
    frame = aim[1:4]
    count = points.shape[0]
    straight = is_straight(lens)
    for chunk in prange((count + CHUNK - 1) // CHUNK):
        b = np.empty(ALL_ROWS * LANES)
        end = min(count, (chunk + 1) * CHUNK)
        for start in range(chunk * CHUNK, end, LANES):
            load_points(b, points, start)
            aim_block(b, aim)
            for _ in range(ITERATIONS):
                newton_block(b, frame, index, planes, first_bound, bounds, discs)
                if largest_move(b) < STEP_SQUARED:
                    break
            for i in range(min(LANES, count - start)):
                solved = b[MOVE + i] < STEP_SQUARED
                seen = b[MARGIN + i] >= limits[4]
                out[start + i, 0] = b[X + i] if solved and seen else (np.nan if solved else np.inf)
                out[start + i, 1] = b[Y + i]
        for i in range(chunk * CHUNK, end):
            if out[i, 0] == np.inf and abs(points[i, 0] + points[i, 1] + points[i, 2]) < np.inf:
                out[i, 0], out[i, 1] = search_point(
                    b, points[i], seeds, frame, index, planes, first_bound, bounds, discs
                )
            x, y = pixel_one(out[i, 0], out[i, 1], lens, fold, straight)
            seen = (limits[0] <= x) & (x <= limits[1]) & (limits[2] <= y) & (y <= limits[3]) & (abs(x) < np.inf)
            out[i, 0] = x if seen else np.nan
            out[i, 1] = y if seen else np.nan


@njit(parallel=True, **OPTIONS)
def ray_tangents(coordinates, index, index_end, planes, plane_tangents, out_rays, out_tangents):
    """Rays (N, 6) of normalised coordinates (N, 2) and their tangents (N, 2 + P, 6) to those and P parameters."""
    count, parameters = coordinates.shape[0], plane_tangents.shape[0]
    padded = np.zeros((2 + parameters, planes.shape[0], 5))
    padded[2:] = plane_tangents
    for chunk in prange((count + CHUNK - 1) // CHUNK):
        p, v = np.empty(3), np.empty(3)
        tp, tv = np.empty((2 + parameters, 3)), np.empty((2 + parameters, 3))
        for i in range(chunk * CHUNK, min(count, (chunk + 1) * CHUNK)):
            x, y = coordinates[i, 0], coordinates[i, 1]
            square = 1 / (1 + x * x + y * y)
            scale = index * math.sqrt(square)
            shrink = scale * square
            p[:] = 0.0
            v[0], v[1], v[2] = x * scale, y * scale, scale
            tp[:] = 0.0
            tv[:] = 0.0
            tv[0, 0], tv[0, 1], tv[0, 2] = scale - shrink * x * x, -shrink * x * y, -shrink * x
            tv[1, 0], tv[1, 1], tv[1, 2] = -shrink * x * y, scale - shrink * y * y, -shrink * y
            trace_one_with_parameters(p, v, tp, tv, planes, padded)
            for c in range(3):
                out_rays[i, c], out_rays[i, 3 + c] = p[c], v[c] / index_end
                for j in range(2 + parameters):
                    out_tangents[i, j, c], out_tangents[i, j, 3 + c] = tp[j, c], tv[j, c] / index_end


@njit(**OPTIONS)
def across_one(d, out):
    """Two unit vectors out (2, 3) square to the unit vector d (3,) and to each other.

    Duff et al. 2017, Building an orthonormal basis, revisited, listing 3.
    """
    sign = math.copysign(1.0, d[2])
    a = -1 / (sign + d[2])
    b = d[0] * d[1] * a
    out[0, 0], out[0, 1], out[0, 2] = 1 + sign * d[0] * d[0] * a, sign * b, -sign * d[0]
    out[1, 0], out[1, 1], out[1, 2] = b, sign + d[1] * d[1] * a, -d[1]


@njit(**OPTIONS)
def lens_one(x, y, lens, out):
    """Derivatives out (2, 9) of a pixel to the lens, at normalised coordinates x, y."""
    fx, fy = lens[0], lens[1]
    xd, yd, _, _, _ = distort_one(x, y, lens)
    r2 = x * x + y * y
    out[:] = 0.0
    out[0, 0], out[1, 1], out[0, 2], out[1, 3] = xd, yd, 1.0, 1.0
    power = r2
    for column in (4, 5, 8):
        out[0, column], out[1, column] = fx * x * power, fy * y * power
        power *= r2
    out[0, 6], out[1, 6] = fx * 2 * x * y, fy * (r2 + 2 * y * y)
    out[0, 7], out[1, 7] = fx * (r2 + 2 * x * x), fy * 2 * x * y


@njit(parallel=True, **OPTIONS)
def pixel_tangents(points, coordinates, lens, rays, tangents, to_point, to_lens, to_optic):
    """How pixels move with point (N, 2, 3), lens (N, 2, 9) and P parameters (N, 2, P).

    points (N, 3) are seen at coordinates (N, 2), by rays (N, 6) with tangents (N, 2 + P, 6). The ray passes
    through the point: its miss, across the ray, is zero. The implicit function theorem turns derivatives of the
    miss into derivatives of the pixel. NaN where there is no pixel.
    """
    count, parameters = points.shape[0], to_optic.shape[2]
    for chunk in prange((count + CHUNK - 1) // CHUNK):
        across, miss, move = np.empty((2, 3)), np.empty((2 + parameters, 2)), np.empty((2, 2))
        for i in range(chunk * CHUNK, min(count, (chunk + 1) * CHUNK)):
            x, y = coordinates[i, 0], coordinates[i, 1]
            if not abs(x + y) < np.inf:
                to_point[i], to_lens[i], to_optic[i] = np.nan, np.nan, np.nan
                continue
            direction = rays[i, 3:]
            across_one(direction, across)
            distance = 0.0
            for c in range(3):
                distance += (points[i, c] - rays[i, c]) * direction[c]
            for j in range(2 + parameters):
                for r in range(2):
                    miss[j, r] = 0.0
                    for c in range(3):
                        miss[j, r] += across[r, c] * (tangents[i, j, c] + distance * tangents[i, j, 3 + c])
            _, _, xx, xy, yy = distort_one(x, y, lens)
            inverse = 1 / (miss[0, 0] * miss[1, 1] - miss[0, 1] * miss[1, 0])
            for r in range(2):  # move = lens Jacobian @ inverse of the miss's Jacobian to the coordinates
                a, b = (lens[0] * xx, lens[0] * xy) if r == 0 else (lens[1] * xy, lens[1] * yy)
                move[r, 0] = (a * miss[1, 1] - b * miss[0, 1]) * inverse
                move[r, 1] = (b * miss[0, 0] - a * miss[1, 0]) * inverse
                for c in range(3):
                    to_point[i, r, c] = move[r, 0] * across[0, c] + move[r, 1] * across[1, c]
                for j in range(parameters):
                    to_optic[i, r, j] = -(move[r, 0] * miss[2 + j, 0] + move[r, 1] * miss[2 + j, 1])
            lens_one(x, y, lens, to_lens[i])
