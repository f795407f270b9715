"""The workshop drawing of a prism: onto the facets, cut through its axis, and along an edge."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from ..rigs import Setup
from .workshop import (
    COLUMN,
    TABLES_TOP,
    Page,
    Tolerances,
    check_chamfer,
    face_text,
    material_rows,
    notes,
    picture_warning,
    place_of_tables,
    round_up,
    sharp_edge_advice,
    start_sheet,
    surface_rows,
)
from .workshop_edge import draw_cut_mark, draw_edge
from .workshop_part import Part, part_of
from .workshop_sheet import MARGIN, TITLE_SIZE, Sheet, degrees_text, length_text, text_length
from .workshop_view import draw_in_space

_ROOM = (104.0, 34.0)  # mm beside and above the views for dimensions
_LISTED = 10  # facets in the table
_RING = 1.1  # times the outline: a clear aperture that is larger is not drawn
_DIMENSIONED = 4  # with more facets their azimuths stand in the table alone


def draw_prism(setup: Setup, page: Page, tolerances: Tolerances, width: float | None) -> Figure:
    """The drawing of a setup's prism; see `workshop.workshop_drawing`."""
    part = part_of(setup, width)
    if part.prism.radius is not None:
        check_chamfer(tolerances, part.measures.rim[0], "the thinnest place of the rim")
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
    lowest = draw_edge(sheet, part, scale)
    rows = min(part.prism.facets, _LISTED) + (part.prism.facets > _LISTED)
    room = lowest - (MARGIN + TITLE_SIZE[1] + 20 + 4.6 * rows)
    if room > 30:
        place = (sheet.size[0] - MARGIN - COLUMN / 2, lowest - room / 2 - 2)
        draw_in_space(sheet, part.solid, part.turn, place, min(1.4 * room - 20, COLUMN - 20))
    _draw_facet_table(sheet, part, tolerances)
    _draw_requirements(sheet, setup, part, page, tolerances, material)
    return sheet.figure


def _draw_front(sheet: Sheet, part: Part, origin, scale, tolerances):
    outline = part.front(part.solid.vertices[part.solid.faces[0]])
    low, high = outline.min(0), outline.max(0)
    if part.prism.radius is not None:
        turn = np.linspace(0, 2 * np.pi, 361)
        outline = part.prism.radius * np.stack([np.cos(turn), np.sin(turn)], -1)
    closed = np.vstack([outline, outline[:1]]) * scale + origin
    sheet.fill(closed)
    sheet.line(closed, name="outline")
    for k, foot in enumerate(part.feet):
        sheet.line(part.front(np.array([part.apex, foot])) * scale + origin, name=f"edge-{k}")
    reach = part.prism.radius or float(np.min(np.abs([low[1], high[1]])))
    crowded = part.prism.facets > _DIMENSIONED
    letters = min(2.0 if crowded else 2.8, 1.2 * reach * scale / part.prism.facets)
    for k, azimuth in enumerate(part.measures.facet_azimuths + part.turn):
        place = origin + (0.87 if crowded else 0.62) * reach * scale * np.array([np.cos(azimuth), np.sin(azimuth)])
        side = 0.0 if crowded else -5.0 if k == 1 else 5.0  # beside the centre line, away from section C-C
        sheet.balloon(place + side * np.array([np.sin(azimuth), -np.cos(azimuth)]), f"F{k}", letters)
    for ends in ([[low[0] * scale - 4, 0], [high[0] * scale + 4, 0]], [[0, low[1] * scale - 4], [0, high[1] * scale]]):
        sheet.line(origin + np.array(ends), "centre")
    _draw_apertures(sheet, part, origin, scale)
    _draw_cutting_plane(sheet, origin, low[1] * scale, high[1] * scale)
    draw_cut_mark(sheet, part, origin, scale, 0.25 * reach * scale)
    if 2 < part.prism.facets <= _DIMENSIONED:
        _draw_azimuth(sheet, part, origin, reach * scale, high[1] * scale, tolerances)
    _draw_sides(sheet, part, origin, scale, low, high, tolerances)
    sheet.text((origin[0], origin[1] + high[1] * scale + 22), "seen onto the facets", 1.8)


