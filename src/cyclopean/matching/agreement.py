"""Cross-checking: a point stays if other views' depth maps have it too."""

import numpy as np
from numba import njit, prange

from .places import FAST, MARGIN, follow, row_of_polynomials

_ANY = 1e6  # hypotheses, more than there are
_ZERO, _HALF, _ONE = np.float32(0), np.float32(0.5), np.float32(1)


@njit(cache=True, fastmath=FAST, error_model="numpy")
def _compare(depth, places, frame, flat, tolerance, hidden, agree, objecting):
    """Look one row up in the map of another view."""
    left, top, width, height = frame[0], frame[1], frame[2], frame[3]
    for x in range(len(depth)):
        i = np.int32(min(max(places[0, x] - left + _HALF, _ZERO), width - _ONE))
        j = np.int32(min(max(places[1, x] - top + _HALF, _ZERO), height - _ONE))
        nearer = depth[x] - flat[np.uint32(j * np.int32(width) + i)]  # NaN on the rim and where nothing is known
        agree[x] += _ONE if nearer <= tolerance and nearer >= -hidden else _ZERO
        objecting[x] += _ONE if nearer > tolerance else _ZERO


@njit(parallel=True, cache=True, fastmath=FAST, error_model="numpy")
def _checked(depth, lines, spacing, half, others, frames, starts, maps, tolerance, hidden):
    height, width = depth.shape
    good = np.zeros((height, width), np.bool_)
    channels, count = len(lines) // len(others), lines.shape[2] // 2
    for y in prange(height):
        polynomials, places = np.empty((2 * count, width), np.float32), np.empty((2, width), np.float32)
        s, agree, objecting = np.empty(width, np.float32), np.zeros(width, np.float32), np.zeros(width, np.float32)
        for x in range(width):
            s[x] = depth[y, x] / half - _ONE if depth[y, x] == depth[y, x] else _ZERO
        for k in range(len(others)):
            view = others[k]
            row_of_polynomials(lines[k * channels], spacing, y, MARGIN, polynomials)
            for axis in range(2):
                follow(polynomials[axis * count : (axis + 1) * count], s, places[axis])
            flat = maps[starts[view] : starts[view + 1]]
            _compare(depth[y], places, frames[view], flat, tolerance, hidden, agree, objecting)
        for x in range(width):
            good[y, x] = agree[x] > 0 and agree[x] >= objecting[x]
    return good


def agreement(plan, maps, tolerances, hidden=False):
    """Say which pixels of each depth map survive a look at those of the other views.

    Each pixel is looked up in the other maps where its own depth puts it. A view agrees if it has the same inverse
    depth, it objects if it looks through the point at something farther; something nearer hides the point and says
    nothing. A pixel survives if views agree and no more object.

    Parameters
    ----------
    plan : Plan
        Maps between the views.
    maps : sequence of (h, w) float32 arrays
        Inverse depth of each view's box in hypotheses; NaN unknown.
    tolerances : sequence of float
        Largest difference between each view's map and others that agree, hypotheses.
    hidden : bool
        Whether a view that shows something nearer counts as one that agrees: what it hides may be there.

    Returns
    -------
    list of (h, w) bool arrays
        Pixels that survive.
    """
    layout = plan.layouts[0]
    flat = layout.packed([[one] for one in maps])[0] + layout.hidden
    arrays = layout.frames, layout.starts, flat
    limits = [(np.float32(one), np.float32(_ANY if hidden else one)) for one in tolerances]
    return [
        _checked(one, own.lines[1], own.spacing, own.half(1), own.others, *arrays, *limits)
        for one, own, limits in zip(maps, plan.references, limits, strict=True)
    ]
