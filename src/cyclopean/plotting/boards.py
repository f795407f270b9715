"""Calibration boards for the printer: every length on the page is true."""

from __future__ import annotations

import io
import struct
import zlib
from dataclasses import dataclass
from typing import TYPE_CHECKING
from xml.sax.saxutils import escape

import numpy as np

from ..errors import OutputError

if TYPE_CHECKING:
    from ..targets.boards import Board

PAPERS = {  # mm, portrait; from small to large
    "A4": (210.0, 297.0),
    "A3": (297.0, 420.0),
    "A2": (420.0, 594.0),
    "A1": (594.0, 841.0),
    "A0": (841.0, 1189.0),
}
MARGIN = 4.0  # mm, that printers leave white
STRIP = 8.0  # mm, for the ruler and the caption
_RULERS = (100.0, 50.0, 20.0)  # mm, the longest that the paper takes
_STROKE = 0.2  # mm
_LETTERS = 2.4  # mm, height
_LETTER_WIDTH = 0.62  # of the height, on average
_MM_PER_INCH = 25.4
_MOST_PIXELS = 600_000_000


@dataclass(frozen=True)
class Text:
    """One line of text; x, y is where its baseline begins."""

    x: float  # mm
    y: float  # mm
    height: float  # mm
    text: str
    upwards: bool = False  # reads from bottom to top


@dataclass(frozen=True, eq=False)
class Sheet:
    """What stands on a page, in mm from its top left corner, x right, y down; black on white."""

    size: tuple[float, float]  # mm, width and height
    origin: tuple[float, float]  # mm, where the origin of the board's frame lies
    rectangles: np.ndarray  # (N, 4) x, y, width, height
    circles: np.ndarray  # (M, 3) x, y, radius
    texts: tuple[Text, ...]


def board_sheet(board: Board, paper: str | tuple[float, float] | None = None) -> Sheet:
    """A board with a ruler and a caption on a page.

    Parameters
    ----------
    board : Board
    paper : str or (width, height) mm, optional
        A name of `PAPERS` or "letter", laid either way, or a size as it lies; the smallest of `PAPERS` that holds the
        board where not given.

    Raises
    ------
    OutputError
        When the board is larger than the paper; it says which paper would do.
    """
    rectangles, circles, box = _shapes(board)
    width, height = box[2] - box[0], box[3] - box[1]
    for page in _pages(paper, width > height):
        corner, beside = _corner((width, height), page)
        if corner is not None:
            break
    else:
        raise OutputError(_too_large(width, height, paper))
    origin = corner[0] - box[0], corner[1] - box[1]
    rectangles[:, :2] += origin
    circles[:, :2] += origin
    marks, texts = _strip(page, beside, describe(board))
    return Sheet(page, origin, np.concatenate([rectangles, marks]), circles, texts)


def describe(board: Board) -> str:
    """A board in a line of words."""
    words = [f"{board.kind.replace('_', ' ')} {board.columns} x {board.rows}"]
    side, mark = {"apriltags": ("pitch", "tag")}.get(board.kind, ("square", "marker"))
    if board.kind in ("circles", "asymmetric_circles"):
        words += [f"spacing {board.square:g} mm", f"diameter {board.diameter:g} mm"]
    else:
        words += [f"{side} {board.square:g} mm"] + ([f"{mark} {board.marker:g} mm"] if board.marker else [])
    if board.dictionary is not None:
        words.append(board.dictionary + (" legacy" if board.legacy else ""))
    return ", ".join(([board.name] if board.name else []) + words)


