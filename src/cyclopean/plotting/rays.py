"""Light through the optic, drawn in a plane: true rays, virtual cameras and the common field of view."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import to_rgba
from matplotlib.figure import Figure

from ..errors import OpticError, SetupError
from ..optics import Mirrors, Plate, Prism
from ..optics.surfaces import Interface
from ..rigs import Rig, Setup
from .colours import LIGHT_GREY, view_colour
from .ray_parts import (
    DIMENSION,
    GLASS,
    MIRROR,
    Bundle,
    DrawingPlane,
    SketchedCamera,
    bundle,
    draw_camera,
    drawing_plane,
    measure,
    sketched_cameras,
    solid_of,
)

_FIELD_GRID = (141, 401)  # points along z and across
_COARSE = 4  # of these points, one in so many is looked at first
_WIDTH = 11.0  # inches of a figure
_FACTS = 8  # lines of text at most
_FIELD_SHADES = ("#e6f2e2", "#a9d3a0")  # seen by two views at least, by all


def side_view(
    axes: Axes,
    setup: Setup,
    *,
    depths: tuple[float, float] | None = None,
    plane: str | float = "facet",
    rays: int = 5,
    virtual: bool = True,
    field: bool = True,
    dimensions: bool = True,
    until: float | None = None,
    rig: Rig | None = None,
) -> None:
    """Draw a section through camera and optic: rays bent at both faces, and where they seem to come from.

    Parameters
    ----------
    axes : Axes
        What to draw on; z runs to the right, both axes have one scale.
    setup : Setup
        With a prism, a plate, or mirrors.
    depths : (2,) mm, optional
        Nearest and farthest depth of interest, drawn as lines; the setup's, or the rig's working depths.
    plane : "facet", "xz", "yz" or rad
        The plane of the drawing, which always holds the camera's optical axis: that of facet 0 (or of the first
        mirror), or the one at this azimuth from image right. Rays of sub-images that lie off the plane are drawn by
        projection, in a lighter tone.
    rays : int
        How many rays of each view, from one end of its sub-image to the other.
    virtual : bool
        Also draw the virtual cameras (ray sketching, boundary ray through the middle) and the rays extended back.
    field : bool
        Shade what two views, and what all views, see in this plane.
    dimensions : bool
        Write distance, facet angle, baseline and angle of the axes.
    until : float, optional
        Where the drawing ends along z, mm; the far depth without it.
    rig : Rig, optional
        `setup.rig()` where it is at hand already.
    """
    if rays != int(rays) or rays < 1:
        raise SetupError(f"a drawing needs one ray of each view at least, got rays={rays}")
    rig = setup.rig() if rig is None else rig
    cut = drawing_plane(setup, plane)
    depths = drawn_depths(setup, rig, depths)
    until = float(depths[1] if until is None else until)
    bundles = [bundle(setup, rig, k, cut, int(rays)) for k in range(len(rig))]
    cameras = sketched_cameras(setup, rig) if virtual else [None] * len(rig)
    half = _half_height(bundles, cameras, cut, until, setup)
    if field:
        _shade_field(axes, rig, cut, until, half)
    _draw_optic(axes, setup, rig, cut, bundles)
    for one, camera in zip(bundles, cameras, strict=True):
        _draw_bundle(axes, one, camera, cut, until)
    size = min(0.07 * until, 0.3 * half)
    _draw_cameras(axes, setup, rig, cut, cameras, bundles, size)
    if dimensions:
        _draw_dimensions(axes, setup, rig, cut, cameras, bundles, half, size, until)
    for depth in depths:
        if depth <= until:
            axes.axvline(depth, color="#999999", linewidth=0.7, linestyle=(0, (6, 4)), zorder=0.5)
    behind = size * (3.4 if virtual and dimensions else 1.5)
    axes.set(xlim=(-behind, until), ylim=(-half, half), aspect="equal", xlabel="z (mm)", ylabel=cut.label)
    if _upside_down(cut):
        axes.invert_yaxis()


def section_figure(
    setup: Setup, depths: tuple[float, float] | None = None, *, plane: str | float = "facet", rays: int = 5
) -> Figure:
    """The light path in one plane: camera and optic close up above, the whole way to the far depth below."""
    rig = setup.rig()
    depths = drawn_depths(setup, rig, depths)
    figure = Figure(dpi=130, layout="constrained")
    until = close_up(setup, rig)
    both = until < 0.6 * depths[1]  # else one drawing shows all
    near, *rest = figure.subplots(1 + both, 1, squeeze=False)[:, 0]
    side_view(near, setup, depths=depths, plane=plane, rays=rays, until=until if both else None, rig=rig)
    near.set_title(f"{_title(setup)}: camera and optic", fontsize=11)
    for whole in rest:
        side_view(whole, setup, depths=depths, plane=plane, rays=rays, dimensions=False, rig=rig)
        whole.set_title(f"to the far depth, {depths[1]:.4g} mm", fontsize=10)
    shades = {1: "one view", 2: "shaded: seen by both views"}
    shade = shades.get(len(rig), "shaded: seen by two views or more, darker: by all")
    lines = f"dashed: rays extended back, uprights at {depths[0]:.4g} and {depths[1]:.4g} mm"
    paler = "; paler: off this plane, by projection" if len(rig) > 2 else ""
    near.figure.supxlabel(f"{shade}; {lines}{paler}", fontsize=8)
    fit_height(figure, [near, *rest])
    return figure


def fit_height(figure: Figure, axes: Sequence[Axes], width: float = _WIDTH) -> None:
    """Make a figure as high as drawings of one scale, one above the other, ask for."""
    height = 0.0
    for one in axes:
        span, rise = abs(np.ptp(one.get_xlim())), abs(np.ptp(one.get_ylim()))
        height += min(rise / span * (width - 1.0), 0.75 * width) + 0.85
    figure.set_size_inches(width, height)


def drawn_depths(setup: Setup, rig: Rig, depths: tuple[float, float] | None) -> tuple[float, float]:
    """The depths given, else the setup's, else the working depths; two and eight times the optic's where none are."""
    if depths is not None:
        if not 0 < depths[0] < depths[1] < np.inf:
            raise SetupError(f"depths must be (near, far) with 0 < near < far in mm, got {depths}")
        return float(depths[0]), float(depths[1])
    if setup.depths is not None:
        return setup.depths
    end = optic_end(setup, rig)
    if len(rig) == 1:
        return 2 * end, 8 * end
    try:
        near, far = rig.working_depths
    except OpticError:
        return 2 * end, 8 * end
    return near, min(far, 12 * max(near, end))


def optic_end(setup: Setup, rig: Rig) -> float:
    """Largest z (mm) at which light of the picture leaves the optic."""
    ends = np.array([view.rays(view.region.centre).origins[2] for view in rig])
    optic = getattr(setup.optic, "distance", 1.0) + getattr(setup.optic, "thickness", 0.0)
    return float(max([optic, *ends[np.isfinite(ends)]]))


def close_up(setup: Setup, rig: Rig) -> float:
    """Where a drawing of camera and optic ends along z, mm."""
    return 2.0 * optic_end(setup, rig)


def _upside_down(cut):
    """True where the drawing's upright axis is more y than x: y runs down, in the drawing as in the picture."""
    return cut.across[1] > abs(cut.across[0]) + 1e-9


