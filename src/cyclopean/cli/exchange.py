"""Commands ``import`` and ``export``: cameras from and for other programs."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

from cyclopts import Parameter

from ..errors import SetupError
from .app import app, parse_depths

Format = Literal["opencv", "ros", "kalibr", "mrcal", "colmap", "aniposelib", "matchid", "dice", "nerfstudio"]
OutFile = Annotated[Path, Parameter(name=["--output", "-o"])]
SetupFile = Annotated[Path | None, Parameter(name=["--setup", "-s"])]


@app.command(name="import")
def import_(
    file: Path,
    *,
    output: OutFile,
    format: Format | None = None,
    setup: SetupFile = None,
    camera: str | None = None,
    size: str | None = None,
) -> None:
    """Take the real camera from another program's calibration.

    Parameters
    ----------
    file
        Its file; for COLMAP the folder of a sparse model.
    output
        Where to write: a TOML file with a [camera] table, or a whole setup file with --setup.
    format
        Guessed from the file's name and content without it.
    setup
        Setup file (TOML) whose camera to replace; the result is written to --output.
    camera
        Which one, by name, where the file holds several different cameras.
    size
        Of the image, px, as WIDTHxHEIGHT, for files that do not say it.
    """
    from ..jobs.exchange import import_camera

    import_camera(file, output, format, setup, camera, parse_size(size))


@app.command
def export(
    setup: Path,
    *,
    output: OutFile,
    format: Format | None = None,
    what: Literal["camera", "virtual"] = "virtual",
    depth: str | None = None,
    view: tuple[int, ...] = (),
    flip: bool = False,
    unit_mm: float | None = None,
) -> None:
    """Write a setup's camera, or one virtual camera for each view, for another program.

    A virtual camera is the pinhole that fits a view best between two depths. Light through glass has no single
    centre: how far the pinhole departs from it is printed, in px.

    Parameters
    ----------
    setup
        Setup file (TOML).
    output
        Where to write: a file; for COLMAP a folder. OpenCV, ROS and mrcal get one file for each camera.
    format
        Guessed from the name of the output without it. A matchid file holds two cameras: --view 0 --view 1.
    what
        The real camera behind the optic, or the virtual cameras.
    depth
        Depths to fit virtual cameras between, mm, as NEAR..FAR; the setup's, or the rig's working depths, without it.
    view
        Number of a view to write; give it several times for several. All without it.
    flip
        Write mirrored views as the cameras of the photograph flipped left to right.
    unit_mm
        What one unit of length of the file is, mm; 1000 for Kalibr and mrcal (metres), 1 for the others without it.
    """
    from ..jobs.exchange import export_cameras

    export_cameras(setup, output, format, what, parse_depths(depth), view, flip, unit_mm)


def parse_size(text: str | None) -> tuple[int, int] | None:
    """The size in px that WIDTHxHEIGHT stands for."""
    if text is None:
        return None
    try:
        width, height = (int(part) for part in text.lower().split("x"))
    except ValueError:
        raise SetupError(f"--size wants WIDTHxHEIGHT in px, for example 1280x960, got {text!r}") from None
    if width < 1 or height < 1:
        raise SetupError(f"--size wants WIDTHxHEIGHT in px, both above 0, got {text!r}")
    return width, height
