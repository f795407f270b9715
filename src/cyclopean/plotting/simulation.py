"""A simulated photograph and what is true in it, in one figure."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import ListedColormap
from matplotlib.figure import Figure

from ..geometry import as_rgb
from ..simulation.truth import Matches, Truth
from .colours import RED, view_colour
from .pictures import draw_depth

_SHOWN = 12  # matches that are drawn
_MARGIN = 0.06  # of the photograph's height
_PALE = 0.45  # how much of a facet's colour lies over the photograph


def truth_picture(photograph: np.ndarray, truth: Truth, matches: Matches) -> Figure:
    """The photograph, its depth, and its facets with a few points that several views see."""
    height, width = photograph.shape[:2]
    figure = Figure(figsize=(16.5, max(2.0, 5.0 * height / width) + 0.5), dpi=110, layout="constrained")
    first, second, third = figure.subplots(1, 3)
    first.imshow(as_rgb(photograph))
    first.set_title("photograph")
    draw_depth(second, truth.depth)
    second.set_title("true depth")
    shown = _draw_facets(third, photograph, truth, matches)
    seen = f", {shown} of {len(matches.points):,} matches" if shown else ""
    third.set_title(f"{len(truth.rig)} {'view' if len(truth.rig) == 1 else 'views'}{seen}")
    for axes in (first, second, third):
        axes.set_axis_off()
        axes.set_xlim(-0.5, width - 0.5)
        axes.set_ylim(height - 0.5, -0.5)
    return figure


def _draw_facets(axes: Axes, photograph: np.ndarray, truth: Truth, matches: Matches) -> int:
    """Draw facets over the pale photograph, and matches; how many these are."""
    grey = as_rgb(photograph).mean(axis=-1)
    axes.imshow(grey, cmap="gray", vmin=0, vmax=255)
    colours = ListedColormap([view_colour(k) for k in range(len(truth.rig))])
    facet = np.ma.masked_less(truth.facet, 0)
    axes.imshow(facet, cmap=colours, vmin=-0.5, vmax=len(truth.rig) - 0.5, alpha=_PALE, interpolation="nearest")
    good = np.isfinite(matches.pixels).all(-1)
    several = np.flatnonzero(good.sum(1) > 1)[:_SHOWN]
    for number, row in enumerate(several, 1):
        places = matches.pixels[row][good[row]]
        axes.plot(*np.concatenate([places, places[:1]]).T, color="white", linewidth=0.7, alpha=0.9)
        axes.plot(*places.T, linestyle="", marker="o", markersize=5, markerfacecolor=RED, markeredgecolor="white")
        for place in places:
            down = -11 if place[1] < _MARGIN * len(photograph) else 4  # below, where the title would be above
            axes.annotate(
                f"{number}",
                place,
                xytext=(5, down),
                textcoords="offset points",
                color="white",
                fontsize=8,
                weight="bold",
                path_effects=_outline(),
            )
    return len(several)


def _outline():
    from matplotlib.patheffects import withStroke

    return [withStroke(linewidth=2, foreground="black")]
