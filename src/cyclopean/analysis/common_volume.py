"""The space that k or more of n views see, by tracing the borders of every sub-image: for any optic."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ..errors import OpticError, SetupError
from ..geometry import Rays
from ..rigs import Rig
from .borders import border_rays

_SAMPLES = 400  # border rays of a view
_EMPTY = 1e-9  # of the smallest view's area: less is nothing
_NOTHING = 1e-11  # of the square of the depth: fields that overlap by less do not
_BLOCK = 200_000  # pairs of a point and an edge looked at in one go
_FARTHEST = 1e4  # times the depth at which light leaves the optic: where the search for a far limit ends


@dataclass(frozen=True, eq=False)
class CommonSection:
    """What at least `views` views see of the plane at one depth."""

    depth: float  # mm
    views: int  # at least so many see it
    polygons: tuple[np.ndarray, ...]  # (N, 2) mm each, counter-clockwise around what is seen, clockwise around holes
    area: float  # mm^2

    @property
    def width(self) -> float:
        """Extent along x, mm."""
        return float(np.ptp(np.concatenate(self.polygons)[:, 0])) if self.polygons else 0.0

    @property
    def height(self) -> float:
        """Extent along y, mm."""
        return float(np.ptp(np.concatenate(self.polygons)[:, 1])) if self.polygons else 0.0

    def extent(self, towards: ArrayLike) -> tuple[float, float]:
        """From where to where the section reaches along the line through the optical axis towards (2,), mm.

        NaN where it does not cross the line; gaps between the two ends are not told.
        """
        towards = np.asarray(towards, dtype=float) / np.linalg.norm(towards)
        places = [np.nan]
        for polygon in self.polygons:
            along, across = polygon @ towards, polygon @ [-towards[1], towards[0]]
            next_along, next_across = np.roll(along, -1), np.roll(across, -1)
            crossed = (across > 0) != (next_across > 0)
            share = across[crossed] / (across - next_across)[crossed]
            places.extend(along[crossed] + share * (next_along - along)[crossed])
        return (float(np.nanmin(places)), float(np.nanmax(places))) if len(places) > 1 else (np.nan, np.nan)

    @cached_property
    def inscribed_circle(self) -> tuple[np.ndarray, float]:
        """Centre (2,) and radius, mm, of the largest circle that fits in; NaN and 0 where nothing is seen.

        By search on ever finer grids around the best places, to 1e-4 of the extent.
        """
        if not self.polygons:
            return np.full(2, np.nan), 0.0
        corners = np.concatenate(self.polygons)
        low, high = corners.min(0), corners.max(0)
        best, span, fineness = ((low + high) / 2)[None], (high - low) / 2, 17
        for _ in range(10):
            steps = np.stack(np.meshgrid(*[np.linspace(-1, 1, fineness)] * 2), -1).reshape(-1, 2) * span
            tried = (best[:, None] + steps).reshape(-1, 2)
            inside = self.clearance(tried)
            best, span, fineness = tried[np.argsort(inside)[-4:]], span / 3, 7
        return best[-1], max(float(inside.max()), 0.0)

    def clearance(self, points: ArrayLike) -> np.ndarray:
        """Distance (M,) of points (M, 2) mm to the border, mm: negative outside, minus infinity if nothing is seen."""
        points = np.asarray(points, dtype=float)
        if not self.polygons:
            return np.full(len(points), -np.inf)
        starts = np.concatenate(self.polygons)
        ends = np.concatenate([np.roll(polygon, -1, axis=0) for polygon in self.polygons])
        block = max(_BLOCK // len(starts), 1)
        parts = [points[k : k + block] for k in range(0, len(points), block)]
        return np.concatenate([_clearance(part, starts, ends) for part in parts]) if parts else np.zeros(0)


@dataclass(frozen=True, eq=False)
class CommonVolume:
    """The solid that at least `views` views see between two depths, as a closed surface of triangles."""

    views: int  # at least so many see it
    depths: tuple[float, float]  # mm
    vertices: np.ndarray  # (N, 3) mm in the rig frame
    faces: np.ndarray  # (M, 3) rows of vertices, counter-clockwise from outside; none where nothing is seen
    volume: float  # mm^3


@dataclass(frozen=True, eq=False)
class CommonField:
    """The fields of n views, each bounded by the rays along the border of its sub-image.

    Exact at the sampled rays; between two of them the border is taken as straight, an error that falls with the square
    of their number.
    """

    borders: tuple[tuple[Rays, ...], ...]  # of each view, (N,) rays along each closed border
    names: tuple[str, ...]  # of the views

    @classmethod
    def of(cls, rig: Rig, samples: int = _SAMPLES) -> CommonField:
        """Trace about `samples` rays along the border of each view of a rig, of any kind."""
        if not samples >= 8:
            raise SetupError(f"at least 8 samples along the border of a view are wanted, got {samples}")
        return cls(tuple(tuple(border_rays(view, samples)) for view in rig), tuple(view.name for view in rig))

    @property
    def start(self) -> float:
        """z (mm) behind which all border rays have left the optic."""
        return max(float(max(rays.origins[:, 2].max() for loops in self.borders for rays in loops)), 0.0)

    def sections(self, depth: float) -> tuple[CommonSection, ...]:
        """What at least 1, 2, ... n views see of the plane at a depth (mm).

        Raises
        ------
        OpticError
            When a view looks so far aside that border rays never reach the plane, or the plane cuts the optic.
        """
        fields = [_cross_section(loops, depth, name) for loops, name in zip(self.borders, self.names, strict=True)]
        smallest = min(field.area() for field in fields)
        sections = []
        for number, section in enumerate(_at_least(fields), start=1):
            polygons = [np.asarray(polygon) for polygon in section.to_polygons()] if section.area() > 0 else []
            polygons = [polygon for polygon in polygons if abs(_signed_area(polygon)) > _EMPTY * smallest]
            area = float(section.area()) if polygons else 0.0
            sections.append(CommonSection(float(depth), number, tuple(polygons), area))
        return tuple(sections)

    def volumes(self, depths: tuple[float, float]) -> tuple[CommonVolume, ...]:
        """The solids that at least 1, 2, ... n views see between two depths (near, far) mm.

        Ruled surfaces, united and intersected by manifold3d, so that each result is closed.
        """
        near, far = depths
        if not 0 < near < far < np.inf:
            raise SetupError(f"a depth range is (near, far) with 0 < near < far in mm, got {depths}")
        solids = [_solid(loops, near, far, name) for loops, name in zip(self.borders, self.names, strict=True)]
        volumes = []
        for number, solid in enumerate(_at_least(solids), start=1):
            mesh = solid.to_mesh64()
            vertices = np.array(mesh.vert_properties, dtype=float)[:, :3].reshape(-1, 3)
            faces = np.array(mesh.tri_verts, dtype=np.int64).reshape(-1, 3)
            volumes.append(CommonVolume(number, (near, far), vertices, faces, float(solid.volume())))
        return tuple(volumes)

    def limits(self, views: int | None = None) -> tuple[float, float]:
        """Nearest and farthest depth (mm) of which at least `views` views (all, where not given) see something.

        Far is inf where the fields still overlap at infinite depth, both are NaN where they never do. A field that ends
        and begins again counts from its first beginning to its last end. Nothing is looked for within the optic: where
        the fields overlap there, near is the depth at which the last ray leaves it.
        """
        number = checked_views(len(self.borders), views)

        def seen(depth):
            fields = [_cross_section(loops, depth, name) for loops, name in zip(self.borders, self.names, strict=True)]
            scale = 1.0 if np.isinf(depth) else depth
            return _at_least(fields)[number - 1].area() > _NOTHING * scale**2

        start = max(self.start, 1e-6)
        steps = max(start, 1.0) * np.geomspace(1e-4, _FARTHEST, 160)
        depths = np.concatenate([[start * (1 + 1e-9)], start + steps, [np.inf]])
        found = np.array([seen(depth) for depth in depths])
        if not found.any():
            return np.nan, np.nan
        first, last = int(np.argmax(found)), len(found) - 1 - int(np.argmax(found[::-1]))
        near = start if first == 0 else _bisect(seen, depths[first], depths[first - 1])
        if last == len(found) - 1:
            return float(near), np.inf
        return float(near), float(_bisect(seen, depths[last], min(depths[last + 1], 1e3 * depths[last])))


def common_volume(
    rig: Rig, depths: tuple[float, float], views: int | None = None, samples: int = _SAMPLES
) -> CommonVolume:
    """The solid that at least `views` views (all, where not given) of a rig see between two depths (near, far) mm.

    `CommonField.of(rig).volumes(depths)` gives those of all numbers of views for the same work.
    """
    number = checked_views(len(rig), views)
    return CommonField.of(rig, samples).volumes(depths)[number - 1]


def checked_views(count: int, views: int | None) -> int:
    """A number of views that a rig of `count` has; all of them for None."""
    if views is None:
        return count
    if not 1 <= views <= count or views != int(views):
        raise SetupError(f"views must lie between 1 and {count}, the number of views of the rig, got {views}")
    return int(views)


def _places(loops, depth, name):
    """Where border rays meet a plane, (N, 2) mm for each loop; their slopes dx/dz, dy/dz at infinite depth."""
    if not depth > 0:
        raise SetupError(f"a depth is a positive number of mm, got {depth}")
    places = []
    for rays in loops:
        aside = rays.directions[:, 2] <= 0
        if aside.any():
            raise OpticError(
                f"{name} looks past 90 degrees: {100 * aside.mean():.0f} % of its border rays never come to a plane of "
                "constant depth, so its field has no sections; narrow the picture or turn the optic"
            )
        if np.isinf(depth):
            places.append(rays.directions[:, :2] / rays.directions[:, 2:])
            continue
        if (rays.origins[:, 2] > depth).any():
            raise OpticError(
                f"depth {depth:g} mm lies within the optic: light of {name} leaves it at up to "
                f"{rays.origins[:, 2].max():.4g} mm; ask for farther depths"
            )
        places.append(rays.at_depth(depth)[:, :2])
    return places


def _clearance(points, starts, ends):
    """Distance (M,) of points (M, 2) to edges (N, 2) of polygons, negative where they lie outside."""
    along = ends - starts
    arm = points[:, None] - starts
    share = np.clip((arm * along).sum(-1) / np.maximum((along**2).sum(-1), 1e-300), 0, 1)
    distance = np.sqrt(((arm - share[..., None] * along) ** 2).sum(-1).min(-1))
    (x, y), (x0, y0), (x1, y1) = points.T[..., None], starts.T, ends.T
    crosses = (y0 > y) != (y1 > y)
    with np.errstate(divide="ignore", invalid="ignore"):
        crossings = crosses & (x < x0 + (y - y0) / (y1 - y0) * (x1 - x0))
    return np.where(crossings.sum(-1) % 2 == 1, distance, -distance)


def _cross_section(loops, depth, name) -> Any:
    """A view's field in a plane, as a manifold3d CrossSection."""
    from manifold3d import CrossSection, FillRule

    return CrossSection(_oriented(_places(loops, depth, name)), FillRule.EvenOdd)


