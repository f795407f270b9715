"""The print of a board as a paint: exact, since a print is black or white between known lines."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ..errors import SetupError
from ..geometry import Pose, launch
from ..targets.boards import Board
from ..targets.prints import outline
from .paints import as_places, check_reflectance
from .scene import Surface

BLACK, WHITE = 0.05, 0.9
_SAME = 1e-9  # of a square: lines nearer than that are one


@dataclass(frozen=True, eq=False)
class Print:
    """A board's print; places are mm in the board's frame. Outside the pattern it is white."""

    board: Board
    black: float = BLACK  # reflectance of ink
    white: float = WHITE  # of paper

    def __post_init__(self):
        if not isinstance(self.board, Board):
            raise SetupError(f"a print needs a Board, got {type(self.board).__name__}: points in space have no print")
        check_reflectance("black", self.black)
        check_reflectance("white", self.white)

    @property
    def dimensions(self) -> int:
        """2."""
        return 2

    @property
    def channels(self) -> int:
        """1."""
        return 1

    def reflectance(self, places: np.ndarray) -> np.ndarray:
        """(N, 1) at places (N, 2) mm."""
        from .paint_kernels import printed_cells, printed_circles

        places = as_places(places, 2)
        out, levels = np.empty(len(places), np.float32), np.array([self.black, self.white])
        if "circles" in self.board.kind:
            radius = self.board.diameter / 2
            launch(printed_circles, len(places), places, self._lattice, self.board.square, radius**2, levels, out)
        else:
            launch(printed_cells, len(places), places, *self._cells, levels, out)
        return out[:, None]

    @cached_property
    def _cells(self):
        """Lines across and down with their look-up tables, and what lies between them; see `printed_cells`."""
        x, y = _lines(self.board)
        middles = [np.concatenate([b[:1] - 1, (b[1:] + b[:-1]) / 2, b[-1:] + 1]) for b in (x, y)]
        white = self.board.shade(np.stack(np.meshgrid(*middles), axis=-1))
        return (x, *_starts(x), y, *_starts(y), white)

    @cached_property
    def _lattice(self):
        """(rows, columns) bool: at which points of a lattice, one spacing apart, there are circles."""
        column, row = np.rint(self.board.points[:, :2] / self.board.square).astype(int).T
        lattice = np.zeros((row.max() + 1, column.max() + 1), bool)
        lattice[row, column] = True
        return lattice


def _lines(board):
    """Where the print may change along x and y, mm; not for circles."""
    squares, side = np.arange(-1, max(board.columns, board.rows) + 2) * board.square, board.side
    lines = [squares]
    if side:
        modules = np.arange(board.bits + 3) * side / (board.bits + 2)
        start = 0.0 if board.kind == "apriltags" else (board.square - side) / 2
        lines.append((squares[:, None] + start + modules).ravel())
    breaks = np.sort(np.concatenate(lines))
    breaks = breaks[np.append(True, np.diff(breaks) > _SAME * board.square)]
    low = -board.square * (board.kind == "apriltags")  # tags have black squares left of and above them
    return [breaks[(breaks >= low) & (breaks <= count * board.square)] for count in (board.columns, board.rows)]


def _starts(breaks):
    """For even steps from the first break: the first break that may lie behind; and steps for each mm."""
    step = np.diff(breaks).min() / 2
    edges = breaks[0] + step * np.arange(int((breaks[-1] - breaks[0]) / step) + 1)
    return np.maximum(np.searchsorted(breaks, edges - step * _SAME, side="left"), 1), 1 / step


def board_surface(
    board: Board, pose: Pose, black: float = BLACK, white: float = WHITE, name: str = "", luminous: bool = False
) -> Surface:
    """A board with its white margin of half a square, as a surface of two triangles.

    Parameters
    ----------
    board : Board
        What is printed.
    pose : Pose
        rig_from_board, mm.
    black, white : float
        Reflectance of ink and paper.
    name : str
        What messages call it; the board's kind where not given.
    luminous : bool
        Whether it shines by itself.
    """
    left, top, right, bottom = outline(board)
    corners = np.array([[left, top], [right, top], [right, bottom], [left, bottom]])
    vertices = pose @ np.concatenate([corners, np.zeros((4, 1))], axis=1)
    faces = np.array([[0, 2, 1], [0, 3, 2]])
    return Surface(vertices, faces, Print(board, black, white), corners, name or f"{board.kind} board", luminous)
