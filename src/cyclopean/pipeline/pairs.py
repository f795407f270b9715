"""The main job by rectified pairs: any matcher of ordinary stereo in the place of our own."""

from __future__ import annotations

import traceback
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ..errors import SetupError, ShapeError
from ..geometry import white_level
from ..matching import DepthMap, checked
from ..matching.pairwise import PairMatcher, as_disparity
from ..rectification import Pair, exact_depth, inverse_depths, partners, per_disparity, rectify, tilted_pinhole
from ..rigs import Rig
from .dense import Progress, as_photograph, check_views, plan_of
from .reconstruction import Reconstruction, assemble

DISPARITY_NOISE = 0.1  # px of the photograph, that a disparity is taken to have: that of StereoSGBM in good texture
TOO_FAR_OFF = 0.5  # px that a pinhole may be off, root mean square, before rows are said not to be level
_PACKAGE = Path(__file__).parents[1]
_BLOCK = 500_000  # pixels that are carried back at once, to save memory
_STRAY = 3.0  # standard deviations that partners may differ by and still agree


def reconstruct_by_pairs(
    photograph: np.ndarray,
    rig: Rig,
    depths: tuple[float, float] | None,
    matcher: PairMatcher,
    *,
    scale: float = 2,
    noise: float = DISPARITY_NOISE,
    progress: Progress | None = None,
    keep: Callable[[int, DepthMap], None] | None = None,
    warn: Callable[[str], None] | None = None,
) -> Reconstruction:
    """Depth and points of a photograph by matching each ordered pair of views, rectified.

    A pinhole is fitted to each view, and each pair is rectified by it; the matcher sees ordinary stereo pictures.
    Its disparities are carried back to pixels of the photograph, and depth is where the true rays of both pixels
    meet, so the pinholes cost no accuracy but what rows that are not level cost the matcher. Each view merges the
    depths from all its partners, and a pixel stays when the other views' maps agree.

    Parameters
    ----------
    photograph : (H, W) or (H, W, 3) array
        The photograph, grey or RGB, of the size of the rig's camera.
    rig : Rig
        The views that the setup gives.
    depths : (2,) mm or None
        Nearest and farthest depth; the rig's working depths where None.
    matcher : PairMatcher
        A callable (left, right, disparities) -> disparity, `cyclopean.matching.pairwise.sgbm()` for example.
    scale : float
        Scale of the rectified pictures: 1 is that of the photograph; most matchers are more exact at 2.
    noise : float
        Standard deviation of a disparity that sigma is stated for, px of the photograph.
    progress : callable, optional
        Told (what, done, total) as the work goes on.
    keep : callable, optional
        Given (number of the view, depth map) as soon as each view is merged.
    warn : callable, optional
        Told where the pinholes fit so badly that rows of the rectified pictures are not level.

    Returns
    -------
    Reconstruction
        As `reconstruct` gives it. The confidence is the share of a view's partners that agree with its depth.

    Raises
    ------
    SetupError
        Where the matcher fails: what it raised, and where.
    ShapeError
        Where it returns something else than disparities.
    OpticError
        Where a pair of views cannot be rectified.
    """
    photograph = as_photograph(photograph, rig)
    check_views(rig)
    if not 0.1 <= scale <= 8:
        raise SetupError(f"the scale of rectified pictures lies between 0.1 and 8 (1 and 2 are usual), got {scale}")
    if not 0 < noise < np.inf:
        raise SetupError(f"the noise of a disparity must be positive, px, got {noise}")
    depths = rig.check_depths(rig.working_depths if depths is None else depths)
    step = np.diff(inverse_depths(rig, depths)[:2])[0]  # 1/mm: half a pixel in the most sensitive view
    picture, masks = _integers(photograph), rig.masks
    cameras = [tilted_pinhole(view, depths) for view in rig]
    if warn is not None and (worst := max(camera.departure_rms for camera in cameras)) > TOO_FAR_OFF:
        warn(
            f"between {depths[0]:g} and {depths[1]:g} mm the best pinholes are off by {worst:.1f} px, so rows of "
            "rectified pictures are not level, and matchers of pairs find less; a narrower --depth helps"
        )
    maps = []
    for k, view in enumerate(rig):
        pixels = np.argwhere(masks[k])[:, ::-1]
        found = []
        if progress is not None:
            progress(view.name, 0, len(rig) - 1)
        for j in (j for j in range(len(rig)) if j != k):
            focal = scale * float(np.mean(view.camera.focal))
            pair = rectify((view, rig[j]), (cameras[k], cameras[j]), depths, focal)
            found.append(_measured(pair, find_disparity(picture, pair, matcher), pixels, depths, noise * scale))
            if progress is not None:
                progress(view.name, len(found), len(rig) - 1)
        inverse, sigma = np.stack(found, axis=1)
        maps.append(_as_map(view, pixels, merged(inverse, sigma, step)))
        if keep is not None:
            keep(k, maps[-1])
    return assemble(photograph, rig, depths, checked(plan_of(rig, depths), maps))


