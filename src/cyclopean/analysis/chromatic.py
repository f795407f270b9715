"""What colour does: a prism spreads light, so pictures blur and depths depend on the wavelength."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from ..errors import MediumError, SetupError
from ..geometry import as_points
from ..optics import Medium, medium
from ..rigs import Setup
from ..rigs.colours import bends_colours, coloured, has_dispersion, index_at
from ..triangulation import triangulate
from ..triangulation.sensitivity import point_response

CHANNELS = {"red": 610.0, "green": 540.0, "blue": 460.0}
"""Middle wavelengths (nm) of the channels of a usual colour sensor; they differ by some 10 nm between makers."""
_WIDEST = 400.0  # nm: wider than any filter
_STEP = 0.5  # nm, over which the slope of the index is taken


@dataclass(frozen=True, eq=False)
class Blur:
    """How far a band of colours spreads what each sub-image shows of a plane at one depth."""

    band: tuple[float, float]  # nm
    depth: float  # mm
    pixels: np.ndarray  # (V, S, S, 2): places in the photograph, a grid over each sub-image
    spread: np.ndarray  # (V, S, S, 2) px: from the short end of the band to the long one; NaN outside the sub-image

    @property
    def blur(self) -> np.ndarray:
        """(V, S, S) px: length of the spread, from end to end."""
        return np.linalg.norm(self.spread, axis=-1)


class FilterAdvice(NamedTuple):
    """The widest band around a wavelength that keeps blur and bias of depth within limits everywhere."""

    centre_nm: float
    slope: float  # of the index, 1/nm
    width_for_blur: float  # nm, from end to end; infinite where any filter will do
    width_for_bias: float  # nm

    @property
    def width(self) -> float:
        """nm, the narrower of the two."""
        return min(self.width_for_blur, self.width_for_bias)


def index_slope(setup: Setup, wavelength_nm: float | None = None, glass: str | Medium | None = None) -> float:
    """d index / d wavelength (1/nm) at a wavelength, the setup's own where not given; 0 for mirrors."""
    if not bends_colours(setup):
        return 0.0
    at = setup.wavelength_nm if wavelength_nm is None else wavelength_nm
    rise = index_at(setup, at + _STEP, glass) - index_at(setup, at - _STEP, glass)
    return rise / (2 * _STEP)


def chromatic_pixels(
    setup: Setup, points: ArrayLike, wavelengths_nm: Sequence[float], glass: str | Medium | None = None
) -> np.ndarray:
    """Pixels (..., L, V, 2) of points (..., 3) mm in light of L wavelengths (nm), in views without borders."""
    points = as_points(points)
    pixels = [coloured(setup, nm, glass).rig().unbounded().project(points) for nm in wavelengths_nm]
    return np.stack(pixels, -3)


def chromatic_blur(
    setup: Setup,
    band: tuple[float, float],
    depth: float,
    *,
    glass: str | Medium | None = None,
    samples: int = 48,
) -> Blur:
    """How far a band of colours spreads the picture of a plane at some depth.

    Parameters
    ----------
    setup : Setup
    band : (2,) nm
        Shortest and longest wavelength.
    depth : float
        mm.
    glass : str or Medium, optional
        Whose dispersion to take where the setup gives its glass as a number.
    samples : int
        Samples across each sub-image.

    Returns
    -------
    Blur
        The lens's own chromatic errors are not in it.
    """
    band = _checked_band(band)
    ends = [coloured(setup, nm, glass).rig().unbounded() for nm in band]
    places, spreads = [], []
    for k, view in enumerate(setup.rig()):
        x, y, width, height = view.region.box
        pixels = np.stack(
            np.meshgrid(np.linspace(x, x + width - 1, samples), np.linspace(y, y + height - 1, samples)), -1
        )
        points = view.rays(pixels).at_depth(depth)
        spread = ends[1][k].project(points) - ends[0][k].project(points)
        places.append(pixels)
        spreads.append(np.where(view.region.contains(pixels)[..., None], spread, np.nan))
    return Blur(band, float(depth), np.stack(places), np.stack(spreads))


def colour_bias(
    setup: Setup,
    points: ArrayLike,
    wavelengths_nm: Sequence[float],
    *,
    seen: ArrayLike | None = None,
    glass: str | Medium | None = None,
) -> np.ndarray:
    """Shifts (..., L, 3) mm of points (..., 3) found in light of L wavelengths, nm, by a setup that believes its own.

    Found by tracing, not to first order. `seen` (..., V) says which views count, as in `point_sensitivity`.
    """
    points = as_points(points)
    rig = setup.rig()
    if seen is None:
        seen = np.isfinite(rig.project(points)).all(-1)
    pixels = chromatic_pixels(setup, points, wavelengths_nm, glass)
    pixels = np.where(np.asarray(seen, dtype=bool)[..., None, :, None], pixels, np.nan)
    return triangulate(rig.unbounded(), pixels).points - points[..., None, :]


