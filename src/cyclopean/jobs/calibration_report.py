"""What a calibration found, for the person: lines at the terminal, pictures and a page."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from rich.table import Table

from ..errors import CyclopeanError
from ..files import replacing
from ..files.calibrations import write_calibration
from ..targets import DIRECT
from .calibration_photographs import COLOURS
from .console import console

if TYPE_CHECKING:
    from ..calibration.depths import DepthErrors
    from ..calibration.guidance import Guidance
    from ..calibration.physical import Calibration
    from ..calibration.validation import Validation
    from .calibration_request import Request

_SHOWN = 5  # notes of the detector at the terminal; the report has all
_ADVISED = 3
_DEPTHS = 5
DEPTH_COLUMNS = ("depth (mm)", "by noise (mm)", "by calibration (mm)", "both (mm)", "largest (mm)")
HELD_OUT_COLUMNS = (
    "depth",
    "photographs",
    "residuals (px)",
    "flatness (mm)",
    "spacing off (%)",
    "+- (%)",
    "shape (mm)",
)
_HELD_OUT = "photographs left out of the calibration: residuals, and points triangulated from them against the board"


@dataclass(frozen=True, eq=False)
class Findings:
    """A calibration and what was found out about it."""

    calibration: Calibration
    notes: Sequence[str]  # of the detector
    warnings: Sequence[str]  # what looks wrong
    open: Sequence[str]  # what the photographs do not determine
    errors: DepthErrors | None
    validation: Validation | None
    guidance: Guidance | None

    @property
    def middle(self) -> int:
        """The colour channel that stands for all: green of red, green and blue."""
        return len(self.calibration.setups) // 2


def say_calibration(request: Request, calibration: Calibration, notes: Sequence[str], seconds: float) -> None:
    """What went in, how well it fits, and the parameters."""
    for note in notes[:_SHOWN]:
        console.print(f"note: {note}")
    if len(notes) > _SHOWN:
        console.print(f"note: {len(notes) - _SHOWN} more like these are in the report")
    seen, solution = calibration.observations, calibration.solution
    counts = ", ".join(f"{name}: {count:,}" for name, count in view_counts(calibration))
    photos = f"{len(seen.photos)} photograph{'s' if len(seen.photos) > 1 else ''}"
    console.print(f"{len(seen):,} corners in {photos} ({counts})")
    console.print(
        f"residuals {calibration.rms:.3g} px rms, {solution.sigma0:.3g} times the detector's noise; "
        f"{calibration.outliers.sum()} outliers; {seconds:.0f} s"
    )
    start = "drawing" if request.setup is not None else "start"
    table = Table("parameter", box=None)
    for column in (start, "found", "sigma"):
        table.add_column(column, justify="right")
    table.add_column("unit")
    for row in parameter_rows(calibration):
        table.add_row(*row)
    console.print(table)


def view_counts(calibration: Calibration) -> list[tuple[str, int]]:
    """How many points each view shows."""
    views, counts = np.unique(calibration.observations.view, return_counts=True)
    names = ["without the optic" if view == DIRECT else f"view {view}" for view in views]
    return list(zip(names, map(int, counts), strict=True))


def parameter_rows(calibration: Calibration) -> list[tuple[str, str, str, str, str]]:
    """Rows (name, start, value, sigma, unit), with as many digits as sigma has."""
    rows = []
    for name, start, value, sigma, unit in calibration.table():
        if len(calibration.setups) == len(COLOURS):
            name = re.sub(r"\[(\d)\]$", lambda number: f" ({COLOURS[int(number[1])]})", name)
        digits = int(np.clip(1 - np.floor(np.log10(sigma)), 0, 8)) if 0 < sigma < np.inf else 4
        rows.append(
            (
                name,
                f"{round(start, 4) + 0.0:.{min(digits, 4)}f}",
                f"{round(value, digits) + 0.0:.{digits}f}",
                f"{sigma:.{digits}f}",
                unit,
            )
        )
    return rows


def judge(request: Request, calibration: Calibration, notes: Sequence[str], progress) -> Findings:
    """Find out how far a calibration can be trusted, telling the person each thing as it is known."""
    from ..calibration.trust import correlated, undetermined, warnings_of

    warnings = [*calibration.notes, *_alone(calibration), *warnings_of(calibration)]
    unknown = [*(direction.text for direction in undetermined(calibration)), *correlated(calibration)]
    for text in warnings:
        console.print(f"warning: {text}", style="yellow")
    for text in unknown:
        console.print(f"open: {text}", style="yellow")
    errors = validation = guidance = None
    middle = len(calibration.setups) // 2
    try:
        errors = _depth_errors(request, calibration, middle)
        say_table(depth_title(errors), DEPTH_COLUMNS, depth_rows(errors))
    except CyclopeanError as fault:
        if not any(str(fault) in text for text in warnings):
            warnings.append(f"no errors of depth: {fault}")
            console.print(f"warning: {warnings[-1]}", style="yellow")
    if request.validate and len(calibration.observations.photos) > 1:
        validation = _validation(calibration, warnings, progress)
    if request.guide and errors is not None:
        guidance = _guidance(request, calibration, middle)
    return Findings(calibration, notes, warnings, unknown, errors, validation, guidance)


def _alone(calibration):
    """What to say of one photograph that is to tell the camera, too."""
    seen = calibration.observations
    lens = [name for name in calibration.unknowns.names if name.startswith("camera.")]
    if len(seen.photos) > 1 or not lens:
        return []
    return [
        f"from one photograph, the camera ({', '.join(lens)}) and the optic are found together and cannot be checked: "
        "hold the camera, or add --camera-photos"
    ]


def _depth_errors(request, calibration, channel):
    from ..calibration.trust import depth_errors

    depths = request.depths or calibration.setup.depths
    places = None if depths is None else np.linspace(depths[0], depths[1], _DEPTHS)
    return depth_errors(calibration, places, channel=channel)


def _validation(calibration, warnings, progress):
    from ..calibration.validation import validate

    try:
        found = validate(calibration, progress=lambda done, total: progress("leaving photographs out", done, total))
    except CyclopeanError as fault:
        warnings.append(f"no validation: {fault}")
        console.print(f"warning: {warnings[-1]}", style="yellow")
        return None
    say_table(_HELD_OUT, HELD_OUT_COLUMNS, held_out_rows(found))
    return found


def _guidance(request, calibration, channel):
    from ..calibration.guidance import guide

    depths = request.depths or calibration.setup.depths
    try:
        found = guide(
            calibration,
            None if depths is None else np.linspace(depths[0], depths[1], 3),
            count=_ADVISED,
            channel=channel,
        )
    except CyclopeanError as fault:
        console.print(f"note: no advice on further photographs: {fault}")
        return None
    console.print(f"\n{found.text}")
    return found


def say_table(title: str, columns: Sequence[str], rows: Iterable[Sequence[str]]) -> None:
    """Print a table with a line above it."""
    table = Table(*columns, box=None)
    for column in table.columns[1:]:
        column.justify = "right"
    for row in rows:
        table.add_row(*row)
    console.print(f"\n{title}")
    console.print(table)


def depth_title(errors: DepthErrors) -> str:
    """What the table of depth errors shows."""
    return f"standard deviation of depth, rms over the common field, for pixels matched to {errors.pixel_sigma:g} px"


def depth_rows(errors: DepthErrors) -> list[tuple[str, ...]]:
    """The table of depth errors as texts."""
    return [(f"{depth:.0f}", *(f"{value:.3g}" for value in parts)) for depth, *parts in errors.table()]


def held_out_rows(validation: Validation) -> list[tuple[str, ...]]:
    """The table of the validation as texts."""
    return [
        tuple(
            text.replace("+nan", "-").replace("nan", "-")
            for text in (name, str(photos), f"{px:.3g}", f"{flat:.3g}", f"{mean:+.3f}", f"{spread:.2g}", f"{shape:.3g}")
        )
        for name, photos, px, flat, mean, spread, shape in validation.table()
    ]


def write_findings(request: Request, findings: Findings) -> None:
    """Write calibration.json, then the pictures, then the page."""
    from .. import plotting
    from ..plotting import calibration as drawing

    folder, calibration = request.folder, findings.calibration
    write_calibration(folder / "calibration.json", calibration, document_of(request, findings))
    held_out = None if findings.validation is None else findings.validation.photo_rms
    figures = {
        "residuals": ("Residuals: observed minus predicted pixels", drawing.residual_picture(calibration)),
        "coverage": ("Where the board was seen", drawing.coverage_picture(calibration)),
        "photos": ("Residuals of each photograph", drawing.photo_picture(calibration, held_out)),
    }
    if findings.errors is not None:
        caption = "Standard deviation of triangulated depth, by noise and calibration together"
        figures["depth_errors"] = (caption, drawing.depth_error_picture(findings.errors))
    for name, (_, figure) in figures.items():
        with replacing(folder / f"{name}.png") as file:
            figure.savefig(file, format="png")
    plotting.write_report(
        folder / "report.html",
        f"Calibration: {', '.join(path.name for path in request.outputs)}",
        f"{len(calibration.observations.photos)} photographs, {len(calibration.observations):,} corners, residuals "
        f"{calibration.rms:.3g} px rms. Sigma is a standard deviation. Lengths in mm.",
        report_tables(request, findings),
        dict(figures.values()),
        [*findings.warnings, *findings.open],
    )


def report_tables(request: Request, findings: Findings) -> dict[str, tuple[Sequence[str], Sequence[Sequence[object]]]]:
    """The tables of the page."""
    calibration = findings.calibration
    start = "drawing" if request.setup is not None else "start"
    tables: dict[str, tuple[Sequence[str], Sequence[Sequence[object]]]] = {
        "Parameters": (("parameter", start, "found", "sigma", "unit"), parameter_rows(calibration)),
    }
    if findings.errors is not None:
        tables[_capital(depth_title(findings.errors))] = (DEPTH_COLUMNS, depth_rows(findings.errors))
    if findings.validation is not None:
        tables[_capital(_HELD_OUT)] = (HELD_OUT_COLUMNS, held_out_rows(findings.validation))
    if findings.guidance is not None:
        lines = findings.guidance.text.splitlines()
        tables["Photographs to take next"] = (("",), [(line,) for line in lines])
    tables["Photographs"] = photo_table(calibration)
    if findings.notes:
        tables["Notes of the detector"] = (("",), [(note,) for note in findings.notes])
    tables["Settings"] = (("setting", "value"), setting_rows(request, calibration))
    return tables


def _capital(text):
    return text[:1].upper() + text[1:]


def photo_table(calibration: Calibration) -> tuple[tuple[str, ...], list[tuple[str, ...]]]:
    """Corners in each view of each photograph, its residuals and the board's depth."""
    from ..calibration.depths import rig_points, rms

    seen, depths = calibration.observations, rig_points(calibration)[:, 2]
    views = np.unique(seen.view)
    rows = []
    for k, name in enumerate(seen.photos):
        mine = seen.photo == k
        counts = [str(int(np.sum(mine & (seen.view == view)))) for view in views]
        size = rms(calibration.residuals[mine & ~calibration.outliers])
        lost = int(np.sum(mine & calibration.outliers))
        rows.append((name, *counts, f"{size:.3g}", str(lost), f"{depths[mine].mean():.0f}"))
    columns = ["no optic" if view == DIRECT else f"view {view}" for view in views]
    return ("photograph", *columns, "residuals (px rms)", "outliers", "depth (mm)"), rows


