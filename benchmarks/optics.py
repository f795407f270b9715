"""How fast we trace rays and project points through glass, beside other packages, in one run.

    python -m benchmarks.optics

Tracing: 1e6 pixels of one view of a biprism (10 degrees, index 1.5168) become rays behind the glass; the
others start from unit vectors. Projecting: 1e6 points become pixels, through the same glass or, for packages
that only know surfaces that face the camera, through a flat port of water or a plate. Float64, two threads.

Every contender lives in a process of its own, because packages change how memory is handed out and leave
threads waiting for work; the processes take turns over several rounds, and medians of wall times count. Every
answer is checked first. Figures are stored in results/optics.json, but only when every package is here, best
in an environment of their own:

    pip install -e ".[peers]" torch && pip install --no-deps aquakit
"""

import os

THREADS = 2
for variable in ("OMP_NUM_THREADS", "NUMBA_NUM_THREADS"):  # read when the packages are imported
    os.environ[variable] = str(THREADS)

import argparse  # noqa: E402
import math  # noqa: E402
import multiprocessing  # noqa: E402
import re  # noqa: E402
import time  # noqa: E402
from collections.abc import Callable, Sequence  # noqa: E402
from dataclasses import dataclass  # noqa: E402
from pathlib import Path  # noqa: E402

import numpy as np  # noqa: E402
from numba import njit, prange  # noqa: E402

from benchmarks.peers import (  # noqa: E402
    TRACING,
    Contender,
    Layers,
    Pinhole,
    aquakit_projecting,
    numpy_projecting,
    optv_projecting,
    trace,
)
from benchmarks.results import table, write  # noqa: E402

APEX_DEG, INDEX, WATER, DISTANCE, THICKNESS = 10.0, 1.5168, 1.333, 60.0, 10.0
CAMERA = Pinhole(focal=(2400.0, 2400.0), centre=(639.5, 479.5), size=(1280, 960))
RAY_BYTES, POINT_BYTES = 16 + 48, 24 + 16  # float64: pixel in, point and direction out; point in, pixel out
COUNT = 1_000_000
OURS, MEMORY = "cyclopean", "memory alone (triad)"
FAST = {"error_model": "numpy", "fastmath": {"reassoc", "contract", "arcp", "nsz"}}


# Problems


def layers_of(optic: str) -> Layers:
    """The planes of an optic: the biprism's flat face and its facet towards +x, a water surface, or a plate."""
    near, far, apex = DISTANCE, DISTANCE + THICKNESS, np.radians(APEX_DEG)
    ahead, tilted = [0.0, 0.0, 1.0], [np.sin(apex), 0.0, np.cos(apex)]
    heights, normals, indices = {
        "wedge": ([near, far], [ahead, tilted], (1.0, INDEX, 1.0)),  # the facet passes through the apex
        "port": ([near], [ahead], (1.0, WATER)),
        "plate": ([near, far], [ahead, ahead], (1.0, INDEX, 1.0)),
    }[optic]
    return Layers(np.outer(heights, ahead), np.array(normals), indices, optic)


def problem(layers: Layers, tracing: bool) -> tuple[np.ndarray, np.ndarray]:
    """What a contender is given and the answer: pixels and (N, 6) rays, or points and the pixels that see them.

    The points lie 500 to 1500 mm along the rays of the pixels, so that both answers are closed forms.
    """
    rng = np.random.default_rng(1)
    pixels = rng.uniform([660, 0], [1279, 959], (COUNT, 2))  # well inside the view
    exits, directions = trace(layers, CAMERA.directions(pixels))
    if tracing:
        return pixels, np.hstack([exits, directions])
    return exits + rng.uniform(500, 1500, (COUNT, 1)) * directions, pixels


# Our side, through the public interface


def our_view(optic: str):
    """The view through an optic: "wedge", "port" (a flat water surface) or "plate"."""
    from cyclopean import Camera, Plate, Prism, Setup

    camera = Camera(size=CAMERA.size, focal=CAMERA.focal, centre=CAMERA.centre)
    optics = {
        "wedge": lambda: Prism(2, APEX_DEG, INDEX, DISTANCE, THICKNESS),
        "port": lambda: Plate(WATER, DISTANCE, THICKNESS, beyond=WATER),
        "plate": lambda: Plate(INDEX, DISTANCE, THICKNESS),
    }
    return Setup(camera, optics[optic]()).rig()[0]


