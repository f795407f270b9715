"""Why candidates do not fit, and by how little requirements would have to give way for one to fit."""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from dataclasses import replace

import numpy as np

from .closed_forms import Screen
from .grid import distance_range, prisms_of
from .limits import SHARED, excesses, may_fit, wanted, worst
from .refinement import Workbench, improve
from .requirements import Candidate, Explanation, Make, Relaxation, Requirements

_TRACED = 6  # candidates of each number of facets that are traced for each requirement that might give way
_STARTS = 4  # of them, each with another number of facets or turned, that are bettered
FORBIDDEN = 1e3
"""Merit of what misses a requirement that must be kept."""
_ROUNDS = 3  # of looking for what is accurate enough after making and calibrating
_SPARE = 0.99  # of an accuracy: what was found once is found again with so much room
_MORE = 1.02  # times the share of the accuracy on paper, from which it is worth another look
_BINDING = 0.97  # of a limit, from which it is what holds a candidate back
_WORDS = {
    "accuracy": "accuracy",
    "field": "field",
    "baseline": "baseline",
    "max_diameter": "diameter",
    "max_length": "length",
    "max_blend": "blend band",
    "max_chromatic": "spread of colours",
    SHARED: "common field about the axis",
}


def explain(
    bench: Workbench, screen: Screen, found: bool, make: Make | None, progress: Callable[[str, int, int], None]
) -> Explanation:
    """What kept candidates out; where nothing was found also what to give way in.

    Parameters
    ----------
    bench : Workbench
        With what has been traced.
    screen : Screen
        All candidates in closed form: these are counted.
    found : bool
        Whether any candidate fits.
    make : callable, optional
        As in `find_designs`.
    progress : callable
        As in `find_designs`.
    """
    requirements = bench.requirements
    factors = excesses(screen, requirements)
    failed = {name: int((factor > 1).sum()) for name, factor in factors.items()}
    alone = {name: int(((factors[name] > 1) & (worst(factors, [name]) <= 1)).sum()) for name in factors}
    if found:
        return Explanation(failed, alone, (), None, _counted(len(screen), failed, alone))
    relaxed: list[tuple[tuple[str, ...], Candidate]] = []
    groups = _groups(requirements)
    for done, names in enumerate(groups):
        progress("what would help", done, len(groups))
        if any(set(names) & set(other) for other, _ in relaxed):
            continue  # one of them is enough
        candidate = _made_without(bench, screen, names, make)
        if candidate is not None:
            relaxed.append((names, candidate))
            if names == ("accuracy",) and candidate.kept is not None and candidate.kept.kept:
                break  # it keeps all once it is made: the search left too much to making
    progress("what would help", len(groups), len(groups))
    relaxed.sort(key=lambda pair: _excess(pair[1], requirements, pair[0]))
    nearest = relaxed[0][1] if relaxed else _nearest(bench)
    relaxations = tuple(_relaxation(requirements, names, candidate) for names, candidate in relaxed)
    text = _story(requirements, relaxed, relaxations, nearest)
    return Explanation(failed, alone, relaxations, nearest, text)


def ranked(values: np.ndarray, count: int) -> np.ndarray:
    """Rows (K,) of some of the values (N,), the least first: ever fewer of those that follow."""
    order = np.argsort(values)
    places = np.unique(np.geomspace(1, max(len(order), 1), count).astype(int)) - 1
    return order[places[places < len(order)]]


def _groups(requirements):
    """Requirements that might give way: each alone, and the two that limit the size together."""
    names = wanted(requirements)
    sizes = ("max_diameter", "max_length")
    return [*((name,) for name in names), *([sizes] if set(sizes) <= set(names) else [])]


def _excess(candidate, requirements, names):
    factors = excesses(candidate.figures, requirements)
    return float(max(factors[name] for name in names))


def total_miss(candidate: Candidate, requirements: Requirements, without: Collection[str] = ()) -> float:
    """By which factor the worst requirement is missed, some left out or none; a little more where others are too."""
    factors = [value for name, value in excesses(candidate.figures, requirements).items() if name not in without]
    above = np.minimum(np.array([1.0, *factors]), FORBIDDEN)
    return float(above.max() + 0.01 * np.maximum(above - 1, 0).sum())


