"""From a drawing to depths and back to the truth: simulate, calibrate, reconstruct, and judge the errors.

The true prism differs from its drawing by what a workshop usually leaves. Photographs of a board calibrate it,
photographs of a relief are reconstructed, and the errors are compared with what calibration and matching foretell.
"""

from dataclasses import replace
from itertools import count

import numpy as np

from cyclopean import Board, Camera, calibrate, observe, reconstruct
from cyclopean.analysis import standard_tolerances, usual_plan
from cyclopean.analysis.chi_square import calibration_chi_square, calibration_shifts, chi_square
from cyclopean.calibration.unknowns import Unknowns
from cyclopean.experiments import standard_setup
from cyclopean.geometry import Pose
from cyclopean.simulation import Scene, render, trace_truth
from cyclopean.simulation.paints import Noise, Speckle
from cyclopean.simulation.prints import board_surface
from cyclopean.simulation.sensor import Sensor
from cyclopean.simulation.shapes import heightmap
from cyclopean.targets import Observations

FACETS, DEPTHS = (2, 3, 4, 5), (750.0, 1250.0)
CAMERA = Camera((400, 300), 750.0)
BOARD = Board("charuco", columns=10, rows=8, square=20.0, marker=15.0, dictionary="DICT_5X5_100")
SENSOR = Sensor(full_well_electrons=10_000, read_noise_electrons=5, exposure=1.0, blur_sigma=0.5)

x, y = np.meshgrid(np.linspace(-4, 4, 60), np.linspace(-4, 4, 60))
hills = heightmap(12 * np.sin(x) * np.cos(0.8 * y), 800.0, 800.0)
leaning = Pose.from_rotation_vector([0.1, -0.2, 0.0], (0.0, 0.0, 1000.0))
# as laboratories spray it, and as nature has it; 4 px wide in the middle
reliefs = [Scene((hills.painted(paint, leaning),)) for paint in (Speckle(5.3), Noise(5.3))]
seeds = count()  # every photograph has rays and noise of its own


def photograph(setup, scene, samples, with_optic=True):
    """What the camera takes of a scene."""
    seed = next(seeds)
    return SENSOR.expose(render(setup, scene, samples=samples, with_optic=with_optic, seed=seed), seed)


def photographs(setup, poses, with_optic):
    """Photographs of the board, with a name each."""
    scenes = [Scene((board_surface(BOARD, pose),), background=(0.15,)) for pose in poses]
    return [(f"{with_optic} {k}", photograph(setup, one, 4, with_optic)) for k, one in enumerate(scenes)]


without = None  # corners in photographs without the optic: the camera is the same for all prisms
for facets in FACETS:
    true = replace(standard_setup(facets, camera=CAMERA), depths=DEPTHS)
    tolerances = standard_tolerances(true)
    known = Unknowns.of([true], tuple(tolerances), tolerances)
    drawing = known.setup(known.start + np.random.default_rng(facets).normal(0, known.spread))

    # calibrate from photographs of a board, beginning with the drawing; the second look has the right sub-images
    plan = usual_plan(true, DEPTHS, BOARD, photos=4, direct_photos=2)
    without = without or observe(photographs(true, plan.direct_poses, False), BOARD, None)[0]
    through, setup = photographs(true, plan.poses, True), drawing
    for _ in range(2):
        corners = Observations.join([observe(through, BOARD, setup.rig().masks)[0], without])
        calibration = calibrate(corners, BOARD, drawing, known.names, tolerances=tolerances)
        setup = calibration.setup

    # reconstruct by the calibrated setup, and look what is true at pixels that have nothing in common
    errors, sigma, together = [], [], []
    for relief in reliefs:
        found = reconstruct(photograph(true, relief, 16), setup.rig(), DEPTHS)
        truth = trace_truth(true, relief)
        columns, rows = found.pixels[(found.pixels % 16 == 0).all(-1)].T
        same = found.view[rows, columns] == truth.facet[rows, columns]
        rows, columns = rows[same], columns[same]
        errors.append(found.depth[rows, columns] - truth.depth[rows, columns])
        sigma.append(found.sigma[rows, columns].astype(float))
        together.append(calibration_shifts(calibration, truth.points[rows, columns])[:, 2:])
    errors, sigma, together = (np.concatenate(parts) for parts in (errors, sigma, together))
    judged = chi_square(errors[:, None], (sigma**2)[:, None, None], together)
    low, high = judged.interval()
    print(
        f"{facets} facets: depth +- {np.median(sigma):.2f} mm by matching and "
        f"{np.nanmedian(np.linalg.norm(together[:, 0], axis=-1)):.2f} mm by the calibration, "
        f"found {np.percentile(np.abs(errors), 68):.2f} mm; chi-square / freedom: "
        f"depths {judged.reduced:.2f} of {judged.freedom} (by chance {low:.2f} to {high:.2f}), "
        f"calibration {calibration_chi_square(calibration, true).reduced:.2f} of {len(known.names)}"
    )
