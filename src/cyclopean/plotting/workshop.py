"""Workshop drawings of optics: what one needs to make the thing, on one sheet, in true scale."""

from __future__ import annotations

import re
from dataclasses import dataclass

import numpy as np
from matplotlib.figure import Figure

from ..errors import OpticError, SetupError
from ..geometry import Rays
from ..optics import Mirrors, Plate, Prism
from ..optics.dimensions import ClearAperture, clear_aperture
from ..rigs import Setup
from .workshop_sheet import MARGIN, SCALES, SHEETS, TITLE_SIZE, Sheet, scale_text, title_block

TABLES_TOP = 60.0  # mm above the sheet's lower edge: what stands above is the drawing
COLUMN = 88.0  # mm, of the column at the right, above the title block
LEAST_RIM = 1.5  # mm: a rim that does not chip


@dataclass(frozen=True)
class Tolerances:
    """What a workshop is asked to keep; the defaults are those of ordinary precision optics."""

    angle_arcmin: float = 1.0  # of each facet to the flat face
    azimuth_arcmin: float = 5.0  # of the facets to each other, around the axis
    thickness: float = 0.1  # mm, from the flat face to the apex
    diameter: float = 0.1  # mm, of the outline, downwards
    centring: float = 0.1  # mm, of the apex from the middle of the outline
    flatness_waves: float = 0.25  # of each face within its clear aperture, at 546.07 nm, peak to valley
    scratch_dig: str = "40-20"  # of MIL-PRF-13830B
    chamfer: float = 0.3  # mm, at 45 degrees, of the rim
    sharpness: float = 0.05  # mm, chips at the edges between facets and at the apex
    coating: str | None = None  # None: against reflections, at the setup's wavelength
    index: float = 0.0005  # of the material's index

    def __post_init__(self):
        positive = "angle_arcmin", "azimuth_arcmin", "thickness", "diameter", "centring", "flatness_waves", "index"
        for name in positive:
            if not 0 < getattr(self, name) < np.inf:
                raise SetupError(f"the tolerance {name} must be a positive number, got {getattr(self, name)}")
        if not re.fullmatch(r"\d+-\d+", self.scratch_dig):
            raise SetupError(f"scratch-dig wants two numbers, such as 40-20, got {self.scratch_dig!r}")
        for name in ("chamfer", "sharpness"):
            if not 0 <= getattr(self, name) < np.inf:
                raise SetupError(f"{name} must be a number of mm, 0 or more, got {getattr(self, name)}")


@dataclass(frozen=True)
class Page:
    """What stands on a drawing beside the thing drawn."""

    name: str = ""  # of the part; none: what it is
    sheet: str | None = None  # "A4" or "A3"; None: A4 where the part fits it in full size, else A3
    scale: float | None = None  # drawn mm per mm; None: the largest standard scale that fits
    author: str = ""
    date: str = ""  # as it is to be written; none: left blank, so that the same setup gives the same file
    density: float | None = None  # g/cm^3, for the mass

    def __post_init__(self):
        if self.sheet is not None and self.sheet not in SHEETS:
            raise SetupError(f"the sheet must be one of {', '.join(SHEETS)}, got {self.sheet!r}")
        if self.scale is not None and not 0 < self.scale < np.inf:
            raise SetupError(f"the scale must be a positive number, got {self.scale}")
        if self.density is not None and not 0 < self.density < np.inf:
            raise SetupError(f"the density must be a positive number of g/cm^3, got {self.density}")


def workshop_drawing(
    setup: Setup, page: Page | None = None, tolerances: Tolerances | None = None, width: float | None = None
) -> Figure:
    """The drawing of a setup's optic, on a sheet whose size is true: 1 mm is 1 mm.

    Parameters
    ----------
    setup : Setup
        Its optic is drawn; its camera says how large the clear apertures must be.
    page : Page, optional
        Name, sheet, scale and the like.
    tolerances : Tolerances, optional
        What the workshop is to keep.
    width : float, optional
        Length (mm) along the ridge of a biprism without a radius; what the camera's light needs, and a fifth more, if
        not given.

    Raises
    ------
    SetupError
        When the part does not fit the sheet at the scale, or the setup has an optic that no workshop makes.
    OpticError
        When a width is given for a prism that ends by itself.
    """
    from .workshop_others import draw_mirrors, draw_plate
    from .workshop_prism import draw_prism

    page, tolerances = page or Page(), tolerances or Tolerances()
    optic = setup.optic
    if isinstance(optic, Prism):
        return draw_prism(setup, page, tolerances, width)
    if width is not None:
        raise OpticError("a width along the ridge belongs to a biprism without a radius")
    if isinstance(optic, Plate):
        return draw_plate(setup, page, tolerances)
    if isinstance(optic, Mirrors):
        return draw_mirrors(setup, page)
    raise SetupError(f"there is no workshop drawing of a setup of the kind {getattr(optic, 'kind', optic)!r}")