def _nearest(bench):
    return min(bench.candidates, key=lambda one: total_miss(one, bench.requirements), default=None)


def _made_without(bench, screen, names, make):
    """The candidate that keeps all but some requirements as it is really made, and misses those by least, or None."""
    requirements, found = bench.requirements, None
    for _ in range(_ROUNDS):
        best = _best_without(bench, requirements, screen, names)
        if not best or make is None or requirements.accuracy is None:
            return found or (best[0] if best else None)
        if "accuracy" in names:
            return min((make(candidate, requirements) for candidate in best), key=lambda one: one.kept.worst)
        candidate = make(best[0], requirements)
        found = candidate if candidate.kept.kept else found
        share = _SPARE * candidate.figures.accuracy / candidate.kept.worst  # that noise may take up of such a prism
        if not share > 0 or (candidate.kept.kept and share < _MORE * requirements.on_paper):
            break
        requirements = replace(requirements, on_paper=share)
    return found


def best_of_each(candidates: Sequence[Candidate], merit: Callable[[Candidate], float]) -> list[Candidate]:
    """The candidate of least merit with each number of facets and each way to turn them, the best one first."""
    best = {(one.prism.facets, one.prism.azimuth_deg): one for one in sorted(candidates, key=merit, reverse=True)}
    return sorted(best.values(), key=merit)


def _best_without(bench, requirements, screen, names):
    """Of each number of facets the candidate that keeps all but some requirements and misses those by least."""

    def merit(candidate):
        miss = total_miss(candidate, requirements, names)
        return FORBIDDEN + miss if miss > 1 else min(_excess(candidate, requirements, names), FORBIDDEN)

    rows = np.flatnonzero(may_fit(screen, requirements, names))
    if len(rows):
        factors = excesses(screen[rows], requirements)
        doubt = np.maximum(worst(factors, names), 1)  # those that the closed forms like best come first
        cost = np.max([factors[name] for name in names], axis=0) * doubt**2
        for facets in requirements.facets:
            own = np.flatnonzero(screen.facets[rows] == facets)
            for prism in prisms_of(requirements, screen[rows[own[ranked(cost[own], _TRACED)]]]):
                bench.trace(prism)
    for start in best_of_each(bench.candidates, merit)[:_STARTS]:
        improve(bench, start, merit)
    return [candidate for candidate in best_of_each(bench.candidates, merit) if merit(candidate) < FORBIDDEN]


def _relaxation(requirements, names, candidate):
    wants = {name: _wanted(requirements, name) for name in names}
    finds = {name: _reached(requirements, name, candidate) for name in names}
    words = " and ".join(
        f"{_WORDS[name]} {_stated(requirements, name, finds[name])} instead of "
        f"{_stated(requirements, name, wants[name])}"
        for name in names
    )
    words += _advice(requirements, names[0], finds)
    return Relaxation(names[0], float(wants[names[0]]), finds[names[0]], words, candidate)


def _advice(requirements, name, finds):
    """What else does the same, in words."""
    if name == "max_blend":
        stop = requirements.f_number * finds[name] / requirements.max_blend
        return f", or with the lens stopped down to f/{three_digits(stop):.3g}"
    if name == "max_chromatic":
        width = requirements.bandwidth_nm * requirements.max_chromatic / finds[name]
        return f", or with a filter {three_digits(width, np.floor):.2g} nm wide"
    return ""


def _reached(requirements: Requirements, name: str, candidate: Candidate) -> float:
    """What a candidate reaches of a requirement; of a field, its width in the proportions wanted.

    Of the accuracy, what must be asked for to have it: as it is kept after making and calibrating where that is known,
    and with the share that is left to these.
    """
    figures = candidate.figures
    if name == "accuracy":
        if candidate.kept is not None:
            return max(candidate.kept.worst, figures.accuracy) / _SPARE
        return figures.accuracy / requirements.on_paper
    if name == "field":
        return float(figures.field_two[:, 0].min())
    values = {"max_diameter": figures.diameter, "max_length": figures.length, "max_blend": figures.blend,
              "max_chromatic": figures.chromatic}  # fmt: skip
    return float(values[name] if name in values else getattr(figures, name))


