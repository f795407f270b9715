"""Where dense matching stands against the limits of the machine: memory bandwidth and rates of arithmetic.

    python -m benchmarks.dense_limits [--store]

First the limits, by small kernels in one thread: reading two large arrays and writing a third (McCalpin's STREAM
triad, 1995), 16-bit additions and minima, and 32-bit multiply-adds, all in registers, and looking up single numbers
in a table that lies in the cache. Then each stage of the matcher alone, in one thread, on the photograph of
`dense_scaling.py` with two views; for jumps in depth its true map has stripes added that lie some hypotheses nearer.

Bytes are those that must pass between a kernel and its arrays when each is read or written once: neighbours that lie
in the cache are free. Operations are counted in the text of the kernels, a multiplication or an addition or a minimum
as one; so are lookups, numbers that are read at places that were computed. All are per item; what an item is stands
beside. A stage with a high share of one limit has little to gain but by doing less work; one with low shares of all
waits for something else, such as lookups or short loops.

Run it on an idle machine, with --store to keep the figures.
"""

import argparse
import os
from collections.abc import Callable
from dataclasses import dataclass

os.environ.setdefault("NUMBA_NUM_THREADS", "1")  # all limits are those of one core

import numpy as np
from numba import njit

from benchmarks.dense_real import FOCAL
from benchmarks.dense_scaling import LEAST_DISPARITY, Case, scene
from benchmarks.results import table, write
from benchmarks.timing import median_times
from cyclopean.matching import Plan
from cyclopean.matching.aggregation import search
from cyclopean.matching.agreement import agreement
from cyclopean.matching.bands import Bands
from cyclopean.matching.cost import TILE, filler
from cyclopean.matching.jumps import RADIUS, REACH, placed
from cyclopean.matching.pictures import Prepared, prepare
from cyclopean.matching.places import BLOCK, MARGIN
from cyclopean.matching.refinement import _TALL, SUB, refined
from cyclopean.matching.sampling import WIDE, look, workspace
from cyclopean.matching.surfaces import extremes
from cyclopean.pipeline import plan_of

REPEATS = 5
LARGE = 1 << 24  # float32 numbers: 64 MiB, beyond the share of a core in most caches
NEAR = 2048  # numbers that stay in the first-level cache
ROUNDS = 400
CHAIN = 16  # steps on each number while it is in a register
CASE = Case(megapixels=0.6, views=2)  # the photograph for the stages
STRIPE, NEARER = 16, 3.0  # px, hypotheses: the jumps


@dataclass(frozen=True, eq=False)
class Stage:
    """A part of the matcher."""

    name: str
    item: str  # what is counted
    items: int
    run: Callable[[], object]
    bytes: float  # each item
    operations: float  # each item
    lookups: float = 0.0  # each item
    kind: str = "float32"  # of the operations: int16 or float32


@dataclass(frozen=True, eq=False)
class Ready:
    """A photograph and its plan, with the true map of its first view."""

    plan: Plan
    pictures: Prepared
    depth: np.ndarray  # (h, w) float32, inverse depth in hypotheses

    @property
    def order(self) -> int:
        """Coefficients of the polynomials that say where a pixel is seen."""
        return self.plan.warps[0].coefficients.shape[-1]


@njit(fastmath=True)
def _triad(a, b, c):
    for k in range(len(a)):
        a[k] = b[k] + np.float32(3) * c[k]


@njit
def _int16(a, b, c):
    for _ in range(ROUNDS):
        for k in range(len(a)):
            value = a[k]
            for _ in range(CHAIN):
                value = min(np.uint16(value + b[k]), c[k])
            a[k] = value


@njit(fastmath={"contract"})
def _float32(a, b, c):
    for _ in range(ROUNDS):
        for k in range(len(a)):
            value = a[k]
            for _ in range(CHAIN):
                value = value * b[k] + c[k]
            a[k] = value


@njit
def _lookups(a, places, values):
    for _ in range(ROUNDS):
        for k in range(len(a)):
            a[k] += values[places[k]]


def limits() -> dict[str, float]:
    """Measured limits of one core: gigabytes, and thousand millions of operations, a second."""
    rng = np.random.default_rng(0)
    large = [np.ones(LARGE, np.float32) for _ in range(3)]
    shorts = [rng.integers(1, 900, NEAR).astype(np.uint16) for _ in range(3)]
    reals = [rng.uniform(0.1, 0.9, NEAR).astype(np.float32) for _ in range(3)]
    places = rng.integers(0, NEAR, NEAR).astype(np.int32)
    count = NEAR * ROUNDS
    return {
        "triad_gigabytes_per_s": 12 * LARGE / seconds(lambda: _triad(*large)) / 1e9,
        "int16_gigaops_per_s": 2 * CHAIN * count / seconds(lambda: _int16(*shorts)) / 1e9,
        "float32_gigaops_per_s": 2 * CHAIN * count / seconds(lambda: _float32(*reals)) / 1e9,
        "lookups_giga_per_s": count / seconds(lambda: _lookups(reals[0], places, reals[1])) / 1e9,
    }


