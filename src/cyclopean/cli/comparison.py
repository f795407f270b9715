"""Command ``compare-calibrations``: ray sketches, virtual cameras and the physical model on the same photographs."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

from .app import OutFolder, SetupFile, Whole, app
from .calibration import BoardFile, Several


@app.command
def compare_calibrations(
    *photos: Path,
    board: BoardFile,
    setup: SetupFile,
    output: OutFolder = Path("comparison"),
    camera_photos: Several = (),
    camera_board: Path | None = None,
    corners: Path | None = None,
    test: Several = (),
    test_board: Path | None = None,
    test_depths: str | None = None,
    field_point: str | None = None,
    folds: Whole | None = None,
    channel: Literal["all", "red", "green", "blue"] = "all",
) -> None:
    """Calibrate by every route and judge them all by photographs that none has seen.

    The routes: ray sketches of the drawing, alone and put right by a field point; virtual cameras by calibration; the
    physical model with true rays. Writes comparison.json, comparison.png and report.html.

    Parameters
    ----------
    photos
        Photographs of the board through the optic to calibrate from, or a folder of them.
    board
        Board file (TOML); `cyclopean board` writes one.
    setup
        Nominal setup file (TOML): camera and optic as drawn or measured with a ruler.
    output
        Folder for the results; made if it is not there.
    camera_photos
        Photographs of a board without the optic, same camera and focus, or a folder: then all routes start from the
        camera that these tell.
    camera_board
        Board file of the camera photographs, where it is another board.
    corners
        Detected corners (CSV) instead of photographs; --test then names photographs in it.
    test
        Photographs to judge by, or a folder. Without them, photographs to calibrate from are left out in turn.
    test_board
        Board file of the test photographs, where it is another board.
    test_depths
        Known depths of the board in the photographs that judge, for boards that stand square to the camera's axis, mm:
        numbers in the order of the photographs (600,700,...), or a CSV file with the columns photo,depth_mm.
    field_point
        PHOTO,DEPTH: a photograph to calibrate from with the board square to the axis at this depth, mm, whose corner
        nearest to the axis is the field point. Without it the physical model says a corner's depth.
    folds
        In how many groups photographs are left out in turn: 4, or as many as there are photographs, without it.
    channel
        Colour to look at.
    """
    from ..jobs.comparison import ComparisonRequest, run_comparison

    run_comparison(
        ComparisonRequest(
            photos, board, setup, output, camera_photos, camera_board, corners, test, test_board, test_depths,
            field_point, folds, channel,
        )
    )  # fmt: skip
