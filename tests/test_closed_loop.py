"""The loop closes: simulated, calibrated from a drawing that errs, reconstructed; errors are as large as foretold.

Small photographs of the benchmark's scene, half speckle and half smooth grey; repeat 0, as it comes.
"""

import numpy as np
import pytest

from benchmarks.closed_loop import CAMERA, FACETS, Outcome, experiment, real_setup
from cyclopean.analysis.chi_square import pooled

SMALL = CAMERA.with_larger_pixels(3.2)  # 400 x 300 px: the same rays, fewer pixels
PHOTOGRAPHED = 3  # facets of the prism whose boards are photographed; for the others true corners stand, with noise


@pytest.fixture(scope="module")
def outcomes() -> dict[int, Outcome]:
    few = {"photos": 3, "direct_photos": 2, "samples": 4}
    return {n: experiment(real_setup(n, SMALL), 0, alone=False, boards=n == PHOTOGRAPHED, **few) for n in FACETS}


@pytest.mark.parametrize("n", FACETS)
def test_errors_of_depth_are_as_large_as_foretold(outcomes, n):
    judged = outcomes[n].whole
    assert judged.freedom > 90
    # what the project asks of the mean, and 3 of the standard deviations that chance gives one photograph: 40 %
    chance = 3 * np.sqrt(2 / judged.freedom)
    assert 0.8 * (1 - chance) < judged.reduced < 1.25 * (1 + chance)
    assert outcomes[n].complete > 0.9  # or the easy pixels alone would be judged


def test_all_prisms_together(outcomes):
    judged = pooled(one.whole for one in outcomes.values())
    assert judged.freedom > 450
    assert 0.8 < judged.reduced < 1.25  # chance makes sqrt(2 / 450) = 0.07


def test_all_depths_with_the_sum_of_both_variances(outcomes):
    # what the calibration moves all together are a few random numbers a photograph: four photographs together
    assert 0.8 < np.mean([one.total["all"] for one in outcomes.values()]) < 1.25


def test_calibrations_err_as_they_say(outcomes):
    judged = pooled(one.calibration for one in outcomes.values())
    assert judged.freedom == 21 + 23 + 25 + 27  # 8 of the camera, 9 of the prism, two of each facet
    low, high = judged.interval(0.999)
    assert low < judged.reduced < high


def test_corners_in_photographs_are_as_good_as_stated(outcomes):
    # four rays a pixel make steps along edges that a corner's own residuals tell in part
    assert 0.8 < outcomes[PHOTOGRAPHED].sigma0 < 1.4


def test_the_calibration_moves_all_depths_together_as_foretold(outcomes):
    # four normal numbers: their chi-square exceeds 18.5 in 0.1 % of cases
    assert np.sum(np.square([one.common for one in outcomes.values()])) < 18.5
