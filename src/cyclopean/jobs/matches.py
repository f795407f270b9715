"""From a photograph and a setup to matched points, a picture and a report; see `cyclopean match`."""

from __future__ import annotations

import time
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np
from rich.table import Table

from ..correspondence import Matches
from ..errors import SetupError, ShapeError
from ..files import check_exposure, output_folder, read_board, read_photograph, read_setup, write_ply
from ..geometry import as_rgb
from ..rigs import Rig
from ..targets import Board
from .console import chosen_depths, console, counted, progress_bars, save_figure

Rows = list[tuple[str, ...]]
NOISE = 0.1  # px, of points and of boards where no other is stated
MAX_AMBIGUITY = 0.2
_MANY = 300  # points, of which a small share says something
_FEW_MATCHED = 0.03  # share of the points found that are matched, below which something is wrong
_FEW_SEEN = 0.1  # share of the points it should show that a view shows, below which something is wrong with it


@dataclass(frozen=True)
class Request:
    """What to match, and how strictly."""

    detector: Literal["sift", "orb", "akaze"]
    points: Path | None
    board: Path | None
    depths: tuple[float, float] | None  # mm
    min_views: int
    noise_px: float | None
    max_ambiguity: float | None
    refine: bool

    @property
    def what(self) -> str:
        """What is matched, for people."""
        if self.points is not None:
            return f"points of {self.points.name}"
        return f"points of the board {self.board.name}" if self.board is not None else f"{self.detector} features"

    @property
    def noise(self) -> str:
        """Standard deviation of a pixel coordinate, px, for people."""
        from ..correspondence import SIGMAS
        from ..correspondence.alignment import REFINED_SIGMA

        features = self.points is None and self.board is None
        if self.noise_px is not None or not features:
            return f"{self.noise_px or NOISE:g}"
        matching = f"{SIGMAS[self.detector]:g}"
        return f"{matching} while matching, {REFINED_SIGMA:g} once refined" if self.refine else matching


def run_match(photo: Path, setup_file: Path, output: Path, request: Request) -> None:
    """Read, match and write everything."""
    started = time.perf_counter()
    setup = read_setup(setup_file)
    photograph = read_photograph(photo, setup.camera.size)
    rig = setup.rig()
    if len(rig) < 2:
        raise SetupError(f"{setup_file}: the setup has one view: to match a point, two must see it")
    if request.min_views > len(rig):
        raise SetupError(f"--min-views {request.min_views} is more than the {counted(len(rig), 'view')} of the setup")
    folder = output_folder(output)
    warnings = check_exposure(photograph, rig.masks)
    depths = chosen_depths(request.depths, setup, rig)
    console.print(f"{photo.name}: {len(rig)} views, {request.what}, depths {depths[0]:g} to {depths[1]:g} mm")
    with progress_bars() as progress:
        matches, notes = find_matches(photograph, rig, depths, request, progress)
    warnings += notes or doubts(rig, matches)
    for warning in warnings:
        console.print(f"warning: {warning}", style="yellow")
    seconds = time.perf_counter() - started
    tables = match_tables(rig, matches)
    for title, (columns, rows) in tables.items():
        console.print(_printed(title, columns, rows))
    with console.status("writing points, pictures and report"):
        write_results(folder, photo, setup_file, photograph, rig, matches, tables, depths, request, warnings)
    console.print(f"{counted(len(matches), 'point')} matched in {seconds:.1f} s -> {folder}/")
    console.print("  matches.csv  points.ply  matches.png  report.html")


def find_matches(photograph, rig: Rig, depths, request: Request, progress) -> tuple[Matches, list[str]]:
    """The matches that a request asks for, and sentences about what is not as it should be."""
    from ..correspondence import match_features, match_points, match_target

    if request.board is not None:
        board = read_board(request.board)
        if not isinstance(board, Board):
            raise SetupError(f"{request.board}: points in space have no print that could be found in a photograph")
        progress("board", 0, 1)
        found = match_target(photograph, rig, board, sigma=request.noise_px or NOISE, min_views=request.min_views)
        progress("board", 1, 1)
        return found
    most = MAX_AMBIGUITY if request.max_ambiguity is None else request.max_ambiguity
    limits = {"min_views": request.min_views, "max_ambiguity": most, "progress": progress}
    if request.points is None:
        return match_features(
            photograph, rig, depths, detector=request.detector, sigma=request.noise_px, refine=request.refine, **limits
        ), []  # fmt: skip
    from ..files.matches import read_points

    given = read_points(request.points, len(rig))
    if sum(len(pixels) > 0 for pixels in given) == 1:
        return _pointed(photograph, rig, depths, request, given)
    try:
        return match_points(rig, given, depths, sigma=request.noise_px or NOISE, **limits), []
    except ShapeError as error:
        raise SetupError(f"{request.points}: {error}") from None


def _pointed(photograph, rig, depths, request, given):
    """Points of one view, looked for in the others."""
    from ..correspondence import match_pointed

    view = next(k for k, pixels in enumerate(given) if len(pixels))
    if request.max_ambiguity is not None:
        raise SetupError(
            f"--max-ambiguity is for points of several views; all points of {request.points} are in view {view}, and "
            "are looked for in the others by the picture around them: leave it out"
        )
    console.print(f"all points are in view {view}: looking for them in the others")
    matches, notes = match_pointed(photograph, rig, view, given[view], depths, pointing=request.noise_px or NOISE)
    enough = matches.views >= request.min_views
    return matches.select(enough), notes