def _shapes(board: Board) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Black rectangles (N, 4), circles (M, 3) and the box x0 y0 x1 y1 to keep free, mm in the board's frame."""
    pitch = board.square
    if board.kind in ("circles", "asymmetric_circles"):
        centres = board.points[:, :2]
        circles = np.column_stack([centres, np.full(len(centres), board.diameter / 2)])
        return np.empty((0, 4)), circles, np.array([*centres.min(0) - pitch, *centres.max(0) + pitch])
    if board.kind == "apriltags":
        gap = pitch - board.marker  # type: ignore[operator]
        crossings = np.stack(np.meshgrid(np.arange(board.columns + 1.0), np.arange(board.rows + 1.0)), -1).reshape(
            -1, 2
        )
        rectangles = np.column_stack([crossings * pitch - gap, np.full((len(crossings), 2), gap)])
        box = np.array([-gap, -gap, board.columns * pitch, board.rows * pitch])
    else:
        column, row = np.meshgrid(np.arange(board.columns), np.arange(board.rows))
        first_is_white = bool(board.shade([1e-3 * pitch, 1e-3 * pitch]))
        black = (column + row) % 2 == first_is_white
        places = np.stack([column[black], row[black]], -1) * pitch
        rectangles = np.column_stack([places, np.full((len(places), 2), pitch)])
        box = np.array([0.0, 0.0, board.columns * pitch, board.rows * pitch])
    return np.concatenate([rectangles, *_markers(board)]), np.empty((0, 3)), box


def _markers(board: Board) -> list[np.ndarray]:
    """The black cells (N, 4) of each marker."""
    if board.dictionary is None:
        return []
    import cv2

    dictionary = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, board.dictionary))
    return [_marker(dictionary, number, corners) for number, corners in enumerate(board.marker_corners)]


def _marker(dictionary, number, corners):
    """The black cells (N, 4) of a marker whose outer corners (4, 2) are given, in runs along its rows."""
    cells = dictionary.markerSize + 2  # a black border of one cell
    picture = dictionary.generateImageMarker(number, cells) < 128
    low, high = corners.min(0), corners.max(0)
    cell = (high - low) / cells
    steps = np.diff(np.pad(picture, ((0, 0), (1, 1))).astype(int), axis=1)
    (rows, starts), (_, ends) = np.nonzero(steps == 1), np.nonzero(steps == -1)
    count = len(rows)
    return np.column_stack(
        [low[0] + starts * cell[0], low[1] + rows * cell[1], (ends - starts) * cell[0], np.full(count, cell[1])]
    )


def _pages(paper, wide):
    """The pages to try, (width, height) mm."""
    if isinstance(paper, tuple):
        return [paper]
    if paper is not None:
        sizes = PAPERS | {"letter": (215.9, 279.4)}
        if paper not in sizes:
            raise OutputError(f"paper {paper!r} is unknown; wanted {', '.join(sizes)} or WIDTHxHEIGHT in mm")
        tried = [sizes[paper]]
    else:
        tried = list(PAPERS.values())
    return [page[::turn] for page in tried for turn in ((-1, 1) if wide else (1, -1))]


def _corner(size, page):
    """Where the top left corner of the board goes on a page, None where it does not fit; and where the ruler does."""
    room = np.array(page) - 2 * MARGIN - size
    for beside, strip in ((False, (0.0, STRIP)), (True, (STRIP, 0.0))):
        left = room - strip
        if (left >= -1e-9).all() and page[1 if beside else 0] - 2 * MARGIN >= _RULERS[-1]:
            return MARGIN + left / 2, beside
    return None, False


def _too_large(width, height, paper):
    needs = (
        f"the board is {width:g} x {height:g} mm, and wants {MARGIN:g} mm around it and {STRIP:g} mm on one side for "
        "the ruler"
    )
    fitting = [
        name
        for name, page in PAPERS.items()
        if any(_corner((width, height), p)[0] is not None for p in (page, page[::-1]))
    ]
    if isinstance(paper, tuple):
        paper = f"{paper[0]:g} x {paper[1]:g} mm"
    where = f"paper {paper} is too small" if paper else "no paper up to A0 is large enough"
    hint = f"; {fitting[0]} would do" if fitting else "; give the paper's size as WIDTHxHEIGHT in mm"
    return f"{needs}: {where}{hint}"


