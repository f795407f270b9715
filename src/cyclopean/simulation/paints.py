"""Paints: how much light each place of a surface sends back."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from ..errors import SetupError, ShapeError
from ..geometry import launch

DARK, BRIGHT = 0.1, 0.8  # of textures
# Radius of a dot, in cells, for half of a plane or of space to be covered: one dot in each cell, anywhere in it.
_HALF_COVERED = {2: 0.4227, 3: 0.5177}
_SPREAD = 0.2  # of the radius, by which dots differ in size
_SOFT = 0.1  # of the diameter, over which the rim of a dot fades
# Reach of a bump in cells, and the standard deviation that the sum of bumps then has.
_REACH = {2: 1.0, 3: 0.75}


@dataclass(frozen=True)
class Uniform:
    """The same everywhere."""

    colour: tuple[float, ...] = (0.5,)  # reflectance, 0 to 1: grey, or red, green and blue
    dimensions: int = 2

    def __post_init__(self):
        colour = tuple(float(part) for part in np.atleast_1d(self.colour))
        if len(colour) not in (1, 3):
            raise SetupError(f"a colour is one number, grey, or three, red, green and blue; got {len(colour)}")
        for part in colour:
            check_reflectance("a colour", part)
        _check_dimensions(self.dimensions)
        object.__setattr__(self, "colour", colour)

    @property
    def channels(self) -> int:
        """1 or 3."""
        return len(self.colour)

    def reflectance(self, places: np.ndarray) -> np.ndarray:
        """(N, channels) at places (N, dimensions)."""
        return np.tile(np.array(self.colour, np.float32), (len(as_places(places, self.dimensions)), 1))


@dataclass(frozen=True)
class Colours:
    """Places are the colours themselves, red, green and blue from 0 to 1: for meshes with coloured vertices."""

    @property
    def dimensions(self) -> int:
        """3."""
        return 3

    @property
    def channels(self) -> int:
        """3."""
        return 3

    def reflectance(self, places: np.ndarray) -> np.ndarray:
        """(N, 3) at places (N, 3)."""
        return np.clip(as_places(places, 3), 0.0, 1.0).astype(np.float32)


@dataclass(frozen=True, eq=False)
class Picture:
    """A picture on the surface, bilinear between the centres of its pixels.

    Its values are reflectances, in linear light: `linear_light` turns those of ordinary picture files into them.
    """

    image: np.ndarray  # (H, W) or (H, W, 3), 0 to 1
    size: tuple[float, float] = (1.0, 1.0)  # mm, or the unit of the places: width and height of the picture
    corner: tuple[float, float] = (0.0, 0.0)  # the place of its upper left corner; x to the right, y down
    repeat: bool = False  # else its border goes on for ever

    def __post_init__(self):
        image = np.asarray(self.image, dtype=np.float32)
        if image.ndim not in (2, 3) or (image.ndim == 3 and image.shape[2] not in (1, 3)) or not image.size:
            raise ShapeError(f"a picture must have shape (H, W) or (H, W, 3), got {image.shape}")
        if not np.isfinite(image).all():
            raise SetupError("a picture must hold numbers; some are NaN or infinite")
        if image.min() < 0 or image.max() > 1:
            raise SetupError(f"a picture holds reflectances, 0 to 1, got {image.min():g} to {image.max():g}")
        for size in self.size:
            check_length("the size of a picture", size)
        object.__setattr__(self, "image", np.ascontiguousarray(image.reshape(*image.shape[:2], -1)))

    @property
    def dimensions(self) -> int:
        """2."""
        return 2

    @property
    def channels(self) -> int:
        """1 or 3."""
        return self.image.shape[2]

    def reflectance(self, places: np.ndarray) -> np.ndarray:
        """(N, channels) at places (N, 2)."""
        from .paint_kernels import picture

        places = as_places(places, 2)
        out = np.empty((len(places), self.channels), np.float32)
        (height, width), (across, down) = self.image.shape[:2], self.size
        scale = width / across, height / down
        launch(picture, len(places), places, self.image, *map(float, self.corner), *scale, bool(self.repeat), out)
        return out


@dataclass(frozen=True)
class Speckle:
    """Dark dots on a bright ground, half of it covered, without end: as sprayed for digital image correlation.

    One dot stands anywhere in each cell of a grid; diameters vary by 20 % to either side, and dots overlap. In three
    dimensions the dots are balls, and a surface shows where it cuts them: no seams and no stretching, but smaller
    dots between the large ones.
    """

    size: float  # mm, middle diameter of a dot
    dark: float = DARK
    bright: float = BRIGHT
    seed: int = 0
    dimensions: int = 2

    def __post_init__(self):
        _check_texture(self)

    @property
    def channels(self) -> int:
        """1."""
        return 1

    def reflectance(self, places: np.ndarray) -> np.ndarray:
        """(N, 1) at places (N, dimensions)."""
        from .paint_kernels import speckle

        radius = _HALF_COVERED[self.dimensions]
        numbers = self.size / (2 * radius), np.uint64(self.seed), radius, _SPREAD, 2 * radius * _SOFT
        return _filled(speckle, places, self.dimensions, *numbers, self.dark, self.bright)


@dataclass(frozen=True)
class Noise:
    """Smooth random grey, without end: no edges, and little that is finer than its grain.

    The sum of round bumps (1 - r^2)^2 of either sign, one anywhere in each cell of a grid (sparse convolution: Lewis
    1989, Algorithms for solid noise synthesis). Its standard deviation is a quarter of the range from dark to bright;
    what lies outside the range, 5 %, is cut.
    """

    size: float  # mm, across a bump, at half its height
    dark: float = DARK
    bright: float = BRIGHT
    seed: int = 0
    dimensions: int = 2

    def __post_init__(self):
        _check_texture(self)

    @property
    def channels(self) -> int:
        """1."""
        return 1

    @cached_property
    def _gain(self):
        """What makes the standard deviation a quarter: the sum of squares of a bump over a cell is its variance."""
        reach = _REACH[self.dimensions]
        return 0.25 / np.sqrt(np.pi * reach**2 / 5 if self.dimensions == 2 else 512 * np.pi * reach**3 / 3465)

    def reflectance(self, places: np.ndarray) -> np.ndarray:
        """(N, 1) at places (N, dimensions)."""
        from .paint_kernels import noise

        reach = _REACH[self.dimensions]
        cell = self.size / (2 * reach * np.sqrt(1 - np.sqrt(0.5)))
        numbers = cell, np.uint64(self.seed), reach, self._gain
        return _filled(noise, places, self.dimensions, *numbers, self.dark, self.bright)


@dataclass(frozen=True)
class Checker:
    """Squares, or in three dimensions cubes, dark and bright by turns; a dark one begins at the origin."""

    size: float  # mm, side of a square
    dark: float = DARK
    bright: float = BRIGHT
    dimensions: int = 2

    def __post_init__(self):
        _check_texture(self)

    @property
    def channels(self) -> int:
        """1."""
        return 1

    def reflectance(self, places: np.ndarray) -> np.ndarray:
        """(N, 1) at places (N, dimensions)."""
        from .paint_kernels import checker

        return _filled(checker, places, self.dimensions, float(self.size), self.dark, self.bright)


def linear_light(image: ArrayLike) -> np.ndarray:
    """Reflectances of a picture whose values are coded for screens (sRGB), as those of ordinary files are.

    Parameters
    ----------
    image : (H, W) or (H, W, 3) array
        uint8, uint16, or real numbers from 0 to 1.

    Returns
    -------
    float32 array of the same shape
        0 to 1.

    References
    ----------
    IEC 61966-2-1, Default RGB colour space sRGB, 1999.
    """
    coded = as_share(image)
    return np.where(coded <= 0.04045, coded / 12.92, ((coded + 0.055) / 1.055) ** 2.4).astype(np.float32)


def as_share(image: ArrayLike) -> np.ndarray:
    """A picture's values as float32 from 0 to 1: whole numbers by the range of their type, real ones as they are."""
    image = np.asarray(image)
    full = np.iinfo(image.dtype).max if image.dtype.kind in "ui" else 1
    return image.astype(np.float32) / np.float32(full)


