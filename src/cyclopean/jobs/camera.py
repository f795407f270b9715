"""From photographs of a board without the optic to the real camera."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from rich.table import Table

from ..errors import ImageError, SetupError
from ..files import output_folder, read_board, read_observations, write_observations
from ..files.exchange import write_camera
from ..targets import DIRECT, Board, Observations, PointTarget
from .calibration_photographs import detect, find_files, read_pictures
from .console import console, progress_bars, save_figure

if TYPE_CHECKING:
    from ..calibration import CameraCalibration, TsaiCalibration
    from ..cameras import Camera

TERMS = {"zhang": (0, 2, 4, 5), "tsai": (0, 1, 2)}
USUAL = {"zhang": 5, "tsai": 1}
COLUMNS = ("parameter", "found", "sigma", "unit")
_LITTLE_TILT_DEG = 15.0
_SHOWN = 5  # notes at the terminal; the report has all


@dataclass(frozen=True)
class CameraRequest:
    """What the person asked for; see `cyclopean camera`."""

    photos: Sequence[Path]
    board: Path
    method: str
    distortion: int | None
    corners: Path | None
    size: tuple[int, int] | None
    output: Path
    report: Path | None

    @property
    def terms(self) -> int:
        """How many terms of distortion to find."""
        return USUAL[self.method] if self.distortion is None else self.distortion


@dataclass(frozen=True, eq=False)
class CameraFindings:
    """A camera, and what there is to say about it."""

    camera: Camera
    rows: list[tuple[str, str, str, str]]  # as `COLUMNS`
    seen: Observations
    residuals: np.ndarray  # (N, 2) px, of `seen`
    rms: float  # px
    notes: list[str]


def run_camera(request: CameraRequest) -> None:
    """Detect, calibrate, tell and write; see `cyclopean camera`."""
    _check(request)
    board = read_board(request.board)
    output_folder(request.output.absolute().parent)
    if request.report is not None:
        output_folder(request.report)
    seen, size, notes = _evidence(request, board)
    found = _by_zhang(request, board, seen, size) if request.method == "zhang" else _by_tsai(request, board, seen, size)
    shown = len(np.unique(seen.photo))
    photos = f"{shown} photograph{'s' if shown > 1 else ''}"
    console.print(f"{len(seen):,} corners in {photos}, residuals {found.rms:.3g} px rms")
    table = Table(*COLUMNS, box=None)
    table.columns[1].justify = table.columns[2].justify = "right"
    for row in found.rows:
        table.add_row(*row)
    console.print(table)
    notes += found.notes
    for note in notes[:_SHOWN] if request.report else notes:
        console.print(f"note: {note}", style="yellow")
    write_camera(request.output, found.camera, f"{photos} ({request.method})")
    if request.report is not None:
        _write_report(request, found, notes)
    console.print(f"-> {request.output}{f', report in {request.report}/report.html' if request.report else ''}")


def _check(request):
    """Options that do not go together."""
    if request.corners is not None and request.photos:
        raise SetupError("give photographs or --corners, not both: the corners file holds what photographs show")
    if request.corners is None and not request.photos:
        raise SetupError("which photographs? name those of the board without the optic, or their folder, or --corners")
    if (request.corners is None) != (request.size is None):
        raise SetupError("--corners and --size go together: photographs say their size themselves, corners do not")
    if request.terms not in TERMS[request.method]:
        raise SetupError(
            f"--distortion with --method {request.method} must be one of {', '.join(map(str, TERMS[request.method]))}, "
            f"got {request.distortion}"
        )
    if request.output.suffix.lower() != ".toml":
        raise SetupError(f"{request.output}: the camera is a .toml file; name the output so")
    if request.output.absolute() == request.board.absolute():
        raise SetupError(f"{request.output}: the output would overwrite the board file; choose another name")


def _evidence(request, board: Board | PointTarget) -> tuple[Observations, tuple[int, int], list[str]]:
    """Corners seen without the optic, the size of the photographs, and notes."""
    if request.corners is not None:
        seen = read_observations(request.corners, board)
        direct = seen.select(seen.view == DIRECT)
        if not len(direct):
            raise SetupError(
                f'{request.corners}: no row is of a photograph without the optic; there, the column view says "direct"'
            )
        lost = len(seen) - len(direct)
        return direct, request.size, [f"{lost:,} corners seen through the optic: left out"] if lost else []
    if not isinstance(board, Board):
        raise SetupError(f"{request.board}: points cannot be found in photographs; give them with --corners and --size")
    files, notes = find_files(request.photos, "camera")
    if request.method == "tsai" and len(files) > 1:
        raise _one_photograph(len(files))
    with progress_bars() as progress:
        pictures, copies = read_pictures(files, None, (), progress)
        seen, said = detect(pictures, board, None, None, ("all",), progress, "board")
    return seen, pictures.size, [*notes, *copies, *said]


def _one_photograph(count):
    return ImageError(
        f"Tsai's method takes one photograph, got {count}: name the one with the most tilted board (30 degrees or "
        "more), or use all of them with --method zhang"
    )


def _by_zhang(request, board, seen, size) -> CameraFindings:
    from ..calibration.zhang import zhang

    if len(np.unique(seen.photo)) < 2:
        raise ImageError(
            f"Zhang's method takes photographs of the board from several sides, but only {seen.photos[seen.photo[0]]} "
            "shows it: take ten, tilted by 20 to 40 degrees to different sides, or use --method tsai for this one"
        )
    found = zhang(seen, board, size, request.terms)
    notes = list(found.notes)
    if isinstance(board, Board):  # its plane is z = 0
        normals = np.array([pose.rotation[:, 2] for pose in found.poses])
        normals = normals[np.isfinite(normals).all(-1)]
        turns = np.degrees(np.arccos(np.clip(np.abs(normals @ normals.T), 0, 1)))
        notes += _tilt_notes(float(turns.max()), "against each other")
    notes += [] if found.converged else [f"not converged: {found.message}"]
    return CameraFindings(found.camera, zhang_rows(found), seen, found.residuals, found.rms, notes)


def _tilt_notes(tilt_deg, against):
    """What to say where boards lean so little that the focal length hangs on the detector's smallest errors."""
    if not tilt_deg < _LITTLE_TILT_DEG:
        return []
    return [
        f"the board leans by {tilt_deg:.1f} degrees at most {against}: errors that corners share then move the focal "
        "length by more than its sigma; tilt by 20 to 40 degrees"
    ]


