"""The way of light through an optic: ordered interfaces, and rays traced along them."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np

from ..errors import OpticError
from ..geometry import Rays, launch
from .surfaces import Interface, Reason, reflect


class PackedPath(NamedTuple):
    """A path as the arrays that the compiled kernels take (optics/kernels.py says what they hold)."""

    planes: np.ndarray
    first_bound: np.ndarray
    bounds: np.ndarray
    discs: np.ndarray


@dataclass(frozen=True, eq=False)
class Path:
    """Interfaces in the order in which light from the camera's pinhole meets them.

    `derivatives` (P, S, 5) are those of each interface's normal, offset and n_after^2 - n_before^2 with
    respect to the P named parameters of the optic that made the path. `blockers` are mirrors that
    may stand in the way (`obstructed`).
    """

    interfaces: tuple[Interface, ...]
    index_start: float = 1.0
    parameter_names: tuple[str, ...] = ()
    derivatives: np.ndarray | None = None
    name: str = ""
    blockers: tuple[Interface, ...] = ()

    def __post_init__(self):
        if not self.index_start > 0:
            raise OpticError(f"the refractive index at the camera must be positive, got {self.index_start}")

    @property
    def index_end(self) -> float:
        """Refractive index of the medium that the rays end in."""
        return self.interfaces[-1].index_after if self.interfaces else self.index_start

    @property
    def mirrored(self) -> bool:
        """True when an odd number of mirrors flips the picture."""
        return sum(interface.act == "reflect" for interface in self.interfaces) % 2 == 1

    def unbounded(self) -> Path:
        """The same path with surfaces that have no end."""
        return replace(self, interfaces=tuple(interface.unbounded() for interface in self.interfaces), blockers=())

    @cached_property
    def packed(self) -> PackedPath:
        """The path as arrays for the kernels."""
        index, planes, discs = self.index_start, [], []
        for interface in self.interfaces:
            delta = 0.0 if interface.act == "reflect" else interface.index_after**2 - index**2
            planes.append([*interface.normal, interface.offset, delta, -1 if interface.act == "reflect" else 1])
            disc = interface.disc
            discs.append([0, 0, 0, 0, 0, 0, np.inf] if disc is None else [*disc.centre, *disc.axis, disc.radius])
            index = interface.index_after
        counts = [len(interface.bounds) for interface in self.interfaces]
        bounds = [interface.bounds for interface in self.interfaces if len(interface.bounds)]
        return PackedPath(
            np.array(planes, dtype=float).reshape(-1, 6),
            np.concatenate([[0], np.cumsum(counts)]).astype(np.int64),
            np.concatenate(bounds).astype(float) if bounds else np.empty((0, 5)),
            np.array(discs, dtype=float).reshape(-1, 7),
        )

    def trace(self, rays: Rays) -> Rays:
        """Send rays through the path.

        Parameters
        ----------
        rays : Rays
            (...,) rays in the first medium, in the rig frame.

        Returns
        -------
        Rays
            (...,) rays behind the last surface, which start on it; NaN where a ray misses a surface or
            its outline, or is totally reflected (`explain` says which).
        """
        from . import kernels

        origins, directions = np.broadcast_arrays(
            np.asarray(rays.origins, dtype=float), np.asarray(rays.directions, dtype=float)
        )
        out = np.empty((2, *origins.shape))
        flat = [np.ascontiguousarray(a).reshape(-1, 3) for a in (origins, directions)]
        launch(
            kernels.trace_rays,
            len(flat[0]),
            *flat,
            self.index_start,
            *self.packed,
            out[0].reshape(-1, 3),
            out[1].reshape(-1, 3),
        )
        return Rays(out[0], out[1])

    def obstructed(self, rays: Rays) -> np.ndarray:
        """True (...,) where one of the blockers stands in the way of rays (...,), before, between or behind surfaces.

        A mirror without size is as large as it needs to be: it hides what is behind it from the camera, but
        does not wall in light that other mirrors have turned.
        """
        origins, directions = np.asarray(rays.origins, dtype=float), np.asarray(rays.directions, dtype=float)
        blocked = np.zeros(directions.shape[:-1], dtype=bool)
        left = None
        for surface in (*self.interfaces, None):
            reach = np.array(np.inf) if surface is None else _distance(surface, origins, directions)
            for blocker in self.blockers:
                if blocker is left or blocker is surface or (left is not None and not len(blocker.bounds)):
                    continue
                distance = _distance(blocker, origins, directions)
                with np.errstate(invalid="ignore"):  # rays that are not there
                    hits = origins + distance[..., None] * directions
                    inside = (hits @ blocker.bounds[:, :3].T <= blocker.bounds[:, 3]).all(-1)
                blocked |= inside & (distance > 0) & (distance < reach)
            if surface is not None:
                with np.errstate(invalid="ignore"):  # rays along the mirror never reach it
                    origins = origins + reach[..., None] * directions
                directions = reflect(directions, surface.normal)
            left = surface
        return blocked

    def explain(self, rays: Rays) -> np.ndarray:
        """The `Reason` (as an integer array, (...,)) why each ray is lost; 0 where it is not."""
        from . import kernels

        origins, directions = np.broadcast_arrays(rays.origins, rays.directions)
        out = np.empty(origins.shape[:-1], dtype=np.int64)
        for index in np.ndindex(out.shape):
            p, v = (
                np.array(origins[index], dtype=float),
                self.index_start * np.array(directions[index], dtype=float),
            )
            if not (np.isfinite(p).all() and np.isfinite(v).all()):
                out[index] = Reason.NOT_A_NUMBER
                continue
            out[index] = kernels.explain_ray(
                p,
                v,
                *self.packed,
                Reason.MISSED.value,
                Reason.OUTSIDE_OUTLINE.value,
                Reason.TOTAL_REFLECTION.value,
            )
        return out


def _distance(surface, origins, directions):
    """How far along each ray (...,) a surface lies; inf or NaN where they never meet."""
    with np.errstate(divide="ignore", invalid="ignore"):
        return (surface.offset - origins @ surface.normal) / (directions @ surface.normal)
