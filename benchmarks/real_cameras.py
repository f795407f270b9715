"""Calibrating a real camera, against published answers and a renderer's truth.

Zhang's method on Zhang's own five views, on OpenCV's chessboard pairs and on rendered boards; Tsai's method on one
rendered photograph at a time and on two photographs of a corner of chessboards, whose corners are detected anew: the
calibration from 26 hand-picked corners predicts all others, each is looked for there, and the calibration repeated.
"""

import json

import cv2
import numpy as np

from benchmarks.data import data_folder
from benchmarks.results import table, write
from cyclopean import Camera
from cyclopean.calibration.tsai import TsaiCalibration, tsai
from cyclopean.calibration.zhang import CameraCalibration, zhang
from cyclopean.errors import SetupError
from cyclopean.targets import DIRECT, Observations
from cyclopean.targets.boards import PointTarget

LENS = ("fx", "fy", "cx", "cy", "k1", "k2", "p1", "p2", "k3")
NOISE = 0.05  # px, added to exact corners
SQUARE = 20.0  # mm, of the corner's chessboards
PITCH = 0.001096  # mm, of the camera that photographed it


def lens_rows(name: str, found: CameraCalibration, reference: dict[str, float]) -> list[tuple]:
    """Name, parameter, found, standard deviation, reference, difference in standard deviations."""
    rows = []
    for parameter, value, own in zip(LENS, found.camera.lens, found.sigma, strict=True):
        if parameter in reference and own > 0:
            apart = (value - reference[parameter]) / own
            rows.append((name, parameter, f"{value:.5g}", f"{own:.2g}", f"{reference[parameter]:.5g}", f"{apart:+.2f}"))
    return rows


def zhang_views() -> tuple[CameraCalibration, list[tuple], dict[str, float]]:
    """Zhang's five views; his answer, which has a skew of 0.2 px as well."""
    folder = data_folder("real") / "zhang2000"
    model = np.loadtxt(folder / "Model.txt").reshape(-1, 2) * 25.4  # mm
    pixels = [np.loadtxt(folder / f"data{k}.txt").reshape(-1, 2) for k in range(1, 6)]
    count = len(model)
    observations = Observations(
        np.repeat(np.arange(5), count),
        DIRECT,
        np.tile(np.arange(count), 5),
        np.concatenate(pixels),
        tuple(f"CalibIm{k}" for k in range(1, 6)),
    )
    found = zhang(observations, PointTarget(np.column_stack([model, np.zeros(count)])), (640, 480), distortion=2)
    focal_x, _, focal_y, centre_x, centre_y, k1, k2 = np.array(
        (folder / "calibration-result-zhang-withdistortion.txt").read_text().split()[:7], dtype=float
    )
    published = {"fx": focal_x, "fy": focal_y, "cx": centre_x, "cy": centre_y, "k1": k1, "k2": k2}
    figures = {"zhang_rms_px": found.rms}
    for parameter, value, own in zip(LENS, found.camera.lens, found.sigma, strict=True):
        if parameter in published:
            figures[f"zhang_{parameter}_off_sigmas"] = (value - published[parameter]) / own
    return found, lens_rows("Zhang's five views", found, published), figures


def chess_corners(side: str) -> Observations:
    """Chessboard corners (9 x 6) of the photographs of one side, `left` or `right`."""
    files = sorted((data_folder("real") / "opencv_chess_stereo").glob(f"{side}[0-9][0-9].jpg"))
    pixels = []
    for file in files:
        grey = cv2.imread(str(file), cv2.IMREAD_GRAYSCALE)
        seen, corners = cv2.findChessboardCorners(grey, (9, 6))
        if not seen:
            raise RuntimeError(f"no chessboard in {file.name}")
        stop = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_MAX_ITER, 50, 0.001)
        pixels.append(cv2.cornerSubPix(grey, corners, (11, 11), (-1, -1), stop).reshape(-1, 2))
    count = len(files)
    return Observations(
        np.repeat(np.arange(count), 54),
        DIRECT,
        np.tile(np.arange(54), count),
        np.concatenate(pixels),
        tuple(file.name for file in files),
        sigma=0.2,
    )


