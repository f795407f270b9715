"""Boards as TOML files that people write by hand; lengths in mm.

[board]
kind = "charuco"
columns = 14
rows = 10
square = 20.0
marker = 15.0
dictionary = "DICT_5X5_250"

Any other known object: kind = "points", file = "points.csv" with the columns id, x, y, z in mm.
"""

from __future__ import annotations

import csv
import difflib
import io
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from .. import __version__
from ..errors import CyclopeanError, OutputError, SetupError
from ..targets.boards import Board, PointTarget
from .disk import PathLike, parse_toml, read_bytes, read_text, replacing

if TYPE_CHECKING:
    from pydantic_core import ErrorDetails

_LIKENESS = 0.6  # of two keys, by difflib's measure, for one to be a slip of the other


def read_board(path: PathLike) -> Board | PointTarget:
    """Read a board file.

    Parameters
    ----------
    path : path
        A TOML file with the table [board].

    Raises
    ------
    SetupError
        With one line for each thing that is wrong in the file.
    """
    return board_from(parse_toml(read_text(path, "board file"), path), path)


def board_from(document: dict[str, Any], path: PathLike) -> Board | PointTarget:
    """The board that a document, {"board": {...}}, describes; `path` says where it comes from."""
    from pydantic import ValidationError

    from .board_tables import BOARDS, BoardFile

    table = document.get("board")
    kind = table.get("kind") if isinstance(table, dict) else None
    if isinstance(table, dict) and kind not in BOARDS:
        like = difflib.get_close_matches(str(kind), BOARDS, 1)
        hint = f"; did you mean {like[0]!r}?" if like else ""
        said = "board.kind is missing" if kind is None else f"board.kind = {kind!r}"
        raise SetupError(f"{path}: {said}: wanted one of {', '.join(BOARDS)}{hint}")
    try:
        given = BoardFile.model_validate(document).board
    except ValidationError as error:
        faults = [_sentence(detail, kind) for detail in error.errors(include_url=False)]
    else:
        return _built(given.model_dump(), path)
    if len(faults) == 1:
        raise SetupError(f"{path}: {faults[0]}")
    raise SetupError("\n  ".join([f"{path}: {len(faults)} things are wrong", *faults]))


def _sentence(detail: ErrorDetails, kind: Any) -> str:
    """What is wrong with one key, what it takes, and what it may have meant."""
    from .board_tables import BOARDS, BoardFile

    keys = [str(part) for part in detail["loc"] if part not in BOARDS]
    name = ".".join(keys)
    fields = (BoardFile if len(keys) == 1 else BOARDS[kind]).model_fields
    if detail["type"] == "extra_forbidden":
        like = difflib.get_close_matches(keys[-1], fields, 1, _LIKENESS)
        hint = f"did you mean {like[0]}?" if like else f"the known ones are {', '.join(fields)}"
        return f"{name} = {detail['input']!r:.60}: unknown key; {hint}"
    if detail["type"] == "missing":
        return f"{name} is missing: {fields[keys[-1]].description}"
    return f"{name} = {detail['input']!r:.60} must be {fields[keys[-1]].description}"


def _built(given: dict[str, Any], path: PathLike) -> Board | PointTarget:
    if given["kind"] == "points":
        return PointTarget(_read_points(Path(path).parent / given["file"]), name=given["name"])
    try:
        return Board(**given)
    except CyclopeanError as fault:
        raise SetupError(f"{path}: {fault}") from None


def _read_points(path: Path) -> np.ndarray:
    """Points (P, 3) mm of a CSV file with the columns id, x, y, z; id is the row."""
    try:
        rows = list(csv.reader(io.StringIO(read_bytes(path, SetupError).decode("utf-8-sig"), newline="")))
    except (UnicodeDecodeError, csv.Error):
        raise SetupError(f"{path}: this is no CSV file (UTF-8)") from None
    header = [word.strip().lower() for word in rows[0]]
    if header != ["id", "x", "y", "z"]:
        raise SetupError(f"{path}: line 1: the header must read id,x,y,z, got {','.join(rows[0])!r:.60}")
    found: dict[int, list[float]] = {}
    for line, row in enumerate(rows[1:], 2):
        if not row:
            continue
        try:
            number, place = int(row[0]), [float(word) for word in row[1:]]
        except ValueError:
            raise SetupError(
                f"{path}: line {line}: wanted a whole number and three numbers, got {','.join(row)!r:.60}"
            ) from None
        if len(place) != 3 or not np.isfinite(place).all():
            raise SetupError(f"{path}: line {line}: wanted x, y and z in mm, got {','.join(row[1:])!r:.60}")
        if number in found:
            raise SetupError(f"{path}: line {line}: id {number} stands twice")
        found[number] = place
    if not found:
        raise SetupError(f"{path}: there are no points below the header")
    missing = sorted(set(range(len(found))) - set(found))
    if missing:
        raise SetupError(
            f"{path}: {len(found)} points must have the ids 0 to {len(found) - 1}, each once; {missing[0]} is missing"
        )
    return np.array([found[number] for number in range(len(found))])


def write_board(path: PathLike, board: Board | PointTarget) -> None:
    """Write a board file that `read_board` turns into the same board.

    The points of a `PointTarget` go into a CSV file of the same name beside it.
    """
    import tomli_w

    if isinstance(board, Board):
        table = {name: getattr(board, name) for name in ("kind", "columns", "rows", "square", "marker", "dictionary")}
        table |= {"legacy": True} if board.legacy else {}
    else:
        points = Path(path).with_suffix(".csv")
        _write_points(points, board.points)
        table = {"kind": "points", "file": points.name}
    if board.name:
        table["name"] = board.name
    table = {key: value for key, value in table.items() if value is not None}
    text = f"# cyclopean board, written by cyclopean {__version__}; lengths in mm\n\n" + tomli_w.dumps({"board": table})
    with replacing(path) as file:
        file.write(text.encode())


def _write_points(path: Path, points: np.ndarray) -> None:
    points = np.asarray(points, dtype=float)
    if not np.isfinite(points).all():
        raise OutputError(f"{path}: every point of the target must be finite")
    lines = [f"{k},{','.join(map(repr, row))}" for k, row in enumerate(points.tolist())]
    with replacing(path) as file:
        file.write(("\n".join(["id,x,y,z", *lines]) + "\n").encode())
