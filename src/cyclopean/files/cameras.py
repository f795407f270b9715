"""The camera of a TOML file: one that `write_camera` wrote, or the [camera] table of a setup file."""

from __future__ import annotations

import tomllib
from decimal import Decimal

from ..cameras import Camera
from ..errors import SetupError
from .disk import PathLike, read_bytes


def read_camera(path: PathLike) -> Camera:
    """Read the [camera] table of a file; other tables are left unread.

    Raises
    ------
    SetupError
        With one line for each thing that is wrong in the table.
    """
    from pydantic import BaseModel, Field, ValidationError

    from .faults import sentences
    from .tables import CameraTable

    class CameraFile(BaseModel):
        camera: CameraTable = Field(description="a table, with size_px and focal_px")

    data = read_bytes(path, SetupError)
    try:
        document = tomllib.loads(data.decode("utf-8-sig"), parse_float=Decimal)
    except UnicodeDecodeError:
        raise SetupError(f"{path}: this is no text (UTF-8), so it is no camera file") from None
    except (ValueError, RecursionError) as fault:
        raise SetupError(f"{path}: this is not TOML: {fault}") from None
    if "camera" not in document:
        raise SetupError(f"{path}: there is no [camera] table; `cyclopean import` makes one of other programs' files")
    try:
        return CameraFile.model_validate(document).camera.build()
    except ValidationError as error:
        raise SetupError("\n  ".join([f"{path}:", *sentences(error, document)])) from None
