"""Compiled tracing of planar paths, a block of rays at a time.

Rays are held as structure of arrays, one row per component, so that every inner loop runs over lanes and
vectorises. A ray carries its *optical direction*, the unit direction times the refractive index, because
then the laws of refraction and reflection are one formula (`trace_block`).

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

LANES = 128  # rays in a block: all rows of a block stay in the first-level cache
CHUNK = 16 * LANES  # rays a thread takes at a time

# NaN is how a ray says that it does not exist, so every relaxation but "nnan" and "ninf" is allowed
OPTIONS = {"cache": True, "error_model": "numpy", "fastmath": {"reassoc", "contract", "arcp", "nsz"}}


@njit(**OPTIONS)
def trace_block(p, v, margin, planes, first_bound, bounds, discs):
    """Move rays through every surface of a path, in place.

    p, v are (3, L) positions and optical directions; margin (L,) becomes the smallest signed clearance to
    any bound (mm, negative: outside). A totally reflected ray gets a NaN direction.

    With u = v . normal, the optical direction after a surface is v + (k - u) normal, where
    k = sign(u) sqrt(u^2 + n_after^2 - n_before^2) for refraction and k = -u for reflection: the component
    along the surface stays (Snell; Born and Wolf, section 1.5.1), the length becomes n_after.
    """
    px, py, pz = p[0], p[1], p[2]
    vx, vy, vz = v[0], v[1], v[2]
    lanes = px.size
    for s in range(planes.shape[0]):
        nx, ny, nz, offset, delta, sign = planes[s]
        for i in range(lanes):
            u = nx * vx[i] + ny * vy[i] + nz * vz[i]
            t = (offset - (nx * px[i] + ny * py[i] + nz * pz[i])) / u
            px[i] += t * vx[i]
            py[i] += t * vy[i]
            pz[i] += t * vz[i]
            root = math.sqrt(u * u + delta)
            k = sign * (root if u >= 0 else -root) - u
            vx[i] += k * nx
            vy[i] += k * ny
            vz[i] += k * nz
            margin[i] = min(margin[i], t)
        bound_block(px, py, pz, margin, s, first_bound, bounds, discs)


@njit(**OPTIONS)
def bound_block(px, py, pz, margin, s, first_bound, bounds, discs):
    """Lower `margin` to the clearance that hits on surface s have from its bounds and its outline."""
    for b in range(first_bound[s], first_bound[s + 1]):
        bx, by, bz, edge = bounds[b, 0], bounds[b, 1], bounds[b, 2], bounds[b, 3]
        for i in range(px.size):
            margin[i] = min(margin[i], edge - (bx * px[i] + by * py[i] + bz * pz[i]))
    if discs[s, 6] < np.inf:
        disc_block(px, py, pz, margin, discs[s])


@njit(**OPTIONS)
def disc_block(px, py, pz, margin, disc):
    """Lower `margin` to the clearance from a cylinder; exact at its wall, to first order near it."""
    cx, cy, cz, ax, ay, az, radius = disc
    for i in range(px.size):
        dx, dy, dz = px[i] - cx, py[i] - cy, pz[i] - cz
        along = ax * dx + ay * dy + az * dz
        square = dx * dx + dy * dy + dz * dz - along * along
        margin[i] = min(margin[i], (radius * radius - square) / (2 * radius))


@njit(**OPTIONS)
def trace_block_with_tangents(p, v, tp, tv, margin, work, planes, first_bound, bounds, discs):
    """`trace_block`, carrying T tangents tp, tv (T, 3, L) of position and optical direction along.

    work is scratch (4, L).
    """
    px, py, pz = p[0], p[1], p[2]
    vx, vy, vz = v[0], v[1], v[2]
    inverse, step, kick, gain = work[0], work[1], work[2], work[3]
    lanes = px.size
    for s in range(planes.shape[0]):
        nx, ny, nz, offset, delta, sign = planes[s]
        for i in range(lanes):
            u = nx * vx[i] + ny * vy[i] + nz * vz[i]
            inverse[i] = 1 / u
            step[i] = (offset - (nx * px[i] + ny * py[i] + nz * pz[i])) * inverse[i]
            root = math.sqrt(u * u + delta)
            kick[i] = sign * (root if u >= 0 else -root) - u
            gain[i] = sign * abs(u) / root - 1  # d kick / d u
            margin[i] = min(margin[i], step[i])
        for j in range(tp.shape[0]):
            tpx, tpy, tpz = tp[j, 0], tp[j, 1], tp[j, 2]
            tvx, tvy, tvz = tv[j, 0], tv[j, 1], tv[j, 2]
            for i in range(lanes):
                wx = tpx[i] + step[i] * tvx[i]
                wy = tpy[i] + step[i] * tvy[i]
                wz = tpz[i] + step[i] * tvz[i]
                slide = (nx * wx + ny * wy + nz * wz) * inverse[i]
                tpx[i] = wx - slide * vx[i]
                tpy[i] = wy - slide * vy[i]
                tpz[i] = wz - slide * vz[i]
                bend = gain[i] * (nx * tvx[i] + ny * tvy[i] + nz * tvz[i])
                tvx[i] += bend * nx
                tvy[i] += bend * ny
                tvz[i] += bend * nz
        for i in range(lanes):
            px[i] += step[i] * vx[i]
            py[i] += step[i] * vy[i]
            pz[i] += step[i] * vz[i]
            vx[i] += kick[i] * nx
            vy[i] += kick[i] * ny
            vz[i] += kick[i] * nz
        bound_block(px, py, pz, margin, s, first_bound, bounds, discs)


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
        root = math.sqrt(u * u + delta)
        side = sign if u >= 0 else -sign
        kick = side * root - u
        for j in range(tp.shape[0]):
            mx, my, mz, t_offset, t_delta = plane_tangents[j, s]
            t_u = mx * v[0] + my * v[1] + mz * v[2] + nx * tv[j, 0] + ny * tv[j, 1] + nz * tv[j, 2]
            t_height = mx * p[0] + my * p[1] + mz * p[2] + nx * tp[j, 0] + ny * tp[j, 1] + nz * tp[j, 2]
            t_t = (t_offset - t_height - t * t_u) / u
            t_kick = side * (2 * u * t_u + t_delta) / (2 * root) - t_u
            for c in range(3):
                tp[j, c] += t * tv[j, c] + t_t * v[c]
                tv[j, c] += t_kick * planes[s, c] + kick * plane_tangents[j, s, c]
        for c in range(3):
            p[c] += t * v[c]
            v[c] += kick * planes[s, c]


@njit(parallel=True, **OPTIONS)
def trace_rays(origins, directions, index, planes, first_bound, bounds, discs, out_origins, out_directions):
    """Trace rays (N, 3) through a path into out_origins, out_directions (N, 3), NaN where one is lost."""
    count = origins.shape[0]
    for chunk in prange((count + CHUNK - 1) // CHUNK):
        p_rows, v_rows, margins = np.empty((3, LANES)), np.empty((3, LANES)), np.empty(LANES)
        for start in range(chunk * CHUNK, min(count, (chunk + 1) * CHUNK), LANES):
            lanes = min(LANES, count - start)
            p, v, margin = p_rows[:, :lanes], v_rows[:, :lanes], margins[:lanes]
            margin[:] = np.inf
            for c in range(3):
                for i in range(lanes):
                    p[c, i] = origins[start + i, c]
                    v[c, i] = index * directions[start + i, c]
            trace_block(p, v, margin, planes, first_bound, bounds, discs)
            store_rays(p, v, margin, start, out_origins, out_directions)


@njit(**OPTIONS)
def store_rays(p, v, margin, start, out_origins, out_directions):
    """Write a block of rays that leave into a medium, NaN where it is outside a bound or has no direction."""
    px, py, pz, vx, vy, vz = p[0], p[1], p[2], v[0], v[1], v[2]
    for i in range(margin.size):
        scale = 1 / math.sqrt(vx[i] * vx[i] + vy[i] * vy[i] + vz[i] * vz[i])
        lost = 0.0 if (margin[i] >= 0 and scale > 0) else np.nan
        scale += lost
        out_origins[start + i, 0] = px[i] + lost
        out_origins[start + i, 1] = py[i] + lost
        out_origins[start + i, 2] = pz[i] + lost
        out_directions[start + i, 0] = vx[i] * scale
        out_directions[start + i, 1] = vy[i] * scale
        out_directions[start + i, 2] = vz[i] * scale


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
        for b in range(first_bound[s], first_bound[s + 1]):
            if bounds[b, 0] * p[0] + bounds[b, 1] * p[1] + bounds[b, 2] * p[2] > bounds[b, 3]:
                return int(bounds[b, 4])
        clearance = np.full(1, np.inf)
        if discs[s, 6] < np.inf:
            disc_block(p[0:1], p[1:2], p[2:3], clearance, discs[s])
        if clearance[0] < 0:
            return outside
        square = u * u + planes[s, 4]
        if square < 0:
            return reflected
        kick = planes[s, 5] * math.copysign(math.sqrt(square), u) - u
        for c in range(3):
            v[c] += kick * n[c]
    return 0
