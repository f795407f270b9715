"""Route 2: each sub-image calibrated as an ordinary camera, all of them one rigid rig.

Sections 4.1.2, 5.1.1 and 6.1.1 of the thesis calibrate each virtual camera alone; here one bundle adjustment finds
them together, since they stand to each other in the same way in all photographs.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from ..cameras import Camera
from ..errors import SetupError, ShapeError
from ..geometry import Pose
from ..rigs import PinholeView, Region, Rig, ViewLike, VirtualCamera
from ..targets import DIRECT, Observations, Target
from .least_squares import Solution, minimise
from .virtual_frame import aligned
from .virtual_model import Eye, Intrinsics, RigModel
from .virtual_start import own_lens, start_values, stereo_pose


@dataclass(frozen=True, eq=False)
class VirtualCalibration:
    """Virtual cameras found from photographs of a target.

    Photographs through the optic alone tell the rig only up to a rigid motion. `frame` says what the frame is:
    "real camera" where photographs of the unmoved target without the optic tie it, "nominal" where it was aligned
    to the views given (see `aligned`), "view 0" where it is that camera's own.
    """

    rig: Rig  # of PinholeView
    cameras: tuple[VirtualCamera, ...]  # their departure is that from the observed pixels
    poses: tuple[Pose | None, ...]  # rig_from_target of each photograph; None where it shows too little
    residuals: np.ndarray  # (N, 2) px, observed - predicted; NaN where an observation was of no use
    rms: np.ndarray  # (V,) px, of the coordinates of each view's residuals
    parameter_names: tuple[str, ...]  # of what was free, poses as camera_from_root: view 0 or the real camera
    covariance: np.ndarray  # (S, S) of these parameters, in px, rad and mm, while the root stands still
    sigma0: float  # what the stated noise must be multiplied by to explain the residuals
    frame: str
    converged: bool
    message: str
    notes: tuple[str, ...] = ()

    def moved(self, new_from_rig: Pose, frame: str = "moved") -> VirtualCalibration:
        """The same calibration in another frame."""
        back = new_from_rig.inverse
        cameras = tuple(replace(camera, camera_from_rig=camera.camera_from_rig @ back) for camera in self.cameras)
        rig = Rig(tuple(PinholeView.of(camera, view) for camera, view in zip(cameras, self.rig, strict=True)))
        poses = tuple(None if pose is None else new_from_rig @ pose for pose in self.poses)
        return replace(self, rig=rig, cameras=cameras, poses=poses, frame=frame)


def calibrate_virtual(
    observations: Observations,
    target: Target,
    camera: Camera,
    views: Sequence[ViewLike] | ArrayLike,
    intrinsics: Intrinsics = "free",
    distortion: int = 4,
    mirrored: Sequence[bool] | None = None,
    *,
    loss: str = "huber",
    iterations: int = 100,
) -> VirtualCalibration:
    """Calibrate each sub-image as an ordinary camera, all of them as one rigid rig.

    Parameters
    ----------
    observations : Observations
        N rows: where the sub-images show the target. In a photograph that also has rows without the optic (view
        `DIRECT`) the target must not have moved between: such photographs tie the rig to the real camera's frame.
        Rows of all colour channels count alike.
    target : Target
        The known object.
    camera : Camera
        The real camera, calibrated without the optic: where all begin, and what "fixed" keeps.
    views : sequence of V views, or (V, H, W) bool array
        The sub-images: views of the nominal setup, in whose frame the result then is as nearly as can be told
        (`aligned`), or only their masks.
    intrinsics : "free", "tied" or "fixed"
        Focal lengths and principal point: each view's own, one set for all views, or those of the real camera.
    distortion : 0, 2, 4 or 5
        How many of k1 k2 p1 p2 k3 each view finds for itself; the others stay the real camera's. A prism bends each
        sub-image in its own way, so they are never shared.
    mirrored : sequence of V bool, optional
        Which sub-images are flipped; what the views say where not given.
    loss : "huber", "cauchy" or "none"
        How outliers count, see `minimise`.
    iterations : int
        At most so many evaluations of the derivatives.

    Raises
    ------
    SetupError
        An option is unknown, or no photograph links some view to the others.
    """
    problem = _Problem.of(observations, target, camera, views, mirrored)
    _check(intrinsics, distortion)
    eyes, poses = start_values(problem.observations, problem.points, problem.eyes)
    method = f"bundle adjustment, intrinsics {intrinsics}, {distortion} distortion terms"
    return _adjust(problem, eyes, poses, intrinsics, distortion, True, loss, iterations, method)


def calibrate_pairwise(
    observations: Observations,
    target: Target,
    camera: Camera,
    views: Sequence[ViewLike] | ArrayLike,
    distortion: int = 4,
    mirrored: Sequence[bool] | None = None,
) -> VirtualCalibration:
    """Calibrate in the two classical steps: each sub-image alone, then each with view 0 as a stereo pair.

    OpenCV's calibrateCamera finds the lens of each view, its stereoCalibrate the pose of each to view 0 with these
    lenses fixed. A small residual here can hide a wrong geometry: `calibrate_virtual` serves better. The parameters
    are those of `calibrate_virtual`; nothing says how uncertain the result is (`covariance` is (0, 0)).

    References
    ----------
    Zhang 2000, A flexible new technique for camera calibration.
    """
    problem = _Problem.of(observations, target, camera, views, mirrored)
    _check("free", distortion)
    seen, points = problem.observations, problem.points
    eyes = [
        eye if eye.number == DIRECT else eye._replace(camera=own_lens(seen, points, eye, distortion))
        for eye in problem.eyes
    ]
    _, poses = start_values(seen, points, eyes)
    eyes = [eyes[0], *(eye._replace(pose=stereo_pose(seen, points, eyes[0], eye)) for eye in eyes[1:])]
    method = f"each view alone, then pairs, {distortion} distortion terms"
    return _adjust(problem, eyes, poses, "fixed", 0, False, "huber", 50, method)


@dataclass(frozen=True, eq=False)
class _Problem:
    """What was given, checked: the rows that can be used, and a camera for each view to begin with."""

    observations: Observations  # usable rows, all photographs
    rows: np.ndarray  # (N,) bool, which rows of those given are usable
    points: np.ndarray  # (N', 3) mm, the target's point of each usable row
    eyes: tuple[Eye, ...]
    views: tuple[PinholeView, ...]  # regions and names
    nominal: Sequence[ViewLike] | None
    notes: tuple[str, ...]

    @classmethod
    def of(cls, observations, target, camera, views, mirrored) -> _Problem:
        if not (len(views) and hasattr(views[0], "region")):
            views = np.asarray(views)
        nominal = None if isinstance(views, np.ndarray) else views
        outlines = _outlines(views, camera, mirrored)
        if observations.view.max(initial=0) >= len(outlines):
            raise ShapeError(
                f"the observations number views up to {observations.view.max()}, but {len(outlines)} are given"
            )
        points = np.asarray(target.points, dtype=float)
        if observations.point.max(initial=0) >= len(points):
            raise ShapeError(
                f"the observations number points up to {observations.point.max()}, but the target has {len(points)}"
            )
        through = np.isin(observations.photo, np.unique(observations.photo[observations.view >= 0]))
        linked = through & (observations.view == DIRECT)
        rows = (through & (observations.view >= 0)) | linked
        notes = ()
        if not rows.all():
            notes = (f"{np.count_nonzero(~rows)} observations of photographs without the optic are of no use here",)
        eyes = [Eye(k, v.name, camera, v.camera_from_rig, v.mirrored) for k, v in enumerate(outlines)]
        if linked.any():
            eyes.insert(0, Eye(DIRECT, "real camera", camera, Pose(np.eye(3), np.zeros(3)), False))
        some = observations.select(rows)
        return cls(some, rows, points[some.point], tuple(eyes), outlines, nominal, notes)


def _outlines(views, camera, mirrored):
    """A pinhole view for each sub-image, with the real camera's lens and no pose yet."""
    still = Pose(np.eye(3), np.zeros(3))
    if isinstance(views, np.ndarray):
        if views.ndim != 3 or views.shape[1:] != camera.size[::-1]:
            raise ShapeError(f"masks must have shape (V, {camera.size[1]}, {camera.size[0]}), got {views.shape}")
        flips = [False] * len(views) if mirrored is None else list(mirrored)
        regions = [Region(mask.astype(bool), 0.0) for mask in views]
        names = [f"view {k}" for k in range(len(views))]
    else:
        flips = [view.mirrored for view in views] if mirrored is None else list(mirrored)
        regions = [view.region for view in views]
        names = [view.name or f"view {k}" for k, view in enumerate(views)]
    if len(flips) != len(regions):
        raise ShapeError(f"mirrored must say True or False for each of the {len(regions)} views, got {len(flips)}")
    return tuple(
        PinholeView(camera, still, region, bool(flip), name)
        for region, flip, name in zip(regions, flips, names, strict=True)
    )