def _draw_azimuth(sheet, part, origin, reach, top, tolerances):
    """The angle between the normals of facets 0 and 1, around the axis; the outline reaches `top` mm up."""
    first, second = np.degrees(part.measures.facet_azimuths[:2] + part.turn)
    second = first + (second - first) % 360
    text = f"{degrees_text(np.deg2rad(second - first), short=True)} ± {tolerances.azimuth_arcmin:g}'"
    way = np.array([np.cos(np.deg2rad(second)), np.sin(np.deg2rad(second))])
    sheet.line([origin, origin + reach * way], "centre")
    radius = max(0.36 * reach, 7.0)
    if text_length(text) < (radius + 2) * np.tan(np.pi / part.prism.facets) - 2:  # between centre line and edge
        sheet.angle(origin, radius, second, first, text, share=0.92)
        return
    sheet.angle(origin, radius, second, first, "", share=0.92)
    turn, above = np.deg2rad(first + 0.15 * (second - first)), origin + np.array([0.0, top + 11.0])
    tip = origin + radius * np.array([np.cos(turn), np.sin(turn)])
    sheet.line([tip, above - [13.0, 0.0]], "thin")
    sheet.line([above - [30.0, 0.0], above - [2.0, 0.0]], "thin")
    sheet.text(above + np.array([-16.0, 0.8]), text, va="bottom")


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
    slopes = np.tan(part.measures.facet_angles) * np.cos(part.measures.facet_azimuths + part.turn - np.deg2rad(215))
    end = part.prism.radius or part.prism.thickness / slopes.max()  # of the glass, that way
    elbow = origin + (max(end, radius) * scale + 6) * way
    sheet.line([tip, elbow, elbow - [3, 0]], "thin")
    sheet.arrow(tip, -way)
    sheet.text(elbow - [3.6, 0], _light_text(part), ha="right")


def _light_text(part):
    """How large the polished part of both faces must be at least."""
    if part.prism.radius is None and part.prism.facets == 2:
        up, aside = part.aperture.half_box
        if not np.isfinite(up):
            return face_text(up, None)
        return f"light: {round_up(2 * aside):.1f} x {round_up(2 * up):.1f}"
    return face_text(part.aperture.radius, part.prism.radius)


def _draw_cutting_plane(sheet, origin, low, high):
    """The trace of section A-A: upright, seen from the left."""
    for end, out in ((origin + np.array([0, high]), 1), (origin + np.array([0, low]), -1)):
        sheet.line([end + np.array([0, 3.0 * out]), end + np.array([0, 8.0 * out])], "cut")
        start = end + np.array([-6.0, 6.5 * out])
        sheet.line([start, start + np.array([4.6, 0])], "thin")
        sheet.arrow(start + np.array([6.0, 0]), [1, 0])
        sheet.text(start + np.array([-2.2, 0]), "A", 3.5)


def _draw_section(sheet: Sheet, part: Part, corner, scale, tolerances):
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
        ("S1", corner + np.array([0, 0.35 * (high - corner[1])]), (-1, 0.6)),
        ("S2", 0.75 * apex + 0.25 * _facet_end(points, corner), (1, 0.3)),
    ):
        elbow = tip + 8 * np.array(way) / np.hypot(*way)
        sheet.line([tip, elbow], "thin")
        sheet.balloon(elbow + np.array([2.2 * way[0], 0.8 * way[1]]), text)


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
    height = f"Ø{length_text((high - low) / scale, tolerances.diameter)}  +0 / -{tolerances.diameter:g}"
    if part.prism.radius is None:  # thickness and angles say where the facets cut the flat face
        height = f"({(high - low) / scale:.2f})"
    sheet.dimension((corner[0], low), (corner[0], high), height, corner[0] - 14, upright=True)
    thickness = f"{length_text(part.prism.thickness, tolerances.thickness)} ± {tolerances.thickness:g}"
    sheet.dimension((corner[0], low), apex, thickness, low - (16 if part.prism.facets % 2 else 9))
    rims = [(_facet_end(points, corner), high + 8)]
    if part.prism.facets % 2:
        lower = points[points[:, 1] < low + 1e-6]
        rims.append((lower[np.argmax(lower[:, 0])], low - 8))
    for end, at in rims:
        if part.prism.radius is not None and end[0] - corner[0] > 0.05:
            sheet.dimension((corner[0], end[1]), end, f"({(end[0] - corner[0]) / scale:.2f})", at)


