"""Commands ``reconstruct`` and ``demo``."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

from .app import OutFolder, SetupFile, Whole, app, parse_depths


@app.command
def reconstruct(
    photo: Path,
    *,
    setup: SetupFile,
    output: OutFolder = Path("out"),
    depth: str | None = None,
    step: float = 0.5,
    memory: float = 1024,
    threads: Whole | None = None,
    channel: Literal["all", "red", "green", "blue"] = "all",
) -> None:
    """Turn one photograph into a measured point cloud.

    Writes points.ply, depth.npz, depth.png, regions.png, overview.png and report.html.

    Parameters
    ----------
    photo
        The photograph: any format that OpenCV reads, 8 or 16 bit, grey or colour.
    setup
        Setup file (TOML) with camera and optic.
    output
        Folder for the results; made if it is not there.
    depth
        Depth range to search, mm, as NEAR..FAR, for example 600..1600. Without it the setup file's, or all
        depths at which the views overlap and resolve depth.
    step
        Movement between two depth hypotheses, px; smaller is slower.
    memory
        Memory for matching, MiB.
    threads
        Threads to use; all cores without it.
    channel
        Colour channel to match. Glass bends colours differently: in white light, with a prism, one channel (and
        its wavelength in the setup file) is far better than all.
    """
    from ..jobs.reconstruction import run_reconstruction

    run_reconstruction(photo, setup, output, parse_depths(depth), step, memory, threads, channel)


@app.command
def demo(*, output: OutFolder = Path("out/demo"), threads: Whole | None = None) -> None:
    """Reconstruct the photograph that comes with the package.

    Parameters
    ----------
    output
        Folder for the results.
    threads
        Threads to use; all cores without it.
    """
    from ..jobs.reconstruction import demo_files, run_reconstruction

    photo, setup = demo_files()
    run_reconstruction(photo, setup, output, None, 0.5, 1024, threads)
