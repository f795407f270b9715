"""The pictures of a reconstruction, each drawn into a matplotlib figure."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from ..geometry import as_rgb
from ..rigs import Rig
from .colours import view_colour

_DRAWN_POINTS = 40_000  # more do not show


def outlined_picture(photograph: np.ndarray, rig: Rig) -> Figure:
    """The photograph with the outline of every sub-image."""
    figure, axes = photo_axes(photograph.shape)
    draw_outlines(axes, photograph, rig)
    return figure


def draw_outlines(axes: Axes, photograph: np.ndarray, rig: Rig) -> None:
    """Draw the photograph and the outline of every sub-image."""
    axes.imshow(as_rgb(photograph))
    for k, view in enumerate(rig):
        colour = view_colour(k)
        for line in view.region.outline:
            inside = view.region.centre + (line - view.region.centre) * 0.997  # keep neighbours' lines apart
            axes.plot(*inside.T, color=colour, linewidth=2)
        axes.annotate(
            f"{k}",
            view.region.centre,
            color="black",
            ha="center",
            va="center",
            weight="bold",
            bbox={"boxstyle": "circle", "facecolor": colour, "edgecolor": "none"},
        )
    height, width = photograph.shape[:2]
    axes.set_xlim(-0.5, width - 0.5)
    axes.set_ylim(height - 0.5, -0.5)
    axes.set_axis_off()


def depth_picture(depth: np.ndarray) -> Figure:
    """The depth (H, W) mm of every pixel, with a colour bar in mm; pixels without depth stay grey."""
    figure, axes = photo_axes(depth.shape, bar=True)
    draw_depth(axes, depth)
    return figure


def draw_depth(axes: Axes, depth: np.ndarray) -> None:
    """Draw depth (H, W) mm with a colour bar."""
    from matplotlib import colormaps

    known = depth[np.isfinite(depth)]
    low, high = np.percentile(known, [1, 99]) if known.size else (0.0, 1.0)
    if high - low < 1e-3 * max(high, 1.0):
        low, high = low - 0.5, high + 0.5
    shades = colormaps["viridis_r"].with_extremes(bad="#c8c8c8")
    image = axes.imshow(np.ma.masked_invalid(depth), cmap=shades, vmin=low, vmax=high, interpolation="nearest")
    axes.set_axis_off()
    if not known.size:
        axes.text(0.5, 0.5, "no depth", transform=axes.transAxes, ha="center", va="center", fontsize=16)
        return
    axes.figure.colorbar(image, ax=axes, label="depth Z (mm), grey: unknown", fraction=0.04, pad=0.02)


def cloud_picture(points: np.ndarray, colours: np.ndarray) -> Figure:
    """The points (N, 3) mm with their colours (N, 3) uint8, seen from above and to one side."""
    figure = Figure(figsize=(9, 7), dpi=110, layout="constrained")
    draw_cloud(figure.add_subplot(projection="3d"), points, colours)
    return figure


def draw_cloud(axes, points: np.ndarray, colours: np.ndarray) -> None:
    """Draw points on 3-D axes, z (depth) to the back and y down."""
    if not len(points):
        axes.text2D(0.5, 0.5, "no points", transform=axes.transAxes, ha="center", va="center", fontsize=16)
        axes.set_axis_off()
        return
    pick = np.random.default_rng(0).permutation(len(points))[:_DRAWN_POINTS]
    x, y, z = points[pick].T
    axes.scatter(x, z, -y, c=colours[pick] / 255.0, s=0.8, linewidths=0, depthshade=False)
    axes.set(zlabel="-y (mm)")
    axes.set_xlabel("x (mm)", labelpad=7)
    axes.set_ylabel("depth z (mm)", labelpad=7)
    spans = [np.ptp(np.percentile(v, [0.5, 99.5])) for v in (x, z, -y)]
    for set_limits, values in ((axes.set_xlim, x), (axes.set_ylim, z), (axes.set_zlim, -y)):
        set_limits(*np.percentile(values, [0.2, 99.8]))
    sides = np.maximum(spans, 0.25 * max(spans) + 1e-9)
    longest = max(sides) / np.linalg.norm(sides)  # a long box is drawn smaller, or its labels would lie outside
    axes.set_box_aspect(sides, zoom=min(0.85, 0.55 / longest))
    for axis, side in zip((axes.xaxis, axes.yaxis, axes.zaxis), sides, strict=True):
        axis.set_major_locator(MaxNLocator(max(2, round(7 * side / max(sides))), steps=[1, 2, 5, 10]))
    axes.view_init(elev=22, azim=-62)
    axes.tick_params(labelsize=7)


def overview_picture(
    photograph: np.ndarray, rig: Rig, depth: np.ndarray, points: np.ndarray, colours: np.ndarray
) -> Figure:
    """The main job in one picture: photograph, sub-images with depth, point cloud."""
    figure = Figure(figsize=(16, 4.6), dpi=110, layout="constrained")
    first, second = figure.add_subplot(1, 3, 1), figure.add_subplot(1, 3, 2)
    draw_outlines(first, photograph, rig)
    first.set_title(f"one photograph, {len(rig)} sub-images")
    draw_depth(second, depth)
    second.set_title("depth of every pixel")
    third = figure.add_subplot(1, 3, 3, projection="3d")
    draw_cloud(third, points, colours)
    third.set_title(f"{len(points):,} points", y=0.98)  # close to the box, which leaves room above it
    return figure


def photo_axes(shape, bar=False):
    """A figure whose axes fill it, about as large as an image of this shape."""
    height, width = shape[:2]
    inches = 9.0
    size = (inches + (1.2 if bar else 0), max(inches * height / width, 1.0))
    figure = Figure(figsize=size, dpi=120, layout="constrained")
    return figure, figure.add_subplot()
