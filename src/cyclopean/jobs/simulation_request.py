"""What a person asks of `cyclopean simulate`."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ..errors import OutputError, SetupError
from ..simulation.sensor import Sensor

ENDINGS = (".png", ".tif", ".tiff")
PREVIEW_SAMPLES = 2
_LARGEST = 2**63 - 1
_MOST_PHOTOGRAPHS = 1000


@dataclass(frozen=True)
class Request:
    """What the person asked for; see `cyclopean simulate`."""

    setup: Path
    sensor: Sensor
    scene: Path | None = None
    output: Path | None = None
    depths: tuple[float, float] | None = None
    samples: int = 16
    colour: bool = False
    bandwidth_nm: float = 0.0
    coating_percent: float | None = None
    vignetting: bool = False
    without_optic: bool = False
    seed: int = 0
    truth: bool = True
    matches: int = 2000
    preview: bool = False
    calibration: int | None = None
    direct: int = 0
    board: Path | None = None
    write_scene: Path | None = None

    @property
    def options(self) -> dict[str, object]:
        """What the renderer is told."""
        return {
            "samples": min(self.samples, PREVIEW_SAMPLES) if self.preview else self.samples,
            "colour": self.colour,
            "bandwidth_nm": self.bandwidth_nm,
            "coating": None if self.coating_percent is None else self.coating_percent / 100,
            "natural_vignetting": self.vignetting,
            "seed": self.seed,
        }

    @property
    def photo(self) -> Path:
        """The photograph to write."""
        return self.output or Path("photo.png")

    @property
    def folder(self) -> Path:
        """The folder of calibration photographs."""
        return self.output or Path("calibration")


def check(request: Request) -> None:
    """Options that make no sense, or do not go together."""
    for name, value, least, most in (
        ("--samples", request.samples, 1, _LARGEST),
        ("--matches", request.matches, 0, _LARGEST),
        ("--direct", request.direct, 0, _MOST_PHOTOGRAPHS),
        ("--calibration", request.calibration or 0, 0, _MOST_PHOTOGRAPHS),
        ("--seed", request.seed, 0, _LARGEST),
        ("--bandwidth", request.bandwidth_nm, 0, np.inf),
    ):
        if not (least <= value <= most and value < np.inf):
            wanted = f"{most:g} or less" if most < value < np.inf else f"{least} or more"
            raise SetupError(f"{name} must be {wanted}, got {value:g}")
    if request.coating_percent is not None and not 0 <= request.coating_percent < 100:
        raise SetupError(
            f"--coating is a loss in percent, 0 or more and below 100, such as 0.5, got {request.coating_percent:g}"
        )
    if request.calibration is None:
        _check_photograph(request)
    else:
        _check_calibration(request)


def _check_photograph(request: Request) -> None:
    for option, value in (("--board", request.board), ("--direct", request.direct)):
        if value:
            raise SetupError(f"{option} belongs to --calibration N, the number of photographs of the board")
    if request.write_scene is not None and request.scene is not None:
        raise SetupError("--write-scene writes a scene to begin with, --scene reads yours: give one of them")
    if request.scene is not None and request.depths is not None:
        raise SetupError("--depth is for --calibration, or where there is no --scene: a scene says where it stands")
    if request.photo.suffix.lower() not in ENDINGS:
        raise OutputError(
            f"{request.photo}: a photograph is written without loss, so its name must end in {', '.join(ENDINGS)}"
        )
    if request.photo.is_dir():
        raise OutputError(f"{request.photo} is a folder; name a file in it, such as {request.photo / 'photo.png'}")


def _check_calibration(request: Request) -> None:
    if request.scene is not None or request.write_scene is not None:
        raise SetupError("--calibration photographs a board, not a scene: leave --scene and --write-scene out")
    if request.without_optic:
        raise SetupError("--calibration looks through the optic; --direct M adds photographs without it")
    if request.preview:
        raise SetupError("--preview is for one photograph; with --calibration give fewer --samples")
    if request.calibration is not None and request.calibration + request.direct < 1:
        raise SetupError(f"--calibration wants a number of photographs, 1 or more, got {request.calibration}")
    if request.folder.suffix.lower() in ENDINGS:
        raise OutputError(f"{request.folder}: --calibration writes many photographs: name a folder")
