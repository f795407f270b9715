"""How far a calibration can be trusted: what the photographs leave open, and what looks wrong, in plain words."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..errors import CyclopeanError
from .checks import warnings_of
from .depths import DepthErrors, depth_errors, rms, target_depths
from .held import HeldTest, tests_of_held
from .physical import Calibration
from .unknowns import kind_of

__all__ = [
    "DepthErrors",
    "Direction",
    "HeldTest",
    "correlated",
    "depth_errors",
    "tests_of_held",
    "undetermined",
    "warnings_of",
]

_OPEN = 1 / 3  # posterior over prior standard deviation, above which the drawing has most of the say
_POOR = 0.1  # the same ratio, above which a correlation is worth a remark
_CORRELATED = 0.99
_NOTHING = 0.5  # share of the drawing, above which the photographs say as good as nothing
_TELLING = 0.9  # share of a direction that the parameters named in its sentence cover
_STEPS = {"": 0.01}  # by which a parameter without unit changes in a sentence; 1 for mm, px, deg


@dataclass(frozen=True, eq=False)
class Direction:
    """Parameters that the photographs cannot tell, or cannot tell apart."""

    names: tuple[str, ...]  # of the parameters that it mainly moves
    weights: np.ndarray  # (S,), unit length, of all free parameters in units of their spread
    share: float  # of the drawing in what is known about it: 1 all of it, 0 none
    depth_sigma: float  # mm, root mean square over the working volume: how uncertain it leaves depths
    text: str


def undetermined(calibration: Calibration, pixel_sigma: float = 0.1) -> tuple[Direction, ...]:
    """Directions of the free parameters about which the photographs say less than the drawing.

    Parameters
    ----------
    calibration : Calibration
        A finished calibration.
    pixel_sigma : float
        Noise of a matched pixel, px; what a direction does to depths is weighed against it.

    Returns
    -------
    tuple of Direction
        Least known first; empty where the photographs determine everything to a third of the drawing's spread.

    Notes
    -----
    Eigenvectors of the photographs' information, each parameter in units of its prior spread: an eigenvalue e leaves
    the share 1 / (1 + e) of the prior's variance. Open eigenvectors are turned by varimax within the space that they
    span, so that each names few parameters.

    References
    ----------
    Belsley, Kuh, Welsch 1980, Regression diagnostics, chapter 3; Kaiser 1958, Psychometrika 23, 187 (varimax).
    """
    unknowns = calibration.unknowns
    if not len(unknowns):
        return ()
    spread = _spread(calibration)
    information = calibration.solution.information * np.outer(spread, spread)
    values, vectors = np.linalg.eigh(information)
    loose = 1 / (1 + np.maximum(values, 0.0)) > _OPEN**2
    if not loose.any():
        return ()
    try:
        errors = depth_errors(calibration, target_depths(calibration, 3), pixel_sigma, samples=12)
    except CyclopeanError:  # views that share nothing, or no photograph through the optic
        errors = None
    posterior = vectors / (1 + np.maximum(values, 0.0)) @ vectors.T
    turned = varimax(vectors[:, loose])
    found = [_direction(calibration, weights, posterior, errors) for weights in turned.T]
    return tuple(sorted(found, key=lambda direction: -direction.share))


def correlated(calibration: Calibration) -> tuple[str, ...]:
    """Remarks on pairs of poorly known parameters whose errors go together almost entirely."""
    names, covariance = calibration.unknowns.names, calibration.solution.covariance
    sigma = np.sqrt(np.diag(covariance))
    poor = sigma > _POOR * _spread(calibration)
    told = [set(direction.names) for direction in undetermined(calibration)]
    remarks = []
    for i, j in zip(*np.triu_indices(len(names), 1), strict=True):
        ratio = covariance[i, j] / (sigma[i] * sigma[j])
        if (
            poor[i]
            and poor[j]
            and abs(ratio) > _CORRELATED
            and not any({names[i], names[j]} <= group for group in told)
        ):
            remarks.append(
                f"{names[i]} and {names[j]} are known together rather than each: correlation {ratio:+.3f}, "
                f"{_amount(names[i], sigma[i])} and {_amount(names[j], sigma[j])} uncertain"
            )
    return tuple(remarks)


def varimax(vectors: np.ndarray, rounds: int = 60) -> np.ndarray:
    """Orthonormal columns (S, K) turned within their span so that each has few large entries.

    Kaiser 1958; the turn is found by repeated singular value decompositions (Horst 1965, Factor analysis of data
    matrices, section 18.4).
    """
    turned, last = vectors, -np.inf
    for _ in range(rounds):
        gradient = vectors.T @ (turned**3 - turned * np.mean(turned**2, axis=0))
        left, strength, right = np.linalg.svd(gradient)
        turned = vectors @ (left @ right)
        if strength.sum() <= last * (1 + 1e-10):
            break
        last = strength.sum()
    return turned


def _direction(calibration, weights, posterior, errors):
    names = calibration.unknowns.names
    order = np.argsort(-np.abs(weights))
    count = 1 + int(np.argmax(np.cumsum(weights[order] ** 2) >= _TELLING - 1e-9))
    main = order[:count]
    share = float(weights @ posterior @ weights)
    steps = weights * _spread(calibration)
    uncertain = rms(errors.slopes @ steps) * np.sqrt(share) if errors is not None else np.nan
    text = _alone(calibration, main[0], share) if count == 1 else _together(names, steps, np.sort(main))
    return Direction(tuple(names[k] for k in np.sort(main)), weights, share, uncertain, text + _harm(uncertain, errors))


def _alone(calibration, k, share):
    name, start = calibration.unknowns.names[k], calibration.unknowns.start[k]
    drawing = _amount(name, _spread(calibration)[k])
    if share > _NOTHING:
        return (
            f"{name} is not determined by these photographs; it was held near {_amount(name, start)} "
            f"(drawing, +- {drawing})"
        )
    return (
        f"{name} is hardly determined by these photographs: {_amount(name, calibration.values[name])} +- "
        f"{_amount(name, calibration.sigma[name])}, where the drawing says {_amount(name, start)} +- {drawing}"
    )


def _together(names, steps, main):
    first = main[0]
    listed = f"{', '.join(names[k] for k in main[:-1])} and {names[main[-1]]}"
    kinds = {kind_of(names[k]).unit for k in main}
    if len(main) > 2 and len(kinds) == 1 and np.ptp(steps[main]) < 0.01 * abs(steps[first]):
        return f"{listed} are known by their differences alone: the drawing decided what they have in common"
    kind = kind_of(names[first])
    step = _STEPS.get(kind.unit, 1.0) / kind.factor / steps[first]
    moves = [
        f"{_amount(names[k], abs(steps[k] * step))} {'more' if steps[k] * step > 0 else 'less'} of {names[k]}"
        for k in main
    ]
    return (
        f"{listed} cannot be told apart by these photographs: {moves[0]} with {' and '.join(moves[1:])} fits as well, "
        "and the drawing decided"
    )


def _harm(uncertain, errors):
    if not np.isfinite(uncertain):
        return ""
    if uncertain < 0.05 * rms(errors.noise):
        return "; depths hardly depend on it"
    return f"; it leaves depths uncertain by {uncertain:.2g} mm"


def _amount(name, value):
    """A value in the unit in which people read it."""
    kind = kind_of(name)
    value = value * kind.factor
    text = f"{value:.2f}" if abs(value) >= 0.1 or value == 0 else f"{value:.2g}"
    return f"{text} {kind.unit}".rstrip()


def _spread(calibration):
    """Prior standard deviations (S,); what a drawing usually knows where none was assumed."""
    unknowns = calibration.unknowns
    usual = [
        kind.spread * (abs(value) if kind.relative else 1.0)
        for kind, value in zip(map(kind_of, unknowns.names), unknowns.start, strict=True)
    ]
    return np.where(np.isfinite(unknowns.spread), unknowns.spread, usual)
