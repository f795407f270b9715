"""The tables of a setup file: their keys, and what each key takes.

Only read when a setup file is, since pydantic is slow to import. A key is the name of an argument of the class that
the table describes, with its unit: `distance_mm` is `Prism.distance`. Keys that are left out take that class's
defaults. The descriptions end up in messages: "optic.apex_deg = 95 must be a number of degrees between 0 and 90".
"""

from __future__ import annotations

from decimal import Decimal
from typing import Annotated, Any, Literal

from pydantic import AfterValidator, BaseModel, BeforeValidator, ConfigDict, Field, field_validator, model_validator

from ..cameras import Camera
from ..optics import Mirror, Mirrors, Plate, Prism, medium
from ..rigs import Setup


def _as_float(value: Any) -> Any:
    return float(value) if isinstance(value, Decimal) else value


def _as_int(value: Any) -> Any:
    return int(value) if isinstance(value, Decimal) and value.is_finite() and value == int(value) else value


def _as_decimal(value: Any) -> Any:
    return Decimal(value) if type(value) is int else value


def _known_medium(name: str) -> str:
    medium(name)
    return name


def _known_glass(name: str) -> str:
    if medium(name).formula == "constant":
        raise ValueError("is a medium without dispersion")
    return name


# Files are read with decimal numbers, so that micrometres become millimetres without a rounding.
Number = Annotated[float, BeforeValidator(_as_float), Field(strict=True, allow_inf_nan=False)]
Positive = Annotated[Number, Field(gt=0)]
Whole = Annotated[int, BeforeValidator(_as_int), Field(strict=True, ge=0)]
Pixels = Annotated[Whole, Field(ge=1, le=100_000)]
Index = Annotated[Number, Field(ge=1, le=5)]
Name = Annotated[str, Field(strict=True), AfterValidator(_known_medium)]
Dispersing = Annotated[str, Field(strict=True), AfterValidator(_known_glass)]
Micrometres = Annotated[Decimal, BeforeValidator(_as_decimal), Field(strict=True, gt=0, lt=10**6, allow_inf_nan=False)]

GLASS = 'the name of a glass, such as "N-BK7" (an index is a number and goes into the key index)'
INDEX = "a number from 1 to 5, relative to the surroundings (a name goes into the key glass)"
MEDIUM = 'the name of a medium, such as "water", or an index from 1 to 5'
MM = "a number of mm"
MM_ABOVE_0 = "a number of mm above 0"
TILT = "three numbers of degrees, [x, y, z]: a rotation vector in the camera's axes"


class Table(BaseModel):
    """A table of the file."""

    model_config = ConfigDict(extra="forbid")

    def arguments(self, *without: str) -> dict[str, Any]:
        """What the file gives of this table, as arguments of the class that it describes."""
        given = {key: value for key, value in self if key in self.model_fields_set}
        return {key.removesuffix("_mm"): value for key, value in given.items() if key not in ("kind", *without)}


