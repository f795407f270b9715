"""Dense matching of one reference view against all others of the same photograph."""

from dataclasses import dataclass

import numpy as np
from scipy.ndimage import spline_filter

from cyclopean.errors import ImageError
from cyclopean.matching import aggregation, cost, refinement
from cyclopean.matching.warps import Warps

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
    own = np.ascontiguousarray(warps.reference_mask()[top : rows.stop])
    wide = cost.padded(width)
    views, channels = len(warps.nodes), levels.shape[-1]
    reference = np.zeros((channels, height, wide), np.float32)
    reference[..., cost.REACH : cost.REACH + width] = np.moveaxis(levels[y0 + top : y0 + rows.stop, x0 : x0 + width], -1, 0)
    warped, seen = np.empty((channels, height, wide), np.float32), np.empty((height, wide), np.float32)
    single = np.empty((views, height, width), np.float32)
    planes = np.empty((len(warps.inverse_depths), height, width), np.uint8)
    for k in range(len(planes)):
        for v in range(views):
            cost.look(levels, warps.masks[v + 1], warps.nodes[v, k], warps.spacing, top, own, warped, seen)
            single[v] = cost.dissimilarity(reference, warped, seen, COST_RADIUS, COST_FLOOR, width)
        planes[k] = cost.fuse(single, CEILING)
    return cost.hypotheses_last(planes)


def penalties(grey):
    jump = np.maximum(np.abs(np.gradient(grey, axis=0)), np.abs(np.gradient(grey, axis=1)))
    return np.maximum(LARGE / (1 + jump / EDGE), LEAST_LARGE).astype(np.uint16)


def refine(splines, reference, warps, top, guess):
    r = WINDOW_RADIUS
    h, w = guess.shape
    V, C = len(warps.nodes), len(reference)
    more = -w % refinement.N
    pad = [(0, 0), (r, r), (r, r + more)]
    ref = np.pad(reference, pad)
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
        depth = np.pad(np.where(np.isfinite(guess), guess, refinement._FAR).astype(np.float32), pad[1:], constant_values=refinement._FAR)
        change, sigma, score, like = refinement.improve(
            ref, np.pad(values, [(0, 0)] + pad), np.pad(slopes, [(0, 0)] + pad), np.pad(seen, pad), depth, window,
            1 / REACH**2, GAIN_WEIGHT, STIFFNESS, NOISE, MARGIN)
        change, sigma, score, like = change[:, :w], sigma[:, :w], score[:, :w], like[..., :w]
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
