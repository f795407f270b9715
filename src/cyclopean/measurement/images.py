"""Measurements from pixels of a photograph: points found in all sub-images, a value, and how far to trust it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from ..correspondence.window_search import Picture, prepare
from ..correspondence.windows import Limits, Located, locate
from ..errors import MeasurementError, OpticError
from ..rigs import Rig
from ..triangulation import triangulate
from .lengths import angle, length, point, point_to_line
from .measured import Measured
from .planes import area, point_to_plane

POINTING = 0.3  # px, standard deviation of a pixel that a person points at: anywhere inside it
_STRONG = 0.9  # correlation below which a match wants a look
_CLEAR = 0.8  # ambiguity above which it does
_CLOSE = 0.5  # px, residual above which it does
_APART = 5.0  # px, residual above which pixels given by hand are no pair
_SHARE = 0.05  # of the value: a larger standard deviation wants a look
_FLAT = 3.0  # a surface is not flat when its points leave the plane by so much of what noise does


class Kind(NamedTuple):
    """What can be measured, and of how many points."""

    function: Callable[..., Measured]
    least: int  # points
    most: int | None  # points; None: any number
    unit: str
    points: str  # what they are


KINDS = {
    "point": Kind(point, 1, 1, "mm", "the point; its depth is the value"),
    "length": Kind(length, 2, None, "mm", "the ends, with corners between them"),
    "point-to-line": Kind(point_to_line, 3, 3, "mm", "the point, two points of the line"),
    "point-to-plane": Kind(point_to_plane, 4, None, "mm", "the point, three or more points of the plane"),
    "area": Kind(area, 3, None, "mm2", "the corners in order around it"),
    "angle": Kind(angle, 3, 3, "rad", "a point on one leg, the vertex, a point on the other leg"),
}


@dataclass(frozen=True)
class ImagePoint:
    """A point of the scene as a person gives it."""

    pixel: tuple[float, float]  # (x, y) px, in the sub-image where it is measured
    by_hand: tuple[tuple[float, float], ...] = ()  # px, where other sub-images show it; found automatically where empty


@dataclass(frozen=True, eq=False)
class Measurement:
    """A value measured in a photograph, and how far it can be trusted."""

    kind: str  # one of KINDS
    given: tuple[ImagePoint, ...]  # N points
    located: Located  # where they are, in all sub-images and in space
    result: Measured | None  # None where it was refused
    sigma_calibration: float  # standard deviation by the calibration, in the value's unit; NaN unknown
    grade: str  # "good", "check" or "refused"
    reasons: tuple[str, ...]  # why it is not good

    @property
    def unit(self) -> str:
        """mm, mm2 or rad."""
        return KINDS[self.kind].unit

    @property
    def value(self) -> float:
        """In `unit`; NaN where it was refused."""
        return np.nan if self.result is None else float(self.result.value)

    @property
    def sigma(self) -> float:
        """Standard deviation by matching and pointing, in `unit`."""
        return np.nan if self.result is None else float(self.result.sigma)

    @property
    def accuracy(self) -> float:
        """Accuracy index: standard deviation by matching and pointing, and by the calibration where it is known."""
        return float(np.hypot(self.sigma, np.nan_to_num(self.sigma_calibration)))

    @property
    def flatness(self) -> float:
        """Root mean square distance of a surface's points from its plane, mm; NaN for other kinds."""
        flatness = None if self.result is None else self.result.flatness
        return np.nan if flatness is None else float(flatness)

    @property
    def strength(self) -> float:
        """Match strength of the weakest point; NaN where all were given by hand."""
        return _worst(np.fmin, self._own(self.located.strength))

    @property
    def ambiguity(self) -> float:
        """Ambiguity of the least certain point; NaN where all were given by hand."""
        return _worst(np.fmax, self._own(self.located.ambiguity))

    @property
    def views(self) -> np.ndarray:
        """(N,) int, the sub-image in which each point was given."""
        return np.argmax(np.isclose(self.located.pixels, [[p.pixel] for p in self.given]).all(-1), axis=1)

    def _own(self, values):
        return values[np.arange(len(self.given)), self.views]


