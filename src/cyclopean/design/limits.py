"""Requirements as numbers: by how much a candidate misses each, for exact figures and closed forms alike."""

from __future__ import annotations

from collections.abc import Collection, Mapping

import numpy as np

from .closed_forms import Screen
from .requirements import Figures, Requirements

SHARED = "shared"
"""The name of what is asked of every candidate: two views share a tenth of the picture's width and height about the
axis at all depths, or something at least where a field is wanted; and light comes through to the picture's corners."""
_TENTH, _SOMETHING = 0.1, 0.001  # of the picture's width and height
_BASELINE = 0.02  # by which a baseline may miss the one wanted
# Exact over closed form, at worst, for thin prisms and narrow pictures: found by tracing, see the tests.
_MARGINS = {"accuracy": 2.0, "field": 2.0, "max_chromatic": 1.2, SHARED: 2.0}
_ROUNDING = 1.001
_BASELINES = (0.4, 0.1)  # by which an exact baseline is shorter or longer, at most
_HOPELESS = 10.0  # doubt from which closed forms cannot say that nothing is shared


def wanted(requirements: Requirements) -> tuple[str, ...]:
    """Names of the requirements that are stated, of those that a candidate can miss."""
    names = ("accuracy", "field", "baseline", "max_diameter", "max_length", "max_blend", "max_chromatic")
    return tuple(name for name in names if getattr(requirements, name) is not None)


def values_of(figures: Figures | Screen) -> dict[str, np.ndarray]:
    """What each requirement limits: a number, or one for each of N candidates; for the field its width and height."""
    return {
        "accuracy": np.asarray(figures.accuracy),
        "field": np.asarray(figures.field),
        "baseline": np.asarray(figures.baseline),
        "max_diameter": np.asarray(figures.diameter),
        "max_length": np.asarray(figures.length),
        "max_blend": np.asarray(figures.blend),
        "max_chromatic": np.asarray(figures.chromatic),
    }


def limit_of(requirements: Requirements, name: str):
    """What a candidate's figure is held against."""
    return requirements.accuracy_on_paper if name == "accuracy" else getattr(requirements, name)


def excesses(figures: Figures | Screen, requirements: Requirements) -> dict[str, np.ndarray]:
    """By which factor each stated requirement is missed: 1 or less where it is kept."""
    found, values = {}, values_of(figures)
    for name in wanted(requirements):
        limit, value = limit_of(requirements, name), values[name]
        if name == "field":
            with np.errstate(divide="ignore"):
                found[name] = np.max(np.asarray(limit) / np.maximum(value, 1e-9), axis=-1)
        elif name == "baseline":
            off = np.maximum(np.abs(value / limit - 1) - _BASELINE, 0.0)
            found[name] = 1 + np.where(figures.solved, 0.0, off) if isinstance(figures, Screen) else 1 + off
        else:
            found[name] = np.where(np.isfinite(value), value, np.inf) / limit
    if isinstance(figures, Figures):
        lit = np.isfinite(figures.accuracy) and figures.reflection_margin > 0
        shares = figures.field_two / (figures.depths[:, None] * picture_size(requirements))
        share = np.asarray(shares.min() if lit else 0.0)
    else:
        share = figures.shared
    least = _TENTH if requirements.field is None else _SOMETHING
    found[SHARED] = least / np.maximum(share, 1e-6)
    return found


def picture_size(requirements: Requirements) -> np.ndarray:
    """Width and height (2,) of what the bare camera shows, over depth."""
    return np.divide(requirements.camera.size, requirements.camera.focal)


def worst(excess: Mapping[str, np.ndarray], without: Collection[str] = ()) -> np.ndarray:
    """The largest of all factors, some requirements left out or none; 1 where there are no others."""
    factors = [value for name, value in excess.items() if name not in without]
    return np.max(np.stack(factors), axis=0) if factors else np.ones(())


def may_fit(screen: Screen, requirements: Requirements, without: Collection[str] = ()) -> np.ndarray:
    """(N,) bool: which candidates exact tracing might accept, by closed forms and the most that these are off."""
    possible = np.isfinite(screen.accuracy) | (screen.doubt > _HOPELESS)
    for name, excess in excesses(screen, requirements).items():
        if name in without:
            continue
        if name == "baseline":
            share = requirements.baseline / screen.baseline
            least = (1 - _BASELINE) / (1 + _BASELINES[0] * screen.doubt)
            most = (1 + _BASELINE) * (1 + _BASELINES[1] * screen.doubt)
            possible &= (share > least) & (share < most) | screen.solved
        elif name in _MARGINS:
            possible &= (excess <= 1 + (_MARGINS[name] - 1) * screen.doubt) | (screen.doubt > _HOPELESS)
        else:
            possible &= excess <= _ROUNDING
    return possible
