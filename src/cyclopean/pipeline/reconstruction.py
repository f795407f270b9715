"""What one photograph tells about the scene: depth of every pixel, points with covariance."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..geometry import as_rgb
from ..matching import DepthMap
from ..rigs import Rig


@dataclass(frozen=True, eq=False)
class Reconstruction:
    """What one photograph tells about the scene.

    The maps cover the photograph, pixel by pixel; the points are those of all pixels with a depth, row by row.
    """

    rig: Rig
    depths: tuple[float, float]  # mm, that were searched
    depth: np.ndarray  # (H, W) float32 mm, z in the rig frame; NaN unknown
    sigma: np.ndarray  # (H, W) float32 mm, standard deviation of depth; NaN unknown
    confidence: np.ndarray  # (H, W) float32, 0 to 1; 0 unknown
    view: np.ndarray  # (H, W) int8, the view that each pixel belongs to; -1 none
    points: np.ndarray  # (N, 3) mm, rig frame
    covariance: np.ndarray  # (N, 3, 3) float32 mm^2
    colours: np.ndarray  # (N, 3) uint8
    pixels: np.ndarray  # (N, 2) the pixel of each point

    @property
    def completeness(self) -> np.ndarray:
        """Share (V,) of each view's pixels that have a depth."""
        known = np.isfinite(self.depth)
        return np.array([known[self.view == k].mean() if (self.view == k).any() else 0.0 for k in range(len(self.rig))])


def assemble(photograph: np.ndarray, rig: Rig, depths: tuple[float, float], maps: Sequence[DepthMap]) -> Reconstruction:
    """One reconstruction from the depth maps of all views."""
    shape = photograph.shape[:2]
    depth, sigma = np.full((2, *shape), np.nan, dtype=np.float32)
    confidence, view_of = np.zeros(shape, np.float32), np.full(shape, -1, np.int8)
    clouds, picture = [], as_rgb(photograph)
    for k, (view, own) in enumerate(zip(rig, maps, strict=True)):
        mask = view.region.mask
        view_of[mask] = k
        rows, columns = np.nonzero(np.isfinite(own.inverse_depth))
        inverse = own.inverse_depth[rows, columns].astype(float)
        spread = own.sigma[rows, columns].astype(float)
        pixels = np.stack([columns, rows], -1) + own.origin
        y, x = pixels[:, 1], pixels[:, 0]
        depth[y, x] = 1 / inverse
        sigma[y, x] = spread / inverse**2
        confidence[y, x] = own.score[rows, columns]
        points, covariance = _located(rig, k, pixels, inverse, spread)
        clouds.append((points, covariance, picture[y, x], pixels))
    points, covariance, colours, pixels = (np.concatenate(parts) for parts in zip(*clouds, strict=True))
    return Reconstruction(rig, depths, depth, sigma, confidence, view_of, points, covariance, colours, pixels)


def _located(rig, k, pixels, inverse, spread):
    """Points (N, 3) of pixels (N, 2) at inverse depths (N,), and their covariance (N, 3, 3).

    A correspondence is as uncertain in the reference view as in the others: along the ray by the spread of
    inverse depth, across it by the pixels that this spread stands for in the most sensitive other view.
    """
    view = rig[k].unbounded()
    depth = 1 / inverse
    points = view.rays(pixels).at_depth(depth)
    further = view.rays(pixels).at_depth(1 / (inverse + spread))
    along = further - points
    moves = [
        np.linalg.norm(other.unbounded().project(further) - other.unbounded().project(points), axis=-1)
        for j, other in enumerate(rig)
        if j != k
    ]
    noise = np.nanmax(moves, axis=0)[:, None]
    across = [
        noise * (view.rays(pixels + half).at_depth(depth) - view.rays(pixels - half).at_depth(depth))
        for half in np.array([[0.5, 0.0], [0.0, 0.5]])
    ]
    factor = np.stack([along, *across], -1).astype(np.float32)
    return points, factor @ np.swapaxes(factor, -1, -2)
