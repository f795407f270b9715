"""How far apart the colour channels of a photograph lie, measured in the photograph itself."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..errors import ImageError
from ..rigs import Rig

_SIDE = 512  # px, largest side of the window that is looked at in each view
_FINE, _COARSE = 1.0, 6.0  # px: detail between these scales counts, brightness and noise do not
_EDGE = 16  # px beside a view's border that the coarse scale smears
_FEWEST = 1000  # pixels
_ALIKE = 0.1  # least correlation of two channels that can be compared: colours of one texture may differ much
_ROUNDS = 8
_BLOCK = 64  # px, side of the parts of a window whose errors are taken as independent


class ChannelShifts(NamedTuple):
    """Shifts of the channels of a photograph against green, in each view."""

    shifts: np.ndarray  # (V, 3, 2) px: what green shows at x, a channel shows at x + shift; NaN where not alike
    sigma: np.ndarray  # (V, 3) px, standard deviation of each shift, in the direction in which it is largest
    correlation: np.ndarray  # (V, 3), of each channel with green once it is shifted

    @property
    def largest(self) -> float:
        """Largest distance (px) between two channels of a view; 0 where none can be told."""
        apart = np.linalg.norm(self.shifts[:, :, None] - self.shifts[:, None], axis=-1)
        return float(np.nanmax(apart, initial=0.0))


def channel_shifts(photograph: np.ndarray, rig: Rig) -> ChannelShifts:
    """Measure how far apart the colour channels lie in each view of a photograph.

    Parameters
    ----------
    photograph : (H, W, 3) array
        Red, green, blue.
    rig : Rig
        The views; only their pixels count.

    Returns
    -------
    ChannelShifts
        One mean shift for each view, from a window of at most 512 px in its middle: phase correlation, then
        Gauss-Newton on the difference of the channels, after a band-pass. Shifts up to some 20 px are found. Sigma
        is large where the colours of the texture differ much: it comes from the scatter of parts of the window.

    References
    ----------
    Kuglin and Hines 1975, The phase correlation image alignment method.
    Lucas and Kanade 1981, An iterative image registration technique (section 4).
    Liang and Zeger 1986, Longitudinal data analysis using generalized linear models (covariance of clusters).
    """
    photograph = np.asarray(photograph)
    if photograph.ndim != 3 or photograph.shape[2] != 3:
        raise ImageError(f"colour channels are those of a photograph (H, W, 3), got {photograph.shape}")
    shifts, sigma, alike = np.zeros((len(rig), 3, 2)), np.zeros((len(rig), 3)), np.ones((len(rig), 3))
    for k, view in enumerate(rig):
        window, inside = _window(view.region)
        channels = [_detail(photograph[(*window, c)]) for c in range(3)]
        for c in (0, 2):
            shifts[k, c], sigma[k, c], alike[k, c] = _shift(channels[1], channels[c], inside)
    shifts[alike < _ALIKE] = sigma[alike < _ALIKE] = np.nan
    return ChannelShifts(shifts, sigma, alike)


def _window(region):
    """Slices of a window around a region's middle, and which of its pixels count."""
    import cv2

    height, width = region.mask.shape
    x, y = (round(float(value)) for value in region.centre)
    left, top = max(x - _SIDE // 2, 0), max(y - _SIDE // 2, 0)
    window = slice(top, min(top + _SIDE, height)), slice(left, min(left + _SIDE, width))
    distance = cv2.distanceTransform(
        np.pad(region.mask[window].astype(np.uint8), 1), cv2.DIST_L2, cv2.DIST_MASK_PRECISE
    )
    return window, distance[1:-1, 1:-1] > _EDGE


def _detail(channel):
    import cv2

    picture = channel.astype(np.float32)
    fine, coarse = (cv2.GaussianBlur(picture, (0, 0), sigma) for sigma in (_FINE, _COARSE))
    return fine - coarse


def _shift(first, second, inside):
    """Shift (2,) px of `second` against `first`, its standard deviation, and their correlation once it is taken off."""
    import cv2
    from scipy.ndimage import map_coordinates, spline_filter

    if np.count_nonzero(inside) < _FEWEST:
        return np.full(2, np.nan), np.nan, 0.0
    taper = cv2.GaussianBlur(inside.astype(np.float32), (0, 0), _EDGE / 2)
    shift = np.array(cv2.phaseCorrelate(np.float64(first * taper), np.float64(second * taper))[0])
    if np.linalg.norm(shift) > 1.25 * _EDGE:
        shift = np.zeros(2)
    rows, columns = np.nonzero(inside)
    slope_y, slope_x = np.gradient(first)
    slopes = np.stack([slope_x[inside], slope_y[inside]], -1).astype(float)
    wanted, spline = first[inside].astype(float), spline_filter(second, order=3, output=np.float32)
    for _ in range(_ROUNDS):
        got = map_coordinates(spline, [rows + shift[1], columns + shift[0]], order=3, prefilter=False, mode="mirror")
        contrast = max(float(np.sum(got * wanted) / max(np.sum(wanted**2), 1e-12)), 1e-3)
        step = np.linalg.lstsq(contrast * slopes, contrast * wanted - got, rcond=None)[0]
        shift = shift + step
        if not np.linalg.norm(step) > 3e-3:
            break
    scale = np.sqrt(np.sum(got**2) * np.sum(wanted**2))
    blocks = rows // _BLOCK * (1 + columns.max() // _BLOCK) + columns // _BLOCK
    sigma = _scatter(contrast * slopes, contrast * wanted - got, blocks)
    return shift, sigma, float(np.sum(got * wanted) / scale) if scale > 0 else 0.0


def _scatter(slopes, left, blocks):
    """Standard deviation of a least-squares solution with slopes (N, 2), from what is left (N,) in each block (N,)."""
    pulls = np.stack([np.bincount(blocks, slopes[:, axis] * left) for axis in range(2)])
    inverse = np.linalg.pinv(slopes.T @ slopes)
    return float(np.sqrt(np.linalg.eigvalsh(inverse @ (pulls @ pulls.T) @ inverse)[-1]))