def _draw_facet_table(sheet, part, tolerances):
    measures, count = part.measures, part.prism.facets
    azimuth, angle = f"azimuth\n± {tolerances.azimuth_arcmin:g}'", f"to flat face\n± {tolerances.angle_arcmin:g}'"
    rows = [["facet", azimuth, angle, "(edge to next,\nto flat face)", "(dihedral to\nnext facet)"]]
    for k in range(min(count, _LISTED)):
        azimuth = np.mod(measures.facet_azimuths[k] - measures.facet_azimuths[0] + 1e-12, 2 * np.pi)
        angles = (azimuth, measures.facet_angles[k], measures.edge_angles[k], measures.dihedral_angles[k])
        rows.append([f"F{k}", *(degrees_text(angle if abs(angle) > 1e-9 else 0.0) for angle in angles)])
    if count > _LISTED:
        alike = not len(part.prism.facet_deviation_deg)
        rows.append([f"to F{count - 1}", "alike, evenly" if alike else "see the mesh", "", "", ""])
    widths = (9.0, 19.0, 18.5, 20.5, 19.0)
    top = MARGIN + TITLE_SIZE[1] + 6 + 4.6 * len(rows) + 3.2
    sheet.table((sheet.size[0] - MARGIN - sum(widths) - 1, top), widths, rows, letters=1.6)


def _draw_requirements(sheet, setup, part, page: Page, tolerances: Tolerances, material):
    left, free = place_of_tables(sheet)
    polish, measures = surface_rows(setup, tolerances), part.measures
    mass = f", mass {measures.mass(page.density):.3g} g" if page.density else ""
    volume = measures.volume / 1000
    widths = (0.32 * free, 0.32 * free, 0.36 * free)
    flat, facets = (face_text(radius, part.prism.radius) for radius in (part.aperture.flat_face, part.aperture.facets))
    rim = f"rim: chamfer {tolerances.chamfer:g} x 45°, ground"
    if part.prism.radius is None:
        rim = f"outer edges: chamfer {tolerances.chamfer:g} at most"
        if part.prism.facets == 2:
            flat = facets = _light_text(part)
    rows = [
        ["S1: flat face", "material", f"S2: facets F0 to F{part.prism.facets - 1}"],
        [f"plane, {flat}", material[0], f"plane, {facets}"],
        [polish["form"], material[1], polish["form"]],
        [polish["surface"], f"index ± {tolerances.index:g}", polish["surface"]],
        [polish["coating"], "0/10  (10 nm/cm)", polish["coating"]],
        [rim, f"volume {volume:.4g} cm^3{mass}", f"edges and apex sharp, chips < {tolerances.sharpness:g}"],
    ]
    bottom = sheet.table((left, TABLES_TOP - 2), widths, rows)
    notes(sheet, _notes(setup, part, tolerances), bottom - 1.5)


def _notes(setup, part, tolerances):
    azimuth = float(np.degrees(part.measures.facet_azimuths[0]))
    lines = [
        "Indications 0/ and 3/ to ISO 10110; form in fringes of 546.07 nm light. Scratch-dig to MIL-PRF-13830B.",
        f"Apex within {tolerances.centring:g} mm of the middle of the outline. Angles hold for every facet. "
        "Values in ( ) follow from the others.",
        "Facets are numbered anticlockwise, seen onto them. Øe, light: what the camera's picture needs.",
        f"In the setup: facets towards the {part.prism.facing}, F0 at {azimuth:.6g}° in its frame.",
    ]
    lines.append(picture_warning(setup, part.aperture))
    if part.prism.radius is None:
        lines.append(sharp_edge_advice(part.prism, part.aperture))
    return [line for line in lines if line]
