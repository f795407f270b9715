"""What views share at a few depths, on a grid: shares, areas and the largest rectangle about the axis."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

CELLS = 128  # along x and y: what is measured is good to about 1 %

_LATTICE = (233, 144)  # samples of a section, two Fibonacci numbers


@dataclass(frozen=True, eq=False)
class Sections:
    """How many of V views see each cell of a grid at D depths; the grids lie about the optical axis."""

    half: np.ndarray  # (D, 2) mm, half of each grid's width and height
    seen: np.ndarray  # (V, D, C, C) bool, rows along y

    @classmethod
    def of(cls, outlines: list[np.ndarray], cells: int = CELLS) -> Sections:
        """From the outlines (D, M, 2) mm of each view's field; none (M = 0) for a view that sees nothing."""
        depths = len(outlines[0])
        reaches = [np.abs(outline).max(1) for outline in outlines if outline.shape[1]]
        half = np.max(reaches, axis=0) if reaches else np.ones((depths, 2))
        seen = np.zeros((len(outlines), depths, cells, cells), dtype=bool)
        for view, outline in enumerate(outlines):
            if outline.shape[1]:
                seen[view] = _covered(outline / half[:, None], cells)
        return cls(half, seen)

    @property
    def cells_across(self) -> int:
        """C: cells along each side."""
        return self.seen.shape[-1]

    @property
    def counts(self) -> np.ndarray:
        """(D, C, C) int: how many views see each cell."""
        return self.seen.sum(0, dtype=np.int8)

    def areas(self, covered: np.ndarray) -> np.ndarray:
        """Area (D,) mm^2 of the cells (D, C, C) that are True."""
        return 4 * self.half.prod(-1) * covered.mean((1, 2))

    def rectangles(self, covered: np.ndarray, proportions: tuple[float, float] | None = None) -> np.ndarray:
        """Width and height (D, 2) mm of the largest rectangle about the axis on cells (D, C, C) that are True.

        Of all rectangles, or of those of stated proportions (width, height).
        """
        middle = self.cells_across // 2
        quarter = covered & covered[:, ::-1] & covered[:, :, ::-1] & covered[:, ::-1, ::-1]
        quarter = quarter[:, middle:, middle:]
        within = np.logical_and.accumulate(np.logical_and.accumulate(quarter, axis=1), axis=2)
        sides = np.arange(1, middle + 1) / middle
        if proportions is None:
            worth = within * sides[:, None] * sides
        else:
            height, width = (sides * self.half[:, axis, None] / proportions[axis] for axis in (1, 0))
            worth = within * np.minimum(height[:, :, None], width[:, None, :])
        best = worth.reshape(len(worth), -1).argmax(-1)
        row, column = np.unravel_index(best, worth.shape[1:])
        found = worth.reshape(len(worth), -1).max(-1)
        if proportions is not None:
            return 2 * found[:, None] * np.asarray(proportions, dtype=float)
        return 2 * self.half * np.stack([sides[column], sides[row]], -1) * (found > 0)[:, None]

    def cells(self, points: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Where points (D, N, 2) mm lie in arrays (D, C, C): an index; NaN and what lies outside in the rim."""
        place = np.floor((points / self.half[:, None] + 1) * (self.cells_across / 2))
        place = np.clip(np.nan_to_num(place, nan=0.0), 0, self.cells_across - 1).astype(int)
        return np.arange(len(points))[:, None], place[..., 1], place[..., 0]

    def samples(self, covered: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Cells (an index into (D, C, C)) spread evenly over those that are True.

        Places of a Fibonacci lattice, which no seam or border runs along (Niederreiter 1992, Random number generation
        and quasi-Monte Carlo methods, section 5.1).
        """
        count, step = _LATTICE
        down, across = (np.arange(count) + 0.5) / count, (np.arange(count) * step % count + 0.5) / count
        chosen = np.zeros_like(covered)
        for depth, cells in enumerate(covered):
            rows, columns = np.flatnonzero(cells.any(1)), np.flatnonzero(cells.any(0))
            if len(rows):
                place = (down * len(rows)).astype(int), (across * len(columns)).astype(int)
                chosen[depth, rows[place[0]], columns[place[1]]] = True
        return np.nonzero(chosen & covered)  # type: ignore[return-value]

    def points(self, cells: tuple[np.ndarray, np.ndarray, np.ndarray], depths: np.ndarray) -> np.ndarray:
        """Middles (N, 3) mm of cells at the grids' depths (D,)."""
        depth, row, column = cells
        share = (np.stack([column, row], -1) + 0.5) * (2 / self.cells_across) - 1
        return np.concatenate([share * self.half[depth], depths[depth, None]], -1)


def _covered(outlines, cells):
    """(D, cells, cells) bool: cells of a grid over -1..1 whose middle lies inside polygons (D, M, 2).

    Each row of the grid is inside between its leftmost and rightmost crossing: a view's field has no bays.
    """
    middles = (np.arange(cells) + 0.5) * (2 / cells) - 1
    above = outlines[..., 1] > middles[:, None, None]  # (cells, D, M)
    row, depth, edge = np.nonzero(above != np.roll(above, -1, axis=-1))
    x0, y0 = outlines[depth, edge].T
    x1, y1 = outlines[depth, (edge + 1) % outlines.shape[1]].T
    places = x0 + (x1 - x0) * (middles[row] - y0) / (y1 - y0)
    low, high = np.full((2, len(outlines), cells), [[[np.inf]], [[-np.inf]]])
    np.minimum.at(low, (depth, row), places)
    np.maximum.at(high, (depth, row), places)
    return (middles >= low[..., None]) & (middles <= high[..., None])
