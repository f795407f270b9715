"""What a search for prisms found: one JSON file of everything, and a shopping list for each that is chosen."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import fields, is_dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from ..cameras import Camera
from ..optics import Prism
from .disk import PathLike, replacing, write_json

if TYPE_CHECKING:
    from ..design.requirements import Candidate, Designs

Rows = Sequence[tuple[str, str]]

_UNITS = {  # keys of the file for fields whose unit is not in their name
    "depths": "depths_mm", "sigma": "sigma_of_depth", "sigma_worst": "worst_sigma_of_depth",
    "field_two": "field_two_mm",
    "field_all": "field_all_mm", "area_two": "area_two_mm2", "area_all": "area_all_mm2", "baseline": "baseline_mm",
    "deviation": "deviation_rad", "reflection_margin": "reflection_margin_rad", "diameter": "diameter_mm",
    "length": "length_mm", "thickness": "thickness_mm", "mass": "mass_g", "blend": "blend_px", "defocus": "defocus_px",
    "chromatic": "chromatic_px", "field": "field_mm", "max_diameter": "max_diameter_mm", "max_length": "max_length_mm",
    "max_blend": "max_blend_px", "max_chromatic": "max_chromatic_px", "distances": "distances_mm", "noise": "noise_px",
    "focus_distance": "focus_distance_mm", "corner_noise": "corner_noise_px",
}  # fmt: skip


def write_designs(
    path: PathLike,
    designs: Designs,
    written: Mapping[int, str],
    shopping: Mapping[int, Mapping[str, Rows]] | None = None,
) -> None:
    """Write requirements, every candidate and what kept others out as JSON.

    Parameters
    ----------
    path : path
        File to write.
    designs : Designs
        What the search found.
    written : mapping
        Index of a candidate -> its letter, which is also the folder of its files.
    shopping : mapping, optional
        Index of a candidate -> its shopping list, heading -> rows (what, value).
    """
    lists, front, shown = shopping or {}, set(designs.front), {*designs.front, *written}
    reasons = {choice.index: list(choice.reasons) for choice in designs.chosen}
    candidates = []
    for k, candidate in enumerate(designs.candidates):
        row: dict[str, Any] = {"letter": written.get(k), "pareto": k in front, "chosen_as": reasons.get(k, [])}
        row |= candidate_table(candidate) if k in shown else _short_table(candidate)
        if k in lists:
            row["shopping_list"] = {heading: dict(rows) for heading, rows in lists[k].items()}
        candidates.append(row)
    explanation = designs.explanation
    document = {
        "requirements": plain(designs.requirements),
        "screened": designs.screened,
        "traced": designs.traced,
        "candidates": candidates,
        "in_the_way": {
            "text": explanation.text,
            "failed": dict(explanation.failed),
            "failed_alone": dict(explanation.alone),
            "relaxations": plain(explanation.relaxations),
            "nearest": None if explanation.nearest is None else candidate_table(explanation.nearest),
        },
    }
    write_json(path, document)


def candidate_table(candidate: Candidate) -> dict[str, Any]:
    """A candidate as JSON can hold it."""
    return {
        "name": candidate.name,
        "prism": plain(candidate.prism),
        "figures": plain(candidate.figures),
        "kept": plain(candidate.kept),
    }


def _short_table(candidate: Candidate) -> dict[str, Any]:
    """A candidate that another betters in everything, in short."""
    prism, figures = candidate.prism, candidate.figures
    numbers = {
        "accuracy": figures.accuracy, "smallest_field_mm": figures.field, "length_mm": figures.length,
        "diameter_mm": figures.diameter, "baseline_mm": figures.baseline,
    }  # fmt: skip
    return {"name": candidate.name, "azimuth_deg": prism.azimuth_deg} | {key: plain(x) for key, x in numbers.items()}


def plain(value: Any) -> Any:
    """Numbers, text, lists and dictionaries of anything with fields; what is no finite number is None."""
    if isinstance(value, Camera):
        keys = {"size": "size_px", "focal": "focal_px", "centre": "centre_px", "pixel_pitch": "pixel_pitch_mm"}
        return {keys.get(f.name, f.name): plain(getattr(value, f.name)) for f in fields(value)}
    if isinstance(value, Prism):
        keys = {"distance": "distance_mm", "thickness": "thickness_mm", "radius": "radius_mm", "shift": "shift_mm"}
        return {keys.get(f.name, f.name): plain(getattr(value, f.name)) for f in fields(value)}
    if is_dataclass(value):
        return {_UNITS.get(f.name, f.name): plain(getattr(value, f.name)) for f in fields(value)}
    if isinstance(value, Mapping):
        return {str(key): plain(item) for key, item in value.items()}
    if isinstance(value, str | bool | int | None):
        return value
    if isinstance(value, float | np.floating):
        return float(f"{value:.6g}") if np.isfinite(value) else None
    if isinstance(value, np.ndarray | list | tuple | set | frozenset):
        return [plain(item) for item in (value.tolist() if isinstance(value, np.ndarray) else value)]
    return value.item() if isinstance(value, np.generic) else str(value)


def write_shopping_list(path: PathLike, title: str, remarks: Sequence[str], lists: Mapping[str, Rows]) -> None:
    """Write a shopping list as Markdown: heading -> rows (what, value)."""
    parts = [f"# {title}\n", *(f"{remark}\n" for remark in remarks)]
    for heading, rows in lists.items():
        body = "\n".join(f"| {_cell(what)} | {_cell(value)} |" for what, value in rows)
        parts.append(f"## {heading}\n\n| what | value |\n| :-- | :-- |\n{body}\n")
    with replacing(path) as file:
        file.write("\n".join(parts).encode())


def _cell(text: str) -> str:
    return str(text).replace("|", "\\|")
