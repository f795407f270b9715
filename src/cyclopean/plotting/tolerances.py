"""Depth errors of many drawn setups in one picture: their spread by depth, their yield, and what they come from."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter

from ..calibration.unknowns import kind_of

if TYPE_CHECKING:
    from ..analysis.tolerances import ToleranceAnalysis

_BEFORE, _AFTER = "#d55e00", "#0072b2"  # Okabe and Ito
_PLAIN = FuncFormatter(lambda value, _: f"{value:g}")
NOT_LINEAR = "not linear"  # what no parameter explains by itself, to first order
_BARS = 9  # parameters that are shown; the others together are one more
_LOWEST = 0.02  # share of the smallest errors that a violin leaves out: on a log scale they would be its tail
_WIDTH = 0.42  # of half a violin, where 1 is the distance of two depths


def tolerance_picture(analysis: ToleranceAnalysis, require: float | None = None) -> Figure:
    """Errors by depth before and after calibration, share of setups that keep a requirement (%), and the drivers."""
    figure = Figure(figsize=(17, 5.6), dpi=110, layout="constrained")
    spread, share, drivers = figure.subplots(1, 3, width_ratios=[5, 4, 5])
    _draw_spread(spread, analysis, require)
    _draw_yield(share, analysis, require)
    _draw_drivers(drivers, analysis)
    figure.legend(*spread.get_legend_handles_labels(), loc="outside lower center", ncols=4, frameon=False)
    return figure


def _draw_spread(axes: Axes, analysis, require):
    depths = analysis.before.depths
    places = np.arange(len(depths))
    samples = [(analysis.before, _BEFORE, -1, "before calibration")]
    if analysis.after is not None:
        samples.append((analysis.after, _AFTER, 1, "after calibration"))
    for sample, colour, side, label in samples:
        for place, depth, k in zip(places, depths, range(len(depths)), strict=True):
            percent = 100 * np.abs(sample.errors[:, sample.plane == k]) / depth
            percent = percent[~np.isnan(percent) & (percent > 0)]
            if np.count_nonzero(np.isfinite(percent)) > 10:
                _half_violin(axes, percent, place, side, colour)
        axes.plot([], [], color=colour, linewidth=8, alpha=0.45, label=label)
    axes.plot([], [], color="#444444", linewidth=1.6, label="50 % and 95 % of the cases")
    if require is not None:
        axes.axhline(require, color="black", linestyle="--", linewidth=1, label=f"required: {require:g} %")
    axes.set_xticks(places, [f"{depth:g}" for depth in depths])
    _finish(axes, "Size of the depth error, by depth", "depth, mm", "error, % of depth")
    axes.set_yscale("log")
    axes.yaxis.set_major_formatter(_PLAIN)


def _half_violin(axes, percent, place, side, colour):
    """Density of the logarithm of errors to one side of a place, with lines at 50 and 95 %."""
    logs = np.log(percent[np.isfinite(percent)])
    low, high = np.quantile(logs, [_LOWEST, 0.9995])
    edges = np.linspace(low, high, 41) if high > low else np.array([low - 0.01, low + 0.01])
    density = np.histogram(logs, edges)[0].astype(float)
    density = np.convolve(np.pad(density, 1, mode="edge"), [0.25, 0.5, 0.25], mode="valid")
    heights, middles = density / density.max() * _WIDTH, np.exp((edges[1:] + edges[:-1]) / 2)
    axes.fill_betweenx(middles, place, place + side * heights, color=colour, alpha=0.45, linewidth=0)
    for level in (0.5, 0.95):
        value = np.quantile(percent, level, method="lower")
        if np.isinf(value):  # rays that part
            continue
        reach = np.interp(np.log(value), np.log(middles), heights)
        axes.plot([place, place + side * reach], [value, value], color=colour, linewidth=1.6)


def _draw_yield(axes: Axes, analysis, require):
    samples = [(analysis.before, _BEFORE)] + ([(analysis.after, _AFTER)] if analysis.after is not None else [])
    worst = [100 * np.nanmax(s.worst / s.depths, axis=-1, initial=0.0)[~s.failed] for s, _ in samples]
    every = np.concatenate(worst)
    every = every[(every > 0) & np.isfinite(every)]
    low, high = (np.quantile(every, [0.001, 0.999]) if every.size else (0.1, 10.0)) * np.array([0.7, 1.4])
    if require is not None:
        low, high = min(low, 0.7 * require), max(high, 1.4 * require)
    limits = np.geomspace(low, high, 200)
    for sample, colour in samples:
        axes.plot(limits, 100 * sample.passing(limits)[:, -1], color=colour, linewidth=2)
    if require is not None:
        axes.axvline(require, color="black", linestyle="--", linewidth=1)
    axes.set_xscale("log")
    axes.xaxis.set_major_formatter(_PLAIN)
    axes.set_ylim(-2, 102)
    _finish(axes, "Setups that keep a limit all over the field", "largest error at any depth, % of depth", "setups, %")


def _draw_drivers(axes: Axes, analysis):
    """Shares of the variance, over all depths: bars before, and after calibration."""
    drivers = analysis.drivers
    before = dict(zip(drivers.names, np.nan_to_num(drivers.overall), strict=True))
    before[NOT_LINEAR] = np.nan_to_num(drivers.unexplained)
    after = analysis.sources
    names = sorted({*before, *after}, key=lambda name: -max(before.get(name, 0.0), after.get(name, 0.0)))
    shown, rest = names[:_BARS], names[_BARS:]
    labels = [*(label_of(name, analysis) for name in shown), *(["all others"] if rest else [])]
    places = np.arange(len(labels))[::-1]
    series = [(before, _BEFORE, 0.2, "before"), (after, _AFTER, -0.2, "after")] if after else [(before, _BEFORE, 0, "")]
    for shares, colour, shift, _ in series:
        values = [100 * shares.get(name, 0.0) for name in shown]
        values += [100 * sum(shares.get(name, 0.0) for name in rest)] if rest else []
        axes.barh(places + shift, values, height=0.36, color=colour, alpha=0.8)
    axes.set_yticks(places, labels, fontsize=8)
    _finish(axes, "What the errors come from", "share of the variance, %", "")
    axes.grid(axis="y", visible=False)


def label_of(name: str, analysis: ToleranceAnalysis) -> str:
    """A parameter with its tolerance, in the unit in which people read it."""
    if name not in analysis.tolerances:
        return name
    return f"{name}  {size_text(name, analysis.tolerances[name])}"


def size_text(name: str, tolerance) -> str:
    """A tolerance in the unit in which people read it: "sigma 0.5 mm", "± 0.5 mm, uniform"."""
    kind = kind_of(name)
    size, unit = tolerance.size * kind.factor, kind.unit
    if unit == "deg" and 0 < size < 0.1:
        size, unit = 60 * size, "arcmin"
    text = f"{size:.3g} {unit}".rstrip()
    return f"sigma {text}" if tolerance.shape == "normal" else f"± {text}, {tolerance.shape}"


def _finish(axes, title, across, up):
    axes.set_title(title, fontsize=11)
    axes.set_xlabel(across)
    axes.set_ylabel(up)
    axes.grid(which="both", color="#dddddd", linewidth=0.6)
    axes.set_axisbelow(True)
    axes.spines[["top", "right"]].set_visible(False)
