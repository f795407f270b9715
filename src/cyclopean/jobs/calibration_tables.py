"""The tables of a calibration, as texts."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING

import numpy as np

from ..targets import DIRECT
from .calibration_photographs import COLOURS

if TYPE_CHECKING:
    from ..calibration.depths import DepthErrors
    from ..calibration.physical import Calibration
    from ..calibration.validation import Validation
    from .calibration_request import Request

_HELD_DIGITS = 7
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
_NOT_COMPARED = (
    "not asked for: --compare sets a ray sketch, virtual cameras and this model side by side here, "
    "`cyclopean compare-calibrations` all routes"
)


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


def held_rows(calibration: Calibration) -> list[tuple[str, str, str, str, str]]:
    """Rows as those of `parameter_rows` for what was held; facets that do not deviate are one row."""
    from ..calibration.unknowns import kind_of

    unknowns, channel = calibration.unknowns, len(calibration.setups) // 2
    values = unknowns.parameters(calibration.solution.shared, channel)
    held = ~np.any(unknowns.matrix[channel] != 0, axis=-1)
    rows, plain = [], 0
    for name, value, idle in zip(calibration.setup.parameter_names, values, held, strict=True):
        if idle and value == 0 and re.match(r"optic\.facet\d", name):
            plain += 1
        elif idle:
            kind = kind_of(name)
            text = f"{kind.factor * value + 0.0:.{_HELD_DIGITS}g}"
            rows.append((name, text, text, "held", kind.unit))
    return rows + ([(f"optic.facets ({plain} values)", "0", "0", "held", "deg")] if plain else [])


def depth_title(errors: DepthErrors) -> str:
    """What the table of depth errors shows."""
    return f"standard deviation of depth, rms over the common field, for pixels matched to {errors.pixel_sigma:g} px"


def depth_rows(errors: DepthErrors) -> list[tuple[str, ...]]:
    """The table of depth errors as texts."""
    return [(f"{depth:.0f}", *(f"{value:.3g}" for value in parts)) for depth, *parts in errors.table()]


def held_out_rows(validation: Validation) -> list[tuple[str, ...]]:
    """The table of the validation as texts, without depths at which there is no photograph."""
    return [
        tuple(
            text.replace("+nan", "-").replace("nan", "-")
            for text in (name, str(photos), f"{px:.3g}", f"{flat:.3g}", f"{mean:+.3f}", f"{spread:.2g}", f"{shape:.3g}")
        )
        for name, photos, px, flat, mean, spread, shape in validation.table()
        if photos
    ]


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
    if not request.compare:
        rows.append(("comparison of routes", _NOT_COMPARED))
    return rows
