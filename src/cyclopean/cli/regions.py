"""Command ``regions``: the sub-images of photographs, found by their seams."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from .app import OutFolder, Whole, app


@app.command
def regions(
    *photos: Path,
    views: Whole | None = None,
    setup: Annotated[Path | None, Parameter(name=["--setup", "-s"])] = None,
    output: OutFolder = Path("out"),
) -> None:
    """Find the sub-images of photographs by their seams; no setup is needed.

    Writes regions.png (the first photograph with the seams and numbers) and regions.json.

    Parameters
    ----------
    photos
        Photographs through one optic, or a folder of them; the more the scene moves between them, the better.
    views
        Number of sub-images, 2 to 8, if known.
    setup
        Setup file (TOML) to compare with: which sub-image is which view, and how far the seams are from it.
    output
        Folder for the results.
    """
    from ..jobs.regions import find_regions

    find_regions(photos, views, setup, output)
