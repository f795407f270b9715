"""All routes to a calibration, compared on the same photographs."""

from __future__ import annotations

import csv
import io
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from ..errors import SetupError
from ..files import output_folder, read_board, read_observations, read_setup
from ..files.disk import read_bytes
from ..targets import DIRECT, Board, Observations, Target
from .calibration import from_drawing
from .calibration_failure import failure_of
from .calibration_photographs import detect, find_files, read_pictures
from .calibration_request import Request, check
from .comparison_report import say_comparison, write_comparison
from .console import console, counted, progress_bars

if TYPE_CHECKING:
    from ..calibration.comparison import Comparison
    from ..calibration.physical import Calibration
    from ..calibration.routes import FieldPoint
    from ..rigs import Setup

_THREE = ("ray sketch (middle)", "virtual cameras, intrinsics free", "physical model")
_THREE_FOLDS = 2


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
        write_comparison(folder, request.setup.name, comparison, material.notes)
    say_comparison(comparison, material.notes)
    console.print(f"-> {folder}/comparison.json, comparison.png, report.html")


def _from_photographs(request, as_calibration, setup: Setup, progress) -> _Material:
    board = read_board(request.board)
    evidence, calibration = from_drawing(as_calibration, board, setup, progress)
    reason = failure_of(calibration)
    said = [*([f"the photographs do not fit the setup: {reason}"] if reason else []), *evidence.notes]
    if not request.test:
        return _Material(evidence.found, evidence.target, None, None, said)
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
    return _Material(evidence.found, evidence.target, test, test_board, [*said, *remarks, *copies, *notes])


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
            f"--test-depths gives {counted(len(depths), 'depth')} for {counted(len(photos), 'photograph')} to judge "
            "by: give one for each, or a CSV file with the columns photo,depth_mm"
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


def compare_three(request: Request, calibration: Calibration, drawn: Setup | None, progress) -> Comparison:
    """A ray sketch, virtual cameras and the physical model on the photographs of a calibration, in half and half."""
    from ..calibration.comparison import compare

    seen, middle = calibration.observations, len(calibration.setups) // 2
    one = seen.select(seen.channel == middle)
    found = compare(
        replace(one, channel=np.zeros(len(one), dtype=int)),
        calibration.target,
        calibration.unknowns.setups[middle] if drawn is None else drawn,
        _THREE,
        folds=_THREE_FOLDS,
        progress=lambda done, total: progress("comparing three routes", done, total),
    )
    if not (request.free or request.hold or request.tolerance):
        return found
    note = "the physical model of this table finds what is usually found, not what --free, --hold and --tolerance say"
    return replace(found, notes=(*found.notes, note))