def _strip(page, beside, caption):
    """The ruler's strokes (N, 4) and the texts, along the bottom of the page or up its right side."""
    length = page[1 if beside else 0] - 2 * MARGIN
    ruler = next(size for size in _RULERS if size <= length)
    ticks = np.arange(0, ruler + 1, 10.0)
    tall = np.where(ticks % 50 == 0, 3.0, 1.5)
    strokes = np.column_stack([ticks - _STROKE / 2, -tall, np.full(len(ticks), _STROKE), tall])
    strokes = np.concatenate([[[-_STROKE / 2, -_STROKE, ruler + _STROKE, _STROKE]], strokes])
    words = [(f"{ruler:g} mm", ruler + 2), (f"{caption}; print at 100 %", ruler + 16)]
    texts = []
    for text, start in words:
        room = (length - start) / (_LETTER_WIDTH * _LETTERS)  # letters
        if room > 8:
            shown = text if len(text) <= room / 0.6 else text[: int(room / 0.6) - 3] + "..."
            texts.append((start, _LETTERS * min(1.0, room / len(shown)), shown))
    if beside:  # from bottom to top
        x, y = page[0] - MARGIN, page[1] - MARGIN
        strokes = np.column_stack([x + strokes[:, 1], y - strokes[:, 0] - strokes[:, 2], strokes[:, 3], strokes[:, 2]])
        return strokes, tuple(Text(x, y - start, height, text, True) for start, height, text in texts)
    strokes[:, :2] += (MARGIN, page[1] - MARGIN)
    return strokes, tuple(Text(MARGIN + start, page[1] - MARGIN, height, text) for start, height, text in texts)


def as_svg(sheet: Sheet) -> str:
    """The sheet as SVG, one unit a mm."""
    width, height = sheet.size
    # whole edges, not steps from one to the next, so that cells side by side share theirs and no seams show
    path = "".join(f"M{x:.4f} {y:.4f}H{x + w:.4f}V{y + h:.4f}H{x:.4f}z" for x, y, w, h in sheet.rectangles)
    lines = [
        '<?xml version="1.0" encoding="UTF-8"?>',
        f'<svg xmlns="http://www.w3.org/2000/svg" width="{width:g}mm" height="{height:g}mm" '
        f'viewBox="0 0 {width:g} {height:g}">',
        f'<rect width="{width:g}" height="{height:g}" fill="white"/>',
        f'<path d="{path}" fill="black"/>',
        *(f'<circle cx="{x:.6g}" cy="{y:.6g}" r="{r:.6g}" fill="black"/>' for x, y, r in sheet.circles),
        *(_svg_text(text) for text in sheet.texts),
        "</svg>",
    ]
    return "\n".join(lines) + "\n"


def _svg_text(text: Text) -> str:
    turn = f' transform="rotate(-90 {text.x:.6g} {text.y:.6g})"' if text.upwards else ""
    style = f'font-family="Helvetica, Arial, sans-serif" font-size="{text.height:.4g}"'
    return f'<text x="{text.x:.6g}" y="{text.y:.6g}" {style}{turn}>{escape(text.text)}</text>'


def as_pdf(sheet: Sheet) -> bytes:
    """The sheet as PDF, vectors on a page of its true size."""
    from matplotlib.figure import Figure
    from matplotlib.patches import Circle, PathPatch
    from matplotlib.path import Path

    width, height = sheet.size
    figure = Figure(figsize=(width / _MM_PER_INCH, height / _MM_PER_INCH))
    axes = figure.add_axes((0, 0, 1, 1))
    axes.set_xlim(0, width)
    axes.set_ylim(height, 0)
    axes.set_axis_off()
    x, y, w, h = sheet.rectangles.T
    corners = np.stack([np.stack(pair, -1) for pair in ((x, y), (x + w, y), (x + w, y + h), (x, y + h), (x, y))], 1)
    codes = np.tile([Path.MOVETO, Path.LINETO, Path.LINETO, Path.LINETO, Path.CLOSEPOLY], len(corners))
    style = {"facecolor": "black", "edgecolor": "none", "linewidth": 0}
    axes.add_patch(PathPatch(Path(corners.reshape(-1, 2), codes), **style))  # one path, so that no seams show
    for cx, cy, radius in sheet.circles:
        axes.add_patch(Circle((cx, cy), radius, **style))
    for text in sheet.texts:
        size = text.height * 72 / _MM_PER_INCH
        place = {"rotation": 90, "ha": "right", "va": "bottom"} if text.upwards else {"ha": "left", "va": "baseline"}
        axes.text(text.x, text.y, text.text.replace("$", r"\$"), fontsize=size, **place)
    file = io.BytesIO()
    figure.savefig(
        file, format="pdf", metadata={"CreationDate": None, "Title": sheet.texts[-1].text if sheet.texts else ""}
    )
    return file.getvalue()


