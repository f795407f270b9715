"""Observations as CSV: bring your own corners, one row for each point that a view shows.

image,view,point,x,y,sigma
board_00.png,0,17,403.218,250.901,0.05
lens_only.png,direct,17,633.020,251.774,0.05

image is the photograph's name, view the number of the sub-image (``direct`` in photographs taken without the optic),
point the row of the target's points, x and y px in the whole photograph, (0, 0) the centre of the top-left pixel.
sigma (px, standard deviation of a coordinate) and channel (of colour) may be left out.
"""

from __future__ import annotations

import csv
import difflib
import io
from collections.abc import Callable, Iterator, Sequence
from itertools import islice

import numpy as np

from ..errors import SetupError
from ..targets import DIRECT, Observations, Target
from .disk import PathLike, read_bytes, write_csv

REQUIRED = ("image", "view", "point", "x", "y")
OPTIONAL = ("sigma", "channel")
_BLOCK = 4096  # rows; many more at once keep the garbage collector busy


def read_observations(path: PathLike, target: Target | None = None) -> Observations:
    """Read observations.

    Parameters
    ----------
    path : path
        A CSV file with a header; photographs are numbered in the order in which the file first names them.
    target : Target, optional
        The board; its number of points bounds the column point.

    Raises
    ------
    SetupError
        With the line and the column of the first thing that is wrong: a missing or unknown column, no number, NaN,
        a point that the target does not have, a point seen twice by one view of one photograph.
    """
    try:
        text = read_bytes(path, SetupError).decode("utf-8-sig")
    except UnicodeDecodeError:
        raise SetupError(f"{path}: this is no text (UTF-8), so it holds no observations") from None
    points = None if target is None else len(target.points)
    blocks = list(_blocks(text, path, points))
    if not blocks:
        raise SetupError(f"{path}: there are no rows below the header")
    table = {name: np.concatenate([block[name] for block in blocks]) for name in blocks[0]}
    photos = tuple(dict.fromkeys(name for block in blocks for name in dict.fromkeys(block["image"].tolist())))
    numbers = {name: k for k, name in enumerate(photos)}
    photo = np.fromiter((numbers[name] for name in table["image"].tolist()), int, len(table["image"]))
    _refuse_twins(photo, table, path)
    pixels = np.stack([table["x"], table["y"]], -1)
    more = {name: table[name] for name in OPTIONAL if name in table}
    return Observations(photo, table["view"], table["point"], pixels, photos, **more)


def _blocks(text: str, path: PathLike, points: int | None) -> Iterator[dict[str, np.ndarray]]:
    """The columns of some thousand rows at a time, with the number of each row's line."""
    reader = csv.reader(io.StringIO(text, newline=""), skipinitialspace=True)
    try:
        names = [name.strip().lower() for name in next((row for row in reader if row), [])]
        _check_header(names, path)
        while block := [(reader.line_num, row) for row in islice(reader, _BLOCK)]:
            rows = [(line, row) for line, row in block if row]  # the others are empty lines
            wrong = next(((line, row) for line, row in rows if len(row) != len(names)), None)
            if wrong is not None:
                wanted = f"{len(names)} values ({', '.join(names)})"
                raise SetupError(f"{path}: line {wrong[0]}: wanted {wanted}, got {len(wrong[1])}")
            if rows:
                columns = dict(zip(names, zip(*(row for _, row in rows), strict=True), strict=True))
                yield _arrays(columns, [line for line, _ in rows], path, points)
    except csv.Error as fault:
        raise SetupError(f"{path}: line {reader.line_num}: this is not CSV: {fault}") from None


def _arrays(columns: dict[str, tuple[str, ...]], lines: list[int], path: PathLike, points: int | None):
    """Columns of text as arrays (N,) of names and numbers."""
    if "" in columns["image"]:
        line = lines[columns["image"].index("")]
        raise SetupError(f"{path}: line {line}: image is empty; wanted a photograph's name")
    from_0 = "a whole number from 0"
    view = f'{from_0}, or "direct" ({DIRECT}) without the optic'
    point = from_0 if points is None else f"{from_0} to {points - 1}, a point of the target"
    arrays = {
        "line": np.array(lines),
        "image": np.array(columns["image"], dtype=object),
        "view": _whole(columns, "view", lines, path, view, _view),
        "point": _whole(columns, "point", lines, path, point, lambda text: _whole_number(text, points)),
        "x": _finite(columns, "x", lines, path),
        "y": _finite(columns, "y", lines, path),
    }
    if "sigma" in columns:
        arrays["sigma"] = _finite(columns, "sigma", lines, path, above_0=True)
    if "channel" in columns:
        arrays["channel"] = _whole(columns, "channel", lines, path, from_0, _whole_number)
    return arrays


