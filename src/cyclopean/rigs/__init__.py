"""Setups, and the rigs of views that they give."""

from .derivatives import PixelDerivatives, RayDerivatives
from .regions import Region
from .rig import Rig
from .setup import Setup
from .view import View, ViewLike
from .virtual import VirtualCamera, fit, sketch

__all__ = [
    "PixelDerivatives",
    "RayDerivatives",
    "Region",
    "Rig",
    "Setup",
    "View",
    "ViewLike",
    "VirtualCamera",
    "fit",
    "sketch",
]
