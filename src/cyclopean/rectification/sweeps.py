"""Maps between sub-images that serve the matcher: a sweep of the reference picture through depth."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import partial

import cv2
import numpy as np
from numpy.typing import ArrayLike

from ..errors import SetupError
from ..geometry import Rays, Warps
from ..rigs import Rig
from ..rigs.regions import on_mask
from .dispersion import check_channels, places

TOLERANCE = 0.01  # px, largest error of the maps between points that are projected exactly
SPACINGS = (8, 4, 2)  # px between those points, the first that is fine enough
_DEGREES = (2, 3, 4, 6)  # of the polynomials in inverse depth
_FOLD = 1.0  # px: second differences of nodes beyond are no bend but an edge
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


def sweep(
    rigs: Rig | Sequence[Rig],
    reference: int,
    inverse: ArrayLike,
    tolerance: float = TOLERANCE,
    middle: float | None = None,
) -> Warps:
    """Where the pixels of one view are seen by all others, for a sweep of depths.

    Lattice points are projected exactly, along true rays, at some inverse depths; a polynomial through them
    stands for those between, and pixels between lattice points are to be interpolated. Degree and spacing of
    the lattice are the coarsest that keep the largest error, found by exact projection in the middles of cells
    and between the depths, below the tolerance. Lattice points beyond a seam are taken from the surfaces
    without end, so that maps stay smooth there; the masks say which pixels count. Where a lattice point has no place
    at some depths, the polynomial goes through the others; it is NaN where too few are left.

    Parameters
    ----------
    rigs : Rig or sequence of three Rigs
        The reference and all other views; one rig for all colours, or those of the channels (`channel_rigs`) of a
        photograph that is `compensated`.
    reference : int
        Number of the view whose pixels are mapped.
    inverse : (D,) array
        Inverse depths 1/mm, ascending and evenly spaced (`inverse_depths`).
    tolerance : float
        Largest error of the maps, px.
    middle : float, optional
        Of three rigs, the inverse depth (1/mm) at which the photograph is compensated; see `places`.

    Returns
    -------
    Warps
        Maps into the other views, in the order of the rig.

    Raises
    ------
    SetupError
        Where even the finest lattice misses the tolerance: the optic folds or bends the picture too much.
    """
    channels = check_channels(rigs)
    inverse = np.asarray(inverse, dtype=float)
    exact = partial(places, channels, reference, middle=(inverse[0] + inverse[-1]) / 2 if middle is None else middle)
    rig = channels[len(channels) // 2]
    masks = rig.masks[[reference, *(k for k in range(len(rig)) if k != reference)]]
    near = [cv2.dilate(mask.astype(np.uint8), np.ones((2 * SPACINGS[0] + 1,) * 2, np.uint8)) > 0 for mask in masks]
    worst, box = np.inf, rig[reference].region.box
    for spacing in SPACINGS:
        for degree in _DEGREES:
            warps = _fitted(exact, box, inverse, spacing, degree, masks)
            worst = _error(exact, warps, near, 0.5)
            if worst <= tolerance:
                return _balanced(warps)
            if _error(exact, warps, near, 0.0) <= tolerance / 2:
                break  # a higher degree would not help, a finer lattice may
    raise SetupError(
        f"maps into other views miss by up to {worst:.3f} px between points {SPACINGS[-1]} px apart, more than "
        f"{tolerance:g} px: the optic bends the picture too much there; state a narrower depth range"
    )


def _fitted(exact, box, inverse, spacing, degree, masks):
    """Warps with polynomials of a degree through exact places at Chebyshev points of the range."""
    x, y, width, height = box
    columns = x + spacing * np.arange(max(-(-(width - 1) // spacing), 1) + 1)
    rows = y + spacing * np.arange(max(-(-(height - 1) // spacing), 1) + 1)
    s = np.cos(np.pi * (np.arange(degree, -1, -1) + 0.5) / (degree + 1))
    found = exact(np.stack(np.meshgrid(columns, rows), -1), _at(inverse, s))
    powers = np.linalg.inv(np.vander(s, increasing=True))
    coefficients = np.einsum("kd,vdcijx->vcijxk", powers, found, optimize=True)
    if np.isnan(coefficients).any():
        _fit_what_there_is(exact, np.stack(np.meshgrid(columns, rows), -1), inverse, coefficients)
    return Warps((x, y), (width, height), inverse, spacing, coefficients.astype(np.float32), masks)


def _balanced(warps):
    """Maps whose errors are 0 on average over all pixels.

    Straight lines between exact places cut all bends on the same side, along either axis by (1 - 1/n^2) / 12 of the
    second difference on average over n pixels; nodes that lie off by as much leave no bias in depth.
    """
    share = np.float32((1 - warps.spacing**-2) / 12)
    bend = np.zeros_like(warps.coefficients)
    for axis in (2, 3):
        if bend.shape[axis] > 2:
            second = np.diff(warps.coefficients, 2, axis=axis)
            ends = [(0, 0)] * second.ndim
            ends[axis] = (1, 1)
            second = np.where(np.abs(second) < _FOLD, second, 0)  # NaN too
            bend += np.pad(second, ends, mode="edge")
    return replace(warps, coefficients=warps.coefficients - share * bend)


def _fit_what_there_is(exact, grid, inverse, coefficients):
    """Fit polynomials to the places that nodes have at some depths only: behind a mirror, say, there are none."""
    count = coefficients.shape[-1]
    s = np.cos(np.pi * (np.arange(4 * count) + 0.5) / (4 * count))
    found = np.moveaxis(exact(grid, _at(inverse, s)), 1, -1)
    there = np.isfinite(found).all(-2)
    chosen = np.isnan(coefficients).any((-2, -1)) & (there.sum(-1) >= count)
    kinds, kind_of = np.unique(there[chosen], axis=0, return_inverse=True)
    values, fitted = found[chosen], coefficients[chosen]
    for k, kind in enumerate(kinds):
        solve = np.linalg.pinv(np.vander(s[kind], count, increasing=True))
        fitted[kind_of == k] = values[kind_of == k][..., kind] @ solve.T
    coefficients[chosen] = fitted


def _at(inverse, s):
    """Inverse depths at s in [-1, 1]."""
    return inverse[0] + (np.asarray(s) + 1) / 2 * (inverse[-1] - inverse[0])


def _error(exact, warps, near, offset):
    """Largest distance (px) of maps from exact places, at nodes or an offset of cells from them, between the depths.

    Only places near pixels of the reference count that lie near pixels of the other view.
    """
    rows, columns = (n - (offset > 0) for n in warps.lattice)
    x, y = np.array(warps.origin) + offset * warps.spacing
    grid = np.stack(np.meshgrid(x + warps.spacing * np.arange(columns), y + warps.spacing * np.arange(rows)), -1)
    count = warps.coefficients.shape[-1]
    probes = np.concatenate([[-1], -np.cos(np.pi * np.arange(1, count) / count), [1]])
    true = exact(grid, _at(warps.inverse_depths, probes))
    found = np.stack([warps.nodes(step) for step in (probes + 1) / 2 * (len(warps.inverse_depths) - 1)], axis=1)
    if offset:
        found = (found[..., 1:, 1:, :] + found[..., 1:, :-1, :] + found[..., :-1, 1:, :] + found[..., :-1, :-1, :]) / 4
    counts = np.stack([on_mask(mask, true[k]) for k, mask in enumerate(near[1:])]) & on_mask(near[0], grid)
    counts &= np.isfinite(found).all(-1)  # maps that lack a node say so
    return float(np.max(np.linalg.norm(true - found, axis=-1), where=counts, initial=0.0))
