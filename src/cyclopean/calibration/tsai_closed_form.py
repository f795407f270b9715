"""The closed form of Tsai's method: pose by radial alignment, then focal length and distance, without distortion."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..errors import SetupError
from ..geometry import Pose

_RANK = 1e-9  # of the largest singular value: below, the points leave the pose open


class ClosedForm(NamedTuple):
    """First values of Tsai's method."""

    pose: Pose  # camera_from_target
    focal: float  # in the unit of the sensor coordinates
    scale: float  # s_x


def coplanar(points: np.ndarray, sensor: np.ndarray) -> ClosedForm:
    """Pose and focal length from points of the plane z = 0 (N, 3) mm, N >= 5, and where the sensor sees them (N, 2).

    Sensor coordinates are distorted, from the principal point, x divided by the known scale. Radial distortion does
    not turn the direction from the principal point to a point, so Yd x = Xd y in the camera's frame (radial alignment
    constraint), which is linear in (r1, r2, Tx, r4, r5, Ty). We solve it as a homogeneous system, so that Ty = 0,
    where Tsai's division by Ty fails, needs no care.

    References
    ----------
    Tsai 1987, monoview coplanar set of points, stages 1 and 2.
    """
    shift, size = points.mean(0), np.abs(points - points.mean(0)).max()
    x, y, _ = ((points - shift) / size).T
    xd, yd = (sensor / np.abs(sensor).max()).T
    one = np.ones_like(x)
    a = _null(np.stack([yd * x, yd * y, yd, -xd * x, -xd * y, -xd], -1))
    block = np.array([[a[0], a[1]], [a[3], a[4]]])
    total, product = np.sum(block**2), np.linalg.det(block)
    length = np.sqrt((total + np.sqrt(max(total**2 - 4 * product**2, 0.0))) / 2)  # the rows are part of unit vectors
    a = a / length * _sign(a[0] * x + a[1] * y + a[2] * one, a[3] * x + a[4] * y + a[5] * one, xd, yd)
    r1, r2, tx, r4, r5, ty = a
    r3, r6 = _third(np.array([r1, r2]), np.array([r4, r5]))
    best = None
    for turn in (1.0, -1.0):  # the plane may lean either way; only one makes the focal length positive
        rotation = _orthonormal(np.array([[r1, r2, turn * r3], [r4, r5, turn * r6]]))
        pose, focal = _focal(rotation, tx * size, ty * size, points - shift, sensor)
        if focal > 0 and pose.translation[2] > 0:
            best = ClosedForm(pose @ Pose(np.eye(3), -shift), focal, 1.0)
    if best is None:
        raise SetupError(
            "focal length and distance cannot be told apart: the plane stands parallel to the picture; tilt it by 30 "
            "deg or more (Tsai 1987)"
        )
    return best


def non_coplanar(points: np.ndarray, sensor: np.ndarray, free_scale: bool) -> ClosedForm:
    """Pose, focal length and scale from points (N, 3) mm, N >= 7, and where the sensor sees them (N, 2).

    As `coplanar`; the linear unknowns are (s r1, s r2, s r3, s Tx, r4, r5, r6, Ty), s the scale, 1 if it is not free.

    References
    ----------
    Tsai 1987, monoview noncoplanar set of points, stages 1 and 2.
    """
    shift, size = points.mean(0), np.abs(points - points.mean(0)).max()
    local = np.column_stack([(points - shift) / size, np.ones(len(points))])
    xd, yd = (sensor / np.abs(sensor).max()).T
    a = _null(np.column_stack([yd[:, None] * local, -xd[:, None] * local]))
    a = a * _sign(local @ a[:4], local @ a[4:], xd, yd)
    first, second = np.linalg.norm(a[:3]), np.linalg.norm(a[4:7])
    if not min(first, second) > _RANK:
        raise SetupError("the points leave the pose open: they lie on a line, or on one through the principal point")
    scale = float(first / second) if free_scale else 1.0
    rotation = _orthonormal(np.array([a[:3] / first, a[4:7] / second]))
    pose, focal = _focal(rotation, a[3] / first * size, a[7] / second * size, points - shift, sensor / [scale, 1.0])
    if not (focal > 0 and pose.translation[2] > 0):
        raise SetupError(
            "the points and their pixels do not fit a camera that looks at them: are points and pixels in the same "
            "order, is the target's frame left-handed or the picture mirrored, is the principal point right?"
        )
    return ClosedForm(pose @ Pose(np.eye(3), -shift), focal, scale)


def _third(first, second):
    """Third components of two unit vectors at right angles, of which two components are known; one sign is open.

    The larger one follows from the length, the other from the right angle: a root of nearly 0 would lose digits.
    """
    one, two = (np.sqrt(max(1 - row @ row, 0.0)) for row in (first, second))
    if max(one, two) == 0:
        return 0.0, 0.0
    return (one, -(first @ second) / one) if one > two else (-(first @ second) / two, two)


def _null(rows):
    """The unit vector that the rows (N, M) send nearest to 0."""
    size = np.linalg.norm(rows, axis=0)
    if (size > 0).all():
        _, values, vectors = np.linalg.svd(rows / size)
        if len(values) >= rows.shape[1] - 1 and values[rows.shape[1] - 2] > _RANK * values[0]:
            return vectors[-1] / size
    raise SetupError("the points leave the pose open: they are too few, on a line, or in a plane taken for a solid")


def _sign(x, y, xd, yd):
    """+1 or -1, so that points are seen on their own side of the principal point: Tsai's rule, by all points."""
    return np.sign(np.sum(x * xd + y * yd)) or 1.0


def _orthonormal(rows):
    """The rotation (3, 3) whose first two rows are nearest to those given (2, 3)."""
    u, _, v = np.linalg.svd(rows, full_matrices=False)
    first, second = u @ v
    return np.array([first, second, np.cross(first, second)])


def _focal(rotation, tx, ty, points, sensor):
    """Focal length and Tz by least squares: f x = Xd (w + Tz), f y = Yd (w + Tz), without distortion."""
    turned = points @ rotation.T
    across = turned[:, :2] + [tx, ty]
    rows = np.stack([across, -sensor], -1).reshape(-1, 2)
    wanted = (sensor * turned[:, 2:]).ravel()
    size = np.linalg.norm(rows, axis=0)
    focal, tz = np.linalg.lstsq(rows / size, wanted)[0] / size
    return Pose(rotation, np.array([tx, ty, tz])), float(focal)
