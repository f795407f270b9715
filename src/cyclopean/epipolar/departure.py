"""How far straight epipolar lines are off the true curves."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..errors import OpticError
from ..rigs import Rig, ViewLike, VirtualCamera, fit
from ..rigs.two_views import Pinhole, fundamental_matrix, undistorted
from .curves import checked_view, epipolar_curves
from .fitting import fitted_fundamental
from .lines import distance_to_line, epipolar_line, straight_line


@dataclass(frozen=True)
class LineDeparture:
    """Distances (px) between the true epipolar curves of one view in another, and straight lines.

    `virtual` is the line of two virtual cameras, in their undistorted pixels; `best` that of the fundamental matrix
    that fits the curves best in the photograph; `straight` the straight line that fits each curve best by itself. No
    pinholes without distortion, however they are chosen, come closer to all curves than `best` (to first order), or
    to any one curve than `straight`.
    """

    first: int  # view of the given pixels
    second: int  # view of the curves
    depths: tuple[float, float]  # mm
    curves: int  # how many were compared
    virtual_rms: float  # px; NaN where the second view sees nothing of the first's
    virtual_max: float
    best_rms: float
    best_max: float
    straight_rms: float
    straight_max: float


def line_departure(
    rig: Rig,
    first: int,
    second: int,
    depths: tuple[float, float],
    cameras: Sequence[Pinhole] | None = None,
    samples: int = 16,
) -> LineDeparture:
    """How far straight lines are off the true epipolar curves of one view in another, over the whole sub-image.

    Parameters
    ----------
    rig : Rig
        Two views or more.
    first, second : int
        The view of the given pixels, and that of their curves.
    depths : (2,) mm
        Nearest and farthest depth of the curves; only what the second view sees counts.
    cameras : sequence of VirtualCamera or PinholeView, optional
        One for each view of the rig. Best fits without distortion where not given: straight lines in the photograph.
    samples : int
        About the number of sample pixels across the first sub-image.
    """
    checked_view(rig, first)
    checked_view(rig, second)
    if first == second:
        raise OpticError(f"view {first} has no epipolar curves in itself; name two views")
    if cameras is None:
        pair: tuple[Pinhole, Pinhole] = (
            fit(rig[first], depths, distortion=False),
            fit(rig[second], depths, distortion=False),
        )
    else:
        pair = _one_each(rig, cameras)[first], cameras[second]
    return _departure(rig, first, second, depths, pair, samples)


def line_departures(
    rig: Rig, depths: tuple[float, float], cameras: Sequence[Pinhole] | None = None, samples: int = 16
) -> dict[tuple[int, int], LineDeparture]:
    """`line_departure` of all ordered pairs of views, by (first, second)."""
    checked_view(rig, 0)
    known = pinholes(rig, depths) if cameras is None else _one_each(rig, cameras)
    pairs = [(i, j) for i in range(len(rig)) for j in range(len(rig)) if i != j]
    return {(i, j): _departure(rig, i, j, depths, (known[i], known[j]), samples) for i, j in pairs}


def line_distances(first: Pinhole, second: Pinhole, pixels: np.ndarray, curves: np.ndarray) -> np.ndarray:
    """Distance (..., D) px of curves (..., D, 2) in the second view from the lines of pixels (..., 2) in the first.

    In the undistorted pixels of the two pinholes that the lines belong to; positive to the right of the line as one
    walks along it in the order of the samples.
    """
    curves = undistorted(second.camera, curves)
    lines = epipolar_line(fundamental_matrix(first, second), undistorted(first.camera, pixels))
    along = np.nansum(np.diff(curves, axis=-2), axis=-2)
    turned = -along[..., 1] * lines[..., 0] + along[..., 0] * lines[..., 1] < 0
    lines = np.where(turned[..., None], -lines, lines)
    return distance_to_line(lines[..., None, :], curves)


def pinholes(rig: Rig, depths: tuple[float, float]) -> list[VirtualCamera]:
    """The virtual cameras that straight lines are drawn by: the best fits without distortion."""
    return [fit(view, depths, distortion=False) for view in rig]


def sample_pixels(view: ViewLike, samples: int = 16) -> np.ndarray:
    """Pixels (N, 2) of a view on a grid of about `samples` across its sub-image, its outermost pixels included."""
    x, y, width, height = view.region.box
    if not width:
        raise OpticError(f"{view.name} has no pixels: no light reaches the camera that way")
    step = max(width, height) / samples
    columns = np.linspace(x, x + width - 1, 1 + int(np.ceil(width / step)))
    rows = np.linspace(y, y + height - 1, 1 + int(np.ceil(height / step)))
    pixels = np.stack(np.meshgrid(columns, rows), -1).reshape(-1, 2)
    return pixels[view.region.contains(pixels)]


def _one_each(rig, cameras):
    if len(cameras) != len(rig):
        raise OpticError(f"{len(rig)} views want as many virtual cameras, got {len(cameras)}")
    return cameras


def _departure(rig, first, second, depths, pair, samples):
    pixels = sample_pixels(rig[first], samples)
    both = Rig((rig[first], rig[second]))
    curves = epipolar_curves(both, 0, pixels, depths, samples=33).pixels[:, 1]  # (N, D, 2)
    seen = np.isfinite(curves).all(-1).sum(-1) >= 3
    if seen.sum() < 8:  # so few say nothing
        return LineDeparture(first, second, tuple(depths), 0, *[np.nan] * 6)
    pixels, curves = pixels[seen], curves[seen]
    virtual = line_distances(pair[0], pair[1], pixels, curves)
    pairs = np.repeat(pixels[:, None], curves.shape[1], 1), curves
    known = np.isfinite(curves).all(-1)
    best = distance_to_line(
        epipolar_line(fitted_fundamental(*(side[known] for side in pairs)), pixels)[:, None], curves
    )
    straight = distance_to_line(straight_line(curves)[:, None], curves)
    virtual, best, straight = (_rms_and_max(distances) for distances in (virtual, best, straight))
    return LineDeparture(first, second, tuple(depths), len(curves), *virtual, *best, *straight)


def _rms_and_max(distances):
    known = distances[np.isfinite(distances)]
    return float(np.sqrt(np.mean(known**2))), float(np.abs(known).max())
