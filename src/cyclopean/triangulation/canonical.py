"""Two equal cameras side by side: the textbook's stereo."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from ..errors import SetupError, ShapeError
from ..geometry import as_pixels
from .points import Points, kept


def canonical_stereo(
    left: ArrayLike,
    right: ArrayLike,
    focal: float,
    baseline: float,
    sigma: float = 0.1,
    centre: ArrayLike = (0.0, 0.0),
) -> Points:
    """Points from the disparity of two equal, parallel cameras: z = focal x baseline / (x_left - x_right).

    Parameters
    ----------
    left, right : (..., 2) array
        Undistorted pixels of the point in both pictures.
    focal : float
        Focal length of both cameras, px.
    baseline : float
        Distance between their centres, along x, mm.
    sigma : float
        Standard deviation of each pixel coordinate, px.
    centre : (2,) array
        Principal point of both cameras, px.

    Returns
    -------
    Points
        In the frame half way between the cameras: x towards the right one, y down, z forward. NaN where the disparity
        is not positive. The residual is what a difference of rows leaves. No other unbiased estimate is better to
        first order: y is that of the mean row.

    References
    ----------
    Xiao, thesis (National University of Singapore), eq. 2.1; its covariance to first order in the noise.
    """
    left, right = as_pixels(left), as_pixels(right)
    for name, value in (("focal length", focal), ("baseline", baseline), ("pixel noise", sigma)):
        if np.ndim(value) or not 0 < float(value) < np.inf:
            raise SetupError(f"the {name} must be one positive number, got {value}")
    try:
        left, right = np.broadcast_arrays(left - centre, right - centre)
    except ValueError:
        raise ShapeError(f"left and right pixels must be pairs, got {left.shape} and {right.shape}") from None
    disparity = left[..., 0] - right[..., 0]
    seen = np.isfinite(left).all(-1) & np.isfinite(right).all(-1)
    good = seen & (disparity > 0)
    scale = baseline / np.where(good, disparity, np.nan)  # mm/px
    middle = (left + right) / 2
    points = np.stack([scale * middle[..., 0], scale * middle[..., 1], scale * focal], -1)
    shrink = scale / np.where(good, disparity, np.nan)  # mm/px^2
    zero = np.zeros_like(scale)
    jacobian = np.stack(  # to x left, y left, x right, y right
        [
            np.stack([-shrink * right[..., 0], zero, shrink * left[..., 0], zero], -1),
            np.stack([-shrink * middle[..., 1], scale / 2, shrink * middle[..., 1], scale / 2], -1),
            np.stack([-shrink * focal, zero, shrink * focal, zero], -1),
        ],
        -2,
    )
    covariance = sigma**2 * np.einsum("...ij,...kj->...ik", jacobian, jacobian)
    residual = np.abs(left[..., 1] - right[..., 1]) / np.sqrt(8)  # half of it in two of four coordinates
    return kept(points, covariance, residual, np.where(seen, 2, 0), good)
