"""Scenes of points without names, as the views of a prism show them."""

import numpy as np

from cyclopean import Camera, Prism, Setup

DEPTHS = (500.0, 1100.0)
SIGMA = 0.1  # px
CAMERA = Camera((640, 480), 1200)


def five_views(facets=5):
    prism = Prism(facets, apex_deg=12.0, glass="N-BK7", distance=60.0, thickness=8.0, azimuth_deg=90.0)
    return Setup(CAMERA, prism, depths=DEPTHS).rig()


RIG = five_views()


def random_scene(rig, count=250, seed=3, depths=DEPTHS):
    """Points (count, 3) mm that lie where some view looks, at any depth of the range."""
    random = np.random.default_rng(seed)
    inverse = random.uniform(1 / depths[1], 1 / depths[0], 4 * count)
    across = random.uniform(-0.27, 0.27, (4 * count, 2)) / inverse[:, None]
    points = np.column_stack([across * [1, 0.75], 1 / inverse])
    return points[(np.isfinite(rig.project(points)[..., 0]).sum(-1) >= 2)][:count]


def seen_by(rig, points, sigma=SIGMA, seed=4, lost=0.0, clutter=0):
    """Points of each view in any order, with noise, gaps and clutter; and which scene point each is, -1 for none."""
    random = np.random.default_rng(seed)
    pixels, names = [], []
    for view in rig:
        here = view.project(points)
        rows = np.flatnonzero(view.region.contains(here) & (random.random(len(points)) >= lost))
        y, x = np.nonzero(view.region.mask)
        false = random.integers(0, len(y), clutter)
        both = np.concatenate([here[rows] + random.normal(0, sigma, (len(rows), 2)), np.stack([x[false], y[false]], 1)])
        name = np.concatenate([rows, np.full(clutter, -1)])
        order = random.permutation(len(both))
        pixels.append(both[order])
        names.append(name[order])
    return pixels, names


def judged(matches, names):
    """For each match whether all its pixels show one scene point, and which (-1 where not)."""
    named = np.stack([np.append(name, -2)[rows] for name, rows in zip(names, matches.source.T, strict=True)], 1)
    first = named[np.arange(len(named)), np.argmax(matches.source >= 0, 1)]
    right = ((named == first[:, None]) | (matches.source < 0)).all(1) & (first >= 0)
    return right, np.where(right, first, -1)


def visible(names, views):
    """Scene points that at least so many views show."""
    every = np.concatenate([np.unique(name[name >= 0]) for name in names])
    return np.flatnonzero(np.bincount(every) >= views)


def along_a_ray(rig, depths, pixel=None):
    """Points on the ray of a pixel of view 0 at some depths, which view 1 sees as well."""
    start = rig[0].region.centre if pixel is None else pixel
    return rig[0].rays(start).at_depth(np.array(depths))


def triangulated_middle(rig):
    """A point that all views of the rig see, near the middle of what they share."""
    random = np.random.default_rng(0)
    z = random.uniform(600, 900, 4000)
    points = np.column_stack([random.uniform(-0.2, 0.2, (4000, 2)) * z[:, None], z])
    inside = np.stack([view.region.contains(view.project(points)) for view in rig]).all(0)
    assert inside.any()
    return points[inside][np.argmin(np.linalg.norm(points[inside, :2], axis=1))]
