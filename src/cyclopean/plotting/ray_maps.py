"""Ray maps: where camera and optic stand, seen from three sides and in space, and how virtual cameras arise."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from ..optics import Mirrors, Prism
from ..optics.footprints import meeting_points
from ..rigs import Rig, Setup
from .colours import view_colour
from .ray_parts import DIMENSION, MIRROR, SketchedCamera, sketched_cameras, solid_of
from .rays import close_up, drawn_depths, side_view

_EDGE = "#20506f"


def ray_map(setup: Setup, depths: tuple[float, float] | None = None) -> Figure:
    """Position of optic and camera: from above, from the side, as the camera sees it, and in space."""
    rig = setup.rig()
    depths = drawn_depths(setup, rig, depths)
    until = close_up(setup, rig)
    cameras = sketched_cameras(setup, rig)
    figure = Figure(figsize=(13.0, 9.0), dpi=120, layout="constrained")
    grid = figure.add_gridspec(2, 2, width_ratios=(1.45, 1.0))
    for row, (plane, title) in enumerate([("xz", "in the plane y = 0"), ("yz", "in the plane x = 0")]):
        axes = figure.add_subplot(grid[row, 0])
        side_view(axes, setup, depths=depths, plane=plane, until=until, rig=rig, dimensions=plane == "xz")
        axes.set_title(title, fontsize=10)
    front = figure.add_subplot(grid[0, 1])
    front_view(front, setup, rig)
    front.set_title("as the camera looks at it; filled: where its light passes", fontsize=10)
    space = figure.add_subplot(grid[1, 1], projection="3d")
    space_view(space, setup, rig, cameras, until)
    space.set_title("in space", fontsize=10)
    return figure


def front_view(axes: Axes, setup: Setup, rig: Rig | None = None) -> None:
    """Draw the optic as the camera looks at it, x to the right and y down, mm, with the footprints of the views.

    A footprint is where the light of a sub-image meets the facet, the mirror, or the plate's second face.
    """
    rig = setup.rig() if rig is None else rig
    for line, strong in _outlines(setup, rig):
        axes.plot(line[:, 0], line[:, 1], color=_EDGE, linewidth=1.4 if strong else 0.9, zorder=3)
    for k, (view, path) in enumerate(zip(rig, setup.optic.paths(setup.wavelength_nm), strict=True)):
        if not path.interfaces:
            continue
        steepest = int(np.argmax([np.linalg.norm(surface.normal[:2]) for surface in path.interfaces]))
        surface = 0 if isinstance(setup.optic, Mirrors) else steepest
        for outline in view.region.outline:
            points = meeting_points(path, view.camera.rays(outline))[:, surface]
            points = points[np.isfinite(points).all(-1)]
            axes.fill(points[:, 0], points[:, 1], color=view_colour(k), alpha=0.35, linewidth=0, zorder=2)
        middle = meeting_points(path, view.camera.rays(view.region.centre))[surface]
        axes.annotate(f"{k}", middle[:2], ha="center", va="center", weight="bold", color=DIMENSION, zorder=5)
    axes.plot(0, 0, "+", color="black", markersize=10, zorder=6)
    axes.annotate("optical axis", (0, 0), xytext=(6, -7), textcoords="offset points", fontsize=7, va="top", zorder=6)
    axes.set(aspect="equal", xlabel="x (mm)", ylabel="y (mm)")
    if not axes.yaxis_inverted():
        axes.invert_yaxis()


def _outlines(setup, rig):
    """Lines (N, 3) of the optic's edges in the rig frame, each with whether it belongs to the outer edge."""
    optic = setup.optic
    if isinstance(optic, Prism):
        solid = solid_of(setup, rig)
        corners = solid.in_rig()
        for face, name in zip(solid.faces, solid.names, strict=True):
            if name != "wall":
                yield corners[np.append(face, face[0])], name == "flat face"
    elif isinstance(optic, Mirrors):
        for mirror in optic.mirrors:
            if mirror.size is not None:
                u, v, normal = mirror.axes()
                half = np.array(mirror.size) / 2
                square = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1], [-1, -1]]) * half
                yield np.asarray(mirror.centre) + mirror.advance * normal + square @ np.array([u, v]), True
    elif getattr(optic, "radius", None) is not None:
        for surface in optic.paths(setup.wavelength_nm)[0].interfaces:
            disc = surface.disc
            u = np.cross(disc.axis, [0.0, 1.0, 0.0])
            u /= np.linalg.norm(u)
            turn = np.linspace(0, 2 * np.pi, 121)[:, None]
            centre = disc.centre + (surface.offset - surface.normal @ disc.centre) * surface.normal
            yield centre + disc.radius * (np.cos(turn) * u + np.sin(turn) * np.cross(disc.axis, u)), True


