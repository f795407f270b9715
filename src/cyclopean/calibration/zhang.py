"""The real camera from several photographs of a board: Zhang's method, then all of it at once in double precision."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ..cameras import Camera
from ..cameras.camera import CAMERA_PARAMETERS
from ..errors import SetupError, ShapeError
from ..geometry import Pose, check_inside
from ..rigs.pinhole import pinhole_derivatives
from ..targets import DIRECT, Observations, Target
from .least_squares import minimise

DISTORTIONS = {0: (), 2: ("k1", "k2"), 4: ("k1", "k2", "p1", "p2"), 5: ("k1", "k2", "p1", "p2", "k3")}
_LEAST_POINTS = 4  # of a plane, in one photograph: they fix a homography
_LEAST_POINTS_SOLID = 6  # of a solid, in one photograph
_PARALLEL_DEG = 2.0  # boards whose normals differ by less stand parallel, as far as a picture tells
_FLAT = 1e-9  # of the target's extent: a target this flat is a plane
_NEARLY_FLAT = 0.05  # of the target's extent: a target this flat serves Zhang's first guess as a plane
_UNSURE = 0.01  # relative standard deviation of the focal length that deserves a note
_UNKNOWN = 0.1  # and the one that makes it worthless
_PARALLEL_LIGHT = 1000.0  # picture widths: a longer focal length has run away
_SINGULAR = 1e-12  # smallest eigenvalue, of the information with ones on its diagonal, that is not rounding
_BAD = 3.0  # times the median of the photographs' rms: a photograph to look at


@dataclass(frozen=True, eq=False)
class CameraCalibration:
    """A camera as photographs of a known target show it, and how surely."""

    camera: Camera
    covariance: np.ndarray  # (9, 9) of the lens, in the order of `CAMERA_PARAMETERS`; 0 where a parameter is fixed
    poses: tuple[Pose, ...]  # camera_from_target of each photograph; NaN where it shows too little
    residuals: np.ndarray  # (N, 2) px, observed - predicted; NaN in rows that could not be used
    photo_rms: np.ndarray  # (B,) px, as `rms`, of each photograph; NaN where it shows too little
    sigma0: float  # what the stated sigmas of the pixels must be multiplied by to explain the residuals
    converged: bool
    message: str
    notes: tuple[str, ...] = ()  # what to know before trusting it

    @property
    def sigma(self) -> np.ndarray:
        """Standard deviations (9,) of the lens, in the order of `CAMERA_PARAMETERS`; 0 where it is fixed."""
        return np.sqrt(np.diag(self.covariance))

    @property
    def rms(self) -> float:
        """Root mean square length of the residuals, px, as OpenCV counts it; sqrt(2) times that of a coordinate."""
        return float(np.sqrt(np.nanmean(np.sum(self.residuals**2, axis=-1))))


def zhang(
    observations: Observations,
    target: Target,
    size: tuple[int, int],
    distortion: int = 5,
    *,
    view: int = DIRECT,
    guess: Camera | None = None,
    free_centre: bool = True,
    free_aspect: bool = True,
    loss: str = "none",
) -> CameraCalibration:
    """Calibrate a camera from photographs of a known target, by default a board in several poses.

    OpenCV's `calibrateCamera` gives the first values, in single precision and without weights; they are then refined
    together with all poses, each pixel weighed by its sigma, which also gives the covariance.

    Parameters
    ----------
    observations : Observations
        N rows; only those of `view` are used.
    target : Target
        Points (P, 3) mm. A plane need not be z = 0. Points that depart a little from a plane (the measured flatness
        of a real board) are used as they are; a solid needs `guess`.
    size : (2,) int
        Width and height of the photographs, px.
    distortion : 0, 2, 4 or 5
        How many of k1, k2, p1, p2, k3 to find; the others are those of `guess`, else 0.
    view : int
        Whose rows to use: `DIRECT` for photographs without the optic, or a sub-image taken as a camera of its own.
    guess : Camera, optional
        First values. The principal point and the ratio of the focal lengths stay its own if they are not free;
        without a guess they are then mid-image and 1.
    free_centre, free_aspect : bool
        Whether to find the principal point, and two focal lengths instead of one.
    loss : "none", "huber" or "cauchy"
        How outliers count in the refinement.

    Returns
    -------
    CameraCalibration

    Raises
    ------
    SetupError
        Too few points or photographs, or all boards stand parallel, so that the focal length is not determined.
    ShapeError
        The observations name points that the target does not have, or pixels that lie outside the photographs.

    References
    ----------
    Zhang 2000, A flexible new technique for camera calibration, IEEE PAMI 22(11).
    """
    if distortion not in DISTORTIONS:
        raise SetupError(f"distortion must be {', '.join(map(str, DISTORTIONS))} terms, got {distortion!r}")
    start = Camera(size, (float(max(size)),) * 2) if guess is None else guess
    if start.size != tuple(size):
        raise SetupError(f"the guess is a camera of {start.size} px, but the photographs have {tuple(size)}")
    data = _usable(observations, target, view)
    check_inside(data.observations.pixels, start.size)
    held = _Held.of(start, distortion, free_centre, free_aspect)
    _check_count(data, held)
    if guess is None and not data.plane and data.flatness > _NEARLY_FLAT:
        raise SetupError("the target's points do not lie in a plane, so a first guess of the camera is wanted: guess")
    lens, poses = _opencv(data, start, held, guess is None)
    solution = minimise(_predict(held), held.of_lens(lens), poses, data.observations, data.points, loss=loss)
    tilt = _check_tilts(data, held, solution.poses)
    return _finish(observations, data, held, start, solution, tilt)


class _Data(NamedTuple):
    """The rows that can be used; photographs numbered anew."""

    rows: np.ndarray  # (M,) rows of the observations given
    photos: np.ndarray  # (B',) numbers of the photographs given
    observations: Observations  # M rows, B' photographs
    points: np.ndarray  # (M, 3) mm, in the target's own frame
    frame: Pose  # plane_from_target: the best plane of the target is z = 0
    flatness: float  # largest distance from that plane, in parts of the target's extent
    notes: tuple[str, ...]

    @property
    def plane(self):
        return self.flatness <= _FLAT

    def flat(self, photo):
        """Points (n, 3) in the plane's frame and pixels (n, 2) of one photograph."""
        mine = self.observations.photo == photo
        return self.frame @ self.points[mine], self.observations.pixels[mine]