def as_picture(sheet: Sheet, dpi: float) -> np.ndarray:
    """The sheet as a grey picture (H, W) uint8: each pixel's share of white, so that edges lie between pixels.

    A point at x, y mm lies at pixel x * dpi / 25.4 - 0.5, and so for y.
    """
    scale = dpi / _MM_PER_INCH
    width, height = (round(length * scale) for length in sheet.size)
    if width * height > _MOST_PIXELS:
        raise OutputError(
            f"{width} x {height} px at {dpi:g} dpi is too large a picture; lower --dpi, or write PDF or SVG"
        )
    picture = np.full((height, width), 255, dtype=np.uint8)
    for x, y, w, h in sheet.rectangles * scale:
        columns, across = _cover(x, x + w, width)
        rows, down = _cover(y, y + h, height)
        black = np.rint(255 * np.outer(down, across)).astype(np.uint8)
        window = picture[rows, columns]
        window -= np.minimum(window, black)
    for x, y, radius in sheet.circles * scale:
        columns, _ = _cover(x - radius - 1, x + radius + 1, width)
        rows, _ = _cover(y - radius - 1, y + radius + 1, height)
        away = np.hypot(np.arange(width)[columns] + 0.5 - x, np.arange(height)[rows, None] + 0.5 - y)
        black = np.rint(255 * np.clip(radius - away + 0.5, 0, 1)).astype(np.uint8)
        window = picture[rows, columns]
        window -= np.minimum(window, black)
    for text in sheet.texts:
        _write(picture, text, scale)
    return picture


def _cover(start, end, size):
    """The pixels that an interval touches, and how much of each it covers."""
    first, last = max(0, int(np.floor(start))), min(size, int(np.ceil(end)))
    edges = np.arange(first, last)
    return slice(first, last), np.clip(np.minimum(edges + 1, end) - np.maximum(edges, start), 0, 1)


def _write(picture, text, scale):
    """Write a line of text into a picture."""
    import cv2

    size = max(int(text.height * scale * 0.75), 4)  # px, of a capital letter
    font = cv2.FONT_HERSHEY_SIMPLEX
    factor = cv2.getFontScaleFromHeight(font, size)
    thick = max(1, round(size / 10))
    shown = text.text.encode("ascii", "replace").decode()
    (width, height), below = cv2.getTextSize(shown, font, factor, thick)
    line = np.full((height + below + thick, width + thick), 255, dtype=np.uint8)
    cv2.putText(line, shown, (0, height), font, factor, 0, thick, cv2.LINE_AA)
    column, row = round(text.x * scale), round(text.y * scale)
    if text.upwards:
        line, column, row = np.rot90(line), column - height, row - line.shape[1]
    else:
        row -= height
    window = picture[max(row, 0) : row + line.shape[0], max(column, 0) : column + line.shape[1]]
    np.minimum(window, line[: window.shape[0], : window.shape[1]], out=window)


def as_png(sheet: Sheet, dpi: float) -> bytes:
    """The sheet as PNG that says its resolution (pHYs), so that it prints at its true size."""
    import cv2

    _, data = cv2.imencode(".png", as_picture(sheet, dpi))
    png = data.tobytes()
    per_metre = round(dpi / _MM_PER_INCH * 1000)
    body = b"pHYs" + struct.pack(">IIB", per_metre, per_metre, 1)
    chunk = struct.pack(">I", len(body) - 4) + body + struct.pack(">I", zlib.crc32(body))
    end_of_header = 8 + 4 + 4 + 13 + 4
    return png[:end_of_header] + chunk + png[end_of_header:]
