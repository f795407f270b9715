"""Targets: known objects, and where photographs show them."""

from .boards import Board, PointTarget
from .detection import Sighting, find_board, observe
from .observations import DIRECT, Observations, Target, Targets, together

__all__ = [
    "Board",
    "PointTarget",
    "find_board",
    "observe",
    "Sighting",
    "DIRECT",
    "Observations",
    "Target",
    "Targets",
    "together",
]
