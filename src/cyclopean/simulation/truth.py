"""What is true in a simulated photograph: depth, facet, surface, and where each point is seen in every view."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ..optics import Path
from ..rigs import Rig, Setup, View
from .checks import check_optic, check_scene
from .intersection import Triangles
from .scene import Scene

_AT_ONCE = 2**20  # pixels


class Matches(NamedTuple):
    """Points, and the pixels at which every view sees them."""

    points: np.ndarray  # (N, 3) mm
    pixels: np.ndarray  # (N, V, 2) px, NaN where the point is hidden from a view or outside its part of the picture
    first: np.ndarray  # (N,) int, the view that each point was drawn from


@dataclass(frozen=True, eq=False)
class Truth:
    """What the central ray of each pixel meets, through the closed aperture."""

    points: np.ndarray  # (H, W, 3) mm, NaN where the ray meets nothing
    facet: np.ndarray  # (H, W) int8, number of the view, -1 none
    surface: np.ndarray  # (H, W) int, number of the surface, -1 none
    rig: Rig
    triangles: Triangles

    @property
    def depth(self) -> np.ndarray:
        """(H, W) mm: z of the points."""
        return self.points[..., 2]

    def matches(self, count: int = 2000, seed: int = 0) -> Matches:
        """Points drawn at random from the photograph, and where every view sees them.

        Parameters
        ----------
        count : int
            How many; fewer where fewer rays meet a surface. Places are drawn evenly over the photograph, to fractions
            of a pixel.
        seed : int
            Of the draw.

        Returns
        -------
        Matches
            Points, their pixels and the view that each was drawn from. A point is hidden from a view when the ray of
            the pixel that it projects to meets another surface first.
        """
        rng = np.random.default_rng(seed)
        rows, columns = np.nonzero(np.isfinite(self.depth))
        chosen = rng.choice(len(rows), min(int(count), len(rows)), replace=False)
        rows, columns = rows[chosen], columns[chosen]
        first = self.facet[rows, columns].astype(int)
        pixels = np.stack([columns, rows], -1) + rng.uniform(-0.5, 0.5, (len(rows), 2))
        points = np.full((len(rows), 3), np.nan)
        for k, view in enumerate(self.rig):
            points[first == k] = self.triangles.meet(view.rays(pixels[first == k])).points
        known = np.isfinite(points[:, 0])  # a place beside the centre of its pixel may see past an edge
        points, first = points[known], first[known]
        seen = self.rig.project(points)
        for k, view in enumerate(self.rig):
            met = self.triangles.meet(view.rays(seen[:, k])).points
            miss = np.linalg.norm(met - points, axis=-1)
            seen[~(miss <= 10 * self.triangles.resolution), k] = np.nan
        return Matches(points, seen, first)


def trace_truth(setup: Setup, scene: Scene, *, with_optic: bool = True) -> Truth:
    """What the central ray of each pixel of a simulated photograph meets.

    Parameters
    ----------
    setup : Setup
        Camera and optic; its wavelength counts, its aperture does not.
    scene : Scene
        What stands in front of them.
    with_optic : bool
        False: the camera alone, as one view.

    Raises
    ------
    OpticError
        When the camera stands in the glass, or no light reaches it through a facet.
    SetupError
        When no surface is in front of the optic, or one reaches into it.
    """
    paths = setup.optic.paths(setup.wavelength_nm) if with_optic else (Path(()),)
    if with_optic:
        check_optic(setup, paths)
    check_scene(setup, scene, paths)
    rig = setup.rig() if with_optic else Rig((View(setup.camera, paths[0], name="camera"),))
    facet = rig.facets
    points, surface = np.full((*facet.shape, 3), np.nan), np.full(facet.shape, -1, dtype=np.int32)
    for k, view in enumerate(rig):
        seen = np.flatnonzero(facet == k)
        for start in range(0, len(seen), _AT_ONCE):
            rows, columns = np.divmod(seen[start : start + _AT_ONCE], facet.shape[1])
            hits = scene.triangles.meet(view.rays(np.stack([columns, rows], -1).astype(float)))
            points[rows, columns], surface[rows, columns] = hits.points, hits.surface
    return Truth(points, facet, surface, rig, scene.triangles)