def seconds(run: Callable[[], object]) -> float:
    """Median of the processor time of repeats, after one that compiles; other programs disturb that least."""
    run()
    return median_times(run, REPEATS)[1]


def ready() -> Ready:
    """The photograph for the stages."""
    photograph, rig, truth = scene(CASE)
    plan = plan_of(rig, (FOCAL / (LEAST_DISPARITY + CASE.disparities), FOCAL / LEAST_DISPARITY))
    x, y, width, height = rig[0].region.box
    warps = plan.warps[0]
    depth = (truth[y : y + height, x : x + width] / FOCAL - warps.inverse_depths[0]) / warps.step
    return Ready(plan, prepare(photograph, plan), depth.astype(np.float32))


def stages() -> list[Stage]:
    """All stages of the matcher."""
    given = ready()
    return [*search_stages(given), look_stage(given), *refinement_stages(given), jump_stage(given),
            agreement_stage(given)]  # fmt: skip


def search_stages(given: Ready) -> list[Stage]:
    """From pictures at half the resolution to one hypothesis for each pixel.

    Costs: 4 for each further coefficient of a place, 12 to find its nearest pixel, both for margins too; sums down 15
    and across 9; 17 for the correlation, 7 to make it a byte. Written once; pictures serve all hypotheses.

    Paths: on each a hypothesis wants two minima and an addition for its neighbours, one minimum for a jump, one
    subtraction, two additions of cost and sum, one minimum for the next pixel. Both sweeps read the costs; the first
    writes the sums, the second reads and writes them, and they are read once more to be judged.
    """
    reference = given.plan.references[0]
    height, width = reference.masks[2].shape
    depths = (reference.depths - 1) // 2 + 1
    bands, rows = Bands.full((width, height), depths, TILE), slice(0, height)
    fill, mask = filler(given.pictures.search, reference, 1, bands), np.ones((height, width), bool)
    volume, large = fill(rows), np.full((height, width), 120, np.uint16)
    margin, pixels = (1 + 2 / TILE) ** 2, width * height * depths
    operations = margin * (4 * (given.order - 1) + 12) + (1 + 2 / TILE) * 15 + 9 + 17 + 7
    return [
        Stage("costs", "pixel, depth, view", pixels, lambda: fill(rows), 1 + 20 / depths, operations, margin),
        *(
            Stage(f"aggregate, {paths} paths", "pixel, depth", pixels,
                  lambda paths=paths: search(lambda rows: volume, bands, mask, 8, large, paths=paths), 10,
                  8 * paths + 1, kind="int16")
            for paths in (4, 8)
        ),
    ]  # fmt: skip


@njit
def _look_rows(lines, spacing, s, known, half, frame, spline, weights, own, out):
    room = workspace(lines.shape[1])
    for y in range(own.shape[0]):
        for left in range(0, own.shape[1] - WIDE + 1, WIDE):
            part = slice(left, left + WIDE)
            mine, to = own[y, part], out[y, 3 * left :]
            look(lines, spacing, y, left, s[y, part], known, half, frame, spline, weights, mine, room, to)


def look_operations(given: Ready) -> float:
    """Of comparing one pixel with a view: its place, the weights of 4 x 4 pixels, their sums, slopes, differences."""
    return 6 * given.order + 8 * (given.order - 1) + 10 + 58 + 4 + 80 + 8 + 8


def look_stage(given: Ready) -> Stage:
    """What the other view shows at each pixel's own inverse depth: value and slope of a cubic B-spline."""
    reference, splines = given.plan.references[0], given.pictures.splines[0]
    height, width = given.depth.shape
    whole = width // WIDE * WIDE
    lines = np.ascontiguousarray(reference.lines[1][0, :, :, MARGIN : MARGIN + whole])
    own = np.ascontiguousarray(given.pictures.smooth[0].own(0)[0, :, :whole])
    s = given.depth[:, :whole] / reference.half(1) - np.float32(1)
    frames, starts, values = splines.arrays
    part = slice(starts[1], starts[2])
    known, out = np.ones(WIDE, np.float32), np.empty((height, 3 * whole), np.float32)
    numbers = lines, reference.spacing, s, known, reference.half(1), frames[1]
    return Stage("look", "pixel, view", height * whole,
                 lambda: _look_rows(*numbers, values[0, part], splines.layout.weights[part], own, out),
                 4 * 7 + 8 * given.order / reference.spacing, look_operations(given), 17)  # fmt: skip


