"""The fundamental matrix that fits corresponding pixels best."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from ..errors import ShapeError
from ..geometry import as_pixels, rotation_from_vector
from ..rigs.two_views import homogeneous


def fitted_fundamental(first: ArrayLike, second: ArrayLike) -> np.ndarray:
    """The matrix F (3, 3), its norm 1, with ``x2 @ F @ x1`` nearest to 0 for corresponding pixels.

    Parameters
    ----------
    first, second : (N, 2) array
        Pixels of the same N >= 8 points in two pictures, without false ones; undistorted where there is distortion.

    Notes
    -----
    The eight-point algorithm with normalised pixels (Hartley 1997), then the least sum of squares of first-order
    distances (Sampson 1982) over all matrices of rank 2, by two rotations and an angle (Bartoli and Sturm 2004).
    """
    from scipy.optimize import least_squares

    first, second = as_pixels(first), as_pixels(second)
    if first.ndim != 2 or first.shape != second.shape or len(first) < 8:
        raise ShapeError(f"wanted 8 pairs of pixels or more, both (N, 2), got {first.shape} and {second.shape}")
    (start, from_first), (end, from_second) = _normalised(first), _normalised(second)
    design = (end[:, :, None] * start[:, None, :]).reshape(-1, 9)
    left, values, right = np.linalg.svd(np.linalg.svd(design, full_matrices=False)[2][-1].reshape(3, 3))
    angle = np.arctan2(values[1], values[0])

    def matrix(x):
        middle = np.diag([np.cos(angle + x[6]), np.sin(angle + x[6]), 0.0])
        turned = left @ rotation_from_vector(x[:3]) @ middle @ rotation_from_vector(x[3:6]) @ right
        return from_second.T @ turned @ from_first

    best = matrix(least_squares(lambda x: sampson_distance(matrix(x), first, second), np.zeros(7), method="lm").x)
    return best / np.linalg.norm(best)


def sampson_distance(fundamental: np.ndarray, first: np.ndarray, second: np.ndarray) -> np.ndarray:
    """How far (N,) px pairs of pixels (N, 2) are off F together, to first order, with its sign.

    References
    ----------
    Sampson 1982, Fitting conic sections to "very scattered" data; Hartley and Zisserman, eq. 11.9.
    """
    start, end = homogeneous(first), homogeneous(second)
    in_second, in_first = start @ fundamental.T, end @ fundamental
    slope = (in_second[:, :2] ** 2).sum(-1) + (in_first[:, :2] ** 2).sum(-1)
    return (end * in_second).sum(-1) / np.sqrt(slope)


def _normalised(pixels):
    """Homogeneous pixels (N, 3) around their mean, of mean length sqrt(2), and the matrix (3, 3) that makes them."""
    centre = pixels.mean(0)
    scale = np.sqrt(2) / np.linalg.norm(pixels - centre, axis=-1).mean()
    matrix = np.array([[scale, 0.0, -scale * centre[0]], [0.0, scale, -scale * centre[1]], [0.0, 0.0, 1.0]])
    return homogeneous(pixels) @ matrix.T, matrix
