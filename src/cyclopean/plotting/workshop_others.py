"""Workshop drawings of plates, and the sheet that says where mirrors stand."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from ..errors import SetupError
from ..optics import Mirrors, Plate
from ..optics.footprints import meeting_points
from ..rigs import Setup
from .ray_parts import rim_pixels
from .workshop import (
    TABLES_TOP,
    Page,
    Tolerances,
    aperture_margin,
    border_rays,
    check_chamfer,
    material_rows,
    notes,
    place_of_tables,
    start_sheet,
    surface_rows,
)
from .workshop_sheet import MARGIN, Sheet, length_text

_PLATE_ROOM = (90.0, 34.0)  # mm beside and above the views for dimensions
_MIRROR_ROOM = (60.0, 30.0)


def draw_plate(setup: Setup, page: Page, tolerances: Tolerances) -> Figure:
    """The drawing of a plane-parallel plate: its face, and a cut through its axis."""
    plate = setup.optic
    assert isinstance(plate, Plate)
    needed = np.ceil(20 * (_plate_reach(setup) + aperture_margin(setup))) / 10
    radius = plate.radius or float(np.ceil(0.6 * needed))
    check_chamfer(tolerances, plate.thickness / 2, "half the rim")
    material = material_rows(plate, setup.wavelength_nm)
    sheet, scale = start_sheet(
        page, "Plate", material[0], (2 * radius + plate.thickness, 2 * radius), _PLATE_ROOM, column=8.0
    )
    middle = (sheet.size[1] - MARGIN + TABLES_TOP) / 2
    origin = np.array([MARGIN + 22.0 + scale * radius, middle])
    turn = np.linspace(0, 2 * np.pi, 361)
    ring = np.stack([np.cos(turn), np.sin(turn)], -1)
    sheet.fill(origin + scale * radius * ring)
    sheet.line(origin + scale * radius * ring, name="outline")
    if needed < 2.2 * radius:
        sheet.line(origin + scale * needed / 2 * ring, "phantom", name="clear-aperture")
    for ends in ([[-1, 0], [1, 0]], [[0, -1], [0, 1]]):
        sheet.line(origin + (scale * radius + 4) * np.array(ends), "centre")
    corner = origin + np.array([scale * radius + 34.0, 0.0])
    _draw_plate_section(sheet, corner, radius, plate.thickness, scale, tolerances)
    _draw_plate_table(sheet, setup, needed, material, tolerances, page)
    return sheet.figure


def _plate_reach(setup):
    """How far (mm) from the plate's axis light of the picture meets its faces."""
    path = setup.optic.paths(setup.wavelength_nm)[0]
    first = path.interfaces[0]
    centre = np.array([*setup.optic.shift, setup.optic.distance])
    arms = meeting_points(path, border_rays(setup)) - centre
    arms = arms - (arms @ first.normal)[..., None] * first.normal
    return float(np.nanmax(np.linalg.norm(arms, axis=-1), initial=0.0))


def _draw_plate_section(sheet: Sheet, corner, radius, thickness, scale, tolerances):
    box = corner + scale * np.array([[0, -radius], [thickness, -radius], [thickness, radius], [0, radius]])
    sheet.fill(box)
    sheet.line(np.vstack([box, box[:1]]), name="section")
    sheet.line([corner - [6, 0], corner + np.array([scale * thickness + 6, 0])], "centre")
    low, high = box[0, 1], box[2, 1]
    text = f"Ø{length_text(2 * radius, tolerances.diameter)}  +0 / -{tolerances.diameter:g}"
    sheet.dimension((corner[0], low), (corner[0], high), text, corner[0] - 14, upright=True)
    sheet.dimension(
        box[0], box[1], f"{length_text(thickness, tolerances.thickness)} ± {tolerances.thickness:g}", low - 9
    )
    for text, x, way in (("S1", corner[0], -1.0), ("S2", box[1, 0], 1.0)):
        tip = np.array([x, corner[1] + 0.4 * scale * radius])
        sheet.line([tip, tip + np.array([6 * way, 4])], "thin")
        sheet.balloon(tip + np.array([8 * way, 5]), text)


