"""Targets: known objects, and where photographs show them."""

from .observations import DIRECT, Observations, Target

__all__ = ["DIRECT", "Observations", "Target"]
