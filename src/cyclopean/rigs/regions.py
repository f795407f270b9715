"""Which pixels of a photograph belong to a view."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from ..geometry import as_pixels


@dataclass(frozen=True, eq=False)
class Region:
    """The pixels of one sub-image.

    `traced` are the pixels whose central ray goes this way. Next to a seam the camera's aperture, and the
    width of a pixel, blend both sides: `mask` leaves out what lies nearer than `margin` to a seam.
    """

    traced: np.ndarray  # (H, W) bool
    margin: float  # px
    clearance: np.ndarray | None = None  # (H, W) mm, positive inside; places the outline between pixels

    @cached_property
    def mask(self) -> np.ndarray:
        """(H, W) bool: the traced pixels without the margin beside seams; the image's own border is no seam."""
        import cv2

        padded = np.pad(self.traced, 1, mode="edge").astype(np.uint8)
        if padded.all():
            return self.traced
        distance = cv2.distanceTransform(padded, cv2.DIST_L2, cv2.DIST_MASK_PRECISE)[1:-1, 1:-1]
        return distance - 0.5 >= self.margin  # the seam runs half a pixel before the first pixel beyond it

    @cached_property
    def box(self) -> tuple[int, int, int, int]:
        """(x, y, width, height) of the smallest rectangle around the mask; zeros when it is empty."""
        rows, columns = np.flatnonzero(self.mask.any(1)), np.flatnonzero(self.mask.any(0))
        if not rows.size:
            return 0, 0, 0, 0
        x, y = int(columns[0]), int(rows[0])
        return x, y, int(columns[-1]) - x + 1, int(rows[-1]) - y + 1

    @property
    def centre(self) -> np.ndarray:
        """Centre of gravity (2,) of the mask, px."""
        rows, columns = np.nonzero(self.mask)
        return np.array([columns.mean(), rows.mean()])

    @cached_property
    def outline(self) -> list[np.ndarray]:
        """Closed polygons (N, 2) px around the traced pixels, placed between pixels by their clearance."""
        import contourpy

        height = np.where(self.traced, 0.5, -0.5)
        if self.clearance is not None:
            usable = np.isfinite(self.clearance) & (np.abs(self.clearance) < 1e6)
            height = np.where(usable, self.clearance, height)
        padded = np.pad(height, 1, constant_values=-1e-9)  # hardly outside, so that the contour runs out there
        rows, columns = padded.shape
        # the padding puts the contour at the edge of the border pixels
        x = np.concatenate([[-0.5 - 1e-6], np.arange(columns - 2.0), [columns - 2.5 + 1e-6]])
        y = np.concatenate([[-0.5 - 1e-6], np.arange(rows - 2.0), [rows - 2.5 + 1e-6]])
        return [np.asarray(line) for line in contourpy.contour_generator(x, y, padded).lines(0.0)]

    def contains(self, pixels: ArrayLike) -> np.ndarray:
        """True (...,) where pixels (..., 2) fall on the mask; False for NaN."""
        return on_mask(self.mask, pixels)

    def with_margin(self, margin: float) -> Region:
        """The same region with another margin (px)."""
        return replace(self, margin=margin)


def on_mask(mask: np.ndarray, pixels: ArrayLike) -> np.ndarray:
    """True (...,) where pixels (..., 2) fall on a mask (H, W) bool; False for NaN."""
    pixels = as_pixels(pixels)
    height, width = mask.shape
    good = np.isfinite(pixels).all(-1)
    nearest = np.rint(np.where(good[..., None], pixels, -1.0))
    good &= ((nearest >= 0) & (nearest < [width, height])).all(-1)
    column, row = np.moveaxis(np.where(good[..., None], nearest, 0).astype(int), -1, 0)
    return good & mask[row, column]


def pixel_grid(size: tuple[int, int]) -> np.ndarray:
    """Centres (H, W, 2) of all pixels of an image of size (width, height)."""
    width, height = size
    grid = np.empty((height, width, 2))
    grid[..., 0] = np.arange(width)
    grid[..., 1] = np.arange(height)[:, None]
    return grid