def filter_advice(
    setup: Setup,
    points: ArrayLike,
    centres_nm: Sequence[float] = (450.0, 490.0, 530.0, 570.0, 610.0, 650.0, 780.0, 850.0),
    *,
    seen: ArrayLike | None = None,
    blur: float = 0.3,
    bias_percent: float = 0.1,
    glass: str | Medium | None = None,
) -> list[FilterAdvice]:
    """Which filter to use: how wide it may be at each middle wavelength.

    Parameters
    ----------
    setup : Setup
    points : (..., 3) array
        Where to measure, mm; limits hold at all of them, in all views that see them.
    centres_nm : sequence of nm
        Middle wavelengths; those outside the glass's data are left out.
    seen : (..., V) bool array, optional
        Which views count.
    blur : float
        Largest spread in the picture, px, from one end of the band to the other.
    bias_percent : float
        Largest error of depth, in percent of depth, in light of either end when the setup is stated for the middle.
    glass : str or Medium, optional
        Whose dispersion to take where the setup gives its glass as a number.

    Notes
    -----
    Pixels and depths follow the index to first order, the index follows the wavelength exactly.
    """
    if not (blur > 0 and bias_percent > 0):
        raise SetupError(f"limits of blur and bias must be positive, got {blur} px and {bias_percent} %")
    per_index, bias_per_index = _per_index(setup, as_points(points), seen)
    advice = []
    for centre in centres_nm:
        try:
            slope = index_slope(setup, centre, glass)
        except MediumError:
            if not has_dispersion(setup.optic.glass if glass is None else glass):  # type: ignore[attr-defined]
                raise
            continue  # the glass has no data there
        offsets = _Offsets(setup, centre, glass)
        for_blur = 2 * _largest(lambda half, at=offsets: per_index * at.across(half) <= blur)
        for_bias = 2 * _largest(lambda half, at=offsets: 100 * bias_per_index * at.aside(half) <= bias_percent)
        advice.append(FilterAdvice(float(centre), slope, for_blur, for_bias))
    return advice


class _Offsets(NamedTuple):
    """How far the index is off its value at the middle of a band."""

    setup: Setup
    centre: float  # nm
    glass: str | Medium | None

    def across(self, half: float) -> float:
        """From end to end of the band."""
        return abs(self._at(-half) - self._at(half))

    def aside(self, half: float) -> float:
        """From the middle to the worse end."""
        return max(abs(self._at(side * half) - self._at(0.0)) for side in (-1, 1))

    def _at(self, offset):
        """Index at a wavelength, or at the nearest one for which there are data."""
        if not bends_colours(self.setup):
            return 1.0
        optic: Any = self.setup.optic
        glass = medium(optic.glass if self.glass is None else self.glass).range_nm
        around = medium(optic.surroundings).range_nm
        low, high = max(glass[0], around[0]), min(glass[1], around[1])
        return index_at(self.setup, float(np.clip(self.centre + offset, low, high)), self.glass)


def _per_index(setup, points, seen):
    """Largest px per unit of index in any view, and largest relative change of depth per unit of index."""
    if not bends_colours(setup):
        return 0.0, 0.0
    response = point_response(setup.rig(), points, seen)
    column = setup.parameter_names.index("optic.index")
    known = np.isfinite(response.gain).all((-1, -2, -3))
    if not known.any():
        raise SetupError("none of the points is seen by two views: choose points inside the common field")
    moves = np.linalg.norm(response.to_parameters[known][..., column], axis=-1)
    bias = np.abs(response.shifts[known][:, 2, column]) / points[known][:, 2]
    return float(moves.max()), float(bias.max())


def _largest(holds):
    """The largest half width (nm) for which something holds that wider bands make worse; infinite where all do."""
    low, high = 0.0, _WIDEST / 2
    if holds(high):
        return np.inf
    for _ in range(40):
        middle = (low + high) / 2
        low, high = (middle, high) if holds(middle) else (low, middle)
    return low


def _checked_band(band):
    if len(band) != 2 or not 0 < band[0] < band[1] < np.inf:
        raise SetupError(f"a band is (shortest, longest) wavelength in nm, got {tuple(band)}")
    return float(band[0]), float(band[1])
