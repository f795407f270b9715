"""Parameters that were held: what the photographs would ask for if one of them were freed."""

from __future__ import annotations

import re
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from ..errors import CyclopeanError
from .depths import depth_slopes, rig_points, rms, target_depths, working_volume
from .physical import Calibration, recalibrate
from .prediction import Prediction
from .unknowns import TIED_FOCAL, Unknowns, kind_of

SIGNIFICANT = 5.0  # standard deviations; residuals of real lenses are never quite normal
SCALE = "target.scale"  # factor on all lengths of the target
_SCALE_SPREAD = 0.02  # printers are right to 0.01
_SCALE_MISTAKEN = 0.5  # a length mistaken, or another board's
_PLAUSIBLE = 5.0  # times what the drawing leaves open
_CATALOGUE = 0.1  # between one glass and another
_ALL = 0.9999  # of the sum of squares: a step that large is not of first order any more
_DEPENDENT = 1e-9  # share of a parameter's information that is left; below, others imitate it exactly


@dataclass(frozen=True)
class HeldTest:
    """What a parameter would do if it were freed alone, to first order."""

    name: str  # as in `setup.parameter_names`, or "target.scale"
    value: float  # at which it was held; rad, mm, px
    change: float  # that the photographs ask for; 0 where they cannot tell
    sigma: float  # of the change; infinite where other parameters imitate it
    rms: float  # px, of the residuals after it
    depth_change: float  # mm, root mean square over the working volume, by which depths would move

    @property
    def z(self) -> float:
        """The change in units of its standard deviation."""
        return self.change / self.sigma if self.sigma < np.inf else 0.0

    @property
    def visible(self) -> bool:
        """Whether the photographs know this parameter better than the drawing does."""
        return self.sigma < _spread(self.name, self.value)

    @property
    def plausible(self) -> bool:
        """Whether the change is one that a drawing may hide; a wrong number elsewhere asks for odd ones here."""
        if self.name == SCALE:
            return abs(self.change) <= _SCALE_MISTAKEN
        spread = _CATALOGUE if self.name.startswith("optic.index") else _spread(self.name, self.value)
        return abs(self.change) <= _PLAUSIBLE * spread


def tests_of_held(calibration: Calibration) -> list[HeldTest]:
    """Test each parameter that was held, and the scale of the target: what would it be if it were free?

    Parameters
    ----------
    calibration : Calibration
        A finished calibration.

    Returns
    -------
    list of HeldTest
        Those that would lower the residuals most come first. Wrong numbers imitate each other: only the first few
        say what may be wrong, and none of them that it is.

    Notes
    -----
    Score (Lagrange multiplier) test by one Gauss-Newton step: with gradient g and information H of the residuals,
    target poses eliminated, the free parameters f and one held parameter h, v = H_hh - H_hf (H_ff + P)^-1 H_fh with
    the precision P of the drawing; the change is g_h / v, and the sum of squares falls by g_h^2 / v.

    References
    ----------
    Rao 1948, Proc. Cambridge Phil. Soc. 44, 50; Engle 1984, Handbook of Econometrics II, chapter 13.
    """
    equations = _with_one_focal(normal_equations(calibration))
    unknowns = calibration.unknowns
    free = equations.embed.T @ equations.information @ equations.embed + np.diag(1 / unknowns.spread**2)
    inverse = np.linalg.pinv(free * np.outer(unknowns.spread, unknowns.spread), hermitian=True)
    inverse *= np.outer(unknowns.spread, unknowns.spread)
    cross = equations.embed.T @ equations.information  # (S, A)
    answer = -inverse @ cross  # (S, A): how the free parameters follow
    slopes = _depth_slopes(calibration, equations)
    tests = []
    for k in np.flatnonzero(~equations.embed.any(1)):
        whole = equations.information[k, k]
        left = whole + cross[:, k] @ answer[:, k]
        moved = slopes[..., k] + slopes @ (equations.embed @ answer[:, k])
        tests.append(_test(calibration, equations, k, left if left > _DEPENDENT * whole else 0.0, moved))

    def unlikeliness(test):  # sum of squares that is left, and how far the drawing would have been wrong
        left = equations.squares * (test.rms / max(calibration.rms, 1e-300)) ** 2
        return left + (test.change / _spread(test.name, test.value)) ** 2

    return sorted(tests, key=unlikeliness)


