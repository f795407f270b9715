"""How exactly the optics agree with an independent renderer, and with OpenCV.

For every rig of the renderer: all corners of its calibration and target photographs are projected through their
facet with the true parameters and compared with the renderer's own pixels, and the facet of every pixel with the
renderer's. The renderer traces rays from pixels; we solve for the pixel of a point.
"""

import json

import cv2
import numpy as np

from benchmarks.data import data_folder, renderer_setup
from benchmarks.results import table, write
from cyclopean import Camera

SETS = {
    "n2": ["calib_n2"],
    "n3": ["calib_n3"],
    "n4": ["calib_n4"],
    "n5": ["calib_n5"],
    "n3_pose": ["calib_n3_pose"],
    "n2_flip": ["calib_n2_flip"],
    "t2_b40": ["calib_t2_b40", "targets_t2_b40"],
    "t3_b40": ["calib_t3_b40", "targets_t3_b40"],
    "t4_b45": ["calib_t4_b45", "targets_t4_b45"],
}


def rig_row(name: str) -> tuple:
    """Rig, corners, corners missed, rms and largest error in px, pixels whose facet agrees in percent."""
    rig = renderer_setup(name).rig()
    errors = []
    for folder in SETS[name]:
        with np.load(data_folder("mitsuba") / folder / "corners.npz") as truth:
            for k, view in enumerate(rig):
                mine = truth["facet"] == k
                miss = view.project(truth["xyz_cam"][mine]) - truth["uv"][mine]
                errors.append(np.linalg.norm(miss, axis=1))
    errors = np.concatenate(errors)
    missed = int(np.isnan(errors).sum())
    with np.load(data_folder("mitsuba") / "rigs" / f"{name}_facets.npz") as truth:
        agree = 100 * float((rig.facets == truth["facet"]).mean())
    return name, len(errors), missed, float(np.sqrt(np.nanmean(errors**2))), float(np.nanmax(errors)), agree


def camera_errors() -> tuple[float, float]:
    """Largest difference (px) from cv2.projectPoints, and of undistorting what it projected."""
    rng = np.random.default_rng(0)
    camera = Camera((1280, 960), (1000.0, 1010.0), (640.0, 470.0), (-0.2, 0.05, 1e-3, -2e-3, 0.01))
    points = np.column_stack([rng.uniform(-0.6, 0.6, (10_000, 2)), np.ones(10_000)]) * rng.uniform(
        100, 2000, (10_000, 1)
    )
    theirs = cv2.projectPoints(points, np.zeros(3), np.zeros(3), camera.matrix, np.array(camera.distortion))[0][:, 0]
    back = camera.normalise(theirs) - points[:, :2] / points[:, 2:]
    return float(np.abs(camera.project(points) - theirs).max()), float(np.abs(back * camera.focal).max())


def main() -> None:
    """Print the tables and keep the figures."""
    rows = [rig_row(name) for name in SETS]
    table(
        "Against the renderer, true parameters",
        ("rig", "corners", "missed", "rms (px)", "largest (px)", "facets agree (%)"),
        [(*row[:3], f"{row[3]:.1e}", f"{row[4]:.1e}", f"{row[5]:.3f}") for row in rows],
    )
    forward, backward = camera_errors()
    print(f"camera against OpenCV: projecting {forward:.1e} px, undistorting {backward:.1e} px")
    figures = {"camera_project_largest_px": forward, "camera_undistort_largest_px": backward}
    for name, corners, missed, rms, largest, agree in rows:
        figures |= {
            f"{name}_corners": corners,
            f"{name}_missed": missed,
            f"{name}_rms_px": rms,
            f"{name}_largest_px": largest,
            f"{name}_facets_agree_percent": agree,
        }
    print(json.dumps({"written": str(write("accuracy", figures).name)}))


if __name__ == "__main__":
    main()
