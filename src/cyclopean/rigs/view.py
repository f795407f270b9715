"""A view: pixels of one sub-image into rays, points into pixels. The contract that everything else builds on."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike

from ..cameras import Camera
from ..errors import OpticError
from ..geometry import Rays, as_pixels, as_points, launch, nearest_point
from ..optics import Path, Reason
from .derivatives import PixelDerivatives, RayDerivatives, pixel_derivatives, ray_derivatives
from .regions import Region, pixel_grid

DEFAULT_MARGIN = 1.5  # px: a pixel on the seam mixes both sides, and so does the blur of a sharp lens


class ViewLike(Protocol):
    """What every step asks of a view."""

    @property
    def name(self) -> str:
        """What to call it."""
        ...

    @property
    def shot(self) -> int:
        """Which exposure it belongs to, for optics that move."""
        ...

    @property
    def channel(self) -> int | None:
        """Which colour channel it belongs to; None: all."""
        ...

    @property
    def mirrored(self) -> bool:
        """True when an odd number of mirrors flips the picture."""
        ...

    @property
    def margin(self) -> float:
        """Pixels left out beside seams."""
        ...

    @property
    def camera(self) -> Camera:
        """The camera whose photograph the pixels belong to; its lens is the view's own where it has one."""
        ...

    @property
    def region(self) -> Region:
        """Which pixels belong to the view."""
        ...

    def rays(self, pixels: ArrayLike) -> Rays:
        """Pixels (..., 2) -> rays (...,), NaN where a pixel does not belong to the view."""
        ...

    def project(self, points: ArrayLike) -> np.ndarray:
        """Points (..., 3) mm -> pixels (..., 2), NaN where the view does not see a point."""
        ...

    def pixel_derivatives(self, points: ArrayLike) -> PixelDerivatives:
        """Pixels of points (..., 3) with their derivatives."""
        ...

    def unbounded(self) -> ViewLike:
        """The same view without borders."""
        ...

    def explain_pixels(self, pixels: ArrayLike) -> np.ndarray:
        """The `Reason` (...,) why a pixel has no ray; 0 where it has one."""
        ...

    def explain_points(self, points: ArrayLike) -> np.ndarray:
        """The `Reason` (...,) why a point has no pixel; 0 where it has one."""
        ...