def _test(calibration, equations, k, left, moved):
    fall = min(equations.gradient[k] ** 2 / left / equations.squares, _ALL) if left > 0 else 0.0
    shrink = float(np.sqrt(1 - fall))
    change = float(equations.gradient[k] / left) if left > 0 else 0.0
    sigma = shrink / float(np.sqrt(left)) if left > 0 else np.inf
    value = float(equations.values[k])
    return HeldTest(equations.names[k], value, change, sigma, shrink * calibration.rms, rms(moved * change))


def freed(calibration: Calibration, test: HeldTest) -> HeldTest:
    """The test with the figures of a calibration in which the parameter is free: exact where the step was large."""
    if test.name == SCALE:
        return test
    names = tuple(re.sub(r"\[\d+\]", "", name) for name in (*calibration.unknowns.names, test.name))
    result = recalibrate(calibration, free=names, poses=calibration.poses)
    change = result.values[test.name] - test.value
    moved = test.depth_change * abs(change / test.change) if test.change else 0.0
    return replace(test, change=change, sigma=result.sigma[test.name], rms=result.rms, depth_change=moved)


def sentence(test: HeldTest, calibration: Calibration) -> str:
    """The test in words for the person who calibrates."""
    if test.name == SCALE:
        return (
            f"the photographs ask for a target {1 + test.change:.4f} +- {test.sigma:.4f} times as large: is the square "
            "length right?"
        )
    kind = kind_of(test.name)
    unit = f" {kind.unit}" if kind.unit else ""
    wanted, sigma, held = (kind.factor * x for x in (test.value + test.change, test.sigma, test.value))
    digits = max(0, min(8, 1 - int(np.floor(np.log10(max(sigma, 1e-12))))))
    advice = "free it to see"
    where = f"{held:.{digits}f}{unit}"
    if test.name.startswith("optic.index"):
        glass = getattr(calibration.setup.optic, "glass", None)
        where = f"{held:.4f}" + (f" of {glass}" if isinstance(glass, str) else "")
        advice = "is it the right glass?"
    elif test.name.startswith("optic.facet"):
        advice = "the facets deviate from the drawing: free optic.facets"
    elif test.name.startswith("camera."):
        advice = (
            "is the camera's calibration right, and the focus as it was? Free it, with photographs taken without the "
            "optic"
        )
    return (
        f"the photographs ask for {test.name} = {wanted:.{digits}f} +- {sigma:.{digits}f}{unit} where it was held at "
        f"{where}: {advice}"
    )


class Equations(NamedTuple):
    """Normal equations of all parameters of a setup and the target's scale at the solution, poses eliminated."""

    names: tuple[str, ...]  # (A,)
    values: np.ndarray  # (A,)
    information: np.ndarray  # (A, A), scaled by sigma0
    gradient: np.ndarray  # (A,), scaled by sigma0
    squares: float  # sum of the weighted squares of the residuals, scaled by sigma0
    embed: np.ndarray  # (A, S): the free parameters among all of them
    to_setup: np.ndarray  # (C, F, A): the parameters of each channel's setup by all


def normal_equations(calibration: Calibration) -> Equations:
    """Normal equations of all parameters, free and held, and of the scale of the target."""
    unknowns, seen = calibration.unknowns, calibration.observations
    everything = Unknowns.of(unknowns.setups, unknowns.setups[0].parameter_names)
    flat = np.linalg.pinv(everything.matrix.reshape(-1, len(everything)))
    found = [unknowns.parameters(calibration.solution.shared, k) for k in range(len(calibration.setups))]
    values = flat @ np.concatenate(found)
    points = rig_points(calibration)
    _, to_all, to_point = Prediction(everything, seen)(values, points, True)
    turned = points - np.array([pose.translation for pose in calibration.poses])[seen.photo]
    to_scale = np.einsum("nij,nj->ni", to_point, turned)[..., None]
    to_all = np.concatenate([to_all, to_scale], -1)
    weight = np.sqrt(calibration.solution.weights) / (seen.sigma * calibration.solution.sigma0)
    used = weight > 0
    to_pose = pose_columns(turned, to_point)
    miss = (calibration.residuals * weight[:, None])[used]
    to_all, to_pose = ((part * weight[:, None, None])[used] for part in (to_all, to_pose))
    reduced, gradient = reduce_poses(to_all, to_pose, miss, seen.photo[used])
    to_setup = np.concatenate([everything.matrix, np.zeros((*everything.matrix.shape[:2], 1))], -1)
    embed = flat @ unknowns.matrix.reshape(-1, len(unknowns))
    embed = np.concatenate([np.where(np.abs(embed) > 1e-9, embed, 0.0), np.zeros((1, embed.shape[1]))])
    names = (*everything.names, SCALE)
    return Equations(names, np.append(values, 1.0), reduced, gradient, float(np.sum(miss**2)), embed, to_setup)


