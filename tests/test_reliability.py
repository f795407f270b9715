"""Stated against found: samples drawn with a known standard deviation, and what the picture shows of them."""

import numpy as np
import pytest

from cyclopean.analysis.reliability import NORMAL_SHARES, reliability
from cyclopean.errors import MeasurementError, ShapeError
from cyclopean.plotting.reliability import reliability_picture

COUNT = 40_000


@pytest.fixture(scope="module")
def sample():
    """Errors (200, 200) of a known sigma between 0.1 and 10 mm."""
    rng = np.random.default_rng(3)
    sigma = 10 ** rng.uniform(-1, 1, (200, 200))
    return sigma * rng.normal(size=sigma.shape), sigma


def test_true_sigma_is_called_true(sample):
    judged = reliability(*sample)
    assert judged.count == COUNT
    assert judged.counts.sum() == COUNT
    # the standard deviation of a share of N samples is at most 0.5 / sqrt(N) = 0.0025
    np.testing.assert_allclose(judged.shares, NORMAL_SHARES, atol=0.01)
    # that of the 68th percentile sqrt(p (1 - p) / N) / density = 0.5 % in all, 1.5 % in a tenth; of chi 0.4 %
    assert judged.ratio == pytest.approx(1, abs=0.02)
    assert judged.chi == pytest.approx(1, abs=0.02)
    np.testing.assert_allclose(judged.rms, judged.stated, rtol=0.06)
    # within a bin sigma varies by a factor 10^0.2, so its errors are not quite normal
    np.testing.assert_allclose(judged.spread, judged.stated, rtol=0.1)
    assert 1 < judged.factor < 1.06
    assert (np.diff(judged.stated) > 0).all()


@pytest.mark.parametrize("times", [0.5, 2.0])
def test_a_wrong_scale_of_sigma_is_told(sample, times):
    error, sigma = sample
    judged, right = reliability(error, times * sigma), reliability(error, sigma)
    assert judged.ratio == pytest.approx(right.ratio / times)
    assert judged.chi == pytest.approx(right.chi / times)
    np.testing.assert_allclose(judged.stated, times * right.stated)
    assert judged.factor == pytest.approx(2, rel=0.06)


def test_sigma_that_knows_nothing_is_told(sample):
    error, _ = sample
    blind = np.random.default_rng(8).permutation(sample[1].ravel()).reshape(error.shape)
    judged = reliability(error, blind)
    assert judged.factor > 2  # its bins all hold the same errors
    assert np.ptp(judged.spread) < 0.2 * judged.spread.mean()


def test_gross_errors_raise_rms_and_chi_alone(sample):
    error, sigma = (part.copy() for part in sample)
    error.ravel()[::100] = 1e4
    judged, right = reliability(error, sigma), reliability(*sample)
    assert judged.chi > 10 * right.chi
    assert (judged.rms > 10 * right.rms).all()
    assert judged.ratio == pytest.approx(right.ratio, rel=0.04)  # 1 % more of them move a percentile by about 2 %
    np.testing.assert_allclose(judged.spread, right.spread, rtol=0.08)


def test_the_same_by_hand():
    judged = reliability([[1.0, -4.0], [np.nan, 3.0]], [[2.0, 1.0], [1.0, 1.5]], bins=3)
    assert judged.count == 3
    np.testing.assert_allclose(judged.stated, [1.0, 1.5, 2.0])
    np.testing.assert_allclose(judged.spread, [4.0, 3.0, 1.0])
    np.testing.assert_allclose(judged.rms, [4.0, 3.0, 1.0])
    np.testing.assert_allclose(judged.shares, [1 / 3, 2 / 3, 2 / 3])
    assert judged.chi == pytest.approx(np.sqrt((0.25 + 16 + 4) / 3))
    assert judged.factor == pytest.approx((4 * 2 * 2) ** (1 / 3))


def test_wrong_calls():
    with pytest.raises(ShapeError, match=r"\(3,\) and \(2,\)"):
        reliability(np.ones(3), np.ones(2))
    with pytest.raises(MeasurementError, match="cannot fill 10 bins"):
        reliability(np.ones(9), np.ones(9))
    with pytest.raises(MeasurementError, match="cannot fill 0 bins"):
        reliability(np.ones(9), np.ones(9), bins=0)
    with pytest.raises(MeasurementError, match="must be positive, got 0"):
        reliability(np.ones(3), np.array([1.0, 0.0, 2.0]), bins=1)


def test_the_picture_draws_what_was_found(sample):
    error, sigma = sample
    curves = {"right": reliability(error, sigma), "half": reliability(error, sigma / 2)}
    diagram, shares = reliability_picture(curves).axes
    for line, curve in zip(diagram.lines, curves.values()):
        np.testing.assert_allclose(line.get_xydata(), np.stack([curve.stated, curve.spread], -1))
    for line, curve in zip(shares.lines, curves.values()):
        np.testing.assert_allclose(line.get_ydata(), 100 * np.array(curve.shares))
    (low, high), (bottom, top) = diagram.get_xlim(), diagram.get_ylim()
    for curve in curves.values():  # nothing falls off the picture
        assert low < curve.stated.min() < curve.stated.max() < high
        assert bottom < curve.spread.min() < curve.spread.max() < top
