"""The pyramid prism: one flat face and n facets that meet in an apex. Two facets make a biprism."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Literal

import numpy as np

from ..errors import OpticError
from .indices import refractive_indices
from .media import Medium, medium
from .paths import Path
from .placement import PLACEMENT_NAMES, Placement
from .surfaces import Disc, Interface, Reason

_HALF_TURN = np.diag([-1.0, 1.0, -1.0])  # about y: the facets, which face +z, then face the camera


@dataclass(frozen=True, eq=False)
class Prism:
    """A solid prism with n facets in front of the camera.

    In the prism's own frame the flat face has the outward normal -z, and facet k the outward normal
    (sin a cos p, sin a sin p, cos a) with a = `apex_deg` and azimuth p = `azimuth_deg` + 360 k / n. All facets
    pass through the apex. With the facets towards the camera the solid is turned by half a turn about y.
    """

    facets: int  # n >= 2
    apex_deg: float  # angle between the flat face and each facet
    glass: str | float | Medium  # name in the table of media, or an index relative to the surroundings
    distance: float  # mm, from the pinhole along z to the nearest point on the prism's axis
    thickness: float = 10.0  # mm, from the flat face to the apex
    radius: float | None = None  # mm, of the round outline; None: the facets run on until they cut the flat face
    facing: Literal["scene", "camera"] = "scene"  # where the facets look
    azimuth_deg: float = 0.0  # of facet 0
    tilt_deg: tuple[float, float, float] = (0.0, 0.0, 0.0)  # rotation vector about the nearest point
    shift: tuple[float, float] = (0.0, 0.0)  # mm, of the nearest point in x and y
    facet_deviation_deg: tuple[tuple[float, float], ...] = ()  # per facet: (angle, azimuth) added to the ideal
    surroundings: str | float | Medium = "air"

    kind = "prism"

    def __post_init__(self):
        if not 2 <= self.facets < np.inf or self.facets != int(self.facets):
            raise OpticError(f"a prism has 2 facets or more (2 is a biprism), got facets={self.facets}")
        object.__setattr__(self, "facets", int(self.facets))
        if not 0 < self.apex_deg < 90:
            raise OpticError(f"apex_deg must lie between 0 and 90, got {self.apex_deg}")
        for name in ("distance", "thickness"):
            if not (np.isfinite(getattr(self, name)) and getattr(self, name) > 0):
                raise OpticError(f"the prism's {name} must be a positive number of mm, got {getattr(self, name)}")
        if self.facing not in ("scene", "camera"):
            raise OpticError(f"facing must be 'scene' or 'camera', got {self.facing!r}")
        deviation = np.asarray(self.facet_deviation_deg, dtype=float)
        if deviation.size and deviation.shape != (self.facets, 2):
            raise OpticError(
                f"facet_deviation_deg needs one (angle, azimuth) pair for each of the {self.facets} facets, "
                f"got shape {deviation.shape}"
            )
        angles, azimuths = self.facet_angles()
        if not ((angles > 0) & (angles < np.pi / 2) & np.isfinite(azimuths)).all():
            raise OpticError(
                f"every facet must stand at 0 to 90 degrees to the flat face, at some azimuth; got "
                f"{np.degrees(angles)} and {np.degrees(azimuths)} degrees: look at facet_deviation_deg and azimuth_deg"
            )
        self._check_outline()
        self.placement  # noqa: B018  wrong numbers are reported here
        medium(self.glass), medium(self.surroundings)

    def _check_outline(self):
        if self.radius is None:
            return
        if not 0 < self.radius < np.inf:
            raise OpticError(
                f"the prism's radius must be a positive number of mm, or None for facets that run on, got {self.radius}"
            )
        steepest = self.facet_angles()[0].max()
        edge = self.thickness - self.radius * np.tan(steepest)
        if edge < 0:
            raise OpticError(
                f"the facets cross inside the glass: with apex_deg={np.degrees(steepest):g} and "
                f"radius={self.radius:g} mm the rim would be {edge:.3g} mm thick; make the thickness at least "
                f"{self.radius * np.tan(steepest):.4g} mm, or the radius or the angle smaller"
            )

    def facet_angles(self) -> tuple[np.ndarray, np.ndarray]:
        """Angle to the flat face and azimuth of each facet, (n,) rad each."""
        deviation = np.zeros((self.facets, 2))
        if len(self.facet_deviation_deg):
            deviation = np.deg2rad(np.asarray(self.facet_deviation_deg, dtype=float))
        azimuths = np.deg2rad(self.azimuth_deg) + 2 * np.pi * np.arange(self.facets) / self.facets
        return np.deg2rad(self.apex_deg) + deviation[:, 0], azimuths + deviation[:, 1]

    @cached_property
    def placement(self) -> Placement:
        """Where the prism stands; its reference point is the flat face's centre, or the apex if that is nearer."""
        turn = np.eye(3) if self.facing == "scene" else _HALF_TURN
        return Placement.of(self.tilt_deg, self.shift, self.distance, turn)

    def paths(self, wavelength_nm: float) -> tuple[Path, ...]:
        """The n ways of light through the prism, one for each facet.

        Raises OpticError when light along the prism's axis is totally reflected, or not bent at all: no such prism
        splits a picture.
        """
        outside, inside = refractive_indices(self.glass, self.surroundings, wavelength_nm)
        if inside == outside:
            raise OpticError(
                f"the prism bends no light: its index is that of its surroundings, {inside:.5g}; "
                "give another glass, by name or as an index"
            )
        self._check_total_reflection(outside, inside)
        faces = self._faces()
        placed = [self.placement.plane(normal, offset) for normal, offset, *_ in faces]
        paths = []
        for facet in range(self.facets):
            order = (0, 1 + facet) if self.facing == "scene" else (1 + facet, 0)
            after = (inside, outside)
            interfaces = tuple(
                Interface(*placed[face], "refract", index, self._bounds(placed, face), self._disc())
                for face, index in zip(order, after, strict=True)
            )
            derivatives = self._derivatives([faces[face] for face in order], outside, inside)
            paths.append(Path(interfaces, outside, self.parameter_names, derivatives, f"facet {facet}"))
        return tuple(paths)

    def _check_total_reflection(self, outside, inside):
        angles, _ = self.facet_angles()
        sine = np.sin(angles) * inside / outside
        if self.facing == "camera":
            refracted = np.arcsin(np.clip(np.sin(angles) * outside / inside, -1, 1))
            sine = np.sin(angles - refracted) * inside / outside
        if np.any(np.abs(sine) >= 1):
            limit = np.degrees(np.arcsin(outside / inside))
            advice = f"it must stay below {limit:.2f} degrees" if self.facing == "scene" else "make it smaller"
            raise OpticError(
                f"light along the prism's axis is totally reflected: apex_deg={self.apex_deg:g} is too steep for "
                f"an index of {inside:.5g} in surroundings of {outside:.5g}; {advice}"
            )

    def _faces(self):
        """Normal, offset and their derivatives to the shape parameters; the flat face first, prism frame."""
        angles, azimuths = self.facet_angles()
        count = 3 + 2 * self.facets  # apex, azimuth, thickness, then (angle, azimuth) of each facet
        towards_scene = self.facing == "scene"
        d_offset = np.zeros(count)
        if not towards_scene:  # the reference point is the apex, so the flat face is the one that moves
            d_offset[2] = 1.0
        flat = (
            np.array([0.0, 0.0, -1.0]),
            0.0 if towards_scene else self.thickness,
            np.zeros((count, 3)),
            d_offset,
        )
        faces = [flat]
        apex = self.thickness if towards_scene else 0.0
        for facet, (angle, azimuth) in enumerate(zip(angles, azimuths, strict=True)):
            sin, cos, around = np.sin(angle), np.cos(angle), np.array([np.cos(azimuth), np.sin(azimuth)])
            d_normal, d_offset = np.zeros((count, 3)), np.zeros(count)
            d_normal[0] = [*(cos * around), -sin]
            d_normal[1] = [-sin * around[1], sin * around[0], 0.0]
            d_offset[0] = -apex * sin
            d_offset[2] = cos if towards_scene else 0.0
            d_normal[3 + 2 * facet], d_normal[4 + 2 * facet] = d_normal[0], d_normal[1]
            d_offset[3 + 2 * facet] = d_offset[0]
            faces.append((np.array([*(sin * around), cos]), apex * cos, d_normal, d_offset))
        return faces

    def _bounds(self, placed, face):
        """Half-spaces of the solid that a point of one face must lie in: all the other faces."""
        rows = []
        for other, (normal, offset) in enumerate(placed):
            if other == face or (face == 0 and self.facing == "scene"):
                continue  # light enters the flat face wherever it is; the facet says which part belongs to it
            reason = Reason.OUTSIDE_OUTLINE if other == 0 or face == 0 else Reason.WRONG_FACET
            rows.append([*normal, offset, reason])
        return np.array(rows, dtype=float).reshape(-1, 5)

    def _disc(self):
        if self.radius is None:
            return None
        placement = self.placement
        return Disc(placement.translation, placement.rotation[:, 2], self.radius)

    @property
    def parameter_names(self) -> tuple[str, ...]:
        """Names of the parameters that derivatives are taken to; angles in rad, lengths in mm."""
        facets = [f"facet{k}_{part}" for k in range(self.facets) for part in ("angle", "azimuth")]
        return (*PLACEMENT_NAMES, "apex", "azimuth", "thickness", *facets, "index")

    def parameters(self, wavelength_nm: float) -> np.ndarray:
        """Values (P,) of the parameters, in the order of `parameter_names`."""
        deviation = np.deg2rad(np.asarray(self.facet_deviation_deg or np.zeros((self.facets, 2)), dtype=float))
        angles = np.deg2rad([self.apex_deg, self.azimuth_deg])
        tilt = np.deg2rad(self.tilt_deg)
        outside, inside = refractive_indices(self.glass, self.surroundings, wavelength_nm)
        return np.array(
            [*tilt, *self.shift, self.distance, *angles, self.thickness, *deviation.ravel(), inside / outside]
        )

    def with_parameters(self, values: np.ndarray) -> Prism:
        """The prism with other parameters (P,), in the order of `parameter_names`; its glass is then an index."""
        values = np.asarray(values, dtype=float)
        deviation = np.degrees(values[9:-1]).reshape(self.facets, 2)
        return replace(
            self,
            tilt_deg=tuple(np.degrees(values[:3]).tolist()),
            shift=tuple(values[3:5].tolist()),
            distance=float(values[5]),
            apex_deg=float(np.degrees(values[6])),
            azimuth_deg=float(np.degrees(values[7])),
            thickness=float(values[8]),
            facet_deviation_deg=tuple(map(tuple, deviation.tolist())) if deviation.any() else (),
            glass=float(values[-1]),
        )

    def _derivatives(self, faces, outside, inside):
        """(P, 2, 5): of normal, offset and squared-index step of the two faces to every parameter."""
        derivatives = np.zeros((len(self.parameter_names), 2, 5))
        for s, (normal, _, d_normal, d_offset) in enumerate(faces):
            derivatives[:-1, s, :4] = self.placement.plane_derivatives(normal, d_normal, d_offset)
            derivatives[-1, s, 4] = (1 if s == 0 else -1) * 2 * inside * outside  # index is inside / outside
        return derivatives
