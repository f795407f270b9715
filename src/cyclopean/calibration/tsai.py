"""A camera from one photograph of known points: Tsai's method."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from ..errors import SetupError, ShapeError
from ..geometry import Pose, as_pixels, as_points, check_inside, rotation_from_vector, rotation_vector_jacobian
from .tsai_camera import TsaiCamera, distort
from .tsai_closed_form import coplanar as coplanar_start
from .tsai_closed_form import non_coplanar as non_coplanar_start

PARAMETERS = (
    "focal", "k1", "k2", "scale", "centre_x", "centre_y", "turn_x", "turn_y", "turn_z", "move_x", "move_y", "move_z",
)  # fmt: skip
_FLAT = 0.01  # of the target's extent: a target this flat starts as a plane
_FACING_DEG = 1.0  # a plane tilted by less faces the camera, as far as a picture tells
_UNSURE = 0.02  # relative standard deviation of the focal length that deserves a note
_UNKNOWN = 0.25  # and the one that makes it worthless
_LEAST_SIGMA = 1e-3  # px: smaller residuals are rounding, and would make anything look certain


@dataclass(frozen=True, eq=False)
class TsaiCalibration:
    """A camera and its pose as one photograph of known points shows them, and how surely."""

    camera: TsaiCamera
    camera_from_target: Pose
    residuals: np.ndarray  # (N, 2) px, observed - predicted; NaN in rows that are not numbers
    names: tuple[str, ...]  # (F,) what was found, out of `PARAMETERS`
    covariance: np.ndarray  # (F, F), scaled by the residuals; a turn is about the camera's axes
    coplanar: bool  # whether the points were taken as those of a plane
    tilt_deg: float  # of a plane against the picture; NaN for a solid
    converged: bool
    message: str
    notes: tuple[str, ...] = ()  # what to know before trusting it

    @property
    def sigma(self) -> dict[str, float]:
        """Standard deviation of each parameter that was found: focal as the camera's, px, rad, mm."""
        return dict(zip(self.names, np.sqrt(np.diag(self.covariance)).tolist(), strict=True))

    @property
    def rms(self) -> float:
        """Root mean square length of the residuals, px."""
        return float(np.sqrt(np.nanmean(np.sum(self.residuals**2, axis=-1))))

    @property
    def angles(self) -> np.ndarray:
        """Yaw, pitch and tilt (3,) rad of the pose; see `rotation_from_angles`."""
        return angles_from_rotation(self.camera_from_target.rotation)


def rotation_from_angles(yaw: float, pitch: float, tilt: float) -> np.ndarray:
    """The rotation camera_from_target (3, 3) of Tsai's angles, rad.

    The target is turned by -tilt about z, then by -yaw about y, then by -pitch about x, the camera's axes:
    R = Rx(-pitch) Ry(-yaw) Rz(-tilt) with right-handed turns. Its first row is
    (cos yaw cos tilt, cos yaw sin tilt, -sin yaw).

    References
    ----------
    Tsai 1987, the rotation of the camera model, with yaw theta, pitch phi, tilt psi.
    """
    return (
        rotation_from_vector([-pitch, 0.0, 0.0])
        @ rotation_from_vector([0.0, -yaw, 0.0])
        @ rotation_from_vector([0.0, 0.0, -tilt])
    )


def angles_from_rotation(rotation: np.ndarray) -> np.ndarray:
    """Yaw in [-pi/2, pi/2], pitch and tilt (3,) rad of a rotation (3, 3); see `rotation_from_angles`."""
    r = rotation
    return np.array(
        [np.arctan2(-r[0, 2], np.hypot(r[0, 0], r[0, 1])), np.arctan2(r[1, 2], r[2, 2]), np.arctan2(r[0, 1], r[0, 0])]
    )


