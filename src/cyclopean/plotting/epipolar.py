"""Epipolar curves on the photograph, and how far straight lines are off them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection, PolyCollection
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import FuncFormatter

from ..epipolar import EpipolarCurves
from ..geometry import as_rgb
from ..rigs import Rig
from .colours import GRID, LIGHT_GREY, view_colour

_BAND = 2.0  # standard deviations to each side
_VISIBLE = 0.3  # of half a close-up: how far across a curve its line or band may be drawn to be seen
_STYLES: tuple[Literal["-", "--", ":", "-."], ...] = ("-", "--", ":", "-.")
_ACROSS, _DOWN = 6, 2  # close-ups
_CLOSE_UP = 2.8  # inches
_LABEL = {"boxstyle": "round,pad=0.15", "facecolor": "white", "edgecolor": "none", "alpha": 0.85}
_DEPTH = FuncFormatter(lambda value, _: f"{1 / value:.4g}")  # of an inverse depth


def epipolar_picture(
    photograph: np.ndarray | None,
    rig: Rig,
    pixels: Sequence[np.ndarray],
    curves: Sequence[EpipolarCurves],
    off: Sequence[np.ndarray],
) -> Figure:
    """Pixels and their curves in the other sub-images, coloured by depth, beside the lines of virtual cameras.

    Parameters
    ----------
    photograph : (H, W) or (H, W, C) array, or None
        What to draw on; the outlines of the sub-images alone where there is none.
    rig : Rig
        Its V views.
    pixels : N arrays (2,)
        The given pixels.
    curves : N EpipolarCurves
        Their curves, each of shape ().
    off : N arrays (V, D)
        Distance of each sample from the straight line, px, as `line_distances` gives it.
    """
    pairs = [(n, k) for n, one in enumerate(curves) for k in range(len(rig)) if _visible(one.pixels[k])]
    rows = min(-(-len(pairs) // _ACROSS), _DOWN)
    width, height = rig.size
    tall = min(max(8.4 * height / width, 3.2), 7.5) + 1.2
    figure = Figure(figsize=(13.0, tall + _CLOSE_UP * rows), dpi=110, layout="constrained")
    heights = [tall, _CLOSE_UP * rows] if rows else [tall]
    parts = figure.subfigures(len(heights), 1, height_ratios=heights, squeeze=False)[:, 0]
    left, right = parts[0].subfigures(1, 2, width_ratios=(8.4, 4.6))
    background = None if photograph is None else _faded(as_rgb(photograph))
    scale = Normalize(curves[0].inverse_depths[0], curves[0].inverse_depths[-1])
    _draw_overview(left, background, rig, pixels, curves, scale)
    _draw_departures(right.add_subplot(), rig, curves, off)
    if rows:
        spots = parts[1].subplots(rows, _ACROSS, squeeze=False).ravel()
        for axes in spots[len(pairs) :]:
            axes.set_axis_off()
        for axes, (n, k) in zip(spots, pairs, strict=False):
            _draw_close_up(axes, background, n, curves[n], k, off[n][k], scale)
        shown = f"Close-ups of {len(spots)} of {len(pairs)} curves" if len(pairs) > len(spots) else "Close-ups"
        about = f"red: straight line of two virtual cameras; band: {_BAND:g} sigma; lengths in px"
        parts[1].suptitle(f"{shown}; {about}", fontsize=10)
    return figure


def _visible(line):
    """Whether a curve (D, 2) has a piece that can be drawn."""
    return np.isfinite(line[:, 0]).sum() >= 2


def _draw_overview(figure, background, rig, pixels, curves, scale):
    axes, inverse = figure.add_subplot(), curves[0].inverse_depths
    _draw_sheet(axes, background, rig)
    for number, (pixel, one) in enumerate(zip(pixels, curves, strict=True)):
        _draw_pixel(axes, number, pixel)
        for k in range(len(rig)):
            _draw_curve(axes, one.pixels[k], inverse, scale, 3.5, casing=1.6)
            _label_curve(axes, one.pixels[k], number)
    _depth_bar(figure, axes, scale, inverse)
    what = "One pixel (dot) and where its partners" if len(pixels) == 1 else "Pixels (dots) and where their partners"
    axes.set_title(f"{what} can lie")


def _faded(picture):
    """A picture halfway to white, so that lines on it stand out."""
    return (128 + picture // 2).astype(np.uint8)


def _draw_sheet(axes: Axes, background, rig):
    width, height = rig.size
    if background is not None:
        axes.imshow(background)
    for k, view in enumerate(rig):
        colour, centre = view_colour(k), view.region.centre
        outline = np.concatenate(view.region.outline)
        for line in view.region.outline:
            axes.plot(*(centre + (line - centre) * 0.997).T, color=colour, linewidth=1.8)  # keeps neighbours apart
        corner = outline[np.argmax(np.linalg.norm(outline - np.array(rig.size) / 2, axis=-1))]
        axes.annotate(
            f"view {k}", centre + 0.82 * (corner - centre), ha="center", va="center", weight="bold", fontsize=9,
            bbox={"boxstyle": "round,pad=0.2", "facecolor": colour, "edgecolor": "none"},
        )  # fmt: skip
    axes.set_xlim(-0.5, width - 0.5)
    axes.set_ylim(height - 0.5, -0.5)
    axes.set_aspect("equal")
    axes.set_axis_off()


def _draw_pixel(axes, number, pixel):
    axes.plot(*pixel, marker="o", markersize=8, color="white", markeredgecolor="black", zorder=6)
    axes.annotate(f"{number}", pixel, (7, 6), textcoords="offset points", weight="bold", zorder=7, bbox=_LABEL)


def _label_curve(axes, line, number):
    if _visible(line):
        axes.annotate(
            f"{number}",
            line[np.isfinite(line[:, 0])][-1],
            (6, 6),
            textcoords="offset points",
            fontsize=8,
            zorder=7,
            bbox=_LABEL,
        )


def _draw_curve(axes, line, inverse, scale, width, casing):
    """The curve (D, 2), coloured by inverse depth (D,), in a dark casing of some points."""
    pairs = np.stack([line[:-1], line[1:]], 1)
    good = np.isfinite(pairs).all((1, 2))
    pairs, values = pairs[good], ((inverse[1:] + inverse[:-1]) / 2)[good]
    if casing:
        axes.plot(*line.T, color="black", linewidth=width + casing, zorder=4, solid_capstyle="butt")
    shades = {"array": values, "cmap": "viridis", "norm": scale, "capstyle": "projecting"}
    axes.add_collection(LineCollection(pairs, linewidth=width, zorder=5, **shades))


def _depth_bar(figure, axes, scale, inverse):
    from matplotlib.cm import ScalarMappable

    ticks = np.linspace(inverse[0], inverse[-1], 6)
    shades = ScalarMappable(scale, "viridis")
    bar = figure.colorbar(shades, ax=axes, location="bottom", fraction=0.04, pad=0.015, aspect=40, ticks=ticks)
    bar.ax.xaxis.set_major_formatter(_DEPTH)
    bar.set_label("depth (mm), even in inverse depth")


def _draw_close_up(axes: Axes, background, number, curves, k, off, scale):
    """One curve with its band, its straight line and the depths of its ends."""
    seen = np.isfinite(curves.pixels[k]).all(-1)
    line, sigma, off = curves.pixels[k, seen], curves.sigma[k, seen], off[seen]
    inverse = curves.inverse_depths[seen]
    slope = np.gradient(line, axis=0)
    normal = np.stack([-slope[:, 1], slope[:, 0]], -1) / np.linalg.norm(slope, axis=-1, keepdims=True)
    half = max(np.ptp(line, axis=0).max() * 0.62, 4.0)
    times = _exaggeration(np.fmax(_BAND * sigma, np.abs(off)), half)
    straight = line - times * off[:, None] * normal
    middle = (line.min(0) + line.max(0)) / 2
    if background is not None:
        axes.imshow(background, interpolation="nearest")
    reach = (_BAND * times * np.nan_to_num(sigma))[:, None] * normal
    band = np.concatenate([line + reach, (line - reach)[::-1]])
    axes.add_collection(PolyCollection([band], facecolor=(1, 1, 1, 0.7), edgecolor="black", linewidth=0.7, zorder=3))
    _draw_curve(axes, line, inverse, scale, 1.8, casing=0.0)
    axes.plot(*straight.T, color="#d00000", linestyle=(0, (4, 2)), linewidth=1.6, zorder=6)
    for end, place in ((0, line[0]), (-1, line[-1])):
        axes.annotate(f"{1 / inverse[end]:.4g}", place, ha="center", va="center", fontsize=7, zorder=7, bbox=_LABEL)
    worst = f"line {np.nanmax(np.abs(off)):.2f} px off" if np.isfinite(off).any() else "no straight line"
    scaled = f"distances from the curve x {times}" if times > 1 else "to scale"
    axes.set_title(f"pixel {number} in view {k}: {worst}\n{scaled}", fontsize=8)
    axes.set_xlim(middle[0] - half, middle[0] + half)
    axes.set_ylim(middle[1] + half, middle[1] - half)
    axes.set_aspect("equal")
    axes.tick_params(labelsize=6)
    axes.locator_params(nbins=4)
    for spine in axes.spines.values():
        spine.set_color(view_colour(k))
        spine.set_linewidth(2.5)


def _exaggeration(widths, half):
    """A round factor by which distances across a curve are drawn larger in a close-up of 2 half px, to be seen."""
    widest = np.nanmax(widths) if np.isfinite(widths).any() else 0.0
    if not widest > 0:
        return 1
    return max((n for n in (1, 2, 5, 10, 20, 50, 100, 200, 500, 1000) if n <= _VISIBLE * half / widest), default=1)


def _draw_departures(axes: Axes, rig, curves, off):
    """How far the straight line of virtual cameras lies from each curve over depth; the curve is the zero line."""
    inverse, widest = curves[0].inverse_depths, np.zeros(len(curves[0].inverse_depths))
    for number, (one, miss) in enumerate(zip(curves, off, strict=True)):
        for k in range(len(rig)):
            colour, style = view_colour(k), _STYLES[number % len(_STYLES)]
            axes.plot(inverse, -miss[k], color=colour, linestyle=style, linewidth=1.8)
        widest = np.fmax(widest, np.nan_to_num(one.sigma).max(0))
    seen = inverse[widest > 0] if (widest > 0).sum() > 1 else inverse
    axes.fill_between(
        inverse, -_BAND * widest, _BAND * widest, where=widest > 0, color=LIGHT_GREY, alpha=0.6, linewidth=0
    )
    axes.axhline(0, color="black", linewidth=1)
    axes.set_xticks(np.linspace(seen[0], seen[-1], 5))
    axes.set_xlim(seen[0], seen[-1])
    axes.xaxis.set_major_formatter(_DEPTH)
    axes.set_xlabel("depth (mm), even in inverse depth")
    axes.set_ylabel("straight line of virtual cameras\nless true curve, across it (px)")
    axes.set_title("How far a straight line is off")
    axes.grid(**GRID)
    axes.spines[["top", "right"]].set_visible(False)
    handles = [Line2D([], [], color=view_colour(k), label=f"in view {k}") for k in range(len(rig))]
    if len(curves) > 1:
        handles += [
            Line2D([], [], color="black", linestyle=_STYLES[n], label=", ".join(map(str, names)))
            for n in range(len(_STYLES))
            if (names := [f"pixel {m}" for m in range(n, len(curves), len(_STYLES))])
        ]
    handles.append(Line2D([], [], color=LIGHT_GREY, linewidth=6, label="curve, 2 sigma"))
    axes.legend(handles=handles, fontsize=8, loc="upper center", bbox_to_anchor=(0.5, -0.14), ncols=3, frameon=False)