def border_rays(setup: Setup, count: int = 65) -> Rays:
    """Rays (4 count,) of the camera along the border of its picture."""
    width, height = setup.camera.size
    step = np.linspace(0.0, 1.0, count)[:, None]
    corners = np.array([[-0.5, -0.5], [width - 0.5, -0.5], [width - 0.5, height - 0.5], [-0.5, height - 0.5]])
    border = [a + step * (b - a) for a, b in zip(corners, np.roll(corners, -1, axis=0), strict=True)]
    return setup.camera.rays(np.concatenate(border))


def aperture_margin(setup: Setup) -> float:
    """How far (mm) light through the open lens reaches beyond that through its middle, where the optic stands.

    Half the entrance pupil, less what the cone towards the focused point has closed by there; 0 for a pinhole.
    """
    distance = getattr(setup.optic, "distance", 0.0)
    if setup.f_number is None or setup.focus_distance is None or setup.camera.pixel_pitch is None:
        return 0.0
    return float(setup.pupil_diameter / 2 * max(1 - distance / setup.focus_distance, 0.0))


def light_aperture(setup: Setup) -> ClearAperture:
    """How large the faces of a setup's prism must be for its camera, the open lens included."""
    prism, width, height = setup.optic, *setup.camera.size
    assert isinstance(prism, Prism)
    inner = np.stack(np.meshgrid(np.linspace(0, width - 1, 9), np.linspace(0, height - 1, 9)), -1).reshape(-1, 2)
    border, inside = border_rays(setup), setup.camera.rays(inner)
    rays = Rays(
        np.concatenate([border.origins, inside.origins]), np.concatenate([border.directions, inside.directions])
    )
    return clear_aperture(prism, setup.wavelength_nm, rays).widened(aperture_margin(setup))


def face_text(radius: float, limit: float | None) -> str:
    """What a face needs for light that reaches `radius` mm from its middle, when it ends at `limit` mm."""
    if np.isnan(radius):
        return "the camera looks past it"
    if radius == np.inf or (limit is not None and radius >= limit):
        return "whole face"
    return f"Øe {round_up(2 * radius):.1f}"


def picture_warning(setup: Setup, aperture: ClearAperture) -> str:
    """What of the picture a prism is too small for; empty where it is large enough."""
    limit = getattr(setup.optic, "radius", None)
    if np.isnan(aperture.radius):
        return "The camera looks past the prism."
    if aperture.radius == np.inf:
        return "The picture looks past the facets, which would end there: it needs a larger and thicker prism."
    if limit is not None and aperture.radius > limit:
        return f"The picture would need Ø{round_up(2 * aperture.radius):.1f}: this outline cuts its corners."
    return ""


def sharp_edge_advice(prism: Prism, aperture: ClearAperture) -> str:
    """What to change where facets run on until they cut the flat face."""
    start = "A sharp outer edge cannot be made, it chips: give the setup a radius_mm"
    thickness, slope = prism.thickness, float(np.tan(prism.facet_angles()[0].max()))
    radius = np.floor((thickness - LEAST_RIM) / slope)
    if not np.isfinite(aperture.radius):
        return f"{start} and a rim of {LEAST_RIM:g} mm or more."
    if radius >= max(aperture.radius, 1.0):
        return f"{start}; {radius:g} leaves a rim of {thickness - radius * slope:.1f} mm."
    radius = np.ceil(aperture.radius)
    return f"{start}; {radius:g} for this camera, with thickness_mm {round_up(radius * slope + LEAST_RIM):.1f}."


