"""Command ``match``: the same points in all sub-images of a photograph."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

from ..errors import SetupError
from .app import OutFolder, SetupFile, Whole, app, parse_depths


@app.command
def match(
    photo: Path,
    *,
    setup: SetupFile,
    output: OutFolder = Path("matches"),
    detector: Literal["sift", "orb", "akaze"] | None = None,
    points: Path | None = None,
    board: Path | None = None,
    depth: str | None = None,
    min_views: Whole = 2,
    noise_px: float | None = None,
    max_ambiguity: float | None = None,
    refine: bool = True,
) -> None:
    """Match single points between the sub-images: features, your own points, or those of a board.

    Writes matches.csv, points.ply, matches.png and report.html.

    Parameters
    ----------
    photo
        The photograph.
    setup
        Setup file (TOML).
    output
        Folder for the results.
    detector
        Features to look for; sift where neither points nor a board are given.
    points
        Points to match instead of features (CSV with the columns view, x, y). Those of one view alone are looked
        for in the others by the picture around them.
    board
        Board file (TOML): its points are matched by name.
    depth
        Depth range, mm, as NEAR..FAR; the setup's, or the rig's working depths, without it.
    min_views
        Views that must show a point.
    noise_px
        Standard deviation of a pixel coordinate, px: noise of the points, and what the setup may be off. Without it
        0.1; for features that of the detector while matching (sift and akaze 0.3, orb 0.6) and 0.1 once refined.
    max_ambiguity
        Matches whose best rival is likelier than this share of their own likelihood are left out, 0 to 1; 0.2 without
        it. Not for points of one view alone.
    refine
        Shift the pixels of features until all views show the same there.
    """
    from ..jobs.matches import Request, run_match

    given = [name for name, value in (("detector", detector), ("points", points), ("board", board)) if value]
    if len(given) > 1:
        raise SetupError(f"give one of --detector, --points and --board, got --{' and --'.join(given)}")
    if noise_px is not None and not 0 < noise_px < float("inf"):
        raise SetupError(f"--noise-px must be a number of px above 0, got {noise_px:g}")
    if max_ambiguity is not None and not 0 <= max_ambiguity <= 1:
        raise SetupError(f"--max-ambiguity must be a number from 0 to 1, got {max_ambiguity:g}")
    if min_views < 2:
        raise SetupError(f"--min-views must be 2 or more, got {min_views}")
    request = Request(
        detector or "sift", points, board, parse_depths(depth), min_views, noise_px, max_ambiguity, refine
    )
    run_match(photo, setup, output, request)
