"""A window around a pixel, and how alike the other sub-images are along its true epipolar curves."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from ..errors import ImageError
from ..geometry import Rays, launch, white_level
from ..rigs import Rig, ViewLike

BLUR = 0.8  # px, standard deviation of what pictures are smoothed with: noise has slopes, which fits would trust
_STEP = 0.5  # px, largest movement between two hypotheses
_MOST_STEPS = 6000  # hypotheses: more is a depth range without sense
_COARSE = 33  # depths at which the length of the curves is measured
_NODES = np.array([(x, y) for y in (-1.0, 0.0, 1.0) for x in (-1.0, 0.0, 1.0)])  # of a window, in half widths
_LEAST_SEEN = 0.6  # share of a window's weight that must be seen
_RISE = 0.05  # a score that rises by so much has left the peak
_LEAST_APART = 4  # hypotheses between two peaks


@dataclass(frozen=True, eq=False)
class Picture:
    """A photograph made ready for windows: a little smoothed, and smooth between its pixels."""

    spline: np.ndarray  # (H, W, C) float32, cubic B-spline coefficients, grey levels of 0 to 255
    clear: np.ndarray  # (H, W) bool, not saturated and a number
    masks: np.ndarray  # (V, H, W) bool, pixels of each view

    @cached_property
    def usable(self) -> np.ndarray:
        """(V, H, W) bool: the pixels of each view that may be compared."""
        return self.masks & self.clear


def prepare(photograph: np.ndarray, rig: Rig) -> Picture:
    """Make a photograph ready for several calls of `locate`.

    Parameters
    ----------
    photograph : (H, W) or (H, W, C) array
        Of the size of the rig's camera, integers or real numbers.
    rig : Rig
        Its views.

    Raises
    ------
    ImageError
        When the photograph does not belong to the rig.
    """
    from scipy.ndimage import spline_filter

    image = np.asarray(photograph)
    width, height = rig.size
    if image.ndim not in (2, 3) or image.shape[:2] != (height, width):
        raise ImageError(
            f"the photograph has shape {image.shape}, but the setup's camera takes {width}x{height} px: "
            f"wanted ({height}, {width}) or ({height}, {width}, 3)"
        )
    planes = image[..., None] if image.ndim == 2 else image[..., :3]
    white = white_level(image)
    known = np.isfinite(planes).all(-1)
    clear = known & (planes < white).all(-1) if np.issubdtype(image.dtype, np.integer) else known
    levels = np.where(known[..., None], planes, 0).astype(np.float32) * np.float32(255 / white)
    levels = _smoothed(levels, clear, rig.masks)
    spline = np.stack([spline_filter(levels[..., c], order=3, output=np.float32) for c in range(levels.shape[2])], -1)
    return Picture(np.ascontiguousarray(spline), clear, rig.masks)


def _smoothed(levels, clear, masks):
    """Grey levels (H, W, C) smoothed within each view, so that nothing comes over a seam or from white pixels."""
    from scipy.ndimage import gaussian_filter

    smooth = levels.copy()
    for mask in masks:
        weights = (mask & clear).astype(np.float32)
        total = gaussian_filter(weights, BLUR)
        known = mask & (total > 1e-3)
        for c in range(levels.shape[2]):
            smooth[known, c] = gaussian_filter(levels[..., c] * weights, BLUR)[known] / total[known]
    return smooth


@dataclass(frozen=True, eq=False)
class Window:
    """The pixels around one pixel of one view, traced into the scene."""

    view: int
    pixel: np.ndarray  # (2,) px
    half: float  # px, half its width
    offsets: np.ndarray  # (N, 2), of its pixels from its middle, in half widths
    shapes: np.ndarray  # (N, 9), shares of its nodes in the place of each pixel
    weights: np.ndarray  # (N,), 0 for pixels that do not count
    values: np.ndarray  # (N, C) grey levels
    rays: Rays  # (9,) of its nodes
    others: tuple[int, ...]  # numbers of the other views
    free: tuple[ViewLike, ...]  # the other views without borders
    seen: float  # share of its weight that belongs to the view and is not saturated
    clipped: float  # share of its weight that is saturated

    def places(self, inverse_depths: np.ndarray) -> np.ndarray:
        """Pixels (..., V-1, 9, 2) of its nodes in the other views, on planes z = 1 / inverse depth (...,)."""
        points = self.rays.at_depth(1 / np.asarray(inverse_depths)[..., None])
        return np.stack([view.project(points) for view in self.free], -3)

    @cached_property
    def contrast(self) -> float:
        """Standard deviation of its grey levels, all channels together."""
        weights = self.weights / max(self.weights.sum(), 1e-12)
        return float(np.sqrt((weights @ (self.values - weights @ self.values) ** 2).sum()))


def window_at(picture: Picture, rig: Rig, view: int, pixel: np.ndarray, width: int) -> Window:
    """The window of some width (px, odd) around a pixel of a view, with Gaussian weights."""
    half = width // 2
    line = np.arange(-half, half + 1.0) / half
    offsets = np.stack(np.meshgrid(line, line), -1).reshape(-1, 2)
    values, slopes = np.empty((len(offsets), picture.spline.shape[2])), np.empty((len(offsets), 0))
    slopes = np.empty((*values.shape, 2))
    from .windows_kernels import sample

    places = pixel + half * offsets
    sample(picture.spline, picture.masks[view], places, values, slopes)
    inside = np.isfinite(values[:, 0])
    nearest = np.clip(np.rint(places).astype(int), 0, np.array(picture.clear.shape[::-1]) - 1)
    clear = picture.clear[nearest[:, 1], nearest[:, 0]]
    gauss = np.exp(-2 * (offsets**2).sum(-1))  # standard deviation half of the half width
    weights = np.where(inside & clear, gauss, 0.0)
    others = tuple(k for k in range(len(rig)) if k != view)
    return Window(
        view, pixel, half, offsets, node_shapes(offsets), weights, np.nan_to_num(values),
        rig[view].unbounded().rays(pixel + half * _NODES), others, tuple(rig[k].unbounded() for k in others),
        weights.sum() / gauss.sum(), gauss[inside & ~clear].sum() / gauss.sum(),
    )  # fmt: skip


def node_shapes(offsets: np.ndarray) -> np.ndarray:
    """Shares (N, 9) of the nodes in offsets (N, 2): quadratic in x and in y."""
    x, y = offsets.T
    along, down = (np.stack([t * (t - 1) / 2, 1 - t * t, t * (t + 1) / 2], -1) for t in (x, y))
    return (down[:, :, None] * along[:, None, :]).reshape(len(offsets), 9)


class Curve(NamedTuple):
    """How alike the other views are along the epipolar curves of a window."""

    inverse_depths: np.ndarray  # (D,) 1/mm, ascending
    scores: np.ndarray  # (D, V-1) correlation; NaN where a view does not see enough of the window
    joint: np.ndarray  # (D,) of all views together; NaN where none sees it

    @property
    def step(self) -> float:
        """Inverse depth between two hypotheses, 1/mm."""
        return float(self.inverse_depths[1] - self.inverse_depths[0])


def search(picture: Picture, window: Window, depths: Sequence[float]) -> Curve:
    """Correlation of a window with all that its epipolar curves pass between two depths, half a pixel apart."""
    from .windows_kernels import correlate

    inverse = _hypotheses(window, depths)
    nodes = window.places(inverse)
    scores = np.empty(nodes.shape[:2])
    usable = picture.usable[list(window.others)]
    given = (nodes, window.shapes, window.values, window.weights, _LEAST_SEEN)
    launch(correlate, scores.size * len(window.weights), picture.spline, usable, *given, scores)
    return Curve(inverse, scores, joint_score(scores))


def joint_score(scores: np.ndarray) -> np.ndarray:
    """Scores (...,) of views (..., V) together: a view that a thing hides the point from adds nothing."""
    seen = np.isfinite(scores)
    total = np.where(seen, np.maximum(scores, 0.0), 0.0).sum(-1)
    return np.where(seen.any(-1), total / np.maximum(seen.sum(-1), 1), np.nan)


def _hypotheses(window: Window, depths: Sequence[float]) -> np.ndarray:
    """Inverse depths (D,) 1/mm, ascending, that move the window by half a pixel in the most sensitive view."""
    far, near = 1 / depths[1], 1 / depths[0]
    middle = window.places(np.linspace(far, near, _COARSE))[:, :, 4]
    moves = np.linalg.norm(np.diff(middle, axis=0), axis=-1)
    longest = np.nanmax(moves, initial=0.0) * (_COARSE - 1)
    return np.linspace(far, near, int(np.clip(np.ceil(longest / _STEP), 8, _MOST_STEPS)) + 1)


def peaks(scores: np.ndarray, most: int) -> list[int]:
    """Indices of the highest peaks of scores (D,), best first: a valley deep enough parts each from the next."""
    left = np.nan_to_num(scores, nan=-1.0)
    found: list[int] = []
    free = np.isfinite(scores)
    while free.any() and len(found) < most:
        best = int(np.argmax(np.where(free, left, -2.0)))
        start, stop = hill(left, best)
        if left[best] >= max(left[max(best - 1, 0)], left[min(best + 1, len(left) - 1)]):
            found.append(best)
        free[start : stop + 1] = False
    return found


def hill(scores: np.ndarray, top: int) -> tuple[int, int]:
    """First and last index of the hill around a peak of scores (D,): until they rise again on the far side."""
    ends = []
    for direction in (-1, 1):
        at = low = top
        while 0 <= at + direction < len(scores):
            at += direction
            if scores[at] <= scores[low]:
                low = at
            elif scores[at] > scores[low] + _RISE:
                break
        apart = top + direction * _LEAST_APART
        ends.append(int(np.clip(min(low, apart) if direction < 0 else max(low, apart), 0, len(scores) - 1)))
    return ends[0], ends[1]
