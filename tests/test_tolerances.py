"""Tolerances: exact draws against one setup after the other, closed forms, first order, and real calibrations."""

from dataclasses import replace

import numpy as np
import pytest
from board_views import BOARD, POSES, prism_setup
from scipy.stats import chi2, kstest
from setups import BENT, OPTICS, SETUPS, STRAIGHT

from cyclopean import Camera, Prism, Setup
from cyclopean.analysis.tolerance_calibration import CalibrationPlan, observe, usual_plan
from cyclopean.analysis.tolerance_draws import bare_views, drawn_pixels, nearby_points, optic_pixels
from cyclopean.analysis.tolerance_errors import DepthErrorSample, drivers_of
from cyclopean.analysis.tolerances import Tolerance, tolerance_analysis, usual_tolerances
from cyclopean.calibration import calibrate
from cyclopean.calibration.depths import working_volume
from cyclopean.errors import CyclopeanError, SetupError
from cyclopean.triangulation import triangulate

BIPRISM = Setup(
    Camera((2048, 1536), 25 / 0.0055, pixel_pitch=0.0055), Prism(2, 6.4, 1.5168, 370.0, 10.0), depths=(600.0, 1500.0)
)
APEX = 380.0  # mm from the pinhole to the biprism's apex
SMALL = (Tolerance("optic.apex", 1e-5), Tolerance("optic.index", 1e-5), Tolerance("optic.pose", 1e-5))
PLAN = CalibrationPlan(BOARD, POSES, sigma=0.05)


def values_of(setup):
    return np.concatenate([setup.camera.lens, setup.optic.parameters(setup.wavelength_nm)])


def drawn_values(setup, count, relative, seed=3):
    """Parameters (count, F) about those of a setup: `relative` of a typical size."""
    values = values_of(setup)
    typical = np.maximum(np.abs(values), 0.2)
    return values + relative * typical * np.random.default_rng(seed).normal(size=(count, len(values)))


def field(setup, depths=(150.0, 250.0), samples=4):
    volume = working_volume(setup.rig(), depths, samples)
    return volume.points[volume.common]


@pytest.mark.parametrize("name", ["prism", "prism, facets to camera", "biprism in water"])
@pytest.mark.parametrize("camera", [STRAIGHT, BENT], ids=["straight", "bent"])
def test_prisms_at_once_are_prisms_one_after_the_other(name, camera):
    setup = Setup(camera, OPTICS[name])
    points = field(setup)
    for relative in (1e-3, 0.05, 0.4):  # 0.4: facets of 90 degrees, folded lenses, outlines that cannot be
        values = drawn_values(setup, 40, relative)
        fast, slow = drawn_pixels(setup, values, points), optic_pixels(setup, values, points)
        # a point on a border, by rounding, may be seen by one and not by the other
        differ = np.isfinite(fast) != np.isfinite(slow)
        assert differ.mean() < 1e-3
        both = np.isfinite(fast) & np.isfinite(slow)
        assert both.any()
        np.testing.assert_allclose(fast[both], slow[both], rtol=0, atol=1e-7)  # Newton stops below 1e-8 of the focal


def test_drawn_pixels_are_those_of_the_real_rig():
    setup = SETUPS["prism, bent lens"]
    points = field(setup)
    values = drawn_values(setup, 5, 2e-3)
    pixels = drawn_pixels(setup, values, points)
    for row, found in zip(values, pixels, strict=True):
        optic = setup.optic.with_parameters(row[9:])
        real = replace(setup, camera=setup.camera.with_lens(row[:9]), optic=optic).rig()
        np.testing.assert_allclose(found, real.project(points), rtol=0, atol=1e-7)


def test_nearby_points_are_triangulated_points():
    setup = SETUPS["prism, straight lens"]
    points = field(setup)
    pixels = setup.rig().project(points) + np.random.default_rng(1).normal(0, 0.5, (len(points), 3, 2))
    found = nearby_points(bare_views(setup), points, pixels)
    # 1e-6 mm: both stop once steps are below 1e-5 mm, of which hundredths are left
    np.testing.assert_allclose(found, triangulate(setup.rig().unbounded(), pixels).points, rtol=0, atol=1e-6)


