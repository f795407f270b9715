"""The command line: ``cyclopean reconstruct``, ``demo``, ``info``, ``split``."""

from __future__ import annotations

import os
import sys
from pathlib import Path
from typing import Annotated, Literal

# heavy modules are imported inside the commands, so that --help answers at once
import cyclopts
from cyclopts import Parameter

from cyclopean import __version__

from .errors import CyclopeanError, SetupError

app = cyclopts.App(
    name="cyclopean",
    version=__version__,
    suppress_keyboard_interrupt=False,
    help="Stereo vision with a single lens: depth and points from one photograph through a prism or mirrors.",
)

SetupFile = Annotated[Path, Parameter(name=["--setup", "-s"])]
OutFolder = Annotated[Path, Parameter(name=["--output", "-o"])]


@app.command
def reconstruct(
    photo: Path,
    *,
    setup: SetupFile,
    output: OutFolder = Path("out"),
    depth: str | None = None,
    step: float = 0.5,
    memory: float = 1024,
    threads: int | None = None,
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
    from .jobs import run_reconstruction

    run_reconstruction(photo, setup, output, parse_depths(depth), step, memory, threads, channel)


@app.command
def demo(*, output: OutFolder = Path("out/demo"), threads: int | None = None) -> None:
    """Reconstruct the photograph that comes with the package.

    Parameters
    ----------
    output
        Folder for the results.
    threads
        Threads to use; all cores without it.
    """
    from .jobs import demo_files, run_reconstruction

    photo, setup = demo_files()
    run_reconstruction(photo, setup, output, None, 0.5, 1024, threads)


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
    from .jobs import print_info

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
    from .jobs import split_photograph

    split_photograph(photo, setup, output)


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


def main() -> None:
    """Run the command line; errors are one clear message and exit status 2, never a traceback."""
    try:
        app(sys.argv[1:])
    except CyclopeanError as error:
        _fail(str(error), 2)
    except KeyboardInterrupt:
        _fail("interrupted; results that were complete have been kept", 130)
    except BrokenPipeError:
        sys.stdout = open(os.devnull, "w")  # noqa: SIM115  the reader has gone: nothing more to say
        sys.exit(1)
    except MemoryError:
        _fail("not enough memory; try a smaller --memory, a narrower --depth or a larger --step", 3)
    except Exception as error:
        if os.environ.get("CYCLOPEAN_DEBUG"):
            raise
        _fail(
            f"this is a fault of cyclopean, please report it: {type(error).__name__}: {error} "
            "(set CYCLOPEAN_DEBUG=1 for the traceback)",
            70,
        )


def _fail(message: str, status: int) -> None:
    print(f"cyclopean: {message}", file=sys.stderr)
    sys.exit(status)