def chess_pairs() -> tuple[list[tuple], dict[str, float]]:
    """OpenCV's chessboard pairs: left camera against the published one, and the stereo pair."""
    x, y = np.meshgrid(np.arange(9) * 25.0, np.arange(6) * 25.0)
    points = np.stack([x.ravel(), y.ravel(), np.zeros(54)], -1)
    sides = {side: chess_corners(side) for side in ("left", "right")}
    cameras = {side: zhang(seen, PointTarget(points), (640, 480)) for side, seen in sides.items()}
    square = zhang(sides["left"], PointTarget(points), (640, 480), free_aspect=False)
    store = cv2.FileStorage(
        str(data_folder("real") / "opencv_chess_stereo" / "left_intrinsics.yml"), cv2.FILE_STORAGE_READ
    )
    matrix, numbers = store.getNode("camera_matrix").mat(), store.getNode("distortion_coefficients").mat().ravel()
    published = dict(zip(LENS, [matrix[0, 0], matrix[1, 1], matrix[0, 2], matrix[1, 2], *numbers], strict=True))
    pixels = {side: seen.pixels.reshape(-1, 54, 2).astype(np.float32) for side, seen in sides.items()}
    lenses = [
        part for side in sides for part in (cameras[side].camera.matrix, np.array(cameras[side].camera.distortion))
    ]
    solids = [points.astype(np.float32)] * len(pixels["left"])
    stereo = cv2.stereoCalibrate(
        solids, pixels["left"], pixels["right"], *lenses, (640, 480), flags=cv2.CALIB_FIX_INTRINSIC
    )
    figures = {
        "chess_left_rms_px": cameras["left"].rms,
        "chess_right_rms_px": cameras["right"].rms,
        "chess_left_fx_px": cameras["left"].camera.focal[0],
        "chess_right_fx_px": cameras["right"].camera.focal[0],
        "chess_left_f_square_px": square.camera.focal[0],
        "chess_left_f_square_off_sigmas": (square.camera.focal[0] - published["fx"]) / square.sigma[0],
        "chess_stereo_rms_px": stereo[0],
        "chess_stereo_baseline_mm": float(np.linalg.norm(stereo[6])),
    }
    return lens_rows("OpenCV's left camera, one focal length", square, published), figures


def rendered() -> tuple[list[tuple], list[tuple], dict[str, float]]:
    """Twelve rendered boards with noise, by Zhang's method; each of them alone, by Tsai's."""
    folder = data_folder("mitsuba") / "camera_only"
    board = json.loads((folder / "views.json").read_text())["board"]
    across = board["squares_x"] - 1
    x, y = np.meshgrid(np.arange(1, across + 1), np.arange(1, board["squares_y"]))
    points = np.stack([x.ravel(), y.ravel(), np.zeros(x.size)], -1) * board["square"]
    with np.load(folder / "corners.npz") as truth:
        noise = NOISE * np.random.default_rng(0).normal(size=truth["uv"].shape)
        names = tuple(f"view_{k:02}" for k in range(12))
        seen = Observations(truth["view"], DIRECT, truth["corner_id"], truth["uv"] + noise, names, sigma=NOISE)
    found = zhang(seen, PointTarget(points), (1280, 960), distortion=4)
    true = dict(zip(LENS, Camera((1280, 960), 2400.0, (639.5, 479.5)).lens, strict=True))
    off = (found.camera.lens - list(true.values()))[:4]
    figures = {f"rendered_{name}_off_px": value for name, value in zip(LENS, off, strict=False)}
    figures |= {f"rendered_{name}_sigma_px": value for name, value in zip(LENS, found.sigma[:4], strict=False)}
    alone = []
    for photo in range(12):
        mine = seen.photo == photo
        try:
            one = tsai(points[seen.point[mine]], seen.pixels[mine], (1280, 960), distortion=0)
        except SetupError:  # the board faces the camera
            alone.append((names[photo], None, None, None, None))
            continue
        off, sigma = one.camera.focal - 2400, one.sigma["focal"]
        alone.append((names[photo], f"{one.tilt_deg:.1f}", f"{off:+.2f}", f"{sigma:.2f}", f"{off / sigma:+.2f}"))
        figures[f"rendered_tsai_{names[photo]}_focal_off_percent"] = off / 24
    rows = lens_rows(f"rendered, noise {NOISE} px", found, true)
    return rows, alone, figures


def corner_grid() -> np.ndarray:
    """All corners (P, 3) mm that the two walls may have: y up, x along the left wall, -z along the right one."""
    along, up = np.meshgrid(np.arange(1, 13) * SQUARE, np.arange(-11, 6) * SQUARE)
    left = np.stack([along, up, 0 * along], -1).reshape(-1, 3)
    return np.concatenate([left, left[:, [2, 1, 0]] * [1, 1, -1]])


def cube_corners(grey: np.ndarray, found: TsaiCalibration, reach: float) -> tuple[np.ndarray, np.ndarray]:
    """Points (N, 3) mm and pixels (N, 2) of corners that lie within `reach` px of where a calibration predicts them.

    A corner counts where the four squares around it are dark and light crosswise.
    """
    points = corner_grid()
    side = np.where(points[:, :1] > 0, [[1.0, 0.0, 0.0]], [[0.0, 0.0, -1.0]])
    up, away = np.array([0.0, 1.0, 0.0]), 0.3 * SQUARE
    moves = [away * (a * side + b * up) for a, b in ((1, 1), (-1, -1), (1, -1), (-1, 1))]
    predicted, *around = (
        found.camera.project(found.camera_from_target @ (points + move)) for move in (0 * side, *moves)
    )
    inside = np.all((np.array(around) > 40) & (np.array(around) < np.array(grey.shape[::-1]) - 40), axis=(0, 2))
    points, predicted, around = points[inside], predicted[inside], np.array(around, dtype=np.float32)[:, inside]
    smooth = cv2.GaussianBlur(grey, (0, 0), 3).astype(np.float32)
    one, two, three, four = cv2.remap(smooth, around[..., 0], around[..., 1], cv2.INTER_LINEAR)
    contrast = np.abs(one + two - three - four) / 2
    crosswise = (contrast > 35) & (np.maximum(np.abs(one - two), np.abs(three - four)) < contrast / 2)
    points, predicted = points[crosswise], predicted[crosswise]
    stop = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_MAX_ITER, 50, 0.001)
    start = np.array(predicted.reshape(-1, 1, 2), dtype=np.float32, order="C")
    pixels = cv2.cornerSubPix(grey, start, (9, 9), (-1, -1), stop)[:, 0].astype(float)
    near = np.linalg.norm(pixels - predicted, axis=-1) < reach
    return points[near], pixels[near]


