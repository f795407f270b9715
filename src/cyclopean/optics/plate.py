"""A plane-parallel glass plate: it shifts the picture of near things and nothing else."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ..errors import OpticError
from .indices import refractive_indices
from .media import Medium, medium
from .paths import Path
from .placement import PLACEMENT_NAMES, Placement
from .surfaces import Disc, Interface


@dataclass(frozen=True, eq=False)
class Plate:
    """A plane-parallel plate in front of the camera, upright or tilted: one view.

    Two photographs with two tilts make a stereo pair (Nishimoto and Shirai 1987). With another medium
    behind it (`beyond="water"`) it is a flat port.
    """

    glass: str | float | Medium  # name in the table of media, or an index relative to the surroundings
    distance: float  # mm, from the pinhole along z to the first face
    thickness: float  # mm
    radius: float | None = None  # mm, of the round outline; None: endless
    tilt_deg: tuple[float, float, float] = (0.0, 0.0, 0.0)  # rotation vector about the first face's centre
    shift: tuple[float, float] = (0.0, 0.0)  # mm, of the first face's centre in x and y
    surroundings: str | float | Medium = "air"
    beyond: str | float | Medium | None = None  # what lies behind the plate; None: the surroundings

    kind = "plate"

    def __post_init__(self):
        for name in ("distance", "thickness"):
            if not (np.isfinite(getattr(self, name)) and getattr(self, name) > 0):
                raise OpticError(f"the plate's {name} must be a positive number of mm, got {getattr(self, name)}")
        if self.radius is not None and not self.radius > 0:
            raise OpticError(f"the plate's radius must be a positive number of mm, got {self.radius}")
        for material in (self.glass, self.surroundings, *([] if self.beyond is None else [self.beyond])):
            medium(material)  # an unknown one is reported here
        Placement.of(self.tilt_deg, self.shift, self.distance)  # so are wrong numbers

    def _indices(self, wavelength_nm):
        outside, inside = refractive_indices(self.glass, self.surroundings, wavelength_nm)
        beyond = outside
        if self.beyond is not None:
            beyond = refractive_indices(self.beyond, self.surroundings, wavelength_nm)[1]
        return outside, inside, beyond

    def paths(self, wavelength_nm: float) -> tuple[Path, ...]:
        """The one way of light through the plate."""
        outside, inside, beyond = self._indices(wavelength_nm)
        placement = Placement.of(self.tilt_deg, self.shift, self.distance)
        disc = None
        if self.radius is not None:
            disc = Disc(placement.translation, placement.rotation[:, 2], self.radius)
        along = np.array([0.0, 0.0, 1.0])
        interfaces, derivatives = [], np.zeros((len(self.parameter_names), 2, 5))
        for s, (offset, index) in enumerate([(0.0, inside), (self.thickness, beyond)]):
            interfaces.append(Interface(*placement.plane(along, offset), "refract", index, disc=disc))
            derivatives[:-1, s, :4] = placement.plane_derivatives(along, np.zeros((1, 3)), np.array([float(s)]))
            derivatives[-1, s, 4] = (1 if s == 0 else -1) * 2 * inside * outside
        return (Path(tuple(interfaces), outside, self.parameter_names, derivatives, "plate"),)

    @property
    def parameter_names(self) -> tuple[str, ...]:
        """Names of the parameters that derivatives are taken to; angles in rad, lengths in mm."""
        return (*PLACEMENT_NAMES, "thickness", "index")

    def parameters(self, wavelength_nm: float) -> np.ndarray:
        """Values (P,) of the parameters, in the order of `parameter_names`."""
        outside, inside, _ = self._indices(wavelength_nm)
        tilt = np.deg2rad(self.tilt_deg)
        return np.array([*tilt, *self.shift, self.distance, self.thickness, inside / outside])

    def with_parameters(self, values: np.ndarray) -> Plate:
        """The plate with other parameters (P,), in the order of `parameter_names`; its glass is then an index."""
        values = np.asarray(values, dtype=float)
        return replace(
            self,
            tilt_deg=tuple(np.degrees(values[:3]).tolist()),
            shift=tuple(values[3:5].tolist()),
            distance=float(values[5]),
            thickness=float(values[6]),
            glass=float(values[7]),
        )
