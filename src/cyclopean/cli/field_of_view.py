"""Command ``fov``: what the views of a setup see together."""

from __future__ import annotations

from pathlib import Path

from .app import OutFolder, Whole, app, parse_depths


@app.command
def fov(setup: Path, *, depth: str | None = None, views: Whole | None = None, output: OutFolder = Path("fov")) -> None:
    """Show the field of view that several views share: its class, limits, cross-sections, volume, use of the sensor.

    Prints the class of an upright prism with its closed forms, and for every optic what tracing the border of each
    sub-image gives. Writes fov.png, sections.png, sensor.png, volume_K.stl and volume_K.ply (mm, the camera's frame),
    fov.json and report.html.

    Parameters
    ----------
    setup
        Setup file (TOML).
    depth
        Depth range, mm, as NEAR..FAR; the setup's, or the rig's working depths, without it.
    views
        Write only the volume that this many views or more see; without it, those of 2, 3, ... and all views. An optic
        with one view needs --views 1.
    output
        Folder for the results; made if it is not there.
    """
    from ..jobs.field_of_view import show_field

    show_field(setup, parse_depths(depth), views, output)
