"""Start values for a rig of virtual cameras: where each sees the target, and how they stand to each other."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import cv2
import numpy as np

from ..cameras import Camera
from ..errors import SetupError
from ..geometry import Pose, rotation_from_vector
from ..rigs.pinhole import pinhole_derivatives
from ..targets import Observations
from .virtual_model import Eye

LEAST_POINTS = 6  # of the target in one view of one photograph, to tell a pose by
_FLAT = 1e-9  # of the target's extent: a target this flat is plane


def start_values(
    observations: Observations, points: np.ndarray, eyes: Sequence[Eye]
) -> tuple[tuple[Eye, ...], list[Pose | None]]:
    """The eyes with their poses, and the pose root_from_target of each photograph; None where none can be told.

    `points` (N, 3) mm are the target's points of each row. The eyes' lenses are taken as they are.
    """
    own = [_own_poses(observations, points, eye) for eye in eyes]
    poses = _relative_poses(own, [eye.name for eye in eyes])
    eyes = tuple(eye._replace(pose=pose) for eye, pose in zip(eyes, poses, strict=True))
    return eyes, _target_poses(observations, points, own, eyes)


def _own_poses(observations, points, eye) -> dict[int, list[Pose]]:
    """Poses camera_from_target of the photographs in which an eye sees enough of the target.

    A plane target seen from afar has two poses that explain it nearly as well: both are given.
    """
    poses = {}
    for photo, rows in _photographs(observations, eye.number):
        found = _poses(points[rows], observations.pixels[rows], eye)
        if found:
            poses[photo] = found
    return poses


def _photographs(observations, number):
    """Photographs that show a view enough of the target, and the rows of each."""
    for photo in np.unique(observations.photo[observations.view == number]):
        rows = np.flatnonzero((observations.view == number) & (observations.photo == photo))
        if len(rows) >= LEAST_POINTS:
            yield int(photo), rows


def _poses(points, pixels, eye):
    flat = eye.camera.normalise(pixels) * ([-1.0, 1.0] if eye.mirrored else [1.0, 1.0])
    good = np.isfinite(flat).all(-1)
    points, flat = points[good], flat[good]
    if len(points) < LEAST_POINTS:
        return []
    middle = points.mean(0)
    _, extent, axes = np.linalg.svd(points - middle)
    if extent[1] <= _FLAT * extent[0]:
        return []  # all on a line
    plane = extent[2] <= _FLAT * extent[0]
    turn = axes * [[1], [1], [np.linalg.det(axes)]] if plane else np.eye(3)
    local = (points - middle) @ turn.T  # on a plane z = 0, as IPPE wants it
    method = cv2.SOLVEPNP_IPPE if plane else cv2.SOLVEPNP_SQPNP
    _, rotations, translations, _ = cv2.solvePnPGeneric(local, flat[:, None], np.eye(3), np.zeros(5), flags=method)
    own = Pose(turn, -turn @ middle)
    poses = [
        Pose(rotation_from_vector(r.ravel()), t.ravel()) @ own for r, t in zip(rotations, translations, strict=True)
    ]
    return [pose for pose in poses if ((pose @ points)[:, 2] > 0).all()]


def _relative_poses(own: Sequence[Mapping[int, list[Pose]]], names: Sequence[str]) -> list[Pose]:
    """Poses camera_from_root of each camera, the first being the root.

    Cameras are linked from the root on, each through the neighbour with which it shares most photographs.
    """
    found = {0: Pose(np.eye(3), np.zeros(3))}
    while len(found) < len(own):
        links = [(len(own[a].keys() & own[b].keys()), -a, -b) for a in found for b in range(len(own)) if b not in found]
        shared, a, b = max(links)
        if not shared:
            lost = ", ".join(names[k] for k in range(len(own)) if k not in found)
            raise SetupError(
                f"no photograph shows {LEAST_POINTS} points of the target both in {lost} and in one of the other "
                "views, so nothing tells how they stand to each other; add photographs with the target in several views"
            )
        found[-b] = _medoid(own[-a], own[-b]) @ found[-a]
    return [found[k] for k in range(len(own))]


def _medoid(first, second):
    """The pose second_from_first that agrees best with those of all photographs; an outlier has no say."""
    photos = sorted(first.keys() & second.keys())
    groups = [[b @ a.inverse for a in first[p] for b in second[p]] for p in photos]
    turns = np.array([pose.rotation for group in groups for pose in group])
    moves = np.array([pose.translation for group in groups for pose in group])
    depth = np.median([np.linalg.norm(pose.translation) for p in photos for pose in first[p]])
    edges = np.cumsum([0] + [len(group) for group in groups])[:-1]

    def support(turn, move):
        angle = np.linalg.norm(turns - turn, axis=(1, 2)) / np.sqrt(2)  # about
        away = angle + np.linalg.norm(moves - move, axis=-1) / depth
        return np.median(np.minimum.reduceat(away, edges))

    best = min(range(len(turns)), key=lambda k: support(turns[k], moves[k]))
    return Pose(turns[best], moves[best])


def _target_poses(observations, points, own, eyes) -> list[Pose | None]:
    """Of the poses that single eyes propose for each photograph, the one that all eyes like best."""
    poses: list[Pose | None] = []
    for photo in range(len(observations.photos)):
        rows = np.flatnonzero(observations.photo == photo)
        proposed = [
            eye.pose.inverse @ pose for found, eye in zip(own, eyes, strict=True) for pose in found.get(photo, [])
        ]
        costs = [_miss(observations, points, rows, eyes, pose) for pose in proposed]
        poses.append(proposed[int(np.argmin(costs))] if proposed else None)
    return poses


def _miss(observations, points, rows, eyes, pose):
    """Sum of the distances (px) at which the eyes miss the observed pixels of a photograph."""
    total = 0.0
    for eye in eyes:
        mine = rows[observations.view[rows] == eye.number]
        local = (eye.pose @ pose) @ points[mine]
        with np.errstate(divide="ignore", invalid="ignore"):
            pixels = pinhole_derivatives(eye.camera, local, eye.mirrored)[0]
        miss = np.linalg.norm(pixels - observations.pixels[mine], axis=-1)
        total += float(np.where((local[:, 2] > 0) & np.isfinite(miss), miss, 1e6).sum())
    return total


def own_lens(observations: Observations, points: np.ndarray, eye: Eye, distortion: int) -> Camera:
    """Lens of one view calibrated alone, by OpenCV, from the photographs that show enough of the target.

    `distortion` (0, 2, 4 or 5) says how many of k1 k2 p1 p2 k3 are found; the others stay those of the eye's camera,
    which is the first guess.
    """
    seen, wanted = [], []
    for _, rows in _photographs(observations, eye.number):
        wanted.append(points[rows].astype(np.float32))
        seen.append(_flipped(observations.pixels[rows], eye).astype(np.float32))
    if not seen:
        raise SetupError(f"no photograph shows {LEAST_POINTS} points of the target in {eye.name}")
    guess = _flipped_camera(eye.camera, eye.mirrored)
    flags = cv2.CALIB_USE_INTRINSIC_GUESS
    flags |= 0 if distortion >= 2 else cv2.CALIB_FIX_K1 | cv2.CALIB_FIX_K2
    flags |= 0 if distortion >= 4 else cv2.CALIB_FIX_TANGENT_DIST
    flags |= 0 if distortion == 5 else cv2.CALIB_FIX_K3
    _, matrix, numbers, _, _ = cv2.calibrateCamera(
        wanted, seen, guess.size, guess.matrix, np.array(guess.distortion), flags=flags
    )
    return _flipped_camera(Camera.from_matrix(matrix, guess.size, np.ravel(numbers)[:5]), eye.mirrored)


def stereo_pose(observations: Observations, points: np.ndarray, first: Eye, second: Eye) -> Pose:
    """Pose second_from_first by OpenCV's stereoCalibrate, both lenses fixed, from what both see at once."""
    wanted, lefts, rights = [], [], []
    others = dict(_photographs(observations, second.number))
    for photo, mine in _photographs(observations, first.number):
        theirs = others.get(photo, np.zeros(0, int))
        _, a, b = np.intersect1d(observations.point[mine], observations.point[theirs], return_indices=True)
        if len(a) >= LEAST_POINTS:
            wanted.append(points[mine[a]].astype(np.float32))
            lefts.append(_flipped(observations.pixels[mine[a]], first).astype(np.float32))
            rights.append(_flipped(observations.pixels[theirs[b]], second).astype(np.float32))
    if not wanted:
        raise SetupError(
            f"no photograph shows {LEAST_POINTS} points of the target both in {first.name} and {second.name}"
        )
    lenses = [_flipped_camera(eye.camera, eye.mirrored) for eye in (first, second)]
    numbers = [part for lens in lenses for part in (lens.matrix, np.array(lens.distortion))]
    found = cv2.stereoCalibrate(wanted, lefts, rights, *numbers, first.camera.size, flags=cv2.CALIB_FIX_INTRINSIC)
    return Pose(np.asarray(found[5]), np.ravel(found[6]))


def _flipped(pixels, eye):
    """Pixels of the photograph, flipped left to right where a view is mirrored."""
    return pixels * [-1.0, 1.0] + [eye.camera.size[0] - 1.0, 0.0] if eye.mirrored else pixels


def _flipped_camera(camera, mirrored):
    """The lens that takes the flipped picture of a flipped scene."""
    if not mirrored:
        return camera
    k1, k2, p1, p2, k3 = camera.distortion
    centre = (camera.size[0] - 1 - camera.centre[0], camera.centre[1])
    return Camera(camera.size, camera.focal, centre, (k1, k2, p1, -p2, k3))
