"""A drawing sheet in true mm: lines of standard widths, dimensions with arrows, tables, and the title block."""

from __future__ import annotations

import io
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import ArrayLike

from ..errors import OutputError

SHEETS = {"A4": (297.0, 210.0), "A3": (420.0, 297.0)}  # mm, lying
SCALES = (50.0, 20.0, 10.0, 5.0, 2.0, 1.0, 0.5, 0.2, 0.1, 0.05, 0.02)  # of ISO 5455
MARGIN = 8.0  # mm between the edge of the sheet and the frame
TITLE_SIZE = (120.0, 34.0)  # mm
KINDS = (".pdf", ".svg", ".png")

_POINT = 72 / 25.4  # points to a mm
_LINES: dict[str, tuple[float, object]] = {  # width in mm, dashes in mm
    "outline": (0.5, "-"),
    "thin": (0.18, "-"),
    "centre": (0.18, (8.0, 1.5, 1.0, 1.5)),
    "hidden": (0.25, (2.5, 1.2)),
    "phantom": (0.18, (7.0, 1.2, 1.0, 1.2, 1.0, 1.2)),
    "cut": (0.7, "-"),
    "frame": (0.5, "-"),
}
_ARROW = np.array([[0.0, 0.0], [-2.6, 0.45], [-2.6, -0.45]])  # mm, tip first, along +x
_NARROW = 9.0  # mm: dimensions shorter than this have their arrows outside
_CAPITAL = 0.73  # height of a capital letter over the size of the font


