"""The folder of one designed prism: setup, solid, drawing, board, picture and shopping list."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from ..errors import CyclopeanError
from ..files import output_folder, replacing, write_board, write_setup
from .console import console, save_figure
from .design_shopping import Rows, drawing_tolerances, shopping_list

if TYPE_CHECKING:
    from ..design.requirements import Candidate, Designs, Requirements
    from ..rigs import Rig
    from .design_request import DesignRequest


@dataclass(frozen=True)
class CandidateFiles:
    """What was written for one prism."""

    folder: Path
    title: str
    shopping: dict[str, Rows]


def write_candidate(
    folder: Path, letter: str, designs: Designs, index: int | None, reasons: Sequence[str], request: DesignRequest
) -> CandidateFiles:
    """Write all files of a candidate, of the nearest miss where there is no index."""
    requirements = designs.requirements
    candidate = designs.explanation.nearest if index is None else designs.candidates[index]
    assert candidate is not None
    output_folder(folder)
    rig = candidate.setup.rig()
    write_setup(candidate.setup, folder / "setup.toml")
    _write_part(folder, letter, candidate, requirements)
    title = f"{letter}: {candidate.name}" + (f" ({', '.join(reasons)})" if reasons else "")
    lists = _write_lists(folder, title, candidate, requirements, rig, request)
    _draw(folder, title, candidate, requirements, rig, request)
    return CandidateFiles(folder, title, lists)


def _write_part(folder, letter, candidate: Candidate, requirements: Requirements) -> None:
    """Solid and drawing of the prism."""
    from ..files.meshes import write_mesh
    from ..optics.solid import prism_solid
    from ..plotting.workshop import Page, workshop_drawing
    from ..plotting.workshop_sheet import encoded

    solid = prism_solid(candidate.prism, tolerance=0.005)
    write_mesh(folder / "prism.stl", solid.vertices, solid.triangles)
    page = Page(f"prism {letter}", "A4")
    drawing = workshop_drawing(candidate.setup, page, drawing_tolerances(candidate, requirements))
    with replacing(folder / "drawing.pdf") as file:
        file.write(encoded(drawing, ".pdf"))


def _write_lists(folder, title, candidate: Candidate, requirements: Requirements, rig: Rig, request) -> dict[str, Rows]:
    """Board and shopping list."""
    from ..analysis import usual_plan
    from ..files.designs import write_shopping_list

    lists = {}
    try:
        plan = usual_plan(
            candidate.setup, requirements.depths, photos=requirements.photos, direct_photos=request.camera_photos,
            sigma=requirements.corner_noise, rig=rig,
        )  # fmt: skip
    except CyclopeanError as error:  # of a miss, whose views may share too little
        lists = shopping_list(candidate, requirements, rig, None, [("", str(error))])
    else:
        write_board(folder / "board.toml", plan.target)  # type: ignore[arg-type]  # a Board
        lists = shopping_list(candidate, requirements, rig, plan, accuracy_rows(candidate, requirements))
    remarks = ["What to buy, set and do. Tolerances are those that the accuracy below holds for."]
    write_shopping_list(folder / "shopping.md", f"Shopping list of prism {title}", remarks, lists)
    return lists


def accuracy_rows(candidate: Candidate, requirements: Requirements) -> Rows:
    """What accuracy to expect, by depth."""
    figures, kept = candidate.figures, candidate.kept
    rows: Rows = [
        ("asked for", "nothing" if requirements.accuracy is None else f"{100 * requirements.accuracy:.3g} % of depth")
    ]
    rows.append(("noise of a matched coordinate", f"{requirements.noise:g} px"))
    for k, depth in enumerate(figures.depths):
        said = f"{100 * figures.sigma[k]:.3g} % of depth, {figures.sigma[k] * depth:.2g} mm, on paper"
        if kept is not None and kept.after is not None:
            most = float(np.interp(depth, kept.depths, kept.after.quantile(0.95)))
            said += f"; 95 % of prisms keep {100 * most:.3g} %, {most * depth:.2g} mm"
        rows.append((f"standard deviation at {depth:.4g} mm", said))
    if kept is not None:
        rows.append(("once made and calibrated", kept.text))
    return rows


def _photograph(candidate, requirements):
    """The simulated photograph; None, with a line to the person, where it cannot be made."""
    from .design_photograph import photograph_of

    try:
        return photograph_of(candidate, requirements.depths)
    except CyclopeanError as error:  # without Embree, or light that meets nothing
        console.print(f"no simulated photograph of {candidate.name}: {error}", style="yellow")
        return None


def _draw(folder, title, candidate, requirements, rig, request) -> None:
    from ..plotting.design_candidate import candidate_picture

    photograph = None
    if request.photo:
        photograph = _photograph(candidate, requirements)
    figures = candidate.figures
    measures = (
        f"baseline {figures.baseline:.3g} mm, diameter {figures.diameter:.4g} mm, thickness {figures.thickness:.3g} mm"
    )
    picture = candidate_picture(candidate, requirements, f"{title}\n{measures}", photograph, rig)
    save_figure(picture, folder / "candidate.png")
