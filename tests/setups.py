"""Setups of every kind, and a slow obvious way to trace a ray, for the tests of several modules."""

import numpy as np

from cyclopean import Camera, Mirror, Mirrors, Plate, Prism, Setup
from cyclopean.geometry import Rays
from cyclopean.optics import Path, reflect, refract

DISTORTION = (0.1, -0.05, 1e-3, -2e-3, 0.02)
STRAIGHT = Camera((640, 480), 900)
BENT = Camera((640, 480), (900, 905), (318.0, 243.0), DISTORTION)

_DEVIATIONS = ((0.2, 0.5), (-0.1, -0.3), (0.15, 0.4))
_ROOF = Mirror((5, 0, 90), (1, 0.1, -1), (60, 80), tilt_deg=(1.5, -2.0), advance=0.7)
_WALL = Mirror((90, 0, 95), (-1, 0.05, 1.2), (120, 120), tilt_deg=(-1.0, 0.5), advance=-0.4)

OPTICS = {
    "prism": Prism(
        3, 10, 1.5168, 60, 12, 22, "scene", 20, tilt_deg=(3, -2, 1), shift=(0.7, -0.4), facet_deviation_deg=_DEVIATIONS
    ),
    "prism, facets to camera": Prism(
        3, 12, 1.62, 50, 14, 19, "camera", -15, tilt_deg=(-2, 3, 2), shift=(-0.5, 0.6), facet_deviation_deg=_DEVIATIONS
    ),
    "biprism in water": Prism(2, 15, "N-SF11", 40, surroundings="water"),
    "two mirrors": Mirrors((_ROOF, _WALL), ((0, 1), (0,)), direct=True),
    "plate": Plate("N-BK7", 40, 15, radius=17, tilt_deg=(20, -15, 5), shift=(1, 2)),
    "port": Plate(1.5, 30, 8, tilt_deg=(4, 3, 0), beyond="water"),
}
SETUPS = {
    f"{name}, {lens}": Setup(camera, optic)
    for name, optic in OPTICS.items()
    for lens, camera in (("straight lens", STRAIGHT), ("bent lens", BENT))
}


def mirrors_beside() -> Mirrors:
    """A mirror on each side of the direct view: two mirrored views and one that is not."""
    sides = (Mirror((side * 40.0, 0.0, 200.0), (-side, 0.0, -0.02), (300.0, 200.0)) for side in (-1, 1))
    return Mirrors(tuple(sides), direct=True)


def random_pixels(setup: Setup, count: int, seed: int = 5) -> np.ndarray:
    """Pixels (count, 2) all over the image."""
    return np.random.default_rng(seed).uniform(0, np.array(setup.camera.size) - 1, (count, 2))


def trace_slowly(path: Path, rays: Rays) -> Rays:
    """What `Path.trace` does, one surface after the other, by the laws of refraction and reflection."""
    origins, directions, index = rays.origins, rays.directions, path.index_start
    alive = np.isfinite(directions).all(-1)
    for surface in path.interfaces:
        distance = (surface.offset - origins @ surface.normal) / (directions @ surface.normal)
        origins = origins + distance[..., None] * directions
        alive &= (distance >= 0) & (origins @ surface.bounds[:, :3].T <= surface.bounds[:, 3]).all(-1)
        if surface.disc is not None:
            arm = origins - surface.disc.centre
            alive &= np.linalg.norm(np.cross(arm, surface.disc.axis), axis=-1) <= surface.disc.radius
        if surface.act == "reflect":
            directions = reflect(directions, surface.normal)
        else:
            directions = refract(directions, surface.normal, index, surface.index_after)
        index = surface.index_after
    alive &= np.isfinite(directions).all(-1)
    return Rays(np.where(alive[..., None], origins, np.nan), np.where(alive[..., None], directions, np.nan))
