"""What a calibration does not know: stated uncertainties against samples, and culprits that are found again."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from board_views import BOARD, NOISE, POSES, Grid, observe_exactly, prism_setup, with_noise
from scipy.stats import chi2

from benchmarks.data import renderer_setup
from cyclopean.calibration.depths import Volume, depth_slopes, target_depths, working_volume
from cyclopean.calibration.held import SCALE, freed, sentence
from cyclopean.calibration.least_squares import minimise
from cyclopean.calibration.physical import calibrate
from cyclopean.calibration.prediction import Prediction, views_of
from cyclopean.calibration.trust import correlated, depth_errors, undetermined, warnings_of
from cyclopean.calibration.trust import tests_of_held as held_tests  # or pytest would run it
from cyclopean.calibration.unknowns import Unknowns
from cyclopean.errors import SetupError
from cyclopean.targets import Observations
from cyclopean.triangulation import point_covariance, triangulate

FREE = ("optic.pose", "optic.apex")


@pytest.fixture(scope="module")
def exact():
    return observe_exactly(prism_setup(), POSES)


@pytest.fixture(scope="module")
def calibration(exact):
    return calibrate(with_noise(exact), BOARD, prism_setup(), FREE, poses=POSES)


def wrong(exact, poses=POSES, board=BOARD, **changes):
    """A calibration that takes the optic for another one; the truth is that of `prism_setup`."""
    return calibrate(with_noise(exact), board, prism_setup(**changes), FREE, poses=poses)


def changed(setup, name, step):
    values = setup.optic.parameters(setup.wavelength_nm)
    values[setup.optic.parameter_names.index(name)] += step
    return replace(setup, optic=setup.optic.with_parameters(values))


@pytest.mark.parametrize("name", ["tilt_x", "shift_y", "distance", "apex", "thickness", "facet1_azimuth", "index"])
def test_slopes_are_those_of_triangulated_depths(name):
    setup = prism_setup()
    rig = setup.rig()
    volume = working_volume(rig, [500, 800], 6)
    _, slopes = depth_slopes(setup, volume)
    everywhere = volume.seen.all(-1)
    pixels = rig.unbounded().project(volume.points[everywhere])
    step = 1e-5
    sides = [triangulate(changed(setup, name, s).rig().unbounded(), pixels).points[:, 2] for s in (step, -step)]
    column = setup.parameter_names.index(f"optic.{name}")
    # 1e-4 of the largest: the difference of two triangulations, each good to 1e-8 mm, and curvature
    expected = (sides[0] - sides[1]) / (2 * step)
    np.testing.assert_allclose(slopes[everywhere][:, column], expected, atol=1e-4 * np.abs(expected).max())


def test_noise_is_that_of_triangulated_points(calibration):
    errors = depth_errors(calibration, [600], 0.2, samples=8)
    rig = calibration.setup.rig()
    all_views = errors.views == 3
    variance = point_covariance(rig.unbounded(), errors.points[all_views], 0.2)[:, 2, 2]
    # 1e-6: one matrix inverted in two ways
    np.testing.assert_allclose(errors.noise[all_views], np.sqrt(variance), rtol=1e-6)
    np.testing.assert_allclose(errors.total**2, errors.noise**2 + errors.calibration**2, rtol=1e-12)
    assert np.isnan(errors.noise[errors.views < 2]).all()
    assert np.isfinite(errors.calibration[errors.views >= 2]).all()
    ((depth, noise, _, both, worst),) = errors.table()
    assert depth == 600
    assert noise < both < worst


def test_stated_depth_errors_are_those_of_many_calibrations(exact):
    setup, runs = prism_setup(), 120
    # narrow enough for what the drawing says to act linearly, wide enough for the photographs to have a say
    drawing = {"optic.shift_x": 0.3, "optic.shift_y": 0.3, "optic.distance": 0.2, "optic.pose": 0.005}
    unknowns = Unknowns.of([setup], FREE, drawing)
    three, rng = exact.of_photos([0, 1, 2]), np.random.default_rng(11)
    predict, points = Prediction(unknowns, three), BOARD.points[three.point]
    spot = np.array([[0, 0, 500.0], [30, 20, 700], [-40, 10, 850]])
    truth = setup.rig().unbounded().project(spot)
    found, total, covariances, scales = [], [], [], []
    for _ in range(runs):
        noisy = replace(three, pixels=three.pixels + rng.normal(0, NOISE, three.pixels.shape))
        mean = unknowns.start + unknowns.spread * rng.normal(size=len(unknowns))
        solution = minimise(predict, unknowns.start, POSES[:3], noisy, points, prior=(mean, unknowns.spread))
        views = views_of(unknowns.setup(solution.shared))
        views = [views[k] for k in range(3)]
        found.append(triangulate(views, truth).points)
        total.append(triangulate(views, truth + rng.normal(0, NOISE, truth.shape)).points)
        covariances.append(solution.covariance)
        scales.append(solution.sigma0)
    slopes = slopes_at(setup, spot) @ unknowns.matrix[0]
    by_calibration = np.einsum("ps,st,pt->p", slopes, np.mean(covariances, axis=0), slopes)
    by_noise = point_covariance(setup.rig().unbounded(), spot, NOISE)[:, 2, 2]
    assert np.mean(scales) == pytest.approx(1, abs=0.02)  # the scale is estimated without bias to about 1 %
    # chance fails one seed in 2000; 5 %: the drawing's spread is small, yet not infinitely so
    low, high = chi2.ppf([2.5e-4, 1 - 2.5e-4], runs)
    for depths, variance in ((found, by_calibration), (total, by_calibration + by_noise)):
        squares = np.sum((np.array(depths)[:, :, 2] - spot[:, 2]) ** 2, 0) / variance
        assert (squares > 0.95 * low).all()
        assert (squares < 1.05 * high).all()


def slopes_at(setup, points):
    """Derivatives of depth (P, F) at points that all views see."""
    seen = np.ones((len(points), 1, 1, len(setup.rig())), dtype=bool)
    return depth_slopes(setup, Volume(points[:, 2], points[:, None, None], seen))[1][:, 0, 0]


def test_stated_depth_errors_are_those_against_a_renderer(mitsuba):
    table = np.load(mitsuba / "calib_n3" / "corners.npz")
    x, y = np.meshgrid(np.arange(1, 14), np.arange(1, 10))
    target = SimpleNamespace(points=20.0 * np.stack([x, y, 0 * x], -1).reshape(-1, 3))
    pixels = table["uv"] + np.random.default_rng(2).normal(0, NOISE, table["uv"].shape)
    names = tuple(map(str, range(14)))
    seen = Observations(table["view"], table["facet"], table["corner_id"], pixels, names, NOISE)
    setup, squares = renderer_setup("n3"), []
    spot = np.array([[0, 0, 550.0], [40, 30, 750], [-50, -40, 900]])
    truth = setup.rig().unbounded().project(spot)
    for k in range(7):
        found = calibrate(seen.of_photos([k, k + 7]), target, setup, FREE)
        slopes = slopes_at(setup, spot) @ found.unknowns.matrix[0]
        variance = np.einsum("ps,st,pt->p", slopes, found.solution.covariance, slopes)
        miss = triangulate(found.setup.rig().unbounded(), truth).points[:, 2] - spot[:, 2]
        squares.append(miss**2 / variance)
    # chance fails one seed in 500: seven calibrations, and depths of one are hardly independent
    low, high = chi2.ppf([1e-3, 1 - 1e-3], 7) / 7
    assert low < np.mean(squares) < high


def test_depths_where_nothing_is_shared_are_named(calibration):
    with pytest.raises(SetupError, match=r"no two views share anything between 2 and 3 mm"):
        depth_errors(calibration, [2, 3])
    with pytest.raises(SetupError, match="positive number of px"):
        depth_errors(calibration, [500], 0)
    near, *_, far = target_depths(calibration)
    assert 400 < near < 520 < 850 < far < 950


def test_a_biprism_may_slide_along_its_edge():
    setup = prism_setup(2)
    result = calibrate(with_noise(observe_exactly(setup, POSES)), BOARD, setup, FREE, poses=POSES)
    (loose,) = undetermined(result)
    assert loose.names == ("optic.shift_y",)
    assert loose.share == pytest.approx(1, abs=1e-6)
    assert loose.depth_sigma == pytest.approx(0, abs=1e-6)  # mm
    assert loose.text.startswith("optic.shift_y is not determined by these photographs; it was held near 0.00 mm")
    assert "depths hardly depend on it" in loose.text


def test_a_prism_with_three_facets_is_determined_by_five_photographs(calibration):
    assert undetermined(calibration) == ()
    assert correlated(calibration) == ()


def test_parameters_that_say_the_same_are_named_together(exact):
    free = (*FREE, "optic.azimuth", "optic.facets")
    found = {loose.names: loose for loose in undetermined(calibrate(with_noise(exact), BOARD, prism_setup(), free))}
    angles = tuple(f"optic.facet{k}_angle" for k in range(3))
    assert angles in found  # together they are the apex angle
    assert "known by their differences alone" in found[angles].text
    text = " ".join(loose.text for loose in found.values())
    assert "optic.azimuth" in text  # turning the facets is turning the prism
    assert all(loose.depth_sigma < 0.1 for names, loose in found.items() if "angle" in names[0])


def test_one_photograph_leaves_the_thickness_to_the_drawing(exact):
    one = calibrate(with_noise(exact).of_photos([0]), BOARD, prism_setup(), (*FREE, "optic.thickness"))
    loose = next(loose for loose in undetermined(one) if "optic.thickness" in loose.names)
    assert loose.share > 0.5
    assert "it leaves depths uncertain by" in loose.text


def test_tests_of_right_values_are_normal_deviates(exact):
    squares = []
    for seed in range(12):
        tests = held_tests(calibrate(with_noise(exact, seed), BOARD, prism_setup(), FREE, poses=POSES))
        squares.append({test.name: test.z**2 for test in tests if test.visible})
    for name in ("optic.index", "camera.k1", "optic.facet0_angle", "camera.focal_tied"):
        low, high = chi2.ppf([2.5e-4, 1 - 2.5e-4], len(squares))  # chance fails one seed in 500
        assert low < sum(run[name] for run in squares) < high


@pytest.mark.parametrize(
    ("name", "step", "changes"),
    [
        ("optic.index", 0.003, {"glass": 1.5168 + 0.003}),
        ("optic.facet1_angle", np.deg2rad(0.01), {"facet_deviation_deg": ((0, 0), (0.01, 0), (0, 0))}),
        ("optic.facet2_azimuth", np.deg2rad(0.05), {"facet_deviation_deg": ((0, 0), (0, 0), (0, 0.05))}),
    ],
)
def test_a_small_fault_is_found_by_its_size(exact, name, step, changes):
    tests = {test.name: test for test in held_tests(wrong(exact, **changes))}
    assert abs(tests[name].change + step) < 4 * tests[name].sigma + 0.05 * step  # 5 %: of first order only
    assert freed_change(exact, name, changes) == pytest.approx(-step, abs=4 * tests[name].sigma)


def freed_change(exact, name, changes):
    result = wrong(exact, **changes)
    return freed(result, next(test for test in held_tests(result) if test.name == name)).change


def test_the_wrong_glass_is_named(exact):
    warnings = warnings_of(wrong(exact, glass="N-SF11"))
    assert warnings[0].startswith("residuals are")
    assert "the photographs ask for optic.index = 1.51" in warnings[1]
    assert "1.7847 of N-SF11: is it the right glass?" in warnings[1]


def test_deviating_facets_are_named(exact):
    setup = prism_setup(facet_deviation_deg=((0.1, 0.1), (-0.07, 0.2), (0.05, -0.1)))
    result = calibrate(with_noise(observe_exactly(setup, POSES)), BOARD, prism_setup(), FREE, poses=POSES)
    assert any("free optic.facets" in line for line in warnings_of(result))


def test_the_scale_hides_behind_the_distance_of_the_prism(calibration):
    # all lengths times one factor give the same picture: only the thickness, which was held, tells the scale at all
    test = next(test for test in held_tests(calibration) if test.name == SCALE)
    assert test.sigma > 0.05
    assert sentence(replace(test, change=0.25), calibration).endswith("is the square length right?")


def test_a_wrong_square_length_is_asked_about():
    setup = prism_setup(distance=80.0, shift=(3.0, 2.0))
    large = Grid(square=1.05 * BOARD.square)
    result = calibrate(with_noise(observe_exactly(setup, POSES)), large, setup, FREE)
    assert any("is the square length right?" in line for line in warnings_of(result))


def test_nothing_is_said_where_nothing_is_wrong(calibration):
    assert warnings_of(calibration) == ()


def test_a_view_numbered_in_another_order_is_named(exact):
    noisy = with_noise(exact)
    odd = np.flatnonzero((noisy.photo == 2) & (noisy.view == 1))
    pixels = noisy.pixels.copy()
    pixels[odd] = pixels[odd][::-1]
    result = calibrate(replace(noisy, pixels=pixels), BOARD, prism_setup(), FREE, poses=POSES)
    (line,) = warnings_of(result)
    assert line.startswith("left out: view 1 of photo 2 disagrees with the other views by ")
    assert line.endswith("are its corners numbered in the same order?")


def test_photographs_that_say_little_are_named(exact):
    one = with_noise(exact).of_photos([0])
    assert any("only one photograph" in line for line in warnings_of(calibrate(one, BOARD, prism_setup(), FREE)))
    three = Observations.join([with_noise(exact, seed).of_photos([0]) for seed in range(3)])
    lines = warnings_of(calibrate(three, BOARD, prism_setup(), FREE))
    assert any(line.startswith("all 3 photographs are alike") for line in lines)


def test_parameters_far_from_the_drawing_are_named(exact):
    tight = {"optic.apex": np.deg2rad(0.01)}
    result = calibrate(with_noise(exact), BOARD, prism_setup(apex_deg=12.2), FREE, tolerances=tight, poses=POSES)
    assert any(line.startswith("optic.apex ended at 12") for line in warnings_of(result))
