"""How well setups calibrate: against the renderer's truth, against what others measured on real photographs, in time.

    python -m benchmarks.calibration [PART ...]

Parts: corners, parameters, camera, one, thesis, photometric, real, speed; all without a name. Figures go to
results/calibration.json, those of the part thesis to results/thesis.json. The start is always a drawing that is off by
0.3 degrees in the facets' angle, 2 mm in distance and about 1.3 degrees in tilt (thesis: see thesis.py); corners are
those that our own detector finds, unless a row says otherwise.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable
from dataclasses import replace
from functools import cache

import cv2
import numpy as np

from benchmarks import mirrors_data, photometric, splitter, thesis
from benchmarks.data import renderer_setup
from benchmarks.results import table, write
from benchmarks.targets import Corners, detected_corners, renderer_corners
from cyclopean import Camera, Setup, triangulate
from cyclopean.calibration import Calibration, calibrate
from cyclopean.calibration.reflected_board import board_from_reflections
from cyclopean.calibration.reflections import mirrors_from_observations
from cyclopean.calibration.tsai import tsai
from cyclopean.geometry import Pose
from cyclopean.rigs import PinholeView, Region
from cyclopean.targets import Board, Observations, together

SETS = ("n2", "n3", "n4", "n5", "n3_pose", "n2_flip", "t2_b40", "t3_b40", "t4_b45")
THESIS = ("t2_b40", "t3_b40", "t4_b45")
USUAL_NOISE = 0.046  # px, of a corner that cv2.cornerSubPix refined on these photographs
CAMERA_TOO = ("camera.focal", "camera.centre", "optic.pose", "optic.apex", "optic.thickness")
REPEATS = 3


def drawn(setup: Setup) -> Setup:
    """The setup as its drawing has it: off in angle, distance and tilt."""
    optic = setup.optic
    tilt = tuple(np.add(optic.tilt_deg, (1.0, -0.7, 0.5)))
    return replace(
        setup, optic=replace(optic, apex_deg=optic.apex_deg + 0.3, distance=optic.distance + 2, tilt_deg=tilt)
    )


def scores(calibration: Calibration, truth: Setup) -> np.ndarray:
    """Error of each free parameter over its stated standard deviation."""
    values = np.concatenate([truth.camera.lens, truth.optic.parameters(truth.wavelength_nm)])
    names = calibration.unknowns.names
    right = np.array([values[truth.parameter_names.index(name)] for name in names])
    return (calibration.solution.shared - right) / np.array([calibration.sigma[name] for name in names])


def rms(values: np.ndarray) -> float:
    """Root mean square without NaN."""
    return float(np.sqrt(np.nanmean(np.square(values))))


def corners_part() -> dict[str, float]:
    """What the detector finds, and how far off."""
    rows, figures = [], {}
    for name in ("camera_only", *(f"calib_{rig}" for rig in SETS), *(f"targets_{rig}" for rig in THESIS)):
        corners = detected_corners(name)
        error = corners.observations.pixels - corners.truth
        score = rms(error / corners.observations.sigma[:, None])
        row = {
            "found_percent": 100 * len(corners.observations) / corners.visible,
            "rms_px": rms(error),
            "largest_px": float(np.nanmax(np.abs(error))),
            "rms_over_stated_sigma": score,
            "wrong": float(np.isnan(error[:, 0]).sum()),
        }
        figures |= {f"corners_{name}_{key}": value for key, value in row.items()}
        rows.append([name, len(corners.observations), *row.values()])
    columns = ["photographs", "corners", "found %", "rms px", "largest px", "rms / stated sigma", "wrong"]
    table(
        "Corners of ChArUco boards in sub-images; found of all that are visible, those cut by seams too", columns, rows
    )
    return figures


def parameters_part() -> dict[str, float]:
    """Parameters of the prism with the camera known, index held and free."""
    rows, figures = [], {}
    for rig in SETS:
        corners, truth = detected_corners(f"calib_{rig}"), renderer_setup(rig)
        start = time.perf_counter()
        found = calibrate(corners.observations, corners.board, drawn(truth))
        seconds = time.perf_counter() - start
        noise = rms(corners.observations.pixels - corners.truth)
        free = calibrate(
            corners.observations,
            corners.board,
            drawn(truth),
            ("optic.pose", "optic.apex", "optic.thickness", "optic.index"),
        )
        row = {
            "noise_px": noise,
            "reprojection_px": found.rms,
            "ratio": found.rms / noise,
            "apex_error_deg": found.setup.optic.apex_deg - truth.optic.apex_deg,
            "apex_sigma_deg": float(np.degrees(found.sigma["optic.apex"])),
            "largest_score": float(np.abs(scores(found, truth)).max()),
            "index_error": free.values["optic.index"] - truth.optic.glass,
            "index_sigma": free.sigma["optic.index"],
            "largest_score_index_free": float(np.abs(scores(free, truth)).max()),
            "largest_score_usual_corners": float(np.abs(scores(_usual(rig), truth)).max()),
            "seconds": seconds,
        }
        figures |= {f"parameters_{rig}_{key}": value for key, value in row.items()}
        rows.append([rig, len(corners.observations.photos), *row.values()])
    columns = ["rig", "photos", "noise px", "fit px", "ratio", "apex error deg", "sigma deg", "max |z|"]
    table("Prism from board photographs, camera known", columns, [row[:8] for row in rows])
    columns = ["rig", "index error", "sigma", "max |z|", "max |z|, corners of 0.046 px, index held", "s"]
    table("The same, index free as well", columns, [[row[0], *row[8:]] for row in rows])
    return figures


def _usual(rig):
    """The same calibration from true corners with the noise that cv2.cornerSubPix leaves."""
    corners = noisy(f"calib_{rig}")
    return calibrate(corners.observations, corners.board, drawn(renderer_setup(rig)))


def joint(rig: str, source: Callable[[str], Corners], free=CAMERA_TOO) -> Calibration:
    """Camera and prism together, from the photographs without and with the prism; focal length 4 % off at the start."""
    truth = renderer_setup(rig)
    bare, through = source("camera_only"), source(f"calib_{rig}")
    observations, target = together([(bare.observations, bare.board), (through.observations, through.board)])
    start = replace(drawn(truth), camera=replace(truth.camera, focal=2300.0, centre=(645.0, 470.0)))  # type: ignore[arg-type]
    return calibrate(observations, target, start, free)


def camera_part() -> dict[str, float]:
    """Camera free as well, with and without photographs that do not look through the prism."""
    rows, figures = [], {}
    for rig in SETS:
        truth = renderer_setup(rig)
        both = joint(rig, detected_corners)
        through = detected_corners(f"calib_{rig}")
        start = replace(drawn(truth), camera=replace(truth.camera, focal=2300.0))
        alone = calibrate(through.observations, through.board, start, CAMERA_TOO)
        row = {
            "focal_error_percent": 100 * (both.setup.camera.focal[0] / 2400 - 1),
            "largest_score": float(np.abs(scores(both, truth)).max()),
            "focal_error_through_prism_only_percent": 100 * (alone.setup.camera.focal[0] / 2400 - 1),
            "focal_sigma_through_prism_only_percent": alone.sigma["camera.focal_x"] / 24,
            "largest_score_through_prism_only": float(np.abs(scores(alone, truth)).max()),
        }
        figures |= {f"camera_{rig}_{key}": value for key, value in row.items()}
        rows.append([rig, *row.values()])
    columns = ["rig", "focal error %", "max |z|", "prism only: focal error %", "sigma %", "max |z|"]
    table("Camera and prism together, start 4 % off in focal length", columns, rows)
    return figures


def one_part() -> dict[str, float]:
    """From each single photograph, with the camera known."""
    rows, figures = [], {}
    for rig in SETS:
        corners, truth = detected_corners(f"calib_{rig}"), renderer_setup(rig)
        errors, worst = [], []
        for photo in range(len(corners.observations.photos)):
            found = calibrate(corners.observations.of_photos([photo]), corners.board, drawn(truth))
            optic = found.setup.optic
            errors.append(
                (
                    abs(optic.apex_deg - truth.optic.apex_deg),
                    abs(optic.distance - truth.optic.distance),
                    np.abs(np.subtract(optic.tilt_deg, truth.optic.tilt_deg)).max(),
                )
            )
            worst.append(np.abs(scores(found, truth)).max())
        median, largest = np.median(errors, axis=0), np.max(errors, axis=0)
        keys = ("apex_deg", "distance_mm", "tilt_deg")
        figures |= {f"one_{rig}_median_{key}": value for key, value in zip(keys, median, strict=True)}
        figures |= {f"one_{rig}_largest_{key}": value for key, value in zip(keys, largest, strict=True)}
        figures[f"one_{rig}_largest_score"] = float(max(worst))
        pairs = (f"{a:.2g} / {b:.2g}" for a, b in zip(median, largest, strict=True))
        rows.append([rig, len(errors), *pairs, float(max(worst))])
    columns = ["rig", "photos", "apex deg", "distance mm", "tilt deg", "max |z|"]
    table("From one photograph alone: median / largest error", columns, rows)
    return figures


@cache
def noisy(name: str) -> Corners:
    """True corners with the noise that cv2.cornerSubPix leaves."""
    return renderer_corners(name, USUAL_NOISE, seed=sum(map(ord, name)))


def thesis_part() -> dict[str, float]:
    """The thesis's tables 4.1, 5.1 and 6.1, which keep their figures in a file of their own."""
    thesis.main(THESIS)
    return {}


