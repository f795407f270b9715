"""Compiled tracing of planar paths, a block of rays at a time.

Every loop here runs over the lanes of one block and vectorises. For that, a block is one flat array whose rows
lie a constant number of lanes apart (`PX` and the names below are where rows start), and always full: unused
lanes at the end of the data repeat the last ray.

A ray carries its *optical direction*, the unit direction times the refractive index, because then the laws
of refraction and reflection are one formula (`trace_block`).

Arrays that describe a path (made by `Path.packed`):

planes : (S, 6)
    Unit normal, offset (``normal . x = offset``), n_after^2 - n_before^2, and +1 to refract or -1 to reflect.
first_bound : (S + 1,)
    Bounds of surface s are rows first_bound[s] : first_bound[s + 1] of `bounds`.
bounds : (B, 5)
    Half-spaces ``normal . x <= offset`` that a hit must lie in, and the Reason when it does not.
discs : (S, 7)
    A cylinder around the surface's outline: point on its axis, unit axis, radius (inf: no outline).
"""

import math

import numpy as np
from numba import njit, prange

LANES = 64  # rays in a block: all its rows stay in the first-level cache
CHUNK = 32 * LANES  # rays that a thread takes at a time

# rows of a block: position, optical direction, clearance from the bounds, scratch, two sets of tangents
PX, PY, PZ, VX, VY, VZ = (LANES * row for row in range(6))
MARGIN, STEP, KICK, GAIN, INVERSE = (LANES * row for row in range(6, 11))
TANGENTS, TANGENT = LANES * 11, LANES * 6  # each set: position, then optical direction
ROWS = 11 + 12

# NaN is how a ray says that it does not exist, so every relaxation but "nnan" and "ninf" is allowed
OPTIONS = {"cache": True, "error_model": "numpy", "fastmath": {"reassoc", "contract", "arcp", "nsz"}}


@njit(**OPTIONS)
def trace_block(b, planes, first_bound, bounds, discs):
    """Move the rays of a block through every surface of a path.

    The margin row becomes the smallest signed clearance to any bound (mm, negative: outside). A totally
    reflected ray gets a NaN direction.

    With u = v . normal, the optical direction after a surface is v + (k - u) normal, where
    k = sign(u) sqrt(u^2 + n_after^2 - n_before^2) for refraction and k = -u for reflection: the component
    along the surface stays (Snell; Born and Wolf, section 1.5.1), the length becomes n_after.
    """
    for s in range(planes.shape[0]):
        nx, ny, nz, offset, delta, sign = planes[s]
        for i in range(LANES):
            u = nx * b[VX + i] + ny * b[VY + i] + nz * b[VZ + i]
            t = (offset - (nx * b[PX + i] + ny * b[PY + i] + nz * b[PZ + i])) / u
            b[PX + i] += t * b[VX + i]
            b[PY + i] += t * b[VY + i]
            b[PZ + i] += t * b[VZ + i]
            kick = sign * math.copysign(math.sqrt(u * u + delta), u) - u
            b[VX + i] += kick * nx
            b[VY + i] += kick * ny
            b[VZ + i] += kick * nz
            b[MARGIN + i] = b[MARGIN + i] if b[MARGIN + i] < t else t
        bound_block(b, s, first_bound, bounds, discs)


@njit(**OPTIONS)
def bound_block(b, s, first_bound, bounds, discs):
    """Lower the margin row to the clearance that hits on surface s have from its bounds and its outline."""
    for k in range(first_bound[s], first_bound[s + 1]):
        nx, ny, nz, edge, _ = bounds[k]
        for i in range(LANES):
            clearance = edge - (nx * b[PX + i] + ny * b[PY + i] + nz * b[PZ + i])
            b[MARGIN + i] = b[MARGIN + i] if b[MARGIN + i] < clearance else clearance
    cx, cy, cz, ax, ay, az, radius = discs[s]
    if radius < np.inf:
        for i in range(LANES):
            dx, dy, dz = b[PX + i] - cx, b[PY + i] - cy, b[PZ + i] - cz
            along = ax * dx + ay * dy + az * dz
            square = dx * dx + dy * dy + dz * dz - along * along
            clearance = (radius * radius - square) / (2 * radius)  # exact at the rim, to first order near it
            b[MARGIN + i] = b[MARGIN + i] if b[MARGIN + i] < clearance else clearance