def tsai(
    points: ArrayLike,
    pixels: ArrayLike,
    size: tuple[int, int],
    *,
    centre: Sequence[float] | None = None,
    pitch: float | tuple[float, float] = 1.0,
    distortion: int = 1,
    scale: float = 1.0,
    free_scale: bool = False,
    free_centre: bool = False,
    coplanar: bool | None = None,
) -> TsaiCalibration:
    """Calibrate a camera from one photograph of known points.

    Radial alignment gives the pose in closed form, least squares focal length and distance; then focal length,
    distance and distortion, and at last all parameters together, are refined on the pixels by least squares.

    Parameters
    ----------
    points : (N, 3) array
        Known points, mm, in the target's frame: 7 or more of a solid, 5 or more of a plane.
    pixels : (N, 2) array
        Where the photograph shows them; rows that are NaN are left out.
    size : (2,) int
        Width and height of the photograph, px.
    centre : (2,), optional
        Principal point, px, which Tsai takes as known; mid-image without it. For a sub-image, its own.
    pitch : float or (2,)
        Distance of pixels, mm. With 1 the focal length comes in px.
    distortion : 0, 1 or 2
        How many of k1, k2 to find.
    scale : float
        Horizontal scale factor s_x, where it is known.
    free_scale, free_centre : bool
        Whether to find s_x, and to refine the principal point; either takes points that are not in a plane.
    coplanar : bool, optional
        Whether the points start as those of a plane; by default, where they nearly are.

    Returns
    -------
    TsaiCalibration

    Raises
    ------
    SetupError
        Too few points, points that leave the camera open, or a plane that faces the camera: then focal length and
        distance cannot be told apart.
    ShapeError
        Arrays of other shapes, or pixels that lie outside the photograph.

    References
    ----------
    Tsai 1987, A versatile camera calibration technique for high-accuracy 3D machine vision metrology using
    off-the-shelf TV cameras and lenses, IEEE J. Robotics and Automation 3(4):323-344.
    """
    data = _Data.of(points, pixels, coplanar)
    check_inside(data.pixels, size)
    if distortion not in (0, 1, 2):
        raise SetupError(f"distortion must be 0, 1 (k1) or 2 (k1, k2), got {distortion!r}")
    if data.coplanar and (free_scale or free_centre):
        raise SetupError(
            "one photograph of a plane tells neither the scale s_x nor the principal point: use points of a solid, or "
            "free_scale=False, free_centre=False"
        )
    pitches = (float(pitch), float(pitch)) if isinstance(pitch, int | float) else (float(pitch[0]), float(pitch[1]))
    middle = ((size[0] - 1) / 2, (size[1] - 1) / 2) if centre is None else (float(centre[0]), float(centre[1]))
    camera = TsaiCamera(size, 1.0, middle, scale=scale, pitch=pitches)
    found, pose = _closed_form(data, camera, free_scale)
    lens = ("focal", *("k1", "k2")[:distortion])
    found, pose = _refined(found, pose, (*lens, "move_z"), data)[:2]
    free = lens + ("scale",) * free_scale + ("centre_x", "centre_y") * free_centre + PARAMETERS[6:]
    return _finish(_refined(found, pose, free, data), free, data)


class _Data(NamedTuple):
    """What was given, checked."""

    rows: np.ndarray  # (N,) bool, which rows are numbers
    points: np.ndarray  # (M, 3) mm
    pixels: np.ndarray  # (M, 2)
    coplanar: bool
    frame: Pose  # plane_from_target: the best plane is z = 0

    @classmethod
    def of(cls, points, pixels, coplanar):
        points, pixels = as_points(points), as_pixels(pixels)
        if points.ndim != 2 or pixels.shape != (len(points), 2):
            raise ShapeError(f"wanted points (N, 3) and pixels (N, 2), got {points.shape} and {pixels.shape}")
        rows = np.isfinite(points).all(-1) & np.isfinite(pixels).all(-1)
        points, pixels = points[rows], pixels[rows]
        extents = np.zeros(3)
        if len(points) >= 3:
            middle = points.mean(0)
            _, extents, axes = np.linalg.svd(points - middle)
            axes = axes * [[1.0], [1.0], [np.linalg.det(axes)]]
        flat = bool(extents[2] <= _FLAT * extents[0]) if coplanar is None else coplanar
        least = 5 if flat else 7
        if len(points) < least:
            raise SetupError(
                f"{len(points)} points that are numbers; Tsai's method takes at least 5 of a plane or 7 of a solid"
            )
        if extents[1] <= 1e-6 * extents[0]:
            raise SetupError("the points lie on a line: they tell no camera")
        return cls(rows, points, pixels, flat, Pose(axes, -axes @ middle))


def _closed_form(data, camera, free_scale):
    sensor = camera.sensor(data.pixels)
    if data.coplanar:
        start = coplanar_start((data.frame @ data.points) * [1, 1, 0], sensor)
        return replace(camera, focal=start.focal), start.pose @ data.frame
    if free_scale:
        camera = replace(camera, scale=1.0)
        sensor = camera.sensor(data.pixels)
    start = non_coplanar_start(data.points, sensor, free_scale)
    return replace(camera, focal=start.focal, scale=camera.scale * start.scale), start.pose


class _Fit(NamedTuple):
    camera: TsaiCamera
    pose: Pose
    residuals: np.ndarray  # (M, 2) px, observed - predicted
    jacobian: np.ndarray  # (2 M, F), of the pixels
    converged: bool
    message: str


def _refined(camera, pose, free, data):
    """Camera and pose that explain the pixels best, some parameters free."""
    from scipy.optimize import least_squares

    columns = [PARAMETERS.index(name) for name in free]
    start = np.array([camera.focal, camera.k1, camera.k2, camera.scale, *camera.centre, 0, 0, 0, *pose.translation])

    def unpacked(values):
        full = start.copy()
        full[columns] = values
        return full

    def miss(values):
        return (_predicted(unpacked(values), pose, camera, data.points)[0] - data.pixels).ravel()

    def slope(values):
        derivatives = _predicted(unpacked(values), pose, camera, data.points, True)[1]
        return derivatives[..., columns].reshape(-1, len(columns))

    tight = dict(ftol=1e-15, xtol=1e-15, gtol=1e-15)
    found = least_squares(miss, start[columns], slope, x_scale="jac", max_nfev=200, **tight)
    full = unpacked(found.x)
    turned = Pose(rotation_from_vector(full[6:9]) @ pose.rotation, full[9:])
    camera = replace(camera, focal=full[0], k1=full[1], k2=full[2], scale=full[3], centre=tuple(full[4:6]))
    return _Fit(camera, turned, -found.fun.reshape(-1, 2), found.jac, found.status > 0, found.message)


