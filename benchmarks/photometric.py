"""What aligning the whole print around each corner brings: noise of corners, and of depths measured with them.

Corners before are those that the detector finds, at least 10 px from seams; corners after come from those.
"""

import json
from dataclasses import dataclass, replace

import cv2
import numpy as np

from benchmarks.data import data_folder, renderer_setup
from benchmarks.results import table
from cyclopean import Rig, Setup, triangulate
from cyclopean.calibration.photometric import align, refine
from cyclopean.calibration.physical import calibrate
from cyclopean.geometry import Pose
from cyclopean.targets import DIRECT, Observations
from cyclopean.targets.boards import Board
from cyclopean.targets.detection import observe
from cyclopean.targets.observations import together

SEAM = 10  # px beside seams where corners are not sought
MEASURING = 2.0  # squares, the windows of corners whose depth is measured; 1 for those that calibrate
RIGS = ("t2_b40", "t3_b40", "t4_b45", "n3")
OFF = {"apex_deg": 0.3, "distance": 2.0, "tilt_deg": (1.0, -0.7, 0.5)}  # by how much the start is wrong


@dataclass(frozen=True, eq=False)
class Photographs:
    """A folder of rendered photographs of a board."""

    board: Board
    images: list[np.ndarray]
    poses: list[Pose]  # true
    truth: Observations  # every corner that is seen
    depths: list[float]  # mm, of boards that stand square to the axis; NaN of others


def photographs(name: str) -> Photographs:
    """The photographs of `mitsuba/NAME` with what is known about them."""
    folder = data_folder("mitsuba") / name
    facts = json.loads((folder / "views.json").read_text())
    b = facts["board"]
    board = Board("charuco", b["squares_x"], b["squares_y"], b["square"], b["marker"], b["dictionary"])
    shots = facts["views"]
    images = [cv2.imread(str(folder / shot["file"]), cv2.IMREAD_UNCHANGED) for shot in shots]
    images = [image if image.ndim == 2 else np.ascontiguousarray(image[..., ::-1]) for image in images]
    poses = [Pose(np.array(shot["R_cam_board"]), np.array(shot["t_cam_board"])) for shot in shots]
    with np.load(folder / "corners.npz") as rows:
        names = tuple(f"{name}/{shot['file']}" for shot in shots)
        truth = Observations(rows["view"], rows["facet"], rows["corner_id"], rows["uv"], names)
    return Photographs(board, images, poses, truth, [shot.get("depth_mm", np.nan) for shot in shots])


def detected(shown: Photographs, setup: Setup) -> Observations:
    """Corners that the detector finds at least `SEAM` px from seams."""
    direct = bool((shown.truth.view == DIRECT).all())
    masks = None if direct else setup.rig(margin=SEAM).masks
    found, _ = observe(list(zip(shown.truth.photos, shown.images, strict=True)), shown.board, masks)
    return found


def corner_errors(found: Observations, truth: Observations) -> np.ndarray:
    """Found minus true pixels (N, 2) of the corners in both; corners that the truth does not have are left out."""
    places = {key: row for row, key in enumerate(zip(truth.photo, truth.view, truth.point, strict=True))}
    rows = [places.get(key, -1) for key in zip(found.photo, found.view, found.point, strict=True)]
    known = np.array(rows) >= 0
    return (found.pixels - truth.pixels[rows])[known]


def refined(shown: Photographs, found: Observations, setup: Setup, poses=None, window: float = 1.0) -> Observations:
    """The corners after aligning the print around them; poses are fitted to the corners where not given."""
    poses = calibrate(found, shown.board, setup, free=()).poses if poses is None else poses
    return refine(shown.images, found, shown.board, setup, poses, window=window).observations


def depth_errors(rig: Rig, found: Observations, shown: Photographs) -> np.ndarray:
    """Errors of depth (N,) in percent of corners triangulated from all views that show them."""
    errors = []
    for photo, depth in enumerate(shown.depths):
        mine = found.photo == photo
        pixels = np.full((len(shown.board.points), len(rig), 2), np.nan)
        pixels[found.point[mine], found.view[mine]] = found.pixels[mine]
        errors.append(triangulate(rig, pixels).points[:, 2] / depth - 1)
    errors = 100 * np.concatenate(errors)
    return errors[np.isfinite(errors)]


