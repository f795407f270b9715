"""Command ``errors``: what makes depth uncertain."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from ..errors import SetupError
from .app import OutFolder, app, parse_depths

Names = Annotated[tuple[str, ...], Parameter(negative="", show_default=False)]


@app.command
def errors(
    setup: Path,
    *,
    output: OutFolder = Path("errors"),
    depth: str | None = None,
    tolerance: Names = (),
    calibration: Path | None = None,
    noise_px: float = 0.1,
    temperature_range: float = 5.0,
    band: str | None = None,
    glass: str | None = None,
    mount: str = "aluminium",
    lens_ppm: float | None = None,
    blur_px: float = 0.3,
    bias_percent: float = 0.1,
) -> None:
    """Print what makes depth uncertain, sorted by share: tolerances, pixel noise, warmth and colour.

    Without --calibration every parameter has the tolerance of a usual drawing; the report lists them.

    Parameters
    ----------
    setup
        Setup file (TOML).
    output
        Folder for report.html, budget.csv, budget.png, maps.png, chromatic.png and errors.json.
    depth
        Depth range, mm, as NEAR..FAR; the setup's, or the rig's working depths, without it.
    tolerance
        NAME=VALUE, repeated or with commas: sigma in mm, degrees or px, in place of the usual one; 0: none.
    calibration
        calibration.json from the report of `cyclopean calibrate`, in place of the usual tolerances.
    noise_px
        Noise of a matched pixel coordinate, px.
    temperature_range
        The setup is used at so many K more or less than it was measured or calibrated at; 0 leaves warmth out.
    band
        Colours that reach the camera, LOW..HIGH in nm; the setup's wavelength +- 5 nm without it.
    glass
        Name of the glass, where the setup gives its index only: for dispersion and warmth.
    mount
        What holds the optic before the lens: aluminium, steel, invar, ..., or its expansion in ppm per K.
    lens_ppm
        Relative change of the camera's focal length, ppm per K; left out where not given.
    blur_px
        Blur that a filter may leave, px.
    bias_percent
        Error of depth, in percent, that a filter may leave at either end of its band.
    """
    from ..jobs.errors import Request, run_errors
    from .calibration import split_names

    run_errors(
        Request(
            setup, output, parse_depths(depth), split_names(tolerance), calibration, noise_px, temperature_range,
            parse_band(band), glass, mount, lens_ppm, blur_px, bias_percent,
        )
    )  # fmt: skip


def parse_band(text: str | None) -> tuple[float, float] | None:
    """The band that LOW..HIGH stands for, nm."""
    if text is None:
        return None
    try:
        low, high = (float(part) for part in text.removesuffix("nm").split(".."))
    except ValueError:
        raise SetupError(f"--band wants LOW..HIGH in nm, for example 540..560, got {text!r}") from None
    if not 0 < low < high < float("inf"):
        raise SetupError(f"--band wants 0 < LOW < HIGH in nm, got {text!r}")
    return low, high
