"""What one photograph tells about the scene: depth of every pixel, points with covariance."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..fusion import fuse
from ..geometry import as_rgb
from ..matching import DepthMap
from ..rigs import Rig


@dataclass(frozen=True, eq=False)
class Reconstruction:
    """What one photograph tells about the scene.

    Depth, sigma, confidence and view cover the photograph, pixel by pixel, as each view was matched by itself. The
    points are the fused cloud (`fusion.fuse`): what several views show is there once, merged, on the ray of its pixel
    in the first of these views.
    """

    rig: Rig
    depths: tuple[float, float]  # mm, that were searched
    depth: np.ndarray  # (H, W) float32 mm, z in the rig frame; NaN unknown
    sigma: np.ndarray  # (H, W) float32 mm, standard deviation of depth; NaN unknown
    confidence: np.ndarray  # (H, W) float32, 0 to 1; 0 unknown
    view: np.ndarray  # (H, W) int8, the view that each pixel belongs to; -1 none
    maps: tuple[DepthMap, ...]  # the same depths by view, for fusion and for a mesh (`fusion.build_mesh`)
    points: np.ndarray  # (N, 3) mm, rig frame
    covariance: np.ndarray  # (N, 3, 3) float32 mm^2
    colours: np.ndarray  # (N, 3) uint8
    normals: np.ndarray  # (N, 3) float32 unit, towards the camera; NaN unknown
    views: np.ndarray  # (N,) uint8, how many views have the point
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
    for k, (view, own) in enumerate(zip(rig, maps, strict=True)):
        view_of[view.region.mask] = k
        rows, columns = np.nonzero(np.isfinite(own.inverse_depth))
        inverse = own.inverse_depth[rows, columns].astype(float)
        y, x = rows + own.origin[1], columns + own.origin[0]
        depth[y, x] = 1 / inverse
        sigma[y, x] = own.sigma[rows, columns] / inverse**2
        confidence[y, x] = own.score[rows, columns]
    cloud = fuse(rig, maps)
    colours = as_rgb(photograph)[cloud.pixels[:, 1], cloud.pixels[:, 0]]
    return Reconstruction(
        rig, depths, depth, sigma, confidence, view_of, tuple(maps), cloud.points, cloud.covariance, colours,
        cloud.normals, cloud.views, cloud.pixels,
    )  # fmt: skip
