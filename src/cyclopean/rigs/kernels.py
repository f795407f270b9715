"""Compiled pixel -> ray and point -> pixel, over whole arrays."""

import math

import numpy as np
from numba import njit, prange

from ..cameras.kernels import normalise_block, pixel_block
from ..optics.kernels import OPTIONS, store_rays, trace_block, trace_block_with_tangents, trace_one_with_parameters

LANES = 64  # points in a block: with two tangents a lane takes 26 numbers
CHUNK = 32 * LANES
STEP_SQUARED = 1e-16  # a Newton step below 1e-8 leaves an error of about its square
ITERATIONS = 8


@njit(**OPTIONS)
def start_block(x, y, p, v, index):
    """Rays from the pinhole through normalised coordinates (L,): positions p and optical directions v (3, L)."""
    for i in range(x.size):
        scale = index / math.sqrt(1 + x[i] * x[i] + y[i] * y[i])
        p[0, i] = 0.0
        p[1, i] = 0.0
        p[2, i] = 0.0
        v[0, i] = x[i] * scale
        v[1, i] = y[i] * scale
        v[2, i] = scale


@njit(**OPTIONS)
def start_tangents(x, y, tp, tv, index):
    """Tangents tp, tv (2, 3, L) of `start_block` to x and to y."""
    tp[:2] = 0.0
    for i in range(x.size):
        square = 1 / (1 + x[i] * x[i] + y[i] * y[i])
        scale = index * math.sqrt(square)
        shrink = scale * square
        tv[0, 0, i] = scale - shrink * x[i] * x[i]
        tv[0, 1, i] = -shrink * x[i] * y[i]
        tv[0, 2, i] = -shrink * x[i]
        tv[1, 0, i] = -shrink * x[i] * y[i]
        tv[1, 1, i] = scale - shrink * y[i] * y[i]
        tv[1, 2, i] = -shrink * y[i]


