"""The physical model: camera, optic and target poses, all sub-images at once, along true rays."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from ..errors import CyclopeanError, OpticError, SetupError, ShapeError
from ..geometry import Pose, shortest_rotation
from ..rigs import Setup
from ..targets import DIRECT, Observations, Target
from .least_squares import Solution, minimise
from .odd_views import OddView, odd_views
from .prediction import Prediction, direct_view
from .starts import start_poses
from .unknowns import DEFAULT_FREE, Unknowns, kind_of

_FEW = 40  # points of a photograph that are plenty to choose between first guesses of a pose
_ROUGH = 1e-4  # of the cost: near enough to see which boards were taken to lean the wrong way
OUTLIER = 0.5  # weight below which an observation is reported as an outlier: twice the robust threshold


@dataclass(frozen=True, eq=False)
class Calibration:
    """A calibrated setup, and how far it can be trusted."""

    setups: tuple[Setup, ...]  # one for each colour channel; `setup` is the first
    unknowns: Unknowns
    solution: Solution
    observations: Observations  # the rows that were used
    target: Target
    notes: tuple[str, ...] = ()  # what the person should know
    left_out: tuple[str, ...] = ()  # views of photographs that contradicted the others and were not used, in words

    @property
    def setup(self) -> Setup:
        """The calibrated setup."""
        return self.setups[0]

    @property
    def poses(self) -> tuple[Pose, ...]:
        """Poses rig_from_target of the photographs."""
        return self.solution.poses

    @property
    def residuals(self) -> np.ndarray:
        """Observed minus predicted pixels (N, 2)."""
        return self.solution.residuals

    @property
    def outliers(self) -> np.ndarray:
        """(N,) bool: rows that the robust loss distrusts."""
        return self.solution.weights < OUTLIER

    @property
    def rms(self) -> float:
        """Root mean square of the residuals' coordinates, px, without the outliers."""
        return float(np.sqrt(np.mean(self.residuals[~self.outliers] ** 2)))

    @cached_property
    def sigma(self) -> dict[str, float]:
        """Standard deviation of each free parameter, in rad, mm, px, by name."""
        return dict(zip(self.unknowns.names, np.sqrt(np.diag(self.solution.covariance)), strict=True))

    @cached_property
    def values(self) -> dict[str, float]:
        """Value of each free parameter, in rad, mm, px, by name."""
        return dict(zip(self.unknowns.names, self.solution.shared, strict=True))

    def table(self) -> list[tuple[str, float, float, float, str]]:
        """Rows (name, start, value, sigma, unit) in the units in which people read them."""
        rows = []
        for name, start in zip(self.unknowns.names, self.unknowns.start, strict=True):
            kind = kind_of(name)
            first, last, sigma = (float(kind.factor * x) for x in (start, self.values[name], self.sigma[name]))
            rows.append((name, first, last, sigma, kind.unit))
        return rows


def calibrate(
    observations: Observations,
    target: Target,
    setup: Setup | Sequence[Setup],
    free: Sequence[str] | None = None,
    *,
    tolerances: Mapping[str, float] | None = None,
    poses: Sequence[Pose] | None = None,
    loss: str = "huber",
    iterations: int = 60,
) -> Calibration:
    """Calibrate camera, optic and target poses together, by true rays (refractive bundle adjustment).

    Parameters
    ----------
    observations : Observations
        Where photographs show the target; view `DIRECT` in those taken without the optic.
    target : Target
        The known object, such as a `Board`.
    setup : Setup or sequence of setups
        The start: what the drawing says. Several setups stand for the colour channels 0, 1, ... of the
        observations: they share the camera and the optic, and have an index each.
    free : sequence of names, optional
        What to find: full names (`setup.parameter_names`) or short ones ("optic.pose", "optic.facets",
        "camera.focal", "camera"). Without it, the pose and shape of the optic; and the camera as well where
        there are direct photographs.
    tolerances : mapping, optional
        Standard deviation of start values by name (mm, rad, px); broad ones where not given. They matter only in
        directions that the photographs leave open.
    poses : sequence of poses, optional
        Start values of rig_from_target; found from the observations where not given.

    Returns
    -------
    Calibration

    Raises
    ------
    SetupError
        When there is nothing to calibrate from, or the views are not those of the setup.
    """
    setups = (setup,) if isinstance(setup, Setup) else tuple(setup)
    _check(observations, target, setups)
    if free is None:
        free = default_free(setups[0], observations)
    unknowns = Unknowns.of([_without_outline(setup) for setup in setups], free, tolerances)
    notes: list[str] = []
    guesses: Sequence[Sequence[Pose]]
    if poses is None:
        observations, guesses = _start(observations, target, setups[0], notes)
    else:
        guesses = [[pose] for pose in poses]
    observations = observations.select(np.lexsort((observations.photo, observations.view, observations.channel)))
    problem = _Problem(unknowns, observations, target, loss, iterations)
    solution = problem.solve(guesses)
    odd = problem.odd_views(solution)
    if odd:
        observations = observations.select(~np.any([o.rows(observations) for o in odd], axis=0))
        left = np.unique(observations.photo)
        observations, guesses = observations.of_photos(left), [guesses[k] for k in left]
        problem = _Problem(unknowns, observations, target, loss, iterations, problem.predict.aims)
        solution = problem.solve(guesses)
    found = tuple(
        _with_outline(unknowns.setup(solution.shared, channel), start, notes) for channel, start in enumerate(setups)
    )
    if not solution.converged:
        notes.append(f"the calibration did not converge ({solution.message}): give a better start, or free less")
    left_out = tuple(f"left out: {o.text}" for o in odd)
    return Calibration(found, unknowns, solution, observations, target, tuple(notes), left_out)


