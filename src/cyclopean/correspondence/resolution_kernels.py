"""Compiled choice among hypotheses that claim the same points.

Hypotheses come with the best first: `rows` (M, V) holds the point of each view in the list of all points, -1 for none.
`begins` (T + 1,) and `members` list the hypotheses of each point, the best first.
"""

import math

import numpy as np
from numba import njit

from .kernels import OPTIONS


@njit(**OPTIONS)
def shared(rows, a, b):
    """How many points two hypotheses have in common."""
    count = 0
    for view in range(rows.shape[1]):
        if rows[a, view] >= 0 and rows[a, view] == rows[b, view]:
            count += 1
    return count


@njit(**OPTIONS)
def rival(rows, evidence, begins, members, alive, h):
    """Evidence of the best living hypothesis that claims one point of `h` for another place; -inf for none."""
    best = -np.inf
    for view in range(rows.shape[1]):
        p = rows[h, view]
        if p < 0:
            continue
        for k in range(begins[p], begins[p + 1]):
            g = members[k]
            if evidence[g] <= best:
                break
            if g != h and alive[g] and shared(rows, g, h) == 1:
                best = evidence[g]
                break
    return best


@njit(**OPTIONS)
def resolve(rows, evidence, begins, members, firm, chance, alive, ambiguity):
    """Accept hypotheses that are better than all others at each of their points, and by far than their rivals.

    Hypotheses come with the best first. An accepted one takes its points away from the others, which may leave
    another one without rivals; `alive` becomes False for the others. Accepted ones have an ambiguity that is no NaN.
    `chance` is the evidence of mere coincidence, a rival of all.
    """
    total, taken = 0, 1
    while taken:
        taken = 0
        for h in range(len(rows)):
            if not alive[h] or not math.isnan(ambiguity[h]) or not is_best(rows, begins, members, alive, h):
                continue
            other = max(rival(rows, evidence, begins, members, alive, h), chance)
            ratio = math.exp(min(other - evidence[h], 0.0))
            if ratio > firm:
                continue
            ambiguity[h] = ratio
            for view in range(rows.shape[1]):
                p = rows[h, view]
                if p < 0:
                    continue
                for k in range(begins[p], begins[p + 1]):
                    if members[k] != h:
                        alive[members[k]] = False
            taken += 1
        total += taken
    return total


@njit(**OPTIONS)
def is_best(rows, begins, members, alive, h):
    """Whether no living hypothesis with more evidence claims a point of `h`."""
    for view in range(rows.shape[1]):
        p = rows[h, view]
        if p < 0:
            continue
        for k in range(begins[p], begins[p + 1]):
            if members[k] == h:
                break
            if alive[members[k]]:
                return False
    return True


@njit(**OPTIONS)
def take_rest(rows, evidence, begins, members, chance, alive, ambiguity):
    """Accept what is left, the best first, so that no point is used twice; rivals are all that were left."""
    used = np.zeros(len(begins) - 1, np.bool_)
    for h in range(len(rows)):
        if not alive[h]:
            continue
        clash = False
        for view in range(rows.shape[1]):
            clash |= rows[h, view] >= 0 and used[rows[h, view]]
        if clash:
            continue
        other = max(rival(rows, evidence, begins, members, alive, h), chance)
        ambiguity[h] = math.exp(min(other - evidence[h], 0.0))
        for view in range(rows.shape[1]):
            if rows[h, view] >= 0:
                used[rows[h, view]] = True
