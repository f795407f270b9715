"""Rigid motions, named by the frames that they connect: ``points_b = b_from_a @ points_a``."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike


@dataclass(frozen=True, eq=False)
class Pose:
    """A rigid motion ``b_from_a``: turns coordinates in frame a into coordinates in frame b.

    ``b_from_a @ points`` moves points (..., 3); ``c_from_b @ b_from_a`` is ``c_from_a``.
    """

    rotation: np.ndarray  # (3, 3)
    translation: np.ndarray  # (3,) mm

    def __matmul__(self, other):
        if isinstance(other, Pose):
            return Pose(self.rotation @ other.rotation, self @ other.translation)
        return np.asarray(other, dtype=float) @ self.rotation.T + self.translation

    @property
    def inverse(self) -> Pose:
        """The motion back: ``b_from_a.inverse`` is ``a_from_b``."""
        return Pose(self.rotation.T, -self.rotation.T @ self.translation)

    @classmethod
    def from_rotation_vector(cls, vector: ArrayLike, translation: ArrayLike = (0.0, 0.0, 0.0)) -> Pose:
        """A pose from a rotation vector (3,) rad and a translation (3,) mm."""
        return cls(rotation_from_vector(vector), np.asarray(translation, dtype=float))


def rotation_from_vector(vector: ArrayLike) -> np.ndarray:
    """Rotation matrix (3, 3) of a rotation vector (3,) rad: axis times angle."""
    from scipy.spatial.transform import Rotation

    return Rotation.from_rotvec(np.asarray(vector, dtype=float)).as_matrix()


def rotation_vector(rotation: ArrayLike) -> np.ndarray:
    """Rotation vector (3,) rad, its angle at most pi, of a rotation matrix (3, 3)."""
    from scipy.spatial.transform import Rotation

    return Rotation.from_matrix(np.asarray(rotation, dtype=float)).as_rotvec()


def rotation_vector_jacobian(vector: ArrayLike) -> np.ndarray:
    """Left Jacobian (3, 3) of a rotation vector (3,) rad.

    To first order ``exp(vector + step) = exp(jacobian @ step) exp(vector)``, so a rotated vector n
    changes by ``cross(jacobian @ step, n)``.

    References
    ----------
    Sola, Deray, Atchuthan 2018, A micro Lie theory for state estimation in robotics, eq. 145.
    """
    vector = np.asarray(vector, dtype=float)
    x, y, z = vector
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    angle = np.linalg.norm(vector)
    if angle < 1e-4:  # series, so that the quotients below never lose digits
        first, second = 0.5 - angle**2 / 24, 1 / 6 - angle**2 / 120
    else:
        first, second = (1 - np.cos(angle)) / angle**2, (angle - np.sin(angle)) / angle**3
    return np.eye(3) + first * cross + second * cross @ cross


def shortest_rotation(start: ArrayLike, end: ArrayLike) -> np.ndarray:
    """The rotation (3, 3) by the smallest angle that takes direction `start` (3,) into `end` (3,)."""
    start = np.asarray(start, dtype=float) / np.linalg.norm(start)
    end = np.asarray(end, dtype=float) / np.linalg.norm(end)
    axis = np.cross(start, end)
    sine, cosine = np.linalg.norm(axis), float(start @ end)
    if sine < 1e-15:
        if cosine > 0:
            return np.eye(3)
        axis = np.cross(start, np.eye(3)[np.argmin(np.abs(start))])
        return rotation_from_vector(np.pi * axis / np.linalg.norm(axis))
    return rotation_from_vector(np.arctan2(sine, cosine) * axis / sine)


def nearest_rotation(matrix: ArrayLike) -> np.ndarray:
    """The rotation (3, 3) nearest to a matrix (3, 3), by least squares.

    Of ``end.T @ start`` it is the rotation that takes vectors `start` (K, 3) nearest to `end` (K, 3).

    References
    ----------
    Kabsch 1976, A solution for the best rotation to relate two sets of vectors; Umeyama 1991 for the sign.
    """
    left, _, right = np.linalg.svd(np.asarray(matrix, dtype=float))
    return left @ np.diag([1.0, 1.0, np.linalg.det(left @ right)]) @ right


def rigid_motion(start: ArrayLike, end: ArrayLike) -> Pose:
    """The motion end_from_start that takes points (K, 3) nearest to other points (K, 3), by least squares.

    Rows with NaN do not count.
    """
    start, end = np.asarray(start, dtype=float), np.asarray(end, dtype=float)
    good = np.isfinite(start).all(-1) & np.isfinite(end).all(-1)
    start, end = start[good], end[good]
    middle, there = start.mean(0), end.mean(0)
    rotation = nearest_rotation((end - there).T @ (start - middle))
    return Pose(rotation, there - rotation @ middle)
