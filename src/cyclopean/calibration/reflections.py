"""Start values for mirrors: their planes, from a board and its images in them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import product

import numpy as np
from numpy.typing import ArrayLike

from ..cameras import Camera
from ..errors import OpticError, SetupError, ShapeError
from ..geometry import Pose, Rays, as_points
from ..optics import Mirror, Mirrors
from ..targets import DIRECT, Observations, Target
from .starts import poses_from_rays
from .zhang import zhang

_FLIP = np.diag([-1.0, 1.0, 1.0])  # un-flips a picture: x to -x in the camera's frame
ENOUGH = 4  # points of one picture that fix a pose
_LEVER = 100.0  # mm, along the axes of a frame: what turns count against shifts where no points are given
_CONTRADICTION = 0.2  # of the way from points to their images: more is no mirror
_TOUCHING = 1e-3  # of the distance of the target: a mirror this near the pinhole shows nothing
_ROOM = 1.1  # a start mirror is larger by this factor than where the light was seen to meet it


def mirror_from_poses(
    direct: Pose | Sequence[Pose], reflected: Pose | Sequence[Pose], points: ArrayLike | None = None
) -> tuple[np.ndarray, float]:
    """Plane of a fixed mirror from poses of a target seen directly and of its image in the mirror.

    A point and its image lie on one line along the normal, half-way between them is the mirror; the normal is the
    common direction of all these lines in the sense of least squares.

    Parameters
    ----------
    direct : Pose, or a sequence with one for each photograph
        camera_from_target as seen directly.
    reflected : Pose, or a sequence
        camera_from_target as estimated from the mirror's part of the same photograph after un-flipping: with
        x to -x about the principal point, so that the target has its right handedness.
    points : (P, 3) array, optional
        The target's points, mm, which weigh turns against shifts; a tripod with legs of 100 mm where not given.

    Returns
    -------
    normal : (3,) array
        Unit, pointing away from the camera.
    offset : float
        Distance of the plane from the pinhole, mm: the plane is normal @ x = offset.

    Raises
    ------
    OpticError
        When the poses are not mirror images of each other.

    References
    ----------
    Rodrigues, Barreto, Nunes 2010, Camera pose estimation using images of planar mirror reflections, section 2.
    """
    seen = [direct] if isinstance(direct, Pose) else list(direct)
    images = [reflected] if isinstance(reflected, Pose) else list(reflected)
    if not seen or len(seen) != len(images):
        raise ShapeError(
            f"wanted a direct and a reflected pose for each photograph, got {len(seen)} and {len(images)} of them"
        )
    marks = np.vstack([np.zeros(3), _LEVER * np.eye(3)]) if points is None else as_points(points).reshape(-1, 3)
    return _plane_between(
        np.concatenate([pose @ marks for pose in seen]), np.concatenate([(pose @ marks) @ _FLIP for pose in images])
    )


def _plane_between(points, images):
    """Normal (3,) and offset of the mirror that takes points (N, 3) into images (N, 3), if there is one."""
    normal, offset = _nearest_plane(points, images)
    length = float(np.sqrt(np.mean(np.sum((points - images) ** 2, axis=-1))))
    miss = float(np.sqrt(np.mean(np.sum((reflected_points(points, normal, offset) - images) ** 2, axis=-1))))
    if miss > _CONTRADICTION * length:
        raise OpticError(
            f"no mirror explains these poses: images miss by {miss:.3g} mm where points are {length:.3g} mm from "
            "their images; was the reflected picture un-flipped, and is the board numbered alike in both?"
        )
    if offset < _TOUCHING * np.abs(points).max():
        raise OpticError(
            "the reflected pose is the same as the direct one, so the mirror would pass through the pinhole: "
            "was the same part of the photograph used twice?"
        )
    return normal, offset


def _nearest_plane(points, images):
    normal = np.linalg.svd(points - images, full_matrices=False)[2][0]
    offset = float(np.mean((points + images) / 2 @ normal))
    return (-normal, -offset) if offset < 0 else (normal, offset)


def reflected_points(points: ArrayLike, normal: np.ndarray, offset: float) -> np.ndarray:
    """Images (..., 3) of points (..., 3) in the mirror normal @ x = offset, mm."""
    points = as_points(points)
    return points - 2 * (points @ normal - offset)[..., None] * normal


def mirrors_from_observations(
    observations: Observations,
    target: Target,
    camera: Camera | tuple[int, int],
    paths: Sequence[Sequence[int]],
) -> tuple[Mirrors, Camera]:
    """Mirrors that roughly explain the observations, for `calibrate` to start from.

    Parameters
    ----------
    observations : Observations
        View k was seen along `paths[k]`; rows of the view `DIRECT` count as seen directly. The mirrors are fixed.
    target : Target
        The known object.
    camera : Camera or (width, height)
        The camera, roughly known; or only the size of the photographs, and the focal length is found from all
        views together: a mirror image, un-flipped, is a picture like any other.
    paths : sequence of sequences
        For each view the mirrors that light from the camera meets, as `Mirrors.sequences`; the empty one, last,
        for the view beside the mirrors: ``((0,), (1,), (0, 1), ())``.

    Returns
    -------
    Mirrors
        Numbered as `paths`. With a direct view, each is a rectangle around where the observed light meets it, a
        tenth larger: no drawing, and only good for a start. Without, they are endless. Where the target stands
        before the mirrors, count its direct view as `DIRECT`: no outline of mirrors parts the two then.
    Camera
        The camera given, or the one found.

    Raises
    ------
    SetupError
        When the observations do not tell where every mirror stands, or the paths are not those of the views.
    OpticError
        When no mirror explains what the views show.
    ShapeError
        Pixels that are not numbers, or points that the target does not have.

    References
    ----------
    Gluckman and Nayar 2001, Catadioptric stereo using planar mirrors: every view is that of a camera reflected in
    the mirrors of its path.
    """
    sequences = tuple(tuple(int(k) for k in path) for path in paths)
    _check_paths(observations, sequences)
    check_rows(observations, target.points)
    if not isinstance(camera, Camera):
        camera = _camera_of(observations, target, camera, sequences)
    pictures = _pictures(observations, target, camera, sequences)
    planes = _planes(pictures, 1 + max(k for path in sequences for k in path))
    hits: list[list[np.ndarray]] = [[] for _ in planes]
    for view, path in enumerate(sequences):
        rays = camera.rays(observations.pixels[observations.view == view])
        for k in path:
            rays = _reflected_rays(rays, *planes[k])
            hits[k].append(rays.origins)
    past = () in sequences
    mirrors = tuple(_mirror(np.concatenate(met), plane, past) for met, plane in zip(hits, planes, strict=True))
    return Mirrors(mirrors, tuple(path for path in sequences if path), direct=past), camera


def _check_paths(observations, paths):
    numbers = sorted({k for path in paths for k in path})
    if not numbers or numbers != list(range(len(numbers))):
        raise SetupError(f"paths must number the mirrors 0, 1, ..., and each must be met by some view; got {paths}")
    if () in paths[:-1]:
        raise SetupError(
            f"the direct view comes last, as in the views of `Mirrors`: number the views anew; got {paths}"
        )
    if not len(observations) or observations.view.max() >= len(paths):
        last = observations.view.max() if len(observations) else "none"
        raise SetupError(f"paths describe {len(paths)} views, but the observations number views up to {last}")


def _camera_of(observations, target, size, paths):
    """The camera without distortion, centred on photographs of this size, from all views together."""
    odd = np.array([len(path) % 2 == 1 for path in (*paths, ())])[observations.view]  # DIRECT is the last
    pixels = observations.pixels.copy()
    pixels[odd, 0] = size[0] - 1 - pixels[odd, 0]
    pairs, photo = np.unique(np.stack([observations.photo, observations.view], -1), axis=0, return_inverse=True)
    names = tuple(f"{observations.photos[p]}, view {v}" for p, v in pairs)
    pictures = replace(observations, pixels=pixels, photo=photo.ravel(), photos=names, view=DIRECT)
    return zhang(pictures, target, size, 0, free_centre=False, free_aspect=False).camera


def _pictures(observations, target, camera, paths):
    """For each photograph the (path, guesses) of its views; a guess is where the target (P, 3) seems to stand."""
    points = np.asarray(target.points, dtype=float)
    found = []
    for photo in range(len(observations.photos)):
        views = []
        for view in np.unique(observations.view[observations.photo == photo]):
            path = () if view == DIRECT else paths[view]
            rows = (observations.photo == photo) & (observations.view == view)
            guesses = apparent_poses(
                camera.rays(observations.pixels[rows]), points[observations.point[rows]], len(path)
            )
            if guesses:
                views.append((path, [pose(points) for pose in guesses]))
        found.append(views)
    return found


def check_rows(observations: Observations, points: np.ndarray) -> None:
    """Raise `ShapeError` for pixels that are not numbers, or points (P, 3) that the target does not have."""
    bad = np.flatnonzero(~np.isfinite(observations.pixels).all(-1))
    if bad.size:
        raise ShapeError(f"{bad.size} observed pixels are not numbers (row {bad[0]} first): leave those rows out")
    if len(observations) and not 0 <= observations.point.min() <= observations.point.max() < len(points):
        raise ShapeError(
            f"points are numbered 0 to {len(points) - 1} on this target, but observations name "
            f"{observations.point.min()} to {observations.point.max()}: is it the right board?"
        )


def apparent_poses(rays, points, mirrors):
    """Maps from the target into the camera's frame (at most two) that put points (N, 3) where they seem to stand."""
    if len(points) < ENOUGH:
        return []
    flip = _FLIP if mirrors % 2 else np.eye(3)
    found = poses_from_rays(Rays(rays.origins, rays.directions @ flip), points)
    return [lambda where, pose=pose: (pose @ where) @ flip for pose in found]


