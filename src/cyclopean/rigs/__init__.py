"""Setups, and the rigs of views that they give."""

from .derivatives import PixelDerivatives, RayDerivatives
from .pinhole import PinholeView, pinhole_rig
from .regions import Region
from .rig import Rig
from .setup import Setup
from .view import View, ViewLike
from .virtual import VirtualCamera, fit, sketch

__all__ = [
    "PinholeView",
    "PixelDerivatives",
    "RayDerivatives",
    "Region",
    "Rig",
    "Setup",
    "View",
    "ViewLike",
    "VirtualCamera",
    "fit",
    "pinhole_rig",
    "sketch",
]
