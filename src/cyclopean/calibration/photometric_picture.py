"""What a view ought to show of a board: its drawing, seen along true rays and blurred as a lens and a pixel blur."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numba import njit, prange
from numpy.typing import ArrayLike

from ..errors import SetupError, ShapeError
from ..geometry import Pose
from ..rigs import ViewLike
from ..targets.boards import Board

_SPACING = 8  # px between the nodes at which rays are traced; cubic in between
_REACH = 4.0  # standard deviations beyond which an edge is not felt
_MOST = 12  # lines across one pixel's reach; a print that fine is grey


@dataclass(frozen=True, eq=False)
class Drawing:
    """A print as it was meant: rectangles of black (0) and white (1) between straight lines."""

    x: np.ndarray  # (C + 1,) mm, lines across the board, rising
    y: np.ndarray  # (R + 1,) mm
    cells: np.ndarray  # (R, C) 0 to 1

    @classmethod
    def from_image(cls, image: ArrayLike, width: float, height: float, corner: tuple[float, float] = (0.0, 0.0)):
        """The drawing in an image file that was printed.

        Parameters
        ----------
        image : (H, W) array
            Grey values.
        width, height : float
            Size of the whole image as printed, mm.
        corner : (x, y)
            Where its outer corner lies in the board's frame, mm: negative if the image has a margin.
        """
        image = np.asarray(image)
        if image.ndim != 2:
            raise ShapeError(f"the printed image must be grey, (H, W), got shape {image.shape}")
        dark, bright = float(image.min()), float(image.max())
        if dark == bright:
            raise ShapeError("the printed image is of one grey all over: is it the right file?")
        cells = (image.astype(float) - dark) / (bright - dark)
        columns = np.append(0, np.flatnonzero((cells[:, 1:] != cells[:, :-1]).any(0)) + 1)  # neighbours that are
        rows = np.append(0, np.flatnonzero((cells[1:] != cells[:-1]).any(1)) + 1)  # alike make one cell
        tall, wide = cells.shape
        x = corner[0] + width / wide * np.append(columns, wide)
        y = corner[1] + height / tall * np.append(rows, tall)
        return cls(x, y, np.ascontiguousarray(cells[np.ix_(rows, columns)]))


def draw(board: Board, markers: bool = True) -> Drawing:
    """The drawing of a chessboard or ChArUco board, in the board's frame.

    Parameters
    ----------
    board : Board
        What was printed.
    markers : bool
        Without them, the squares of a ChArUco board alone.

    Raises
    ------
    SetupError
        For a board of another kind, whose points are not where edges cross.
    """
    if board.kind not in ("chessboard", "charuco"):
        raise SetupError(f"only chessboards and ChArUco boards can be aligned by their picture, not {board.kind!r}")
    marker = board.marker or 0.0
    gap, inner = (board.square - marker) / 2, np.zeros(1)
    if board.kind == "charuco" and markers:
        inner = np.append(0.0, gap + marker / (board.bits + 2) * np.arange(board.bits + 3))
    x, y = (
        np.append((board.square * np.arange(count)[:, None] + inner).ravel(), board.square * count)
        for count in (board.columns, board.rows)
    )
    middle_x, middle_y = ((lines[1:] + lines[:-1]) / 2 if markers else lines[:-1] + gap / 2 for lines in (x, y))
    return Drawing(x, y, board.shade(np.stack(np.meshgrid(middle_x, middle_y), -1)).astype(float))


@dataclass(frozen=True, eq=False)
class Prediction:
    """The picture of a board that a view ought to show, black 0 and white 1, in a box of the photograph."""

    corner: tuple[int, int]  # (x, y) of the box's first pixel
    values: np.ndarray  # (h, w) float32
    slopes: np.ndarray  # (2, h, w) float32, change per px in x and in y
    board: np.ndarray  # (2, h, w) float32, where the pixel's ray meets the board, mm; NaN where it does not

    def changed(self, change: Callable[[np.ndarray], np.ndarray]) -> Prediction:
        """The prediction after a linear filter (h, w) -> (h, w)."""
        slopes = np.stack([change(plane) for plane in self.slopes])
        return replace(self, values=change(self.values), slopes=slopes)


def predict_picture(
    view: ViewLike,
    pose: Pose,
    drawing: Drawing,
    corner: tuple[int, int],
    wanted: np.ndarray,
    blur: float,
    shift: Callable[[np.ndarray], np.ndarray] | None = None,
) -> Prediction:
    """The picture of a board as a view ought to show it.

    Parameters
    ----------
    view : view
        Calibrated, without borders.
    pose : Pose
        rig_from_target.
    drawing : Drawing
        In the plane z = 0 of the target.
    corner : (x, y)
        The first pixel of a box in the photograph.
    wanted : (h, w) bool array
        The pixels of the box that are wanted; others are left white.
    blur : float
        Standard deviation of the lens's point-spread function, px; the square pixel comes on top.
    shift : callable, optional
        Pixels (..., 2) -> (..., 2) px: how far the photograph shows everything from where the calibration says.

    Returns
    -------
    Prediction

    Notes
    -----
    A straight edge blurred by a Gaussian is an error function across it, whose width follows from the map between
    pixel and board; the square pixel is four squares, each blurred as much as a Gaussian of its variance.
    """
    (x, y), (height, width) = corner, wanted.shape
    axes = [s + _SPACING * np.arange(-1.0, -(-n // _SPACING) + 3) for s, n in ((x, width), (y, height))]
    nodes = np.stack(np.meshgrid(*axes), -1)
    lattice = _on_board(view.rays(nodes if shift is None else nodes - shift(nodes)), pose)
    values, slopes, board = (np.empty((*n, height, width), np.float32) for n in ((), (2,), (2,)))
    variance = blur**2 + 0.25 / 12
    _paint(lattice, drawing.x, drawing.y, drawing.cells, variance, wanted, values, slopes, board)
    return Prediction((x, y), values, slopes, board)


def _on_board(rays, pose):
    """Where rays (...,) meet the plane z = 0 of the target, (..., 2) mm."""
    origins, directions = pose.inverse @ rays.origins, rays.directions @ pose.rotation
    with np.errstate(divide="ignore", invalid="ignore"):
        distance = -origins[..., 2] / directions[..., 2]
        return np.where(distance[..., None] > 0, (origins + distance[..., None] * directions)[..., :2], np.nan)


@njit(cache=True)
def _cubic(t, weights, slopes):
    """Weights of four nodes around a fraction t, and of the slope (Keys 1981, a = -1/2: exact for parabolas)."""
    weights[0] = ((-0.5 * t + 1.0) * t - 0.5) * t
    weights[1] = (1.5 * t - 2.5) * t * t + 1.0
    weights[2] = ((-1.5 * t + 2.0) * t + 0.5) * t
    weights[3] = (0.5 * t - 0.5) * t * t
    slopes[0] = (-1.5 * t + 2.0) * t - 0.5
    slopes[1] = (4.5 * t - 5.0) * t
    slopes[2] = (-4.5 * t + 4.0) * t + 0.5
    slopes[3] = (1.5 * t - 1.0) * t


@njit(cache=True)
def _reached(lines, place, reach):
    """First line, and number of lines, within reach of a place; lines beyond `_MOST` are left out."""
    first = np.searchsorted(lines, place - reach)
    last = np.searchsorted(lines, place + reach)
    return first, min(last - first, _MOST)


@njit(cache=True)
def _shares(lines, first, count, place, sigma, share, slope):
    """How much of the blurred place each of the cells between the reached lines holds, and how that changes."""
    below = 0.0
    below_slope = 0.0
    for k in range(count):
        u = (lines[first + k] - place) / sigma
        above = 0.5 * (1.0 + math.erf(u * 0.7071067811865476))
        above_slope = -0.3989422804014327 * math.exp(-0.5 * u * u) / sigma
        share[k] = above - below
        slope[k] = above_slope - below_slope
        below, below_slope = above, above_slope
    share[count] = 1.0 - below
    slope[count] = -below_slope


@njit(cache=True)
def _pixel(at, along, down, variance, lines_x, lines_y, cells, shares, out):
    """Value of a pixel, and its change per mm in x and y, into `out`; cells beyond the drawing are white."""
    tall, wide = cells.shape
    share_x, slope_x, share_y, slope_y = shares
    sigma_x = math.sqrt(variance * (along[0] ** 2 + down[0] ** 2)) + 1e-12
    sigma_y = math.sqrt(variance * (along[1] ** 2 + down[1] ** 2)) + 1e-12
    reach = _REACH * sigma_x + 0.25 * (abs(along[0]) + abs(down[0]))
    first_x, count_x = _reached(lines_x, at[0], reach)
    reach = _REACH * sigma_y + 0.25 * (abs(along[1]) + abs(down[1]))
    first_y, count_y = _reached(lines_y, at[1], reach)
    out[:] = 0.0
    parts = 4 if count_x + count_y else 1
    for part in range(parts):
        a = 0.25 - 0.5 * (part % 2) if parts > 1 else 0.0
        b = 0.25 - 0.5 * (part // 2) if parts > 1 else 0.0
        _shares(lines_x, first_x, count_x, at[0] + a * along[0] + b * down[0], sigma_x, share_x, slope_x)
        _shares(lines_y, first_y, count_y, at[1] + a * along[1] + b * down[1], sigma_y, share_y, slope_y)
        for q in range(count_y + 1):
            for p in range(count_x + 1):
                row, column = first_y + q - 1, first_x + p - 1
                inside = 0 <= row < tall and 0 <= column < wide
                cell = cells[row, column] if inside else 1.0
                out[0] += cell * share_y[q] * share_x[p]
                out[1] += cell * share_y[q] * slope_x[p]
                out[2] += cell * slope_y[q] * share_x[p]
    out /= parts


@njit(parallel=True, cache=True)
def _paint(lattice, lines_x, lines_y, cells, variance, wanted, values, slopes, board):
    """Write the picture; node (1, 1) of the lattice is the first pixel."""
    height, width = values.shape
    columns = lattice.shape[1]
    for y in prange(height):
        weights, weights_slope = np.empty(4), np.empty(4)
        line, line_slope = np.zeros((columns, 2)), np.zeros((columns, 2))
        shares, out = np.empty((4, _MOST + 1)), np.empty(3)
        at, along, down = np.empty(2), np.empty(2), np.empty(2)
        j = y // _SPACING
        _cubic(y / _SPACING - j, weights, weights_slope)
        for k in range(4):
            line += weights[k] * lattice[j + k]
            line_slope += weights_slope[k] / _SPACING * lattice[j + k]
        for x in range(width):
            i = x // _SPACING
            _cubic(x / _SPACING - i, weights, weights_slope)
            for axis in range(2):
                at[axis] = along[axis] = down[axis] = 0.0
                for k in range(4):
                    at[axis] += weights[k] * line[i + k, axis]
                    along[axis] += weights_slope[k] / _SPACING * line[i + k, axis]
                    down[axis] += weights[k] * line_slope[i + k, axis]
            board[0, y, x], board[1, y, x] = at[0], at[1]
            out[0], out[1], out[2] = 1.0, 0.0, 0.0
            if wanted[y, x] and not math.isnan(at[0] + at[1]):
                _pixel(at, along, down, variance, lines_x, lines_y, cells, shares, out)
            values[y, x] = out[0]
            slopes[0, y, x] = out[1] * along[0] + out[2] * along[1]
            slopes[1, y, x] = out[1] * down[0] + out[2] * down[1]
