"""The workshop drawing of a prism: onto the facets, cut through its axis, and along an edge."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from matplotlib.figure import Figure

from ..optics import Prism
from ..optics.dimensions import ClearAperture, PrismDimensions, clear_aperture, prism_dimensions
from ..optics.solid import PrismSolid, prism_solid, seam_directions
from ..rigs import Setup
from .ray_parts import reach_along_ridge
from .workshop import (
    COLUMN,
    TABLES_TOP,
    Page,
    Tolerances,
    aperture_margin,
    border_rays,
    material_rows,
    notes,
    place_of_tables,
    start_sheet,
    surface_rows,
)
from .workshop_sheet import MARGIN, TITLE_SIZE, Sheet, degrees_text, length_text
from .workshop_view import draw_in_space

_ROOM = (104.0, 34.0)  # mm beside and above the views for dimensions
_LISTED = 10  # facets in the table
_RING = 1.1  # times the outline: a clear aperture that is larger is not drawn
_DIMENSIONED = 4  # with more facets their azimuths stand in the table alone


@dataclass(frozen=True, eq=False)
class _Part:
    """A prism with all that its drawing states; azimuths are turned so that facet 0 looks up."""

    prism: Prism
    solid: PrismSolid
    measures: PrismDimensions
    aperture: ClearAperture
    turn: float  # rad, by which the prism is turned about its axis

    def front(self, points: np.ndarray) -> np.ndarray:
        """Points (..., 3) of the workshop's frame, seen onto the facets, (..., 2) mm."""
        c, s = np.cos(self.turn), np.sin(self.turn)
        return np.asarray(points)[..., :2] @ np.array([[c, s], [-s, c]])


def draw_prism(setup: Setup, page: Page, tolerances: Tolerances, width: float | None) -> Figure:
    """The drawing of a setup's prism; see `workshop.workshop_drawing`."""
    part = _part(setup, width)
    outline = part.front(part.solid.vertices)
    low, high = outline.min(0), outline.max(0)
    extent = high - low + [part.prism.thickness, 0.0]
    kind = "Biprism" if part.prism.facets == 2 else f"Prism, {part.prism.facets} facets"
    material = material_rows(part.prism, setup.wavelength_nm)
    sheet, scale = start_sheet(page, kind, material[0], tuple(extent), _ROOM)
    area = sheet.size[1] - MARGIN + TABLES_TOP
    origin = np.array([MARGIN + 20.0, area / 2 + 1.0]) - scale * np.array([low[0], (low[1] + high[1]) / 2])
    _draw_front(sheet, part, origin, scale, tolerances)
    _draw_section(sheet, part, np.array([origin[0] + scale * high[0] + 30.0, origin[1]]), scale, tolerances)
    lowest = _draw_edge(sheet, part, scale)
    rows = min(part.prism.facets, _LISTED) + (part.prism.facets > _LISTED)
    room = lowest - (MARGIN + TITLE_SIZE[1] + 20 + 4.6 * rows)
    if room > 30:
        place = (sheet.size[0] - MARGIN - COLUMN / 2, lowest - room / 2 - 2)
        draw_in_space(sheet, part.solid, part.turn, place, min(1.4 * room - 20, COLUMN - 20))
    _draw_facet_table(sheet, part, tolerances)
    _draw_requirements(sheet, setup, part, page, tolerances, material)
    return sheet.figure


def prism_width(setup: Setup) -> float:
    """Length (mm) along the ridge of a biprism without a radius: what the camera's light needs, and a fifth more."""
    return float(np.ceil(2.4 * reach_along_ridge(setup, setup.rig())))


def _part(setup, width):
    prism = setup.optic
    if prism.facets == 2 and prism.radius is None and width is None:
        width = prism_width(setup)
    measures = prism_dimensions(prism, width)
    needed = clear_aperture(prism, setup.wavelength_nm, border_rays(setup)).widened(aperture_margin(setup))
    solid = prism_solid(prism, tolerance=0.005, width=width)
    return _Part(prism, solid, measures, needed, float(np.pi / 2 - measures.facet_azimuths[0]))