class _Problem:
    """What stays the same while one set of observations is solved from several starts."""

    def __init__(self, unknowns, observations, target, loss, iterations, aims=None):
        self.unknowns, self.observations = unknowns, observations
        self.points = np.asarray(target.points, dtype=float)[observations.point]
        self.predict = Prediction(unknowns, observations, aims)
        self.options = {"loss": loss, "iterations": iterations, "prior": (unknowns.start, unknowns.spread)}

    def solve(self, guesses: Sequence[Sequence[Pose]]) -> Solution:
        """The solution from these first guesses of each photograph's pose."""
        rows = self.observations, self.points
        poses, _ = _best_poses(self.predict, self.unknowns.start, guesses, *rows)
        solution = minimise(self.predict, self.unknowns.start, poses, *rows, **self.options, tolerance=_ROUGH)
        for _ in range(3):  # a board that was taken to lean the wrong way stands out once the optic is known
            better = _leaning_right(self.predict, solution, guesses, *rows)
            if better is None:
                break
            solution = minimise(self.predict, solution.shared, better, *rows, **self.options, tolerance=_ROUGH)
        return minimise(self.predict, solution.shared, solution.poses, *rows, **self.options)

    def odd_views(self, solution: Solution) -> list[OddView]:
        """Views that contradict the others, and whole photographs that do; none where half of the photographs would."""
        try:
            views = self.predict.views(solution.shared, 0)
        except CyclopeanError:
            return []
        odd = [o for o in odd_views(self.observations, solution.residuals, self.points, views) if o.certain]
        return odd if 2 * len(odd) < len(self.observations.photos) else []


def default_free(setup: Setup, observations: Observations) -> tuple[str, ...]:
    """What is found where nobody says: the optic, and the camera where direct photographs show it."""
    camera = ("camera",) if np.any(observations.view == DIRECT) else ()
    return (*camera, *DEFAULT_FREE.get(setup.optic.kind, ("optic.pose",)))


