"""The pinhole that stands for a view where its picture is to be rectified."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..errors import OpticError
from ..geometry import Pose, Rays
from ..rigs import ViewLike, fit

_SAMPLES, _DEPTHS = 24, 5  # samples across a sub-image, and depths, that a pinhole is fitted to
_FLIP = np.diag([-1.0, 1.0, 1.0])


@dataclass(frozen=True, eq=False)
class TiltedPinhole:
    """A pinhole with OpenCV's radial, tangential, thin-prism and tilt terms.

    A wedge shears the picture, which thin-prism and tilt terms can follow and the others cannot. In a mirrored view
    x of the pinhole's own frame is flipped before it projects, so that its pose is a rotation all the same.
    """

    matrix: np.ndarray  # (3, 3) px
    distortion: np.ndarray  # (14,) in OpenCV's order
    camera_from_rig: Pose
    mirrored: bool
    departure_rms: float  # px, from the true view where it was fitted
    departure_max: float  # px

    @property
    def centre(self) -> np.ndarray:
        """Optical centre (3,) mm in the rig frame."""
        return self.camera_from_rig.inverse.translation

    @property
    def axis(self) -> np.ndarray:
        """Direction (3,) of the optical axis in the rig frame."""
        return self.camera_from_rig.rotation[2]

    @property
    def flip(self) -> np.ndarray:
        """What (3, 3) changes the sign of x where the view is mirrored."""
        return _FLIP if self.mirrored else np.eye(3)

    def project(self, points: np.ndarray) -> np.ndarray:
        """Pixels (..., 2) of points (..., 3) mm in the rig frame; what lies behind it comes out upside down."""
        local = (self.camera_from_rig @ points) @ self.flip
        with np.errstate(divide="ignore", invalid="ignore"):
            flat = local[..., :2] / local[..., 2:]
        return _distorted(flat, self.distortion) @ self.matrix[:2, :2].T + self.matrix[:2, 2]

    def rays(self, pixels: np.ndarray) -> Rays:
        """Rays (N,) of pixels (N, 2) in the rig frame."""
        import cv2

        pixels = np.asarray(pixels, dtype=float)
        criteria = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_COUNT, 100, 1e-12)
        slopes = cv2.undistortPoints(pixels[:, None], self.matrix, self.distortion, criteria=criteria)[:, 0]
        local = np.concatenate([slopes, np.ones((len(pixels), 1))], axis=-1)
        directions = local @ self.flip @ self.camera_from_rig.rotation
        directions /= np.linalg.norm(directions, axis=-1, keepdims=True)
        return Rays(np.broadcast_to(self.centre, directions.shape), directions)


def tilted_pinhole(view: ViewLike, depths: tuple[float, float]) -> TiltedPinhole:
    """The pinhole that fits the true rays of a view best, in px, between two depths.

    Parameters
    ----------
    view : View
        The view to stand for; it may be mirrored.
    depths : (2,) mm
        Nearest and farthest depth; samples lie evenly in inverse depth between them.

    Raises
    ------
    OpticError
        Where too few rays of the view reach these depths.

    Notes
    -----
    OpenCV's rational terms are left out, which add nothing here but folds.
    """
    import cv2
    from scipy.optimize import least_squares

    start = fit(view, depths)
    points, pixels = _samples(view, depths)
    flip = _FLIP if view.mirrored else np.eye(3)
    points = points @ flip  # OpenCV knows no mirrors: what x of the camera's frame must do, x of the rig's does
    rotation = flip @ start.camera_from_rig.rotation @ flip
    shift = flip @ start.camera_from_rig.translation
    first = np.concatenate([cv2.Rodrigues(rotation)[0].ravel(), shift, start.camera.lens, np.zeros(9)])
    free = np.delete(np.arange(24), [15, 16, 17])  # not k4, k5, k6
    scale = np.repeat([1e-3, 1.0, 10.0, 0.1], [3, 3, 4, 11])

    def unpacked(change):
        x = first.copy()
        x[free] += change * scale
        return x[:3], x[3:6], np.array([[x[6], 0, x[8]], [0, x[7], x[9]], [0, 0, 1]]), x[10:]

    def miss(change):
        return (cv2.projectPoints(points, *unpacked(change))[0][:, 0] - pixels).ravel()

    def derivatives(change):
        return cv2.projectPoints(points, *unpacked(change))[1][:, free] * scale

    found = least_squares(miss, np.zeros(len(free)), derivatives, method="lm", max_nfev=200)
    turn, shift, matrix, distortion = unpacked(found.x)
    pose = Pose(flip @ cv2.Rodrigues(turn)[0] @ flip, flip @ shift)
    off = np.linalg.norm(found.fun.reshape(-1, 2), axis=-1)
    return TiltedPinhole(matrix, distortion, pose, view.mirrored, float(np.sqrt(np.mean(off**2))), float(off.max()))


def _distorted(flat, distortion):
    """What `cv2.projectPoints` does to (x / z, y / z) (..., 2), without its derivatives: they take most of its time."""
    k1, k2, p1, p2, k3, _, _, _, s1, s2, s3, s4, turn_x, turn_y = distortion  # no rational terms
    x, y = flat[..., 0], flat[..., 1]
    r2 = x * x + y * y
    radial = 1 + r2 * (k1 + r2 * (k2 + r2 * k3))
    u = x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x * x) + r2 * (s1 + r2 * s2)
    v = y * radial + p1 * (r2 + 2 * y * y) + 2 * p2 * x * y + r2 * (s3 + r2 * s4)
    about_x = np.array([[1, 0, 0], [0, np.cos(turn_x), np.sin(turn_x)], [0, -np.sin(turn_x), np.cos(turn_x)]])
    about_y = np.array([[np.cos(turn_y), 0, -np.sin(turn_y)], [0, 1, 0], [np.sin(turn_y), 0, np.cos(turn_y)]])
    turn = about_y @ about_x
    (a, b, c), (d, e, f), (g, h, i) = (
        np.array([[turn[2, 2], 0, -turn[0, 2]], [0, turn[2, 2], -turn[1, 2]], [0, 0, 1]]) @ turn
    )
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.stack([a * u + b * v + c, d * u + e * v + f], -1) / (g * u + h * v + i)[..., None]


def _samples(view, depths):
    """Points (N, 3) on the true rays of a view, evenly in inverse depth, and the pixels (N, 2) that see them."""
    x, y, width, height = view.region.box
    step = max(width, height) / _SAMPLES
    pixels = np.stack(np.meshgrid(np.arange(x, x + width, step), np.arange(y, y + height, step)), -1).reshape(-1, 2)
    pixels = pixels[view.region.contains(pixels)]
    rays = view.rays(pixels)
    points = np.concatenate([rays.at_depth(1 / w) for w in np.linspace(1 / depths[1], 1 / depths[0], _DEPTHS)])
    good = np.isfinite(points).all(-1)
    if np.count_nonzero(good) < 24:  # as many as there are unknowns
        raise OpticError(f"{view.name}: too few rays reach the depths {depths[0]:g} to {depths[1]:g} mm")
    return points[good], np.tile(pixels, (_DEPTHS, 1))[good]
