"""A scene: what stands in front of the camera, and the light on it."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Protocol

import numpy as np

from ..errors import SetupError

if TYPE_CHECKING:
    from .intersection import Triangles


class Paint(Protocol):
    """How much of the light a surface sends back, place by place."""

    @property
    def dimensions(self) -> int:
        """2 for places on the surface, 3 for places in the object's own frame, mm."""
        ...

    @property
    def channels(self) -> int:
        """1 for grey, 3 for red, green and blue."""
        ...

    def reflectance(self, places: np.ndarray) -> np.ndarray:
        """Part of the light (N, channels), 0 to 1, that is sent back at places (N, dimensions)."""
        ...


@dataclass(frozen=True, eq=False)
class Surface:
    """Triangles and what is painted on them, matte and seen from both sides."""

    vertices: np.ndarray  # (N, 3) mm, rig frame
    faces: np.ndarray  # (T, 3) int, rows of vertices
    paint: Paint
    places: np.ndarray  # (N, paint.dimensions), where each vertex lies on the paint; linear on each triangle
    name: str = ""
    luminous: bool = False  # True: the paint is light that the surface sends to all sides, whatever the lamps do

    def __post_init__(self):
        vertices, faces = np.array(self.vertices, dtype=float), np.array(self.faces)
        places, what = np.array(self.places, dtype=float), self.called
        if vertices.ndim != 2 or vertices.shape[1] != 3:
            raise SetupError(f"{what}: vertices must have shape (N, 3), mm, got {vertices.shape}")
        if faces.ndim != 2 or faces.shape[1] != 3 or not len(faces):
            raise SetupError(f"{what}: faces must be triangles, shape (T, 3) with T > 0, got {faces.shape}")
        if faces.dtype.kind not in "iu":
            raise SetupError(f"{what}: faces are whole numbers, the rows of vertices, got {faces.dtype}")
        if faces.min() < 0 or faces.max() >= len(vertices):
            raise SetupError(
                f"{what}: a face asks for vertex {faces.min() if faces.min() < 0 else faces.max()}, but vertices are "
                f"numbered 0 to {len(vertices) - 1}"
            )
        if not np.isfinite(vertices).all():
            count = np.count_nonzero(~np.isfinite(vertices).all(1))
            raise SetupError(f"{what}: {count} of {len(vertices)} vertices are not numbers; take them out of the mesh")
        if places.shape != (len(vertices), self.paint.dimensions):
            raise SetupError(
                f"{what}: places must have shape ({len(vertices)}, {self.paint.dimensions}), a row for each vertex "
                f"and as many columns as the paint has dimensions, got {places.shape}"
            )
        if not np.isfinite(places).all():
            raise SetupError(f"{what}: places on the paint must be numbers; some are NaN or infinite")
        object.__setattr__(self, "vertices", vertices)
        object.__setattr__(self, "faces", faces.astype(np.int64))
        object.__setattr__(self, "places", places)

    @property
    def called(self) -> str:
        """What messages call it."""
        return f"surface {self.name!r}" if self.name else "a surface"


@dataclass(frozen=True)
class Lamp:
    """A small lamp at a position, or parallel light such as the sun's.

    A white matte surface that faces the lamp sends `strength` at `distance` from it, and four times less at twice
    that; in parallel light it does everywhere.
    """

    position: tuple[float, float, float] | None = None  # mm, rig frame
    direction: tuple[float, float, float] | None = None  # where parallel light goes, of any length
    strength: float = 1.0
    shadows: bool = True
    distance: float | None = None  # mm, at which the strength holds; None: that to the middle of the scene's box

    def __post_init__(self):
        if (self.position is None) == (self.direction is None):
            raise SetupError(
                "a lamp needs either a position (mm) or the direction in which its light goes, "
                f"got position {self.position} and direction {self.direction}"
            )
        name = "direction" if self.position is None else "position"
        value = getattr(self, name)
        if np.shape(value) != (3,) or not np.isfinite(value).all():
            raise SetupError(f"a lamp's {name} must be three numbers (x, y, z), got {value}")
        if name == "direction" and not np.linalg.norm(value) > 0:
            raise SetupError("a lamp's direction must not be (0, 0, 0)")
        if not (np.isfinite(self.strength) and self.strength >= 0):
            raise SetupError(f"a lamp's strength must be a number of 0 or more, got {self.strength}")
        if self.distance is not None and not (np.isfinite(self.distance) and self.distance > 0):
            raise SetupError(f"a lamp's distance must be a positive number of mm, got {self.distance}")
        object.__setattr__(self, name, tuple(float(x) for x in value))


@dataclass(frozen=True, eq=False)
class Scene:
    """Surfaces and the light on them, in the rig frame."""

    surfaces: tuple[Surface, ...]
    ambient: float = 1.0  # even light from all sides: a white matte surface sends so much of it back
    lamps: tuple[Lamp, ...] = ()
    background: tuple[float, ...] = (0.0,)  # light where a ray meets nothing: grey, or red, green and blue

    def __post_init__(self):
        object.__setattr__(self, "surfaces", tuple(self.surfaces))
        object.__setattr__(self, "lamps", tuple(self.lamps))
        background = tuple(float(x) for x in np.atleast_1d(self.background))
        object.__setattr__(self, "background", background)
        if not self.surfaces:
            raise SetupError("the scene is empty: it needs at least one surface, such as a plane or a mesh")
        if not (np.isfinite(self.ambient) and self.ambient >= 0):
            raise SetupError(f"ambient light must be a number of 0 or more, got {self.ambient}")
        if len(background) not in (1, 3) or not all(np.isfinite(x) and x >= 0 for x in background):
            raise SetupError(f"the background must be one number of 0 or more, or three, got {background}")

    @cached_property
    def box(self) -> np.ndarray:
        """(2, 3) mm: the lowest and the highest coordinates of all surfaces."""
        corners = [surface.vertices[surface.faces].reshape(-1, 3) for surface in self.surfaces]
        return np.array([np.min([c.min(0) for c in corners], axis=0), np.max([c.max(0) for c in corners], axis=0)])

    @cached_property
    def triangles(self) -> Triangles:
        """All triangles, ready to be searched."""
        from .intersection import Triangles

        return Triangles(self)

    @property
    def channels(self) -> int:
        """3 where a paint or the background has colour, else 1."""
        return max(*(surface.paint.channels for surface in self.surfaces), len(self.background))
