"""Error budget: what each source of error does to depth, and which one to look after first."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from ..calibration.depths import Volume, finite, working_volume
from ..calibration.unknowns import Unknowns, kind_of
from ..errors import MediumError, SetupError, ShapeError
from ..optics import Medium
from ..rigs import Setup
from .chromatic import bends_colours, index_at
from .sensitivity import Sensitivity, check_views, point_sensitivity
from .thermal import ThermalResponse, thermal_response

_ARCMIN = np.deg2rad(1 / 60)
_DEPTHS = 5


class UsualTolerance(NamedTuple):
    """How well a kind of parameter is usually known."""

    pattern: str  # of full names
    source: str  # the row of the budget that it belongs to
    sigma: float  # standard deviation in mm, rad, px, 1; or per value; or px at the picture's corner
    unit: str  # "", "relative" or "corner"
    origin: str


USUAL_TOLERANCES = (
    UsualTolerance(r"camera\.focal_[xy]", "focal length", 0.001, "relative", "assumed"),
    UsualTolerance(r"camera\.centre_[xy]", "principal point", 2.0, "", "assumed"),
    UsualTolerance(r"camera\.(k1|k2|p1|p2)", "lens distortion", 0.3, "corner", "assumed"),
    UsualTolerance(r"camera\.k3", "lens distortion", 0.0, "", "k1 and k2 stand for it"),
    UsualTolerance(r"optic\.tilt_[xyz]", "tilt of the optic", np.deg2rad(0.2), "", "assumed"),
    UsualTolerance(r"optic\.shift_[xy]", "shift of the optic", 0.2, "", "assumed"),
    UsualTolerance(r"optic\.distance", "distance of the optic", 0.5, "", "assumed"),
    UsualTolerance(r"optic\.apex", "apex angle", _ARCMIN, "", "Tensun Optics, product page Wedge prism"),
    UsualTolerance(r"optic\.azimuth", "azimuth", 0.0, "", "the tilt about z stands for it"),
    UsualTolerance(r"optic\.thickness", "thickness", 0.1, "", "OptoSigma, Outer Dimension Tolerance"),
    UsualTolerance(
        r"optic\.facet\d+_angle", "facet angles", _ARCMIN / 2, "", "assumed, of one facet against the others"
    ),
    UsualTolerance(r"optic\.facet\d+_azimuth", "facet azimuths", 3 * _ARCMIN, "", "assumed"),
    UsualTolerance(r"optic\.index", "glass index", 0.0005, "", "Optimax, Manufacturing Tolerance Chart, precision"),
    UsualTolerance(r"optic\.mirror\d+_tilt_[uv]", "mirror tilts", np.deg2rad(0.2), "", "assumed"),
    UsualTolerance(r"optic\.mirror\d+_advance", "mirror positions", 0.2, "", "assumed"),
)
"""What a drawing is usually off by, as standard deviations. "corner": each term moves a corner of the picture by so
many px. Limits of makers are taken as standard deviations, which is on the careful side."""


@dataclass(frozen=True, eq=False)
class Source:
    """A source of error: independent errors of one standard deviation each, and how they move points."""

    name: str
    size: str  # how large it is, in words
    shifts: np.ndarray  # (D, H, W, 3, K) mm, of points for each of K independent errors; NaN outside the common field
    parts: tuple[str, ...] = ()  # (K,) what each error is, where it has a name

    @property
    def sigma(self) -> np.ndarray:
        """(D, H, W) mm, standard deviation of depth."""
        return np.sqrt(np.sum(self.shifts[..., 2, :] ** 2, axis=-1))


class Row(NamedTuple):
    """One source at one depth."""

    name: str
    size: str
    sigma: float  # mm of depth, median over the field
    percent: float  # the same in percent of depth
    worst: float  # mm, largest over the field
    share: float  # of the variance of depth, mean over the field; 1 for all together


@dataclass(frozen=True, eq=False)
class Budget:
    """Standard deviations of depth over the common field of view, by source."""

    setup: Setup
    volume: Volume  # D depths, points (D, H, W, 3) mm, and which views see them
    sensitivity: Sensitivity  # of the points (D, H, W)
    sources: tuple[Source, ...]  # the largest first, over all depths
    warmth: ThermalResponse  # changes of the setup per kelvin
    notes: tuple[str, ...] = ()  # what is not in it
    within: Mapping[str, float] = field(
        default_factory=dict
    )  # parts of the calibration's variance, at the middle depth

    @property
    def depths(self) -> np.ndarray:
        """(D,) mm."""
        return self.volume.depths

    @property
    def total(self) -> np.ndarray:
        """(D, H, W) mm, standard deviation of depth by all sources together."""
        return np.sqrt(np.sum([source.sigma**2 for source in self.sources], axis=0))

    def share(self, source: Source, k: int) -> float:
        """Share of a source in the variance of depth at depth number k, mean over the field."""
        return float(np.nanmean(source.sigma[k] ** 2) / np.nanmean(self.total[k] ** 2))

    def table(self, k: int | None = None) -> list[Row]:
        """Rows at depth number k (the middle one where not given), the largest share first; the last is the total."""
        k = self.middle if k is None else k
        if not np.isfinite(self.total[k]).any():
            raise SetupError(f"no two views share anything at {self.depths[k]:g} mm")
        rows = [self._row(s.name, s.size, s.sigma[k], k, self.share(s, k)) for s in self.sources]
        rows.sort(key=lambda row: -row.share)
        return [*rows, self._row("all together", "", self.total[k], k, 1.0)]

    @property
    def middle(self) -> int:
        """The number of the depth nearest to the middle at which two views share anything."""
        there = np.flatnonzero(np.isfinite(self.total).any((1, 2)))
        return int(there[np.argmin(np.abs(there - (len(self.depths) - 1) / 2))])

    def _row(self, name, size, sigma, k, share):
        median = float(np.nanmedian(sigma))
        return Row(name, size, median, 100 * median / float(self.depths[k]), float(np.nanmax(sigma)), share)


def standard_tolerances(setup: Setup) -> dict[str, float]:
    """Usual standard deviations (mm, rad, px, 1) of a setup's parameters by full name; see `USUAL_TOLERANCES`."""
    values = np.concatenate([setup.camera.lens, setup.optic.parameters(setup.wavelength_nm)])
    found = {}
    for name, value in zip(setup.parameter_names, values, strict=True):
        for tolerance in USUAL_TOLERANCES:
            if re.fullmatch(tolerance.pattern, name):
                found[name] = _sigma_of(tolerance, name, value, setup)
                break
    return {name: sigma for name, sigma in found.items() if sigma > 0}


