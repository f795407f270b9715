"""How large a prism must be, how far away, and how far apart its virtual cameras stand."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from ..cameras import Camera
from ..errors import SetupError
from ..geometry import nearest_point
from .rig import Rig

EDGE = 1.5  # mm, of glass at the rim
_COVER = 1.08  # of the picture's farthest corner, at the apex: how far the glass reaches
_STEEPEST = 0.9  # of the depth of the apex, that facets may take up from axis to rim
_ACROSS = 41  # samples across the picture
_AZIMUTHS = {2: 0.0, 4: 45.0}  # degrees; others 90


def usual_azimuth(facets: int) -> float:
    """Azimuth (degrees) of facet 0: views side by side for two facets, upright pictures for others."""
    return _AZIMUTHS.get(facets, 90.0)


def reach(camera: Camera) -> float:
    """Radius of a prism that covers the picture, over the depth of its apex."""
    return _COVER * _half_diagonal(camera)


def covering_slope(camera: Camera, apex_deg: ArrayLike) -> np.ndarray:
    """Share (...,) of the apex's depth that facets take up from axis to rim; NaN where no prism covers the picture."""
    slope = reach(camera) * np.tan(np.deg2rad(np.asarray(apex_deg, dtype=float)))
    return np.where((slope > 0) & (slope < _STEEPEST), slope, np.nan)


def apex_depth(camera: Camera, apex_deg: float, distance: float, edge: float = EDGE) -> float:
    """Depth (mm) of the apex of a prism that covers the picture, its flat face at a distance (mm) from the pinhole.

    thickness = radius tan(apex) + edge, with the radius that covers the picture at the apex's depth.

    Raises
    ------
    SetupError
        Facets so steep, or a field so wide, that the rim would be thinner than nothing.
    """
    return (distance + edge) / (1 - _slope(camera, apex_deg))


def flat_distance(camera: Camera, apex_deg: ArrayLike, depth: ArrayLike, edge: float = EDGE) -> np.ndarray:
    """Distance (...,) mm of the flat face of a prism that covers the picture, its apex at a depth (...,) mm.

    NaN where no prism covers the picture; see `apex_depth`.
    """
    return np.asarray(depth) * (1 - covering_slope(camera, apex_deg)) - edge


def axis_deviation(index: ArrayLike, apex_deg: ArrayLike) -> np.ndarray:
    """Angle delta (...,) rad by which light along the axis is bent, asin(n sin a) - a; NaN where it is reflected."""
    apex = np.deg2rad(apex_deg)
    with np.errstate(invalid="ignore"):
        return np.arcsin(np.asarray(index) * np.sin(apex)) - apex


def covering_solid(camera: Camera, apex_deg: float, distance: float, edge: float = EDGE) -> tuple[float, float]:
    """Thickness and radius (mm) of the prism that just covers the picture, its flat face at a distance (mm)."""
    apex = apex_depth(camera, apex_deg, distance, edge)
    return apex - distance, reach(camera) * apex


def sample_pixels(size: tuple[int, int]) -> np.ndarray:
    """Pixels (N, 2) spread over a picture: they stay where they are as the optic moves."""
    width, height = size
    step = max(width, height) / _ACROSS
    grid = np.meshgrid(np.arange(step / 3, width - 1, step), np.arange(step / 3, height - 1, step))
    return np.stack(grid, -1).reshape(-1, 2)


def virtual_centres(rig: Rig) -> np.ndarray:
    """Optical centres (V, 3) mm of the virtual cameras: the point nearest to all rays of each view."""
    pixels = sample_pixels(rig.size)
    centres = [nearest_point(view.rays(pixels[view.region.contains(pixels)])).points for view in rig]
    return np.array(centres)


def baseline(rig: Rig) -> float:
    """Mean distance (mm) of the optical centres of neighbouring views: of facets that share an edge."""
    if len(rig) < 2:
        raise SetupError("a baseline lies between two views, but this rig has one")
    return mean_spacing(virtual_centres(rig))


def mean_spacing(centres: np.ndarray) -> float:
    """Mean distance (mm) between each of the centres (V, 3) and the next."""
    return float(np.linalg.norm(np.roll(centres, -1, axis=0) - centres, axis=-1).mean())


def _half_diagonal(camera):
    """From the optical axis to the farthest corner of the picture, over depth."""
    width, height = camera.size
    corners = camera.normalise([[x - 0.5, y - 0.5] for x in (0, width) for y in (0, height)])
    return float(np.nanmax(np.hypot(*corners.T)))


def _slope(camera, apex_deg):
    slope = float(covering_slope(camera, apex_deg))
    if np.isnan(slope):
        raise SetupError(
            f"no prism with facets of {apex_deg:g} degrees covers this camera's field of "
            f"{2 * np.degrees(np.arctan(_half_diagonal(camera))):.0f} degrees: its rim would be thinner than nothing; "
            "take a longer lens or flatter facets"
        )
    return slope
