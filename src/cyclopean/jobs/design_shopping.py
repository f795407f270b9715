"""What one must buy and set for a designed prism, in words: the shopping list."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from ..optics import medium
from .design_tables import number

if TYPE_CHECKING:
    from ..analysis import CalibrationPlan
    from ..design.requirements import Candidate, Requirements
    from ..plotting.workshop import Tolerances
    from ..rigs import Rig

Rows = list[tuple[str, str]]

_BLUR = 0.3  # px, of colours or beside seams, where the requirements say nothing
_STOPS = (1.4, 2.0, 2.8, 4.0, 5.6, 8.0, 11.0, 16.0, 22.0, 32.0)
_OTHER_LIGHT = (470.0, 525.0, 632.8, 850.0)  # nm: lamps that one buys
_PARAMETERS = {  # fields of the drawing's tolerances, and of which parameter
    "angle_arcmin": "optic.apex", "azimuth_arcmin": "optic.facet1_azimuth", "thickness": "optic.thickness",
    "index": "optic.index",
}  # fmt: skip


def limits_of(candidate: Candidate, requirements: Requirements) -> dict[str, float]:
    """How far each parameter of the setup may be from the drawing, by full name: mm, rad, 1.

    Limits as they are stated; of what is stated as a standard deviation, two of these.
    """
    from ..design.judgement import drawn_tolerances

    given = drawn_tolerances(candidate.setup, requirements)
    short = {"optic.facets": "optic.facet1_azimuth"}
    return {short.get(t.name, t.name): t.size * (2.0 if t.shape == "normal" else 1.0) for t in given}


def drawing_tolerances(candidate: Candidate, requirements: Requirements) -> Tolerances:
    """What the workshop drawing states: the tolerances that the candidate is judged by, others as usual."""
    from dataclasses import replace

    from ..design.catalogue import ToleranceGrade
    from ..optics.dimensions import prism_dimensions
    from ..plotting.workshop import Tolerances

    usual, limits = Tolerances(), limits_of(candidate, requirements)
    stated: dict[str, Any] = {}
    for field, name in _PARAMETERS.items():
        if limits.get(name, 0.0) > 0:
            stated[field] = limits[name] if field in ("thickness", "index") else 60 * float(np.degrees(limits[name]))
    if isinstance(requirements.tolerances, ToleranceGrade):
        stated["diameter"] = requirements.tolerances.diameter[0] or usual.diameter
    rim = prism_dimensions(candidate.prism).rim[0] if candidate.prism.radius is not None else 0.0
    chamfer = usual.chamfer if rim > 2 * usual.chamfer else round(rim / 3, 2)
    stated = {key: float(f"{value:.3g}") for key, value in stated.items()}
    return replace(usual, chamfer=chamfer, **stated)


def shopping_list(
    candidate: Candidate, requirements: Requirements, rig: Rig, plan: CalibrationPlan | None, kept: Rows
) -> dict[str, Rows]:
    """Heading -> rows (what, value) of all that is to be bought, set and done.

    `rig` is `candidate.setup.rig()`; `kept` holds the rows about the accuracy to expect.
    """
    return {
        "Prism": _prism_rows(candidate, requirements),
        "Mount": _mount_rows(candidate, requirements),
        "Camera and lens": _lens_rows(candidate, requirements),
        "Light and filter": _light_rows(candidate, requirements, rig),
        "Calibration": [] if plan is None else _calibration_rows(plan),
        "Accuracy to expect": kept,
    }


def _prism_rows(candidate, requirements) -> Rows:
    from ..design.catalogue import glass_fact
    from ..plotting.workshop import face_text, light_aperture

    prism, figures = candidate.prism, candidate.figures
    tolerances = drawing_tolerances(candidate, requirements)
    light = light_aperture(candidate.setup)
    glass, fact = medium(prism.glass), glass_fact(str(prism.glass)) if isinstance(prism.glass, str) else None
    at = requirements.wavelength_nm
    shape = (
        "biprism, two facets that meet in a ridge" if prism.facets == 2 else f"pyramid of {prism.facets} equal facets"
    )
    clear = ", ".join(face_text(radius, prism.radius) for radius in (light.flat_face, light.facets))
    rows = [
        ("shape", f"{shape}, one flat face, round outline" if prism.radius else f"{shape}, one flat face"),
        ("each facet to the flat face", f"{prism.apex_deg:.4f} deg ± {_arcmin(tolerances.angle_arcmin)}"),
        ("nearest angle from stock", _stock_text(prism)),
        ("facets to each other, around the axis", f"{360 / prism.facets:g} deg ± {_arcmin(tolerances.azimuth_arcmin)}"),
        ("glass", f"{glass.name}, n({at:.4g} nm) = {glass.index_in_air(at):.5f} ± {tolerances.index:g}"
                  + (f", V = {glass.abbe_number:.1f}" if np.isfinite(glass.abbe_number) else "")),
        ("diameter", f"{figures.diameter:.4g} mm, +0 / -{tolerances.diameter:g} mm"),
        ("clear aperture: flat face, facets", clear),
        ("thickness at the apex", f"{prism.thickness:.4g} mm ± {tolerances.thickness:g} mm"),
        ("surface", f"scratch-dig {tolerances.scratch_dig}, flat to {tolerances.flatness_waves:g} wave at 546 nm"),
        ("edges between facets", f"sharp: chips up to {tolerances.sharpness:g} mm"),
        ("coating", f"against reflections at {at:.4g} nm, all polished faces"),
    ]  # fmt: skip
    if np.isfinite(figures.mass):
        rows.append(("mass", f"{number(figures.mass)} g"))
    if fact is not None:
        rows.append(("about the glass", f"price {fact.price}; {fact.remark}"))
    return rows


def _stock_text(prism) -> str:
    from ..design.catalogue import stock_wedges

    wedges = [wedge for wedge in stock_wedges() if wedge.glass == prism.glass] or stock_wedges()
    nearest = min(wedges, key=lambda wedge: abs(wedge.angle_deg - prism.apex_deg))
    same = abs(nearest.angle_deg - prism.apex_deg) < 0.006
    return (
        f"{nearest.angle_deg:g} deg ({nearest.glass} wedge, {nearest.deviation_deg:g} deg of deviation)"
        + (": this one; facets are cut from it" if same else "; --angles stock designs with those alone")
    )  # fmt: skip


def _arcmin(value: float) -> str:
    return f"{value:.3g}'" if value >= 1 else f'{60 * value:.3g}"'


def _mount_rows(candidate, requirements) -> Rows:
    from ..analysis.field_of_view import picture_azimuths

    prism, limits = candidate.prism, limits_of(candidate, requirements)
    first = "flat face" if prism.facing == "scene" else "apex"
    rows = [("which way", f"{'facets' if prism.facing == 'scene' else 'flat face'} towards the scene")]
    rows.append((
        f"from the lens's entrance pupil to the {first}",
        f"{prism.distance:.4g} mm" + _plus_minus(limits.get("optic.distance"), "mm"),
    ))  # fmt: skip
    turn = "ridge" if prism.facets == 2 else "middle of facet 0"
    azimuth = float(np.degrees(picture_azimuths(prism)[0])) + (90 if prism.facets == 2 else 0)
    rows.append((f"turned so that the {turn}", f"lies at {azimuth % 360:g} deg from image right towards image down"))
    rows.append(("middle of the apex off the optical axis", _within(limits.get("optic.shift_x"), 1.0, "mm")))
    rows.append(("tilt", _within(limits.get("optic.tilt_x"), 180 / np.pi, "deg")))
    rows.append(("length from the pupil to the prism's end", f"{candidate.figures.length:.4g} mm"))
    return rows


def _plus_minus(limit, unit):
    return f" ± {limit:.3g} {unit}" if limit else ""


def _within(limit, factor, unit):
    return f"up to {limit * factor:.3g} {unit}" if limit else "as well as the mount holds it; the calibration finds it"


def _lens_rows(candidate, requirements) -> Rows:
    camera, figures = requirements.camera, candidate.figures
    pitch = camera.pixel_pitch
    size = f"{camera.size[0]} x {camera.size[1]} px" + (f" of {1000 * pitch:.4g} um" if pitch else "")
    focal = f"{camera.focal[0]:.5g} px" + (f", {camera.focal[0] * pitch:.4g} mm" if pitch else "")
    rows = [("sensor", size), ("focal length", focal), ("focus at", f"{requirements.focus:.4g} mm from the pupil")]
    if requirements.f_number is not None:
        near, far = figures.defocus
        rows.append(("aperture", f"f/{requirements.f_number:g}"))
        rows.append(("blur circle at the nearest, farthest depth", f"{near:.2g} px, {far:.2g} px"))
        rows.append(("band beside seams where views mix", f"{figures.blend:.3g} px wide"))
    elif pitch:
        rows.append(("aperture", stop_advice(requirements)))
    else:
        rows.append(("aperture", "as small as the light allows; state pixel pitch and f-number to see what it does"))
    return rows


def stop_advice(requirements: Requirements) -> str:
    """The standard stop that blurs the ends of the depths least, defocus and diffraction together.

    Diameters: of the blur circle D (image distance) |1 / z - 1 / focus| with the pupil D = f / N, thin lens; of
    the Airy disc 2.44 wavelength N (Born and Wolf, Principles of Optics, section 8.5.2).
    """
    camera, focus = requirements.camera, requirements.focus
    slope = max(abs(1 / depth - 1 / focus) for depth in requirements.depths)
    pitch: float = camera.pixel_pitch  # type: ignore[assignment]
    open_circle = camera.focal[0] ** 2 * pitch * slope  # px, at f/1
    airy = 2.44 * requirements.wavelength_nm * 1e-6 / pitch  # px, at f/1
    stop = min(_STOPS, key=lambda stop: float(np.hypot(open_circle / stop, airy * stop)))
    return (
        f"f/{stop:g} is sharpest at both ends: blur circle {open_circle / stop:.2g} px, diffraction {airy * stop:.2g} "
        f"px; --f-number {stop:g} tells how wide seams blend then"
    )


def _light_rows(candidate, requirements, rig) -> Rows:
    blur = requirements.max_chromatic or _BLUR
    at, width = requirements.wavelength_nm, requirements.bandwidth_nm
    rows = [
        ("wavelength", f"{at:.5g} nm, the one that the index is stated at"),
        (
            "designed for a full width of",
            f"{width:g} nm: spreads a point by {candidate.figures.chromatic:.2g} px at most",
        ),
    ]
    advice = _advice(candidate, requirements, blur, rig)
    if advice:
        widest = {a.centre_nm: a.width_for_blur for a in advice}
        rows.append(
            (f"filter for a spread of {blur:g} px", f"centre {at:.5g} nm, full width up to {_nm(widest.pop(at))}")
        )
        rows.append(
            ("widest filter at other colours", ", ".join(f"{nm:g} nm: {_nm(wide)}" for nm, wide in widest.items()))
        )
    return [row for row in rows if row[1]]


def _nm(width):
    return "any" if np.isinf(width) else f"{width:.3g} nm"


def _advice(candidate, requirements, blur, rig):
    from ..analysis import filter_advice
    from ..calibration.depths import working_volume

    volume = working_volume(rig, requirements.depths, 4)
    centres = (requirements.wavelength_nm, *(nm for nm in _OTHER_LIGHT if abs(nm - requirements.wavelength_nm) > 15))
    return filter_advice(
        candidate.setup, volume.points[volume.common], centres, seen=volume.seen[volume.common], blur=blur,
        bias_percent=1000.0,
    )  # fmt: skip


def _calibration_rows(plan: CalibrationPlan) -> Rows:
    target = plan.target
    rows = [("board", str(target)), ("print it", "cyclopean board board.toml -o board.pdf")]
    rows.append(
        (
            "photographs through the prism",
            f"{len(plan.poses)}, tilted by 20 to 25 deg to all sides, near, middle and far",
        )
    )
    if plan.direct_poses:
        rows.append(("photographs without the prism", f"{len(plan.direct_poses)}"))
    direct = f" --direct {len(plan.direct_poses)}" if plan.direct_poses else ""
    rehearsal = f"cyclopean simulate setup.toml --calibration {len(plan.poses)}{direct} --board board.toml"
    rows.append(("what they will look like", rehearsal))
    more = " --camera-photos without_prism/" if plan.direct_poses else ""
    rows.append(("then", f"cyclopean calibrate photos/ --board board.toml --setup setup.toml{more}"))
    return rows
