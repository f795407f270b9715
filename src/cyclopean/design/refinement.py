"""Better prisms near good ones: a pattern search over apex angle and distance, with exact rays."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from ..optics import Prism
from ..rigs.sizing import flat_distance
from .closed_forms import edge_of
from .grid import angles_of, covering_prism, distance_range, traced
from .requirements import Candidate, Requirements

_STEPS = ((0.15, 2.0), (0.05, 0.5), (0.015, 0.1))  # relative, of the distance; degrees, of the apex angle
_FINEST = 0.1  # degrees, to which free apex angles are rounded: no drawing states them more finely
_MOST = 30  # prisms traced for one start


@dataclass(frozen=True, eq=False)
class Workbench:
    """Traces prisms, each once, and remembers all of them."""

    requirements: Requirements
    seen: dict[tuple, Candidate | None] = field(default_factory=dict)

    def trace(self, prism: Prism) -> Candidate | None:
        """The candidate of a prism; None where no light comes through a facet."""
        key = (prism.facets, prism.glass, round(prism.apex_deg, 4), round(prism.distance, 3), prism.azimuth_deg)
        if key not in self.seen:
            self.seen[key] = traced(self.requirements, prism)
        return self.seen[key]

    @property
    def candidates(self) -> list[Candidate]:
        """All that could be traced."""
        return [candidate for candidate in self.seen.values() if candidate is not None]


def improve(bench: Workbench, start: Candidate, merit: Callable[[Candidate], float]) -> Candidate:
    """The candidate of least merit found near another one.

    Steps to both sides in distance and in apex angle, ever smaller ones (Hooke and Jeeves 1961, Direct search solution
    of numerical and statistical problems); of angles from a list, the next ones are tried.
    """
    best, value, left = start, merit(start), _MOST
    for step, turn in _STEPS:
        moved = True
        while moved and left > 0:
            moved = False
            for prism in _neighbours(bench.requirements, best.prism, step, turn):
                left -= 1
                found = bench.trace(prism)
                if found is not None and (new := merit(found)) < value - 1e-6:
                    best, value, moved = found, new, True
                    break
    return best


def _neighbours(requirements, prism, step, turn):
    """Prisms a step nearer and farther; flatter and steeper ones at the same distance, apex or, about, baseline."""
    for factor in (1 + step, 1 / (1 + step)):
        yield from _placed(requirements, prism, prism.apex_deg, prism.distance * factor)
    for apex in _next_angles(requirements, prism.apex_deg, turn):
        yield from _placed(requirements, prism, apex, prism.distance)
        yield from _placed(requirements, prism, apex, _same_apex(requirements, prism, apex))
        yield from _placed(requirements, prism, apex, prism.distance * prism.apex_deg / apex)


def _same_apex(requirements, prism, apex_deg):
    """Distance (mm) at which a prism with another angle has its apex, and so its size, where this one has."""
    return float(flat_distance(requirements.camera, apex_deg, prism.distance + prism.thickness, edge_of(requirements)))


def _next_angles(requirements, apex_deg, turn):
    if requirements.angles_deg is None:
        angles = np.round([apex_deg - turn, apex_deg + turn], 1)
        return [float(angle) for angle in angles if _FINEST <= angle < 90]
    known = angles_of(requirements)
    place = int(np.abs(known - apex_deg).argmin())
    return [float(known[k]) for k in (place - 1, place + 1) if 0 <= k < len(known)]


def _placed(requirements, prism, apex_deg, distance):
    """The prism with another angle and distance, as far as there may be one: nothing, or one."""
    least, most = distance_range(requirements, np.asarray(apex_deg))
    if not (least <= most and np.isfinite(distance)):
        return
    distance = float(np.clip(distance, least, most))
    if (apex_deg, distance) != (prism.apex_deg, prism.distance):
        yield covering_prism(requirements, prism.facets, apex_deg, prism.glass, distance, prism.azimuth_deg)