def doubts(rig: Rig, matches: Matches) -> list[str]:
    """Sentences about what speaks against the setup, the photograph or the depth range."""
    advice = (
        "is this the setup that took the photograph, does the depth range hold the scene, and is --noise-px as large "
        "as the setup may be off?"
    )
    if not len(matches):
        return [f"nothing was matched: {advice}"]
    found, used = int(matches.counts.detected.sum()), int((matches.source >= 0).sum())
    if found > _MANY and used < _FEW_MATCHED * found:
        return [f"only {100 * used / found:.1f} % of the points found are matched: {advice}"]
    said = []
    for k, view in enumerate(rig):
        should = view.region.contains(view.unbounded().project(matches.points))
        shows = int((matches.source[should, k] >= 0).sum())
        if should.sum() > _MANY // 10 and shows < _FEW_SEEN * should.sum():
            said.append(
                f"{view.name} shows {shows} of the {should.sum()} matched points that it should show: is that view "
                f"blocked or out of focus? {advice}"
            )
    return said


def match_tables(rig: Rig, matches: Matches) -> dict[str, tuple[tuple[str, ...], Rows]]:
    """Heading -> columns and rows of numbers about the matches."""
    counts = matches.counts
    used = (matches.source >= 0).sum(0)
    per_view: Rows = [
        (view.name, f"{counts.detected[k]:,}", f"{used[k]:,}", _share(used[k], counts.detected[k]))
        for k, view in enumerate(rig)
    ]
    tables: dict[str, tuple[tuple[str, ...], Rows]] = {
        "points of each view": (("view", "found", "matched", "share (%)"), per_view)
    }
    if counts.pairs:
        tables["candidates"] = (("step", "number", "candidates of a point in a view"), _steps(matches))
    pointed = bool(np.isfinite(matches.next_best).any())
    rows = [_depth_row(matches.select(matches.views == views), views) for views in np.unique(matches.views)]
    columns = (
        "seen by", "points", "median depth (mm)", "depths (mm)", "median sigma of depth (mm)", "residual rms (px)",
        "median next best" if pointed else "median ambiguity",
    )  # fmt: skip
    if rows:
        tables["matched points by number of views"] = (columns, rows)
    return tables


def _steps(matches):
    counts = matches.counts
    steps = [("every point of another view", counts.pairs), ("in the band and the range of depths", counts.in_band)]
    steps += [("and alike", counts.alike)] if counts.alike != counts.in_band else []
    return [
        *((name, f"{number:,}", _few(counts.per_point(number))) for name, number in steps),
        ("sets that a third view confirms", f"{counts.verified:,}", ""),
        ("matched", f"{len(matches):,}", ""),
        ("refused as ambiguous", f"{counts.refused:,}", ""),
    ]


def _depth_row(matches, views):
    depth, sigma = matches.points[:, 2], np.sqrt(matches.covariance[:, 2, 2])
    doubt = np.median(np.where(np.isnan(matches.ambiguity), matches.next_best, matches.ambiguity))
    numbers = np.median(depth), np.median(sigma), np.sqrt((matches.residual**2).mean()), doubt
    return (
        str(views), f"{len(matches):,}", f"{numbers[0]:.1f}", f"{depth.min():.1f} to {depth.max():.1f}",
        f"{numbers[1]:.3f}", f"{numbers[2]:.3f}", f"{numbers[3]:.2g}",
    )  # fmt: skip


def _share(part, whole):
    return f"{100 * part / whole:.0f}" if whole else "-"


def _printed(title, columns, rows):
    table = Table(title=title, title_justify="left", box=None)
    for number, column in enumerate(columns):
        table.add_column(column, justify="right" if number else "left")
    for row in rows:
        table.add_row(*row)
    return table


def write_results(
    folder: Path, photo: Path, setup_file: Path, photograph: np.ndarray, rig: Rig, matches: Matches, tables, depths,
    request: Request, warnings: list[str],
) -> None:  # fmt: skip
    """Write the numbers first, then the picture, then the report."""
    from ..files.matches import write_matches
    from ..plotting import write_report
    from ..plotting.matches import matches_picture

    write_matches(folder / "matches.csv", matches)
    sigma = np.sqrt(matches.covariance[:, 2, 2])
    colours = _colours(photograph, matches)
    write_ply(folder / "points.ply", matches.points, colors=colours, covariance=matches.covariance, sigma=sigma)
    picture = matches_picture(photograph, rig, matches)
    save_figure(picture, folder / "matches.png")
    settings = [
        ("photograph", photo.name),
        ("setup", setup_file.name),
        ("matched", request.what),
        ("depth range (mm)", f"{depths[0]:g} to {depths[1]:g}"),
        ("pixel noise (px)", request.noise),
        ("views that must show a point", str(request.min_views)),
    ]
    doubt = "Next best: correlation of the next best place over that of the match."
    if not np.isfinite(matches.next_best).any():
        most = MAX_AMBIGUITY if request.max_ambiguity is None else request.max_ambiguity
        settings += [("largest ambiguity", f"{most:g}")] if request.board is None else []
        doubt = "Ambiguity: likelihood of the best other explanation over the match's."
    write_report(
        folder / "report.html",
        f"Matches of {photo.name}",
        f"Lengths in mm in the camera's frame. {doubt}",
        {**tables, "Settings": (("setting", "value"), settings)},
        {"Matched points, coloured by depth; the same colour is the same point": picture},
        warnings,
    )


def _colours(photograph, matches):
    """Colours (P, 3) uint8 of the photograph where the first view shows each point."""
    seen = np.isfinite(matches.pixels[..., 0])
    first = matches.pixels[np.arange(len(matches)), np.argmax(seen, 1)]
    height, width = photograph.shape[:2]
    column, row = np.clip(np.rint(first).astype(int), 0, [width - 1, height - 1]).T
    return as_rgb(photograph)[row, column]


def _few(number):
    return f"{number:,.0f}" if number >= 100 else f"{number:.2g}"
