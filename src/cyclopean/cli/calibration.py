"""Command ``calibrate``: from photographs of a board to a calibrated setup."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Literal

from cyclopts import Parameter

from .app import Whole, app, parse_depths

BoardFile = Annotated[Path, Parameter(name=["--board", "-b"])]
OptionalSetup = Annotated[Path | None, Parameter(name=["--setup", "-s"])]
OutFile = Annotated[Path, Parameter(name=["--output", "-o"])]
Several = Annotated[tuple[Path, ...], Parameter(consume_multiple=True, negative="", show_default=False)]
Names = Annotated[tuple[str, ...], Parameter(negative="", show_default=False)]


@app.command
def calibrate(
    *photos: Path,
    board: BoardFile,
    setup: OptionalSetup = None,
    output: OutFile = Path("calibrated.toml"),
    report: Path | None = None,
    camera_photos: Several = (),
    camera_board: Path | None = None,
    corners: Path | None = None,
    save_corners: Path | None = None,
    free: Names = (),
    hold: Names = (),
    tolerance: Names = (),
    facets: Whole | None = None,
    glass: str | None = None,
    camera: Path | None = None,
    depth: str | None = None,
    validate: bool = True,
    guide: bool = True,
    channel: Literal["all", "red", "green", "blue", "each"] = "all",
    compare: bool = False,
) -> None:
    """Calibrate a setup from photographs of a board.

    Take 8 photographs or more through the optic, the board tilted by 20 to 40 degrees to all sides, near and far.
    Writes the calibrated setup, and a folder with report.html, pictures, calibration.json and corners.csv. A
    calibration that cannot be right is written as NAME_failed.toml, and the exit status is 1.

    Parameters
    ----------
    photos
        Photographs of the board through the optic, or a folder of them.
    board
        Board file (TOML); `cyclopean board` writes one.
    setup
        Nominal setup file (TOML): camera and optic as drawn or measured with a ruler.
    output
        Calibrated setup file to write; with --channel each, one for each colour: NAME_red.toml, ...
    report
        Folder for the report; NAME_report beside the output without it.
    camera_photos
        Photographs of a board without the optic, same camera and focus, or a folder: then the camera is found too.
    camera_board
        Board file of the camera photographs, where it is another board.
    corners
        Detected corners (CSV) instead of photographs.
    save_corners
        Where to write the detected corners as CSV, besides the report's corners.csv.
    free
        Parameters to find, repeated or with commas: optic.pose, optic.apex, optic.facets, camera.focal, camera, ...
        Without it the optic's pose and shape, and the camera where there are camera photographs.
    hold
        Parameters to take from the setup file although they are usually found.
    tolerance
        NAME=VALUE, how far the setup file may be off: standard deviation in mm, degrees or px.
    facets
        Number of facets of a prism without a drawing: instead of --setup.
    glass
        Glass of that prism, or its index.
    camera
        Camera file (TOML), from `cyclopean import` or another setup, in place of the setup file's camera.
    depth
        NEAR..FAR, mm: depths at which the setup will be used, for depth errors and guidance; kept in the output.
    validate
        Calibrate again without some of the photographs in turn, and look how those left out are explained.
    guide
        Say which photographs to take next.
    channel
        Colour to look at; each: all three, with one prism and an index for each.
    compare
        Set a ray sketch of the drawing, virtual cameras and this model side by side, each calibrated from half of the
        photographs and judged by the rest; takes about as long as three more calibrations.
    """
    from ..jobs.calibration import run_calibration
    from ..jobs.calibration_request import Request

    run_calibration(
        Request(
            photos, board, setup, output, report, camera_photos, camera_board, corners, save_corners, split_names(free),
            split_names(hold), split_names(tolerance), facets, glass, camera, parse_depths(depth), validate, guide,
            channel, compare,
        )
    )  # fmt: skip


def split_names(given: Sequence[str]) -> tuple[str, ...]:
    """Names that were given one by one, or with commas between them."""
    return tuple(name.strip() for text in given for name in text.split(",") if name.strip())
