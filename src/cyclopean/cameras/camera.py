"""A pinhole camera with Brown-Conrady distortion, as OpenCV defines it."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from ..errors import SetupError
from ..geometry import Rays, as_pixels, as_points, launch

CAMERA_PARAMETERS = ("focal_x", "focal_y", "centre_x", "centre_y", "k1", "k2", "p1", "p2", "k3")


@dataclass(frozen=True, eq=False)
class Camera:
    """A camera at the origin that looks along +z, x to the right and y down.

    Distortion is that of Brown (1966) in OpenCV's order, k1 k2 p1 p2 k3.
    """

    size: tuple[int, int]  # (width, height) px
    focal: tuple[float, float]  # (x, y) px; one number stands for both
    centre: tuple[float, float] = None  # type: ignore[assignment]  # principal point (x, y) px; None: mid-image
    distortion: tuple[float, float, float, float, float] = (0.0, 0.0, 0.0, 0.0, 0.0)
    pixel_pitch: float | None = None  # mm; only needed where a lens's real focal length matters

    def __post_init__(self):
        if np.shape(self.size) != (2,) or not all(0 < n < np.inf and n == int(n) for n in self.size):
            raise SetupError(f"the camera's size must be (width, height) in whole pixels, got {self.size}")
        width, height = self.size
        focal = np.atleast_1d(np.asarray(self.focal, dtype=float))  # one number stands for both
        if focal.size not in (1, 2) or not (np.isfinite(focal).all() and focal.min() > 0):
            raise SetupError(f"the camera's focal length must be positive px, one number or (x, y), got {self.focal}")
        centre = ((width - 1) / 2, (height - 1) / 2) if self.centre is None else self.centre
        if len(centre) != 2 or not np.isfinite(centre).all():
            raise SetupError(f"the camera's centre must be (x, y) in px, got {self.centre}")
        if len(self.distortion) != 5 or not np.isfinite(self.distortion).all():
            raise SetupError(f"distortion must be the five numbers k1 k2 p1 p2 k3, got {self.distortion}")
        if self.pixel_pitch is not None and not self.pixel_pitch > 0:
            raise SetupError(f"the pixel pitch must be positive mm (0.0055 for 5.5 um), got {self.pixel_pitch}")
        object.__setattr__(self, "size", (int(width), int(height)))
        object.__setattr__(self, "focal", (float(focal[0]), float(focal[-1])))
        object.__setattr__(self, "centre", (float(centre[0]), float(centre[1])))
        object.__setattr__(self, "distortion", tuple(float(k) for k in self.distortion))

    @classmethod
    def from_matrix(cls, matrix: ArrayLike, size: tuple[int, int], distortion: ArrayLike = (0,) * 5) -> Camera:
        """A camera from OpenCV's 3x3 matrix and its distortion numbers (up to five)."""
        matrix = np.asarray(matrix, dtype=float)
        numbers = np.zeros(5)
        given = np.asarray(distortion, dtype=float).ravel()
        if matrix.shape != (3, 3) or given.size > 5:
            raise SetupError(
                f"wanted a 3x3 matrix and at most k1 k2 p1 p2 k3, got shapes {matrix.shape} and {given.shape}"
            )
        numbers[: given.size] = given
        return cls(size, (matrix[0, 0], matrix[1, 1]), (matrix[0, 2], matrix[1, 2]), tuple(numbers))  # type: ignore[arg-type]

    @property
    def matrix(self) -> np.ndarray:
        """OpenCV's camera matrix (3, 3), px."""
        return np.array([[self.focal[0], 0, self.centre[0]], [0, self.focal[1], self.centre[1]], [0, 0, 1.0]])

    @cached_property
    def lens(self) -> np.ndarray:
        """The nine parameters (9,) in the order of `CAMERA_PARAMETERS`."""
        return np.array([*self.focal, *self.centre, *self.distortion], dtype=float)

    def with_lens(self, values: ArrayLike) -> Camera:
        """The camera with other parameters (9,), in the order of `CAMERA_PARAMETERS`."""
        v = [float(x) for x in np.asarray(values, dtype=float)]
        return replace(self, focal=(v[0], v[1]), centre=(v[2], v[3]), distortion=tuple(v[4:]))  # type: ignore[arg-type]

    def with_larger_pixels(self, factor: float) -> Camera:
        """The same lens before pixels so many times as large; the picture's size is rounded to whole ones."""
        width, height = (max(round(side / factor), 1) for side in self.size)
        x, y = ((place + 0.5) / factor - 0.5 for place in self.centre)
        pitch = None if self.pixel_pitch is None else factor * self.pixel_pitch
        focal = self.focal[0] / factor, self.focal[1] / factor
        return replace(self, size=(width, height), focal=focal, centre=(x, y), pixel_pitch=pitch)

    @cached_property
    def fold_radius(self) -> float:
        """Largest undistorted radius (tangent of the field angle) at which the lens model is one-to-one.

        Radial distortion folds the picture over where r (1 + k1 r^2 + k2 r^4 + k3 r^6) stops growing; beyond,
        one pixel would belong to two directions.
        """
        k1, k2, _, _, k3 = self.distortion
        roots = np.roots([7 * k3, 5 * k2, 3 * k1, 1.0]) if any((k1, k2, k3)) else np.empty(0)
        squares = roots[(np.abs(roots.imag) < 1e-9 * np.maximum(np.abs(roots), 1)) & (roots.real > 0)].real
        return float(np.sqrt(squares.min())) if squares.size else 1e6

    def normalise(self, pixels: ArrayLike) -> np.ndarray:
        """Undistorted normalised coordinates (..., 2), x/z and y/z, of pixels (..., 2); NaN beyond the lens's fold."""
        return self._convert(as_pixels(pixels), to_pixels=False)

    def denormalise(self, coordinates: ArrayLike) -> np.ndarray:
        """Pixels (..., 2) of undistorted normalised coordinates (..., 2); NaN beyond the lens's fold."""
        return self._convert(as_pixels(coordinates), to_pixels=True)

    def _convert(self, pairs, to_pixels):
        from . import kernels

        out = np.empty(pairs.shape)
        flat = np.ascontiguousarray(pairs).reshape(-1, 2)
        launch(kernels.convert, len(flat), flat, self.lens, self.fold_radius, to_pixels, out.reshape(-1, 2))
        return out

    def rays(self, pixels: ArrayLike) -> Rays:
        """Rays from the pinhole through pixels (..., 2)."""
        coordinates = self.normalise(pixels)
        directions = np.concatenate([coordinates, np.ones((*coordinates.shape[:-1], 1))], axis=-1)
        directions = directions / np.linalg.norm(directions, axis=-1, keepdims=True)
        return Rays(np.where(np.isfinite(directions), 0.0, np.nan), directions)

    def project(self, points: ArrayLike) -> np.ndarray:
        """Pixels (..., 2) of points (..., 3) mm in the camera's frame; NaN behind the camera."""
        points = as_points(points)
        z = np.where(points[..., 2:] > 0, points[..., 2:], np.nan)
        return self.denormalise(points[..., :2] / z)

    def contains(self, pixels: ArrayLike) -> np.ndarray:
        """True (...,) where pixels (..., 2) lie on the image, its border pixels included to their outer edge."""
        pixels = as_pixels(pixels)
        return np.all((pixels >= -0.5) & (pixels <= np.asarray(self.size) - 0.5), axis=-1)