def space_view(axes, setup: Setup, rig: Rig, cameras: list[SketchedCamera | None], until: float) -> None:
    """Draw optic, axis ray and boundary ray of each view, and the virtual centres, on 3-D axes."""
    for line, _ in _outlines(setup, rig):
        _line(axes, line, color=_EDGE if isinstance(setup.optic, Prism) else MIRROR, linewidth=0.8)
    points = [np.zeros((1, 3))]
    for k, camera in enumerate(cameras):
        if camera is None:
            continue
        colour = view_colour(k)
        for trail, direction in zip(camera.trails, camera.directions, strict=True):
            ahead = (until - trail[-1, 2]) / direction[2] if direction[2] > 0.2 else 0.4 * until
            way = np.vstack([trail, trail[-1] + max(ahead, 0.0) * direction])
            back = np.vstack([trail[-1], camera.centre])
            _line(axes, way, color=colour, linewidth=1.0)
            _line(axes, back, color=colour, linewidth=0.8, linestyle="--")
            points.append(way)
        _line(axes, camera.centre[None], color=colour, marker="o", markersize=4)
        axes.text(camera.centre[0], camera.centre[2], -camera.centre[1], f"  {k}", fontsize=8)
        points.append(camera.centre[None])
    _line(axes, np.zeros((1, 3)), color="black", marker="o", markersize=5)
    points += [line for line, _ in _outlines(setup, rig)]
    _equal_scale(axes, np.concatenate(points))


def _line(axes, points, **style):
    axes.plot(points[:, 0], points[:, 2], -points[:, 1], **style)


def _equal_scale(axes, points):
    """Limits and shape of 3-D axes so that a mm is as long in every direction."""
    points = points[np.isfinite(points).all(-1)] * [1.0, -1.0, 1.0]
    low, high = points.min(0), points.max(0)
    room = 0.04 * (high - low).max()
    low, high = low - room, high + room
    axes.set_xlim(low[0], high[0])
    axes.set_ylim(low[2], high[2])
    axes.set_zlim(low[1], high[1])
    axes.set_box_aspect((high - low)[[0, 2, 1]], zoom=0.95)
    axes.set_xlabel("x (mm)", fontsize=8)
    axes.set_ylabel("z (mm)", fontsize=8)
    axes.set_zlabel("-y (mm)", fontsize=8)
    axes.tick_params(labelsize=7)
    axes.locator_params(nbins=4, axis="x")
    axes.locator_params(nbins=4, axis="z")
    axes.view_init(elev=24, azim=-60)


