"""Plane polygons, given by their corners in order."""

import numpy as np
from numpy.typing import ArrayLike


def polygon_area(corners: ArrayLike) -> float:
    """Area of a simple polygon (N, 2), in the square of its unit; never negative."""
    x, y = np.asarray(corners, dtype=float).T
    return 0.5 * abs(float(np.dot(x, np.roll(y, -1)) - np.dot(y, np.roll(x, -1))))


def clip_by_half_plane(corners: ArrayLike, normal: ArrayLike, offset: float) -> np.ndarray:
    """The part of a polygon where ``normal . x <= offset``.

    Parameters
    ----------
    corners : (N, D) array
        Corners in order; D is 2, or 3 for a plane polygon in space.
    normal : (D,) array
        Normal of the border, pointing to the side that is cut away.
    offset : float
        Value of ``normal . x`` on the border.

    Returns
    -------
    (M, D) array
        Corners of what is left, in the same order; M = 0 when nothing is.

    References
    ----------
    Sutherland and Hodgman 1974, Reentrant polygon clipping.
    """
    corners = np.asarray(corners, dtype=float)
    height = corners @ np.asarray(normal, dtype=float) - offset
    kept = []
    for here, there, height_here, height_there in zip(
        corners, np.roll(corners, -1, axis=0), height, np.roll(height, -1), strict=True
    ):
        if height_here <= 0:
            kept.append(here)
        if (height_here < 0 < height_there) or (height_there < 0 < height_here):
            share = height_here / (height_here - height_there)
            kept.append(here + share * (there - here))
    return np.array(kept).reshape(-1, corners.shape[-1])
