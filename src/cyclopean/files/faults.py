"""Plain sentences for what pydantic finds wrong in a setup file."""

from __future__ import annotations

import difflib
from dataclasses import dataclass
from typing import Any

from pydantic import ValidationError
from pydantic_core import ErrorDetails

from .keys import about_unknown, meant_by, text_of
from .tables import OPTICS, CameraTable, LightTable, MirrorTable, SceneTable, SetupTable, Table

_TABLES: dict[str, type[Table]] = {"camera": CameraTable, "light": LightTable, "scene": SceneTable}
_HOMES = {
    **{f"[{name}]": table for name, table in _TABLES.items()},
    **{f'[optic] of kind "{kind}"': table for kind, table in OPTICS.items()},
}
_WRONG_KIND_OF_TABLE = ("model_type", "model_attributes_type")


@dataclass(frozen=True)
class _Place:
    """Where a fault lies: the table, its path in the file, and the key in it; None when it is the table itself."""

    table: type[Table]
    path: tuple[str | int, ...]
    key: str | None

    @classmethod
    def of(cls, location: tuple[str | int, ...]) -> _Place:
        top, *rest = location or (None,)
        if top in _TABLES and rest:
            return cls(_TABLES[str(top)], location[:1], str(rest[0]))
        if top == "optic" and rest:
            kind, *rest = rest
            if kind == "mirrors" and rest[:1] == ["mirrors"] and len(rest) > 1:
                return cls(MirrorTable, ("optic", "mirrors", rest[1]), str(rest[2]) if len(rest) > 2 else None)
            return cls(OPTICS[str(kind)], ("optic",), str(rest[0]) if rest else None)
        return cls(SetupTable, (), None if top is None else str(top))

    @property
    def name(self) -> str:
        """As in optic.mirrors[0].size_mm."""
        parts = (*self.path, *(() if self.key is None else (self.key,)))
        return "".join(f"[{part}]" if isinstance(part, int) else f".{part}" for part in parts).lstrip(".")

    def value(self, document: Any) -> Any:
        """What the file says there; None when it says nothing."""
        for part in self.path:
            document = document[part]
        return document if self.key is None else document.get(self.key)

    @property
    def wanted(self) -> str:
        """What the key takes."""
        return str(self.table.model_fields[self.key].description) if self.key is not None else "a table"


def sentences(error: ValidationError, document: dict[str, Any]) -> list[str]:
    """One sentence for each wrong key of a document, with its value, what it takes, and what it may have meant."""
    found = [(_Place.of(detail["loc"]), detail) for detail in error.errors(include_url=False)]
    meant = {
        (place.path, name)
        for place, detail in found
        if detail["type"] == "extra_forbidden"
        for name in meant_by(str(place.key), place.table)
    }
    said: dict[str, str] = {}
    for place, detail in found:
        if (place.path, place.key) in meant and place.value(document) is None:
            continue  # missing, but the sentence about the unknown key says it
        if place.name not in said or _own_text(detail):
            said[place.name] = _sentence(place, detail, document)
    return list(said.values())


def _own_text(detail: ErrorDetails) -> str:
    """The text of an exception that our own checks raised, on one line, or none."""
    return " ".join(str(detail["ctx"]["error"]).split()) if detail["type"] == "value_error" else ""


def _sentence(place: _Place, detail: ErrorDetails, document: dict[str, Any]) -> str:
    value = place.value(document)
    with_value = f"{place.name} = {text_of(value)}"
    if detail["type"] == "extra_forbidden":
        return f"{with_value}: {about_unknown(str(place.key), place.table, _HOMES)}"
    if detail["type"] == "union_tag_not_found":
        return 'optic.kind is missing: "prism", "mirrors" or "plate"'
    if detail["type"] == "union_tag_invalid":
        kind = value.get("kind")
        close = difflib.get_close_matches(str(kind), OPTICS, n=1)
        hint = f'; did you mean "{close[0]}"?' if close else ""
        return f'optic.kind = {text_of(kind)} must be "prism", "mirrors" or "plate"{hint}'
    if detail["type"] in _WRONG_KIND_OF_TABLE:
        return f"{with_value} must be {place.wanted}"
    if _own_text(detail):
        is_table = value is None or isinstance(value, dict)
        return f"{place.name if is_table else with_value}: {_own_text(detail)}".removeprefix(": ")
    if value is None:
        return f"{place.name} is missing: {place.wanted}"
    return f"{with_value} must be {place.wanted}"
