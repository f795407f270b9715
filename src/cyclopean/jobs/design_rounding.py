"""Round numbers for a designed prism: what a drawing states and a ruler can set."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from ..design.requirements import Candidate, Requirements

_STEPS = (1.0, 0.5, 0.1, 0.05, 0.01)  # mm
_FINE = (0.01, 0.002)  # of a length, which steps must not exceed: tried one after the other


def rounded(candidate: Candidate, requirements: Requirements) -> Candidate:
    """The prism with a round distance, and diameter and thickness rounded up; traced anew."""
    from ..design.grid import covering_prism, traced
    from ..design.search import fits

    prism = candidate.prism
    if prism.radius is None:
        return candidate
    low, high = requirements.distances
    for fine in _FINE:
        step = _step(prism.distance, fine)
        distance = float(np.clip(round(round(prism.distance / step) * step, 6), low, high))
        raw = covering_prism(
            requirements, prism.facets, prism.apex_deg, prism.glass, distance, prism.azimuth_deg  # type: ignore[arg-type]
        )  # fmt: skip
        assert raw.radius is not None
        radius = _up(2 * raw.radius, fine) / 2
        thicker = (radius - raw.radius) * np.tan(np.deg2rad(raw.apex_deg))  # so that the rim stays
        found = traced(requirements, replace(raw, radius=radius, thickness=_up(raw.thickness + thicker, fine)))
        if found is not None and fits(found, requirements):
            return found
    return candidate


def _step(length: float, fine: float) -> float:
    """The largest step that is a small part of a length."""
    return next((step for step in _STEPS if step <= fine * length), _STEPS[-1])


def _up(length: float, fine: float) -> float:
    """A length rounded up to a whole number of steps."""
    step = _step(length, fine)
    return round(float(np.ceil(length / step - 1e-6)) * step, 6)