def as_places(places: ArrayLike, dimensions: int) -> np.ndarray:
    """Places (N, dimensions) as float64, or a ShapeError."""
    places = np.ascontiguousarray(places, dtype=float)
    if places.ndim != 2 or places.shape[1] != dimensions:
        raise ShapeError(f"places on this paint must have shape (N, {dimensions}), got {places.shape}")
    return places


def check_reflectance(what: str, value: float) -> None:
    """A SetupError where a reflectance is none."""
    if not 0 <= value <= 1:
        raise SetupError(f"{what} must be a reflectance from 0 (black) to 1 (white), got {value}")


def check_length(what: str, value: float) -> None:
    """A SetupError where a length is none."""
    if not 0 < value < np.inf:
        raise SetupError(f"{what} must be a number of mm above 0, got {value}")


def _check_texture(paint):
    check_length(f"the size of a {type(paint).__name__.lower()}", paint.size)
    for name in ("dark", "bright"):
        check_reflectance(name, getattr(paint, name))
    _check_dimensions(paint.dimensions)
    seed = getattr(paint, "seed", 0)
    if isinstance(seed, bool) or seed != int(seed) or not 0 <= seed < 2**63:
        raise SetupError(f"a seed is a whole number of 0 or more, got {seed}")


def _check_dimensions(dimensions):
    if dimensions not in (2, 3):
        raise SetupError(f"a paint has 2 dimensions, on the surface, or 3, through the solid; got {dimensions}")


def _filled(kernel, places, dimensions, *numbers):
    """What a kernel for one channel says at places: (N, 1) float32."""
    places = as_places(places, dimensions)
    out = np.empty(len(places), np.float32)
    launch(kernel, len(places), places, *numbers, out)
    return out[:, None]
