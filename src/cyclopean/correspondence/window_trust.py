"""Whether a match can be believed: the middle of its window alone, the way back, and what is left over."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from ..rigs import Rig, ViewLike
from .window_fit import PlaneFit, ShiftFit, fit_plane, fit_shift, fitted_places, likeness
from .window_search import Curve, Picture, Window, joint_score, search, window_at

_FLOOR = 0.003  # px: pictures are known no better between their pixels
_SURE = 0.1  # px, standard deviation of a colour's place that counts


@dataclass(frozen=True, eq=False)
class Match:
    """A peak of the search, refined."""

    index: int  # of the peak among the hypotheses
    plane: PlaneFit
    shifts: tuple[ShiftFit, ...]  # one for each other view
    strengths: np.ndarray  # (V-1,)
    used: np.ndarray  # (V-1,) bool: the views that show the point

    @property
    def score(self) -> float:
        """Of all views that see the place together, 0 to 1."""
        return float(joint_score(self.strengths)) if self.used.any() else 0.0

    @property
    def strength(self) -> float:
        """Correlation of the views that show the point; NaN where none does."""
        return float(self.strengths[self.used].mean()) if self.used.any() else np.nan

    @property
    def speed(self) -> float:
        """px per unit of inverse depth in the most sensitive of the views that show the point."""
        return max(float(np.linalg.norm(s.along)) for s, used in zip(self.shifts, self.used, strict=True) if used)

    @property
    def residual(self) -> float:
        """px, root mean square shift of the views away from where the plane puts the point, a coordinate."""
        shifts = np.array([s.shift for s, used in zip(self.shifts, self.used, strict=True) if used])
        return float(np.sqrt((shifts**2).mean()))

    @property
    def disagreement(self) -> float:
        """Factor (1 or more) by which the views contradict each other more than their noise lets them."""
        used = [s for s, used in zip(self.shifts, self.used, strict=True) if used]
        chi_squared = sum(s.shift @ np.linalg.solve(s.covariance, s.shift) for s in used)
        freedom = 2 * len(used) - 1
        return float(np.sqrt(max(1.0, chi_squared / (freedom + 2 * np.sqrt(2 * freedom)))))


class Middle(NamedTuple):
    """What the middle of a window says by itself."""

    difference: float  # 1/mm, of its inverse depth from the whole window's: large where depth changes within
    sigma: float  # 1/mm, its standard deviation
    strength: float  # correlation where the whole window puts it; low where the window's rim decided


def middle_alone(picture: Picture, window: Window, match: Match, step: float) -> Middle:
    """Fit the middle of a matched window, half as wide."""
    core = replace(window, weights=window.weights**4)  # Gaussian weights, half as wide
    plane = fit_plane(picture, core, match.plane.inverse_depth, step, match.used, match.plane.slopes)
    strengths = [
        likeness(picture, core, v, fitted_places(window, v, match.plane, step) + match.shifts[v].shift)
        for v in np.flatnonzero(match.used).tolist()
    ]
    return Middle(plane.inverse_depth - match.plane.inverse_depth, plane.sigma, float(np.mean(strengths)))


def way_back(picture: Picture, rig: Rig, window: Window, match: Match, curve: Curve) -> float:
    """How far (px) the best match of what the best view shows lies from where it came from; NaN where it has none."""
    v = int(np.argmax(np.where(match.used, np.nan_to_num(match.strengths, nan=-1.0), -2.0)))
    there = window_at(picture, rig, window.others[v], match.shifts[v].pixel, int(2 * window.half) + 1)
    depths = 1 / curve.inverse_depths[-1], 1 / curve.inverse_depths[0]
    back = search(picture, there, depths)
    if there.seen < 0.3 or not np.isfinite(back.joint).any():
        return np.nan
    best = back.inverse_depths[np.nanargmax(back.joint)]
    return float(abs(best - match.plane.inverse_depth) * match.speed)


def colours_apart(picture: Picture, window: Window, match: Match, step: float) -> float:
    """How far (px) the colour channels lie apart in the view where they do most; 0 for grey pictures.

    Glass bends colours differently. A channel counts where its own picture tells its place to `_SURE` px.
    """
    apart = 0.0
    channels = window.values.shape[1]
    for v in np.flatnonzero(match.used) if channels > 1 else ():
        pixels = []
        for c in range(channels):
            one = replace(picture, spline=np.ascontiguousarray(picture.spline[..., c : c + 1]))
            fit = fit_shift(one, replace(window, values=window.values[:, c : c + 1]), int(v), match.plane, step)
            if np.trace(fit.covariance) < 2 * _SURE**2:
                pixels.append(fit.pixel)
        if len(pixels) > 1:
            apart = max(apart, float(np.linalg.norm(np.ptp(pixels, axis=0))))
    return apart


def depth_sigma(match: Match, middle: Middle) -> float:
    """Standard deviation (1/mm) of the inverse depth.

    What the grey levels left over tell, widened where views contradict each other; what the middle of the window says
    otherwise, beyond its own noise; and a floor.
    """
    noise, floor = match.plane.sigma * match.disagreement, _FLOOR / match.speed
    beyond = max(middle.difference**2 - middle.sigma**2, 0.0)
    return float(np.sqrt(noise**2 + beyond + floor**2))


def point_covariance(view: ViewLike, window: Window, plane: PlaneFit, sigma: float, pointing: float) -> np.ndarray:
    """Covariance (3, 3) mm^2 of a point: depth by the match, and the pointing, which moves it along its surface.

    Parameters
    ----------
    view : ViewLike
        That the pixel was given in, without borders.
    sigma : float
        Standard deviation of the inverse depth, 1/mm.
    pointing : float
        Standard deviation of the given pixel, px.
    """
    ray = view.rays(window.pixel)
    ends = [ray.at_depth(1 / (plane.inverse_depth + side * sigma)) for side in (-0.5, 0.5)]
    columns = [ends[1] - ends[0]]
    for axis in np.eye(2):
        slope = plane.slopes @ axis / window.half
        ends = [
            view.rays(window.pixel + side * axis).at_depth(1 / (plane.inverse_depth + side * slope))
            for side in (-0.5, 0.5)
        ]
        columns.append(pointing * (ends[1] - ends[0]))
    factors = np.stack(columns, -1)
    return factors @ factors.T
