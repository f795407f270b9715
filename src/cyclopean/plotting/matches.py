"""Matched points on the photograph."""

from __future__ import annotations

import numpy as np
from matplotlib import colormaps
from matplotlib.collections import LineCollection
from matplotlib.colors import ListedColormap
from matplotlib.figure import Figure

from ..correspondence import Matches
from ..geometry import as_rgb
from ..rigs import Rig
from .colours import view_colour

_LINKED = 400  # with more matches the links between sub-images hide the photograph
_NUMBERED = 60
_SHADES = ListedColormap(colormaps["plasma"](np.linspace(0.35, 1, 256)))  # all bright enough for the dimmed photograph
_SHOWN = 6000  # unmatched points


def matches_picture(photograph: np.ndarray, rig: Rig, matches: Matches) -> Figure:
    """The photograph with all matched points, coloured by their depth; the same colour is the same point.

    Few matches are numbered and linked. Points that were found and not matched are small and white, those of matches
    that were refused as ambiguous crosses.
    """
    height, width = photograph.shape[:2]
    figure = Figure(figsize=(11.2, max(10 * height / width, 2.0) + 0.6), dpi=130, layout="constrained")
    axes = figure.add_subplot()
    axes.imshow((0.55 * as_rgb(photograph)).astype(np.uint8))
    for k, view in enumerate(rig):
        for line in view.region.outline:
            inside = view.region.centre + (line - view.region.centre) * 0.997
            axes.plot(*inside.T, color=view_colour(k), linewidth=1.2)
        badge = {"boxstyle": "circle,pad=0.2", "facecolor": view_colour(k), "edgecolor": "none"}
        axes.annotate(
            f"{k}", view.region.centre, ha="center", va="center", fontsize=8, weight="bold", bbox=badge, zorder=5
        )
    _draw_rest(axes, matches)
    depth = matches.points[:, 2]
    few = len(matches) <= _NUMBERED
    if len(matches):
        low, high = np.percentile(depth, [2, 98])
        low, high = (low, high) if high - low > 1e-6 * high else (low - 0.5, high + 0.5)
        colours = _SHADES(np.clip((depth - low) / (high - low), 0, 1))
        _draw_links(axes, matches.pixels, colours)
        flat, seen = matches.pixels.reshape(-1, 2), np.isfinite(matches.pixels[..., 0]).ravel()
        x, y = flat[seen].T
        dots = axes.scatter(
            x, y, c=np.repeat(depth, len(rig))[seen], s=26 if few else 9, cmap=_SHADES, vmin=low, vmax=high,
            edgecolors="black", linewidths=0.6 if few else 0.25, zorder=3,
        )  # fmt: skip
        scale = figure.colorbar(dots, ax=axes, label="depth Z (mm)", fraction=0.035, pad=0.01)
        scale.ax.ticklabel_format(axis="y", useOffset=False)
    if few:
        _draw_numbers(axes, matches)
    refused = f", {len(matches.refused):,} refused as ambiguous (crosses)" if len(matches.refused) else ""
    points = "point" if len(matches) == 1 else "points"
    axes.set_title(f"{len(matches):,} {points} matched in {len(rig)} views{refused}", fontsize=10)
    axes.set_xlim(-0.5, width - 0.5)
    axes.set_ylim(height - 0.5, -0.5)
    axes.set_axis_off()
    return figure


def _draw_rest(axes, matches):
    """Points without a match, and those of refused matches."""
    for k, pixels in enumerate(matches.detected):
        used = np.zeros(len(pixels), bool)
        used[matches.source[matches.source[:, k] >= 0, k]] = True
        refused = np.zeros(len(pixels), bool)
        refused[matches.refused[matches.refused[:, k] >= 0, k]] = True
        rest = pixels[~used & ~refused][:_SHOWN]
        axes.plot(*rest.T, ".", color="white", alpha=0.35, markersize=2, markeredgewidth=0)
        axes.plot(*pixels[refused & ~used].T, "x", color="white", alpha=0.75, markersize=4, markeredgewidth=0.8)


def _draw_links(axes, pixels, colours):
    """Thin lines from view to view where there are few enough."""
    if len(pixels) > _LINKED:
        return
    lines = [line[np.isfinite(line[:, 0])] for line in pixels]
    axes.add_collection(LineCollection(lines, colors=colours, linewidths=0.7, alpha=0.8, zorder=2))


def _draw_numbers(axes, matches):
    for number, line in enumerate(matches.pixels):
        name = matches.label[number] if matches.label[number] >= 0 else number + 1
        for x, y in line[np.isfinite(line[:, 0])]:
            axes.annotate(
                str(name), (x, y), xytext=(4, 3), textcoords="offset points", fontsize=6, color="white", zorder=4
            )
