"""The true epipolar curve of a pixel: its ray, as every other sub-image sees it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from ..cameras.camera import CAMERA_PARAMETERS
from ..errors import SetupError, ShapeError
from ..geometry import as_pixels
from ..rigs import PixelDerivatives, Rig, View, ViewLike

_BLOCK = 200_000  # points that are traced at once: bounds the memory
_NODES = 17  # samples at which the uncertainty is computed; it hardly changes between them


@dataclass(frozen=True, eq=False)
class EpipolarCurves:
    """Where pixels of one view can lie in the others, sampled evenly in inverse depth, from far to near.

    `sigma` is the standard deviation by which a curve lies off sideways, across itself, for noise of the given pixel.
    A pixel found in the other view has noise of its own, to be added in quadrature.
    """

    pixels: np.ndarray  # (..., V, D, 2) px; NaN where a view does not see the point, and in the given view itself
    inverse_depths: np.ndarray  # (D,) 1/mm, growing: z of the rig frame
    points: np.ndarray  # (..., D, 3) mm, on the ray of the given pixel
    sigma: np.ndarray  # (..., V, D) px, across the curve
    view: int  # the view of the given pixels

    @property
    def depths(self) -> np.ndarray:
        """Depths (D,) mm of the samples, falling."""
        return 1 / self.inverse_depths


def epipolar_curves(
    rig: Rig,
    view: int,
    pixels: ArrayLike,
    depths: tuple[float, float],
    samples: int = 65,
    sigma: float = 0.1,
    bounded: bool = True,
    *,
    names: Sequence[str] = (),
    covariance: ArrayLike | None = None,
) -> EpipolarCurves:
    """The curves on which the points seen at given pixels lie in every other view.

    Each pixel's ray is traced to the scene and seen through the optic by the other views. No view is taken for a
    pinhole, so the curve is exact for a setup that is exact.

    Parameters
    ----------
    rig : Rig
        Two views or more.
    view : int
        The view that the pixels belong to.
    pixels : (..., 2) array
        Pixels of the photograph as it is, with its distortion.
    depths : (2,) mm
        Nearest and farthest depth, z of the rig frame.
    samples : int
        Samples of each curve.
    sigma : float
        Standard deviation of each coordinate of the given pixels, px.
    bounded : bool
        Whether curves end where the sub-images end, and pixels outside their own have none. Without, views are taken
        without borders.
    names : (P,) names, optional
        Parameters that are uncertain, by the names of `setup.parameter_names`.
    covariance : (P, P) array, optional
        Their covariance (mm, rad, px), such as a calibration states it. It adds to the variance across the curve.

    Returns
    -------
    EpipolarCurves
        (...,) curves; NaN where rays are lost or a view does not see the point.

    Raises
    ------
    SetupError
        For a rig of one view, a view that is not there, or depths that are no range.

    Notes
    -----
    At a fixed depth the point moves with the given pixel by the inverse of how its own view sees points move, and the
    other view sees that movement: only the part across the curve shifts the curve. The same holds for parameters of
    the setup, by the implicit function theorem.
    """
    pixels = as_pixels(pixels)
    index = checked_view(rig, view)
    inverse_depths = inverse_depth_samples(depths, samples)
    if not (np.isfinite(sigma) and sigma >= 0):
        raise SetupError(f"the pixel noise must be a number of px, 0 or more, got {sigma}")
    errors = _ParameterErrors.of(rig, names, covariance)
    views = [with_few_derivatives(v if bounded else v.unbounded(), errors is not None) for v in rig]
    flat = pixels.reshape(-1, 2)
    block = max(1, _BLOCK // samples)
    parts = [
        _curves(views, index, flat[start : start + block], inverse_depths, sigma, errors)
        for start in range(0, max(len(flat), 1), block)
    ]
    curves, points, spread = (
        np.concatenate(part).reshape(*pixels.shape[:-1], *part[0].shape[1:]) for part in zip(*parts, strict=True)
    )
    return EpipolarCurves(curves, inverse_depths, points, spread, index)


def checked_view(rig: Rig, view: int) -> int:
    """The number of a view of a rig that has others, or a SetupError."""
    if len(rig) < 2:
        raise SetupError("a rig of one view has no epipolar curves: they need a second view that sees the same points")
    if isinstance(view, bool) or not isinstance(view, int | np.integer) or not 0 <= view < len(rig):
        raise SetupError(f"view {view!r} is not there: the views of this rig are 0 to {len(rig) - 1}")
    return int(view)


def inverse_depth_samples(depths: tuple[float, float], samples: int) -> np.ndarray:
    """Inverse depths (D,) 1/mm, evenly from far to near, or a SetupError."""
    if np.shape(depths) != (2,) or not 0 < depths[0] < depths[1] < np.inf:
        raise SetupError(f"a depth range is (near, far) with 0 < near < far in mm, got {depths}")
    if samples < 3:
        raise SetupError(f"a curve needs 3 samples or more, got {samples}")
    return np.linspace(1 / depths[1], 1 / depths[0], samples)


def with_few_derivatives(view: ViewLike, all_of_them: bool) -> ViewLike:
    """The view, without the derivatives to its optic where they are not wanted: they cost most of the time."""
    if all_of_them or not isinstance(view, View):
        return view
    return replace(view, path=replace(view.path, parameter_names=(), derivatives=None))


@dataclass(frozen=True, eq=False)
class _ParameterErrors:
    """A covariance of parameters, with its columns in the derivatives of every view."""

    columns: np.ndarray  # (P,) int, in [to_camera, to_optic]
    covariance: np.ndarray  # (P, P)

    @classmethod
    def of(cls, rig, names, covariance):
        if covariance is None:
            if len(names):
                raise SetupError(f"{len(names)} parameters are named; their covariance is missing")
            return None
        covariance = np.asarray(covariance, dtype=float)
        if covariance.shape != (len(names), len(names)):
            raise ShapeError(f"a covariance of {len(names)} named parameters is square, got {covariance.shape}")
        if not all(isinstance(view, View) and view.camera is rig[0].camera for view in rig):
            raise SetupError("a covariance of parameters is for the views of one setup; this rig has other views")
        known = [f"camera.{name}" for name in CAMERA_PARAMETERS]
        known += [f"optic.{name}" for name in rig[0].path.parameter_names]
        unknown = [name for name in names if name not in known]
        if unknown:
            raise SetupError(f"{unknown[0]} is no parameter of this setup; it has {', '.join(known)}")
        return cls(np.array([known.index(name) for name in names], dtype=int), covariance)

    def gradient(self, derivatives: PixelDerivatives) -> np.ndarray:
        """Derivatives (..., 2, P) of pixels to the parameters."""
        every = np.concatenate([derivatives.to_camera, derivatives.to_optic], -1)
        return every[..., self.columns]


def _curves(views, index, pixels, inverse_depths, sigma, errors):
    """Pixels (N, V, D, 2), points (N, D, 3) and spreads (N, V, D) of the curves of pixels (N, 2)."""
    rays = views[index].rays(pixels[:, None])
    points = rays.at_depth(1 / inverse_depths)
    curves = np.stack([view.project(points) for view in views], 1)
    curves[:, index] = np.nan
    nodes = np.unique(np.linspace(0, len(inverse_depths) - 1, _NODES).round().astype(int))
    with np.errstate(divide="ignore", invalid="ignore"):
        spread = _spreads(views, index, rays, points[:, nodes], sigma, errors)
    spread = _between(spread, nodes, len(inverse_depths))
    return curves, points, np.where(np.isfinite(curves[..., 0]), spread, np.nan)


def _spreads(views, index, rays, points, sigma, errors):
    """Standard deviations (N, V, M) across the curves at points (N, M, 3) of rays (N, 1)."""
    own = views[index].unbounded().pixel_derivatives(points)
    back = _inverse(own.to_point[..., :2])  # mm/px: how x and y of the point move with the pixel, at its depth
    along = rays.directions / rays.directions[..., 2:]  # mm of the point for each mm of depth
    spread = np.full((len(points), len(views), points.shape[1]), np.nan)
    for k, view in enumerate(views):
        if k == index:
            continue
        other = view.unbounded().pixel_derivatives(points)
        tangent = (other.to_point * along[..., None, :]).sum(-1)
        normal = np.stack([-tangent[..., 1], tangent[..., 0]], -1)
        normal = normal / np.linalg.norm(normal, axis=-1, keepdims=True)
        moves = np.einsum("...ij,...jk->...ik", other.to_point[..., :2], back)  # px/px
        across = np.einsum("...i,...ij->...j", normal, moves)
        variance = sigma**2 * (across**2).sum(-1)
        if errors is not None:
            gradient = np.einsum("...i,...ip->...p", normal, errors.gradient(other))
            gradient -= np.einsum("...i,...ip->...p", across, errors.gradient(own))
            variance = variance + np.einsum("...p,pq,...q->...", gradient, errors.covariance, gradient)
        spread[:, k] = np.sqrt(variance)
    return spread


def _between(values, nodes, count):
    """Values (..., M) at some of `count` samples as values (..., count) at all: lines between them, known ends kept."""
    place = np.arange(count)
    left = np.minimum(np.searchsorted(nodes, place, side="right") - 1, len(nodes) - 2)
    share = (place - nodes[left]) / (nodes[left + 1] - nodes[left])
    before, behind = values[..., left], values[..., left + 1]
    before, behind = np.where(np.isnan(before), behind, before), np.where(np.isnan(behind), before, behind)
    return before + share * (behind - before)


def _inverse(matrices):
    """Inverses of (..., 2, 2) matrices; inf or NaN where they are singular."""
    (a, b), (c, d) = np.moveaxis(matrices, (-2, -1), (0, 1))
    adjugate = np.stack([np.stack([d, -b], -1), np.stack([-c, a], -1)], -2)
    return adjugate / (a * d - b * c)[..., None, None]