CUBE_MODELS = {  # name in the figures: title, options
    "k1": ("k1", {"distortion": 1}),
    "k1k2": ("k1, k2", {"distortion": 2}),
    "centre": ("k1, k2, centre", {"distortion": 2, "free_centre": True}),
    "scale": ("k1, k2, centre, s_x", {"distortion": 2, "free_centre": True, "free_scale": True}),
}


def cube() -> tuple[list[tuple], dict[str, float]]:
    """The corner of chessboards by Tsai's method: hand-picked corners, then all that can be detected."""
    folder = data_folder("real") / "tsai_corner_cube"
    given = np.loadtxt(folder / "points.csv", delimiter=",", usecols=range(7))
    picked = given[:, :3] * [1, 1, -1]  # its frame is left-handed
    size = (3000, 3000)
    seen: dict[str, list] = {"picked": [], "detected": []}
    for name, columns in (("3D_L0933_square.JPG", slice(3, 5)), ("3D_R0548_square.JPG", slice(5, 7))):
        grey = cv2.imread(str(folder / name), cv2.IMREAD_GRAYSCALE)
        seen["picked"].append((picked, given[:, columns]))
        found = tsai(picked, given[:, columns], size, pitch=PITCH, distortion=2)
        for reach in (12.0, 8.0, 6.0, 5.0, 5.0, 5.0):
            corners = cube_corners(grey, found, reach)
            found = tsai(*corners, size, pitch=PITCH, distortion=2, free_centre=True)
        seen["detected"].append(corners)
    rows, figures = [], {}
    for kind, pair in seen.items():
        for key, (title, options) in CUBE_MODELS.items():
            both = [tsai(*corners, size, pitch=PITCH, **options) for corners in pair]
            centres = [one.camera_from_target.inverse.translation for one in both]
            baseline, distance = float(np.linalg.norm(centres[0] - centres[1])), float(np.linalg.norm(centres[0]))
            counts = "/".join(str(len(points)) for points, _ in pair)
            focals = "/".join(f"{one.camera.focal:.3f}" for one in both)
            rms = "/".join(f"{one.rms:.2f}" for one in both)
            rows.append((f"{kind}: {title}", counts, rms, focals, f"{baseline:.1f}", f"{distance:.0f}"))
            figures |= {
                f"cube_{kind}_{key}_left_rms_px": both[0].rms,
                f"cube_{kind}_{key}_right_rms_px": both[1].rms,
                f"cube_{kind}_{key}_baseline_mm": baseline,
                f"cube_{kind}_{key}_distance_mm": distance,
            }
        figures |= {f"cube_{kind}_{side}_corners": len(p) for side, (p, _) in zip(("left", "right"), pair, strict=True)}
    return rows, figures


def main() -> None:
    """Print the tables and keep the figures."""
    five, rows, figures = zhang_views()
    chess, more = chess_pairs()
    boards, alone, most = rendered()
    walls, last = cube()
    figures |= more | most | last
    header = ("photographs", "parameter", "found", "sigma", "reference", "off (sigmas)")
    table(f"Zhang's method (his five views: rms {five.rms:.3f} px)", header, [*rows, *chess, *boards])
    print(
        f"chessboard pairs: rms {figures['chess_left_rms_px']:.4f} and {figures['chess_right_rms_px']:.4f} px, stereo "
        f"{figures['chess_stereo_rms_px']:.4f} px, baseline {figures['chess_stereo_baseline_mm']:.2f} mm"
    )
    table(
        f"Tsai's method, one rendered photograph at a time, noise {NOISE} px, f = 2400 px",
        ("photograph", "tilt (deg)", "f off (px)", "sigma (px)", "off (sigmas)"),
        alone,
    )
    table(
        "Tsai's method, corner of chessboards (nominal: baseline 33 mm, distance 233 mm)",
        ("corners: free", "corners", "rms (px)", "f (mm)", "baseline (mm)", "distance (mm)"),
        walls,
    )
    print(json.dumps({"written": str(write("real_cameras", figures).name)}))


if __name__ == "__main__":
    main()