def real_part() -> dict[str, float]:
    """Real photographs with mirrors, beside what their authors reached; real cameras alone: real_cameras.py."""
    target, seen, camera = mirrors_data.pycalib_chess()
    board = board_from_reflections(seen, target, camera)
    figures = {
        "real_pycalib_mirror_mean_px": float(np.linalg.norm(board.residuals, axis=-1).mean()),
        "real_pycalib_mirror_published_px": 0.6401,
    }
    target, seen, _, size = mirrors_data.lcm_observations()
    seen = mirrors_data.with_direct(seen)
    optic, camera = mirrors_from_observations(seen, target, size, mirrors_data.LCM_PATHS[:3])
    free = ("camera.focal", "camera.centre", "camera.radial", "optic.mirrors")
    found = calibrate(seen, target, Setup(camera, optic), free)
    left, right = (mirror.axes()[2] for mirror in found.setup.optic.mirrors)
    figures |= {
        "real_lcm_two_mirrors_rms_px": found.rms,
        "real_lcm_two_mirrors_others_px": 0.653,
        "real_lcm_two_mirrors_angle_deg": float(np.degrees(np.arccos(abs(left @ right)))),
    }
    figures |= splitter_figures()
    rows = [
        ["ptv_splitter4: dots named in four views", figures["real_ptv_splitter4_dots"], 229.0],
        ["ptv_splitter4: linear cameras, dots in 3 views or more, mm", figures["real_ptv_splitter4_linear_mm"], 0.20],
        ["ptv_splitter4: Tsai with k1 in each view, mm", figures["real_ptv_splitter4_tsai_mm"], 0.20],
        [
            "ptv_splitter4: the same, fitted to odd, tested on even dots, mm",
            figures["real_ptv_splitter4_test_mm"],
            0.25,
        ],
        ["pycalib_mirror: mean distance px", figures["real_pycalib_mirror_mean_px"], 0.6401],
        ["lcm_two_mirrors: rms px", figures["real_lcm_two_mirrors_rms_px"], 0.653],
        ["lcm_two_mirrors: angle of the mirrors, deg", figures["real_lcm_two_mirrors_angle_deg"], 89.96],
    ]
    table("Real photographs", ["", "ours", "others"], rows)
    return figures


