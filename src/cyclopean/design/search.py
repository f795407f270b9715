"""From requirements to prisms: closed forms look at all, exact rays at some hundred, and the best are bettered."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from .choice import EXTREMES, SENSIBLE, choose
from .closed_forms import Screen
from .explanation import FORBIDDEN, best_of_each, explain, ranked, total_miss
from .feasibility import check_feasible
from .grid import all_prisms, prisms_of
from .limits import excesses, may_fit, worst
from .pareto import objectives, pareto_front, spread_out
from .refinement import Workbench, improve
from .requirements import Candidate, Designs, Make, Requirements

Progress = Callable[[str, int, int], None]
_TRACED = 200  # candidates that are traced exactly
_DOUBTFUL = 0.25  # of them, such as the closed forms hold for misfits, but not for certain
_NEAREST = 24  # that miss by least, traced where none fits
_TIGHT = 0.85  # of the accuracy on paper, from which the most accurate prism has hardly enough
_STARTS = 6  # from which a fit is looked for where none was found


def find_designs(requirements: Requirements, *, make: Make | None = None, progress: Progress | None = None) -> Designs:
    """The prisms that fit requirements, those among them that no other betters in everything, and a few to choose from.

    Parameters
    ----------
    requirements : Requirements
    make : callable, optional
        Judges candidates as they are really made, as `judge_choices` takes it: where nothing fits, what is said to help
        is then what helps after making and calibrating.
    progress : callable, optional
        Called with what is being done, how much of it is done, and of how much.

    Returns
    -------
    Designs
        No candidates where nothing fits; `explanation` then says why, and what would help. What was found until then
        where Ctrl-C breaks the search off.

    Raises
    ------
    SetupError
        Requirements contradict each other, whatever the prism.
    """
    check_feasible(requirements)
    tell = progress or (lambda text, done, total: None)
    tell("prisms in closed form", 0, 1)
    screen = all_prisms(requirements)
    tell("prisms in closed form", 1, 1)
    bench, interrupted = Workbench(requirements), False
    try:
        _search(bench, screen, tell)
    except KeyboardInterrupt:
        if not _fitting(bench):
            raise
        interrupted = True
    explanation = explain(bench, screen, bool(_fitting(bench)), make, tell)
    if explanation.nearest is not None and _fitting(bench):  # met while looking for what would help
        _better(bench, tell)
        explanation = explain(bench, screen, True, make, tell)
    candidates = tuple(_fitting(bench))
    front = tuple(pareto_front(objectives(candidates)).tolist())
    return Designs(
        requirements,
        candidates,
        front,
        choose(candidates, front, requirements),
        len(screen),
        len(bench.seen),
        explanation,
        interrupted,
    )


def _search(bench, screen, tell):
    """Trace what is worth it, look harder where nothing fits, and better what does."""
    _trace(bench, screen[_worth_tracing(screen, bench.requirements)], tell)
    if not _fitting(bench):
        _trace(bench, screen[ranked(worst(excesses(screen, bench.requirements)), _NEAREST)], tell)
        _look_harder(bench, tell)
    if _fitting(bench):
        _better(bench, tell)


def _worth_tracing(screen: Screen, requirements: Requirements) -> np.ndarray:
    """Rows of a screen that are to be traced, alike for each number of facets.

    Spread over all that fit, and a few misfits that exact rays might yet accept, the nearest first.
    """
    possible = may_fit(screen, requirements)
    if requirements.baseline is not None and (possible & screen.solved).any():
        possible &= screen.solved
    miss = worst(excesses(screen, requirements))
    rows, share = [], _TRACED // len(requirements.facets)
    for facets in requirements.facets:
        own = possible & (screen.facets == facets)
        likely, doubtful = np.flatnonzero(own & (miss <= 1)), np.flatnonzero(own & (miss > 1))
        count = int(share * _DOUBTFUL)
        rows += [likely[spread_out(_costs(screen[likely]), share - count)]] if len(likely) else []
        rows += [doubtful[ranked(miss[doubtful], max(count, share - len(likely)))]]
    return np.concatenate(rows)


def _costs(screen):
    """What candidates of a screen differ in, (N, 6) logarithms."""
    columns = [screen.accuracy, 1 / np.maximum(screen.area, 1e-9), screen.length, 0.05 + screen.blend,
               0.05 + screen.chromatic, 1 / np.maximum(screen.use, 1e-3)]  # fmt: skip
    return np.log(np.stack(columns, -1))


def _trace(bench, rows, tell):
    for done, prism in enumerate(prisms_of(bench.requirements, rows)):
        tell("prisms by exact rays", done, len(rows))
        bench.trace(prism)
    tell("prisms by exact rays", len(rows), len(rows))


def fits(candidate: Candidate, requirements: Requirements) -> bool:
    """Whether a candidate keeps all requirements, by its exact figures."""
    return bool(worst(excesses(candidate.figures, requirements)) <= 1)


def _fitting(bench):
    return [candidate for candidate in bench.candidates if fits(candidate, bench.requirements)]


def _look_harder(bench, tell):
    """Search near the candidates that miss by least: those that fit may lie between the ones looked at."""
    for done in range(_STARTS):
        tell("prisms that nearly fit", done, _STARTS)
        starts = sorted(bench.candidates, key=lambda one: total_miss(one, bench.requirements))[: 3 * _STARTS : 3]
        if done >= len(starts):
            break
        found = improve(bench, starts[done], lambda one: total_miss(one, bench.requirements))
        if fits(found, bench.requirements):
            break
    tell("prisms that nearly fit", _STARTS, _STARTS)


def _better(bench, tell):
    """Better the extremes and the balance of what was found, and what there is with each number of facets."""
    candidates = _fitting(bench)
    choices = choose(candidates, pareto_front(objectives(candidates)).tolist(), bench.requirements)
    costs = objectives(candidates)
    low, spans = costs.min(0), np.ptp(costs, axis=0)
    for done, choice in enumerate(choices):
        tell("better prisms nearby", done, len(choices))
        start = candidates[choice.index]
        weights = _weights(choice.reasons[0], spans)

        def merit(candidate, weights=weights):
            miss = total_miss(candidate, bench.requirements)
            if miss > 1:
                return FORBIDDEN + miss
            above = objectives([candidate])[0] - low
            absurd = np.maximum(above[:2] - np.log(SENSIBLE), 0).sum()
            return float((above * weights).sum() + 100 * absurd)

        improve(bench, start, merit)
    _most_accurate(bench)
    tell("better prisms nearby", len(choices), len(choices))


def _most_accurate(bench):
    """Better the most accurate prism of each number of facets where what is asked for is hardly reached."""
    limit = bench.requirements.accuracy_on_paper
    if limit is None:
        return

    def merit(candidate):
        miss = total_miss(candidate, bench.requirements)
        return FORBIDDEN + miss if miss > 1 else candidate.figures.accuracy / limit

    starts = best_of_each(_fitting(bench), merit)
    if merit(starts[0]) > _TIGHT:
        for start in starts:
            improve(bench, start, merit)


def _weights(reason, spans):
    """What counts for a choice: all things evenly over their ranges, and one of them most."""
    weights = np.where(spans > 0.02, 1 / np.maximum(spans, 0.02), 0.0)
    if reason in EXTREMES:
        weights = 0.1 * weights
        weights[EXTREMES.index(reason)] *= 20
    return weights