def _best_poses(predict, shared, guesses, observations, points):
    """The guess of each photograph that explains its rows best, after fitting the poses alone, and its cost."""
    step = max(len(observations) // (len(guesses) * _FEW), 1)
    if step > 1:  # a few points of each photograph tell
        observations, points = observations.select(np.s_[::step]), points[::step]
        predict = Prediction(predict.unknowns, observations, predict.aims)
    held = _held(predict, shared)
    best: list[Pose] = []
    costs = np.full(len(guesses), np.inf)
    for turn in range(max(map(len, guesses))):
        start = [found[min(turn, len(found) - 1)] for found in guesses]
        solution = minimise(held, np.zeros(0), start, observations, points, iterations=8, tolerance=1e-4)
        cost = _photo_costs(solution.residuals, observations)
        best = best or list(solution.poses)
        for k in np.flatnonzero(cost < costs):
            best[k], costs[k] = solution.poses[k], cost[k]
    return best, costs


def _leaning_right(predict, solution, guesses, observations, points):
    """Poses with another guess for the photographs that fit badly, or None where no other guess is better."""
    costs = _photo_costs(solution.residuals, observations)
    bad = np.flatnonzero(costs > 3 * np.median(costs))
    if not bad.size:
        return None
    some = observations.of_photos(bad)
    rows = np.isin(observations.photo, bad)
    tries = [[*guesses[k], _tipped(solution.poses[k], observations, points, k)] for k in bad]
    part = Prediction(predict.unknowns, some, predict.aims)
    poses, found = _best_poses(part, solution.shared, tries, some, points[rows])
    if not np.any(found < 0.5 * costs[bad]):
        return None
    better = list(solution.poses)
    for k, pose, cost in zip(bad, poses, found, strict=True):
        better[k] = pose if cost < 0.5 * costs[k] else better[k]
    return better


def _tipped(pose, observations, points, photo):
    """The pose with the target leaning the other way: mirrored in the plane through it square to the line of sight."""
    seen = points[observations.photo == photo]
    middle = pose @ seen.mean(0)
    sight = middle / np.linalg.norm(middle)
    normal = pose.rotation[:, 2] * np.sign(pose.rotation[:, 2] @ sight)
    turn = shortest_rotation(normal, 2 * (normal @ sight) * sight - normal)
    rotation = turn @ pose.rotation
    return Pose(rotation, middle - rotation @ seen.mean(0))


def _photo_costs(residuals, observations):
    """Median residual (px) of each photograph; infinite where most of its points are not seen."""
    length = np.linalg.norm(residuals, axis=-1)
    length = np.where(np.isfinite(length), length, np.inf)
    order = np.lexsort((length, observations.photo))
    starts = np.searchsorted(observations.photo[order], np.arange(len(observations.photos) + 1))
    middle = np.minimum((starts[:-1] + starts[1:]) // 2, len(length) - 1)
    return np.where(np.diff(starts) > 0, length[order][middle], 0.0)


def _held(predict, shared):
    """The same prediction with the shared unknowns held, for fitting poses alone."""

    def predict_held(_, points, jacobian):
        pixels, to_shared, to_point = predict(shared, points, jacobian)
        return pixels, None if to_shared is None else to_shared[..., :0], to_point

    return predict_held


def _without_outline(setup):
    """The setup with an endless optic: on its way the solver may pass through glass that nobody could grind."""
    return replace(setup, optic=replace(setup.optic, radius=None)) if hasattr(setup.optic, "radius") else setup


def _with_outline(setup, start, notes):
    """The setup with the outline of the start, as far as the calibrated optic allows it."""
    radius = getattr(start.optic, "radius", None)
    if radius is None:
        return setup
    try:
        return replace(setup, optic=replace(setup.optic, radius=radius))
    except OpticError:
        steepest = np.deg2rad(setup.optic.apex_deg) + np.deg2rad(np.max(setup.optic.facet_deviation_deg or 0.0))
        fits = 0.999 * setup.optic.thickness / np.tan(steepest)
        notes.append(f"a prism of this thickness and angle ends at {fits:.2f} mm from its axis, not at {radius:g} mm")
        return replace(setup, optic=replace(setup.optic, radius=float(fits)))


def _check(observations, target, setups):
    points = np.asarray(target.points, dtype=float)
    if not len(observations):
        raise SetupError("there are no observations to calibrate from: was the target found in any photograph?")
    if not np.isfinite(observations.pixels).all():
        bad = np.flatnonzero(~np.isfinite(observations.pixels).all(-1))
        raise ShapeError(f"{len(bad)} observed pixels are not numbers (row {bad[0]} first): leave those rows out")
    if observations.point.min() < 0 or observations.point.max() >= len(points):
        raise ShapeError(
            f"points are numbered 0 to {len(points) - 1} on this target, but observations name "
            f"{observations.point.min()} to {observations.point.max()}: is it the right board?"
        )
    channels = observations.channel.max() + 1
    if channels > len(setups):
        raise SetupError(
            f"the observations have {channels} colour channels: give one setup for each, got {len(setups)}"
        )
    if not (np.isfinite(observations.sigma).all() and (observations.sigma > 0).all()):
        raise ShapeError("sigma, the standard deviation of each observed pixel, must be positive numbers of px")


def _start(observations, target, setup, notes):
    """Rows of photographs that show enough of the target, and a first pose for each of them."""
    points = np.asarray(target.points, dtype=float)[observations.point]
    guesses = start_poses(observations, points, list(setup.rig()), direct_view(setup))
    kept = [k for k, found in enumerate(guesses) if found]
    lost = [observations.photos[k] for k, found in enumerate(guesses) if not found]
    if lost:
        notes.append(f"left out, as no view shows four points of the target: {', '.join(lost)}")
    if not kept:
        raise SetupError("no photograph shows four points of the target in one view: nothing to start from")
    return observations.of_photos(kept), [guesses[k] for k in kept]


def without_outliers(calibration: Calibration) -> Observations:
    """The observations that the calibration trusts."""
    return calibration.observations.select(~calibration.outliers)


def recalibrate(calibration: Calibration, observations: Observations | None = None, **changes) -> Calibration:
    """Calibrate again from where a calibration ended, with other observations or free parameters."""
    found = calibration.setups
    free = changes.pop("free", calibration.unknowns.names)
    result = calibrate(observations or calibration.observations, calibration.target, found, free, **changes)
    return replace(result, notes=(*calibration.notes, *result.notes))
