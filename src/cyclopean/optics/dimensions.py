"""The measures of a prism that a workshop needs: angles, rim, areas, volume, and the aperture that light uses."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..geometry import Rays
from .footprints import meeting_points
from .prism import Prism
from .solid import FLAT, facet_planes, prism_solid, seam_directions
from .surfaces import Reason


@dataclass(frozen=True, eq=False)
class PrismDimensions:
    """Measures of a prism with n facets; edge k lies between facet k and facet k + 1."""

    facet_angles: np.ndarray  # (n,) rad, between each facet and the flat face
    facet_azimuths: np.ndarray  # (n,) rad, anticlockwise as seen onto the facets
    edge_angles: np.ndarray  # (n,) rad, between each edge and the flat face
    edge_azimuths: np.ndarray  # (n,) rad
    dihedral_angles: np.ndarray  # (n,) rad, inside the glass, between facet k and facet k + 1
    height: float  # mm, from the flat face to the apex
    rim: tuple[float, float]  # mm, least and greatest thickness at the outline; (0, 0) where facets meet the flat face
    flat_area: float  # mm^2
    facet_areas: np.ndarray  # (n,) mm^2
    volume: float  # mm^3

    def mass(self, density: float) -> float:
        """Mass in g of a material of this density in g/cm^3."""
        return 1e-3 * density * self.volume


def prism_dimensions(prism: Prism, width: float | None = None) -> PrismDimensions:
    """Measures of a prism, in closed form where its outline is round.

    For a regular pyramid with facet angle a these are: edge angle b with tan b = tan a cos(pi / n), dihedral angle q
    with cos q = -(cos^2 a + sin^2 a cos(2 pi / n)), and height = inradius tan a. They follow from the normals:
    an edge lies in two facets, and the angle inside the glass is the supplement of that between outward normals.

    Parameters
    ----------
    prism : Prism
        The prism; each facet counts with its own angle and azimuth.
    width : float, optional
        Length along the ridge (mm) of a biprism without a radius, as in `prism_solid`.
    """
    normals, angles, azimuths = facet_planes(prism)
    seams = seam_directions(prism)
    following = np.roll(normals, -1, axis=0)
    sine = np.linalg.norm(np.cross(normals, following), axis=-1)
    dihedral = np.pi - np.arctan2(sine, np.sum(normals * following, axis=-1))
    edge_angles = np.arctan2(-seams[:, 2], np.hypot(seams[:, 0], seams[:, 1]))
    edge_azimuths = np.arctan2(seams[:, 1], seams[:, 0])
    if prism.radius is None:
        solid = prism_solid(prism, width=width)
        rim, flat_area, volume = (0.0, 0.0), solid.area(FLAT), solid.volume
        facet_areas = np.array([solid.area(f"facet {k}") for k in range(prism.facets)])
    else:
        rim, flat_area, facet_areas, volume = _round_measures(prism, angles, azimuths, edge_azimuths)
    return PrismDimensions(
        angles, azimuths, edge_angles, edge_azimuths, dihedral, prism.thickness, rim, flat_area, facet_areas, volume
    )


def _round_measures(prism, angles, azimuths, edge_azimuths):
    """Rim, flat area, facet areas and volume of a prism with a cylinder for an outline.

    Below facet k the glass reaches to t - r tan(a) cos(u), u the azimuth from the facet's; integrated over its sector.
    """
    radius, thickness, slopes = prism.radius, prism.thickness, np.tan(angles)
    before = np.mod(azimuths - np.roll(edge_azimuths, 1), 2 * np.pi)  # how far each sector reaches to both sides
    after = np.mod(edge_azimuths - azimuths, 2 * np.pi)
    sectors = before + after
    volume = np.sum(radius**2 * thickness * sectors / 2 - radius**3 * slopes * (np.sin(after) + np.sin(before)) / 3)
    rim = thickness - radius * slopes.max(), thickness - radius * float(np.min(slopes * np.cos(after)))
    return (
        (max(float(rim[0]), 0.0), float(rim[1])),
        float(np.pi * radius**2),
        radius**2 * sectors / 2 / np.cos(angles),
        float(volume),
    )


@dataclass(frozen=True)
class ClearAperture:
    """Where light of the camera meets a prism's faces, were the faces as large as they need to be.

    NaN where no ray meets the prism; infinite where some do, and others find no facet: past the sharp outer edge, in
    which facets cut the flat face, no outline helps.
    """

    flat_face: float  # mm, radius around the prism's axis
    facets: float  # mm, radius around the prism's axis
    half_box: tuple[float, float]  # mm, half of the box around both: along facet 0's azimuth, and at right angles to it

    @property
    def radius(self) -> float:
        """The larger of the two, mm."""
        return max(self.flat_face, self.facets)

    def widened(self, margin: float) -> ClearAperture:
        """The aperture with so many mm more all around."""
        box = (self.half_box[0] + margin, self.half_box[1] + margin)
        return ClearAperture(self.flat_face + margin, self.facets + margin, box)


def clear_aperture(prism: Prism, wavelength_nm: float, rays: Rays) -> ClearAperture:
    """The part of each face that rays of the camera pass through.

    Parameters
    ----------
    prism : Prism
        Its outline does not count: each ray takes the facet that it would meet if the facets ran on.
    wavelength_nm : float
        Of the light.
    rays : Rays
        (N,) rays of the camera in the rig frame; those of the picture's border reach farthest.

    Returns
    -------
    ClearAperture
        Radii around the prism's axis.
    """
    placement = prism.placement
    farthest, box = np.full(2, np.nan), np.full(2, np.nan)
    azimuth = facet_planes(prism)[2][0]
    axes = np.array([[np.cos(azimuth), np.sin(azimuth)], [-np.sin(azimuth), np.cos(azimuth)]])
    facet_first = prism.facing == "camera"
    lost = np.ones(rays.origins.shape[:-1], dtype=bool)
    for path in prism.paths(wavelength_nm):
        points = meeting_points(path, rays)
        facet = 0 if facet_first else 1
        bounds = path.interfaces[facet].bounds
        others = bounds[bounds[:, 4] == Reason.WRONG_FACET]
        with np.errstate(invalid="ignore"):
            own = (points[:, facet] @ others[:, :3].T <= others[:, 3] + 1e-9).all(-1)
        lost &= ~(own & np.isfinite(points).all((-1, -2)))
        arms = (points[own] - placement.translation) @ placement.rotation
        arms = arms[np.isfinite(arms).all((-1, -2))][..., :2]
        if len(arms):
            reach = np.linalg.norm(arms, axis=-1).max(0)
            farthest = np.fmax(farthest, reach[::-1] if facet_first else reach)
            box = np.fmax(box, np.abs(arms @ axes.T).max((0, 1)))
    if lost.any() and not lost.all():
        return ClearAperture(np.inf, np.inf, (np.inf, np.inf))
    return ClearAperture(float(farthest[0]), float(farthest[1]), (float(box[0]), float(box[1])))
