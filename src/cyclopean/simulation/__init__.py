"""Simulation: the photograph that a setup would take of a scene, and what is true in it."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ..lazy import lazy
from .scene import Lamp, Paint, Scene, Surface

if TYPE_CHECKING:
    from .rendering import render
    from .truth import Matches, Truth, trace_truth

_LATER = {"Matches": "truth", "Truth": "truth", "render": "rendering", "trace_truth": "truth"}
__all__ = ["Lamp", "Matches", "Paint", "Scene", "Surface", "Truth", "render", "trace_truth"]
__getattr__ = lazy(__name__, _LATER)


def __dir__():
    return sorted(__all__)
