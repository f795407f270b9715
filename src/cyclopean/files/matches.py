"""Matches as CSV, and points of sub-images to match.

Points: one row for each, in any order; x and y px in the whole photograph, (0, 0) the centre of the top-left pixel.

view,x,y
0,403.218,250.901

Matches: one row for each. x, y, z and their standard deviations are mm in the camera's frame, residual is px, views
tells how many views show the point and expected how many should; u0 and v0 are the pixel in view 0, empty where that
view does not show the point. Points that were given in one view have a column next_best instead of their ambiguity: the
correlation of the next best place over that of the match. A column point follows where points have names.
"""

from __future__ import annotations

import csv
import io

import numpy as np

from ..correspondence import Matches
from ..errors import SetupError
from .disk import PathLike, read_text, write_csv

_COLUMNS = ("view", "x", "y")


def read_points(path: PathLike, views: int) -> tuple[np.ndarray, ...]:
    """The points (N, 2) px of each of the views, from CSV with the columns view, x, y.

    Raises
    ------
    SetupError
        With the line of the first thing that is wrong.
    """
    reader = csv.reader(io.StringIO(read_text(path, "table of points"), newline=""), skipinitialspace=True)
    found: list[list[tuple[float, float]]] = [[] for _ in range(views)]
    try:
        header = [name.strip().lower() for name in next((row for row in reader if row), [])]
        missing = [name for name in _COLUMNS if name not in header]
        if missing:
            raise SetupError(
                f"{path}: the column {', '.join(missing)} is missing; the header must read {','.join(_COLUMNS)}"
            )
        places = [header.index(name) for name in _COLUMNS]
        for row in reader:
            if row:
                view, x, y = _read_row(row, places, len(header), views, f"{path}: line {reader.line_num}")
                found[view].append((x, y))
    except csv.Error as fault:
        raise SetupError(f"{path}: line {reader.line_num}: this is not CSV: {fault}") from None
    if not any(found):
        raise SetupError(f"{path}: there are no rows below the header")
    return tuple(np.array(rows, dtype=float).reshape(-1, 2) for rows in found)


def _read_row(row, places, length, views, where):
    """View, x and y of one row."""
    if len(row) != length:
        raise SetupError(f"{where}: wanted {length} values, got {len(row)}")
    view_text, *texts = (row[place].strip() for place in places)
    if not (view_text.isascii() and view_text.isdigit() and int(view_text) < views):
        raise SetupError(f"{where}: view = {view_text!r:.40} must be a whole number from 0 to {views - 1}")
    values = []
    for name, text in zip(_COLUMNS[1:], texts, strict=True):
        try:
            values.append(float(text))
        except ValueError:
            values.append(np.nan)
        if not np.isfinite(values[-1]):
            raise SetupError(f"{where}: {name} = {text!r:.40} must be a number of px")
    return int(view_text), values[0], values[1]


def write_matches(path: PathLike, matches: Matches) -> None:
    """Write matches as CSV: pixels to 0.001 px, lengths to 0.0001 mm; an unknown number is an empty cell."""
    named = bool((matches.label >= 0).any())
    views = matches.pixels.shape[1]
    doubt = "next_best" if np.isfinite(matches.next_best).any() else "ambiguity"
    names = ["x", "y", "z", "sigma_x", "sigma_y", "sigma_z", "residual", "views", "expected", doubt]
    names += [name for k in range(views) for name in (f"u{k}", f"v{k}")] + ["point"] * named
    sigma = np.sqrt(np.maximum(np.diagonal(matches.covariance, axis1=1, axis2=2), 0))
    rows = []
    for k in range(len(matches)):
        row = [_number(value, 4) for value in (*matches.points[k], *sigma[k], matches.residual[k])]
        row += [str(matches.views[k]), str(matches.expected[k]), f"{getattr(matches, doubt)[k]:.3g}"]
        row += [_number(value, 3) for value in matches.pixels[k].ravel()]
        rows.append([*row, int(matches.label[k])] if named else row)
    write_csv(path, names, rows)


def _number(value: float, digits: int) -> str:
    return f"{value:.{digits}f}" if np.isfinite(value) else ""