def our_tracing(camera: Pinhole, layers: Layers, pixels: np.ndarray) -> Contender:
    """`view.rays`, from pixels."""
    view = our_view(layers.name)
    return Contender(OURS, lambda _: view.rays(pixels), lambda rays: np.hstack([rays.origins, rays.directions]))


def our_projecting(camera: Pinhole, layers: Layers, points: np.ndarray) -> Contender:
    """`view.project`."""
    view = our_view(layers.name)
    return Contender(f"{OURS}, {layers.name}", lambda _: view.project(points), np.asarray)


# What the machine could do: the same arithmetic without an interface, and memory alone


@njit(inline="always", **FAST)
def two_planes(x, y, camera, planes):
    """Exit point and direction of one pixel.

    camera (4,): focal and centre, px; planes (2, 5): normal, offset, index before over index after.
    """
    vx, vy = (x - camera[2]) / camera[0], (y - camera[3]) / camera[1]
    vz = 1 / math.sqrt(1 + vx * vx + vy * vy)
    vx, vy = vx * vz, vy * vz
    px = py = pz = 0.0
    for s in range(2):
        nx, ny, nz, offset, ratio = planes[s, 0], planes[s, 1], planes[s, 2], planes[s, 3], planes[s, 4]
        cos = nx * vx + ny * vy + nz * vz
        step = (offset - nx * px - ny * py - nz * pz) / cos
        px, py, pz = px + step * vx, py + step * vy, pz + step * vz
        kick = math.sqrt(1 - ratio * ratio * (1 - cos * cos)) - ratio * cos
        vx, vy, vz = ratio * vx + kick * nx, ratio * vy + kick * ny, ratio * vz + kick * nz
    return px, py, pz, vx, vy, vz


@njit(parallel=True, **FAST)
def bare_columns(x, y, camera, planes, out):
    """Pixels x, y (N,) to out (6, N)."""
    for i in prange(x.size):
        p0, p1, p2, v0, v1, v2 = two_planes(x[i], y[i], camera, planes)
        out[0, i], out[1, i], out[2, i], out[3, i], out[4, i], out[5, i] = p0, p1, p2, v0, v1, v2


