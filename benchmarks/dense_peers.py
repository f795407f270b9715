"""What a user does today with the same photographs: rectified pairs and OpenCV's StereoSGBM, its depth and its time."""

from collections.abc import Callable, Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from itertools import permutations

import cv2
import numpy as np

from benchmarks.dense_truth import Scene, judged
from benchmarks.timing import median_seconds
from cyclopean import Rig
from cyclopean.matching import PairMatcher, sgbm
from cyclopean.pipeline import find_disparity
from cyclopean.rectification import Pair, exact_depth, partners, pinhole_depth, rectify, tilted_pinhole

NEAR_TRUTH = 0.02  # the peer's depths reach this share beyond the true ones
WAYS = {"pinhole": pinhole_depth, "exact": exact_depth}
REPEATS = 3


@dataclass(frozen=True)
class Peer:
    """One way to run OpenCV's matcher."""

    title: str
    scale: int  # of the rectified pictures
    grey: bool
    matcher: PairMatcher


PEERS = {
    "grey1x": Peer("SGBM grey 1x", 1, True, sgbm()),
    "grey3way1x": Peer("SGBM 3WAY grey 1x", 1, True, sgbm(mode="3way")),
    "sgbm1x": Peer("SGBM colour 1x", 1, False, sgbm()),
    "sgbm2x": Peer("SGBM colour 2x", 2, False, sgbm()),
}


Pairs = Mapping[tuple[int, int], Pair]  # by the numbers of the reference and the other view


def rectified(rig: Rig, truth: Scene, scale: int) -> Pairs:
    """All ordered pairs of a rig for just the depths of a scene."""
    depths = (
        np.nanmin(truth.points[..., 2]) * (1 - NEAR_TRUTH),
        np.nanmax(truth.points[..., 2]) * (1 + NEAR_TRUTH),
    )
    cameras, focal = [tilted_pinhole(view, depths) for view in rig], scale * truth.setup.camera.focal[0]
    orders = permutations(range(len(rig)), 2)
    return {(i, j): rectify((rig[i], rig[j]), (cameras[i], cameras[j]), depths, focal) for i, j in orders}


def peer_seconds(
    peer: Peer, photograph: np.ndarray, pairs: Pairs, threads: int, tick: Callable[[], None] = lambda: None
) -> dict[str, float]:
    """Seconds of all ordered pairs, one after the other: matching alone, and with remapping; sums of medians.

    Last, with remapping, as many pairs at once as there are threads.
    """
    picture = grey(photograph) if peer.grey else photograph
    alone = together = 0.0
    for pair in pairs.values():
        left, right = (cv2.remap(picture, maps, None, cv2.INTER_CUBIC) for maps in pair.maps)
        alone += median_seconds(lambda: peer.matcher(left, right, pair.count), REPEATS)  # noqa: B023
        together += median_seconds(lambda: find_disparity(picture, pair, peer.matcher), REPEATS)  # noqa: B023
        tick()

    def all_of_them() -> None:
        with ThreadPoolExecutor(threads) as pool:
            list(pool.map(lambda pair: find_disparity(picture, pair, peer.matcher), pairs.values()))

    at_once = median_seconds(all_of_them, REPEATS)
    return {"match_seconds": alone, "seconds": together, "pairs_at_once_seconds": at_once}


def peer_figures(
    peer: Peer, photograph: np.ndarray, pairs: Pairs, truth: Scene, masks: np.ndarray, other: np.ndarray,
    motion: np.ndarray,
) -> dict[str, float]:  # fmt: skip
    """Figures of its depths, merged and by pairs, by pinholes and by exact rays.

    `masks` (h, w, V) are those of the views, `other` (h, w, V) says which views count as partners of a pixel,
    `motion` (h, w, V) px mm is from `motions`.
    """
    true_depth = truth.points[..., 2]
    found = {way: np.full(other.shape, np.nan) for way in WAYS}  # (h, w, V), by the other view
    for (i, j), pair in pairs.items():
        disparity = find_disparity(photograph, pair, peer.matcher)
        rows, columns = np.nonzero(masks[..., i])
        pixels = truth.step * np.stack([columns, rows], axis=-1)
        places = partners(pair, disparity, pixels)
        for way, depth in WAYS.items():
            found[way][rows, columns, j] = depth(pair, pixels, places)
    some, figures = other.any(-1), {}
    most = np.max(motion[some], axis=-1, where=other[some], initial=0.0)
    every = np.broadcast_to(true_depth[..., None], other.shape)
    for way, depth in found.items():
        merged = judged(_median(depth[some]), true_depth[some], motion=most)
        single = judged(depth[other], every[other], motion=motion[other])
        figures |= {f"{way}_{name}": value for name, value in merged.items()}
        figures |= {f"{way}_pairs_{name}": value for name, value in single.items()}
    return figures


def match_all(peer: Peer, photograph: np.ndarray, pairs: Pairs) -> None:
    """Match all ordered pairs, one after the other."""
    for pair in pairs.values():
        find_disparity(grey(photograph) if peer.grey else photograph, pair, peer.matcher)


def grey(photograph: np.ndarray) -> np.ndarray:
    """A photograph without its colours."""
    return photograph if photograph.ndim == 2 else cv2.cvtColor(photograph, cv2.COLOR_RGB2GRAY)


def _median(depths):
    """Median (N,) over the last axis of (N, V), NaN where there is none."""
    some = np.isfinite(depths).any(-1)
    return np.where(some, np.nanmedian(np.where(some[:, None], depths, 0.0), axis=-1), np.nan)