def measure(
    photograph: np.ndarray | Picture,
    rig: Rig,
    kind: str,
    given: Sequence[ImagePoint | tuple[float, float]],
    depths: Sequence[float],
    *,
    window: int = 21,
    pointing: float = POINTING,
    limits: Limits | None = None,
) -> Measurement:
    """Measure in a photograph, from pixels of any one sub-image.

    Parameters
    ----------
    photograph : (H, W) or (H, W, C) array, or Picture
    rig : Rig
    kind : str
        One of `KINDS`: "point", "length", "point-to-line", "point-to-plane", "area" or "angle".
    given : sequence of N pixels (x, y) or ImagePoint
        The points in the order that `KINDS[kind].points` says.
    depths : (near, far)
        Depths to search, mm.
    window, pointing, limits
        As in `cyclopean.correspondence.windows.locate`.

    Raises
    ------
    MeasurementError
        When the kind is not known, or wants another number of points. A measurement that cannot be trusted is returned
        as refused, with the reasons.
    """
    points = tuple(p if isinstance(p, ImagePoint) else ImagePoint((float(p[0]), float(p[1]))) for p in given)
    check_count(kind, len(points))
    located = find_points(photograph, rig, points, depths, window=window, pointing=pointing, limits=limits)
    return evaluate(kind, points, located)


def check_count(kind: str, count: int) -> None:
    """Raise MeasurementError when a kind is not known or wants another number of points."""
    if kind not in KINDS:
        raise MeasurementError(f"there is no measurement {kind!r}: choose one of {', '.join(KINDS)}")
    wanted = KINDS[kind]
    if count < wanted.least or (wanted.most is not None and count > wanted.most):
        number = f"{wanted.least}" if wanted.least == wanted.most else f"{wanted.least} or more"
        raise MeasurementError(f"{kind} wants {number} points ({wanted.points}), got {count}")


def find_points(
    photograph: np.ndarray | Picture,
    rig: Rig,
    given: Sequence[ImagePoint],
    depths: Sequence[float],
    *,
    window: int = 21,
    pointing: float = POINTING,
    limits: Limits | None = None,
) -> Located:
    """Where points are seen in all sub-images: those given by hand as given, the others by `locate`."""
    picture = photograph if isinstance(photograph, Picture) else prepare(photograph, rig)
    rows = []
    for each in given:
        view = view_of(rig, each.pixel)
        if each.by_hand:
            rows.append(_by_hand(rig, view, each, pointing))
            continue
        rows.append(locate(picture, rig, view, [each.pixel], depths, window=window, pointing=pointing, limits=limits))
    return join(rows)


def join(rows: Sequence[Located]) -> Located:
    """Several sets of points as one."""
    return Located(*(np.concatenate([getattr(row, name) for row in rows]) for name in Located.__dataclass_fields__))


def view_of(rig: Rig, pixel: Sequence[float]) -> int:
    """Number of the sub-image that holds a pixel; the nearest one where none does.

    `locate` says then why the pixel cannot be used.
    """
    for k, view in enumerate(rig):
        if view.region.contains(np.asarray(pixel, dtype=float)):
            return k
    away = [_distance(view.region, pixel) for view in rig]
    return int(np.argmin(away))


def _distance(region, pixel):
    x, y, width, height = region.box
    pixel = np.nan_to_num(np.asarray(pixel, dtype=float))
    return np.linalg.norm(pixel - np.clip(pixel, [x, y], [x + width, y + height]))


