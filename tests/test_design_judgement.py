"""Accuracy that prisms keep: against closed forms, full-size pictures, counting, and what bounds promise."""

from dataclasses import replace

import numpy as np
import pytest

from cyclopean import Camera, Prism, Setup
from cyclopean.analysis import Tolerance
from cyclopean.design import Requirements, judgement
from cyclopean.design.judgement import ErrorSpread, keep_accuracy
from cyclopean.errors import SetupError
from cyclopean.experiments import standard_setup
from cyclopean.experiments.setups import baseline

DEPTHS = (600.0, 1600.0)
CAMERA = Camera((320, 240), 25 / 0.022, pixel_pitch=0.022)  # 1280 x 960 of 5.5 um, four to a side taken as one
NOISE = 0.025  # px, of such a pixel
EXACT = (Tolerance("optic.apex", 1e-12), Tolerance("optic.distance", 1e-12))


def case(facets=2, **changes) -> tuple[Setup, Requirements]:
    setup = replace(standard_setup(facets, 40.0, apex_deg=12.0, camera=CAMERA), depths=DEPTHS)
    return setup, Requirements(CAMERA, DEPTHS, noise=NOISE, corner_noise=0.005, **changes)


@pytest.fixture(scope="module")
def built():
    setup, requirements = case(accuracy=0.002, tolerances="commercial")
    return keep_accuracy(setup, requirements, draws=60)


def test_exact_prisms_keep_what_noise_leaves():
    setup, requirements = case(tolerances=EXACT, accuracy=0.0009)
    requirements = replace(requirements, corner_noise=1e-9)
    kept = keep_accuracy(setup, requirements, draws=20, direct_photos=0)
    for spread in (kept.before, kept.after):
        np.testing.assert_allclose(spread.errors, np.tile(kept.noise, (20, 1)), rtol=1e-6)
    # two parallel cameras: sigma_Z / Z = Z sqrt(2) sigma / (baseline f); 6 %: views are stretched along the slope
    paper = kept.depths * np.sqrt(2) * NOISE / (baseline(setup.rig()) * CAMERA.focal[0])
    np.testing.assert_allclose(kept.noise, paper, rtol=0.06)
    assert kept.driver == judgement.MATCHING
    assert kept.kept is bool(kept.noise.max() <= 0.0009)


def test_calibration_betters_what_was_built(built):
    assert (built.after.sigma < 0.2 * built.before.sigma).all()
    assert (built.noise < built.after.sigma).all()
    assert (built.after.median <= built.after.quantile(0.95)).all()
    assert (built.after.quantile(0.95) <= built.after.worst_point).all()
    assert built.kept
    assert built.share == 1
    assert built.share_before < 0.5
    assert sum(built.drivers_after.values()) == pytest.approx(1)
    assert sum(built.drivers_before.values()) == pytest.approx(1)
    assert built.driver_before == "optic.apex"  # 3 arcmin of 12 deg: 0.4 % times Z / apex - 1
    assert "95 % of prisms keep" in built.text


def test_finer_grades_keep_more_before_calibration(built):
    setup, requirements = case(tolerances="high")
    fine = keep_accuracy(setup, requirements, draws=60)
    assert (fine.before.sigma < built.before.sigma).all()
    assert fine.kept is None  # no accuracy is wanted


def test_without_direct_photographs_the_focal_length_is_left(built):
    setup, requirements = case(tolerances="commercial")
    left = keep_accuracy(setup, requirements, draws=60, direct_photos=0)
    # the lens is known to 0.1 % and depth goes with it; 0.06 %: a spread from 60 draws, 4 of its own deviations
    assert (np.sqrt(left.after.sigma**2 - left.noise**2) > 0.0006).all()
    assert (built.after.sigma < left.after.sigma).all()
    assert max(left.drivers_after, key=lambda n: left.drivers_after[n] * (n != judgement.MATCHING)).startswith("camera")


