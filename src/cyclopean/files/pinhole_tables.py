"""The tables of a file of virtual cameras; only read when such a file is, since pydantic is slow to import."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from .tables import Number, Pixels, Positive, Table, Whole

Corner = tuple[Number, Number]
Polygon = Annotated[list[Corner], Field(min_length=3)]


class ViewTable(Table):
    """[[view]]"""

    name: Annotated[str, Field(strict=True)] = Field("", description="a text")
    focal_px: tuple[Positive, Positive] = Field(description="two numbers of px above 0, [x, y]")
    centre_px: tuple[Number, Number] = Field(description="two numbers of px, [x, y]")
    distortion: tuple[Number, Number, Number, Number, Number] = Field(
        (0.0,) * 5, description="five numbers, [k1, k2, p1, p2, k3]"
    )
    rotation_deg: tuple[Number, Number, Number] = Field(
        description="three numbers of degrees, a rotation vector from the rig's frame to the view's camera"
    )
    translation_mm: tuple[Number, Number, Number] = Field(
        description="three numbers of mm, from the rig's frame to the view's camera"
    )
    mirrored: Annotated[bool, Field(strict=True)] = Field(False, description="true or false")
    margin_px: Annotated[Number, Field(ge=0)] = Field(0.0, description="a number of px, 0 or more")
    shot: Whole = Field(0, description="a whole number, 0 or more")
    channel: Whole | None = Field(None, description="a whole number, 0 or more")
    region_px: list[Polygon] = Field(description="polygons, each of three corners [x, y] px or more")


class RigTable(Table):
    """The file."""

    kind: Literal["virtual cameras"] = Field(description='"virtual cameras"')
    size_px: tuple[Pixels, Pixels] = Field(description="two whole numbers of px from 1 to 100000, [width, height]")
    view: Annotated[list[ViewTable], Field(min_length=1)] = Field(description="one table [[view]] or more")
