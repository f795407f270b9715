"""Dense depth of photographs with known truth, beside OpenCV's, in one run.

    python -m benchmarks.dense [SCENE ...] [--full]

Photographs and true depths are those of `mitsuba/scenes`, rendered by other people's code; ours and the peer
both get the true setup. Ours searches 600 to 1600 mm. The peer is what `cyclopean reconstruct --matcher sgbm` does
with each ordered pair of views (pinholes, rectification, StereoSGBM). It is favoured: its pinholes are fitted
between, and its disparities cover, just the scene's true depths. Its depth is measured in colour, at the
photograph's scale and, with --full, at twice that; its time for grey pictures and for its fastest mode (3WAY) too.
numba and OpenCV both have two threads. Only --full with all scenes stores figures, in results/dense.json.

In the scene named chroma the glass disperses: colours of one point lie some px apart, and apart otherwise in each
view. Its setup and its truth are those of green light; it is measured as it is, by its green channel alone, and
compensated: three setups, one for each colour, bring the colours together, and each is matched along its own rays.

What counts: the pixels that the truth is sampled at, that lie in the mask of a view, and whose true point another
view sees. It does when the point projects into that view's mask, and one of the 3 x 3 true samples around there
lies within 1 % of the depth of it; otherwise something hides it. All views are pooled, each as reference.

- complete: the share of those pixels that have a depth; everything below is over these
- bad-N: the share whose depth is off by more than N % of the true depth
- bad/none: the share of all that have a depth off by more than 1 %, or none
- median, rms: of the error in % of the true depth; the rms is of the best 98 %
- rms px: error of inverse depth as px in the view that moves most of those that see the point, best 98 %
- error/sigma: the 68th percentile of the error over its stated standard deviation; 1 is ideal

The peer gives one depth for each other view: "merged" is their median, as a user would take it; "pairs" are all
ordered pairs of views pooled. "exact" is depth by exact rays from the same matches. Seconds are medians of repeats:

- match: matching alone, all views, with the maps between the views ready (the peer: all ordered pairs one after the
  other, its rectifying maps ready; with and without the remapping that they are for, which ours does as it matches)
- first: the whole job from the setup to points with covariance; further: the same for another photograph
- rate: pixels x hypotheses x other views a second of match, of all hypotheses half a px apart at full resolution, as
  a plain sweep would try ("effective"), and of those that are tried at half the resolution
- memory: the peak of a process less what it held before, for matching with its maps, and for the whole job

With --full, also with the setup that our own calibration finds from the boards in `camera_only` and `calib_*`,
camera and prism together, beside the same with the true setup.
"""

import argparse
import json
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import cache, partial

import cv2
import numba
import numpy as np
from rich.progress import Progress

from benchmarks.dense_peers import PEERS, match_all, peer_figures, peer_seconds, rectified
from benchmarks.dense_report import report
from benchmarks.dense_truth import (
    Scene,
    channel_indices,
    judged,
    motions,
    others,
    rig_name,
    scene,
    scene_names,
    seen_by,
)
from benchmarks.results import write
from benchmarks.timing import apart, few_threads, held_mib, median_seconds, peak_mib
from cyclopean import Camera, Rig, Setup, reconstruct
from cyclopean.matching import match
from cyclopean.pipeline import plan_of
from cyclopean.rectification import channel_rigs, compensated, middle_inverse_depth

DEPTHS = (600.0, 1600.0)  # mm, that ours searches
THREADS = 2
MATCHES, JOBS = 5, 3  # repeats
RATIOS = ("complete", "bad1", "median", "rms98")  # that our own calibration is judged by


def row_names() -> list[str]:
    """All rows of the table: the scenes, and those with dispersion compensated too."""
    names = scene_names()
    return sorted([*names, *(name.replace("_green", "_compensated") for name in names if name.endswith("_green"))])


def row_scene(name: str) -> Scene:
    """The scene of a row."""
    return scene(name.removesuffix("_compensated"))


def prepared(name: str, truth: Scene, setup: Setup) -> tuple[np.ndarray, Rig, tuple[Rig, ...] | None]:
    """What `reconstruct` is given: photograph, rig, and the rigs of the channels where colours are compensated."""
    if not name.endswith("_compensated"):
        return truth.photograph, setup.rig(), None
    indices = channel_indices(name.removesuffix("_compensated"))
    setups = [replace(setup, optic=replace(setup.optic, glass=index)) for index in indices]
    rigs = channel_rigs(setups, DEPTHS)
    return compensated(truth.photograph, rigs, middle_inverse_depth(DEPTHS)), rigs[1], rigs