def _planes(pictures, count):
    """Planes of all mirrors: those first that a known target shows, then those that need others."""
    planes: dict[int, tuple[np.ndarray, float]] = {}
    while len(planes) < count:
        pairs: dict[int, list] = {}
        for views in pictures:
            seen = [view for view in views if all(k in planes for k in view[0])]
            if not seen:
                continue
            path, guesses = min(seen, key=lambda view: len(view[0]))
            where = _unfolded(path, guesses, planes)
            for path, guesses in views:
                missing = [k for k in path if k not in planes]
                if len(missing) == 1:
                    place = path.index(missing[0])
                    objects = [_folded(path[place + 1 :], points, planes) for points in where]
                    images = _unfolded(path[:place], guesses, planes)
                    pairs.setdefault(missing[0], []).append(list(product(objects, images)))
        if not pairs:
            unknown = ", ".join(str(k) for k in range(count) if k not in planes)
            raise SetupError(
                f"the photographs do not tell where mirror {unknown} stands: some must show the target both directly "
                "(or over mirrors that are known) and over that mirror, with four points or more in each view"
            )
        planes |= {k: _agreed_plane(options) for k, options in pairs.items()}
    return [planes[k] for k in range(count)]


def _folded(path, points, planes):
    """Where points (P, 3) seem to stand over the mirrors of a path."""
    for k in reversed(path):
        points = reflected_points(points, *planes[k])
    return points


