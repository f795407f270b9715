"""The borders of sub-images, found by tracing, and the rays that belong to them."""

from __future__ import annotations

import numpy as np

from ..errors import OpticError
from ..geometry import Rays
from ..rigs import View, ViewLike

_STRAIGHT = 0.005  # px, by which a simplified outline may miss the traced one
_CUT = 3.0  # px, the longest way along which a contour between pixels cuts off a corner
_REACH = 1.5  # px, to either side of a traced outline, in which the true border is looked for


def border_rays(view: ViewLike, samples: int = 400) -> list[Rays]:
    """Rays (N,) along each closed border of a view's sub-image, about `samples` in all, corners kept.

    The border is that of the traced pixels, without any margin beside seams.
    """
    outlines = [_sharpened(_simplified(_refined(line, view))) for line in view.region.outline]
    outlines = [line for line in outlines if len(line) >= 3]
    if not outlines:
        raise OpticError(f"{view.name or 'a view'} has no pixels, so it has no field of view")
    length = sum(np.linalg.norm(np.roll(line, -1, axis=0) - line, axis=-1).sum() for line in outlines)
    loops = [_resampled(line, length / samples) for line in outlines]
    rays = [view.unbounded().rays(loop) for loop in loops]
    kept = [ray[np.isfinite(ray.directions).all(-1)] for ray in rays]
    if not any(len(ray.directions) >= 3 for ray in kept):
        raise OpticError(f"{view.name}: no ray of its border passes the optic")
    return [ray for ray in kept if len(ray.directions) >= 3]


def _refined(line, view):
    """A traced outline (N, 2) moved onto the true border between what has a ray and what has none, px."""
    line = np.asarray(line, dtype=float)
    if not isinstance(view, View):
        return line  # its border is that of whole pixels
    along = np.roll(line, -3, axis=0) - np.roll(line, 3, axis=0)
    across = np.stack([-along[:, 1], along[:, 0]], -1) / np.maximum(np.linalg.norm(along, axis=-1), 1e-12)[:, None]

    def seen(pixels):
        return view.camera.contains(pixels) & np.isfinite(view.rays(pixels).directions).all(-1)

    one, other = line + _REACH * across, line - _REACH * across
    first = seen(one)
    good = first != seen(other)
    inside, outside = np.where(first[:, None], one, other), np.where(first[:, None], other, one)
    for _ in range(24):  # to 2e-7 px
        middle = (inside + outside) / 2
        here = seen(middle)[:, None]
        inside, outside = np.where(here, middle, inside), np.where(here, outside, middle)
    return np.where(good[:, None], inside, line)


def _simplified(line):
    """Corners (N, 2) of an outline, without points that lie on straight pieces."""
    import cv2

    closed = np.asarray(line, dtype=float)
    if len(closed) and np.allclose(closed[0], closed[-1]):
        closed = closed[:-1]
    shift = closed.mean(0)
    few = cv2.approxPolyDP((closed - shift).astype(np.float32)[:, None], _STRAIGHT, True)
    return few[:, 0].astype(float) + shift


def _sharpened(corners):
    """An outline with the corners back that a contour between pixels cuts off: short pieces between long ones."""
    ahead = np.roll(corners, -1, axis=0) - corners
    length = np.linalg.norm(ahead, axis=-1)
    long = np.flatnonzero(length >= 4 * _CUT)  # pieces whose direction is known well
    if len(long) < 3:
        return corners
    sharp = []
    for first, second in zip(long, np.roll(long, -1), strict=True):
        between = (first + 1 + np.arange((second - first) % len(corners))) % len(corners)
        sides = np.stack([ahead[first] / length[first], -ahead[second] / length[second]], -1)
        if length[between[:-1]].sum() < _CUT and len(between) > 1 and abs(np.linalg.det(sides)) > 0.05:
            corner = corners[first] + np.linalg.solve(sides, corners[second] - corners[first])[0] * sides[:, 0]
            if np.linalg.norm(corner - corners[second]) < 2 * _CUT:
                sharp.append(corner[None])
                continue
        sharp.append(corners[between])
    return np.concatenate(sharp)


def _resampled(corners, step):
    """A closed polygon (N, 2) with points at most a step apart, its corners kept."""
    pieces = []
    for here, there in zip(corners, np.roll(corners, -1, axis=0), strict=True):
        count = max(int(np.ceil(np.linalg.norm(there - here) / step)), 1)
        pieces.append(here + np.arange(count)[:, None] / count * (there - here))
    return np.concatenate(pieces)
