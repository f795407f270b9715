"""Tolerances of a three-facet prism by 10,000 exact draws: time, first order, and real calibrations as a check.

python -m benchmarks.tolerances [draws]
"""

import sys
import time
from dataclasses import replace

import numpy as np
from scipy.stats import chi2

from benchmarks.results import table, write
from cyclopean import read_setup
from cyclopean.analysis.tolerance_calibration import observe, usual_plan
from cyclopean.analysis.tolerances import tolerance_analysis
from cyclopean.calibration import calibrate
from cyclopean.jobs.reconstruction import DEMO
from cyclopean.triangulation import triangulate

CHECKED = 20  # draws whose calibration is really carried out


def main(draws=10_000):
    setup = read_setup(DEMO / "setup.toml")
    plan = usual_plan(setup, setup.depths)
    with_camera = usual_plan(setup, setup.depths, direct_photos=6)
    tolerance_analysis(setup, draws=300, plan=plan)  # compiles
    started = time.perf_counter()
    through = tolerance_analysis(setup, draws=draws, plan=plan)
    seconds = time.perf_counter() - started
    both = tolerance_analysis(setup, draws=draws, plan=with_camera)
    samples = {"before": through.before, "after": through.after, "after, 6 photos without optic": both.after}
    rows = []
    for name, sample in samples.items():
        quantiles = 100 * sample.quantiles() / sample.depths[:, None]
        for k in (0, 2, 4):
            ratio = sample.sigma[k] / sample.linear_sigma[k]
            rows.append((name, f"{sample.depths[k]:g}", *map(float, quantiles[k]), float(ratio)))
    columns = ("setups", "depth mm", "50 % (% of depth)", "68 %", "95 %", "99 %", "sigma / first order")
    table(f"{draws:,} setups, {len(through.before.points)} points, 3 views: {seconds:.1f} s", columns, rows)
    figures = {
        "prism3_draws": draws,
        "prism3_points": len(through.before.points),
        "prism3_time_s": seconds,
        "prism3_before_sigma_over_first_order": float(through.before.sigma[2] / through.before.linear_sigma[2]),
    }
    for name, sample in zip(("before", "after", "after_with_camera_photos"), samples.values(), strict=True):
        figures[f"prism3_{name}_95_percent_at_990mm_percent"] = 100 * sample.quantiles([0.95])[2, 0] / sample.depths[2]
    for name, analysis in (("after", through), ("after_with_camera_photos", both)):
        figures |= {f"prism3_{name}_{key}": value for key, value in checked(setup, analysis).items()}
    write("tolerances", figures)


def checked(setup, analysis):
    """Real calibrations of the first draws beside what was foretold for each of them."""
    left, names = analysis.remainder, analysis.remainder.found.names
    told = {name: t.sigma for name, t in analysis.tolerances.items() if name in names and t.sigma > 0}
    points = analysis.before.points
    drawing = np.concatenate([setup.camera.lens, setup.optic.parameters(setup.wavelength_nm)])
    errors = []
    for k in range(CHECKED):
        values = drawing + left.toleranced.matrix[0] @ analysis.deviations[k]
        optic = replace(setup.optic, radius=None).with_parameters(values[9:])
        real = replace(setup, camera=setup.camera.with_lens(values[:9]), optic=optic)
        seen = observe(real, analysis.plan, np.random.default_rng([7, k]))
        poses = analysis.plan.all_poses
        found = calibrate(seen, analysis.plan.target, setup, names, tolerances=told, poses=poses).setup
        depth = triangulate(found.rig().unbounded(), real.rig().project(points)).points[:, 2]
        errors.append(depth - points[:, 2])
    errors = np.array(errors)
    foretold = analysis.after.linear
    real_rms, expected = (
        float(np.sqrt(np.nanmean(part**2))) for part in (errors, np.broadcast_to(foretold, errors.shape))
    )
    middle = int(np.argmin(np.linalg.norm(points - points.mean(0), axis=-1)))
    square = float(np.nansum((errors[:, middle] / foretold[middle]) ** 2))
    print(
        f"{CHECKED} real calibrations: depth errors of {real_rms:.3f} mm rms where {expected:.3f} mm are foretold; "
        f"chi-square of the middle point {square:.1f} for {CHECKED} (95 % within "
        f"{chi2.ppf(0.025, CHECKED):.1f} to {chi2.ppf(0.975, CHECKED):.1f})"
    )
    return {"real_rms_mm": real_rms, "foretold_rms_mm": expected, "chi_square_of_20": square}


if __name__ == "__main__":
    main(*map(int, sys.argv[1:]))
