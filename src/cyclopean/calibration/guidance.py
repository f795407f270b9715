"""What to photograph next: the target's poses that would tell most about what depths still depend on."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..errors import SetupError
from ..geometry import Pose
from ..targets import DIRECT
from .depths import DepthErrors, depth_errors, finite, rms, target_depths
from .held import pose_columns, schur
from .physical import Calibration
from .prediction import views_of

_TILTS_DEG = (0.0, 20.0, -20.0, 35.0, -35.0)
_PLACES = (-1.0, 0.0, 1.0)  # across the common field; 1 is _REACH of the way to its border
_REACH = 0.55
_ENOUGH = 6  # points of a view that a detector finds a board by
_SMALLEST_GAIN = 0.05  # of what the calibration adds to depths
_SMALL_SHARE = 1 / 3  # of the noise of pixels, below which the calibration no longer matters
_WHOLE = ("chessboard", "circles", "asymmetric_circles")  # boards that are found whole or not at all
_CHUNK = 4_000_000  # numbers of derivatives that are held at a time
_UNITS = 6  # rotation and translation of the target


@dataclass(frozen=True, eq=False)
class Candidate:
    """A photograph that might be taken."""

    pose: Pose  # rig_from_target
    place: tuple[int, int]  # left to right and top to bottom, each -1, 0 or 1
    depth: float  # mm, of the target's middle
    tilt_deg: tuple[float, float]  # about the horizontal (x) and the vertical (y) axis
    direct: bool = False  # without the optic

    @property
    def text(self) -> str:
        """Where to hold the target, in words."""
        column = {-1: "left", 0: "", 1: "right"}[self.place[0]]
        row = {-1: "upper", 0: "", 1: "lower"}[self.place[1]]
        where = f"the {' '.join(filter(None, (row, column)))} part" if row or column else "the middle"
        tilts = []
        if self.tilt_deg[1]:
            edge = "right" if self.tilt_deg[1] > 0 else "left"
            tilts.append(f"{abs(self.tilt_deg[1]):g} degrees about the vertical axis ({edge} edge nearer)")
        if self.tilt_deg[0]:
            edge = "upper" if self.tilt_deg[0] > 0 else "lower"
            tilts.append(f"{abs(self.tilt_deg[0]):g} degrees about the horizontal axis ({edge} edge nearer)")
        how = f"tilted {' and '.join(tilts)}" if tilts else "square to the camera"
        return f"board at {self.depth:.0f} mm, in {where} of the field, {how}" + (
            ", without the optic" if self.direct else ""
        )


@dataclass(frozen=True, eq=False)
class Advice:
    """The next photograph to take, after those advised before it."""

    candidate: Candidate
    before: float  # mm, what the calibration adds to depths: root mean square over the working volume
    after: float  # mm, the same with this photograph

    @property
    def text(self) -> str:
        """The advice in words."""
        digits = _digits(self.after)
        return (
            f"{self.candidate.text}: depth error from calibration falls from {self.before:.{digits}f} to "
            f"{self.after:.{digits}f} mm"
        )


@dataclass(frozen=True, eq=False)
class Guidance:
    """Which photographs are worth taking next, in their order."""

    advice: tuple[Advice, ...]  # best first; each supposes that those before it were taken
    worth: int  # how many of them are worth taking
    now: float  # mm, what the calibration adds to depths: root mean square over the working volume
    noise: float  # mm, what the noise of pixels adds
    candidates: tuple[Candidate, ...]
    gains: np.ndarray  # (C,) mm, by how much each candidate alone would lower `now`; NaN where too little is seen
    errors: DepthErrors  # at the working depths

    @property
    def text(self) -> str:
        """All of it in words."""
        digits = _digits(self.now)
        state = (
            f"depth error from calibration is {self.now:.{digits}f} mm, from the noise of pixels {self.noise:.2g} mm"
        )
        if not self.worth:
            return f"{state}: more photographs of this board would not help much"
        plural = "photograph is" if self.worth == 1 else "photographs are"
        lines = [f"{k}. {advice.text}" for k, advice in enumerate(self.advice[: self.worth], 1)]
        return "\n".join([f"{state}: {self.worth} more {plural} worth taking", *lines])


def guide(
    calibration: Calibration,
    depths: Sequence[float] | np.ndarray | None = None,
    candidates: Sequence[Candidate] | None = None,
    *,
    count: int = 6,
    pixel_sigma: float = 0.1,
    channel: int = 0,
) -> Guidance:
    """What to photograph next.

    Parameters
    ----------
    calibration : Calibration
        A first calibration, of a few photographs.
    depths : sequence of mm, optional
        z of the planes on which depths shall be right; between the nearest and the farthest target where not given.
    candidates : sequence of Candidate, optional
        Photographs to choose from; `usual_candidates` where not given.
    count : int
        At most so many photographs are advised.
    pixel_sigma : float
        Noise of a matched pixel, px, that the calibration's share is compared with.
    channel : int
        Colour channel, where the calibration has several.

    Returns
    -------
    Guidance
        Photographs are worth taking while the next one lowers the calibration's depth error by 5 % or more, and
        that error is above a third of the one by noise of pixels.

    Notes
    -----
    With the information I of all photographs so far and the drawing, a candidate adds its own, the pose of the
    target eliminated, at the noise that was found in the photographs. The measure is I-optimality: the mean variance
    trace(C M) of depth over the working volume, with M the mean of the outer products of d depth / d parameters.
    The photographs are chosen one after the other (greedily).

    References
    ----------
    Atkinson, Donev, Tobias 2007, Optimum experimental designs, with SAS, chapters 10 and 12.
    """
    depths = target_depths(calibration, 3) if depths is None else np.atleast_1d(np.asarray(depths, dtype=float))
    errors = depth_errors(calibration, depths, pixel_sigma, samples=12, channel=channel)
    if candidates is None:
        candidates = usual_candidates(calibration, errors)
    if not len(candidates):
        raise SetupError("there are no candidates to choose from")
    scale = calibration.unknowns.spread  # lengths, angles and px mix badly
    scale = np.where(np.isfinite(scale), scale, 1.0)
    slopes = errors.slopes[np.isfinite(errors.slopes).all(-1)] * scale
    wanted = slopes.T @ slopes / len(slopes)
    added = candidate_information(calibration, candidates, channel) * np.outer(scale, scale)
    known = np.linalg.inv(finite(calibration.solution.covariance) / np.outer(scale, scale) + 1e-14 * np.eye(len(scale)))
    noise = rms(errors.noise)
    now = float(_sigma(known, wanted))
    gains = now - _sigma(known + added, wanted)
    advice: list[Advice] = []
    left = np.ones(len(candidates), dtype=bool)  # the same photograph again would only average its noise
    for _ in range(min(count, len(candidates))):
        after = _sigma(known + np.where(np.isfinite(added), added, 0.0), wanted)
        after = np.where(left, after, np.inf)
        before = advice[-1].after if advice else now
        best = int(np.argmin(after))
        if not after[best] < before:
            break
        advice.append(Advice(candidates[best], float(before), float(after[best])))
        known, left[best] = known + added[best], False
    worth = 0
    while worth < len(advice) and _is_worth(advice[worth], noise):
        worth += 1
    return Guidance(tuple(advice), worth, now, noise, tuple(candidates), gains, errors)


def usual_candidates(calibration: Calibration, errors: DepthErrors) -> list[Candidate]:
    """The target in nine places at each depth of the working volume, square to the camera and tilted.

    Tilts are 20 and 35 degrees about one axis. Where photographs without the optic were taken, more of them are
    candidates as well.
    """
    found = []
    points = np.asarray(calibration.target.points, dtype=float)
    middle = (points.min(0) + points.max(0)) / 2
    tilts = [(0.0, 0.0), *((t, 0.0) for t in _TILTS_DEG[1:]), *((0.0, t) for t in _TILTS_DEG[1:])]
    kinds = (False, True) if np.any(calibration.observations.view == DIRECT) else (False,)
    for k, depth in enumerate(errors.depths):
        field = errors.points[k][errors.views[k] >= 2]
        if not len(field):
            continue
        low, high = field[:, :2].min(0), field[:, :2].max(0)
        for place in np.stack(np.meshgrid(_PLACES, _PLACES), -1).reshape(-1, 2):
            there = np.append((low + high) / 2 + place * _REACH * (high - low) / 2, depth)
            for tilt in tilts:
                turn = Pose.from_rotation_vector(np.deg2rad([*tilt, 0.0])).rotation
                pose, where = Pose(turn, there - turn @ middle), (int(place[0]), int(place[1]))
                found += [Candidate(pose, where, float(depth), tilt, direct) for direct in kinds]
    return found


def candidate_information(calibration: Calibration, candidates: Sequence[Candidate], channel: int = 0) -> np.ndarray:
    """What each candidate would add to the information (C, S, S) on the free parameters.

    NaN where no view would show enough of the target to find it by.
    """
    setup, size = calibration.setups[channel], len(calibration.unknowns)
    points = np.asarray(calibration.target.points, dtype=float)
    sigma = float(np.median(calibration.observations.sigma)) * calibration.solution.sigma0
    rotations = np.array([candidate.pose.rotation for candidate in candidates])
    shifts = np.array([candidate.pose.translation for candidate in candidates])
    direct = np.array([candidate.direct for candidate in candidates])
    grams = np.zeros((len(candidates), size + _UNITS, size + _UNITS))
    views, unbounded = dict(enumerate(setup.rig())), views_of(setup)
    views[DIRECT] = unbounded[DIRECT]
    step = max(1, _CHUNK // (len(points) * 2 * (size + _UNITS)))
    for start in range(0, len(candidates), step):
        part = slice(start, start + step)
        turned = np.einsum("cij,pj->cpi", rotations[part], points)
        there = turned + shifts[part, None]
        for number, view in views.items():
            mine = direct[part] == (number == DIRECT)
            if not mine.any():
                continue
            columns, shown = _columns(calibration, view, unbounded[number], there, turned, number, channel)
            shown &= mine[:, None]
            columns = np.where(shown[..., None, None], columns, 0.0) / sigma
            stacked = columns.reshape(len(columns), -1, size + _UNITS)
            grams[part] += np.swapaxes(stacked, -1, -2) @ stacked
    seen = grams[:, -1, -1] > 0
    information = np.full((len(candidates), size, size), np.nan)
    information[seen] = schur(grams[seen], _UNITS)
    return information


def _columns(calibration, view, unbounded, points, turned, number, channel):
    """Derivatives (C, P, 2, S + 6) of pixels to free parameters and pose, and which points (C, P) would be found."""
    pixels = view.project(points)
    shown = np.isfinite(pixels).all(-1) if number == DIRECT else view.region.contains(pixels)
    if number == DIRECT:
        shown &= view.camera.contains(pixels)
    least = points.shape[1] if getattr(calibration.target, "kind", "") in _WHOLE else min(_ENOUGH, points.shape[1])
    shown &= (shown.sum(-1) >= least)[:, None]
    size = len(calibration.unknowns)
    columns = np.zeros((*points.shape[:2], 2, size + _UNITS))
    found = unbounded.pixel_derivatives(points[shown])
    matrix = calibration.unknowns.matrix[channel]
    count = found.to_camera.shape[-1]
    to_shared = found.to_camera @ matrix[:count]
    if number != DIRECT:
        to_shared = to_shared + found.to_optic @ matrix[count:]
    columns[shown] = np.concatenate([to_shared, pose_columns(turned[shown], found.to_point)], -1)
    return columns, shown & np.isfinite(columns).all((-1, -2))


def _sigma(information, wanted):
    """Root mean square (...,) of depth's standard deviation for informations (..., S, S)."""
    values = np.einsum("...ij,ji->...", np.linalg.inv(information), wanted)
    return np.sqrt(np.maximum(values, 0.0))


def _is_worth(advice, noise):
    return advice.before - advice.after >= _SMALLEST_GAIN * advice.before and advice.before > _SMALL_SHARE * noise


def _digits(value):
    return max(0, min(6, 1 - int(np.floor(np.log10(max(value, 1e-9))))))
