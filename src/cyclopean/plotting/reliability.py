"""The reliability diagram: stated standard deviations against the errors that are found."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator, NullFormatter

from ..analysis.reliability import NORMAL_SHARES, Reliability
from .colours import GREY, GRID, LIGHT_GREY, VIEW_COLOURS

_MARKERS = "osD^vP*X"


def reliability_picture(curves: Mapping[str, Reliability], unit: str = "mm") -> Figure:
    """Spread of errors over stated sigma, bin by bin, and how many errors lie within 1, 2 and 3 sigma.

    Parameters
    ----------
    curves : mapping of str to Reliability
        Name of each curve, such as a scene or a level of noise, and what was found.
    unit : str
        Of errors and standard deviations.
    """
    figure = Figure(figsize=(13.5, 6), dpi=110, layout="constrained")
    left, right = figure.subplots(1, 2, width_ratios=[6, 5])
    for number, (name, curve) in enumerate(curves.items()):
        colour = VIEW_COLOURS[number % len(VIEW_COLOURS)]
        marker = _MARKERS[number // len(VIEW_COLOURS) % len(_MARKERS)]
        label = f"{name}: {curve.ratio:.2f}"
        left.loglog(curve.stated, curve.spread, "-", marker=marker, color=colour, markersize=4.5, label=label)
        right.plot((1, 2, 3), 100 * np.array(curve.shares), "-", marker=marker, color=colour, markersize=4.5)
    _finish_diagram(left, curves, unit)
    _finish_shares(right)
    return figure


def _finish_diagram(axes: Axes, curves: Mapping[str, Reliability], unit: str) -> None:
    every = np.concatenate([[*curve.stated, *curve.spread] for curve in curves.values()])
    ends = np.array([every[every > 0].min() / 1.4, every.max() * 1.4])
    axes.fill_between(ends, ends / 2, 2 * ends, color=LIGHT_GREY, alpha=0.35, linewidth=0, label="within a factor of 2")
    axes.plot(ends, ends, color=GREY, linewidth=1.2, linestyle="--", label="ideal")
    axes.set(xlim=ends, ylim=ends, aspect="equal")
    axes.set(xlabel=f"stated sigma, rms of each bin ({unit})", ylabel=f"68th percentile of the error ({unit})")
    for scale in (axes.xaxis, axes.yaxis):
        scale.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
        scale.set_major_formatter("{x:g}")
        scale.set_minor_formatter(NullFormatter())
    axes.grid(which="both", **GRID)
    axes.set_axisbelow(True)
    columns = 1 if len(curves) <= 8 else 2
    axes.legend(fontsize=8, ncols=columns, loc="upper left", title="error over sigma, 68th percentile")
    axes.set_title("above the line: errors are larger than stated", loc="left")


def _finish_shares(axes: Axes) -> None:
    normal = 100 * np.array(NORMAL_SHARES)
    axes.plot((1, 2, 3), normal, "--", color=GREY, linewidth=1.2, label="normal distribution")
    for k, value in enumerate(normal, start=1):
        place = (-8, 4) if k == 1 else (0, 7)  # beside the first point, where the line rises
        side = "right" if k == 1 else "center"
        axes.annotate(f"{value:.1f}", (k, value), place, textcoords="offset points", ha=side, color=GREY)
    axes.set(xlabel="stated standard deviations", ylabel="errors within (%)", xticks=(1, 2, 3), xlim=(0.8, 3.2))
    axes.set_ylim(min(axes.get_ylim()[0], 50.0), 103)
    axes.grid(**GRID)
    axes.set_axisbelow(True)
    axes.legend(fontsize=8, loc="lower right")
    axes.set_title("share of errors within 1, 2 and 3 sigma", loc="left")
