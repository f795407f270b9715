"""Tolerances of making and mounting: what they do to depths, before and after a calibration, by exact rays."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np

from ..calibration.depths import working_volume
from ..calibration.unknowns import TIED_FOCAL, Unknowns
from ..errors import SetupError
from ..rigs import Rig, Setup
from .budget import standard_tolerances
from .sensitivity import point_sensitivity
from .tolerance_calibration import CalibrationPlan, Remainder, remainder
from .tolerance_draws import bare_views, drawn_pixels, nearby_points
from .tolerance_errors import DepthErrorSample, Drivers, drivers_of

Shape = Literal["normal", "uniform", "truncated"]
_CHUNK = 250  # setups that are computed at a time, between two calls of `progress`
_DEPTHS = 5
_FARTHEST = 10.0  # times the true depth, beyond which a computed one is none


@dataclass(frozen=True)
class Tolerance:
    """How far one parameter, or each of a group, may be from the drawing: in mm, rad, px."""

    name: str  # as in `setup.parameter_names`, or a short one: "optic.facets", "camera.focal_tied"
    size: float  # normal: standard deviation; uniform: half of the width; truncated: the limit to both sides
    shape: Shape = "normal"
    limit_sigmas: float = 2.0  # truncated: the limit in standard deviations of the normal curve that is cut off

    def __post_init__(self):
        if not 0 <= self.size < np.inf:
            raise SetupError(f"the tolerance of {self.name} must be a finite number, 0 or more, got {self.size}")
        if self.shape not in get_args(Shape):
            raise SetupError(f"the tolerance of {self.name} is one of {', '.join(get_args(Shape))}, got {self.shape!r}")
        if not 0 < self.limit_sigmas < np.inf:
            raise SetupError(f"the limit of {self.name} must be a positive number of sigmas, got {self.limit_sigmas}")

    @property
    def sigma(self) -> float:
        """Standard deviation."""
        if self.shape == "normal":
            return self.size
        if self.shape == "uniform":
            return self.size / np.sqrt(3)
        k = self.limit_sigmas
        inside = _normal_within(k)
        density = np.exp(-(k**2) / 2) / np.sqrt(2 * np.pi)
        return self.size / k * np.sqrt(1 - 2 * k * density / inside)

    def draw(self, rng: np.random.Generator, count: int) -> np.ndarray:
        """Independent deviations (count,) from the drawing."""
        if self.shape == "normal":
            return rng.normal(0.0, 1.0, count) * self.size
        if self.shape == "uniform":
            return rng.uniform(-1.0, 1.0, count) * self.size
        from scipy.special import ndtri

        tail = (1 - _normal_within(self.limit_sigmas)) / 2
        return ndtri(rng.uniform(tail, 1 - tail, count)) * (self.size / self.limit_sigmas)


def _normal_within(sigmas):
    """Probability of a normal number to lie within so many sigmas."""
    from scipy.special import erf

    return float(erf(sigmas / np.sqrt(2)))


def usual_tolerances(setup: Setup) -> tuple[Tolerance, ...]:
    """Those of the error budget (`standard_tolerances`), as standard deviations; focal lengths err together."""
    sigmas = standard_tolerances(setup)
    found = [Tolerance(TIED_FOCAL, sigmas["camera.focal_x"])] if "camera.focal_x" in sigmas else []
    others = [name for name in sigmas if not name.startswith("camera.focal")]
    return (*found, *(Tolerance(name, sigmas[name]) for name in others))


@dataclass(frozen=True, eq=False)
class ToleranceAnalysis:
    """Depth errors of D setups that were drawn at random within their tolerances."""

    setup: Setup  # the drawing
    tolerances: dict[str, Tolerance]  # of each of the T parameters, by full name
    deviations: np.ndarray  # (D, T) real setup minus drawing; mm, rad, px
    before: DepthErrorSample  # depths by the drawing
    after: DepthErrorSample | None  # depths by a calibrated setup; None where no calibration was planned
    plan: CalibrationPlan | None
    remainder: Remainder | None
    drivers: Drivers  # which parameter the errors before calibration come from
    sources: dict[str, float]  # of the variance after calibration: share of each parameter and of "noise of corners"
    noise: float  # px, of a matched pixel coordinate, that the errors hold
    seed: int
    wanted: int  # how many setups should have been drawn; more than D after an interruption

    @property
    def names(self) -> tuple[str, ...]:
        """Full names of the T parameters."""
        return tuple(self.tolerances)

    @property
    def interrupted(self) -> bool:
        """Whether fewer setups were drawn than asked for."""
        return len(self.deviations) < self.wanted


def tolerance_analysis(
    setup: Setup,
    tolerances: Sequence[Tolerance] | None = None,
    depths: Sequence[float] | np.ndarray | None = None,
    *,
    draws: int = 10_000,
    samples: int = 4,
    noise: float = 0.0,
    plan: CalibrationPlan | None = None,
    seed: int = 0,
    progress: Callable[[int, int], None] | None = None,
    rig: Rig | None = None,
) -> ToleranceAnalysis:
    """Draw real setups at random and find what depths come out where the drawing, or a calibration, is believed.

    Parameters
    ----------
    setup : Setup
        The drawing.
    tolerances : sequence of Tolerance, optional
        What may differ; a later one replaces an earlier one of the same parameter. `usual_tolerances` without it.
    depths : sequence of Z mm, optional
        z of the planes to look at; five from the nearest to the farthest depth of the setup without it.
    draws : int
        How many setups are drawn.
    samples : int
        Points across the common field at each depth.
    noise : float
        Standard deviation of a matched pixel coordinate, px; 0: what the setup alone does.
    plan : CalibrationPlan, optional
        Photographs that the setup is calibrated from, see `usual_plan`.
    seed : int
        The same seed draws the same setups.
    progress : callable, optional
        Called as ``progress(done, draws)``.
    rig : Rig, optional
        That of the setup, where there is one already: its regions need not be traced again.

    Returns
    -------
    ToleranceAnalysis
        Of the setups that were ready where the work was interrupted (KeyboardInterrupt) after the first of them.

    Raises
    ------
    SetupError
        For parameters that the setup does not have, depths at which no two views share anything, and tolerances so wide
        that no drawn setup gives any depth.

    Notes
    -----
    Before calibration every draw is another real setup: points of the common field are projected through it along
    exact rays, and triangulated by n-view least squares with the drawing. After calibration the setup that is
    believed differs from the real one by a `Remainder`; this part is of first order, as is what it does to depths.
    Exact rays would not better it: what a calibration is wrong about lies along directions that photographs cannot
    tell, which are straight to first order only.
    """
    _check_numbers(draws, samples, noise)
    chosen = _by_name(setup, usual_tolerances(setup) if tolerances is None else tolerances)
    unknowns = Unknowns.of([setup], tuple(chosen))
    chosen = {name: chosen[name] for name in unknowns.names}  # in the order of the setup
    rig = setup.rig() if rig is None else rig
    volume = _volume(setup, rig, depths, samples)
    stream = np.random.default_rng([int(seed), 0])
    deviations = np.stack([tolerance.draw(stream, int(draws)) for tolerance in chosen.values()], -1)
    left = None
    if plan is not None:
        sigmas = np.array([tolerance.sigma for tolerance in chosen.values()])
        left = remainder(setup, plan, unknowns, sigmas, rig)
    work = _Work(setup, unknowns, volume, left, float(noise), int(seed))
    before, after = _draw_all(work, deviations, progress)
    return _result(work, chosen, deviations[: len(before)], before, after, plan, int(seed), int(draws))


def _check_numbers(draws, samples, noise):
    if draws != int(draws) or draws < 2:
        raise SetupError(f"a distribution needs 2 draws or more, got {draws}")
    if samples != int(samples) or samples < 1:
        raise SetupError(f"samples across the field must be 1 or more, got {samples}")
    if not 0 <= noise < np.inf:
        raise SetupError(f"the pixel noise must be 0 or a positive number of px, got {noise}")


def _by_name(setup, tolerances):
    """The tolerance of each parameter, by full name; a later one replaces an earlier one."""
    chosen: dict[str, Tolerance] = {}
    for tolerance in tolerances:
        for name in Unknowns.of([setup], [tolerance.name]).names:
            if name == TIED_FOCAL:
                chosen = {other: t for other, t in chosen.items() if not other.startswith("camera.focal")}
            elif name.startswith("camera.focal"):
                chosen.pop(TIED_FOCAL, None)
            chosen[name] = tolerance
    if not chosen:
        raise SetupError("there are no tolerances: name at least one parameter that may differ from the drawing")
    return chosen


def _volume(setup, rig, depths, samples):
    if depths is None:
        near, far = setup.depths or rig.working_depths
        depths = [float(f"{depth:.4g}") for depth in np.geomspace(near, far, _DEPTHS)]
    if len(rig) < 2:
        raise SetupError(f"depth needs two views or more, and this {setup.optic.kind} gives {len(rig)}")
    return working_volume(rig, np.sort(np.atleast_1d(np.asarray(depths, dtype=float))), int(samples))


class _Work:
    """What does not change from draw to draw."""

    def __init__(self, setup, unknowns, volume, left, noise, seed):
        self.setup, self.unknowns, self.volume, self.left, self.noise = setup, unknowns, volume, left, noise
        self.pixel_stream, self.corner_stream = (np.random.default_rng([seed, k]) for k in (1, 2))
        self.points = volume.points[volume.common]
        self.views = bare_views(setup)
        self.drawing = np.concatenate([setup.camera.lens, setup.optic.parameters(setup.wavelength_nm)])
        sensitivity = point_sensitivity(setup, self.points, seen=volume.seen[volume.common])
        self.shifts = sensitivity.matrix.reshape(-1, len(self.drawing))  # (N * 3, F)
        self.slopes = sensitivity.depth  # (N, F) mm, for a real setup that exceeds the one that is believed
        self.gain = sensitivity.response.gain[:, 2].reshape(len(self.points), -1)  # (N, V * 2) mm/px

    def errors(self, deviations):
        """Depth errors (D, N) mm with the drawing, and with a calibrated setup (None where there is none)."""
        differences = deviations @ self.unknowns.matrix[0].T
        pixels = drawn_pixels(self.setup, self.drawing + differences, self.points)
        noise = self.pixel_stream.normal(0.0, self.noise, pixels.shape) if self.noise else np.zeros(pixels.shape)
        start = self.points + (differences @ self.shifts.T).reshape(-1, *self.points.shape)
        found = nearby_points(self.views, start, pixels + noise)[..., 2]
        sane = (found > 0) & (found < _FARTHEST * self.points[:, 2])
        before = np.where(sane, found - self.points[:, 2], np.inf)
        before[np.isfinite(pixels).all(-1).sum(-1) < 2] = np.nan
        if self.left is None:
            return before, None
        corners = self.corner_stream.normal(size=(len(deviations), len(self.drawing))) @ self.left.noise_root.T
        after = -(deviations @ self.left.carried.T + corners) @ self.slopes.T
        if self.noise:
            after += np.einsum("nk,dnk->dn", self.gain, noise.reshape(*after.shape, -1))
        return before, np.where(np.isnan(before), np.nan, after)


def _draw_all(work, deviations, progress):
    """Depth errors (D, N) before and after calibration; of fewer draws where the work is interrupted."""
    parts = []
    try:
        for start in range(0, len(deviations), _CHUNK):
            part = deviations[start : start + _CHUNK]
            parts.append(work.errors(part))
            if progress is not None:
                progress(start + len(part), len(deviations))
    except KeyboardInterrupt:
        if not parts:
            raise
    before, after = zip(*parts, strict=True)
    return np.concatenate(before), None if work.left is None else np.concatenate(after)


def _result(work, chosen, deviations, before, after, plan, seed, wanted):
    volume, real = work.volume, work.unknowns.matrix[0]
    slopes = work.slopes
    sigmas = np.array([tolerance.sigma for tolerance in chosen.values()])
    noise = work.noise**2 * np.sum(work.gain**2, axis=-1)
    each = (slopes @ real * sigmas) ** 2  # (N, T) mm^2
    first = _sample(volume, before, np.sqrt(each.sum(-1) + noise))
    second, sources = None, {}
    if after is not None:
        carried = (slopes @ work.left.carried * sigmas) ** 2
        corners = np.einsum("nf,fg,ng->n", slopes, work.left.noise, slopes)
        second = _sample(volume, after, np.sqrt(carried.sum(-1) + corners + noise))
        shares = np.append(carried.sum(0), corners.sum())
        sources = dict(zip((*chosen, "noise of corners"), shares / max(shares.sum(), 1e-300), strict=True))
    linear = _shares(volume, each)
    if first.failed.all():
        widest = tuple(chosen)[int(np.argmax(linear.sum(0)))]
        raise SetupError(f"no drawn setup gives any depth; the tolerance of {widest} is too wide")
    drivers = drivers_of(tuple(chosen), deviations, first, linear)
    return ToleranceAnalysis(
        work.setup, chosen, deviations, first, second, plan, work.left, drivers, sources, work.noise, seed, wanted
    )


def _shares(volume, each):
    """Share (Z, T) of every tolerance in the variance at each depth, to first order."""
    plane = np.nonzero(volume.common)[0]
    sums = np.stack([each[plane == k].sum(0) for k in range(len(volume.depths))])
    return sums / np.maximum(sums.sum(-1, keepdims=True), 1e-300)


def _sample(volume, errors, linear):
    """Errors (D, N) of all points together as errors by depth."""
    plane = np.nonzero(volume.common)[0]
    return DepthErrorSample(volume.depths, volume.points[volume.common], plane, errors, linear)
