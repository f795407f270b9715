"""The picture of one designed prism: light from the side, what the views share, and the errors of depth."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from ..rigs import Rig, Setup
from .colours import BLUE, GREY, GRID, ORANGE, RED, VERMILION, view_colour
from .ray_parts import drawing_plane, measure
from .rays import close_up, side_view

if TYPE_CHECKING:
    from ..design.judgement import KeptAccuracy
    from ..design.requirements import Candidate, Requirements

_WIDTH, _DPI = 12.0, 120  # inches, dots per inch
_TOP, _GAP, _LEFT, _RIGHT, _BETWEEN = 0.85, 0.85, 0.75, 0.25, 0.8  # inches, around and between panels
_COLUMNS = (5.7, _WIDTH - _LEFT - _RIGHT - _BETWEEN - 5.7)  # inches
_CLOSE_SHAPE = 0.46  # height over width of the panel that shows the optic
_STEEP = 4.0  # times the requirement, above which curves are cut off


def candidate_picture(
    candidate: Candidate,
    requirements: Requirements,
    title: str,
    photograph: np.ndarray | None = None,
    rig: Rig | None = None,
) -> Figure:
    """All that one looks at before buying a prism.

    Parameters
    ----------
    candidate : Candidate
        The prism, its figures, and what it keeps of its accuracy where that is known.
    requirements : Requirements
        What was asked for; drawn where the pictures have a place for it.
    title : str
        What the prism is called.
    photograph : (H, W) or (H, W, 3) array, optional
        What the setup would show; without it the panel shows which view each pixel belongs to.
    rig : Rig, optional
        `candidate.setup.rig()` where it is at hand already.
    """
    setup, depths = candidate.setup, requirements.depths
    rig = setup.rig() if rig is None else rig
    figure = Figure(dpi=_DPI)
    near, sensor, whole, field, errors = (figure.add_axes((0, 0, 1, 1), label=str(k)) for k in range(5))
    _draw_close(near, candidate, rig, depths)
    _draw_sensor(sensor, setup, rig, photograph)
    side_view(whole, setup, depths=depths, rays=3, dimensions=False, rig=rig)
    shade = "shaded: seen by both views" if len(rig) == 2 else "shaded: seen by two views or more, darker: by all"
    whole.set_title(f"common field to the far depth; {shade}; uprights: nearest and farthest depth", fontsize=10)
    draw_field(field, candidate, requirements)
    draw_errors(errors, candidate, requirements)
    flat = abs(np.ptp(whole.get_ylim()) / np.ptp(whole.get_xlim()))
    _arrange(figure, ((near, sensor), (whole,), (field, errors)), min(flat * (_WIDTH - _LEFT - _RIGHT), 4.2))
    figure.suptitle(title, fontsize=12, y=1 - 0.12 / figure.get_figheight(), va="top")
    return figure


def _arrange(figure: Figure, rows: Sequence[Sequence[Axes]], tall: float) -> None:
    """Place rows of panels, the first and the last of a fixed height, that between `tall` inches high.

    By hand: to let matplotlib find the places costs as much as to draw everything once more.
    """
    heights = (_CLOSE_SHAPE * _COLUMNS[0], tall, 2.6)
    whole = _TOP + sum(heights) + len(heights) * _GAP - 0.15
    figure.set_size_inches(_WIDTH, whole)
    top = whole - _TOP
    for row, height in zip(rows, heights, strict=True):
        widths = _COLUMNS if len(row) == 2 else (_WIDTH - _LEFT - _RIGHT,)
        left = _LEFT
        for axes, width in zip(row, widths, strict=True):
            axes.set_position((left / _WIDTH, (top - height) / whole, width / _WIDTH, height / whole))
            left += width + _BETWEEN
        top -= height + _GAP


def _draw_close(axes: Axes, candidate: Candidate, rig: Rig, depths) -> None:
    """Camera and optic from the side, with distance and baseline."""
    setup, prism = candidate.setup, candidate.prism
    side_view(axes, setup, depths=depths, rays=3, dimensions=False, until=close_up(setup, rig), rig=rig)
    cut = drawing_plane(setup)
    low, high = axes.get_ylim()
    room = 0.16 * (high - low)
    line = low - 0.7 * room
    measure(axes, [0, line], [prism.distance, line], f"distance {prism.distance:.4g} mm")
    for z in (0.0, prism.distance):
        axes.plot([z, z], [0.0, low - 0.9 * room], color=GREY, linewidth=0.5, zorder=1)
    axes.set_ylim(low - 1.4 * room, high)
    _fill_panel(axes, _CLOSE_SHAPE)
    axes.set_title(
        f"camera and prism, cut at {np.degrees(cut.azimuth) % 180:.4g}° from x; dashed: virtual cameras", fontsize=10
    )


def _fill_panel(axes: Axes, shape: float) -> None:
    """Widen the limits so that a drawing in one scale fills a panel of this height over width."""
    (left, right), (bottom, top) = axes.get_xlim(), axes.get_ylim()
    wide, tall = right - left, abs(top - bottom)
    if tall < shape * wide:
        grow = (shape * wide - tall) / 2 * np.sign(top - bottom)
        axes.set_ylim(bottom - grow, top + grow)
    else:
        grow = (tall / shape - wide) / 2
        axes.set_xlim(left - grow, right + grow)


def _draw_sensor(axes: Axes, setup: Setup, rig: Rig, photograph: np.ndarray | None) -> None:
    """The photograph, or the sub-images, with the outline of each view."""
    width, height = setup.camera.size
    size, middle = np.array([width, height]), np.array([width, height]) / 2
    axes.set(xlim=(-0.5, width - 0.5), ylim=(height - 0.5, -0.5), aspect="equal", xlabel="x (px)", ylabel="y (px)")
    axes.set_facecolor("#222222" if photograph is None else "black")
    if photograph is not None:
        axes.imshow(
            photograph, extent=(-0.5, width - 0.5, height - 0.5, -0.5), cmap="gray", vmin=0, vmax=255,
            interpolation="antialiased",
        )  # fmt: skip
    for k, view in enumerate(rig):
        for outline in view.region.outline:
            closed = np.vstack([outline, outline[:1]])
            if photograph is None:
                axes.fill(*closed.T, color=view_colour(k), alpha=0.85)
            axes.plot(*closed.T, color=view_colour(k), linewidth=1.4)
        x, y = (
            view.region.centre
            if photograph is None
            else np.clip(1.5 * (view.region.centre - middle) + middle, 0.05 * size, 0.95 * size)
        )
        axes.text(
            float(x), float(y), f"view {k}", color="white", ha="center",
            va="center", fontsize=9, bbox={"facecolor": view_colour(k), "edgecolor": "none", "alpha": 0.8, "pad": 2},
        )  # fmt: skip
    what = (
        "simulated photograph of a wall, a board and a block"
        if photograph is not None
        else "the photograph's sub-images"
    )
    axes.set_title(what, fontsize=10)
    axes.tick_params(labelsize=8)


def draw_field(axes: Axes, candidate: Candidate, requirements: Requirements) -> None:
    """What views share over depth: as a square of the same area, or in the proportions that were asked for."""
    figures, wanted = candidate.figures, requirements.field
    if wanted is None:
        two, every = (np.sqrt(area) for area in (figures.area_two, figures.area_all))
        what, title = "side (mm)", "common field: side of a square as large as what is shared"
    else:
        two, every = figures.field_two[:, 0], figures.field_all[:, 0]
        what, title = "width (mm)", f"common field: largest rectangle about the axis, as wide to high as {_by(wanted)}"
        axes.axhline(wanted[0], color=RED, linestyle="--", linewidth=1.2, label=f"asked for: {_by(wanted)} mm")
    several = candidate.prism.facets > 2
    axes.plot(figures.depths, two, color=ORANGE, linewidth=1.8, label="two views or more" if several else "both views")
    if several:
        axes.plot(figures.depths, every, color=BLUE, linewidth=1.8, label="all views")
    axes.set(xlabel="depth z (mm)", ylabel=what, xlim=requirements.depths)
    axes.set_ylim(0, 1.35 * axes.get_ylim()[1])
    axes.set_title(title, fontsize=10)
    _finish(axes)


def _by(size):
    return f"{size[0]:g} x {size[1]:g}"


def draw_errors(axes: Axes, candidate: Candidate, requirements: Requirements) -> None:
    """Standard deviation of depth in percent of depth: on paper, kept after calibration, and asked for."""
    figures, kept = candidate.figures, candidate.kept
    axes.plot(figures.depths, 100 * figures.sigma, color=BLUE, linewidth=1.8, label="on paper: pixel noise")
    axes.plot(
        figures.depths, 100 * figures.sigma_worst, ":", color=BLUE, linewidth=1.2, label="on paper, worst of the field"
    )
    tops = [np.nanmax(np.where(np.isfinite(figures.sigma_worst), 100 * figures.sigma_worst, 0.0), initial=0.0)]
    if kept is not None:
        tops.append(_draw_kept(axes, kept))
    if requirements.accuracy is not None:
        wanted = 100 * requirements.accuracy
        axes.axhline(wanted, color=RED, linestyle="--", linewidth=1.2, label=f"asked for: {wanted:.3g} %")
        tops = [min(max(*tops, wanted), _STEEP * wanted)]
    axes.set(xlabel="depth z (mm)", xlim=requirements.depths)
    axes.set_ylabel("standard deviation (% of depth)")
    axes.set_ylim(0, 1.4 * max(tops) if max(tops) > 0 else 1.0)
    axes.set_title("error of depth", fontsize=10)
    _finish(axes)


def _draw_kept(axes: Axes, kept: KeptAccuracy) -> float:
    """Draw what prisms keep as they are really made; returns how high it reaches, %."""
    from ..design.judgement import SHARE

    if kept.after is None:
        axes.text(0.5, 0.5, f"cannot be judged: {kept.reason}", transform=axes.transAxes, ha="center", wrap=True)
        return 0.0
    median, most = 100 * kept.after.median, 100 * kept.after.quantile(SHARE)
    most = np.where(np.isfinite(most), most, np.nan)
    axes.fill_between(kept.depths, median, most, color=VERMILION, alpha=0.25, linewidth=0)
    axes.plot(kept.depths, median, color=VERMILION, linewidth=1.2, label="calibrated: half of all prisms")
    axes.plot(kept.depths, most, color=VERMILION, linewidth=2.0, label=f"calibrated: {100 * SHARE:g} % of them")
    if kept.before is not None:
        axes.plot([], [], " ", label=f"not calibrated: {100 * kept.worst_before:.2g} %")
    return float(np.nanmax(most, initial=0.0))


def _finish(axes):
    axes.grid(**GRID)
    axes.set_axisbelow(True)
    axes.spines[["top", "right"]].set_visible(False)
    axes.tick_params(labelsize=8)
    axes.legend(fontsize=8, framealpha=0.9, loc="upper left", ncols=2)
