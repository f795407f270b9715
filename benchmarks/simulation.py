"""Rays a second of simulated photographs, and of Mitsuba 3 on the same scene where it is installed.

    python -m benchmarks.simulation [--quick]

The scene is a relief of so many triangles with a picture on it, luminous where nothing else is said, seen at 1280 x 960
px through a prism of n facets. A row changes one thing of the base case: 100,000 triangles, 16 samples a pixel, n = 3,
a pinhole. A ray is a primary one, from the camera: made, bent, intersected, looked up on the picture and added to its
pixel; the time is that of the whole call of `render`, Embree's tree, checks and all. Processor time is that of all
threads together; it is disturbed least by other programs.

Mitsuba gets the same triangles, picture and prism, the prism as a closed mesh of smooth dielectric, and its `path`
integrator; a sample is one of its camera paths, some 4 % of which are reflected at a face of the glass and thrown away
here. Its variants run in processes of their own: where one cannot run, its row is missing. `llvm_ad_rgb` wants the
LLVM library, which the environment variable DRJIT_LIBLLVM_PATH may name; the time of its first, compiling, call is
not counted, nor is the first call of ours. The difference is that of the mean light of its picture and ours.

Tables are printed, figures go to `results/simulation.json`. With --quick the pictures have a quarter of the pixels,
and nothing is stored.
"""

import argparse
import itertools
import json
import sys
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numba
import numpy as np

from benchmarks import timing
from benchmarks.results import table, write
from cyclopean import Camera, Prism, Setup
from cyclopean.geometry import Pose
from cyclopean.optics import prism_solid
from cyclopean.simulation import Lamp, Scene, Surface, render, trace_truth
from cyclopean.simulation.paints import Picture
from cyclopean.simulation.shapes import heightmap

VARIANTS = ("scalar_rgb", "llvm_ad_rgb")
DEPTH, WIDTH, HEIGHT, RELIEF = 1000.0, 700.0, 560.0, 30.0  # mm
REPEATS, ENOUGH = 3, 12.0  # repeats; seconds after which no other one begins


@dataclass(frozen=True)
class Case:
    """What is rendered."""

    name: str
    triangles: int = 100_000
    samples: int = 16
    facets: int = 3
    open_aperture: bool = False
    lamps: int = 0
    distorted: bool = False
    colour: bool = False


CASES = (
    Case("base"),
    Case("1k_triangles", triangles=1_000),
    Case("10k_triangles", triangles=10_000),
    Case("1m_triangles", triangles=1_000_000),
    Case("1_sample", samples=1),
    Case("1m_triangles_1_sample", triangles=1_000_000, samples=1),
    Case("n2", facets=2),
    Case("n4", facets=4),
    Case("n5", facets=5),
    Case("open_aperture", open_aperture=True),
    Case("n5_open_aperture", facets=5, open_aperture=True),
    Case("distorted_lens", distorted=True),
    Case("lamp_with_shadows", lamps=1),
    Case("colour", colour=True),
)


