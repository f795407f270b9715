"""Which dot is which point of a target: from a first guess, or from a few points named by hand."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import ArrayLike
from scipy.optimize import linear_sum_assignment
from scipy.spatial import KDTree

from ..errors import ShapeError
from ..geometry import as_pixels, as_points

_ROUNDS = 30


def assign(
    pixels: ArrayLike,
    guess: ArrayLike,
    points: ArrayLike | None = None,
    radius: float | None = None,
    tolerance: float = 3.0,
) -> np.ndarray:
    """Name dots after the points of a target, from a guess where these should be seen.

    Parameters
    ----------
    pixels : (N, 2) array
        Dots found, px; some of them may be something else.
    guess : (P, 2) array
        Where the points should be seen, px, roughly: nearer than half their spacing, after a common shift, turn and
        stretch. NaN where a point cannot be seen; some that can may be missing among the dots.
    points : (P, 3) array, optional
        The points, mm. With them (not all in one plane) the guess is mended by a camera, without by a plane map.
    radius : float, optional
        px, largest distance of a pair in the first round; half the median spacing of the guess without it.
    tolerance : float
        px, largest distance of a pair in the last round.

    Returns
    -------
    (N,) int array
        The point (row of `guess`) that each dot is; -1 for none. No point is given twice.

    Notes
    -----
    Mutual nearest neighbours, a robust map from guess to dots, a new guess, and so on with a shrinking radius and maps
    with more freedom: shift, affine map, then camera (direct linear transform) or homography. The last round pairs
    dots and points at the least sum of distances.
    """
    pixels, guess = as_pixels(pixels).reshape(-1, 2), as_pixels(guess).reshape(-1, 2)
    points = None if points is None else as_points(points).reshape(-1, 3)
    if points is not None and len(points) != len(guess):
        raise ShapeError(f"guess and points must have the same length, got {len(guess)} and {len(points)}")
    seen = np.isfinite(guess).all(axis=1)
    if not seen.any() or not len(pixels):
        return np.full(len(pixels), -1)
    first = 0.5 * _spacing(guess[seen]) if radius is None else radius
    now = guess.copy()
    for limit in np.geomspace(max(first, tolerance), tolerance, _ROUNDS):
        dots, named = _mutual(pixels, now, limit)
        now = _mended(guess, points, pixels[dots], named, now, tolerance)
    return _best_pairs(pixels, now, tolerance)


def assign_from_seeds(
    pixels: ArrayLike, points: ArrayLike, seeds: Mapping[int, ArrayLike], tolerance: float = 3.0
) -> np.ndarray:
    """Name dots after the points of a target, from six or more points named by hand.

    Parameters
    ----------
    pixels : (N, 2) array
        Dots found, px.
    points : (P, 3) array
        The points of the target, mm.
    seeds : mapping
        Number of a point -> its approximate pixel (x, y); at least six that do not lie in one plane.
    tolerance : float
        px, largest distance of a dot from where the camera sees its point.

    Returns
    -------
    (N,) int array
        The point that each dot is; -1 for none.
    """
    pixels, points = as_pixels(pixels).reshape(-1, 2), as_points(points).reshape(-1, 3)
    names = np.array(list(seeds), dtype=int)
    if len(names) < 6 or names.min() < 0 or names.max() >= len(points):
        raise ShapeError(
            f"seeds must name six or more of the points 0 to {len(points) - 1}, got {len(names)} seeds: "
            f"{names[:10].tolist()}"
        )
    places = as_pixels(np.array([seeds[name] for name in names], dtype=float))
    nearest = KDTree(pixels).query(places)[1] if len(pixels) else np.zeros(len(names), int)
    close = len(pixels) > 0 and np.linalg.norm(pixels[nearest] - places, axis=1) < 4 * tolerance
    camera = linear_camera(points[names], np.where(np.reshape(close, (-1, 1)), pixels[nearest], places))
    return assign(pixels, project_linear(camera, points), points, tolerance=tolerance)


def linear_camera(points: ArrayLike, pixels: ArrayLike) -> np.ndarray:
    """The camera (3, 4) that takes points (N, 3) mm to pixels (N, 2), by a direct linear transform.

    Homogeneous least squares on normalised coordinates; NaN for fewer than six points, or points in one plane.

    References
    ----------
    Hartley and Zisserman, Multiple View Geometry, 2nd edition 2004, algorithm 7.1.
    """
    points, pixels = as_points(points), as_pixels(pixels)
    if len(points) < 6 or len(points) != len(pixels):
        return np.full((3, 4), np.nan)
    to_points, to_pixels = _normaliser(points), _normaliser(pixels)
    solid, flat = _mapped(to_points, points), _mapped(to_pixels, pixels)
    if np.linalg.svd(solid, compute_uv=False)[-1] < 1e-6 * np.sqrt(len(points)):
        return np.full((3, 4), np.nan)
    camera = _null_vector(solid, flat).reshape(3, 4)
    return np.linalg.solve(to_pixels, camera) @ to_points


def project_linear(camera: np.ndarray, points: ArrayLike) -> np.ndarray:
    """Pixels (..., 2) of points (..., 3) in a camera (3, 4)."""
    return _mapped(camera, as_points(points))


def plane_map(guess: np.ndarray, pixels: np.ndarray) -> np.ndarray:
    """The homography (3, 3) from guess (N, 2) to pixels (N, 2), by a direct linear transform; NaN for fewer than 4."""
    if len(guess) < 4:
        return np.full((3, 3), np.nan)
    before, after = _normaliser(guess), _normaliser(pixels)
    middle = _null_vector(_mapped(before, guess), _mapped(after, pixels)).reshape(3, 3)
    return np.linalg.solve(after, middle) @ before


def _null_vector(sources, pixels):
    """The map, row by row, that takes homogeneous sources (N, D) to pixels (N, 2) best in the algebraic sense."""
    ones = np.column_stack([sources, np.ones(len(sources))])
    zero = np.zeros_like(ones)
    rows = [np.hstack([ones, zero, -pixels[:, :1] * ones]), np.hstack([zero, ones, -pixels[:, 1:] * ones])]
    return np.linalg.svd(np.concatenate(rows), full_matrices=False)[2][-1]


def _normaliser(values):
    """Map (D + 1, D + 1) that moves values (N, D) to their centroid and scales them to unit size."""
    size = values.shape[1]
    centre = values.mean(axis=0)
    scale = np.sqrt(size) / max(np.sqrt(((values - centre) ** 2).sum(axis=1).mean()), 1e-12)
    matrix = np.diag([*np.full(size, scale), 1.0])
    matrix[:-1, -1] = -scale * centre
    return matrix


def _mapped(matrix, values):
    """Values (..., D) through a projective map (E + 1, D + 1), as (..., E)."""
    out = values @ matrix[:, :-1].T + matrix[:, -1]
    with np.errstate(divide="ignore", invalid="ignore"):
        return out[..., :-1] / out[..., -1:]


def _spacing(guess):
    distances = KDTree(guess).query(guess, k=2)[0][:, 1] if len(guess) > 1 else np.array([20.0])
    return float(np.median(distances))


def _mutual(pixels, guess, radius):
    """Rows of dots and of points that are each other's nearest, within a radius."""
    seen = np.flatnonzero(np.isfinite(guess).all(axis=1))
    if not len(seen):
        return np.empty(0, int), np.empty(0, int)
    distance, nearest = KDTree(guess[seen]).query(pixels)
    back = KDTree(pixels).query(guess[seen])[1]
    good = (distance <= radius) & (back[nearest] == np.arange(len(pixels)))
    return np.flatnonzero(good), seen[nearest[good]]


