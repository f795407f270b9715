"""Warps moved to cyclopean.geometry.warps (rectification builds them, matching reads them)."""

from ..geometry.warps import Warps

__all__ = ["Warps"]
