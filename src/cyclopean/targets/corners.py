"""Corners where black and white meet, placed to hundredths of a pixel by fitting what a blurred corner looks like.

Two straight edges cross at the corner, and the blur of lens and pixel is Gaussian, so the brightness is

    background + cover (contrast + gradient . (pixel - window)),   cover = sum over white quadrants Phi(d1) Phi(d2)

with d1, d2 the distances from the two edges over the blur's standard deviation, and Phi the normal distribution.
Gauss-Newton finds the corner, both edge directions, the blur and the four brightnesses at once. Markers inside the
quadrants are part of the model, or left out where their bits begin. Where the map from the board bends (lens, glass,
perspective), d1 and d2 are taken in coordinates in which it is linear (see `curvature.py`).

References
----------
Duda and Frese, Accurate detection and localization of checkerboard corners for calibration, BMVC 2018 (why windows
should reach along the edges); White, A heteroskedasticity-consistent covariance matrix estimator, Econometrica 1980,
and Conley, GMM estimation with cross sectional dependence, J. Econometrics 1999 (the standard deviations).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

_LARGEST = 11  # px, half width of the largest window
_APART = 3.0  # px; markers further than this from the edges are left out of the model and of the window
_FLOOR = 0.003  # px; no corner is known better than this, whatever its residuals say
_LOCKING = 0.015  # px, error of sharp edges that run along the pixel grid (measured on rendered boards) ...
_SHARP = 0.55  # px, ... when their blur is this; it vanishes as exp(-2 pi² blur²), the sampled edge's first alias


@dataclass(frozen=True, eq=False)
class Surroundings:
    """What lies around K corners in the board's plane; quadrants in the order (-,-), (+,-), (-,+), (+,+) of (x, y)."""

    white: np.ndarray  # (K, 4) bool, quadrants that are white
    marked: np.ndarray  # (K, 4) bool, quadrants that hold a marker
    extent: float  # mm from the corner, along x and y, that may be used
    gap: float = np.inf  # mm from the edges to the markers; inf: the marked quadrants begin with a border
    clear: float = np.inf  # mm from the edges to the markers' bits, which are not part of the model

    def rows(self, rows: np.ndarray) -> Surroundings:
        """The same for some of the corners."""
        return Surroundings(self.white[rows], self.marked[rows], self.extent, self.gap, self.clear)


@dataclass(frozen=True, eq=False)
class CornerFits:
    """Fitted corners, K rows; NaN where the window holds too little."""

    pixels: np.ndarray  # (K, 2) px
    sigma: np.ndarray  # (K,) px, standard deviation of one coordinate
    contrast: np.ndarray  # (K,) brightness of white less that of black; negative when the colours are exchanged
    explained: np.ndarray  # (K,) share of the window's variance that the model explains
    turned: np.ndarray  # (K,) rad, by how much an edge departs from the direction foretold, the larger of the two
    blur: np.ndarray  # (K,) px, standard deviation


def fit_corners(
    image: np.ndarray,
    valid: np.ndarray,
    pixels: np.ndarray,
    jacobians: np.ndarray,
    around: Surroundings,
    second: np.ndarray | None = None,
) -> CornerFits:
    """Fit the model of a blurred corner at K places.

    Parameters
    ----------
    image : (H, W) array
        Brightness, linear or not.
    valid : (H, W) array of bool
        Pixels that may be used; a window never takes in others.
    pixels : (K, 2) array
        First guess, good to a few px.
    jacobians : (K, 2, 2) array
        px per mm, d pixel / d (x, y of the board) at each corner; negative determinant: seen from behind, or y up.
    around : Surroundings
        Of the same K corners.
    second : (K, 3, 2) array, optional
        px per mm², d² pixel / dx², dx dy and dy² of the board at each corner. Without, edges are taken as straight.

    Returns
    -------
    CornerFits
        `sigma` comes from the residuals, whose variance and correlation (over 3 × 3 px) are not assumed.
    """
    from . import kernels

    pixels, jacobians = np.asarray(pixels, dtype=float), np.asarray(jacobians, dtype=float)
    fits = np.full((len(pixels), 7), np.nan)
    size = np.linalg.det(jacobians)
    seen_from_behind = size < 0  # the board's y up: the same corners in a frame whose y points down
    jacobians = np.where(seen_from_behind[:, None, None], jacobians * [1, -1], jacobians)
    size = np.abs(size)
    quadrants = np.where(seen_from_behind[:, None], [2, 3, 0, 1], [0, 1, 2, 3])
    rows = np.flatnonzero(np.isfinite(pixels).all(-1) & (size > 0))
    along_x, along_y, size = jacobians[rows, :, 0], jacobians[rows, :, 1], size[rows]
    angles = np.stack([np.arctan2(-along_y[:, 0], along_y[:, 1]), np.arctan2(along_x[:, 0], -along_x[:, 1])], axis=1)
    per_mm = size[:, None] / np.stack([np.linalg.norm(along_y, axis=1), np.linalg.norm(along_x, axis=1)], axis=1)
    gap, clear = around.gap, around.clear
    if rows.size and np.isfinite(gap) and gap * np.median(per_mm) > _APART:
        gap, clear = np.inf, around.gap
    shapes = [np.take_along_axis(a, quadrants, axis=1)[rows] for a in (around.white, around.marked)]
    shapes = np.concatenate(shapes, axis=1).astype(float)
    gaps = np.where(np.isfinite(gap), gap * per_mm, np.inf)
    image, valid = np.ascontiguousarray(image, dtype=np.float64), np.ascontiguousarray(valid, dtype=bool)
    places, inverses, found = pixels[rows], np.linalg.inv(jacobians[rows]), np.empty((len(rows), 7))
    second = np.zeros((len(pixels), 3, 2)) if second is None else np.asarray(second, dtype=float)
    second = np.where(seen_from_behind[:, None, None], second * [[1], [-1], [1]], second)[rows]
    kernels.fit_all(image, valid, places, angles, inverses, second, shapes, gaps, around.extent, clear, _LARGEST, found)
    fits[rows] = found
    fits[rows, 2] = np.sqrt(fits[rows, 2] ** 2 + _FLOOR**2 + _locking(angles, fits[rows, 6]) ** 2)
    return CornerFits(fits[:, :2], *fits[:, 2:].T)


def _locking(angles, blur):
    """Standard deviation (K,) px of a coordinate that comes from pixels of finite size.

    All pixels along an edge that runs with the grid share one phase; a slanted edge averages over phases.
    """
    slant = np.abs((angles + np.pi / 4) % (np.pi / 2) - np.pi / 4)  # (K, 2) rad off the grid
    phases = 2 * _LARGEST * np.tan(slant)  # px that the edge crosses within the window
    shares = (np.exp(-(phases**2)) ** 2).mean(-1)
    return _LOCKING * np.sqrt(shares) * np.minimum(1, np.exp(2 * np.pi**2 * (_SHARP**2 - blur**2)))
