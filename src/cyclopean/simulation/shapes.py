"""Shapes made of triangles, each with coordinates for paints; to be placed in a scene."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from ..errors import SetupError, ShapeError
from ..geometry import Pose
from .scene import Paint, Surface

_AROUND = 360  # steps about a sphere or a cylinder: the triangles lie up to 4e-5 radii inside
_CORNERS = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])
_FACES = np.array([[0, 2, 1], [0, 3, 2]])
# Of a box: axes across and down a side, the axis that it looks along, which way, and which ways pictures run along the
# first two. Those on top and below are upright for a viewer to whom that side is tipped.
_SIDES = (
    (0, 1, 2, -1, (1, 1)),
    (0, 1, 2, 1, (-1, 1)),
    (2, 1, 0, -1, (-1, 1)),
    (2, 1, 0, 1, (1, 1)),
    (0, 2, 1, -1, (1, -1)),
    (0, 2, 1, 1, (1, 1)),
)


@dataclass(frozen=True, eq=False)
class Shape:
    """Triangles in the shape's own frame (x right, y down, z away from the viewer), with places for paints.

    Paints through the solid (3 dimensions) take the vertices themselves.
    """

    vertices: np.ndarray  # (N, 3) mm
    faces: np.ndarray  # (T, 3) int
    flat: np.ndarray | None  # (N, 2) mm, on the surface rolled out; None: unknown
    share: np.ndarray | None  # (N, 2), where on a picture that is stretched over the surface once, 0 to 1

    def painted(
        self, paint: Paint, pose: Pose, *, stretched: bool = False, name: str = "", luminous: bool = False
    ) -> Surface:
        """The shape in a scene.

        Parameters
        ----------
        paint : Paint
            With 3 dimensions it goes through the solid.
        pose : Pose
            rig_from_shape, mm.
        stretched : bool
            Whether a paint with 2 dimensions takes `share`, not mm.
        name, luminous
            As a `Surface` has them.

        Raises
        ------
        SetupError
            When the shape has no coordinates for this paint.
        """
        places = self.vertices if paint.dimensions == 3 else self.share if stretched else self.flat
        if places is None:
            raise SetupError("the surface has no coordinates for flat paints: take one that goes through the solid")
        return Surface(pose @ self.vertices, self.faces, paint, places, name, luminous)


def plane(width: float, height: float) -> Shape:
    """A rectangle about the origin; it looks towards -z, the viewer."""
    flat = (_CORNERS - 0.5) * [width, height]
    return Shape(np.concatenate([flat, np.zeros((4, 1))], axis=1), _FACES, flat, _CORNERS)


def box(width: float, height: float, depth: float) -> Shape:
    """A box about the origin; a picture stands on every side, upright for a viewer to whom the side is turned."""
    size = np.array([width, height, depth])
    vertices, flat, shares = [], [], []
    for across, down, out, side, ways in _SIDES:
        share = (_CORNERS - 0.5) * ways + 0.5
        corners = np.zeros((4, 3))
        corners[:, [across, down]] = _CORNERS - 0.5
        corners[:, out] = side / 2
        vertices.append(corners * size)
        shares.append(share)
        flat.append((share - 0.5) * size[[across, down]])
    faces = np.concatenate([_FACES + 4 * k for k in range(6)])
    return Shape(np.concatenate(vertices), faces, np.concatenate(flat), np.concatenate(shares))


def sphere(radius: float) -> Shape:
    """A sphere about the origin; rolled out by longitude and latitude, the middle faces the viewer, the poles +-y."""
    share = _grid_shares(_AROUND, _AROUND // 2)
    longitude, latitude = (share[:, 0] - 0.5) * 2 * np.pi, (share[:, 1] - 0.5) * np.pi
    vertices = radius * np.stack(
        [np.cos(latitude) * np.sin(longitude), np.sin(latitude), -np.cos(latitude) * np.cos(longitude)], axis=1
    )
    flat = (share - 0.5) * [2 * np.pi * radius, np.pi * radius]
    return Shape(vertices, _without_slivers(vertices, _grid_faces(_AROUND, _AROUND // 2)), flat, share)


def cylinder(radius: float, length: float) -> Shape:
    """A cylinder about the y axis with both ends; rolled out, its middle faces the viewer."""
    share = _grid_shares(_AROUND, 1)
    angle = (share[:, 0] - 0.5) * 2 * np.pi
    down = (share[:, 1] - 0.5) * length
    side = np.stack([radius * np.sin(angle), down, -radius * np.cos(angle)], axis=1)
    flat = np.stack([radius * angle, down], axis=1)
    around = np.arange(_AROUND + 1) * 2 * np.pi / _AROUND
    rim = np.concatenate([[[0.0, 0.0]], np.stack([np.sin(around), -np.cos(around)], axis=1)])
    ring = np.arange(1, _AROUND + 1)
    fan = np.stack([np.zeros_like(ring), ring, ring + 1], axis=1)
    vertices, flats, shares, faces = [side], [flat], [share], [_grid_faces(_AROUND, 1)]
    for end in (-0.5, 0.5):
        faces.append(fan[:, :: 1 if end > 0 else -1] + sum(map(len, vertices)))
        vertices.append(np.stack([radius * rim[:, 0], np.full(len(rim), end * length), radius * rim[:, 1]], axis=1))
        seen = rim * [1.0, np.sign(end)]  # from outside, upright for a viewer to whom the end is tipped
        flats.append(radius * seen)
        shares.append((seen + 1) / 2)
    return Shape(*(np.concatenate(part) for part in (vertices, faces, flats, shares)))


def heightmap(heights: ArrayLike, width: float, height: float) -> Shape:
    """A relief: heights (H, W) mm towards the viewer, at even steps over a rectangle about the origin."""
    heights = np.asarray(heights, dtype=float)
    if heights.ndim != 2 or min(heights.shape) < 2 or not np.isfinite(heights).all():
        raise ShapeError(f"heights must be numbers (H, W), 2 or more each way, got shape {heights.shape}")
    rows, columns = heights.shape
    share = _grid_shares(columns - 1, rows - 1)
    flat = (share - 0.5) * [width, height]
    return Shape(np.column_stack([flat, -heights.ravel()]), _grid_faces(columns - 1, rows - 1), flat, share)


def _grid_shares(columns, rows):
    """Corners ((rows + 1) (columns + 1), 2) of the cells of a grid, 0 to 1, row by row."""
    x, y = np.meshgrid(np.linspace(0, 1, columns + 1), np.linspace(0, 1, rows + 1))
    return np.stack([x.ravel(), y.ravel()], axis=1)


def _grid_faces(columns, rows):
    """Two triangles (T, 3) for each cell of a grid."""
    first = (np.arange(rows)[:, None] * (columns + 1) + np.arange(columns)).ravel()
    right, below = first + 1, first + columns + 1
    return np.concatenate([np.stack([first, below + 1, right], 1), np.stack([first, below, below + 1], 1)])


def _without_slivers(vertices, faces):
    """The triangles that have an area: at a sphere's poles half of them have none."""
    a, b, c = np.moveaxis(vertices[faces], 1, 0)
    area = np.linalg.norm(np.cross(b - a, c - a), axis=1)
    return faces[area > 1e-9 * area.max()]
