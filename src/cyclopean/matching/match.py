"""Dense matching of one reference view against all others of the same photograph."""

from dataclasses import dataclass

import numpy as np
from scipy.ndimage import spline_filter

from cyclopean.errors import ImageError
from cyclopean.matching import aggregation, cost, refinement
from cyclopean.matching.warps import Warps, spread, warp

COST_RADIUS = 2
COST_FLOOR = 1.0
CEILING = 0.7
SMALL, LARGE, LEAST_LARGE, EDGE = 8, 120, 30, 12.0
OVERLAP = 48
WINDOW_RADIUS, WINDOW_SIGMA = 5, 2.5
REACH = 1.5
GAIN_WEIGHT = 100.0
STIFFNESS = 100.0
NOISE = 0.2
MARGIN = 0.3
ITERATIONS = 3
MAX_SIGMA, MIN_SCORE = 0.5, 0.6


@dataclass(frozen=True, eq=False)
class DepthMap:
    """Inverse depth of every pixel of a reference box."""

    origin: tuple[int, int]    # (x, y) of the top-left pixel in the photograph
    inverse_depth: np.ndarray  # (h, w) float32, 1/mm; NaN unknown
    sigma: np.ndarray          # (h, w) float32, standard deviation of inverse_depth, 1/mm
    score: np.ndarray          # (h, w) float32, 0 to 1

    def at(self, pixels):
        i = np.round(np.nan_to_num(np.asarray(pixels, float), nan=-1e6)).astype(int) - np.array(self.origin)
        h, w = self.inverse_depth.shape
        inside = (i[..., 0] >= 0) & (i[..., 1] >= 0) & (i[..., 0] < w) & (i[..., 1] < h)
        out = np.full(i.shape[:-1], np.nan, np.float32)
        out[inside] = self.inverse_depth[i[inside][:, 1], i[inside][:, 0]]
        return out


def grey_levels(image):
    image = np.asarray(image)
    top = np.iinfo(image.dtype).max if image.dtype.kind == "u" else float(np.nanmax(np.abs(image))) or 1.0
    levels = np.nan_to_num(image.astype(np.float32) * np.float32(255 / top))
    return levels if levels.ndim == 3 else levels[..., None]


def costs(levels, warps, rows):
    (x0, y0), (width, _) = warps.origin, warps.size
    top, height = rows.start, rows.stop - rows.start
    box = (slice(y0 + top, y0 + top + height), slice(x0, x0 + width))
    reference = np.ascontiguousarray(np.moveaxis(levels[box], -1, 0))
    own = warps.masks[0][box].astype(np.float32)
    masks = warps.masks.astype(np.uint8)
    planes = np.empty((len(warps.inverse_depths), height, width), np.uint8)
    for k in range(len(planes)):
        single = []
        for v in range(len(warps.nodes)):
            maps = spread(warps.nodes[v, k], warps.spacing, top, height, width)
            warped, inside = warp(levels, masks[v + 1], *maps)
            single.append(cost.dissimilarity(reference, warped, own * inside, COST_RADIUS, COST_FLOOR))
        planes[k] = cost.fuse(np.array(single), CEILING)
    return cost.hypotheses_last(planes)


def penalties(grey):
    jump = np.maximum(np.abs(np.gradient(grey, axis=0)), np.abs(np.gradient(grey, axis=1)))
    return np.maximum(LARGE / (1 + jump / EDGE), LEAST_LARGE).astype(np.uint16)


def refine(splines, reference, warps, top, guess):
    r = WINDOW_RADIUS
    h, w = guess.shape
    V, C = len(warps.nodes), len(reference)
    ref = np.pad(reference, ((0, 0), (r, r), (r, r)))
    values, slopes = np.zeros((2, V, C, h, w), np.float32)
    seen = np.zeros((V, h, w), np.float32)
    window = refinement.gaussian_window(r, WINDOW_SIGMA)
    depths = len(warps.inverse_depths)
    like = None
    for _ in range(ITERATIONS):
        for v in range(V):
            refinement.sample(splines, warps.masks[v + 1], warps.nodes[v], warps.spacing, top, guess, values[v], slopes[v], seen[v])
        if like is not None:
            best = like.max(0)
            drop = like < best - MARGIN
            seen[drop] = 0
        pad = [(0, 0), (r, r), (r, r)]
        depth = np.pad(np.where(np.isfinite(guess), guess, refinement._FAR).astype(np.float32), r, constant_values=refinement._FAR)
        change, sigma, score, like = refinement.improve(
            ref, np.pad(values, [(0, 0)] + pad), np.pad(slopes, [(0, 0)] + pad), np.pad(seen, pad), depth, window,
            1 / REACH**2, GAIN_WEIGHT, STIFFNESS, NOISE, MARGIN)
        guess = guess + np.clip(np.nan_to_num(change), -1, 1)
    bad = ~np.isfinite(change) | (np.abs(change) > 0.3) | (sigma > MAX_SIGMA) | (score < MIN_SCORE) | (guess < 0) | (guess > depths - 1)
    guess[bad] = np.nan
    return guess, sigma, score


def match(image, warps, *, memory_mib=1024, progress=None):
    levels = grey_levels(image)
    splines = np.stack([spline_filter(levels[..., c], order=3, output=np.float32) for c in range(levels.shape[-1])], -1)
    w, h = warps.size
    guess, sigma, score = _strip(levels, splines, warps, range(0, h))
    q = warps.inverse_depths[0] + guess * warps.step
    return DepthMap(warps.origin, q.astype(np.float32), (sigma * warps.step).astype(np.float32), score)


def _strip(levels, splines, warps, rows):
    volume = costs(levels, warps, rows)
    (x0, y0), (width, _) = warps.origin, warps.size
    ref = levels[y0 + rows.start : y0 + rows.stop, x0 : x0 + width]
    mask = np.ascontiguousarray(warps.reference_mask()[rows.start : rows.stop])
    total = aggregation.aggregate(volume, mask, SMALL, penalties(ref.mean(-1)))
    guess = aggregation.winner(total, mask)
    return refine(splines, np.ascontiguousarray(np.moveaxis(ref, -1, 0)), warps, rows.start, guess)
