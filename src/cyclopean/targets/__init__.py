"""Targets: known objects, and where photographs show them."""

from .boards import Board, PointTarget
from .detection import Sighting, find_board, observe
from .observations import DIRECT, Observations, Target, Targets, together
from .seams import Reconciliation, Seams, find_seams, reconcile

__all__ = [
    "DIRECT",
    "Board",
    "Observations",
    "PointTarget",
    "Reconciliation",
    "Seams",
    "Sighting",
    "Target",
    "Targets",
    "find_board",
    "find_seams",
    "observe",
    "reconcile",
    "together",
]
