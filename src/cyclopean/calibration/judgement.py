"""Any views, judged by photographs of a board: how they explain its pixels, and how well they measure it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields
from typing import NamedTuple

import numpy as np

from ..geometry import Pose, rigid_motion
from ..rigs import ViewLike
from ..targets import Observations
from ..triangulation import triangulate
from .least_squares import minimise
from .starts import start_poses
from .validation import neighbours

_PLANE_POINTS = 6  # triangulated points of a photograph, below which a plane fits anything
_FAR_OUT = 10.0  # times the median residual
_ITERATIONS = 30


@dataclass(frozen=True, eq=False)
class Judgement:
    """What T photographs say about views; NaN where one shows too little. Lengths are those of triangulated points.

    The pose of the board is fitted to each photograph for `rms`, and a rigid motion for `rigid`: these do not notice
    a wrong frame. `depth` and its errors do.
    """

    rows: np.ndarray  # (T,) how many pixels
    rms: np.ndarray  # (T,) px, root mean square of the coordinates of observed - predicted pixels
    points: np.ndarray  # (T,) how many triangulated points
    rigid: np.ndarray  # (T,) mm, root mean square distance from the board after the best rigid motion
    rigid_max: np.ndarray  # (T,) mm
    flatness: np.ndarray  # (T,) mm, root mean square distance from the best plane; NaN for targets that are not flat
    pairs: np.ndarray  # (T,) how many pairs of neighbouring points
    square: np.ndarray  # (T,) mm, mean distance of neighbours less the true one
    square_sd: np.ndarray  # (T,) mm
    pose_depth: np.ndarray  # (T,) mm, mean z of what is seen of the board, by its fitted pose
    depth: np.ndarray  # (T,) mm, mean z of the triangulated points
    depth_rms: np.ndarray  # (T,) mm, root mean square error of z, where it is known
    depth_max: np.ndarray  # (T,) mm, largest error of z

    @classmethod
    def nothing(cls, count: int) -> Judgement:
        """No figures yet for `count` photographs."""
        counts = ("rows", "points", "pairs")
        return cls(**{field.name: np.full(count, 0.0 if field.name in counts else np.nan) for field in fields(cls)})

    def of(self, photos: np.ndarray) -> Judgement:
        """The figures of some photographs."""
        return Judgement(**{field.name: getattr(self, field.name)[photos] for field in fields(self)})

    def put(self, photos: Sequence[int], part: Judgement) -> None:
        """Fill in the figures of some photographs."""
        for field in fields(self):
            getattr(self, field.name)[list(photos)] = getattr(part, field.name)


class Held(NamedTuple):
    """Poses of the board that were fitted to photographs while the views were held."""

    poses: tuple[Pose | None, ...]  # rig_from_target; None where a photograph shows too little
    residuals: np.ndarray  # (N, 2) px, NaN where a view does not show its point

    @property
    def far_out(self) -> np.ndarray:
        """(N,) bool: rows that are far from where these views expect them, by their own standard."""
        length = np.linalg.norm(self.residuals, axis=-1)
        usual = np.median(length[np.isfinite(length)]) if np.isfinite(length).any() else 0.0
        return ~(length <= max(_FAR_OUT * usual, 1e-6))


def hold(views: Sequence[ViewLike], seen: Observations, points: np.ndarray) -> Held:
    """Fit the board's pose to each photograph, the views held.

    Parameters
    ----------
    views : sequence of V views
        The calibrated rig.
    seen : Observations
        N rows, all of them through the optic.
    points : (N, 3) array
        The target's point of each row, mm.
    """
    views = [view.unbounded() for view in views]
    guesses = start_poses(seen, points, views, views[0])
    kept = [k for k, found in enumerate(guesses) if found]
    rows = np.isin(seen.photo, kept)
    poses: list[Pose | None] = [None] * len(guesses)
    residuals = np.full((len(seen), 2), np.nan)
    if not kept:
        return Held(tuple(poses), residuals)
    some, there = seen.of_photos(kept), points[rows]
    best, costs = residuals[rows], np.full(len(kept), np.inf)
    for turn in range(max(len(guesses[k]) for k in kept)):  # a plane seen from afar may lean either way
        start = [guesses[k][min(turn, len(guesses[k]) - 1)] for k in kept]
        solution = minimise(_prediction(views, some), np.zeros(0), start, some, there, iterations=_ITERATIONS)
        squares = np.nan_to_num(np.sum(solution.residuals**2, -1), nan=1e6)
        for j, cost in enumerate(np.bincount(some.photo, squares, len(kept))):
            if cost < costs[j]:
                mine = some.photo == j
                costs[j], poses[kept[j]], best[mine] = cost, solution.poses[j], solution.residuals[mine]
    residuals[rows] = best
    return Held(tuple(poses), residuals)


def _prediction(views, seen):
    """Where views that are held show points: what `minimise` asks for."""
    groups = [(int(number), np.flatnonzero(seen.view == number)) for number in np.unique(seen.view)]

    def predict(_, points, jacobian):
        pixels, to_point = np.full((len(points), 2), np.nan), np.full((len(points), 2, 3), np.nan)
        for number, rows in groups:
            if jacobian:
                found = views[number].pixel_derivatives(points[rows])
                pixels[rows], to_point[rows] = found.pixels, found.to_point
            else:
                pixels[rows] = views[number].project(points[rows])
        return (pixels, np.zeros((len(points), 2, 0)), to_point) if jacobian else (pixels, None, None)

    return predict


def judge(
    views: Sequence[ViewLike], held: Held, seen: Observations, target: np.ndarray, good: np.ndarray, known: np.ndarray
) -> Judgement:
    """Measure the board in each photograph.

    Parameters
    ----------
    views : sequence of V views
        The calibrated rig.
    held : Held
        The poses that go with it.
    seen : Observations
        N rows of T photographs, all of them through the optic.
    target : (P, 3) array
        The target's points, mm.
    good : (N,) bool array
        Which rows count.
    known : (T,) array
        z of the board in the camera's frame, mm, where it stands square to the axis; NaN where it is not known.
    """
    result = Judgement.nothing(len(seen.photos))
    keys, place = np.unique(np.stack([seen.photo[good], seen.point[good]], -1), axis=0, return_inverse=True)
    pixels = np.full((len(keys), len(views), 2), np.nan)
    pixels[place.ravel(), seen.view[good]] = seen.pixels[good]
    found = triangulate([view.unbounded() for view in views], pixels).points
    solid = np.isfinite(found).all(-1)
    for k, pose in enumerate(held.poses):
        mine = (seen.photo == k) & good
        miss = held.residuals[mine]
        miss = miss[np.isfinite(miss).all(-1)]
        if pose is None or not len(miss):
            continue
        result.rows[k], result.rms[k] = len(miss), np.sqrt(np.mean(miss**2))
        result.pose_depth[k] = (pose @ target[seen.point[mine]])[:, 2].mean()
        rows = solid & (keys[:, 0] == k)
        if np.count_nonzero(rows) >= _PLANE_POINTS:
            _measure(result, k, found[rows], target[keys[rows, 1]], known[k])
    return result


def _measure(result, k, points, model, known):
    """Fill in the lengths of photograph k from triangulated points (K, 3) and those of the target (K, 3), mm."""
    count = len(points)
    pose = rigid_motion(model, points)
    miss = np.linalg.norm(pose @ model - points, axis=-1)
    result.points[k], result.rigid[k], result.rigid_max[k] = count, np.sqrt(np.mean(miss**2)), miss.max()
    if np.linalg.matrix_rank(model - model.mean(0), tol=1e-6 * np.ptp(model)) < 3:
        result.flatness[k] = np.linalg.svd(points - points.mean(0), compute_uv=False)[-1] / np.sqrt(count)
    first, second = neighbours(model)
    if len(first):
        along = (model[second] - model[first]) @ pose.rotation.T
        length = np.linalg.norm(along, axis=-1)
        # along the true direction: noise across it would make every length too long
        error = np.einsum("ei,ei->e", points[second] - points[first], along) / length - length
        result.pairs[k], result.square[k], result.square_sd[k] = len(first), error.mean(), error.std()
    result.depth[k] = points[:, 2].mean()
    if np.isfinite(known):
        error = points[:, 2] - known
        result.depth_rms[k], result.depth_max[k] = np.sqrt(np.mean(error**2)), np.abs(error).max()