def _unfolded(path, guesses, planes):
    """Where the points really stand that seem to stand at `guesses`, each (P, 3), over the mirrors of a path."""
    for k in path:
        guesses = [reflected_points(points, *planes[k]) for points in guesses]
    return guesses


def _agreed_plane(options):
    """One plane from pairs (points, images) of many photographs, each of which offers several."""
    chosen = [min(pairs, key=lambda pair: _skew(*pair)) for pairs in options]
    for _ in range(3):
        normal, offset = _nearest_plane(*(np.concatenate(part) for part in zip(*chosen, strict=True)))

        def miss(pair, normal=normal, offset=offset):
            return np.sum((reflected_points(pair[0], normal, offset) - pair[1]) ** 2)

        chosen = [min(pairs, key=miss) for pairs in options]
    return _plane_between(*(np.concatenate(part) for part in zip(*chosen, strict=True)))


def _skew(points, images):
    """How far points and images are from lying on lines of one direction: 0 for a mirror."""
    singular = np.linalg.svd(points - images, compute_uv=False)
    return singular[1] / singular[0]


def _reflected_rays(rays, normal, offset):
    """The rays after the mirror, starting on it."""
    origins = rays.at((offset - rays.origins @ normal) / (rays.directions @ normal))
    return Rays(origins, rays.directions - 2 * (rays.directions @ normal)[..., None] * normal)


def _mirror(hits, plane, bounded):
    """A mirror in the plane, in the middle of where light met it (N, 3), as large as that where it is bounded."""
    normal, offset = plane
    hits = hits[np.isfinite(hits).all(-1)]
    axes = Mirror((0, 0, 0), tuple(-normal)).axes()[:2]
    along = (hits - offset * normal) @ axes.T
    low, high = along.min(0), along.max(0)
    x, y, z = map(float, offset * normal + (low + high) / 2 @ axes)
    width, height = map(float, _ROOM * (high - low))
    nx, ny, nz = map(float, -normal)  # faces the camera
    return Mirror((x, y, z), (nx, ny, nz), (width, height) if bounded else None)
