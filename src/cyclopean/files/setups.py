"""Setups as TOML files that people write by hand: units stand in the names of the keys.

[camera]
size_px = [1280, 960]
focal_px = 2400.0

[optic]
kind = "prism"
facets = 3
apex_deg = 12.0
glass = "N-BK7"
distance_mm = 60.0
"""

from __future__ import annotations

from collections.abc import Mapping
from decimal import Decimal
from numbers import Integral, Real
from typing import Any

import numpy as np

from .. import __version__
from ..errors import MediumError, OutputError, SetupError
from ..optics import Medium, medium
from ..rigs import Setup
from .disk import PathLike, on_one_line, parse_toml, read_text, replacing

FORMAT = 1
HEADER = f"""\
# cyclopean setup, format {FORMAT}, written by cyclopean {__version__}
# Units stand in the names. Camera frame: x right, y down, z forward; pixel (0, 0) is the centre of the top-left one.

"""


def read_setup(path: PathLike) -> Setup:
    """Read a setup file.

    Parameters
    ----------
    path : path
        A TOML file with the tables [camera] and [optic], and, if wanted, [light] and [scene].

    Raises
    ------
    SetupError
        With one line for each thing that is wrong in the file.
    """
    return _parsed(read_text(path, "setup file"), path)


def _parsed(text: str, path: PathLike) -> Setup:
    from pydantic import ValidationError

    from .faults import sentences
    from .tables import SetupTable

    document = parse_toml(text, path, Decimal)
    try:
        return SetupTable.model_validate(document).build()
    except ValidationError as error:
        faults = sentences(error, document)
    if len(faults) == 1:
        raise SetupError(f"{path}: {faults[0]}")
    raise SetupError("\n  ".join([f"{path}: {len(faults)} things are wrong", *faults]))


def write_setup(setup: Setup, path: PathLike) -> None:
    """Write a setup file that `read_setup` turns into the same setup, to the last digit.

    Raises
    ------
    OutputError
        With the reason, when the file cannot be written or cannot hold this setup.
    SetupError
        When no light gets through the setup: no file should say so.
    """
    import tomli_w

    try:
        document = _document(setup)
    except OutputError as fault:
        raise OutputError(f"{path}: cannot be written: {fault}") from None
    text = HEADER + on_one_line(tomli_w.dumps(document))
    _parsed(text, path)
    with replacing(path) as file:
        file.write(text.encode())


def _document(setup: Setup) -> dict[str, Any]:
    from .tables import IN_CAMERA, OPTICS, CameraTable, LightTable

    kind = getattr(setup.optic, "kind", None)
    if kind not in OPTICS:
        name = type(setup.optic).__name__
        raise OutputError(f"an optic of type {name} has no place in a setup file; {', '.join(OPTICS)} have")
    camera = _table(setup.camera, CameraTable, "_px")
    if setup.camera.pixel_pitch is not None:
        camera["pixel_pitch_um"] = Decimal(repr(float(setup.camera.pixel_pitch))).scaleb(3)
    camera |= _plain({key: getattr(setup, name) for key, name in IN_CAMERA.items()})
    document = {
        "camera": camera,
        "optic": {"kind": kind, **_table(setup.optic, OPTICS[kind], "_mm")},
        "light": _plain({key: getattr(setup, key) for key in LightTable.model_fields}),
    }
    if setup.depths is not None:
        document["scene"] = {"depth_mm": _plain(setup.depths)}
    return document


def _table(thing: Any, table: Any, suffix: str) -> dict[str, Any]:
    """The keys of a table with the values that a camera or an optic has for them."""
    given: dict[str, Any] = {key: getattr(thing, key.removesuffix(suffix), None) for key in table.model_fields}
    if isinstance(given.get("glass"), Real):
        given["index"] = given.pop("glass")
    if "mirrors" in given:
        from .tables import MirrorTable

        given["mirrors"] = [_table(mirror, MirrorTable, suffix) for mirror in given["mirrors"]]
    return _plain(given)


def _plain(value: Any) -> Any:
    """Built-in numbers, text, lists and dictionaries; what is None or empty is left out of dictionaries."""
    if isinstance(value, Mapping):
        plain = {key: _plain(item) for key, item in value.items() if item is not None}
        return {key: item for key, item in plain.items() if item != []}
    if isinstance(value, Medium):
        return _name(value)
    if isinstance(value, str):
        return str(value)
    if isinstance(value, bool | np.bool_):
        return bool(value)
    if isinstance(value, Integral):
        return int(value)
    if isinstance(value, Real):
        return float(value)
    return [_plain(item) for item in value]


def _name(material: Medium) -> str:
    """The name that finds a medium again."""
    try:
        if medium(material.name) == material:
            return material.name
    except MediumError:
        pass
    raise OutputError(f"a setup file cannot hold the medium {material.name!r}, which media() does not list")