def check_chamfer(tolerances: Tolerances, room: float, where: str) -> None:
    """Refuse a chamfer that leaves nothing of an edge that is `room` mm thick."""
    if tolerances.chamfer and tolerances.chamfer >= room:
        raise SetupError(
            f"a chamfer of {tolerances.chamfer:g} mm does not fit {where}, which is {room:.3g} mm thick: make it "
            "smaller, 0 for none, or the optic thicker"
        )


def round_up(length: float) -> float:
    """A length rounded up to a tenth of a mm."""
    return float(np.ceil(length * 10 - 1e-6) / 10)


def start_sheet(
    page: Page, part: str, material: str, extent: tuple[float, float], room: tuple[float, float], column: float = COLUMN
) -> tuple[Sheet, float]:
    """An empty sheet with its title block, and the scale at which a part of this extent (mm) fits.

    `room` (2,) is how many mm of the sheet dimensions and text need beside and above the part, `column` how many are
    kept free at the right.
    """
    sheets = [page.sheet] if page.sheet else list(SHEETS)
    scales = {}
    for name in sheets:
        width, height = SHEETS[name]
        free = np.array([width - 2 * MARGIN - column, height - MARGIN - TABLES_TOP]) - room
        scales[name] = float(np.min(free / extent))
    best = {name: max((s for s in SCALES if s <= fit), default=0.0) for name, fit in scales.items()}
    name = sheets[0] if len(sheets) == 1 or best["A4"] >= min(1.0, best["A3"]) else "A3"
    if page.scale is not None:
        name = next((n for n in sheets if page.scale <= scales[n] + 1e-9), "")
        if not name:
            raise SetupError(
                f"at a scale of {scale_text(page.scale)} the part does not fit {' or '.join(sheets)}: "
                f"{scale_text(max(best.values()))} does"
            )
    scale = page.scale or best[name]
    if not scale:
        raise SetupError(f"the part, {extent[0]:.0f} x {extent[1]:.0f} mm, fits no sheet at 1:50; give it an outline")
    sheet = Sheet.of(name)
    cells = {
        "part": part,
        "material": material,
        "scale": scale_text(scale),
        "sheet, units": f"{name}, mm",
        "drawn by": page.author,
        "date": page.date,
    }
    title_block(sheet, cells, page.name or part)
    return sheet, scale


def notes(sheet: Sheet, lines: list[str], top: float, left: float = MARGIN + 2) -> None:
    """Lines of small text, one below the other."""
    for k, line in enumerate(lines):
        sheet.text((left, top - 3.3 * k), line, 1.6, ha="left", va="top")


def place_of_tables(sheet: Sheet) -> tuple[float, float]:
    """Left edge and width (mm) of what is free beside the title block."""
    return MARGIN, sheet.size[0] - 2 * MARGIN - TITLE_SIZE[0]


def surface_rows(setup: Setup, tolerances: Tolerances) -> dict[str, str]:
    """What is asked of a polished surface, as the cells of a table."""
    coating = tolerances.coating
    if coating is None:
        coating = f"coating: AR, R < 0.5 % at {setup.wavelength_nm:.4g} nm"
    elif coating.strip().lower() in ("", "none"):
        coating = "uncoated"
    return {
        "form": f"3/{2 * tolerances.flatness_waves:.3g}  (flat to {_wave_text(tolerances.flatness_waves)})",
        "surface": f"scratch-dig {tolerances.scratch_dig}",
        "coating": coating,
    }


def _wave_text(waves):
    if waves < 1 and abs(1 / waves - round(1 / waves)) < 1e-6:
        return f"lambda/{round(1 / waves)}"
    return f"{waves:g} lambda"


def material_rows(optic, wavelength_nm: float) -> list[str]:
    """What glass: its name, its index and its Abbe number."""
    from ..optics import Medium, medium
    from ..optics.media import D_LINE_NM

    glass = medium(optic.glass)
    if not isinstance(optic.glass, str | Medium):
        return ["to be agreed", f"index {glass.index_in_air(wavelength_nm):.6g} at {wavelength_nm:.4g} nm"]
    low, high = glass.range_nm
    line = D_LINE_NM if low <= D_LINE_NM <= high else wavelength_nm
    index = f"n({line:.4g} nm) = {glass.index_in_air(line):.5f}"
    abbe = glass.abbe_number
    return [glass.name, index + (f", V = {abbe:.2f}" if np.isfinite(abbe) else "")]
