"""Seams to a fraction of a pixel: strips of the photographs along each seam, searched for its exact line."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import cv2
import numpy as np

from .seam_search import add_evidence, reach, ridges

_HALF = 9  # px to either side of the line that are searched, at each scale
_MARGIN = 12  # px more that the measures need
_STEP = 0.5  # px between the offsets that are tried


def refine(
    photographs: Sequence[np.ndarray],
    apex: np.ndarray,
    angles: np.ndarray,
    side: int,
    weight: float,
    shrink: Callable[[np.ndarray, int], np.ndarray],
) -> tuple[np.ndarray, np.ndarray]:
    """Apex (2,) px and angles (n,) rad of a star, followed from a picture of longer side `side` to full size.

    Each half-line is shifted and turned inside a strip until the evidence along it is largest; the apex is the
    point nearest to all lines, each with the weight of its evidence. Two half-lines are one line.
    """
    full = max(photographs[0].shape[:2])
    while True:
        pictures = [shrink(photograph, side) for photograph in photographs]
        size = pictures[0].shape[1], pictures[0].shape[0]
        factor = size[0] / photographs[0].shape[1]
        small = (np.asarray(apex) + 0.5) * factor - 0.5
        for _ in range(2):
            small, angles = _refine_once(pictures, small, angles, size, weight)
        apex = (small + 0.5) / factor - 0.5
        if side >= full:
            return apex, angles
        side *= 2


def _refine_once(pictures, apex, angles, size, weight):
    if len(angles) == 2:
        start = apex + reach(apex[None], angles[1:], size)[0] * _unit(angles[1])
        ends, _ = _fit_line(pictures, start, angles[0], size, weight)
        apex = _foot(ends, (np.array(size) - 1) / 2)
        angle = _angle(ends[1] - ends[0])
        return apex, np.array([angle, angle + np.pi])
    fits = [_fit_line(pictures, apex, angle, size, weight) for angle in angles]
    apex = _meeting_point([ends for ends, _ in fits], [gain for _, gain in fits], apex)
    return apex, np.array([_angle(ends[1] - apex) for ends, _ in fits])


def _fit_line(pictures, start, angle, size, weight):
    """The two ends (2, 2) of the line along which the evidence is largest, near a half-line; and that evidence."""
    length = int(reach(start[None], np.array([angle]), size)[0, 0])
    evidence = strip_evidence(pictures, start, angle, length, weight)
    if evidence is None:
        return np.stack([start, start + max(length, 1) * _unit(angle)]), 0.0
    offsets = np.arange(-_HALF, _HALF + _STEP, _STEP)
    along = np.linspace(0, 1, evidence.shape[1])
    columns = np.arange(evidence.shape[1])
    rows = offsets[:, None, None] * (1 - along) + offsets[:, None] * along + evidence.shape[0] // 2
    low = np.floor(rows).astype(int)
    part = rows - low
    sums = (evidence[low, columns] * (1 - part) + evidence[low + 1, columns] * part).sum(axis=-1)
    first, last = np.unravel_index(int(sums.argmax()), sums.shape)
    normal = _unit(angle + np.pi / 2)
    ends = np.stack([start + offsets[first] * normal, start + length * _unit(angle) + offsets[last] * normal])
    return ends, max(float(sums.max()), 0.0)


def strip_evidence(pictures, start, angle, length, weight):
    """Evidence (rows, length) of lines along a half-line, the line itself in the middle row; None if too short."""
    if length < 2 * _MARGIN:
        return None
    breaks, steps = np.zeros((2, 2 * (_HALF + _MARGIN) + 1, length), np.float32)
    for picture in pictures:
        add_evidence(strip(picture, start, angle, length), breaks, steps)
    return ridges(cv2.GaussianBlur((breaks + weight * steps) / len(pictures), (1, 0), 0, sigmaY=0.8))


def strip(picture: np.ndarray, start: np.ndarray, angle: float, length: int, half: int = _HALF + _MARGIN) -> np.ndarray:
    """A picture (2 half + 1, length) sampled along a half-line, every px, with the half-line in its middle row."""
    along, across = np.arange(length)[:, None] * _unit(angle), np.arange(-half, half + 1)[:, None]
    places = np.asarray(start) + along + (across * _unit(angle + np.pi / 2))[:, None]
    return cv2.remap(picture, places.astype(np.float32), None, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)


def blend_width(pictures: Sequence[np.ndarray], apex: np.ndarray, angles: np.ndarray, size: tuple[int, int]) -> float:
    """Width px of the band in which both sides of the seams mix, roughly: where the squared slope across is above half.

    Averaged along all seams and photographs, less that beside the seams. NaN where it stands out nowhere.
    """
    half = max(min(size) // 12, 8)
    profile = np.zeros(2 * half + 1)
    for angle, length in zip(angles, reach(apex[None], angles, size)[:, 0], strict=True):
        for picture in pictures:
            if length > 2 * half:  # leave out the surroundings of the apex, where other seams are near
                cut = strip(picture, apex + half * _unit(angle), angle, int(length) - half, half)
                profile[1:-1] += ((cut[2:] - cut[:-2]) ** 2).sum(axis=1)
    profile -= np.median(profile[1:-1])
    middle = profile[half - 2 : half + 3].max()
    if middle <= 3 * np.median(np.abs(profile[1:-1])):
        return float("nan")
    below = profile < middle / 2
    left = int(np.argmax(below[half::-1])) if below[half::-1].any() else half
    right = int(np.argmax(below[half:])) if below[half:].any() else half
    return float(left + right - 1)


def _meeting_point(lines, gains, start):
    """The point nearest to lines, each given by two points (2, 2); where no line has evidence, the start."""
    normals = np.stack([_unit(_angle(ends[1] - ends[0]) + np.pi / 2) for ends in lines])
    offsets = np.array([normal @ ends[0] for normal, ends in zip(normals, lines, strict=True)])
    weights = np.asarray(gains)
    if (weights > 0).sum() < 2:
        return start
    weighted = normals * weights[:, None]
    point, *_ = np.linalg.lstsq(weighted, offsets * weights, rcond=1e-3)
    return point if np.linalg.norm(point - start) < 4 * _HALF else start


def _unit(angle):
    return np.array([np.cos(angle), np.sin(angle)])


def _angle(direction):
    return float(np.arctan2(direction[1], direction[0]))


def _foot(ends, point):
    """The point of a line nearest to another point."""
    along = (ends[1] - ends[0]) / np.linalg.norm(ends[1] - ends[0])
    return ends[0] + (point - ends[0]) @ along * along
