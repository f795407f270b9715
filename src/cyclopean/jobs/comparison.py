"""All routes to a calibration, compared on the same photographs."""

from __future__ import annotations

import csv
import io
import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from rich.table import Table

from ..errors import SetupError
from ..files import output_folder, read_board, read_observations, read_setup, replacing
from ..files.disk import read_bytes
from ..targets import DIRECT, Board, Observations, Target
from .calibration import from_drawing
from .calibration_photographs import detect, find_files, read_pictures
from .calibration_request import Request, check
from .console import console, progress_bars, save_figure

if TYPE_CHECKING:
    from ..calibration.comparison import Comparison, Route
    from ..calibration.routes import FieldPoint
    from ..rigs import Setup

_COLUMNS = (
    "route",
    "time (s)",
    "px",
    "rigid fit (mm)",
    "largest (mm)",
    "% of depth",
    "square (mm)",
    "square (%)",
    "flat (mm)",
)
_THESIS_COLUMNS = ("actual depth (mm)", "recovered depth (mm)", "error (%)", "rms (mm)", "largest (mm)")


@dataclass(frozen=True)
class ComparisonRequest:
    """What the person asked for; see `cyclopean compare-calibrations`."""

    photos: Sequence[Path]
    board: Path
    setup: Path
    output: Path
    camera_photos: Sequence[Path] = ()
    camera_board: Path | None = None
    corners: Path | None = None
    test: Sequence[Path] = ()
    test_board: Path | None = None
    test_depths: str | None = None
    field_point: str | None = None
    folds: int | None = None
    channel: str = "all"


@dataclass(frozen=True, eq=False)
class _Material:
    """What there is to calibrate from and to judge by."""

    found: Observations
    target: Target
    test: Observations | None
    test_target: Target | None
    notes: list[str]


def run_comparison(request: ComparisonRequest) -> None:
    """Detect, calibrate by every route, judge and write; see `cyclopean compare-calibrations`."""
    from ..calibration.comparison import compare

    as_calibration = Request(
        request.photos, request.board, request.setup, request.output / "calibrated.toml",
        camera_photos=request.camera_photos, camera_board=request.camera_board, corners=request.corners,
        channel=request.channel,
    )  # fmt: skip
    check(as_calibration)
    if request.test_board is not None and (not request.test or request.corners is not None):
        raise SetupError("--test-board is the board of the photographs --test: give those as well, and no --corners")
    if request.test and request.folds is not None:
        raise SetupError("--folds leaves photographs out in turn; with --test there is no need: give one of the two")
    setup = read_setup(request.setup)
    folder = output_folder(request.output)
    with progress_bars() as progress:
        if request.corners is not None:
            material = _from_corners(request)
        else:
            material = _from_photographs(request, as_calibration, setup, progress)
        judged = material.found if material.test is None else material.test
        known = _known_depths(request.test_depths, judged)
        comparison = compare(
            material.found,
            material.target,
            setup,
            test=material.test,
            test_target=material.test_target,
            known_depths=known,
            field_point=_field_point(request.field_point, material.found, setup),
            folds=request.folds,
            progress=lambda done, total: progress("calibrating by every route", done, total),
        )
    with console.status("drawing the report"):
        _write(folder, request, comparison, material.notes)
    _say(comparison, material.notes)
    console.print(f"-> {folder}/comparison.json, comparison.png, report.html")


def _from_photographs(request, as_calibration, setup: Setup, progress) -> _Material:
    board = read_board(request.board)
    evidence, calibration = from_drawing(as_calibration, board, setup, progress)
    if not request.test:
        return _Material(evidence.found, evidence.target, None, None, evidence.notes)
    test_board = board if request.test_board is None else read_board(request.test_board)
    if not isinstance(test_board, Board):
        raise SetupError(f"{request.test_board}: points in space cannot be found in photographs")
    files, remarks = find_files(request.test, "--test")
    pictures, copies = read_pictures(
        files, setup.camera.size, evidence.found.photos, progress, "reading test photographs"
    )
    rig = calibration.setup.rig()
    mirrored = [view.mirrored for view in rig]
    test, notes = detect(
        pictures, test_board, rig.masks, mirrored, (request.channel,), progress, "board in the test photographs"
    )
    return _Material(evidence.found, evidence.target, test, test_board, [*evidence.notes, *remarks, *copies, *notes])


def _from_corners(request) -> _Material:
    """Corners of a file; `--test` names photographs in it."""
    board = read_board(request.board)
    found = read_observations(request.corners, board)
    if not request.test:
        return _Material(found, board, None, None, [])
    chosen = [_photo(str(name), found.photos, "--test") for name in request.test]
    rest = [k for k in range(len(found.photos)) if k not in chosen]
    if not rest:
        raise SetupError("--test names every photograph of the corners file: none is left to calibrate from")
    return _Material(found.of_photos(rest), board, found.of_photos(chosen), board, [])