def _by_hand(rig, view, given, sigma):
    """One row of `Located` for a point whose pixels a person gave."""
    if len(rig) < 2:
        raise OpticError(f"a point is found by two views or more, but this setup gives {len(rig)}")
    pixels = np.full((1, len(rig), 2), np.nan)
    reason = "" if rig[view].region.contains(given.pixel) else "in no sub-image, or too near to a seam"
    pixels[0, view] = given.pixel
    for pixel in given.by_hand:
        k = view_of(rig, pixel)
        if not rig[k].region.contains(pixel):
            reason = reason or f"{pixel[0]:g},{pixel[1]:g} is in no sub-image, or too near to a seam"
        elif np.isfinite(pixels[0, k]).all():
            reason = reason or f"{pixel[0]:g},{pixel[1]:g} is the second pixel in sub-image {k}: give one in another"
        else:
            pixels[0, k] = pixel
    found = triangulate(rig, pixels, max(sigma, 1e-3))
    residual = float(found.residual[0])
    if not reason and not np.isfinite(residual):
        reason = "the rays of the pixels given by hand do not meet before the optic"
    elif not reason and residual > _APART:
        reason = f"the pixels given by hand do not belong together: {residual:.1f} px beside the epipolar curves"
    lost = np.nan if reason else 0.0
    nothing = np.full((1, len(rig)), np.nan)
    spread = np.where(np.isfinite(pixels[..., 0]), sigma, np.nan)
    return Located(
        pixels, nothing, nothing, found.points + lost, found.covariance + lost, found.residual + lost, spread,
        np.array([reason], dtype=object),
    )  # fmt: skip


def evaluate(kind: str, given: Sequence[ImagePoint], located: Located) -> Measurement:
    """The value that located points give, with its grade."""
    given = tuple(given)
    refused = [f"point {k + 1}: {reason}" for k, reason in enumerate(located.reason) if reason]
    result = None
    if not refused:
        try:
            rows = 0 if kind == "point" else slice(None)
            result = KINDS[kind].function(located.points[rows], located.covariance[rows])
        except MeasurementError as error:
            refused = [str(error)]
    if result is not None and not (np.isfinite(result.value) and np.isfinite(result.sigma)):
        result, refused = None, ["the legs lie on one line: the angle has no standard deviation"]
    if refused:
        return Measurement(kind, given, located, None, np.nan, "refused", tuple(refused))
    found = Measurement(kind, given, located, result, np.nan, "good", ())
    reasons = (*_weak_points(found), *_weak_value(found))
    return replace(found, grade="check" if reasons else "good", reasons=reasons)


def with_calibration(measurement: Measurement, shifts: np.ndarray, covariance: np.ndarray) -> Measurement:
    """The same measurement with what the calibration's uncertainty does to it.

    The parameters shift all points of a measurement together: what is common to them cancels.

    Parameters
    ----------
    shifts : (N, 3, P) array
        Shift of each point, mm, per unit of each parameter.
    covariance : (P, P) array
        Of the parameters.
    """
    if measurement.result is None:
        return measurement
    slope = np.einsum("ni,nip->p", measurement.result.gradient, shifts)
    found = replace(measurement, sigma_calibration=float(np.sqrt(max(slope @ covariance @ slope, 0.0))))
    reasons = (*_weak_points(found), *_weak_value(found))
    return replace(found, grade="check" if reasons else "good", reasons=reasons)


def _weak_points(found):
    strength, ambiguity = found._own(found.located.strength), found._own(found.located.ambiguity)
    for k, given in enumerate(found.given):
        residual = found.located.residual[k]
        if given.by_hand:
            yield f"point {k + 1} was given by hand"
        elif strength[k] < _STRONG:
            yield f"point {k + 1}: weak match, strength {strength[k]:.2f}"
        elif ambiguity[k] > _CLEAR:
            yield f"point {k + 1}: ambiguous, the next best match reaches {100 * ambiguity[k]:.0f} % of it"
        if residual > _CLOSE:
            yield f"point {k + 1}: {residual:.1f} px beside the epipolar curves"


def _weak_value(found):
    if found.kind in ("length", "area") and found.accuracy > _SHARE * found.value:
        yield f"known to {100 * found.accuracy / found.value:.0f} % only"
    if found.flatness > 0:
        surface = slice(1, None) if found.kind == "point-to-plane" else slice(None)
        noise = np.sqrt(np.linalg.eigvalsh(found.located.covariance[surface])[:, -1].mean())
        if found.flatness > _FLAT * noise:
            yield f"the surface is not flat: its points leave their plane by {found.flatness:.2g} mm"


def _worst(function, values):
    known = values[np.isfinite(values)]
    return float(function.reduce(known)) if known.size else np.nan
