"""Maps between sub-images that serve the matcher: a sweep of the reference picture through depth."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from ..errors import SetupError
from ..geometry import Rays, Warps
from ..rigs import Rig

_PROBES = 24  # a grid of pixels a side, and of depths, to choose steps by


def inverse_depths(rig: Rig, depths: tuple[float, float], step: float = 0.5) -> np.ndarray:
    """Inverse depths, evenly spaced, so that one step moves no picture by more than `step` px.

    Parameters
    ----------
    rig : Rig
        Views to match.
    depths : (2,) mm
        Nearest and farthest depth (z in the rig frame).
    step : float
        Largest movement of a pixel from one inverse depth to the next, px.

    Returns
    -------
    (D,) array
        1/mm, ascending; its ends lie at the two depths.
    """
    near, far = depths
    if not 0 < near < far < np.inf:
        raise SetupError(f"a depth range is (near, far) with 0 < near < far in mm, got {depths}")
    if not 0.01 <= step <= 10:
        raise SetupError(f"the step between hypotheses must lie between 0.01 and 10 px (0.5 is usual), got {step}")
    low, high = 1 / far, 1 / near
    probe = np.linspace(low, high, _PROBES)
    fastest = 0.0
    for reference in range(len(rig)):
        x, y, width, height = rig[reference].region.box
        grid = np.stack(
            np.meshgrid(np.linspace(x, x + width - 1, _PROBES), np.linspace(y, y + height - 1, _PROBES)), -1
        )
        rays = rig[reference].unbounded().rays(grid)
        for other in range(len(rig)):
            if other != reference:
                pixels = rig[other].unbounded().project(at_inverse_depths(rays, probe))
                inside = rig[other].camera.contains(pixels)  # what the other view cannot see may move at any speed
                move = np.linalg.norm(np.diff(pixels, axis=0), axis=-1)[inside[1:] & inside[:-1]]
                fastest = max(fastest, float(move.max(initial=0.0)) / (probe[1] - probe[0]))
    if not fastest > 0:
        raise SetupError(
            f"nothing moves between the depths {near:g} and {far:g} mm: the rig needs two views that overlap there"
        )
    fastest *= 1.02  # what lies between the probes may be a little faster
    return np.linspace(low, high, max(int(np.ceil((high - low) * fastest / step)) + 1, 3))  # a matcher wants 3


def at_inverse_depths(rays: Rays, inverse: ArrayLike) -> np.ndarray:
    """Points (D, ..., 3) where rays (...,) reach the inverse depths (D,) 1/mm."""
    inverse = np.asarray(inverse, dtype=float)
    return rays.at_depth((1 / inverse).reshape(-1, *[1] * len(rays.shape)))


def sweep(rig: Rig, reference: int, inverse: ArrayLike, spacing: int = 8) -> Warps:
    """Where the pixels of one view are seen by all others, for a sweep of depths.

    Every lattice point is projected exactly, along true rays, at every depth; pixels between lattice points
    are to be interpolated. Lattice points beyond a seam are taken from the surfaces without end, so that maps
    stay smooth there; the masks say which pixels count.

    Parameters
    ----------
    rig : Rig
        Views; the reference and all others.
    reference : int
        Number of the view whose pixels are mapped.
    inverse : (D,) array
        Inverse depths 1/mm, ascending and evenly spaced (`inverse_depths`).
    spacing : int
        Distance of lattice points, px. `interpolation_error` measures what it costs.

    Returns
    -------
    Warps
        Maps into the other views, in the order of the rig.
    """
    view = rig[reference]
    x, y, width, height = view.region.box
    columns = x + spacing * np.arange(-(-(width - 1) // spacing) + 1)
    rows = y + spacing * np.arange(-(-(height - 1) // spacing) + 1)
    rays = view.unbounded().rays(np.stack(np.meshgrid(columns, rows), -1))
    others = [k for k in range(len(rig)) if k != reference]
    inverse = np.asarray(inverse, dtype=float)
    nodes = np.empty((len(others), len(inverse), len(rows), len(columns), 2), dtype=np.float32)
    for d, w in enumerate(inverse):  # one depth at a time: the points of all would not fit in memory
        points = rays.at_depth(1 / w)
        for k, other in enumerate(others):
            nodes[k, d] = rig[other].unbounded().project(points)
    masks = rig.masks[[reference, *others]]
    return Warps((x, y), (width, height), inverse, spacing, nodes, masks)


def interpolation_error(rig: Rig, warps: Warps, reference: int) -> float:
    """Largest error (px) of bilinear interpolation between a sweep's lattice points, found at cell middles."""
    half = warps.spacing / 2
    rows, columns = warps.nodes.shape[2] - 1, warps.nodes.shape[3] - 1
    if rows < 1 or columns < 1:
        return 0.0
    x, y = warps.origin
    middle = np.stack(
        np.meshgrid(x + half + warps.spacing * np.arange(columns), y + half + warps.spacing * np.arange(rows)),
        -1,
    )
    rays = rig[reference].unbounded().rays(middle)
    others = [k for k in range(len(rig)) if k != reference]
    worst = 0.0
    for d in (0, len(warps.inverse_depths) - 1):
        points = rays.at_depth(1 / warps.inverse_depths[d])
        for k, other in enumerate(others):
            cells = warps.nodes[k, d].astype(float)
            between = (cells[1:, 1:] + cells[1:, :-1] + cells[:-1, 1:] + cells[:-1, :-1]) / 4
            miss = np.linalg.norm(rig[other].unbounded().project(points) - between, axis=-1)
            worst = max(worst, float(np.nanmax(miss, initial=0.0)))
    return worst