def _draw_plate_table(sheet, setup, needed, material, tolerances, page):
    left, free = place_of_tables(sheet)
    plate, polish = setup.optic, surface_rows(setup, tolerances)
    volume = np.pi * (plate.radius or np.ceil(0.6 * needed)) ** 2 * plate.thickness / 1000
    mass = f", mass {page.density * volume:.3g} g" if page.density else ""
    rows = [
        ["S1", "material", "S2"],
        [f"plane, Øe {needed:.1f}", material[0], f"plane, Øe {needed:.1f}"],
        [polish["form"], material[1], polish["form"]],
        [polish["surface"], f"index ± {tolerances.index:g}", polish["surface"]],
        [polish["coating"], "0/10  (10 nm/cm)", polish["coating"]],
        [
            f"rim: chamfer {tolerances.chamfer:g} x 45°",
            f"volume {volume:.4g} cm^3{mass}",
            f"parallel to S1 within {tolerances.angle_arcmin:g}'",
        ],
    ]
    bottom = sheet.table((left, TABLES_TOP - 2), (free / 3,) * 3, rows)
    tilt = ", ".join(f"{angle:g}" for angle in plate.tilt_deg)
    lines = [
        "Indications 0/ and 3/ to ISO 10110; form in fringes of 546.07 nm light. Scratch-dig to MIL-PRF-13830B.",
        f"In the setup: {plate.distance:g} mm before the pinhole, tilted by the rotation vector ({tilt})°.",
    ]
    if plate.radius is not None and needed > 2 * plate.radius:
        lines.append(f"The picture would need Ø{needed:.1f}: this outline cuts it.")
    if plate.radius is None:
        lines.append("The setup gives no outline: drawn a fifth larger than the camera's picture needs.")
    notes(sheet, lines, bottom - 1.5)


def draw_mirrors(setup: Setup, page: Page) -> Figure:
    """Where mirrors stand: seen along the optical axis and from above, with a table of positions and angles."""
    optic = setup.optic
    assert isinstance(optic, Mirrors)
    corners = [_mirror_corners(mirror, half) for mirror, half in zip(optic.mirrors, mirror_halves(setup), strict=True)]
    points = np.concatenate([*corners, np.zeros((1, 3))])
    low, high = points.min(0), points.max(0)
    span = high - low
    sheet, scale = start_sheet(
        page, "Mirrors", "", (span[0] + span[2], max(span[1], span[0])), _MIRROR_ROOM, column=8.0
    )
    middle = (sheet.size[1] - MARGIN + TABLES_TOP) / 2 + 4
    front = np.array([MARGIN + 22.0 - scale * low[0], middle + scale * (low[1] + high[1]) / 2])
    above = np.array([front[0] + scale * high[0] + 30.0 - scale * low[2], middle - scale * (low[0] + high[0]) / 2])
    for k, corner in enumerate(corners):
        _draw_mirror(sheet, k, front + scale * corner[:, :2] * [1, -1], f"front-{k}")
        _draw_mirror(sheet, k, above + scale * corner[:, [2, 0]], f"above-{k}")
    sheet.line([front - [5, 0], front + np.array([5, 0])], "centre")
    sheet.line([front - [0, 5], front + np.array([0, 5])], "centre")
    sheet.line([above - [6, 0], above + np.array([scale * high[2] + 6, 0])], "centre")
    _draw_pinhole(sheet, above)
    sheet.text((front[0], sheet.size[1] - MARGIN - 6), "as the camera looks: x right, y down", 1.8)
    sheet.text((above[0] + scale * span[2] / 2, sheet.size[1] - MARGIN - 6), "z right, x up; pinhole at the left", 1.8)
    _draw_mirror_table(sheet, setup)
    return sheet.figure


