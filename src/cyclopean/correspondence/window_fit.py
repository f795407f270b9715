"""Where a window is seen to a fraction of a pixel: Gauss-Newton on its plane, then on its shift in each view.

The other views are taken to show gain x window + offset, for each channel, moved as the plane and the optic say.
What is left over tells the noise. Pixels of one block of the window count together in the covariance, so that noise
that neighbours, channels and views have in common is not taken for independent.

Lucas and Kanade, IJCAI 1981; Baker and Matthews, IJCV 56(3), 2004; White, Econometrica 48(4), 1980 (the covariance).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from .window_search import BLUR, Picture, Window
from .windows_kernels import sample

_REACH = 2.0  # steps of inverse depth between the places that the warp is known at
_SLOPE = 3.0  # steps, what the inverse depth is expected to change from the middle of a window to its edge
_BAND = 1.0  # px, how far from its epipolar curve a window may lie
_BLOCK = 4  # px, of a window: noise within is taken for alike
_MOST = 2.0  # times by which the few blocks of a small window widen its variance
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
    moved = np.inf
    for _ in range(_PASSES):
        rows = []
        for v in np.flatnonzero(used):
            warp = _warp(window, int(v), plane * step, step)
            parts = _equations(picture, window, int(v), warp[0], step * warp[1][:, :, None] * shape[:, None, :])
            if parts is not None:
                rows.append(parts)
        if not rows:
            return PlaneFit(np.nan, np.full(2, np.nan), np.nan, False)
        change = _change(rows, stiffness, plane * [0, 1, 1])
        change *= min(1.0, 1.5 / max(np.abs(change).max(), 1e-12))
        plane, moved = plane + change, float(np.abs(change[0]))
        if moved < _STILL:
            break
    sigma = float(np.sqrt(_covariance(window, rows, stiffness)[0, 0]))
    return PlaneFit(plane[0] * step, plane[1:] * step, sigma * step, bool(np.isfinite(sigma) and moved < 0.05))


def fit_shift(picture: Picture, window: Window, v: int, plane: PlaneFit, step: float) -> ShiftFit:
    """Where the v-th of the other views shows the window, on its curve or beside it."""
    values = np.array([plane.inverse_depth, *plane.slopes])
    places, along = _warp(window, v, values, step)
    middle = node_middle(window)
    moves = np.broadcast_to(np.eye(2), (len(places), 2, 2))
    shift, covariance, stiffness = np.zeros(2), np.full((2, 2), np.nan), np.full(2, _BAND**-2)
    for _ in range(_PASSES):
        parts = _equations(picture, window, v, places + shift, moves)
        if parts is None:
            break
        change = _change([parts], stiffness, shift)
        change *= min(1.0, 0.7 / max(np.abs(change).max(), 1e-12))
        shift = shift + change
        if np.abs(change).max() < _STILL:
            break
    if parts is not None:
        covariance = _covariance(window, [parts], stiffness)
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


class _Equations(NamedTuple):
    """Least-squares equations of one view, gain and offset taken out."""

    slopes: np.ndarray  # (N, C, P) grey levels per unit of the unknowns
    misses: np.ndarray  # (N, C) grey levels left over
    weights: np.ndarray  # (N, C)
    moves: np.ndarray  # (N, 2, P) px per unit of the unknowns

    @property
    def energy(self) -> np.ndarray:
        """(C,) mean square of what is left over."""
        return np.einsum("nc,nc,nc->c", self.weights, self.misses, self.misses) / self.weights.sum(0)


def _equations(picture, window, v, places, moves):
    """Equations of a view at places (N, 2) that move (N, 2, P) with the unknowns; None where it shows too little."""
    values, slopes = _look(picture, window, v, places)
    weights = np.where(np.isfinite(values[:, 0]), window.weights, 0.0)
    if weights.sum() < 0.5 * window.weights.sum():
        return None
    values, slopes = np.nan_to_num(values), np.einsum("ncx,nxp->ncp", np.nan_to_num(slopes), moves)
    own = window.values - weights @ window.values / weights.sum()
    power = np.maximum(weights @ own**2, 1e-9 * weights.sum())

    def without(a):  # (N, C, ...): less the part that gain and offset explain
        a = a - np.tensordot(weights, a, 1) / weights.sum()
        share = np.einsum("n,nc,nc...->c...", weights, own, a)
        return a - np.einsum("nc,c...->nc...", own, share / power.reshape(-1, *[1] * (a.ndim - 2)))

    weights_of_all = np.broadcast_to(weights[:, None], values.shape)
    return _Equations(without(slopes), -without(values), weights_of_all, moves)


def _normal(rows, stiffness):
    """Normal matrix (P, P) of the equations, and the variance of a grey level."""
    normal = sum(np.einsum("nc,nci,ncj->ij", e.weights, e.slopes, e.slopes) for e in rows)
    noise = max(float(np.mean([e.energy for e in rows])), _NOISE)
    return normal + np.diag(stiffness) * noise, noise


def _inverse(normal):
    size = np.sqrt(np.maximum(np.diag(normal), 1e-12))
    return np.linalg.inv(normal / np.outer(size, size) + 1e-9 * np.eye(len(size))) / np.outer(size, size)


def _change(rows, stiffness, held):
    """One Gauss-Newton step; `held` is what the stiffness pulls to zero."""
    normal, noise = _normal(rows, stiffness)
    right = sum(np.einsum("nc,nci,nc->i", e.weights, e.slopes, e.misses) for e in rows)
    return _inverse(normal) @ (right - stiffness * noise * held)


def _covariance(window, rows, stiffness):
    """Covariance (P, P) of the unknowns: slopes that are only noise tell nothing, so their share is taken out.

    Smoothed noise of variance s has slopes of variance s / (2 blur^2); half of what is left over is the view's own.
    """
    normal, noise = _normal(rows, stiffness)
    idle = sum(np.einsum("nc,c,nxi,nxj->ij", e.weights, e.energy, e.moves, e.moves) for e in rows)
    normal = _larger(normal / 4, normal - idle / (4 * BLUR**2))
    inverse = _inverse(normal)
    spread = _larger(_block_spread(window, rows), _noise_spread(window, rows))
    spread = spread + _NOISE * sum(np.einsum("nc,nci,ncj->ij", e.weights**2, e.slopes, e.slopes) for e in rows)
    spread = spread + np.diag(stiffness) * noise**2  # what the stiffness knows no better
    return inverse @ spread @ inverse


def _block_spread(window, rows):
    """Covariance (P, P) of the right side, from what is left over in blocks of the window, whatever its cause."""
    column, row = np.floor((window.offsets + 1) * window.half / _BLOCK).astype(int).T
    block = row * (int(2 * window.half) // _BLOCK + 1) + column
    pulls, shares = np.zeros((block.max() + 1, rows[0].slopes.shape[2])), np.zeros(block.max() + 1)
    for e in rows:
        np.add.at(pulls, block, np.einsum("nc,nci,nc->ni", e.weights, e.slopes, e.misses))
        np.add.at(shares, block, e.weights[:, 0])
    count = shares.sum() ** 2 / (shares**2).sum()  # as many blocks of equal weight tell as much
    unknown = pulls.shape[1] + 2  # gain and offset too
    return pulls.T @ pulls * count / max(count - unknown, count / _MOST)


def _noise_spread(window, rows):
    """Covariance (P, P) of the right side, from noise that is alike only as far as the pictures are smoothed.

    Half of what is left over belongs to the window itself, and is the same in all views. Few blocks may miss noise by
    luck; this does not.
    """
    line = window.half * np.unique(window.offsets[:, 0])
    alike = np.exp(-(((line[:, None] - line) / (2 * BLUR)) ** 2))
    pulls = [e.weights[..., None] * e.slopes * np.sqrt(e.energy)[:, None] for e in rows]
    spread = 0.0
    for pull in (*pulls, sum(pulls)):
        field = pull.reshape(len(line), len(line), -1)
        near = np.tensordot(alike, np.tensordot(alike, field, (1, 1)), (1, 1)).reshape(pull.shape)
        spread = spread + np.einsum("nci,ncj->ij", pull, near) / 2
    return spread


def _larger(a, b):
    """The covariance that is at least as large as both (P, P) in every direction."""
    values, vectors = np.linalg.eigh(b - a)
    return a + (vectors * np.maximum(values, 0.0)) @ vectors.T
