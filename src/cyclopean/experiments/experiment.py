"""An experiment from what was seen to recovered depth, by each approach."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from ..calibration.depths import rms
from ..calibration.physical import Calibration
from ..calibration.routes import FIELD_POINT, PHYSICAL, ROUTES, Evidence, FieldPoint, nearest_to_axis
from ..errors import CyclopeanError, SetupError
from ..rigs import Setup, ViewLike
from ..targets import DIRECT, Observations, Target, together
from ..triangulation import triangulate

TRUE = "true setup"  # what nobody has outside a simulation: the limit that the corners set
ALL = (*ROUTES, TRUE)
USUAL = (
    "ray sketch (middle)",
    "ray sketch (edge)",
    FIELD_POINT,
    "virtual cameras, intrinsics free",
    PHYSICAL,
    TRUE,
)


class Seen(NamedTuple):
    """A known object, and where photographs show it."""

    observations: Observations
    target: Target


@dataclass(frozen=True, eq=False)
class Material:
    """What an experiment has to work from."""

    true: Setup | None  # what stands on the bench, where that is known
    drawn: Setup  # what the drawing says
    camera: Seen | None  # photographs without the optic
    calibration: Seen  # of a board through the optic, in several poses
    targets: Seen  # of a board square to the axis, through the optic
    depths: np.ndarray  # (T,) mm, of each of these photographs: z in the camera's frame


class Row(NamedTuple):
    """One approach at one depth."""

    approach: str
    actual: float  # mm
    points: int
    recovered: float  # mm, mean over the points
    deviation: float  # mm, standard deviation of the points
    error_percent: float  # of the mean
    rms_percent: float  # of the points' errors
    largest_percent: float  # of the points' errors


class Summary(NamedTuple):
    """One approach over all depths."""

    approach: str
    rms_percent: float  # of the points' errors
    largest_percent: float
    mean_percent: float  # mean of the points' errors: a scale that is off
    residual_px: float  # rms reprojection error of the triangulated points
    seconds: float


@dataclass(frozen=True, eq=False)
class Recovered:
    """What one approach came to."""

    approach: str
    views: Sequence[ViewLike]  # V; none where it failed
    points: np.ndarray  # (N, 3) mm, NaN where the rays part
    deviation: np.ndarray  # (N,) mm, expected standard deviation of depth by the noise of the corners
    residual: np.ndarray  # (N,) px
    seconds: float  # of the calibration
    message: str = ""  # what is wrong

    @property
    def failed(self) -> bool:
        """Whether there are no views."""
        return not len(self.views)


@dataclass(frozen=True, eq=False)
class Experiment:
    """Depths of a target, known and recovered by several approaches."""

    material: Material
    recovered: tuple[Recovered, ...]
    pixels: np.ndarray  # (N, V, 2) px, the target's points in each view; NaN where one does not show it
    actual: np.ndarray  # (N,) mm
    setup: Setup  # the drawing with the camera that the photographs without the optic tell
    physical: Calibration | None  # the physical model, where it was among the approaches
    field_point: FieldPoint | None  # the one that put a drawing right

    def of(self, approach: str) -> Recovered:
        """What one approach came to."""
        for one in self.recovered:
            if one.approach == approach:
                return one
        raise SetupError(f"the experiment has no approach {approach!r}; it has {', '.join(self.approaches)}")

    @property
    def approaches(self) -> tuple[str, ...]:
        """Names of the approaches."""
        return tuple(one.approach for one in self.recovered)

    @cached_property
    def rows(self) -> tuple[Row, ...]:
        """A row for each approach and each depth."""
        return tuple(self._row(one, depth) for one in self.recovered for depth in np.unique(self.actual))

    @cached_property
    def summary(self) -> tuple[Summary, ...]:
        """A row for each approach."""
        return tuple(self._summary(one) for one in self.recovered)

    def errors_percent(self, approach: str) -> np.ndarray:
        """Errors (N,) of depth of the points in percent of their actual depth; NaN where there is none."""
        return 100 * (self.of(approach).points[:, 2] / self.actual - 1)

    def _row(self, one, depth):
        found = one.points[self.actual == depth, 2]
        found = found[np.isfinite(found)]
        if not found.size:
            return Row(one.approach, float(depth), 0, *[np.nan] * 5)
        error = 100 * (found / depth - 1)
        figures = found.mean(), found.std(), error.mean(), rms(error), np.abs(error).max()
        return Row(one.approach, float(depth), found.size, *map(float, figures))

    def _summary(self, one):
        error = self.errors_percent(one.approach)
        error = error[np.isfinite(error)]
        if not error.size:
            return Summary(one.approach, *[np.nan] * 5)
        residual = rms(one.residual)
        largest, mean = float(np.abs(error).max()), float(error.mean())
        return Summary(one.approach, rms(error), largest, mean, residual, one.seconds)


def perform(
    material: Material,
    approaches: Sequence[str] = USUAL,
    progress: Callable[[int, int], None] | None = None,
) -> Experiment:
    """Calibrate by each approach and recover the depth of the target.

    Parameters
    ----------
    material : Material
        What there is to work from.
    approaches : sequence of names
        Some of `ALL`. The field point of "ray sketch + field point" is the corner nearest to the axis of the target
        at the middle one of its depths: this approach has seen one of the points by which it is judged.
    progress : callable, optional
        Called as ``progress(done, total)`` after each approach.

    Returns
    -------
    Experiment
        An approach that fails keeps its reason; its points are NaN.

    Raises
    ------
    SetupError
        An unknown approach, or the true setup where it is not known; depths that do not belong to the photographs.

    References
    ----------
    Xiao, thesis (National University of Singapore), sections 4.2, 5.2 and 6.2.
    """
    _check(material, approaches)
    pixels, actual = _corresponding(material)
    point = _field_point(material) if FIELD_POINT in approaches else None
    parts = [material.calibration] if material.camera is None else [material.camera, material.calibration]
    evidence = Evidence(*together([(part.observations, part.target) for part in parts]), material.drawn, point)
    sigma = float(np.median(material.targets.observations.sigma))
    results = []
    for done, name in enumerate(approaches):
        start = time.perf_counter()
        try:
            views, message = _views(material, evidence, name)
            seconds = time.perf_counter() - start
            found = triangulate([view.unbounded() for view in views], pixels, sigma)
            deviation = np.sqrt(found.covariance[..., 2, 2])
            results.append(Recovered(name, views, found.points, deviation, found.residual, seconds, message))
        except (CyclopeanError, np.linalg.LinAlgError) as fault:
            nothing = np.full(len(pixels), np.nan)
            results.append(Recovered(name, (), np.full((len(pixels), 3), np.nan), nothing, nothing, np.nan, str(fault)))
        if progress is not None:
            progress(done + 1, len(approaches))
    usable = PHYSICAL in approaches and not results[list(approaches).index(PHYSICAL)].failed
    physical = evidence.physical if usable else None
    return Experiment(material, tuple(results), pixels, actual, evidence.setup, physical, point)


def _check(material, approaches):
    unknown = [name for name in approaches if name not in ALL]
    if unknown or not len(approaches):
        raise SetupError(f"approaches must be some of {'; '.join(ALL)}; got {'; '.join(unknown) or 'none'}")
    if TRUE in approaches and material.true is None:
        raise SetupError(f"{TRUE!r} is known in a simulation only: leave it out of the approaches")
    photos = len(material.targets.observations.photos)
    depths = np.asarray(material.depths, dtype=float)
    if depths.shape != (photos,):
        raise SetupError(f"each of the {photos} photographs of the target wants its depth, got shape {depths.shape}")
    if not (np.isfinite(depths).all() and (depths > 0).all()):
        raise SetupError(f"depths of the target must be positive numbers of mm, got {depths}")


def _views(material, evidence, name):
    """The views that an approach ends with, and what is wrong with them."""
    if name == TRUE:
        return list(material.true.rig()), ""
    found = evidence.run(name)
    views = evidence.physical.setup.rig() if name == PHYSICAL else found.views  # those of the solver have no borders
    return list(views), found.message


def _corresponding(material):
    """Pixels (N, V, 2) of the target's points that two views or more show, and their depth (N,) mm."""
    seen = material.targets.observations
    seen = seen.select(seen.view != DIRECT)
    views = len(material.drawn.optic.paths(material.drawn.wavelength_nm))
    count = len(material.targets.target.points)
    keys, row = np.unique(seen.photo * count + seen.point, return_inverse=True)
    pixels = np.full((len(keys), views, 2), np.nan)
    pixels[row, seen.view] = seen.pixels
    depths = np.asarray(material.depths, dtype=float)[keys // count]
    two = np.isfinite(pixels[..., 0]).sum(-1) >= 2
    if not two.any():
        raise SetupError(
            "no two views show the same point of the target: take flatter facets, a wider lens, a larger target, or "
            "place it farther from the prism"
        )
    return pixels[two], depths[two]


def _field_point(material):
    """The corner nearest to the axis of the target at the middle one of its depths."""
    order = np.argsort(np.abs(material.depths - np.median(material.depths)), kind="stable")
    fault: SetupError | None = None
    for photo in order:
        try:
            _, pixels = nearest_to_axis(material.targets.observations, material.drawn, int(photo))
            return FieldPoint(pixels, float(material.depths[photo]))
        except SetupError as reason:
            fault = fault or reason
    raise fault or SetupError("there is no photograph of the target to take a field point from")
