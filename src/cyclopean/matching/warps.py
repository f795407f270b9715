"""Where each reference pixel is seen in the other views, for a ladder of inverse depths."""

from dataclasses import dataclass

import cv2
import numpy as np
from numba import njit, prange

from cyclopean.errors import ShapeError


@dataclass(frozen=True, eq=False)
class Warps:
    """Maps from one reference view into every other view, on a coarse lattice of reference pixels.

    Between the nodes of the lattice the maps are bilinear, between two hypotheses linear in inverse depth.
    """

    origin: tuple[int, int]     # (x, y) of the reference box's top-left pixel in the photograph
    size: tuple[int, int]       # (width, height) of the reference box
    inverse_depths: np.ndarray  # (D,) 1/mm, ascending and evenly spaced: the hypotheses
    spacing: int                # px between the nodes of the lattice
    nodes: np.ndarray           # (V-1, D, Ny, Nx, 2) float32, pixel of the photograph in the other view, NaN unknown
    masks: np.ndarray           # (V, H, W) bool, pixels that belong to each view; row 0 is the reference

    def __post_init__(self):
        """Check that the arrays fit together."""
        views, depths, rows, columns = self.masks.shape[0], len(self.inverse_depths), *self.lattice
        wanted = (views - 1, depths, rows, columns, 2)
        if self.nodes.shape != wanted:
            raise ShapeError(f"nodes must have shape (V-1, D, Ny, Nx, 2) = {wanted}, got {self.nodes.shape}")
        if depths < 3:
            raise ShapeError(f"matching needs at least 3 inverse depths, got {depths}; widen the depth range")

    @property
    def lattice(self):
        """Rows and columns of nodes, (Ny, Nx)."""
        return tuple((n - 2) // self.spacing + 2 for n in self.size[::-1])

    @property
    def step(self):
        """Inverse depth between two hypotheses, 1/mm."""
        return float(self.inverse_depths[-1] - self.inverse_depths[0]) / (len(self.inverse_depths) - 1)

    def reference_mask(self):
        """Pixels of the box that belong to the reference view, (h, w) bool."""
        (x, y), (width, height) = self.origin, self.size
        return self.masks[0, y : y + height, x : x + width]


@njit(parallel=True, cache=True)
def spread(nodes, spacing, top, height, width):
    """Bilinear maps at every pixel of some rows of the box from the nodes of one view and hypothesis.

    Parameters
    ----------
    nodes : (Ny, Nx, 2) float32 array
        Pixels of the photograph at the nodes.
    spacing, top, height, width : int
        Pixels between nodes, first row wanted, number of rows, width of the box.

    Returns
    -------
    (height, width), (height, width) float32 arrays
        x and y in the photograph, far outside it where a node is NaN.
    """
    map_x = np.empty((height, width), np.float32)
    map_y = np.empty((height, width), np.float32)
    last_row, last_column = nodes.shape[0] - 1, nodes.shape[1] - 1
    for row in prange(height):
        j = (top + row) // spacing
        below = min(j + 1, last_row)
        t = np.float32((top + row) % spacing) / np.float32(spacing)
        line = (np.float32(1) - t) * nodes[j] + t * nodes[below] if t > 0 else nodes[j].copy()
        for x in range(width):
            i = x // spacing
            s = np.float32(x % spacing) / np.float32(spacing)
            right = min(i + 1, last_column) if s > 0 else i
            u = line[i, 0] + s * (line[right, 0] - line[i, 0])
            v = line[i, 1] + s * (line[right, 1] - line[i, 1])
            known = u == u and v == v
            map_x[row, x] = u if known else np.float32(-1e4)
            map_y[row, x] = v if known else np.float32(-1e4)
    return map_x, map_y


def warp(image, mask, map_x, map_y):
    """The picture another view has where the maps point, and which of its pixels count.

    Parameters
    ----------
    image : (H, W, C) float32 array
        Photograph.
    mask : (H, W) uint8 array
        1 on the pixels of the other view.
    map_x, map_y : (h, w) float32 arrays
        Pixels of the photograph.

    Returns
    -------
    (C, h, w) float32 array, (h, w) float32 array
        Picture by cubic interpolation and mask of 0 and 1.
    """
    border = {"borderMode": cv2.BORDER_CONSTANT, "borderValue": 0}
    warped = cv2.remap(image, map_x, map_y, cv2.INTER_CUBIC, **border)
    inside = cv2.remap(mask, map_x, map_y, cv2.INTER_NEAREST, **border)
    warped = warped.reshape(*map_x.shape, -1)
    return np.ascontiguousarray(np.moveaxis(warped, -1, 0)), inside.astype(np.float32)
