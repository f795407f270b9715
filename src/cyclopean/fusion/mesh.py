"""One surface of triangles from the depth maps of all views."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from ..errors import SetupError
from ..matching import DepthMap
from ..rigs import Rig
from . import kernels
from .continuity import connected
from .merging import CORRELATION, DEVIATIONS, TOLERANCE_PX, Merged, merge

_FLATTEST_DEG = 85.0  # between normal and ray: no texture shows on a surface seen more flatly, it was smeared
# Corners of the triangles of each kind of cell, in the order right and down of a camera: outside faces it
# only in the order a c b. Nodes a b are the upper row, c d the lower one; both of a cell are cut along a d or b c.
_CORNERS: dict[int, tuple[tuple[int, int, int], ...]] = {
    kernels.ABC: ((0, 2, 1),),
    kernels.BDC: ((1, 2, 3),),
    kernels.ABD: ((0, 3, 1),),
    kernels.ADC: ((0, 2, 3),),
}


@dataclass(frozen=True, eq=False)
class Mesh:
    """A surface of triangles, open where nothing was seen."""

    vertices: np.ndarray  # (N, 3) mm, rig frame
    faces: np.ndarray  # (M, 3) int, rows of vertices, counter-clockwise as seen from the camera
    view: np.ndarray  # (N,) int8, the view that each vertex comes from
    pixels: np.ndarray  # (N, 2) int, its pixel

    @property
    def area(self) -> float:
        """Of the whole surface, mm^2."""
        a, b, c = np.moveaxis(self.vertices[self.faces], 1, 0)
        return float(np.linalg.norm(np.cross(b - a, c - a), axis=-1).sum() / 2)


@dataclass(frozen=True, eq=False)
class _Lattice:
    """Every so many pixels of a merged map, and the triangles between them."""

    origin: np.ndarray  # (2,) px of the first node
    depth: np.ndarray  # (h, w) 1/mm; NaN unknown
    limit: np.ndarray  # (h, w) 1/mm, by which maps of one surface may differ
    cells: np.ndarray  # (h-1, w-1) uint8, which triangles there are
    vertex: np.ndarray  # (h, w) int, the row of each node in all vertices; that of a node of an earlier view; -1


def build_mesh(
    rig: Rig,
    maps: Sequence[DepthMap],
    *,
    stride: int = 1,
    tolerance_px: float = TOLERANCE_PX,
    correlation: float = CORRELATION,
    smallest: int = 20,
) -> Mesh:
    """One surface of triangles from the depth maps of all views, with no surface twice.

    The maps are merged as `fuse` does. The pixels of each view are connected to triangles wherever they lie on one
    continuous surface (`connected`), never across a step; triangles seen edge on, at over 85 degrees, are left out.
    Where an earlier view's triangles show the same surface, a view adds none. At the seam its triangles are tied to
    the nearest vertices of the earlier view: they overlap by less than a cell there, and small gaps may stay where
    the two samplings differ. No two triangles pass along an edge in the same direction, so all of them face the same
    way as their neighbours: of two that would, the later view's is left out.

    Parameters
    ----------
    rig : Rig
        The views.
    maps : sequence of DepthMap
        One for each view, cross-checked or not.
    stride : int
        Only every so many pixels, in both directions, become vertices, each at the depth of a plane through the
        connected pixels up to as far around it.
    tolerance_px, correlation : float
        See `fuse`.
    smallest : int
        Pieces of fewer triangles, connected by their edges, are left out.

    Raises
    ------
    ShapeError, OpticError, SetupError
        When there is not one map a view, or only one view, or an option is out of range.
    """
    if stride != int(stride) or stride < 1:
        raise SetupError(f"the stride of a mesh is a whole number of pixels, 1 or more, got {stride}")
    if not smallest >= 0:
        raise SetupError(f"the smallest piece of a mesh has 0 triangles or more, got {smallest}")
    merged = merge(rig, maps, tolerance_px, correlation)
    lattices: list[_Lattice] = []
    vertices, faces, views, pixels = [], [], [], []
    count = 0
    for k, one in enumerate(merged):
        lattice, points, own = _lattice(rig, k, one, int(stride), lattices, count)
        lattices.append(lattice)
        vertices.append(points)
        pixels.append(own)
        views.append(np.full(len(points), k, np.int8))
        faces.append(_faces(lattice, count, rig[k].mirrored))
        count += len(points)
    columns = (np.concatenate(parts) for parts in (vertices, faces, views, pixels))
    return _tidy(rig, Mesh(*columns), smallest)


def _lattice(rig, k, merged, stride, earlier, first):
    """The lattice of view k, the points (N, 3) that it adds, numbered from `first` on, and their pixels (N, 2)."""
    every = (slice(None, None, stride),) * 2
    edges = connected(merged.inverse_depth, merged.sigma, merged.motion)
    cells = _cells(merged, edges, stride)
    limit = merged.slack[every] + DEVIATIONS * np.sqrt(2) * merged.sigma[every]
    depth = _levelled(merged, edges, stride)
    rows, columns = np.nonzero(np.isfinite(depth))
    pixels = stride * np.stack([columns, rows], -1) + merged.origin
    points = rig[k].unbounded().rays(pixels).at_depth(1 / depth[rows, columns])
    owner = np.full(len(points), -1)
    for j, lattice in enumerate(earlier):
        places = (rig[j].unbounded().project(points) - lattice.origin) / stride
        nearest = np.empty(len(points), int)
        kernels.cover(
            places, depth[rows, columns], limit[rows, columns].astype(float), lattice.depth, lattice.cells, nearest
        )
        covered = (nearest >= 0) & (owner < 0)
        owner[covered] = lattice.vertex.ravel()[nearest[covered]]
    new = owner < 0
    owner[new] = first + np.arange(new.sum())
    vertex = np.full(depth.shape, -1)
    vertex[rows, columns] = owner
    return _Lattice(np.array(merged.origin), depth, limit, cells, vertex), points[new], pixels[new]


def _levelled(merged: Merged, edges, stride):
    """Inverse depth (h, w) at every `stride` pixels: of planes through the pixels between, NaN where unknown."""
    depth = merged.inverse_depth[::stride, ::stride].astype(float)
    rows, columns = np.nonzero(np.isfinite(depth))
    fitted = np.empty((len(rows), 3))
    kernels.planes(stride * rows, stride * columns, merged.inverse_depth, merged.sigma, *edges, stride, fitted)
    depth[rows, columns] = np.where(np.isfinite(fitted[:, 0]), fitted[:, 0], depth[rows, columns])
    return depth


def _cells(merged, edges, stride):
    """Which triangles (h-1, w-1) uint8 there are between every `stride` pixels of a map."""
    every = (slice(None, None, stride),) * 2
    depth, sigma, motion = (grid[every] for grid in (merged.inverse_depth, merged.sigma, merged.motion))
    right, down = connected(depth, sigma, motion, stride)
    top, bottom, left, lower = right[:-1, :-1], right[1:, :-1], down[:-1, :-1], down[:-1, 1:]
    cells = np.select(
        [top & bottom & left & lower, top & left, bottom & lower, top & lower, bottom & left],
        [kernels.BOTH, kernels.ABC, kernels.BDC, kernels.ABD, kernels.ADC],
        kernels.NONE,
    ).astype(np.uint8)
    if stride > 1:
        cells[_torn(merged, edges, stride)[: cells.shape[0], : cells.shape[1]]] = kernels.NONE
    return cells


def _torn(merged, edges, stride):
    """True where a cell of `stride` pixels has an edge of the surface inside it, fine as it may be."""
    known = merged.views > 0
    right, down = edges
    torn = np.zeros(known.shape, bool)
    torn[:, :-1] |= known[:, :-1] & known[:, 1:] & ~right[:, :-1]
    torn[:-1] |= known[:-1] & known[1:] & ~down[:-1]
    height, width = known.shape
    padded = np.pad(torn, ((0, -height % stride), (0, -width % stride)))
    blocks = padded.reshape(padded.shape[0] // stride, stride, padded.shape[1] // stride, stride)
    return blocks.any((1, 3))


def _faces(lattice, first, mirrored):
    """Triangles (M, 3) of a lattice that have a vertex of its own, numbered from `first` on."""
    cells, depth = lattice.cells, lattice.depth
    nodes = [lattice.vertex[r : r + cells.shape[0], c : c + cells.shape[1]] for r in (0, 1) for c in (0, 1)]
    a, b, c, d = (depth[r : r + cells.shape[0], s : s + cells.shape[1]] for r in (0, 1) for s in (0, 1))
    rising = np.abs(a - d) <= np.abs(b - c)  # cut along the edge over which depth changes less
    both = cells == kernels.BOTH
    cuts = [(both & rising, _CORNERS[kernels.ABD] + _CORNERS[kernels.ADC])]
    cuts += [(both & ~rising, _CORNERS[kernels.ABC] + _CORNERS[kernels.BDC])]
    cuts += [(cells == kind, corners) for kind, corners in _CORNERS.items()]
    faces = np.concatenate([
        np.stack([nodes[corner][where] for corner in corners], -1) for where, triangles in cuts for corners in triangles
    ])  # fmt: skip
    faces = faces[(faces >= first).any(-1)]
    return faces[:, ::-1] if mirrored else faces


def _tidy(rig, mesh, smallest):
    """A mesh without triangles seen edge on, or drawn to a line or doubled at a seam, scraps and unused vertices."""
    faces = mesh.faces
    several = (faces[:, 0] != faces[:, 1]) & (faces[:, 1] != faces[:, 2]) & (faces[:, 2] != faces[:, 0])
    faces = faces[several]
    faces = faces[~_edge_on(rig, mesh, faces)]
    _, unique = np.unique(np.sort(faces, axis=1), axis=0, return_index=True)
    faces = _one_sided(faces[np.sort(unique)])
    pieces = _pieces(faces)
    faces = faces[np.bincount(pieces, minlength=1)[pieces] >= smallest]
    used = np.unique(faces)
    number = np.full(len(mesh.vertices), -1)
    number[used] = np.arange(len(used))
    return Mesh(mesh.vertices[used], number[faces], mesh.view[used], mesh.pixels[used])


def _sides(faces):
    """Numbers (M, 3) of the sides of triangles, one for each pair of corners in their order; those of the way back."""
    ends, count = np.roll(faces, -1, axis=1), faces.max(initial=0) + 1
    return faces * count + ends, ends * count + faces


def _one_sided(faces):
    """Triangles (M, 3) of which no two pass along an edge in the same direction; the first of each such two stays."""
    while True:
        sides = _sides(faces)[0].ravel()
        _, first, edge = np.unique(sides, return_index=True, return_inverse=True)
        late = (first[edge] != np.arange(len(sides))).reshape(-1, 3)
        if not late.any():
            return faces
        # only those go that meet a triangle which stays; where that one goes itself, its edge is free again
        blocked = ~late.any(1)[first[edge] // 3].reshape(-1, 3) & late
        faces = faces[~blocked.any(1)]


def _pieces(faces):
    """The piece (M,) that each triangle belongs to, counted from 0; triangles that share an edge are of one piece."""
    ahead, back = _sides(faces)
    _, edge = np.unique(np.minimum(ahead, back), return_inverse=True)
    ends = np.repeat(np.arange(len(faces)), 3), len(faces) + edge.ravel()  # from each triangle to its edges
    count = len(faces) + edge.max(initial=-1) + 1
    links = coo_array((np.ones(edge.size), ends), (count, count))
    return connected_components(links, directed=False)[1][: len(faces)]


def _edge_on(rig, mesh, faces):
    """True (M,) for triangles that show the view that made them their edge, or, folded at a seam, their back."""
    views = mesh.view[faces]
    newest = views.argmax(1)
    corner = faces[np.arange(len(faces)), newest]
    maker = views[np.arange(len(faces)), newest]
    facing = np.empty(len(faces))
    for k, view in enumerate(rig):
        mine = np.flatnonzero(maker == k)
        directions = view.unbounded().rays(mesh.pixels[corner[mine]]).directions
        a, b, c = np.moveaxis(mesh.vertices[faces[mine]], 1, 0)
        normals = np.cross(b - a, c - a)
        facing[mine] = -(normals * directions).sum(-1) / np.linalg.norm(normals, axis=-1)
    return ~(facing > np.cos(np.deg2rad(_FLATTEST_DEG)))
