"""Where a window is seen to a fraction of a pixel: Gauss-Newton on its plane, then on its shift in each view.

The other views are taken to show gain x window + offset, for each channel, moved as the plane and the optic say.
What is left over tells the noise. Pixels of one block of the window count together in the covariance, so that noise
that neighbours, channels and views have in common is not taken for independent.

Lucas and Kanade, IJCAI 1981; Baker and Matthews, IJCV 56(3), 2004; White, Econometrica 48(4), 1980 (the covariance).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from .window_search import Picture, Window
from .windows_kernels import sample

_REACH = 2.0  # steps of inverse depth between the places that the warp is known at
_SLOPE = 3.0  # steps, what the inverse depth is expected to change from the middle of a window to its edge
_BAND = 1.0  # px, how far from its epipolar curve a window may lie
_BLOCK = 4  # px, of a window: noise within is taken for alike
_PASSES = 12
_STILL = 2e-3  # steps or px: a fit that moves less has ended
_NOISE = 0.1  # least variance of a grey level: that of its rounding, and some


class PlaneFit(NamedTuple):
    """A plane in inverse depth that explains a window."""

    inverse_depth: float  # 1/mm, at the window's middle
    slopes: np.ndarray  # (2,) 1/mm, its change over half the window's width
    sigma: float  # 1/mm, standard deviation of the inverse depth
    converged: bool


class ShiftFit(NamedTuple):
    """Where one view shows a window."""

    pixel: np.ndarray  # (2,) px
    shift: np.ndarray  # (2,) px, away from where the plane puts it
    covariance: np.ndarray  # (2, 2) px^2
    strength: float  # zero-mean normalised correlation
    along: np.ndarray  # (2,) px per unit of inverse depth: direction of the epipolar curve


def fit_plane(
    picture: Picture, window: Window, start: float, step: float, used: np.ndarray, slopes: np.ndarray | None = None
) -> PlaneFit:
    """The plane that makes the used views (V-1,) look like the window.

    Parameters
    ----------
    start : float
        Inverse depth to start from, 1/mm, good to about a pixel.
    step : float
        Inverse depth that moves the window by about half a pixel, 1/mm.
    used : (V-1,) bool array
        The other views that count.
    slopes : (2,) array, optional
        Slopes to start from, 1/mm.
    """
    plane = np.array([start, *(np.zeros(2) if slopes is None else slopes)]) / step  # in steps from here on
    shape = np.column_stack([np.ones(len(window.offsets)), window.offsets])
    stiffness = np.array([0.0, _SLOPE**-2, _SLOPE**-2])
    sigma, moved = np.inf, np.inf
    for _ in range(_PASSES):
        blocks, rows = [], []
        for v in np.flatnonzero(used):
            warp = _warp(window, int(v), plane * step, step)
            parts = _equations(picture, window, int(v), warp[0], warp[1] * step)
            if parts is None:
                continue
            slope, miss, weights = parts  # (N, C, 1), (N, C), (N, C)
            rows.append((slope * shape[:, None, :], miss, weights))
            blocks.append(_blocks(window))
        if not rows:
            return PlaneFit(np.nan, np.full(2, np.nan), np.nan, False)
        change, covariance = _solve(rows, blocks, stiffness, plane * [0, 1, 1])
        change *= min(1.0, 1.5 / max(np.abs(change).max(), 1e-12))
        plane, moved, sigma = plane + change, float(np.abs(change[0])), float(np.sqrt(covariance[0, 0]))
        if moved < _STILL:
            break
    return PlaneFit(plane[0] * step, plane[1:] * step, sigma * step, bool(np.isfinite(sigma) and moved < 0.05))


def fit_shift(picture: Picture, window: Window, v: int, plane: PlaneFit, step: float) -> ShiftFit:
    """Where the v-th of the other views shows the window, on its curve or beside it."""
    values = np.array([plane.inverse_depth, *plane.slopes])
    places, along = _warp(window, v, values, step)
    middle = node_middle(window)
    shift, covariance, strength = np.zeros(2), np.full((2, 2), np.nan), np.nan
    for _ in range(_PASSES):
        parts = _equations(picture, window, v, places + shift, np.eye(2))
        if parts is None:
            break
        change, covariance = _solve([parts], [_blocks(window)], np.full(2, _BAND**-2), shift)
        change *= min(1.0, 0.7 / max(np.abs(change).max(), 1e-12))
        shift = shift + change
        if np.abs(change).max() < _STILL:
            break
    strength = likeness(picture, window, v, places + shift)
    return ShiftFit(middle @ places + shift, shift, covariance, strength, middle @ along)


def node_middle(window: Window) -> np.ndarray:
    """Weights (N,) that pick the pixel in the middle of the window."""
    return (np.abs(window.offsets).max(-1) < 1e-9).astype(float)


def likeness(picture: Picture, window: Window, v: int, places: np.ndarray) -> float:
    """Zero-mean normalised correlation of the window with a view at places (N, 2); NaN where nothing is seen."""
    values, _ = _look(picture, window, v, places)
    weights = np.where(np.isfinite(values[:, 0]), window.weights, 0.0)
    total = weights.sum()
    if total < 0.5 * window.weights.sum():
        return np.nan
    own, other = (a - weights @ a / total for a in (window.values, np.nan_to_num(values)))
    energy = (weights @ own**2).sum() * (weights @ other**2).sum()
    return float((weights @ (own * other)).sum() / np.sqrt(max(energy, 1e-12)))


def fitted_places(window: Window, v: int, plane: PlaneFit, step: float) -> np.ndarray:
    """Places (N, 2) px of the window's pixels in the v-th of the other views, by a plane."""
    return _warp(window, v, np.array([plane.inverse_depth, *plane.slopes]), step)[0]