def zhang_rows(found: CameraCalibration) -> list[tuple[str, str, str, str]]:
    """The parameters as texts."""
    from ..cameras.camera import CAMERA_PARAMETERS

    units = ["px"] * 4 + [""] * 5
    return [
        _row(*one)
        for one in zip(CAMERA_PARAMETERS, found.camera.lens.tolist(), found.sigma.tolist(), units, strict=True)
    ]


def _by_tsai(request, board, seen, size) -> CameraFindings:
    from ..calibration.tsai import tsai

    photos = np.unique(seen.photo)
    if len(photos) > 1:
        raise _one_photograph(len(photos))
    found = tsai(board.points[seen.point], seen.pixels, size, distortion=request.terms)
    brown = found.camera.brown()
    notes = [
        "Tsai's method takes the principal point as mid-image and the pixels as square; what that is wrong by goes "
        "into focal length and pose, and is in no sigma",
        *found.notes,
        *_tilt_notes(found.tilt_deg, "against the picture"),
    ]
    if request.terms:
        notes.append(
            "the camera file holds k1 k2 k3 of our lens model, whose distortion leads the other way than Tsai's: over "
            f"the picture they depart by {brown.departure_rms:.4f} px rms, {brown.departure_max:.4f} px at most"
        )
    if not found.converged:
        notes.append(f"not converged: {found.message}")
    return CameraFindings(brown.camera, tsai_rows(found), seen, found.residuals, found.rms, notes)


def tsai_rows(found: TsaiCalibration) -> list[tuple[str, str, str, str]]:
    """The parameters as texts: Tsai's own lens, and how far and how tilted the board stood."""
    lens, sigma = found.camera, found.sigma
    rows = [
        _row("focal", lens.focal, sigma["focal"], "px"),
        _row("k1 (Tsai's)", lens.k1, sigma.get("k1", 0.0), "1/px^2"),
        _row("k2 (Tsai's)", lens.k2, sigma.get("k2", 0.0), "1/px^4"),
        _row("centre_x", lens.centre[0], 0.0, "px"),
        _row("centre_y", lens.centre[1], 0.0, "px"),
        _row("distance of the board's origin", float(found.camera_from_target.translation[2]), sigma["move_z"], "mm"),
    ]
    if np.isfinite(found.tilt_deg):
        rows.append(("tilt of the board", f"{found.tilt_deg:.2f}", "", "deg"))
    return rows


def _row(name, value, sigma, unit):
    """A value with as many digits as its sigma has; one without a sigma was held."""
    if not sigma > 0:
        return name, f"{value:g}", "held", unit
    if sigma < 1e-7:
        return name, f"{value:.3e}", f"{sigma:.1e}", unit
    digits = int(np.clip(1 - np.floor(np.log10(sigma)), 0, 8))
    return name, f"{round(value, digits) + 0.0:.{digits}f}", f"{sigma:.{digits}f}", unit


def _write_report(request, found: CameraFindings, notes: list[str]) -> None:
    from .. import plotting
    from ..plotting.camera import camera_picture

    folder = request.report
    write_observations(folder / "corners.csv", found.seen)
    figure = camera_picture(found.camera.size, found.seen.pixels, found.residuals)
    save_figure(figure, folder / "residuals.png")
    plotting.write_report(
        folder / "report.html",
        f"Camera: {request.output.name}",
        f"{len(found.seen):,} corners, residuals {found.rms:.3g} px rms, method {request.method}. Sigma is a standard "
        "deviation, for corners that err independently.",
        {"Parameters": (COLUMNS, found.rows), "Photographs": photo_table(found)},
        {"Residuals: observed minus predicted pixels": figure},
        notes,
    )


def photo_table(found: CameraFindings) -> tuple[tuple[str, ...], list[tuple[str, str, str]]]:
    """Corners and residuals of each photograph."""
    rows = []
    for k, name in enumerate(found.seen.photos):
        mine = found.residuals[found.seen.photo == k]
        known = mine[np.isfinite(mine).all(-1)]
        size = f"{np.sqrt(np.mean(np.sum(known**2, -1))):.3g}" if len(known) else "-"
        rows.append((name, str(len(mine)), size))
    return ("photograph", "corners", "residuals (px rms)"), rows