def error_budget(
    setup: Setup,
    depths: Sequence[float] | ArrayLike | None = None,
    *,
    tolerances: Mapping[str, float] | None = None,
    sigma: float = 0.1,
    temperature_range: float = 5.0,
    band: tuple[float, float] | None = None,
    covariance: tuple[Sequence[str], np.ndarray] | None = None,
    mount: str | float = "aluminium",
    glass: str | Medium | None = None,
    lens_per_kelvin: float | None = None,
    samples: int = 24,
) -> Budget:
    """What each source of error does to depth, over the common field of view.

    Parameters
    ----------
    setup : Setup
    depths : sequence of D mm, optional
        Five over the setup's depths, or the rig's working depths, where not given.
    tolerances : mapping, optional
        Standard deviations (mm, rad, px, 1) by full name or short one ("camera.focal", "optic.facets"); they replace
        the usual ones (`standard_tolerances`). 0 leaves a parameter out.
    sigma : float
        Noise of a matched pixel coordinate, px.
    temperature_range : float
        Half width, K, of the temperatures at which the setup is used, all equally likely.
    band : (2,) nm, optional
        Shortest and longest wavelength that may reach the camera; the setup's own +- 5 nm where not given. The mean
        colour of what is seen is taken to lie anywhere in the band.
    covariance : (names, (S, S) matrix), optional
        Of a calibration (`calibration.unknowns.names`, `calibration.solution.covariance`): it replaces the usual
        tolerances, and correlations count.
    mount, glass, lens_per_kelvin
        See `thermal_response`; `glass` also gives the dispersion where the setup states its glass as a number.
    samples : int
        Samples across the common field at each depth.

    Returns
    -------
    Budget

    Notes
    -----
    To first order. The two focal lengths err together; all other tolerances are independent. A range of half width a
    has the standard deviation a / sqrt(3).

    References
    ----------
    JCGM 100:2008, Guide to the expression of uncertainty in measurement, 4.3.7 (ranges) and 5 (propagation).
    """
    _check_numbers(sigma, temperature_range)
    check_views(setup)
    volume = working_volume(setup.rig(), _depths(setup, depths), samples)
    points = np.where(volume.common[..., None], volume.points, np.nan)
    sensitivity = point_sensitivity(setup, points, seen=volume.seen)
    notes: list[str] = []
    empty = ~volume.common.any((1, 2))
    if empty.any():
        notes.append(f"no two views share anything at {', '.join(f'{z:g}' for z in volume.depths[empty])} mm: left out")
    sources = _of_tolerances(setup, sensitivity, _tolerances(setup, tolerances, covariance is None))
    within: dict[str, float] = {}
    if covariance is not None:
        calibrated, within = _of_covariance(setup, sensitivity, *covariance)
        sources.append(calibrated)
        notes.append(
            "parameters that the calibration held are taken as known; it took up most of their error, and a tolerance "
            "that is given for one counts in full"
        )
    sources.append(_of_noise(sensitivity, sigma))
    warmth = thermal_response(setup, mount=mount, glass=glass, lens_per_kelvin=lens_per_kelvin)
    notes += [f"not in it: {what}" for what in warmth.unknown]
    if temperature_range > 0:
        shifts = sensitivity.shift(warmth.total)[..., None] * (temperature_range / np.sqrt(3))
        sources.append(Source("temperature", f"+-{temperature_range:g} K", shifts, ("temperature",)))
    sources += _of_colour(setup, sensitivity, band, glass, notes)
    sources.sort(key=lambda source: -float(np.nanmean((source.sigma / volume.depths[:, None, None]) ** 2)))
    return Budget(setup, volume, sensitivity, tuple(sources), warmth, tuple(notes), within)