class _Held(NamedTuple):
    """Which numbers of the lens are free: lens = fixed + basis @ shared."""

    basis: np.ndarray  # (9, S)
    fixed: np.ndarray  # (9,)

    @classmethod
    def of(cls, start, distortion, free_centre, free_aspect):
        names = [*(("centre_x", "centre_y") if free_centre else ()), *DISTORTIONS[distortion]]
        columns = [np.eye(9)[CAMERA_PARAMETERS.index(name)] for name in names]
        focal = np.zeros((2, 9))
        focal[[0, 1], [0, 1]] = start.focal
        focals = focal / np.array(start.focal)[:, None] if free_aspect else focal.sum(0)[None] / start.focal[1]
        basis = np.array([*focals, *columns]).T
        return cls(basis, np.where(np.any(basis != 0, axis=1), 0.0, start.lens))

    def lens(self, shared):
        return self.fixed + self.basis @ shared

    def of_lens(self, lens):
        return np.linalg.lstsq(self.basis, lens - self.fixed)[0]


def _usable(observations, target, view):
    """Rows of one view with finite pixels, of photographs that show enough of the target."""
    points = np.asarray(target.points, dtype=float)
    if observations.point.size and not 0 <= observations.point.min() <= observations.point.max() < len(points):
        raise ShapeError(
            f"the observations number points {observations.point.min()} to {observations.point.max()}, but the target "
            f"has {len(points)}"
        )
    mine = observations.view == view
    if not mine.any():
        raise SetupError(
            f"no observation of view {view}; there are those of {sorted(set(observations.view.tolist()))} "
            f"({DIRECT}: photographs without the optic)"
        )
    fine = mine & np.isfinite(observations.pixels).all(-1) & np.isfinite(points[observations.point]).all(-1)
    notes = [f"{np.count_nonzero(mine & ~fine)} observations are not numbers: left out"] if (mine & ~fine).any() else []
    frame, flatness = _plane(points[np.unique(observations.point[fine])])
    photos: list[int] = []
    short: list[int] = []
    for photo in np.unique(observations.photo[mine]):
        rows = fine & (observations.photo == photo)
        enough = _spans((frame @ points[observations.point[rows]]), flatness)
        (photos if enough else short).append(int(photo))
    if short:
        names = ", ".join(observations.photos[k] for k in short)
        notes.append(f"left out, too few points or all on a line: {names}")
    if not photos:
        raise SetupError(
            f"no photograph shows {_LEAST_POINTS} points of the target ({_LEAST_POINTS_SOLID} of a solid) that are not "
            "on one line"
        )
    rows = np.flatnonzero(fine & np.isin(observations.photo, photos))
    some = observations.select(rows).of_photos(photos)
    return _Data(rows, np.array(photos), some, points[some.point], frame, flatness, tuple(notes))


