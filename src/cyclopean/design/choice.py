"""A few candidates out of many: what a person should look at, and why."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from .pareto import TOLERANCE, objectives, pareto_front
from .requirements import Candidate, Choice, Designs, Make, Requirements

MOST = 10
"""How many choices there are at most."""
EXTREMES = ("most accurate", "widest field", "smallest", "least blending", "least colour", "best use of the sensor")
"""Reasons for the best in each of the objectives, in their order."""
SENSIBLE = 4.0  # times the best: what is worse than this in accuracy or field is no choice, however small it is
_SAME = 2 * TOLERANCE  # candidates that differ by no more in anything are one choice


def choose(
    candidates: Sequence[Candidate], front: Sequence[int], requirements: Requirements, most: int = MOST
) -> tuple[Choice, ...]:
    """Choices out of the front: a balance, the best in each thing that counts, and the best of each number of facets.

    The last may be off the front: more views are worth a look even where fewer do better in all that is counted here.
    Extremes are looked for among candidates that are not more than four times worse than the best in accuracy or
    in field. The balance is the least mean of all logarithms, each over its own range. One candidate may
    stand for several reasons. Where an accuracy is wanted, those that were judged not to keep it are left out as long
    as others are left.
    """
    best = _trusted(candidates, np.asarray(front, dtype=int), requirements)
    if not len(best):
        return ()
    rows = np.concatenate([best, *_others(candidates, best, requirements)])
    costs = objectives([candidates[row] for row in rows])
    first = np.arange(len(rows)) < len(best)
    sensible = first & ((costs - costs[first].min(0))[:, :2] <= np.log(SENSIBLE)).all(-1)
    if not sensible.any():
        sensible = first
    spans = np.ptp(costs[sensible], axis=0)
    balance = ((costs - costs[sensible].min(0)) / np.where(spans > TOLERANCE, spans, np.inf)).sum(-1)
    wishes = [(balance, sensible, "balanced")]
    for column, reason in enumerate(EXTREMES):
        if spans[column] > TOLERANCE:
            wishes.append((costs[:, column] + 1e-3 * balance, sensible, reason))
    facets = np.array([candidates[row].prism.facets for row in rows])
    for count in sorted(set(facets.tolist())) if len(set(facets.tolist())) > 1 else ():
        own = facets == count
        wishes.append((balance, own & sensible if (own & sensible).any() else own, f"best with {count} facets"))
    reasons = _granted(wishes, costs)
    return tuple(Choice(int(rows[k]), tuple(why)) for k, why in list(reasons.items())[:most])


def _others(candidates, best, requirements):
    """Rows of what is best with each number of facets that has none among the best of all."""
    there = {candidates[row].prism.facets for row in best}
    for count in sorted({candidate.prism.facets for candidate in candidates} - there):
        own = np.array([row for row, candidate in enumerate(candidates) if candidate.prism.facets == count])
        yield _trusted(candidates, own[pareto_front(objectives([candidates[row] for row in own]))], requirements)


def _granted(wishes, costs):
    """Reasons of each row that is least in one of the wishes; one that is nearly equal to an earlier one joins it."""
    reasons: dict[int, list[str]] = {}
    for values, which, reason in wishes:
        best = int(np.where(which, values, np.inf).argmin())
        near = [row for row in reasons if (np.abs(costs[row] - costs[best]) <= _SAME).all() and which[row]]
        reasons.setdefault(near[0] if near else best, []).append(reason)
    return reasons


def _trusted(candidates, rows, requirements):
    """Rows of candidates that keep the accuracy as far as is known, or all where none does."""
    if requirements.accuracy is None:
        return rows
    holding = [row for row in rows if _holds(candidates[row])]
    return np.array(holding or rows, dtype=int)


def judge_choices(
    designs: Designs,
    make: Make,
    *,
    most: int = MOST,
    spare: int = 4,
    progress: Callable[[str, int, int], None] | None = None,
) -> Designs:
    """Judge the chosen candidates as they are made; where one does not keep the accuracy, another takes its place.

    Parameters
    ----------
    designs : Designs
    make : callable
        Takes a candidate and the requirements, and returns the candidate as it would be built, with what it keeps:
        ``lambda one, wanted: replace(one, kept=keep_accuracy(one, wanted))`` for instance.
    most : int
        How many are chosen at most.
    spare : int
        How many more may be judged.
    progress : callable, optional
        As in `find_designs`.

    Returns
    -------
    Designs
        All that are chosen are as `make` returned them, those that keep the accuracy first. Where none does, the most
        accurate of each number of facets, and way to turn them, are judged too; where these do not either, the first
        ones stay.
    """
    made: dict[int, Candidate] = {}

    def look(rows, of):
        for row in rows:
            if progress is not None:
                progress("prisms as really made", len(made), max(of, len(made) + 1))
            made[row] = make(designs.candidates[row], designs.requirements)

    chosen = first = choose(designs.candidates, designs.front, designs.requirements, most)
    while new := [choice.index for choice in chosen if choice.index not in made][: most + spare - len(made)]:
        look(new, len(first))
        # as they were found, with what they keep: round measures shall not change what is chosen
        known = [replace(one, kept=made[k].kept) if k in made else one for k, one in enumerate(designs.candidates)]
        chosen = choose(known, designs.front, designs.requirements, most)
    if not any(_holds(one) for one in made.values()):
        last = _most_accurate(designs.candidates)
        look([row for row in last if row not in made], len(made) + len(last))
        chosen = tuple(
            Choice(k, (f"most accurate with {made[k].prism.facets} facets",)) for k in last if _holds(made[k])
        )
    if progress is not None:
        progress("prisms as really made", len(made), len(made))
    judged = [choice for choice in chosen if choice.index in made] or list(first)
    judged = sorted(judged, key=lambda choice: not _holds(made[choice.index]))[:most]
    candidates = tuple(made.get(k, candidate) for k, candidate in enumerate(designs.candidates))
    return replace(designs, candidates=candidates, chosen=tuple(judged))


def _holds(candidate):
    """Whether a candidate, once made, keeps the accuracy as far as any is wanted."""
    return candidate.kept is None or candidate.kept.kept is not False


def _most_accurate(candidates):
    """Rows of the most accurate candidate of each number of facets and each way to turn them."""
    best = {}
    for row in sorted(range(len(candidates)), key=lambda row: -candidates[row].figures.accuracy):
        best[candidates[row].prism.facets, candidates[row].prism.azimuth_deg] = row
    return list(best.values())
