"""The app that every command registers on, and what commands share."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import cyclopts
from cyclopts import Parameter

from cyclopean import __version__

from ..errors import SetupError
from ..jobs.words import Whole

__all__ = ["OutFolder", "SetupFile", "SetupFiles", "Whole", "app", "parse_depths"]

app = cyclopts.App(
    name="cyclopean",
    version=__version__,
    suppress_keyboard_interrupt=False,
    help="Stereo vision with a single lens: depth and points from one photograph through a prism or mirrors.",
)

SetupFile = Annotated[Path, Parameter(name=["--setup", "-s"])]
SetupFiles = Annotated[list[Path], Parameter(name=["--setup", "-s"], negative="")]
OutFolder = Annotated[Path, Parameter(name=["--output", "-o"])]


def parse_depths(text: str | None) -> tuple[float, float] | None:
    """The depth range that NEAR..FAR stands for, mm."""
    if text is None:
        return None
    try:
        near, far = (float(part) for part in text.split(".."))
    except ValueError:
        raise SetupError(f"--depth wants NEAR..FAR in mm, for example 600..1600, got {text!r}") from None
    if not 0 < near < far < float("inf"):
        raise SetupError(f"--depth wants 0 < NEAR < FAR in mm, got {text!r}")
    return near, far