def _oriented(polygons):
    """Polygons turned so that the largest, the outline, is counter-clockwise: mirrors turn them round."""
    areas = [_signed_area(polygon) for polygon in polygons]
    turned = areas[int(np.argmax(np.abs(areas)))] < 0
    return [np.ascontiguousarray(polygon[::-1] if turned else polygon) for polygon in polygons]


def _signed_area(polygon):
    x, y = (polygon - polygon.mean(0)).T
    return 0.5 * float(np.dot(x, np.roll(y, -1)) - np.dot(y, np.roll(x, -1)))


def _at_least(shapes: Sequence[Any]) -> list[Any]:
    """What at least 1, 2, ... n of n shapes cover, by adding one shape after the other."""
    counted: list[Any] = []
    for shape in shapes:
        both = [*(covered ^ shape for covered in counted)]
        joined = [covered + (shape if k == 0 else both[k - 1]) for k, covered in enumerate(counted)]
        counted = [*joined, both[-1] if both else shape]
    return counted


def _solid(loops, near, far, name) -> Any:
    """A view's field between two depths, as a manifold3d Manifold."""
    from manifold3d import Manifold, Mesh64

    front, back = _places(loops, near, name), _places(loops, far, name)
    mirrored = _signed_area(max(front, key=lambda polygon: abs(_signed_area(polygon)))) < 0
    if mirrored:
        front, back = [polygon[::-1] for polygon in front], [polygon[::-1] for polygon in back]
    count = sum(map(len, front))
    flat = np.concatenate([*front, *back])
    vertices = np.column_stack([flat, np.repeat([near, far], count)])
    faces = np.concatenate([_cap(front)[:, ::-1], _cap(back) + count, *_walls(front, count)])
    solid = Manifold(Mesh64(vertices, faces.astype(np.uint64)))
    if solid.status().name != "NoError":
        raise OpticError(
            f"the border rays of {name} cross between {near:g} and {far:g} mm: its field is no solid there"
        )
    return solid


def _cap(polygons):
    """Triangles (M, 3) that fill polygons with holes, counter-clockwise."""
    from manifold3d import triangulate

    return np.asarray(triangulate([np.ascontiguousarray(polygon) for polygon in polygons])).reshape(-1, 3)


def _walls(polygons, count):
    """Triangles between each polygon at the near depth and the same rays at the far one, `count` vertices on."""
    start = 0
    for polygon in polygons:
        here = start + np.arange(len(polygon))
        there = np.roll(here, -1)
        yield np.concatenate([
            np.stack([here, there, there + count], -1),
            np.stack([here, there + count, here + count], -1),
        ])  # fmt: skip
        start += len(polygon)


def _bisect(seen, inside, outside):
    """The depth between one where something is seen and one where nothing is."""
    for _ in range(60):
        middle = np.sqrt(inside * outside)
        inside, outside = (middle, outside) if seen(middle) else (inside, middle)
        if abs(inside - outside) < 1e-9 * inside:
            break
    return inside