@pytest.mark.parametrize(
    ("name", "size", "slope"),
    [  # d depth / d parameter, the real one larger: first-order formulas of a thin biprism, A = Z / apex - 1
        ("optic.index", 1e-4, lambda z: z * (z / APEX - 1) / 0.5168),
        ("optic.apex", 1e-5, lambda z: z * (z / APEX - 1) / np.deg2rad(6.4)),
        ("camera.focal_tied", 0.5, lambda z: z * (z / APEX - 1) / (25 / 0.0055)),
        ("optic.distance", 0.01, lambda z: -z / APEX),
    ],
)
def test_single_tolerances_follow_closed_forms(name, size, slope):
    result = tolerance_analysis(BIPRISM, [Tolerance(name, size)], (600, 1000, 1500), draws=300, samples=1)
    deviation, errors = result.deviations[:, 0], result.before.errors
    for k, depth in enumerate(result.before.depths):
        found = (deviation @ errors[:, k]) / (deviation @ deviation)
        # 4 %: thin-prism formulas; an exact trace differs from them by up to 3 % here
        assert found == pytest.approx(slope(depth), rel=0.04)
    assert result.drivers.shares == pytest.approx(1, abs=1e-3)  # nothing else varies, and errors are nearly linear
    assert np.abs(result.drivers.ranks) == pytest.approx(1, abs=1e-9)


def test_small_tolerances_are_linear():
    result = tolerance_analysis(prism_setup(), SMALL, (500, 700), draws=3000)
    # 5 %: four standard deviations of a sigma from 3000 draws, 1 / sqrt(2 * 3000)
    np.testing.assert_allclose(result.before.sigma, result.before.linear_sigma, rtol=0.05)
    np.testing.assert_allclose(result.drivers.shares, result.drivers.linear, atol=0.05)
    np.testing.assert_allclose(result.drivers.linear.sum(-1), 1)
    for k in range(2):  # normal tolerances give normal errors
        mine = result.before.errors[:, result.before.plane == k]
        assert kstest(mine[:, 0] / mine[:, 0].std(), "norm").pvalue > 1e-3


def test_no_tolerance_no_error():
    none = [Tolerance(name, 0.0) for name in ("optic.apex", "optic.index", "camera")]
    result = tolerance_analysis(prism_setup(), none, (500, 700), draws=4, plan=PLAN)
    np.testing.assert_allclose(result.before.errors, 0, atol=1e-6)  # mm: where Newton and Gauss-Newton stop
    assert result.before.passing(1e-3).tolist() == [1, 1, 1]
    assert result.before.lost.tolist() == [0, 0]
    assert result.sources["noise of corners"] == 1


def test_pixel_noise_adds_what_triangulation_says():
    none = [Tolerance("optic.apex", 0.0)]
    result = tolerance_analysis(prism_setup(), none, (500, 700), draws=1500, noise=0.1, plan=PLAN)
    # 3 %: many points, each with noise of its own
    np.testing.assert_allclose(result.before.sigma, result.before.linear_sigma, rtol=0.03)
    np.testing.assert_allclose(result.after.sigma, result.after.linear_sigma, rtol=0.06)


@pytest.mark.parametrize("shape", ["normal", "uniform", "truncated"])
def test_draws_have_the_stated_shape(shape):
    tolerance = Tolerance("optic.apex", 2.0, shape)
    sample = tolerance.draw(np.random.default_rng(2), 40_000)
    assert sample.std() == pytest.approx(tolerance.sigma, rel=0.015)  # four standard deviations
    assert sample.mean() == pytest.approx(0, abs=4 * tolerance.sigma / 200)
    if shape != "normal":
        assert 1.99 < np.abs(sample).max() <= 2
    if shape == "truncated":  # the density at the limit is exp(-2) of that in the middle
        inner, outer = np.mean(np.abs(sample) < 0.1), np.mean(np.abs(sample) > 1.9)
        assert outer / inner == pytest.approx(np.exp(-2), rel=0.15)


