"""Plain sentences for what pydantic finds wrong in a scene file."""

from __future__ import annotations

import difflib
from dataclasses import dataclass
from typing import Any

from pydantic import BaseModel, ValidationError
from pydantic_core import ErrorDetails

from .keys import about_unknown, meant_by, text_of
from .scene_tables import OBJECTS, LampTable, LightTable, PaintedTable, SceneFile

_HOMES: dict[str, type[BaseModel]] = {
    "[light]": LightTable,
    "[[light.lamp]]": LampTable,
    **{f'[[object]] of kind "{kind}"': table for kind, table in OBJECTS.items()},
}


@dataclass(frozen=True)
class _Place:
    """Where a fault lies: the words for its table, the table itself, what the file has there, and the key."""

    where: str
    table: type[BaseModel]
    content: Any
    key: str | None

    @classmethod
    def of(cls, location: tuple[str | int, ...], document: dict[str, Any]) -> _Place:
        top, *rest = location or (None,)
        if top == "object" and rest:
            number, *rest = rest
            content = document["object"][number]
            kind = rest[0] if rest else None
            table = OBJECTS.get(str(kind), PaintedTable)
            where = f"object {int(number) + 1}" + (f" ({kind})" if kind else "")
            return cls(f"{where}: ", table, content, str(rest[1]) if len(rest) > 1 else None)
        if top == "light" and rest[:1] == ["lamp"] and len(rest) > 1:
            number = int(rest[1])
            content = document["light"]["lamp"][number]
            return cls(f"lamp {number + 1}: ", LampTable, content, str(rest[2]) if len(rest) > 2 else None)
        if top == "light" and rest:
            return cls("light.", LightTable, document["light"], str(rest[0]))
        return cls("", SceneFile, document, None if top is None else str(top))

    @property
    def value(self) -> Any:
        """What the file says there; None when it says nothing."""
        if self.key is None:
            return self.content
        return self.content.get(self.key) if isinstance(self.content, dict) else None


def sentences(error: ValidationError, document: dict[str, Any]) -> list[str]:
    """One sentence for each wrong key of a document, with its value, what it takes, and what it may have meant."""
    said: dict[tuple[str, str | None], str] = {}
    meant = set()
    found = [(_Place.of(detail["loc"], document), detail) for detail in error.errors(include_url=False)]
    for place, detail in found:
        if detail["type"] == "extra_forbidden":
            meant |= {(place.where, name) for name in meant_by(str(place.key), place.table)}
    for place, detail in found:
        at = (place.where, place.key)
        if at in meant and place.value is None:
            continue  # missing, but the sentence about the unknown key says it
        if at not in said or detail["type"] == "value_error":
            said[at] = _sentence(place, detail)
    return list(said.values())


def _sentence(place: _Place, detail: ErrorDetails) -> str:
    here = f"{place.where}{place.key or ''}"
    if detail["type"] in ("union_tag_not_found", "union_tag_invalid"):
        return f"{place.where}{_about_kind(place.content)}"
    if detail["type"] == "extra_forbidden":
        return f"{here} = {text_of(place.value)}: {about_unknown(str(place.key), place.table, _HOMES)}"
    if detail["type"] == "value_error":
        return f"{here.removesuffix(': ') if place.key is None else here}: {detail['ctx']['error']}"
    wanted = "a table" if place.key is None else place.table.model_fields[place.key].description
    if detail["type"] == "missing":
        return f"{here} is missing: {wanted}"
    if place.key is None:
        return f"{place.where}{text_of(place.value)} must be a table"
    return f"{here} = {text_of(place.value)} must be {wanted}"


def _about_kind(content: Any) -> str:
    kind = content.get("kind") if isinstance(content, dict) else None
    if kind is None:
        return f"kind is missing: one of {', '.join(OBJECTS)}"
    close = difflib.get_close_matches(str(kind), OBJECTS, n=1)
    hint = f"; did you mean {close[0]}?" if close else ""
    return f"kind = {text_of(kind)} must be one of {', '.join(OBJECTS)}{hint}"
