"""How a triangulated point answers to its pixels, and so to all that the setup is wrong about."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from ..geometry import as_points
from ..rigs import ViewLike

_SINGULAR = 1e-14  # smallest over largest eigenvalue of the information, below which the views tell no depth


@dataclass(frozen=True, eq=False)
class PointResponse:
    """Derivatives of triangulated points (...,) to pixels, and of pixels to parameters."""

    gain: np.ndarray  # (..., 3, V, 2) mm/px; zero for views that do not count, NaN where fewer than two do
    to_parameters: np.ndarray  # (..., V, 2, F) px per mm, rad, px, 1; zero for views that do not count

    @property
    def shifts(self) -> np.ndarray:
        """(..., 3, F): shift (mm) of the point per unit of each parameter by which the real one exceeds the believed.

        Pixels come from the real setup and are triangulated by the believed one. The other way round, the same
        pixels triangulated by a setup whose parameter was raised, has the opposite sign.
        """
        return self.moved_by(self.to_parameters)

    @property
    def covariance(self) -> np.ndarray:
        """(..., 3, 3) mm^2 of the point for independent noise of 1 px in every pixel coordinate."""
        return np.einsum("...ivk,...jvk->...ij", self.gain, self.gain)

    def moved_by(self, pixels: np.ndarray) -> np.ndarray:
        """Shifts (..., 3, K) mm of the points for K changes (..., V, 2, K) px of their pixels."""
        shape = self.gain.shape[:-2]
        return self.gain.reshape(*shape, -1) @ pixels.reshape(*pixels.shape[:-3], -1, pixels.shape[-1])


def point_response(views: Sequence[ViewLike], points: ArrayLike, seen: ArrayLike | None = None) -> PointResponse:
    """How triangulated points react to changes of their pixels and of the setup.

    Parameters
    ----------
    views : sequence of V views
        A rig. All its views must share their F parameters, as those of a setup do.
    points : (..., 3) array
        Points in the rig frame, mm.
    seen : (..., V) bool array, optional
        Which views count; those that see the point where it is not given. Borders of views do not count otherwise:
        derivatives are those of views without end.

    Returns
    -------
    PointResponse
        (...,) NaN where fewer than two views see a point, or all see it along one line.

    Notes
    -----
    A triangulated point minimises the reprojection error. Where that is zero, the implicit function theorem gives
    dX = (J^T J)^-1 J^T du exactly, for a change du of the pixels and J = d pixel / d X of all views.

    References
    ----------
    Hartley and Zisserman, Multiple View Geometry, result 5.10 and section 5.2.4.
    """
    points = as_points(points)
    if seen is None:
        seen = np.stack([np.isfinite(view.project(points)).all(-1) for view in views], -1)
    found = [view.unbounded().pixel_derivatives(points) for view in views]
    to_point = np.stack([one.to_point for one in found], -3)
    to_parameters = np.stack([np.concatenate([one.to_camera, one.to_optic], -1) for one in found], -3)
    good = np.asarray(seen, dtype=bool) & np.isfinite(to_point).all((-1, -2))
    to_point = np.where(good[..., None, None], to_point, 0.0)
    to_parameters = np.where(good[..., None, None], to_parameters, 0.0)
    flat = to_point.reshape(*points.shape[:-1], -1, 3)
    information = np.swapaxes(flat, -1, -2) @ flat
    gain = np.swapaxes(flat @ _inverses(information, good.sum(-1) >= 2), -1, -2)
    return PointResponse(gain.reshape(*points.shape[:-1], 3, len(found), 2), to_parameters)


def _inverses(information, enough):
    """Inverses (..., 3, 3) of symmetric matrices; NaN where there is not enough, or they are singular."""
    values = np.linalg.eigvalsh(information)
    good = enough & (values[..., 0] > _SINGULAR * values[..., 2])
    inverses = np.linalg.inv(np.where(good[..., None, None], information, np.eye(3)))
    return np.where(good[..., None, None], inverses, np.nan)
