"""The prism as a body: its corners, faces, edges and volume, for a workshop and for pictures."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ..errors import OpticError
from ..geometry import clip_by_half_plane
from .prism import Prism

FLAT, WALL = "flat face", "wall"
_SAME = 1e-9  # mm: corners nearer than this are one
FINEST = 1e-5  # mm: a polygon nearer to a round outline would have too many corners


@dataclass(frozen=True, eq=False)
class PrismSolid:
    """A prism as a closed polyhedron, in the workshop's frame.

    The flat face lies in z = 0 with the glass above it, the apex at (0, 0, thickness), and facet k looks to the azimuth
    that the prism gives it, whichever way the prism faces. The corners of each face run anticlockwise as seen from
    outside. A round outline is a polygon inside the true circle, no farther from it than `tolerance`.
    """

    prism: Prism
    vertices: np.ndarray  # (N, 3) mm
    faces: tuple[np.ndarray, ...]  # corners of each face: the flat face, the n facets, then the walls
    names: tuple[str, ...]  # of each face: "flat face", "facet k" or "wall"
    tolerance: float  # mm, largest distance from a round outline; 0 where every face is a true polygon

    @cached_property
    def triangles(self) -> np.ndarray:
        """(T, 3) int: the faces cut into triangles; every edge belongs to two of them, once in each direction."""
        return np.concatenate([
            np.stack([np.full(len(face) - 2, face[0]), face[1:-1], face[2:]], axis=-1) for face in self.faces
        ])  # fmt: skip

    @cached_property
    def volume(self) -> float:
        """Volume of the polyhedron, mm^3."""
        a, b, c = np.moveaxis(self.vertices[self.triangles], 1, 0)
        return float(np.einsum("ti,ti->", a, np.cross(b, c)) / 6)

    def area(self, name: str) -> float:
        """Area (mm^2) of all faces of this name."""
        total = 0.0
        for face, its_name in zip(self.faces, self.names, strict=True):
            if its_name == name:
                corners = self.vertices[face] - self.vertices[face[0]]
                total += np.linalg.norm(np.cross(corners[1:-1], corners[2:]).sum(0)) / 2
        return float(total)

    @cached_property
    def planes(self) -> tuple[np.ndarray, np.ndarray]:
        """Outward unit normals (F, 3) of the faces, and their offsets (F,) mm: normal . x = offset."""
        corners = [self.vertices[face] for face in self.faces]
        normals = np.array([np.cross(c[1:-1] - c[0], c[2:] - c[0]).sum(0) for c in corners])
        normals /= np.linalg.norm(normals, axis=-1, keepdims=True)
        return normals, np.array([n @ c.mean(0) for n, c in zip(normals, corners, strict=True)])

    def in_rig(self, points: np.ndarray | None = None) -> np.ndarray:
        """Points (..., 3) of the workshop's frame, the corners where none are given, in the rig frame."""
        points = self.vertices if points is None else np.asarray(points, dtype=float)
        if self.prism.facing == "camera":  # the prism's own frame starts at the apex
            points = points - [0.0, 0.0, self.prism.thickness]
        placement = self.prism.placement
        return points @ placement.rotation.T + placement.translation

    def from_rig(self, points: np.ndarray) -> np.ndarray:
        """Points (..., 3) of the rig frame in the workshop's frame."""
        placement = self.prism.placement
        points = (np.asarray(points, dtype=float) - placement.translation) @ placement.rotation
        return points + np.array([0.0, 0.0, self.prism.thickness if self.prism.facing == "camera" else 0.0])

    def section(self, point: np.ndarray, normal: np.ndarray) -> np.ndarray:
        """Corners (M, 3) in order, in the workshop's frame, of the cut with a plane; M = 0 where it misses.

        `point` (3,) mm is any point of the plane, `normal` (3,) its normal.
        """
        normal = np.asarray(normal, dtype=float) / np.linalg.norm(normal)
        side = np.cross(normal, np.eye(3)[np.argmin(np.abs(normal))])
        side /= np.linalg.norm(side)
        reach = 2 * np.ptp(self.vertices, axis=0).max()
        middle = self.vertices.mean(0)
        middle = middle - ((middle - point) @ normal) * normal
        corners = middle + reach * np.array([[1, 1], [-1, 1], [-1, -1], [1, -1]]) @ np.array(
            [side, np.cross(normal, side)]
        )
        for face_normal, offset in zip(*self.planes, strict=True):
            if len(corners) and (corners @ face_normal).max() > offset:
                corners = clip_by_half_plane(corners, face_normal, offset)
        apart = np.linalg.norm(corners - np.roll(corners, 1, axis=0), axis=-1) > _SAME
        return corners[apart]


