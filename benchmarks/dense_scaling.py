"""How the time and the memory of dense depth grow with pixels, depth range, views and threads.

    python -m benchmarks.dense_scaling [--quick]

The scene is a slanted plane with random texture, seen by equal pinhole cameras on a circle whose longest baseline is
always one unit, so that a depth range is so many px of disparity whatever the number of views. All views lie side by
side in one photograph; its pixels are counted, not those of one view. Each measurement is a process of its own that
first runs a small scene, so that kernels are compiled. Time is the median of repeats of the whole job to points with
covariance, and of matching alone, the maps between the views ready (their time stands beside): the processor's, which
other programs disturb least, but the clock's where threads are counted. Memory is the peak of the process less what
it held before the measured scene, with the maps.

The exponent of a quantity is the slope of a straight line through the logarithms. It is fitted to whole runs, so that
what does not grow makes it smaller. With --quick the photographs are smaller, and nothing is stored.
"""

import argparse
import json
import sys
import time
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import cv2
import numpy as np

from benchmarks import timing
from benchmarks.data import ROOT
from benchmarks.dense_real import FOCAL, side_by_side
from benchmarks.results import table, write
from cyclopean import reconstruct
from cyclopean.matching import match
from cyclopean.pipeline import plan_of

PICTURE = ROOT / "docs" / "images" / "dense_scaling.png"
LEAST_DISPARITY = 8.0  # px, at the far end of every depth range
MIDDLE, SLOPES = 24.0, (0.004, 0.012)  # disparity px of the plane in mid-picture; its share of change along x and y
REPEATS, ENOUGH = 3, 12.0  # repeats; seconds after which no other one begins


@dataclass(frozen=True)
class Case:
    """One measurement."""

    megapixels: float = 1.2  # of the photograph
    disparities: float = 32.0  # px, the depth range along the longest baseline
    views: int = 3
    threads: int = 1


STEPS = {  # what is varied, one at a time from the case of the defaults
    "megapixels": (0.3, 1.2, 4.8, 12.0),
    "disparities": (32.0, 64.0, 128.0),
    "views": (2, 3, 4, 5, 6, 8),
    "threads": (1, 2),
}
NAMES = {
    "megapixels": "photograph, million pixels",
    "disparities": "depth range, px of disparity",
    "views": "views",
    "threads": "threads",
}
COLUMNS = {
    "seconds": "s",
    "processor_seconds": "processor s",
    "match_seconds": "match s",
    "match_processor_seconds": "processor s",
    "plan_seconds": "maps s",
    "mib": "MiB",
    "process_mib": "in all",
    "complete_percent": "complete %",
    "median_px": "median px",
}


def scene(case: Case) -> tuple[np.ndarray, object, np.ndarray]:
    """Photograph (H, W) uint8, its rig, and the true disparity (H, W) px along a baseline of one unit."""
    height = round(float(np.sqrt(case.megapixels * 1e6 / case.views * 3 / 4)))
    width = round(height * 4 / 3)
    angles = 2 * np.pi * np.arange(case.views) / case.views
    centres = np.stack([np.cos(angles), np.sin(angles)], axis=-1)
    centres /= np.linalg.norm(centres[:, None] - centres, axis=-1).max()
    texture = _texture(width, height)
    pictures, truths = zip(*(_seen(texture, centre, width, height) for centre in centres))
    photograph, rig = side_by_side(pictures, centres)
    truth = np.full(photograph.shape, np.nan)
    for view, own in zip(rig, truths, strict=True):
        x, y, w, h = view.region.box
        truth[y : y + h, x : x + w] = own
    return photograph, rig, truth


def _texture(width, height):
    """Random texture (h, w) uint8 with a margin on all sides."""
    shape = height + 2 * _margin(height), width + 2 * _margin(height)
    noise = cv2.GaussianBlur(np.random.default_rng(7).normal(size=shape).astype(np.float32), None, 1.2)
    return np.clip(128 + 40 * noise / noise.std(), 0, 255).astype(np.uint8)


def _margin(height):
    return round(3 * MIDDLE + 0.02 * height)


def _seen(texture, centre, width, height):
    """The plane's picture (h, w) in a camera at a centre (2,), and its disparity there (h, w) px.

    A pixel p of a camera in the middle, px from mid-picture, with the disparity d = d0 + s p is seen at p - c d: an
    affine map of the picture.
    """
    slopes = np.array(SLOPES) * min(1, 480 / height)  # so that large pictures stay within the same disparities
    middle = np.array([width - 1, height - 1]) / 2
    own_from_middle = np.eye(2) - np.outer(centre, slopes)
    middle_from_own = np.linalg.inv(own_from_middle)
    shift = middle_from_own @ (centre * MIDDLE - middle) + middle + _margin(height)
    affine = np.column_stack([middle_from_own, shift])
    flags = cv2.INTER_LANCZOS4 | cv2.WARP_INVERSE_MAP
    picture = cv2.warpAffine(texture, affine, (width, height), flags=flags, borderMode=cv2.BORDER_REFLECT)
    grid = np.stack(np.meshgrid(np.arange(width), np.arange(height)), axis=-1) - middle
    return picture, MIDDLE + (grid + centre * MIDDLE) @ middle_from_own.T @ slopes


