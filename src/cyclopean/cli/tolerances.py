"""Commands ``tolerance`` and ``model-error``: depth errors by wrong numbers, and by a wrong model."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

from cyclopts import Parameter

from .app import OutFolder, Whole, app, parse_depths

Texts = Annotated[tuple[str, ...], Parameter(negative="", show_default=False)]


@app.command
def tolerance(
    setup: Path,
    *,
    output: OutFolder = Path("tolerances"),
    draws: Whole = 10_000,
    tolerance: Texts = (),
    usual: bool = True,
    depth: str | None = None,
    noise_px: float = 0.0,
    require: float = 1.0,
    board: Annotated[Path | None, Parameter(name=["--board", "-b"])] = None,
    photos: Whole = 12,
    camera_photos: Whole = 0,
    corner_noise_px: float = 0.02,
    free: Texts = (),
    seed: Whole = 0,
) -> None:
    """Depth errors of setups as they are really made and mounted, before and after calibration.

    Draws many real setups at random within their tolerances, traces exact rays through each, and triangulates with the
    drawing, or with a calibration from photographs of a board. Writes tolerances.png, tolerances.csv, draws.npz and
    report.html. Ctrl-C ends the drawing; what was drawn so far is kept.

    Parameters
    ----------
    setup
        Setup file (TOML): the drawing.
    output
        Folder for the results.
    draws
        How many setups to draw.
    tolerance
        NAME=VALUE or NAME=VALUE:uniform, repeated or with commas, in mm, degrees or px: standard deviation of a
        parameter (optic.distance=0.5, optic.facets=0.02); with :uniform half of the width; with :truncated the limits
        of a normal curve, at two of its standard deviations. 0 takes a usual one away.
    usual
        Draw all usual tolerances besides those that are given; --no-usual: only those that are given.
    depth
        NEAR..FAR, mm; the setup's, or the rig's working depths, without it.
    noise_px
        Noise of matched pixels that the errors shall hold, px.
    require
        Largest error of depth that is allowed, in percent of the depth.
    board
        Board file (TOML) of the calibration; a board that fits the field without it.
    photos
        Photographs of the board that the setup is calibrated from; 0: no calibration.
    camera_photos
        Photographs of the board without the optic: then the camera is found too.
    corner_noise_px
        Noise of the board's corners in these photographs, px.
    free
        Parameters that the calibration finds, repeated or with commas; without it the optic, and the camera where
        there are camera photographs.
    seed
        The same seed draws the same setups.
    """
    from ..jobs.tolerances import ToleranceRequest, run_tolerances
    from .calibration import split_names

    run_tolerances(
        ToleranceRequest(
            setup, output, draws, split_names(tolerance), usual, parse_depths(depth), noise_px, require, board, photos,
            camera_photos, corner_noise_px, split_names(free), seed,
        )
    )  # fmt: skip


@app.command
def model_error(
    setup: Path,
    *,
    output: OutFolder = Path("model_error"),
    depth: str | None = None,
    method: Literal["all", "sketch", "fit", "distortion"] = "all",
    fit_depth: str | None = None,
) -> None:
    """Depth errors that remain when each sub-image is taken as the picture of an ordinary camera.

    Exact points of the common field are triangulated with virtual cameras: ray sketches, and best-fitting pinholes
    without and with distortion. Writes model_error.png and model_error.csv.

    Parameters
    ----------
    setup
        Setup file (TOML).
    output
        Folder for the results.
    depth
        NEAR..FAR, mm; the setup's, or the rig's working depths, without it.
    method
        Which virtual cameras.
    fit_depth
        NEAR..FAR, mm, between which the pinholes are fitted; those of --depth without it.
    """
    from ..jobs.model_error import run_model_error

    run_model_error(setup, output, parse_depths(depth), method, parse_depths(fit_depth))
