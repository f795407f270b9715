"""Whether stated standard deviations can be trusted: stated against found, bin by bin."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from ..errors import MeasurementError, ShapeError

NORMAL_SHARES = (0.6827, 0.9545, 0.9973)  # within 1, 2 and 3 standard deviations, of a normal distribution


@dataclass(frozen=True, eq=False)
class Reliability:
    """What errors are, where their standard deviation is stated to be this or that.

    All bins hold about the same number of values, those of the smallest stated sigma first.
    """

    count: int  # values in all
    counts: np.ndarray  # (B,) values in each bin
    stated: np.ndarray  # (B,) root mean square of the stated standard deviations
    spread: np.ndarray  # (B,) 68.27th percentile of the size of the errors: as robust as a median
    rms: np.ndarray  # (B,) root mean square of the errors, gross ones included
    shares: tuple[float, float, float]  # of errors within 1, 2 and 3 stated standard deviations; see NORMAL_SHARES
    ratio: float  # 68.27th percentile of error over sigma; 1 is ideal, more says that sigma is too small
    chi: float  # root mean square of error over sigma; 1 is ideal, gross errors raise it

    @property
    def factor(self) -> float:
        """By what factor, on average over the bins, stated and found differ: 1 is ideal."""
        off = np.abs(np.log(self.spread / self.stated))
        return float(np.exp(np.average(off, weights=self.counts)))


def reliability(errors: ArrayLike, sigma: ArrayLike, bins: int = 10) -> Reliability:
    """Compare errors with their stated standard deviations.

    Parameters
    ----------
    errors : (...) array
        Found minus true; NaN where there is none.
    sigma : (...) array
        Stated standard deviation of each, in the same unit; NaN where there is none.
    bins : int
        Number of bins of equal size that values are sorted into by their sigma.

    Returns
    -------
    Reliability
        Of the values that have both.

    Raises
    ------
    ShapeError
        The shapes differ.
    MeasurementError
        A sigma is not positive, or there are fewer values than bins.

    References
    ----------
    Levi, Gispan, Giladi and Fetaya, Evaluating and calibrating uncertainty prediction in regression tasks, Sensors
    22(15), 2022, section 3.2: bins of stated sigma against the root mean square of their errors.
    """
    errors, sigma = np.asarray(errors, dtype=float), np.asarray(sigma, dtype=float)
    if errors.shape != sigma.shape:
        raise ShapeError(f"every error needs a sigma of its own, got shapes {errors.shape} and {sigma.shape}")
    known = np.isfinite(errors) & np.isfinite(sigma)
    errors, sigma = np.abs(errors[known]), sigma[known]
    if bins < 1 or len(errors) < bins:
        raise MeasurementError(
            f"{len(errors)} errors that have a sigma cannot fill {bins} bins; ask for at least 1 bin, and for no more "
            "than there are errors"
        )
    if not (sigma > 0).all():
        raise MeasurementError(f"a standard deviation must be positive, got {sigma.min():g}; leave out exact values")
    parts = np.array_split(np.argsort(sigma, kind="stable"), bins)
    scaled = errors / sigma
    first, second, third = (float(np.mean(scaled <= k)) for k in (1, 2, 3))
    return Reliability(
        count=len(errors),
        counts=np.array([len(part) for part in parts]),
        stated=np.array([_root_mean_square(sigma[part]) for part in parts]),
        spread=np.array([np.percentile(errors[part], 100 * NORMAL_SHARES[0]) for part in parts]),
        rms=np.array([_root_mean_square(errors[part]) for part in parts]),
        shares=(first, second, third),
        ratio=float(np.percentile(scaled, 100 * NORMAL_SHARES[0])),
        chi=_root_mean_square(scaled),
    )


def _root_mean_square(values):
    return float(np.sqrt(np.mean(values**2)))