def measure(case: Case) -> dict[str, float]:
    """Seconds, MiB and errors of one case, in this process."""
    depths = FOCAL / (LEAST_DISPARITY + case.disparities), FOCAL / LEAST_DISPARITY
    small = scene(replace(case, megapixels=0.01 * case.views))
    reconstruct(*small[:2], depths)
    photograph, rig, truth = scene(case)
    before, start = timing.held_mib(), time.perf_counter()
    plan = plan_of(rig, depths)
    figures = {"plan_seconds": time.perf_counter() - start}
    found = reconstruct(photograph, rig, depths)
    for what, work in (("", lambda: reconstruct(photograph, rig, depths)), ("match_", lambda: match(photograph, plan))):
        clock, processor = timing.median_times(work, REPEATS, ENOUGH)
        figures |= {f"{what}seconds": clock, f"{what}processor_seconds": processor}
    error = np.abs(FOCAL / found.depth - truth)
    return {
        **figures,
        "mib": timing.peak_mib() - before,
        "process_mib": timing.peak_mib(),
        "complete_percent": float(100 * np.isfinite(found.depth).sum() / np.isfinite(truth).sum()),
        "median_px": float(np.nanmedian(error)),
    }


def apart(case: Case) -> dict[str, float]:
    """The same in a process of its own."""
    return timing.apart("dense_scaling", ["--one", json.dumps(asdict(case))], case.threads)


def exponent(x: Sequence[float], y: Sequence[float]) -> float:
    """Slope of the straight line through the logarithms of both."""
    return float(np.polyfit(np.log(x), np.log(y), 1)[0])


def timed(what: str) -> tuple[str, str]:
    """Which times say how a quantity counts: of the whole job, and of matching alone."""
    return ("seconds", "match_seconds") if what == "threads" else ("processor_seconds", "match_processor_seconds")


def report(found: dict[Case, dict[str, float]], steps: dict[str, Sequence[float]]) -> dict[str, float]:
    """Print tables and exponents; the figures to store."""
    figures = {}
    for what, values in steps.items():
        rows = [found[replace(Case(), **{what: value})] for value in values]
        cells = [[value, *(row[key] for key in COLUMNS)] for value, row in zip(values, rows)]
        table(NAMES[what], ["", *COLUMNS.values()], cells)
        for value, row in zip(values, rows):
            figures |= {f"{what}_{value:g}_{key}": row[key] for key in COLUMNS}
        for key in (*timed(what), "mib"):
            figures[f"{what}_{key}_exponent"] = exponent(values, [row[key] for row in rows])
        whole, alone, memory = (figures[f"{what}_{key}_exponent"] for key in (*timed(what), "mib"))
        print(f"exponents: time {whole:.2f}, of matching alone {alone:.2f}, memory {memory:.2f}\n")
    return figures


def picture(figures: dict[str, float], steps: dict[str, Sequence[float]], path: Path) -> None:
    """Time and memory over what is varied, on logarithmic axes."""
    from matplotlib.figure import Figure
    from matplotlib.ticker import FixedLocator, LogLocator, NullFormatter, NullLocator

    from cyclopean.plotting.colours import BLUE, GREEN, GRID, VERMILION

    figure = Figure(figsize=(12, 5.6), dpi=110, layout="constrained")
    axes = figure.subplots(2, len(steps), sharey="row")
    names = ("the whole job", "matching alone", None)
    for column, (what, values) in enumerate(steps.items()):
        for key, colour, name in zip((*timed(what), "mib"), (BLUE, GREEN, VERMILION), names):
            place, y = axes[int(key == "mib"), column], [figures[f"{what}_{value:g}_{key}"] for value in values]
            slope = f"exponent {figures[f'{what}_{key}_exponent']:.2f}"
            place.loglog(values, y, color=colour, marker="o", markersize=5, label=f"{name}: {slope}" if name else slope)
            place.xaxis.set_major_locator(FixedLocator(list(values)))
            place.xaxis.set_minor_locator(NullLocator())
            place.set_xticks(list(values), [f"{value:g}" for value in values])
            place.yaxis.set_major_locator(LogLocator(subs=(1, 2, 5)))
            place.yaxis.set_major_formatter("{x:g}")
            place.yaxis.set_minor_formatter(NullFormatter())
            place.grid(**GRID)
            place.spines[["top", "right"]].set_visible(False)
        for place in axes[:, column]:
            place.legend(loc="lower left", bbox_to_anchor=(0, 1), frameon=False, fontsize=9, borderpad=0)
        axes[1, column].set_xlabel(NAMES[what])
    axes[0, 0].set_ylabel("time, s")
    axes[1, 0].set_ylabel("memory, MiB")
    figure.savefig(path)


def main() -> None:
    """Measure all cases, print, draw and store."""
    parser = argparse.ArgumentParser(description="Time and memory of dense depth as photographs grow.")
    parser.add_argument("--quick", action="store_true", help="smaller photographs; nothing is stored")
    parser.add_argument("--one", type=lambda text: Case(**json.loads(text)), help=argparse.SUPPRESS)
    chosen = parser.parse_args()
    if chosen.one is not None:
        print(json.dumps(measure(chosen.one)))
        return
    steps = {**STEPS, "megapixels": (0.3, 0.6, 1.2)} if chosen.quick else STEPS
    cases = dict.fromkeys(replace(Case(), **{what: value}) for what, values in steps.items() for value in values)
    found = {}
    for case in cases:
        found[case] = apart(case)
        print(f"{case}: {found[case]['seconds']:.2f} s", file=sys.stderr)
    figures = report(found, steps)
    if not chosen.quick:
        picture(figures, steps, PICTURE)
        write("dense_scaling", figures)


if __name__ == "__main__":
    main()
