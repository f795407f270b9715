"""The camera of a TOML file: one that `write_camera` wrote, or the [camera] table of a setup file."""

from __future__ import annotations

from decimal import Decimal

from ..cameras import Camera
from ..errors import SetupError
from .disk import PathLike, parse_toml, read_text


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

    document = parse_toml(read_text(path, "camera file"), path, Decimal)
    if "camera" not in document:
        raise SetupError(f"{path}: there is no [camera] table; `cyclopean import` makes one of other programs' files")
    try:
        return CameraFile.model_validate(document).camera.build()
    except ValidationError as error:
        raise SetupError("\n  ".join([f"{path}:", *sentences(error, document)])) from None
