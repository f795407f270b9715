"""Where each reference pixel is seen in the other views, as a function of inverse depth."""

from dataclasses import dataclass

import numpy as np

from ..errors import ShapeError


@dataclass(frozen=True, eq=False)
class Warps:
    """Maps from one reference view into every other view, on a coarse lattice of reference pixels.

    On each node of the lattice the place in another view is a polynomial sum_k c_k s^k of s, which runs from -1 at
    the first inverse depth to +1 at the last; between the nodes the places are bilinear.
    """

    origin: tuple[int, int]  # (x, y) of the reference box's top-left pixel in the photograph
    size: tuple[int, int]  # (width, height) of the reference box
    inverse_depths: np.ndarray  # (D,) 1/mm, ascending and evenly spaced: the hypotheses
    spacing: int  # px between the nodes of the lattice
    coefficients: np.ndarray  # (V-1, C, Ny, Nx, 2, K) float32 px of the photograph; C = 1: all channels alike
    masks: np.ndarray  # (V, H, W) bool, pixels that belong to each view; row 0 is the reference

    def __post_init__(self):
        """Check that the arrays fit together."""
        wanted = (self.masks.shape[0] - 1, *self.lattice, 2)
        shape = self.coefficients.shape
        if len(shape) != 6 or (shape[0], *shape[2:5]) != wanted or 0 in shape:
            views, rows, columns, _ = wanted
            raise ShapeError(
                f"coefficients must have shape (V-1, C, Ny, Nx, 2, K) = ({views}, C, {rows}, {columns}, 2, K), "
                f"got {shape}"
            )
        if len(self.inverse_depths) < 3:
            raise ShapeError(
                f"matching needs at least 3 inverse depths, got {len(self.inverse_depths)}; widen the depth range"
            )

    @property
    def lattice(self) -> tuple[int, int]:
        """Rows and columns of nodes, (Ny, Nx)."""
        rows, columns = (max(length - 2, 0) // self.spacing + 2 for length in self.size[::-1])
        return rows, columns

    @property
    def step(self) -> float:
        """Inverse depth between two hypotheses, 1/mm."""
        return float(self.inverse_depths[-1] - self.inverse_depths[0]) / (len(self.inverse_depths) - 1)

    def reference_mask(self) -> np.ndarray:
        """Pixels of the box that belong to the reference view, (h, w) bool."""
        (x, y), (width, height) = self.origin, self.size
        return self.masks[0, y : y + height, x : x + width]

    def nodes(self, steps: float) -> np.ndarray:
        """Where the nodes are seen at one hypothesis number, fractions allowed: (V-1, C, Ny, Nx, 2) px."""
        s = 2 * steps / (len(self.inverse_depths) - 1) - 1
        return np.polynomial.polynomial.polyval(s, np.moveaxis(self.coefficients, -1, 0))
