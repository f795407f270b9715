"""Corners on curved grid lines: through glass a board's lines bend, and a straight edge fitted to one misses it.

In a window that reaches U squares along an edge whose second derivative is p'' (px per square²), the straight edge
that fits best lies off by about p'' U² / 6. So the map from board to picture is fitted to all corners of the view,
and every corner once more in coordinates where that map is linear around it. Discs are shifted likewise.
"""

from __future__ import annotations

import numpy as np

from .corners import Surroundings, fit_corners

_FEWEST = 6  # corners in a view; with fewer, edges are taken as straight
_CUBIC, _QUADRATIC = (20, 5), (10, 4)  # least corners, and least columns and rows of them
_MOVED = 0.3  # px, largest correction that is believed
_LESS_SURE = 1.5  # largest factor by which a correction may raise the standard deviation


def straightened(
    image: np.ndarray, valid: np.ndarray, xy: np.ndarray, pixels: np.ndarray, sigma: np.ndarray, around: Surroundings
) -> tuple[np.ndarray, np.ndarray]:
    """Fit corners of one view again, with the bends of the board's lines.

    Parameters
    ----------
    image, valid : (H, W) arrays
        Brightness, and the pixels of the view.
    xy : (N, 2) array
        mm, the corners' places on the board.
    pixels, sigma : (N, 2) and (N,) arrays
        px, what `fit_corners` found for straight edges, and the standard deviation.
    around : Surroundings
        Of the same N corners.

    Returns
    -------
    pixels, sigma : (N, 2) and (N,) arrays
        As given where a view holds too few corners, or a corner does not fit better.
    """
    if len(xy) < _FEWEST:
        return pixels, sigma
    try:
        jacobians, second = second_order(xy, pixels)
    except np.linalg.LinAlgError:
        return pixels, sigma
    fits = fit_corners(image, valid, pixels, jacobians, around, second)
    with np.errstate(invalid="ignore"):
        better = (np.linalg.norm(fits.pixels - pixels, axis=-1) < _MOVED) & (fits.sigma < _LESS_SURE * sigma)
    return np.where(better[:, None], fits.pixels, pixels), np.where(better, fits.sigma, sigma)


def bent_disc_offset(xy: np.ndarray, pixels: np.ndarray, radius: np.ndarray) -> np.ndarray:
    """Mean pixel of a disc's picture less its centre's pixel, beyond what a homography gives; (N, 2) px.

    With p(s) = J s + H[s, s] / 2 on a disc of radius r, whose pixels lie as dense as det dp/ds = det J (1 + g . s),
    the mean is r² (p_xx + p_yy) / 8 + r² J g / 4. Zero with few discs.

    Parameters
    ----------
    xy, pixels, radius : (N, 2), (N, 2) and (N,) arrays
        Centres on the board, mm, roughly where they are, px, and radii, mm.
    """
    if len(xy) < _FEWEST:
        return np.zeros_like(pixels)
    homography, curved = _fitted(xy, pixels)
    offsets = []
    for first, second in (curved, _homography_derivatives(homography, xy)[1:]):
        slopes = np.linalg.solve(first[:, None], np.stack([second[:, :2], second[:, 1:]], axis=1).swapaxes(2, 3))
        density = np.trace(slopes, axis1=2, axis2=3)  # (N, 2) 1/mm
        offsets.append((second[:, 0] + second[:, 2]) / 8 + (first @ density[..., None])[..., 0] / 4)
    return radius[:, None] ** 2 * (offsets[0] - offsets[1])


def second_order(xy: np.ndarray, pixels: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Derivatives of a smooth map from board to picture: a homography, and a polynomial for what it leaves.

    Parameters
    ----------
    xy, pixels : (N, 2) arrays
        Points of the board, mm, and where they are, px.

    Returns
    -------
    jacobians : (N, 2, 2) array
        px per mm, d pixel / d (x, y).
    second : (N, 3, 2) array
        px per mm², d² pixel / dx², dx dy, dy².

    Raises
    ------
    numpy.linalg.LinAlgError
        When the points lie on a line.
    """
    return _fitted(xy, pixels)[1]


def _fitted(xy, pixels):
    """Homography, and the derivatives of `second_order`."""
    import cv2

    homography, _ = cv2.findHomography(xy, pixels)
    if homography is None:
        raise np.linalg.LinAlgError("points on a line")
    mapped, jacobians, second = _homography_derivatives(homography, xy)
    sides = min(len(np.unique(np.round(column, 6))) for column in xy.T)
    order = next((n for n, least in ((3, _CUBIC), (2, _QUADRATIC)) if len(xy) >= least[0] and sides >= least[1]), 0)
    if order:
        unit = np.ptp(xy, axis=0).max() / 2  # mm
        terms = _polynomial((xy - xy.mean(0)) / unit, order)
        rest = terms @ np.linalg.lstsq(terms[0], pixels - mapped, rcond=None)[0]  # (6, N, 2)
        jacobians = jacobians + np.stack([rest[1], rest[2]], axis=-1) / unit
        second = second + np.stack([rest[3], rest[4], rest[5]], axis=1) / unit**2
    return homography, (jacobians, second)


def _homography_derivatives(homography, xy):
    """Pixels (N, 2), first (N, 2, 2) and second derivatives (N, 3, 2) of a homography."""
    from .growth import homography_pixels

    pixels, first = homography_pixels(homography, xy)
    slope = homography[2, :2] / (xy @ homography[2, :2] + homography[2, 2])[:, None]  # of the depth, over it
    turn = first[:, :, :, None] * slope[:, None, None, :]
    second = -(turn + np.swapaxes(turn, 2, 3))  # (N, pixel, 2, 2)
    return pixels, first, np.stack([second[:, :, 0, 0], second[:, :, 0, 1], second[:, :, 1, 1]], axis=1)


def _polynomial(xy, order):
    """Monomials (N, T) up to an order, and their derivatives x, y, xx, xy, yy: (6, N, T)."""
    exponents = np.array([(total - n, n) for total in range(order + 1) for n in range(total + 1)])
    powers = [_power(v[:, None], exponents[:, axis]) for axis, v in enumerate(xy.T)]
    return np.stack([powers[0][i] * powers[1][j] for i, j in ((0, 0), (1, 0), (0, 1), (2, 0), (1, 1), (0, 2))])


def _power(value, exponent):
    """value**exponent and its first two derivatives."""
    low = np.maximum(exponent - np.arange(3)[:, None], 0)
    return value ** low[0], exponent * value ** low[1], exponent * (exponent - 1) * value ** low[2]
