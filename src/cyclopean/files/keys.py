"""Wrong keys of TOML files: which key one may have meant, and its value as the file has it."""

from __future__ import annotations

import difflib
import json
from collections.abc import Mapping
from typing import Any

from pydantic import BaseModel

_WANTED_UNITS = {
    "mm": "lengths are in mm",
    "deg": "angles are in degrees",
    "px": "lengths on the picture are in px",
    "nm": "wavelengths are in nm",
    "um": "the distance between pixels is in micrometres",
}
_UNITS = {*_WANTED_UNITS, "m", "cm", "dm", "inch", "in", "rad", "mrad", "degrees", "degree", "arcmin", "pixels"}
_TEXT_LENGTH = 60  # of a value in a message
_LIKENESS = 0.7  # of two keys, by difflib's measure, for one to be a slip of the other


def meant_by(key: str, table: type[BaseModel]) -> list[str]:
    """The keys of a table that an unknown one probably stands for."""
    known = list(table.model_fields)
    stem = _without_unit(key)
    return [name for name in known if stem == _without_unit(name)] or difflib.get_close_matches(
        key, known, 1, _LIKENESS
    )


def about_unknown(key: str, table: type[BaseModel], homes: Mapping[str, type[BaseModel]]) -> str:
    """What to say of a key that a table does not have; `homes` are the other tables, by what they are called."""
    meant = meant_by(key, table)
    if meant and _without_unit(key) == _without_unit(meant[0]):
        units = [(_WANTED_UNITS.get(name.rpartition("_")[2]), name) for name in meant]
        return "; ".join(f"{unit}: {name}" if unit else f"this key is called {name}" for unit, name in units)
    for home, other in homes.items():
        if key in other.model_fields:
            return f"this key belongs in {home}"
    if meant:
        return f"unknown key; did you mean {meant[0]}?"
    return f"unknown key; the known ones are {', '.join(table.model_fields)}"


def text_of(value: Any) -> str:
    """A value as it stands in the file, shortened."""
    if isinstance(value, dict):
        return "{...}"
    if isinstance(value, list):
        text = f"[{', '.join(map(text_of, value))}]"
    elif isinstance(value, bool):
        text = str(value).lower()
    elif isinstance(value, str):
        text = json.dumps(value, ensure_ascii=False)
    else:
        text = str(value)
    return text if len(text) <= _TEXT_LENGTH else f"{text[:_TEXT_LENGTH]}..."


def _without_unit(key: str) -> str:
    stem, _, unit = key.rpartition("_")
    return stem if unit in _UNITS else key
