"""What accuracy a prism keeps after it was made, mounted and calibrated: many prisms drawn within their tolerances."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from ..analysis import Tolerance, ToleranceAnalysis, tolerance_analysis, usual_plan
from ..analysis.tolerance_errors import DepthErrorSample
from ..calibration.depths import largest, rms, working_volume
from ..calibration.unknowns import Unknowns
from ..errors import CyclopeanError, SetupError
from ..rigs import Rig, Setup
from ..rigs.view import DEFAULT_MARGIN
from ..triangulation.sensitivity import point_response
from .catalogue import ToleranceGrade, grade
from .evaluation import DEPTHS
from .requirements import Candidate, Requirements

SHARE = 0.95
"""Of the prisms made, that must keep the accuracy."""
DIRECT_PHOTOS = 6
"""Photographs of the board without the prism: only they show the camera's own focal length."""
DRAWS = 400
_SAMPLES = 5  # across the field, for the errors of each prism
_FINE = 16  # the same for the noise of matching
_SIDE = 1280  # px; pictures with a longer side are judged by larger pixels, with noise in proportion
_SIGMAS = 1.96  # of a normal number, that hold 95 % of the cases
MATCHING = "noise of matching"


@dataclass(frozen=True, eq=False)
class ErrorSpread:
    """Relative depth errors of D prisms at Z depths; NaN where no two views share anything, inf where rays part.

    The error of one prism at one depth is the root mean square, over the field, of its systematic error and of the
    noise of matched pixels together: what a depth that is measured there is wrong by.
    """

    errors: np.ndarray  # (D, Z)
    worst: np.ndarray  # (D, Z) largest systematic error with the largest noise

    @property
    def sigma(self) -> np.ndarray:
        """(Z,) root mean square over the prisms, of those that give depths."""
        square = np.where(np.isfinite(self.errors), self.errors, np.nan) ** 2
        return np.sqrt(_over_prisms(np.nanmean, square))

    @property
    def median(self) -> np.ndarray:
        """(Z,) error that half of the prisms keep."""
        return self.quantile(0.5)

    def quantile(self, level: float) -> np.ndarray:
        """(Z,) error that this share of the prisms keeps; NaN where more of them give no depth."""
        return self._ordered(self.errors, np.ceil(level * len(self.errors)) - 1)

    def quantile_bounds(self, level: float) -> np.ndarray:
        """(2, Z) between which the quantile of all prisms lies with 95 %, as only D were drawn.

        By the ranks that a binomial number allows (Conover 1999, Practical nonparametric statistics, section 3.2).
        """
        count = len(self.errors)
        half = _SIGMAS * np.sqrt(count * level * (1 - level))
        ranks = np.clip([np.floor(level * count - half), np.ceil(level * count + half)], 0, count - 1)
        return np.stack([self._ordered(self.errors, rank) for rank in ranks])

    @property
    def worst_point(self) -> np.ndarray:
        """(Z,) error that 95 % of the prisms keep at their worst point."""
        return self._ordered(self.worst, np.ceil(SHARE * len(self.worst)) - 1)

    def share(self, accuracy: float) -> float:
        """Share of the prisms whose error is not above `accuracy` at any depth."""
        with np.errstate(invalid="ignore"):
            return float((self.errors <= accuracy).all(-1).mean())

    def share_bounds(self, accuracy: float) -> tuple[float, float]:
        """Between which the share of all prisms lies with 95 %, as only D were drawn (Wilson 1927, score interval)."""
        count, square = len(self.errors), _SIGMAS**2
        share = self.share(accuracy)
        middle = (share + square / (2 * count)) / (1 + square / count)
        half = _SIGMAS * np.sqrt(share * (1 - share) / count + square / (4 * count**2)) / (1 + square / count)
        return float(max(middle - half, 0.0)), float(min(middle + half, 1.0))

    def _ordered(self, values, rank):
        known = np.sort(np.where(np.isnan(values), np.inf, values), axis=0)[int(rank)]
        return np.where(np.isnan(values).all(0), np.nan, known)


