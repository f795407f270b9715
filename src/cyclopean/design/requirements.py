"""What a prism is designed for, what a candidate is judged by, and what a search finds."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from ..cameras import Camera
from ..errors import SetupError
from ..optics import Prism, medium
from ..rigs import Setup
from ..rigs.setup import D_LINE_NM

if TYPE_CHECKING:
    from ..analysis import Tolerance
    from .catalogue import ToleranceGrade
    from .judgement import KeptAccuracy

_FRONT = 20.0  # mm, by which the entrance pupil of a usual lens lies behind its front; less before near targets
_POSITIVE = ("accuracy", "baseline", "max_diameter", "max_length", "max_blend", "max_chromatic", "f_number")


@dataclass(frozen=True, eq=False)
class Requirements:
    """What is asked of a prism before a camera; None leaves a thing open.

    The lens is focused at the harmonic mean of the depths where no focus distance is given: blur is then the same at
    both ends.
    """

    camera: Camera  # with its pixel pitch where a lens's f-number counts
    depths: tuple[float, float]  # mm, nearest and farthest
    accuracy: float | None = None  # relative standard deviation of depth to be kept over all depths; 0.001 is 0.1 %
    facets: tuple[int, ...] = (2, 3, 4, 5)
    glasses: tuple[str, ...] = ("N-BK7",)
    angles_deg: tuple[float, ...] | None = None  # the apex angles that can be had; None: any
    field: tuple[float, float] | None = None  # mm (width, height) that two views or more share at every depth
    baseline: float | None = None  # mm between neighbouring virtual cameras, to 2 %
    max_diameter: float | None = None  # mm, of the glass
    max_length: float | None = None  # mm, from the pinhole to the apex
    max_blend: float | None = None  # px, of the band around seams in which views mix
    max_chromatic: float | None = None  # px, of the light's band spread out
    distances: tuple[float, float] = None  # type: ignore[assignment]  # mm, pinhole to glass; None: 20 or more
    noise: float = 0.1  # px, standard deviation of a matched coordinate
    wavelength_nm: float = D_LINE_NM
    bandwidth_nm: float = 10.0  # full width of the filter or the lamp
    f_number: float | None = None
    focus_distance: float | None = None  # mm
    tolerances: ToleranceGrade | tuple[Tolerance, ...] | None = None  # of maker and mount; None: the usual ones
    on_paper: float = 0.92  # share of the accuracy that noise of matching may take up: making and calibrating cost more
    photos: int = 12  # of the calibration
    corner_noise: float = 0.02  # px, of a corner in them

    def __post_init__(self):
        pair = np.asarray(self.depths, dtype=float)
        if pair.shape != (2,) or not np.isfinite(pair).all() or not 0 < pair[0] < pair[1]:
            raise SetupError(
                f"the depths are (near, far) mm with 0 < near < far, got {pair.tolist()}; "
                + ("swap them" if pair.shape == (2,) and 0 < pair[1] < pair[0] else "give both ends of the range")
            )
        if self.distances is None:
            object.__setattr__(self, "distances", (min(_FRONT, float(pair[0]) / 10), np.inf))
        for name in _POSITIVE:
            value = getattr(self, name)
            if value is not None and not 0 < value < np.inf:
                raise SetupError(f"{name} must be a positive number, got {value}")
        self._check_numbers()
        self._check_choices()
        for name in ("depths", "distances", "field"):
            if getattr(self, name) is not None:
                object.__setattr__(self, name, tuple(float(value) for value in getattr(self, name)))
        object.__setattr__(self, "facets", tuple(sorted({int(count) for count in self.facets})))
        object.__setattr__(self, "glasses", tuple(dict.fromkeys(self.glasses)))

    def _check_numbers(self):
        if self.accuracy is not None and self.accuracy >= 1:
            raise SetupError(f"the accuracy is a share of depth (0.001 is 0.1 %), got {self.accuracy:g}")
        if not 0 < self.on_paper <= 1:
            raise SetupError(f"the share of the accuracy on paper lies above 0 and up to 1, got {self.on_paper:g}")
        low, high = self.distances
        if not 0 < low <= high:
            raise SetupError(
                f"the distances to the glass are (least, most) mm with 0 < least <= most, got {low}, {high}"
            )
        if self.field is not None and not (len(self.field) == 2 and min(self.field) > 0 and max(self.field) < np.inf):
            raise SetupError(f"the field is (width, height), positive mm, got {self.field}")
        for name in ("noise", "wavelength_nm", "corner_noise"):
            if not 0 < getattr(self, name) < np.inf:
                raise SetupError(f"{name} must be a positive number, got {getattr(self, name)}")
        if not 0 <= self.bandwidth_nm < 2 * self.wavelength_nm:
            raise SetupError(f"the bandwidth is a full width in nm, 0 or more, got {self.bandwidth_nm}")
        if self.photos != int(self.photos) or self.photos < 1:
            raise SetupError(f"a calibration needs one photograph or more, got photos={self.photos}")
        if self.focus_distance is not None and not 0 < self.focus_distance < np.inf:
            raise SetupError(f"the focus distance must be a positive number of mm, got {self.focus_distance}")

    def _check_choices(self):
        if not self.facets or min(self.facets) < 2 or any(count != int(count) for count in self.facets):
            raise SetupError(f"facets are whole numbers from 2 on (2 is a biprism), got {list(self.facets)}")
        if max(self.facets) > 12:
            raise SetupError(f"prisms of up to 12 facets are searched, got {max(self.facets)}")
        if not self.glasses:
            raise SetupError("name one glass or more, such as N-BK7")
        if self.angles_deg is not None:
            if not self.angles_deg or not all(0 < angle < 90 for angle in self.angles_deg):
                raise SetupError(f"apex angles lie between 0 and 90 degrees, got {list(self.angles_deg)}")
            object.__setattr__(self, "angles_deg", tuple(sorted({float(angle) for angle in self.angles_deg})))
        if self.f_number is None and self.max_blend is not None:
            raise SetupError("max_blend limits what an open lens mixes beside seams: give the f-number too")
        if self.f_number is not None and self.camera.pixel_pitch is None:
            raise SetupError("an f-number counts only with the size of a pixel: give the camera's pixel pitch")
        for glass in self.glasses:
            low, high = self.band
            for nm in (low, self.wavelength_nm, high):
                medium(glass).index_in_air(nm)  # what is no glass, or has no data there, is said here

    @property
    def band(self) -> tuple[float, float]:
        """Shortest and longest wavelength, nm."""
        return self.wavelength_nm - self.bandwidth_nm / 2, self.wavelength_nm + self.bandwidth_nm / 2

    @property
    def accuracy_on_paper(self) -> float | None:
        """Relative standard deviation of depth that noise of matching alone may cause; None where nothing is wanted."""
        return None if self.accuracy is None else self.on_paper * self.accuracy

    @property
    def focus(self) -> float:
        """Distance (mm) at which the lens is focused: as asked, or the harmonic mean of the depths."""
        near, far = self.depths
        return 2 * near * far / (near + far) if self.focus_distance is None else self.focus_distance

    def setup(self, prism: Prism) -> Setup:
        """A prism before the camera, in the light and with the lens of these requirements."""
        focus = self.focus if self.f_number is not None else self.focus_distance
        return Setup(self.camera, prism, self.wavelength_nm, self.f_number, focus, self.depths)


@dataclass(frozen=True, eq=False)
class Figures:
    """What a candidate is judged by, at D depths.

    The field is the largest rectangle about the optical axis that lies wholly inside; where the requirements state a
    field it has that one's proportions.
    """

    depths: np.ndarray  # (D,) mm
    sigma: np.ndarray  # (D,) relative standard deviation of depth from pixel noise: rms over what two views see
    sigma_worst: np.ndarray  # (D,) the same at the worst point looked at
    field_two: np.ndarray  # (D, 2) mm, width and height of the field that two views or more see
    field_all: np.ndarray  # (D, 2) mm, of the field that all views see
    area_two: np.ndarray  # (D,) mm^2, of all that two views or more see, rectangle or not
    area_all: np.ndarray  # (D,) mm^2, of all that all views see
    share_two: np.ndarray  # (D,) share of the sensor's pixels whose point two views or more see: the use of the sensor
    share_all: np.ndarray  # (D,) share of the sensor's pixels whose point all views see
    baseline: float  # mm, between neighbouring virtual cameras
    deviation: float  # rad, by which light along the axis is bent
    reflection_margin: float  # rad, by which the most slanted ray in use stays below total reflection
    diameter: float  # mm, of the glass
    length: float  # mm, from the pinhole to where the prism ends
    thickness: float  # mm, of the glass on the axis
    mass: float  # g; NaN where the glass's density is not known
    blend: float  # px, width of the band around seams in which the open lens mixes views; 0 for a pinhole
    defocus: tuple[float, float]  # px, diameter of the blur circle at the nearest and farthest depth; 0 for a pinhole
    chromatic: float  # px, length to which the light's band spreads a point, largest over the field

    @property
    def accuracy(self) -> float:
        """Relative standard deviation of depth at the worst depth, by which candidates are judged; inf where blind."""
        return float(np.max(np.where(np.isfinite(self.sigma), self.sigma, np.inf)))

    @property
    def worst_depth(self) -> float:
        """Depth (mm) at which `accuracy` holds."""
        return float(self.depths[int(np.argmax(np.where(np.isfinite(self.sigma), self.sigma, np.inf)))])

    @property
    def field(self) -> tuple[float, float]:
        """Width and height (mm) of the rectangle that two views or more see at the depth where it is smallest."""
        smallest = self.field_two[int(np.argmin(self.field_two.prod(-1)))]
        return float(smallest[0]), float(smallest[1])

    @property
    def use(self) -> float:
        """Share of the sensor's pixels that two views or more make use of, mean over the depths."""
        return float(self.share_two.mean())

    @property
    def middle(self) -> int:
        """Number of the middle depth."""
        return len(self.depths) // 2


