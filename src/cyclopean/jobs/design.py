"""From what is wanted to the prism to buy; see `cyclopean design`."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from pathlib import Path
from string import ascii_lowercase
from typing import TYPE_CHECKING

import numpy as np

from ..errors import SetupError
from ..files import output_folder
from .console import console, counted, progress_bars, save_figure
from .design_files import CandidateFiles, write_candidate
from .design_request import DesignRequest, requirements_of
from .design_rounding import rounded
from .design_tables import design_tables, nearest_tables, say_tables

if TYPE_CHECKING:
    from ..design.judgement import KeptAccuracy
    from ..design.requirements import Candidate, Designs, Make, Requirements


@dataclass
class _Kept:
    """What is on disk already, for the one who presses Ctrl-C."""

    folder: Path
    done: list[str] = field(default_factory=list)

    def __str__(self):
        return f"complete and kept in {self.folder}: {', '.join(self.done)}" if self.done else ""


def run_design(request: DesignRequest) -> None:
    """Search, judge, tell, draw and write; see `cyclopean design`."""
    requirements, notes = requirements_of(request)
    folder = output_folder(request.output)
    for line in [*request_lines(requirements), *notes]:
        console.print(line)
    kept = _Kept(folder)
    try:
        _design(request, requirements, notes, kept)
    except KeyboardInterrupt:
        raise KeyboardInterrupt(str(kept)) from None


def _design(request, requirements, notes, kept: _Kept) -> None:
    from ..files.designs import write_designs

    with progress_bars() as progress:
        designs = _found(request, requirements, progress)
        requirements = designs.requirements
        if not designs.candidates:
            progress("writing the nearest miss", 0, 1)
            files = _write_nearest(request, designs, kept)
            progress("writing the nearest miss", 1, 1)
        else:
            written = [choice.index for choice in designs.chosen]
            write_designs(kept.folder / "designs.json", designs, dict(zip(written, _letters(written), strict=True)))
            kept.done.append("designs.json")
    if not designs.candidates:
        if designs.explanation.nearest is not None:
            say_tables(nearest_tables(designs))
        raise SetupError(_nothing_text(designs, files))
    _tell(designs, written)
    _write_all(request, designs, written, notes, kept)
    _tell_next(kept.folder, designs, written)


def _found(request, requirements: Requirements, progress) -> Designs:
    """What a search finds, judged as it is really made.

    At first noise of matching may take up a share of the accuracy, as making and calibrating cost something too. Where
    all prisms that were found lose more than that, or there was none but one that loses less, it may take up all.
    """
    from ..design.choice import judge_choices
    from ..design.search import find_designs

    make = _maker(request)
    for share in (requirements.on_paper, 1.0) if request.judge else (1.0,):
        designs = find_designs(
            replace(requirements, on_paper=share), make=make if request.judge else None, progress=progress
        )
        if designs.candidates:
            designs = judge_choices(designs, make, most=request.choose, progress=progress)
        if not _hopeful(designs):
            break
    return designs


def _hopeful(designs: Designs) -> bool:
    """Whether a search with more accuracy left to noise may find what this one did not."""
    if designs.candidates:
        return all(one.kept is not None and one.kept.kept is False for one in designs.options)
    best = [one.candidate for one in designs.explanation.relaxations if one.requirement == "accuracy"]
    return any(one.kept is not None and one.kept.kept for one in best)


def _maker(request) -> Make:
    """Takes a candidate to what is built: round measures, and what it then keeps of its accuracy."""
    from ..design.judgement import keep_accuracy

    def make(candidate: Candidate, requirements: Requirements) -> Candidate:
        built = rounded(candidate, requirements)
        if not request.judge:
            return built
        kept = keep_accuracy(built, requirements, draws=request.draws, direct_photos=request.camera_photos)
        return replace(built, kept=kept)

    return make


def request_lines(requirements: Requirements) -> list[str]:
    """What is asked for, in words."""
    camera, (near, far) = requirements.camera, requirements.depths
    pitch = camera.pixel_pitch
    size = f"{camera.size[0]} x {camera.size[1]} px" + (f" of {1000 * pitch:.3g} um" if pitch else "")
    lens = (
        f"f = {camera.focal[0] * pitch:.4g} mm ({camera.focal[0]:.4g} px)" if pitch else f"f = {camera.focal[0]:.5g} px"
    )
    stop = f", f/{requirements.f_number:g}, focus at {requirements.focus:.4g} mm" if requirements.f_number else ""
    asked = [f"depths {near:g} to {far:g} mm"]
    if requirements.accuracy is not None:
        asked.append(f"depth to {100 * requirements.accuracy:.3g} %")
    if requirements.field is not None:
        asked.append(f"a common field of {requirements.field[0]:g} x {requirements.field[1]:g} mm")
    if requirements.baseline is not None:
        asked.append(f"baseline {requirements.baseline:g} mm")
    for name, unit in (("diameter", "mm"), ("length", "mm"), ("blend", "px"), ("chromatic", "px")):
        limit = getattr(requirements, f"max_{name}")
        if limit is not None:
            asked.append(
                f"{ {'blend': 'blend band', 'chromatic': 'spread of colours'}.get(name, name) } up to {limit:g} {unit}"
            )
    facets = ", ".join(map(str, requirements.facets))
    angles = "any angle" if requirements.angles_deg is None else f"{counted(len(requirements.angles_deg), 'angle')}"
    light = f"{requirements.wavelength_nm:.5g} nm, {requirements.bandwidth_nm:g} nm wide"
    return [
        f"camera: {size}, {lens}{stop}; light {light}; matching to {requirements.noise:g} px",
        f"asked for: {', '.join(asked)}; {facets} facets, {' or '.join(requirements.glasses)}, {angles}",
    ]


def _letters(written):
    return ascii_lowercase[: len(written)]


def _tell(designs: Designs, written: list[int]) -> None:
    """Print what was found, as tables and remarks."""
    console.print(
        f"{designs.screened:,} prisms looked at in closed form, {designs.traced:,} by exact rays; "
        f"{counted(len(designs.candidates), 'prism')} fit{'s' if len(designs.candidates) == 1 else ''}, "
        f"{len(designs.front)} of them bettered by no other in everything"
    )
    if designs.explanation.text:
        console.print(designs.explanation.text)
    console.print()
    say_tables(design_tables(designs, written, _letters(written)))
    for remark in remarks_of(designs, written):
        console.print(remark, style="yellow")


def remarks_of(designs: Designs, written: list[int]) -> list[str]:
    """What the person should know about the figures."""
    remarks = []
    judged = [(letter, designs.candidates[k].kept) for letter, k in zip(_letters(written), written, strict=True)]
    for letter, kept in judged:
        if kept is not None and kept.after is None:
            remarks.append(f"{letter} cannot be judged: {kept.reason}")
    for letter, kept in judged:
        if kept is None or kept.after is None or kept.accuracy is None or kept.kept:
            continue
        near = "" if kept.sure else "; too close to tell, more --draws would"
        remarks.append(
            f"{letter}: {100 * kept.share:.0f} % of prisms made keep {100 * kept.accuracy:.3g} %, not 95 %{near}; most "
            f"of the variance is by {kept.driver}"
        )
    return remarks


def _write_all(request, designs: Designs, written: list[int], notes, kept: _Kept) -> None:
    """Write the comparison, then a folder for each prism, then what holds them all."""
    from ..files.designs import write_designs
    from ..plotting.design import comparison_picture
    from .design_report import write_design_report

    letters = dict(zip(written, _letters(written), strict=True))
    files: dict[int, CandidateFiles] = {}
    with progress_bars() as progress:
        steps = len(written) + 1
        progress("writing", 0, steps)
        comparison = comparison_picture(designs, written)
        save_figure(comparison, kept.folder / "comparison.png")
        kept.done.append("comparison.png")
        for done, (k, letter) in enumerate(letters.items()):
            progress("writing", done + 1, steps)
            reasons = next((choice.reasons for choice in designs.chosen if choice.index == k), ())
            files[k] = write_candidate(kept.folder / letter, letter, designs, k, reasons, request)
            kept.done.append(f"{letter}/")
        write_designs(kept.folder / "designs.json", designs, letters, {k: one.shopping for k, one in files.items()})
        tables = design_tables(designs, written, _letters(written))
        lines = [*request_lines(designs.requirements), *notes, designs.explanation.text]
        write_design_report(kept.folder, lines, tables, remarks_of(designs, written), files, letters, designs)
        progress("writing", steps, steps)


def _tell_next(folder: Path, designs: Designs, written: list[int]) -> None:
    names = ", ".join(f"{letter}/" for letter in _letters(written))
    console.print(f"-> {folder}/report.html, comparison.png, designs.json; for each prism: {names}")
    console.print(f"next: cyclopean simulate {folder}/a/setup.toml shows the photograph that it would take")
    judged = [one.kept for one in designs.options if one.kept is not None]
    if judged and all(kept.kept is False for kept in judged):
        best = min(judged, key=lambda kept: kept.worst)
        raise SetupError(
            f"none of these prisms keeps {100 * (best.accuracy or np.nan):.3g} % of depth in 95 of 100 cases, as they "
            f"are really made and calibrated; the best does in {100 * max(kept.share for kept in judged):.0f}. Most of "
            f"its variance is by {best.driver}: {_advice(best)}"
        )


def _advice(kept: KeptAccuracy) -> str:
    """What to change where too few prisms keep the accuracy."""
    from ..design.explanation import three_digits
    from ..design.judgement import MATCHING

    if not np.isfinite(kept.worst):
        return "some of them show nothing at a depth; ask for less depth or a smaller baseline"
    ask = f"ask for {three_digits(101 * kept.worst):g} %"
    if kept.driver == MATCHING:
        return f"matching itself leaves {100 * np.nanmax(kept.noise):.3g} %; {ask}, or match better (--noise)"
    if kept.driver.startswith("camera.") or kept.driver == "noise of corners":
        return f"more photographs (--photos, --camera-photos) help, or {ask}"
    return f"--tolerances precision or high, more --photos, or {ask}"


def _write_nearest(request, designs: Designs, kept: _Kept) -> list[str]:
    """Write what is nearest to the requirements, though it does not keep them."""
    from ..files.designs import write_designs

    write_designs(kept.folder / "designs.json", designs, {})
    kept.done.append("designs.json")
    nearest = designs.explanation.nearest
    if nearest is None:
        return kept.done
    write_candidate(kept.folder / "nearest", "nearest", designs, None, ("misses by least",), request)
    kept.done.append("nearest/")
    return kept.done


def _nothing_text(designs: Designs, files: list[str]) -> str:
    looked = f"{designs.screened:,} prisms were looked at in closed form, {designs.traced:,} by exact rays"
    return f"{designs.explanation.text} ({looked}; written: {', '.join(files)})"
