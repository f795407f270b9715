"""How well virtual cameras tell depth: sketched, put right by a field point, calibrated, or fitted to true rays.

On the renderer's rigs with long baselines: calibrated from the corners of six photographs of a board, judged by the
corners of boards at 600 to 1600 mm, in percent of depth. Corners are the renderer's with noise as a detector leaves,
and only those that OpenCV's detector finds, or all that are seen. Depth is z in the real camera's frame, and
photographs of boards tell a rig only up to a rigid motion: rows hold for a rig aligned to the drawing (`aligned`, by
its centres), then for one aligned to the drawing's scene, then to the true corners of the calibration photographs,
which no user has.
"""

import json
import sys
import time
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cache
from itertools import combinations
from pathlib import Path
from typing import NamedTuple

import cv2
import numpy as np

from benchmarks.data import data_folder, renderer_setup
from benchmarks.results import table
from cyclopean import Rig, Setup, triangulate
from cyclopean.calibration.field_point import field_point_test, separation, two_depths
from cyclopean.calibration.virtual import calibrate_pairwise, calibrate_virtual
from cyclopean.calibration.virtual_frame import aligned
from cyclopean.geometry import Pose, rigid_motion
from cyclopean.rigs import fit, pinhole_rig, sketch
from cyclopean.targets import Observations

RIGS = ("t2_b40", "t3_b40", "t4_b45")
SIGMA = 0.046  # px, of a corner that OpenCV's cornerSubPix refined, on these photographs
DEPTHS = (600.0, 1600.0)  # mm, of the boards to judge by
CALIBRATED = (620.0, 1310.0)  # mm, that the calibration photographs cover
FIELD_POINT = 1000.0  # mm


@dataclass(frozen=True, eq=False)
class Board:
    """A known target."""

    points: np.ndarray  # (P, 3) mm


@dataclass(frozen=True, eq=False)
class Corners:
    """Corners of a set of photographs as a detector would give them, and the truth."""

    observations: Observations
    truth: np.ndarray  # (N, 3) mm, of each observation
    board: Board

    def together(self, views: int) -> tuple[np.ndarray, np.ndarray]:
        """Pixels (P, V, 2) and points (P, 3) of the corners that two views see."""
        seen = self.observations
        keys, row = np.unique(seen.photo * 10_000 + seen.point, return_inverse=True)
        pixels, truth = np.full((len(keys), views, 2), np.nan), np.empty((len(keys), 3))
        pixels[row, seen.view], truth[row] = seen.pixels, self.truth
        two = np.isfinite(pixels[..., 0]).sum(-1) >= 2
        return pixels[two], truth[two]


class Errors(NamedTuple):
    """Error of depth in percent: root mean square and largest, over all pairs of views and of all views at once."""

    pairs_rms: float
    pairs_max: float
    all_rms: float
    all_max: float


def corners(folder: str, seed: int = 0, only_found: bool = True) -> Corners:
    """Corners of a set such as `calib_t2_b40`, with noise of SIGMA px."""
    place = data_folder("mitsuba") / folder
    facts = json.loads((place / "views.json").read_text())["board"]
    x, y = np.meshgrid(np.arange(1, facts["squares_x"]), np.arange(1, facts["squares_y"]))
    board = Board(np.stack([x, y, 0 * x], -1).reshape(-1, 3) * float(facts["square"]))
    with np.load(place / "corners.npz") as c:
        pixels = c["uv"] + np.random.default_rng(seed).normal(0, SIGMA, c["uv"].shape)
        names = tuple(f"{k:02d}" for k in range(c["view"].max() + 1))
        seen = Observations(c["view"], c["facet"], c["corner_id"], pixels, names, SIGMA)
        truth = c["xyz_cam"]
    rows = found(place) if only_found else np.ones(len(seen), dtype=bool)
    return Corners(seen.select(rows), truth[rows], board)


@cache
def found(place: Path) -> np.ndarray:
    """Which rows (N,) of `corners.npz` OpenCV's detector finds, each facet looked at alone.

    It wants the markers around a corner whole, so that corners next to seams are missing.
    """
    facts = json.loads((place / "views.json").read_text())
    board = facts["board"]
    dictionary = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, board["dictionary"]))
    shape = board["squares_x"], board["squares_y"]
    detector = cv2.aruco.CharucoDetector(cv2.aruco.CharucoBoard(shape, board["square"], board["marker"], dictionary))
    with np.load(place.parent / "rigs" / f"{facts['rig']}_facets.npz") as masks:
        facets = masks["facet"]
    with np.load(place / "corners.npz") as c:
        keys = list(zip(c["view"].tolist(), c["facet"].tolist(), c["corner_id"].tolist(), strict=True))
    seen = set()
    for k, view in enumerate(facts["views"]):
        picture = cv2.imread(str(place / view["file"]), cv2.IMREAD_GRAYSCALE)
        for facet in range(facets.max() + 1):
            ids = detector.detectBoard(np.where(facets == facet, picture, 0).astype(np.uint8))[1]
            seen |= {(k, facet, int(number)) for number in np.ravel([] if ids is None else ids)}
    return np.array([key in seen for key in keys])