def _warp(window, v, plane, step):
    """Places (N, 2) of the window's pixels in a view, and their derivatives (N, 2) to inverse depth."""
    at = plane[0] + step * _REACH * np.array([-1.0, 0.0, 1.0])
    nodes = np.einsum("nk,dkx->dnx", window.shapes, window.free[v].project(window.rays.at_depth(1 / at[:, None])))
    t = (window.offsets @ plane[1:] / (step * _REACH))[:, None]
    bend, tilt = (nodes[0] + nodes[2]) / 2 - nodes[1], (nodes[2] - nodes[0]) / 2
    return nodes[1] + t * (tilt + t * bend), (tilt + 2 * t * bend) / (step * _REACH)


def _look(picture, window, v, places):
    values = np.empty((len(places), picture.spline.shape[2]))
    slopes = np.empty((*values.shape, 2))
    sample(picture.spline, picture.usable[window.others[v]], np.ascontiguousarray(places), values, slopes)
    return values, slopes


def _equations(picture, window, v, places, directions):
    """Slopes (N, C, P), misses (N, C) and weights (N, C) of one view, gain and offset taken out; None: unseen.

    `directions` (N, 2) or (2, P) is how places move with the unknowns.
    """
    values, slopes = _look(picture, window, v, places)
    weights = np.where(np.isfinite(values[:, 0]), window.weights, 0.0)
    if weights.sum() < 0.5 * window.weights.sum():
        return None
    values, slopes = np.nan_to_num(values), np.nan_to_num(slopes)
    if directions.shape == (2, 2):
        slope = slopes @ directions
    else:
        slope = np.einsum("ncx,nx->nc", slopes, directions)[..., None]
    own = window.values - weights @ window.values / weights.sum()
    power = np.maximum(weights @ own**2, 1e-9 * weights.sum())

    def without(a):  # (N, C, ...): less the part that gain and offset explain
        a = a - np.tensordot(weights, a, 1) / weights.sum()
        share = np.einsum("n,nc,nc...->c...", weights, own, a)
        return a - np.einsum("nc,c...->nc...", own, share / power.reshape(-1, *[1] * (a.ndim - 2)))

    return without(slope), -without(values), np.broadcast_to(weights[:, None], values.shape)


def _blocks(window):
    """Number (N,) of the block that each pixel of a window belongs to."""
    column, row = np.floor((window.offsets * window.half + window.half) / _BLOCK).astype(int).T
    return row * (int(2 * window.half) // _BLOCK + 1) + column


def _solve(rows, blocks, stiffness, held):
    """One Gauss-Newton step and its covariance; `held` is what the stiffness pulls to zero."""
    normal = sum(np.einsum("nc,nci,ncj->ij", w, j, j) for j, _, w in rows)
    right = sum(np.einsum("nc,nci,nc->i", w, j, e) for j, e, w in rows)
    energy = sum(float((w * e * e).sum()) for _, e, w in rows) / sum(float(w.sum()) for _, _, w in rows)
    noise = max(float(energy), _NOISE)
    normal = normal + np.diag(stiffness) * noise
    right = right - stiffness * noise * held
    size = np.sqrt(np.maximum(np.diag(normal), 1e-12))
    inverse = np.linalg.inv(normal / np.outer(size, size) + 1e-9 * np.eye(len(size))) / np.outer(size, size)
    pulls = np.zeros((max(b.max() for b in blocks) + 1, len(size)))
    for (slope, miss, weights), block in zip(rows, blocks, strict=True):
        np.add.at(pulls, block, np.einsum("nc,nci,nc->ni", weights, slope, miss))
    count = int(np.count_nonzero(np.abs(pulls).sum(-1)))
    spread = pulls.T @ pulls * count / max(count - len(size) - 2, 1)
    spread = spread + _NOISE * sum(np.einsum("nc,nci,ncj->ij", w * w, j, j) for j, _, w in rows)
    spread = spread + np.diag(stiffness) * noise**2  # what the stiffness knows no better
    return inverse @ right, inverse @ spread @ inverse