def prism_solid(prism: Prism, *, tolerance: float = 0.005, width: float | None = None) -> PrismSolid:
    """The body of a prism.

    Parameters
    ----------
    prism : Prism
        With a radius its outline is a cylinder, which the facets cut in arcs of ellipses. Without one the facets run on
        until they cut the flat face in a polygon.
    tolerance : float
        How far the polygon that stands for a round outline may lie inside it, mm; 1e-5 at least.
    width : float, optional
        Length (mm) along the ridge of a biprism without a radius, whose facets alone would never end; only for it.

    Raises
    ------
    OpticError
        When the facets enclose no body, or `width` is missing or not wanted.
    """
    if not FINEST <= tolerance < np.inf:
        raise OpticError(f"the tolerance of the outline must be a number of mm from {FINEST:g}, got {tolerance:g}")
    if prism.radius is not None:
        _refuse_width(width, "has a round outline")
        return _round_solid(prism, tolerance)
    if prism.facets == 2:
        return _strip_solid(prism, width)
    _refuse_width(width, f"has {prism.facets} facets, which end where they cut the flat face")
    return _pyramid_solid(prism)


def facet_planes(prism: Prism) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Outward normals (n, 3) of the facets in the prism's frame, their angles (n,) and azimuths (n,), rad."""
    angles, azimuths = prism.facet_angles()
    sine = np.sin(angles)
    return np.stack([sine * np.cos(azimuths), sine * np.sin(azimuths), np.cos(angles)], -1), angles, azimuths


def seam_directions(prism: Prism) -> np.ndarray:
    """Unit vectors (n, 3), prism frame, from the apex down the edge between facet k and facet k + 1.

    Raises OpticError where the edges do not follow each other around the apex, so that a facet is missing.
    """
    normals, _, azimuths = facet_planes(prism)
    seams = np.cross(np.roll(normals, -1, axis=0), normals)
    seams /= np.linalg.norm(seams, axis=-1, keepdims=True)
    around = np.arctan2(seams[:, 1], seams[:, 0])
    ahead = np.mod(around - azimuths + np.pi, 2 * np.pi) - np.pi  # of the facet whose edge it is
    behind = np.mod(azimuths - np.roll(around, 1) + np.pi, 2 * np.pi) - np.pi
    if not ((ahead > 0).all() and (behind > 0).all()) or abs((ahead + behind).sum() - 2 * np.pi) > 1e-6:
        raise OpticError(
            "the facets do not follow each other around the apex, so one of them is not there at all: look at "
            f"facet_deviation_deg; azimuths of the facets are {np.degrees(azimuths)} degrees"
        )
    return seams


def _refuse_width(width, why):
    if width is not None:
        raise OpticError(f"a width along the ridge belongs to a biprism without a radius; this prism {why}")


def _facet_height(prism, normals, points):
    """Height z (N, n) of every facet's plane over points (N, 2)."""
    return prism.thickness - points @ (normals[:, :2] / normals[:, 2:]).T