@njit(parallel=True, **OPTIONS)
def trace_pixels(pixels, lens, fold, index, planes, first_bound, bounds, discs, out_origins, out_directions):
    """Rays (N, 3), (N, 3) behind the optic of pixels (N, 2), NaN where one is lost."""
    count = pixels.shape[0]
    for chunk in prange((count + CHUNK - 1) // CHUNK):
        rows, margins = np.empty((8, LANES)), np.empty(LANES)
        for start in range(chunk * CHUNK, min(count, (chunk + 1) * CHUNK), LANES):
            lanes = min(LANES, count - start)
            x, y, p, v, margin = rows[0, :lanes], rows[1, :lanes], rows[2:5, :lanes], rows[5:, :lanes], margins[:lanes]
            for i in range(lanes):
                x[i], y[i], margin[i] = pixels[start + i, 0], pixels[start + i, 1], np.inf
            normalise_block(x, y, lens, fold)
            start_block(x, y, p, v, index)
            trace_block(p, v, margin, planes, first_bound, bounds, discs)
            store_rays(p, v, margin, start, out_origins, out_directions)


@njit(parallel=True, **OPTIONS)
def pixel_clearance(pixels, lens, fold, index, planes, first_bound, bounds, discs, out):
    """Smallest clearance (N,) mm that the rays of pixels (N, 2) have from the bounds of the path."""
    count = pixels.shape[0]
    for chunk in prange((count + CHUNK - 1) // CHUNK):
        rows = np.empty((8, LANES))
        for start in range(chunk * CHUNK, min(count, (chunk + 1) * CHUNK), LANES):
            lanes = min(LANES, count - start)
            x, y, p, v, margin = (
                rows[0, :lanes],
                rows[1, :lanes],
                rows[2:5, :lanes],
                rows[5:, :lanes],
                out[start : start + lanes],
            )
            for i in range(lanes):
                x[i], y[i], margin[i] = pixels[start + i, 0], pixels[start + i, 1], np.inf
            normalise_block(x, y, lens, fold)
            start_block(x, y, p, v, index)
            trace_block(p, v, margin, planes, first_bound, bounds, discs)
            for i in range(lanes):
                if not abs(v[0, i] + v[1, i] + v[2, i]) < np.inf:
                    margin[i] = np.nan


@njit(**OPTIONS)
def newton_block(x, y, goal, frame, step, margin, state, tangents, work, index, planes, first_bound, bounds, discs):
    """One Newton step on normalised coordinates x, y (L,) towards the rays that pass through goal (3, L).

    The miss is measured in the plane through each point with normal frame[2], along frame[0] and frame[1].
    step (L,) becomes the square of the step made, margin (L,) the clearance of the ray before the step.
    Returns nothing; the miss (L,) is left in work[4].
    """
    p, v, tp, tv = state[:3], state[3:], tangents[:2], tangents[2:]
    start_block(x, y, p, v, index)
    start_tangents(x, y, tp, tv, index)
    margin[:] = np.inf
    trace_block_with_tangents(p, v, tp, tv, margin, work[:4], planes, first_bound, bounds, discs)
    (ax, ay, az), (bx, by, bz), (wx, wy, wz) = frame[0], frame[1], frame[2]
    px, py, pz, vx, vy, vz = p[0], p[1], p[2], v[0], v[1], v[2]
    gx, gy, gz = goal[0], goal[1], goal[2]
    miss = work[4]
    for i in range(x.size):
        ahead = 1 / (wx * vx[i] + wy * vy[i] + wz * vz[i])
        dx, dy, dz = gx[i] - px[i], gy[i] - py[i], gz[i] - pz[i]
        t = (wx * dx + wy * dy + wz * dz) * ahead
        mx, my, mz = t * vx[i] - dx, t * vy[i] - dy, t * vz[i] - dz
        va = ax * vx[i] + ay * vy[i] + az * vz[i]
        vb = bx * vx[i] + by * vy[i] + bz * vz[i]
        ux, uy, uz = tp[0, 0, i] + t * tv[0, 0, i], tp[0, 1, i] + t * tv[0, 1, i], tp[0, 2, i] + t * tv[0, 2, i]
        slide = (wx * ux + wy * uy + wz * uz) * ahead
        j00 = ax * ux + ay * uy + az * uz - slide * va
        j10 = bx * ux + by * uy + bz * uz - slide * vb
        ux, uy, uz = tp[1, 0, i] + t * tv[1, 0, i], tp[1, 1, i] + t * tv[1, 1, i], tp[1, 2, i] + t * tv[1, 2, i]
        slide = (wx * ux + wy * uy + wz * uz) * ahead
        j01 = ax * ux + ay * uy + az * uz - slide * va
        j11 = bx * ux + by * uy + bz * uz - slide * vb
        r0, r1 = ax * mx + ay * my + az * mz, bx * mx + by * my + bz * mz
        determinant = 1 / (j00 * j11 - j01 * j10)
        sx, sy = (j11 * r0 - j01 * r1) * determinant, (j00 * r1 - j10 * r0) * determinant
        x[i] -= sx
        y[i] -= sy
        step[i] = sx * sx + sy * sy
        miss[i] = r0 * r0 + r1 * r1
        margin[i] = min(margin[i], t)


@njit(**OPTIONS)
def search_one(goal, seeds, x, y, frame, step, margin, state, tangents, work, path):
    """Damped Newton for one hard point (all arrays of length 1), from each of seeds (M, 2); True if it converged."""
    index, planes, first_bound, bounds, discs = path
    for m in range(seeds.shape[0]):
        best_x, best_y, best_miss = seeds[m, 0], seeds[m, 1], np.inf
        x[0], y[0] = best_x, best_y
        next_x, next_y = best_x, best_y
        for _ in range(60):
            here_x, here_y = x[0], y[0]
            newton_block(
                x, y, goal, frame, step, margin, state, tangents, work, index, planes, first_bound, bounds, discs
            )
            if work[4, 0] <= best_miss and step[0] < np.inf:
                if step[0] < STEP_SQUARED:
                    return True
                best_x, best_y, best_miss = here_x, here_y, work[4, 0]
                next_x, next_y = x[0], y[0]
            else:  # the step led away, or to where there is no ray: go half as far
                next_x, next_y = 0.5 * (here_x + best_x), 0.5 * (here_y + best_y)
                x[0], y[0] = next_x, next_y
                if abs(next_x - best_x) + abs(next_y - best_y) < 1e-14:
                    break
    return False


@njit(parallel=True, **OPTIONS)
def project_points(points, aim, seeds, lens, fold, limits, index, planes, first_bound, bounds, discs, out):
    """Pixels out (N, 2) at which points (N, 3) are seen; NaN where they are not.

    aim (7, 3) is the virtual camera that Newton starts from: centre, its axes as rows, and a homography from
    its coordinates to the normalised ones. limits (4,) are the smallest and largest x and y of the image.
    """
    frame, homography = aim[1:4], aim[4:]
    count = points.shape[0]
    for chunk in prange((count + CHUNK - 1) // CHUNK):
        rows, tangent_rows, works = np.empty((13, LANES)), np.empty((4, 3, LANES)), np.empty((5, LANES))
        for start in range(chunk * CHUNK, min(count, (chunk + 1) * CHUNK), LANES):
            lanes = min(LANES, count - start)
            x, y, step, margin = rows[0, :lanes], rows[1, :lanes], rows[2, :lanes], rows[3, :lanes]
            goal, state = rows[4:7, :lanes], rows[7:, :lanes]
            tangents, work = tangent_rows[:, :, :lanes], works[:, :lanes]
            for i in range(lanes):
                goal[0, i], goal[1, i], goal[2, i] = points[start + i, 0], points[start + i, 1], points[start + i, 2]
            aim_block(goal, aim[0], frame, homography, x, y)
            for _ in range(ITERATIONS):
                newton_block(
                    x, y, goal, frame, step, margin, state, tangents, work, index, planes, first_bound, bounds, discs
                )
                if step.max() < STEP_SQUARED:
                    break
            for i in range(lanes):
                if not step[i] < STEP_SQUARED:
                    s = slice(i, i + 1)
                    path = (index, planes, first_bound, bounds, discs)
                    finite = abs(goal[0, i] + goal[1, i] + goal[2, i]) < np.inf
                    if not finite or not search_one(
                        goal[:, s],
                        seeds,
                        x[s],
                        y[s],
                        frame,
                        step[s],
                        margin[s],
                        state[:, s],
                        tangents[:, :, s],
                        work[:, s],
                        path,
                    ):
                        margin[i] = -1.0
            pixel_block(x, y, lens, fold)
            for i in range(lanes):
                seen = margin[i] >= 0 and limits[0] <= x[i] <= limits[1] and limits[2] <= y[i] <= limits[3]
                out[start + i, 0] = x[i] if seen else np.nan
                out[start + i, 1] = y[i] if seen else np.nan


@njit(**OPTIONS)
def aim_block(goal, centre, frame, homography, x, y):
    """Where the virtual camera sees goal (3, L), as normalised coordinates x, y (L,)."""
    for i in range(x.size):
        dx, dy, dz = goal[0, i] - centre[0], goal[1, i] - centre[1], goal[2, i] - centre[2]
        a = frame[0, 0] * dx + frame[0, 1] * dy + frame[0, 2] * dz
        b = frame[1, 0] * dx + frame[1, 1] * dy + frame[1, 2] * dz
        c = frame[2, 0] * dx + frame[2, 1] * dy + frame[2, 2] * dz
        scale = 1 / (homography[2, 0] * a + homography[2, 1] * b + homography[2, 2] * c)
        x[i] = (homography[0, 0] * a + homography[0, 1] * b + homography[0, 2] * c) * scale
        y[i] = (homography[1, 0] * a + homography[1, 1] * b + homography[1, 2] * c) * scale


@njit(parallel=True, **OPTIONS)
def ray_tangents(coordinates, index, index_end, planes, plane_tangents, out_rays, out_tangents):
    """Rays (N, 6) of normalised coordinates (N, 2) and their tangents (N, 2 + P, 6) to those and P parameters."""
    count, parameters = coordinates.shape[0], plane_tangents.shape[0]
    padded = np.zeros((2 + parameters, planes.shape[0], 5))
    padded[2:] = plane_tangents
    for chunk in prange((count + CHUNK - 1) // CHUNK):
        p, v, x, y = np.empty((3, 1)), np.empty((3, 1)), np.empty(1), np.empty(1)
        tp0, tv0 = np.empty((2, 3, 1)), np.empty((2, 3, 1))
        tp, tv = np.empty((2 + parameters, 3)), np.empty((2 + parameters, 3))
        for i in range(chunk * CHUNK, min(count, (chunk + 1) * CHUNK)):
            x[0], y[0] = coordinates[i, 0], coordinates[i, 1]
            start_block(x, y, p, v, index)
            start_tangents(x, y, tp0, tv0, index)
            tp[:] = 0.0
            tv[:] = 0.0
            tv[:2] = tv0[:, :, 0]
            trace_one_with_parameters(p[:, 0], v[:, 0], tp, tv, planes, padded)
            for c in range(3):
                out_rays[i, c], out_rays[i, 3 + c] = p[c, 0], v[c, 0] / index_end
                for j in range(2 + parameters):
                    out_tangents[i, j, c], out_tangents[i, j, 3 + c] = tp[j, c], tv[j, c] / index_end
