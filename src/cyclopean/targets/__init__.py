"""Targets: known objects, and where photographs show them."""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING

from .boards import Board, PointTarget
from .detection import Sighting, find_board, observe
from .observations import DIRECT, Observations, Target, Targets, together
from .seams import Reconciliation, Seams, find_seams, reconcile

if TYPE_CHECKING:
    from .assignment import assign
    from .dots import Dots, find_dots

_LATER = {"Dots": "dots", "assign": "assignment", "find_dots": "dots"}  # these wait for scipy
__all__ = [
    "DIRECT",
    "Board",
    "Dots",
    "Observations",
    "PointTarget",
    "Reconciliation",
    "Seams",
    "Sighting",
    "Target",
    "Targets",
    "assign",
    "find_board",
    "find_dots",
    "find_seams",
    "observe",
    "reconcile",
    "together",
]


def __getattr__(name: str):
    """Import what is heavy when it is first asked for."""
    if name not in _LATER:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(importlib.import_module(f".{_LATER[name]}", __name__), name)


def __dir__():
    return sorted(__all__)
