"""A prism with all that its workshop drawing states."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..optics import Prism
from ..optics.dimensions import ClearAperture, PrismDimensions, prism_dimensions
from ..optics.solid import PrismSolid, prism_solid, seam_directions
from ..rigs import Setup
from .ray_parts import reach_along_ridge
from .workshop import light_aperture


@dataclass(frozen=True, eq=False)
class Part:
    """A prism and its measures; azimuths are turned so that facet 0 looks up."""

    prism: Prism
    solid: PrismSolid
    measures: PrismDimensions
    aperture: ClearAperture
    turn: float  # rad, by which the prism is turned about its axis

    def front(self, points: np.ndarray) -> np.ndarray:
        """Points (..., 3) of the workshop's frame, seen onto the facets, (..., 2) mm."""
        c, s = np.cos(self.turn), np.sin(self.turn)
        return np.asarray(points)[..., :2] @ np.array([[c, s], [-s, c]])

    @property
    def apex(self) -> np.ndarray:
        """(3,) mm, workshop frame."""
        return np.array([0.0, 0.0, self.prism.thickness])

    @property
    def feet(self) -> np.ndarray:
        """Where each edge ends at the outline, (n, 3) mm, workshop frame."""
        seams = seam_directions(self.prism)
        if self.prism.radius is not None:
            steps = self.prism.radius / np.linalg.norm(seams[:, :2], axis=-1)
        elif self.prism.facets == 2:
            steps = np.linalg.norm(self.solid.vertices[[0, 3]] - self.apex, axis=-1)
        else:
            steps = self.prism.thickness / -seams[:, 2]
        return seams * steps[:, None] + self.apex


def part_of(setup: Setup, width: float | None) -> Part:
    """The prism of a setup; `width` (mm) as in `workshop.workshop_drawing`."""
    prism = setup.optic
    assert isinstance(prism, Prism)
    if prism.facets == 2 and prism.radius is None and width is None:
        width = prism_width(setup)
    measures = prism_dimensions(prism, width)
    solid = prism_solid(prism, tolerance=0.005, width=width)
    return Part(prism, solid, measures, light_aperture(setup), float(np.pi / 2 - measures.facet_azimuths[0]))


def prism_width(setup: Setup) -> float:
    """Length (mm) along the ridge of a biprism without a radius: what the camera's light needs, and a fifth more."""
    return float(np.ceil(2.4 * reach_along_ridge(setup, setup.rig())))