@dataclass(frozen=True, eq=False)
class KeptAccuracy:
    """What a design keeps of its accuracy on paper."""

    depths: np.ndarray  # (Z,) mm
    noise: np.ndarray  # (Z,) relative standard deviation by noise of matched pixels, root mean square over the field
    before: ErrorSpread | None  # depths by the drawing
    after: ErrorSpread | None  # depths by a calibrated setup
    accuracy: float | None  # relative, that is wanted
    drivers_before: dict[str, float]  # share of each parameter and of noise in the variance, the largest first
    drivers_after: dict[str, float]
    tolerances: tuple[Tolerance, ...]
    plan: str  # the calibration, in words
    reason: str = ""  # why the design could not be judged, at some depth or at all

    @property
    def share(self) -> float:
        """Share of the prisms that keep the wanted accuracy at all depths once calibrated; NaN where none is wanted."""
        if self.accuracy is None:
            return float("nan")
        return 0.0 if self.after is None else self.after.share(self.accuracy)

    @property
    def share_bounds(self) -> tuple[float, float]:
        """Between which the share lies with 95 %, as only so many prisms were drawn."""
        if self.accuracy is None or self.after is None:
            return self.share, self.share
        return self.after.share_bounds(self.accuracy)

    @property
    def share_before(self) -> float:
        """The share that would keep it without a calibration."""
        if self.accuracy is None:
            return float("nan")
        return 0.0 if self.before is None else self.before.share(self.accuracy)

    @property
    def kept(self) -> bool | None:
        """Whether 95 % of the prisms keep the wanted accuracy once calibrated; None where none is wanted."""
        return None if self.accuracy is None else self.share >= SHARE

    @property
    def sure(self) -> bool:
        """Whether more draws would hardly change `kept`: 95 % lies outside of the bounds of the share."""
        low, high = self.share_bounds
        return not low < SHARE < high

    @cached_property
    def worst(self) -> float:
        """Error that 95 % of the prisms keep once calibrated, at the depth where it is largest; inf if blind at any."""
        return float("inf") if self.after is None else _highest(self.after.quantile(SHARE))

    @cached_property
    def worst_before(self) -> float:
        """The same without a calibration."""
        return float("inf") if self.before is None else _highest(self.before.quantile(SHARE))

    @property
    def driver(self) -> str:
        """What most of the variance after calibration comes from; empty where the design could not be judged."""
        return next(iter(self.drivers_after), "")

    @property
    def driver_before(self) -> str:
        """The parameter that most of the variance before calibration comes from."""
        return next((name for name in self.drivers_before if name != MATCHING), "")

    @property
    def text(self) -> str:
        """In a sentence."""
        if self.after is None or self.reason:
            return f"cannot be judged: {self.reason}"
        part = 100 * self.drivers_after[self.driver]
        said = f"95 % of prisms keep {100 * self.worst:.2g} %, {part:.0f} % of its variance from {self.driver}"
        if self.accuracy is not None:
            low, high = self.share_bounds
            said += f"; {100 * self.share:.0f} % ({100 * low:.0f} to {100 * high:.0f}) keep {100 * self.accuracy:g} %"
        return f"{said}; without a calibration {100 * self.worst_before:.2g} %, most of it from {self.driver_before}"