def _title(setup):
    optic = setup.optic
    if isinstance(optic, Prism):
        kind = "biprism" if optic.facets == 2 else f"prism of {optic.facets} facets"
        return f"{kind}, facets towards the {optic.facing}"
    return "mirrors" if isinstance(optic, Mirrors) else optic.kind


def _half_height(bundles, cameras, cut, until, setup):
    """How far the drawing reaches to both sides of the axis, mm."""
    reach = [1.0]
    for one in bundles:
        flat = cut.flat(one.trails)
        reach.append(np.nanmax(np.abs(flat[..., 1]), initial=0.0))
        ends = _ends(one.trails[:, -1], one.directions, until)
        ends = ends[ends[:, 2] <= until * 1.001]
        reach.append(np.nanmax(np.abs(cut.flat(ends)[..., 1]), initial=0.0) if one.in_plane else 0.0)
    for camera in cameras:
        if camera is not None:
            reach.append(1.5 * abs(camera.centre @ cut.across))
    radius = getattr(setup.optic, "radius", None)
    if radius is not None:
        reach.append(radius + np.abs(setup.optic.shift).max() + setup.optic.thickness / 4)
    return 1.12 * max(reach)


def _ends(points, directions, until):
    """Where rays leave the drawing (N, 3): at z = until, or as far to the side where they never come there."""
    with np.errstate(divide="ignore", invalid="ignore"):
        distance = (until - points[:, 2]) / directions[:, 2]
    longest = 3 * until
    distance = np.where((distance > 0) & (distance < longest), distance, longest)
    return points + distance[:, None] * directions


