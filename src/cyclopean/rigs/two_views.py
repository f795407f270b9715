"""Two pinhole cameras: the matrices that tie their pixels together."""

from __future__ import annotations

from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike

from ..cameras import Camera
from ..errors import OpticError
from ..geometry import Pose, as_pixels


class Pinhole(Protocol):
    """A camera with one centre: a `VirtualCamera` or a `PinholeView`."""

    @property
    def camera(self) -> Camera:
        """Its lens."""
        ...

    @property
    def camera_from_rig(self) -> Pose:
        """Where it stands."""
        ...

    @property
    def mirrored(self) -> bool:
        """True when x of its own frame is flipped before it projects."""
        ...


def homogeneous(pixels: np.ndarray) -> np.ndarray:
    """Pixels (..., 2) with a third coordinate of 1, (..., 3)."""
    return np.concatenate([pixels, np.ones((*pixels.shape[:-1], 1))], -1)


def essential_matrix(first: Pinhole, second: Pinhole) -> np.ndarray:
    """The matrix E (3, 3) with ``y2 @ E @ y1 = 0`` for undistorted normalised coordinates y = (x/z, y/z, 1).

    Parameters
    ----------
    first, second : VirtualCamera or PinholeView
        Two cameras with different centres. One or both may be mirrored; E then holds for pictures as they are seen,
        not flipped back.

    Returns
    -------
    (3, 3) array
        ``cross(b) @ M``, where points of the first camera's frame go to ``M @ y + b`` in the second's; mm. Between
        two cameras of which just one is mirrored M is a rotation and a flip.

    Raises
    ------
    OpticError
        When both have the same centre: every pixel then has one partner, and no line.

    References
    ----------
    Longuet-Higgins 1981, A computer algorithm for reconstructing a scene from two projections.
    """
    turn = second.camera_from_rig @ first.camera_from_rig.inverse
    flips = [np.diag([-1.0 if camera.mirrored else 1.0, 1.0, 1.0]) for camera in (first, second)]
    x, y, z = baseline = flips[1] @ turn.translation
    reach = max(np.linalg.norm(camera.camera_from_rig.translation) for camera in (first, second))
    if not np.linalg.norm(baseline) > 1e-12 * reach:  # roundings
        raise OpticError("two cameras with the same centre have no epipolar lines")
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return cross @ flips[1] @ turn.rotation @ flips[0]


def fundamental_matrix(first: Pinhole, second: Pinhole) -> np.ndarray:
    """The matrix F (3, 3) with ``x2 @ F @ x1 = 0`` for undistorted pixels x = (x, y, 1); its norm is 1.

    It holds for undistorted pixels: where a camera has distortion, `undistorted` makes them. Otherwise as
    `essential_matrix`.

    References
    ----------
    Luong and Faugeras 1996, The fundamental matrix; Hartley and Zisserman, Multiple View Geometry, eq. 9.12.
    """
    matrix = essential_matrix(first, second)
    left, right = np.linalg.inv(second.camera.matrix), np.linalg.inv(first.camera.matrix)
    fundamental = left.T @ matrix @ right
    return fundamental / np.linalg.norm(fundamental)


def undistorted(camera: Camera, pixels: ArrayLike) -> np.ndarray:
    """Pixels (..., 2) as the camera would take them without distortion: those that lines and F hold for.

    NaN beyond the fold of the lens.
    """
    return camera.normalise(pixels) * camera.focal + camera.centre


def redistorted(camera: Camera, pixels: ArrayLike) -> np.ndarray:
    """Pixels (..., 2) of the photograph for undistorted ones: the inverse of `undistorted`."""
    return camera.denormalise((as_pixels(pixels) - camera.centre) / camera.focal)
