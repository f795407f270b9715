"""Flat boards with a printed pattern, and other known sets of points."""

from __future__ import annotations

import difflib
import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from ..errors import SetupError
from ..geometry.arrays import as_points
from .corners import Surroundings

KINDS = ("charuco", "chessboard", "circles", "asymmetric_circles", "apriltags")

# Bits along a marker's side (without its border) and number of markers of OpenCV's dictionaries.
DICTIONARIES = {
    **{f"DICT_{n}X{n}_{count}": (n, count) for n in (4, 5, 6, 7) for count in (50, 100, 250, 1000)},
    "DICT_ARUCO_ORIGINAL": (5, 1024),
    "DICT_APRILTAG_16h5": (4, 30),
    "DICT_APRILTAG_25h9": (5, 35),
    "DICT_APRILTAG_36h10": (6, 2320),
    "DICT_APRILTAG_36h11": (6, 587),
    "DICT_ARUCO_MIP_36h12": (6, 250),
}
_OVERSAMPLING = 4  # samples per pixel and axis of a drawn board


@dataclass(frozen=True, eq=False)
class PointTarget:
    """Any other known object: its points in its own frame."""

    points: np.ndarray  # (P, 3) mm
    name: str = ""

    def __post_init__(self):
        points = as_points(self.points)
        if points.ndim != 2 or not len(points) or not np.isfinite(points).all():
            raise SetupError(f"a target needs points of shape (P, 3), P > 0, all finite; got shape {points.shape}")
        object.__setattr__(self, "points", points)