def _plane(points):
    """The pose plane_from_target, and the largest distance from the plane in parts of the extent."""
    if not len(points):
        return Pose(np.eye(3), np.zeros(3)), 0.0
    middle = points.mean(0)
    axes = np.linalg.svd(points - middle)[2]
    axes = axes * [[1.0], [1.0], [np.linalg.det(axes)]]  # a rotation
    local = (points - middle) @ axes.T
    extent = max(float(np.ptp(local, axis=0).max()), 1e-300)
    return Pose(axes, -axes @ middle), float(np.abs(local[:, 2]).max() / extent)


def _spans(flat, flatness):
    if len(flat) < (_LEAST_POINTS if flatness <= _NEARLY_FLAT else _LEAST_POINTS_SOLID):
        return False
    extents = np.linalg.svd(flat[:, :2] - flat[:, :2].mean(0), compute_uv=False)
    return extents[1] > 1e-6 * extents[0]


def _check_count(data, held):
    """An error where so few photographs of a plane cannot tell so many numbers of a pinhole: two each (Zhang 2000)."""
    unknowns = np.linalg.matrix_rank(held.basis[:4])
    count = len(data.photos)
    if data.flatness <= _NEARLY_FLAT and 2 * count < unknowns:
        raise SetupError(
            f"{count} photograph of a plane tells 2 numbers of a camera, but {unknowns} are asked for (focal lengths, "
            "principal point): take ten from different sides, or free_centre=False, free_aspect=False"
        )


def _check_tilts(data, held, poses):
    """How far (deg) the boards depart from parallel, or from facing the camera; an error where they tell nothing."""
    if data.flatness > _NEARLY_FLAT:
        return np.inf
    normals = np.array([(pose @ data.frame.inverse).rotation[:, 2] for pose in poses])
    alone = np.linalg.matrix_rank(held.basis[:4]) <= 2  # principal point known: any tilt against the axis will do
    mean = np.array([0.0, 0.0, 1.0]) if alone else np.linalg.svd(normals)[2][0]  # signs do not matter
    tilt = float(np.degrees(np.arccos(np.clip(np.abs(normals @ mean), 0, 1)).max()))
    if not tilt > _PARALLEL_DEG:
        to = "the picture" if alone else "each other"
        raise SetupError(
            f"the focal length is not determined: the boards of all photographs ({len(poses)}) stand parallel to {to} "
            f"within {tilt:.2g} deg; tilt the board by 20 to 40 deg to different sides"
        )
    return tilt


def _opencv(data, start, held, plane):
    """The lens (9,) and poses camera_from_target by OpenCV; `plane`: begin with Zhang's closed form."""
    import cv2

    flats = [data.flat(k) for k in range(len(data.photos))]
    pixels = [np.ascontiguousarray(seen, dtype=np.float32)[:, None] for _, seen in flats]
    free = np.any(held.basis != 0, axis=1)
    flags = 0 if free[2] else cv2.CALIB_FIX_PRINCIPAL_POINT
    flags |= 0 if held.basis[:2].any(0).sum() == 2 else cv2.CALIB_FIX_ASPECT_RATIO
    flags |= 0 if free[6] else cv2.CALIB_FIX_TANGENT_DIST
    for column, flag in ((4, cv2.CALIB_FIX_K1), (5, cv2.CALIB_FIX_K2), (8, cv2.CALIB_FIX_K3)):
        flags |= 0 if free[column] else flag
    matrix, numbers = start.matrix, np.array(start.distortion)
    rounds = [(True, flags), (False, flags | cv2.CALIB_USE_INTRINSIC_GUESS)]
    rounds = rounds[:1] if plane and data.plane else rounds if plane else rounds[1:]
    for flat, options in rounds:  # a board that is not quite flat is first taken as flat
        solids = [np.ascontiguousarray(p * [1, 1, 0 if flat else 1], dtype=np.float32)[:, None] for p, _ in flats]
        try:
            found = cv2.calibrateCameraExtended(solids, pixels, start.size, matrix, numbers, flags=options)
        except cv2.error as error:
            raise SetupError(f"OpenCV finds no camera that explains the points: {error.err}") from error
        matrix, numbers = found[1], np.ravel(found[2])[:5]
    poses = [Pose.from_rotation_vector(r.ravel(), t.ravel()) @ data.frame for r, t in zip(*found[3:5], strict=True)]
    return np.array([matrix[0, 0], matrix[1, 1], matrix[0, 2], matrix[1, 2], *numbers]), poses