def photometric_part() -> dict[str, float]:
    """What aligning the print itself gains over fitted corners: depth of the thesis's planes."""
    rows, figures = [], {}
    for rig in THESIS:
        row = photometric.depth_row(rig)
        figures |= {f"photometric_{rig}_{key}_rms_percent": value for key, value in row.items()}
        rows.append([rig, *row.values()])
    heads = ["rig", "true, before", "after", "calibrated, before", "after", "whole board, true", "calibrated"]
    table("Photometric alignment: rms error of depth, %", heads, rows)
    return figures


def splitter_figures() -> dict[str, float]:
    """One camera behind a mirror splitter: each view by Tsai's method, then dots of a block triangulated."""
    points, rows = splitter.splitter_observations()
    linear = splitter.linear_figures(points, rows)
    everything = np.ones(len(rows["view"]), dtype=bool)
    odd = rows["point"] % 2 == 1
    return {
        "real_ptv_splitter4_dots": float(len(rows["view"])),
        "real_ptv_splitter4_linear_mm": linear["rms_mm"],
        "real_ptv_splitter4_tsai_mm": _splitter_error(points, rows, everything, everything),
        "real_ptv_splitter4_test_mm": _splitter_error(points, rows, odd, ~odd),
    }


def _splitter_error(points, rows, fitted, tested):
    """Error (mm) of tested dots that three views or more see, with cameras from the fitted ones."""
    views = []
    for number, corner in enumerate(splitter.QUADRANTS):
        mine = fitted & (rows["view"] == number)
        centre = np.add(corner, 255.5)
        given = points[rows["point"][mine]], rows["pixels"][mine], (1024, 1024)
        found = tsai(*given, centre=centre, distortion=1, free_centre=True)
        lens = found.camera.brown((*corner, 512, 512)).camera
        everywhere = Region(np.ones((1024, 1024), dtype=bool), 0.0)
        views.append(PinholeView(lens, found.camera_from_target, everywhere, name=f"view {number}"))
    numbers, row = np.unique(rows["point"][tested], return_inverse=True)
    pixels = np.full((len(numbers), len(views), 2), np.nan)
    pixels[row, rows["view"][tested]] = rows["pixels"][tested]
    three = np.isfinite(pixels[..., 0]).sum(-1) >= 3
    placed = triangulate(views, pixels[three]).points
    return float(np.sqrt(np.nanmean(np.sum((placed - points[numbers[three]]) ** 2, axis=-1))))


