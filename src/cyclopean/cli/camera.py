"""Command ``camera``: the real camera, from photographs of a board without the optic."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

from cyclopts import Parameter

from .app import app
from .exchange import parse_size


@app.command
def camera(
    *photos: Path,
    board: Annotated[Path, Parameter(name=["--board", "-b"])],
    method: Literal["zhang", "tsai"] = "zhang",
    distortion: Literal[0, 1, 2, 4, 5] | None = None,
    corners: Path | None = None,
    size: str | None = None,
    output: Annotated[Path, Parameter(name=["--output", "-o"])] = Path("camera.toml"),
    report: Path | None = None,
) -> None:
    """Calibrate the real camera from photographs of a board without the optic.

    Take ten photographs or more, the board tilted by 20 to 40 degrees to all sides and out to the corners of the
    picture; leave focus and zoom as they will be with the optic. Tsai's method takes one photograph of a tilted board.

    Parameters
    ----------
    photos
        Photographs of the board without the optic, or a folder of them.
    board
        Board file (TOML); `cyclopean board` writes one.
    method
        zhang: from all photographs; tsai: from one, with the principal point taken as mid-image.
    distortion
        How many terms to find. zhang: the first 0, 2, 4 or 5 of k1 k2 p1 p2 k3, usually 5; tsai: 0, 1 or 2 radial
        ones, usually 1.
    corners
        Detected corners (CSV) instead of photographs, with "direct" in the column view.
    size
        Of the photographs that the corners come from, px, as WIDTHxHEIGHT.
    output
        Camera file (TOML) to write, for `cyclopean calibrate --camera` or to begin a setup file with.
    report
        Folder for a page with the residuals and corners.csv.
    """
    from ..jobs.camera import CameraRequest, run_camera

    run_camera(CameraRequest(photos, board, method, distortion, corners, parse_size(size), output, report))
