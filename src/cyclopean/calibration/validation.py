"""Validation by photographs that the calibration has not seen."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ..errors import SetupError
from ..geometry import rigid_motion
from ..rigs import Setup
from ..targets import DIRECT, Observations, Target
from ..triangulation import triangulate
from .depths import rms
from .least_squares import minimise
from .physical import OUTLIER, Calibration, calibrate
from .prediction import Prediction, views_of
from .unknowns import Unknowns

_FOLDS = 8
_BINS = 4
_PLANE_POINTS = 6  # triangulated points of a photograph, below which a plane fits anything
_NEIGHBOUR = 1.001  # of the smallest distance between a point and another


@dataclass(frozen=True, eq=False)
class Validation:
    """How well calibrations do on photographs that were left out of them.

    Every figure of a photograph comes from a calibration that did not see it; only the pose of the target was then
    fitted to it. Lengths are those of points triangulated from at least two views.
    """

    calibration: Calibration  # from all photographs
    shared: np.ndarray  # (K, S), the free parameters found in each of the K folds
    fold: np.ndarray  # (B,) int, the fold that left each photograph out
    residuals: np.ndarray  # (N, 2) px, observed - predicted, by the fold that left the row's photograph out
    outliers: np.ndarray  # (N,) bool, rows that the robust fit of the pose distrusts
    row_depths: np.ndarray  # (N,) mm, z of each row's point in the rig's frame
    photo_depths: np.ndarray  # (B,) mm, mean depth of what a photograph shows of the target
    flatness: np.ndarray  # (B,) mm, root mean square distance from the best plane; NaN for targets that are not flat
    square: np.ndarray  # (B,) mm, mean distance of neighbouring points less the true one
    square_sd: np.ndarray  # (B,) mm, standard deviation of that difference
    rigid: np.ndarray  # (B,) mm, root mean square distance from the target after the best rigid motion
    expected: np.ndarray  # (B,) mm, what `rigid` should be by the noise of the pixels alone
    triangulated: np.ndarray  # (B,) int, points seen by at least two views
    spacing: float  # mm, between neighbouring points of the target
    edges: np.ndarray  # (D + 1,) mm, of the depth bins

    @property
    def rms(self) -> float:
        """Root mean square of the residuals' coordinates, px, without the outliers."""
        return rms(self.residuals[~self.outliers])

    @property
    def view_rms(self) -> dict[int, float]:
        """The same for each view, by its number (`DIRECT` without the optic)."""
        views = self.calibration.observations.view
        return {int(k): rms(self.residuals[(views == k) & ~self.outliers]) for k in np.unique(views)}

    @property
    def depth_rms(self) -> np.ndarray:
        """The same (D,) for each depth bin."""
        places = self._bins(self.row_depths)
        return np.array([rms(self.residuals[(places == k) & ~self.outliers]) for k in range(len(self.edges) - 1)])

    @property
    def photo_rms(self) -> np.ndarray:
        """The same (B,) for each photograph."""
        photos = self.calibration.observations.photo
        return np.array([rms(self.residuals[(photos == k) & ~self.outliers]) for k in range(len(self.fold))])

    def table(self) -> list[tuple[str, int, float, float, float, float, float]]:
        """Rows for the depth bins, then all together.

        (depths, photographs, rms px, flatness mm, square's error %, its standard deviation %, rigid fit mm)
        """
        places = self._bins(self.photo_depths)
        rows = []
        for k, px in enumerate(self.depth_rms):
            name = f"{self.edges[k]:.0f} to {self.edges[k + 1]:.0f} mm"
            rows.append(self._row(name, px, places == k))
        return [*rows, self._row("all", self.rms, np.ones(len(self.fold), dtype=bool))]

    def _row(self, name, px, photos):
        usable = photos & np.isfinite(self.square)
        weights = self.triangulated[usable]
        mean, spread = np.nan, np.nan
        if weights.sum():
            mean = float(np.average(self.square[usable], weights=weights))
            spread = float(
                np.sqrt(np.average(self.square_sd[usable] ** 2 + (self.square[usable] - mean) ** 2, weights=weights))
            )
        percent = 100 / self.spacing
        flat, rigid = rms(self.flatness[photos]), rms(self.rigid[photos])
        return (name, int(photos.sum()), float(px), flat, mean * percent, spread * percent, rigid)

    def _bins(self, depths):
        return np.clip(np.searchsorted(self.edges, depths, side="right") - 1, 0, len(self.edges) - 2)


