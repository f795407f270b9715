"""Compared calibrations for the person: lines at the terminal, a picture, a page and plain data."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from rich.table import Table

from ..files import replacing
from .console import console, counted, save_figure

if TYPE_CHECKING:
    from ..calibration.comparison import Comparison, Route

_COLUMNS = (
    "route",
    "time (s)",
    "pixels (px rms)",
    "shape (mm rms)",
    "shape, largest (mm)",
    "shape (rms, % of depth)",
    "square, mean off (mm)",
    "square, mean off (%)",
    "flat (mm rms)",
)
_DRIFTED = 3.0  # %, by which depths may be off before a note says so
_ALIKE = 0.3  # of that, how far it may vary over the photographs and still be one factor


def comparison_table(comparison: Comparison) -> tuple[tuple[str, ...], list[tuple[str, ...]]]:
    """Columns and rows of the figures of every route."""
    return _COLUMNS, [_row(comparison, route) for route in comparison.routes]


def _row(comparison: Comparison, route: Route) -> tuple[str, ...]:
    """One route's figures as text."""
    if route.failed:
        return (route.name, *["-"] * (len(_COLUMNS) - 1))
    found = comparison.figures(route)
    return (
        route.name,
        _text(route.seconds, ".2f"),
        _text(found.rms, ".3f"),
        _text(found.rigid, ".3f"),
        _text(found.rigid_max, ".2f"),
        _text(found.rigid_percent, ".4f"),
        _text(found.square, "+.4f"),
        _text(found.square_percent, "+.3f"),
        _text(found.flatness, ".3f"),
    )


def _text(value: float, form: str) -> str:
    return format(value, form) if np.isfinite(value) else "-"


def _bin_rows(comparison: Comparison) -> tuple[tuple[str, ...], list[tuple[str, ...]]]:
    """Columns and rows of the rigid fit of each route in each depth bin, % of depth."""
    routes = [route for route in comparison.routes if not route.failed]
    rows = [
        (name, *(_text(comparison.figures(route, mask).rigid_percent, ".4f") for route in routes))
        for name, mask in comparison.bins()
    ]
    return ("depth", *(route.name for route in routes)), rows


def _recovered_rows(comparison: Comparison) -> tuple[tuple[str, ...], list[tuple[str, ...]]]:
    """Columns and rows of what each route recovers of each known depth: mean, rms and largest error (mm)."""
    routes = [route for route in comparison.routes if not route.failed]
    rows = [
        (
            f"{found[0].depth:g}",
            *(f"{_text(row.mean, '.2f')} ({_text(row.rms, '.2f')}, {_text(row.largest, '.2f')})" for row in found),
        )
        for found in zip(*(comparison.depth_table(route) for route in routes), strict=True)
    ]
    return ("actual (mm)", *(route.name for route in routes)), rows


def _known_rows(comparison: Comparison) -> tuple[tuple[str, ...], list[tuple[str, ...]]]:
    """Columns and rows of each route's error (%) of the mean recovered depth at each known depth."""
    routes = [route for route in comparison.routes if not route.failed]
    tables = [comparison.depth_table(route) for route in routes]
    depths = np.unique(comparison.known[np.isfinite(comparison.known)])
    rows = [(f"{z:g} mm", *(_text(table[k].percent, "+.3f") for table in tables)) for k, z in enumerate(depths)]
    totals = np.transpose([comparison.depth_percent(route) for route in routes]) if routes else np.zeros((2, 0))
    rows += [
        (name, *(_text(x, ".3f") for x in row)) for name, row in zip(("rms (%)", "largest (%)"), totals, strict=True)
    ]
    return ("depth", *(route.name for route in routes)), rows


def comparison_remarks(comparison: Comparison, notes: Sequence[str]) -> list[str]:
    """What went wrong, then what to know."""
    wrong = [f"{route.name}: {route.message}" for route in comparison.routes if route.message]
    return [*wrong, *_drifts(comparison), *comparison.notes, *notes]


def _drifts(comparison: Comparison) -> list[str]:
    """Notes on virtual cameras whose depths are all off by one factor."""
    lines = []
    for route in comparison.routes:
        with np.errstate(invalid="ignore"):
            percent = 100 * (route.judgement.depth / comparison.depths - 1)
        percent = percent[np.isfinite(percent)]
        off = float(np.median(percent)) if percent.size else 0.0
        if not route.name.startswith("virtual") or abs(off) < _DRIFTED or np.ptp(percent) > 2 * _ALIKE * abs(off):
            continue
        size = comparison.figures(route).square_percent
        lines.append(
            f"{route.name}: depths are {abs(off):.1f} % too {'large' if off > 0 else 'small'} wherever the board "
            f"stood, while squares are {_text(size, '+.2f')} % off: the intrinsics drifted or the frame could not be "
            "aligned well, so that the scale along the axis is wrong; rely on none of its depths"
        )
    return lines


