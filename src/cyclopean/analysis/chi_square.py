"""Whether errors are as large as they were stated: chi-square of points and of calibrations against a known truth."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from ..calibration import Calibration
from ..calibration.unknowns import Unknowns
from ..errors import MeasurementError, ShapeError
from ..rigs import Setup
from .sensitivity import point_sensitivity

_SYMMETRIC = 1e-6  # of a covariance's entries: more is not rounding
_DAMAGED = -1e-9  # least eigenvalue of a matrix of correlations that rounding explains


@dataclass(frozen=True)
class ChiSquare:
    """A sum of squared errors, each in units of what was stated for it."""

    value: float
    freedom: int  # how many numbers were judged

    @property
    def reduced(self) -> float:
        """Value over freedom: 1 is ideal, more says that errors are larger than stated."""
        return self.value / self.freedom

    def interval(self, share: float = 0.95) -> tuple[float, float]:
        """Where `reduced` lies with this probability if all that was stated is true, and errors are normal."""
        from scipy.stats import chi2

        low, high = chi2.ppf([(1 - share) / 2, (1 + share) / 2], self.freedom) / self.freedom
        return float(low), float(high)

    @property
    def probability(self) -> float:
        """Of a larger value, if all that was stated is true."""
        from scipy.stats import chi2

        return float(chi2.sf(self.value, self.freedom))


def pooled(parts: Iterable[ChiSquare]) -> ChiSquare:
    """Several independent ones as one."""
    parts = list(parts)
    return ChiSquare(float(sum(part.value for part in parts)), sum(part.freedom for part in parts))


def chi_square(errors: ArrayLike, covariance: ArrayLike, shared: ArrayLike | None = None) -> ChiSquare:
    """Chi-square e' C^-1 e of errors that were stated with a covariance.

    Parameters
    ----------
    errors : (..., K) array
        Found minus true, such as points (N, 3) or depths (N, 1), mm. Rows with NaN are left out.
    covariance : (..., K, K) array
        Of each row by itself. The errors of different rows must be independent but for `shared`: of a dense map,
        take pixels farther apart than the matcher's windows.
    shared : (..., K, S) array, optional
        How S independent errors of one standard deviation each move all rows together, such as
        `calibration_shifts`. C is then block diagonal plus shared shared'.

    Returns
    -------
    ChiSquare

    Raises
    ------
    ShapeError
        The shapes do not fit.
    MeasurementError
        No row is left, or a covariance is not positive definite.

    References
    ----------
    Bar-Shalom, Li and Kirubarajan 2001, Estimation with applications to tracking and navigation, section 5.4.2
    (normalised estimation error squared); Woodbury's identity for the shared part.
    """
    rows, blocks, moves = _rows(errors, covariance, shared)
    try:
        roots = np.linalg.cholesky(blocks)
    except np.linalg.LinAlgError:
        raise MeasurementError(
            "a covariance is not positive definite; leave out exact values, and directions that nothing was stated for"
        ) from None
    white = np.linalg.solve(roots, rows[..., None])[..., 0].ravel()
    value = white @ white
    if moves.shape[-1]:
        pull = np.linalg.solve(roots, moves).reshape(white.size, -1)
        common = pull.T @ white
        value -= common @ np.linalg.solve(np.eye(len(common)) + pull.T @ pull, common)
    return ChiSquare(float(value), white.size)


def _rows(errors, covariance, shared):
    """Rows (N, K) without NaN, their covariances (N, K, K) and their shared moves (N, K, S)."""
    errors, covariance = np.asarray(errors, dtype=float), np.asarray(covariance, dtype=float)
    if errors.ndim < 1 or covariance.shape != (*errors.shape, *errors.shape[-1:]):
        wanted = (*errors.shape, *errors.shape[-1:])
        raise ShapeError(
            f"errors of shape (..., K), such as {errors.shape}, need covariances {wanted}, got {covariance.shape}; "
            "single numbers want a last axis of 1: errors[..., None], variances[..., None, None]"
        )
    moves = np.zeros((*errors.shape, 0)) if shared is None else np.asarray(shared, dtype=float)
    if moves.shape[:-1] != errors.shape:
        raise ShapeError(f"shared must have shape {(*errors.shape, 'S')}, got {moves.shape}")
    known = np.isfinite(errors).all(-1) & np.isfinite(covariance).all((-1, -2)) & np.isfinite(moves).all((-1, -2))
    if not known.any():
        raise MeasurementError("no error has a covariance: there is nothing to judge")
    blocks = covariance[known]
    size = np.abs(blocks).max(initial=0.0)
    if np.abs(blocks - np.swapaxes(blocks, -1, -2)).max(initial=0.0) > _SYMMETRIC * size:
        raise MeasurementError("a covariance is not symmetric")
    return errors[known], blocks, moves[known]


def calibration_shifts(calibration: Calibration, points: ArrayLike, *, seen: ArrayLike | None = None) -> np.ndarray:
    """How the uncertainty of a calibration moves triangulated points, all of them together.

    Parameters
    ----------
    calibration : Calibration
        With S free parameters.
    points : (..., 3) array
        Points in the rig frame, mm.
    seen : (..., V) bool array, optional
        Which views count; those that see the point where it is not given.

    Returns
    -------
    (..., 3, S) array
        mm, for each of S independent errors of one standard deviation: with B the shifts of all points, B B' is their
        covariance. NaN where fewer than two views see a point.

    Notes
    -----
    Of first order: the derivatives of `point_sensitivity` times a root of the calibration's covariance.
    """
    sensitivity = point_sensitivity(calibration.setup, points, seen=seen)
    return sensitivity.matrix @ (calibration.unknowns.matrix[0] @ _root(calibration.solution.covariance))


def calibration_chi_square(calibration: Calibration, true: Setup) -> ChiSquare:
    """Chi-square of what a calibration found, against the true setup.

    Parameters
    ----------
    calibration : Calibration
        Of one colour. Its covariance holds what the drawing was said to know (`tolerances`): over many setups the
        mean is 1 where drawings err by their tolerances, and where no parameter that was held is wrong.
    true : Setup
        Of the same kind of optic.

    Returns
    -------
    ChiSquare
        With as many degrees of freedom as the calibration has free parameters that anything is known about.
    """
    unknowns = calibration.unknowns
    error = calibration.solution.shared - Unknowns.of((true,), unknowns.names).start
    covariance = calibration.solution.covariance
    known = np.isfinite(np.diag(covariance)) & (np.diag(covariance) > 0)
    covariance = covariance[np.ix_(known, known)]
    scale = np.sqrt(np.diag(covariance))  # rad, mm and px mix badly
    return chi_square(error[known] / scale, covariance / np.outer(scale, scale))


def _root(covariance):
    """(S, S): its product with independent unit normal numbers has the covariance; 0 where nothing is known."""
    known = np.isfinite(np.diag(covariance))
    scale = np.where(known, np.sqrt(np.where(known, np.diag(covariance), 0.0)), 0.0)
    safe = np.where(scale > 0, scale, 1.0)
    alike = np.where(np.outer(known, known), covariance, 0.0) / np.outer(safe, safe)
    values, vectors = np.linalg.eigh(alike)
    if values.min(initial=0.0) < _DAMAGED * len(values):
        raise MeasurementError("the covariance of the calibration has a negative eigenvalue: it is damaged")
    return scale[:, None] * vectors * np.sqrt(np.maximum(values, 0.0))
