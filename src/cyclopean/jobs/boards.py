"""Boards for the printer."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from ..errors import OutputError, SetupError
from ..files import replacing
from ..files.boards import board_from, read_board, write_board
from ..targets.boards import Board
from .console import console


def draw_board(
    file: Path | None, given: dict[str, Any], output: Path, paper: str | tuple[float, float] | None, dpi: float
) -> None:
    """Draw a board at its true size and, when it was made from options, write its file; see `cyclopean board`."""
    from ..plotting.boards import as_pdf, as_png, as_svg, board_sheet, describe

    ending = output.suffix.lower()
    if ending not in (".pdf", ".svg", ".png"):
        raise OutputError(f"{output}: a board is drawn as .pdf, .svg or .png; name the output so")
    board = _board(file, given)
    sheet = board_sheet(board, paper)
    if ending == ".pdf":
        data = as_pdf(sheet)
    elif ending == ".svg":
        data = as_svg(sheet).encode()
    else:
        data = as_png(sheet, dpi)
    description = output.with_suffix(".toml")
    if file is None:
        _refuse_other_board(description, board)
    with replacing(output) as target:
        target.write(data)
    console.print(f"{describe(board)}")
    at = f", {dpi:g} dpi" if ending == ".png" else ""
    console.print(f"-> {output}: {sheet.size[0]:g} x {sheet.size[1]:g} mm{at}; print at 100 %, then measure the ruler")
    if file is None:
        write_board(description, board)
        console.print(f"-> {description}: the board's file; where the ruler is off, correct its lengths")


def _board(file: Path | None, given: dict[str, Any]) -> Board:
    given = {key: value for key, value in given.items() if value is not None and value is not False}
    if file is not None and given:
        raise SetupError(f"give a board file or the options of a board, not both: {file} and {', '.join(given)}")
    if file is None and not given:
        raise SetupError("which board? name a board file (TOML), or give --kind, --columns, --rows and --square")
    board = read_board(file) if file is not None else board_from({"board": given}, "the options")
    if not isinstance(board, Board):
        raise SetupError(f"{file}: points in space cannot be drawn on paper")
    return board


def _refuse_other_board(path: Path, board: Board) -> None:
    """Leave a file alone that describes something else."""
    if not path.exists():
        return
    try:
        there = read_board(path)
    except SetupError:
        there = None
    if there != board:
        raise OutputError(f"{path} exists and is another board or setup; choose another name for the output")