def test_draws_are_reproducible():
    first, again, other = (tolerance_analysis(prism_setup(), SMALL, [600], draws=40, seed=s) for s in (1, 1, 2))
    np.testing.assert_array_equal(first.before.errors, again.before.errors)
    assert not np.array_equal(first.deviations, other.deviations)


def test_interrupted_draws_are_kept():
    told = []

    def stop(done, total):
        told.append((done, total))
        if done >= 500:
            raise KeyboardInterrupt

    result = tolerance_analysis(prism_setup(), SMALL, [600], draws=900, plan=PLAN, progress=stop)
    whole = tolerance_analysis(prism_setup(), SMALL, [600], draws=900, plan=PLAN)
    assert told == [(250, 900), (500, 900)]
    assert result.interrupted
    assert not whole.interrupted
    np.testing.assert_array_equal(result.before.errors, whole.before.errors[:500])
    np.testing.assert_array_equal(result.after.errors, whole.after.errors[:500])


def test_lost_views_are_counted():
    wild = [Tolerance("optic.tilt_x", np.deg2rad(12)), Tolerance("optic.apex", np.deg2rad(12))]
    result = tolerance_analysis(prism_setup(), wild, (500, 700), draws=300)
    sample = result.before
    failed = ~np.isfinite(sample.errors).any(-1)
    assert 0 < failed.sum() < 300  # apex angles below 0 degrees, and boards that left the picture
    np.testing.assert_array_equal(sample.failed, failed)
    np.testing.assert_allclose(sample.lost, [np.isnan(sample.errors[:, sample.plane == k]).mean() for k in range(2)])
    np.testing.assert_allclose(sample.astray, [np.isinf(sample.errors[:, sample.plane == k]).mean() for k in range(2)])
    assert sample.passing(1e6)[-1] <= 1 - failed.mean()  # a setup without depths keeps no limit


def test_quantiles_and_yield_by_counting():
    errors = np.random.default_rng(0).normal(size=(50, 6)) * 10
    errors[3, :2] = errors[5] = np.nan  # points that are not seen, and a setup that shows none
    errors[7, 0] = np.inf  # rays that part
    plane, depths = np.array([0, 0, 0, 1, 1, 1]), (100.0, 200.0)
    sample = DepthErrorSample(np.array(depths), np.zeros((6, 3)), plane, errors, np.ones(6))

    def keeps(row, percent):
        """Whether all that a setup shows is right to so many percent, at each depth."""
        parts = [np.abs(row[plane == k]) for k in range(2)]
        parts = [part[~np.isnan(part)] for part in parts]
        return [
            bool(len(part)) and bool((100 * part <= percent * z).all()) for part, z in zip(parts, depths, strict=True)
        ]

    limits = [5.0, 12.0]
    expected = []
    for percent in limits:
        good = np.array([keeps(row, percent) for row in errors])
        expected.append([*good.mean(0), good.all(-1).mean()])
    np.testing.assert_array_equal(sample.passing(limits), expected)
    sizes = np.sort(np.abs(errors[:, :3])[~np.isnan(errors[:, :3])])
    assert sample.quantiles([0.5, 1.0])[0].tolist() == [np.median(sizes), np.inf]
    assert sample.sigma[0] == pytest.approx(np.sqrt(np.mean(sizes[:-1] ** 2)))  # of what is a number
    assert sample.astray.tolist() == [1 / 150, 0]
    assert np.flatnonzero(sample.failed).tolist() == [5]


def test_a_depth_at_which_all_drawn_setups_are_blind_is_failed():
    errors = np.array([[0.1, np.nan], [0.2, np.nan], [0.1, np.nan]])
    depths = np.array([100.0, 200.0, 300.0])  # the drawing's views share nothing at the last
    sample = DepthErrorSample(depths, np.zeros((2, 3)), np.array([0, 1]), errors, np.ones(2))
    np.testing.assert_array_equal(sample.passing(1.0), [1, 0, np.nan, 0])