@dataclass(frozen=True)
class Board:
    """A flat board.

    The board's frame: x along its columns, y along its rows, z = 0 on the print; seen from the front with x to the
    right, y points down and z away from the viewer. The number of a point is its row in `points`.

    ========================  =================================  ==================================================
    kind                      columns, rows count                points
    ========================  =================================  ==================================================
    ``charuco``               squares                            inner corners, row by row, OpenCV's corner numbers
    ``chessboard``            squares (not inner corners)        inner corners, row by row
    ``circles``               circles                            centres, row by row
    ``asymmetric_circles``    circles of a row; rows             centres; odd rows moved by one spacing
    ``apriltags``             tags                               four corners of tag 0, then of tag 1, ...
    ========================  =================================  ==================================================

    Origin: the outer corner of the first square (charuco, chessboard; that square is black), the centre of the first
    circle, or the corner of tag 0, each at the top left. Asymmetric circles lie at ((2 column + row % 2) square,
    row square). Tag t stands in column t % columns of row t // columns; its corners go (0, 0), (marker, 0),
    (marker, marker), (0, marker) from its own corner. Kalibr prints its tags from the bottom row up: there y points
    up and z towards the viewer, and these numbers hold as they are.
    """

    kind: str  # one of KINDS
    columns: int
    rows: int
    square: float  # mm, side of a square; spacing of circles (see above); pitch of tags
    marker: float | None = None  # mm, side of a marker; diameter of a circle (default: half the square)
    dictionary: str | None = None  # of the markers, OpenCV's name; tags: DICT_APRILTAG_36h11
    legacy: bool = False  # charuco with an even number of rows, drawn by OpenCV before 4.6: the first square is white
    name: str = ""

    def __post_init__(self):
        _check_kind(self.kind)
        _check_counts(self)
        _check_sizes(self)
        object.__setattr__(self, "dictionary", _dictionary(self))
        if self.legacy and self.kind != "charuco":
            raise SetupError(f"legacy belongs to charuco boards only, not to {self.kind}")

    def __str__(self) -> str:
        what = {"apriltags": "tags", "charuco": "squares", "chessboard": "squares"}.get(self.kind, "circles")
        kind = self.kind if self.kind == "chessboard" else f"{self.kind.replace('_', ' ')} board"
        said = f"{kind} of {self.columns} x {self.rows} {what} of {self.marker_or_square:g} mm"
        return f"{said}, {self.dictionary}" if self.dictionary else said

    @property
    def marker_or_square(self) -> float:
        """mm, the size by which one speaks of the pattern: that of a tag, else the square or spacing."""
        return self.side if self.kind == "apriltags" else self.square

    @property
    def grid(self) -> tuple[int, int]:
        """Columns and rows of the points (inner corners, circles); of the tags."""
        if self.kind in ("charuco", "chessboard"):
            return self.columns - 1, self.rows - 1
        return self.columns, self.rows

    @cached_property
    def points(self) -> np.ndarray:
        """Points (P, 3) mm in the board's frame; see the class for their order."""
        columns, rows = self.grid
        column, row = (a.ravel() for a in np.meshgrid(np.arange(columns), np.arange(rows)))
        if self.kind == "apriltags":
            corners = np.array([[0, 0], [1, 0], [1, 1], [0, 1]]) * self.side
            xy = (np.stack([column, row], axis=-1)[:, None] * self.square + corners).reshape(-1, 2)
        elif self.kind == "asymmetric_circles":
            xy = np.stack([2 * column + row % 2, row], axis=-1) * self.square
        else:
            xy = (np.stack([column, row], axis=-1) + (self.kind in ("charuco", "chessboard"))) * self.square
        return np.concatenate([xy, np.zeros((len(xy), 1))], axis=-1).astype(float)

    @property
    def bits(self) -> int:
        """Bits along the side of a marker, without its border."""
        return DICTIONARIES[self.dictionary][0] if self.dictionary else 0

    @property
    def side(self) -> float:
        """mm, of a marker; 0 for boards without markers."""
        return self.marker if self.dictionary and self.marker is not None else 0.0

    @property
    def diameter(self) -> float:
        """mm, of a circle."""
        return self.marker if self.marker is not None else self.square / 2

    @property
    def marker_corners(self) -> np.ndarray:
        """Corners (M, 4, 2) mm of the markers 0, 1, ...: (0, 0), (1, 0), (1, 1), (0, 1) of each."""
        if self.kind == "apriltags":
            return self.points[:, :2].reshape(-1, 4, 2)
        row, column = np.nonzero(self.white_squares)
        first = np.stack([column, row], axis=-1) * self.square + (self.square - self.side) / 2
        return first[:, None] + np.array([[0, 0], [1, 0], [1, 1], [0, 1]]) * self.side

    @property
    def white_squares(self) -> np.ndarray:
        """Which squares are white, (rows, columns) bool; they hold the markers of a charuco board."""
        row, column = np.indices((self.rows, self.columns))
        turned = self.legacy and self.rows % 2 == 0
        return (row + column) % 2 == (0 if turned else 1)

    @cached_property
    def surroundings(self) -> Surroundings:
        """What lies around each point, for boards whose points are corners; tags with black squares between them."""
        marker = self.side
        border = marker / (self.bits + 2)
        if self.kind == "apriltags":
            count = self.columns * self.rows
            tag = np.array([[0, 0, 0, 1], [0, 0, 1, 0], [1, 0, 0, 0], [0, 1, 0, 0]], bool)  # the tag's quadrant
            white = np.array([[0, 1, 1, 0], [1, 0, 0, 1]] * 2, bool)
            extent = min(0.45 * marker, 0.9 * (self.square - marker))
            return Surroundings(np.tile(white, (count, 1)), np.tile(tag, (count, 1)), extent, clear=border)
        squares = self.white_squares
        white = np.stack([squares[:-1, :-1], squares[:-1, 1:], squares[1:, :-1], squares[1:, 1:]], -1).reshape(-1, 4)
        if self.kind == "chessboard":
            return Surroundings(white, np.zeros_like(white), 0.45 * self.square)
        gap = (self.square - marker) / 2
        return Surroundings(white, white, 0.45 * self.square, gap, gap + border)

    @cached_property
    def symmetries(self) -> tuple[np.ndarray, ...]:
        """Turns of the board that its pattern does not show: for each, the number that every point takes, (P,) int.

        The first is no turn at all. Boards with markers have no other.
        """
        found = turns(self.points[:, :2]) if not self.dictionary else [np.arange(len(self.points))]
        if self.kind == "chessboard":
            black = ~self.surroundings.white[:, 0]  # the first quadrant, where a quarter turn brings the other colour
            quarter = [abs(turn[1] - turn[0]) > 1 for turn in found]
            found = [t for t, other in zip(found, quarter, strict=True) if (black[t] == (black ^ other)).all()]
        return tuple(found)

    def shade(self, xy: ArrayLike) -> np.ndarray:
        """Whether the print is white at points (..., 2) mm of the board; (...,) bool."""
        from . import prints

        return prints.shade(self, np.asarray(xy, dtype=float))

    def image(self, pixels_per_mm: float) -> np.ndarray:
        """Picture of the board with a white margin of half a square, (H, W) uint8.

        The board's origin lies at the outer corner of the pixel that `prints.outline` says; edges between pixels
        are grey.
        """
        from . import prints

        if not (math.isfinite(pixels_per_mm) and pixels_per_mm > 0):
            raise SetupError(f"pixels_per_mm must be positive, got {pixels_per_mm}")
        return prints.draw(self, pixels_per_mm, _OVERSAMPLING)


