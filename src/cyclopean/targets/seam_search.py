"""Where stars of straight seams run through photographs: evidence, search over all apexes, refinement.

A seam is where two sub-images meet. Along a seam the picture breaks off: what crosses the line on one side does not
go on at the other. The straight edges of objects do not have that mark, so two measures are taken along lines:

- *break*: the slope along the line differs in size between the two sides. The grid lines of a calibration board
  have none, because squares and markers begin and end on both sides at the same place;
- *step*: the slope across the line is larger than it is a few pixels to either side. It also answers to the edges of
  objects, but is the stronger one in fine texture.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np
from numba import njit

STEP_WEIGHTS = (0.0, 0.3)  # share of the step measure beside the break measure; both mixtures are searched
DIRECTIONS = 180  # searched over half a turn
_FLOOR = 0.04  # slopes below this share of the picture's range, per px, are noise
_TOLERANCE = 0.15  # of a sector: how far seams may stand from equal angles
_REACH = (0.12, 0.88)  # the apex is sought in this part of the picture's width and height
_NEAR, _FAR = 3, 15  # px: a ridge's width, and that of its surroundings
_RIVAL_DISTANCE = 12.0  # px beyond which a parallel line counts as another line
_DISAGREEMENT = 0.6  # what is left of the confidence where the two mixtures find different stars
_RIVAL_ANGLE = 8  # directions (degrees) beyond which a half-line counts as another one


@dataclass(frozen=True, eq=False)
class Star:
    """Half-lines through one apex, in px of the pictures that were searched."""

    apex: np.ndarray  # (2,) px
    angles: np.ndarray  # (n,) rad
    evidence: np.ndarray  # (n,) mean evidence along each half-line
    confidence: float  # 0 (another star is as good) to 1 (nothing else comes near)
    step_weight: float  # of STEP_WEIGHTS, the one that told the star best from others


def shrink(photograph: np.ndarray, side: int) -> np.ndarray:
    """A grey picture (h, w) float32 whose longer side is at most `side` px, scaled so that most values are 0 to 1."""
    grey = photograph.mean(axis=-1, dtype=np.float32) if photograph.ndim == 3 else photograph.astype(np.float32)
    grey = np.nan_to_num(grey, posinf=0, neginf=0)
    factor = side / max(grey.shape)
    if factor < 1:
        size = round(grey.shape[1] * factor), round(grey.shape[0] * factor)
        grey = cv2.resize(grey, size, interpolation=cv2.INTER_AREA)
    low, high = np.percentile(grey, [2, 98])
    return (grey - np.float32(low)) / np.float32(max(high - low, 1e-9))


@njit(cache=True, nogil=True, error_model="numpy")
def add_evidence(picture, breaks, steps):
    """Add the break and step measures of lines along x to (h, w) maps."""
    height, width = picture.shape
    slope = np.zeros((height, width), np.float32)
    for y in range(height):
        for x in range(1, width - 1):
            slope[y, x] = 0.5 * abs(picture[y, x + 1] - picture[y, x - 1])
    for y in range(4, height - 4):
        for x in range(1, width - 1):
            above = 0.5 * (slope[y - 2, x] + slope[y - 1, x])
            below = 0.5 * (slope[y + 2, x] + slope[y + 1, x])
            breaks[y, x] += abs(above - below) / (above + below + _FLOOR)
            here = 0.5 * abs(picture[y + 1, x] - picture[y - 1, x])
            beside = 0.25 * (abs(picture[y + 4, x] - picture[y + 2, x]) + abs(picture[y - 2, x] - picture[y - 4, x]))
            steps[y, x] += (here - beside) / (here + beside + 0.5 * _FLOOR)


def ridges(evidence: np.ndarray) -> np.ndarray:
    """What stands out along lines in x against the lines beside them."""
    return cv2.blur(evidence, (1, _NEAR)) - cv2.blur(evidence, (1, _FAR))


def line_sums(pictures: Sequence[np.ndarray], apexes: np.ndarray, progress=None) -> np.ndarray:
    """Sum of the evidence along half-lines from apexes (A, 2) to the border of the pictures.

    Returns (mixtures, 2 DIRECTIONS, A) float32: for each of STEP_WEIGHTS, each direction j pi / DIRECTIONS, each apex.
    Every direction turns the pictures once; a running sum then serves all apexes.
    """
    height, width = pictures[0].shape
    side = int(np.ceil(np.hypot(height, width))) + 8
    sums = np.empty((len(STEP_WEIGHTS), 2 * DIRECTIONS, len(apexes)), np.float32)
    stacks = [np.dstack(pictures[k : k + 4]) for k in range(0, len(pictures), 4)]  # four turn as fast as one
    for j in range(DIRECTIONS):
        if progress is not None and j % 10 == 0:
            progress("searching seams", j, DIRECTIONS)
        turn = _turn(np.pi * j / DIRECTIONS, (width, height), side)
        breaks, steps = np.zeros((2, side, side), np.float32)
        for stack in stacks:
            turned = cv2.warpAffine(stack, turn, (side, side), borderMode=cv2.BORDER_REPLICATE)
            for picture in cv2.split(turned):
                add_evidence(picture, breaks, steps)
        inner = np.ones((height - 4, width - 4), np.float32)
        shifted = turn @ np.array([[1.0, 0, 2], [0, 1, 2], [0, 0, 1]])
        inside = cv2.warpAffine(inner, shifted, (side, side)) > 0.99
        places = (apexes @ turn[:, :2].T + turn[:, 2]).astype(np.float32)
        for mixture, weight in enumerate(STEP_WEIGHTS):
            running = np.cumsum(ridges((breaks + weight * steps) / len(pictures)) * inside, axis=1)
            behind = _sampled(running, places)
            whole = _sampled(running, np.stack([np.full(len(places), side - 1.0), places[:, 1]], -1))
            sums[mixture, j], sums[mixture, j + DIRECTIONS] = whole - behind, behind
    if progress is not None:
        progress("searching seams", DIRECTIONS, DIRECTIONS)
    return sums


def _turn(angle, size, side):
    """Affine map (2, 3) that turns a picture about its centre so that lines of direction `angle` run along x."""
    cos, sin = np.cos(angle), np.sin(angle)
    rotation = np.array([[cos, sin], [-sin, cos]])
    centre = (np.array(size) - 1) / 2
    return np.column_stack([rotation, (side - 1) / 2 - rotation @ centre])


def _sampled(image, places):
    places = np.ascontiguousarray(places, dtype=np.float32)
    return cv2.remap(np.ascontiguousarray(image), places[:, None, :], None, cv2.INTER_LINEAR)[:, 0]


def reach(apexes: np.ndarray, angles: np.ndarray, size: tuple[int, int]) -> np.ndarray:
    """Length (..., A) px of half-lines from apexes (A, 2) inside a picture of size (width, height)."""
    width, height = size
    cos, sin = np.cos(angles)[..., None], np.sin(angles)[..., None]
    with np.errstate(divide="ignore", invalid="ignore"):
        across = np.where(cos > 0, (width - 0.5 - apexes[:, 0]) / cos, (-0.5 - apexes[:, 0]) / cos)
        down = np.where(sin > 0, (height - 0.5 - apexes[:, 1]) / sin, (-0.5 - apexes[:, 1]) / sin)
    across = np.where(np.abs(cos) < 1e-9, np.inf, across)
    down = np.where(np.abs(sin) < 1e-9, np.inf, down)
    return np.maximum(np.minimum(across, down), 0.0)


def search(pictures: Sequence[np.ndarray], counts: Sequence[int], progress=None) -> dict[int, Star]:
    """The best star of each number of half-lines, over both mixtures of evidence.

    Parameters
    ----------
    pictures : sequence of (h, w) arrays
        Small grey pictures of one size, from `shrink`.
    counts : sequence of int
        Numbers of half-lines to look for.
    progress : callable, optional
        Called with (what, done, total).
    """
    height, width = pictures[0].shape
    x, y = (np.arange(_REACH[0] * size, _REACH[1] * size, 2.0) for size in (width, height))
    apexes = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
    angles = np.pi * np.arange(2 * DIRECTIONS) / DIRECTIONS
    lengths = reach(apexes, angles, (width, height)).astype(np.float32)
    sums = line_sums(pictures, apexes, progress)
    best = {}
    for n in counts:
        stars = [_best_star(part, lengths, apexes, n, weight) for part, weight in zip(sums, STEP_WEIGHTS, strict=True)]
        first, second = sorted(stars, key=lambda star: -star.confidence)
        same = _agree(first, second)
        best[n] = first if same else replace(first, confidence=_DISAGREEMENT * first.confidence)
    return best


def _agree(star, other):
    """Whether two stars are the same lines."""
    gap = np.abs(np.angle(np.exp(1j * (star.angles[:, None] - other.angles)))).min(axis=1)
    normals = np.stack([-np.sin(star.angles), np.cos(star.angles)], axis=-1)
    return bool((gap < np.deg2rad(4)).all() and (np.abs(normals @ (other.apex - star.apex)) < 6).all())


def _best_star(sums, lengths, apexes, n, step_weight):
    score, members = _score_stars(sums, n)
    place = int(score.argmax())
    mine = members(place)
    evidence = sums[mine, place] / np.maximum(lengths[mine, place], 1)
    apex, angles = apexes[place], np.pi * mine / DIRECTIONS
    rival, _ = _score_stars(np.where(_same_lines(apexes, apex, mine), 0, sums), n)
    confidence = 1 - float(rival.max()) / max(float(score[place]), 1e-9)
    if n > 2:
        confidence = min(confidence, _weakest(sums[:, place] / np.maximum(lengths[:, place], 1), mine, n))
    return Star(apex, angles, evidence, float(np.clip(confidence, 0, 1)), step_weight)


def _window(n):
    return int(_TOLERANCE * 2 * DIRECTIONS / n) if n > 2 else 0


def _score_stars(sums, n):
    """Score (A,) of the best star at each apex, and a function that gives the directions (n,) of the one at a place."""
    total, window = len(sums), _window(n)
    widest = sums
    if window:
        padded = np.concatenate([sums[-window:], sums, sums[:window]])
        widest = cv2.dilate(padded, np.ones((2 * window + 1, 1), np.uint8))[window : window + total]
    starts = np.round(np.arange(n) * total / n).astype(int)
    phases = np.arange(total // n + 1)
    scores = sum(widest[(phases + start) % total] for start in starts)
    best = scores.argmax(axis=0)

    def members(place):
        near = (best[place] + starts[:, None] + np.arange(-window, window + 1)) % total
        return near[np.arange(n), sums[near, place].argmax(axis=1)]

    return scores.max(axis=0), members


def _same_lines(apexes, apex, members):
    """(directions, A) bool: half-lines that run along one of a star's, there or back."""
    same = np.zeros((2 * DIRECTIONS, len(apexes)), bool)
    near = np.arange(-_RIVAL_ANGLE, _RIVAL_ANGLE + 1)
    for member in members:
        cos, sin = np.cos(np.pi * member / DIRECTIONS), np.sin(np.pi * member / DIRECTIONS)
        close = np.abs((apexes - apex) @ [-sin, cos]) < _RIVAL_DISTANCE
        beyond = (apexes - apex) @ [cos, sin] > _RIVAL_DISTANCE  # from there, the way back runs along it too
        same[(member + near) % (2 * DIRECTIONS)] |= close
        same[(member + near + DIRECTIONS) % (2 * DIRECTIONS)] |= close & beyond
    return same


def _weakest(profile, members, n):
    """How far the weakest half-line of a star stands above others near it through the same apex: 0 to 1."""
    total, window = len(profile), max(_window(n), 2 * _RIVAL_ANGLE)
    taken = (members[:, None] + np.arange(-_RIVAL_ANGLE, _RIVAL_ANGLE + 1)).ravel() % total
    free = profile.copy()
    free[taken] = -np.inf
    rivals = [free[(member + np.arange(-window, window + 1)) % total].max() for member in members]
    rivals = np.where(np.isfinite(rivals), rivals, 0.0)
    return float((1 - rivals / np.maximum(profile[members], 1e-9)).min())
