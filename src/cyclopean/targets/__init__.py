"""Targets: known objects, and where photographs show them."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ..lazy import lazy
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
__getattr__ = lazy(__name__, _LATER)


def __dir__():
    return sorted(__all__)
