"""What a calibration found, for the person: lines at the terminal, pictures and a page."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from rich.table import Table

from ..errors import CyclopeanError
from ..files import replacing
from ..files.calibrations import write_calibration
from .calibration_tables import (
    DEPTH_COLUMNS,
    HELD_OUT_COLUMNS,
    depth_rows,
    depth_title,
    held_out_rows,
    held_rows,
    parameter_rows,
    photo_table,
    setting_rows,
    view_counts,
)
from .console import console, counted

if TYPE_CHECKING:
    from ..calibration.comparison import Comparison
    from ..calibration.depths import DepthErrors
    from ..calibration.guidance import Guidance
    from ..calibration.physical import Calibration
    from ..calibration.validation import Validation
    from ..rigs import Setup
    from .calibration_request import Request

_SHOWN = 5  # notes of the detector at the terminal; the report has all
_ADVISED = 3
_DEPTHS = 5
_BY_CALIBRATION = (
    "The part by calibration is that of the free parameters, for errors of the corners that are independent of each "
    "other; what the held values are wrong by comes on top."
)
_COMPARED = "Three routes, each judged by photographs that it has not seen"
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
    comparison: Comparison | None = None  # with other routes

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
    console.print(f"{counted(len(seen), 'corner')} in {counted(len(seen.photos), 'photograph')} ({counts})")
    console.print(
        f"residuals {calibration.rms:.3g} px rms, {solution.sigma0:.3g} times the detector's noise; "
        f"{counted(int(calibration.outliers.sum()), 'outlier')}; {seconds:.0f} s"
    )
    start = "drawing" if request.setup is not None else "start"
    table = Table("parameter", box=None)
    for column in (start, "found", "sigma"):
        table.add_column(column, justify="right")
    table.add_column("unit")
    for row in parameter_rows(calibration):
        table.add_row(*row)
    console.print(table)
    held = [f"{name} {value} {unit}".rstrip() for name, _, value, _, unit in held_rows(calibration)]
    console.print(f"held: {', '.join(held)}" if held else "held: nothing")


def judge(
    request: Request, calibration: Calibration, notes: Sequence[str], progress, drawn: Setup | None = None
) -> Findings:
    """Find out how far a calibration can be trusted, telling the person each thing as it is known."""
    from ..calibration.trust import correlated, undetermined, warnings_of
    from .calibration_failure import failure_of

    warnings = [*calibration.notes, *_alone(calibration), *warnings_of(calibration)]
    for text in warnings:
        console.print(f"warning: {text}", style="yellow")
    if failure_of(calibration):  # figures of such a calibration would mean nothing
        return Findings(calibration, notes, warnings, [], None, None, None)
    unknown = [*(direction.text for direction in undetermined(calibration)), *correlated(calibration)]
    for text in unknown:
        console.print(f"open: {text}", style="yellow")
    errors = _depth_errors(request, calibration, warnings)
    validation = guidance = comparison = None
    if request.validate and len(calibration.observations.photos) > 1:
        validation = _validation(calibration, warnings, progress)
    if request.compare:
        comparison = _comparison(request, calibration, drawn, warnings, progress)
    if request.guide and errors is not None:
        guidance = _guidance(request, calibration, len(calibration.setups) // 2)
    return Findings(calibration, notes, warnings, unknown, errors, validation, guidance, comparison)


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


def _depth_errors(request, calibration, warnings):
    from ..calibration.trust import depth_errors

    depths = calibration.setup.depths if request.depths is None else request.depths
    places = None if depths is None else np.linspace(depths[0], depths[1], _DEPTHS)
    try:
        errors = depth_errors(calibration, places, channel=len(calibration.setups) // 2)
    except CyclopeanError as fault:
        if not any(str(fault) in text for text in warnings):
            warnings.append(f"no errors of depth: {fault}")
            console.print(f"warning: {warnings[-1]}", style="yellow")
        return None
    say_table(depth_title(errors), DEPTH_COLUMNS, depth_rows(errors))
    console.print(_BY_CALIBRATION)
    return errors


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


def _comparison(request, calibration, drawn, warnings, progress):
    from .comparison import compare_three
    from .comparison_report import say_comparison

    try:
        found = compare_three(request, calibration, drawn, progress)
    except CyclopeanError as fault:
        warnings.append(f"no comparison of routes: {fault}")
        console.print(f"warning: {warnings[-1]}", style="yellow")
        return None
    console.print()
    say_comparison(found, ())
    return found


def _guidance(request, calibration, channel):
    from ..calibration.guidance import guide

    depths = calibration.setup.depths if request.depths is None else request.depths
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


def write_findings(request: Request, findings: Findings) -> None:
    """Write calibration.json, then the pictures, then the page."""
    from .. import plotting
    from ..plotting import calibration as drawing
    from .comparison_report import comparison_remarks

    folder, calibration = request.folder, findings.calibration
    write_calibration(folder / "calibration.json", calibration, document_of(request, findings))
    held_out = None if findings.validation is None else findings.validation.photo_rms
    figures = {
        "residuals": ("Residuals: observed minus predicted pixels", drawing.residual_picture(calibration)),
        "coverage": ("Where the board was seen", drawing.coverage_picture(calibration)),
        "photos": ("Residuals of each photograph", drawing.photo_picture(calibration, held_out)),
    }
    if findings.errors is not None:
        caption = "Standard deviation of triangulated depth: noise and calibration together, and the calibration's part"
        figures["depth_errors"] = (caption, drawing.depth_error_picture(findings.errors))
    for name, (_, figure) in figures.items():
        with replacing(folder / f"{name}.png") as file:
            figure.savefig(file, format="png")
    captions = {}
    if findings.errors is not None:
        captions[_capital(depth_title(findings.errors))] = _BY_CALIBRATION
    if findings.comparison is not None:
        captions[_COMPARED] = " ".join(_sentence(text) for text in comparison_remarks(findings.comparison, ()))
    plotting.write_report(
        folder / "report.html",
        f"Calibration: {', '.join(path.name for path in request.outputs)}",
        f"{counted(len(calibration.observations.photos), 'photograph')}, "
        f"{counted(len(calibration.observations), 'corner')}, residuals "
        f"{calibration.rms:.3g} px rms. Sigma is a standard deviation. Lengths in mm.",
        report_tables(request, findings),
        dict(figures.values()),
        [*findings.warnings, *findings.open],
        captions,
    )


def report_tables(request: Request, findings: Findings) -> dict[str, tuple[Sequence[str], Sequence[Sequence[object]]]]:
    """The tables of the page."""
    from .comparison_report import comparison_table

    calibration = findings.calibration
    start = "drawing" if request.setup is not None else "start"
    tables: dict[str, tuple[Sequence[str], Sequence[Sequence[object]]]] = {
        "Parameters": (
            ("parameter", start, "found", "sigma", "unit"),
            [*parameter_rows(calibration), *held_rows(calibration)],
        ),
    }
    if findings.errors is not None:
        tables[_capital(depth_title(findings.errors))] = (DEPTH_COLUMNS, depth_rows(findings.errors))
    if findings.validation is not None:
        tables[_capital(_HELD_OUT)] = (HELD_OUT_COLUMNS, held_out_rows(findings.validation))
    if findings.comparison is not None:
        tables[_COMPARED] = comparison_table(findings.comparison)
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


def _sentence(text):
    return f"{_capital(text)}."


def document_of(request: Request, findings: Findings) -> dict[str, Any]:
    """What the findings add to calibration.json."""
    from .comparison_report import routes_document

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
    if findings.comparison is not None:
        more["routes"] = routes_document(findings.comparison)
    if findings.guidance is not None:
        more["next_photographs"] = [advice.text for advice in findings.guidance.advice[: findings.guidance.worth]]
    return more