def _check_numbers(sigma, temperature_range):
    if not 0 < sigma < np.inf:
        raise SetupError(f"the pixel noise must be a positive number of px, got {sigma}")
    if not 0 <= temperature_range < 1000:
        raise SetupError(f"the range of temperatures is its half width in K, 0 or more, got {temperature_range}")


def _depths(setup, depths):
    if depths is not None:
        return np.atleast_1d(np.asarray(depths, dtype=float))
    near, far = setup.depths or setup.rig().working_depths
    return np.array([float(f"{depth:.4g}") for depth in np.geomspace(near, far, _DEPTHS)])


def _sigma_of(tolerance, name, value, setup):
    if tolerance.unit == "relative":
        return tolerance.sigma * abs(float(value))
    if tolerance.unit == "corner":
        camera = setup.camera
        focal = float(np.mean(camera.focal))
        width, height = camera.size
        radius = np.hypot(width, height) / 2 / focal
        term = {"k1": radius**3, "k2": radius**5}.get(name.split(".")[1], 3 * radius**2)
        return tolerance.sigma / (focal * term)
    return tolerance.sigma


def _tolerances(setup, given, usual):
    """Standard deviations by full name."""
    found = standard_tolerances(setup) if usual else {}
    for name, sigma in (given or {}).items():
        if not 0 <= sigma < np.inf:
            raise SetupError(f"the tolerance of {name} must be a standard deviation, 0 or more, got {sigma}")
        unknowns = Unknowns.of([setup], (name,))
        for row in np.flatnonzero(np.any(unknowns.matrix[0] != 0, axis=-1)):
            found[setup.parameter_names[row]] = float(sigma)
    return {name: sigma for name, sigma in found.items() if sigma > 0}


def _of_tolerances(setup, sensitivity, tolerances):
    """One source for each kind of parameter."""
    rows: dict[str, list[str]] = {}
    for name in tolerances:
        rows.setdefault(source_of(name), []).append(name)
    sources = []
    for row, names in rows.items():
        columns = [setup.parameter_names.index(name) for name in names]
        shifts = sensitivity.matrix[..., columns] * np.array([tolerances[name] for name in names])
        if row == "focal length":
            shifts, names = shifts.sum(-1, keepdims=True), names[:1]  # one lens: both err together
        sources.append(Source(row, _words(names, tolerances, setup), shifts, _labels(names)))
    return sources


def _labels(names):
    """Short names of parameters."""
    short = (name.split(".", 1)[1].replace("focal_x", "focal length").replace("_", " ") for name in names)
    return tuple(re.sub(r"^(facet|mirror)(\d)", r"\1 \2", name) for name in short)


def source_of(name: str) -> str:
    """The row of the budget that a parameter belongs to, by its full name."""
    return next((one.source for one in USUAL_TOLERANCES if re.fullmatch(one.pattern, name)), name)