@dataclass(frozen=True, eq=False)
class Sheet:
    """An empty sheet; everything is placed in mm from its lower left corner."""

    figure: Figure
    axes: Axes
    size: tuple[float, float]  # mm

    @classmethod
    def of(cls, name: str) -> Sheet:
        """A sheet of this name, with its frame."""
        width, height = SHEETS[name]
        figure = Figure(figsize=(width / 25.4, height / 25.4), dpi=200)
        axes = figure.add_axes((0.0, 0.0, 1.0, 1.0))
        axes.set(xlim=(0, width), ylim=(0, height))
        axes.set_axis_off()
        sheet = cls(figure, axes, (width, height))
        right, top = width - MARGIN, height - MARGIN
        sheet.line([[MARGIN, MARGIN], [right, MARGIN], [right, top], [MARGIN, top], [MARGIN, MARGIN]], "frame")
        return sheet

    def line(self, points: ArrayLike, kind: str = "outline", name: str | None = None) -> None:
        """A line through points (N, 2) of a kind in `_LINES`; `name` is its id in an SVG file."""
        width, dashes = _LINES[kind]
        style = "-" if dashes == "-" else (0, tuple(d / width for d in dashes))  # type: ignore[attr-defined]
        (drawn,) = self.axes.plot(
            *np.asarray(points, dtype=float).T,
            color="black",
            linewidth=width * _POINT,
            linestyle=style,
            solid_joinstyle="round",
            solid_capstyle="round",
            dash_capstyle="butt",
        )
        drawn.get_path().should_simplify = False  # a point left out would be a wrong length
        if name is not None:
            drawn.set_gid(name)

    def segments(self, ends: ArrayLike) -> None:
        """Many short outlines: segments (N, 2, 2) from end to end."""
        from matplotlib.collections import LineCollection

        width = _LINES["outline"][0] * _POINT
        self.axes.add_collection(
            LineCollection(list(np.asarray(ends)), colors="black", linewidths=width, capstyle="round")
        )

    def fill(self, points: ArrayLike, colour: str = "#eaf3f9") -> None:
        """A polygon (N, 2) filled, without an outline."""
        self.axes.fill(*np.asarray(points, dtype=float).T, facecolor=colour, edgecolor="none", zorder=0.5)

    def text(self, place: ArrayLike, text: str, height: float = 2.2, **style) -> None:
        """Text whose capital letters are `height` mm high."""
        style = {"ha": "center", "va": "center", "color": "black", **style}
        x, y = np.asarray(place, dtype=float)
        self.axes.text(x, y, text, fontsize=height * _POINT / _CAPITAL, **style)

    def arrow(self, tip: ArrayLike, direction: ArrayLike) -> None:
        """A filled arrowhead that points along `direction` (2,) at `tip` (2,)."""
        x, y = np.asarray(direction, dtype=float) / np.linalg.norm(direction)
        head = _ARROW @ np.array([[x, y], [-y, x]]) + tip
        self.axes.fill(*head.T, facecolor="black", edgecolor="none", zorder=3)

    def dimension(self, first: ArrayLike, second: ArrayLike, text: str, at: float, upright: bool = False) -> None:
        """A linear dimension between two points (2,).

        It measures along x, with its line at y = `at`; upright it measures along y, with its line at x = `at`.
        Its text stands above the line, or beside it where there is no room between the arrows.
        """
        along = 1 if upright else 0
        points = np.array([first, second], dtype=float)
        points = points[np.argsort(points[:, along])]
        ends = points.copy()
        ends[:, 1 - along] = at
        for point, end in zip(points, ends, strict=True):
            step = np.sign(at - point[1 - along]) * np.eye(2)[1 - along]
            if abs(at - point[1 - along]) > 1.0:
                self.line([point + 0.8 * step, end + 1.5 * step], "thin")
        unit = np.eye(2)[along]
        length = ends[1, along] - ends[0, along]
        narrow, crowded = length < _NARROW, length < text_length(text)
        before, after = 7.0 * unit * narrow, 7.0 * unit * crowded
        self.line([ends[0] - before, ends[1] + after], "thin")
        self.arrow(ends[0], unit if narrow else -unit)
        self.arrow(ends[1], -unit if narrow else unit)
        beside = np.array([-1.0, 0.0]) if upright else np.array([0.0, 1.0])
        place = ends[1] + after + 1.0 * unit if crowded else ends.mean(0) + 0.9 * beside
        across = {"ha": "left", "va": "center"} if crowded else {"va": "bottom"}
        if upright:
            across = {"rotation": 90, **({"ha": "center", "va": "bottom"} if crowded else {"ha": "right"})}
        self.text(place, text, **across)

    def angle(
        self, corner: ArrayLike, radius: float, start_deg: float, end_deg: float, text: str, share: float | None = None
    ) -> None:
        """The angle between two directions at a corner (2,), on an arc of this radius (mm).

        The text stands past the side at `end_deg`, or outside the arc at this share of the way to it.
        """
        corner = np.asarray(corner, dtype=float)
        turn = np.sign(end_deg - start_deg)

        def at(degrees):
            return corner + radius * np.array([np.cos(np.deg2rad(degrees)), np.sin(np.deg2rad(degrees))])

        for side in (start_deg, end_deg):
            self.line([corner, corner + (radius + 2) / radius * (at(side) - corner)], "thin")
        narrow = abs(np.deg2rad(end_deg - start_deg)) * radius < _NARROW
        past = np.degrees(7.0 / radius) * turn
        before, after = past * narrow, past * (narrow or share is None)
        self.line([at(d) for d in np.linspace(start_deg - before, end_deg + after, 90)], "thin")
        for side, sign in ((start_deg, -turn), (end_deg, turn)):
            tangent = np.deg2rad(side) + np.pi / 2
            self.arrow(at(side), (-sign if narrow else sign) * np.array([np.cos(tangent), np.sin(tangent)]))
        if share is None:
            place = at(end_deg + 1.12 * past)
            self.text(place, text, ha="left" if place[0] > at(end_deg)[0] else "right")
            return
        place = at(start_deg + share * (end_deg - start_deg))
        away = (place - corner) / radius
        aside = "left" if away[0] > 0.1 else "right" if away[0] < -0.1 else "center"
        self.text(place + 1.4 * away, text, ha=aside, va="bottom" if away[1] > 0.1 else "top")

    def break_line(self, x: float, low: float, high: float) -> None:
        """An upright line with a zigzag, where a part is broken off between two heights."""
        middle, zigzag = (low + high) / 2, np.array([[0, -0.8], [-1.3, -0.4], [1.3, 0.4], [0, 0.8]])
        self.line([[x, low - 2], *(zigzag + np.array([x, middle])), [x, high + 2]], "thin")

    def balloon(self, place: ArrayLike, text: str, height: float = 2.2) -> None:
        """The name of a face in a circle."""
        self.text(place, text, height, bbox={"boxstyle": "circle,pad=0.15", "fc": "white", "lw": 0.5})

    def table(
        self, corner: tuple[float, float], widths: Sequence[float], rows: Sequence[Sequence[str]], height: float = 4.6,
        letters: float = 1.8, head: bool = True,
    ) -> float:  # fmt: skip
        """A table whose upper left corner stands at `corner`; gives the y of its lower edge. A row may span lines."""
        left, top = corner
        y, total = top, float(np.sum(widths))
        self.line([[left, y], [left + total, y]], "thin")
        for k, row in enumerate(rows):
            lines = max(str(cell).count("\n") + 1 for cell in row)
            deep = height + (lines - 1) * letters * 1.75
            for cell, x in zip(row, left + np.concatenate([[0], np.cumsum(widths)[:-1]]), strict=True):
                bold = {"weight": "bold"} if head and k == 0 else {}
                self.text((x + 1.2, y - deep / 2), str(cell), letters, ha="left", linespacing=1.25, **bold)
            y -= deep
            self.line([[left, y], [left + total, y]], "thin")
        for x in left + np.concatenate([[0], np.cumsum(widths)]):
            self.line([[x, top], [x, y]], "thin")
        return y


