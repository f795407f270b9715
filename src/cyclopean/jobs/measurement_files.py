"""Measurements on disk: JSON and CSV for programs, a picture and a page for people."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ..files.disk import write_csv, write_json
from ..measurement.images import KINDS, Measurement
from ..rigs import Rig
from .console import save_figure
from .measurement_session import shown_value

COLUMNS = (
    "number", "kind", "value", "unit", "sigma", "sigma_calibration", "accuracy", "grade", "strength", "ambiguity",
    "residual_px", "flatness_mm", "points", "reasons",
)  # fmt: skip


@dataclass(frozen=True)
class Source:
    """What was measured in."""

    photo: Path
    setup: Path
    depths: tuple[float, float]  # mm
    window: int  # px
    pointing: float  # px
    channel: str
    calibration: Path | None


def write_measurements(folder: Path, source: Source, done: Sequence[Measurement]) -> None:
    """Write measurements.json and measurements.csv, whole or not at all."""
    document = {
        "kind": "cyclopean measurements",
        "format": 1,
        "photo": str(source.photo),
        "setup": str(source.setup),
        "calibration": None if source.calibration is None else str(source.calibration),
        "depths_mm": source.depths,
        "window_px": source.window,
        "pointing_px": source.pointing,
        "channel": source.channel,
        "measurements": [_entry(number, found) for number, found in enumerate(done, 1)],
    }
    write_json(folder / "measurements.json", document)
    write_csv(folder / "measurements.csv", COLUMNS, [_row(number, found) for number, found in enumerate(done, 1)])


def write_pictures(folder: Path, source: Source, photograph: np.ndarray, rig: Rig, done: Sequence[Measurement]) -> None:
    """Write measurements.png and report.html."""
    from ..plotting.measurement import measurement_picture
    from ..plotting.report import write_report

    figure = measurement_picture(photograph, rig, done, [shown_value(found) for found in done])
    save_figure(figure, folder / "measurements.png")
    columns, rows = value_table(done)
    near, far = source.depths
    settings = [
        ("photograph", source.photo.name), ("setup", source.setup.name),
        ("depths searched (mm)", f"{near:g} to {far:g}"),
        ("window (px)", source.window), ("pointing, standard deviation (px)", source.pointing),
        ("calibration", "not given" if source.calibration is None else source.calibration.name),
    ]  # fmt: skip
    write_report(
        folder / "report.html",
        f"Measurements in {source.photo.name}",
        "Values with their accuracy index: one standard deviation by matching, pointing and, where given, calibration.",
        {"Measurements": (columns, rows), "Settings": (("setting", "value"), settings)},
        {"Round: points as given. Crosses: where they were found. Squares: given by hand.": figure},
        [f"{found.kind} {k}: {found.grade}: {text}" for k, found in enumerate(done, 1) for text in found.reasons],
    )


def value_table(done: Sequence[Measurement]) -> tuple[tuple[str, ...], list[tuple[str, ...]]]:
    """Columns and rows for people."""
    columns = ("", "kind", "value +- accuracy index", "strength", "ambiguity", "beside curve (px)", "trust")
    rows: list[tuple[str, ...]] = []
    for k, found in enumerate(done, 1):
        residual = np.nan_to_num(found.located.residual, nan=-1).max(initial=-1)
        rows.append(
            (str(k), found.kind, shown_value(found), _short(found.strength), _short(found.ambiguity),
             "-" if found.result is None else f"{residual:.2f}", found.grade)
        )  # fmt: skip
    return columns, rows


def _short(value):
    return f"{value:.2f}" if np.isfinite(value) else "-"


def _entry(number, found):
    return {
        "number": number,
        "kind": found.kind,
        "value": _number(found.value),
        "unit": found.unit,
        "sigma": _number(found.sigma),
        "sigma_calibration": _number(found.sigma_calibration),
        "accuracy": _number(found.accuracy),
        "grade": found.grade,
        "reasons": found.reasons,
        "strength": _number(found.strength),
        "ambiguity": _number(found.ambiguity),
        "flatness_mm": _number(found.flatness),
        "points": [_point(found, k) for k in range(len(found.given))],
    }


def _point(found, k):
    located = found.located
    return {
        "view": int(found.views[k]),
        "pixel": found.given[k].pixel,
        "by_hand": found.given[k].by_hand,
        "pixels": _numbers(located.pixels[k]),
        "sigma_px": _numbers(located.sigma[k]),
        "strength": _numbers(located.strength[k]),
        "ambiguity": _numbers(located.ambiguity[k]),
        "residual_px": _number(located.residual[k]),
        "point_mm": _numbers(located.points[k]),
        "covariance_mm2": _numbers(located.covariance[k]),
        "reason": str(located.reason[k]),
    }


def _row(number, found):
    residual = np.nan_to_num(found.located.residual, nan=-1).max(initial=-1)
    points = " ".join("=".join(f"{x:g},{y:g}" for x, y in (p.pixel, *p.by_hand)) for p in found.given)
    numbers = (found.sigma, found.sigma_calibration, found.accuracy)
    numbers = ["" if _number(value) is None else f"{value:.6g}" for value in (found.value, *numbers)]
    quality = [
        "" if not np.isfinite(value) else f"{value:.4g}"
        for value in (found.strength, found.ambiguity, residual if residual >= 0 else np.nan, found.flatness)
    ]
    reasons = "; ".join(found.reasons)
    return (
        number,
        found.kind,
        numbers[0],
        KINDS[found.kind].unit,
        *numbers[1:],
        found.grade,
        *quality,
        points,
        reasons,
    )


def _number(value):
    return float(value) if np.isfinite(value) else None


def _numbers(values):
    if np.ndim(values) == 0:
        return _number(values)
    return [_numbers(value) for value in values]
