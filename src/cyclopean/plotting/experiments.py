"""The pictures of an experiment: ray map, boards in photographs, disparity, and errors of recovered depth."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, NullFormatter

from ..errors import OpticError
from ..geometry import Rays, as_rgb
from ..rigs import Rig, Setup
from .colours import GREEN, GREY, GRID, LIGHT_GREY, RED, VIEW_COLOURS, view_colour
from .comparison import STYLES as STYLES
from .ray_parts import GLASS, drawing_plane, sketched_cameras, solid_of

if TYPE_CHECKING:
    from ..experiments import Experiment

_PLAIN = FuncFormatter(lambda value, _: f"{value:g}")
_LINES = ("-", "-", "-.", "--", ":")  # of views that stand alike one curve lies on another
_TRUE_STYLE = (GREEN, "x", ":")
_BUNDLE = 15  # rays across a sub-image that are extended back
_ARROW = 0.05  # of the picture's width, that of the 95th percentile of the residuals


def depth_errors_picture(experiment: Experiment) -> Figure:
    """Error of recovered depth over depth by each approach: rms of the points, and of their mean."""
    figure = Figure(figsize=(12.5, 6.0), dpi=110, layout="constrained")
    spread, mean = figure.subplots(1, 2)
    for one in experiment.recovered:
        rows = [row for row in experiment.rows if row.approach == one.approach and row.points]
        colour, marker, line = STYLES.get(one.approach, _TRUE_STYLE)
        style = {"color": colour, "marker": marker, "linestyle": line, "linewidth": 1.5, "markersize": 5}
        depths = [row.actual for row in rows]
        spread.plot(depths, [max(row.rms_percent, 1e-12) for row in rows], label=one.approach, **style)
        mean.plot(depths, [row.error_percent for row in rows], **style)
    spread.set_yscale("log")
    spread.yaxis.set_major_formatter(_PLAIN)
    spread.yaxis.set_minor_formatter(NullFormatter())
    spread.set_title("rms error of the target's points")
    spread.set_ylabel("% of depth")
    spread.grid(which="both", **GRID)
    mean.axhline(0, color=GREY, linewidth=0.8)
    mean.set_title("error of their mean depth")
    mean.set_ylabel("% of depth")
    mean.grid(**GRID)
    for axes in (spread, mean):
        axes.set_xlabel("actual depth, mm")
        axes.spines[["top", "right"]].set_visible(False)
    handles, labels = spread.get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=3, frameon=False)
    return figure


def disparity_picture(experiment: Experiment, rig: Rig) -> Figure:
    """How far apart view 0 and each other view show the target's points, over depth and over its inverse.

    The line is that of points on the camera's axis, by true rays of `rig`: straight over inverse depth.
    """
    figure = Figure(figsize=(11.5, 5.4), dpi=110, layout="constrained")
    over_depth, over_inverse = figure.subplots(1, 2, sharey=True)
    depths = np.linspace(experiment.actual.min(), experiment.actual.max(), 60)
    on_axis = rig.unbounded().project(np.stack([0 * depths, 0 * depths, depths], -1))
    centres = [view.region.centre for view in rig]
    for k in range(1, len(rig)):
        along = centres[0] - centres[k]
        along = along / np.linalg.norm(along)
        seen = (experiment.pixels[:, 0] - experiment.pixels[:, k]) @ along
        line = (on_axis[:, 0] - on_axis[:, k]) @ along
        colour = view_colour(k)
        label = f"views 0 and {k}"
        for axes, x, dots in (
            (over_depth, depths, experiment.actual),
            (over_inverse, 1000 / depths, 1000 / experiment.actual),
        ):
            axes.plot(x, line, color=colour, linewidth=1.5, linestyle=_LINES[k % len(_LINES)], label=label)
            axes.plot(dots, seen, ".", color=colour, markersize=3, alpha=0.35)
    over_depth.set(xlabel="actual depth, mm", ylabel="disparity along the line between the sub-images, px")
    over_inverse.set(xlabel="inverse depth, 1/m")
    over_depth.set_title("disparity over depth")
    over_inverse.set_title("disparity over inverse depth")
    for axes in (over_depth, over_inverse):
        axes.grid(**GRID)
        axes.spines[["top", "right"]].set_visible(False)
    over_depth.legend(frameon=False, title="line: on the axis; dots: target", fontsize=9)
    return figure


class Sheet(NamedTuple):
    """One photograph of a board, or the place of one that was never taken."""

    title: str
    photograph: np.ndarray | None  # (H, W) or (H, W, 3)
    rig: Rig | None  # whose sub-images it shows; None without the optic
    views: np.ndarray  # (N,) of each corner
    pixels: np.ndarray  # (N, 2) px
    residuals: np.ndarray | None = None  # (N, 2) px, observed - predicted


def boards_picture(sheets: Sequence[Sheet], size: tuple[int, int]) -> Figure:
    """Photographs with the corners found in them, and residuals as arrows where there are any."""
    width, height = size
    figure = Figure(figsize=(5.2 * len(sheets), 5.2 * height / width + 0.7), dpi=110, layout="constrained")
    for axes, sheet in zip(figure.subplots(1, len(sheets), squeeze=False)[0], sheets, strict=True):
        _draw_sheet(axes, sheet, width)
        axes.set(xlim=(-0.5, width - 0.5), ylim=(height - 0.5, -0.5), aspect="equal", xticks=[], yticks=[])
        axes.set_title(sheet.title, fontsize=10)
    return figure


def _draw_sheet(axes: Axes, sheet: Sheet, width: int) -> None:
    if sheet.photograph is not None:
        axes.imshow(as_rgb(sheet.photograph), alpha=0.75)
    for view in sheet.rig or ():
        for line in view.region.outline:
            axes.plot(*line.T, color="#999999", linewidth=0.8)
    colours = np.array([*VIEW_COLOURS, RED])[np.where(sheet.views < 0, -1, sheet.views % len(VIEW_COLOURS))]
    edge, size = ("none", 9) if sheet.photograph is None else ("white", 22)  # dots must show on black and on white
    x, y = sheet.pixels.T
    axes.scatter(x, y, s=size, c=colours, edgecolors=edge, linewidths=0.8, zorder=3)
    if sheet.residuals is None or not np.isfinite(sheet.residuals).any():
        return
    length = np.linalg.norm(sheet.residuals, axis=-1)
    usual = float(np.nanpercentile(length, 95))
    unit = float(f"{max(usual, 1e-9):.1g}")
    scale = _ARROW * width / unit
    arrows = axes.quiver(
        *sheet.pixels.T, *(sheet.residuals * scale).T,
        color=RED, angles="xy", scale_units="xy", scale=1, width=0.0025, headwidth=4, zorder=4,
    )  # fmt: skip
    axes.quiverkey(arrows, 0.05, -0.04, _ARROW * width, f"observed - predicted, {unit:g} px", labelpos="E")


def ray_map_picture(setup: Setup, rig: Rig | None = None, view: int = 0) -> Figure:
    """How ray sketching finds the virtual camera of one view: two rays through the glass, extended back.

    On the left the letters of the thesis's figures 4.3 and 5.4: the axis ray F K J S, the boundary ray F M N L, the
    virtual centre F'. On the right the place where they meet, with the other true rays of the view.
    """
    rig = setup.rig() if rig is None else rig
    camera = sketched_cameras(setup, rig)[view]
    if camera is None:
        raise OpticError(f"{rig[view].name}: the axis ray or the boundary ray is lost in the optic, so nothing to draw")
    towards = rig[view].region.centre - rig[view].camera.centre
    cut = drawing_plane(setup, float(np.arctan2(towards[1], towards[0])))
    figure = Figure(figsize=(13.5, 5.6), dpi=110, layout="constrained")
    whole, near = figure.subplots(1, 2, width_ratios=[3, 2])
    _draw_way(whole, setup, rig, view, camera, cut)
    _draw_meeting(near, rig[view], camera, cut, view_colour(view))
    whole.set_title(f"{rig[view].name}: axis ray and boundary ray (across is enlarged)", fontsize=10)
    near.set_title(
        f"where they meet, {camera.gap:.3f} mm apart;\nthin: more rays of the view, extended back", fontsize=10
    )
    for axes in (whole, near):
        axes.set(xlabel="z (mm)", ylabel="across (mm)")
        axes.grid(**GRID)
        axes.spines[["top", "right"]].set_visible(False)
    return figure


def _draw_way(axes, setup, rig, view, camera, cut):
    """Both rays from the pinhole to the scene, with letters."""
    solid = solid_of(setup, rig)
    section = solid.section(solid.from_rig(np.zeros(3)), solid.from_rig(cut.normal) - solid.from_rig(np.zeros(3)))
    if len(section):
        axes.fill(*cut.flat(solid.in_rig(section)).T, facecolor=GLASS, edgecolor="#20506f", linewidth=1.0)
    end = 1.7 * float(np.nanmax(camera.trails[..., 2]))
    colour, centre = view_colour(view), cut.flat(camera.centre)
    for trail, direction, letters in zip(camera.trails, camera.directions, ("KJS", "MNL"), strict=True):
        last = trail[-1] + direction * (end - trail[-1, 2]) / direction[2]
        way = cut.flat(np.vstack([trail, last]))
        axes.plot(*way.T, color=colour, linewidth=1.4)
        axes.plot(*np.vstack([way[-2], centre]).T, color=colour, linewidth=1.0, linestyle=(0, (5, 3)))
        for place, letter, side in zip(way[1:], letters, (-12, 5, 3), strict=True):
            axes.annotate(letter, place, xytext=(side, 5), textcoords="offset points", fontsize=10)
    for place, letter in ((np.zeros(2), "F"), (centre, "F'")):
        axes.plot(*place, "o", color="black" if letter == "F" else colour, markersize=5)
        axes.annotate(letter, place, xytext=(-13, 4), textcoords="offset points", fontsize=11)
    axes.set_xlim(min(-0.08 * end, centre[0] - 0.08 * end), end * 1.02)


def _draw_meeting(axes, view, camera, cut, colour):
    """The neighbourhood of the virtual centre: the two rays extended back, and the other rays of the view."""
    towards = view.region.centre - np.asarray(view.camera.centre)
    steps = np.linspace(0.02, 1.98, _BUNDLE)[:, None]
    pixels = view.camera.centre + steps * towards
    rays = view.rays(pixels[view.region.contains(pixels)])
    middle = cut.flat(camera.centre)
    flat = [cut.flat(rays.at(t)) for t in (-1.0, 0.0)]
    span = 3.0 * max(camera.gap, np.ptp(_crossings(rays, cut, middle[0])), 0.3)
    deep = span / max(abs(np.ptp(_slopes(flat))), 1e-3) * 1.2
    z = middle[0] + np.array([-deep, deep])
    for start, next_ in zip(flat[1], flat[0], strict=True):
        axes.plot(z, _line(start, next_, z), color=LIGHT_GREY, linewidth=0.7)
    for trail, direction, name in zip(camera.trails, camera.directions, ("axis ray", "boundary ray"), strict=True):
        a, b = cut.flat(trail[-1]), cut.flat(trail[-1] + direction)
        line = "-." if name == "axis ray" else "-"
        axes.plot(z, _line(a, b, z), color=colour, linestyle=line, linewidth=1.6, label=name)
    axes.plot(*cut.flat(camera.segment).T, color=RED, linewidth=2.0)
    axes.plot(*middle, "o", color="black", markersize=5, label="virtual centre F'")
    axes.set_xlim(*z)
    axes.set_ylim(middle[1] - span, middle[1] + span)
    axes.legend(frameon=False, fontsize=9)


def _line(first, second, z):
    """Height of the line through two points (2,) of the drawing at depths z."""
    slope = (second[1] - first[1]) / (second[0] - first[0])
    return first[1] + slope * (z - first[0])


def _slopes(flat):
    return (flat[1][:, 1] - flat[0][:, 1]) / (flat[1][:, 0] - flat[0][:, 0])


def _crossings(rays: Rays, cut, depth):
    """Where rays (N,), extended back, cross a depth: how far across, (N,) mm."""
    distance = (depth - rays.origins[:, 2]) / rays.directions[:, 2]
    return cut.flat(rays.at(distance))[:, 1]
