"""The tables of a scene file: their keys, and what each key takes.

Only read when a scene file is, since pydantic is slow to import. The descriptions end up in messages.
"""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field, model_validator

from ..simulation.paints import BRIGHT, DARK
from ..simulation.prints import BLACK, WHITE
from .meshes import UNITS

Number = Annotated[float, Field(strict=True, allow_inf_nan=False, ge=-1e9, le=1e9)]
Light = Annotated[float, Field(strict=True, allow_inf_nan=False, ge=0, le=1e6)]
Length = Annotated[float, Field(strict=True, allow_inf_nan=False, gt=0, le=1e7)]
Share = Annotated[float, Field(strict=True, allow_inf_nan=False, ge=0, le=1)]
Text = Annotated[str, Field(strict=True, min_length=1)]
Place = tuple[Number, Number, Number]

MM_ABOVE_0 = "a number of mm above 0"
SIZE = "two numbers of mm above 0, [width, height]"
SHARE = "a number from 0 (black) to 1 (white)"
LIGHT = "a number of 0 or more; 1 is the light in which a white matte surface has the value 1"
UNIT = f"one of {', '.join(UNITS)}"
FILE = "the name of a file, beside the scene file"


class Table(BaseModel):
    """A table of the file."""

    model_config = ConfigDict(extra="forbid")


class LampTable(Table):
    """[[light.lamp]]"""

    position_mm: Place | None = Field(None, description="three numbers of mm, [x, y, z]")
    direction: Place | None = Field(None, description="three numbers, [x, y, z]: where parallel light goes")
    strength: Light = Field(1.0, description=LIGHT)
    distance_mm: Length | None = Field(None, description=f"{MM_ABOVE_0}, at which the strength holds")
    shadows: bool = Field(True, strict=True, description="true or false")

    @model_validator(mode="after")
    def _one_place(self):
        if (self.position_mm is None) == (self.direction is None):
            raise ValueError("give one of position_mm, where a lamp stands, and direction, where parallel light goes")
        if self.direction is not None and not any(self.direction):
            raise ValueError("direction = [0, 0, 0] is no direction")
        return self


class LightTable(Table):
    """[light]"""

    ambient: Light = Field(1.0, description=LIGHT)
    background: Light | tuple[Light, Light, Light] = Field(0.0, description=f"{LIGHT}; or three, [red, green, blue]")
    lamp: list[LampTable] = Field([], description="tables [[light.lamp]], each with position_mm or direction")


class ObjectTable(Table):
    """[[object]]: what all kinds have."""

    kind: str
    name: str = Field("", strict=True, description="a text in quotes")
    rotation_deg: Place = Field((0.0, 0.0, 0.0), description="three numbers of degrees, [x, y, z]: a rotation vector")
    luminous: bool = Field(False, strict=True, description="true or false: whether it shines by itself")


class PaintedTable(ObjectTable):
    """Objects with a texture."""

    texture: Text | None = Field(
        None, description='"speckle", "noise" or "checker", or the name of a picture file beside the scene file'
    )
    texture_size_mm: Length | tuple[Length, Length] | None = Field(
        None, description=f"{MM_ABOVE_0}, of a dot, grain, square or repeated picture; for a picture also two"
    )
    dark: Share = Field(DARK, description=SHARE)
    bright: Share = Field(BRIGHT, description=SHARE)
    seed: Annotated[int, Field(strict=True, ge=0, lt=2**63)] | None = Field(
        None, description="a whole number of 0 or more"
    )
    linear: bool = Field(
        False, strict=True, description="true or false: whether the picture's values are proportional to light"
    )
    grey: Share | None = Field(None, description=SHARE)
    color: tuple[Share, Share, Share] | None = Field(
        None, description="three numbers from 0 to 1, [red, green, blue], in linear light"
    )

    @model_validator(mode="after")
    def _one_paint(self):
        given = [name for name in ("texture", "grey", "color") if getattr(self, name) is not None]
        if len(given) > 1:
            raise ValueError(f"give one of texture, grey and color, not {' and '.join(given)}")
        if self.texture in TEXTURES and isinstance(self.texture_size_mm, tuple):
            raise ValueError(f'texture_size_mm of "{self.texture}" is one number of mm')
        if self.texture is None and self.texture_size_mm is not None:
            raise ValueError("texture_size_mm needs a texture")
        return self


