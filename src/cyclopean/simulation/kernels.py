"""Compiled loops of the simulation, over rays.

Rays of a tile lie sample by sample: ray ``s * pixels + p`` is sample s of the tile's pixel p, so that neighbours
are alike.
"""

import math

import numpy as np
from numba import njit, prange

from ..cameras.kernels import distort_one, is_straight, normalise_one
from ..optics.kernels import CHUNK, LANES, MARGIN, OPTIONS, PX, PY, PZ, ROWS, VX, VY, VZ, trace_block
from .paint_kernels import STEP, mixed

# rows of a block beyond those of tracing: part of the light that is left, and an optical direction to follow it with
LEFT, WX, WY, WZ = (LANES * row for row in range(ROWS, ROWS + 4))
ALL_ROWS = ROWS + 4
_BY_FOLD = 0.5  # of the square of a lens's fold: beyond, two Newton steps may lead over it


@njit(inline="always", **OPTIONS)
def meet_one(ox, oy, oz, dx, dy, dz, triangle, vertices, faces):
    """Distance along a ray to the plane of a triangle, and the weights of its corners there."""
    a, b, c = faces[triangle, 0], faces[triangle, 1], faces[triangle, 2]
    ax, ay, az = vertices[a, 0], vertices[a, 1], vertices[a, 2]
    ux, uy, uz = vertices[b, 0] - ax, vertices[b, 1] - ay, vertices[b, 2] - az
    vx, vy, vz = vertices[c, 0] - ax, vertices[c, 1] - ay, vertices[c, 2] - az
    nx, ny, nz = uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx
    rx, ry, rz = ax - ox, ay - oy, az - oz
    inverse = 1 / (nx * dx + ny * dy + nz * dz)
    t = (nx * rx + ny * ry + nz * rz) * inverse
    qx, qy, qz = ry * dz - rz * dy, rz * dx - rx * dz, rx * dy - ry * dx
    second = (vx * qx + vy * qy + vz * qz) * inverse
    third = -(ux * qx + uy * qy + uz * qz) * inverse
    return t, second, third, nx, ny, nz


@njit(parallel=True, **OPTIONS)
def meet(origins, directions, triangles, vertices, faces, out_points, out_weights):
    """Points (N, 3) and corner weights (N, 3) of rays (N, 3) on the planes of triangles (N,); NaN where that is -1.

    Plane and barycentric coordinates as Möller and Trumbore (1997).
    """
    for i in prange(origins.shape[0]):
        if triangles[i] < 0:
            for c in range(3):
                out_points[i, c] = np.nan
                out_weights[i, c] = np.nan
            continue
        ox, oy, oz = origins[i, 0], origins[i, 1], origins[i, 2]
        dx, dy, dz = directions[i, 0], directions[i, 1], directions[i, 2]
        t, second, third, _, _, _ = meet_one(ox, oy, oz, dx, dy, dz, triangles[i], vertices, faces)
        out_points[i, 0] = ox + t * dx
        out_points[i, 1] = oy + t * dy
        out_points[i, 2] = oz + t * dz
        out_weights[i, 0] = 1 - second - third
        out_weights[i, 1] = second
        out_weights[i, 2] = third


