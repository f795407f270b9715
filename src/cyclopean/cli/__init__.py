"""The command line: ``cyclopean COMMAND``, one module for each group of commands."""

from __future__ import annotations

import os
import sys

# heavy modules are imported inside the commands, so that --help answers at once
from ..errors import CalibrationError, CyclopeanError
from . import (  # noqa: F401  they register their commands
    boards,
    calibration,
    camera,
    comparison,
    design,
    epipolar,
    errors,
    exchange,
    experiments,
    field_of_view,
    matches,
    measurement,
    reconstruction,
    regions,
    setups,
    simulation,
    tolerances,
    workshop,
)
from .app import app, parse_depths

__all__ = ["app", "main", "parse_depths"]


def main() -> None:
    """Run the command line; errors are one clear message and exit status 2, never a traceback.

    The status is 1 where all was asked for rightly, but a calibration failed.
    """
    try:
        app(sys.argv[1:])
    except CalibrationError as error:
        _fail(str(error), 1)
    except CyclopeanError as error:
        _fail(str(error), 2)
    except KeyboardInterrupt as stop:
        _fail(f"interrupted; {stop}" if str(stop) else "interrupted", 130)
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