def keep_accuracy(
    candidate: Candidate | Setup,
    requirements: Requirements,
    *,
    draws: int = DRAWS,
    samples: int = _SAMPLES,
    direct_photos: int = DIRECT_PHOTOS,
    seed: int = 0,
    progress: Callable[[int, int], None] | None = None,
) -> KeptAccuracy:
    """Draw prisms within the tolerances of maker and mount, and find the accuracy that each keeps.

    Parameters
    ----------
    candidate : Candidate or Setup
        The drawing.
    requirements : Requirements
        Depths, wanted accuracy, noise, tolerances, and photographs of the calibration.
    draws : int
        How many prisms are drawn; 400 tell a share of 95 % to about 2 %.
    samples : int
        Points across the common field at each depth, an odd number: fields may be a cross about the axis. More are
        taken where these miss the field.
    direct_photos : int
        Photographs of the board without the prism, by which the camera is calibrated. Without them the focal length
        stays as uncertain as the lens maker leaves it, and depths err by as much.
    seed : int
        The same seed draws the same prisms.
    progress : callable, optional
        Called as ``progress(done, draws)``.

    Returns
    -------
    KeptAccuracy
        With a `reason` where two views share nothing at a depth, or no photograph of the board shows enough.

    Notes
    -----
    `tolerance_analysis` says what the errors before and after calibration are. Dispersion, temperature and the shape of
    surfaces are not in it. Pictures with more than 1280 px to a side are judged by larger pixels: rays, boards and
    errors stay what they are, only borders of views become coarser.

    References
    ----------
    JCGM 101:2008, Propagation of distributions using a Monte Carlo method, section 5.
    """
    setup = candidate if isinstance(candidate, Setup) else candidate.setup
    _check(draws, samples)
    tolerances = drawn_tolerances(setup, requirements)
    depths = np.geomspace(*requirements.depths, DEPTHS)
    factor = _factor(setup.camera, tolerances)
    try:
        coarse, rig = _coarse(setup, factor)
        plan = usual_plan(
            coarse, requirements.depths, photos=requirements.photos, direct_photos=direct_photos,
            sigma=requirements.corner_noise / factor, rig=rig,
        )  # fmt: skip
        noise = _noise(rig, depths, requirements.noise / factor)
        for count in (samples, 2 * samples + 1):
            analysis = tolerance_analysis(
                coarse, _scaled(tolerances, factor), depths, draws=draws, samples=count, plan=plan, seed=seed,
                progress=progress, rig=rig,
            )  # fmt: skip
            if all((analysis.before.plane == k).any() for k, part in enumerate(noise) if len(part)):
                break
    except CyclopeanError as error:
        nothing = np.full(DEPTHS, np.nan)
        return KeptAccuracy(depths, nothing, None, None, requirements.accuracy, {}, {}, tolerances, "", str(error))
    words = replace(plan, sigma=requirements.corner_noise).text
    return _judged(analysis, noise, requirements.accuracy, tolerances, words)


def drawn_tolerances(setup: Setup, requirements: Requirements) -> tuple[Tolerance, ...]:
    """What may differ from a drawing: of the requirements' grade or as they list it, else the usual."""
    given = requirements.tolerances
    if given is None or isinstance(given, str | ToleranceGrade):
        return grade(given or "usual", setup)
    if not given:
        raise SetupError("there are no tolerances: name at least one parameter that may differ, or a grade")
    for tolerance in given:
        Unknowns.of([setup], [tolerance.name])  # a name that the setup does not have is said here
    return tuple(given)


def _check(draws, samples):
    if draws != int(draws) or draws < 20:
        raise SetupError(f"quantiles of prisms need 20 draws or more, got {draws}")
    if samples != int(samples) or samples < 1:
        raise SetupError(f"samples across the field must be 1 or more, got {samples}")


def _factor(camera, tolerances):
    """Pixels to a side that are taken as one."""
    if any(tolerance.name == "camera" for tolerance in tolerances):  # one size for px and numbers alike
        return 1
    return max(int(np.ceil(max(camera.size) / _SIDE)), 1)


def _coarse(setup: Setup, factor: int) -> tuple[Setup, Rig]:
    """The setup with larger pixels, and its rig with margins beside seams of the same width in mm."""
    if factor == 1:
        return setup, setup.rig()
    coarse = replace(setup, camera=setup.camera.with_larger_pixels(factor))
    blend = max(coarse.blend_band(path) for path in coarse.optic.paths(coarse.wavelength_nm))
    return coarse, coarse.rig(margin=DEFAULT_MARGIN / factor + blend / 2)