def depth_errors(rig: Rig, judged: Corners, motion: Pose | None = None) -> Errors:
    """Errors of depth of corners that a rig triangulates, after a rigid motion into the camera's frame."""
    pixels, truth = judged.together(len(rig))
    views, every = rig.unbounded(), range(len(rig))

    def errors(numbers):
        both = np.isfinite(pixels[:, numbers, 0]).sum(-1) >= 2
        points = triangulate([views[k] for k in numbers], pixels[both][:, numbers]).points
        points = points if motion is None else motion @ points
        return 100 * (points[:, 2] / truth[both, 2] - 1)

    pairs = np.concatenate([errors(list(pair)) for pair in combinations(every, 2)])
    full = errors(list(every))
    return Errors(*(f(e) for e in (pairs, full) for f in (_rms, lambda e: float(np.nanmax(np.abs(e))))))


def _rms(error):
    return float(np.sqrt(np.nanmean(np.square(error))))


class Row(NamedTuple):
    """One approach: its name, seconds, rms of the residuals (px), and errors in up to three frames."""

    name: str
    seconds: float
    residual: float
    errors: tuple[Errors, ...]  # by the drawing's centres (or as it is), by its scene, by true corners


def calibrated_rows(setup: Setup, seen: Corners, judged: Corners) -> Iterator[Row]:
    """Route 2: pinholes calibrated together, in every combination, and in the two classical steps."""
    nominal = setup.rig()
    _ = nominal.masks, [view.region.outline for view in nominal]  # traced before the clock starts
    given = seen.observations, seen.board, setup.camera, nominal
    runs = [
        (
            f"joint, {kind}, {terms} terms",
            lambda kind=kind, terms=terms: calibrate_virtual(*given, kind, terms),
        )
        for kind in ("fixed", "tied", "free")
        for terms in (0, 2, 4, 5)
    ]
    runs.append(("each alone, then pairs, 4", lambda: calibrate_pairwise(*given)))
    pixels, truth = seen.together(len(nominal))
    for name, run in runs:
        start = time.perf_counter()
        result = run()
        seconds = time.perf_counter() - start
        scene = aligned(result.rig, nominal, "scene", CALIBRATED)
        best = rigid_motion(triangulate(result.rig.unbounded(), pixels).points, truth)
        frames = (None, scene, best)
        yield Row(
            name + ("" if result.converged else " (not converged)"),
            seconds,
            _rms(result.residuals),
            tuple(depth_errors(result.rig, judged, motion) for motion in frames),
        )


BOUNDARIES = {  # of sketches; which one a person draws is open
    "middle ray to the rim": "middle",
    "ray to the corner": "edge",
    "mid sub-image ray": None,
}


def sketched_rows(setup: Setup, judged: Corners) -> Iterator[Row]:
    """Routes 1 and 3: ray sketches, alone and put right by a corner at FIELD_POINT mm; the best fit; true rays."""
    nominal = setup.rig()
    pixels, depth = field_point(judged, len(nominal))
    for name, boundary in BOUNDARIES.items():
        rims = [boundary] * len(nominal) if boundary else [view.region.centre for view in nominal]
        start = time.perf_counter()
        rig = pinhole_rig([sketch(view, DEPTHS, rim) for view, rim in zip(nominal, rims, strict=True)], nominal)
        seconds = time.perf_counter() - start
        yield Row(f"sketch, {name}", seconds, np.nan, (depth_errors(rig, judged),))
        for parameter in ("apex", "distance"):
            start = time.perf_counter()
            result = field_point_test(setup, pixels, depth, parameter, boundary=boundary or rims, sigma_px=SIGMA)
            seconds = time.perf_counter() - start
            yield Row(f"  field point: {parameter}", seconds, np.nan, (depth_errors(result.rig, judged),))
    start = time.perf_counter()
    rig = pinhole_rig([fit(view, DEPTHS) for view in nominal], nominal)
    yield Row("best pinhole fit, 4 terms", time.perf_counter() - start, np.nan, (depth_errors(rig, judged),))
    yield Row("true rays, true parameters", np.nan, np.nan, (depth_errors(nominal, judged),))


