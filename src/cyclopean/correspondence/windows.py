"""Points that a person gives in one sub-image, found in all the others by the windows around them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from ..errors import OpticError, SetupError, ShapeError
from ..geometry import as_pixels
from ..rigs import Rig
from .window_fit import PlaneFit, fit_plane, fit_shift
from .window_search import Curve, Picture, Window, hill, peaks, prepare, search, window_at
from .window_trust import Match, colours_apart, depth_sigma, middle_alone, point_covariance, way_back

_CANDIDATES = 5  # peaks of the search that are refined
_MARGIN = 0.15  # a view whose likeness is so far below the best view's does not see the point
_LEAST_LIKE = 0.5  # nor does one less alike than this
_SURELY = 3.0  # standard deviations that a contradiction must exceed
_FAR = 1.5  # px: a candidate that moves so far from its peak has lost it


@dataclass(frozen=True, eq=False)
class Located:
    """N points of one sub-image in all V of them; NaN where a point was refused, with the reason."""

    pixels: np.ndarray  # (N, V, 2) px; NaN in views that do not show the point
    strength: np.ndarray  # (N, V) correlation of each view, -1 to 1; of all views together in the given view's column
    ambiguity: np.ndarray  # (N, V) next best peak over the best, each view; all together in the given view's column
    points: np.ndarray  # (N, 3) mm, on the rays of the given pixels
    covariance: np.ndarray  # (N, 3, 3) mm^2
    residual: np.ndarray  # (N,) px, root mean square distance of the found pixels from the point's, a coordinate
    sigma: np.ndarray  # (N, V) px, standard deviation along the epipolar curve; of the pointing in the given view
    reason: np.ndarray  # (N,) text, why a point was refused; empty where it was found

    @property
    def found(self) -> np.ndarray:
        """(N,) bool: which points were found."""
        return self.reason == ""


@dataclass(frozen=True)
class Limits:
    """What a match must reach; else its point is refused."""

    strength: float = 0.8  # least correlation of the views that count, together
    ambiguity: float = 0.92  # most that the next best peak may reach of the best
    sigma: float = 0.5  # px, largest standard deviation along the epipolar curve
    contrast: float = 2.0  # grey levels of 255, least standard deviation inside the window
    saturated: float = 0.25  # largest share of the window that is saturated
    residual: float = 1.0  # px, largest distance from the epipolar curves, a coordinate
    middle: float = 0.2  # px, by how much the middle of the window may contradict the whole
    weaker: float = 0.1  # by how much its correlation may be lower
    back: float = 1.5  # px, how far from the given pixel the way back may end
    colours: float = 0.5  # px, how far the colour channels may lie apart


def locate(
    photograph: np.ndarray | Picture,
    rig: Rig,
    view: int,
    pixels: ArrayLike,
    depths: Sequence[float],
    *,
    window: int = 21,
    pointing: float = 0.0,
    limits: Limits | None = None,
) -> Located:
    """Find pixels of one sub-image in all the others, along their true epipolar curves.

    The window around a pixel is traced to planes of many depths and seen from there in the other views, through the
    optic, so that turned, mirrored and scaled views compare alike. The best depths are refined with a slanted plane and
    a gain and offset for each view and channel; then each view's window may leave its curve, which tells how far the
    setup can be trusted. A point stands on the ray of the pixel that was given.

    Parameters
    ----------
    photograph : (H, W) or (H, W, C) array, or Picture
        The photograph; what `prepare` returns for it saves time in several calls.
    rig : Rig
        Two views or more.
    view : int
        Number of the view that the pixels lie in.
    pixels : (N, 2) array
        Pixels (x, y) of the photograph.
    depths : (near, far)
        Depths to search, z in mm.
    window : int
        Width of the window, px, odd.
    pointing : float
        Standard deviation of the given pixels, px: how well a person points. It moves a point along its surface.
    limits : Limits, optional
        What a match must reach.

    Returns
    -------
    Located

    References
    ----------
    Correlation along the epipolar curve: Okutomi and Kanade, IEEE PAMI 15(4), 1993 (several views, one depth).
    """
    pixels = as_pixels(pixels).reshape(-1, 2)
    _check(rig, view, depths, window, pointing)
    picture = photograph if isinstance(photograph, Picture) else prepare(photograph, rig)
    limits = limits or Limits()
    answers = [_locate_one(picture, rig, view, pixel, depths, window, pointing, limits) for pixel in pixels]
    count, views = len(pixels), len(rig)
    shapes = {
        "pixels": (views, 2), "strength": (views,), "ambiguity": (views,), "points": (3,), "covariance": (3, 3),
        "residual": (), "sigma": (views,),
    }  # fmt: skip
    columns = {
        name: np.array([a[k] for a in answers]).reshape(count, *shape) for k, (name, shape) in enumerate(shapes.items())
    }
    return Located(**columns, reason=np.array([a[-1] for a in answers], dtype=object).reshape(count))


def _check(rig, view, depths, window, pointing):
    if len(rig) < 2:
        raise OpticError(f"a point is found by two views or more, but this setup gives {len(rig)}")
    if not (isinstance(view, int | np.integer) and 0 <= view < len(rig)):
        raise ShapeError(f"there is no view {view}: this setup has views 0 to {len(rig) - 1}")
    if not (len(depths) == 2 and 0 < depths[0] < depths[1] < np.inf):
        raise SetupError(f"depths must be (near, far) with 0 < near < far in mm, got {tuple(depths)}")
    if not (window >= 5 and window % 2 == 1):
        raise ShapeError(f"the window must be an odd number of px, 5 or more, got {window}; 21 is usual")
    if not 0 <= pointing < np.inf:
        raise ShapeError(f"pointing must be a standard deviation in px, 0 or more, got {pointing}")


def _locate_one(picture, rig, view, pixel, depths, width, pointing, limits):
    """One row of each field of `Located`."""
    reason = _unfit_pixel(rig, view, pixel)
    if reason:
        return _refused(rig, view, pixel, reason)
    window = window_at(picture, rig, view, pixel, width)
    reason = _unfit_window(window, limits)
    if reason:
        return _refused(rig, view, pixel, reason)
    curve = search(picture, window, depths)
    if not np.isfinite(curve.joint).any():
        return _refused(rig, view, pixel, "outside the other sub-images at all depths searched")
    matches = _matches(picture, window, curve)
    if not matches:
        return _refused(
            rig, view, pixel, "nothing alike between the depths searched: hidden in the others, or of another setup"
        )
    best = matches[0]
    strength, ambiguity = _columns(rig, window, curve, matches)
    reason, sigma = _unfit_match(curve, matches, ambiguity[view], limits, window.values.shape[1] > 1), np.nan
    if not reason:
        middle = middle_alone(picture, window, best, curve.step)
        sigma = depth_sigma(best, middle)
        reason = _unfit_surroundings(picture, rig, window, curve, best, middle, limits)
    if reason:
        return _refused(rig, view, pixel, reason, strength, ambiguity)
    return _accepted(rig, window, best, sigma, pointing, strength, ambiguity)


def _unfit_pixel(rig, view, pixel):
    if not np.isfinite(pixel).all():
        return "not a number"
    if rig[view].region.contains(pixel):
        return ""
    for k, other in enumerate(rig):
        if k != view and other.region.contains(pixel):
            return f"in sub-image {k}, not in sub-image {view}"
    return "in no sub-image, or too near to a seam"


def _unfit_window(window: Window, limits: Limits):
    if window.clipped > limits.saturated:
        return f"saturated: {100 * window.clipped:.0f} % of the window is white"
    if window.seen < 0.5:
        return "too near to a seam or to the edge: less than half of the window is in the sub-image"
    if window.contrast < limits.contrast:
        return f"no texture: the window's grey levels spread by {window.contrast:.1f} of 255"
    return ""


def _matches(picture: Picture, window: Window, curve: Curve) -> list[Match]:
    """The best peaks, refined, best first; each on its own hill."""
    tops = peaks(curve.joint, _CANDIDATES)
    best = np.where(np.isfinite(curve.scores), curve.scores, -1).max(-1)
    tops += [top for top in peaks(np.where(best > -1, best, np.nan), 2) if top not in tops]
    found: list[Match] = []
    for top in tops:
        candidate = _refined(picture, window, curve, top)
        if candidate is not None:
            found.append(candidate)
    found.sort(key=lambda c: -c.score)
    apart: list[Match] = []
    for candidate in found:
        if all(abs(candidate.plane.inverse_depth - c.plane.inverse_depth) > 4 * curve.step for c in apart):
            apart.append(candidate)
    return apart


def _refined(picture: Picture, window: Window, curve: Curve, top: int) -> Match | None:
    """The plane at a peak, and where each view shows the window; None where the fit runs away."""
    used = _seeing(curve.scores[top], np.zeros(curve.scores.shape[1]))
    start = float(curve.inverse_depths[top])
    plane = PlaneFit(start, np.zeros(2), np.inf, False)
    for _ in range(3):
        plane = fit_plane(picture, window, plane.inverse_depth, curve.step, used, plane.slopes)
        if not plane.converged or abs(plane.inverse_depth - start) > 2 * _FAR * curve.step:
            return None
        shifts = [fit_shift(picture, window, v, plane, curve.step) for v in range(len(used))]
        strengths = np.array([shift.strength for shift in shifts])
        now = _seeing(strengths, np.array([np.abs(s.shift).max() for s in shifts]))
        if (now == used).all() or not now.any():
            break
        used = now
    return Match(top, plane, tuple(shifts), strengths, now)


def _seeing(strengths, shifts):
    """(V-1,) bool: the views that show the point."""
    strengths = np.nan_to_num(strengths, nan=-1.0)
    return (strengths >= max(strengths.max() - _MARGIN, _LEAST_LIKE)) & (shifts < _FAR)


def _columns(rig, window, curve, matches):
    """Strength and ambiguity (V,)."""
    best, strength, ambiguity = matches[0], np.full(len(rig), np.nan), np.full(len(rig), np.nan)
    others = list(window.others)
    strength[others] = best.strengths
    strength[window.view] = best.strength
    start, stop = hill(np.nan_to_num(curve.joint, nan=-1.0), best.index)
    outside = np.r_[0:start, stop + 1 : len(curve.joint)]
    for v, k in enumerate(others):
        rest = curve.scores[outside, v]
        if best.strengths[v] > 0:  # a curve that ends there holds no rival
            ambiguity[k] = np.nanmax(rest, initial=0.0) / best.strengths[v]
    rival = matches[1].score if len(matches) > 1 else 0.0
    rival = max(rival, np.nanmax(curve.joint[outside], initial=0.0))
    ambiguity[window.view] = rival / best.score if best.score > 0 else np.nan
    return strength, ambiguity


def _unfit_match(curve, matches, ambiguity, limits, colour):
    best = matches[0]
    if not best.used.any():
        return _unused(best, limits)
    if best.strength < limits.strength:
        hint = "; in white light take one channel" if colour else ""
        return f"poor correlation: {best.strength:.2f}, wanted {limits.strength:g}{hint}"
    if not curve.inverse_depths[0] <= best.plane.inverse_depth <= curve.inverse_depths[-1]:
        return "best at an end of the depths searched; make the range wider"
    if ambiguity > limits.ambiguity:
        other = 1 / matches[1].plane.inverse_depth if len(matches) > 1 else np.nan
        where = f": depth {other:.4g} mm looks as well as {1 / best.plane.inverse_depth:.4g} mm" if other > 0 else ""
        return f"ambiguous{where}"
    sigma = best.plane.sigma * best.speed
    if not sigma <= limits.sigma:
        return f"texture does not tell the depth: +- {sigma:.2f} px along the epipolar curve"
    if best.residual > limits.residual:
        return f"{best.residual:.2f} px beside the epipolar curves: is this the setup of the photograph?"
    return ""


def _unused(best, limits):
    """Why no view of a match counts."""
    strength = np.nanmax(best.strengths, initial=-1.0)
    if strength < limits.strength:
        return f"poor correlation: {max(strength, 0.0):.2f} at best, wanted {limits.strength:g}"
    beside = max(np.abs(s.shift).max() for s, k in zip(best.shifts, best.strengths, strict=True) if k == strength)
    return f"what looks alike lies {beside:.1f} px beside the epipolar curve: is this the setup of the photograph?"


def _unfit_surroundings(picture, rig, window, curve, best, middle, limits):
    """Why the surroundings of a match speak against it; empty where they do not."""
    moved = abs(middle.difference) * best.speed
    allowed = max(limits.middle, _SURELY * middle.sigma * best.speed)
    if not moved <= allowed or middle.strength < best.strength - limits.weaker:
        return "depth changes within the window: an edge in depth runs through it; try a smaller window"
    back = way_back(picture, rig, window, best, curve)
    if back > limits.back:
        return f"the way back ends {back:.0f} px away: hidden in the other sub-images, or repeated"
    apart = colours_apart(picture, window, best, curve.step)
    if apart > limits.colours:
        return f"colours lie {apart:.1f} px apart, bent differently by the glass: take one channel"
    return ""


def _accepted(rig, window, best, sigma, pointing, strength, ambiguity):
    pixels, spread = np.full((len(rig), 2), np.nan), np.full(len(rig), np.nan)
    pixels[window.view], spread[window.view] = window.pixel, pointing
    for k, shift, used in zip(window.others, best.shifts, best.used, strict=True):
        if used:
            direction = shift.along / np.linalg.norm(shift.along)
            pixels[k], spread[k] = shift.pixel, np.sqrt(direction @ shift.covariance @ direction)
    view, plane = rig[window.view].unbounded(), best.plane
    point = view.rays(window.pixel).at_depth(1 / plane.inverse_depth)
    covariance = point_covariance(view, window, plane, sigma, pointing)
    return pixels, strength, ambiguity, point, covariance, best.residual, spread, ""


def _refused(rig, view, pixel, reason, strength=None, ambiguity=None):
    nothing = np.full(len(rig), np.nan)
    pixels = np.full((len(rig), 2), np.nan)
    pixels[view] = pixel
    return (
        pixels, nothing if strength is None else strength, nothing if ambiguity is None else ambiguity,
        np.full(3, np.nan), np.full((3, 3), np.nan), np.nan, nothing, reason,
    )  # fmt: skip