def _photo(name: str, photos: Sequence[str], option: str) -> int:
    """Number of the photograph of this name, with or without its folder."""
    for matches in (
        [k for k, photo in enumerate(photos) if photo == name],
        [k for k, photo in enumerate(photos) if Path(photo).name == Path(name).name],
    ):
        if len(matches) == 1:
            return matches[0]
    some = ", ".join(photos[:4]) + (", ..." if len(photos) > 4 else "")
    raise SetupError(f"{option}: there is no one photograph {name!r}; there are {some}")


def _known_depths(text: str | None, judged: Observations) -> dict[str, float]:
    """Depths (mm) by name of a photograph, of numbers with commas between them or of a CSV file."""
    if text is None:
        return {}
    photos = [judged.photos[k] for k in range(len(judged.photos)) if not _without_optic(judged, k)]
    if text.lower().endswith(".csv"):
        return {photos[_photo(name, photos, text)]: depth for name, depth in _depth_rows(Path(text))}
    depths = [_depth(word, "--test-depths") for word in text.split(",")]
    if len(depths) != len(photos):
        raise SetupError(
            f"--test-depths gives {len(depths)} depths for {len(photos)} photographs that judge: give one for each, or "
            "a CSV file with the columns photo,depth_mm"
        )
    return dict(zip(photos, depths, strict=True))


def _without_optic(observations, photo):
    views = observations.view[observations.photo == photo]
    return bool(len(views)) and bool(np.all(views == DIRECT))


def _depth_rows(path: Path) -> list[tuple[str, float]]:
    """Rows (photo, depth) of a CSV file."""
    try:
        rows = list(csv.reader(io.StringIO(read_bytes(path, SetupError).decode("utf-8-sig"), newline="")))
    except (UnicodeDecodeError, csv.Error):
        raise SetupError(f"{path}: this is no CSV file (UTF-8)") from None
    if [word.strip().lower() for word in rows[0]] != ["photo", "depth_mm"]:
        raise SetupError(f"{path}: line 1: the header must read photo,depth_mm, got {','.join(rows[0])!r:.60}")
    found = []
    for line, row in enumerate(rows[1:], 2):
        if row and len(row) != 2:
            raise SetupError(f"{path}: line {line}: wanted a photograph's name and a depth, got {','.join(row)!r:.60}")
        if row:
            found.append((row[0].strip(), _depth(row[1], f"{path}: line {line}")))
    return found


def _depth(text: str, where: str) -> float:
    try:
        depth = float(text)
    except ValueError:
        depth = float("nan")
    if not 0 < depth < float("inf"):
        raise SetupError(f"{where}: a depth is a number of mm above 0, got {text!r:.40}")
    return depth


def _field_point(text: str | None, found: Observations, setup: Setup) -> FieldPoint | None:
    """The corner nearest to the axis in the photograph that PHOTO,DEPTH names."""
    from ..calibration.routes import FieldPoint, nearest_to_axis

    if text is None:
        return None
    name, comma, depth = text.rpartition(",")
    if not comma:
        raise SetupError(f"--field-point wants PHOTO,DEPTH, for example view_03.png,900, got {text!r:.60}")
    _, pixels = nearest_to_axis(found, setup, _photo(name, found.photos, "--field-point"))
    return FieldPoint(pixels, _depth(depth, "--field-point"))


def _row(comparison: Comparison, route: Route) -> tuple[str, ...]:
    """One route's figures as text."""
    if route.failed:
        return (route.name, *["-"] * (len(_COLUMNS) - 1))
    found = comparison.figures(route)
    return (
        route.name,
        f"{route.seconds:.2f}",
        f"{found.rms:.3f}",
        f"{found.rigid:.3f}",
        f"{found.rigid_max:.2f}",
        f"{found.rigid_percent:.4f}",
        f"{found.square:+.4f}",
        f"{found.square_percent:+.3f}",
        f"{found.flatness:.3f}",
    )


def _bin_rows(comparison: Comparison) -> tuple[tuple[str, ...], list[tuple[str, ...]]]:
    """Columns and rows of the rigid fit of each route in each depth bin, % of depth."""
    routes = [route for route in comparison.routes if not route.failed]
    rows = [
        (name, *(f"{comparison.figures(route, mask).rigid_percent:.4f}" for route in routes))
        for name, mask in comparison.bins()
    ]
    return ("depth", *(route.name for route in routes)), rows


