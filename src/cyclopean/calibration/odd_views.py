"""Views of a photograph that contradict the others: corners in another order, another board, blur."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from ..errors import CyclopeanError
from ..rigs import View
from ..targets import DIRECT, Observations
from .starts import poses_from_rays

_ODD, _ODD_PX = 4.0, 1.0  # a view of a photograph: times the usual median residual, and at least so many px
_MISNUMBERED_PX = 5.0  # beyond this, no blur explains it
_AGREE_PX = 20.0  # between views, for the pose of a board by one view alone; wrong orders are off by far more


class OddView(NamedTuple):
    """What is wrong with a photograph."""

    photo: int
    views: tuple[int, ...]  # that contradict the majority; empty where there is none
    size: float  # px
    text: str

    @property
    def certain(self) -> bool:
        """Whether it is clear what is wrong: some views, or the numbers of the whole photograph."""
        return bool(self.views) or self.size > _MISNUMBERED_PX

    def rows(self, observations: Observations) -> np.ndarray:
        """(N,) bool: the rows that contradict."""
        mine = observations.photo == self.photo
        return mine & np.isin(observations.view, self.views) if self.views else mine


def odd_views(
    observations: Observations, residuals: np.ndarray, points: np.ndarray, views: Mapping[int, View]
) -> list[OddView]:
    """Photographs of which one view, or all, fit much worse than the rest.

    Parameters
    ----------
    observations : Observations
        N rows.
    residuals : (N, 2) array
        Of a calibration, px.
    points : (N, 3) array
        The target's point of each row, mm.
    views : mapping
        The calibrated views by their numbers, continued beyond all borders; empty where there are none.
    """
    length = np.linalg.norm(residuals, axis=-1)
    length = np.where(np.isfinite(length), length, np.inf)
    pairs, group = np.unique(np.stack([observations.photo, observations.view], -1), axis=0, return_inverse=True)
    medians = np.array([np.median(length[group.ravel() == k]) for k in range(len(pairs))])
    bad = (medians > _ODD * np.median(medians)) & (medians > _ODD_PX)
    found = []
    for photo in np.unique(pairs[bad, 0]):
        mine = pairs[:, 0] == photo
        groups = [pairs[mine & which, 1] for which in (bad, ~bad)]
        if not len(groups[1]) and len(groups[0]) > 1:  # a pose between them all
            groups = _agreeing(observations, points, views, photo, groups[0])
        odd, rest = sorted(groups, key=len)  # the pose may have gone with the odd view, and left the others behind
        size = float(medians[mine & bad].max())
        certain = 0 < len(odd) < len(rest)
        text = _text(observations.photos[photo], odd, certain, size)
        found.append(OddView(int(photo), tuple(map(int, odd)) if certain else (), size, text))
    return found


def _text(name, odd, certain, size):
    off = f"{size:.3g} px" if np.isfinite(size) else "so much that it cannot see the points"
    why = ": are its corners numbered in the same order?" if size > _MISNUMBERED_PX else ": is it blurred?"
    if certain:
        views = " and ".join("the photograph" if view == DIRECT else f"view {view}" for view in odd)
        return f"{views} of {name} disagree{'s' if len(odd) == 1 else ''} with the other views by {off}{why}"
    if len(odd):
        return f"the views of {name} disagree with each other by {off}{why}"
    return (
        f"{name} disagrees with the other photographs by {off}: is it another board or setup, or are the corners of "
        "one view numbered in another order?"
    )


def _agreeing(observations, points, views, photo, numbers):
    """The views of a photograph that agree with each other on the pose of the target, and those that do not."""
    rows = {number: np.flatnonzero((observations.photo == photo) & (observations.view == number)) for number in numbers}
    best = np.zeros(len(numbers), dtype=bool)
    for number in numbers:
        try:
            rays = views[number].rays(observations.pixels[rows[number]])
        except (KeyError, CyclopeanError):  # an optic that shows nothing
            continue
        for pose in poses_from_rays(rays, points[rows[number]]):
            off = [
                np.linalg.norm(views[k].project(pose @ points[rows[k]]) - observations.pixels[rows[k]], axis=-1)
                for k in numbers
            ]
            good = np.array([np.median(length) < _AGREE_PX for length in off])
            best = good if good.sum() > best.sum() else best
    if best.sum() < 2:  # each agrees with itself alone
        return numbers, numbers[:0]
    return numbers[best], numbers[~best]