@njit(**OPTIONS)
def trace_block_with_tangents(b, planes, first_bound, bounds, discs):
    """`trace_block`, carrying both sets of tangents along."""
    for s in range(planes.shape[0]):
        nx, ny, nz, offset, delta, sign = planes[s]
        for i in range(LANES):
            u = nx * b[VX + i] + ny * b[VY + i] + nz * b[VZ + i]
            inverse = 1 / u
            step = (offset - (nx * b[PX + i] + ny * b[PY + i] + nz * b[PZ + i])) * inverse
            root = math.copysign(math.sqrt(u * u + delta), u)
            b[INVERSE + i] = inverse
            b[STEP + i] = step
            b[KICK + i] = sign * root - u
            b[GAIN + i] = sign * u / root - 1  # d kick / d u
            b[MARGIN + i] = b[MARGIN + i] if b[MARGIN + i] < step else step
        tangent_block(b, TANGENTS, nx, ny, nz)
        tangent_block(b, TANGENTS + TANGENT, nx, ny, nz)
        for i in range(LANES):
            b[PX + i] += b[STEP + i] * b[VX + i]
            b[PY + i] += b[STEP + i] * b[VY + i]
            b[PZ + i] += b[STEP + i] * b[VZ + i]
            b[VX + i] += b[KICK + i] * nx
            b[VY + i] += b[KICK + i] * ny
            b[VZ + i] += b[KICK + i] * nz
        bound_block(b, s, first_bound, bounds, discs)


@njit(inline="always", **OPTIONS)
def tangent_block(b, row, nx, ny, nz):
    """Move one set of tangents, which starts at `row`, through a surface with this normal."""
    for i in range(LANES):
        step = b[STEP + i]
        tvx, tvy, tvz = b[row + VX + i], b[row + VY + i], b[row + VZ + i]
        wx = b[row + PX + i] + step * tvx
        wy = b[row + PY + i] + step * tvy
        wz = b[row + PZ + i] + step * tvz
        slide = (nx * wx + ny * wy + nz * wz) * b[INVERSE + i]
        b[row + PX + i] = wx - slide * b[VX + i]
        b[row + PY + i] = wy - slide * b[VY + i]
        b[row + PZ + i] = wz - slide * b[VZ + i]
        bend = b[GAIN + i] * (nx * tvx + ny * tvy + nz * tvz)
        b[row + VX + i] = tvx + bend * nx
        b[row + VY + i] = tvy + bend * ny
        b[row + VZ + i] = tvz + bend * nz


