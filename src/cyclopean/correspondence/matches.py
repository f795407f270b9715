"""What sparse matching ends with: points of the scene, and the pixels that show each of them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..errors import SetupError
from ..rigs import Rig


@dataclass(frozen=True, eq=False)
class Counts:
    """How many candidates each step of the matcher left."""

    detected: np.ndarray  # (V,) int, points given in each view
    pairs: int  # pairs of points of two views, all combinations; 0 where points were known by name
    in_band: int  # pairs that agree in two views: within the epipolar band and the depth range
    alike: int  # of these, pairs that also look alike; the same number without descriptors
    verified: int  # tuples of three and more points that agree
    matched: int
    refused: int  # matches that were left out since another explanation is nearly as good

    def per_point(self, pairs: int) -> float:
        """A number of pairs as candidates that a point has in each other view, on average."""
        places = (len(self.detected) - 1) * int(self.detected.sum())
        return 2 * pairs / places if places else 0.0


@dataclass(frozen=True, eq=False)
class Matches:
    """P points of the scene in V views.

    Ambiguity and next best are different things, and a match has one of them: the other is NaN.
    """

    pixels: np.ndarray  # (P, V, 2) px, NaN where a view does not show the point
    points: np.ndarray  # (P, 3) mm in the rig frame
    covariance: np.ndarray  # (P, 3, 3) mm^2
    residual: np.ndarray  # (P,) px, root mean square over the coordinates of the pixels
    views: np.ndarray  # (P,) int, how many views show the point
    expected: np.ndarray  # (P,) int, how many views should show it: the point falls on their pixels
    ambiguity: np.ndarray  # (P,) likelihood of the best rival over the match's own: 0 without a rival, 1 undecidable
    next_best: np.ndarray  # (P,) correlation of the next best place over the match's, of points found by a window
    source: np.ndarray  # (P, V) int, rows of the points given for each view; -1 where a view does not show the point
    label: np.ndarray  # (P,) int, the point's name where it has one: row of a target's or of a person's points; else -1
    refused: np.ndarray  # (R, V) int, rows of the matches that were left out as ambiguous; -1 as in source
    detected: tuple[np.ndarray, ...]  # V arrays (N, 2) px, the points given
    counts: Counts

    def __len__(self) -> int:
        return len(self.points)

    def select(self, rows: np.ndarray) -> Matches:
        """Some of the matches (a mask or indices); counts and refused ones stay as they are."""
        return Matches(
            self.pixels[rows], self.points[rows], self.covariance[rows], self.residual[rows], self.views[rows],
            self.expected[rows], self.ambiguity[rows], self.next_best[rows], self.source[rows], self.label[rows],
            self.refused, self.detected, self.counts,
        )  # fmt: skip


def pixels_of(source: np.ndarray, detected: tuple[np.ndarray, ...]) -> np.ndarray:
    """Pixels (P, V, 2) of rows (P, V) of the detected points; NaN where the row is -1."""
    columns = []
    for rows, pixels in zip(source.T, detected, strict=True):
        padded = np.concatenate([pixels, np.full((1, 2), np.nan)])
        columns.append(padded[rows])
    return np.stack(columns, 1) if columns else np.zeros((len(source), 0, 2))


def check_views(rig: Rig, min_views: int) -> None:
    """A SetupError where a rig has no two views, or fewer than are asked for."""
    if len(rig) < 2:
        raise SetupError("a rig of one view has nothing to match: two views must see the same point")
    if not 2 <= min_views <= len(rig):
        raise SetupError(f"min_views must be a whole number from 2 to {len(rig)}, got {min_views}")
