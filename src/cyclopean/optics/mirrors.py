"""Plane mirrors in front of the camera: each way of light over them, and past them, is a view."""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from ..errors import OpticError
from ..geometry import rotation_from_vector, rotation_vector_jacobian
from .media import Medium, medium
from .paths import Path
from .surfaces import Interface, Reason


@dataclass(frozen=True, eq=False)
class Mirror:
    """A plane mirror, endless or a rectangle."""

    centre: tuple[float, float, float]  # mm, a point of the mirror: the middle of the rectangle
    normal: tuple[float, float, float]  # of any length; either side reflects
    size: tuple[float, float] | None = None  # mm, along its own u and v axes; None: endless
    tilt_deg: tuple[float, float] = (
        0.0,
        0.0,
    )  # correction: rotation about the u and v axes through the centre
    advance: float = 0.0  # mm, correction along the normal

    def __post_init__(self):
        if np.shape(self.normal) != (3,) or not (np.isfinite(self.normal).all() and np.linalg.norm(self.normal) > 0):
            raise OpticError(f"a mirror's normal must be a direction, three numbers, got {self.normal}")
        if np.shape(self.centre) != (3,) or not np.isfinite(self.centre).all():
            raise OpticError(f"a mirror's centre must be three numbers of mm, got {self.centre}")
        if self.size is not None and (np.shape(self.size) != (2,) or not np.all(np.array(self.size) > 0)):
            raise OpticError(f"a mirror's size must be two positive numbers of mm, got {self.size}")
        if np.shape(self.tilt_deg) != (2,) or not np.isfinite([*self.tilt_deg, self.advance]).all():
            raise OpticError(
                f"a mirror's corrections are two tilts and an advance, got {self.tilt_deg} degrees, {self.advance} mm"
            )

    def _nominal_axes(self) -> np.ndarray:
        """Rows u, v, normal (3, 3) before the correction; v lies as near to image-down as it can."""
        normal = np.asarray(self.normal, dtype=float) / np.linalg.norm(self.normal)
        down = np.array([0.0, 1.0, 0.0]) if abs(normal[1]) < 0.9 else np.array([0.0, 0.0, 1.0])
        u = np.cross(down, normal)
        u /= np.linalg.norm(u)
        return np.array([u, np.cross(normal, u), normal])

    def axes(self) -> np.ndarray:
        """Rows u, v, normal (3, 3) of the mirror as it stands."""
        nominal = self._nominal_axes()
        return nominal @ rotation_from_vector(np.deg2rad(self.tilt_deg) @ nominal[:2]).T

    def interface(self, index: float) -> Interface:
        """The mirror as one interface in a medium of this index."""
        axes, centre = self.axes(), np.asarray(self.centre, dtype=float)
        rows = []
        if self.size is not None:
            for axis, extent in zip(axes[:2], self.size, strict=True):
                for side in (axis, -axis):
                    rows.append([*side, side @ centre + extent / 2, Reason.OUTSIDE_OUTLINE])
        bounds = np.array(rows, dtype=float).reshape(-1, 5)
        return Interface(axes[2], float(axes[2] @ centre + self.advance), "reflect", index, bounds)

    def derivatives(self) -> np.ndarray:
        """(3, 5): of the interface to the tilts about u and v (rad) and to the advance (mm)."""
        nominal, normal = self._nominal_axes(), self.axes()[2]
        jacobian = rotation_vector_jacobian(np.deg2rad(self.tilt_deg) @ nominal[:2])
        out = np.zeros((3, 5))
        out[:2, :3] = np.cross((jacobian @ nominal[:2].T).T, normal)
        out[:2, 3] = out[:2, :3] @ np.asarray(self.centre, dtype=float)
        out[2, 3] = 1.0
        return out


@dataclass(frozen=True, eq=False)
class Mirrors:
    """Mirrors, and the orders in which light may meet them.

    Each sequence lists mirrors in the order in which light *from the camera* meets them and makes one view:
    ``((0,), (1,))`` is a view over each of two mirrors, ``((0, 1),)`` one view over both. With `direct` the
    picture beside the mirrors is a view as well.
    """

    mirrors: tuple[Mirror, ...]
    sequences: tuple[tuple[int, ...], ...] | None = None  # None: each mirror by itself
    direct: bool = False
    surroundings: str | float | Medium = "air"

    kind = "mirrors"

    def __post_init__(self):
        if not self.mirrors:
            raise OpticError("mirrors: at least one mirror is needed")
        for sequence in self.sequences or ():
            if not sequence or not all(0 <= k < len(self.mirrors) for k in sequence):
                raise OpticError(
                    f"a sequence lists mirrors by their numbers 0 to {len(self.mirrors) - 1}, got {sequence}"
                )
            if any(a == b for a, b in pairwise(sequence)):
                raise OpticError(f"light cannot meet the same plane mirror twice in a row, got {sequence}")

    def paths(self, wavelength_nm: float) -> tuple[Path, ...]:
        """The ways of light: one for each sequence, then the direct one."""
        index = float(medium(self.surroundings).index_in_air(wavelength_nm))
        interfaces = [mirror.interface(index) for mirror in self.mirrors]
        derivatives = [mirror.derivatives() for mirror in self.mirrors]
        sequences = self.sequences or tuple((k,) for k in range(len(self.mirrors)))
        paths = []
        for sequence in sequences:
            jacobian = np.zeros((len(self.parameter_names), len(sequence), 5))
            for s, k in enumerate(sequence):
                jacobian[3 * k : 3 * k + 3, s] = derivatives[k]
            name = "mirror " + " then ".join(map(str, sequence))
            surfaces = tuple(interfaces[k] for k in sequence)
            blockers = tuple(interfaces) if len(interfaces) > 1 else ()
            paths.append(Path(surfaces, index, self.parameter_names, jacobian, name, blockers))
        if self.direct:
            nothing = np.zeros((len(self.parameter_names), 0, 5))
            paths.append(Path((), index, self.parameter_names, nothing, "direct", blockers=tuple(interfaces)))
        return tuple(paths)

    @property
    def parameter_names(self) -> tuple[str, ...]:
        """Names of the parameters that derivatives are taken to; angles in rad, lengths in mm."""
        parts = ("tilt_u", "tilt_v", "advance")
        return tuple(f"mirror{k}_{part}" for k in range(len(self.mirrors)) for part in parts)

    def parameters(self, wavelength_nm: float) -> np.ndarray:
        """Values (P,) of the parameters, in the order of `parameter_names`."""
        return np.array([x for mirror in self.mirrors for x in (*np.deg2rad(mirror.tilt_deg), mirror.advance)])

    def with_parameters(self, values: np.ndarray) -> Mirrors:
        """The mirrors with other parameters (P,), in the order of `parameter_names`."""
        rows = np.asarray(values, dtype=float).reshape(-1, 3)
        mirrors = tuple(
            replace(mirror, tilt_deg=tuple(np.degrees(row[:2]).tolist()), advance=float(row[2]))
            for mirror, row in zip(self.mirrors, rows, strict=True)
        )
        return replace(self, mirrors=mirrors)