def _stated(requirements, name, value):
    """A value in words, rounded to the safe side."""
    if not np.isfinite(value):
        return "none"
    if name == "accuracy":
        return f"{three_digits(100 * value):g} %"
    if name == "field":
        height = value * requirements.field[1] / requirements.field[0]
        return f"{three_digits(value, np.floor):g} x {three_digits(height, np.floor):g} mm"
    if name == "baseline":
        return f"{value:.3g} mm"
    return f"{three_digits(value):g} {'mm' if name in ('max_diameter', 'max_length') else 'px'}"


def three_digits(value: float, way: Callable[[float], float] = np.ceil) -> float:
    """A positive number to three digits, up or down."""
    unit = 10.0 ** (np.floor(np.log10(value)) - 2) if value > 0 else 1.0
    return float(f"{way(value / unit - 1e-9 * (1 if way is np.ceil else -1)) * unit:.4g}")


def _story(requirements, relaxed, relaxations, nearest):
    if nearest is None:
        return "Nothing fits: no prism gives a picture in which two views share anything at these depths."
    if not relaxed:
        missed = [name for name, factor in excesses(nearest.figures, requirements).items() if factor > 1]
        parts = [
            f"{_WORDS[name]} {_stated(requirements, name, _reached(requirements, name, nearest))} instead of "
            f"{_stated(requirements, name, _wanted(requirements, name))}"
            for name in missed
            if name != SHARED
        ]
        parts += [f"no {_WORDS[SHARED]}"] if SHARED in missed else []
        return (
            f"Nothing fits, and no requirement can give way alone. The prism that misses by least ({nearest.name}) has "
            f"{', '.join(parts)}."
        )
    names, best = relaxed[0]
    asked = " and ".join(f"{_WORDS[name]} {_stated(requirements, name, _wanted(requirements, name))}" for name in names)
    reached = " and ".join(_stated(requirements, name, _reached(requirements, name, best)) for name in names)
    if names == ("accuracy",):
        reached = f"{three_digits(100 * best.figures.accuracy):g} % at {best.figures.worst_depth:.4g} mm on paper"
        if best.kept is not None:
            reached += f" and {three_digits(100 * best.kept.worst):g} % once made and calibrated"
    others = "".join(f"; or with {relaxation.text}" for relaxation in relaxations[1:])
    return (
        f"Nothing fits: {asked} cannot be kept. The best prism that keeps all else has {reached} ({best.name}: "
        f"baseline {best.figures.baseline:.3g} mm){_barred(requirements, best, names)}. It fits with "
        f"{relaxations[0].text}{others}."
    )


def _wanted(requirements, name):
    limit = getattr(requirements, name)
    return limit[0] if name == "field" else limit


def _barred(requirements, candidate, names):
    """What holds a candidate back, in words."""
    factors = excesses(candidate.figures, requirements)
    held = [_WORDS[other] for other, factor in factors.items() if other not in (*names, SHARED) and factor > _BINDING]
    if held and "baseline" not in names:
        return f", held back by the {' and the '.join(held)}"
    prism = candidate.prism
    least, most = distance_range(requirements, np.asarray(prism.apex_deg))
    if prism.distance > 0.98 * most:
        return ", as far from the camera as the distances and the nearest depth allow"
    if prism.distance < 1.02 * least:
        return ", as near to the camera as it may stand"
    return ""


def _counted(total, failed, alone):
    """How many candidates were kept out by what, in words; empty where nothing was asked."""
    parts = [
        f"{count} miss the {_WORDS[name]} ({alone[name]} of them nothing else)"
        for name, count in sorted(failed.items(), key=lambda item: -item[1])
        if count
    ]
    return f"Of {total} prisms looked at in closed form, {', '.join(parts)}." if parts else ""
