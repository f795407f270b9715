"""Talking to the person at the terminal, and what all commands share."""

from __future__ import annotations

import sys
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

from rich.console import Console

from ..errors import OutputError, SetupError

if TYPE_CHECKING:
    from ..rigs import Rig, Setup

_AT_TERMINAL = sys.stdout is not None and sys.stdout.isatty()
console = Console(highlight=False, markup=False, width=None if _AT_TERMINAL else 110)  # names may hold [ ]


def counted(count: int, what: str) -> str:
    """A number of things: "1 photograph", "2 photographs"."""
    return f"{count:,} {what}{'' if count == 1 else 's'}"


def chosen_depths(asked: tuple[float, float] | None, setup: Setup, rig: Rig) -> tuple[float, float]:
    """The depths (near, far) mm that were asked for, else the setup's, else those at which its rig is of use."""
    return rig.check_depths(asked if asked is not None else setup.depths or rig.working_depths)


def save_figure(figure, path: Path) -> None:
    """Write a figure as PNG, or raise OutputError."""
    try:
        figure.savefig(path)
    except OSError as error:
        raise OutputError(f"cannot write {path}: {error.strerror or error}") from error


def use_threads(threads: int | None) -> None:
    """Limit the threads of compiled kernels and of OpenCV."""
    if threads is None:
        return
    import cv2
    import numba

    if not 1 <= threads <= numba.config.NUMBA_NUM_THREADS:
        raise SetupError(f"--threads must lie between 1 and {numba.config.NUMBA_NUM_THREADS}, got {threads}")
    numba.set_num_threads(threads)
    cv2.setNumThreads(threads)


@contextmanager
def naming(files: list[Path]):
    """Names, where the work is interrupted, those of the files that are there by then."""
    try:
        yield
    except KeyboardInterrupt:
        there = ", ".join(str(path) for path in files if path.exists())
        raise KeyboardInterrupt(f"complete and kept: {there}" if there else "") from None


@contextmanager
def progress_bars():
    """A callable (what, done, total) that shows one bar for each `what`."""
    from rich.progress import BarColumn, Progress, TaskID, TextColumn, TimeElapsedColumn, TimeRemainingColumn

    columns = (TextColumn("{task.description}"), BarColumn(), TimeElapsedColumn(), TimeRemainingColumn())
    tasks: dict[str, TaskID] = {}
    with Progress(*columns, console=console) as bars:

        def show(what, done, total):
            if what not in tasks:
                tasks[what] = bars.add_task(what, total=total)
            bars.update(tasks[what], completed=done, total=total)

        yield show