def _round_solid(prism, tolerance):
    """Apex, then the rim's upper and lower corners: one at every edge, the arcs between as fine as asked."""
    radius, normals = prism.radius, facet_planes(prism)[0]
    seams = seam_directions(prism)
    around = np.arctan2(seams[:, 1], seams[:, 0])
    step = 2 * np.arccos(max(1 - tolerance / radius, np.cos(np.pi / 6)))  # six corners at least to half a turn
    azimuths: list[float] = []
    sectors = []
    for facet in range(prism.facets):
        start = around[facet - 1]
        turn = np.mod(around[facet] - start, 2 * np.pi)
        count = max(int(np.ceil(turn / step)), 1)
        sectors.append(len(azimuths) + np.arange(count + 1))
        azimuths.extend(start + turn * np.arange(count) / count)
    total = len(azimuths)
    rim = radius * np.stack([np.cos(azimuths), np.sin(azimuths)], -1)
    heights = _facet_height(prism, normals, rim).min(1)
    upper = np.column_stack([rim, heights])
    lower = np.column_stack([rim, np.zeros(total)])
    thin = heights < _SAME  # the facet touches the flat face there
    top = np.where(thin, 1 + total + np.arange(total), 1 + np.arange(total))
    bottom = 1 + total + np.arange(total)
    faces = [bottom[::-1]] + [np.concatenate([[0], top[sector % total]]) for sector in sectors]
    names = [FLAT, *(f"facet {k}" for k in range(prism.facets))]
    for i in range(total):
        j = (i + 1) % total
        corners = list(dict.fromkeys([bottom[i], bottom[j], top[j], top[i]]))
        if len(corners) > 2:
            faces.append(np.array(corners))
            names.append(WALL)
    vertices = np.vstack([[0.0, 0.0, prism.thickness], upper, lower])
    sagitta = radius * (1 - np.cos(max(np.diff(np.append(np.sort(azimuths), min(azimuths) + 2 * np.pi))) / 2))
    return _solid(prism, vertices, faces, names, float(sagitta))


def _pyramid_solid(prism):
    """Apex and a polygonal base, whose corners are where the edges meet the flat face."""
    seams = seam_directions(prism)
    if not (seams[:, 2] < -1e-9).all():
        raise OpticError("the facets never close around the flat face: give the prism a radius")
    base = seams * (prism.thickness / -seams[:, 2:]) + [0.0, 0.0, prism.thickness]
    base[:, 2] = 0.0
    count = prism.facets
    faces = [np.arange(count, 0, -1)]
    faces += [np.array([0, 1 + (k - 1) % count, 1 + k]) for k in range(count)]
    names = [FLAT, *(f"facet {k}" for k in range(count))]
    return _solid(prism, np.vstack([[0.0, 0.0, prism.thickness], base]), faces, names, 0.0)


def _strip_solid(prism, width):
    """A biprism of this width along its ridge, between two upright walls."""
    if width is None:
        raise OpticError(
            "a biprism without a radius is endless along its ridge: give the width (mm) that it is cut to, or a radius"
        )
    if not 0 < width < np.inf:
        raise OpticError(f"the width along the ridge must be a positive number of mm, got {width}")
    normals = facet_planes(prism)[0]
    seams = seam_directions(prism)
    middle = np.deg2rad(prism.azimuth_deg) + np.pi / 2
    along = np.array([np.cos(middle), np.sin(middle)])
    slopes = normals[:, :2] / normals[:, 2:]
    vertices = []
    for side, seam in zip((1, -1), seams, strict=True):  # the wall ahead, then the wall behind
        reach = side * width / 2
        vertices.append([0.0, 0.0, prism.thickness] + seam * (reach / (seam[:2] @ along)))
        for slope in slopes:  # where the facet, the wall and the flat face meet
            vertices.append([*np.linalg.solve([slope, along], [prism.thickness, reach]), 0.0])
    vertices = np.array(vertices)
    if not (vertices[[0, 3], 2] > 0).all():
        raise OpticError(f"the ridge runs into the flat face within a width of {width:g} mm: make the width smaller")
    faces = [np.array(face) for face in ([4, 5, 2, 1], [0, 3, 4, 1], [3, 0, 2, 5], [0, 1, 2], [3, 5, 4])]
    return _solid(prism, vertices, faces, [FLAT, "facet 0", "facet 1", WALL, WALL], 0.0)


def _solid(prism, vertices, faces, names, tolerance):
    used = np.unique(np.concatenate(faces))
    place = np.full(len(vertices), -1)
    place[used] = np.arange(len(used))
    return PrismSolid(prism, vertices[used], tuple(place[face] for face in faces), tuple(names), tolerance)
