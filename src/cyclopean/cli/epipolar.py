"""Command ``epipolar``: where the partners of a pixel can lie."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from .app import OutFolder, SetupFile, Whole, app, parse_depths

Pixels = Annotated[tuple[str, ...], Parameter(name=["--pixel", "-p"], negative="", show_default=False)]


@app.command
def epipolar(
    photo: Path | None = None,
    *,
    setup: SetupFile,
    pixel: Pixels = (),
    view: Whole | None = None,
    depth: str | None = None,
    noise_px: float = 0.1,
    calibration: Path | None = None,
    output: OutFolder = Path("epipolar"),
) -> None:
    """Draw the true epipolar curves of pixels in the other sub-images, with their band of uncertainty.

    Each pixel's ray is traced to the scene and seen through the optic by every other view. Prints where each curve
    ends, how long and how wide it is, how far it moves for a mm of depth, and how far the straight line of two
    virtual cameras is off. Writes epipolar.png and epipolar.csv.

    Parameters
    ----------
    photo
        The photograph to draw on; without it, the outlines of the sub-images only.
    setup
        Setup file (TOML).
    pixel
        A pixel X,Y of the photograph, for example 400,300; one that begins with a minus as --pixel=-0.3,300. Give
        --pixel several times for several. Without it, one of each sub-image that the others see well.
    view
        The view that the pixels must lie in; without it, each lies in the one that it is found in.
    depth
        Depth range of the curves, mm, as NEAR..FAR; the setup's, or the rig's working depths, without it.
    noise_px
        Standard deviation of each coordinate of the given pixels, px.
    calibration
        calibration.json of the setup, to add the uncertainty of its parameters to the bands.
    output
        Folder for the results; made if it is not there.
    """
    from ..jobs.epipolar import draw_curves

    draw_curves(photo, setup, pixel, view, parse_depths(depth), noise_px, calibration, output)
