"""Commands ``reconstruct`` and ``demo``."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

from .app import OutFolder, SetupFiles, Whole, app, parse_depths


@app.command
def reconstruct(
    photo: Path,
    *,
    setup: SetupFiles,
    output: OutFolder = Path("out"),
    depth: str | None = None,
    step: float = 0.5,
    memory: float = 1024,
    threads: Whole | None = None,
    channel: Literal["all", "red", "green", "blue"] = "all",
    strict: bool = True,
    matcher: str = "cyclopean",
    scale: Literal[1, 2] = 2,
    mesh: Literal["ply", "stl", "obj"] | None = None,
    mesh_step: Whole = 2,
) -> None:
    """Turn one photograph into a measured point cloud.

    Writes points.ply (each surface element once, with colour, normal, covariance and the number of views that have
    it), depth.npz (depth of every pixel), depth.png, regions.png, overview.png and report.html.

    Parameters
    ----------
    photo
        The photograph: any format that OpenCV reads, 8 or 16 bit, grey or colour.
    setup
        Setup file (TOML) with camera and optic. Given three times, those of red, green and blue, as `calibrate
        --channel each` writes them.
    output
        Folder for the results; made if it is not there.
    depth
        Depth range to search, mm, as NEAR..FAR, for example 600..1600. Without it the setup file's, or all
        depths at which the views overlap and resolve depth.
    step
        Movement between two depth hypotheses, px; the search itself takes every second one, at half the resolution.
        Larger is faster, and wrong more often at edges.
    memory
        Memory for our own matcher, MiB.
    threads
        Threads to use; all cores without it.
    channel
        Colour channel to match. Glass bends colours differently. All are matched along their own rays where the
        setup file states channel_wavelengths_nm, or where three setups are given; elsewhere, in white light, one
        channel is far better than all.
    strict
        With --no-strict our own matcher also keeps depths of weakly textured pixels that only half the resolution and
        their neighbours tell, with a larger sigma: a fuller map of which more is wrong.
    matcher
        What matches: cyclopean, our own, all views at once along true rays; sgbm or sgbm-3way, OpenCV's in colour
        and its fastest in grey, on rectified pairs; or a function of yours on rectified pairs, FILE.py:FUNCTION or
        package.module:function.
    scale
        Scale of the rectified pictures, for matchers of pairs; 1 is faster and usually less exact.
    mesh
        Write the surface as triangles too: mesh.ply, mesh.obj (both in colour) or mesh.stl, in mm.
    mesh_step
        Pixels between the corners of the mesh; more makes it smaller and smoother.
    """
    from ..jobs.reconstruction import run_reconstruction

    run_reconstruction(
        photo,
        setup,
        output,
        parse_depths(depth),
        step,
        memory,
        threads,
        channel=channel,
        strict=strict,
        matcher=matcher,
        scale=scale,
        mesh=mesh,
        mesh_step=mesh_step,
    )


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