def hold_out(
    observations: Observations,
    target: Target,
    setup: Setup | Sequence[Setup],
    free: Sequence[str] | None = None,
    *,
    folds: int | None = None,
    depths: Sequence[float] | None = None,
    progress: Callable[[int, int], None] | None = None,
    **options,
) -> Validation:
    """Calibrate, then calibrate again without some of the photographs, and look how those left out are explained.

    Parameters
    ----------
    observations, target, setup, free
        As `calibrate` takes them; `options` too.
    folds : int, optional
        Groups of photographs that are left out in turn: one for each photograph, up to 8, where not given.
    depths : sequence of D + 1 mm, optional
        Edges of the bins of depth; four bins with equally many points where not given.
    progress : callable, optional
        Called as ``progress(done, total)`` after each calibration.

    Returns
    -------
    Validation

    Raises
    ------
    SetupError
        When there are fewer than two photographs, or more folds than photographs.
    """
    total = 1 + _fold_count(folds, len(observations.photos))
    full = calibrate(observations, target, setup, free, **options)
    if progress is not None:
        progress(1, total)
    shifted = None if progress is None else lambda done, count: progress(done + 1, count + 1)
    chosen = {name: options[name] for name in ("loss", "iterations") if name in options}
    return validate(full, folds=folds, depths=depths, progress=shifted, **chosen)


def validate(
    calibration: Calibration,
    *,
    folds: int | None = None,
    depths: Sequence[float] | None = None,
    progress: Callable[[int, int], None] | None = None,
    loss: str = "huber",
    iterations: int = 60,
) -> Validation:
    """As `hold_out`, for a calibration from all photographs that was made before."""
    seen = calibration.observations
    count = _fold_count(folds, len(seen.photos))
    fold = _folds(seen, count)
    residuals, weights = np.full((len(seen), 2), np.nan), np.zeros(len(seen))
    shared, poses, pieces = [], list(calibration.poses), {}
    for k in range(count):
        out = np.flatnonzero(fold == k)
        found = _without(calibration, np.flatnonzero(fold != k), loss, iterations)
        setups = [calibration.unknowns.setup(found, channel) for channel in range(len(calibration.setups))]
        rows = np.flatnonzero(np.isin(seen.photo, out))
        fitted = _fit_poses(calibration, setups, out, loss, iterations)
        residuals[rows], weights[rows] = fitted.residuals, fitted.weights
        for photo, pose in zip(out, fitted.poses, strict=True):
            poses[photo] = pose
        pieces.update(_measure(calibration, setups, out, weights >= OUTLIER))
        shared.append(found)
        if progress is not None:
            progress(k + 1, count)
    lost = weights < OUTLIER
    return _report(calibration, np.array(shared), fold, residuals, lost, poses, pieces, depths)


def _fold_count(folds, photos):
    if photos < 2:
        raise SetupError("validation leaves photographs out, so it takes two at least: take more, 8 is a good number")
    if folds is None:
        return min(_FOLDS, photos)
    if not 2 <= folds <= photos:
        raise SetupError(f"folds must lie between 2 and the number of photographs, {photos}, got {folds}")
    return int(folds)


def _folds(seen, count):
    """The fold (B,) of each photograph; those without the optic are spread evenly over the folds, too."""
    direct = np.array([np.all(seen.view[seen.photo == k] == DIRECT) for k in range(len(seen.photos))])
    order = np.argsort(direct, kind="stable")
    fold = np.empty(len(direct), dtype=int)
    fold[order] = np.arange(len(direct)) % count
    return fold


def _without(calibration, kept, loss, iterations):
    """Free parameters (S,) found from the photographs `kept`, from where the full calibration ended.

    The drawing's knowledge stays that of the drawing: what was left out must not come back through it.
    """
    unknowns, some = calibration.unknowns, calibration.observations.of_photos(kept)
    points = np.asarray(calibration.target.points, dtype=float)[some.point]
    return minimise(
        Prediction(unknowns, some),
        calibration.solution.shared,
        [calibration.poses[k] for k in kept],
        some,
        points,
        prior=(unknowns.start, unknowns.spread),
        loss=loss,
        iterations=iterations,
    ).shared


def _fit_poses(calibration, setups, photos, loss, iterations):
    """Poses of the target in some photographs, everything else held."""
    some = calibration.observations.of_photos(photos)
    points = np.asarray(calibration.target.points, dtype=float)[some.point]
    predict = Prediction(Unknowns.of(setups, ()), some)
    start = [calibration.poses[k] for k in photos]
    return minimise(predict, np.zeros(0), start, some, points, loss=loss, iterations=iterations)


class _Piece(NamedTuple):
    """What the triangulated points of one photograph say, mm."""

    flatness: float
    errors: np.ndarray  # (E,) of neighbouring points' distances
    rigid: float
    expected: float
    points: int  # that were triangulated


