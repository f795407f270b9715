"""A target that the camera never sees directly, from photographs of a mirror in several poses."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations

import numpy as np

from ..cameras import Camera
from ..errors import SetupError
from ..geometry import Pose, nearest_rotation, rotation_from_vector, rotation_vector_jacobian
from ..rigs.pinhole import pinhole_derivatives
from ..targets import Observations, Target
from .reflections import ENOUGH, apparent_poses, check_rows

_ALIKE = np.deg2rad(1.0)  # mirrors that stand nearer to parallel tell nothing about where the target is
_LOST = 1e6  # residual of a point that a step puts behind the camera


@dataclass(frozen=True, eq=False)
class ReflectedBoard:
    """Where a target stands that is only seen in mirrors, and the mirror of each photograph."""

    pose: Pose  # camera_from_target
    planes: np.ndarray  # (B, 4): unit normal away from the camera, distance from the pinhole (mm)
    covariance: np.ndarray  # (6 + 3 B,) squared: pose (rotation rad, translation mm, in the camera's frame), then for
    # each mirror the image of the pinhole in it, 2 offset normal (mm)
    residuals: np.ndarray  # (N, 2) px, observed - predicted
    start_residuals: np.ndarray  # (N, 2) px, of the linear solution
    sigma0: float  # what the stated sigmas of the pixels must be multiplied by to explain the residuals
    converged: bool
    message: str

    @property
    def rms(self) -> float:
        """Root mean square of the residuals' coordinates, px."""
        return float(np.sqrt(np.mean(self.residuals**2)))


def board_from_reflections(observations: Observations, target: Target, camera: Camera) -> ReflectedBoard:
    """Find a target that is never seen directly, from photographs of a plane mirror in three or more poses.

    Two images of one point differ by a vector square to the line in which their two mirrors meet, so the images of
    the whole target give that line's direction, and the directions of three mirrors or more give the normals
    (Takahashi et al.); the more two mirrors differ, the more the direction of their line counts. The target's pose
    and the distances follow linearly; then all are refined together, which minimises the residuals in the
    photographs.

    Parameters
    ----------
    observations : Observations
        N rows; each photograph shows the target in a mirror of its own, whatever the number of the view.
    target : Target
        The known object.
    camera : Camera
        Known.

    Returns
    -------
    ReflectedBoard

    Raises
    ------
    SetupError
        Fewer than three photographs with four points or more; or mirrors so nearly parallel, or turned about one
        axis only, that the target could stand anywhere.
    ShapeError
        Pixels that are not numbers, or points that the target does not have.

    References
    ----------
    Sturm and Bonfort 2006, How to compute the pose of an object without a direct view? Rodrigues, Barreto, Nunes
    2010, Camera pose estimation using images of planar mirror reflections. Takahashi, Nobuhara, Matsuyama 2012, A
    new mirror-based extrinsic camera calibration using an orthogonality constraint, section 4.
    """
    points = np.asarray(target.points, dtype=float)
    check_rows(observations, points)
    pose, centres = _linear(_least_skew(_guesses(observations, points, camera)))
    return _refined(observations, points[observations.point], camera, pose, centres)


def _guesses(observations, points, camera):
    """Where the target seems to stand in each photograph: at most two arrays (4 + P, 3), as `_linear` takes them."""
    counts = np.bincount(observations.photo, minlength=len(observations.photos))
    few = [name for name, count in zip(observations.photos, counts) if count < ENOUGH]
    if len(counts) < 3 or few:
        raise SetupError(
            "a board that is only seen in mirrors needs three photographs, each with a mirror in another pose and "
            f"{ENOUGH} points or more; got {len(counts)}"
            + (f", and too few points in {', '.join(few)}: leave these out" if few else "")
        )
    guesses = []
    for photo, name in enumerate(observations.photos):
        rows = observations.photo == photo
        found = apparent_poses(camera.rays(observations.pixels[rows]), points[observations.point[rows]], 1)
        if not found:
            raise SetupError(f"no pose of the target explains {name}: do its points lie on a line?")
        guesses.append([where(np.vstack([np.zeros(3), np.eye(3), points])) for where in found])
    return guesses


def _least_skew(guesses):
    """One guess for each photograph, such that images of the target differ as mirrors make them differ."""

    def cost(chosen):
        return sum(_thin(a[4:] - b[4:])[1] for a, b in combinations(chosen, 2))

    chosen = [options[0] for options in guesses]
    for _ in range(2):
        for photo, options in enumerate(guesses):
            chosen = min(([*chosen[:photo], option, *chosen[photo + 1 :]] for option in options), key=cost)
    return chosen


def _thin(differences):
    """Direction (3,) that differences (P, 3) avoid, how much of them lies along it, and how sure it is (mm)."""
    _, singular, axes = np.linalg.svd(differences, full_matrices=False)
    return axes[2], singular[2] / singular.sum(), singular[1] / np.sqrt(len(differences))


def _linear(images):
    """Pose of the target, and the pinhole's images (B, 3), from where the target seems to stand over each mirror.

    Each of `images` is (4 + P, 3): the origin of the target's frame, the ends of its unit axes, the points.
    """
    count = len(images)
    turns = [(image[1:4] - image[0]).T for image in images]  # improper: camera from target over each mirror
    axes: list[list[np.ndarray]] = [[] for _ in images]
    for a, b in combinations(range(count), 2):
        tilt = np.arccos(np.clip((np.trace(turns[a] @ turns[b].T) - 1) / 2, -1, 1)) / 2  # between the two mirrors
        if tilt < _ALIKE:
            continue
        axis, _, surety = _thin(images[a][4:] - images[b][4:])
        for k in (a, b):
            axes[k].append(surety * axis)
    normals = []
    for k, mine in enumerate(axes):
        _, singular, directions = np.linalg.svd(np.array([*mine, np.zeros(3), np.zeros(3), np.zeros(3)]))
        if singular[1] < np.sin(_ALIKE) * singular[0] or singular[0] == 0:
            raise SetupError(
                f"the mirror of photograph {k} stands parallel to the others, or all mirrors are turned about one "
                "axis: turn the mirror both sideways and up and down between photographs, by some degrees"
            )
        normal = directions[2]
        normals.append(normal * np.sign(normal @ images[k][4:].mean(0)))  # away from the camera
    return _linear_pose(images, turns, np.array(normals))


