"""Views brought side by side: maps between sub-images that serve a matcher."""

from .sweeps import at_inverse_depths, interpolation_error, inverse_depths, sweep

__all__ = ["at_inverse_depths", "interpolation_error", "inverse_depths", "sweep"]
