"""The simple calibration: exact pinholes, sampled noise, and stations that tell nothing."""

import numpy as np
import pytest

from cyclopean import Camera
from cyclopean.calibration.simple import crossing_lines, simple_calibration
from cyclopean.errors import SetupError, ShapeError

FOCAL, NEAR, TRAVEL, LENGTH = 1500.0, 400.0, 150.0, 100.0
ENDS = np.array([[-60.0, 20.0], [40.0, 20.0], [10.0, -50.0], [10.0, 30.0]])  # left, right, top, bottom, mm
CAMERA = Camera((1280, 960), (1500.0, 1510.0), (640.0, 470.0))


def images(focal=FOCAL, near=NEAR, travel=TRAVEL, length=LENGTH):
    return np.array([focal * length / near, focal * length / (near + travel)])


def cross(depth):
    return CAMERA.project(np.column_stack([ENDS, np.full(4, depth)]))


def test_an_exact_pinhole():
    found = simple_calibration(LENGTH, TRAVEL, images())
    assert found.focal == pytest.approx(FOCAL, rel=1e-13)  # a few roundings
    assert found.distance == pytest.approx(NEAR, rel=1e-13)


def test_it_broadcasts():
    focals = np.array([800.0, 1500.0, 3000.0])
    found = simple_calibration(LENGTH, TRAVEL, np.stack([images(f) for f in focals]))
    np.testing.assert_allclose(found.focal, focals, rtol=1e-13)
    np.testing.assert_allclose(found.distance, NEAR, rtol=1e-13)


def test_sigmas_are_those_of_sampled_noise():
    rng = np.random.default_rng(0)
    noisy = images() + np.sqrt(2) * 0.1 * rng.normal(size=(40_000, 2))
    lengths, travels = LENGTH + 0.05 * rng.normal(size=40_000), TRAVEL + 0.1 * rng.normal(size=40_000)
    # the true object and travel depart from what is stated, which amounts to the same to first order
    found = simple_calibration(lengths, travels, noisy)
    stated = simple_calibration(LENGTH, TRAVEL, images(), 0.1, 0.05, 0.1)
    # 2 %: 1/sqrt(2 * 40 000) is 0.35 %, and second order adds 0.3 %
    assert found.focal.std() == pytest.approx(stated.sigma_focal, rel=0.02)
    assert found.distance.std() == pytest.approx(stated.sigma_distance, rel=0.02)


def test_crossing_lines_give_both_axes():
    found = crossing_lines([100.0, 80.0], TRAVEL, cross(NEAR), cross(NEAR + TRAVEL))
    np.testing.assert_allclose(found.focal, CAMERA.focal, rtol=1e-12)
    np.testing.assert_allclose(found.distance, NEAR, rtol=1e-12)
    np.testing.assert_allclose(found.centre, CAMERA.centre, rtol=1e-12)
    assert found.aspect == pytest.approx(1510 / 1500, rel=1e-12)


def test_sigmas_of_crossing_lines_are_those_of_sampled_noise():
    rng = np.random.default_rng(1)
    near, far = (cross(z) + 0.1 * rng.normal(size=(40_000, 4, 2)) for z in (NEAR, NEAR + TRAVEL))
    found = crossing_lines([100.0, 80.0], TRAVEL, near, far, 0.1)
    stated = crossing_lines([100.0, 80.0], TRAVEL, cross(NEAR), cross(NEAR + TRAVEL), 0.1)
    np.testing.assert_allclose(found.focal.std(0), stated.sigma_focal, rtol=0.02)  # as above
    np.testing.assert_allclose(found.distance.std(0), stated.sigma_distance, rtol=0.02)
    np.testing.assert_allclose(found.centre.std(0), stated.sigma_centre, rtol=0.02)
    assert found.sigma_centre.shape == (40_000, 2)


def test_stations_that_tell_nothing_give_nan():
    for pair in ([100.0, 100.0], [90.0, 100.0], [100.0, 0.0], [np.nan, 50.0]):
        found = simple_calibration(LENGTH, TRAVEL, pair)
        assert np.isnan([found.focal, found.distance, found.sigma_focal, found.sigma_distance]).all()
    same = crossing_lines([100.0, 80.0], TRAVEL, cross(NEAR), cross(NEAR))
    assert np.isnan(same.focal).all()
    assert np.isnan(same.centre).all()


def test_wrong_calls():
    with pytest.raises(ShapeError, match="near and far"):
        simple_calibration(LENGTH, TRAVEL, [1.0, 2.0, 3.0])
    with pytest.raises(SetupError, match="positive"):
        simple_calibration(-LENGTH, TRAVEL, images())
    with pytest.raises(ShapeError, match="left, right, top, bottom"):
        crossing_lines([100.0, 80.0], TRAVEL, np.zeros((3, 2)), np.zeros((3, 2)))
    with pytest.raises(ShapeError, match="lengths"):
        crossing_lines(100.0, TRAVEL, cross(NEAR), cross(NEAR + TRAVEL))
