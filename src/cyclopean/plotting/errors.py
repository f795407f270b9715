"""The pictures of an error budget: which source matters, where in the field, and at which depth."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator, NullFormatter

from ..analysis.budget import Budget
from ..analysis.chromatic import CHANNELS, Blur, FilterAdvice
from ..rigs import Rig

_COLOURS = ("#0072b2", "#e69f00", "#009e73", "#d55e00", "#cc79a7", "#56b4e9", "#777777")
_MARKERS = "os^vD<>"
_DEPTH_SHADES = ("#9ecae1", "#3182bd", "#08306b")
_CHANNEL_COLOURS = {"red": "#c03028", "green": "#2a8a3a", "blue": "#2b50c8"}
_CURVES = 7  # more sources cannot be told apart
_MAPS = 11
_STEEP = 100.0  # % of depth: curves of colours beyond it would flatten all others
_LINEAR = 10.0  # % of depth, up to which the scale is linear then
_SMALLEST = 1e-4  # of the largest source: bars below it are left out of the axis


def budget_picture(budget: Budget) -> Figure:
    """Sources as bars, the largest first, at the nearest, middle and farthest depth; and as curves over depth.

    Both show standard deviations of depth in percent of depth, median over the common field.
    """
    figure = Figure(figsize=(15, max(4.6, 0.42 * len(budget.sources) + 2.2)), dpi=110, layout="constrained")
    left, right = figure.subplots(1, 2, width_ratios=[6, 5])
    percent = _percents(budget)
    _draw_bars(left, budget, percent)
    _draw_curves(right, budget, percent)
    return figure


def _percents(budget):
    """Standard deviation in percent of depth, median over the field: name -> (D,)."""
    depths = budget.depths[:, None, None]
    fields = {source.name: source.sigma for source in budget.sources} | {"all together": budget.total}
    found = {}
    for name, sigma in fields.items():
        flat = (100 * sigma / depths).reshape(len(depths), -1)
        there = np.isfinite(flat).any(-1)
        found[name] = np.array([np.nanmedian(row) if good else np.nan for row, good in zip(flat, there, strict=True)])
    return found


def _draw_bars(axes: Axes, budget: Budget, percent: Mapping[str, np.ndarray]) -> None:
    seen = np.flatnonzero(np.isfinite(percent["all together"]))
    chosen = sorted({int(seen[0]), budget.middle, int(seen[-1])})
    *rows, total = budget.table()
    rows = [total, *rows]
    names = [row.name for row in rows]
    sizes = {row.name: row.size for row in rows}
    height = 0.8 / len(chosen)
    shades = _DEPTH_SHADES[-len(chosen) :]
    for number, (k, shade) in enumerate(zip(chosen, shades, strict=True)):
        places = np.arange(len(names)) + (number - (len(chosen) - 1) / 2) * height
        values = [percent[name][k] for name in names]
        axes.barh(places, values, height * 0.92, color=shade, label=f"at {budget.depths[k]:g} mm")
    labels = [f"{name}\n{sizes[name]}" if sizes[name] else name for name in names]
    axes.set_yticks(range(len(names)), labels, fontsize=8)
    largest = np.nanmax(percent["all together"])
    axes.set_xscale("log")
    axes.set_xlim(max(np.nanmin([np.nanmin(percent[n]) for n in names]) / 2, largest * _SMALLEST), largest * 1.5)
    axes.xaxis.set_major_formatter("{x:g}")
    axes.set(xlabel="standard deviation of depth (% of depth), median over the field")
    axes.set_title(f"what makes depth uncertain, sorted by share at {budget.depths[budget.middle]:g} mm", loc="left")
    axes.grid(axis="x", alpha=0.3)
    axes.set_axisbelow(True)
    axes.legend(fontsize=8, loc="lower right")
    axes.set_ylim(len(names) - 0.4, -0.6)


def _draw_curves(axes: Axes, budget: Budget, percent: Mapping[str, np.ndarray]) -> None:
    if len(budget.depths) == 1:
        _draw_shares(axes, budget)
        return
    for source, colour, marker in zip(budget.sources[:_CURVES], _COLOURS, _MARKERS, strict=False):
        axes.plot(budget.depths, percent[source.name], marker + "-", color=colour, markersize=5, label=source.name)
    axes.plot(budget.depths, percent["all together"], "k:", linewidth=2, label="all together")
    axes.set_xscale("log")
    axes.set_yscale("log")
    axes.set_xticks(budget.depths, [f"{depth:g}" for depth in budget.depths])
    axes.xaxis.set_minor_formatter(NullFormatter())
    axes.yaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
    axes.yaxis.set_major_formatter("{x:g}")
    axes.yaxis.set_minor_formatter(NullFormatter())
    axes.set(xlabel="depth z (mm)", ylabel="standard deviation of depth (% of depth)")
    left_out = len(budget.sources) - _CURVES
    more = f", {left_out} smaller sources not drawn" if left_out > 0 else ""
    axes.set_title(f"over depth{more}", loc="left")
    axes.grid(alpha=0.3, which="both")
    axes.legend(fontsize=8)


def _draw_shares(axes, budget):
    """Shares of variance at the only depth there is."""
    rows = budget.table()[:-1]
    axes.barh(range(len(rows)), [100 * row.share for row in rows], color=_COLOURS[0])
    axes.set_yticks(range(len(rows)), [row.name for row in rows], fontsize=8)
    axes.invert_yaxis()
    axes.set(xlabel="share of the variance of depth (%)")


def error_maps(budget: Budget, k: int | None = None) -> Figure:
    """Maps over the common field at depth number k: sigma of all together, then each error, the largest first.

    An error with a sign is drawn in percent of depth for one standard deviation by which the real setup exceeds the
    believed one; each map has its own scale.
    """
    k = budget.middle if k is None else k
    panels = _panels(budget, k)
    points = budget.volume.points[k]
    wide = np.ptp(points[..., 0]) / max(np.ptp(points[..., 1]), 1e-9)
    columns = 4 if wide > 0.6 else 6
    rows = -(-len(panels) // columns)
    height = float(np.clip(3.0 / wide, 1.4, 5.0)) * (4 / columns) ** 0.5 + 0.9
    figure = Figure(figsize=(16, height * rows + 0.6), dpi=100, layout="constrained")
    every = figure.subplots(rows, columns, squeeze=False).ravel()
    for axes, (title, values) in zip(every, panels, strict=False):
        _draw_map(axes, points, values)
        axes.set_title(title, fontsize=9)
    for axes in every[len(panels) :]:
        axes.set_visible(False)
    figure.suptitle(f"errors of depth at {budget.depths[k]:g} mm, in percent of depth", x=0.01, ha="left")
    return figure


def _panels(budget, k):
    """Titles and maps (H, W) in percent."""
    scale = 100 / float(budget.depths[k])
    panels = [("all together (standard deviation)", scale * budget.total[k])]
    parts = []
    for source in budget.sources:
        if not source.parts:
            parts.append((f"{source.name} (standard deviation)", scale * source.sigma[k]))
        elif len(source.parts) == 1:
            title = f"{source.name}: {source.size}"
            parts.append((title, scale * source.shifts[k, ..., 2, 0]))
        else:
            for column, part in enumerate(source.parts):
                title = f"{part}: {re.sub(',? each$', '', source.size)}"
                parts.append((title if " to " not in source.size else part, scale * source.shifts[k, ..., 2, column]))
    parts.sort(key=lambda part: -np.nanmean(part[1] ** 2))
    return panels + parts[:_MAPS]


def _draw_map(axes, points, values):
    from matplotlib import colormaps

    known = values[np.isfinite(values)]
    low, high = (float(known.min()), float(known.max())) if known.size else (0.0, 1.0)
    mixed = low < 0 < high
    if mixed:
        low, high = -max(-low, high), max(-low, high)
    elif high - low < 0.01 * max(abs(low), abs(high)):
        low, high = low - 0.005 * abs(low), high + 0.005 * abs(high)  # so even a flat map has a scale
    shades = colormaps["RdBu_r" if mixed else "viridis"].with_extremes(bad="#d8d8d8")
    shown = axes.pcolormesh(
        points[..., 0],
        points[..., 1],
        np.ma.masked_invalid(values),
        cmap=shades,
        vmin=low,
        vmax=high,
        shading="nearest",
    )
    axes.set_facecolor("#d8d8d8")
    axes.set_aspect("equal")
    axes.invert_yaxis()
    axes.tick_params(labelsize=7)
    axes.set_xlabel("x (mm)", fontsize=7)
    axes.set_ylabel("y (mm)", fontsize=7)
    bar = axes.figure.colorbar(shown, ax=axes, shrink=0.8)
    bar.ax.tick_params(labelsize=7)


def chromatic_picture(
    rig: Rig,
    blur: Blur,
    bias: tuple[np.ndarray, np.ndarray, Sequence[float]],
    advice: Sequence[FilterAdvice],
    limits: tuple[float, float],
) -> Figure:
    """Blur over the photograph, depth that light of other colours gives, and how wide a filter may be.

    Parameters
    ----------
    rig : Rig
    blur : Blur
        Of the band at one depth.
    bias : (wavelengths (L,) nm, percent (D, L), depths (D,) mm)
        Error of depth in percent, in the middle of the field.
    advice : sequence of FilterAdvice
    limits : (px, percent)
        What the advice keeps to.
    """
    figure = Figure(figsize=(16, 4.9), dpi=110, layout="constrained")
    first, second, third = figure.subplots(1, 3, width_ratios=[5, 4.5, 4.5])
    _draw_blur(first, rig, blur)
    _draw_bias(second, *bias)
    _draw_advice(third, advice, limits)
    return figure


def _draw_blur(axes, rig, blur):
    every = blur.blur[np.isfinite(blur.blur)]
    low, high = (float(every.min()), float(every.max())) if every.size else (0.0, 1.0)
    if high - low < 0.02 * high:
        low, high = 0.98 * low, 1.02 * high
    shown = None
    for k, view in enumerate(rig):
        x, y = blur.pixels[k, ..., 0], blur.pixels[k, ..., 1]
        values = np.ma.masked_invalid(blur.blur[k])
        shown = axes.pcolormesh(x, y, values, cmap="viridis", vmin=low, vmax=high, shading="nearest")
        for line in view.region.outline:
            axes.plot(*line.T, color="black", linewidth=0.8)
        few = np.s_[4::8, 4::8]
        arrows = blur.pixels[k][few].reshape(-1, 2), blur.spread[k][few].reshape(-1, 2)
        there = np.isfinite(arrows[1]).all(-1)
        axes.quiver(*arrows[0][there].T, *arrows[1][there].T, angles="xy", color="white", width=0.004)
    width, height = rig.size
    axes.set(xlim=(-0.5, width - 0.5), ylim=(height - 0.5, -0.5), aspect="equal", xticks=[], yticks=[])
    low_nm, high_nm = (f"{nm:.5g}" for nm in blur.band)
    axes.set_title(f"spread from {low_nm} to {high_nm} nm at {blur.depth:g} mm", loc="left")
    if shown is not None:
        axes.figure.colorbar(shown, ax=axes, label="blur from end to end (px); arrows: where red goes", shrink=0.8)


def _draw_bias(axes, wavelengths, percent, depths):
    shades = [_DEPTH_SHADES[i] for i in np.linspace(0, 2, len(depths)).round().astype(int)]
    for row, depth, shade in zip(percent, depths, shades, strict=True):
        axes.plot(wavelengths, row, color=shade, label=f"{depth:g} mm")
    for name, nm in CHANNELS.items():
        if wavelengths[0] <= nm <= wavelengths[-1]:
            axes.axvline(nm, color=_CHANNEL_COLOURS[name], linestyle="--", linewidth=1)
            axes.annotate(name, (nm, 0.02), xycoords=("data", "axes fraction"), fontsize=8, ha="right", rotation=90)
    axes.axhline(0, color="black", linewidth=0.8)
    axes.set(xlabel="wavelength of the light (nm)", ylabel="error of depth (%)")
    known = np.abs(percent[np.isfinite(percent)])
    steep = known.size > 0 and known.max() > _STEEP
    if steep:
        axes.set_yscale("symlog", linthresh=_LINEAR)
        axes.yaxis.set_major_formatter("{x:g}")
        axes.set_ylabel(f"error of depth (%), logarithmic beyond {_LINEAR:g}")
    axes.set_title("depth found in light of other colours", loc="left")
    axes.grid(alpha=0.3)
    axes.legend(fontsize=8, title="depth", title_fontsize=8)


def _draw_advice(axes, advice, limits):
    centres = np.array([row.centre_nm for row in advice])
    for label, widths, colour in (
        (f"blur {limits[0]:g} px", [row.width_for_blur for row in advice], _COLOURS[0]),
        (f"depth {limits[1]:g} %", [row.width_for_bias for row in advice], _COLOURS[3]),
    ):
        axes.plot(centres, np.where(np.isfinite(widths), widths, np.nan), "o-", color=colour, label=label, markersize=4)
    axes.set(xlabel="middle of the filter (nm)", ylabel="widest band, from end to end (nm)")
    axes.set_ylim(bottom=0)
    axes.set_title("how wide a filter may be", loc="left")
    axes.grid(alpha=0.3)
    axes.legend(fontsize=8, title="limit", title_fontsize=8)
