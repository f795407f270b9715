"""Sub-images of an upright prism as polygons in the picture: seams are straight lines through the axis there."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from ..analysis.field_of_view import picture_azimuths
from ..cameras import Camera
from ..geometry import clip_by_half_plane
from ..optics import Prism
from ..rigs import View

_BORDER = 24  # points along each side of the picture
_STEP = 1 / 40  # of the picture's diagonal, between points of an outline
_HALVINGS = 24  # to 1e-7 of the picture, where light ends within it


@dataclass(frozen=True, eq=False)
class SubImages:
    """Where the sub-images of an upright prism with n facets lie, margins beside seams taken off."""

    camera: Camera
    azimuths: np.ndarray  # (n,) rad, of their middles
    margin: float  # of normalised coordinates
    corners: tuple[np.ndarray, ...]  # n of (M, 2): outlines in undistorted normalised coordinates; M = 0: none left

    @classmethod
    def of(cls, camera: Camera, prism: Prism, margin: float) -> SubImages:
        """Those of a prism that stands upright on the axis, with a margin in px."""
        return _sub_images(camera, tuple(picture_azimuths(prism).tolist()), float(margin))

    def labels(self, coordinates: np.ndarray) -> np.ndarray:
        """The number (N,) of the sub-image that normalised coordinates (N, 2) lie in; -1 beside seams."""
        depths = -np.stack([(coordinates @ normals.T).max(-1) for normals in _seam_normals(self.azimuths)])
        return np.where(depths.max(0) >= self.margin, depths.argmax(0), -1)

    def pixels(self, number: int, view: View) -> tuple[np.ndarray, bool]:
        """Outline (M, 2) px of one sub-image as far as light comes through, and whether all of it does."""
        corners = self.corners[number]
        if not len(corners):
            return corners, False
        pixels = self.camera.denormalise(corners)
        lit = _lit(view, pixels)
        if lit.all():
            return pixels, True
        azimuth = self.azimuths[number]
        start = (corners @ [np.cos(azimuth), np.sin(azimuth)]).min() + 0.05 * np.abs(corners).max()
        inside = np.broadcast_to(start * np.array([np.cos(azimuth), np.sin(azimuth)]), corners.shape)
        if not _lit(view, self.camera.denormalise(inside[:1])).all():
            return np.empty((0, 2)), False
        outside = corners
        for _ in range(_HALVINGS):
            middle = (inside + outside) / 2
            here = _lit(view, self.camera.denormalise(middle))[:, None]
            inside, outside = np.where(here, middle, inside), np.where(here, outside, middle)
        return np.where(lit[:, None], pixels, self.camera.denormalise(inside)), False


@lru_cache(maxsize=64)
def _sub_images(camera, azimuths, margin):
    inset, border = margin / float(np.mean(camera.focal)), picture_border(camera)
    step = _STEP * float(np.hypot(*np.ptp(border, axis=0)))
    outlines = []
    for normals in _seam_normals(azimuths):
        corners = border
        for normal in normals:
            corners = clip_by_half_plane(corners, normal, -inset)
        outlines.append(_densified(corners, step))
    return SubImages(camera, np.array(azimuths), inset, tuple(outlines))


def picture_border(camera: Camera) -> np.ndarray:
    """Outline (N, 2) of the picture in undistorted normalised coordinates."""
    width, height = camera.size
    share = np.arange(_BORDER) / _BORDER
    zero, one = np.zeros(_BORDER), np.ones(_BORDER)
    sides = [(share, zero), (one, share), (1 - share, one), (zero, 1 - share)]
    pixels = np.concatenate([np.stack(side, -1) for side in sides]) * [width, height] - 0.5
    return camera.normalise(pixels)


def _seam_normals(azimuths):
    """Normals (2, 2) of the two seams beside each middle, pointing out of its sector."""
    half = np.pi / len(azimuths) + np.pi / 2
    for azimuth in azimuths:
        yield np.array([[np.cos(azimuth + side * half), np.sin(azimuth + side * half)] for side in (-1, 1)])


def _densified(corners, step):
    """A closed polygon (M, 2) with points no farther apart than about a step, its corners kept."""
    if len(corners) < 3:
        return np.empty((0, 2))
    closed = np.vstack([corners, corners[:1]])
    along = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(closed, axis=0), axis=-1))])
    places = np.union1d(along[:-1], np.arange(0, along[-1], step))
    return np.stack([np.interp(places, along, closed[:, k]) for k in range(2)], -1)


def _lit(view, pixels):
    return np.isfinite(view.rays(pixels).directions).all(-1)