def mirror_halves(setup: Setup) -> list[np.ndarray]:
    """Half sizes (2,) mm of each mirror along its own axes: given ones, else what the light of the views needs."""
    optic = setup.optic
    assert isinstance(optic, Mirrors)
    sequences = optic.sequences or tuple((k,) for k in range(len(optic.mirrors)))
    halves = [None if mirror.size is None else np.array(mirror.size) / 2 for mirror in optic.mirrors]
    if all(half is not None for half in halves):
        return halves  # type: ignore[return-value]
    needed = [np.zeros(2) for _ in optic.mirrors]
    for view, path, sequence in zip(setup.rig(), optic.paths(setup.wavelength_nm), sequences, strict=False):
        hits = meeting_points(path, view.camera.rays(rim_pixels(view)))
        for s, k in enumerate(sequence):
            mirror = optic.mirrors[k]
            local = (hits[:, s] - mirror.centre) @ mirror.axes()[:2].T
            needed[k] = np.fmax(needed[k], np.nanmax(np.abs(local), axis=0))
    found = [have if half is None else half for half, have in zip(halves, needed, strict=True)]
    if not all((half > 0).all() for half in found):
        raise SetupError("a mirror without a size is used by no view, so nothing says how large it must be")
    return found


def _mirror_corners(mirror, half):
    u, v, normal = mirror.axes()
    square = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) * half
    return np.asarray(mirror.centre, dtype=float) + mirror.advance * normal + square @ np.array([u, v])


def _draw_mirror(sheet, k, corners, name):
    sheet.fill(corners, "#e4e8ec")
    sheet.line(np.vstack([corners, corners[:1]]), name=name)
    sheet.balloon(corners.mean(0), str(k), 3.0)


def _draw_pinhole(sheet, place):
    sheet.line([place + np.array([-7, 2.5]), place, place + np.array([-7, -2.5]), place + np.array([-7, 2.5])], "thin")
    sheet.fill(place + 0.9 * np.stack([np.cos(np.linspace(0, 6.3, 25)), np.sin(np.linspace(0, 6.3, 25))], -1), "black")


def _draw_mirror_table(sheet, setup):
    """Positions, sizes and angles of the mirrors as they stand, corrections included."""
    optic, halves = setup.optic, mirror_halves(setup)
    given = [mirror.size is not None for mirror in optic.mirrors]
    rows = [["mirror", "centre x, y, z", "size u x v", "normal x, y, z", "about y; up"]]
    for k, (mirror, half) in enumerate(zip(optic.mirrors, halves, strict=True)):
        normal = mirror.axes()[2]
        centre = np.asarray(mirror.centre, dtype=float) + mirror.advance * normal
        about, up = np.degrees([np.arctan2(normal[0], -normal[2]), np.arcsin(np.clip(-normal[1], -1, 1))])
        size = f"{2 * half[0]:.2f} x {2 * half[1]:.2f}"
        rows.append([
            str(k), ", ".join(f"{x:.2f}" for x in centre), size if given[k] else f"({size})",
            ", ".join(f"{x + 0.0:.5f}" for x in normal), f"{about:.3f}°; {up + 0.0:.3f}°",
        ])  # fmt: skip
    left, free = place_of_tables(sheet)
    shares = np.array([0.09, 0.22, 0.2, 0.27, 0.22]) * free
    top = max(TABLES_TOP - 2, MARGIN + 4.6 * len(rows) + 16)
    if len(rows) > 9:  # no room beside the title block
        raise SetupError(f"a sheet lists 8 mirrors at most, the setup has {len(rows) - 1}")
    bottom = sheet.table((left, top), shares, rows, letters=1.5)
    lines = [
        "In the camera's frame: x right, y down, z forward, from the pinhole; mm. About y: of the normal from the",
        "direction to the camera, positive to the right; up: of the normal, positive upwards.",
    ]
    if not all(given):
        lines.append("( ): the setup gives no size; this is what the light of the views needs around the centre.")
    notes(sheet, lines, bottom - 1.5)
