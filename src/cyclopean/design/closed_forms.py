"""Figures of thousands of prisms at once, in closed form: thin prisms, which shift what each view shows.

A view through facet k shows a point at depth Z where the bare camera would, moved by tan(delta) (1 - z_apex / Z)
towards the facet (for two facets: Lee and Kweon 2000, A novel stereo camera system by a biprism). So what views share,
over depth, depends on that shift alone: it is drawn once for each number of facets and then looked up. Light that
leaves a steep facet is also spread by cos(a) / cos(a + delta) along its slope; that is taken as on the axis.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields
from functools import cache, lru_cache

import numpy as np
from numpy.typing import ArrayLike

from ..cameras import Camera
from ..geometry import polygon_area
from ..optics import Prism, medium
from ..rigs.sizing import EDGE, axis_deviation, covering_slope, reach
from ..rigs.view import DEFAULT_MARGIN
from .evaluation import DEPTHS
from .outlines import SubImages, picture_border
from .requirements import Requirements
from .sections import Sections

_SHIFTS = 48  # values of the shift that are drawn
_CELLS = 64  # across each drawing


@dataclass(frozen=True, eq=False)
class Shapes:
    """What n views share over depth, at S values of the shift, all in normalised coordinates."""

    shifts: np.ndarray  # (S,)
    rectangle: np.ndarray  # (S, 2) width and height of the rectangle that two views or more see
    area_two: np.ndarray  # (S,)
    share_two: np.ndarray  # (S,) of the picture's pixels
    spread: np.ndarray  # (S,) rms over the field of 1 / sqrt(Q), see `_spread`

    @classmethod
    def of(cls, camera: Camera, facets: int, azimuth_deg: float, proportions: tuple[float, float] | None) -> Shapes:
        """Draw them for prisms with one number of facets."""
        prism = Prism(facets, 1.0, 1.5, 1.0, azimuth_deg=azimuth_deg)
        images = SubImages.of(camera, prism, 0.0)
        farthest = float(np.linalg.norm(picture_border(camera), axis=-1).max())
        shifts = np.linspace(0, farthest, _SHIFTS)
        towards = np.stack([np.cos(images.azimuths), np.sin(images.azimuths)], -1)
        moved = shifts[:, None] * towards[:, None]  # (n, S, 2)
        outlines = [corners - moved[k][:, None] for k, corners in enumerate(images.corners)]
        sections = Sections.of(outlines, _CELLS)
        counts = sections.counts
        picture = float(sum(map(polygon_area, images.corners)))
        return cls(
            shifts,
            sections.rectangles(counts >= 2, proportions),
            sections.areas(counts >= 2),
            sections.areas(np.where(counts >= 2, counts, 0)) / picture,
            _spread(sections, counts, towards),
        )

    def at(self, name: str, shifts: np.ndarray) -> np.ndarray:
        """One of the figures at shifts (...,): zero, or NaN for `spread`, where views share nothing."""
        values = getattr(self, name)
        if values.ndim == 2:
            return np.stack([self._interpolated(column, shifts) for column in values.T], -1)
        return self._interpolated(values, shifts)

    def _interpolated(self, values, shifts):
        empty = np.nan if values is self.spread else 0.0
        return np.interp(shifts, self.shifts, values, left=empty, right=empty)


def _spread(sections, counts, towards):
    """rms (S,) of 1 / sqrt(Q), Q = sum |c - mean c|^2 of the centres c, 1 off the axis, of views that see a cell."""
    total = np.tensordot(sections.seen.astype(np.float32), towards.astype(np.float32), (0, 0))
    shared = counts >= 2
    squares = counts - (total**2).sum(-1) / np.maximum(counts, 1)
    inverse = np.where(shared & (squares > 1e-6), 1 / np.maximum(squares, 1e-6), 0.0)
    number = shared.sum((1, 2))
    return np.sqrt(np.where(number > 0, inverse.sum((1, 2)) / np.maximum(number, 1), np.nan))


@dataclass(frozen=True, eq=False)
class Screen:
    """N prisms and their figures in closed form, over D depths."""

    facets: np.ndarray  # (N,) int
    glass: np.ndarray  # (N,) int, which of the requirements' glasses
    apex_deg: np.ndarray  # (N,)
    azimuth_deg: np.ndarray  # (N,) of facet 0
    distance: np.ndarray  # (N,) mm, from the pinhole to the flat face
    solved: np.ndarray  # (N,) bool, whether exact rays give the baseline wanted there
    length: np.ndarray  # (N,) mm, from the pinhole to the apex
    diameter: np.ndarray  # (N,) mm
    baseline: np.ndarray  # (N,) mm
    accuracy: np.ndarray  # (N,) relative sigma of depth at the worst depth; inf where views share nothing at any
    field: np.ndarray  # (N, 2) mm, of the smallest rectangle over the depths
    shared: np.ndarray  # (N,) least side of that rectangle at any depth over that of the picture
    area: np.ndarray  # (N,) mm^2, that two views or more share at the middle depth
    use: np.ndarray  # (N,) share of the sensor, mean over the depths
    blend: np.ndarray  # (N,) px
    chromatic: np.ndarray  # (N,) px
    doubt: np.ndarray  # (N,) how little closed forms are worth: 1 for thin prisms and narrow pictures, more for others

    def __len__(self) -> int:
        return len(self.facets)

    def __getitem__(self, index) -> Screen:
        return Screen(*(getattr(self, one.name)[index] for one in fields(self)))

    @classmethod
    def joined(cls, screens: Sequence[Screen]) -> Screen:
        """Several as one."""
        return cls(*(np.concatenate([getattr(screen, one.name) for screen in screens]) for one in fields(cls)))


def edge_of(requirements: Requirements) -> float:
    """Glass at the rim, mm: 1.5 mm, less for prisms that work at less than 150 mm."""
    return float(np.clip(requirements.depths[0] / 100, 0.3, EDGE))


def screen(
    requirements: Requirements, facets: int, glass: int, apex_deg: ArrayLike, distance: ArrayLike, azimuth_deg: float
) -> Screen:
    """Figures of prisms with one number of facets, of one glass (a number), with apex angles and distances (N,)."""
    camera, (near, far) = requirements.camera, requirements.depths
    apex, distance = (np.asarray(values, dtype=float) for values in (apex_deg, distance))
    low, nominal, high = (glass_index(requirements.glasses[glass], nm) for nm in _wavelengths(requirements))
    delta, slope = axis_deviation(nominal, apex), covering_slope(camera, apex)
    length = (distance + edge_of(requirements)) / (1 - slope)
    depths = np.geomspace(near, far, DEPTHS)[:, None]
    focal = float(np.mean(camera.focal))
    cosine = np.cos(np.deg2rad(apex) + delta)
    stretch = np.cos(np.deg2rad(apex)) / cosine / np.cos(delta) ** 2
    blend = _blend(requirements, distance, length, nominal)
    inset = (DEFAULT_MARGIN + blend / 2) / focal / np.sin(np.pi / facets)
    shifts = np.tan(delta) * (1 - length / depths) / stretch - inset
    shapes = _shapes(camera, facets, azimuth_deg, requirements.field)
    radius = length * np.tan(delta)
    with np.errstate(invalid="ignore"):
        sigma = depths * requirements.noise * stretch / (focal * radius) * shapes.at("spread", shifts)
        usual = np.isfinite(sigma).any(0) & (length < near)
        rectangles = shapes.at("rectangle", shifts)  # over depth
        use = shapes.at("share_two", shifts).mean(0)
    chromatic = focal * np.sin(np.deg2rad(apex)) / cosine * abs(low - high) * (1 - length / far)
    return Screen(
        np.full(apex.shape, facets),
        np.full(apex.shape, glass),
        apex,
        np.full(apex.shape, azimuth_deg),
        distance,
        np.zeros(apex.shape, dtype=bool),
        length,
        2 * reach(camera) * length,
        2 * radius * np.sin(np.pi / facets),
        np.where(usual, np.max(np.nan_to_num(sigma), axis=0), np.inf),
        _smallest(depths[..., None] * rectangles),
        (rectangles / np.divide(camera.size, camera.focal)).min((0, 2)),
        depths[DEPTHS // 2] ** 2 * shapes.at("area_two", shifts[DEPTHS // 2]),
        use,
        blend,
        chromatic,
        (1 + reach(camera) ** 2) ** 2 / cosine**2,
    )


def _smallest(rectangles):
    """Of rectangles (D, N, 2) that with the least area, (N, 2)."""
    least = np.nanargmin(np.nan_to_num(rectangles.prod(-1)), axis=0)
    return rectangles[least, np.arange(rectangles.shape[1])]


def _wavelengths(requirements):
    low, high = requirements.band
    return low, requirements.wavelength_nm, high


@cache
def glass_index(glass: str, wavelength_nm: float) -> float:
    """Index of a glass relative to air."""
    return float(medium(glass).index_in_air(wavelength_nm))


@lru_cache(maxsize=32)
def _shapes(camera, facets, azimuth_deg, proportions):
    return Shapes.of(camera, facets, azimuth_deg, proportions)


def _blend(requirements, distance, length, index):
    """Width (N,) px of the blend band, as `Setup.blend_band` has it."""
    if requirements.f_number is None or requirements.camera.pixel_pitch is None:
        return np.zeros(distance.shape)
    camera, focus = requirements.camera, requirements.focus
    pupil = 1 / (1 / (camera.focal[0] * camera.pixel_pitch) + 1 / focus) / requirements.f_number
    seam = np.minimum(distance + (length - distance) / index, focus)
    return pupil * (1 / seam - 1 / focus) * camera.focal[0]