def turns(xy: np.ndarray, reflected: bool = False) -> list[np.ndarray]:
    """Quarter turns of a set of points (P, 2) onto itself: for each, the number that every point takes, (P,) int.

    The first is no turn. With `reflected`, those after a reflection follow.
    """
    centred = xy - (xy.min(0) + xy.max(0)) / 2
    found = []
    for sign in (1, -1) if reflected else (1,):
        for cos, sin in ((1, 0), (0, 1), (-1, 0), (0, -1)):
            turned = centred * [sign, 1] @ np.array([[cos, sin], [-sin, cos]])
            apart = np.linalg.norm(turned[:, None] - centred, axis=-1)
            if apart.min(1).max() < 1e-6 * np.ptp(xy):
                found.append(apart.argmin(1))
    return found


def _check_kind(kind):
    if kind not in KINDS:
        near = difflib.get_close_matches(str(kind), KINDS, n=1, cutoff=0.4)
        hint = f"; did you mean {near[0]!r}?" if near else ""
        raise SetupError(f"kind of board must be one of {', '.join(KINDS)}, got {kind!r}{hint}")


def _check_counts(board):
    least = 4 if board.kind == "chessboard" else 2
    for name in ("columns", "rows"):
        count = getattr(board, name)
        if isinstance(count, bool) or not isinstance(count, (int, np.integer)) or count < least:
            why = " (they count squares, not inner corners)" if board.kind == "chessboard" else ""
            raise SetupError(f"{name} of a {board.kind} must be a whole number, at least {least}{why}; got {count!r}")


def _check_sizes(board):
    for name in ("square", "marker"):
        size = getattr(board, name)
        if size is not None and not (math.isfinite(size) and size > 0):
            raise SetupError(f"{name} must be a positive length in mm, got {size}")
    marked = board.kind in ("charuco", "apriltags")
    if marked and board.marker is None:
        raise SetupError(f"a {board.kind} board needs marker, the side of its markers in mm, smaller than its square")
    if board.kind == "chessboard" and board.marker is not None:
        raise SetupError("a chessboard has no markers: leave marker out, or take kind = 'charuco'")
    room = board.square * (math.sqrt(2) if board.kind == "asymmetric_circles" else 1.0)
    if board.marker is not None and board.marker >= room:
        what = "marker" if marked else "marker (the circles' diameter)"
        raise SetupError(f"{what} must be smaller than {room:g} mm, got {board.marker:g} mm; were the two exchanged?")


def _dictionary(board):
    """The dictionary's name as OpenCV spells it, checked; None for boards without markers."""
    if board.kind not in ("charuco", "apriltags"):
        if board.dictionary is not None:
            raise SetupError(f"a {board.kind} board has no markers: leave dictionary out")
        return None
    given = board.dictionary or ("DICT_APRILTAG_36h11" if board.kind == "apriltags" else "")
    spellings = {name.lower(): name for name in DICTIONARIES}
    spellings |= {name.lower().removeprefix("dict_"): name for name in DICTIONARIES}
    name = spellings.get(str(given).lower())
    if name is None:
        near = difflib.get_close_matches(str(given).upper(), DICTIONARIES, n=3, cutoff=0.5)
        said = f"unknown dictionary {given!r}" if given else "a charuco board needs the dictionary of its markers"
        raise SetupError(f"{said}; take one such as {', '.join(near or ['DICT_4X4_50', 'DICT_5X5_250'])}")
    count = DICTIONARIES[name][1]
    wanted = board.columns * board.rows // (2 if board.kind == "charuco" else 1)
    if wanted > count:
        raise SetupError(
            f"a board of {board.columns} x {board.rows} needs {wanted} markers but {name} has only {count}; "
            "take a larger dictionary or fewer squares"
        )
    return name