@dataclass(frozen=True, eq=False)
class View:
    """What the camera sees along one path through the optic."""

    camera: Camera
    path: Path
    margin: float = DEFAULT_MARGIN  # px left out beside seams
    name: str = ""
    shot: int = 0  # which exposure, for optics that move
    channel: int | None = None  # which colour channel; None: all
    clip: bool = field(default=True, repr=False)  # False only in what `unbounded` and `continued` return
    backwards: bool = field(default=False, repr=False)  # True only in what `continued` returns

    @property
    def mirrored(self) -> bool:
        """True when an odd number of mirrors flips the picture."""
        return self.path.mirrored

    def rays(self, pixels: ArrayLike) -> Rays:
        """Rays in the scene that belong to pixels.

        Parameters
        ----------
        pixels : (..., 2) array
            Pixels (x, y) of the photograph.

        Returns
        -------
        Rays
            (...,) rays that start on the optic's last surface, in the rig frame; NaN where a pixel does not
            look through this facet, or its ray is totally reflected (`explain_pixels` says which).
        """
        from . import kernels

        pixels = as_pixels(pixels)
        origins, directions = np.empty((*pixels.shape[:-1], 3)), np.empty((*pixels.shape[:-1], 3))
        flat = np.ascontiguousarray(pixels).reshape(-1, 2)
        out = origins.reshape(-1, 3), directions.reshape(-1, 3)
        launch(kernels.trace_pixels, len(flat), flat, *self._optics, *out)
        if self.path.blockers:
            blocked = self.path.obstructed(self.camera.rays(pixels))
            origins[blocked] = directions[blocked] = np.nan
        return Rays(origins, directions)

    def project(self, points: ArrayLike) -> np.ndarray:
        """Pixels at which points are seen.

        Parameters
        ----------
        points : (..., 3) array
            Points in the rig frame, mm.

        Returns
        -------
        (..., 2) array
            Pixels (x, y); NaN where this view does not see the point (`explain_points` says why): it never
            returns a pixel whose ray does not pass through the point.

        Notes
        -----
        Newton in two variables with analytic derivatives, started from a virtual camera. For refracting planes
        the path is the one of least time, so the solution is unique.
        """
        from . import kernels

        points = as_points(points)
        out = np.empty((*points.shape[:-1], 2))
        flat = np.ascontiguousarray(points).reshape(-1, 3)
        launch(
            kernels.project_points,
            len(flat),
            flat,
            *self._aim,
            *self._optics[:2],
            self._limits,
            *self._optics[2:],
            out.reshape(-1, 2),
        )
        if self.path.blockers:
            out[self.path.obstructed(self.camera.rays(out))] = np.nan
        return out

    def ray_derivatives(self, pixels: ArrayLike) -> RayDerivatives:
        """Rays of pixels (..., 2) with their derivatives to pixel, camera and optic."""
        return ray_derivatives(self.camera, self.path, as_pixels(pixels), self.rays(pixels))

    def pixel_derivatives(self, points: ArrayLike) -> PixelDerivatives:
        """Pixels of points (..., 3) with their derivatives to point, camera and optic."""
        points = as_points(points)
        return pixel_derivatives(self.camera, self.path, points, self.project(points))

    def unbounded(self) -> View:
        """The same view with surfaces that have no end and an image without border: smooth across seams."""
        return self._unbounded

    @cached_property
    def _unbounded(self) -> View:
        view = replace(self, path=self.path.unbounded(), clip=False)
        view.__dict__["_aim"] = self._aim  # it sees what this view sees, and more
        return view

    def with_region(self, region: Region) -> View:
        """The same view that gives these pixels as its own; rays and projections stay what they are."""
        view = replace(self)
        view.__dict__.update({name: self.__dict__[name] for name in ("_aim", "_unbounded") if name in self.__dict__})
        view.__dict__["region"] = region
        return view

    def continued(self, camera: Camera, path: Path) -> View:
        """A view along a similar path, for solvers: it projects smoothly even where no real light would go.

        Surfaces have no end, and light may run backwards from one to the next, as it does in a prism whose
        facets have moved through its flat face. Projections start from this view's, so nothing is traced now.
        """
        view = replace(self, camera=camera, path=path.unbounded(), clip=False, backwards=True)
        view.__dict__["_aim"] = self._aim
        return view

    def explain_pixels(self, pixels: ArrayLike) -> np.ndarray:
        """The `Reason` (integer array (...,)) why each pixel (..., 2) has no ray in this view; 0 where it has one."""
        pixels = as_pixels(pixels)
        rays = self.camera.rays(pixels)
        reasons = self.path.explain(rays)
        if self.path.blockers:
            reasons[(reasons == Reason.SEEN) & self.path.obstructed(rays)] = Reason.BLOCKED
        return reasons

    def explain_points(self, points: ArrayLike) -> np.ndarray:
        """The `Reason` (integer array (...,)) why each point (..., 3) has no pixel in this view; 0 where it has one."""
        points = as_points(points)
        pixels = self.unbounded().project(points)
        unsolved = np.where(self._behind(points), int(Reason.BEHIND), int(Reason.NO_SOLUTION))
        reasons = np.where(np.isfinite(pixels).all(-1), self.explain_pixels(pixels), unsolved)
        inside = self.camera.contains(pixels)
        reasons = np.where((reasons == Reason.SEEN) & ~inside, int(Reason.OUTSIDE_IMAGE), reasons)
        return np.where(np.isfinite(points).all(-1), reasons, int(Reason.NOT_A_NUMBER))

    @cached_property
    def region(self) -> Region:
        """The pixels of this view, found by tracing the ray of every pixel."""
        from . import kernels

        grid = pixel_grid(self.camera.size)
        clearance = np.empty(grid.shape[:2])
        launch(kernels.pixel_clearance, clearance.size, grid.reshape(-1, 2), *self._optics, clearance.reshape(-1))
        if self.path.blockers:
            clearance[self.path.obstructed(self.camera.rays(grid))] = -1.0
        return Region(clearance >= 0, self.margin, clearance)

    @cached_property
    def _optics(self):
        return (self.camera.lens, self.camera.fold_radius, self.path.index_start, *self.path.packed)

    @cached_property
    def _limits(self) -> np.ndarray:
        width, height = self.camera.size
        borders = [-0.5, width - 0.5, -0.5, height - 0.5] if self.clip else [-np.inf, np.inf] * 2
        return np.array([*borders, -np.inf if self.backwards else 0.0])

    @cached_property
    def _aim(self) -> tuple[np.ndarray, np.ndarray]:
        """What projection starts from: a rough virtual camera (7, 3) and seeds (M, 2), see rigs/kernels.py."""
        width, height = self.camera.size
        pixels = np.stack(np.meshgrid(np.linspace(0, width - 1, 33), np.linspace(0, height - 1, 33)), -1).reshape(-1, 2)
        good = np.isfinite(self.rays(pixels).directions).all(-1)
        inside = pixels[good]
        if len(inside) < 6:  # a small view may lie between the samples
            every = np.argwhere(self.region.traced)[:, ::-1].astype(float)
            inside = every[:: max(len(every) // 1000, 1)]
        if len(inside) < 6:
            raise OpticError(
                f"no light reaches the camera through {self.name or 'this view'}; rays of the image are lost: "
                f"{_tally(self.explain_pixels(pixels[::7]))}"
            )
        rays, coordinates = self.rays(inside), self.camera.normalise(inside)
        return _rough_camera(rays, coordinates), _seeds(coordinates)

    def _behind(self, points):
        """True (...,) where points do not lie in front of the last surface, or of the camera if there is none."""
        if not self.path.interfaces:
            return points[..., 2] <= 0
        last, axis = self.path.interfaces[-1], self._aim[0][3]
        return (points @ last.normal - last.offset) * (axis @ last.normal) <= 0


def _tally(reasons):
    values, counts = np.unique(reasons, return_counts=True)
    return ", ".join(f"{Reason(v).text} ({100 * c / counts.sum():.0f} %)" for v, c in zip(values, counts, strict=True))


def _seeds(coordinates):
    """64 normalised coordinates (64, 2), a full block, spread over the box of the view's own (N, 2)."""
    (left, top), (right, bottom) = coordinates.min(0), coordinates.max(0)
    grid = np.meshgrid(np.linspace(left, right, 8), np.linspace(top, bottom, 8))
    return np.stack(grid, -1).reshape(-1, 2)


def _rough_camera(rays, coordinates):
    """Centre, axes and homography (7, 3) of the pinhole that roughly stands for rays with these coordinates."""
    axis = rays.directions.mean(0)
    axis /= np.linalg.norm(axis)
    centre = nearest_point(rays).points
    if not np.isfinite(centre).all():
        centre = rays.origins.mean(0)
    side = np.cross(axis, np.eye(3)[np.argmin(np.abs(axis))])
    side /= np.linalg.norm(side)
    frame = np.array([side, np.cross(axis, side), axis])
    scale = max(np.linalg.norm(rays.origins - centre, axis=-1).max(), 1.0)
    local = (rays.at(np.full(rays.shape, 20 * scale)) - centre) @ frame.T
    (x, y), (a, b, c) = coordinates.T, local.T
    # h @ (a, b, c) ~ (x, y, 1): two linear equations a sample, solved with h[2, 2] = 1
    zero = np.zeros_like(a)
    rows = np.concatenate([
        np.stack([a, b, c, zero, zero, zero, -x * a, -x * b], -1),
        np.stack([zero, zero, zero, a, b, c, -y * a, -y * b], -1),
    ])  # fmt: skip
    h = np.linalg.lstsq(rows, np.concatenate([x * c, y * c]), rcond=None)[0]
    return np.vstack([centre, frame, np.append(h, 1.0).reshape(3, 3)])
