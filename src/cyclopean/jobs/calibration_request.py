"""What a person asks of `cyclopean calibrate`, and what their words mean."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from ..errors import SetupError
from ..targets import Observations
from .calibration_photographs import COLOURS

if TYPE_CHECKING:
    from ..rigs import Setup


@dataclass(frozen=True)
class Request:
    """What the person asked for; see `cyclopean calibrate`."""

    photos: Sequence[Path]
    board: Path
    setup: Path | None
    output: Path
    report: Path | None = None
    camera_photos: Sequence[Path] = ()
    camera_board: Path | None = None
    corners: Path | None = None
    save_corners: Path | None = None
    free: Sequence[str] = ()
    hold: Sequence[str] = ()
    tolerance: Sequence[str] = ()
    facets: int | None = None
    glass: str | None = None
    camera: Path | None = None
    depths: tuple[float, float] | None = None
    validate: bool = True
    guide: bool = True
    channel: str = "all"
    compare: bool = False

    @property
    def channels(self) -> tuple[str, ...]:
        """The colours to look at, one after the other."""
        return COLOURS if self.channel == "each" else (self.channel,)

    @property
    def folder(self) -> Path:
        """Where the report goes."""
        return self.report or self.output.with_name(f"{self.output.stem}_report")

    @property
    def outputs(self) -> list[Path]:
        """The setup files to write, one for each colour."""
        if len(self.channels) == 1:
            return [self.output]
        return [self.output.with_name(f"{self.output.stem}_{name}{self.output.suffix}") for name in self.channels]


def check(request: Request) -> None:
    """Options that do not go together."""
    if request.corners is not None and (request.photos or request.camera_photos):
        raise SetupError("give photographs or --corners, not both: the corners file holds what photographs show")
    if request.corners is None and not request.photos:
        swallowed = "; photographs after --camera-photos count as taken without it" if request.camera_photos else ""
        raise SetupError(
            f"which photographs? name those of the board through the optic, or their folder, or --corners{swallowed}"
        )
    if request.setup is None and request.facets is None:
        raise SetupError(
            "what is in front of the lens? give a nominal setup file (--setup), or --facets for a prism without a "
            "drawing"
        )
    if request.setup is not None and (request.facets is not None or request.glass is not None):
        raise SetupError("--facets and --glass describe a prism without a drawing; the setup file says them already")
    if request.corners is not None and request.facets is not None and request.camera is None:
        raise SetupError("--corners with --facets needs --camera: corners do not say how large the photograph is")
    if request.camera_board is not None and not request.camera_photos:
        raise SetupError("--camera-board is the board of --camera-photos: give those as well")
    if request.output.suffix.lower() != ".toml":
        raise SetupError(f"{request.output}: the calibrated setup is a .toml file; name the output so")
    given = [path.absolute() for path in (request.setup, request.camera, request.board) if path is not None]
    for path in request.outputs:
        if path.absolute() in given:
            raise SetupError(f"{path}: the output would overwrite a file that was given; choose another name")


def check_names(request: Request, setup: Setup) -> None:
    """Raise SetupError before the work where parameters do not exist, or a tolerance is given for a held one."""
    from ..calibration.unknowns import Unknowns

    tolerances = parse_tolerances(request.tolerance, setup)
    Unknowns.of([setup], (*request.free, *request.hold, *tolerances), tolerances)
    if request.free:
        colours = ("optic.index",) if request.channel == "each" and "optic.index" in setup.parameter_names else ()
        Unknowns.of([setup], (*request.free, *colours), tolerances)


def free_names(
    request: Request, setup: Setup, observations: Observations, more: tuple[str, ...] = ()
) -> tuple[str, ...]:
    """Names of what to find: as asked for, or what is usual and `more`."""
    from ..calibration.physical import default_free
    from ..calibration.unknowns import Unknowns

    free = tuple(request.free) or default_free(setup, observations) + more
    if request.channel == "each" and "optic.index" in setup.parameter_names:
        free += ("optic.index",)
    if not request.hold:
        return free
    names = Unknowns.of([setup], free).names
    held = Unknowns.of([setup], request.hold).names
    idle = [name for name in held if name not in names]
    if len(idle) == len(held):
        raise SetupError(f"--hold {', '.join(request.hold)}: held anyway; found are {', '.join(names)}")
    return tuple(name for name in names if name not in held)


def parse_tolerances(given: Sequence[str], setup: Setup) -> dict[str, float]:
    """Standard deviations (mm, rad, px) by name, of texts NAME=VALUE in mm, degrees and px."""
    from ..calibration.unknowns import GROUPS, Unknowns, kind_of

    tolerances = {}
    for text in given:
        name, _, value = (part.strip() for part in text.partition("="))
        number = re.fullmatch(r"([-+.\deE]+) *(mm|deg|px)?", value)
        try:
            spread = float(number[1]) if number else np.nan
        except ValueError:
            spread = np.nan
        if not 0 < spread < np.inf:
            raise SetupError(f"--tolerance wants NAME=VALUE, for example optic.apex=0.1 (degrees), got {text!r}")
        kinds = {kind_of(full).unit: kind_of(full) for full in Unknowns.of([setup], [name]).names}
        if len(kinds) > 1:
            units = " and ".join(unit or "no unit" for unit in sorted(kinds))
            raise SetupError(
                f"--tolerance {text}: {name} holds parameters in {units}; give each its own: "
                f"{', '.join(full for full in setup.parameter_names if re.fullmatch(GROUPS[name], full))}"
            )
        ((unit, kind),) = kinds.items()
        if number is not None and number[2] not in (None, unit):
            raise SetupError(f"--tolerance {text}: {name} is in {unit or 'no unit'}, not in {number[2]}")
        tolerances[name] = spread / kind.factor
    return tolerances