def title_block(sheet: Sheet, cells: Mapping[str, str], title: str) -> None:
    """The title block in the lower right corner, with the sign of first-angle projection."""
    width, height = TITLE_SIZE
    right, bottom = sheet.size[0] - MARGIN, MARGIN
    left, top = right - width, bottom + height
    sheet.line([[left, bottom], [left, top], [right, top]], "frame")
    middle = bottom + height - 12
    sheet.line([[left, middle], [right, middle]], "thin")
    sheet.text((left + 2, top - 6), title, 3.5, ha="left")
    names = list(cells)
    columns, rows = 3, -(-len(names) // 3)
    for i, name in enumerate(names):
        column, row = i % columns, i // columns
        x, y = left + column * width * 0.28, middle - row * (middle - bottom) / rows
        sheet.text((x + 1.5, y - 2.4), name, 1.3, ha="left")
        sheet.text((x + 1.5, y - 6.6), cells[name], 2.2, ha="left")
        if column:
            sheet.line([[x, middle], [x, bottom]], "thin")
        if row:
            sheet.line([[left, y], [left + 3 * width * 0.28, y]], "thin")
    sheet.line([[left + 3 * width * 0.28, middle], [left + 3 * width * 0.28, bottom]], "thin")
    _first_angle_sign(sheet, np.array([right - 9.6, (middle + bottom) / 2]))


def _first_angle_sign(sheet, place):
    """A cone from the side, narrow end first, with its end view at the right: first-angle projection."""
    turn = np.linspace(0, 2 * np.pi, 73)
    ring = np.stack([np.cos(turn), np.sin(turn)], -1)
    for radius in (1.6, 3.2):
        sheet.line(place + [4.2, 0] + radius * ring, "thin")
    cone = np.array([[-7.4, -1.6], [-0.8, -3.2], [-0.8, 3.2], [-7.4, 1.6], [-7.4, -1.6]])
    sheet.line(place + cone, "thin")
    for line in ([[-8.4, 0], [0.2, 0]], [[0.3, 0], [8.1, 0]], [[4.2, -4.0], [4.2, 4.0]]):
        sheet.line(place + np.array(line), "thin")


def encoded(figure: Figure, kind: str) -> bytes:
    """A figure as the bytes of a .pdf, .svg or .png file; the same figure gives the same bytes at any time."""
    if kind not in KINDS:
        raise OutputError(f"a drawing is written as {', '.join(KINDS)}, not as {kind or 'a file without ending'}")
    undated = {".pdf": {"CreationDate": None}, ".svg": {"Date": None}, ".png": {}}[kind]
    buffer = io.BytesIO()
    with rc_context({"svg.fonttype": "none", "svg.hashsalt": "cyclopean", "pdf.fonttype": 42}):
        figure.savefig(buffer, format=kind[1:], metadata=undated)
    return buffer.getvalue()


def kind_of(path: Path) -> str:
    """The ending of a path, small."""
    return Path(path).suffix.lower()


def length_text(length: float, tolerance: float) -> str:
    """A length in mm with as many decimals as its tolerance asks for, two at least."""
    decimals = int(np.clip(np.ceil(1 - np.log10(tolerance) - 1e-9), 2, 6))
    return f"{length:.{decimals}f}"


def text_length(text, height=2.2):
    """About how long a text is, mm."""
    return 0.85 * height * len(text) + 2.0


def scale_text(scale: float) -> str:
    """A scale as drawings state it: 2:1, 1:5."""
    return f"{scale:g}:1" if scale >= 1 else f"1:{1 / scale:g}"


def degrees_text(angle: float, short: bool = False) -> str:
    """An angle (rad) in degrees, minutes and seconds, to the nearest second; short: without zeros at its end."""
    seconds = round(abs(np.degrees(angle)) * 3600)
    sign = "-" if angle < 0 and seconds else ""
    if short and seconds % 3600 == 0:
        return f"{sign}{seconds // 3600}°"
    return f"{sign}{seconds // 3600}° {seconds // 60 % 60:02d}' {seconds % 60:02d}\""
