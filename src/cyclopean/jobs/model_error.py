"""From a setup file to the depth errors of virtual cameras: table and picture."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from rich.table import Table

from ..errors import OpticError, SetupError
from ..files import output_folder, read_setup
from ..files.disk import write_csv
from .console import chosen_depths, console, save_figure

_COLUMNS = ("depth_mm", "middle_percent", "smallest_percent", "largest_percent", "rms_percent", "row_difference_px",
            "residual_px", "mm_per_px")  # fmt: skip
_SAMPLES = 15
_DEPTHS = 9


def run_model_error(
    setup_file: Path,
    output: Path,
    depths: tuple[float, float] | None,
    method: str,
    fit_depths: tuple[float, float] | None,
) -> None:
    """Compute and write everything; see `cyclopean model-error`."""
    from ..analysis.model_error import METHODS, model_error
    from ..plotting.model_error import model_error_picture

    setup = read_setup(setup_file)
    rig = setup.rig()
    if len(rig) < 2:
        raise SetupError(f"{setup_file}: depth needs two views or more, and this {setup.optic.kind} gives {len(rig)}")
    folder = output_folder(output)
    near, far = chosen_depths(depths, setup, rig)
    planes, empty = _planes(rig, [float(f"{depth:.4g}") for depth in np.geomspace(near, far, _DEPTHS)])
    found, failed = [], []
    for name in METHODS if method == "all" else (method,):
        with console.status(METHODS[name]):
            try:
                found.append(model_error(setup, planes, name, fit_depths=fit_depths, samples=_SAMPLES))  # type: ignore[arg-type]
            except OpticError as error:
                failed.append(f"{METHODS[name]}: {error}")
    if not found:
        raise OpticError("; ".join(failed))
    _write_table(folder / "model_error.csv", found)
    save_figure(model_error_picture(found), folder / "model_error.png")
    for error in found:
        console.print(_table(error, METHODS[error.method]))
        console.print()
    if empty.size:
        console.print(
            f"no two views share anything at {', '.join(f'{z:g}' for z in empty)} mm: left out", style="yellow"
        )
    for reason in failed:
        console.print(f"left out: {reason}", style="yellow")
    console.print("true rays have none of this error: it comes from taking each sub-image for an ordinary picture")
    console.print(f"-> {folder}/model_error.png, model_error.csv")


def _planes(rig, depths):
    """Depths at which two views or more share something, and those at which none do."""
    from ..calibration.depths import working_volume

    there = working_volume(rig, depths).common.any((1, 2))
    return np.array(depths)[there], np.array(depths)[~there]


def _numbers(error):
    """One row of `_COLUMNS` for each depth."""
    residual = [np.nanmax(plane) if np.isfinite(plane).any() else np.nan for plane in error.residual]
    return np.column_stack(
        [error.depths, error.middle, error.range, error.rms, error.largest_row, residual, error.mm_per_px]
    )


def _table(error, title):
    departure = max(camera.departure_rms for camera in error.cameras)
    table = Table(title=f"{title}: misses the true pixels by {departure:.3g} px (rms)", title_justify="left", box=None)
    for name in ("depth (mm)", "error in the middle (%)", "over the field (%)", "rms (%)", "rows differ (px)",
                 "residual (px)", "mm per px"):  # fmt: skip
        table.add_column(name, justify="right")
    for depth, middle, low, high, rms, rows, residual, scale in _numbers(error):
        table.add_row(f"{depth:g}", f"{middle:+.3g}", f"{low:+.3g} to {high:+.3g}", f"{rms:.3g}", f"{rows:.3g}",
                      f"{residual:.3g}", f"{scale:.3g}")  # fmt: skip
    return table


def _write_table(path, found):
    rows = [[error.method, *(f"{value:.6g}" for value in row)] for error in found for row in _numbers(error)]
    write_csv(path, ["method", *_COLUMNS], rows)