def _draw_front(sheet: Sheet, part: _Part, origin, scale, tolerances):
    outline = part.front(part.solid.vertices[part.solid.faces[0]])
    low, high = outline.min(0), outline.max(0)
    if part.prism.radius is not None:
        turn = np.linspace(0, 2 * np.pi, 361)
        outline = part.prism.radius * np.stack([np.cos(turn), np.sin(turn)], -1)
    closed = np.vstack([outline, outline[:1]]) * scale + origin
    sheet.fill(closed)
    sheet.line(closed, name="outline")
    apex = np.array([0.0, 0.0, part.prism.thickness])
    for k, foot in enumerate(_feet(part)):
        sheet.line(part.front(np.array([apex, foot])) * scale + origin, name=f"edge-{k}")
    reach = part.prism.radius or float(np.min(np.abs([low[1], high[1]])))
    crowded = part.prism.facets > _DIMENSIONED
    letters = min(3.5, 1.6 * reach * scale / part.prism.facets)
    for k, azimuth in enumerate(part.measures.facet_azimuths + part.turn):
        place = origin + (0.78 if crowded else 0.62) * reach * scale * np.array([np.cos(azimuth), np.sin(azimuth)])
        aside = np.array([np.sin(azimuth), -np.cos(azimuth)]) * (0.0 if crowded else 4.5)  # of the centre line
        sheet.text(place + aside, str(k), letters, bbox={"boxstyle": "circle,pad=0.15", "fc": "white", "lw": 0.5})
    for ends in ([[low[0] * scale - 4, 0], [high[0] * scale + 4, 0]], [[0, low[1] * scale - 4], [0, high[1] * scale]]):
        sheet.line(origin + np.array(ends), "centre")
    _draw_apertures(sheet, part, origin, scale)
    _draw_cutting_plane(sheet, origin, low[1] * scale, high[1] * scale)
    if 2 < part.prism.facets <= _DIMENSIONED:
        _draw_azimuth(sheet, part, origin, reach * scale, tolerances)
    _draw_sides(sheet, part, origin, scale, low, high, tolerances)
    sheet.text((origin[0], origin[1] + high[1] * scale + 22), "seen onto the facets", 1.8)


def _draw_azimuth(sheet, part, origin, reach, tolerances):
    """The angle between the normals of facets 0 and 1, around the axis."""
    first, second = np.degrees(part.measures.facet_azimuths[:2] + part.turn)
    second = first + (second - first) % 360
    text = f"{degrees_text(np.deg2rad(second - first), short=True)} ± {tolerances.azimuth_arcmin:g}'"
    way = np.array([np.cos(np.deg2rad(second)), np.sin(np.deg2rad(second))])
    sheet.line([origin, origin + reach * way], "centre")
    sheet.angle(origin, max(0.36 * reach, 7.0), second, first, text, share=0.92)


def _draw_sides(sheet, part, origin, scale, low, high, tolerances):
    """Measures of an outline that is a polygon."""
    if part.prism.radius is not None:
        return
    if part.prism.facets == 2:
        ends = origin + scale * np.array([[low[0], low[1]], [high[0], low[1]]])
        text = f"{length_text(high[0] - low[0], tolerances.diameter)} ± {tolerances.diameter:g}"
        sheet.dimension(*ends, text, ends[0, 1] - 15)
        return
    side = part.front(part.solid.vertices[part.solid.faces[1][1:]])
    ends = origin + scale * side
    sheet.dimension(*ends, f"({np.linalg.norm(side[1] - side[0]):.2f})", ends[:, 1].max() + 13)


def _draw_apertures(sheet, part, origin, scale):
    """Where light passes: a circle, or on a biprism without an outline a rectangle."""
    if not np.isfinite(part.aperture.radius):
        return
    up, aside = part.aperture.half_box
    if part.prism.radius is None and part.prism.facets == 2:
        corners = np.array([[-aside, -up], [aside, -up], [aside, up], [-aside, up], [-aside, -up]])
        sheet.line(origin + scale * corners, "phantom", name="clear-aperture")
        sheet.text(origin + scale * np.array([-aside, -up]) + [1.5, 2.5], _light_text(part), 1.8, ha="left")
        return
    radius = part.aperture.radius
    turn = np.linspace(0, 2 * np.pi, 181)
    if part.prism.radius is not None and radius > _RING * part.prism.radius:
        return
    ring = origin + scale * radius * np.stack([np.cos(turn), np.sin(turn)], -1)
    sheet.line(ring, "phantom", name="clear-aperture")
    way = np.array([np.cos(np.deg2rad(215)), np.sin(np.deg2rad(215))])
    tip = origin + scale * radius * way
    elbow = origin + (max(part.prism.radius or radius, radius) * scale + 6) * way
    sheet.line([tip, elbow, elbow - [3, 0]], "thin")
    sheet.arrow(tip, -way)
    sheet.text(elbow - [3.6, 0], _light_text(part), ha="right")


