"""From a setup file to the depth errors of setups as they are really made: table, picture, draws and report."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, get_args

import numpy as np
from rich.table import Table

from ..errors import SetupError
from ..files import output_folder, read_setup, replacing
from ..files.disk import write_csv
from .calibration_request import parse_tolerances
from .console import chosen_depths, console, counted, progress_bars, save_figure

if TYPE_CHECKING:
    from ..analysis.tolerance_errors import DepthErrorSample
    from ..analysis.tolerances import Tolerance, ToleranceAnalysis
    from ..rigs import Setup

_LEVELS = (0.5, 0.68, 0.95, 0.99)
_FAR_FROM_LINEAR = 0.1
_MAIN = 0.5  # share of one parameter in what is left, above which it is worth a remark
_LOST = 0.02
_SMALL = 0.002  # share, below which a parameter goes to the others
_UNEXPLAINED = 0.02  # share, below which it is by the few draws
_OPTION = "--tolerance"


@dataclass(frozen=True)
class ToleranceRequest:
    """What the person asked for; see `cyclopean tolerance`."""

    setup: Path
    output: Path
    draws: int
    tolerances: Sequence[str]
    usual: bool
    depths: tuple[float, float] | None
    noise_px: float
    require: float
    board: Path | None
    photos: int
    camera_photos: int
    corner_noise_px: float
    free: Sequence[str]
    seed: int


def run_tolerances(request: ToleranceRequest) -> None:
    """Draw, compute and write everything; see `cyclopean tolerance`."""
    from ..analysis.tolerances import tolerance_analysis

    setup = read_setup(request.setup)
    _check(request)
    tolerances = drawn_tolerances(request.tolerances, setup, request.usual)
    rig = setup.rig()
    if len(rig) < 2:
        raise SetupError(
            f"{request.setup}: depth needs two views or more, and this {setup.optic.kind} gives {len(rig)}"
        )
    folder = output_folder(request.output)
    near, far = chosen_depths(request.depths, setup, rig)
    depths = [float(f"{depth:.4g}") for depth in np.geomspace(near, far, 5)]
    plan = _plan(request, setup, (near, far))
    with progress_bars() as progress:
        analysis = tolerance_analysis(
            setup, tolerances, depths, draws=request.draws, noise=request.noise_px, plan=plan, seed=request.seed,
            progress=lambda done, total: progress("drawing setups", done, total),
        )  # fmt: skip
    with console.status("writing"):
        write_tolerances(folder, request, analysis)
    say_tolerances(analysis, request)
    console.print(f"-> {folder}/report.html, tolerances.png, tolerances.csv, draws.npz")


def _check(request):
    if not 0 < request.require < np.inf:
        raise SetupError(f"--require wants a positive percentage of the depth, got {request.require}")
    if request.photos == 0 and request.camera_photos == 0 and (request.board is not None or request.free):
        raise SetupError("--photos 0 means no calibration: leave --board and --free out, or give photographs")
    if request.draws > 1_000_000:
        raise SetupError(f"{request.draws:,} draws do not fit into memory; a million is plenty")
    if request.seed < 0:
        raise SetupError(f"--seed wants a whole number, 0 or more, got {request.seed}")


def drawn_tolerances(given: Sequence[str], setup: Setup, usual: bool) -> list[Tolerance]:
    """The usual tolerances where they are wanted, then those that texts NAME=VALUE[:SHAPE] stand for."""
    from ..analysis.tolerances import Shape, Tolerance, usual_tolerances

    found = list(usual_tolerances(setup)) if usual else []
    for text in given:
        start, colon, shape = (part.strip() for part in text.partition(":"))
        if colon and shape not in get_args(Shape):
            raise SetupError(f"{_OPTION} {text}: after the colon comes one of {', '.join(get_args(Shape))}")
        name, _, value = (part.strip() for part in start.partition("="))
        if re.fullmatch(r"\+?0*\.?0+(e\d+)? *(mm|deg|px)?", value):
            found.append(Tolerance(name, 0.0))
            continue
        ((name, size),) = parse_tolerances([start], setup).items()
        found.append(Tolerance(name, size, shape or "normal"))  # type: ignore[arg-type]
    if found and not any(tolerance.size for tolerance in found):
        raise SetupError(f"every tolerance is 0, so there is nothing to draw: give {_OPTION} NAME=VALUE above 0")
    if not found:
        raise SetupError(f"--no-usual leaves nothing to draw: give {_OPTION} NAME=VALUE, for example optic.apex=0.02")
    return found


def _plan(request, setup, depths):
    from ..analysis.tolerance_calibration import usual_plan
    from ..files import read_board

    if request.photos == 0 and request.camera_photos == 0:
        return None
    board = None if request.board is None else read_board(request.board)
    return usual_plan(
        setup, depths, board, photos=request.photos, direct_photos=request.camera_photos,
        sigma=request.corner_noise_px, free=request.free or None,
    )  # fmt: skip


def samples_of(analysis: ToleranceAnalysis) -> Iterator[tuple[str, DepthErrorSample]]:
    """The samples of errors by name: before and, where there was one, after calibration."""
    yield "before", analysis.before
    if analysis.after is not None:
        yield "after", analysis.after


def say_tolerances(analysis: ToleranceAnalysis, request: ToleranceRequest) -> None:
    """Tell the person what came out."""
    console.print(
        f"{request.setup.name}: {counted(len(analysis.deviations), 'setup')} drawn, seed {analysis.seed}; "
        + ("no calibration" if analysis.plan is None else f"calibration from {analysis.plan.text}")
    )
    for title, (columns, rows) in tables_of(analysis, request.require).items():
        table = Table(title=title, title_justify="left", box=None)
        for k, column in enumerate(columns):
            table.add_column(column, justify="right" if k else "left", no_wrap=not k)
        for row in rows:
            table.add_row(*map(str, row))
        console.print(table)
        console.print()
    for remark in remarks_of(analysis):
        console.print(remark, style="yellow")


def tables_of(analysis: ToleranceAnalysis, require: float) -> dict[str, tuple[tuple[str, ...], list[tuple[str, ...]]]]:
    """Heading -> columns and rows of text: errors by depth, then what they come from."""
    tables = {}
    for when, sample in samples_of(analysis):
        columns = ("depth", *(f"{100 * level:g} %" for level in _LEVELS), "95 % in % of depth", "bias", "sigma")
        columns += ("first order", f"under {require:g} % (%)", "lost (%)")
        title = f"depth errors {when} calibration, mm: what 50 to 99 % of them do not exceed"
        tables[title] = columns, list(_depth_rows(sample, require))
    tables["what they come from"] = _driver_table(analysis)
    return tables


def _depth_rows(sample, require):
    quantiles, passing, lost = sample.quantiles(_LEVELS), sample.passing(require), sample.lost
    for k, depth in enumerate(sample.depths):
        yield (
            f"{depth:g}",
            *(_mm(value) for value in quantiles[k]),
            _mm(100 * quantiles[k, 2] / depth),
            *(_mm(part[k]) for part in (sample.bias, sample.sigma, sample.linear_sigma)),
            _percent(passing[k]),
            _percent(lost[k]),
        )
    yield ("all", *([""] * 8), _percent(passing[-1]), "")


def _mm(value):
    return "-" if np.isnan(value) else "none" if np.isinf(value) else f"{value:.3g}" if abs(value) >= 1e-4 else "0"


def _percent(share):
    return "-" if np.isnan(share) else f"{100 * share:.1f}"


def _driver_table(analysis):
    """Columns and rows of the parameters that matter, and all others in one row."""
    from ..plotting.tolerances import NOT_LINEAR, size_text

    drivers, after = analysis.drivers, analysis.sources
    columns = ("parameter", "tolerance", "share before (%)", "first order (%)", "rank correlation")
    columns += ("share after (%)",) if after else ()
    shares, linear = drivers.overall, drivers.linear.sum(0) / max(drivers.linear.any(-1).sum(), 1)
    middle = len(analysis.before.depths) // 2
    rows, rest = [], []
    for k in drivers.order:
        name = drivers.names[k]
        if max(linear[k], after.get(name, 0.0)) < _SMALL:
            rest.append(k)
            continue
        texts = (name, size_text(name, analysis.tolerances[name]), _percent(shares[k]), _percent(linear[k]))
        texts += (f"{drivers.ranks[middle, k]:+.2f}",)
        rows.append(texts + ((_percent(after[name]),) if after else ()))
    if rest:
        left = sum(after.get(drivers.names[k], 0.0) for k in rest)
        texts = (f"{len(rest)} others", "", _percent(shares[rest].sum()), _percent(linear[rest].sum()), "")
        rows.append(texts + ((_percent(left),) if after else ()))
    if drivers.unexplained >= _UNEXPLAINED:
        rows.append((NOT_LINEAR, "", _percent(drivers.unexplained), "", "") + (("",) if after else ()))
    if after:
        noise = _percent(after["noise of corners"])
        rows.append(("noise of corners", f"sigma {analysis.plan.sigma:g} px", "", "", "", noise))
    return columns, rows


def remarks_of(analysis: ToleranceAnalysis) -> list[str]:
    """What the person should know about the figures."""
    remarks = []
    if analysis.interrupted:
        remarks.append(f"interrupted: {len(analysis.deviations):,} of {analysis.wanted:,} setups were drawn")
    empty = np.isnan(analysis.before.lost)  # no point of the drawing's field
    if empty.any():
        depths = ", ".join(f"{depth:g}" for depth in analysis.before.depths[empty])
        remarks.append(f"no two views of the drawing share anything at {depths} mm: left out")
    failed = int(analysis.before.failed.sum())
    if failed:
        remarks.append(f"{counted(failed, 'setup')} of {len(analysis.deviations):,} give no depth at all")
    astray = np.nanmax(analysis.before.astray)
    if astray > 0:
        remarks.append(
            f"up to {100 * astray:.2g} % of the points get no depth before calibration: their rays part, or cross more "
            "than ten times too far away; they count as errors without end"
        )
    lost = np.nanmax(analysis.before.lost)
    if lost > _LOST:
        remarks.append(
            f"up to {100 * lost:.1f} % of the points lie where fewer than two views of the real setup show them: the "
            "common field is that much smaller than drawn, and these points do not count in errors and limits"
        )
    ratio = analysis.before.sigma / np.maximum(analysis.before.linear_sigma, 1e-300)
    if np.any(np.abs(ratio - 1) > _FAR_FROM_LINEAR) and analysis.before.linear_sigma.max() > 0:
        after = (
            "" if analysis.after is None else "; what is left after calibration is of first order: a rough guide here"
        )
        remarks.append(f"the tolerances are too wide for first-order formulas: trust the draws{after}")
    remarks += _what_is_left(analysis)
    return remarks


def _what_is_left(analysis):
    if not analysis.sources:
        return []
    name = max(analysis.sources, key=lambda key: analysis.sources[key])
    share = analysis.sources[name]
    if share < _MAIN or name not in analysis.remainder.held:
        return []
    advice = (
        "photograph the board without the optic as well (--camera-photos)"
        if name.startswith("camera.")
        else (f"let the calibration find it (--free {name})")
    )
    return [f"{100 * share:.0f} % of what calibration leaves comes from {name}, which it takes as drawn: {advice}"]


def write_tolerances(folder: Path, request: ToleranceRequest, analysis: ToleranceAnalysis) -> None:
    """Write the numbers first, then the picture, then the report."""
    from ..plotting.report import write_report
    from ..plotting.tolerances import tolerance_picture

    _write_table(folder / "tolerances.csv", analysis, request.require)
    _write_draws(folder / "draws.npz", analysis)
    picture = tolerance_picture(analysis, request.require)
    save_figure(picture, folder / "tolerances.png")
    how = "no calibration" if analysis.plan is None else f"Calibration: {analysis.plan.text}."
    write_report(
        folder / "report.html",
        f"Tolerances of {request.setup.name}",
        f"{len(analysis.deviations):,} setups drawn at random (seed {analysis.seed}), exact rays. Depth errors are "
        f"computed minus true, at {len(analysis.before.points)} points of the common field; noise of matched pixels "
        f"{analysis.noise:g} px. {how}",
        tables_of(analysis, request.require),
        {"Spread of the errors, setups that keep a limit, and where the errors come from": picture},
        remarks_of(analysis),
        _captions(analysis, request.require),
    )


def _captions(analysis, require):
    """What to know about the tables, by heading."""
    *errors, sources = tables_of(analysis, require)
    counted_points = (
        f"Under {require:g} %: setups whose largest error over the field stays under {require:g} % of the depth. "
        "Points that a setup has lost (last column) do not count in it, nor in any error; a setup that shows no point "
        "of a depth fails there."
    )
    return dict.fromkeys(errors, counted_points) | {
        sources: "Shares of the variance over all depths; rank correlation at middle depth."
    }


def _write_table(path, analysis, require):
    names = [f"abs_error_{100 * level:g}_percent_mm" for level in _LEVELS]
    columns = ["calibration", "depth_mm", *names, "bias_mm", "sigma_mm", "first_order_sigma_mm"]
    columns += [f"share_under_{require:g}_percent", "lost_share"]
    rows = []
    for when, sample in samples_of(analysis):
        quantiles, passing = sample.quantiles(_LEVELS), sample.passing(require)
        for k, depth in enumerate(sample.depths):
            numbers = (*quantiles[k], sample.bias[k], sample.sigma[k], sample.linear_sigma[k], passing[k])
            rows.append([when, f"{depth:g}", *(f"{x:.6g}" for x in (*numbers, sample.lost[k]))])
    write_csv(path, columns, rows)


def _write_draws(path, analysis):
    arrays = {
        "names": np.array(analysis.names), "deviations": analysis.deviations, "points": analysis.before.points,
        "depths": analysis.before.depths, "plane": analysis.before.plane, "seed": analysis.seed,
    }  # fmt: skip
    for when, sample in samples_of(analysis):
        arrays[f"errors_{when}"] = sample.errors.astype(np.float32)
    with replacing(path) as file:
        np.savez_compressed(file, **arrays)
