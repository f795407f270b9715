"""Errors of depth over the working volume: by the noise of pixels, and by what the calibration does not know."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ..errors import SetupError
from ..rigs import Rig, Setup
from ..targets import DIRECT
from ..triangulation.sensitivity import point_response
from .physical import Calibration

_COARSE = 48  # samples across when the common field is sought
_DEPTHS = 5


@dataclass(frozen=True, eq=False)
class DepthErrors:
    """Standard deviations of triangulated depth over the common field of view.

    NaN where fewer than two views see a point. The part of the calibration is common to all photographs that are
    taken with it and nearly so to neighbouring points: it does not average out, but much of it cancels in the
    difference of two near depths.
    """

    depths: np.ndarray  # (D,) mm
    points: np.ndarray  # (D, H, W, 3) mm, in the rig's frame
    views: np.ndarray  # (D, H, W) int: how many views see the point
    noise: np.ndarray  # (D, H, W) mm, by the noise of pixels
    calibration: np.ndarray  # (D, H, W) mm, by the calibration's uncertainty
    slopes: np.ndarray  # (D, H, W, S): derivatives of depth to the calibration's free parameters
    pixel_sigma: float  # px, the noise of a pixel coordinate that `noise` is stated for

    @property
    def total(self) -> np.ndarray:
        """(D, H, W) mm, both together."""
        return np.hypot(self.noise, self.calibration)

    def table(self) -> list[tuple[float, float, float, float, float]]:
        """Rows (depth, noise, calibration, both, largest of both), mm: root mean square over the field."""
        rows = []
        for k, depth in enumerate(self.depths):
            parts = (rms(self.noise[k]), rms(self.calibration[k]), rms(self.total[k]), largest(self.total[k]))
            rows.append((float(depth), *parts))
        return rows


def depth_errors(
    calibration: Calibration,
    depths: Sequence[float] | np.ndarray | None = None,
    pixel_sigma: float = 0.1,
    *,
    samples: int = 24,
    channel: int = 0,
) -> DepthErrors:
    """How far triangulated depths can be trusted, point by point.

    Parameters
    ----------
    calibration : Calibration
        A finished calibration.
    depths : sequence of D mm, optional
        z of the planes to look at; five between the nearest and the farthest target where not given.
    pixel_sigma : float
        Noise of a matched pixel coordinate, px.
    samples : int
        Samples across the common field at each depth.
    channel : int
        Colour channel, where the calibration has several.

    Returns
    -------
    DepthErrors

    Notes
    -----
    A triangulated point X minimises the reprojection error, so that with J = d pixel / d X of all views that see
    it, dX / d theta = -(J^T J)^-1 J^T d pixel / d theta at small residuals, and its covariance is
    pixel_sigma^2 (J^T J)^-1 + (dX / d theta) C (dX / d theta)^T for a calibration of covariance C.

    References
    ----------
    Hartley and Zisserman, Multiple View Geometry, result 5.10 and section 5.2.4 (implicit functions).
    """
    if not 0 < pixel_sigma < np.inf:
        raise SetupError(f"the pixel noise must be a positive number of px, got {pixel_sigma}")
    setup = calibration.setups[channel]
    volume = working_volume(setup.rig(), target_depths(calibration) if depths is None else depths, samples)
    spread, slopes = depth_slopes(setup, volume)
    slopes = slopes @ calibration.unknowns.matrix[channel]
    variance = np.einsum("...s,st,...t->...", slopes, finite(calibration.solution.covariance), slopes)
    return DepthErrors(
        volume.depths,
        volume.points,
        volume.seen.sum(-1),
        pixel_sigma * spread,
        np.sqrt(np.maximum(variance, 0.0)),
        slopes,
        float(pixel_sigma),
    )


class Volume(NamedTuple):
    """Points of the common field of view at some depths."""

    depths: np.ndarray  # (D,) mm
    points: np.ndarray  # (D, H, W, 3) mm
    seen: np.ndarray  # (D, H, W, V) bool: by which views, margins beside seams taken off

    @property
    def common(self) -> np.ndarray:
        """(D, H, W) bool: seen by at least two views."""
        return self.seen.sum(-1) >= 2


def target_depths(calibration: Calibration, count: int = _DEPTHS) -> np.ndarray:
    """Depths (count,) mm from the nearest to the farthest place at which two views or one saw the target."""
    seen = calibration.observations
    through = seen.view != DIRECT
    if not through.any():
        raise SetupError("no photograph was taken through the optic, so say at which depths to look: depths=(...)")
    near, far = np.percentile(rig_points(calibration)[through, 2], [2, 98])
    return np.linspace(near, far, count)


def rig_points(calibration: Calibration) -> np.ndarray:
    """The target's point of each observation (N, 3), mm, in the rig's frame."""
    seen = calibration.observations
    points = np.asarray(calibration.target.points, dtype=float)[seen.point]
    rotations = np.array([pose.rotation for pose in calibration.poses])[seen.photo]
    return np.einsum("nij,nj->ni", rotations, points) + np.array([p.translation for p in calibration.poses])[seen.photo]


def working_volume(rig: Rig, depths: Sequence[float] | np.ndarray, samples: int = 24) -> Volume:
    """A grid of samples x samples points over what at least two views share, at each of D depths (mm).

    Raises
    ------
    SetupError
        When no two views share anything at any of these depths.
    """
    depths = np.atleast_1d(np.asarray(depths, dtype=float))
    if not (np.isfinite(depths).all() and (depths > 0).all()):
        raise SetupError(f"depths are positive numbers of mm, got {depths}")
    points = np.full((len(depths), samples, samples, 3), np.nan)
    seen = np.zeros((len(depths), samples, samples, len(rig)), dtype=bool)
    for k, depth in enumerate(depths):
        corners = _field(rig, depth)
        if not np.isfinite(corners).all():
            continue
        coarse = _grid(corners[0], corners[1], depth, _COARSE)
        both = _seen(rig, coarse).sum(-1) >= 2
        if not both.any():
            continue
        step = (corners[1] - corners[0]) / _COARSE
        places = coarse[both][:, :2]
        points[k] = _grid(places.min(0) - step / 2, places.max(0) + step / 2, depth, samples)
        seen[k] = _seen(rig, points[k])
    if not (seen.sum(-1) >= 2).any():
        raise SetupError(
            f"no two views share anything between {depths.min():.4g} and {depths.max():.4g} mm: give other depths "
            f"(the rig is of use from {' to '.join(f'{z:g}' for z in rig.working_depths)} mm)"
        )
    return Volume(depths, points, seen)


def depth_slopes(setup: Setup, volume: Volume) -> tuple[np.ndarray, np.ndarray]:
    """How depth reacts: standard deviation for pixel noise of 1 px (D, H, W), mm, and derivatives (D, H, W, F).

    The F parameters are all those of the setup (`setup.parameter_names`). NaN outside the common field.
    """
    common = volume.common
    response = point_response(setup.rig(), volume.points[common], volume.seen[common])
    spread, slopes = np.full(common.shape, np.nan), np.full((*common.shape, len(setup.parameter_names)), np.nan)
    spread[common] = np.sqrt(response.covariance[:, 2, 2])
    slopes[common] = -response.shifts[:, 2]  # here the believed parameter changes and the pixels stay
    return spread, slopes


def rms(values: np.ndarray) -> float:
    """Root mean square of the values that are numbers; NaN where none is."""
    values = values[np.isfinite(values)]
    return float(np.sqrt(np.mean(values**2))) if values.size else float("nan")


def largest(values: np.ndarray) -> float:
    """The largest of the values that are numbers; NaN where none is."""
    values = values[np.isfinite(values)]
    return float(values.max()) if values.size else float("nan")


def finite(covariance: np.ndarray) -> np.ndarray:
    """The covariance with zeros where nothing at all is known: such a parameter has no effect on any pixel."""
    return np.where(np.isfinite(covariance), covariance, 0.0)


def _field(rig, depth):
    """Corners (2, 2) mm of the box around all that the views see at a depth; NaN where they see nothing."""
    places = []
    for view in rig:
        x, y, width, height = view.region.box
        pixels = np.stack(np.meshgrid(np.linspace(x, x + width - 1, 16), np.linspace(y, y + height - 1, 16)), -1)
        pixels = pixels.reshape(-1, 2)
        places.append(view.rays(pixels[view.region.contains(pixels)]).at_depth(depth)[:, :2])
    flat = np.concatenate(places)
    flat = flat[np.isfinite(flat).all(-1)]
    return np.stack([flat.min(0), flat.max(0)]) if len(flat) else np.full((2, 2), np.nan)


def _grid(low, high, depth, count):
    """Middles (count, count, 3) of the cells of a grid between two corners (2,) at a depth."""
    fractions = (np.arange(count) + 0.5) / count
    x, y = (low[k] + (high[k] - low[k]) * fractions for k in range(2))
    return np.stack([*np.meshgrid(x, y), np.full((count, count), float(depth))], -1)


def _seen(rig, points):
    """(..., V) bool: which views show points (..., 3), margins beside seams taken off."""
    return np.stack([view.region.contains(view.project(points)) for view in rig], -1)
