"""Chi-square against sums by hand, samples drawn from a covariance, and calibrations drawn from a drawing."""

from dataclasses import replace

import numpy as np
import pytest

from cyclopean import Camera, Prism, Setup, calibrate, error_budget, triangulate
from cyclopean.analysis import standard_tolerances, usual_plan
from cyclopean.analysis.chi_square import (
    ChiSquare,
    calibration_chi_square,
    calibration_shifts,
    chi_square,
    pooled,
)
from cyclopean.analysis.tolerance_calibration import observe
from cyclopean.calibration.unknowns import Unknowns
from cyclopean.errors import MeasurementError, ShapeError

REAL = Setup(Camera((640, 480), 1200), Prism(3, 12, 1.5168, 60, azimuth_deg=90), depths=(600.0, 1000.0))


def calibrated(seed):
    """A calibration from corners with noise of a setup whose drawing errs by the usual tolerances."""
    rng = np.random.default_rng(seed)
    tolerances = standard_tolerances(REAL)
    known = Unknowns.of([REAL], tuple(tolerances), tolerances)
    drawing = known.setup(known.start + rng.normal(0, known.spread))
    plan = usual_plan(REAL, REAL.depths, photos=6, direct_photos=4, sigma=0.02)
    return calibrate(observe(REAL, plan, rng), plan.target, drawing, known.names, tolerances=tolerances)


@pytest.fixture(scope="module")
def calibrations():
    return [calibrated(seed) for seed in range(8)]


def random_covariance(rng, *shape):
    root = rng.normal(size=(*shape, shape[-1]))
    return root @ np.swapaxes(root, -1, -2) + 0.1 * np.eye(shape[-1])


def test_a_shared_part_is_what_the_whole_matrix_gives():
    rng = np.random.default_rng(1)
    errors, blocks, shared = rng.normal(size=(7, 3)), random_covariance(rng, 7, 3), rng.normal(size=(7, 3, 4))
    whole = shared.reshape(21, 4) @ shared.reshape(21, 4).T
    for k in range(7):
        whole[3 * k : 3 * k + 3, 3 * k : 3 * k + 3] += blocks[k]
    by_hand = errors.ravel() @ np.linalg.solve(whole, errors.ravel())
    found = chi_square(errors, blocks, shared)
    assert found.freedom == 21
    assert found.value == pytest.approx(by_hand, rel=1e-10)  # 21 x 21 with condition numbers below 1e4


def test_units_do_not_matter():
    rng = np.random.default_rng(2)
    errors, blocks, shared = rng.normal(size=(5, 3)), random_covariance(rng, 5, 3), rng.normal(size=(5, 3, 2))
    change = rng.normal(size=(3, 3))
    turned = chi_square(errors @ change.T, change @ blocks @ change.T, change @ shared)
    assert turned.value == pytest.approx(chi_square(errors, blocks, shared).value, rel=1e-8)  # roundings, as above


def test_samples_of_the_stated_covariance_lie_in_the_interval_as_often_as_it_says():
    rng = np.random.default_rng(3)
    blocks, shared = random_covariance(rng, 6, 3), 3 * rng.normal(size=(6, 3, 2))
    roots = np.linalg.cholesky(blocks)
    found = []
    for _ in range(400):
        own = (roots @ rng.normal(size=(6, 3, 1)))[..., 0]
        found.append(chi_square(own + shared @ rng.normal(size=2), blocks, shared))
    low, high = found[0].interval(0.8)
    inside = np.mean([low < one.reduced < high for one in found])
    assert inside == pytest.approx(0.8, abs=0.08)  # 4 standard deviations of a share of 400: 4 x 0.02
    together = pooled(found)
    assert together.freedom == 400 * 18
    assert together.reduced == pytest.approx(1, abs=4 * np.sqrt(2 / together.freedom))
    # neglecting what is shared is told
    assert chi_square(own + shared @ [2.0, -2.0], blocks).reduced > 3


def test_rows_without_numbers_are_left_out():
    errors, variances = np.array([[1.0], [np.nan], [3.0], [2.0]]), np.array([1.0, 1.0, 9.0, np.nan])
    found = chi_square(errors, variances[:, None, None])
    assert found == ChiSquare(2.0, 2)
    assert found.reduced == 1
    assert found.probability == pytest.approx(np.exp(-1))  # two degrees of freedom: exp(-value / 2)


@pytest.mark.parametrize(
    ("errors", "covariance", "shared", "error", "words"),
    [
        (np.ones(3), np.ones(3), None, ShapeError, "last axis of 1"),
        (np.ones((3, 1)), np.ones((3, 1, 1)), np.ones((2, 1, 4)), ShapeError, "shared"),
        (np.full((3, 1), np.nan), np.ones((3, 1, 1)), None, MeasurementError, "nothing to judge"),
        (np.ones((3, 1)), np.zeros((3, 1, 1)), None, MeasurementError, "positive definite"),
        (np.ones((1, 2)), np.array([[[1.0, 0.5], [0.0, 1.0]]]), None, MeasurementError, "symmetric"),
    ],
)
def test_wrong_calls_are_told(errors, covariance, shared, error, words):
    with pytest.raises(error, match=words):
        chi_square(errors, covariance, shared)


def test_calibrations_err_as_they_say(calibrations):
    judged = pooled(calibration_chi_square(one, REAL) for one in calibrations)
    assert judged.freedom == 8 * 23
    # 184 degrees of freedom: standard deviation sqrt(2 / 184) = 0.10; 0.3 is three of them
    assert judged.reduced == pytest.approx(1, abs=0.3)


def test_a_covariance_that_is_too_small_is_told(calibrations):
    wrong = [
        replace(one, solution=replace(one.solution, covariance=one.solution.covariance / 2)) for one in calibrations
    ]
    assert pooled(calibration_chi_square(one, REAL) for one in wrong).reduced > 1.6


def test_points_move_as_the_calibration_says(calibrations):
    one = calibrations[0]
    budget = error_budget(
        one.setup, [700.0, 900.0], covariance=(one.unknowns.names, one.solution.covariance), samples=4
    )
    shifts = calibration_shifts(one, budget.volume.points, seen=budget.volume.seen)
    stated = next(source.sigma for source in budget.sources if source.name == "calibration")
    known = np.isfinite(stated)
    assert known.sum() > 10
    np.testing.assert_allclose(np.linalg.norm(shifts[..., 2, :], axis=-1)[known], stated[known], rtol=1e-6)


def test_points_of_calibrations_err_together_as_they_say(calibrations):
    points = np.array([[x, y, z] for x in (-20.0, 0, 20) for y in (-15.0, 0, 15) for z in (650.0, 800, 950)])
    pixels = REAL.rig().project(points)
    seen = np.isfinite(pixels).all(-1)
    points, pixels, seen = (part[seen.sum(-1) > 1] for part in (points, pixels, seen))
    squares = []
    for one in calibrations:
        error = triangulate(one.setup.rig(), pixels).points - points
        shifts = calibration_shifts(one, points, seen=seen)
        # all numbers together live in few directions; their mean depth is one number that is known best
        depth, sigma = error[:, 2].mean(), np.linalg.norm(shifts[:, 2].mean(0))
        squares.append((depth / sigma) ** 2)
    # a chi-square of 8 degrees of freedom lies in 0.9 .. 27 in all but 0.1 % of cases to either side
    assert 0.9 < sum(squares) < 27
