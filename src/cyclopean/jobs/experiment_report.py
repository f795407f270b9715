"""An experiment for the person: lines at the terminal, tables, pictures and a page."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from rich.table import Table

from ..files import replacing
from ..files.disk import write_csv
from .console import console, save_figure
from .experiment_pictures import experiment_pictures
from .experiment_request import Options

if TYPE_CHECKING:
    from ..experiments import Experiment

TABLES = {"biprism": "4.1", "trinocular": "5.1", "multiocular": "6.1"}
_ABREAST = 6  # approaches side by side on the screen


def title_of(name: str, experiment: Experiment) -> str:
    """A heading in the words of the thesis's list of tables."""
    from ..experiments import baseline

    rig = (experiment.material.true or experiment.setup).rig()
    kind = {"biprism": "binocular", "multiocular": f"multi-ocular ({len(rig)} facets)"}.get(name, name)
    return (
        f"Recovered depth by {kind} stereovision, baseline {baseline(rig):.1f} mm "
        f"(the form of the thesis's table {TABLES[name]})"
    )


def say_experiment(name: str, experiment: Experiment, options: Options) -> None:
    """Tell the person what came out."""
    from ..experiments import summary_table, thesis_table

    for line in facts(experiment, options):
        console.print(line)
    console.print(f"\n{title_of(name, experiment)}: mean of the points, mm, and its error, %")
    names = experiment.approaches
    for start in range(0, len(names), _ABREAST):
        _print_table(*thesis_table(experiment, names[start : start + _ABREAST]))
    console.print("\nall points:")
    _print_table(*summary_table(experiment))
    for note in notes(experiment):
        console.print(f"note: {note}", style="yellow")


def facts(experiment: Experiment, options: Options) -> list[str]:
    """Setup, camera and material in a few lines."""
    from ..experiments import prism_of

    material, camera = experiment.material, experiment.setup.camera
    bench, drawn = material.true or experiment.setup, material.drawn
    optic, wrong = prism_of(bench), prism_of(drawn)
    focal_off = 100 * (drawn.camera.focal[0] / bench.camera.focal[0] - 1)
    seen = material.targets.observations
    corners = (
        "corners found in photographs"
        if options.data
        else f"corners computed with {options.corner_noise_px:g} px noise"
    )
    lines = [
        f"bench: {optic.facets} facets of {optic.apex_deg:g} degrees, {optic.distance:.2f} mm from the pinhole, "
        f"{optic.thickness:.2f} mm thick; camera {bench.camera.size[0]} x {bench.camera.size[1]} px, focal length "
        f"{bench.camera.focal[0]:g} px",
        f"drawing: {wrong.apex_deg:g} degrees, {wrong.distance:.2f} mm, tilted by "
        f"{np.linalg.norm(np.subtract(wrong.tilt_deg, optic.tilt_deg)):.2g} degrees more; focal length "
        f"{drawn.camera.focal[0]:g} px ({focal_off:+.2g} %), where the camera's calibration starts",
        f"camera calibrated without the prism: focal length {camera.focal[0]:.2f}, {camera.focal[1]:.2f} px, centre "
        f"{camera.centre[0]:.2f}, {camera.centre[1]:.2f} px",
    ]
    if experiment.physical is not None:
        found = prism_of(experiment.physical.setup)
        lines.append(
            f"prism by the physical model: {found.apex_deg:.4f} degrees, {found.distance:.3f} mm; fits to "
            f"{experiment.physical.rms:.3f} px"
        )
    lines.append(f"target: {material.targets.target}, {len(seen):,} {corners}, {len(experiment.actual):,} points")
    return lines


def notes(experiment: Experiment) -> list[str]:
    """What went wrong, and what to know."""
    from ..calibration.routes import FIELD_POINT

    found = [f"{one.approach}: {one.message}" for one in experiment.recovered if one.message]
    if FIELD_POINT in experiment.approaches and experiment.field_point is not None:
        found.append(
            f"the field point is a corner of the target at {experiment.field_point.depth:g} mm, one of the points "
            "that judge"
        )
    return found


def write_experiment(
    folder: Path, name: str, experiment: Experiment, options: Options, folders: Sequence[Path] | None = None
) -> list[str]:
    """Write the tables, the pictures and report.html; names of the files.

    `folders` hold the photographs without the optic, through it, and of the target, where any were taken.
    """
    from .. import plotting
    from ..experiments import as_latex, as_markdown, cameras_table, long_table, summary_table, thesis_table

    title = title_of(name, experiment)
    table, whole = thesis_table(experiment), summary_table(experiment)
    texts = {
        "table.md": f"{title}; error in %\n\n{as_markdown(table)}\n{as_markdown(whole)}",
        "table.tex": as_latex(table, f"{title}; error in %"),
    }
    for file, text in texts.items():
        with replacing(folder / file) as out:
            out.write(text.encode())
    write_csv(folder / "table.csv", *long_table(experiment))
    pictures = experiment_pictures(experiment, folders)
    for file, (_, figure) in pictures.items():
        save_figure(figure, folder / file)
    plotting.write_report(
        folder / "report.html",
        title,
        " ".join(line[0].upper() + line[1:] + "." for line in facts(experiment, options)),
        {
            "Recovered depth: mean of the points, mm, and its error, %": table,
            "All points": whole,
            "Virtual cameras": cameras_table(experiment),
        },
        dict(pictures.values()),
        notes(experiment),
    )
    return [*texts, *pictures, "report.html"]


def _print_table(columns: Sequence[str], rows: Sequence[Sequence[str]]) -> None:
    table = Table(box=None, padding=(0, 1, 0, 0))
    table.add_column(columns[0], max_width=max(6, *(len(row[0]) for row in rows)))
    for name in columns[1:]:
        table.add_column(name, justify="right", max_width=18)
    for row in rows:
        table.add_row(*row)
    console.print(table)
