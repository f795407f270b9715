"""Calibration: from photographs of a known target to a setup that can be trusted."""

from .guess import guess_prism, renumbered
from .physical import Calibration, calibrate, recalibrate, without_outliers

__all__ = ["Calibration", "calibrate", "guess_prism", "recalibrate", "renumbered", "without_outliers"]