@njit(parallel=True, **OPTIONS)
def trace_rays(origins, directions, index, planes, first_bound, bounds, discs, out_origins, out_directions):
    """Trace rays (N, 3) through a path into out_origins, out_directions (N, 3), NaN where one is lost."""
    count = origins.shape[0]
    for chunk in prange((count + CHUNK - 1) // CHUNK):
        b = np.empty(ROWS * LANES)
        for start in range(chunk * CHUNK, min(count, (chunk + 1) * CHUNK), LANES):
            for i in range(LANES):
                n = min(start + i, count - 1)
                for c in range(3):
                    b[PX + c * LANES + i] = origins[n, c]
                    b[VX + c * LANES + i] = index * directions[n, c]
                b[MARGIN + i] = np.inf
            trace_block(b, planes, first_bound, bounds, discs)
            finish_block(b)
            store_block(b, start, count, out_origins, out_directions)


@njit(**OPTIONS)
def finish_block(b):
    """Make directions unit again, and rays NaN that are outside a bound or have no direction."""
    for i in range(LANES):
        square = b[VX + i] * b[VX + i] + b[VY + i] * b[VY + i] + b[VZ + i] * b[VZ + i]
        scale = 1 / math.sqrt(square)
        lost = 0.0 if (b[MARGIN + i] >= 0) & (scale > 0) else np.nan
        b[PX + i] += lost
        b[PY + i] += lost
        b[PZ + i] += lost
        b[VX + i] = b[VX + i] * scale + lost
        b[VY + i] = b[VY + i] * scale + lost
        b[VZ + i] = b[VZ + i] * scale + lost


@njit(**OPTIONS)
def store_block(b, start, count, out_origins, out_directions):
    """Write a block's rays to rows from `start` on of (N, 3) arrays."""
    for i in range(min(LANES, count - start)):
        out_origins[start + i, 0] = b[PX + i]
        out_origins[start + i, 1] = b[PY + i]
        out_origins[start + i, 2] = b[PZ + i]
        out_directions[start + i, 0] = b[VX + i]
        out_directions[start + i, 1] = b[VY + i]
        out_directions[start + i, 2] = b[VZ + i]


@njit(**OPTIONS)
def trace_one_with_parameters(p, v, tp, tv, planes, plane_tangents):
    """Trace one ray with tangents to anything, the surfaces included.

    p, v (3,) position and optical direction and tp, tv (T, 3) their tangents are changed in place;
    plane_tangents (T, S, 5) holds the tangents of normal, offset and n_after^2 - n_before^2.
    """
    for s in range(planes.shape[0]):
        nx, ny, nz, offset, delta, sign = planes[s]
        u = nx * v[0] + ny * v[1] + nz * v[2]
        t = (offset - (nx * p[0] + ny * p[1] + nz * p[2])) / u
        root = sign * math.copysign(math.sqrt(u * u + delta), u)
        kick = root - u
        for j in range(tp.shape[0]):
            mx, my, mz, t_offset, t_delta = plane_tangents[j, s]
            t_u = mx * v[0] + my * v[1] + mz * v[2] + nx * tv[j, 0] + ny * tv[j, 1] + nz * tv[j, 2]
            t_height = mx * p[0] + my * p[1] + mz * p[2] + nx * tp[j, 0] + ny * tp[j, 1] + nz * tp[j, 2]
            t_t = (t_offset - t_height - t * t_u) / u
            t_kick = (2 * u * t_u + t_delta) / (2 * root) - t_u
            for c in range(3):
                tp[j, c] += t * tv[j, c] + t_t * v[c]
                tv[j, c] += t_kick * planes[s, c] + kick * plane_tangents[j, s, c]
        for c in range(3):
            p[c] += t * v[c]
            v[c] += kick * planes[s, c]


@njit(**OPTIONS)
def explain_ray(p, v, planes, first_bound, bounds, discs, missed, outside, reflected):
    """Why a ray with position p (3,) and optical direction v (3,), both changed, is lost: a Reason or 0.

    missed, outside and reflected are the reasons for a surface never met, an outline missed and total
    reflection; half-spaces bring their own.
    """
    for s in range(planes.shape[0]):
        n = planes[s, :3]
        u = n[0] * v[0] + n[1] * v[1] + n[2] * v[2]
        t = (planes[s, 3] - (n[0] * p[0] + n[1] * p[1] + n[2] * p[2])) / u
        if not 0 <= t < np.inf:
            return missed
        for c in range(3):
            p[c] += t * v[c]
        for k in range(first_bound[s], first_bound[s + 1]):
            if bounds[k, 0] * p[0] + bounds[k, 1] * p[1] + bounds[k, 2] * p[2] > bounds[k, 3]:
                return int(bounds[k, 4])
        if discs[s, 6] < np.inf:
            d = p - discs[s, :3]
            along = d[0] * discs[s, 3] + d[1] * discs[s, 4] + d[2] * discs[s, 5]
            if d[0] * d[0] + d[1] * d[1] + d[2] * d[2] - along * along > discs[s, 6] * discs[s, 6]:
                return outside
        square = u * u + planes[s, 4]
        if square < 0:
            return reflected
        kick = planes[s, 5] * math.copysign(math.sqrt(square), u) - u
        for c in range(3):
            v[c] += kick * n[c]
    return 0