def _check(intrinsics, distortion):
    if intrinsics not in ("free", "tied", "fixed"):
        raise SetupError(f"intrinsics must be 'free', 'tied' or 'fixed', got {intrinsics!r}")
    if distortion not in (0, 2, 4, 5):
        raise SetupError(f"distortion must be 0, 2, 4 or 5 of k1 k2 p1 p2 k3, got {distortion!r}")


def _adjust(problem, eyes, poses, intrinsics, distortion, free_poses, loss, iterations, method) -> VirtualCalibration:
    """Bundle adjustment from start values, and the result in its frame."""
    known = [k for k, pose in enumerate(poses) if pose is not None]
    rows = np.isin(problem.observations.photo, known)
    seen = problem.observations.select(rows).of_photos(known)
    model = RigModel.of(eyes, seen.view, intrinsics, distortion, free_poses)
    solution = minimise(
        model.predict, model.start, [poses[k] for k in known], seen, problem.points[rows],
        prior=model.prior if model.names else None, loss=loss, iterations=iterations,
    )  # fmt: skip
    notes = list(problem.notes)
    if len(known) < len(poses):
        names = ", ".join(problem.observations.photos[k] for k in range(len(poses)) if k not in known)
        notes.append(f"photographs that show too little of the target: {names}")
    residuals = np.full((len(problem.rows), 2), np.nan)
    residuals[np.flatnonzero(problem.rows)[rows]] = solution.residuals
    target_poses: list[Pose | None] = [None] * len(poses)
    for k, pose in zip(known, solution.poses, strict=True):
        target_poses[k] = pose
    return _result(problem, model, solution, residuals, tuple(target_poses), seen, problem.points[rows], method, notes)


