"""Finding the sub-images of photographs; see `cyclopean regions`."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from rich.table import Table

from ..errors import ImageError, SetupError
from ..files import output_folder, read_photograph, read_setup, replacing
from ..targets.seams import VIEWS, Reconciliation, Seams, find_seams, reconcile
from .calibration_photographs import find_files
from .console import console, progress_bars, save_figure


def find_regions(photos: Sequence[Path], views: int | None, setup_file: Path | None, output: Path) -> None:
    """Find seams, tell and write them, and compare them with a setup if there is one."""
    if not photos:
        raise ImageError("no photograph was given; name one or more, for example: cyclopean regions photo*.png")
    if views is not None and views not in VIEWS:
        raise SetupError(f"--views must be {VIEWS[0]} to {VIEWS[-1]}, got {views}; leave it out if it is not known")
    photos, remarks = find_files(photos, "regions")
    for remark in remarks:
        console.print(f"note: {remark}", style="yellow")
    setup = None if setup_file is None else read_setup(setup_file)
    first = read_photograph(photos[0], None if setup is None else setup.camera.size)
    size = first.shape[1], first.shape[0]
    photographs = [first, *(_read(path, size, photos[0]) for path in photos[1:])]
    folder = output_folder(output)
    with progress_bars() as progress:
        seams = find_seams(photographs, views, progress)
    console.print(headline(seams))
    console.print(seams_table(seams))
    if seams.message:
        console.print(f"warning: {seams.message}", style="yellow")
    written = seams_as_json(seams, photos)
    if setup is not None:
        with console.status("comparing with the setup"):
            comparison = reconcile(seams, setup.rig())
        say_comparison(comparison)
        written["setup"] = comparison_as_json(comparison)
    with replacing(folder / "regions.json") as file:
        file.write((json.dumps(written, indent=1) + "\n").encode())
    from ..plotting.seams import seams_picture

    save_figure(seams_picture(first, seams), folder / "regions.png")
    console.print(f"-> {folder}/  regions.png  regions.json")


def _read(path, size, first):
    photograph = read_photograph(path)
    got = photograph.shape[1], photograph.shape[0]
    if got != size:
        raise ImageError(
            f"{path} is {got[0]}x{got[1]} px but {first} is {size[0]}x{size[1]} px: seams are found in photographs "
            "of one setup, all of one size"
        )
    return photograph


def headline(seams: Seams) -> str:
    """What was found, in one line."""
    place = f"({seams.apex[0]:.1f}, {seams.apex[1]:.1f}) px"
    where = f"one seam, through {place}" if len(seams) == 2 else f"seams meet at {place}"
    band = f"; both sides mix over {seams.band:.0f} px" if np.isfinite(seams.band) else ""
    return f"{len(seams)} sub-images; {where}; confidence {seams.confidence:.2f}{band}"


def seams_table(seams: Seams) -> Table:
    """One row for each sub-image."""
    table = Table("view", "from (deg)", "to (deg)", "share (%)", box=None)
    for k, ((begin, end), share) in enumerate(zip(np.degrees(seams.sectors), seams.shares, strict=True)):
        table.add_row(str(k), f"{begin:.2f}", f"{end:.2f}", f"{100 * share:.1f}")
    return table


def say_comparison(comparison: Reconciliation) -> None:
    """Tell how the sub-images compare with the setup."""
    table = Table("sub-image", "view of the setup", "of its pixels (%)", box=None)
    for k, (view, overlap) in enumerate(zip(comparison.order, comparison.overlap, strict=True)):
        table.add_row(str(k), str(view) if view >= 0 else "none", f"{100 * overlap:.1f}")
    console.print(table)
    if np.isfinite(comparison.distance):
        console.print(
            f"seams found less those of the setup: shift ({comparison.offset[0]:.2f}, {comparison.offset[1]:.2f}) px, "
            f"turn {np.degrees(comparison.rotation):.3f} degrees; largest distance {comparison.distance:.2f} px"
        )
    if comparison.message:
        console.print(f"warning: {comparison.message}", style="yellow")


def seams_as_json(seams: Seams, photos: Sequence[Path]) -> dict:
    """What regions.json holds."""
    return {
        "photographs": [path.name for path in photos],
        "size_px": list(seams.size),
        "apex_px": seams.apex.tolist(),
        "angles_deg": np.degrees(seams.angles).tolist(),
        "sectors_deg": np.degrees(seams.sectors).tolist(),
        "shares": seams.shares.tolist(),
        "band_px": _known(seams.band),
        "confidence": seams.confidence,
        "trusted": seams.trusted,
        "message": seams.message,
    }


def comparison_as_json(comparison: Reconciliation) -> dict:
    """What regions.json holds about a setup."""
    return {
        "view_of_sub_image": comparison.order.tolist(),
        "overlap": comparison.overlap.tolist(),
        "offset_px": [_known(value) for value in comparison.offset],
        "rotation_deg": _known(np.degrees(comparison.rotation)),
        "largest_distance_px": _known(comparison.distance),
        "agrees": comparison.agrees,
        "message": comparison.message,
    }


def _known(value):
    return float(value) if np.isfinite(value) else None