def _check_header(names: Sequence[str], path: PathLike) -> None:
    known = (*REQUIRED, *OPTIONAL)
    if len(names) == 1 and any(mark in names[0] for mark in ";\t"):
        raise SetupError(f"{path}: the columns are not separated by commas; the header must read {','.join(REQUIRED)}")
    missing = [name for name in REQUIRED if name not in names]
    unknown = [name for name in names if name not in known]
    hints = "".join(
        f"; {name!r} is unknown"
        + "".join(f", did you mean {like}?" for like in difflib.get_close_matches(name, known, 1))
        for name in unknown
    )
    if missing:
        raise SetupError(
            f"{path}: the column {', '.join(missing)} is missing; the header must read {','.join(known)}{hints}"
        )
    if unknown:
        raise SetupError(f"{path}: the columns are {', '.join(known)}{hints}")
    if len(set(names)) < len(names):
        raise SetupError(f"{path}: a column stands twice in the header: {', '.join(names)}")


def _view(text: str) -> int | None:
    if text.strip().lower() in ("direct", str(DIRECT)):
        return DIRECT
    return _whole_number(text)


def _whole_number(text: str, end: int | None = None) -> int | None:
    """The number that a text stands for, or None."""
    try:
        value = int(text)
    except ValueError:
        return None
    return value if 0 <= value < (2**31 if end is None else end) else None


def _whole(
    columns: dict, name: str, lines: list[int], path: PathLike, wanted: str, parse: Callable[[str], int | None]
) -> np.ndarray:
    """A column of whole numbers (N,): each text that occurs is looked at once."""
    column = columns[name]
    values = {text: parse(text) for text in set(column)}
    wrong = {text for text, value in values.items() if value is None}
    if wrong:
        row = next(k for k, text in enumerate(column) if text in wrong)
        raise SetupError(f"{path}: line {lines[row]}: {name} = {column[row]!r:.60} must be {wanted}")
    return np.array([values[text] for text in column])


def _finite(columns: dict, name: str, lines: list[int], path: PathLike, above_0: bool = False) -> np.ndarray:
    """A column of finite numbers (N,)."""
    column = columns[name]
    try:
        values = np.array([float(text) for text in column])
        wrong = ~np.isfinite(values) | (values <= 0 if above_0 else False)
    except ValueError:
        wrong = np.array([not _is_number(text) for text in column])
    if wrong.any():
        row = int(np.argmax(wrong))
        wanted = "a number of px" + (" above 0" if above_0 else "")
        raise SetupError(f"{path}: line {lines[row]}: {name} = {column[row]!r:.60} must be {wanted}")
    return values


def _is_number(text: str) -> bool:
    try:
        return bool(np.isfinite(float(text)))
    except ValueError:
        return False


def _refuse_twins(photo: np.ndarray, table: dict[str, np.ndarray], path: PathLike) -> None:
    """No view of a photograph may show a point twice."""
    keys = [photo, table["view"], table["point"], table.get("channel", np.zeros_like(photo))]
    order = np.lexsort((np.arange(len(photo)), *keys))
    same = np.all([np.diff(values[order]) == 0 for values in keys], axis=0)
    if same.any():
        first, second = min((int(order[k]), int(order[k + 1])) for k in np.flatnonzero(same))
        view = "direct" if table["view"][first] == DIRECT else table["view"][first]
        raise SetupError(
            f"{path}: lines {table['line'][first]} and {table['line'][second]}: {table['image'][first]}, view {view} "
            f"shows point {table['point'][first]} twice"
        )


def write_observations(path: PathLike, observations: Observations) -> None:
    """Write observations as CSV that `read_observations` turns into the same, to the last digit.

    Photographs without any observation leave no trace; a channel is written where one is other than 0.
    """
    views = ["direct" if view == DIRECT else view for view in observations.view.tolist()]
    columns = [
        [observations.photos[k] for k in observations.photo.tolist()],
        views,
        observations.point.tolist(),
        *observations.pixels.T.tolist(),
        observations.sigma.tolist(),
    ]
    names = [*REQUIRED, "sigma"]
    if observations.channel.any():
        names.append("channel")
        columns.append(observations.channel.tolist())
    write_csv(path, names, zip(*columns, strict=True))
