"""YAML that robots read: plain tables of numbers."""

from __future__ import annotations

import json
from typing import Any

from ...errors import SetupError
from ..disk import PathLike
from .named import read_text


def read_yaml(path: PathLike, text: str | None = None) -> dict[str, Any]:
    """The table that a YAML file, or its text, holds; matrices of OpenCV's are tables with rows, cols and data."""
    import yaml

    class Loader(getattr(yaml, "CSafeLoader", yaml.SafeLoader)):  # type: ignore[misc]
        """Plain values, and OpenCV's matrices as the tables that they are."""

    Loader.add_constructor("tag:yaml.org,2002:opencv-matrix", lambda loader, node: loader.construct_mapping(node, True))
    text = read_text(path) if text is None else text
    if text.startswith("%YAML:"):
        raise SetupError(f"{path}: this is YAML of OpenCV's FileStorage; read it as format opencv")
    try:
        document = yaml.load(text, Loader)
    except (yaml.YAMLError, ValueError, TypeError, RecursionError) as fault:
        raise SetupError(f"{path}: this is not YAML: {' '.join(str(fault).split())}") from None
    if not isinstance(document, dict):
        raise SetupError(f"{path}: wanted a table (keys and values), got {type(document).__name__}")
    return document


def quoted(text: str) -> str:
    """Text as YAML takes it whatever it holds."""
    return json.dumps(text)  # JSON is YAML
