"""Surfaces of closed form and their true depth maps in every view, for the tests of fusion."""

import numpy as np

from cyclopean.matching import DepthMap

SIGMA = 1e-6  # 1/mm: 0.6 mm at 800 mm, 0.008 px of motion


def plane(rays, depth=800.0, slope=0.3):
    """z (N,) of the plane z = depth + slope x."""
    return _hit(rays, np.array([-slope, 0, 1]), depth)


def step(rays):
    """z (N,) of a half-plane at 700 mm left of x = 12 mm, before a plane at 900 mm."""
    near = _hit(rays, np.array([0, 0, 1.0]), 700)
    left = rays.at_depth(near)[:, 0] < 12
    return np.where(left, near, _hit(rays, np.array([0, 0, 1.0]), 900))


def sphere(rays, centre=(5.0, -3.0, 760.0), radius=60.0):
    """z (N,) of a sphere, NaN beside it."""
    arm = rays.origins - np.array(centre)
    b, c = (arm * rays.directions).sum(-1), (arm**2).sum(-1) - radius**2
    with np.errstate(invalid="ignore"):
        return rays.at(-b - np.sqrt(b**2 - c))[:, 2]


def _hit(rays, normal, offset):
    return rays.at((offset - rays.origins @ normal) / (rays.directions @ normal))[:, 2]


def depth_map(view, inverse_depth, sigma=SIGMA):
    """A DepthMap of inverse depths (H, W) of the whole photograph, NaN unknown; only its own region counts."""
    x, y, width, height = view.region.box
    own = np.where(view.region.mask, inverse_depth, np.nan)[y : y + height, x : x + width].astype(np.float32)
    known = np.isfinite(own)
    spread = np.where(known, sigma, np.nan).astype(np.float32)
    return DepthMap((x, y), own, spread, known.astype(np.float32))


def maps_of(rig, surface):
    """The true depth map of a surface in every view."""
    maps = []
    for view in rig:
        rows, columns = np.nonzero(view.region.mask)
        inverse = np.full(rig.size[::-1], np.nan)
        inverse[rows, columns] = 1 / surface(view.rays(np.stack([columns, rows], -1)))
        maps.append(depth_map(view, inverse))
    return maps


def across(mesh):
    """Cross products (M, 3) mm^2 of the sides of each triangle: twice its area, towards where it faces."""
    a, b, c = np.moveaxis(mesh.vertices[mesh.faces], 1, 0)
    return np.cross(b - a, c - a)
