"""Real setups that differ from the drawing, and what they do to depths that are computed with the drawing."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ..errors import CyclopeanError, OpticError
from ..optics import Prism
from ..rigs import Setup, View
from ..triangulation import triangulate
from ..triangulation.points import as_correspondences
from .tolerance_prisms import prism_pixels

_CAMERA_COUNT = 9  # CAMERA_PARAMETERS come first in the parameters of a setup
_ROUNDS = 8  # of Gauss-Newton; from a point some mm away three do
_STILL = 1e-5  # mm; what is left after such a step is hundredths of it


def drawn_pixels(setup: Setup, values: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Where real setups show points.

    Parameters
    ----------
    setup : Setup
        The drawing; projections start from its views.
    values : (D, F) array
        All parameters (`setup.parameter_names`) of D real setups; rad, mm, px.
    points : (N, 3) array
        Points in the rig frame, mm.

    Returns
    -------
    (D, N, V, 2) array
        Pixels; NaN where the real view does not show the point: it left the facet or the picture, the light is lost,
        or there can be no such setup.
    """
    points = np.asarray(points, dtype=float)
    if isinstance(setup.optic, Prism):
        return prism_pixels(setup, values, points)
    return optic_pixels(setup, values, points)


def optic_pixels(setup: Setup, values: np.ndarray, points: np.ndarray) -> np.ndarray:
    """What `drawn_pixels` finds, for any optic, one setup after the other."""
    nominal = list(setup.rig())
    pixels = np.full((len(values), len(points), len(nominal), 2), np.nan)
    for k, row in enumerate(values):
        try:
            camera, paths = _real_parts(setup, row)
        except CyclopeanError:  # no such glass could be ground
            continue
        for number, (view, path) in enumerate(zip(nominal, paths, strict=True)):
            found = view.continued(camera, path).project(points)
            light = np.isfinite(View(camera, path, name=view.name).rays(found).directions[:, 0])
            pixels[k, :, number] = np.where((light & camera.contains(found))[:, None], found, np.nan)
    return pixels


def _real_parts(setup, values):
    """Camera and paths of a setup with these parameters (F,).

    Facets that would cut through the rim of the glass run on: the outline is no part of the question.
    """
    camera = setup.camera.with_lens(values[:_CAMERA_COUNT])
    try:
        optic = setup.optic.with_parameters(values[_CAMERA_COUNT:])
    except OpticError:
        if getattr(setup.optic, "radius", None) is None:
            raise
        optic = replace(setup.optic, radius=None).with_parameters(values[_CAMERA_COUNT:])
    return camera, optic.paths(setup.wavelength_nm)


def bare_views(setup: Setup) -> list[View]:
    """The setup's views without borders, for `nearby_points`: with derivatives to points alone."""
    views = []
    for view in setup.rig():
        assert isinstance(view, View)
        path = replace(view.path, parameter_names=(), derivatives=np.zeros((0, len(view.path.interfaces), 5)))
        views.append(view.continued(view.camera, path))
    return views


def nearby_points(views: Sequence[View], start: np.ndarray, pixels: np.ndarray) -> np.ndarray:
    """The points that explain pixels best, sought from points close by: `triangulate` for very many of them.

    Parameters
    ----------
    views : sequence of V views
        Without borders, see `bare_views`.
    start : (..., 3) array
        Points not far from those that are sought, mm.
    pixels : (..., V, 2) array
        NaN where a view does not see the point.

    Returns
    -------
    (..., 3) array
        mm; NaN where fewer than two views see the point, or no point explains the pixels.

    References
    ----------
    Hartley and Zisserman, Multiple View Geometry, section 12.3: the least sum of squares of the pixels' errors, by
    Gauss-Newton.
    """
    pixels = as_correspondences(pixels, len(views))
    shape, pixels = pixels.shape[:-2], pixels.reshape(-1, len(views), 2)
    points = np.array(np.broadcast_to(start, (*shape, 3))).reshape(-1, 3)
    seen = np.isfinite(pixels).all(-1)
    points[seen.sum(-1) < 2] = np.nan
    left = _settle(views, points, pixels, seen, np.flatnonzero(np.isfinite(points[:, 0])))
    if len(left):  # the start was not close enough
        points[left] = triangulate(views, pixels[left]).points
        left = _settle(views, points, pixels, seen, left[np.isfinite(points[left, 0])])
        points[left] = np.nan
    return points.reshape(*shape, 3)


def _settle(views, points, pixels, seen, rows):
    """Move some rows of points (M, 3) until they rest; returns the rows that do not."""
    for _ in range(_ROUNDS):
        if not len(rows):
            break
        step = _step(views, points[rows], pixels[rows], seen[rows])
        points[rows] += step
        rows = rows[~(np.abs(step).max(-1) <= _STILL)]
    return rows


def _step(views, points, pixels, seen):
    """Gauss-Newton step (..., 3) mm of points (..., 3)."""
    normal, gradient = np.zeros((*points.shape[:-1], 3, 3)), np.zeros(points.shape)
    for k, view in enumerate(views):
        found = view.pixel_derivatives(points)
        used = seen[..., k, None, None]
        jacobian = np.where(used, found.to_point, 0.0)
        miss = np.where(used[..., 0], pixels[..., k, :] - found.pixels, 0.0)
        normal += np.einsum("...ij,...ik->...jk", jacobian, jacobian)
        gradient += np.einsum("...ij,...i->...j", jacobian, miss)
    return _solve(normal, gradient)


def _solve(matrices, vectors):
    """Solutions (..., 3) of symmetric systems (..., 3, 3) by their cofactors: quicker than LAPACK for so many."""
    a, b, c = (matrices[..., 0, k] for k in range(3))
    d, e, f = matrices[..., 1, 1], matrices[..., 1, 2], matrices[..., 2, 2]
    cofactors = np.stack([d * f - e * e, c * e - b * f, b * e - c * d, a * f - c * c, b * c - a * e, a * d - b * b], -1)
    aa, ab, ac, bb, bc, cc = np.moveaxis(cofactors, -1, 0)
    x, y, z = np.moveaxis(vectors, -1, 0)
    with np.errstate(divide="ignore", invalid="ignore"):
        scale = 1 / (a * aa + b * ab + c * ac)
        return (
            np.stack([aa * x + ab * y + ac * z, ab * x + bb * y + bc * z, ac * x + bc * y + cc * z], -1)
            * scale[..., None]
        )