def speed_part() -> dict[str, float]:
    """Time against OpenCV on the same corners, and against the number of photographs."""
    corners, truth = detected_corners("calib_n3"), renderer_setup("n3")
    ours = _fastest(lambda: calibrate(corners.observations, corners.board, drawn(truth)))
    camera = _fastest(lambda: calibrate(corners.observations, corners.board, drawn(truth), CAMERA_TOO))
    theirs = _fastest(lambda: _opencv(corners, truth.camera))
    figures = {
        "speed_n3_seconds": ours,
        "speed_n3_camera_too_seconds": camera,
        "speed_n3_opencv_seconds": theirs,
        "speed_n3_opencv_over_ours_times": theirs / ours,
    }
    rows = [["14 photographs x 3 facets", ours, None], ["the same, camera too", camera, None]]
    rows.append(["the same by OpenCV, each facet, then pairs", theirs, None])
    for photos in (10, 100, 280, 1000):
        setup, observations, board = synthetic(photos)
        start = replace(drawn(setup), camera=replace(setup.camera, focal=2350.0))
        free = ("camera.focal", "camera.centre", "optic.pose", "optic.apex", "optic.index")
        calibrate(observations, board, start, free)
        seconds = _fastest(lambda o=observations, s=start, b=board, f=free: calibrate(o, b, s, f), 2)
        figures[f"speed_{photos}_photographs_seconds"] = seconds
        figures[f"speed_{photos}_photographs_residuals"] = 2.0 * len(observations)
        rows.append(
            [
                f"{photos} photographs, {2 * len(observations):,} residuals",
                seconds,
                1e6 * seconds / 2 / len(observations),
            ]
        )
    table("Time of a calibration with covariance, after compilation", ["", "s", "us per residual"], rows)
    return figures