def _scaled(tolerances, factor):
    """Tolerances in larger pixels."""
    in_pixels = ("camera.focal", "camera.centre")
    return tuple(
        replace(tolerance, size=tolerance.size / factor) if tolerance.name.startswith(in_pixels) else tolerance
        for tolerance in tolerances
    )


def _judged(analysis: ToleranceAnalysis, noise: Sequence[np.ndarray], accuracy, tolerances, words) -> KeptAccuracy:
    depths, plane = analysis.before.depths, analysis.before.plane
    assert analysis.after is not None
    blind = np.array([not (len(part) and (plane == k).any()) for k, part in enumerate(noise)])
    said = ", ".join(f"{depth:.4g}" for depth in depths[blind])
    first = analysis.drivers.linear[~blind].mean(0)  # of the parameters, before calibration
    return KeptAccuracy(
        depths,
        np.array([rms(part) / depth for part, depth in zip(noise, depths, strict=True)]),
        _spread(analysis.before, noise),
        _spread(analysis.after, noise),
        accuracy,
        _drivers(analysis.before, noise, dict(zip(analysis.names, first, strict=True))),
        _drivers(analysis.after, noise, analysis.sources),
        tolerances,
        words,
        f"two views share next to nothing at {said} mm" if said else "",
    )


def _noise(rig, depths, sigma):
    """Standard deviations (...,) mm of depth by noise of matching, for points of the common field at each depth."""
    volume = working_volume(rig, depths, _FINE)
    parts = []
    for points, seen, common in zip(volume.points, volume.seen, volume.common, strict=True):
        if common.any():
            response = point_response(rig, points[common], seen[common])
            parts.append(sigma * np.sqrt(response.covariance[:, 2, 2]))
        else:
            parts.append(np.zeros(0))
    return parts


def _spread(sample: DepthErrorSample, noise: Sequence[np.ndarray]) -> ErrorSpread:
    """Errors of each prism at each depth, relative."""
    errors = np.full((len(sample.errors), len(sample.depths)), np.nan)
    worst = errors.copy()
    for k, depth in enumerate(sample.depths):
        here = sample.plane == k
        if here.any() and len(noise[k]):
            square = sample.errors[:, here] ** 2
            errors[:, k] = np.sqrt(_over_field(np.nanmean, square) + rms(noise[k]) ** 2) / depth
            worst[:, k] = np.sqrt(_over_field(np.nanmax, square) + largest(noise[k]) ** 2) / depth
    return ErrorSpread(errors, worst)


def _over_field(figure, values):
    """A figure (D,) of values (D, N) that skips NaN; inf where a prism shows no point."""
    shown = ~np.isnan(values).all(-1)
    found = np.full(len(values), np.inf)
    found[shown] = figure(values[shown], axis=-1)
    return found


def _over_prisms(figure, values):
    """A figure (Z,) of values (D, Z) that skips NaN; NaN where nothing is known."""
    known = ~np.isnan(values).all(0)
    found = np.full(values.shape[1], np.nan)
    found[known] = figure(values[:, known], axis=0)
    return found


def _drivers(sample, noise, shares):
    """Shares with that of matching, the largest first, mean over depths; `shares` are those in the systematic part."""
    pairs = [(rms(sample.linear[sample.plane == k]), rms(part)) for k, part in enumerate(noise) if len(part)]
    part = float(np.mean([random**2 / max(systematic**2 + random**2, 1e-300) for systematic, random in pairs]))
    everything = {name: float(share) * (1 - part) for name, share in shares.items()} | {MATCHING: part}
    return dict(sorted(everything.items(), key=lambda item: -item[1]))


def _highest(values):
    return float(np.where(np.isnan(values), np.inf, values).max())