def _result(problem, model, solution: Solution, residuals, poses, seen, points, method, notes):
    eyes = [eye for eye in model.eyes_at(solution.shared) if eye.number != DIRECT]
    in_rig = np.einsum("nij,nj->ni", np.array([p.rotation for p in solution.poses])[seen.photo], points)
    in_rig += np.array([p.translation for p in solution.poses])[seen.photo]
    cameras, rms = [], []
    for eye in eyes:
        rows = seen.view == eye.number
        miss = np.linalg.norm(solution.residuals[rows], axis=-1)
        miss = miss[np.isfinite(miss)] if np.isfinite(miss).any() else np.full(1, np.nan)
        depth = in_rig[rows, 2]
        depths = (float(depth.min()), float(depth.max())) if rows.any() else (np.nan, np.nan)
        spread = float(np.sqrt(np.mean(miss**2)))
        cameras.append(VirtualCamera(eye.camera, eye.pose, eye.mirrored, method, depths, spread, float(miss.max())))
        rms.append(spread / np.sqrt(2))
    rig = Rig(tuple(PinholeView.of(camera, view) for camera, view in zip(cameras, problem.views, strict=True)))
    tied = model.eyes[0].number == DIRECT
    result = VirtualCalibration(
        rig, tuple(cameras), poses, residuals, np.array(rms), model.names, solution.covariance, solution.sigma0,
        "real camera" if tied else "view 0", solution.converged, solution.message, tuple(notes),
    )  # fmt: skip
    if tied or problem.nominal is None:
        return result
    return result.moved(aligned(result.rig, problem.nominal), "nominal")
