"""Command ``design``: from what is wanted to the prism to buy."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from .app import OutFolder, Whole, app, parse_depths

Texts = Annotated[tuple[str, ...], Parameter(negative="", show_default=lambda names: ",".join(names))]


@app.command
def design(
    *,
    camera: str,
    depth: str,
    accuracy: str | None = None,
    field: str | None = None,
    facets: str = "2..5",
    glass: Texts = ("N-BK7",),
    angles: str = "any",
    baseline: float | None = None,
    max_diameter: float | None = None,
    max_length: float | None = None,
    max_blend: float | None = None,
    max_chromatic: float | None = None,
    distance: str | None = None,
    wavelength: float | None = None,
    band: float = 10.0,
    noise: float = 0.1,
    f_number: float | None = None,
    focus: float | None = None,
    tolerances: str = "commercial",
    photos: Whole = 12,
    camera_photos: Whole = 6,
    draws: Whole = 400,
    choose: Whole = 6,
    judge: bool = True,
    photo: bool = True,
    output: OutFolder = Path("design"),
) -> None:
    """Design the prism for a camera, a working depth and an accuracy.

    Looks through numbers of facets, angles, glasses and distances, traces exact rays through those that may do, and
    judges the best by the accuracy that they keep after being made, mounted and calibrated. Prints a table to choose
    from, and writes comparison.png, report.html, designs.json, and for each chosen prism a folder with setup.toml,
    prism.stl, drawing.pdf, candidate.png and shopping.md. Says what is in the way where nothing fits. Ctrl-C keeps
    what is written by then.

    Parameters
    ----------
    camera
        Pixels, pixel pitch and focal length, with commas: "1280x960, 5.5 um, f=25 mm". Also "f=2400 px", an aperture
        "f/8", "sensor 7.04x5.28 mm" or "2/3 inch" in place of the pitch; or a camera file or setup file (TOML).
    depth
        NEAR..FAR, mm, from the camera's pinhole: between these the prism must serve.
    accuracy
        Standard deviation of depth to be kept at every depth, in percent of the depth (0.1%), or as a length at the far
        depth ("0.5 mm"). Without it the prisms are compared, and none is refused for its accuracy.
    field
        WIDTHxHEIGHT, mm, that two views or more must share at every depth, about the optical axis.
    facets
        Numbers of facets to look at: 2..5, or 2,3; 2 is a biprism.
    glass
        Glasses to look at, with commas: N-BK7,PMMA.
    angles
        Apex angles, between the flat face and a facet: "any", "stock" for those that are sold from stock, or degrees:
        4,6,8.
    baseline
        Distance wanted between neighbouring virtual cameras, mm; kept to 2 %.
    max_diameter
        Largest diameter of the glass, mm.
    max_length
        Largest length from the pinhole to the prism's far end, mm. Where neither this nor the diameter nor the distance
        is limited, it is half of the nearest depth, and the diameter 160 mm.
    max_blend
        Widest band beside seams in which the open lens mixes two views, px; needs the f-number.
    max_chromatic
        Widest spread of a point by the light's band of colours, px.
    distance
        NEAREST..FARTHEST, mm, from the pinhole (the lens's entrance pupil) to the glass; from 20 mm on without it.
    wavelength
        Of the light, nm; that of a setup file, or 587.56, without it.
    band
        Full width of the light's band, that of the filter or the lamp, nm.
    noise
        Standard deviation of a matched coordinate, px.
    f_number
        Of the lens, to tell the blend band and the depth of field; "f/8" in --camera says the same.
    focus
        Distance from the pinhole to what is in focus, mm; the harmonic mean of the depths without it.
    tolerances
        Of maker and mount: commercial, precision, high, usual (the error budget's), or a file with a line NAME=VALUE
        for each parameter, as --tolerance of `cyclopean tolerance` takes them.
    photos
        Photographs of a board through the prism that the setup will be calibrated from.
    camera_photos
        Photographs of the board without the prism, which show the camera's own focal length.
    draws
        Prisms that are drawn at random within the tolerances to judge one candidate.
    choose
        How many candidates are judged and written, 1 to 26.
    judge
        Judge candidates by what they keep after making, mounting and calibrating; --no-judge: on paper only, faster.
    photo
        Show in each picture the photograph that the setup would take; --no-photo: without.
    output
        Folder for the results.
    """
    from ..jobs.design import run_design
    from ..jobs.design_request import DesignRequest

    depths = parse_depths(depth)
    assert depths is not None
    run_design(
        DesignRequest(
            camera, depths, accuracy, field, facets, glass, angles, baseline, max_diameter, max_length, max_blend,
            max_chromatic, distance, wavelength, band, noise, f_number, focus, tolerances, photos, camera_photos,
            draws, choose, judge, photo, output,
        )
    )  # fmt: skip