def setting_rows(request: Request, calibration: Calibration) -> list[tuple[str, str]]:
    """What was asked for."""
    rows = [
        ("board", f"{request.board.name}: {calibration.target}"),
        ("free", ", ".join(calibration.unknowns.names)),
        ("colour", request.channel),
        ("noise of the corners, as detected (px)", f"{np.median(calibration.observations.sigma):.3g}"),
        ("found noise / detected noise", f"{calibration.solution.sigma0:.3g}"),
    ]
    if request.setup is not None:
        rows.insert(0, ("nominal setup", request.setup.name))
    return rows


def document_of(request: Request, findings: Findings) -> dict[str, Any]:
    """What the findings add to calibration.json."""
    more: dict[str, Any] = {
        "setups": [path.name for path in request.outputs],
        "warnings": findings.warnings,
        "undetermined": findings.open,
        "detector_notes": findings.notes,
    }
    if findings.errors is not None:
        names = ("depth", "noise", "calibration", "both", "largest")
        rows = [dict(zip(names, row, strict=True)) for row in findings.errors.table()]
        more["depth_errors"] = {"unit": "mm", "pixel_sigma_px": findings.errors.pixel_sigma, "rows": rows}
    if findings.validation is not None:
        names = ("depths", "photographs", "rms_px", "flatness", "spacing_percent", "spacing_sd_percent", "rigid")
        more["held_out"] = [dict(zip(names, row, strict=True)) for row in findings.validation.table()]
    if findings.guidance is not None:
        more["next_photographs"] = [advice.text for advice in findings.guidance.advice[: findings.guidance.worth]]
    return more
