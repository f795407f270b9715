"""Tsai's camera: its distortion leads from the distorted picture to the undistorted one."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from ..cameras import Camera
from ..errors import SetupError
from ..geometry import as_pixels, as_points


class BrownCamera(NamedTuple):
    """Our own camera in the place of one of another kind, and by how many px it misses it."""

    camera: Camera
    departure_rms: float  # px, over the part of the picture it was fitted to
    departure_max: float  # px


@dataclass(frozen=True, eq=False)
class TsaiCamera:
    """A camera at the origin that looks along +z, x to the right and y down, with Tsai's radial distortion.

    On the sensor, from the principal point and in the unit of `pitch`, a point seen at (Xd, Yd) would without
    distortion be seen at (Xu, Yu) = (Xd, Yd) (1 + k1 r^2 + k2 r^4), r^2 = Xd^2 + Yd^2. A pixel is
    (scale Xd / pitch_x + centre_x, Yd / pitch_y + centre_y).

    References
    ----------
    Tsai 1987, A versatile camera calibration technique for high-accuracy 3D machine vision metrology using
    off-the-shelf TV cameras and lenses, IEEE J. Robotics and Automation 3(4), steps 2 to 4 of the camera model.
    """

    size: tuple[int, int]  # (width, height) px
    focal: float  # in the unit of `pitch`: mm, or px where the pitch is 1
    centre: tuple[float, float]  # principal point and centre of distortion (x, y) px
    k1: float = 0.0  # one over the square of that unit
    k2: float = 0.0  # one over its fourth power
    scale: float = 1.0  # Tsai's s_x: horizontal scale that the clock of the frame grabber adds
    pitch: tuple[float, float] = (1.0, 1.0)  # distance of pixels (dx', dy), mm

    def __post_init__(self):
        if not (self.focal > 0 and self.scale > 0 and min(self.pitch) > 0):
            raise SetupError(
                f"focal length, scale and pitch must be positive, got {self.focal}, {self.scale} and {self.pitch}"
            )
        for name in ("focal", "k1", "k2", "scale"):
            object.__setattr__(self, name, float(getattr(self, name)))
        for name, kind in (("size", int), ("centre", float), ("pitch", float)):
            x, y = getattr(self, name)
            object.__setattr__(self, name, (kind(x), kind(y)))

    @property
    def focal_px(self) -> tuple[float, float]:
        """Focal lengths (x, y) in px."""
        return self.scale * self.focal / self.pitch[0], self.focal / self.pitch[1]

    @cached_property
    def fold_radius(self) -> float:
        """Largest distorted radius at which the model is one-to-one: where r (1 + k1 r^2 + k2 r^4) stops growing."""
        roots = np.roots([5 * self.k2, 3 * self.k1, 1.0])
        squares = roots[(np.abs(roots.imag) < 1e-9 * np.abs(roots)) & (roots.real > 0)].real
        return float(np.sqrt(squares.min())) if squares.size else np.inf

    def sensor(self, pixels: ArrayLike) -> np.ndarray:
        """Distorted coordinates (..., 2) on the sensor, from the principal point, of pixels (..., 2)."""
        return (as_pixels(pixels) - self.centre) * [self.pitch[0] / self.scale, self.pitch[1]]

    def normalise(self, pixels: ArrayLike) -> np.ndarray:
        """Undistorted normalised coordinates (..., 2), x/z and y/z, of pixels (..., 2); NaN beyond the fold."""
        seen = self.sensor(pixels)
        square = np.sum(seen**2, axis=-1, keepdims=True)
        flat = seen * (1 + square * (self.k1 + square * self.k2)) / self.focal
        return np.where(square < self.fold_radius**2, flat, np.nan)

    def denormalise(self, coordinates: ArrayLike) -> np.ndarray:
        """Pixels (..., 2) of undistorted normalised coordinates (..., 2); NaN beyond the fold."""
        seen = distort(self.focal * as_pixels(coordinates), self.k1, self.k2, self.fold_radius)
        return seen * [self.scale / self.pitch[0], 1 / self.pitch[1]] + self.centre

    def project(self, points: ArrayLike) -> np.ndarray:
        """Pixels (..., 2) of points (..., 3) mm in the camera's frame; NaN behind the camera."""
        points = as_points(points)
        z = np.where(points[..., 2:] > 0, points[..., 2:], np.nan)
        return self.denormalise(points[..., :2] / z)

    def brown(self, box: tuple[float, float, float, float] | None = None) -> BrownCamera:
        """Our `Camera`, whose distortion leads the other way, with k1, k2, k3 fitted over the picture.

        Parameters
        ----------
        box : (x, y, width, height) px, optional
            The part of the picture that matters, such as that of a sub-image; without it, all.

        Returns
        -------
        BrownCamera
            Focal lengths and principal point are the same; the departure is measured in px.
        """
        x, y, width, height = (0, 0, *self.size) if box is None else box
        grid = np.meshgrid(np.linspace(x, x + width - 1, 65), np.linspace(y, y + height - 1, 65))
        pixels = np.stack(grid, -1).reshape(-1, 2)
        flat = self.normalise(pixels)
        good = np.isfinite(flat).all(-1)
        if np.count_nonzero(good) < 8:
            raise SetupError(f"the lens model folds over in nearly all of {box or 'the picture'}: k1 {self.k1}")
        pixels, flat = pixels[good], flat[good]
        square = np.sum(flat**2, axis=-1)
        powers = np.stack([square, square**2, square**3], -1)
        columns = (flat[:, :, None] * powers[:, None, :] * np.array(self.focal_px)[:, None]).reshape(-1, 3)
        wanted = (pixels - self.centre - flat * self.focal_px).ravel()
        size = np.linalg.norm(columns, axis=0)
        k1, k2, k3 = np.linalg.lstsq(columns / size, wanted)[0] / size
        camera = Camera(self.size, self.focal_px, self.centre, (k1, k2, 0.0, 0.0, k3))
        miss = np.linalg.norm((columns @ np.array([k1, k2, k3]) - wanted).reshape(-1, 2), axis=-1)
        return BrownCamera(camera, float(np.sqrt(np.mean(miss**2))), float(miss.max()))


def distort(undistorted: np.ndarray, k1: float, k2: float, fold_radius: float) -> np.ndarray:
    """Distorted coordinates (..., 2) on the sensor of undistorted ones; NaN where none lies before the fold.

    Newton in the radius, which is monotone up to the fold.
    """
    wanted = np.linalg.norm(undistorted, axis=-1)
    radius = np.minimum(wanted, fold_radius)
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        for _ in range(100):
            square = radius**2
            miss = radius * (1 + square * (k1 + square * k2)) - wanted
            step = miss / (1 + square * (3 * k1 + square * 5 * k2))
            last, radius = radius, np.clip(radius - step, 0.0, fold_radius)
            if not np.any(np.abs(radius - last) > 1e-15 * radius):
                break
        square = radius**2
        miss = radius * (1 + square * (k1 + square * k2)) - wanted
        factor = np.where(wanted > 0, radius / wanted, 1.0)
        factor = np.where(np.abs(miss) <= 1e-12 * wanted, factor, np.nan)
    return undistorted * factor[..., None]
