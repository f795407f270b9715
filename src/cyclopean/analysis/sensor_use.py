"""What the pixels of the sensor are used for at one depth: seen by how many views, or lost beside seams."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..errors import SetupError
from ..rigs import Rig

_PIXELS = 200_000  # sampled by default
LOST = -1  # beside a seam, where the open aperture and the width of a pixel mix views


@dataclass(frozen=True, eq=False)
class SensorUse:
    """How many views see what each pixel looks at, at one depth."""

    depth: float  # mm
    step: int  # px between samples
    counts: (
        np.ndarray
    )  # (H, W) int8 of every step-th pixel: 0 no view, LOST beside a seam, else views that see its point
    views: int  # n of the rig

    def share(self, views: int) -> float:
        """Share of all pixels of the sensor whose point at this depth `views` views or more see."""
        if not 1 <= views <= self.views:
            raise SetupError(f"views must lie between 1 and {self.views}, got {views}")
        return float((self.counts >= views).mean())

    @property
    def lost(self) -> float:
        """Share of pixels that lie in a blend band or another margin beside a seam."""
        return float((self.counts == LOST).mean())

    @property
    def unused(self) -> float:
        """Share of pixels that look through no facet or mirror, or whose ray never comes to this depth."""
        return float((self.counts == 0).mean())


def sensor_use(rig: Rig, depth: float, step: int | None = None) -> SensorUse:
    """What the pixels of the sensor are used for at a depth.

    A pixel counts as used when it belongs to a view, margins beside seams taken off (`Setup.rig` makes them as wide as
    half the blend band and 1.5 px); its point counts for another view wherever that view sees it, margins or not.

    Parameters
    ----------
    rig : Rig
        n views of any kind.
    depth : float
        z, mm.
    step : int, optional
        Take every step-th pixel, both ways; such that about 200,000 are sampled where not given.
    """
    if not 0 < depth < np.inf:
        raise SetupError(f"a depth is a positive number of mm, got {depth}")
    width, height = rig.size
    if step is None:
        step = max(int(np.sqrt(width * height / _PIXELS)), 1)
    if not (step >= 1 and step == int(step)):
        raise SetupError(f"step must be a whole number of px, 1 or more, got {step}")
    columns, rows = np.arange(step // 2, width, step), np.arange(step // 2, height, step)
    counts = np.zeros((len(rows), len(columns)), dtype=np.int8)
    for own, view in enumerate(rig):
        traced, kept = (mask[np.ix_(rows, columns)] for mask in (view.region.traced, view.region.mask))
        counts[traced & ~kept & (counts == 0)] = LOST
        row, column = np.nonzero(kept)
        points = view.rays(np.stack([columns[column], rows[row]], -1)).at_depth(depth)
        seen = np.isfinite(points[:, 0]).astype(np.int8)
        for other, another in enumerate(rig):
            if other != own and len(points):
                seen += np.isfinite(another.project(points)[:, 0])
        counts[row, column] = np.maximum(counts[row, column], seen)
    return SensorUse(float(depth), int(step), counts, len(rig))
