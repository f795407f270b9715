"""Calibrations that cannot be right: how they are told, and what may be behind them."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from ..errors import CyclopeanError

if TYPE_CHECKING:
    from ..calibration.physical import Calibration
    from .calibration_request import Request

_MISFIT = 20.0  # times the stated noise of the corners, beyond which no lens is to blame
_MISFIT_PX = 1.0  # rms; below it, the stated noise may be too small
_LOST = 0.5  # share of the corners that may be outliers
_BETTER = 0.1  # of the residuals: a numbering that leaves so little is the right one
_FEW = 40  # corners of a photograph that tell numberings apart
_ITERATIONS = 15  # that show whether a numbering leads anywhere


def failure_of(calibration: Calibration) -> str:
    """Why a calibration is of no use, in words; empty where it may be of use."""
    solution, size = calibration.solution, calibration.rms
    if calibration.outliers.mean() > _LOST:
        return f"it explains no more than {100 * (1 - calibration.outliers.mean()):.0f} % of the corners"
    if misfits(calibration):
        return f"residuals of {size:.3g} px rms are {solution.sigma0:.0f} times the noise of the corners"
    for setup in calibration.setups:
        try:
            setup.rig()
        except CyclopeanError as fault:
            return f"the optic that came out cannot be right: {fault}"
    if not solution.converged:
        return f"it did not converge ({solution.message})"
    return ""


def misfits(calibration: Calibration) -> bool:
    """Whether a calibration explains as good as nothing."""
    lost = calibration.outliers.mean() > _LOST
    return bool(lost or (not calibration.rms < _MISFIT_PX and not calibration.solution.sigma0 < _MISFIT))


def numbered_otherwise(calibration: Calibration) -> str:
    """A sentence about another numbering of the views that explains the corners; empty where there is none."""
    from ..calibration.guess import renumbered
    from ..calibration.physical import calibrate

    seen, unknowns = calibration.observations, calibration.unknowns
    some = seen.select(np.arange(0, len(seen), max(1, len(seen) // (_FEW * len(seen.photos)))))
    free = [re.sub(r"\[\d+\]", "", name) for name in unknowns.names]
    best, right = _BETTER * _size(calibration), None
    for order in _orders(len(unknowns.setups[0].optic.paths(unknowns.setups[0].wavelength_nm))):
        try:
            found = calibrate(
                renumbered(some, order), calibration.target, unknowns.setups, free, iterations=_ITERATIONS
            )
        except (CyclopeanError, np.linalg.LinAlgError):
            continue
        if not misfits(found) and _size(found) < best:
            best, right = _size(found), order
    return "" if right is None else _sentence(right, unknowns.setups[0].optic, best)


def _size(calibration):
    """Median length of the residuals, px; infinite where most points are not seen."""
    length = np.linalg.norm(calibration.residuals, axis=-1)
    return float(np.median(np.where(np.isfinite(length), length, np.inf)))


def _orders(count):
    """What view k may be instead: counted from another view, or the other way round."""
    steps = np.arange(count)
    every = [tuple((first + sign * steps) % count) for sign in (1, -1) for first in range(count)]
    return [np.array(order) for order in dict.fromkeys(every) if order != tuple(steps)]


def _sentence(order, optic, size):
    what = "facet" if optic.kind == "prism" else "view"
    pairs = ", ".join(f"view {k} of the corners is {what} {number} of the setup" for k, number in enumerate(order))
    rising = len(order) < 3 or (order[1] - order[0]) % len(order) == 1
    turn = ""
    if what == "facet" and rising and not optic.facet_deviation_deg:
        azimuth = (optic.azimuth_deg + 360 * int(order[0]) / len(order)) % 360
        turn = f", or turn the drawing to azimuth_deg = {azimuth:g},"
    return (
        f"The views seem to be numbered otherwise: {pairs} (residuals of {size:.2g} px then). Renumber them in the "
        f"corners file{turn} and calibrate again."
    )


def as_failed(request: Request) -> Request:
    """The request with outputs under names that say so, and without what only a good calibration is worth."""
    output = request.output.with_name(f"{request.output.stem}_failed{request.output.suffix}")
    return replace(request, output=output, report=request.folder, validate=False, guide=False, compare=False)


def failure_message(request: Request, reason: str, hints: Sequence[str]) -> str:
    """One paragraph; `request` is that of `as_failed`."""
    wanted = request.output.stem.removesuffix("_failed")
    return (
        f"the calibration failed: {reason}. {''.join(f'{hint} ' for hint in hints)}What came out is of no use, and was "
        f"written as {', '.join(path.name for path in request.outputs)} instead of {wanted}.toml; "
        f"the warnings above and {request.folder}/report.html say what may be wrong"
    )