@pytest.mark.filterwarnings("error")
def test_drivers_need_two_draws_and_something_that_varies():
    errors = np.array([[0.1], [np.nan], [np.nan]])
    sample = DepthErrorSample(np.array([100.0]), np.zeros((1, 3)), np.array([0]), errors, np.ones(1))
    deviations = np.array([[1.0], [2.0], [3.0]])
    one = drivers_of(("optic.apex",), deviations, sample, np.ones((1, 1)))
    still = drivers_of(("optic.apex",), 0 * deviations, replace(sample, errors=errors[[0, 0, 0]]), np.ones((1, 1)))
    for drivers in (one, still):
        assert np.isnan(drivers.shares).all()
        assert np.isnan(drivers.unexplained)
        assert drivers.order.tolist() == [0]


def test_calibration_leaves_what_real_calibrations_leave():
    setup = prism_setup()
    tolerances = [
        Tolerance("optic.distance", 0.03), Tolerance("optic.apex", 5e-5), Tolerance("optic.tilt_x", 3e-4),
        Tolerance("optic.tilt_y", 3e-4), Tolerance("optic.index", 3e-5), Tolerance("camera.focal_tied", 0.05),
    ]  # fmt: skip  # small: what is foretold is of first order
    free = ("optic.distance", "optic.apex", "optic.tilt_x", "optic.tilt_y")
    plan = replace(PLAN, free=free)
    result = tolerance_analysis(setup, tolerances, (500, 700), draws=12, samples=3, plan=plan)
    assert set(result.remainder.held) == {"optic.index", "camera.focal_tied"}
    points, left = result.after.points, result.remainder
    some = points[[0, len(points) // 2, -1]]
    from cyclopean.analysis.sensitivity import point_sensitivity

    slopes = point_sensitivity(setup, some).depth
    covariance = slopes @ left.noise @ slopes.T
    total = 0.0
    for k, deviation in enumerate(result.deviations):
        values = values_of(setup) + left.toleranced.matrix[0] @ deviation
        optic = setup.optic.with_parameters(values[9:])
        real = replace(setup, camera=setup.camera.with_lens(values[:9]), optic=optic)
        seen = observe(real, plan, np.random.default_rng(5000 + k))
        told = {t.name: t.sigma for t in tolerances if t.name in free}
        found = calibrate(seen, BOARD, setup, free, tolerances=told, poses=POSES).setup
        depth = triangulate(found.rig().unbounded(), real.rig().project(some)).points[:, 2]
        # what is carried over from the deviations is foretold for each draw; the rest is noise of the corners
        noise = depth - some[:, 2] + slopes @ (left.carried @ deviation)
        total += noise @ np.linalg.solve(covariance, noise)
    low, high = chi2.ppf([5e-4, 1 - 5e-4], 12 * len(some))
    assert low < total < high


def test_calibration_without_information_leaves_the_drawing():
    tolerances = [Tolerance("optic.apex", 1e-4), Tolerance("camera.focal_tied", 0.3)]
    blind, sharp = (
        tolerance_analysis(prism_setup(), tolerances, (500, 700), draws=3, plan=replace(PLAN, sigma=s))
        for s in (1e6, 1e-6)
    )
    # usual priors of the parameters that calibration finds besides do not matter: they have no tolerance
    np.testing.assert_allclose(blind.after.linear_sigma, blind.before.linear_sigma, rtol=1e-3)
    assert (sharp.after.linear_sigma < 0.5 * blind.after.linear_sigma).all()
    assert sharp.sources["camera.focal_tied"] > 0.99  # held: exact corners do not tell


def test_photographs_without_the_optic_find_the_camera():
    setup = prism_setup()
    through = usual_plan(setup, setup.depths, BOARD, photos=6)
    both = usual_plan(setup, setup.depths, BOARD, photos=6, direct_photos=6)
    one, two = (tolerance_analysis(setup, None, (500, 700), draws=3, plan=plan) for plan in (through, both))
    assert any(name.startswith("camera") for name in one.remainder.held)
    assert not two.remainder.held
    assert (two.after.linear_sigma < one.after.linear_sigma).all()


def test_usual_plan_fits_the_field():
    plan = usual_plan(BIPRISM, BIPRISM.depths, photos=9)
    seen = observe(BIPRISM, plan)
    assert len(np.unique(seen.photo)) == 9
    assert np.bincount(seen.photo).min() > 20
    assert set(seen.view) == {0, 1}


def test_mirrors_have_tolerances_too():
    setup = Setup(STRAIGHT, OPTICS["two mirrors"])
    depths = setup.rig().working_depths
    result = tolerance_analysis(setup, None, depths, draws=40, samples=3)
    assert {t.name for t in usual_tolerances(setup)} >= {"optic.mirror0_tilt_u", "optic.mirror1_advance"}
    ratio = result.before.sigma / result.before.linear_sigma
    assert (np.abs(ratio - 1) < 0.5).all()  # 40 draws, four standard deviations


def test_a_later_tolerance_replaces_an_earlier_one():
    tolerances = [*usual_tolerances(prism_setup()), Tolerance("optic.facets", 0.0), Tolerance("camera.focal_x", 3.0)]
    result = tolerance_analysis(prism_setup(), tolerances, [600], draws=2)
    assert result.tolerances["optic.facet1_angle"].size == 0
    assert result.tolerances["camera.focal_x"].size == 3
    assert "camera.focal_tied" not in result.names
    assert list(result.names) == [name for name in prism_setup().parameter_names if name in result.names]


@pytest.mark.parametrize(
    ("words", "call"),
    [
        ("2 draws or more", lambda: tolerance_analysis(BIPRISM, draws=1)),
        ("samples across", lambda: tolerance_analysis(BIPRISM, samples=0)),
        ("pixel noise", lambda: tolerance_analysis(BIPRISM, noise=np.nan)),
        ("no tolerances", lambda: tolerance_analysis(BIPRISM, [])),
        ("optic.apex", lambda: tolerance_analysis(BIPRISM, [Tolerance("optic.apx", 1)])),
        ("0 or more", lambda: Tolerance("optic.apex", -1.0)),
        ("finite", lambda: Tolerance("optic.apex", np.nan)),
        ("normal, uniform", lambda: Tolerance("optic.apex", 1.0, "flat")),
        ("sigmas", lambda: Tolerance("optic.apex", 1.0, "truncated", 0)),
        ("no two views", lambda: tolerance_analysis(BIPRISM, SMALL, [100.0])),
        ("no drawn setup", lambda: tolerance_analysis(BIPRISM, [*SMALL, Tolerance("optic.distance", 1e6)], draws=5)),
        ("positive numbers of mm", lambda: tolerance_analysis(BIPRISM, SMALL, [-100.0])),
        ("two views", lambda: tolerance_analysis(SETUPS["plate, straight lens"], SMALL[:0] or None, [100.0])),
        ("noise of corners", lambda: replace(PLAN, sigma=0.0)),
        ("photographs", lambda: CalibrationPlan(BOARD, ())),
        ("0 or more", lambda: usual_plan(BIPRISM, (600, 1500), photos=-1)),
        ("enough of the board", lambda: observe(BIPRISM, replace(PLAN, poses=PLAN.poses[:1], target=far_board()))),
        ("between 0 and 1", lambda: tolerance_analysis(BIPRISM, SMALL, [900], draws=2).before.quantiles([50])),
        ("positive percentage", lambda: tolerance_analysis(BIPRISM, SMALL, [900], draws=2).before.passing(0)),
    ],
)
def test_wrong_calls_say_what_was_wanted(words, call):
    with pytest.raises(CyclopeanError, match=words) as caught:
        call()
    assert isinstance(caught.value, SetupError)


def far_board():
    from cyclopean.targets.boards import PointTarget

    return PointTarget(BOARD.points + np.array([1e4, 0, 0]))
