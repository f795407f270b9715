"""What a person may choose of an experiment."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from .words import Whole


@dataclass(frozen=True)
class Options:
    """What an experiment is made of.

    Parameters
    ----------
    baseline
        Between the optical centres of neighbouring virtual cameras, mm; the prism is placed for it. 40 for two and
        three facets and 45 for others, without it.
    apex_deg
        Angle between the prism's flat face and each facet, degrees; 12 for two and three facets, 15 for others.
    glass
        Name of a glass, or an index.
    setup
        Setup file (TOML) of what stands on the bench, with any camera and prism, instead of the three above.
    data
        Folder that holds the renderer's photographs (mitsuba/), instead of computed corners.
    depths
        Depths of the target, mm: 600,700,800,...
    corner_noise_px
        Standard deviation of each coordinate of a computed corner, px.
    seed
        Of the noise.
    photos
        How many of the board to calibrate from are computed, without the prism and through it.
    board_stays
        The board stands still while the prism is put on, so that virtual cameras are calibrated in the real camera's
        frame.
    drawing_apex_deg
        By how much the drawing's facet angle is too large, degrees.
    drawing_distance
        By how much the drawing's distance is too large, mm.
    drawing_tilt_deg
        By how much the prism is drawn tilted though it is not, degrees.
    approaches
        The usual six, or all of them.
    """

    baseline: float | None = None
    apex_deg: float | None = None
    glass: str = "N-BK7"
    setup: Path | None = None
    data: Path | None = None
    depths: str | None = None
    corner_noise_px: float = 0.05
    seed: Whole = 0
    photos: Whole = 8
    board_stays: bool = False
    drawing_apex_deg: float = 0.05
    drawing_distance: float = 1.0
    drawing_tilt_deg: float = 0.2
    approaches: Literal["usual", "all"] = "usual"
