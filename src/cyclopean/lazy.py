"""Names that a package imports when they are first asked for."""

from __future__ import annotations

import importlib
from collections.abc import Callable, Mapping
from typing import Any


def lazy(package: str, homes: Mapping[str, str]) -> Callable[[str], Any]:
    """A `__getattr__` for a package, so that importing it stays cheap.

    `homes` names the module inside the package that each public name lives in; an empty home is the module of that
    name itself.
    """

    def load(name: str) -> Any:
        if name not in homes:
            raise AttributeError(f"module {package!r} has no attribute {name!r}")
        home = homes[name]
        module = importlib.import_module(f".{home or name}", package)
        return getattr(module, name) if home else module

    return load
