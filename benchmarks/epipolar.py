"""Epipolar curves against the renderer's true correspondences, straight lines against curves, ways to triangulate.

    python -m benchmarks.epipolar

prints tables and keeps their figures in results/epipolar.json.
"""

from __future__ import annotations

import time

import numpy as np

from benchmarks.data import data_folder, renderer_setup
from benchmarks.results import table, write
from cyclopean.epipolar import distance_to_curves, epipolar_curves, line_departures
from cyclopean.rigs import fit, pinhole_rig
from cyclopean.triangulation import midpoint, nearest_to_rays, optimal, triangulate

SCENES = ("n2_round", "n3_steps", "n3_pose_steps", "n4_round", "n5_bumpy")
RIGS = dict.fromkeys(("n2", "n3", "n4", "n5"), (600.0, 1500.0))
RIGS |= dict.fromkeys(("t2_b40", "t3_b40", "t4_b45"), (600.0, 1600.0))
_DRAWS = 20_000


def correspondences() -> dict[str, float]:
    """How far the true partners of pixels are off their curves."""
    figures, rows = {}, []
    for scene in SCENES:
        truth = np.load(data_folder("mitsuba") / "scenes" / f"{scene}.npz")
        rig, pixels, points = renderer_setup(scene.rsplit("_", 1)[0]).rig(), truth["match_uv"], truth["match_xyz"]
        depths = 0.95 * float(np.nanmin(points[:, 2])), 1.05 * float(np.nanmax(points[:, 2]))
        worst, off, count, lost = 0.0, 0.0, 0, 0
        for k in range(len(rig)):
            known = np.isfinite(pixels[:, k, 0])
            distance, inverse = distance_to_curves(epipolar_curves(rig, k, pixels[known, k], depths), pixels[known])
            others = np.isfinite(pixels[known, :, 0]) & (np.arange(len(rig)) != k)
            worst = max(worst, float(np.nanmax(np.abs(distance))))
            off = max(off, float(np.nanmax(np.abs(1 / inverse - points[known, 2:])[others])))
            count, lost = count + others.sum(), lost + (np.isnan(distance) & others).sum()
        rows.append((scene, f"{count:,}", int(lost), worst, off))
        figures |= {f"distance_{scene}_max_px": worst, f"depth_{scene}_max_mm": off}
    columns = ("scene", "pairs", "lost", "distance from curve, max (px)", "depth of the foot off, max (mm)")
    table("True partners and their curves (the file's pixels are good to 6e-5 px)", columns, rows)
    return figures


def departures() -> dict[str, float]:
    """How far straight lines of several kinds are off the curves."""
    figures, rows = {}, []
    for name, depths in RIGS.items():
        rig = renderer_setup(name).rig()
        plain = list(line_departures(rig, depths).values())
        bent = list(line_departures(rig, depths, [fit(view, depths) for view in rig]).values())
        row = [name, f"{depths[0]:g} to {depths[1]:g}"]
        for label, found, kind in (
            ("pinholes", plain, "virtual"), ("distorted_pinholes", bent, "virtual"), ("matrix", plain, "best"),
            ("own_line", plain, "straight"),
        ):  # fmt: skip
            rms = float(np.sqrt(np.mean([getattr(one, f"{kind}_rms") ** 2 for one in found])))
            largest = max(getattr(one, f"{kind}_max") for one in found)
            row.append(f"{rms:.3f}, {largest:.2f}")
            figures |= {f"line_{name}_{label}_rms_px": rms, f"line_{name}_{label}_max_px": largest}
        rows.append(row)
    columns = ("rig", "depths (mm)", "two pinholes", "with distortion", "fitted matrix", "line of its own")
    table("Straight lines less true curves: rms, max (px), worst pair of views", columns, rows)
    return figures


def speed() -> dict[str, float]:
    """Pixels a second, with curves and bands in four other views; and candidates a second."""
    rig = renderer_setup("n5").rig()
    pixels = rig[0].region.centre + np.random.default_rng(0).uniform(-50, 50, (5000, 2))
    others = np.random.default_rng(1).uniform(0, 900, (200_000, 5, 2))
    curves = epipolar_curves(rig, 0, pixels, (600, 1500))
    one = epipolar_curves(rig, 0, pixels[0], (600, 1500))
    distance_to_curves(one, others[:10])
    best = []
    for job in (lambda: epipolar_curves(rig, 0, pixels, (600, 1500)), lambda: distance_to_curves(one, others)):
        times = []
        for _ in range(3):
            start = time.perf_counter()
            job()
            times.append(time.perf_counter() - start)
        best.append(min(times))
    figures = {
        "curves_pixels_per_s": len(pixels) / best[0],
        "samples_mpoints_per_s": curves.pixels[:, 1:, :, 0].size / best[0] / 1e6,
        "candidates_mdistances_per_s": others.shape[0] * 4 / best[1] / 1e6,
    }
    table("Speed, 5 views, 65 samples", ("figure", "value"), figures.items())
    return figures


def methods() -> dict[str, float]:
    """Bias and spread of depth by each way to triangulate, by sampled noise."""
    figures, rows, rng = {}, [], np.random.default_rng(2)
    for name, depth, sigma in (("t2_b40", 1200.0, 0.1), ("t2_b40", 1200.0, 0.5), ("n2", 1200.0, 0.1)):
        rig = renderer_setup(name).rig().unbounded()
        point = np.array([10.0, -20.0, depth])
        pixels = rig.project(point) + rng.normal(0, sigma, (_DRAWS, 2, 2))
        cameras = [fit(view, RIGS[name]) for view in renderer_setup(name).rig()]
        pinholes = pinhole_rig(cameras, renderer_setup(name).rig()).unbounded()
        for label, found in (
            ("midpoint", midpoint(rig, pixels, sigma)),
            ("nearest_to_rays", nearest_to_rays(rig, pixels, sigma)),
            ("triangulate", triangulate(rig, pixels, sigma)),
            ("optimal, virtual cameras", optimal(cameras, pixels, sigma)),
            ("triangulate, virtual cameras", triangulate(pinholes, pixels, sigma)),
        ):
            z = found.points[:, 2]
            bias, spread = float(z.mean() - depth), float(z.std())
            stated = float(np.sqrt(np.median(found.covariance[:, 2, 2])))
            error = spread / np.sqrt(_DRAWS)
            rows.append((f"{name}, {sigma:g} px", label, f"{bias:.3f} +- {error:.3f}", spread, stated))
            short = f"{name}_{sigma:g}_{label.replace(', ', '_').replace(' ', '_')}"
            figures |= {f"depth_{short}_bias_mm": bias, f"depth_{short}_spread_mm": spread}
    columns = ("rig, noise", "method", "bias of depth (mm)", "spread (mm)", "stated (mm)")
    table(f"A point at 1200 mm, {_DRAWS:,} draws of noise", columns, rows)
    return figures


if __name__ == "__main__":
    write("epipolar", correspondences() | departures() | speed() | methods())
