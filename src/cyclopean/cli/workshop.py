"""Commands ``drawing`` and ``rays``: what a workshop needs, and where the light goes."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

from cyclopts import Parameter

from .app import Whole, app, parse_depths

OutFiles = Annotated[
    tuple[Path, ...],
    Parameter(name=["--output", "-o"], negative=(), show_default=lambda files: " ".join(map(str, files))),
]
OutFile = Annotated[Path, Parameter(name=["--output", "-o"])]


@app.command
def drawing(
    setup: Path,
    *,
    output: OutFiles = (Path("drawing"),),
    name: str = "",
    sheet: Literal["A4", "A3"] | None = None,
    scale: str | None = None,
    author: str = "",
    date: str = "",
    density: float | None = None,
    width: float | None = None,
    angle_tolerance: float = 1.0,
    azimuth_tolerance: float = 5.0,
    thickness_tolerance: float = 0.1,
    diameter_tolerance: float = 0.1,
    centring: float = 0.1,
    flatness: float = 0.25,
    scratch_dig: str = "40-20",
    chamfer: float = 0.3,
    sharpness: float = 0.05,
    coating: str | None = None,
    index_tolerance: float = 0.0005,
    mesh_tolerance: float = 0.005,
) -> None:
    """Write the workshop drawing of a setup's prism, plate or mirrors in true scale, and the prism as a solid.

    Parameters
    ----------
    setup
        Setup file (TOML).
    output
        Files to write, one after each -o: .pdf, .svg, .png a drawing; .stl, .ply, .obj the solid, in mm. A name without
        ending is a folder for drawing.pdf, drawing.svg, and prism.stl.
    name
        Name of the part, for the title block.
    sheet
        A4 or A3; A4 where the part fits it in full size, else A3.
    scale
        Such as 2:1 or 1:5; the largest standard scale that fits where left out.
    author
        For the title block.
    date
        For the title block, as it is to be written; left blank without it, so that a setup always gives the same file.
    density
        Of the material, g/cm^3, for the mass.
    width
        Length along the ridge, mm, of a biprism without a radius, which would be endless; what the camera's light
        needs, and a fifth more, where left out.
    angle_tolerance
        Of each facet to the flat face, arc minutes.
    azimuth_tolerance
        Of the facets to each other around the axis, arc minutes.
    thickness_tolerance
        Of the thickness at the apex, mm.
    diameter_tolerance
        Of the outline, downwards, mm.
    centring
        Largest distance of the apex from the middle of the outline, mm.
    flatness
        Of each polished face within its clear aperture, in waves of 546.07 nm, peak to valley.
    scratch_dig
        Surface quality to MIL-PRF-13830B, two numbers such as 40-20.
    chamfer
        Of the rim, mm; less than the rim is thick.
    sharpness
        Largest chips at the edges between facets, mm.
    coating
        Text for the coating, "none" for none; against reflections at the setup's wavelength where left out.
    index_tolerance
        Of the material's index.
    mesh_tolerance
        How far the polygon that stands for a round outline may lie inside it in the solid, mm; 1e-5 at least.
    """
    from ..jobs.workshop import DrawingRequest, write_drawings
    from ..plotting.workshop import Page, Tolerances

    positive = {
        "--angle-tolerance": angle_tolerance, "--azimuth-tolerance": azimuth_tolerance,
        "--thickness-tolerance": thickness_tolerance, "--diameter-tolerance": diameter_tolerance,
        "--centring": centring, "--flatness": flatness, "--index-tolerance": index_tolerance,
    }  # fmt: skip
    _check_options(positive, {"--chamfer": chamfer, "--sharpness": sharpness})
    tolerances = Tolerances(
        angle_tolerance, azimuth_tolerance, thickness_tolerance, diameter_tolerance, centring, flatness, scratch_dig,
        chamfer, sharpness, coating, index_tolerance,
    )  # fmt: skip
    page = Page(name, sheet, None if scale is None else parse_scale(scale), author, date, density)
    write_drawings(DrawingRequest(setup, output, page, tolerances, width, mesh_tolerance))


def _check_options(positive: dict[str, float], from_zero: dict[str, float]) -> None:
    """Numbers that a drawing can state, named as they were typed."""
    from ..errors import SetupError

    for option, value in positive.items():
        if not 0 < value < float("inf"):
            raise SetupError(f"{option} must be a positive number, got {value:g}")
    for option, value in from_zero.items():
        if not 0 <= value < float("inf"):
            raise SetupError(f"{option} must be a number of mm, 0 or more, got {value:g}")


def parse_scale(text: str) -> float:
    """The scale that "2:1" or "1:5" stands for, drawn mm per mm."""
    from ..errors import SetupError

    try:
        drawn, true = (float(part) for part in text.split(":"))
        scale = drawn / true
    except (ValueError, ZeroDivisionError):
        raise SetupError(f"--scale wants a scale such as 2:1 or 1:5, got {text!r}") from None
    if not 0 < scale < float("inf"):
        raise SetupError(f"--scale wants a scale such as 2:1 or 1:5, got {text!r}")
    return scale


@app.command
def rays(
    setup: Path,
    *,
    output: OutFile = Path("rays"),
    figure: Literal["section", "map", "cameras"] = "section",
    depth: str | None = None,
    plane: str = "facet",
    count: Whole = 5,
    boundary: Literal["edge", "middle"] = "edge",
) -> None:
    """Draw the light's way through the optic, the virtual cameras, and the common field of view.

    Parameters
    ----------
    setup
        Setup file (TOML).
    output
        File to write, .png, .pdf or .svg. A name without ending is a folder for all three figures as PNG.
    figure
        Which figure goes into the file: "section", camera and optic cut along one plane; "map", from all sides;
        "cameras", how axis ray and boundary ray make each virtual camera.
    depth
        Depth range, mm, as NEAR..FAR; the setup's, or the rig's working depths, without it.
    plane
        Plane of the section: "facet", that of facet 0 or of the first mirror; "xz", "yz", or an azimuth in degrees
        from image right towards image down.
    count
        Rays of each view in the section, 1 to 500.
    boundary
        Which boundary ray makes the virtual cameras of "cameras": to the farthest corner of the sub-image, or through
        its middle.
    """
    from ..jobs.workshop import RayRequest, draw_rays

    draw_rays(RayRequest(setup, output, figure, parse_depths(depth), plane, count, boundary))
