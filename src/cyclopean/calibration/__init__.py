"""Calibration: from photographs of a known target to a setup that can be trusted."""
