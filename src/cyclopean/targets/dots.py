"""Dots in photographs: found, and measured to a few hundredths of a pixel."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import ArrayLike
from scipy.ndimage import map_coordinates

from ..errors import ImageError, ShapeError

_SCALE = 1.25  # between the sizes that are tried
_ROUND = 0.3  # least ratio of the two curvatures at a dot's centre: edges and scratches have one near 0
_NOISE = 5.0  # times the noise: what a dot must stand out by
_TURNS = 12  # iterations of the centroid


@dataclass(frozen=True, eq=False)
class Dots:
    """N dots, the strongest first."""

    pixels: np.ndarray  # (N, 2) px, centres
    diameters: np.ndarray  # (N,) px
    sigma: np.ndarray  # (N,) px, standard deviation of each coordinate of the centre, from the noise of the pixels
    contrast: np.ndarray  # (N,) grey levels above (below, for dark dots) the surroundings

    def __len__(self) -> int:
        return len(self.pixels)

    def select(self, rows: np.ndarray) -> Dots:
        """Some of the dots (a mask or indices)."""
        return Dots(self.pixels[rows], self.diameters[rows], self.sigma[rows], self.contrast[rows])


def find_dots(
    photograph: ArrayLike,
    mask: ArrayLike | None = None,
    dark: bool | None = None,
    min_diameter: float = 4.0,
    max_diameter: float = 30.0,
    min_contrast: float = 0.03,
) -> Dots:
    """Find round dots and measure their centres.

    Parameters
    ----------
    photograph : (H, W) or (H, W, C) array
        Photograph; colours are averaged.
    mask : (H, W) array of bool, optional
        Where to look; a dot counts when its centre lies on the mask.
    dark : bool, optional
        True for dark dots on bright ground, False for bright ones; without it, the kind that stands out more.
    min_diameter, max_diameter : float
        px, sizes to look for.
    min_contrast : float
        Least difference from the surroundings, as a share of the photograph's range (1st to 99th percentile).

    Returns
    -------
    Dots
        Centres are those of the grey values, weighted by a Gaussian window of the dot's size, after a plane through
        the surroundings is taken off: slow changes of brightness do not move them.

    References
    ----------
    Lindeberg, Feature detection with automatic scale selection, International Journal of Computer Vision 30, 1998
    (blobs as extrema of the scaled Laplacian). Bertin and Arnouts, SExtractor, Astronomy and Astrophysics
    Supplement 117, 1996, and its manual (windowed centroids).
    """
    grey = _grey(photograph)
    if not 2 <= min_diameter < max_diameter <= min(grey.shape) / 2:
        raise ShapeError(
            f"diameters must satisfy 2 <= min < max <= half the picture, got {min_diameter:g} and {max_diameter:g} px"
        )
    allowed = np.ones(grey.shape, bool) if mask is None else np.asarray(mask, dtype=bool)
    if allowed.shape != grey.shape:
        raise ShapeError(f"mask must have shape {grey.shape}, got {allowed.shape}")
    noise = noise_level(grey)
    low, high = np.percentile(grey, [1, 99])
    least = max(min_contrast * (high - low), _NOISE * noise)
    kinds = (False, True) if dark is None else (dark,)
    found = [_measured(-grey if kind else grey, allowed, min_diameter, max_diameter, least, noise) for kind in kinds]
    return max(found, key=lambda dots: dots.contrast.sum())


def noise_level(grey: np.ndarray) -> float:
    """Standard deviation of the noise of a picture's pixels, from their smallest differences.

    Immerkaer, Fast noise variance estimation, Computer Vision and Image Understanding 64, 1996, with a median in
    place of the mean, so that edges do not count.
    """
    kernel = np.array([[1, -2, 1], [-2, 4, -2], [1, -2, 1]], np.float32)
    return float(np.median(np.abs(cv2.filter2D(grey, cv2.CV_32F, kernel))) / 0.6745 / 6)


def _grey(photograph):
    picture = np.asarray(photograph)
    if picture.ndim not in (2, 3):
        raise ShapeError(f"a photograph must have shape (H, W) or (H, W, C), got {picture.shape}")
    grey = picture.mean(axis=-1, dtype=np.float32) if picture.ndim == 3 else picture.astype(np.float32)
    if not np.isfinite(grey).all():
        raise ImageError("the photograph holds values that are not finite; set them to 0 first")
    return grey


def _measured(grey, allowed, min_diameter, max_diameter, least, noise):
    """Bright dots, measured, without those that turn out to be something else."""
    starts, diameters = _candidates(grey, allowed, min_diameter, max_diameter, least)
    rows = [_measure(grey, start, diameter, noise) for start, diameter in zip(starts, diameters, strict=True)]
    table = np.array(rows, dtype=float).reshape(-1, 5)
    moved = np.linalg.norm(table[:, :2] - starts.reshape(-1, 2), axis=1)
    good = np.isfinite(table).all(axis=1) & (moved <= 0.5 * diameters) & (table[:, 4] >= least)
    table = table[good]
    table = table[np.argsort(-table[:, 4], kind="stable")]
    keep = _apart(table[:, :2], table[:, 2])
    return Dots(table[keep, :2], table[keep, 2], table[keep, 3], table[keep, 4])


def _candidates(grey, allowed, min_diameter, max_diameter, least):
    """Starts (N, 2) px and diameters (N,): maxima of the scaled Laplacian in place and size, round and strong."""
    count = int(np.ceil(np.log(max_diameter / min_diameter) / np.log(_SCALE))) + 1
    diameters = min_diameter * _SCALE ** np.arange(-1, count + 1)
    responses, rounds = zip(*(_laplacian(grey, diameter / 2 / np.sqrt(2)) for diameter in diameters), strict=True)
    window = np.ones((3, 3), np.uint8)
    starts, sizes = [np.empty((0, 2))], [np.empty(0)]
    for k in range(1, len(diameters) - 1):
        here = responses[k]
        best = (here >= cv2.dilate(here, window)) & (here > responses[k - 1]) & (here >= responses[k + 1])
        y, x = np.nonzero(best & allowed & (rounds[k] >= _ROUND) & (here >= 0.5 * least))
        starts.append(np.column_stack([x, y]).astype(float))
        sizes.append(np.full(len(x), diameters[k]))
    return np.concatenate(starts), np.concatenate(sizes)


def _laplacian(grey, scale):
    """Minus the scaled Laplacian (H, W), and the ratio (H, W) of the smaller to the larger curvature."""
    smooth = cv2.GaussianBlur(grey, (0, 0), scale, borderType=cv2.BORDER_REFLECT)
    xx, yy = cv2.Sobel(smooth, cv2.CV_32F, 2, 0, ksize=3) / 4, cv2.Sobel(smooth, cv2.CV_32F, 0, 2, ksize=3) / 4
    xy = cv2.Sobel(smooth, cv2.CV_32F, 1, 1, ksize=3) / 4
    half, root = (xx + yy) / 2, np.sqrt(((xx - yy) / 2) ** 2 + xy**2)
    ratio = (-half - root) / np.maximum(-half + root, 1e-9)
    return -(scale**2) * 2 * half, ratio


def _measure(grey, start, diameter, noise):
    """Centre x, y, diameter, sigma and contrast of a bright dot; NaN where it runs out of the picture."""
    reach = int(np.ceil(1.25 * diameter)) + 1
    x0, y0 = (round(float(v)) for v in start)
    height, width = grey.shape
    if not (reach <= x0 < width - reach and reach <= y0 < height - reach):
        reach = min(x0, y0, width - 1 - x0, height - 1 - y0)
        if reach < 0.75 * diameter + 1:
            return [np.nan] * 5
    patch = grey[y0 - reach : y0 + reach + 1, x0 - reach : x0 + reach + 1].astype(float)
    y, x = np.mgrid[-reach : reach + 1, -reach : reach + 1].astype(float)
    values = patch - _surroundings(patch, x, y, diameter)
    scale = diameter / 2.4  # a disc keeps most of its weight, its surroundings little
    centre = np.zeros(2)
    for _ in range(_TURNS):
        weight = np.exp(-((x - centre[0]) ** 2 + (y - centre[1]) ** 2) / (2 * scale**2))
        total = (weight * values).sum()
        if total <= 0:
            return [np.nan] * 5
        # twice the step: the window holds the centroid of a Gaussian of its own size back by half
        step = (
            2 * np.array([(weight * values * (x - centre[0])).sum(), (weight * values * (y - centre[1])).sum()]) / total
        )
        centre += np.clip(step, -1, 1)
        if np.abs(step).max() < 1e-4:
            break
    spread = np.sqrt((weight**2 * (x - centre[0]) ** 2).sum())
    contrast = float(map_coordinates(values, [[centre[1] + reach], [centre[0] + reach]], order=1, mode="nearest")[0])
    area = np.clip(values[np.hypot(x - centre[0], y - centre[1]) < diameter] / max(contrast, 1e-9), 0, 1).sum()
    return [x0 + centre[0], y0 + centre[1], 2 * np.sqrt(area / np.pi), 2 * max(noise, 0.29) * spread / total, contrast]


def _surroundings(patch, x, y, diameter):
    """A plane through the ring around a dot, robust to neighbours that reach into it."""
    distance = np.hypot(x, y)
    ring = distance > 0.7 * diameter
    design = np.column_stack([np.ones(ring.sum()), x[ring], y[ring]])
    values, weight = patch[ring], np.ones(ring.sum())
    plane = np.array([np.median(values), 0.0, 0.0])
    for _ in range(4):
        gap = values - design @ plane
        scale = max(1.4826 * np.median(np.abs(gap)), 0.5)
        weight = 1 / (1 + (gap / (2 * scale)) ** 2)
        plane = np.linalg.lstsq(design * weight[:, None], values * weight, rcond=None)[0]
    return plane[0] + plane[1] * x + plane[2] * y


def _apart(pixels, diameters):
    """Rows of dots none of which lies inside a stronger one; dots come strongest first."""
    from scipy.spatial import KDTree

    if not len(pixels):
        return np.empty(0, int)
    taken = np.zeros(len(pixels), bool)
    near = KDTree(pixels).query_ball_point(pixels, 0.6 * np.maximum(diameters, 2.0))
    for k, others in enumerate(near):
        if not taken[k]:
            taken[[other for other in others if other > k]] = True
    return np.flatnonzero(~taken)