def write_comparison(folder: Path, setup_name: str, comparison: Comparison, notes: Sequence[str]) -> None:
    """Write comparison.json, comparison.png and report.html."""
    from .. import plotting
    from ..plotting.comparison import comparison_picture

    document = json.dumps(_document(comparison, notes), indent=1, allow_nan=False)
    with replacing(folder / "comparison.json") as file:
        file.write(document.encode())
    picture = comparison_picture(comparison)
    save_figure(picture, folder / "comparison.png")
    tables: dict[str, tuple[Sequence[str], Sequence[Sequence[object]]]] = {
        "All photographs that judged": comparison_table(comparison),
        "Shape by depth: rms misfit of a rigid motion, % of depth": _bin_rows(comparison),
    }
    if np.isfinite(comparison.known).any():
        tables["Error of the mean recovered depth, %; rms and largest error over all points"] = _known_rows(comparison)
        tables["Recovered depth (mm): mean, and in brackets the rms and the largest error"] = _recovered_rows(
            comparison
        )
    plotting.write_report(
        folder / "report.html",
        f"Calibrations of {setup_name} compared",
        f"Each calibrated from {counted(comparison.calibrations, 'photograph')} through the optic or more, judged by "
        f"{len(comparison.photos)} that it has not seen. Lengths in mm, of points triangulated from two views or more.",
        tables,
        {"Errors of every route over depth, and its reprojection error": picture},
        comparison_remarks(comparison, notes),
    )


def _document(comparison: Comparison, notes: Sequence[str]) -> dict[str, Any]:
    """Everything as plain data; None where there is no number."""
    photos = zip(comparison.photos, comparison.depths, comparison.known, strict=True)
    return _plain(
        {
            "units": "mm, px; *_percent in %",
            "photographs": [{"name": n, "depth": d, "known_depth": k} for n, d, k in photos],
            "spacing": comparison.spacing,
            "calibrated_from": comparison.calibrations,
            "routes": routes_document(comparison),
            "notes": [*_drifts(comparison), *comparison.notes, *notes],
        }
    )


def routes_document(comparison: Comparison) -> list[dict[str, Any]]:
    """Every route as plain data."""
    routes = []
    for route in comparison.routes:
        bins = {name: comparison.figures(route, mask)._asdict() for name, mask in comparison.bins()}
        routes.append(
            {
                "name": route.name,
                "seconds": route.seconds,
                "converged": route.converged,
                "message": route.message,
                "figures": comparison.figures(route)._asdict(),
                "by_depth": bins,
                "known_depths": [row._asdict() for row in comparison.depth_table(route)],
                "known_depths_percent": dict(zip(("rms", "largest"), comparison.depth_percent(route), strict=True)),
                "photographs": {name: values.tolist() for name, values in asdict(route.judgement).items()},
            }
        )
    return _plain(routes)


def _plain(value):
    if isinstance(value, dict):
        return {key: _plain(one) for key, one in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(one) for one in value]
    if isinstance(value, float | np.floating):
        return float(value) if np.isfinite(value) else None
    return value


def say_comparison(comparison: Comparison, notes: Sequence[str]) -> None:
    """Tell the person what came out."""
    console.print(
        f"judged by {counted(len(comparison.photos), 'photograph')} that no calibration has seen, the pose of the "
        "board fitted:"
    )
    _print_table(*comparison_table(comparison))
    if len(comparison.bins()) > 1:
        console.print("\nshape by depth: rms misfit of a rigid motion, % of depth:")
        _print_table(*_bin_rows(comparison))
    if np.isfinite(comparison.known).any():
        console.print("\nerror of the mean recovered depth, %, then rms and largest error over all points:")
        _print_table(*_known_rows(comparison))
    for remark in comparison_remarks(comparison, notes):
        console.print(f"note: {remark}", style="yellow")


def _print_table(columns, rows):
    table = Table(box=None, padding=(0, 1, 0, 0))
    table.add_column(columns[0], no_wrap=True)
    for name in columns[1:]:
        table.add_column(name, justify="right", max_width=10)
    for row in rows:
        table.add_row(*row)
    console.print(table)