def _fastest(work, repeats=REPEATS):
    times = []
    for _ in range(repeats):
        start = time.perf_counter()
        work()
        times.append(time.perf_counter() - start)
    return float(np.median(times))


def synthetic(photos: int) -> tuple[Setup, Observations, Board]:
    """Photographs of a board of 88 corners through a biprism, 0.1 px of noise and 1 % of gross outliers."""
    setup, board, rng = renderer_setup("n2"), Board("chessboard", 12, 9, 8.0), np.random.default_rng(1)
    rig = setup.rig().unbounded()
    middle, found = board.points.mean(0), []
    while len(found) < photos:
        turn = Pose.from_rotation_vector(rng.normal(0, 0.35, 3)).rotation
        place = np.array([rng.uniform(-20, 20), rng.uniform(-30, 30), rng.uniform(550, 1300)])
        pixels = rig.project(Pose(turn, place - turn @ middle) @ board.points)
        if np.isfinite(pixels).all():
            found.append(pixels)
    pixels = np.stack(found)  # (B, P, V, 2)
    pixels += rng.normal(0, 0.1, pixels.shape)
    wrong = rng.random(pixels.shape[:-1]) < 0.01
    pixels[wrong] += rng.normal(0, 10, (int(wrong.sum()), 2))
    photo, point, view = (grid.ravel() for grid in np.indices(pixels.shape[:-1]))
    names = tuple(map(str, range(photos)))
    return setup, Observations(photo, view, point, pixels.reshape(-1, 2), names, 0.1), board


def _opencv(corners: Corners, camera: Camera) -> None:
    """What a user does today: each facet as a camera of its own, then pairs of them."""
    seen = corners.observations
    lists, lenses = {}, {}
    for view in np.unique(seen.view):
        for photo in range(len(seen.photos)):
            rows = (seen.view == view) & (seen.photo == photo)
            lists[view, photo] = {int(k): p for k, p in zip(seen.point[rows], seen.pixels[rows], strict=True)}
        points, pixels = zip(
            *(_lists(corners.board, lists[view, photo], lists[view, photo]) for photo in range(len(seen.photos))),
            strict=True,
        )
        flags = cv2.CALIB_USE_INTRINSIC_GUESS
        _, matrix, distortion, _, _ = cv2.calibrateCamera(
            points, pixels, camera.size, camera.matrix.copy(), np.zeros(5), flags=flags
        )
        lenses[view] = matrix, distortion
    first, *others = np.unique(seen.view)
    for other in others:
        both = [(lists[first, photo], lists[other, photo]) for photo in range(len(seen.photos))]
        common = [_lists(corners.board, a, b) for a, b in both if len(a.keys() & b.keys()) >= 6]
        back = [_lists(corners.board, b, a) for a, b in both if len(a.keys() & b.keys()) >= 6]
        cv2.stereoCalibrate(
            [c[0] for c in common], [c[1] for c in common], [b[1] for b in back],
            *lenses[first], *lenses[other], camera.size, flags=cv2.CALIB_FIX_INTRINSIC,
        )  # fmt: skip


def _lists(board, mine, other):
    keys = sorted(mine.keys() & other.keys())
    return board.points[keys].astype(np.float32), np.array([mine[k] for k in keys], dtype=np.float32)


PARTS = {
    "corners": corners_part,
    "parameters": parameters_part,
    "camera": camera_part,
    "one": one_part,
    "thesis": thesis_part,
    "photometric": photometric_part,
    "real": real_part,
    "speed": speed_part,
}


if __name__ == "__main__":
    for part in sys.argv[1:] or PARTS:
        write("calibration", PARTS[part]())