def _predicted(full, base, camera, points, jacobian=False):
    """Pixels (N, 2) of the points, with derivatives (N, 2, 12) in the order of `PARAMETERS`."""
    focal, k1, k2, scale, *centre = full[:6]
    turned = points @ (rotation_from_vector(full[6:9]) @ base.rotation).T
    local = turned + full[9:]
    trial = TsaiCamera(camera.size, abs(focal), (0.0, 0.0), k1, k2)
    flat = local[:, :2] / np.where(local[:, 2:] > 0, local[:, 2:], np.nan)
    if not (focal > 0 and scale > 0):
        flat = flat * np.nan
    seen = distort(focal * flat, k1, k2, trial.fold_radius)
    to_pixel = np.array([scale / camera.pitch[0], 1 / camera.pitch[1]])
    pixels = seen * to_pixel + centre
    if not jacobian:
        return pixels, None
    square = np.sum(seen**2, -1)[:, None, None]
    spread = 2 * k1 + 4 * k2 * square
    stretch = (1 + square * (k1 + square * k2)) * np.eye(2) + spread * seen[:, :, None] * seen[:, None, :]
    inverse = np.linalg.inv(stretch) * to_pixel[:, None]  # pixel by undistorted coordinate
    depth = local[:, 2, None, None]
    to_point = np.concatenate([np.broadcast_to(np.eye(2), (len(seen), 2, 2)), -flat[..., None]], -1) * focal / depth
    to_turn = np.cross(turned[:, None, :], to_point) @ rotation_vector_jacobian(full[6:9])
    bent = seen[..., None] * square
    to_flat = np.concatenate([flat[..., None], -bent, -bent * square], -1)
    derivatives = np.zeros((len(seen), 2, 12))
    derivatives[..., :3] = inverse @ to_flat
    derivatives[:, 0, 3] = seen[:, 0] / camera.pitch[0]
    derivatives[:, 0, 4] = derivatives[:, 1, 5] = 1.0
    derivatives[..., 6:9], derivatives[..., 9:] = inverse @ to_turn, inverse @ to_point
    return pixels, derivatives


def _finish(fit, free, data):
    camera, pose, residuals, jacobian, converged, message = fit
    freedom = max(residuals.size - len(free), 1)
    variance = np.sum(residuals**2) / freedom
    cofactor = _cofactor(jacobian)
    known = np.sqrt(max(variance, _LEAST_SIGMA**2) * cofactor[0, 0]) / camera.focal  # focal comes first
    normal = (pose @ data.frame.inverse).rotation[:, 2]
    tilt_deg = float(np.degrees(np.arccos(min(abs(normal[2]), 1.0)))) if data.coplanar else np.nan
    leaning = f"; the plane is tilted by {tilt_deg:.1f} deg, 30 or more would tell" if data.coplanar else ""
    if not known < _UNKNOWN or tilt_deg < _FACING_DEG:
        raise SetupError(
            f"focal length and distance cannot be told apart (focal length known to {100 * known:.2g} %){leaning}"
        )
    notes = [] if data.rows.all() else [f"{np.count_nonzero(~data.rows)} points are not numbers: left out"]
    if residuals.size == len(free):
        notes.append("no more pixels than unknowns: nothing says how good the fit is")
    if known > _UNSURE:
        notes.append(f"focal length is known to {100 * known:.1f} % only{leaning}")
    corners = np.array([[0, 0], [1, 0], [0, 1], [1, 1]]) * (np.array(camera.size) - 1)
    if not np.isfinite(camera.normalise(corners)).all():
        notes.append("the lens model folds over inside the picture, beyond the points: use more of it, or fewer terms")
    full = np.full((len(data.rows), 2), np.nan)
    full[data.rows] = residuals
    return TsaiCalibration(
        camera, pose, full, tuple(free), variance * cofactor, data.coplanar, tilt_deg, bool(converged), message,
        tuple(notes),
    )  # fmt: skip


def _cofactor(jacobian):
    """Inverse (F, F) of the normal matrix; infinite where the pixels do not tell."""
    size = np.linalg.norm(jacobian, axis=0)
    if not (size > 0).all():
        return np.full((len(size), len(size)), np.inf)
    _, values, vectors = np.linalg.svd(jacobian / size, full_matrices=False)
    if values[-1] < 1e-12 * values[0]:
        return np.full((len(size), len(size)), np.inf)
    half = vectors.T / values / size[:, None]
    return half @ half.T
