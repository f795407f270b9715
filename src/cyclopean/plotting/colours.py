"""Colours of the figures: Okabe and Ito's palette, which colour-blind people can tell apart."""

from __future__ import annotations

from typing import Any

ORANGE, SKY_BLUE, GREEN, YELLOW = "#e69f00", "#56b4e9", "#009e73", "#f0e442"
BLUE, VERMILION, PURPLE = "#0072b2", "#d55e00", "#cc79a7"
GREY, LIGHT_GREY = "#555555", "#bbbbbb"
RED = "#cc0000"  # of what is wrong: residuals, outliers
GRID: dict[str, Any] = {"color": "#dddddd", "linewidth": 0.6}

VIEW_COLOURS = (ORANGE, SKY_BLUE, GREEN, PURPLE, BLUE, VERMILION, "#999999", "#a6a200")
"""Colours of the views, the same in every figure; all show on white and on a photograph, so none is yellow."""


def view_colour(view: int) -> str:
    """Colour of a view; they begin again after eight."""
    return VIEW_COLOURS[view % len(VIEW_COLOURS)]
