"""Lengths, distances, areas and angles between points, each with its standard deviation."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ..lazy import lazy
from .lengths import angle, distance, length, point, point_to_line
from .measured import Measured
from .planes import area, best_plane, point_to_plane

if TYPE_CHECKING:
    from .images import KINDS, ImagePoint, Measurement, measure

_LATER = dict.fromkeys(("KINDS", "ImagePoint", "Measurement", "measure"), "images")  # waits for numba
__all__ = [
    # between points
    "Measured",
    "angle",
    "area",
    "best_plane",
    "distance",
    "length",
    "point",
    "point_to_line",
    "point_to_plane",
    # in a photograph
    "KINDS",
    "ImagePoint",
    "Measurement",
    "measure",
]
__getattr__ = lazy(__name__, _LATER)


def __dir__():
    return sorted(__all__)