def _shade_field(axes, rig, cut, until, half):
    if len(rig) < 2:
        return
    z = np.linspace(until / _FIELD_GRID[0], until, _FIELD_GRID[0])
    across = np.linspace(-half, half, _FIELD_GRID[1])
    seen = _seen_by(rig, cut.lifted(np.stack(np.meshgrid(z, across), axis=-1)))
    if seen.max() < 2:
        return
    if len(rig) == 2:
        axes.contourf(z, across, seen, levels=[1.5, 2.5], colors=[_FIELD_SHADES[1]], zorder=0)
        return
    axes.contourf(z, across, seen, levels=[1.5, len(rig) - 0.5, len(rig) + 0.5], colors=_FIELD_SHADES, zorder=0)


def _seen_by(rig, points):
    """How many views see each point (H, W) of a grid (H, W, 3): closely where that changes, else as its neighbours."""
    from scipy.ndimage import maximum_filter, minimum_filter

    rows, columns = (np.round(np.arange(n) / _COARSE).astype(int) for n in points.shape[:2])
    coarse = np.isfinite(rig.project(points[::_COARSE, ::_COARSE])[..., 0]).sum(-1)
    rows, columns = np.minimum(rows, len(coarse) - 1), np.minimum(columns, coarse.shape[1] - 1)
    changes = maximum_filter(coarse, 3) != minimum_filter(coarse, 3)
    seen, closely = coarse[np.ix_(rows, columns)], changes[np.ix_(rows, columns)]
    seen[closely] = np.isfinite(rig.project(points[closely])[..., 0]).sum(-1)
    return seen


def _draw_optic(axes, setup, rig, cut, bundles):
    optic = setup.optic
    if isinstance(optic, Prism):
        _draw_prism(axes, setup, rig, cut)
    elif isinstance(optic, Plate):
        _draw_plate(axes, setup, cut, bundles)
    elif isinstance(optic, Mirrors):
        surfaces = [mirror.interface(1.0) for mirror in optic.mirrors]
        for k, surface in enumerate(surfaces):
            _draw_mirror(axes, k, surface, optic.mirrors[k], cut, bundles, rig)


def _draw_prism(axes, setup, rig, cut):
    solid = solid_of(setup, rig)
    corners = solid.in_rig()
    for face, name in zip(solid.faces, solid.names, strict=True):
        if name.startswith("facet"):  # their outlines, as seen from the side
            flat = cut.flat(corners[np.append(face, face[0])])
            axes.plot(*flat.T, color="#9db9cc", linewidth=0.7, zorder=1.5)
    normal = solid.from_rig(cut.normal) - solid.from_rig(np.zeros(3))
    section = solid.section(solid.from_rig(np.zeros(3)), normal)
    if len(section):
        flat = cut.flat(solid.in_rig(section))
        axes.fill(*flat.T, facecolor=GLASS, edgecolor="#20506f", linewidth=1.3, zorder=2)


def _draw_plate(axes, setup, cut, bundles):
    (path,) = setup.optic.paths(setup.wavelength_nm)
    first = path.interfaces[0]
    direction = np.array([-first.normal @ cut.across, first.normal[2]])  # along the face, as (z, across)
    direction /= np.linalg.norm(direction)
    hits = cut.flat(np.concatenate([one.trails[:, 1:].reshape(-1, 3) for one in bundles]))
    along = hits @ direction
    reach = setup.optic.radius or 1.15 * np.nanmax(np.abs(along - np.nanmean(along)))
    middle = cut.flat(np.array([*setup.optic.shift, setup.optic.distance]))
    normal = cut.flat(first.normal)
    if setup.optic.radius is None:
        middle = middle + (np.nanmean(along) - middle @ direction) * direction
    front = np.array([middle - reach * direction, middle + reach * direction])
    back = front[::-1] + setup.optic.thickness * normal / (normal @ normal)
    axes.fill(*np.vstack([front, back]).T, facecolor=GLASS, edgecolor="#20506f", linewidth=1.3, zorder=2)


