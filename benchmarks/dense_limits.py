"""Where dense matching stands against the limits of the machine: memory bandwidth and rates of arithmetic.

    python -m benchmarks.dense_limits [--store]

First the limits, by small kernels in one thread: reading two large arrays and writing a third (McCalpin's STREAM
triad, 1995), 16-bit additions and minima, and 32-bit multiply-adds, all in registers, and looking up single numbers
in a table that lies in the cache. Then each stage of the matcher alone, on random pictures.

Bytes are those that must pass between a kernel and its arrays when each is read or written once: neighbours that lie
in the cache are free. Operations are counted in the text of the kernels, a multiplication or an addition or a minimum
as one. Both are per item; what an item is stands beside. A stage with a high share of one limit has little to gain
but by doing less work; one with low shares of all waits for something else, such as lookups or short loops.

Run it on an idle machine, with --store to keep the figures.
"""

import argparse
import os
import time
from collections.abc import Callable
from dataclasses import dataclass

os.environ.setdefault("NUMBA_NUM_THREADS", "1")  # all limits are those of one core

import numpy as np
from numba import njit

from benchmarks.results import table, write

REPEATS = 5
LARGE = 1 << 24  # float32 numbers: 64 MiB, beyond the share of a core in most caches
NEAR = 2048  # numbers that stay in the first-level cache
ROUNDS = 400
CHAIN = 16  # steps on each number while it is in a register
SIZE, VIEWS, CHANNELS, DEPTHS = (640, 480), 2, 3, 64  # of the pictures for the stages


@dataclass(frozen=True, eq=False)
class Stage:
    """A part of the matcher."""

    name: str
    item: str  # what is counted
    items: int
    run: Callable[[], object]
    bytes: float  # each item
    operations: float  # each item
    kind: str  # of the operations: int16 or float32


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
    taken = []
    for _ in range(REPEATS):
        start = time.process_time()
        run()
        taken.append(time.process_time() - start)
    return float(np.median(taken))


def stages() -> list[Stage]:
    """All stages of the matcher."""
    return [*cost_stages(), *aggregation_stages(), *refinement_stages()]


