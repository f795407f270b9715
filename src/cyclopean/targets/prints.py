"""What a board looks like: the shade of every point of its print, and pictures made of it."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ..errors import SetupError

if TYPE_CHECKING:
    from .boards import Board

_MOST = 100e6  # pixels of a drawn board


def outline(board: Board) -> tuple[float, float, float, float]:
    """Left, top, right, bottom (mm, the board's frame) of the print with its margin of half a square."""
    margin = board.square / 2
    if board.kind in ("charuco", "chessboard"):
        left, top, right, bottom = 0.0, 0.0, board.columns * board.square, board.rows * board.square
    else:
        (left, top), (right, bottom) = board.points[:, :2].min(0), board.points[:, :2].max(0)
        reach = board.square - board.side if board.kind == "apriltags" else board.diameter / 2
        left, top, right, bottom = left - reach, top - reach, right + reach, bottom + reach
    return left - margin, top - margin, right + margin, bottom + margin


def draw(board: Board, pixels_per_mm: float, oversampling: int) -> np.ndarray:
    """Picture (H, W) uint8 of the outline, black 0 and white 255, averaged over each pixel."""
    left, top, right, bottom = outline(board)
    width, height = round((right - left) * pixels_per_mm), round((bottom - top) * pixels_per_mm)
    if width * height > _MOST or min(width, height) < 1:
        raise SetupError(f"at {pixels_per_mm:g} pixels per mm the board would have {width} x {height} pixels")
    x = left + (np.arange(width * oversampling) + 0.5) / (oversampling * pixels_per_mm)
    image = np.empty((height, width), np.uint8)
    for row in range(height):
        y = top + (row + (np.arange(oversampling) + 0.5) / oversampling) / pixels_per_mm
        white = shade(board, np.stack(np.broadcast_arrays(x, y[:, None]), axis=-1))
        image[row] = np.rint(255 * white.reshape(oversampling, width, oversampling).mean((0, 2)))
    return image


def shade(board: Board, xy: np.ndarray) -> np.ndarray:
    """Whether the print is white at points (..., 2) mm; (...,) bool."""
    if board.kind in ("circles", "asymmetric_circles"):
        return _circles(board, xy)
    if board.kind == "apriltags":
        return _tags(board, xy)
    cell = np.floor(xy / board.square).astype(int)
    inside = ((cell >= 0) & (cell < [board.columns, board.rows])).all(-1)
    column, row = _indices(cell, inside)
    squares = board.white_squares
    white = ~inside | squares[row, column]
    if board.kind == "charuco":
        numbers = np.cumsum(squares).reshape(squares.shape) - 1
        from_marker = xy - cell * board.square - (board.square - board.side) / 2
        white &= ~(inside & squares[row, column]) | _marker_white(board, numbers[row, column], from_marker)
    return white


def _indices(cell, inside):
    """Column and row of cells (..., 2), 0 for those outside."""
    cell = np.where(inside[..., None], cell, 0)
    return cell[..., 0], cell[..., 1]


def _circles(board, xy):
    """White but within circles: of the lattice points around, one of the nearest is the circle's centre."""
    white = np.ones(xy.shape[:-1], bool)
    wanted = {tuple(place) for place in np.rint(board.points[:, :2] / board.square).astype(int).tolist()}
    columns, rows = np.array(sorted(wanted)).max(0) + 1
    lattice = np.zeros((rows, columns), bool)
    for column, row in wanted:
        lattice[row, column] = True
    nearest = np.floor(xy / board.square).astype(int)
    for step in np.ndindex(2, 2):
        place = nearest + np.array(step)
        inside = ((place >= 0) & (place < [columns, rows])).all(-1)
        column, row = _indices(place, inside)
        covered = ((xy - place * board.square) ** 2).sum(-1) < (board.diameter / 2) ** 2
        white &= ~(inside & lattice[row, column] & covered)
    return white


def _tags(board, xy):
    """Tags at their pitch, and black squares that touch their corners, as Kalibr prints them."""
    cell = np.floor(xy / board.square).astype(int)
    inside = ((cell >= 0) & (cell < [board.columns, board.rows])).all(-1)
    column, row = _indices(cell, inside)
    from_tag = xy - cell * board.square
    white = ~inside | _marker_white(board, row * board.columns + column, from_tag)
    between = (from_tag > board.side).all(-1)  # the square left and above a tag belongs to the cell before it
    near = ((cell >= -1) & (cell < [board.columns, board.rows])).all(-1)
    return white & ~(between & near)


def _marker_white(board, numbers, from_marker):
    """Whether points (..., 2) mm from the markers' corners are white; outside the markers: yes."""
    modules = board.bits + 2
    pictures = marker_pictures(board.dictionary, modules, int(numbers.max(initial=0)) + 1)
    module = np.floor(from_marker * (modules / board.side)).astype(int)
    inside = ((module >= 0) & (module < modules)).all(-1)
    column, row = _indices(module, inside)
    return ~inside | pictures[np.where(inside, numbers, 0), row, column]


def marker_pictures(dictionary: str, modules: int, count: int) -> np.ndarray:
    """The first markers of a dictionary with their black border, (count, modules, modules) bool, True = white."""
    import cv2

    book = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, dictionary))
    return np.stack([book.generateImageMarker(number, modules, borderBits=1) > 127 for number in range(count)])
