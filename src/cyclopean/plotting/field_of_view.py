"""Pictures of the common field of view: from the side, across, its classes, and on the sensor."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.colors import BoundaryNorm, ListedColormap
from matplotlib.figure import Figure
from matplotlib.patches import Patch, PathPatch
from matplotlib.path import Path

from ..analysis.borders import border_rays
from ..analysis.common_volume import CommonSection
from ..analysis.field_of_view import FieldOfView, not_upright
from ..analysis.sensor_use import LOST, SensorUse
from ..rigs import Rig, Setup
from .ray_parts import drawing_plane
from .rays import side_view

_GRID = (320, 320)  # samples across and along the side view
_LINE = "#222222"


def counting_colours(views: int) -> list[tuple[float, float, float, float]]:
    """Colours (views,) for what 1, 2, ... n views see, from pale to dark."""
    return [colormaps["YlGnBu"](share) for share in np.linspace(0.12, 0.88, views)]


def field_picture(
    setup: Setup,
    rig: Rig,
    depths: tuple[float, float],
    traced: np.ndarray,
    field: FieldOfView | None = None,
) -> Figure:
    """The field in one picture: light from the side, who sees what there, and the half width over depth.

    Parameters
    ----------
    setup, rig : Setup, Rig
        What is drawn, cut in the plane through the optical axis and the middle of the first facet.
    depths : (near, far)
        mm, between which the half width is drawn; the side views begin at the camera.
    traced : (N, 2) array
        Depth and half width, mm, as traced.
    field : FieldOfView, optional
        Closed form of the half width.
    """
    figure = Figure(dpi=110, layout="constrained")
    grid = figure.add_gridspec(2, 2, width_ratios=[1.2, 1])
    above = figure.add_subplot(grid[0, :])
    side_view(above, setup, depths=depths, rays=2, dimensions=False, rig=rig)
    above.set_title(
        "light through the optic: boundary rays of each view, and its virtual camera; views whose facets coincide from "
        "this side are drawn as one", fontsize=10,
    )  # fmt: skip
    flat = float(np.ptp(above.get_ylim()) / np.ptp(above.get_xlim()))
    grid.set_height_ratios([min(11.6 * flat, 8.0) + 0.9, 5.2])
    figure.set_size_inches(13, min(11.6 * flat, 8.0) + 6.3)
    draw_side(figure.add_subplot(grid[1, 0]), setup, rig, depths)
    right = figure.add_subplot(grid[1, 1])
    draw_half_width(right, depths, field, traced, len(rig))
    if field is not None and not_upright(setup):
        right.set_title(f"{right.get_title()} (closed form: of the prism set upright)", fontsize=10)
    return figure


def draw_side(axes: Axes, setup: Setup, rig: Rig, depths: tuple[float, float]) -> None:
    """Draw how many views see each point of the plane through the optical axis and the middle of the first facet."""
    cut, far = drawing_plane(setup), depths[1]
    towards = cut.across[:2]
    low, high = _reach(rig, towards, far)
    across, along = np.linspace(low, high, _GRID[0]), np.linspace(0, far, _GRID[1] + 1)[1:]
    points = np.empty((*_GRID, 3))
    points[..., :2], points[..., 2] = across[:, None, None] * towards, along
    counts = np.isfinite(rig.project(points)[..., 0]).sum(-1)
    _draw_counts(axes, counts, len(rig), (0, far, low, high))
    seen = across[(counts > 0).any(1)]
    room = 0.05 * np.ptp(seen)
    axes.set_ylim(seen.min() - room, seen.max() + room)
    for depth in depths:
        axes.axvline(depth, color="#999999", linewidth=0.7, linestyle=(0, (6, 4)))
    axes.set_xlabel("z (mm)")
    axes.set_ylabel(cut.label)
    if cut.across[1] > abs(cut.across[0]) + 1e-9:
        axes.invert_yaxis()  # y runs down, as in the picture
    axes.set_title("how many views see a point of this plane", fontsize=10)
    axes.legend(handles=_count_patches(len(rig)), fontsize=8, loc="upper left", framealpha=0.9)


def draw_half_width(
    axes: Axes, depths: tuple[float, float], field: FieldOfView | None, traced: np.ndarray, views: int
) -> None:
    """Draw the half width of the field that all views share over depth: closed form, and as traced (N, 2)."""
    what = "radius of the largest circle"
    if field is not None:
        what = "half width in this plane" if views == 2 else "radius of the largest circle about the axis"
    if field is not None:
        low = min(depths[0], 0.9 * field.near)
        marks = [depth for depth in (field.near, field.kink, field.far) if low < depth < depths[1]]
        depth = np.unique(np.concatenate([np.linspace(low, depths[1], 400), marks]))
        axes.plot(depth, field.half_width(depth), color="#d55e00", linewidth=2, label=f"closed form, {field.kind}")
        top = float(field.half_width(depth).max())
        for name in ("near", "kink", "far"):
            mark = getattr(field, name)
            if low < mark < depths[1]:
                axes.axvline(mark, color="#999999", linewidth=1, linestyle=":")
                axes.annotate(
                    f"{name} {mark:.4g} mm", (mark, 0.02 * top), (3, 2), textcoords="offset points", rotation=90,
                    fontsize=8, va="bottom",
                )  # fmt: skip
    axes.plot(*np.asarray(traced).T, "o" if field is not None else "o-", color="#0072b2", markersize=5, label="traced")
    axes.set_ylim(bottom=0)
    axes.set_xlabel("depth z (mm)")
    axes.set_ylabel(f"{what} (mm)")
    axes.set_title(
        f"what {'all' if views > 2 else 'both'} views share" if views > 1 else "what the view sees", fontsize=10
    )
    axes.legend()
    axes.grid(color="#dddddd", linewidth=0.6)
    axes.spines[["top", "right"]].set_visible(False)


def classes_picture(fields: Sequence[FieldOfView], far: float | None = None) -> Figure:
    """Closed-form fields side by side: axes dashed, boundaries, and the common field, in the plane of the facets.

    Parameters
    ----------
    fields : sequence of FieldOfView
        Drawn in the plane through the optical axis and the first facet.
    far : float, optional
        Farthest depth, mm; beyond all kinks and limits where not given.
    """
    figure = Figure(figsize=(5.2 * len(fields), 4.8), dpi=110, layout="constrained")
    panels = figure.subplots(1, len(fields), squeeze=False)[0]
    if far is None:
        marks = [depth for field in fields for depth in (field.kink, field.far) if np.isfinite(depth)]
        far = 1.25 * max([*marks, 3 * max(field.near for field in fields)])
    for axes, field in zip(panels, fields, strict=True):
        _draw_class(axes, field, far)
    return figure


def sections_picture(rows: Mapping[str, Sequence[Sequence[CommonSection]]]) -> Figure:
    """Cross-sections at several depths, coloured by how many views see what.

    Parameters
    ----------
    rows : mapping
        Heading of a row -> what `CommonField.sections` gives at each of its depths.
    """
    columns = max(len(row) for row in rows.values())
    shapes = [max(sections[0].height / max(sections[0].width, 1e-9) for sections in row) for row in rows.values()]
    heights = 2.7 * np.clip(shapes, 0.3, 1.5) + 0.75
    figure = Figure(figsize=(3.3 * columns + 0.6, heights.sum() + 0.3), dpi=110, layout="constrained")
    panels = figure.subplots(len(rows), columns, squeeze=False, height_ratios=heights.tolist())
    for (heading, row), places in zip(rows.items(), panels, strict=True):
        for axes, sections in zip(places, row, strict=False):
            draw_section(axes, sections)
            axes.set_title(f"z = {sections[0].depth:g} mm", fontsize=10)
        places[0].set_ylabel(f"{heading}\ny (mm)" if heading else "y (mm)")
        for axes in places[len(row) :]:
            axes.set_axis_off()
    most = max(len(sections) for row in rows.values() for sections in row)
    if len({len(sections) for row in rows.values() for sections in row}) == 1:
        figure.legend(handles=_count_patches(most), loc="outside lower center", ncols=most, frameon=False)
    else:
        for places, row in zip(panels, rows.values(), strict=True):
            beside = {"loc": "upper left", "bbox_to_anchor": (1.02, 1.0), "frameon": False}
            places[len(row) - 1].legend(handles=_count_patches(len(row[0])), fontsize=8, **beside)
    return figure


def draw_section(axes: Axes, sections: Sequence[CommonSection]) -> None:
    """Draw a cross-section, y down as in the picture, from what one view sees to what all see."""
    for section, colour in zip(sections, counting_colours(len(sections)), strict=True):
        if not section.polygons:
            continue
        closed = [np.vstack([polygon, polygon[:1]]) for polygon in section.polygons]
        outline = Path.make_compound_path(*(Path(polygon, closed=True) for polygon in closed))
        axes.add_patch(PathPatch(outline, facecolor=colour, edgecolor=_LINE, linewidth=0.5))
    centre, radius = sections[-1].inscribed_circle
    if radius > 0:
        around = np.linspace(0, 2 * np.pi, 100)
        circle = centre + radius * np.stack([np.cos(around), np.sin(around)], -1)
        axes.plot(*circle.T, color="white", linewidth=1, linestyle="--")
    axes.autoscale_view()
    axes.set_aspect("equal")
    if not axes.yaxis_inverted():
        axes.invert_yaxis()
    axes.set_xlabel("x (mm)")
    axes.tick_params(labelsize=8)


def sensor_picture(uses: Sequence[SensorUse]) -> Figure:
    """The sensor at several depths: how many views see what each pixel looks at, and what seams cost."""
    height, width = uses[0].counts.shape
    across = 15.0 / len(uses) if len(uses) > 2 else 6.0
    figure = Figure(figsize=(across * len(uses), across * height / width + 1.1), dpi=110, layout="constrained")
    panels = figure.subplots(1, len(uses), squeeze=False)[0]
    for axes, use in zip(panels, uses, strict=True):
        size = [-0.5, width * use.step - 0.5, height * use.step - 0.5, -0.5]
        _draw_counts(axes, np.maximum(use.counts, 0)[::-1], use.views, (size[0], size[1], size[2], size[3]))
        if (use.counts == LOST).any():
            x = np.arange(width) * use.step
            y = np.arange(height) * use.step
            lost = (use.counts == LOST).astype(float)
            axes.contourf(x, y, lost, levels=[0.5, 1.5], colors=["#f6b48f"], hatches=["////"])
        axes.set_xlim(size[0], size[1])
        axes.set_ylim(size[2], size[3])
        axes.set_aspect("equal")
        share = f"{100 * use.share(min(2, use.views)):.0f} %"
        axes.set_title(f"z = {use.depth:g} mm: {share} seen by {min(2, use.views)} or more", fontsize=10)
        axes.tick_params(labelsize=8)
    handles = [*_count_patches(uses[0].views), Patch(facecolor="#f6b48f", hatch="////", label="lost beside seams")]
    figure.legend(handles=handles, loc="outside lower center", ncols=len(handles), frameon=False)
    return figure


def _reach(rig, towards, far):
    """From where to where the fields reach along a direction at the farthest depth, mm, with some room."""
    ends = []
    for view in rig:
        for rays in border_rays(view, 120):
            ends.extend(rays.at_depth(far)[:, :2] @ towards)
    low, high = np.nanmin(ends), np.nanmax(ends)
    room = 0.06 * (high - low)
    return float(low - room), float(high + room)


def _draw_counts(axes, counts, views, extent):
    """Draw numbers of views as colours, 0 white."""
    shades = ListedColormap([(1, 1, 1, 1), *counting_colours(views)])
    norm = BoundaryNorm(np.arange(-0.5, views + 1), views + 1)
    axes.imshow(
        counts, extent=extent, origin="lower", aspect="auto", cmap=shades, norm=norm, interpolation="nearest",
    )  # fmt: skip


def _count_patches(views):
    names = ["1 view", *(f"{k} views" for k in range(2, views + 1))]
    return [Patch(color=colour, label=name) for colour, name in zip(counting_colours(views), names, strict=True)]


def _draw_class(axes, field, far):
    """Draw one field in closed form in the plane through the optical axis and the first facet."""
    opposite = field.facets // 2  # the facet across, or next to it
    depth = np.linspace(min(0.0, field.centres.min()), far, 600)
    wide = field.half_width(depth)
    axes.fill_between(
        depth, -wide, wide, where=wide > 0, color=counting_colours(2)[1], alpha=0.7, label="common to all"
    )
    for side, facet, colour in ((1, 0, "#d55e00"), (-1, opposite, "#0072b2")):
        centre = field.centres[facet]
        here = np.array([centre, far])
        axis = (field.crossing - here) * np.tan(field.deviation)
        outer = field.baselines[facet] / 2 + (here - centre) * np.tan(field.half_angles[facet] - field.deviation)
        axes.plot(here, side * axis, color=colour, linestyle="--", linewidth=1.3)
        axes.plot(here, side * outer, color=colour, linewidth=1.3)
        axes.plot(centre, side * field.baselines[facet] / 2, "o", color=colour, markersize=5)
    for name in ("near", "kink", "far"):
        mark = getattr(field, name)
        if np.isfinite(mark) and mark <= far:
            axes.axvline(mark, color="#999999", linewidth=0.8, linestyle=":")
            axes.annotate(f"{name} {mark:.0f}", (mark, axes.get_ylim()[0]), (2, 3), textcoords="offset points",
                          fontsize=8, rotation=90, va="bottom")  # fmt: skip
    omega, gamma = np.degrees(field.omega1.min()), np.degrees(field.gamma)
    axes.set_title(f"{field.kind}\nomega1 {omega:.2f} deg, gamma {gamma:.2f} deg", fontsize=10)
    axes.set_xlabel("depth z (mm)")
    axes.set_ylabel("mm from the optical axis")
    axes.spines[["top", "right"]].set_visible(False)
