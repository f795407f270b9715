"""Epipolar lines and epipoles of two pinhole cameras, in undistorted pixels."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from ..errors import ShapeError
from ..geometry import as_pixels


def epipolar_line(fundamental: ArrayLike, pixels: ArrayLike) -> np.ndarray:
    """Lines (..., 3) in the second picture of pixels (..., 2) in the first, both undistorted.

    A line (a, b, c) holds the pixels with a x + b y + c = 0, and a^2 + b^2 = 1: for any other pixel the sum is its
    distance in px. For lines in the first picture hand in the transposed matrix.
    """
    pixels = as_pixels(pixels)
    matrix = _as_matrix(fundamental)
    lines = np.einsum("ij,...j->...i", matrix[:, :2], pixels) + matrix[:, 2]
    with np.errstate(divide="ignore", invalid="ignore"):  # the epipole itself has no line
        return lines / np.linalg.norm(lines[..., :2], axis=-1, keepdims=True)


def epipoles(fundamental: ArrayLike) -> tuple[np.ndarray, np.ndarray]:
    """Where each camera stands in the other's picture, undistorted: homogeneous (3,) in the first, in the second.

    Unit vectors (x, y, w): the pixel is (x / w, y / w), and w = 0 for cameras that stand side by side.
    """
    left, _, right = np.linalg.svd(_as_matrix(fundamental))
    return right[2], left[:, 2]


def distance_to_line(lines: ArrayLike, pixels: ArrayLike) -> np.ndarray:
    """Distance (...,) px, with a sign, of pixels (..., 2) from lines (..., 3) such as `epipolar_line` gives."""
    lines, pixels = np.asarray(lines, dtype=float), as_pixels(pixels)
    return (lines[..., :2] * pixels).sum(-1) + lines[..., 2]


def straight_line(pixels: ArrayLike) -> np.ndarray:
    """The line (..., 3) that lies nearest to pixels (..., D, 2), by least squares across it; NaN for fewer than two.

    References
    ----------
    Pearson 1901, On lines and planes of closest fit to systems of points in space.
    """
    pixels = as_pixels(pixels)
    known = np.isfinite(pixels).all(-1)
    count = known.sum(-1)[..., None]
    safe = np.where(known[..., None], pixels, 0.0)
    with np.errstate(divide="ignore", invalid="ignore"):
        centre = np.where(count >= 2, safe.sum(-2) / count, np.nan)
    arm = np.where(known[..., None], pixels - centre[..., None, :], 0.0)
    scatter = np.einsum("...di,...dj->...ij", arm, arm)
    angle = 0.5 * np.arctan2(2 * scatter[..., 0, 1], scatter[..., 0, 0] - scatter[..., 1, 1])  # of the long axis
    normal = np.where(count >= 2, np.stack([-np.sin(angle), np.cos(angle)], -1), np.nan)
    return np.concatenate([normal, -(normal * centre).sum(-1, keepdims=True)], -1)


def _as_matrix(fundamental):
    matrix = np.asarray(fundamental, dtype=float)
    if matrix.shape != (3, 3):
        raise ShapeError(f"a fundamental matrix has shape (3, 3), got {matrix.shape}")
    return matrix
