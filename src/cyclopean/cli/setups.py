"""Commands ``info`` and ``split``: what a setup gives."""

from __future__ import annotations

from pathlib import Path

from .app import OutFolder, SetupFile, app, parse_depths


@app.command
def info(setup: Path, *, depth: str | None = None, noise_px: float = 0.1) -> None:
    """Print what a setup gives: views, virtual cameras, baselines, common field of view, depth resolution.

    Parameters
    ----------
    setup
        Setup file (TOML).
    depth
        Depth range, mm, as NEAR..FAR; the setup's, or the rig's working depths, without it.
    noise_px
        Pixel noise that the depth resolution is stated for, px.
    """
    from ..jobs.setups import print_info

    print_info(setup, parse_depths(depth), noise_px)


@app.command
def split(photo: Path, *, setup: SetupFile, output: OutFolder = Path("out")) -> None:
    """Write the sub-images of a photograph, each in its own file, black where a pixel is not of the view.

    Mirrored views are written as seen, not flipped back. views.json says where each lies in the photograph.

    Parameters
    ----------
    photo
        The photograph.
    setup
        Setup file (TOML).
    output
        Folder for view_0.png, view_1.png, ... and regions.png.
    """
    from ..jobs.setups import split_photograph

    split_photograph(photo, setup, output)
