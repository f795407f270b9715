"""A rig: a few views of one scene, the only thing that downstream steps know."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from ..errors import OpticError, SetupError
from ..geometry import as_points
from .view import ViewLike


@dataclass(frozen=True, eq=False)
class Rig(Sequence):
    """Views in the order of the optic's facets."""

    views: tuple[ViewLike, ...]

    def __post_init__(self):
        if not self.views:
            raise OpticError("a rig needs at least one view")

    def __len__(self) -> int:
        return len(self.views)

    def __getitem__(self, index):
        return Rig(self.views[index]) if isinstance(index, slice) else self.views[index]

    def __iter__(self) -> Iterator[ViewLike]:
        return iter(self.views)

    @property
    def size(self) -> tuple[int, int]:
        """(width, height) of the photograph, px."""
        return self.views[0].camera.size

    @cached_property
    def masks(self) -> np.ndarray:
        """(V, H, W) bool: which pixels belong to each view, margins taken off."""
        for view in self.views:
            if not view.region.mask.any():
                raise OpticError(
                    f"{view.name} has no pixels left: all {view.region.traced.sum()} of them lie within its margin of "
                    f"{view.margin:g} px beside seams; move the optic, or make the margin smaller"
                )
        return np.stack([view.region.mask for view in self.views])

    @property
    def facets(self) -> np.ndarray:
        """(H, W) int: the number of the view that the central ray of each pixel takes; -1 where none does."""
        labels = np.full(self.views[0].region.traced.shape, -1, dtype=np.int8)
        for k, view in enumerate(self.views):
            labels[view.region.traced] = k
        return labels

    def project(self, points: ArrayLike) -> np.ndarray:
        """Pixels (..., V, 2) of points (..., 3) mm in every view; NaN where a view does not see a point."""
        points = as_points(points)
        return np.stack([view.project(points) for view in self.views], axis=-2)

    def unbounded(self) -> Rig:
        """The same views with surfaces that have no end."""
        return Rig(tuple(view.unbounded() for view in self.views))

    @cached_property
    def working_depths(self) -> tuple[float, float]:
        """Depths (near, far) mm between which the rig is of use.

        At least a fifth of the pixels of some view are seen by another one there, and one pixel of
        disparity stands for at most a tenth of the depth.
        """
        start = max(float(np.nanmax(self._sample_rays.origins[..., 2])), 1.0)
        depths = start * np.geomspace(1.02, 300, 240)
        useful = np.array([self._is_useful(depth) for depth in depths])
        if useful[-1] or not useful.any():  # rays that start at the pinhole say nothing about the scale
            depths = np.concatenate([depths, depths[1:] * (depths[-1] / depths[0])])
            useful = np.append(useful, [self._is_useful(depth) for depth in depths[240:]])
        if not useful.any():
            raise OpticError(
                "no depth is seen well by two views: the views do not overlap, or their baseline is too short; "
                "state the depth range yourself if you know better"
            )
        first = int(np.argmax(useful))
        last = first + int(np.argmin(np.append(useful[first:], False))) - 1
        return float(f"{depths[first]:.3g}"), float(f"{depths[last]:.3g}")

    def check_depths(self, depths: ArrayLike) -> tuple[float, float]:
        """A range of depths (near, far) mm as two numbers, or a SetupError that says why it is none.

        The near limit must lie behind the optic's last surface. Beside a mirror there may be a scene, so with mirrors
        it must lie behind where the mirror begins.
        """
        values = np.asarray(depths, dtype=float)
        if values.shape != (2,) or not 0 < values[0] < values[1] < np.inf:
            raise SetupError(f"a depth range is (near, far) with 0 < near < far in mm, got {values.tolist()}")
        near, far = float(values[0]), float(values[1])
        if near <= self._last_surface:
            least = np.ceil(self._last_surface + 0.1)
            raise SetupError(
                f"the near limit {near:g} mm lies inside the optic, whose last surface is at {self._last_surface:.1f} "
                f"mm; use {least:g} mm or more"
            )
        return near, far

    @cached_property
    def _last_surface(self):
        """Depth mm before which no two views see anything: where their rays leave the optic."""
        ends = []
        for k, view in enumerate(self.views):
            path = getattr(view, "path", None)
            mirrors = path is not None and any(interface.act == "reflect" for interface in path.interfaces)
            depths = self._sample_rays[k].origins[:, 2]
            if np.isfinite(depths).any():
                ends.append(float(np.nanmin(depths) if mirrors else np.nanmax(depths)))
        return sorted(ends)[:2][-1] if ends else 0.0

    @cached_property
    def _sample_pixels(self):
        """A few pixels (V, N, 2) of each view, NaN-padded to the same number."""
        samples = []
        for view in self.views:
            x, y, width, height = view.region.box
            if not width:
                raise OpticError(f"{view.name} has no pixels: no light reaches the camera that way")
            grid = np.stack(np.meshgrid(np.linspace(x, x + width - 1, 12), np.linspace(y, y + height - 1, 12)), -1)
            grid = grid.reshape(-1, 2)
            samples.append(np.where(view.region.contains(grid)[:, None], grid, np.nan))
        return np.stack(samples)

    @cached_property
    def _sample_rays(self):
        from ..geometry import Rays

        rays = [view.rays(pixels) for view, pixels in zip(self.views, self._sample_pixels, strict=True)]
        return Rays(np.stack([r.origins for r in rays]), np.stack([r.directions for r in rays]))

    def _is_useful(self, depth):
        step = 0.001
        for k in range(len(self.views)):
            rays = self._sample_rays[k]
            points, behind = rays.at_depth(depth), rays.at_depth(depth * (1 + step))
            total = np.count_nonzero(np.isfinite(points[:, 0]))
            for other, view in enumerate(self.views):
                if other == k or not total:
                    continue
                pixels = view.project(points)
                seen = np.isfinite(pixels[:, 0])
                if np.count_nonzero(seen) < 0.2 * total:
                    continue
                move = np.linalg.norm(view.unbounded().project(behind[seen]) - pixels[seen], axis=-1)
                if step / max(np.nanmedian(move), 1e-12) <= 0.1:
                    return True
        return False