def _light_text(part):
    """How large the polished part of both faces must be at least."""
    if part.prism.radius is None and part.prism.facets == 2:
        up, aside = part.aperture.half_box
        if not np.isfinite(up):
            return _effective(up)
        return f"light: {_up(2 * aside):.1f} x {_up(2 * up):.1f}"
    return _effective(part.aperture.radius)


def _effective(radius):
    """The effective diameter of a face, as ISO 10110 writes it."""
    return f"Øe {_up(2 * radius):.1f}" if np.isfinite(radius) else "the camera looks past it"


def _draw_cutting_plane(sheet, origin, low, high):
    """The trace of section A-A: upright, seen from the left."""
    for end, out in ((origin + np.array([0, high]), 1), (origin + np.array([0, low]), -1)):
        sheet.line([end + np.array([0, 3.0 * out]), end + np.array([0, 8.0 * out])], "cut")
        start = end + np.array([-6.0, 6.5 * out])
        sheet.line([start, start + np.array([4.6, 0])], "thin")
        sheet.arrow(start + np.array([6.0, 0]), [1, 0])
        sheet.text(start + np.array([-2.2, 0]), "A", 3.5)


def _draw_section(sheet: Sheet, part: _Part, corner, scale, tolerances):
    """Section A-A: flat face at the left, apex at the right; `corner` (2,) is where the axis meets the flat face."""
    thickness = part.prism.thickness
    along = np.array([np.cos(part.measures.facet_azimuths[0]), np.sin(part.measures.facet_azimuths[0]), 0.0])
    cut = part.solid.section(np.zeros(3), np.cross(along, [0, 0, 1.0]))
    flat = np.stack([cut[:, 2], cut @ along], -1)
    if part.prism.radius is not None:  # the polygon of the outline may not have a corner here
        flat = _true_section(part)
    points = flat * scale + corner
    sheet.fill(points)
    sheet.line(np.vstack([points, points[:1]]), name="section")
    low, high = points[:, 1].min(), points[:, 1].max()
    apex = corner + np.array([scale * thickness, 0.0])
    sheet.line([corner - [6, 0], apex + np.array([8, 0])], "centre")
    _draw_section_sizes(sheet, part, points, corner, apex, scale, tolerances)
    reach = min(0.75 * (high - corner[1]), 42.0)
    angle = float(np.degrees(part.measures.facet_angles[0]))
    text = f"{degrees_text(part.measures.facet_angles[0])} ± {tolerances.angle_arcmin:g}'"
    sheet.angle(apex, reach, 90 + angle, 90.0, text)
    if part.prism.facets % 2 and not len(part.prism.facet_deviation_deg):
        edge = part.measures.edge_angles[part.prism.facets // 2]
        below = min(0.75 * (corner[1] - low), 42.0)
        sheet.angle(apex, below, 270 - float(np.degrees(edge)), 270.0, f"({degrees_text(edge)})")
    sheet.text((corner[0] + scale * thickness / 2, high + 16), "A-A", 3.5)
    for text, tip, way in (
        ("1", corner + np.array([0, 0.35 * (high - corner[1])]), (-1, 0.6)),
        ("2", 0.75 * apex + 0.25 * _facet_end(points, corner), (1, 0.3)),
    ):
        elbow = tip + 8 * np.array(way) / np.hypot(*way)
        sheet.line([tip, elbow], "thin")
        sign = {"boxstyle": "circle,pad=0.15", "fc": "white", "lw": 0.5}
        sheet.text(elbow + np.array([1.6 * way[0], 0.8 * way[1]]), text, 2.2, bbox=sign)


def _true_section(part):
    """Corners (M, 2) mm, (z, up), of the cut through facet 0's middle where the outline is round."""
    radius, thickness, measures = part.prism.radius, part.prism.thickness, part.measures
    heights = []
    for azimuth in (measures.facet_azimuths[0], measures.facet_azimuths[0] + np.pi):
        slopes = np.tan(measures.facet_angles) * np.cos(azimuth - measures.facet_azimuths)
        heights.append(thickness - radius * slopes.max())
    return np.array([[0, radius], [0, -radius], [heights[1], -radius], [thickness, 0], [heights[0], radius]])


def _facet_end(points, corner):
    """The upper end of the facet in the section."""
    upper = points[points[:, 1] > points[:, 1].max() - 1e-6]
    return upper[np.argmax(upper[:, 0])]


def _draw_section_sizes(sheet, part, points, corner, apex, scale, tolerances):
    low, high = points[:, 1].min(), points[:, 1].max()
    sign = "Ø" if part.prism.radius is not None else ""
    height = f"{sign}{length_text((high - low) / scale, tolerances.diameter)}  +0 / -{tolerances.diameter:g}"
    sheet.dimension((corner[0], low), (corner[0], high), height, corner[0] - 11, upright=True)
    thickness = f"{length_text(part.prism.thickness, tolerances.thickness)} ± {tolerances.thickness:g}"
    sheet.dimension((corner[0], low), apex, thickness, low - (16 if part.prism.facets % 2 else 9))
    rims = [(_facet_end(points, corner), high + 8)]
    if part.prism.facets % 2:
        lower = points[points[:, 1] < low + 1e-6]
        rims.append((lower[np.argmax(lower[:, 0])], low - 8))
    for end, at in rims:
        if part.prism.radius is not None and end[0] - corner[0] > 0.05:
            sheet.dimension((corner[0], end[1]), end, f"({(end[0] - corner[0]) / scale:.2f})", at)


def _draw_edge(sheet: Sheet, part: _Part, scale) -> float:
    """View C along edge 0: the angle between two facets in its true size. Gives the y (mm) of its lower end."""
    seam = seam_directions(part.prism)[0]
    foot = _feet(part)[0]
    middle = (foot + np.array([0.0, 0.0, part.prism.thickness])) / 2
    cut = part.solid.section(middle, seam) - middle
    level = np.cross([0.0, 0.0, 1.0], seam)
    level /= np.linalg.norm(level)
    flat = np.stack([cut @ level, cut @ np.cross(seam, level)], -1)
    flat[:, 1] *= np.sign(np.cross(seam, level)[2])
    half = min(np.abs(flat[:, 0]).max(), (COLUMN / 2 - 7) / scale)
    inside = np.clip(flat[:, 0], -half, half)
    flat = _clipped(flat, half) if (inside != flat[:, 0]).any() else flat
    depth = -flat[:, 1].min() * scale
    peak = np.array([sheet.size[0] - MARGIN - COLUMN / 2, sheet.size[1] - MARGIN - 14.0])
    points = peak + scale * flat
    sheet.fill(points)
    sheet.line(np.vstack([points, points[:1]]), name="edge-view")
    half_angle = float(np.degrees(part.measures.dihedral_angles[0])) / 2
    text = f"({degrees_text(part.measures.dihedral_angles[0])})"
    sheet.angle(peak, depth + 9.0, 270 - half_angle, 270 + half_angle, text, share=0.5)
    bottom = peak[1] - depth - 14.0
    sheet.text(peak + np.array([0, 7.0]), "C: cut at right angles to the edge 0-1, dihedral angle", 1.8)
    return float(bottom)


def _clipped(polygon, half):
    from ..geometry import clip_by_half_plane

    return clip_by_half_plane(clip_by_half_plane(polygon, [1.0, 0.0], half), [-1.0, 0.0], half)


def _feet(part):
    """Where each edge ends at the outline, (n, 3) mm, workshop frame."""
    seams = seam_directions(part.prism)
    if part.prism.radius is not None:
        steps = part.prism.radius / np.linalg.norm(seams[:, :2], axis=-1)
    elif part.prism.facets == 2:
        ridge = part.solid.vertices[[0, 3]] - [0.0, 0.0, part.prism.thickness]
        steps = np.linalg.norm(ridge, axis=-1)
    else:
        steps = part.prism.thickness / -seams[:, 2]
    return seams * steps[:, None] + [0.0, 0.0, part.prism.thickness]


def _draw_facet_table(sheet, part, tolerances):
    measures, count = part.measures, part.prism.facets
    azimuth, angle = f"azimuth\n± {tolerances.azimuth_arcmin:g}'", f"to flat face\n± {tolerances.angle_arcmin:g}'"
    rows = [["facet", azimuth, angle, "(edge to next,\nto flat face)", "(dihedral to\nnext facet)"]]
    for k in range(min(count, _LISTED)):
        azimuth = np.mod(measures.facet_azimuths[k] - measures.facet_azimuths[0] + 1e-12, 2 * np.pi)
        angles = (azimuth, measures.facet_angles[k], measures.edge_angles[k], measures.dihedral_angles[k])
        rows.append([str(k), *(degrees_text(angle if abs(angle) > 1e-9 else 0.0) for angle in angles)])
    if count > _LISTED:
        alike = not len(part.prism.facet_deviation_deg)
        rows.append([f"to {count - 1}", "alike, evenly" if alike else "see the mesh", "", "", ""])
    widths = (9.0, 19.0, 18.5, 20.5, 19.0)
    top = MARGIN + TITLE_SIZE[1] + 6 + 4.6 * len(rows) + 3.2
    sheet.table((sheet.size[0] - MARGIN - sum(widths) - 1, top), widths, rows, letters=1.6)


def _draw_requirements(sheet, setup, part, page: Page, tolerances: Tolerances, material):
    left, free = place_of_tables(sheet)
    polish, measures = surface_rows(setup, tolerances), part.measures
    mass = f", mass {measures.mass(page.density):.3g} g" if page.density else ""
    widths = (0.32 * free, 0.32 * free, 0.36 * free)
    flat, facets = (_effective(radius) for radius in (part.aperture.flat_face, part.aperture.facets))
    rim = f"rim: chamfer {tolerances.chamfer:g} x 45°, ground"
    if part.prism.radius is None:
        rim = f"outer edges: chamfer {tolerances.chamfer:g} at most"
        if part.prism.facets == 2:
            flat = facets = _light_text(part)
    rows = [
        ["surface 1: flat face", "material", f"surface 2: {part.prism.facets} facets"],
        [f"plane, {flat}", material[0], f"plane, {facets}"],
        [polish["form"], material[1], polish["form"]],
        [polish["surface"], "0/10  (10 nm/cm)", polish["surface"]],
        [polish["coating"], f"volume {measures.volume / 1000:.4g} cm^3{mass}", polish["coating"]],
        [rim, "", f"edges and apex sharp, chips < {tolerances.sharpness:g}"],
    ]
    bottom = sheet.table((left, TABLES_TOP - 2), widths, rows)
    notes(sheet, _notes(part, tolerances), bottom - 1.5)


def _notes(part, tolerances):
    lines = [
        "Indications 0/ and 3/ to ISO 10110; form in fringes of 546.07 nm light. Scratch-dig to MIL-PRF-13830B.",
        f"Apex within {tolerances.centring:g} mm of the middle of the outline. Angles hold for every facet. "
        "Values in ( ) follow from the others.",
        "Facets are numbered anticlockwise, seen onto them. Øe, light: what the camera's picture needs.",
        f"In the setup: facets towards the {part.prism.facing}, facet 0 at {part.prism.azimuth_deg:g}° in its frame.",
    ]
    radius, needed = part.prism.radius, part.aperture.radius
    if radius is not None and needed > radius:
        lines.append(f"The picture would need Ø{_up(2 * needed):.1f}: this outline cuts its corners.")
    if radius is None:
        lines.append("The facets run out in a sharp edge: a round outline (radius_mm in the setup) is easier to make.")
    return lines


def _up(length):
    """A length rounded up to a tenth of a mm."""
    return np.ceil(length * 10 - 1e-6) / 10