@dataclass(frozen=True, eq=False)
class Candidate:
    """A prism that might be built, and its figures."""

    setup: Setup
    figures: Figures
    kept: KeptAccuracy | None = None  # what it keeps after making, mounting and calibrating; None: not looked at

    @property
    def prism(self) -> Prism:
        """The prism of the setup."""
        return self.setup.optic  # type: ignore[return-value]

    @property
    def name(self) -> str:
        """In a few words: facets, apex angle, glass, distance."""
        prism = self.prism
        glass = prism.glass if isinstance(prism.glass, str) else f"index {prism.glass}"
        return f"{prism.facets} facets of {prism.apex_deg:.4g} deg, {glass}, at {prism.distance:.4g} mm"


Make = Callable[[Candidate, Requirements], Candidate]
"""A candidate as it would be built, in round measures say, with what it keeps after making and calibrating."""


@dataclass(frozen=True)
class Choice:
    """One of the candidates that a person should look at, and why."""

    index: int  # of the candidate
    reasons: tuple[str, ...]  # such as "most accurate", "widest field", "best with 3 facets"


@dataclass(frozen=True)
class Relaxation:
    """A requirement, and the least to which it must give way for a prism to fit, all others kept."""

    requirement: str  # field of `Requirements`
    wanted: float
    possible: float  # in the same unit
    text: str  # in words
    candidate: Candidate  # that then fits


@dataclass(frozen=True, eq=False)
class Explanation:
    """What kept candidates out."""

    failed: dict[str, int]  # requirement: how many of the candidates looked at fail it
    alone: dict[str, int]  # requirement: how many fail it and nothing else
    relaxations: tuple[Relaxation, ...]  # where nothing fits: what to give way in, the least change first
    nearest: Candidate | None  # where nothing fits: what fits after the first of these, else what misses by least
    text: str  # all this in words; empty where nothing was in the way


@dataclass(frozen=True, eq=False)
class Designs:
    """The prisms that fit the requirements."""

    requirements: Requirements
    candidates: tuple[Candidate, ...]  # all that fit, as exactly traced
    front: tuple[int, ...]  # candidates that no other betters in everything (Pareto)
    chosen: tuple[Choice, ...]  # about six to ten, nearly all of the front
    screened: int  # how many were looked at in closed form
    traced: int  # how many of them were traced exactly
    explanation: Explanation
    interrupted: bool = False  # whether the search was broken off: candidates are those found by then

    @property
    def options(self) -> tuple[Candidate, ...]:
        """The chosen candidates."""
        return tuple(self.candidates[choice.index] for choice in self.chosen)