def test_larger_pixels_give_the_same_answer(monkeypatch):
    setup, requirements = case(tolerances="commercial", accuracy=0.0013)
    setup = replace(setup, camera=Camera((642, 480), 25 / 0.011, (325.0, 236.0), pixel_pitch=0.011))
    requirements = replace(requirements, camera=setup.camera, noise=2 * NOISE, corner_noise=0.01)
    full = keep_accuracy(setup, requirements, draws=40)
    monkeypatch.setattr(judgement, "_SIDE", 321)
    coarse = keep_accuracy(setup, requirements, draws=40)
    # the same draws; 2 %: borders of views move by up to half of a larger pixel, and with them the points looked at
    np.testing.assert_allclose(coarse.noise, full.noise, rtol=0.02)
    np.testing.assert_allclose(coarse.before.sigma, full.before.sigma, rtol=0.02)
    np.testing.assert_allclose(coarse.after.sigma, full.after.sigma, rtol=0.02)


def test_shares_and_quantiles_by_counting():
    errors = np.array([[1.0, 2.0], [3.0, 1.0], [2.0, np.inf], [4.0, 3.0]])
    spread = ErrorSpread(errors, 2 * errors)
    assert spread.share(3.0) == 0.5  # the first two; one prism gives no depth at the far end
    assert spread.quantile(0.5).tolist() == [2, 2]
    assert spread.quantile(0.95).tolist() == [4, np.inf]
    assert spread.worst_point.tolist() == [8, np.inf]
    np.testing.assert_allclose(spread.sigma, np.sqrt([30 / 4, 14 / 3]))
    blind = ErrorSpread(np.full((4, 1), np.nan), np.full((4, 1), np.nan))
    assert blind.share(1.0) == 0
    assert np.isnan([blind.sigma, blind.quantile(0.5), blind.worst_point]).all()


def test_bounds_hold_what_they_promise():
    rng = np.random.default_rng(4)
    true_quantile, accuracy = 3.0 * np.log(20), 3.0 * np.log(10)  # of exponential errors of mean 3
    held = np.zeros(2)
    for _ in range(400):
        spread = ErrorSpread(rng.exponential(3.0, (200, 1)), np.zeros((200, 1)))
        low, high = spread.quantile_bounds(0.95)[:, 0]
        bottom, top = spread.share_bounds(accuracy)
        held += [low <= true_quantile <= high, bottom <= 0.9 <= top]
    # 95 %; 400 trials tell that to 1.1 %, four of these; ranks and counts are whole numbers, which adds a percent
    assert (np.abs(held / 400 - 0.95) < 0.055).all()


def test_blind_depths_are_said():
    # light bent by 10 deg where half of the picture is 8 deg wide: views part at about 40 / (2 tan 2 deg) = 600 mm
    steep = replace(standard_setup(2, 40.0, apex_deg=18.0, camera=CAMERA, nearest=300.0), depths=(300.0, 1600.0))
    requirements = replace(case(accuracy=0.05, tolerances="precision")[1], depths=(300.0, 1600.0))
    kept = keep_accuracy(steep, requirements, draws=20)
    assert "share next to nothing at" in kept.reason
    assert "1600 mm" in kept.reason
    assert kept.kept is False
    assert np.isfinite(kept.after.sigma[0])
    assert np.isnan(kept.after.sigma[-1])
    assert kept.worst == np.inf
    nothing = keep_accuracy(steep, replace(requirements, depths=(1200.0, 1600.0)), draws=20)
    assert nothing.after is None
    assert nothing.kept is False
    assert "cannot be judged" in nothing.text


def test_a_field_that_is_a_cross_is_judged():
    # four views close before the prism: neighbours share the two arms of a cross, about a tenth of its box wide
    camera = Camera((320, 240), 25 / 0.022)
    optic = Prism(4, 16.0, "N-BK7", 497.6, 30.3, azimuth_deg=45.0)
    setup = Setup(camera, optic, depths=DEPTHS)
    kept = keep_accuracy(setup, replace(case(accuracy=0.05)[1], camera=camera), draws=20, samples=4)
    assert not kept.reason
    assert np.isfinite(kept.after.sigma).all()


def test_wrong_calls_are_said():
    setup, requirements = case()
    with pytest.raises(SetupError, match="20 draws"):
        keep_accuracy(setup, requirements, draws=5)
    with pytest.raises(SetupError, match="apx"):
        keep_accuracy(setup, replace(requirements, tolerances=(Tolerance("optic.apx", 1.0),)), draws=20)
    with pytest.raises(SetupError, match="no tolerances"):
        keep_accuracy(setup, replace(requirements, tolerances=()), draws=20)
