"""What makers offer: stock wedges, glasses for prisms, and grades of tolerances, each with where it comes from.

A source that reads "assumed" is a usual figure of workshops and laboratories without a page to point to. No maker keeps
pyramids of three facets or more, or biprisms of several degrees, in stock as far as the pages looked through say: a
stock angle is that of a wedge, of which facets are cut and set side by side.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from ..analysis import Tolerance, usual_tolerances
from ..errors import SetupError
from ..optics import medium
from ..optics.glasses import PLASTICS
from ..rigs import Setup

ASSUMED = "assumed"
HELIUM_NEON_NM = 632.8
"""Wavelength that makers state the deviation of a wedge at."""
_ARCMIN = np.deg2rad(1 / 60)
_PLASTIC_INDEX = 0.001  # by which two sheets differ, see PMMA in `optics.glasses`


class StockWedge(NamedTuple):
    """A round wedge that is sold from stock."""

    glass: str
    deviation_deg: float  # of light that falls square on one face, at 632.8 nm
    angle_deg: float  # between its faces
    source: str


_WEDGE_GLASSES = {
    "N-BK7": "glass: Tensun Optics, product page Wedge prism",
    "fused silica": "glass: Tensun Optics, product page Wedge prism",
}
_DEVIATIONS_DEG = (2.0, 4.0, 6.0, 8.0, 10.0)
_DEVIATION_SOURCE = "range of 2 to 10 deg: Metoree, page Wedge Prisms; steps of 2 deg: assumed"


def wedge_angle_deg(deviation_deg: float, index: float) -> float:
    """Angle (degrees) of the wedge that bends light by so many degrees, where it falls square on one face.

    sin(a + d) = n sin(a), so that tan(a) = sin(d) / (n - cos(d)) (Born and Wolf, Principles of Optics, section 4.7.2,
    with a first face that does not bend).
    """
    deviation = np.deg2rad(deviation_deg)
    return float(np.degrees(np.arctan2(np.sin(deviation), index - np.cos(deviation))))


def stock_wedges(glasses: tuple[str, ...] | None = None) -> tuple[StockWedge, ...]:
    """Wedges from stock of some glasses (all, where none are named), the smallest angle first.

    Raises
    ------
    SetupError
        When wedges of none of these glasses are kept in stock.
    """
    wanted = None if glasses is None else {medium(glass).name for glass in glasses}
    wedges = []
    for glass, source in _WEDGE_GLASSES.items():
        if wanted is None or glass in wanted:
            index = float(medium(glass).index_in_air(HELIUM_NEON_NM))
            for deviation in _DEVIATIONS_DEG:
                angle = round(wedge_angle_deg(deviation, index), 2)
                wedges.append(StockWedge(glass, deviation, angle, f"{source}; deviation: {_DEVIATION_SOURCE}"))
    if not wedges:
        raise SetupError(
            f"wedges of {', '.join(sorted(wanted or ()))} are not kept in stock; take {' or '.join(_WEDGE_GLASSES)}, "
            "or let the angles be any"
        )
    return tuple(sorted(wedges, key=lambda wedge: wedge.angle_deg))


def stock_angles_deg(glasses: tuple[str, ...] | None = None) -> tuple[float, ...]:
    """Angles (degrees) of `stock_wedges`, each once."""
    return tuple(sorted({wedge.angle_deg for wedge in stock_wedges(glasses)}))


@dataclass(frozen=True)
class GlassFact:
    """What speaks for a glass, and against it."""

    name: str  # as in `media()`
    price: str  # "low", "usual" or "high" beside N-BK7, assumed: makers state prices on demand
    remark: str
    source: str  # of the remark

    @property
    def index(self) -> float:
        """Index relative to air at the helium d line."""
        return float(medium(self.name).index_in_air(587.5618))

    @property
    def abbe_number(self) -> float:
        """V_d: light of another colour is bent by about 1 / V_d more from red to blue."""
        return medium(self.name).abbe_number


_THORLABS = "Thorlabs, product page N-BK7 Bi-Convex Lenses"
_LYTLE = "Lytle, Polymeric Optics, Handbook of Optics, chapter 34"
_FORMULA = "its dispersion formula"
GLASSES = (
    GlassFact(
        "N-BK7", "usual", "the most common glass for good optics", "Thorlabs, product page N-BK7 Bi-Convex Lenses"
    ),
    GlassFact("H-K9L", "low", "the same index and dispersion as N-BK7", "the dispersion formulas of both"),
    GlassFact("B270", "low", "sheet glass with a fire polish; its index varies more than that of N-BK7", ASSUMED),
    GlassFact("BOROFLOAT 33", "low", "float glass, expands little with heat; streaks show in thick parts", ASSUMED),
    GlassFact(
        "fused silica",
        "high",
        "expands little with heat and passes ultraviolet; bends less than N-BK7",
        _THORLABS,
    ),
    GlassFact(
        "PMMA",
        "low",
        "light and tough, can be moulded or diamond-turned; sheets differ in index by 0.001, and it expands with heat",
        f"Beadie et al. 2015; {_LYTLE}",
    ),
    GlassFact(
        "Zeonex E48R",
        "usual",
        "a plastic for moulding that takes up little water",
        f"{_LYTLE}, and assumed",
    ),
    GlassFact("polycarbonate", "low", "tough; spreads colours more than twice as far as N-BK7", _FORMULA),
    GlassFact("N-BAK4", "usual", "bends more than N-BK7, spreads colours a little more", _FORMULA),
    GlassFact("N-LAK8", "high", "bends nearly as much as N-SF10 at half its dispersion", _FORMULA),
    GlassFact("F2", "usual", "a flint; bends more, spreads colours nearly twice as far as N-BK7", _FORMULA),
    GlassFact(
        "N-SF11",
        "high",
        "bends light half as much again: smaller angles; spreads colours 2.5 times as far, so needs a narrow filter",
        _FORMULA,
    ),
)
"""Glasses and plastics that prisms are made of, the usual one first."""


def glass_fact(name: str) -> GlassFact | None:
    """What the table says of a glass, by any name that `medium` knows; None where it says nothing."""
    known = medium(name).name
    return next((fact for fact in GLASSES if fact.name == known), None)


class Limit(NamedTuple):
    """How far a kind of parameter may be from the drawing."""

    pattern: str  # of full names of parameters
    what: str
    size: float  # limit to both sides, mm or rad or 1
    source: str


@dataclass(frozen=True)
class ToleranceGrade:
    """How well prism and mount are made; the camera is known as the usual error budget has it."""

    name: str
    text: str
    limits: tuple[Limit, ...]  # all sizes within them are equally likely
    diameter: tuple[float, float]  # mm, (under, over) the drawing's; no error of depth comes from it
    diameter_source: str
    cost: float | None = None  # of the part, relative to "commercial"

    def tolerances(self, setup: Setup) -> tuple[Tolerance, ...]:
        """Those of a setup, by full names of parameters, for `tolerance_analysis`.

        A limit +-a stands for a uniform distribution, standard deviation a / sqrt(3) (JCGM 100:2008, 4.3.7).
        """
        usual = usual_tolerances(setup)
        if not self.limits:
            return usual
        found = [tolerance for tolerance in usual if tolerance.name.startswith("camera.")]
        for name in setup.parameter_names:
            limit = next((limit for limit in self.limits if re.fullmatch(limit.pattern, name)), None)
            if limit is not None:
                found.append(Tolerance(name, self._size(limit, name, setup), "uniform"))
        return tuple(found)

    def _size(self, limit, name, setup):
        """The limit; that of plastics' index is never below what sheets differ by."""
        glass = getattr(setup.optic, "glass", None)
        plastic = isinstance(glass, str) and medium(glass).name in _PLASTICS
        return max(limit.size, _PLASTIC_INDEX) if plastic and name == "optic.index" else limit.size

    @cached_property
    def lines(self) -> tuple[str, ...]:
        """One line for each limit, with its source, as a shopping list wants it."""
        return tuple(f"{limit.what}: +-{_shown(limit)} ({limit.source})" for limit in self.limits)