def setup_of(case: Case, quick: bool) -> Setup:
    """Camera and prism of a case."""
    scale = 2 if quick else 1
    distortion = (0.1, -0.05, 1e-3, -2e-3, 0.02) if case.distorted else (0.0,) * 5
    camera = Camera((1280 // scale, 960 // scale), 2400 / scale, None, distortion, 0.0055 * scale)
    setup = Setup(camera, Prism(case.facets, 12.0, "N-BK7", 60.0, radius=30.0))
    return replace(setup, f_number=5.6, focus_distance=DEPTH) if case.open_aperture else setup


def relief(triangles: int, luminous: bool) -> Surface:
    """So many triangles with a picture stretched over them."""
    cells = max(2, round((triangles / 2) ** 0.5))
    x, y = np.meshgrid(np.linspace(-0.5, 0.5, cells + 1) * WIDTH, np.linspace(-0.5, 0.5, cells + 1) * HEIGHT)
    shape = heightmap(-RELIEF * np.sin(x / 30) * np.cos(y / 40), WIDTH, HEIGHT)
    pose = Pose(np.eye(3), np.array([0.0, 0.0, DEPTH]))
    return shape.painted(Picture(texture()), pose, stretched=True, name="relief", luminous=luminous)


def texture() -> np.ndarray:
    """A picture (1024, 1024) float32 of random grey levels, some px wide."""
    coarse = np.random.default_rng(0).uniform(0.1, 0.9, (256, 256))
    return np.kron(coarse, np.ones((4, 4))).astype(np.float32)


def scene_of(case: Case) -> Scene:
    """The scene of a case."""
    lamps = tuple(Lamp(position=(-300.0, -400.0, 0.0), strength=0.6) for _ in range(case.lamps))
    return Scene((relief(case.triangles, luminous=not lamps),), ambient=0.4 if lamps else 1.0, lamps=lamps)


def measure(case: Case, quick: bool) -> dict[str, float]:
    """Rays a second of a case, in millions, by the clock and by the processors' time; and their number."""
    setup, scene = setup_of(case, quick), scene_of(case)  # a copy of the scene has no tree yet
    options = {"samples": case.samples, "colour": case.colour}
    render(replace(setup, camera=Camera((64, 48), 120, pixel_pitch=0.1)), scene, **{**options, "samples": 1})
    clock, processor = timing.median_times(lambda: render(setup, replace(scene), **options), REPEATS, ENOUGH)
    rays = setup.camera.size[0] * setup.camera.size[1] * case.samples * (3 if case.colour else 1) / 1e6
    return {"rays": rays, "clock": rays / clock, "processor": rays / processor, "seconds": clock}


def measure_truth(quick: bool) -> dict[str, float]:
    """Millions of pixels a second of `trace_truth`, and of points of its matches, in the base case."""
    setup, scene = setup_of(CASES[0], quick), scene_of(CASES[0])
    truth = trace_truth(setup, scene)
    truth.matches(100)
    pixels = setup.camera.size[0] * setup.camera.size[1] / 1e6
    traced = timing.median_seconds(lambda: trace_truth(setup, replace(scene)), REPEATS)
    matched = timing.median_seconds(lambda: truth.matches(20_000), REPEATS)
    return {"truth_mpixels_per_s": pixels / traced, "matches_mpoints_per_s": 0.02 / matched}


def measure_mitsuba(variant: str, quick: bool) -> dict[str, float]:
    """Camera paths a second of Mitsuba in the base case, in millions, and the mean light of its picture."""
    import mitsuba as mi

    mi.set_variant(variant)
    samples = 2 if variant.startswith("scalar") else 16
    with tempfile.TemporaryDirectory() as folder:
        scene = mi.load_dict(_mitsuba_scene(mi, setup_of(CASES[0], quick), Path(folder), samples))
    np.array(mi.render(scene, spp=1))
    seeds = itertools.count(1)

    def photograph():
        return np.array(mi.render(scene, spp=samples, seed=next(seeds)))

    clock, processor = timing.median_times(photograph, REPEATS)
    picture = photograph()
    rays = picture.shape[0] * picture.shape[1] * samples / 1e6
    mean = float(picture.mean())
    return {"rays": rays, "clock": rays / clock, "processor": rays / processor, "seconds": clock, "mean": mean}


def _mitsuba_scene(mi, setup, folder, samples):
    """The base case as Mitsuba takes it."""
    surface = relief(CASES[0].triangles, luminous=True)
    solid = prism_solid(setup.optic)
    corners = solid.in_rig()
    write_ply(folder / "relief.ply", surface.vertices, surface.faces, surface.places)
    write_ply(folder / "prism.ply", corners, solid.triangles, np.zeros((len(corners), 2)))
    width, height = setup.camera.size
    picture = mi.Bitmap(np.repeat(texture()[:, :, None], 3, axis=-1))
    index = float(setup.optic.parameters(setup.wavelength_nm)[-1])
    angle = float(np.degrees(2 * np.arctan(width / 2 / setup.camera.focal[0])))
    toward = mi.ScalarTransform4f().look_at([0, 0, 0], [0, 0, 1], [0, -1, 0])
    return {
        "type": "scene",
        "integrator": {"type": "path", "max_depth": 6},
        "sensor": {
            "type": "perspective", "fov_axis": "x", "fov": angle,
            "near_clip": 1.0, "far_clip": 1e5, "to_world": toward,
            "film": {"type": "hdrfilm", "width": width, "height": height, "rfilter": {"type": "box"}},
            "sampler": {"type": "independent", "sample_count": samples},
        },
        "prism": {
            "type": "ply", "filename": str(folder / "prism.ply"), "face_normals": True,
            "bsdf": {"type": "dielectric", "int_ior": index, "ext_ior": 1.0},
        },
        "relief": {
            "type": "ply", "filename": str(folder / "relief.ply"), "face_normals": True,
            "bsdf": {"type": "diffuse", "reflectance": {"type": "rgb", "value": 0.0}},
            "emitter": {"type": "area", "radiance": {"type": "bitmap", "bitmap": picture, "raw": True}},
        },
    }  # fmt: skip


def write_ply(path: Path, vertices: np.ndarray, faces: np.ndarray, places: np.ndarray) -> None:
    """Write triangles with places on a picture, in the form that Mitsuba reads."""
    rows = np.column_stack([vertices, places]).astype("<f4")
    triangles = np.empty(len(faces), dtype=[("count", "u1"), ("corners", "<i4", 3)])
    triangles["count"], triangles["corners"] = 3, faces
    names = "".join(f"property float {name}\n" for name in ("x", "y", "z", "u", "v"))
    header = (
        f"ply\nformat binary_little_endian 1.0\nelement vertex {len(rows)}\n{names}"
        f"element face {len(faces)}\nproperty list uchar int vertex_indices\nend_header\n"
    )
    path.write_bytes(header.encode() + rows.tobytes() + triangles.tobytes())


def main(words: Sequence[str] | None = None) -> None:
    """Measure, print and store."""
    parser = argparse.ArgumentParser(description="Rays a second of simulated photographs.")
    parser.add_argument("--quick", action="store_true")
    parser.add_argument("--mitsuba", choices=VARIANTS, help=argparse.SUPPRESS)
    parser.add_argument("--alone", action="store_true", help=argparse.SUPPRESS)
    given = parser.parse_args(words)
    if given.mitsuba or given.alone:
        print(
            json.dumps(measure_mitsuba(given.mitsuba, given.quick) if given.mitsuba else measure(CASES[0], given.quick))
        )
        return
    threads = numba.get_num_threads()
    quick = ["--quick"] if given.quick else []
    found = {case.name: measure(case, given.quick) for case in CASES}
    found["base_one_thread"] = timing.apart("simulation", ["--alone", *quick], 1)
    theirs = {variant: _mitsuba(variant, quick, threads) for variant in VARIANTS}
    truth = measure_truth(given.quick)
    rows = [(name, f["rays"], f["seconds"], f["clock"], f["processor"]) for name, f in found.items()]
    rows += [
        (f"Mitsuba {name}", f["rays"], f["seconds"], f["clock"], f["processor"]) for name, f in theirs.items() if f
    ]
    columns = ("case", "M rays", "s", "M rays / s", "M rays / processor s")
    table(f"Simulated photographs, {threads} threads", columns, rows)
    table("Truth, base case", ("M pixels / s", "M matches / s"), [tuple(truth.values())])
    figures = {f"{name}_{kind}_mrays_per_s": f[kind] for name, f in found.items() for kind in ("clock", "processor")}
    light = render(setup_of(CASES[0], given.quick), scene_of(CASES[0]), samples=4).mean()
    for name, f in theirs.items():
        if f:
            figures |= {f"mitsuba_{name}_{kind}_msamples_per_s": f[kind] for kind in ("clock", "processor")}
            figures[f"mitsuba_{name}_mean_difference_percent"] = 100 * (f["mean"] / light - 1)
            print(f"Mitsuba {name}: mean light {100 * (f['mean'] / light - 1):+.2f} % of ours")
    if not given.quick:
        write("simulation", figures | truth)


def _mitsuba(variant, quick, threads):
    """Figures of one of Mitsuba's variants; nothing where it cannot run."""
    try:
        return timing.apart("simulation", ["--mitsuba", variant, *quick], threads)
    except RuntimeError as error:
        reason = str(error).strip().splitlines()[-1]
        print(f"Mitsuba's {variant} does not run here: {reason}", file=sys.stderr)
        return {}


if __name__ == "__main__":
    main()
