"""The table of a board file: its keys for each kind of board, and what each key takes.

Only read when a board file is, since pydantic is slow to import. The descriptions end up in messages.
"""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field

Count = Annotated[int, Field(strict=True, ge=1, le=1000)]
Length = Annotated[float, Field(gt=0, le=100_000, allow_inf_nan=False, strict=True)]

COUNT = "a whole number from 1 to 1000"
MM = "a number of mm above 0"
DICTIONARY = 'the name of one of OpenCV\'s dictionaries, such as "DICT_5X5_250"'


class _Table(BaseModel):
    model_config = ConfigDict(extra="forbid")

    name: str = Field("", description="a text in quotes", strict=True)


class _Grid(_Table):
    columns: Count = Field(description=COUNT)
    rows: Count = Field(description=COUNT)


class ChessboardTable(_Grid):
    """kind = "chessboard" """

    kind: Literal["chessboard"]
    square: Length = Field(description=f"{MM}, the side of a square")


class CharucoTable(_Grid):
    """kind = "charuco" """

    kind: Literal["charuco"]
    square: Length = Field(description=f"{MM}, the side of a square")
    marker: Length = Field(description=f"{MM}, the side of a marker")
    dictionary: str = Field(description=DICTIONARY, strict=True)
    legacy: bool = Field(False, description="true or false: whether OpenCV before 4.6 drew it", strict=True)


class CirclesTable(_Grid):
    """kind = "circles" or "asymmetric_circles" """

    kind: Literal["circles", "asymmetric_circles"]
    square: Length = Field(description=f"{MM}, the spacing of the circles")
    marker: Length | None = Field(None, description=f"{MM}, the diameter of a circle")


class TagsTable(_Grid):
    """kind = "apriltags" """

    kind: Literal["apriltags"]
    square: Length = Field(description=f"{MM}, from one tag to the next")
    marker: Length = Field(description=f"{MM}, the side of a tag")
    dictionary: str | None = Field(None, description=DICTIONARY, strict=True)


class PointsTable(_Table):
    """kind = "points" """

    kind: Literal["points"]
    file: str = Field(description="the name of a CSV file with the columns id,x,y,z", strict=True)


class BoardFile(BaseModel):
    """The whole file."""

    model_config = ConfigDict(extra="forbid")

    board: Annotated[
        ChessboardTable | CharucoTable | CirclesTable | TagsTable | PointsTable, Field(discriminator="kind")
    ] = Field(description="a table, [board], with kind, columns, rows and square")


BOARDS: dict[str, type[_Table]] = {
    "charuco": CharucoTable,
    "chessboard": ChessboardTable,
    "circles": CirclesTable,
    "asymmetric_circles": CirclesTable,
    "apriltags": TagsTable,
    "points": PointsTable,
}