def _linear_pose(images, turns, normals):
    """Pose and pinhole images (B, 3) once the normals (B, 3) are known."""
    flips = np.eye(3) - 2 * normals[:, :, None] * normals[:, None, :]
    rotation = nearest_rotation(np.sum(flips @ np.array(turns), axis=0))
    count = len(normals)
    # flip_k apparent_k = translation - 2 offset_k normal_k
    rows = np.zeros((count, 3, 3 + count))
    rows[:, :, :3] = np.eye(3)
    rows[np.arange(count), :, 3 + np.arange(count)] = -2 * normals
    right = np.einsum("kij,kj->ki", flips, np.array([image[0] for image in images]))
    solution = np.linalg.lstsq(rows.reshape(-1, 3 + count), right.ravel(), rcond=None)[0]
    return Pose(rotation, solution[:3]), 2 * solution[3:, None] * normals


def _refined(observations, points, camera, pose, centres):
    """The pose and mirrors that minimise the residuals in the photographs."""
    from scipy.optimize import least_squares

    spread, photo = observations.sigma[:, None], observations.photo

    def residuals(step):
        turned = rotation_from_vector(step[:3]) @ pose.rotation
        board = Pose(turned, pose.translation + step[3:6])
        images = _imaged(board @ points, (centres + step[6:].reshape(-1, 3))[photo])
        pixels, to_image, _ = pinhole_derivatives(camera, images)
        pixels[images[:, 2] <= 0] = np.nan
        return observations.pixels - pixels, to_image, points @ turned.T

    def weighted(step):
        return np.nan_to_num((residuals(step)[0] / spread).ravel(), nan=_LOST)

    def jacobian(step):
        _, to_image, arms = residuals(step)
        to_pose, to_centre = _image_derivatives(
            arms, step, pose.translation, (centres + step[6:].reshape(-1, 3))[photo]
        )
        out = np.zeros((len(points), 2, step.size))
        out[..., :6] = to_image @ to_pose
        columns = 6 + 3 * photo[:, None] + np.arange(3)
        np.put_along_axis(out, np.broadcast_to(columns[:, None], (*out.shape[:2], 3)), to_image @ to_centre, axis=-1)
        return -(out / spread[..., None]).reshape(-1, step.size)

    begin = np.zeros(6 + centres.size)
    start = residuals(begin)[0]
    if not np.isfinite(start).all():
        raise SetupError("the first guess puts some points behind the camera: are the points numbered right?")
    found = least_squares(weighted, begin, jacobian, x_scale="jac", xtol=1e-12, ftol=1e-12, gtol=1e-12)
    return _result(found, residuals(found.x)[0], start, spread, pose, centres)


def _result(found, left, start, spread, pose, centres):
    """What SciPy found, as a `ReflectedBoard`."""
    freedom = max(left.size - found.x.size, 1)
    sigma0 = float(np.sqrt(np.sum((left / spread) ** 2) / freedom))
    centres = centres + found.x[6:].reshape(-1, 3)
    length = np.linalg.norm(centres, axis=-1, keepdims=True)
    rotation = rotation_from_vector(found.x[:3]) @ pose.rotation
    return ReflectedBoard(
        Pose(rotation, pose.translation + found.x[3:6]), np.hstack([centres / length, length / 2]),
        _inverse(found.jac.T @ found.jac) * sigma0**2, left, start, sigma0, found.status > 0, found.message,
    )  # fmt: skip


def _imaged(points, centres):
    """Images (N, 3) of points (N, 3) in mirrors that the image (N, 3) of the pinhole names."""
    length = np.linalg.norm(centres, axis=-1, keepdims=True)
    normals = centres / length
    return points - (2 * np.sum(points * normals, axis=-1, keepdims=True) - length) * normals


def _image_derivatives(arms, step, translation, centres):
    """Of the images to the step of the pose (N, 3, 6), and to the image of the pinhole (N, 3, 3)."""
    length = np.linalg.norm(centres, axis=-1)[:, None, None]
    normals, eye = centres / length[..., 0], np.eye(3)
    along = normals[:, :, None] * normals[:, None, :]
    flip = eye - 2 * along
    turn = -np.cross(arms[:, :, None], eye[None], axisa=1, axisb=1, axisc=1)  # turning by w moves an arm by w x arm
    to_pose = np.concatenate([flip @ turn @ rotation_vector_jacobian(step[:3]), flip], -1)
    points = arms + translation + step[3:6]
    dot = np.sum(points * normals, axis=-1)[:, None, None]
    to_normal = -2 * (dot * eye + normals[:, :, None] * points[:, None, :])
    return to_pose, eye + to_normal @ (eye - along) / length


def _inverse(matrix):
    """Inverse of a symmetric matrix whose rows have different units."""
    scale = 1 / np.sqrt(np.diag(matrix))
    return np.linalg.pinv(matrix * scale * scale[:, None], rcond=1e-14, hermitian=True) * scale * scale[:, None]