def _known_rows(comparison: Comparison) -> tuple[tuple[str, ...], list[tuple[str, ...]]]:
    """Columns and rows of each route's error (%) of the mean recovered depth at each known depth."""
    routes = [route for route in comparison.routes if not route.failed]
    tables = [comparison.depth_table(route) for route in routes]
    depths = np.unique(comparison.known[np.isfinite(comparison.known)])
    rows = [(f"{z:g} mm", *(f"{table[k].percent:+.3f}" for table in tables)) for k, z in enumerate(depths)]
    totals = np.transpose([comparison.depth_percent(route) for route in routes]) if routes else np.zeros((2, 0))
    rows += [(name, *(f"{x:.3f}" for x in row)) for name, row in zip(("rms (%)", "largest (%)"), totals, strict=True)]
    return ("depth", *(route.name for route in routes)), rows


def _remarks(comparison: Comparison, notes: Sequence[str]) -> list[str]:
    """What went wrong, then what to know."""
    wrong = [f"{route.name}: {route.message}" for route in comparison.routes if route.message]
    return [*wrong, *comparison.notes, *notes]


def _write(folder: Path, request: ComparisonRequest, comparison: Comparison, notes: Sequence[str]) -> None:
    from .. import plotting
    from ..plotting.comparison import comparison_picture

    document = json.dumps(_document(comparison, notes), indent=1, allow_nan=False)
    with replacing(folder / "comparison.json") as file:
        file.write(document.encode())
    picture = comparison_picture(comparison)
    save_figure(picture, folder / "comparison.png")
    tables: dict[str, tuple[Sequence[str], Sequence[Sequence[object]]]] = {
        "All photographs that judged": (_COLUMNS, [_row(comparison, route) for route in comparison.routes]),
        "Rigid fit by depth, % of depth": _bin_rows(comparison),
    }
    if np.isfinite(comparison.known).any():
        tables["Error of the mean recovered depth, %; rms and largest error over all points"] = _known_rows(comparison)
        for route in comparison.routes:
            if not route.failed:
                rows = [
                    (f"{row.depth:g}", f"{row.mean:.2f}", f"{row.percent:+.3f}", f"{row.rms:.3f}", f"{row.largest:.3f}")
                    for row in comparison.depth_table(route)
                ]
                tables[f"Depth by {route.name}"] = (_THESIS_COLUMNS, rows)
    plotting.write_report(
        folder / "report.html",
        f"Calibrations of {request.setup.name} compared",
        f"Each calibrated from {comparison.calibrations} photographs through the optic or more, judged by "
        f"{len(comparison.photos)} that it has not seen. Lengths in mm, of points triangulated from two views or more.",
        tables,
        {"Errors of every route over depth, and its reprojection error": picture},
        _remarks(comparison, notes),
    )


def _document(comparison: Comparison, notes: Sequence[str]) -> dict[str, Any]:
    """Everything as plain data; None where there is no number."""
    photos = zip(comparison.photos, comparison.depths, comparison.known, strict=True)
    routes = []
    for route in comparison.routes:
        bins = {name: comparison.figures(route, mask)._asdict() for name, mask in comparison.bins()}
        routes.append(
            {
                "name": route.name,
                "seconds": route.seconds,
                "converged": route.converged,
                "message": route.message,
                "figures": comparison.figures(route)._asdict(),
                "by_depth": bins,
                "known_depths": [row._asdict() for row in comparison.depth_table(route)],
                "known_depths_percent": dict(zip(("rms", "largest"), comparison.depth_percent(route), strict=True)),
                "photographs": {name: values.tolist() for name, values in asdict(route.judgement).items()},
            }
        )
    return _plain(
        {
            "units": "mm, px; *_percent in %",
            "photographs": [{"name": n, "depth": d, "known_depth": k} for n, d, k in photos],
            "spacing": comparison.spacing,
            "calibrated_from": comparison.calibrations,
            "routes": routes,
            "notes": [*comparison.notes, *notes],
        }
    )


def _plain(value):
    if isinstance(value, dict):
        return {key: _plain(one) for key, one in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(one) for one in value]
    if isinstance(value, float | np.floating):
        return float(value) if np.isfinite(value) else None
    return value


def _say(comparison: Comparison, notes: Sequence[str]) -> None:
    """Tell the person what came out."""
    console.print(
        f"judged by {len(comparison.photos)} photographs that no calibration has seen, the pose of the board fitted:"
    )
    _print_table(_COLUMNS, [_row(comparison, route) for route in comparison.routes])
    if len(comparison.bins()) > 1:
        console.print("\nrigid fit by depth, % of depth:")
        _print_table(*_bin_rows(comparison))
    if np.isfinite(comparison.known).any():
        console.print("\nerror of the mean recovered depth, %, then rms and largest error over all points:")
        _print_table(*_known_rows(comparison))
    for remark in _remarks(comparison, notes):
        console.print(f"note: {remark}", style="yellow")


def _print_table(columns, rows):
    table = Table(box=None, padding=(0, 1, 0, 0))
    table.add_column(columns[0], no_wrap=True)
    for name in columns[1:]:
        table.add_column(name, justify="right", max_width=10)
    for row in rows:
        table.add_row(*row)
    console.print(table)
