"""The figures that describe a rig."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..errors import SetupError
from ..rigs import Rig, VirtualCamera, fit
from ..triangulation import point_covariance

_GRID = 96  # samples across a depth plane


@dataclass(frozen=True)
class FieldAtDepth:
    """What the views share at one depth, and how well depth is resolved there."""

    depth: float  # mm
    width: float  # mm, of the box around what at least two views see
    height: float  # mm
    share_two: float  # of all pixels that belong to a view, those whose point a second view sees too
    share_all: float  # those whose point all views see
    sigma_two: float  # mm, standard deviation of depth where just two views see a point, median; NaN: nowhere
    sigma_all: float  # mm, the same where all views see it


@dataclass(frozen=True)
class ViewPair:
    """Two virtual cameras as a stereo pair."""

    first: int
    second: int
    baseline: float  # mm between the optical centres
    angle: float  # rad between the rays of the optical axis through the two facets


@dataclass(frozen=True, eq=False)
class RigSummary:
    """The numbers that describe a rig."""

    depths: tuple[float, float]  # mm, that the figures hold between
    cameras: tuple[VirtualCamera, ...]  # best pinhole with distortion for each view
    pairs: tuple[ViewPair, ...]
    fields: tuple[FieldAtDepth, ...]
    sigma_px: float  # pixel noise that the depth resolution is stated for


def summarise(rig: Rig, depths: tuple[float, float] | None = None, sigma_px: float = 0.1) -> RigSummary:
    """Describe a rig between two depths (its working depths where none are given).

    The angle of a pair is that between the directions in which the camera's optical axis leaves through the two
    facets, the gamma of the thesis; each facet is taken without end for it. Where it misses the optic, as with mirrors
    that stand along it, the axis of the virtual camera takes its place.
    """
    if not 0 < sigma_px < np.inf:
        raise SetupError(f"the pixel noise must be a positive number of px, got {sigma_px}")
    near, far = rig.working_depths if depths is None else depths
    cameras = tuple(fit(view, (near, far)) for view in rig)
    axes = [view.unbounded().rays(view.camera.centre).directions for view in rig]
    axes = [a if np.isfinite(a).all() else c.axis for a, c in zip(axes, cameras, strict=True)]
    pairs = []
    for i in range(len(rig)):
        for j in range(i + 1, len(rig)):
            baseline = float(np.linalg.norm(cameras[i].centre - cameras[j].centre))
            sine, cosine = np.linalg.norm(np.cross(axes[i], axes[j])), axes[i] @ axes[j]
            pairs.append(ViewPair(i, j, baseline, float(np.arctan2(sine, cosine))))
    fields = tuple(field_at(rig, float(f"{depth:.4g}"), sigma_px) for depth in np.geomspace(near, far, 5))
    return RigSummary((near, far), cameras, tuple(pairs), fields, sigma_px)


def field_at(rig: Rig, depth: float, sigma_px: float = 0.1) -> FieldAtDepth:
    """What the views of a rig share at a depth (mm)."""
    counts, points, views = np.zeros(3), [], []
    for view in rig:
        x, y, width, height = view.region.box
        columns, rows = np.linspace(x, x + width - 1, _GRID // 2), np.linspace(y, y + height - 1, _GRID // 2)
        pixels = np.stack(np.meshgrid(columns, rows), -1).reshape(-1, 2)
        here = view.rays(pixels[view.region.contains(pixels)]).at_depth(depth)
        here = here[np.isfinite(here).all(-1)]
        others = np.isfinite(rig.project(here)[..., 0]).sum(-1) if len(here) else np.zeros(0)
        counts += np.array([(others >= 2).sum(), (others >= len(rig)).sum(), len(here)])
        points.append(here[others >= 2])
        views.append(others[others >= 2])
    two, full, total = counts
    common, seen_by = np.concatenate(points), np.concatenate(views)
    if not len(common):
        return FieldAtDepth(depth, 0.0, 0.0, 0.0, 0.0, np.nan, np.nan)
    width, height = np.ptp(common[:, 0]), np.ptp(common[:, 1])
    sigmas = [_median_sigma(rig, common[seen_by == count], sigma_px) for count in (2, len(rig))]
    return FieldAtDepth(depth, float(width), float(height), float(two / total), float(full / total), *sigmas)


def _median_sigma(rig, points, sigma_px):
    """Median standard deviation of depth (mm) of points (N, 3), a few hundred of them; NaN where there are none."""
    if not len(points):
        return np.nan
    variance = point_covariance(rig, points[:: max(1, len(points) // 400)], sigma_px)[:, 2, 2]
    return float(np.sqrt(np.nanmedian(variance)))
