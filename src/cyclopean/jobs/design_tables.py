"""The tables of `cyclopean design`: what the chosen prisms are, and what they do."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from rich.table import Table

from .console import console

if TYPE_CHECKING:
    from ..design.requirements import Candidate, Designs, Requirements

Columns = tuple[str, ...]
Rows = list[tuple[str, ...]]

CAPTIONS = {
    "the prisms": (
        "Distance: from the pinhole to the nearest point of the glass on the axis. Length: to the prism's far end. "
        "Baseline: between neighbouring virtual cameras."
    ),
    "what they do": (
        "On paper: standard deviation of depth by noise of matching, root mean square over the field at the worst "
        "depth. Kept: what 95 % of the prisms keep as they are really made, mounted and calibrated; holds in: how many "
        "keep what is asked for. Field: the largest rectangle about the axis that two views or more see. Sensor use: "
        "pixels whose point two views or more see. Blend: band beside seams in which the open lens mixes views. "
        "Colours: spread of a point by the light's band."
    ),
}


def design_tables(designs: Designs, written: Sequence[int], letters: str) -> dict[str, tuple[Columns, Rows]]:
    """Heading -> columns and rows: the prisms, then what they do."""
    reasons = {choice.index: ", ".join(choice.reasons) for choice in designs.chosen}
    chosen = [(letter, designs.candidates[k], reasons.get(k, "")) for letter, k in zip(letters, written, strict=True)]
    return {
        "the prisms": prism_table(chosen),
        "what they do": figure_table([(letter, candidate) for letter, candidate, _ in chosen], designs.requirements),
    }


def nearest_tables(designs: Designs) -> dict[str, tuple[Columns, Rows]]:
    """The same of the candidate that misses the requirements by least."""
    nearest = designs.explanation.nearest
    assert nearest is not None
    return {
        "the prism that misses by least": prism_table([("nearest", nearest, "")]),
        "what it does": figure_table([("nearest", nearest)], designs.requirements),
    }


def prism_table(chosen: Sequence[tuple[str, Candidate, str]]) -> tuple[Columns, Rows]:
    """Columns and rows of what the prisms are."""
    columns = ("", "facets", "apex (deg)", "glass", "distance (mm)", "diameter x thickness (mm)", "length (mm)")
    columns += ("mass (g)", "baseline (mm)", "chosen as")
    rows: Rows = []
    for letter, candidate, reason in chosen:
        prism, figures = candidate.prism, candidate.figures
        rows.append((
            letter, str(prism.facets), f"{prism.apex_deg:.4g}", _glass(prism), f"{prism.distance:.4g}",
            f"{figures.diameter:.4g} x {prism.thickness:.3g}", f"{figures.length:.4g}", number(figures.mass),
            number(figures.baseline), reason,
        ))  # fmt: skip
    return columns, rows


def figure_table(chosen: Sequence[tuple[str, Candidate]], requirements: Requirements) -> tuple[Columns, Rows]:
    """Columns and rows of what the prisms do."""
    near, far = requirements.depths
    middle = chosen[0][1].figures.depths[chosen[0][1].figures.middle] if chosen else (near + far) / 2
    columns = ("", "on paper (%)", "kept (%)", "holds in")
    columns += tuple(
        f"field at {depth:.5g} (mm)" if depth == near else f"at {depth:.5g}"
        for depth in (near, float(f"{middle:.3g}"), far)
    )
    columns += (f"by all at {number(middle)}", "sensor use (%)", "blend (px)", "colours (px)")
    rows: Rows = []
    for letter, candidate in chosen:
        figures = candidate.figures
        fields = [figures.field_two[k] for k in (0, figures.middle, -1)]
        rows.append((
            letter, percent(figures.accuracy), *kept_texts(candidate), *map(_size, fields),
            _size(figures.field_all[figures.middle]), f"{100 * figures.use:.0f}",
            f"{figures.blend:.3g}" if requirements.f_number is not None else "-", number(figures.chromatic),
        ))  # fmt: skip
    if all(row[2] == "-" for row in rows):
        return _without(columns, (2, 3)), [_without(row, (2, 3)) for row in rows]
    return columns, rows


def _without(row, places):
    return tuple(cell for k, cell in enumerate(row) if k not in places)


def _glass(prism):
    return prism.glass if isinstance(prism.glass, str) else f"index {prism.glass}"


def _size(pair):
    return "none" if not min(pair) > 0 else " x ".join(f"{side:.0f}" if side >= 9.5 else f"{side:.2g}" for side in pair)


def kept_texts(candidate: Candidate) -> tuple[str, str]:
    """The error (% of depth) that 95 % of the prisms made keep once calibrated, and how many keep what is asked for."""
    kept = candidate.kept
    if kept is None:
        return "-", "-"
    share = f"{100 * kept.share:.0f} %" if np.isfinite(kept.share) else "-"
    return percent(kept.worst), share


def number(value: float) -> str:
    """A number with three digits, or a dash for none."""
    return "-" if not np.isfinite(value) else f"{value:.0f}" if abs(value) >= 100 else f"{value:.3g}"


def percent(share: float) -> str:
    """A share in percent."""
    return f"{100 * share:.3g}" if np.isfinite(share) else "none"


def say_tables(tables: dict[str, tuple[Columns, Rows]]) -> None:
    """Print tables."""
    for heading, (columns, rows) in tables.items():
        table = Table(title=heading, title_justify="left", box=None, padding=(0, 1, 0, 0))
        for k, column in enumerate(columns):
            words = column in ("", "chosen as", "glass")
            table.add_column(column, justify="left" if words else "right", no_wrap=not k)
        for row in rows:
            table.add_row(*row)
        console.print(table)
        if heading in CAPTIONS:
            console.print(CAPTIONS[heading], style="dim")
        console.print()