def refinement_stages(given: Ready) -> list[Stage]:
    """From hypotheses to fractions of them, where the depth is smooth, and with jumps everywhere.

    Products 12, sums of ten of them down 30 + 60 and across 30 + 60, gain and offset 34, solution and result 41;
    margins are computed too. Near a jump 29 for each of 49 neighbours.
    """
    reference, pictures = given.plan.references[0], given.pictures
    tall, wide = 1 + 10 / _TALL, WIDE / BLOCK
    smooth = tall * wide * (look_operations(given) + 12 + 30) + wide * 150 + 34 + 41
    passed = 4 * 7 + 8 * given.order / reference.spacing

    def run(depth):
        return lambda: refined(
            pictures.smooth[0], pictures.splines[0], reference, depth, passes=3, reach=1.5, prior=0.2
        )

    shape = given.depth.size
    return [
        Stage("refine", "pixel, view", shape, run(given.depth), passed, smooth, 17 * tall * wide),
        Stage("refine, jumps everywhere", "pixel, view", shape, run(striped(given.depth, SUB // 2)), passed,
              smooth + 49 * 29, 17 * tall * wide),
    ]  # fmt: skip


def jump_stage(given: Ready) -> Stage:
    """The choice between the surfaces at a jump: two of them, 9 pixels each, 27 for each and 18 for their likeness."""
    reference, depth = given.plan.references[0], striped(given.depth, STRIPE)
    low, high = extremes(depth, RADIUS)
    near = np.count_nonzero(high - low > REACH)
    operations = 4 * given.order + 2 * (10 * given.order + 9 * 27 + 18)
    return Stage("choose at jumps", "pixel, view", near,
                 lambda: placed(given.pictures.smooth[0], reference, depth), 4 * 7, operations, 2 * 9 * 5)  # fmt: skip


def agreement_stage(given: Ready) -> Stage:
    """Whether maps agree: the place of a pixel, and 20 to look it up and compare."""
    both = [given.depth, given.depth]
    operations = 6 * given.order + 4 * (given.order - 1) + 20
    bytes_each = 4 + 4 + 1 + 8 * given.order / given.plan.references[0].spacing
    tolerances = [1.0, 1.0]
    return Stage("agreement", "pixel, view", 2 * given.depth.size, lambda: agreement(given.plan, both, tolerances),
                 bytes_each, operations, 1)  # fmt: skip


def striped(depth: np.ndarray, width: int) -> np.ndarray:
    """A map (h, w) with every other stripe of some px nearer."""
    stripes = np.arange(depth.shape[1]) // width % 2
    return depth + np.float32(NEARER) * stripes.astype(np.float32)


def beside(stage: Stage, taken: float, limit: dict[str, float]) -> dict[str, float]:
    """Figures of a stage that took some seconds, as shares of the limits."""
    rate = stage.items / taken / 1e9
    return {
        "bytes": stage.bytes,
        "operations": float(stage.operations),
        "lookups": stage.lookups,
        "million_per_s": 1e3 * rate,
        "nanoseconds": 1 / rate,
        "bandwidth_percent": 100 * rate * stage.bytes / limit["triad_gigabytes_per_s"],
        "arithmetic_percent": 100 * rate * stage.operations / limit[f"{stage.kind}_gigaops_per_s"],
        "lookups_percent": 100 * rate * stage.lookups / limit["lookups_giga_per_s"],
    }


def main() -> None:
    """Measure, print and store."""
    parser = argparse.ArgumentParser(description="Where dense matching stands against the limits of the machine.")
    parser.add_argument("--store", action="store_true", help="keep the figures in results/dense_limits.json")
    store = parser.parse_args().store
    figures = limits()
    units = {"gigabytes": "GB/s", "gigaops": "thousand million operations/s", "giga": "thousand million/s"}
    table("Limits of one core", ["", "rate", ""],
          [[key.split("_")[0], value, units[key.split("_")[1]]] for key, value in figures.items()])  # fmt: skip
    rows = []
    for stage in stages():
        found = beside(stage, seconds(stage.run), figures)
        rows.append([stage.name, stage.item, *found.values()])
        name = stage.name.replace(", ", "_").replace(" ", "_")
        figures |= {f"{name}_{key}": value for key, value in found.items()}
    heads = ["item", "bytes", "oper.", "lookups", "10^6/s", "ns", "% memory", "% oper.", "% lookups"]
    table("Stages, one thread", ["", *heads], rows)
    if store:
        write("dense_limits", figures)


if __name__ == "__main__":
    main()