class PlaneTable(PaintedTable):
    """kind = "plane" """

    kind: Literal["plane"]
    size_mm: tuple[Length, Length] = Field(description=SIZE)
    centre_mm: Place = Field(description="three numbers of mm, [x, y, z]")


class BoxTable(PaintedTable):
    """kind = "box" """

    kind: Literal["box"]
    size_mm: tuple[Length, Length, Length] = Field(description="three numbers of mm above 0, [width, height, depth]")
    centre_mm: Place = Field(description="three numbers of mm, [x, y, z]")


class SphereTable(PaintedTable):
    """kind = "sphere" """

    kind: Literal["sphere"]
    radius_mm: Length = Field(description=MM_ABOVE_0)
    centre_mm: Place = Field(description="three numbers of mm, [x, y, z]")


class CylinderTable(PaintedTable):
    """kind = "cylinder" """

    kind: Literal["cylinder"]
    radius_mm: Length = Field(description=MM_ABOVE_0)
    length_mm: Length = Field(description=f"{MM_ABOVE_0}, along y before it is turned")
    centre_mm: Place = Field(description="three numbers of mm, [x, y, z]")


class MeshTable(PaintedTable):
    """kind = "mesh" """

    kind: Literal["mesh"]
    file: Text = Field(description=f"{FILE}: STL, PLY, OBJ, GLB or OFF")
    unit: Literal["mm", "cm", "m", "inch"] = Field("mm", description=UNIT)
    centre_mm: Place | None = Field(
        None, description="three numbers of mm, [x, y, z]: where the middle of its box goes; the file's place without"
    )


class HeightmapTable(PaintedTable):
    """kind = "heightmap" """

    kind: Literal["heightmap"]
    file: Text = Field(description=f"{FILE}: a grey picture")
    size_mm: tuple[Length, Length] = Field(description=SIZE)
    height_mm: Number = Field(description="a number of mm: how far white stands out towards the viewer")
    centre_mm: Place = Field(description="three numbers of mm, [x, y, z]: of the black level")


class BoardTable(ObjectTable):
    """kind = "board" """

    kind: Literal["board"]
    file: Text | None = Field(None, description=f"{FILE}: a board file")
    board: dict[str, Any] | None = Field(None, description="a table with kind, columns, rows and square")
    centre_mm: Place = Field(description="three numbers of mm, [x, y, z]: of the middle of the sheet")
    black: Share = Field(BLACK, description=SHARE)
    white: Share = Field(WHITE, description=SHARE)

    @model_validator(mode="after")
    def _one_board(self):
        if (self.file is None) == (self.board is None):
            raise ValueError(
                'give one of file, the name of a board file, and board, such as { kind = "chessboard", … }'
            )
        return self


class SceneFile(BaseModel):
    """The whole file."""

    model_config = ConfigDict(extra="forbid")

    light: LightTable = Field(
        LightTable.model_validate({}), description="a table, with ambient, background and [[light.lamp]]"
    )
    object: Annotated[
        list[
            Annotated[
                PlaneTable | BoxTable | SphereTable | CylinderTable | MeshTable | HeightmapTable | BoardTable,
                Field(discriminator="kind"),
            ]
        ],
        Field(min_length=1),
    ] = Field(description="one or more tables [[object]], each with a kind")


TEXTURES = ("speckle", "noise", "checker")
OBJECTS: dict[str, type[ObjectTable]] = {
    "plane": PlaneTable,
    "box": BoxTable,
    "sphere": SphereTable,
    "cylinder": CylinderTable,
    "mesh": MeshTable,
    "heightmap": HeightmapTable,
    "board": BoardTable,
}