def _with_one_focal(equations):
    """The equations with one more parameter, the focal length of x and y together, where both are held."""
    rows = [equations.names.index(f"camera.focal_{axis}") for axis in "xy"]
    if equations.embed[rows].any():
        return equations
    add = np.eye(len(equations.names), len(equations.names) + 1)
    add[rows, -1] = 1.0, equations.values[rows[1]] / equations.values[rows[0]]
    return Equations(
        (*equations.names, TIED_FOCAL),
        np.append(equations.values, equations.values[rows[0]]),
        add.T @ equations.information @ add,
        add.T @ equations.gradient,
        equations.squares,
        np.concatenate([equations.embed, np.zeros((1, equations.embed.shape[1]))]),
        equations.to_setup @ add,
    )


def pose_columns(turned: np.ndarray, to_point: np.ndarray) -> np.ndarray:
    """Derivatives (..., 2, 6) of pixels to the target's rotation vector (rad, rig frame) and translation (mm).

    `turned` (..., 3) are the target's points turned, not moved, into the rig's frame: a small rotation w moves them
    by w x turned.
    """
    return np.concatenate([np.cross(turned[..., None, :], to_point), to_point], -1)


def reduce_poses(
    to_shared: np.ndarray, to_pose: np.ndarray, miss: np.ndarray, photo: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Information (A, A) and gradient (A,) of whitened rows (N, 2, A), (N, 2, 6), (N, 2), each photograph's pose gone.

    Triggs et al. 2000, Bundle adjustment, a modern synthesis, section 6.1: Schur complement.
    """
    size = to_shared.shape[-1]
    total, gradient = np.zeros((size, size)), np.zeros(size)
    for number in np.unique(photo):
        rows = photo == number
        stacked = np.concatenate([to_shared[rows], miss[rows][..., None], to_pose[rows]], -1).reshape(-1, size + 7)
        reduced = schur(stacked.T @ stacked, 6)
        total += reduced[:-1, :-1]
        gradient += reduced[:-1, -1]
    return total, gradient


def schur(gram: np.ndarray, count: int) -> np.ndarray:
    """Gram matrices (..., K + count, K + count) with the last `count` unknowns eliminated, (..., K, K)."""
    kept, cross, block = gram[..., :-count, :-count], gram[..., :-count, -count:], gram[..., -count:, -count:]
    scale = np.sqrt(np.maximum(np.einsum("...ii->...i", block), 1e-300))  # rad and mm mix badly
    even = block / (scale[..., :, None] * scale[..., None, :])
    inverse = np.linalg.pinv(even, rcond=1e-12, hermitian=True)
    cross = cross / scale[..., None, :]
    return kept - cross @ inverse @ np.swapaxes(cross, -1, -2)


def _depth_slopes(calibration, equations):
    """Derivatives (D, H, W, A) of depths to all parameters over the working volume; NaN where there is none."""
    try:
        volume = working_volume(calibration.setup.rig(), target_depths(calibration, 3), 12)
    except CyclopeanError:  # a calibration gone astray, whose views see nothing together
        return np.full((1, 1, 1, len(equations.names)), np.nan)
    return depth_slopes(calibration.setup, volume)[1] @ equations.to_setup[0]


def _spread(name, value):
    if name == SCALE:
        return _SCALE_SPREAD
    kind = kind_of(name)
    return kind.spread * abs(value) if kind.relative else kind.spread
