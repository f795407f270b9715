"""Where each reference pixel is seen in the other views, for a ladder of inverse depths."""

from dataclasses import dataclass

import numpy as np

from ..errors import ShapeError


@dataclass(frozen=True, eq=False)
class Warps:
    """Maps from one reference view into every other view, on a coarse lattice of reference pixels.

    Between the nodes of the lattice the maps are bilinear, between two hypotheses linear in inverse depth.
    """

    origin: tuple[int, int]  # (x, y) of the reference box's top-left pixel in the photograph
    size: tuple[int, int]  # (width, height) of the reference box
    inverse_depths: np.ndarray  # (D,) 1/mm, ascending and evenly spaced: the hypotheses
    spacing: int  # px between the nodes of the lattice
    nodes: np.ndarray  # (V-1, D, Ny, Nx, 2) float32, pixel of the photograph in the other view, NaN unknown
    masks: np.ndarray  # (V, H, W) bool, pixels that belong to each view; row 0 is the reference

    def __post_init__(self):
        """Check that the arrays fit together."""
        views, depths, rows, columns = self.masks.shape[0], len(self.inverse_depths), *self.lattice
        wanted = (views - 1, depths, rows, columns, 2)
        if self.nodes.shape != wanted:
            raise ShapeError(f"nodes must have shape (V-1, D, Ny, Nx, 2) = {wanted}, got {self.nodes.shape}")
        if depths < 3:
            raise ShapeError(f"matching needs at least 3 inverse depths, got {depths}; widen the depth range")

    @property
    def lattice(self) -> tuple[int, int]:
        """Rows and columns of nodes, (Ny, Nx)."""
        return (self.size[1] - 2) // self.spacing + 2, (self.size[0] - 2) // self.spacing + 2

    @property
    def step(self):
        """Inverse depth between two hypotheses, 1/mm."""
        return float(self.inverse_depths[-1] - self.inverse_depths[0]) / (len(self.inverse_depths) - 1)

    def reference_mask(self):
        """Pixels of the box that belong to the reference view, (h, w) bool."""
        (x, y), (width, height) = self.origin, self.size
        return self.masks[0, y : y + height, x : x + width]