def find_disparity(photograph: np.ndarray, pair: Pair, matcher: PairMatcher) -> np.ndarray:
    """Disparity (h, w) float32 px that a matcher finds in a pair of rectified pictures, NaN unknown.

    `photograph` is (H, W) or (H, W, 3), uint8 or uint16. Whatever goes wrong in the matcher is a SetupError or a
    ShapeError that names it.
    """
    import cv2

    left, right = (cv2.remap(photograph, maps, None, cv2.INTER_CUBIC) for maps in pair.maps)
    shape = left.shape[:2]
    try:
        found = matcher(left, right, pair.count)
    except MemoryError:
        raise
    except (Exception, SystemExit) as error:
        hint = "" if _frames(error) else "; it is called as matcher(left, right, disparities)"
        raise SetupError(f"the matcher {_name(matcher)} failed: {fault_of(error)}{hint}") from error
    try:
        return as_disparity(found, shape, pair.count)
    except ShapeError as error:
        raise ShapeError(f"the matcher {_name(matcher)}: {error}") from None


def fault_of(error: BaseException) -> str:
    """What went wrong in somebody else's code, and in which line of theirs."""
    text = " ".join(f"{type(error).__name__}: {error}".split()).removesuffix(":")
    if not (frames := _frames(error)):
        return text
    last = [frame for frame in frames if frame.filename == frames[0].filename][-1]
    return f"{text} ({last.filename}, line {last.lineno})"


@dataclass(frozen=True, eq=False)
class Merged:
    """What the partners of a view say together, for each of N pixels."""

    inverse: np.ndarray  # (N,) 1/mm, NaN where they know nothing or disagree
    sigma: np.ndarray  # (N,) 1/mm
    score: np.ndarray  # (N,) 0 to 1, the share of the partners that agree


def merged(inverse: np.ndarray, sigma: np.ndarray, tolerance: float) -> Merged:
    """Merge what each partner of a view found, without those that stray.

    The start is the median, weighted by precision. Partners agree with it that lie within `tolerance` and three of
    their standard deviations of it; the result is their mean, weighted by precision. It is kept where more than half
    of those that know something agree.

    Parameters
    ----------
    inverse, sigma : (K, N) arrays
        Inverse depth by each of K partners and its standard deviation, 1/mm; NaN unknown.
    tolerance : float
        Difference of inverse depth that is none, 1/mm.
    """
    known = np.isfinite(inverse) & np.isfinite(sigma)
    weights = np.where(known, 1 / np.where(known, sigma, 1.0) ** 2, 0.0)
    order = np.argsort(np.where(known, inverse, np.inf), axis=0)
    ladder = np.cumsum(np.take_along_axis(weights, order, axis=0), axis=0)
    middle = np.argmax(ladder >= ladder[-1] / 2, axis=0)
    start = np.take_along_axis(np.take_along_axis(inverse, order, axis=0), middle[None], axis=0)
    agree = known & (np.abs(np.where(known, inverse - start, np.inf)) <= tolerance + _STRAY * np.where(known, sigma, 0))
    weights = np.where(agree, weights, 0.0)
    good = 2 * agree.sum(0) > known.sum(0)
    total = np.where(good, weights.sum(0), np.nan)
    mean = (weights * np.where(agree, inverse, 0.0)).sum(0) / total
    scatter = (weights * np.where(agree, inverse - mean, 0.0) ** 2).sum(0) / total
    count = np.maximum(agree.sum(0), 1)
    # half the variance of a disparity comes from the picture of the view itself, which all its partners share
    spread = np.sqrt(count / total * (1 + 1 / count) / 2 + scatter / count)
    return Merged(mean, spread, np.where(good, agree.sum(0) / len(inverse), 0.0))


def _measured(pair, disparity, pixels, depths, noise):
    """Inverse depth (N,) of pixels by the true rays, NaN outside the depths, and its standard deviation (N,) 1/mm."""
    parts = []
    for block in np.array_split(pixels, len(pixels) // _BLOCK + 1):
        depth = exact_depth(pair, block, partners(pair, disparity, block))
        move = per_disparity(pair, block, depth)
        inverse = 1 / depth
        inside = (inverse > 1 / depths[1] - move / 2) & (inverse < 1 / depths[0] + move / 2)  # half a px beyond
        parts.append(np.where(inside, [inverse, noise * move], np.nan).astype(np.float32))
    return np.concatenate(parts, axis=-1)


def _as_map(view, pixels, values):
    """A `DepthMap` of values at the pixels (N, 2) of a view."""
    x, y, width, height = view.region.box
    column, row = (pixels - [x, y]).T
    inverse, sigma = np.full((2, height, width), np.nan, dtype=np.float32)
    score = np.zeros((height, width), dtype=np.float32)
    inverse[row, column], sigma[row, column], score[row, column] = values.inverse, values.sigma, values.score
    return DepthMap((x, y), inverse, sigma, score)


def _integers(photograph):
    """The photograph as uint8 or uint16: other numbers become uint16, white at its top."""
    if photograph.dtype in (np.uint8, np.uint16):
        return photograph
    scaled = np.nan_to_num(photograph.astype(np.float32), posinf=0, neginf=0) * (65535 / white_level(photograph))
    return np.clip(np.rint(scaled), 0, 65535).astype(np.uint16)


def _name(matcher):
    return repr(getattr(matcher, "__qualname__", type(matcher).__name__))


def _frames(error):
    """Frames of an exception in code that is neither ours nor the import system's."""
    frames = traceback.extract_tb(error.__traceback__)
    return [frame for frame in frames if not frame.filename.startswith((str(_PACKAGE), "<frozen"))]