def board_errors(setup: Setup, shown: Photographs, starts) -> np.ndarray:
    """Errors of depth (N,) in percent of all corners of boards whose pose was found as a whole; NaN where not."""
    errors = []
    for image, depth, start in zip(shown.images, shown.depths, starts, strict=True):
        pose = align(image, shown.board, setup, start).pose
        errors.append((pose @ shown.board.points)[:, 2] / depth - 1)
    return 100 * np.concatenate(errors)


def start_of(setup: Setup) -> Setup:
    """The true setup as a drawing would give it: somewhat wrong."""
    optic = setup.optic
    tilt = tuple(np.add(optic.tilt_deg, OFF["tilt_deg"]))
    wrong = replace(
        optic, apex_deg=optic.apex_deg + OFF["apex_deg"], distance=optic.distance + OFF["distance"], tilt_deg=tilt
    )
    return replace(setup, optic=wrong)


def calibrated(name: str) -> tuple[Setup, Setup]:
    """A setup calibrated from corners before and after, with photographs without and through the optic."""
    truth = renderer_setup(name)
    shown = [photographs("camera_only"), photographs(f"calib_{name}")]
    found = [detected(part, truth) for part in shown]
    boards = [part.board for part in shown]
    before = calibrate(*together(list(zip(found, boards, strict=True))), start_of(truth))
    split = len(shown[0].images)
    poses = [before.poses[:split], before.poses[split:]]
    finer = [refined(*given, before.setup, p) for *given, p in zip(shown, found, poses, strict=True)]
    after = calibrate(*together(list(zip(finer, boards, strict=True))), before.setup)
    return before.setup, after.setup


def rms(values: np.ndarray) -> float:
    """Root of the mean square."""
    return float(np.sqrt(np.mean(np.square(values))))


def corner_row(name: str, setup: Setup, window: float = 1.0) -> dict[str, float]:
    """Noise of the corners of a folder before and after, px rms of a coordinate."""
    shown = photographs(name)
    before = detected(shown, setup)
    after = refined(shown, before, setup, window=window)
    miss = corner_errors(after, shown.truth)
    return {
        "corners": len(before),
        "corners_after": len(after),
        "before_px": rms(corner_errors(before, shown.truth)),
        "after_px": rms(miss),
        "after_largest_px": float(np.abs(miss).max()),
        "after_claimed_px": rms(after.sigma),
    }


def depth_row(name: str) -> dict[str, float]:
    """Errors of depth on boards 600 to 1600 mm away: true or calibrated setup, corners before and after."""
    truth = renderer_setup(name)
    shown = photographs(f"targets_{name}")
    found = detected(shown, truth)
    setups = dict(zip(("before", "after"), calibrated(name), strict=True))
    figures = {"true_before": rms(depth_errors(truth.rig(), found, shown))}
    figures["true_after"] = rms(depth_errors(truth.rig(), refined(shown, found, truth, window=MEASURING), shown))
    figures["calibrated_before"] = rms(depth_errors(setups["before"].rig(), found, shown))
    finer = refined(shown, found, setups["after"], window=MEASURING)
    figures["calibrated_after"] = rms(depth_errors(setups["after"].rig(), finer, shown))
    figures["board_true"] = rms(board_errors(truth, shown, calibrate(found, shown.board, truth, free=()).poses))
    starts = calibrate(found, shown.board, setups["after"], free=()).poses
    figures["board_calibrated"] = rms(board_errors(setups["after"], shown, starts))
    return figures


def main() -> None:
    """Print the tables."""
    folders = [f"{kind}_{name}" for name in RIGS for kind in ("calib", "targets") if name != "n3" or kind == "calib"]
    rows = [
        (f"{folder}, {window:g}", corner_row(folder, renderer_setup(folder.split("_", 1)[1]), window))
        for folder in folders
        for window in (1.0, MEASURING)
    ]
    table(
        "Corners, rms of a coordinate",
        ("photographs, window", "corners", "after", "before (px)", "after (px)", "largest (px)", "claimed (px)"),
        [(folder, r["corners"], r["corners_after"], *(f"{v:.4f}" for v in list(r.values())[2:])) for folder, r in rows],
    )
    depths = [(name, *(f"{value:.4f}" for value in depth_row(name).values())) for name in RIGS if name != "n3"]
    heads = ("rig", "true, before", "true, after", "cal., before", "cal., after", "board, true", "board, cal.")
    table("Depth of corners and of whole boards, rms in percent", heads, depths)


if __name__ == "__main__":
    main()
