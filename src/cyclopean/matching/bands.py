"""Which hypotheses are tried where: a band for each tile of pixels, and how their costs lie in memory."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numba import njit

from ..errors import ShapeError
from .vectors import LANES, transpose

TILE = 32  # px


@dataclass(frozen=True, eq=False)
class Bands:
    """A band of neighbouring hypotheses for each tile of a box of pixels.

    Costs lie in one flat uint8 array, tile after tile in reading order. In a tile lie its pixels row by row, no more
    than the box has; for each pixel the costs of its band side by side, from the first to the last. Each pixel takes
    a multiple of 16 places (`stride`), what is left over is not read. So whole rows of tiles follow one another:
    the costs of a strip of the box are a piece of those of the box.
    """

    size: tuple[int, int]  # (width, height) of the box, px
    depths: int  # hypotheses in all
    tile: int  # width and height of a tile, px
    first: np.ndarray  # (Ty, Tx) int32, the first hypothesis of each tile
    count: np.ndarray  # (Ty, Tx) int32, how many there are, at least one

    def __post_init__(self):
        shape = (-(-self.size[1] // self.tile), -(-self.size[0] // self.tile))
        for name in ("first", "count"):
            array = np.ascontiguousarray(getattr(self, name), np.int32)
            if array.shape != shape:
                raise ShapeError(f"{name} must hold {shape} tiles of {self.tile} px, got {array.shape}")
            object.__setattr__(self, name, array)
        if (self.first < 0).any() or (self.count < 1).any() or (self.first + self.count > self.depths).any():
            raise ShapeError(f"bands must hold at least one and only hypotheses from 0 to {self.depths - 1}")

    @classmethod
    def full(cls, size, depths, tile=TILE, mask=None):
        """All hypotheses everywhere; one in tiles without a pixel of the mask (h, w), where one is given."""
        shape = (-(-size[1] // tile), -(-size[0] // tile))
        count = np.full(shape, depths, np.int32)
        if mask is not None:
            count[~_reduced(mask, tile, np.max, False)] = 1
        return cls(tuple(size), depths, tile, np.zeros(shape, np.int32), count)

    @classmethod
    def around(cls, steps, mask, margin, depths, tile=TILE):
        """Bands about what is known already.

        Parameters
        ----------
        steps : (h, w) float array
            Hypothesis of each pixel, fractions included; NaN unknown.
        mask : (h, w) bool array
            Pixels that take part.
        margin : float
            Hypotheses added on both sides.
        depths : int
            Hypotheses in all.
        tile : int
            Width of a tile, px, a multiple of 4.

        Returns
        -------
        Bands
            From the least to the largest hypothesis of each tile and of a rim a quarter of a tile wide about it.
            A tile of which nothing is known has what its eight neighbours have, and all hypotheses if that is nothing
            too; only where there is no pixel of the mask either, one.
        """
        if tile % 4 or steps.shape != mask.shape:
            raise ShapeError(f"a tile must be a multiple of 4 px, got {tile}; steps and mask must be of one shape")
        known = mask & ~np.isnan(steps)
        with np.errstate(invalid="ignore"):
            low = _reduced(np.where(known, steps, np.inf), tile // 4, np.min, np.inf)
            high = _reduced(np.where(known, steps, -np.inf), tile // 4, np.max, -np.inf)
        low = _reduced(_dilated(low, np.min, np.inf), 4, np.min, np.inf)
        high = _reduced(_dilated(high, np.max, -np.inf), 4, np.max, -np.inf)
        blank = np.isinf(low)
        low = np.where(blank, _dilated(low, np.min, np.inf), low)
        high = np.where(blank, _dilated(high, np.max, -np.inf), high)
        blank, used = np.isinf(low), _dilated(_reduced(mask, tile, np.max, False), np.max, False)
        low = np.where(blank, 0, np.floor(low) - margin)
        high = np.where(blank, np.where(used, depths - 1, 0), np.ceil(high) + margin)
        first = np.clip(np.floor(low), 0, depths - 1).astype(np.int32)
        last = np.clip(np.ceil(high), 0, depths - 1).astype(np.int32)
        return cls(steps.shape[::-1], depths, tile, first, last - first + 1)

    def rounded(self, multiple=LANES):
        """Wider bands, of a multiple of some hypotheses where there are as many: they cost the aggregation nothing."""
        count = np.minimum(-(-self.count // multiple) * multiple, self.depths)
        first = np.clip(self.first - (count - self.count) // 2, 0, self.depths - count)
        return Bands(self.size, self.depths, self.tile, first, count)

    @cached_property
    def stride(self):
        """Places of each pixel of a tile, (Ty, Tx) int32: its hypotheses, rounded up to a multiple of 16."""
        return -(-self.count // LANES) * LANES

    @cached_property
    def start(self):
        """Place at which each tile begins, (Ty, Tx) int64."""
        width, height = (np.minimum(self.tile, n - np.arange(0, n, self.tile)) for n in self.size)
        places = height[:, None] * width * self.stride.astype(np.int64)
        return (np.cumsum(places) - places.ravel()).reshape(places.shape)

    def tiles(self, rows):
        """Rows of tiles that hold some rows of pixels, a slice."""
        if rows.start % self.tile or (rows.stop % self.tile and rows.stop != self.size[1]):
            raise ShapeError(f"strips must begin and end between tiles of {self.tile} px, got {rows}")
        return slice(rows.start // self.tile, -(-rows.stop // self.tile))

    def places(self, rows):
        """Length of the flat array that holds the costs of some rows, whole rows of tiles."""
        top, height = rows.start, rows.stop - rows.start
        high = np.minimum(self.tile, height - np.arange(0, height, self.tile))
        wide = np.minimum(self.tile, self.size[0] - np.arange(0, self.size[0], self.tile))
        tiles = self.tiles(slice(top, rows.stop))
        return int(high @ self.stride[tiles].astype(np.int64) @ wide)


def _reduced(values, factor, reduce, nothing):
    """The least or largest of blocks of factor x factor values."""
    height, width = values.shape
    padded = np.pad(values, ((0, -height % factor), (0, -width % factor)), constant_values=nothing)
    blocks = padded.reshape(padded.shape[0] // factor, factor, padded.shape[1] // factor, factor)
    return reduce(blocks, axis=(1, 3))


def _dilated(values, reduce, nothing):
    """The least or largest of each value and its eight neighbours."""
    padded = np.pad(values, 1, constant_values=nothing)
    return reduce(np.lib.stride_tricks.sliding_window_view(padded, (3, 3)), axis=(2, 3))


@njit(cache=True, nogil=True)
def store(planes, volume, at):
    """Write the costs of one tile, hypothesis by hypothesis, to their places in a flat volume.

    Parameters
    ----------
    planes : (count, rows, columns) uint8 array
        Costs of the tile's band; a view of a larger array will do if its rows lie in order.
    volume : flat uint8 array
        Where they go.
    at : int
        Where the tile begins.
    """
    count, rows, columns = planes.shape
    stride = (count + LANES - 1) // LANES * LANES
    whole, wide = count - count % LANES, columns - columns % LANES
    for y in range(rows):
        line = at + y * columns * stride
        for x in range(0, wide, LANES):
            for k in range(0, whole, LANES):
                transpose(planes, k, y, x, volume, line + x * stride + k, stride)
        for k in range(count):
            for x in range(0 if k >= whole else wide, columns):
                volume[line + x * stride + k] = planes[k, y, x]
