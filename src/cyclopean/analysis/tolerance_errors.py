"""Depth errors of many setups: quantiles, yield, and what drives them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ..calibration.depths import rms
from ..errors import SetupError

LEVELS = (0.5, 0.68, 0.95, 0.99)
"""Usual quantiles of a distribution."""

_HUGE = 1e30  # mm, in the place of inf where numbers are interpolated


@dataclass(frozen=True, eq=False)
class DepthErrorSample:
    """Depth errors, computed minus true, of D setups at N points of the common field on Z planes."""

    depths: np.ndarray  # (Z,) mm
    points: np.ndarray  # (N, 3) mm, in the rig frame
    plane: np.ndarray  # (N,) int, which depth a point belongs to
    errors: np.ndarray  # (D, N) mm; NaN: fewer than two views of the real setup show the point; inf: rays part
    linear: np.ndarray  # (N,) mm, standard deviation to first order, from derivatives

    @property
    def sigma(self) -> np.ndarray:
        """(Z,) mm, root mean square error over setups and field."""
        return self._each(rms)

    @property
    def linear_sigma(self) -> np.ndarray:
        """(Z,) mm, the same to first order."""
        return np.array([rms(self.linear[self.plane == k]) for k in range(len(self.depths))])

    @property
    def bias(self) -> np.ndarray:
        """(Z,) mm, mean error over setups and field."""
        return self._each(lambda part: float(np.mean(part[np.isfinite(part)])) if np.isfinite(part).any() else np.nan)

    def quantiles(self, levels: Sequence[float] = LEVELS) -> np.ndarray:
        """Sizes (Z, L) mm that the error of a point of the field does not exceed in a share `levels` of the cases."""
        levels = np.asarray(levels, dtype=float)
        if not ((levels >= 0) & (levels <= 1)).all():
            raise SetupError(f"quantiles are asked for by shares between 0 and 1, got {levels}")
        found = self._each(lambda part: np.nanquantile(np.minimum(np.abs(part), _HUGE), levels), len(levels))
        return np.where(found > 1e-9 * _HUGE, np.inf, found)

    @cached_property
    def worst(self) -> np.ndarray:
        """(D, Z) mm, largest size of the error over the field; NaN where no point of a plane is seen by two views."""
        found = np.full((len(self.errors), len(self.depths)), np.nan)
        for k in range(len(self.depths)):
            part = np.abs(self.errors[:, self.plane == k])
            seen = ~np.isnan(part).all(-1)
            found[seen, k] = np.nanmax(part[seen], axis=-1) if part.shape[1] else np.nan
        return found

    @property
    def failed(self) -> np.ndarray:
        """(D,) bool: setups that give no depth at all, as no two views share anything any more."""
        return ~np.isfinite(self.errors).any(-1)

    @property
    def lost(self) -> np.ndarray:
        """(Z,) share of the points that fewer than two views of the real setups show."""
        return self._each(lambda part: float(np.mean(np.isnan(part))) if part.size else np.nan)

    @property
    def astray(self) -> np.ndarray:
        """(Z,) share of the points whose rays part, or cross so far away that no depth comes out."""
        return self._each(lambda part: float(np.mean(np.isinf(part))) if part.size else np.nan)

    def passing(self, percent: float | np.ndarray) -> np.ndarray:
        """Share (..., Z + 1) of setups whose error stays under so many percent of the depth all over the field.

        One column for each depth, the last for all depths together; NaN for a depth at which the drawing's views share
        nothing. A setup that shows no point of a depth fails there. Where it shows some, those that it has lost do not
        count.
        """
        percent = np.asarray(percent, dtype=float)
        if not (percent > 0).all():
            raise SetupError(f"a requirement is a positive percentage of the depth, got {percent}")
        relative = 100 * self.worst / self.depths
        known = np.bincount(self.plane, minlength=len(self.depths)) > 0  # where the drawing's views share something
        relative = np.where(np.isnan(relative), np.inf, relative)
        highest = np.max(relative[:, known], axis=-1, keepdims=True)
        good = np.concatenate([np.where(known, relative, np.nan), highest], -1)
        ordered = np.sort(good, axis=0)  # NaN last
        shares = [np.searchsorted(column, percent, side="right") / len(column) for column in ordered.T]
        return np.where(np.append(known, True), np.stack(shares, -1), np.nan)

    def _each(self, figure, count=None):
        """A figure of the errors of every plane; NaN where the plane holds none."""
        found = np.full((len(self.depths), count or 1), np.nan)
        for k in range(len(self.depths)):
            part = self.errors[:, self.plane == k]
            if part.size and (count is None or np.isfinite(part).any()):
                found[k] = figure(part)
        return found[:, 0] if count is None else found


@dataclass(frozen=True, eq=False)
class Drivers:
    """Which of T parameters the depth errors come from."""

    names: tuple[str, ...]  # (T,)
    shares: np.ndarray  # (Z, T) of the variance, by regression over the field; NaN at depths where nothing varies
    linear: np.ndarray  # (Z, T) the same to first order, from derivatives
    ranks: np.ndarray  # (Z, T) Spearman's rank correlation of the deviations and the field's mean error

    @property
    def overall(self) -> np.ndarray:
        """(T,) `shares` over all depths; NaN where nothing varies at any."""
        known = np.isfinite(self.shares).all(-1)
        return self.shares[known].mean(0) if known.any() else np.full(len(self.names), np.nan)

    @property
    def unexplained(self) -> float:
        """Share of the variance over all depths that no parameter explains by itself: what is not linear.

        NaN where nothing varies.
        """
        return float(np.maximum(1 - self.overall.sum(), 0.0))

    @property
    def order(self) -> np.ndarray:
        """(T,) int: the parameters, largest share over all depths first."""
        return np.argsort(-self.overall, kind="stable")


def drivers_of(names: tuple[str, ...], deviations: np.ndarray, sample: DepthErrorSample, linear: np.ndarray) -> Drivers:
    """Shares of each parameter in depth errors, from the draws themselves.

    They are NaN where fewer than two draws give depths, and where no parameter varies.

    Parameters
    ----------
    names : (T,) names
    deviations : (D, T) array
        Independent of each other.
    sample : DepthErrorSample
        The errors that they lead to.
    linear : (Z, T) array
        Shares to first order, to be shown beside.

    References
    ----------
    Saltelli, Chan, Scott 2000, Sensitivity analysis, chapter 6 (regression and rank correlation).
    """
    shares = np.full((len(sample.depths), len(names)), np.nan)
    ranks = shares.copy()
    good = ~sample.failed
    if good.sum() < 2:
        return Drivers(names, shares, linear, ranks)
    turned = deviations[good] - deviations[good].mean(0)
    spread = turned.std(0)
    unit = turned / np.where(spread > 0, spread, 1.0)
    for k in range(len(sample.depths)):
        part = sample.errors[good][:, sample.plane == k]
        seen = np.isfinite(part)
        if not seen.any() or not spread.any():
            continue
        count = np.maximum(seen.sum(0), 1)
        centred = np.where(seen, part - np.where(seen, part, 0.0).sum(0) / count, 0.0)
        slopes = np.einsum("dt,dn->tn", unit, centred) / count
        shares[k] = (slopes**2).sum(-1) / max(float((centred**2).sum(0) @ (1 / count)), 1e-300)
        usable = seen.any(-1)
        ranks[k] = _rank_correlation(unit[usable], np.nanmean(part[usable], axis=-1))
    return Drivers(names, shares, linear, ranks)


def _rank_correlation(columns, values):
    """Spearman's correlation (T,) of each column (D, T) with values (D,); 0 where a column is constant."""
    ranked = np.argsort(np.argsort(columns, axis=0), axis=0).astype(float)
    order = np.argsort(np.argsort(values)).astype(float)
    ranked, order = ranked - ranked.mean(0), order - order.mean()
    scale = np.sqrt((ranked**2).sum(0) * (order**2).sum())
    moving = (np.ptp(columns, axis=0) > 0) & (np.ptp(values) > 0)
    return np.where(moving, (ranked * order[:, None]).sum(0) / np.maximum(scale, 1e-300), 0.0)
