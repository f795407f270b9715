"""What is best when several things count: candidates that no other betters in everything."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from .requirements import Candidate

OBJECTIVES = ("accuracy", "field", "size", "blend band", "colour", "sensor use")
TOLERANCE = 0.02
"""Relative difference below which two candidates count as equal in a figure."""
_LEAST = 0.05  # px: blurs that are smaller do no harm, and count as equal


def objectives(candidates: Sequence[Candidate]) -> np.ndarray:
    """Natural logarithms (N, 6) of what counts, in the order of `OBJECTIVES`; less is better.

    Accuracy at the worst depth, area that two views share at the middle depth, size (cube root of the box from the
    pinhole to the apex), blend band, chromatic blur, use of the sensor.
    """
    rows = []
    for candidate in candidates:
        figures = candidate.figures
        rows.append([
            figures.accuracy,
            1 / max(figures.area_two[figures.middle], 1e-9),
            (figures.diameter**2 * figures.length) ** (1 / 3),
            _LEAST + figures.blend,
            _LEAST + np.nan_to_num(figures.chromatic),
            1 / max(figures.use, 1e-9),
        ])  # fmt: skip
    return np.log(np.array(rows).reshape(-1, len(OBJECTIVES)))


def pareto_front(costs: np.ndarray, tolerance: float = TOLERANCE) -> np.ndarray:
    """Rows of the candidates that stay, the one with the least sum first.

    Parameters
    ----------
    costs : (N, M) array
        What is to be small; logarithms, where the tolerance is a relative one.
    tolerance : float
        A candidate goes when another one that stays is no worse by more than this in anything, and better in sum:
        near-equal candidates do not all stay.

    Returns
    -------
    (K,) int array
        For every candidate that went there is one that stays and is no worse by more than the tolerance in anything.

    References
    ----------
    Laumanns, Thiele, Deb, Zitzler 2002, Combining convergence and diversity in evolutionary multiobjective
    optimization, definition 4 (epsilon-approximate sets).
    """
    costs = np.asarray(costs, dtype=float)
    kept: list[int] = []
    for row in np.lexsort((*costs.T[::-1], costs.sum(-1))):
        if not kept or not (costs[kept] <= costs[row] + tolerance).all(-1).any():
            kept.append(int(row))
    return np.array(kept, dtype=int)


def spread_out(costs: np.ndarray, count: int) -> np.ndarray:
    """Rows (K,) of up to `count` candidates that lie far from one another: the best in each cost, then the farthest.

    Each next one has the greatest least distance to those before (Gonzalez 1985, Clustering to minimize the maximum
    intercluster distance).
    """
    costs = np.asarray(costs, dtype=float)
    if len(costs) <= count:
        return np.arange(len(costs))
    chosen = list(dict.fromkeys(int(row) for row in costs.argmin(0)))[:count]
    distance = np.min([((costs - costs[row]) ** 2).sum(-1) for row in chosen], axis=0)
    while len(chosen) < count:
        row = int(distance.argmax())
        chosen.append(row)
        distance = np.minimum(distance, ((costs - costs[row]) ** 2).sum(-1))
    return np.array(chosen)