def _mended(guess, points, pixels, named, now, tolerance):
    """The guess, mapped onto the dots by the map with as much freedom as the pairs found so far allow."""
    count = len(named)
    if count < 3:
        return now
    sources, fit = guess, _shift
    if count >= 6:
        fit = _affine
    if points is None and count >= 12:
        fit = plane_map
    if points is not None and count >= 15 and np.isfinite(linear_camera(points[named], pixels)).all():
        sources, fit = points, linear_camera
    weight = np.ones(count, bool)
    for _ in range(5):  # fit, drop what lies far out, fit again
        matrix = fit(sources[named][weight], pixels[weight])
        if not np.isfinite(matrix).all():
            return now
        gap = np.linalg.norm(_mapped(matrix, sources[named]) - pixels, axis=1)
        limit = max(3 * 1.4826 * np.median(gap), 0.5 * tolerance)
        if (kept := gap <= limit).sum() < max(count // 2, 3) or (kept == weight).all():
            break
        weight = kept
    return _mapped(matrix, sources)


def _shift(guess, pixels):
    matrix = np.eye(3)
    matrix[:2, 2] = np.median(pixels - guess, axis=0)
    return matrix


def _affine(guess, pixels):
    design = np.column_stack([guess, np.ones(len(guess))])
    return np.vstack([np.linalg.lstsq(design, pixels, rcond=None)[0].T, [0, 0, 1]])


def _best_pairs(pixels, guess, tolerance):
    """The point of each dot (N,), by the least sum of distances, no pair longer than the tolerance."""
    ids = np.full(len(pixels), -1)
    seen = np.flatnonzero(np.isfinite(guess).all(axis=1))
    if not len(seen) or not len(pixels):
        return ids
    distance = np.linalg.norm(pixels[:, None] - guess[seen], axis=-1)
    dots, named = linear_sum_assignment(np.minimum(distance, 2 * tolerance))
    good = distance[dots, named] <= tolerance
    ids[dots[good]] = seen[named[good]]
    return ids
