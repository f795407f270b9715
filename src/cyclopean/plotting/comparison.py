"""Routes to a calibration in one picture."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter

from .colours import BLUE, GRID, ORANGE, PURPLE, SKY_BLUE, VERMILION

if TYPE_CHECKING:
    from ..calibration.comparison import Comparison, Route

_PLAIN = FuncFormatter(lambda value, _: f"{value:g}")
STYLES = {  # colours of Okabe and Ito, one for each family; marker, line
    "ray sketch (middle)": (ORANGE, "o", "-"),
    "ray sketch (edge)": (ORANGE, "s", "--"),
    "ray sketch + field point": (VERMILION, "D", "-"),
    "virtual cameras, intrinsics fixed": (SKY_BLUE, "v", "-"),
    "virtual cameras, intrinsics tied": (SKY_BLUE, "^", "--"),
    "virtual cameras, intrinsics free": (BLUE, "o", "-"),
    "virtual cameras, each alone then pairs": (PURPLE, "s", "-"),
    "physical model": ("#000000", "o", "-"),
}


def comparison_picture(comparison: Comparison) -> Figure:
    """Errors of every route over depth, on logarithmic scales, and its reprojection error."""
    known = bool(np.isfinite(comparison.known).any())
    figure = Figure(figsize=(15.5 if known else 11, 6.2), dpi=110, layout="constrained")
    axes = figure.subplots(1, 3 if known else 2, squeeze=False)[0]
    routes = [route for route in comparison.routes if not route.failed]
    _draw_shape(axes[0], comparison, routes)
    if known:
        _draw_depth(axes[1], comparison, routes)
    _draw_pixels(axes[-1], comparison, routes)
    handles, labels = axes[0].get_legend_handles_labels()
    if handles:
        figure.legend(handles, labels, loc="outside lower center", ncols=4, frameon=False)
    return figure


def _draw_shape(axes: Axes, comparison: Comparison, routes: list[Route]) -> None:
    order = np.argsort(comparison.depths)
    for route in routes:
        with np.errstate(invalid="ignore"):
            percent = 100 * route.judgement.rigid / comparison.depths
        _curve(axes, route, comparison.depths[order], percent[order])
    _finish(axes, "Shape: triangulated board, after a rigid motion", "rms misfit, % of depth")


def _draw_depth(axes: Axes, comparison: Comparison, routes: list[Route]) -> None:
    for route in routes:
        rows = comparison.depth_table(route)
        _curve(axes, route, [row.depth for row in rows], [100 * row.rms / row.depth for row in rows])
    _finish(axes, "Depth: as it comes out, against the known one", "rms error of depth, %")


def _draw_pixels(axes: Axes, comparison: Comparison, routes: list[Route]) -> None:
    """The reprojection error of each route, the first on top."""
    values = [comparison.figures(route).rms for route in routes]
    places = np.arange(len(routes))[::-1]
    for route, value, place in zip(routes, values, places, strict=True):
        axes.plot(value, place, marker=_style(route)[1], color=_style(route)[0], markersize=9)
        axes.annotate(f"{value:.3g}", (value, place), (9, 0), textcoords="offset points", va="center")
    axes.set_yticks(places, [route.name.replace(", ", ",\n").replace(" + ", "\n+ ") for route in routes])
    axes.set_xscale("log")
    axes.xaxis.set_major_formatter(_PLAIN)
    axes.margins(x=0.18, y=0.08)
    axes.grid(**GRID)
    axes.set_xlabel("rms, px")
    axes.set_title("Reprojection, the board's pose fitted")
    axes.spines[["top", "right"]].set_visible(False)


def _curve(axes, route, depths, values):
    colour, marker, line = _style(route)
    width = 2.2 if route.name == "physical model" else 1.4
    axes.plot(depths, values, color=colour, marker=marker, linestyle=line, linewidth=width, label=route.name)


def _style(route):
    return STYLES.get(route.name, ("#999999", "x", ":"))


def _finish(axes, title, label):
    axes.set_yscale("log")
    axes.yaxis.set_major_formatter(_PLAIN)
    axes.set_xlabel("depth of the board, mm")
    axes.set_ylabel(label)
    axes.set_title(title)
    axes.grid(which="both", **GRID)
    axes.spines[["top", "right"]].set_visible(False)