class CameraTable(Table):
    """[camera]"""

    size_px: tuple[Pixels, Pixels] = Field(description="two whole numbers of px from 1 to 100000, [width, height]")
    focal_px: Positive | tuple[Positive, Positive] | None = Field(
        None, description="a number of px above 0, or two, [x, y]"
    )
    focal_mm: Positive | tuple[Positive, Positive] | None = Field(
        None, validate_default=True, description="a number of mm above 0, or two, [x, y]"
    )
    centre_px: tuple[Number, Number] | None = Field(None, description="two numbers of px, [x, y]")
    distortion: Annotated[tuple[Number, ...], Field(min_length=1, max_length=5)] | None = Field(
        None, description="one to five numbers, [k1, k2, p1, p2, k3]"
    )
    f_number: Positive | None = Field(None, description="a number above 0")
    focus_distance_mm: Positive | None = Field(None, description=MM_ABOVE_0)
    pixel_pitch_um: Micrometres | None = Field(
        None, validate_default=True, description="a number of micrometres above 0 and below 1000000"
    )

    @field_validator("focal_mm")
    @classmethod
    def _one_focal_length(cls, value, info):
        if "focal_px" in info.data and (value is None) == (info.data["focal_px"] is None):
            raise ValueError("give one of focal_px, a number of px, and focal_mm, a number of mm")
        return value

    @field_validator("pixel_pitch_um")
    @classmethod
    def _pitch_where_needed(cls, value, info):
        given = {key for key, other in info.data.items() if other is not None}
        if value is None and "focal_mm" in given:
            raise ValueError("focal_mm needs the distance between pixels, a number of micrometres above 0")
        if value is None and {"f_number", "focus_distance_mm"} <= given:
            raise ValueError(
                "f_number and focus_distance_mm need the distance between pixels, a number of micrometres above 0"
            )
        return value

    @model_validator(mode="after")
    def _in_focus(self):
        camera = self.build()
        if self.f_number is not None and self.focus_distance_mm is None:
            raise ValueError("f_number needs focus_distance_mm, to tell how wide seams blend; give both or neither")
        if camera.pixel_pitch is not None and self.focus_distance_mm is not None:
            focal = max(camera.focal) * camera.pixel_pitch
            if self.focus_distance_mm <= focal:
                raise ValueError(
                    f"focus_distance_mm must exceed the focal length, {focal:.4g} mm, got {self.focus_distance_mm:g}"
                )
        return self

    def build(self) -> Camera:
        """The camera of this table."""
        pitch = None if self.pixel_pitch_um is None else float(self.pixel_pitch_um.scaleb(-3))
        focal = self.focal_px
        if self.focal_mm is not None:
            assert pitch is not None  # _pitch_where_needed
            lengths = self.focal_mm if isinstance(self.focal_mm, tuple) else (self.focal_mm, self.focal_mm)
            focal = lengths[0] / pitch, lengths[1] / pitch
        distortion = (*(self.distortion or ()), 0.0, 0.0, 0.0, 0.0, 0.0)[:5]
        return Camera(self.size_px, focal, self.centre_px, distortion, pitch)  # type: ignore[arg-type]


class GlassTable(Table):
    """What a prism and a plate have in common."""

    glass: Name | None = Field(None, description=GLASS)
    index: Index | None = Field(None, validate_default=True, description=INDEX)
    distance_mm: Positive = Field(description=f"{MM_ABOVE_0}, from the pinhole to the glass along the axis")
    radius_mm: Positive | None = Field(None, description=f"{MM_ABOVE_0}, of the round outline")
    tilt_deg: tuple[Number, Number, Number] | None = Field(None, description=TILT)
    shift_mm: tuple[Number, Number] | None = Field(None, description="two numbers of mm, [x, y]")
    surroundings: Name | Index | None = Field(None, description=MEDIUM)

    @field_validator("index")
    @classmethod
    def _one_medium(cls, value, info):
        if "glass" in info.data and (value is None) == (info.data["glass"] is None):
            raise ValueError('give one of glass, a name such as "N-BK7", and index, a number from 1 to 5')
        return value

    @model_validator(mode="after")
    def _can_exist(self):
        self.build()
        return self

    def build(self) -> Prism | Plate:
        """The optic of this table."""
        raise NotImplementedError

    def _glass_arguments(self) -> dict[str, Any]:
        return {"glass": self.index if self.glass is None else self.glass, **self.arguments("glass", "index")}


class PrismTable(GlassTable):
    """[optic] with kind = "prism" """

    kind: Literal["prism"]
    facets: Annotated[Whole, Field(ge=2, lt=128)] = Field(description="a whole number from 2 to 127")
    apex_deg: Annotated[Number, Field(gt=0, lt=90)] = Field(
        description="a number of degrees between 0 and 90, from the flat face to each facet"
    )
    thickness_mm: Positive | None = Field(None, description=f"{MM_ABOVE_0}, from the flat face to the apex")
    facing: Literal["scene", "camera"] | None = Field(None, description='"scene" or "camera": where the facets look')
    azimuth_deg: Number | None = Field(None, description="a number of degrees, of facet 0")
    facet_deviation_deg: tuple[tuple[Number, Number], ...] | None = Field(
        None, description="a pair of degrees for each facet, [[angle, azimuth], ...]"
    )

    def build(self) -> Prism:
        """The prism of this table."""
        return Prism(**self._glass_arguments())