def job(name: str, truth: Scene, setup: Setup):
    """The whole job, from the photograph to points with covariance."""
    photograph, rig, channels = prepared(name, truth, setup)
    return reconstruct(photograph, rig, DEPTHS, channels=channels)


def depth_figures(name: str, truth: Scene, setup: Setup, other: np.ndarray, motion: np.ndarray) -> dict[str, float]:
    """Figures of our depths with a setup; `other` and `motion` are those of the true one."""
    found, every, counted = job(name, truth, setup), (slice(None, None, truth.step),) * 2, other.any(-1)
    most = np.max(motion[counted], axis=-1, where=other[counted], initial=0.0)
    depth, sigma = found.depth[every][counted].astype(float), found.sigma[every][counted]
    return judged(depth, truth.points[counted][:, 2], sigma, most)


def our_seconds(name: str, truth: Scene) -> dict[str, float]:
    """Seconds of matching alone and of the whole job, and how many hypotheses that makes a second."""
    photograph, rig, channels = prepared(name, truth, truth.setup)
    plan = plan_of(rig, DEPTHS, channels=channels)
    seconds = median_seconds(lambda: match(photograph, plan), MATCHES)
    first = median_seconds(lambda: job(name, truth, truth.setup), JOBS)
    further = median_seconds(lambda: reconstruct(photograph, rig, DEPTHS, channels=channels), JOBS)
    looks, hypotheses = len(rig) - 1, plan.references[0].depths
    figures = {
        "match_seconds": seconds,
        "first_seconds": first,
        "further_seconds": further,
        "hypotheses": hypotheses,
        "effective_million_per_s": looks * hypotheses * int(rig.masks.sum()) / seconds / 1e6,
    }
    if len(plan.layouts) == 2:  # else coarser levels decide what is tried
        tried = sum(int(reference.masks[2].sum()) for reference in plan.references) * ((hypotheses - 1) // 2 + 1)
        figures["tried_million_per_s"] = looks * tried / seconds / 1e6
    return figures


def peak(name: str, who: str) -> dict[str, float]:
    """Memory (MiB) that matching takes, and the whole job, beyond what this process holds before."""
    few_threads(THREADS)
    warm_up(name)
    truth = row_scene(name)
    photograph, rig, channels = prepared(name, truth, truth.setup)
    before = held_mib()
    if who in PEERS:
        match_all(PEERS[who], photograph, rectified(rig, truth, PEERS[who].scale))
        return {"match_mib": peak_mib() - before}
    match(photograph, plan_of(rig, DEPTHS, channels=channels))
    matched = peak_mib()
    reconstruct(photograph, rig, DEPTHS, channels=channels)
    return {"match_mib": matched - before, "whole_mib": peak_mib() - before}


@cache
def calibrated(rig: str) -> Setup:
    """The setup that our own calibration finds, camera and prism together, from a start that is off."""
    from benchmarks.calibration import joint
    from benchmarks.targets import detected_corners

    return joint(rig, detected_corners).setup


def peers_beside(
    name: str, truth: Scene, other: np.ndarray, motion: np.ndarray, full: bool, tick: Callable[[str], None]
) -> dict[str, float]:
    """All figures of the peer."""
    photograph, rig, _ = prepared(name, truth, truth.setup)
    masks = np.moveaxis(rig.masks[:, :: truth.step, :: truth.step], 0, -1)
    figures, pairs = {}, {}
    for key, peer in PEERS.items():
        if peer.scale > 1 and not full:
            continue
        if peer.scale not in pairs:
            pairs = {peer.scale: rectified(rig, truth, peer.scale)}
        found = peer_seconds(peer, photograph, pairs[peer.scale], THREADS, partial(tick, f"{name}, {peer.title}"))
        if not peer.grey:
            found |= peer_figures(peer, photograph, pairs[peer.scale], truth, masks, other, motion)
        figures |= {f"{key}_{what}": value for what, value in found.items()}
    return figures


def measured(name: str, full: bool, tick: Callable[[str], None]) -> dict[str, float]:
    """All figures of one row."""
    truth = row_scene(name)
    rig = truth.setup.rig()
    other, motion = others(rig, truth, seen_by(rig, truth)), motions(rig, truth)
    tick(name)
    figures = depth_figures(name, truth, truth.setup, other, motion) | our_seconds(name, truth)
    tick(name)
    figures |= peers_beside(name, truth, other, motion, full, tick)
    if full:
        for who in ("ours", "sgbm1x", "sgbm2x"):
            found = apart("dense", [name, "--peak", who], THREADS)
            figures |= {key if who == "ours" else f"{who}_{key}": value for key, value in found.items()}
        if "chroma" not in name:
            own = depth_figures(name, truth, calibrated(rig_name(name)), other, motion)
            figures |= {f"calibrated_{key}": value for key, value in own.items()}
    return figures | ratios(figures)


def ratios(figures: dict[str, float]) -> dict[str, float]:
    """Ours beside the peer, and our own calibration beside the true setup, in times."""
    found = {}
    for peer in ("sgbm1x", "sgbm2x"):
        if f"{peer}_exact_bad1_percent" in figures:
            for key in ("bad1_percent", "median_percent", "rms98_px"):
                what = key.split("_")[0]
                found[f"{what}_over_{peer}_times"] = _over(figures[key], figures[f"{peer}_exact_{key}"])
    for peer in PEERS:
        if f"{peer}_match_seconds" in figures:
            found[f"{peer}_match_over_ours_times"] = figures[f"{peer}_match_seconds"] / figures["match_seconds"]
            found[f"{peer}_over_ours_times"] = figures[f"{peer}_seconds"] / figures["match_seconds"]
    if "calibrated_bad1_percent" in figures:
        for key in RATIOS:
            own, true = figures[f"calibrated_{key}_percent"], figures[f"{key}_percent"]
            found[f"calibrated_{key}_over_true_times"] = _over(own, true)
    return found


def warm_up(name: str) -> None:
    """Compile everything, on a small copy of a scene."""
    truth = row_scene(name)
    camera = truth.setup.camera
    small = Camera(tuple(n // 4 for n in camera.size), camera.focal[0] / 4)
    given = replace(truth, photograph=cv2.resize(truth.photograph, small.size))
    job(name, given, Setup(small, truth.setup.optic))


def main() -> None:
    """Measure the scenes asked for, or all; store a full run."""
    names = row_names()
    chosen = _arguments(names)
    if chosen.peak:
        print(json.dumps(peak(chosen.scenes[0], chosen.peak)))
        return
    few_threads(THREADS)
    figures, peers = {}, [peer for peer in PEERS.values() if chosen.full or peer.scale == 1]
    with Progress() as progress:
        views = {name: row_scene(name).setup.optic.facets for name in chosen.scenes or names}
        total = sum(2 + len(peers) * n * (n - 1) for n in views.values())
        task = progress.add_task("compiling", total=total)
        for name in views:
            warm_up(name)
            figures[name] = measured(name, chosen.full, lambda what: progress.update(task, description=what, advance=1))
            progress.console.print(f"{name}: {figures[name]['match_seconds']:.2f} s")
    report(figures, numba.get_num_threads(), chosen.full)
    if chosen.scenes or not chosen.full or numba.get_num_threads() != THREADS:
        print(f"not stored: that takes all scenes, --full and {THREADS} threads")
        return
    stored = {f"{name}_{key}": value for name, row in figures.items() for key, value in row.items()}
    write("dense", {key: value for key, value in stored.items() if np.isfinite(value)})


def _arguments(names: Sequence[str]) -> argparse.Namespace:
    parser = argparse.ArgumentParser(description="Dense depth of photographs with known truth, beside OpenCV's.")
    parser.add_argument("scenes", nargs="*", metavar="SCENE", help=f"one of {', '.join(names)} (default: all)")
    parser.add_argument(
        "--full", action="store_true", help="OpenCV at twice the scale, our own calibration and memory too; store"
    )
    parser.add_argument("--peak", choices=("ours", *PEERS), help=argparse.SUPPRESS)
    chosen = parser.parse_args()
    if unknown := set(chosen.scenes) - set(names):
        parser.error(f"no scene {', '.join(sorted(unknown))}; there are {', '.join(names)}")
    return chosen


def _over(ours, theirs):
    return ours / theirs if theirs > 0 else float("nan")


if __name__ == "__main__":
    main()
