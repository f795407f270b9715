"""What happens to light at one plane, and why a ray can be lost there."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from enum import IntEnum
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike


class Reason(IntEnum):
    """Why there is no ray for a pixel, or no pixel for a point."""

    SEEN = 0
    NOT_A_NUMBER = 1
    MISSED = 2
    OUTSIDE_OUTLINE = 3
    WRONG_FACET = 4
    TOTAL_REFLECTION = 5
    BLOCKED = 6
    OUTSIDE_IMAGE = 7
    BEHIND = 8
    NO_SOLUTION = 9

    @property
    def text(self) -> str:
        """The reason in words."""
        return _REASON_TEXTS[self]


_REASON_TEXTS = {
    Reason.SEEN: "seen",
    Reason.NOT_A_NUMBER: "the input is not a number",
    Reason.MISSED: "the ray never meets the surface",
    Reason.OUTSIDE_OUTLINE: "the ray passes outside the outline of the optic",
    Reason.WRONG_FACET: "the ray meets another facet first",
    Reason.TOTAL_REFLECTION: "the ray is totally reflected",
    Reason.BLOCKED: "the ray is blocked by a mirror",
    Reason.OUTSIDE_IMAGE: "the pixel lies outside the image",
    Reason.BEHIND: "the point does not lie in front of the last surface",
    Reason.NO_SOLUTION: "no ray of this view passes through the point",
}


def refract(directions: ArrayLike, normals: ArrayLike, index_in: float, index_out: float) -> np.ndarray:
    """Bend rays as they cross from one medium into another.

    Parameters
    ----------
    directions : (..., 3) array
        Unit vectors along the travel of each ray.
    normals : (..., 3) array
        Unit normals of the surface; either side will do.
    index_in, index_out : float
        Refractive indices before and after the surface.

    Returns
    -------
    (..., 3) array
        Unit vectors after the surface, NaN where the ray is totally reflected.

    References
    ----------
    Born and Wolf, Principles of Optics, section 1.5.1.
    """
    directions, normals = np.asarray(directions, float), np.asarray(normals, float)
    ratio = index_in / index_out
    cos_in = -np.sum(directions * normals, axis=-1, keepdims=True)
    normals = np.where(cos_in < 0, -normals, normals)  # face the incoming ray
    cos_in = np.abs(cos_in)
    cos_out_squared = 1 - ratio**2 * (1 - cos_in**2)
    cos_out = np.sqrt(np.where(cos_out_squared >= 0, cos_out_squared, np.nan))
    return ratio * directions + (ratio * cos_in - cos_out) * normals


def reflect(directions: ArrayLike, normals: ArrayLike) -> np.ndarray:
    """Mirror rays at a surface: (..., 3) unit vectors and unit normals -> (..., 3) unit vectors."""
    directions, normals = np.asarray(directions, float), np.asarray(normals, float)
    return directions - 2 * np.sum(directions * normals, axis=-1, keepdims=True) * normals


@dataclass(frozen=True, eq=False)
class Disc:
    """The outline of a round optic: a cylinder, cut by whatever surfaces stand in it."""

    centre: np.ndarray  # (3,) mm, a point of the axis
    axis: np.ndarray  # (3,) unit
    radius: float  # mm


@dataclass(frozen=True, eq=False)
class Interface:
    """One plane of an optic, what it does to light, and where on the plane it does so."""

    normal: np.ndarray  # (3,) unit; either side
    offset: float  # mm, normal . x on the plane
    act: Literal["refract", "reflect"]
    index_after: float  # refractive index behind the surface; for a mirror that in front of it
    bounds: np.ndarray = field(default_factory=lambda: np.empty((0, 5)))  # half-spaces: normal, offset, Reason
    disc: Disc | None = None

    def unbounded(self) -> Interface:
        """The same plane without an end."""
        return replace(self, bounds=np.empty((0, 5)), disc=None)
