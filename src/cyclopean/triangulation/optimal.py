"""The likeliest point of two pinhole cameras, without a search in space."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from ..errors import OpticError, ShapeError
from ..geometry import Rays, nearest_point
from ..rigs.derivatives import lens_derivatives
from ..rigs.pinhole import pinhole_derivatives
from ..rigs.two_views import Pinhole, fundamental_matrix, homogeneous, redistorted, undistorted
from .points import Points, as_correspondences, as_noise, kept, symmetric_inverse

_ITERATIONS = 12  # 2 do but near an epipole
_ENOUGH = 1e-11  # px


def nearest_pair(fundamental: ArrayLike, pixels: ArrayLike) -> np.ndarray:
    """The pairs of pixels that fulfil the epipolar constraint exactly and are nearest to given ones.

    Parameters
    ----------
    fundamental : (3, 3) array
        F with ``x2 @ F @ x1 = 0``.
    pixels : (..., 2, 2) array
        Undistorted pixels (x, y) in the first and in the second picture.

    Returns
    -------
    (..., 2, 2) array
        The pair with the smallest sum of squared distances (px) to the given one, NaN where that is NaN. Within about
        the noise of an epipole there may be a second minimum, and it may be the lower one.

    References
    ----------
    Lindstrom 2010, Triangulation made easy, listing 2 (its minimum is that of Hartley and Sturm 1997).
    """
    matrix = np.asarray(fundamental, dtype=float)
    if matrix.shape != (3, 3):
        raise ShapeError(f"a fundamental matrix has shape (3, 3), got {matrix.shape}")
    pixels = as_correspondences(pixels, 2)
    first, second = pixels[..., 0, :], pixels[..., 1, :]
    core = matrix[:2, :2]
    gap = np.einsum("...i,ij,...j->...", homogeneous(second), matrix, homogeneous(first))
    normals = start = _normals(matrix, first, second)
    best = pixels
    for _ in range(_ITERATIONS):
        quadratic = np.einsum("...i,ij,...j->...", normals[..., 1, :], core, normals[..., 0, :])
        linear = (normals * start).sum((-1, -2)) / 2
        with np.errstate(invalid="ignore", divide="ignore"):
            share = gap / (linear + np.sqrt(linear**2 - quadratic * gap))
        share = np.where(gap == 0, 0.0, share)
        moved = pixels - share[..., None, None] * normals
        change = np.abs(moved - best)
        best = moved
        if not (change > _ENOUGH).any():
            break
        normals = _normals(matrix, best[..., 0, :], best[..., 1, :])
    return best


def optimal(cameras: Sequence[Pinhole], pixels: ArrayLike, sigma: float = 0.1) -> Points:
    """The likeliest points of two pinhole cameras, from pixels corrected onto their epipolar lines.

    Parameters
    ----------
    cameras : sequence of 2 VirtualCamera or PinholeView
        Where there is glass, they only stand for the views, and points inherit what they are off; `triangulate`
        follows the true rays.
    pixels : (..., 2, 2) array
        The same point as each camera sees it, px of the photograph. Where a camera has distortion, the sum of squares
        is smallest in undistorted pixels, which is a little less than optimal.
    sigma : float
        Standard deviation of each pixel coordinate, px.

    Returns
    -------
    Points
        With residuals and covariance for pixels of the photograph. NaN where the point is behind a camera.

    References
    ----------
    Hartley and Sturm 1997, Triangulation; Lindstrom 2010, Triangulation made easy.
    """
    if len(cameras) != 2:
        raise ShapeError(f"this is for 2 cameras, got {len(cameras)}; triangulate takes any number")
    for camera in cameras:
        if not hasattr(camera, "camera_from_rig"):
            raise OpticError(
                f"{getattr(camera, 'name', '') or camera} is no pinhole camera: use triangulate, which follows its "
                "rays, or a virtual camera that stands for it (rigs.fit)"
            )
    pixels = as_correspondences(pixels, 2)
    if np.ndim(sigma):
        raise ShapeError("sigma must be one number: both cameras count the same here; triangulate takes one for each")
    as_noise(sigma, pixels)
    straight = np.stack([undistorted(c.camera, pixels[..., k, :]) for k, c in enumerate(cameras)], -2)
    corrected = nearest_pair(fundamental_matrix(*cameras), straight)
    points = nearest_point(_straight_rays(cameras, corrected)).points
    local = [camera.camera_from_rig @ points for camera in cameras]
    ahead = np.all([part[..., 2] > 0 for part in local], axis=0)
    photographed = np.stack([redistorted(c.camera, corrected[..., k, :]) for k, c in enumerate(cameras)], -2)
    residual = np.sqrt(((photographed - pixels) ** 2).mean((-1, -2)))
    covariance = _covariance(cameras, local) * sigma**2
    return kept(points, covariance, residual, np.isfinite(straight).all(-1).sum(-1), ahead)


def _covariance(cameras, local):
    """Covariance (..., 3, 3) mm^2 for noise of 1 px in the photograph, of points `local` (..., 3) in each camera.

    They minimise distances in undistorted pixels: N^-1 sum(A^T U U^T A) N^-1 with N = sum(A^T A), A (2, 3) from the
    point to the undistorted pixel and U (2, 2) from the pixel of the photograph to that.
    """
    information = spread = np.zeros((3, 3))
    for camera, points in zip(cameras, local, strict=True):
        lens = camera.camera
        straight = lens.with_lens([*lens.lens[:4], 0, 0, 0, 0, 0])
        to_rig = camera.camera_from_rig.rotation
        jacobian = pinhole_derivatives(straight, points, camera.mirrored)[1] @ to_rig
        flat = points[..., :2] / points[..., 2:] * ([-1, 1] if camera.mirrored else [1, 1])
        bend = lens_derivatives(lens, flat)[0] / lens.focal  # from undistorted pixels to those of the photograph
        known = np.isfinite(bend).all((-1, -2), keepdims=True)
        moves = np.einsum("...ij,...ik->...jk", jacobian, np.linalg.inv(np.where(known, bend, np.eye(2))))
        information = information + np.einsum("...ij,...ik->...jk", jacobian, jacobian)
        spread = spread + np.einsum("...ij,...kj->...ik", moves, moves)
    inverse = symmetric_inverse(information)
    return np.einsum("...ij,...jk,...kl->...il", inverse, spread, inverse)


def _normals(matrix, first, second):
    """Normals (..., 2, 2) of the epipolar lines through a pair, in the first and in the second picture."""
    in_first = np.einsum("...i,ij->...j", homogeneous(second), matrix)
    in_second = np.einsum("ij,...j->...i", matrix, homogeneous(first))
    return np.stack([in_first[..., :2], in_second[..., :2]], -2)


def _straight_rays(cameras, pixels):
    """Rays (..., 2) of undistorted pixels (..., 2, 2) of two cameras."""
    origins, directions = [], []
    for k, camera in enumerate(cameras):
        flat = (pixels[..., k, :] - camera.camera.centre) / camera.camera.focal
        local = homogeneous(flat) * ([-1, 1, 1] if camera.mirrored else [1, 1, 1])
        direction = local @ camera.camera_from_rig.rotation
        directions.append(direction / np.linalg.norm(direction, axis=-1, keepdims=True))
        origins.append(np.broadcast_to(camera.camera_from_rig.inverse.translation, direction.shape))
    return Rays(np.stack(origins, -2), np.stack(directions, -2))