def virtual_camera_figure(setup: Setup, depths: tuple[float, float] | None = None, boundary: str = "edge") -> Figure:
    """How virtual cameras arise: axis ray and boundary ray of each view, extended back to their shortest segment.

    Parameters
    ----------
    setup : Setup
        With any optic.
    depths : (2,) mm, optional
        Only the far one counts: nothing is drawn beyond it.
    boundary : "edge" or "middle"
        Which boundary ray, as in `rigs.sketch`. The two rays of the middle one lie in a plane of symmetry and meet;
        those of an edge are skew, and the virtual centre is the middle of their shortest segment.

    References
    ----------
    Xiao, thesis (National University of Singapore), sections 4.1.3, 5.1.2 and 6.1.2.
    """
    rig = setup.rig()
    until = min(close_up(setup, rig), drawn_depths(setup, rig, depths)[1])
    cameras = sketched_cameras(setup, rig, boundary)
    figure = Figure(figsize=(13.0, 9.5), dpi=120, layout="constrained")
    grid = figure.add_gridspec(2, 2, height_ratios=(1.5, 1.0), width_ratios=(1.15, 1.0))
    space = figure.add_subplot(grid[0, 0], projection="3d")
    space_view(space, setup, rig, cameras, until)
    space.set_title(f"axis ray and boundary ray ({boundary}) of each view", fontsize=10)
    _table(figure.add_subplot(grid[0, 1]), rig, cameras)
    crossing, gap = figure.add_subplot(grid[1, 0]), figure.add_subplot(grid[1, 1])
    _draw_meeting(crossing, gap, cameras)
    return figure


def _table(axes, rig, cameras):
    axes.set_axis_off()
    rows = []
    for k, (view, camera) in enumerate(zip(rig, cameras, strict=True)):
        if camera is None:
            rows.append([f"{k} {view.name}", "rays are parallel", "", "", ""])
            continue
        centre = ", ".join(f"{value:.3f}" for value in camera.centre)
        cosine, sine = camera.axis[2], np.hypot(*camera.axis[:2])
        tilt = np.degrees(np.arctan2(sine, cosine))
        rows.append([f"{k} {view.name}", centre, f"{tilt:.3f}", f"{camera.focal:.1f}", f"{camera.gap:.4f}"])
    columns = ["view", "centre x, y, z (mm)", "axis to z (deg)", "f' (px)", "gap (mm)"]
    table = axes.table(rows, colLabels=columns, loc="center", cellLoc="center", edges="horizontal")
    table.auto_set_font_size(False)
    table.set_fontsize(9)
    table.auto_set_column_width(list(range(len(columns))))
    table.scale(1.0, 1.5)
    axes.set_title("virtual cameras; gap: length of the shortest segment", fontsize=10)


def _draw_meeting(crossing: Axes, gap: Axes, cameras: list[SketchedCamera | None]) -> None:
    """Both rays around their shortest segment: upright to it, where they cross, and along it, where they miss."""
    known = [(k, camera) for k, camera in enumerate(cameras) if camera is not None]
    reach = max([2.0, *(8 * camera.gap for _, camera in known)])
    for k, camera in known:
        axis, boundary = camera.directions
        upright = np.cross(axis, boundary)
        upright /= np.linalg.norm(upright)
        side = np.cross(upright, axis)
        for direction, end, style in zip((axis, boundary), camera.segment, ("-.", "--"), strict=True):
            line = end + np.array([[-reach], [reach]]) * direction - camera.centre
            for axes, across in ((crossing, side), (gap, upright)):
                (drawn,) = axes.plot(line @ axis, line @ across, style, color=view_colour(k))
                drawn.set_linewidth(max(3.0 - 0.6 * k, 0.8))
        ends = camera.segment - camera.centre
        gap.plot(
            ends @ axis,
            ends @ upright,
            color=view_colour(k),
            linewidth=max(5 - k, 1),
            label=f"{k}: {camera.gap:.4f} mm",
        )
        crossing.plot(0, 0, "o", color=view_colour(k))
    largest = max((camera.gap for _, camera in known), default=0.0)
    crossing.set(xlabel="along the virtual axis (mm)", ylabel="across it (mm)", aspect="equal", xlim=(-reach, reach))
    crossing.set_title("the two rays extended back: dash-dot the axis ray, dashed the boundary ray", fontsize=10)
    gap.set(xlabel="along the virtual axis (mm)", ylabel="along the shortest segment (mm)", xlim=(-reach, reach))
    gap.set_ylim(-max(largest, 0.01), max(largest, 0.01))
    gap.set_title("their shortest segment, from the side; the virtual centre is its middle", fontsize=10)
    if known:
        gap.legend(title="view: gap", fontsize=8, title_fontsize=8, loc="upper right")
