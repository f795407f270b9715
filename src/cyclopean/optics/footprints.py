"""Where rays meet the surfaces of an optic on their way."""

from __future__ import annotations

import numpy as np

from ..geometry import Rays
from .paths import Path
from .surfaces import reflect, refract


def meeting_points(path: Path, rays: Rays) -> np.ndarray:
    """Points at which rays meet each surface of a path, each surface taken without end.

    Parameters
    ----------
    path : Path
        With S surfaces.
    rays : Rays
        (...,) rays in the first medium, in the rig frame.

    Returns
    -------
    (..., S, 3) array
        Points in the rig frame, mm, in the order of the surfaces; NaN from where a ray misses one, or behind where it
        is totally reflected.
    """
    origins, directions = np.broadcast_arrays(
        np.asarray(rays.origins, dtype=float), np.asarray(rays.directions, dtype=float)
    )
    points, index = np.empty((*origins.shape[:-1], len(path.interfaces), 3)), path.index_start
    for s, surface in enumerate(path.interfaces):
        with np.errstate(divide="ignore", invalid="ignore"):
            distance = (surface.offset - origins @ surface.normal) / (directions @ surface.normal)
        distance = np.where((distance >= 0) & np.isfinite(distance), distance, np.nan)
        origins = points[..., s, :] = origins + distance[..., None] * directions
        normals = np.broadcast_to(surface.normal, directions.shape)
        if surface.act == "reflect":
            directions = reflect(directions, normals)
        else:
            directions = refract(directions, normals, index, surface.index_after)
        index = surface.index_after
    return points