@njit(**FAST)
def bare_piece(pixels, camera, planes, origins, directions):
    """Some rows, flat: with two indices, stores of three numbers side by side would not vectorise."""
    for i in range(pixels.size // 2):
        p0, p1, p2, v0, v1, v2 = two_planes(pixels[2 * i], pixels[2 * i + 1], camera, planes)
        origins[3 * i], origins[3 * i + 1], origins[3 * i + 2] = p0, p1, p2
        directions[3 * i], directions[3 * i + 1], directions[3 * i + 2] = v0, v1, v2


@njit(parallel=True, **FAST)
def bare_rows(pixels, camera, planes, origins, directions):
    """Pixels (2 N,) to origins (3 N,) and directions (3 N,), rows one after the other."""
    count = pixels.size // 2
    for piece in prange((count + 2047) // 2048):
        i, j = piece * 2048, min(count, (piece + 1) * 2048)
        bare_piece(pixels[2 * i : 2 * j], camera, planes, origins[3 * i : 3 * j], directions[3 * i : 3 * j])


@njit(parallel=True, **FAST)
def triad(a, b, c):
    """STREAM's triad (McCalpin 1995): two arrays read, one written."""
    for i in prange(a.size):
        a[i] = b[i] + 3.0 * c[i]


def packed(camera: Pinhole, layers: Layers) -> tuple[np.ndarray, np.ndarray]:
    """Camera and planes as `two_planes` wants them."""
    offsets = np.sum(layers.points * layers.normals, axis=1)
    ratios = [ratio for _, _, ratio in layers]
    return np.array([*camera.focal, *camera.centre]), np.column_stack([layers.normals, offsets, ratios])


def columns_tracing(camera: Pinhole, layers: Layers, pixels: np.ndarray) -> Contender:
    """A bare kernel: columns into columns that are there already."""
    x, y = np.ascontiguousarray(pixels.T)
    numbers, out = packed(camera, layers), np.ones((6, len(pixels)))

    def run(_):
        bare_columns(x, y, *numbers, out)
        return out

    return Contender("bare kernel, columns, in place", run, np.transpose)


def rows_tracing(camera: Pinhole, layers: Layers, pixels: np.ndarray, new: bool = False) -> Contender:
    """A bare kernel: rows into rows that are there already, or into new ones, as ours are."""
    numbers, old = packed(camera, layers), np.ones((2, len(pixels), 3))

    def run(_):
        out = np.empty_like(old) if new else old
        bare_rows(pixels.reshape(-1), *numbers, out[0].reshape(-1), out[1].reshape(-1))
        return out

    return Contender("bare kernel, rows, " + ("new arrays" if new else "in place"), run, np.hstack)


def new_rows_tracing(camera: Pinhole, layers: Layers, pixels: np.ndarray) -> Contender:
    """A bare kernel: rows into new rows."""
    return rows_tracing(camera, layers, pixels, new=True)


def memory(camera: Pinhole, layers: Layers, pixels: np.ndarray) -> Contender:
    """The triad over arrays that hold as many bytes together as the rays do."""
    # ones, because memory that was only ever zeroed is not there yet
    a, b, c = np.ones((3, len(pixels) * RAY_BYTES // 24))
    return Contender(MEMORY, lambda _: triad(a, b, c), None)


# Races


@dataclass(frozen=True)
class Entry:
    """One contender: who makes it, through which optic, tracing or projecting, and how far off it may be."""

    maker: Callable
    optic: str
    tracing: bool
    tolerance: float  # mm and direction cosines when tracing, px when projecting


@dataclass(frozen=True, eq=False)
class Result:
    """How a contender fared."""

    name: str
    ours: str  # the name of our contender on the same problem
    error: float  # largest difference from the truth; NaN where nothing was checked
    times: np.ndarray  # (R,) s, each run


def serve(entry: Entry, pipe) -> None:
    """Build a contender and say its name and error, or what is missing; then run it whenever asked."""
    layers = layers_of(entry.optic)
    given, truth = problem(layers, entry.tracing)
    try:
        contender = entry.maker(CAMERA, layers, given)
    except (ImportError, OSError) as error:
        pipe.send((None, f"{entry.maker.__name__}: {error}"))
        return
    result = contender.run(contender.fresh())
    error = np.abs(contender.answer(result) - truth).max() if contender.answer else math.nan
    del result
    pipe.send((contender.name, float(error)))
    while floor := pipe.recv():
        pipe.send(turn(contender, floor))


def turn(contender: Contender, floor: float) -> list[float]:
    """Wall times (s) of runs that last `floor` s together, or of a single run that takes longer."""
    times: list[float] = []
    while sum(times) < floor:
        state = contender.fresh()
        start = time.perf_counter()
        result = contender.run(state)
        times.append(time.perf_counter() - start)
        del result
    return times


def race(entries: Sequence[Entry], rounds: int) -> tuple[list[Result], list[str]]:
    """Let the contenders run in turn, each in its own process; also say who could not take part."""
    context = multiprocessing.get_context("spawn")
    runners, results, missing = [], [], []
    for entry in entries:
        pipe, theirs = context.Pipe()
        process = context.Process(target=serve, args=(entry, theirs), daemon=True)
        process.start()
        theirs.close()
        name, said = pipe.recv()
        if name is None:
            missing.append(said)
        elif said > entry.tolerance:
            raise SystemExit(f"{name} is wrong: off by {said:.3g}, allowed {entry.tolerance:.3g}")
        else:
            ours = OURS if entry.tracing else f"{OURS}, {entry.optic}"
            runners.append((pipe, process, name, ours, said, []))
    for number in range(rounds + 1):
        for pipe, *_, times in runners:
            time.sleep(0.1)  # threads of the one before wait for work, and then give up
            pipe.send(0.05)
            times.extend(pipe.recv() if number else pipe.recv()[:0])  # round 0 warms up
    for pipe, process, name, ours, error, times in runners:
        pipe.send(None)
        process.join()
        results.append(Result(name, ours, error, np.array(times)))
    return results, missing


def report(title: str, results: Sequence[Result], item_bytes: int, bandwidth: float) -> None:
    """Print a race: rates in 1e6/s, our rate over each, share of the bandwidth (bytes/s), largest error."""
    medians = {result.name: np.median(result.times) for result in results}
    rows = []
    for result in sorted(results, key=lambda result: medians[result.name]):
        median, least = medians[result.name], result.times.min()
        ratio = median / medians.get(result.ours, math.nan)
        rate = COUNT / median
        share = 100 * rate * item_bytes / bandwidth
        rows.append([result.name, median * 1e3, least * 1e3, rate / 1e6, ratio, share, f"{result.error:.0e}"])
    table(title, ["", "median ms", "least ms", "1e6/s", "ours / it", "% bandwidth", "error"], rows)


def figures(prefix: str, results: Sequence[Result]) -> dict[str, float]:
    """Rates, and ours over each, under names that carry the unit."""
    medians = {result.name: np.median(result.times) for result in results}
    found = {}
    for result in results:
        key = f"{prefix}_" + re.sub(r"\W+", "_", result.name.lower()).strip("_")
        found[f"{key}_million_per_s"] = COUNT / medians[result.name] / 1e6
        if not result.name.startswith((OURS, "bare")) and result.ours in medians:
            found[f"{key}_ours_over_it_times"] = medians[result.name] / medians[result.ours]
    return found


def race_tracing(rounds: int) -> tuple[dict[str, float], list[str], float]:
    """Race, print and name the figures of tracing; also what is missing, and the bandwidth in bytes/s."""
    makers = [our_tracing, *TRACING, columns_tracing, rows_tracing, new_rows_tracing, memory]
    # 1e-12: some roundings of numbers up to 75 (mm)
    results, missing = race([Entry(maker, "wedge", True, 1e-12) for maker in makers], rounds)
    alone = next(result for result in results if result.name == MEMORY)
    bandwidth = COUNT * RAY_BYTES / np.median(alone.times)
    results.remove(alone)
    report("Tracing a wedge: 1e6 rays", results, RAY_BYTES, bandwidth)
    print(f"{MEMORY}, over as many bytes: {bandwidth / 1e9:.1f} GB/s\n")
    return figures("trace", results), missing, bandwidth


def race_projecting(rounds: int, bandwidth: float) -> tuple[dict[str, float], list[str]]:
    """Race, print and name the figures of projecting; also what is missing."""
    entries = [
        Entry(our_projecting, "wedge", False, 1e-8),
        Entry(numpy_projecting, "wedge", False, 1e-8),
        Entry(our_projecting, "port", False, 1e-8),
        Entry(aquakit_projecting, "port", False, 1e-8),
        Entry(our_projecting, "plate", False, 1e-8),
        Entry(optv_projecting, "plate", False, 1e-3),  # stops when the ray's foot moves by less than 1 um
    ]
    results, missing = race(entries, rounds)
    report("Projecting: 1e6 points", results, POINT_BYTES, bandwidth)
    return figures("project", results), missing


def busy_seconds() -> float:
    """Processor time that all other programs have spent so far; NaN where the system does not tell."""
    try:
        user, nice, system, _, _, *interrupts = Path("/proc/stat").read_text().splitlines()[0].split()[1:8]
    except OSError:
        return math.nan
    spent = sum(map(int, [user, nice, system, *interrupts])) / os.sysconf("SC_CLK_TCK")
    return spent - sum(os.times()[:4])


def main() -> None:
    """Run both races; store their figures when nothing was missing."""
    parser = argparse.ArgumentParser(description="Race ray tracing and projecting against other packages.")
    parser.add_argument("--rounds", type=int, default=7, help="rounds of each race (default 7)")
    parser.add_argument("--dry", action="store_true", help="store nothing")
    chosen = parser.parse_args()
    began, before = time.perf_counter(), busy_seconds()
    traced, missing, bandwidth = race_tracing(chosen.rounds)
    projected, more = race_projecting(chosen.rounds, bandwidth)
    others = 100 * (busy_seconds() - before) / (time.perf_counter() - began)
    print(f"other programs kept {others:.0f} % of a processor busy; above 10 %, measure again\n")
    for reason in dict.fromkeys(missing + more):
        print(f"left out: {reason}")
    if missing or more or chosen.dry:
        print("not stored")
        return
    general = {"memory_triad_gb_per_s": bandwidth / 1e9, "threads_count": THREADS, "others_busy_percent": others}
    write("optics", {**traced, **projected, **general})


if __name__ == "__main__":
    main()