def _draw_mirror(axes, k: int, surface: Interface, mirror, cut: DrawingPlane, bundles: list[Bundle], rig: Rig):
    u, v, normal = mirror.axes()
    centre = np.asarray(mirror.centre) + mirror.advance * normal
    hits = [one.trails[..., s, :].reshape(-1, 3) for one in bundles for s in range(1, one.trails.shape[1])]
    near = np.concatenate([points[np.abs(points @ normal - surface.offset) < 1e-6] for points in hits] or [centre])
    if mirror.size is None:
        local = (near - centre) @ np.array([u, v]).T if len(near) else np.array([[-20.0, -20.0], [20.0, 20.0]])
        low, high = local.min(0), local.max(0)
        low, high = low - 0.1 * (high - low) - 1, high + 0.1 * (high - low) + 1
    else:
        high = np.array(mirror.size) / 2
        low = -high
    rectangle = np.array([[low[0], low[1]], [high[0], low[1]], [high[0], high[1]], [low[0], high[1]]])
    corners = cut.flat(centre + rectangle @ np.array([u, v]))
    axes.fill(*corners.T, facecolor="#d8dee3", edgecolor=MIRROR, linewidth=0.9, zorder=2)
    axes.plot(*cut.flat(centre + _mirror_cut(low, high, u @ cut.normal, v @ cut.normal) @ np.array([u, v])).T,
              color=MIRROR, linewidth=2.4, zorder=2.5)  # fmt: skip
    outward = -1 if (corners.mean(0)[1] < 0) ^ _upside_down(cut) else 1
    place = {"xytext": (0, 9 * outward), "textcoords": "offset points", "ha": "center", "va": "center"}
    axes.annotate(f"mirror {k}", corners.mean(0), **place, fontsize=8, color=DIMENSION, zorder=8)


def _mirror_cut(low, high, along_u, along_v):
    """Ends (2, 2), in a mirror's own axes, of the line through its middle that is parallel to the drawing's plane."""
    direction = np.array([along_v, -along_u])
    length = np.linalg.norm(direction)
    direction = direction / length if length > 1e-9 else np.array([1.0, 0.0])
    middle = (low + high) / 2
    with np.errstate(divide="ignore"):
        reach = np.min((high - low) / 2 / np.abs(direction))
    return middle + np.array([[-reach], [reach]]) * direction


def _draw_bundle(axes, one: Bundle, camera: SketchedCamera | None, cut, until):
    colour, tone = view_colour(one.view), 1.0 if one.in_plane else 0.35
    flat = cut.flat(one.trails)
    ends = cut.flat(_ends(one.trails[:, -1], one.directions, until))
    for way, end in zip(flat, ends, strict=True):
        axes.plot(*np.vstack([way, end]).T, color=colour, alpha=tone, linewidth=1.0, zorder=3)
    if camera is None:
        return
    centre = cut.flat(camera.centre)
    for way in flat[[0, -1]] if len(flat) > 1 else flat:
        back = np.vstack([way[-1], centre])
        axes.plot(*back.T, color=colour, alpha=0.8 * tone, linewidth=0.8, linestyle=(0, (5, 3)), zorder=3)
    axis = np.vstack([centre, cut.flat(_ends(camera.trails[:1, -1], camera.directions[:1], until))])
    axes.plot(*axis.T, color=colour, alpha=0.8 * tone, linewidth=0.9, linestyle=(0, (12, 3, 2, 3)), zorder=3)


def _draw_cameras(axes, setup, rig, cut, cameras, bundles, size):
    lens = setup.camera
    extent = np.abs(np.multiply([np.cos(cut.azimuth), np.sin(cut.azimuth)], lens.size) / lens.focal)
    half = np.arctan(min(e for e in extent if e > 1e-9) / 2 if min(extent) < 1e-9 else max(extent) / 2)
    for camera, one in zip(cameras, bundles, strict=True):
        if camera is None or np.linalg.norm(camera.centre) < 1e-6:
            continue
        angle = np.arccos(np.clip(camera.directions[0] @ camera.directions[1], -1, 1))
        tone = to_rgba(view_colour(one.view), 1.0 if one.in_plane else 0.4)
        draw_camera(axes, cut.flat(camera.centre), cut.flat(camera.axis), size, angle, tone)
    draw_camera(axes, np.zeros(2), [1.0, 0.0], 1.3 * size, half, "black", real=True)


