"""Dense depth of photographs with known truth, beside OpenCV's, in one run.

    python -m benchmarks.dense [SCENE ...] [--full]

Photographs and true depths are those of `mitsuba/scenes`, rendered by other people's code; ours and the peer
both get the true setup. Ours searches 600 to 1600 mm. The peer is what `cyclopean reconstruct --matcher sgbm` does
with each pair (pinholes, rectification, StereoSGBM in colour). It is favoured: its pinholes are fitted between, and
its disparities cover, just the scene's true depths, and its seconds are those of remapping and matching alone. It
matches at the photograph's scale and, with --full, at twice that. Without --full, or for some scenes only, nothing
is stored in results/dense.json.

In the scene named chroma the glass disperses: colours of one point lie some px apart, and apart otherwise in each
view. Its setup and its truth are those of green light; it is measured as it is, and by its green channel alone.

What counts: the pixels that the truth is sampled at, that lie in the mask of a view, and whose true point another
view sees. It does when the point projects into that view's mask, and one of the 3 x 3 true samples around there
lies within 1 % of the depth of it; otherwise something hides it. All views are pooled, each as reference.

- complete: the share of those pixels that have a depth; everything below is over these
- bad-N: the share whose depth is off by more than N % of the true depth
- bad/none: the share of all that have a depth off by more than 1 %, or none
- median, rms: of the error in % of the true depth; the rms is of the best 98 %
- error/sigma: the 68th percentile of the error over its stated standard deviation; 1 is ideal

The peer gives one depth for each other view: "merged" is their median, as a user would take it; "pairs" are all
ordered pairs of views pooled. "exact" is depth by exact rays from the same matches.
"""

import argparse
import json
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import permutations

import cv2
import numpy as np
from rich.progress import Progress

from benchmarks.data import data_folder, renderer_setup
from benchmarks.results import table, write
from cyclopean import Camera, Rig, Setup, reconstruct
from cyclopean.matching.pairwise import sgbm
from cyclopean.pipeline import find_disparity
from cyclopean.rectification import exact_depth, partners, pinhole_depth, rectify, tilted_pinhole

DEPTHS = (600.0, 1600.0)  # mm, that ours searches
NEAR_TRUTH = 0.02  # the peer's depths reach this share beyond the true ones
SAME_POINT = 0.01  # of the depth: two true samples so near to each other are one point
ONE_SIGMA_PERCENT = 68.27
WAYS = {"pinhole": pinhole_depth, "exact": exact_depth}


@dataclass(frozen=True, eq=False)
class Scene:
    """A photograph with its truth, sampled every `step` px."""

    setup: Setup
    photograph: np.ndarray  # (H, W, 3) uint8, RGB; (H, W) green
    step: int
    points: np.ndarray  # (h, w, 3) mm, the true point of each sampled pixel


def scene_names() -> list[str]:
    """All scenes; NAME_green is the green channel of a scene with dispersion."""
    folder = data_folder("mitsuba") / "scenes"
    names = sorted(path.stem for path in folder.glob("*.png"))
    return sorted([*names, *(f"{name}_green" for name in names if "chroma" in name)])


def scene(name: str) -> Scene:
    """Read `mitsuba/scenes/NAME`."""
    stem = data_folder("mitsuba") / "scenes" / name.removesuffix("_green")
    truth = np.load(stem.with_suffix(".npz"))
    rig = json.loads(stem.with_suffix(".json").read_text())["rig"]
    photograph = cv2.cvtColor(cv2.imread(str(stem.with_suffix(".png"))), cv2.COLOR_BGR2RGB)
    if name.endswith("_green"):
        photograph = photograph[..., 1].copy()
    return Scene(renderer_setup(rig), photograph, int(truth["step"]), truth["xyz"].astype(float))


def seen_by(rig: Rig, truth: Scene) -> np.ndarray:
    """(h, w, V) bool: which views see the true point of each sampled pixel, themselves included."""
    height, width = truth.points.shape[:2]
    seen = []
    for view in rig:
        pixels = view.project(truth.points)
        inside = view.region.contains(pixels)
        x, y = np.moveaxis(np.rint(np.where(inside[..., None], pixels, 0) / truth.step).astype(int), -1, 0)
        around = [(np.clip(y + j, 0, height - 1), np.clip(x + i, 0, width - 1)) for j in (-1, 0, 1) for i in (-1, 0, 1)]
        apart = np.min([np.linalg.norm(truth.points[place] - truth.points, axis=-1) for place in around], axis=0)
        seen.append(inside & (apart < SAME_POINT * truth.points[..., 2]))
    return np.stack(seen, axis=-1)