@njit(parallel=True, **OPTIONS)
def primary_rays(first, pixels, width, samples, key, lens, fold, aperture, focus, origins, directions, falloff):
    """Rays in air of all samples of a tile: the pixels `first` to `first + pixels` of the picture, row by row.

    samples : (S, 4) uint32, where each sample lies in a pixel and on the pupil; every pixel flips other bits of them,
        which keeps them as well spread as they are (a digital shift)
    aperture, focus : radius of the pupil in the plane z = 0, and z of the plane in focus, mm
    origins, directions : (S * pixels, 3) out; a direction has z = 1 or is NaN where it, or the middle of its pixel,
        lies beyond the lens's fold
    falloff : (S * pixels,) out, cos^4 of the field angle, or of length 0
    """
    straight = is_straight(lens)
    scale_x, scale_y, unit = 1 / lens[0], 1 / lens[1], 2.0**-32
    for chunk in prange((pixels + LANES - 1) // LANES):
        for p in range(chunk * LANES, min(pixels, (chunk + 1) * LANES)):
            number = first + p
            column, row = number % width, number // width
            flips = mixed(np.uint64(number) + (np.uint64(key) << np.uint64(32)) + STEP)
            pupil_flips = mixed(flips + STEP)
            flip_x, flip_y = np.uint32(flips), np.uint32(flips >> np.uint64(32))
            flip_u, flip_v = np.uint32(pupil_flips), np.uint32(pupil_flips >> np.uint64(32))
            a, b = (column - lens[2]) * scale_x, (row - lens[3]) * scale_y
            by_fold = False
            if not straight:
                a, b = normalise_one(a, b, lens, fold)
                by_fold = a * a + b * b > _BY_FOLD * fold * fold
            for s in range(samples.shape[0]):
                n = s * pixels + p
                dx = (samples[s, 0] ^ flip_x) * unit + (0.5 * unit - 0.5)
                dy = (samples[s, 1] ^ flip_y) * unit + (0.5 * unit - 0.5)
                if straight:
                    x, y = a + dx * scale_x, b + dy * scale_y
                else:
                    x, y = (column + dx - lens[2]) * scale_x, (row + dy - lens[3]) * scale_y
                    x, y = normalise_one(x, y, lens, fold) if by_fold else normalise_near(x, y, a, b, lens)
                px, py = 0.0, 0.0
                if aperture > 0:
                    radius = aperture * math.sqrt(((samples[s, 2] ^ flip_u) + 0.5) * unit)
                    angle = 2 * math.pi * (samples[s, 3] ^ flip_v) * unit
                    px, py = radius * math.cos(angle), radius * math.sin(angle)
                origins[n, 0] = px
                origins[n, 1] = py
                origins[n, 2] = 0.0
                directions[n, 0] = x - px / focus
                directions[n, 1] = y - py / focus
                directions[n, 2] = 1.0
                if falloff.shape[0]:
                    falloff[n] = 1 / (1 + x * x + y * y) ** 2


@njit(inline="always", **OPTIONS)
def normalise_near(x, y, a, b, lens):
    """Undistorted coordinates of distorted ones (x, y), from those (a, b) of a place within a pixel.

    Two Newton steps: the first is off by the square of a pixel, the second by its fourth power.
    """
    for _ in range(2):
        xd, yd, xx, xy, yy = distort_one(a, b, lens)
        inverse = 1 / (xx * yy - xy * xy)
        ex, ey = xd - x, yd - y
        a -= (yy * ex - xy * ey) * inverse
        b -= (xx * ey - xy * ex) * inverse
    return a, b


@njit(parallel=True, **OPTIONS)
def send(
    origins, directions, pixels, line, number, shut, index, planes, first_bound, bounds, discs, coating, middle,
    way, passed, out_origins, out_directions, near_origins, near_directions,
):  # fmt: skip
    """Send the rays of a tile that no way has taken yet along one path, and write down those that it takes.

    line : (S,) which of the wavelengths each sample has
    number : of this path; it becomes the `way` (N,) int8 of the rays it takes
    shut : (N,) bool, rays that a mirror hides from this path, or of length 0
    index : refractive index before the first surface
    planes : (L, S, 6), the path's planes at each wavelength
    first_bound, bounds, discs : its bounds, the same at all wavelengths
    coating : reflectance of every refracting surface; NaN for that of the bare glass
    middle : (3,) mm, where Embree's coordinates start
    passed : (N,) part of the light that the surfaces let through
    out_origins, out_directions : (N, 3) behind the last surface, unit directions
    near_origins, near_directions : (N, 3) float32, the same for Embree
    """
    blocks = (pixels + LANES - 1) // LANES
    per_chunk = CHUNK // LANES
    for chunk in prange((blocks * line.shape[0] + per_chunk - 1) // per_chunk):
        b = np.empty(ALL_ROWS * LANES)
        for k in range(chunk * per_chunk, min((chunk + 1) * per_chunk, blocks * line.shape[0])):
            s = k // blocks
            start = s * pixels + (k % blocks) * LANES
            stop = min(start + LANES, (s + 1) * pixels)
            wanted = False
            for n in range(start, stop):
                wanted |= way[n] < 0
            if not wanted:
                continue
            load_block(b, origins, directions, start, stop, index)
            trace_block(b, planes[line[s]], first_bound, bounds, discs)
            wanted = False
            for i in range(LANES):
                wanted |= b[MARGIN + i] >= 0
            if not wanted:
                continue
            transmit_block(b, index, planes[line[s]], coating)
            for i in range(stop - start):
                n = start + i
                vx, vy, vz = b[VX + i], b[VY + i], b[VZ + i]
                square = vx * vx + vy * vy + vz * vz
                if way[n] >= 0 or not (b[MARGIN + i] >= 0 and square > 0) or (shut.shape[0] and shut[n]):
                    continue
                scale = 1 / math.sqrt(square)
                way[n] = number
                passed[n] = b[LEFT + i]
                for c in range(3):
                    out_origins[n, c] = b[PX + c * LANES + i]
                    out_directions[n, c] = b[VX + c * LANES + i] * scale
                    near_origins[n, c] = b[PX + c * LANES + i] - middle[c]
                    near_directions[n, c] = b[VX + c * LANES + i] * scale


@njit(**OPTIONS)
def load_block(b, origins, directions, start, stop, index):
    """Fill a block with rays `start` to `stop`, the last one again where there are fewer than lanes."""
    for i in range(LANES):
        n = min(start + i, stop - 1)
        dx, dy, dz = directions[n, 0], directions[n, 1], directions[n, 2]
        scale = index / math.sqrt(dx * dx + dy * dy + dz * dz)
        b[PX + i] = origins[n, 0]
        b[PY + i] = origins[n, 1]
        b[PZ + i] = origins[n, 2]
        b[VX + i] = b[WX + i] = dx * scale
        b[VY + i] = b[WY + i] = dy * scale
        b[VZ + i] = b[WZ + i] = dz * scale
        b[MARGIN + i] = np.inf


@njit(**OPTIONS)
def transmit_block(b, index, planes, coating):
    """Part of the light that a path's surfaces let through, for the directions (row W) of a block of rays before it.

    With u = n_1 cos a_1 and w = n_2 cos a_2, unpolarised light loses (r_s^2 + r_p^2) / 2 at a surface, where
    r_s = (u - w) / (u + w) and r_p = (n_2^2 u - n_1^2 w) / (n_2^2 u + n_1^2 w) (Born and Wolf, section 1.5.2).
    """
    for i in range(LANES):
        b[LEFT + i] = 1.0
    before = index * index
    for s in range(planes.shape[0]):
        nx, ny, nz, _, delta, sign = planes[s]
        if sign < 0:
            for i in range(LANES):
                u = 2 * (nx * b[WX + i] + ny * b[WY + i] + nz * b[WZ + i])
                b[WX + i] -= u * nx
                b[WY + i] -= u * ny
                b[WZ + i] -= u * nz
            continue
        after = before + delta
        for i in range(LANES):
            u = nx * b[WX + i] + ny * b[WY + i] + nz * b[WZ + i]
            w = math.sqrt(u * u + delta)
            kick = math.copysign(w, u) - u
            u = abs(u)
            across = (u - w) / (u + w)
            along = (after * u - before * w) / (after * u + before * w)
            loss = coating if coating >= 0 else 0.5 * (across * across + along * along)
            b[LEFT + i] *= 1 - loss
            b[WX + i] += kick * nx
            b[WY + i] += kick * ny
            b[WZ + i] += kick * nz
        before = after


@njit(parallel=True, **OPTIONS)
def find_places(rows, origins, directions, triangles, first, vertices, faces, places, out):
    """Where on a surface's paint (M, D) the rays `rows` (M,) of all (N,) lie.

    triangles, first : (N,) that the rays meet, and the number of the surface's own first one
    vertices, faces, places : of the surface
    """
    for m in prange(rows.shape[0]):
        n = rows[m]
        k = triangles[n] - first
        _, second, third, _, _, _ = meet_one(
            origins[n, 0], origins[n, 1], origins[n, 2], directions[n, 0], directions[n, 1], directions[n, 2],
            k, vertices, faces,
        )  # fmt: skip
        second, third = min(max(second, 0.0), 1.0), min(max(third, 0.0), 1.0)  # rounding and grazing rays
        start = 1 - second - third
        for c in range(places.shape[1]):
            out[m, c] = (
                start * places[faces[k, 0], c] + second * places[faces[k, 1], c] + third * places[faces[k, 2], c]
            )


@njit(parallel=True, **OPTIONS)
def lamp_light(
    origins, directions, triangles, vertices, faces, lamp, parallel, distance, lift, middle,
    gain, near_origins, near_directions,
):  # fmt: skip
    """What a lamp of strength 1 would add to a white matte surface where rays (N, 3) meet triangles (N,).

    lamp : (3,) mm, where it is, or the unit vector towards it where its light is `parallel`
    distance : mm, at which the strength holds
    lift : mm, by which shadow rays start above the surface
    gain : (N,) out, cos of the angle to the normal times (distance / that to the lamp)^2; 0 on the far side
    near_origins, near_directions : (N, 3) float32 out, rays that end at the lamp after their own length; NaN: none
    """
    for n in prange(triangles.shape[0]):
        gain[n] = 0.0
        near_directions[n, 0] = np.nan
        if triangles[n] < 0:
            continue
        ox, oy, oz = origins[n, 0], origins[n, 1], origins[n, 2]
        dx, dy, dz = directions[n, 0], directions[n, 1], directions[n, 2]
        t, _, _, nx, ny, nz = meet_one(ox, oy, oz, dx, dy, dz, triangles[n], vertices, faces)
        scale = -math.copysign(1 / math.sqrt(nx * nx + ny * ny + nz * nz), nx * dx + ny * dy + nz * dz)
        nx, ny, nz = nx * scale, ny * scale, nz * scale  # towards the camera
        px, py, pz = ox + t * dx + lift * nx, oy + t * dy + lift * ny, oz + t * dz + lift * nz
        lx, ly, lz = lamp[0], lamp[1], lamp[2]
        if not parallel:
            lx, ly, lz = lx - px, ly - py, lz - pz
        square = lx * lx + ly * ly + lz * lz
        cosine = (nx * lx + ny * ly + nz * lz) / math.sqrt(square)
        if not cosine > 0:
            continue
        gain[n] = cosine if parallel else cosine * distance * distance / square
        near_origins[n, 0], near_origins[n, 1], near_origins[n, 2] = px - middle[0], py - middle[1], pz - middle[2]
        near_directions[n, 0], near_directions[n, 1], near_directions[n, 2] = lx, ly, lz


@njit(parallel=True, **OPTIONS)
def gather(values, passed, pixels, mix, out):
    """Add the light of all samples of a tile to its pixels: out (pixels, C) from values (N, V) and mix (V, C)."""
    samples = passed.shape[0] // pixels
    for p in prange(pixels):
        for s in range(samples):
            n = s * pixels + p
            for v in range(mix.shape[0]):
                value = passed[n] * values[n, v]
                for c in range(mix.shape[1]):
                    out[p, c] += value * mix[v, c]