_PLASTICS = {row["name"] for row in PLASTICS}
_EDMUND = "Edmund Optics, Understanding Optical Specifications"
_OPTIMAX = "Optimax, Manufacturing Tolerance Chart"
_STARNA = "Starna, product page Beam splitters"


def _limits(angle, angle_source, azimuth, thickness, quality, index, index_source, distance, shift, tilt_deg):
    """Rows of a grade; angles in rad but the tilt, lengths in mm."""
    return (
        Limit(r"optic\.apex", "facet angle, all facets alike", angle, angle_source),
        Limit(r"optic\.facet\d+_angle", "facet angle, one against the others", angle / 2, ASSUMED),
        Limit(r"optic\.facet\d+_azimuth", "facet azimuth", azimuth, ASSUMED),
        Limit(r"optic\.thickness", "thickness", thickness, f"{_EDMUND}, {quality}"),
        Limit(r"optic\.index", "refractive index", index, index_source),
        Limit(r"optic\.distance", "distance from the camera", distance, ASSUMED),
        Limit(r"optic\.shift_[xy]", "shift in the mount", shift, ASSUMED),
        Limit(r"optic\.tilt_[xyz]", "tilt in the mount", float(np.deg2rad(tilt_deg)), ASSUMED),
    )


GRADES = {
    grade.name: grade
    for grade in (
        ToleranceGrade(
            "usual",
            "the usual error budget: limits of makers taken as standard deviations",
            (),
            (0.1, 0.0),
            "OptoSigma, Outer Dimension Tolerance",
        ),
        ToleranceGrade(
            "commercial",
            "ordinary workshop, prism against a stop in a tube",
            _limits(
                3 * _ARCMIN, f"{_STARNA}, standard", 10 * _ARCMIN, 0.2, "typical quality",
                0.001, f"{_OPTIMAX}, commercial", 0.5, 0.3, 0.3,
            ),
            (0.1, 0.0),
            f"{_OPTIMAX}, commercial",
            1.0,
        ),
        ToleranceGrade(
            "precision",
            "good workshop, machined mount",
            _limits(
                _ARCMIN, "Tensun Optics, product page Wedge prism", 3 * _ARCMIN, 0.05, "precision quality",
                0.0005, f"{_OPTIMAX}, precision", 0.2, 0.1, 0.1,
            ),
            (0.025, 0.0),
            f"{_OPTIMAX}, precision",
            1.5,
        ),
        ToleranceGrade(
            "high",
            "best workshop with measured glass, mount adjusted under a microscope",
            _limits(
                5 * _ARCMIN / 60, f"{_STARNA}, custom", _ARCMIN, 0.01, "high quality",
                0.0001, f"{_OPTIMAX}, high precision: melt data; to what they hold: assumed", 0.05, 0.03, 0.03,
            ),
            (0.015, 0.0),
            f"{_OPTIMAX}, high precision",
            2.25,
        ),
    )
}  # fmt: skip
"""By name, the coarsest last but "usual". Costs: "price increases around 50 %" from grade to grade (Optimax, chart)."""


def tolerance_grade(name: str | ToleranceGrade) -> ToleranceGrade:
    """A grade by its name; SetupError for one that there is not."""
    if isinstance(name, ToleranceGrade):
        return name
    if name not in GRADES:
        raise SetupError(f"there is no grade {name!r} of tolerances; there are {', '.join(GRADES)}")
    return GRADES[name]


def grade(name: str | ToleranceGrade, setup: Setup) -> tuple[Tolerance, ...]:
    """What may differ from the drawing of a setup at a grade ("usual", "commercial", "precision", "high").

    "usual" is that of the error budget, `analysis.usual_tolerances`; the others are limits of makers and mounts within
    which all sizes are equally likely.
    """
    return tolerance_grade(name).tolerances(setup)


def _shown(limit):
    """A limit in the unit that drawings state it in."""
    if not re.search("tilt|apex|facet", limit.pattern):
        return f"{limit.size:g}" if "index" in limit.pattern else f"{limit.size:g} mm"
    arcmin = limit.size / _ARCMIN
    return f"{60 * arcmin:.3g} arcsec" if arcmin < 0.99 else f"{arcmin:.3g} arcmin"
