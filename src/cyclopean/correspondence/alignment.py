"""Matched pixels placed between pixels: the surroundings of one view laid over those of another."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike

from ..errors import SetupError
from ..geometry import as_rgb
from ..rigs import Rig
from ..triangulation import triangulate
from .frames import facing
from .matches import Matches
from .points import GATE

REFINED_SIGMA = 0.1
"""Standard deviation of a coordinate of aligned pixels, px: what the window leaves, and a good calibration."""

_MIDDLE = 0.4  # px that the middle of a window may lie elsewhere, where noise does not move it more
_NOISE = 3.0  # or times as far as the middles of half the windows do
_ROLL = np.deg2rad(10)  # views turned by more against each other are not laid over each other


def align(
    photograph: ArrayLike,
    rig: Rig,
    matches: Matches,
    *,
    sigma: float = REFINED_SIGMA,
    window: int = 11,
    farthest: float = 3.0,
) -> Matches:
    """Move the pixels of matches so that all views show the same surroundings there.

    The pixel of the first view that shows a point stays. In every other view a window is shifted until it looks like
    that of the first (Lucas and Kanade 1981), mirrored views in their mirror picture. Where depth jumps inside the
    window, its middle alone, two thirds as wide, shifts elsewhere: such matches are left out.

    Parameters
    ----------
    photograph : (H, W) or (H, W, 3) array
        The photograph that the matches come from.
    rig : Rig
        Its views.
    matches : Matches
        P matches.
    sigma : float
        Standard deviation of each coordinate afterwards, px; scales the covariance.
    window : int
        Side of the window, px, odd.
    farthest : float
        px; a match with a pixel that would move further, or that finds no minimum, is left out; so is one whose middle
        of the window moves by more than 0.4 px from where the whole window lies, and 3 times as far as that of others.

    Returns
    -------
    Matches
        Those that could be aligned. Views turned by more than 10 degrees against the first keep their pixels.
    """
    if window % 2 == 0 or window < 5:
        raise SetupError(f"window must be an odd number of px from 5, got {window}")
    if not len(matches):
        return matches
    picture = as_rgb(np.asarray(photograph)).mean(-1).round().astype(np.uint8)
    depth = float(np.median(matches.points[:, 2]))
    turns = [facing(view, depth) for view in rig]
    seen, first = matches.source >= 0, np.argmax(matches.source >= 0, 1)
    pixels, good = matches.pixels.copy(), np.ones(len(matches), bool)
    for a in range(len(rig)):
        for b in range(a + 1, len(rig)):
            rows = np.flatnonzero((first == a) & seen[:, b])
            if len(rows) and _alike(turns[a][1], turns[b][1]):
                flips = turns[a][0], turns[b][0]
                pixels[rows, b], known = _shift(picture, pixels[rows, a], pixels[rows, b], flips, window)
                moved = np.linalg.norm(pixels[rows, b] - matches.pixels[rows, b], axis=1)
                middle, _ = _shift(picture, pixels[rows, a], pixels[rows, b], flips, window * 2 // 3 | 1)
                alone = np.linalg.norm(middle - pixels[rows, b], axis=1)
                steady = alone <= max(_MIDDLE, _NOISE * np.median(alone))
                good[rows] &= known & (moved <= farthest) & steady
    solved = triangulate(rig, pixels, sigma)
    good &= np.isfinite(solved.residual) & (solved.residual <= np.maximum(GATE * sigma, matches.residual))
    return replace(
        matches.select(good),
        pixels=pixels[good],
        points=solved.points[good],
        covariance=solved.covariance[good],
        residual=solved.residual[good],
        counts=replace(matches.counts, matched=int(good.sum())),
    )


def _alike(one, other):
    return abs((one - other + np.pi) % (2 * np.pi) - np.pi) < _ROLL


def _shift(picture, here, there, flips, window):
    """Pixels (N, 2) that show what `here` shows, near `there`, and which were found; for each its picture's flip."""
    import cv2

    mirror = np.ascontiguousarray(picture[:, ::-1])
    width = picture.shape[1]

    def turned(pixels, flip):
        return np.where([flip, False], width - 1 - pixels, pixels).astype(np.float32)[:, None]

    found, status, _ = cv2.calcOpticalFlowPyrLK(
        mirror if flips[0] else picture,
        mirror if flips[1] else picture,
        turned(here, flips[0]),
        turned(there, flips[1]).copy(),
        winSize=(window, window),
        maxLevel=0,
        criteria=(cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_COUNT, 40, 1e-3),
        flags=cv2.OPTFLOW_USE_INITIAL_FLOW,
    )
    return turned(found[:, 0], flips[1])[:, 0].astype(float), status[:, 0].astype(bool)