def _predict(held) -> Callable:
    """What `minimise` asks for: pixels with derivatives to the free numbers of the lens and to the point."""

    def predict(shared, points, jacobian):
        lens = held.lens(shared)
        if not lens[:2].min() > 0:
            lost = np.full((len(points), 2), np.nan)
            return lost, None, None
        camera = Camera((1, 1), (1.0, 1.0)).with_lens(lens)
        in_front = np.where(points[:, 2:] > 0, points, np.nan)
        pixels, to_point, to_lens = pinhole_derivatives(camera, in_front)
        return (pixels, to_lens @ held.basis, to_point) if jacobian else (pixels, None, None)

    return predict


def _finish(observations, data, held, start, solution, tilt):
    camera = start.with_lens(held.lens(solution.shared))
    covariance = held.basis @ solution.covariance @ held.basis.T
    residuals = np.full((len(observations), 2), np.nan)
    residuals[data.rows] = solution.residuals
    lost = Pose(np.full((3, 3), np.nan), np.full(3, np.nan))
    poses, photo_rms = [lost] * len(observations.photos), np.full(len(observations.photos), np.nan)
    for k, photo in enumerate(data.photos):
        mine = solution.residuals[data.observations.photo == k]
        poses[photo], photo_rms[photo] = solution.poses[k], np.sqrt(np.mean(np.sum(mine**2, -1)))
    known = _relative_sigma(camera, solution, held)
    if not known < _UNKNOWN or max(camera.focal) > _PARALLEL_LIGHT * max(camera.size):
        raise SetupError(
            f"the focal length is not determined (known to {100 * known:.2g} %; boards tilted by {tilt:.2g} deg): tilt "
            "the board by 20 to 40 deg to different sides, and let it fill the picture"
        )
    notes = [*data.notes]
    if known > _UNSURE:
        notes.append(
            f"focal length is known to {100 * known:.1f} % only (boards tilted by {tilt:.2g} deg): tilt the board more"
        )
    worst = photo_rms > _BAD * np.nanmedian(photo_rms)
    notes += [
        f"{observations.photos[k]}: residuals of {photo_rms[k]:.2g} px, {photo_rms[k] / np.nanmedian(photo_rms):.1f} "
        "times the median photograph's; look at it"
        for k in np.flatnonzero(worst)
        if photo_rms[k] > 1e-3  # below, rounding
    ]
    notes += _folded(camera, data.observations.pixels)
    return CameraCalibration(
        camera, covariance, tuple(poses), residuals, photo_rms, solution.sigma0, solution.converged, solution.message,
        tuple(notes),
    )  # fmt: skip


def _relative_sigma(camera, solution, held):
    """Relative standard deviation of the focal length, for residuals of at least a hundredth of the stated sigmas.

    Without noise the residuals are rounding, and would make anything look certain.
    """
    information = solution.information
    size = np.sqrt(np.diag(information).clip(0))
    if not (size > 0).all() or np.linalg.eigvalsh(information / size / size[:, None])[0] < _SINGULAR:
        return np.inf
    variance = (held.basis @ solution.covariance @ held.basis.T)[:2, :2].diagonal()
    floor = max(1.0, 0.01 / max(solution.sigma0, 1e-300))
    relative = np.sqrt(variance) / np.array(camera.focal) * floor
    return float(np.max(relative)) if np.isfinite(relative).all() else np.inf


def _folded(camera, pixels):
    """A note where the lens model turns round inside the picture."""
    width, height = camera.size
    x, y = np.meshgrid(np.linspace(0, width - 1, 33), np.linspace(0, height - 1, 33))
    lost = np.isnan(camera.normalise(np.stack([x, y], -1))).any(-1)
    if not lost.any():
        return []
    reach = np.abs(pixels - camera.centre).max(0)
    return [
        f"the lens model folds over in {100 * lost.mean():.0f} % of the picture, beyond the points seen (up to "
        f"{reach[0]:.0f} x {reach[1]:.0f} px from the centre): fill the corners, or find fewer distortion terms"
    ]