def _draw_dimensions(axes, setup, rig, cut, cameras, bundles, half, size, until):
    distance = getattr(setup.optic, "distance", None)
    if distance is not None:
        down = 1 if _upside_down(cut) else -1
        sunk = [0.0, 0.9 * half * down]
        for z in (0.0, distance):
            axes.plot([z, z], [0.0, 0.94 * half * down], color=DIMENSION, linewidth=0.5, zorder=1)
        measure(axes, [0.0, 0.0], [distance, 0.0], f"distance {distance:g} mm", sunk)
    pair = [k for k, one in enumerate(bundles) if one.in_plane and cameras[k] is not None]
    if len(pair) == 2 and isinstance(setup.optic, Prism):
        first, second = (cut.flat(cameras[k].centre) for k in pair)
        if np.linalg.norm(first - second) > 1e-3 * until:
            back = min(first[0], second[0]) - 2.4 * size
            for point in (first, second):
                axes.plot([back, point[0]], [point[1]] * 2, color=DIMENSION, linewidth=0.5, zorder=1)
            baseline = np.linalg.norm(cameras[pair[0]].centre - cameras[pair[1]].centre)
            measure(axes, [back, first[1]], [back, second[1]], f"$\\lambda$ = {baseline:.2f} mm")
            _draw_angle(axes, first, cut.flat(cameras[pair[0]].axis), second, cut.flat(cameras[pair[1]].axis), until)
    text = "\n".join(_facts(setup, cameras))
    if text:
        box = {"facecolor": "white", "edgecolor": LIGHT_GREY, "alpha": 0.9, "pad": 3}
        axes.text(0.995, 0.985, text, transform=axes.transAxes, ha="right", va="top", fontsize=8, bbox=box, zorder=9)


def _draw_angle(axes, first, first_axis, second, second_axis, until):
    """The angle between two lines of the drawing, beyond the point where they cross."""
    steps = np.array([first_axis, -second_axis]).T
    if abs(np.linalg.det(steps)) < 1e-6:
        return
    crossing = first + np.linalg.solve(steps, second - first)[0] * first_axis
    if not 0 < crossing[0] < until:
        return
    radius = 0.6 * (until - crossing[0])
    start, end = (np.arctan2(axis[1], axis[0]) for axis in (first_axis, second_axis))
    turn = np.linspace(start, end, 60)
    arc = crossing + radius * np.stack([np.cos(turn), np.sin(turn)], -1)
    axes.plot(*arc.T, color=DIMENSION, linewidth=0.9, zorder=7)
    axes.annotate(
        "$\\gamma$", arc[30], xytext=(3, 0), textcoords="offset points", va="center", color=DIMENSION, zorder=8
    )


def _facts(setup, cameras):
    """Lines of text: the optic's angle, and baseline and angle of the axes of every pair of views."""
    optic, lines = setup.optic, []
    if isinstance(optic, Prism):
        lines.append(f"facet angle {optic.apex_deg:.5g}°, thickness {optic.thickness:.5g} mm")
    if isinstance(optic, Plate):
        lines.append(f"thickness {optic.thickness:g} mm, tilt {np.linalg.norm(optic.tilt_deg):.4g}°")
    known = [(k, camera) for k, camera in enumerate(cameras) if camera is not None]
    lines += ["virtual cameras by ray sketch (middle):"] if len(known) > 1 else []
    for i, (j, first) in enumerate(known):
        for k, second in known[i + 1 :]:
            sine = np.linalg.norm(np.cross(first.axis, second.axis))
            angle = np.degrees(np.arctan2(sine, first.axis @ second.axis))
            baseline = np.linalg.norm(first.centre - second.centre)
            lines.append(f"views {j}, {k}: $\\lambda$ = {baseline:.2f} mm, $\\gamma$ = {angle:.3f}°")
    return lines[:_FACTS] + ([f"and {len(lines) - _FACTS} pairs more"] if len(lines) > _FACTS else [])