class PlateTable(GlassTable):
    """[optic] with kind = "plate" """

    kind: Literal["plate"]
    thickness_mm: Positive = Field(description=MM_ABOVE_0)
    beyond: Name | Index | None = Field(None, description=MEDIUM)

    def build(self) -> Plate:
        """The plate of this table."""
        return Plate(**self._glass_arguments())


class MirrorTable(Table):
    """[[optic.mirrors]]"""

    centre_mm: tuple[Number, Number, Number] = Field(description="three numbers of mm, [x, y, z]")
    normal: tuple[Number, Number, Number] = Field(description="three numbers, [x, y, z]: a direction of any length")
    size_mm: tuple[Positive, Positive] | None = Field(None, description="two numbers of mm above 0")
    tilt_deg: tuple[Number, Number] | None = Field(None, description="two numbers of degrees, about its two edges")
    advance_mm: Number | None = Field(None, description=f"{MM}, along the normal")

    @model_validator(mode="after")
    def _can_exist(self):
        self.build()
        return self

    def build(self) -> Mirror:
        """The mirror of this table."""
        return Mirror(**self.arguments())


class MirrorsTable(Table):
    """[optic] with kind = "mirrors" """

    kind: Literal["mirrors"]
    mirrors: Annotated[list[MirrorTable], Field(min_length=1)] = Field(
        description="one or more tables [[optic.mirrors]], each with centre_mm and normal"
    )
    sequences: tuple[tuple[Whole, ...], ...] | None = Field(
        None, description="lists of the numbers of mirrors, counted from 0, [[0], [0, 1]]"
    )
    direct: bool | None = Field(None, strict=True, description="true or false: whether the picture beside them counts")
    surroundings: Name | Index | None = Field(None, description=MEDIUM)

    @model_validator(mode="after")
    def _can_exist(self):
        self.build()
        return self

    def build(self) -> Mirrors:
        """The mirrors of this table."""
        return Mirrors(tuple(table.build() for table in self.mirrors), **self.arguments("mirrors"))


class LightTable(Table):
    """[light]"""

    wavelength_nm: Positive | None = Field(None, description="a number of nm above 0")
    channel_wavelengths_nm: tuple[Positive, Positive, Positive] | None = Field(
        None, description="three numbers of nm above 0, [red, green, blue]"
    )
    dispersion: Dispersing | None = Field(
        None, description='the name of a glass, such as "N-BK7", whose dispersion counts where index is a number'
    )


class SceneTable(Table):
    """[scene]"""

    depth_mm: tuple[Positive, Positive] | None = Field(
        None, description="two numbers of mm above 0, [near, far], the nearer first"
    )

    @field_validator("depth_mm")
    @classmethod
    def _near_first(cls, value):
        if value is not None and not value[0] < value[1]:
            raise ValueError(f"must be {cls.model_fields['depth_mm'].description}")
        return value


class SetupTable(Table):
    """The whole file."""

    camera: CameraTable = Field(description="a table, with size_px and focal_px")
    optic: Annotated[PrismTable | MirrorsTable | PlateTable, Field(discriminator="kind")] = Field(
        description='a table, with kind = "prism", "mirrors" or "plate"'
    )
    light: LightTable | None = Field(None, description="a table, with wavelength_nm or channel_wavelengths_nm")
    scene: SceneTable | None = Field(None, description="a table, with depth_mm")

    @model_validator(mode="after")
    def _lets_light_through(self):
        setup = self.build()
        setup.optic.paths(setup.wavelength_nm)
        return self

    def build(self) -> Setup:
        """The setup of this file."""
        more = {name: getattr(self.camera, key) for key, name in IN_CAMERA.items()}
        if self.light is not None:
            more |= self.light.arguments()
        if self.scene is not None and self.scene.depth_mm is not None:
            more["depths"] = self.scene.depth_mm
        return Setup(self.camera.build(), self.optic.build(), **more)


IN_CAMERA = {"f_number": "f_number", "focus_distance_mm": "focus_distance"}  # keys of [camera] that Setup holds
OPTICS: dict[str, type[Table]] = {"prism": PrismTable, "mirrors": MirrorsTable, "plate": PlateTable}
