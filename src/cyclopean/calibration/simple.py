"""The simple calibration: a ruler seen at two stations a known distance apart, and nothing else."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from ..errors import SetupError, ShapeError
from ..geometry import as_pixels


@dataclass(frozen=True, eq=False)
class SimpleCalibration:
    """Focal length and distance of a pinhole, with standard deviations to first order.

    Each is (...,), or (..., 2) for the x and y axes where it comes from `crossing_lines`.
    """

    focal: np.ndarray  # px, or the unit of the image lengths; NaN where the stations cannot be told apart
    distance: np.ndarray  # mm, from the pinhole to the near station
    sigma_focal: np.ndarray
    sigma_distance: np.ndarray  # mm
    centre: np.ndarray | None = None  # (..., 2) px, where the way from station to station meets the picture
    sigma_centre: np.ndarray | None = None  # (..., 2) px

    @property
    def aspect(self) -> np.ndarray:
        """Focal length along y over that along x, (...,); from `crossing_lines` only."""
        return self.focal[..., 1] / self.focal[..., 0]


def simple_calibration(
    length: ArrayLike,
    travel: ArrayLike,
    image_lengths: ArrayLike,
    sigma: float = 0.1,
    sigma_length: float = 0.0,
    sigma_travel: float = 0.0,
) -> SimpleCalibration:
    """Focal length and distance from an object of known length, seen from two distances.

    The object lies across the optical axis and moves along it, so its image is h = f H / Z at each station:
    f = dZ / (H (1/h2 - 1/h1)) and Z1 = f H / h1. No distortion.

    Parameters
    ----------
    length : (...,) mm
        Length H of the object.
    travel : (...,) mm
        Distance dZ from the near station to the far one.
    image_lengths : (..., 2) px
        Its image at the near station h1 and at the far one h2, h1 > h2.
    sigma : px
        Standard deviation of a coordinate of an image's end; that of its length is sqrt(2) times as large.
    sigma_length, sigma_travel : mm
        Standard deviations of the two known lengths.

    Returns
    -------
    SimpleCalibration
        NaN where h1 > h2 > 0 does not hold: noise has eaten the difference, or the stations are interchanged.

    References
    ----------
    Xiao, thesis (National University of Singapore), appendix B.
    """
    length, travel = np.asarray(length, dtype=float), np.asarray(travel, dtype=float)
    image_lengths = np.asarray(image_lengths, dtype=float)
    if image_lengths.shape[-1:] != (2,):
        raise ShapeError(f"image_lengths must be (..., 2), near and far, got shape {image_lengths.shape}")
    if not (np.all(length > 0) and np.all(travel > 0)):
        raise SetupError(f"length and travel must be positive mm, got {length} and {travel}")
    near, far = np.moveaxis(np.where(image_lengths > 0, image_lengths, np.nan), -1, 0)
    shrink = np.where(near > far, near - far, np.nan)
    focal = travel * near * far / (length * shrink)
    distance = travel * far / shrink
    ends = np.sqrt(2) * sigma
    # derivatives to near and far: of ln f, -far / (near shrink) and near / (far shrink); of Z1, -dZ far and dZ near
    # over shrink squared
    of_focal = np.hypot(far / near, near / far) / shrink * ends
    known = np.hypot(sigma_length / length, sigma_travel / travel)
    of_distance = np.hypot(near, far) / (far * shrink) * ends
    return SimpleCalibration(
        focal, distance, focal * np.hypot(of_focal, known), distance * np.hypot(of_distance, sigma_travel / travel)
    )


def crossing_lines(
    lengths: ArrayLike, travel: float, near: ArrayLike, far: ArrayLike, sigma: float = 0.1
) -> SimpleCalibration:
    """Both focal lengths, the aspect and the principal point from a horizontal and a vertical line that cross.

    The two lines lie in a plane across the optical axis, along the picture's x and y, and move along the axis. Each
    gives the focal length of its axis by `simple_calibration`. As images of one point lie at c + f X / Z, the
    crossing also tells the point c that does not move: (h1 u2 - h2 u1) / (h1 - h2), where h is the image's length.

    Parameters
    ----------
    lengths : (2,) mm
        Of the horizontal and of the vertical line.
    travel : mm
        Distance from the near station to the far one.
    near, far : (..., 4, 2) px
        Ends of the lines' images at the two stations: left, right, top, bottom.
    sigma : px
        Standard deviation of an end's coordinate.

    Returns
    -------
    SimpleCalibration
        focal, distance and centre (..., 2), by the horizontal and by the vertical line. `centre` is the principal
        point where the way from station to station is parallel to the optical axis.

    References
    ----------
    Xiao, thesis (National University of Singapore), appendix B (two crossing object lines).
    """
    near, far = as_pixels(near), as_pixels(far)
    if near.shape != far.shape or near.shape[-2:] != (4, 2):
        raise ShapeError(f"near and far must be (..., 4, 2): left, right, top, bottom; got {near.shape}, {far.shape}")
    lengths = np.asarray(lengths, dtype=float)
    if lengths.shape != (2,):
        raise ShapeError(f"lengths must be those of the horizontal and the vertical line, got shape {lengths.shape}")
    ends = np.stack([near, far], -3)  # (..., station, end, 2)
    images = np.stack([_length(ends[..., :2, :]), _length(ends[..., 2:, :])], -2)  # (..., line, station)
    line = simple_calibration(lengths, travel, images, sigma)
    centre = np.where(np.isfinite(line.focal), _still_point(ends), np.nan)
    step = 1e-3 * np.eye(16).reshape(16, *([1] * (ends.ndim - 3)), 2, 4, 2)  # px; 16 coordinates of ends
    slopes = (_still_point(ends + step) - _still_point(ends - step)) / 2e-3
    sigma_centre = sigma * np.linalg.norm(slopes, axis=0)
    return SimpleCalibration(line.focal, line.distance, line.sigma_focal, line.sigma_distance, centre, sigma_centre)


def _still_point(ends):
    """The point (..., 2) of the picture that does not move from station to station, of ends (..., 2, 4, 2)."""
    h1, h2 = np.moveaxis(np.stack([_length(ends[..., :2, :]), _length(ends[..., 2:, :])], -1), -2, 0)
    u1, u2 = np.moveaxis(_crossing(ends), -2, 0)
    return (h1 * u2 - h2 * u1) / np.where(h1 > h2, h1 - h2, np.nan)


def _length(ends):
    """Lengths (...,) of lines with ends (..., 2, 2)."""
    return np.linalg.norm(ends[..., 1, :] - ends[..., 0, :], axis=-1)


def _crossing(ends):
    """Where the lines from left to right and from top to bottom cross, (..., 2), of ends (..., 4, 2)."""
    left, right, top, bottom = np.moveaxis(ends, -2, 0)
    along, down, offset = right - left, bottom - top, top - left
    determinant = along[..., 0] * down[..., 1] - along[..., 1] * down[..., 0]
    determinant = np.where(determinant != 0, determinant, np.nan)  # lines that never cross
    share = (offset[..., 0] * down[..., 1] - offset[..., 1] * down[..., 0]) / determinant
    return left + share[..., None] * along
