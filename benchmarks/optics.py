"""How fast we trace rays and project points through glass, beside other packages, in one run.

    python benchmarks/optics.py

Tracing: 1e6 pixels of one view of a biprism (10 degrees, index 1.5168) become rays behind the glass; the
others start from unit vectors. Projecting: 1e6 points become pixels, through the same glass or, for packages
that only know surfaces that face the camera, through a flat port of water or a plate. Float64, two threads,
the contenders in turn over several rounds, medians of wall times; every answer is checked first. Results are
stored in results/optics.json, but only when every package is here, best in an environment of their own:

    pip install batoid optiland torch optv && pip install --no-deps aquakit
"""

import os

THREADS = 2
for variable in ("OMP_NUM_THREADS", "NUMBA_NUM_THREADS"):  # read when the packages are imported
    os.environ[variable] = str(THREADS)

import argparse  # noqa: E402
import math  # noqa: E402
import re  # noqa: E402
import time  # noqa: E402
from collections.abc import Callable, Sequence  # noqa: E402
from pathlib import Path  # noqa: E402

import numpy as np  # noqa: E402
from numba import njit, prange  # noqa: E402
from peers import (  # noqa: E402
    TRACING,
    Contender,
    Layers,
    Pinhole,
    aquakit_projecting,
    installed,
    numpy_projecting,
    optv_projecting,
    trace,
)
from results import table, write  # noqa: E402

APEX_DEG, INDEX, WATER, DISTANCE, THICKNESS = 10.0, 1.5168, 1.333, 60.0, 10.0
CAMERA = Pinhole(focal=(2400.0, 2400.0), centre=(639.5, 479.5), size=(1280, 960))
RAY_BYTES, POINT_BYTES = 16 + 48, 24 + 16  # float64: pixel in, point and direction out; point in, pixel out
COUNT = 1_000_000
OURS = "cyclopean"
FAST = {"error_model": "numpy", "fastmath": {"reassoc", "contract", "arcp", "nsz"}}


# Problems


def wedge() -> Layers:
    """The flat face of the biprism and its facet towards +x, which passes through the apex."""
    apex = np.radians(APEX_DEG)
    points = np.array([[0.0, 0.0, DISTANCE], [0.0, 0.0, DISTANCE + THICKNESS]])
    normals = np.array([[0.0, 0.0, 1.0], [np.sin(apex), 0.0, np.cos(apex)]])
    return Layers(points, normals, (1.0, INDEX, 1.0))


def facing(heights: Sequence[float], indices: tuple[float, ...]) -> Layers:
    """Planes that face the camera at these distances (mm)."""
    points = np.array([[0.0, 0.0, height] for height in heights])
    return Layers(points, np.tile([0.0, 0.0, 1.0], (len(heights), 1)), indices)