def field_point(judged: Corners, views: int) -> tuple[np.ndarray, float]:
    """Pixels (V, 2) and depth of the corner at FIELD_POINT mm that all views see and that is nearest to the axis."""
    pixels, truth = judged.together(views)
    there = np.flatnonzero(np.isfinite(pixels[..., 0]).all(-1) & (np.abs(truth[:, 2] - FIELD_POINT) < 1))
    best = there[np.argmin(np.hypot(*truth[there, :2].T))]
    return pixels[best], float(truth[best, 2])


def two_depth_errors(judged: Corners) -> tuple[float, float, float]:
    """A biprism's law of depth from corners near the axis at 600 and 1500 mm: rms and largest error (%), and rms
    within 30 mm of the axis."""
    pixels, truth = judged.together(2)
    apart, off = separation(pixels), np.hypot(*truth[:, :2].T)
    chosen = []
    for depth in (600, 1500):
        there = np.flatnonzero(np.abs(truth[:, 2] - depth) < 1)
        chosen.append(there[np.argmin(off[there])])
    error = 100 * (two_depths(apart[chosen], truth[chosen, 2]).depth(apart) / truth[:, 2] - 1)
    return _rms(error), float(np.abs(error).max()), _rms(error[off < 30])


def drawn_wrong(setup: Setup, rng: np.random.Generator) -> Setup:
    """The setup as drawn by someone who knows it within usual tolerances.

    Standard deviations: apex angle 3 arc minutes, index 5e-4, distance 1 mm, focal length 0.1 %.
    """
    apex, index, distance, focal = rng.normal(size=4) * [0.05, 5e-4, 1.0, 1e-3]
    optic = replace(
        setup.optic,
        apex_deg=setup.optic.apex_deg + apex,
        glass=float(setup.optic.glass) + index,
        distance=setup.optic.distance + distance,
    )
    camera = replace(setup.camera, focal=tuple(f * (1 + focal) for f in setup.camera.focal))
    return replace(setup, optic=optic, camera=camera)


def tolerance_rows(setup: Setup, seen: Corners, judged: Corners, draws: int = 12) -> list[tuple[str, float]]:
    """Rms error of depth (%, all views) over drawings that are wrong by `drawn_wrong`, of what is done with them."""
    pixels, depth = field_point(judged, len(setup.rig()))
    joint = calibrate_virtual(seen.observations, seen.board, setup.camera, setup.rig().masks, "free", 4)
    rng, sums = np.random.default_rng(5), {}
    for _ in range(draws):
        drawing = drawn_wrong(setup, rng)
        nominal = drawing.rig()
        tried = {"true rays of the drawing": (nominal, None)}
        for parameter in ("apex", "distance", "index"):
            tested = field_point_test(drawing, pixels, depth, parameter, "rays", sigma_px=SIGMA)
            tried[f"true rays, field point: {parameter}"] = (tested.rig, None)
        for by in ("centres", "scene"):
            tried[f"joint pinholes, frame by the drawing's {by}"] = (
                joint.rig,
                aligned(joint.rig, nominal, by, CALIBRATED),
            )
        for name, (rig, motion) in tried.items():
            sums.setdefault(name, []).append(depth_errors(rig, judged, motion).all_rms)
    return [(name, float(np.sqrt(np.mean(np.square(errors))))) for name, errors in sums.items()]


def main(names: tuple[str, ...], only_found: bool = True) -> None:
    """Print the tables of some rigs."""
    for name in names:
        setup = renderer_setup(name)
        seen = corners(f"calib_{name}", 0, only_found)
        judged = corners(f"targets_{name}", 1, only_found)
        rows = [*calibrated_rows(setup, seen, judged), *sketched_rows(setup, judged)]
        table(
            f"{name}: rms / largest error, % of depth; corners {'found' if only_found else 'seen'}; aligned by "
            "the drawing's centres, by its scene (all views), to true corners",
            ["approach", "s", "px", "pairs", "all", "scene", "pairs, true", "all, true"],
            [_cells(row) for row in rows],
        )
        if len(setup.rig()) == 2:
            print(
                "two depths: rms {:.2f} %, largest {:.2f} %, rms near the axis {:.2f} %".format(
                    *two_depth_errors(judged)
                )
            )
        table(
            f"{name}: drawings wrong by usual tolerances", ["", "rms, % of depth"], tolerance_rows(setup, seen, judged)
        )


def _cells(row):
    texts = [f"{e.pairs_rms:.2f}/{e.pairs_max:.1f} {e.all_rms:.2f}/{e.all_max:.1f}".split() for e in row.errors]
    scene, true = (texts[1][1], texts[2]) if len(texts) == 3 else (None, [None, None])
    seconds, residual = (None if x != x else f"{x:.2f}" for x in (row.seconds, row.residual))
    return row.name, seconds, residual, *texts[0], scene, *true


if __name__ == "__main__":
    main(tuple(name for name in sys.argv[1:] if name in RIGS) or RIGS, "--all" not in sys.argv)
