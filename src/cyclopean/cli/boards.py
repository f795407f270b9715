"""Command ``board``: a calibration board for the printer."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

from cyclopts import Parameter

from ..errors import SetupError
from .app import Whole, app

OutFile = Annotated[Path, Parameter(name=["--output", "-o"])]


@app.command
def board(
    file: Path | None = None,
    *,
    output: OutFile,
    kind: Literal["charuco", "chessboard", "circles", "asymmetric_circles", "apriltags"] | None = None,
    columns: Whole | None = None,
    rows: Whole | None = None,
    square: float | None = None,
    marker: float | None = None,
    dictionary: str | None = None,
    legacy: bool = False,
    paper: str | None = None,
    dpi: float = 600,
) -> None:
    """Draw a calibration board at its true size, with a ruler that checks the printer's scale.

    From a board file, or from options; then the board file is written beside the drawing.

    Parameters
    ----------
    file
        Board file (TOML).
    output
        Drawing to write: .pdf or .svg (vectors), or .png.
    kind
        Kind of board.
    columns
        How many squares (circles, tags) across.
    rows
        How many down.
    square
        Side of a square, or spacing of circles or tags, mm.
    marker
        Side of a marker or tag, diameter of a circle, mm.
    dictionary
        OpenCV's name of the markers, for example DICT_5X5_250.
    legacy
        A ChArUco board as OpenCV before 4.6 made it.
    paper
        A4, A3, A2, A1, A0, letter, or WIDTHxHEIGHT in mm; the smallest of A4 to A0 that holds the board without it.
    dpi
        Resolution of a .png, dots per inch.
    """
    from ..jobs.boards import draw_board

    if not 10 <= dpi <= 10_000:
        raise SetupError(f"--dpi wants a number from 10 to 10000, got {dpi:g}")
    given = {
        "kind": kind, "columns": columns, "rows": rows, "square": square, "marker": marker, "dictionary": dictionary,
        "legacy": legacy,
    }  # fmt: skip
    draw_board(file, given, output, parse_paper(paper), dpi)


def parse_paper(text: str | None) -> str | tuple[float, float] | None:
    """The name of a paper, or the size (width, height) mm that WIDTHxHEIGHT stands for."""
    if text is None:
        return None
    parts = text.lower().split("x")
    try:
        width, height = (float(part) for part in parts)
    except ValueError:
        return text.upper() if text.lower() != "letter" else "letter"
    if not (0 < width < 10_000 and 0 < height < 10_000):
        raise SetupError(f"--paper wants WIDTHxHEIGHT in mm, both between 0 and 10000, got {text!r}")
    return width, height