def _measure(calibration, setups, photos, good):
    """The pieces of some photographs, by their numbers, from rows that are `good` (N,)."""
    seen, points = calibration.observations, np.asarray(calibration.target.points, dtype=float)
    sigma = float(np.median(seen.sigma)) * calibration.solution.sigma0
    found: dict[int, tuple[list, list, list]] = {photo: ([], [], []) for photo in photos}
    for channel, setup in enumerate(setups):
        rows = np.flatnonzero(np.isin(seen.photo, photos) & (seen.view != DIRECT) & (seen.channel == channel) & good)
        if not rows.size:
            continue
        views = views_of(setup)
        keys, place = np.unique(np.stack([seen.photo[rows], seen.point[rows]], -1), axis=0, return_inverse=True)
        pixels = np.full((len(keys), len(views) - 1, 2), np.nan)
        pixels[place.ravel(), seen.view[rows]] = seen.pixels[rows]
        result = triangulate([views[k] for k in range(len(views) - 1)], pixels, sigma)
        solid = np.isfinite(result.points).all(-1)
        for photo in photos:
            mine = solid & (keys[:, 0] == photo)
            for store, values in zip(found[photo], (keys[mine, 1], result.points[mine], result.covariance[mine])):
                store.append(values)
    return {photo: _piece(points, *map(_joined, parts)) for photo, parts in found.items()}


def _joined(parts):
    return np.concatenate(parts) if parts else np.zeros((0, 3))


def _piece(target, numbers, points, covariance):
    if len(points) < _PLANE_POINTS:
        return _Piece(np.nan, np.zeros(0), np.nan, np.nan, len(points))
    numbers = numbers.astype(int)
    model = target[numbers]
    flat = np.linalg.matrix_rank(target - target.mean(0), tol=1e-6 * np.ptp(target)) < 3
    flatness = np.linalg.svd(points - points.mean(0), compute_uv=False)[-1] / np.sqrt(len(points)) if flat else np.nan
    pose = rigid_motion(model, points)
    miss = pose @ model - points
    first, second = neighbours(model)
    along = (model[second] - model[first]) @ pose.rotation.T
    lengths = np.linalg.norm(along, axis=-1)
    errors = np.einsum("ei,ei->e", points[second] - points[first], along) / np.maximum(lengths, 1e-300) - lengths
    freedom = max(1 - 2 / len(points), 0.0)  # six numbers of the motion out of three for each point
    expected = np.sqrt(np.mean(np.trace(covariance, axis1=-2, axis2=-1)) * freedom)
    rigid = np.sqrt(np.mean(np.sum(miss**2, -1)))
    return _Piece(float(flatness), errors, float(rigid), float(expected), len(points))


def neighbours(points):
    """Pairs (E,), (E,) of points (K, 3) that lie as near to each other as any do."""
    from scipy.spatial import cKDTree

    places, number = np.unique(points, axis=0, return_inverse=True)  # colours show the same point several times
    nearest = cKDTree(places).query(places, 2)[0][number.ravel(), 1]
    pairs = cKDTree(points).query_pairs(_NEIGHBOUR * float(nearest.max()), output_type="ndarray")
    length = np.linalg.norm(points[pairs[:, 0]] - points[pairs[:, 1]], axis=-1)
    pairs = pairs[(length <= _NEIGHBOUR * np.minimum(nearest[pairs[:, 0]], nearest[pairs[:, 1]])) & (length > 0)]
    return pairs[:, 0], pairs[:, 1]


def _report(calibration, shared, fold, residuals, lost, poses, pieces, edges):
    seen, points = calibration.observations, np.asarray(calibration.target.points, dtype=float)
    rotations = np.array([pose.rotation for pose in poses])[seen.photo]
    shifts = np.array([pose.translation for pose in poses])[seen.photo]
    depths = np.einsum("nj,nj->n", rotations[:, 2], points[seen.point]) + shifts[:, 2]
    photo_depths = np.array(
        [depths[seen.photo == k].mean() if np.any(seen.photo == k) else np.nan for k in range(len(fold))]
    )
    if edges is None:
        edges = np.quantile(depths, np.linspace(0, 1, _BINS + 1))
    ordered = [pieces[k] for k in range(len(fold))]
    through = seen.point[seen.view != DIRECT]  # boards that were only photographed without the optic do not count
    places = np.unique(points[through if through.size else seen.point], axis=0)
    first, second = neighbours(places)
    spacing = float(np.median(np.linalg.norm(places[first] - places[second], axis=-1)))
    return Validation(
        calibration,
        shared,
        fold,
        residuals,
        lost,
        depths,
        photo_depths,
        np.array([piece.flatness for piece in ordered]),
        np.array([piece.errors.mean() if piece.errors.size else np.nan for piece in ordered]),
        np.array([piece.errors.std() if piece.errors.size else np.nan for piece in ordered]),
        np.array([piece.rigid for piece in ordered]),
        np.array([piece.expected for piece in ordered]),
        np.array([piece.points for piece in ordered]),
        spacing,
        np.asarray(edges, dtype=float),
    )