def judged(depth: np.ndarray, truth: np.ndarray, sigma: np.ndarray | None = None) -> dict[str, float]:
    """Figures of depths (N,) beside the true ones, both in mm, NaN where there is none."""
    known = np.isfinite(depth)
    error = np.abs(depth - truth)[known]
    percent = np.sort(100 * error / truth[known])
    best = percent[: int(0.98 * len(percent))]
    figures = {
        "complete_percent": 100 * known.mean(),
        "bad1_percent": 100 * np.mean(percent > 1),
        "bad2_percent": 100 * np.mean(percent > 2),
        "bad5_percent": 100 * np.mean(percent > 5),
        "bad1_or_none_percent": 100 * (1 - np.count_nonzero(percent <= 1) / len(known)),
        "median_percent": np.median(percent),
        "rms98_percent": np.sqrt(np.mean(best**2)),
    }
    if sigma is not None:
        figures["error_over_sigma_times"] = np.percentile(error / sigma[known], ONE_SIGMA_PERCENT)
    return {name: float(value) for name, value in figures.items()}


def ours(truth: Scene, rig: Rig, counted: np.ndarray) -> dict[str, float]:
    """Figures of the whole job, from the photograph to points with covariance."""
    start = time.perf_counter()
    found = reconstruct(truth.photograph, rig, DEPTHS)
    seconds = time.perf_counter() - start
    every = (slice(None, None, truth.step),) * 2
    figures = judged(found.depth[every][counted], truth.points[counted][:, 2], found.sigma[every][counted])
    return {**figures, "seconds": seconds}


def peers(truth: Scene, rig: Rig, seen: np.ndarray, scale: int, tick: Callable[[], None]) -> dict[str, float]:
    """Figures of the peer at a scale, merged and by pairs, by pinholes and by exact rays."""
    masks = np.stack([view.region.mask[:: truth.step, :: truth.step] for view in rig], axis=-1)
    true_depth = truth.points[..., 2]
    depths = np.nanmin(true_depth) * (1 - NEAR_TRUTH), np.nanmax(true_depth) * (1 + NEAR_TRUTH)
    cameras = [tilted_pinhole(view, depths) for view in rig]
    found = {way: np.full(seen.shape, np.nan) for way in WAYS}  # (h, w, V), by the other view
    seconds = 0.0
    for i, j in permutations(range(len(rig)), 2):
        pair = rectify((rig[i], rig[j]), (cameras[i], cameras[j]), depths, scale * truth.setup.camera.focal[0])
        start = time.perf_counter()
        disparity = find_disparity(truth.photograph, pair, sgbm())
        seconds += time.perf_counter() - start
        rows, columns = np.nonzero(masks[..., i])
        pixels = truth.step * np.stack([columns, rows], axis=-1)
        others = partners(pair, disparity, pixels)
        for way, depth in WAYS.items():
            found[way][rows, columns, j] = depth(pair, pixels, others)
        tick()
    other = seen & masks.any(-1)[..., None] & ~masks
    some = other.any(-1)
    figures = {"seconds": seconds}
    for way, depth in found.items():
        merged = judged(_median(depth[some]), true_depth[some])
        pairs = judged(depth[other], np.broadcast_to(true_depth[..., None], depth.shape)[other])
        figures |= {f"{way}_{name}": value for name, value in merged.items()}
        figures |= {f"{way}_pairs_{name}": value for name, value in pairs.items()}
    return {f"sgbm{scale}x_{name}": value for name, value in figures.items()}


