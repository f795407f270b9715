"""Where an optic stands: its planes turned and moved into the camera's frame, with derivatives."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from ..errors import OpticError
from ..geometry import rotation_from_vector, rotation_vector_jacobian

PLACEMENT_NAMES = ("tilt_x", "tilt_y", "tilt_z", "shift_x", "shift_y", "distance")  # rad, mm


@dataclass(frozen=True, eq=False)
class Placement:
    """The optic's frame in the camera's frame: turned by `turn`, tilted, moved to (shift, distance).

    The tilt is a rotation vector about the optic's reference point, in camera axes.
    """

    tilt: np.ndarray  # (3,) rad
    translation: np.ndarray  # (3,) mm: shift x, shift y, distance
    turn: np.ndarray  # (3, 3) a fixed rotation, before the tilt

    @classmethod
    def of(cls, tilt_deg: ArrayLike, shift: ArrayLike, distance: float, turn: np.ndarray | None = None) -> Placement:
        """A placement from the numbers that users give."""
        for name, numbers, count in (("tilt_deg", tilt_deg, 3), ("shift", shift, 2)):
            if np.shape(numbers) != (count,) or not np.isfinite(numbers).all():
                raise OpticError(f"{name} must be {count} numbers, got {numbers!r}")
        translation = np.array([*np.asarray(shift, dtype=float), distance])
        return cls(np.deg2rad(np.asarray(tilt_deg, dtype=float)), translation, np.eye(3) if turn is None else turn)

    @cached_property
    def rotation(self) -> np.ndarray:
        """Rotation (3, 3) from the optic's frame into the camera's."""
        return rotation_from_vector(self.tilt) @ self.turn

    def plane(self, normal: np.ndarray, offset: float) -> tuple[np.ndarray, float]:
        """A plane of the optic's frame, in the camera's frame."""
        moved = self.rotation @ normal
        return moved, float(offset + moved @ self.translation)

    def plane_derivatives(self, normal: np.ndarray, d_normal: np.ndarray, d_offset: np.ndarray) -> np.ndarray:
        """Derivatives (6 + P, 4) of a placed plane's normal and offset.

        The first six rows are those with respect to `PLACEMENT_NAMES`, the others those with respect to P
        parameters of shape, whose derivatives in the optic's frame are d_normal (P, 3) and d_offset (P,).
        """
        rotation = self.rotation
        moved = rotation @ normal
        turned = np.cross(rotation_vector_jacobian(self.tilt).T, moved)  # row i: how tilt_i turns the normal
        normals = np.concatenate([turned, np.zeros((3, 3)), d_normal @ rotation.T])
        offsets = np.concatenate([np.zeros(3), moved, d_offset]) + normals @ self.translation
        return np.concatenate([normals, offsets[:, None]], axis=1)