def cost_stages() -> list[Stage]:
    """From pictures to one cost for each pixel and hypothesis."""
    from cyclopean.matching import cost
    from cyclopean.matching.views import look

    (width, height), reach, radius = SIZE, cost.REACH, cost._RADIUS
    rng = np.random.default_rng(1)
    image = rng.uniform(0, 255, (height, width, CHANNELS)).astype(np.float32)
    mask = np.ones((height, width), bool)
    nodes = np.stack(np.meshgrid(np.arange(0, width + 8, 8), np.arange(0, height + 8, 8)), -1).astype(np.float32) + 3.3
    wide = -(-width // cost.N) * cost.N + 2 * reach
    warped = np.zeros((CHANNELS, height, wide), np.float32)
    reference, seen = rng.uniform(0, 255, warped.shape).astype(np.float32), np.zeros((height, wide), np.float32)
    costs = rng.uniform(0, 1, (VIEWS, height, width)).astype(np.float32)
    planes = rng.integers(0, 255, (DEPTHS, height, width)).astype(np.uint8)
    pixels, rows = width * height, 2 * radius + 1
    one, item = 4 * CHANNELS, "pixel, hypothesis, view"
    likeness = CHANNELS * (24 * rows + 14) + 5
    return [
        Stage("look into a view", item, pixels,
              lambda: look(image, mask, nodes, 8, 0, mask, reach, warped, seen), 2 * one + 4, 8 + 9 * CHANNELS,
              "float32"),
        Stage("likeness of windows", item, pixels,
              lambda: cost.dissimilarity(reference, warped, seen, radius, 1.0, width), 2 * one + 8, likeness,
              "float32"),
        Stage("fuse views", item, pixels * VIEWS, lambda: cost.fuse(costs, 0.7), 4 + 1 / VIEWS, 4, "float32"),
        Stage("turn the volume", "pixel, hypothesis", pixels * DEPTHS, lambda: cost.hypotheses_last(planes), 2, 0,
              "float32"),
    ]  # fmt: skip


def aggregation_stages() -> list[Stage]:
    """From costs to one hypothesis for each pixel.

    On each path a hypothesis wants two minima and an addition for its neighbours, one minimum for a jump, one
    subtraction, two additions of cost and sum, one minimum for the next pixel. The sums of half of the paths are
    written once, and read and judged after the other half.
    """
    from cyclopean.matching.aggregation import search
    from cyclopean.matching.bands import Bands

    width, height = SIZE
    bands = Bands.full(SIZE, DEPTHS)
    whole = np.random.default_rng(2).integers(0, 255, bands.places(slice(0, height))).astype(np.uint8)
    mask, large = np.ones((height, width), bool), np.full((height, width), 120, np.uint16)
    return [
        Stage(f"aggregate, {paths} paths", "pixel, hypothesis", width * height * DEPTHS,
              lambda paths=paths: search(lambda rows: whole, bands, mask, 8, large, paths=paths), 6, 8 * paths + 1,
              "int16")
        for paths in (4, 8)
    ]  # fmt: skip


def refinement_stages() -> list[Stage]:
    """From hypotheses to fractions of them."""
    from cyclopean.matching import refinement
    from cyclopean.matching.views import sample

    width, height = SIZE[0], SIZE[1] // 2
    radius, rng = refinement._RADIUS, np.random.default_rng(3)
    spline = rng.uniform(0, 255, (height, width, CHANNELS)).astype(np.float32)
    mask, guess = np.ones((height, width), bool), rng.uniform(1, 2, (height, width)).astype(np.float32)
    grid = np.stack(np.meshgrid(np.arange(0, width + 8, 8), np.arange(0, height + 8, 8)), -1).astype(np.float32)
    nodes = np.stack([grid + shift for shift in (0.3, 0.8, 1.3, 1.8)])
    padded = height + 2 * radius, -(-width // refinement.N) * refinement.N + 2 * radius
    values, slopes = np.zeros((2, VIEWS, CHANNELS, *padded), np.float32)
    reference = rng.uniform(0, 255, (CHANNELS, *padded)).astype(np.float32)
    seen, depth = np.ones((VIEWS, *padded), np.float32), np.ones(padded, np.float32)
    window = refinement._window()
    taps = np.count_nonzero(window)
    numbers = [np.float32(n) for n in (1, 100, 100, 0.2, 0.15)]
    pixels = width * height
    return [
        Stage("sample a view", "pixel, view, round", pixels,
              lambda: sample(spline, mask, nodes, 8, 0, guess, radius, values[0], slopes[0], seen[0]),
              12 * CHANNELS + 8, 70 + 16 * (5 + 4 * CHANNELS), "float32"),
        Stage("fit planes", "pixel, view, round", pixels * VIEWS,
              lambda: refinement.improve(reference, values, slopes, seen, depth, window, *numbers),
              8 * CHANNELS + 4 + (4 * CHANNELS + 4) / VIEWS, CHANNELS * (55 * taps + 110) + 60, "float32"),
    ]  # fmt: skip


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
        rate = stage.items / seconds(stage.run) / 1e9
        bandwidth = 100 * rate * stage.bytes / figures["triad_gigabytes_per_s"]
        arithmetic = 100 * rate * stage.operations / figures[f"{stage.kind}_gigaops_per_s"]
        rows.append([stage.name, stage.item, stage.bytes, stage.operations, 1e3 * rate, bandwidth, arithmetic])
        name = stage.name.replace(", ", "_").replace(" ", "_")
        figures |= {
            f"{name}_bytes": stage.bytes,
            f"{name}_operations": stage.operations,
            f"{name}_million_per_s": 1e3 * rate,
            f"{name}_bandwidth_percent": bandwidth,
            f"{name}_arithmetic_percent": arithmetic,
        }
    heads = ["item", "bytes", "operations", "million/s", "of bandwidth %", "of arithmetic %"]
    table("Stages, one thread", ["", *heads], rows)
    if store:
        write("dense_limits", figures)


if __name__ == "__main__":
    main()
