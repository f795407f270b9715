"""Analytic derivatives of rays and of pixels, for calibration and error analysis."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..cameras import Camera
from ..geometry import Rays, launch
from ..optics import Path


@dataclass(frozen=True, eq=False)
class RayDerivatives:
    """Rays and how they move. Rows of the derivatives are origin x, y, z (mm), then direction x, y, z."""

    rays: Rays  # (...,)
    to_pixel: np.ndarray  # (..., 6, 2)
    to_camera: np.ndarray  # (..., 6, 9), columns in the order of cameras.camera.CAMERA_PARAMETERS
    to_optic: np.ndarray  # (..., 6, P), columns in the order of the optic's parameter_names


@dataclass(frozen=True, eq=False)
class PixelDerivatives:
    """Pixels and how they move; NaN where the point is not seen."""

    pixels: np.ndarray  # (..., 2)
    to_point: np.ndarray  # (..., 2, 3) px/mm
    to_camera: np.ndarray  # (..., 2, 9), columns in the order of cameras.camera.CAMERA_PARAMETERS
    to_optic: np.ndarray  # (..., 2, P), columns in the order of the optic's parameter_names


def ray_derivatives(camera: Camera, path: Path, pixels: np.ndarray, rays: Rays) -> RayDerivatives:
    """Derivatives of the rays of pixels (..., 2); `rays` are those rays, and say where there is none."""
    coordinates = camera.normalise(pixels)
    flat = np.ascontiguousarray(coordinates, dtype=float).reshape(-1, 2)
    tangents = np.swapaxes(_ray_tangents(path, flat)[1], -1, -2)
    tangents = tangents.reshape(*coordinates.shape[:-1], 6, tangents.shape[-1])
    jacobian, to_lens = lens_derivatives(camera, coordinates)
    inverse = np.linalg.inv(jacobian)
    to_coordinates = tangents[..., :2]
    lost = np.where(np.isfinite(rays.directions[..., 0]), 0.0, np.nan)[..., None, None]
    return RayDerivatives(
        rays,
        to_coordinates @ inverse + lost,
        -to_coordinates @ inverse @ to_lens + lost,
        tangents[..., 2:] + lost,
    )


def pixel_derivatives(camera: Camera, path: Path, points: np.ndarray, pixels: np.ndarray) -> PixelDerivatives:
    """Derivatives of the pixels (..., 2) at which points (..., 3) are seen."""
    from . import kernels

    shape = pixels.shape[:-1]
    points, coordinates = (
        np.ascontiguousarray(np.broadcast_to(given, (*shape, given.shape[-1])), dtype=float).reshape(
            -1, given.shape[-1]
        )
        for given in (points, camera.normalise(pixels))
    )
    rays, tangents = _ray_tangents(path, coordinates)
    to_point, to_camera, to_optic = (
        np.empty((len(points), 2, size)) for size in (3, len(camera.lens), tangents.shape[1] - 2)
    )
    given = points, coordinates, camera.lens, rays, tangents
    launch(kernels.pixel_tangents, len(points), *given, to_point, to_camera, to_optic)
    return PixelDerivatives(
        pixels, *(part.reshape(*shape, *part.shape[1:]) for part in (to_point, to_camera, to_optic))
    )


def lens_derivatives(camera: Camera, coordinates: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Derivatives of the pixel to normalised coordinates (..., 2): (..., 2, 2), and to the lens: (..., 2, 9)."""
    x, y = coordinates[..., 0], coordinates[..., 1]
    fx, fy = camera.focal
    k1, k2, p1, p2, k3 = camera.distortion
    r2 = x * x + y * y
    radial = 1 + r2 * (k1 + r2 * (k2 + r2 * k3))
    slope = 2 * (k1 + r2 * (2 * k2 + r2 * 3 * k3))
    xd = x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x * x)
    yd = y * radial + p1 * (r2 + 2 * y * y) + 2 * p2 * x * y
    mixed = x * y * slope + 2 * p1 * x + 2 * p2 * y
    jacobian = np.empty((*x.shape, 2, 2))
    jacobian[..., 0, 0] = fx * (radial + x * x * slope + 2 * p1 * y + 6 * p2 * x)
    jacobian[..., 0, 1] = fx * mixed
    jacobian[..., 1, 0] = fy * mixed
    jacobian[..., 1, 1] = fy * (radial + y * y * slope + 6 * p1 * y + 2 * p2 * x)
    zero, one = np.zeros_like(x), np.ones_like(x)
    lens_x = [
        xd,
        zero,
        one,
        zero,
        fx * x * r2,
        fx * x * r2**2,
        fx * 2 * x * y,
        fx * (r2 + 2 * x * x),
        fx * x * r2**3,
    ]
    lens_y = [
        zero,
        yd,
        zero,
        one,
        fy * y * r2,
        fy * y * r2**2,
        fy * (r2 + 2 * y * y),
        fy * 2 * x * y,
        fy * y * r2**3,
    ]
    return jacobian, np.stack([np.stack(lens_x, -1), np.stack(lens_y, -1)], -2)


def _ray_tangents(path, coordinates):
    """Rays (N, 6) of normalised coordinates (N, 2), and their tangents (N, 2 + P, 6) to those and the optic."""
    from . import kernels

    names = len(path.parameter_names)
    derivatives = np.zeros((0, len(path.interfaces), 5)) if path.derivatives is None else path.derivatives
    rays, tangents = np.empty((len(coordinates), 6)), np.empty((len(coordinates), 2 + names, 6))
    indices = path.index_start, path.index_end
    launch(
        kernels.ray_tangents, len(coordinates), coordinates, *indices, path.packed.planes, derivatives, rays, tangents
    )
    return rays, tangents