def measured(name: str, scales: Sequence[int], tick: Callable[[str, int], None]) -> dict[str, float]:
    """All figures of one scene."""
    truth = scene(name)
    rig = truth.setup.rig()
    seen = seen_by(rig, truth)
    masks = rig.masks[:, :: truth.step, :: truth.step]
    counted = masks.any(0) & (seen & ~np.moveaxis(masks, 0, -1)).any(-1)
    tick(name, 0)
    figures = ours(truth, rig, counted)
    tick(name, 1)
    for scale in scales:
        figures |= peers(truth, rig, seen, scale, partial(tick, f"{name}, OpenCV {scale}x", 1))
        figures[f"sgbm{scale}x_exact_median_over_ours_times"] = (
            figures[f"sgbm{scale}x_exact_median_percent"] / figures["median_percent"]
        )
    return figures


def warm_up(name: str) -> None:
    """Compile everything, on a small copy of a scene."""
    truth = scene(name)
    camera = truth.setup.camera
    small = Camera(tuple(n // 4 for n in camera.size), camera.focal[0] / 4)
    reconstruct(cv2.resize(truth.photograph, small.size), Setup(small, truth.setup.optic).rig(), DEPTHS)


def report(figures: dict[str, dict[str, float]], scales: Sequence[int]) -> None:
    """Print ours, ours beside the peer, and the peer by pairs."""
    columns = ["complete %", "bad-1 %", "bad-2 %", "bad-5 %", "median %", "rms %", "error/sigma", "s"]
    keys = [f"{key}_percent" for key in ("complete", "bad1", "bad2", "bad5", "median", "rms98")]
    _table("cyclopean", columns, [*keys, "error_over_sigma_times", "seconds"], figures)
    for scale in scales:
        columns = ["bad-1", "bad/none", "median", "s"]
        keys = ["bad1_percent", "bad1_or_none_percent", "median_percent", "seconds"]
        peer = [f"sgbm{scale}x_{'' if key == 'seconds' else 'exact_'}{key}" for key in keys]
        columns = [*columns, "| bad-1", *columns[1:], "/ ours"]
        keys = [*keys, *peer, f"sgbm{scale}x_exact_median_over_ours_times"]
        _table(f"cyclopean beside OpenCV at {scale}x: merged, exact rays, %", columns, keys, figures)
    for scale in scales:
        columns = ["complete", *(f"{way}: {column}" for way in WAYS for column in ("bad-1", "median", "rms"))]
        keys = [f"sgbm{scale}x_exact_pairs_complete_percent"]
        keys += [f"sgbm{scale}x_{way}_pairs_{key}_percent" for way in WAYS for key in ("bad1", "median", "rms98")]
        _table(f"OpenCV at {scale}x, pairs, %", columns, keys, figures)


def main() -> None:
    """Measure the scenes asked for, or all; store a full run."""
    names = scene_names()
    parser = argparse.ArgumentParser(description="Dense depth of photographs with known truth, beside OpenCV's.")
    parser.add_argument("scenes", nargs="*", metavar="SCENE", help=f"one of {', '.join(names)} (default: all)")
    parser.add_argument("--full", action="store_true", help="OpenCV at twice the scale too; store the figures")
    chosen = parser.parse_args()
    if unknown := set(chosen.scenes) - set(names):
        parser.error(f"no scene {', '.join(sorted(unknown))}; there are {', '.join(names)}")
    scales = (1, 2) if chosen.full else (1,)
    figures = {}
    with Progress() as progress:
        views = {name: scene(name).setup.optic.facets for name in chosen.scenes or names}
        total = sum(1 + len(scales) * n * (n - 1) for n in views.values())
        task = progress.add_task("compiling", total=total)
        warm_up(next(iter(views)))
        for name in views:
            figures[name] = measured(name, scales, lambda what, n: progress.update(task, description=what, advance=n))
            progress.console.print(f"{name}: {figures[name]['seconds']:.1f} s")
    report(figures, scales)
    if chosen.scenes or not chosen.full:
        print("not stored: that takes all scenes, and --full")
        return
    write("dense", {f"{name}_{key}": value for name, row in figures.items() for key, value in row.items()})


def _median(depths):
    """Median (N,) over the last axis of (N, V), NaN where there is none."""
    some = np.isfinite(depths).any(-1)
    return np.where(some, np.nanmedian(np.where(some[:, None], depths, 0.0), axis=-1), np.nan)


def _table(title, columns, keys, figures):
    table(title, ["", *columns], [[name, *(row[key] for key in keys)] for name, row in figures.items()])


if __name__ == "__main__":
    main()