def seen(layers: Layers, pixels: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Points (N, 3) that these pixels see, 500 to 1500 mm behind the layers."""
    exits, directions = trace(layers, CAMERA.directions(pixels))
    return exits + rng.uniform(500, 1500, (len(pixels), 1)) * directions


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


def our_tracing(pixels: np.ndarray) -> Contender:
    """`view.rays`, from pixels."""
    view = our_view("wedge")
    return Contender(OURS, lambda _: view.rays(pixels), lambda rays: np.hstack([rays.origins, rays.directions]))


def our_projecting(optic: str, points: np.ndarray) -> Contender:
    """`view.project`."""
    view = our_view(optic)
    return Contender(f"{OURS}, {optic}", lambda _: view.project(points), np.asarray)


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


def ceilings(layers: Layers, pixels: np.ndarray) -> list[Contender]:
    """Bare kernels: columns into old arrays, rows into old arrays, rows into new ones."""
    camera = np.array([*CAMERA.focal, *CAMERA.centre])
    ratios = [layers.indices[0] / layers.indices[1], layers.indices[1] / layers.indices[2]]
    offsets = np.sum(layers.points * layers.normals, axis=1)
    planes = np.column_stack([layers.normals, offsets, ratios])
    columns, old = np.zeros((6, len(pixels))), np.zeros((2, len(pixels), 3))
    x, y = np.ascontiguousarray(pixels.T)

    def run_columns(_):
        bare_columns(x, y, camera, planes, columns)
        return columns

    def run_rows(out):
        bare_rows(pixels.reshape(-1), camera, planes, out[0].reshape(-1), out[1].reshape(-1))
        return out

    return [
        Contender("bare kernel, columns, in place", run_columns, np.transpose),
        Contender("bare kernel, rows, in place", run_rows, np.hstack, lambda: old),
        Contender("bare kernel, rows, new arrays", lambda _: run_rows(np.empty_like(old)), np.hstack),
    ]


def memory(count: int) -> Contender:
    """The triad over arrays that hold as many bytes together as the rays do."""
    a, b, c = np.ones((3, count * RAY_BYTES // 24))  # ones: memory that was only ever zeroed is not there yet
    return Contender("memory alone (triad)", lambda _: triad(a, b, c), np.asarray)


# Races


def race(contenders: Sequence[Contender], rounds: int, floor: float = 0.05) -> dict[str, np.ndarray]:
    """Wall times (s) of each contender by name: in turn, `rounds` times, each time for `floor` s or once."""
    times = {contender.name: [] for contender in contenders}
    for number in range(rounds + 1):
        for contender in contenders:
            time.sleep(0.1)  # threads of the one before wait for work, and then give up
            spent = 0.0
            while spent < floor:
                state = contender.fresh()
                start = time.perf_counter()
                result = contender.run(state)
                took = time.perf_counter() - start
                del result
                spent += took
                if number:  # round 0 compiles and warms up
                    times[contender.name].append(took)
    return {name: np.array(values) for name, values in times.items()}


def busy_seconds() -> float:
    """Processor time that everything on this machine has spent so far; NaN where the system does not tell."""
    try:
        user, nice, system, _, _, *interrupts = Path("/proc/stat").read_text().splitlines()[0].split()[1:8]
    except OSError:
        return math.nan
    return sum(map(int, [user, nice, system, *interrupts])) / os.sysconf("SC_CLK_TCK")


def check(contender: Contender, truth: np.ndarray, tolerance: float) -> float:
    """Largest difference between a contender's answer and the truth; too large a one ends the benchmark."""
    answer = contender.answer(contender.run(contender.fresh()))
    worst = float(np.abs(answer - truth).max())
    if not worst <= tolerance:
        raise SystemExit(f"{contender.name} is wrong: off by {worst:.3g}, allowed {tolerance:.3g}")
    return worst


def report(title: str, times: dict, errors: dict, ours: Callable, item_bytes: int, bandwidth: float) -> None:
    """Print the race: rates in 1e6/s, our rate over each, share of the bandwidth, largest error."""
    rows = []
    for name in sorted(times, key=lambda name: np.median(times[name])):
        median, least = np.median(times[name]), times[name].min()
        ratio = median / np.median(times[ours(name)]) if ours(name) in times else math.nan
        rate = COUNT / median
        share = 100 * rate * item_bytes / bandwidth
        rows.append([name, median * 1e3, least * 1e3, rate / 1e6, ratio, share, f"{errors[name]:.0e}"])
    columns = ["", "median ms", "least ms", "1e6/s", "ours / it", "% bandwidth", "error"]
    table(title, columns, rows)


def figures(prefix: str, times: dict, ours: Callable[[str], str]) -> dict[str, float]:
    """Rates, and ours over each, with names that carry the unit."""
    found = {}
    for name, values in times.items():
        key = f"{prefix}_" + re.sub(r"\W+", "_", name.lower()).strip("_")
        found[f"{key}_million_per_s"] = COUNT / np.median(values) / 1e6
        if not name.startswith((OURS, "bare")) and ours(name) in times:
            found[f"{key}_ours_over_it_times"] = np.median(values) / np.median(times[ours(name)])
    return found


def race_tracing(rounds: int, rng: np.random.Generator) -> tuple[dict, list[str], float]:
    """Race, print and name the figures of tracing; also what is missing, and the bandwidth in bytes/s."""
    layers = wedge()
    pixels = rng.uniform([660, 0], [1279, 959], (COUNT, 2))  # well inside the view
    contenders, missing = installed(TRACING, layers, CAMERA.directions(pixels))
    own, absent = installed([our_tracing], pixels)
    contenders = own + contenders + ceilings(layers, pixels)
    truth = np.hstack(trace(layers, CAMERA.directions(pixels)))
    # 1e-12: some roundings of numbers up to 75 (mm)
    errors = {contender.name: check(contender, truth, 1e-12) for contender in contenders}
    alone = memory(COUNT)
    times = race([*contenders, alone], rounds)
    bandwidth = COUNT * RAY_BYTES / np.median(times.pop(alone.name))
    report("Tracing a wedge: 1e6 rays", times, errors, lambda _: OURS, RAY_BYTES, bandwidth)
    print(f"memory alone (triad over as many bytes): {bandwidth / 1e9:.1f} GB/s\n")
    return figures("trace", times, lambda _: OURS), missing + absent, bandwidth


def race_projecting(rounds: int, rng: np.random.Generator, bandwidth: float) -> tuple[dict, list[str]]:
    """Race, print and name the figures of projecting; also what is missing."""
    pixels = rng.uniform([660, 0], [1279, 959], (COUNT, 2))
    glass = {
        "wedge": (wedge(), [numpy_projecting]),
        "port": (facing([DISTANCE], (1.0, WATER)), [aquakit_projecting]),
        "plate": (facing([DISTANCE, DISTANCE + THICKNESS], (1.0, INDEX, 1.0)), [optv_projecting]),
    }
    contenders, missing, errors, ours = [], [], {}, {}
    for optic, (layers, makers) in glass.items():
        points = seen(layers, pixels, rng)  # a closed form: the pixels came first
        others, absent = installed(makers, CAMERA, layers, points)
        own, unable = installed([our_projecting], optic, points)
        for contender in own + others:
            # px; optv stops when the foot of the ray moves by less than 1 um
            errors[contender.name] = check(contender, pixels, 1e-3 if "optv" in contender.name else 1e-8)
            ours[contender.name] = f"{OURS}, {optic}"
        contenders += own + others
        missing += absent + unable
    times = race(contenders, rounds)
    report("Projecting: 1e6 points", times, errors, ours.get, POINT_BYTES, bandwidth)
    return figures("project", times, ours.get), missing


def main() -> None:
    """Run both races; store their figures when nothing was missing."""
    parser = argparse.ArgumentParser(description="Race ray tracing and projecting against other packages.")
    parser.add_argument("--rounds", type=int, default=7, help="rounds of each race (default 7)")
    parser.add_argument("--dry", action="store_true", help="store nothing")
    chosen = parser.parse_args()
    rng = np.random.default_rng(1)
    began, before = time.perf_counter(), busy_seconds() - time.process_time()
    traced, missing, bandwidth = race_tracing(chosen.rounds, rng)
    projected, more = race_projecting(chosen.rounds, rng, bandwidth)
    others = 100 * (busy_seconds() - time.process_time() - before) / (time.perf_counter() - began)
    print(f"other programs kept {others:.0f} % of a processor busy; above 10 %, measure again\n")
    for reason in dict.fromkeys(missing + more):
        print(f"left out: {reason}")
    if missing or more or chosen.dry:
        print("not stored")
        return
    general = {
        "memory_triad_gb_per_s": bandwidth / 1e9,
        "threads_count": THREADS,
        "others_busy_percent": others,
    }
    write("optics", {**traced, **projected, **general})


if __name__ == "__main__":
    main()
