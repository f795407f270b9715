"""Where rays meet a scene: Embree finds the triangle, double precision finds the point on it."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from ..errors import SetupError
from ..geometry import Rays, launch

if TYPE_CHECKING:
    from .scene import Scene

RESOLUTION = 2e-6  # of the scene's size: what single precision may lose; nearer surfaces cannot be told apart
_OUTSIDE = 1e-11  # barycentric coordinate of a point that rounding alone puts outside its triangle
_SHARE = 8192  # rays that are worth a thread
# where to look around a ray, in units of the resolution: small steps for small triangles, large ones for rounding
_ANGLES = 2 * np.pi * np.arange(24) / 24
_RING = np.resize([0.3, 1.0, 3.0], 24)[:, None] * np.stack([np.cos(_ANGLES), np.sin(_ANGLES)], -1)


@dataclass(frozen=True, eq=False)
class Hits:
    """Where rays first meet a scene."""

    points: np.ndarray  # (..., 3) mm, NaN for none
    surface: np.ndarray  # (...,) int32, number of the surface, -1 for none


class Triangles:
    """All triangles of a scene, as Embree searches them."""

    def __init__(self, scene: Scene):
        counts = [len(surface.faces) for surface in scene.surfaces]
        first = np.cumsum([0, *(len(surface.vertices) for surface in scene.surfaces)])
        self.vertices = np.concatenate([surface.vertices for surface in scene.surfaces])  # (N, 3) mm
        self.faces = np.concatenate([surface.faces + k for surface, k in zip(scene.surfaces, first, strict=False)])
        self.surface = np.repeat(np.arange(len(counts), dtype=np.int32), counts)  # (T,) of each triangle
        self.middle = scene.box.mean(0)  # Embree's origin
        self.size = float(np.linalg.norm(scene.box[1] - scene.box[0]))
        self._embree = _embree_scene(self.vertices - self.middle, self.faces)

    @property
    def resolution(self) -> float:
        """Length (mm) below which single precision cannot tell places apart."""
        return RESOLUTION * max(self.size, 1e-9)

    def first(self, origins: np.ndarray, directions: np.ndarray) -> np.ndarray:
        """Triangle (N,) int32 that each ray meets first, -1 for none.

        Rays as float32 (N, 3), their origins seen from `middle`; NaN rays meet nothing.
        """
        return self._ask(origins, directions, None)

    def blocked(self, origins: np.ndarray, directions: np.ndarray, reach: np.ndarray) -> np.ndarray:
        """True (N,) where something stands on a ray nearer than `reach` (N,), in lengths of its direction."""
        return self._ask(origins, directions, reach) >= 0

    def meet(self, rays: Rays) -> Hits:
        """Where rays (...,) first meet a surface, exactly.

        Embree's answer is that of a ray some 1e-7 of the scene's size beside the true one. Where the true ray misses
        that triangle, Embree is asked again all around, and the first triangle that the true ray does meet is taken.
        Only at an outline is it single precision that says which of two surfaces is met.
        """
        origins = np.ascontiguousarray(rays.origins, dtype=float).reshape(-1, 3)
        directions = np.ascontiguousarray(rays.directions, dtype=float).reshape(-1, 3)
        near = self._near(origins, directions)
        triangle = self.first((near - self.middle).astype(np.float32), directions.astype(np.float32))
        points, weights = self._on(triangle, origins, directions)
        missed = np.flatnonzero((triangle >= 0) & ~(weights.min(-1) >= -_OUTSIDE))
        for start in range(0, len(missed), _SHARE):
            rows = missed[start : start + _SHARE]
            some = near[rows], directions[rows], triangle[rows], points[rows]
            points[rows], triangle[rows] = self._around(*some)
        surface = np.where(triangle >= 0, self.surface[triangle], np.int32(-1))
        shape = rays.shape
        return Hits(points.reshape(*shape, 3), surface.reshape(shape))

    def _on(self, triangle, origins, directions):
        """Points (N, 3) of rays on the planes of triangles (N,), and the weights (N, 3) of the corners there."""
        from . import kernels

        points, weights = np.empty((2, len(triangle), 3))
        launch(kernels.meet, len(triangle), origins, directions, triangle, self.vertices, self.faces, points, weights)
        return points, weights

    def _around(self, origins, directions, triangle, points):
        """Points (M, 3) and triangles (M,) of rays (M,) that pass just beside the triangles and points given.

        A ray that meets nothing around stays with its triangle, at the depth of one of its places.
        """
        along = self.vertices[self.faces[triangle]] - origins[:, None]
        along = np.einsum("mkc,mc->mk", along, directions)  # of the corners
        reach = np.einsum("mc,mc->m", points - origins, directions)
        reach = np.where(np.isfinite(reach), reach, along.mean(-1)).clip(along.min(-1), along.max(-1))
        points = origins + reach[:, None] * directions
        across = np.cross(directions, np.eye(3)[np.abs(directions).argmin(-1)])
        across /= np.linalg.norm(across, axis=-1, keepdims=True)
        ring = self.resolution * (_RING @ np.stack([across, np.cross(directions, across)], 1))  # (M, K, 3)
        towards = ((points - origins)[:, None] + ring).reshape(-1, 3).astype(np.float32)
        origins, directions = (np.repeat(array, len(_RING), axis=0) for array in (origins, directions))
        other = self.first((origins - self.middle).astype(np.float32), towards)
        there, weights = self._on(other, origins, directions)
        met = np.einsum("nc,nc->n", there - origins, directions)
        met = np.where(weights.min(-1) >= -_OUTSIDE, met, np.inf).reshape(-1, len(_RING))
        rows = np.arange(len(met)) * len(_RING) + met.argmin(-1)
        found = np.isfinite(met.min(-1))
        return np.where(found[:, None], there[rows], points), np.where(found, other[rows], triangle)

    def _near(self, origins, directions):
        """Points (N, 3) of the rays near the scene: a far origin would cost digits."""
        with np.errstate(invalid="ignore"):
            ahead = np.einsum("ij,ij->i", self.middle - origins, directions) - self.size
        return origins + np.maximum(ahead, 0.0)[:, None] * directions

    def _ask(self, origins, directions, reach):
        import numba

        count = len(origins)
        threads = max(1, min(numba.get_num_threads(), count // _SHARE))
        query = "INTERSECT" if reach is None else "OCCLUDED"

        def part(start, stop):
            limits = None if reach is None else reach[start:stop]
            return self._embree.run(*_without_nan(origins[start:stop], directions[start:stop]), limits, query=query)

        if threads == 1:
            return part(0, count)
        ends = np.linspace(0, count, threads + 1).astype(int)
        with ThreadPoolExecutor(threads) as pool:  # Embree runs without Python's lock
            return np.concatenate(list(pool.map(part, ends[:-1], ends[1:])))


def _embree_scene(vertices, faces):
    try:
        from embreex import rtcore_scene
        from embreex.mesh_construction import TriangleMesh
    except ImportError:
        raise SetupError(
            "simulation needs Embree, which finds what rays meet: pip install embreex (there are packages for Linux "
            "and Windows on x86-64 and for macOS)"
        ) from None
    embree = rtcore_scene.EmbreeScene(robust=True)  # watertight: no ray slips through between two triangles
    TriangleMesh(embree, vertices.astype(np.float32), faces.astype(np.int32))
    embree.run(*np.ones((2, 1, 3), np.float32))  # builds it now: two threads would do it twice
    return embree


def _without_nan(origins, directions):
    """Rays (N, 3) whose direction is 0 where they are NaN: those meet nothing at once, NaN costs a search of all."""
    good = np.isfinite(origins).all(-1) & np.isfinite(directions).all(-1)
    if good.all():
        return origins, directions
    return np.where(good[:, None], origins, np.float32(0)), np.where(good[:, None], directions, np.float32(0))