def _words(names, tolerances, setup):
    """How large the tolerances of one row are."""
    if source_of(names[0]) == "focal length":
        value = dict(zip(setup.parameter_names, setup.camera.lens, strict=False))[names[0]]
        return f"{100 * tolerances[names[0]] / value:.3g} %"
    usual = standard_tolerances(setup)
    if source_of(names[0]) == "lens distortion" and all(tolerances[name] == usual.get(name) for name in names):
        return "0.3 px at the corner, each"
    kind = kind_of(names[0])
    sizes = sorted({float(f"{tolerances[name] * kind.factor:.3g}") for name in names})
    if kind.unit == "deg" and sizes[-1] < 0.1:
        sizes = [float(f"{60 * size:.3g}") for size in sizes]
        unit = "arcmin"
    else:
        unit = kind.unit
    text = f"{sizes[0]:g}" if len(sizes) == 1 else f"{sizes[0]:g} to {sizes[-1]:g}"
    return f"{text} {unit}".strip() + (" each" if len(names) > 1 else "")


def _of_noise(sensitivity, sigma):
    gain = sensitivity.response.gain
    shifts = sigma * gain.reshape(*gain.shape[:-2], -1)
    return Source("pixel noise", f"{sigma:g} px each coordinate", shifts)


def _of_covariance(setup, sensitivity, names, covariance):
    """The calibration as one source, and what each parameter alone would make of its variance."""
    covariance = finite(np.asarray(covariance, dtype=float))
    if covariance.shape != (len(names), len(names)):
        raise ShapeError(
            f"the covariance of {len(names)} parameters must have shape ({len(names)}, {len(names)}), "
            f"got {covariance.shape}"
        )
    to_setup = np.stack([_column(setup, name) for name in names], -1)
    values, vectors = np.linalg.eigh(covariance)
    if values.min() < -1e-6 * max(values.max(), 1e-300):
        raise SetupError("the covariance of the calibration has a negative eigenvalue: it is damaged")
    root = vectors * np.sqrt(np.maximum(values, 0.0))
    source = Source("calibration", f"{len(names)} parameters, correlated", sensitivity.matrix @ (to_setup @ root))
    slopes = sensitivity.depth @ to_setup
    k = len(slopes) // 2
    alone = np.nanmean(slopes[k].reshape(-1, len(names)) ** 2, axis=0) * np.diag(covariance)
    all_together = float(np.nanmean(source.sigma[k] ** 2))
    within = dict(zip(names, (alone / all_together).tolist(), strict=True))
    return source, within | {"correlations": 1.0 - float(alone.sum()) / all_together}


def _column(setup, name):
    """How all parameters (F,) of a setup follow one that a calibration found."""
    plain = re.sub(r"\[\d+\]$", "", name)
    try:
        return Unknowns.of([setup], (plain,)).matrix[0][:, 0]
    except SetupError as error:
        raise SetupError(f"the calibration is that of another setup: {error}") from None


def _of_colour(setup, sensitivity, band, glass, notes):
    if not bends_colours(setup):
        return []
    low, high = band or (setup.wavelength_nm - 5, setup.wavelength_nm + 5)
    if not 0 < low < high < np.inf:
        raise SetupError(f"a band is (shortest, longest) wavelength in nm, got ({low}, {high})")
    try:
        slope = (index_at(setup, high, glass) - index_at(setup, low, glass)) / (high - low)
        offset = index_at(setup, (low + high) / 2, glass) - index_at(setup, setup.wavelength_nm, glass)
    except MediumError as error:
        if band is not None and glass is not None:
            raise
        notes.append(f"not in it: colour; {error}")
        return []
    column = sensitivity.matrix[..., sensitivity.names.index("optic.index")]
    if abs(offset) > 0.1 * abs(slope) * (high - low):
        k = len(column) // 2
        bias = float(np.nanmedian(column[k][..., 2])) * offset
        notes.append(
            f"the middle of the band is {(low + high) / 2:g} nm, but the setup is stated for "
            f"{setup.wavelength_nm:g} nm: depths are found {bias:+.3g} mm off in the middle of the field, "
            "which is not in the budget"
        )
    shifts = column[..., None] * (slope * (high - low) / np.sqrt(12))
    return [Source("wavelength", f"{low:.5g} to {high:.5g} nm", shifts, ("wavelength",))]
