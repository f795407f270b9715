"""Measured values against closed forms, and their standard deviations against sampled noise."""

from dataclasses import replace

import numpy as np
import pytest
from scenes import photograph_plane, small_setup

from cyclopean import measurement
from cyclopean.correspondence.window_search import prepare
from cyclopean.errors import MeasurementError, ShapeError
from cyclopean.geometry import Pose
from cyclopean.measurement.images import ImagePoint, evaluate, find_points, measure, with_calibration

RNG = np.random.default_rng(1)
CLOUD = RNG.normal(size=(6, 3)) * 20 + [0, 0, 500]
PENTAGON = np.array([[0, 0, 500], [30, 0, 505], [40, 20, 500], [15, 35, 498], [-5, 20, 501.0]])
FACTORS = RNG.normal(size=(6, 3, 3)) * 0.1
COVARIANCE = FACTORS @ FACTORS.swapaxes(-1, -2)  # mm^2, of some 0.2 mm, in all directions differently

CASES = [
    (measurement.distance, CLOUD[:2]),
    (measurement.length, CLOUD),
    (measurement.point_to_line, CLOUD[:3]),
    (measurement.angle, CLOUD[:3]),
    (measurement.point_to_plane, CLOUD[:4]),
    (measurement.point_to_plane, np.vstack([CLOUD[:1], PENTAGON])),
    (measurement.area, PENTAGON),
    (measurement.area, PENTAGON[:3]),
]
NAMES = [f"{function.__name__} of {len(points)}" for function, points in CASES]
DEPTHS = (550.0, 1100.0)


@pytest.mark.parametrize(("function", "points"), CASES, ids=NAMES)
def test_sigma_is_the_scatter_of_noisy_points(function, points):
    count = len(points)
    noise = np.einsum("nij,knj->kni", FACTORS[:count], np.random.default_rng(2).normal(size=(6000, count, 3)))
    found = function(points, COVARIANCE[:count])
    # 6000 draws tell a standard deviation to 0.9 %; noise of 0.2 mm over 30 mm bends the value by less than 1 %
    np.testing.assert_allclose(np.std(function(points + noise).value), found.sigma, rtol=0.04)


@pytest.mark.parametrize(("function", "points"), CASES, ids=NAMES)
def test_gradients_are_those_of_differences(function, points):
    found, step = function(points), 1e-4
    numeric = np.zeros_like(points)
    for index in np.ndindex(points.shape):
        move = np.zeros_like(points)
        move[index] = step
        numeric[index] = (function(points + move).value - function(points - move).value) / (2 * step)
    np.testing.assert_allclose(found.gradient, numeric, atol=1e-6)  # rounding of 500 mm over 2e-4 mm, squared step


@pytest.mark.parametrize(("function", "points"), CASES, ids=NAMES)
def test_values_do_not_depend_on_where_the_rig_stands(function, points):
    turn = Pose.from_rotation_vector([0.2, -0.1, 0.7], [5.0, -30.0, 80.0])
    # a turn of less than a right angle keeps the sense of "behind the plane" for these points
    np.testing.assert_allclose(function(turn @ points).value, function(points).value, rtol=1e-10)


def test_closed_forms():
    square = np.array([[0, 0, 100], [30, 0, 100], [30, 20, 100], [0, 20, 100.0]])
    assert measurement.distance(square[:2]).value == pytest.approx(30)
    assert measurement.length(square).value == pytest.approx(80)
    assert measurement.angle(square[:3]).value == pytest.approx(np.pi / 2)
    assert measurement.point(square[0]).value == pytest.approx(100)
    assert measurement.point_to_line(square[[2, 0, 1]]).value == pytest.approx(20)
    assert measurement.area(square).value == pytest.approx(600)
    assert measurement.area(square[::-1]).value == pytest.approx(600)
    pit, bump = np.vstack([[[10, 10, 104]], square]), np.vstack([[[90, 10, 97.0]], square])
    assert measurement.point_to_plane(pit).value == pytest.approx(4)
    assert measurement.point_to_plane(bump).value == pytest.approx(-3)
    assert measurement.point_to_plane(pit).flatness == pytest.approx(0, abs=1e-9)
    concave = np.array([[0, 0, 50], [10, 0, 50], [10, 10, 50], [5, 2, 50], [0, 10, 50.0]])
    assert measurement.area(concave).value == pytest.approx(60)  # 100 less a triangle of 10 x 8 / 2


def test_sigmas_in_closed_form():
    pair = np.array([[0, 0, 100], [30, 0, 100.0]])
    noise = np.array([np.diag([0.04, 9, 9]), np.diag([0.09, 9, 9])])  # only what lies along the line counts
    assert measurement.distance(pair, noise).sigma == pytest.approx(np.sqrt(0.13))
    square = np.array([[0, 0, 100], [30, 0, 100], [30, 30, 100], [0, 30, 100.0]])
    isotropic = np.broadcast_to(0.01 * np.eye(3), (4, 3, 3))
    # each corner of a square of side s moves the area by s / sqrt(2) per mm: sqrt(4 s^2 / 2) sigma
    assert measurement.area(square, isotropic).sigma == pytest.approx(np.sqrt(2) * 30 * 0.1)
    middle = np.vstack([[[15, 15, 103]], square])
    five = np.broadcast_to(0.01 * np.eye(3), (5, 3, 3))
    # over the centre of n points the plane's height is their mean: sigma sqrt(1 + 1 / n)
    assert measurement.point_to_plane(middle, five).sigma == pytest.approx(0.1 * np.sqrt(1.25))
    assert measurement.point(square, isotropic).sigma == pytest.approx(0.1)


def test_a_point_on_its_line_has_a_sigma():
    on_line = np.array([[10, 0, 100], [0, 0, 100], [20, 0, 100.0]])
    noise = np.broadcast_to(np.diag([0.01, 0.01, 0.04]), (3, 3, 3))
    found = measurement.point_to_line(on_line, noise)
    assert found.value == 0
    assert found.sigma == pytest.approx(0.2 * np.sqrt(1 + 0.25 + 0.25))  # half way between both ends


def test_batches_are_rows_and_nan_stays_nan():
    batch = np.stack([PENTAGON, PENTAGON + 5.0, np.full_like(PENTAGON, np.nan)])
    found = measurement.area(batch, np.broadcast_to(COVARIANCE[:5], (3, 5, 3, 3)))
    alone = measurement.area(PENTAGON, COVARIANCE[:5])
    np.testing.assert_allclose(found.value[:2], alone.value, rtol=1e-12)
    np.testing.assert_allclose(found.sigma[:2], alone.sigma, rtol=1e-9)
    assert np.isnan(found.value[2])
    assert np.isnan(found.sigma[2])


@pytest.mark.parametrize(
    ("function", "points", "says"),
    [
        (measurement.distance, np.zeros((2, 3)), "points are the same"),
        (measurement.length, [[0, 0, 1], [0, 0, 2], [0, 0, 2.0]], "points are the same"),
        (measurement.point_to_line, [[0, 0, 1], [1, 1, 1], [1, 1, 1.0]], "points are the same"),
        (measurement.angle, [[1, 1, 1], [1, 1, 1], [2, 1, 1.0]], "points are the same"),
        (measurement.point_to_plane, [[0, 0, 9], [0, 0, 1], [1, 1, 1], [3, 3, 1.0]], "on one line"),
        (measurement.point_to_plane, [[0, 0, 9], [1, 1, 1], [1, 1, 1], [1, 1, 1.0]], "the same"),
        (measurement.area, [[0, 0, 1], [1, 1, 1], [3, 3, 1.0]], "on one line"),
        (measurement.area, [[0, 0, 1], [1, 1, 1], [1, 0, 1], [0, 1, 1.0]], "crosses itself"),
    ],
)
def test_bad_geometry_is_named(function, points, says):
    with pytest.raises(MeasurementError, match=says):
        function(np.asarray(points, dtype=float))


def test_a_line_within_its_noise_is_no_plane():
    narrow = np.array([[0, 0, 120], [0, 0, 100], [50, 0.1, 100], [100, 0, 100.0]])
    noise = np.broadcast_to(np.eye(3), (4, 3, 3))
    assert np.isfinite(measurement.point_to_plane(narrow, 1e-4 * noise).value)
    with pytest.raises(MeasurementError, match="within their noise"):
        measurement.point_to_plane(narrow, noise)


@pytest.mark.parametrize(
    ("function", "shape"),
    [(measurement.distance, (3, 3)), (measurement.length, (1, 3)), (measurement.area, (2, 3)),
     (measurement.angle, (3, 2)), (measurement.point_to_plane, (3, 3)), (measurement.point_to_line, (3,))],
)  # fmt: skip
def test_a_wrong_shape_is_named(function, shape):
    with pytest.raises(ShapeError, match="wants points"):
        function(np.zeros(shape))


def test_covariances_must_fit():
    with pytest.raises(ShapeError, match="covariances must have shape"):
        measurement.distance(CLOUD[:2], np.eye(3))


@pytest.fixture(scope="module")
def plane():
    """A rig and the picture of a plane 800 mm away, made ready."""
    rig = small_setup().rig()
    return rig, prepare(photograph_plane(rig, 800.0, pitch=2.0)[0], rig)


@pytest.fixture(scope="module")
def corners(plane):
    """Four pixels of sub-image 0 that show a square of 20 mm on the plane, and its true corners."""
    rig, _ = plane
    middle = rig[0].rays(rig[0].region.centre).at_depth(800.0)
    square = middle + 10.0 * np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]])
    return rig[0].project(square), square


def test_a_square_on_a_plane_is_measured(plane, corners):
    rig, picture = plane
    pixels, _ = corners
    options = {"depths": DEPTHS, "pointing": 0.05}
    for kind, given, true in [
        ("length", pixels[:2], 20.0),
        ("length", pixels, 60.0),
        ("area", pixels, 400.0),
        ("angle", pixels[:3], np.pi / 2),
        ("point-to-line", pixels[[3, 0, 1]], 20.0),
        ("point-to-plane", pixels[[2, 0, 1, 3]], 0.0),
        ("point", pixels[:1], 800.0),
    ]:
        found = measure(picture, rig, kind, given, **options)
        assert found.grade != "refused", (kind, found.reasons)
        assert abs(found.value - true) < 4 * found.sigma, kind
        assert found.sigma > 0
        assert found.strength > 0.95
        assert (found.views == 0).all()


def test_points_given_by_hand_agree_with_those_found(plane, corners):
    rig, picture = plane
    pixels, true = corners
    seen = rig.project(true)
    given = [ImagePoint(tuple(p), tuple(map(tuple, s[1:]))) for p, s in zip(pixels[:2], seen[:2], strict=True)]
    found = measure(picture, rig, "length", given, DEPTHS)
    assert found.value == pytest.approx(20.0, abs=1e-6)  # exact pixels
    assert found.grade == "check"
    assert "by hand" in found.reasons[0]
    assert np.isnan(found.strength)


@pytest.mark.parametrize(
    ("other", "says"),
    [((5.0, 3.0), "do not"), ("own", "second pixel"), ((-40.0, -40.0), "no sub-image")],
)
def test_a_wrong_pixel_by_hand_is_refused(plane, corners, other, says):
    rig, picture = plane
    pixel = tuple(corners[0][0])
    other = tuple(corners[0][2]) if other == "own" else other
    found = measure(picture, rig, "point", [ImagePoint(pixel, (other,))], DEPTHS)
    assert found.grade == "refused"
    assert says in found.reasons[0]
    assert np.isnan(found.value)
    assert np.isnan(found.accuracy)


def test_grades_say_why(plane, corners):
    rig, picture = plane
    points = [ImagePoint(tuple(p)) for p in corners[0]]
    located = find_points(picture, rig, points, DEPTHS)
    assert evaluate("area", points, located).grade == "good"
    weak = replace(located, strength=np.where(located.strength > 0, 0.85, np.nan))
    assert "weak match" in evaluate("area", points, weak).reasons[0]
    twin = replace(located, ambiguity=np.full_like(located.ambiguity, 0.9))
    assert "ambiguous" in evaluate("area", points, twin).reasons[0]
    beside = replace(located, residual=np.full(4, 0.8))
    assert "beside the epipolar curves" in evaluate("area", points, beside).reasons[0]
    coarse = replace(located, covariance=located.covariance * 400)
    assert any("% only" in reason for reason in evaluate("length", points, coarse).reasons)
    bent = replace(located, points=located.points + np.array([[0, 0, 5], [0, 0, -5], [0, 0, 5], [0, 0, -5]]))
    assert any("not flat" in reason for reason in evaluate("area", points, bent).reasons)
    crossed = replace(located, points=located.points[[0, 2, 1, 3]])
    assert "crosses itself" in evaluate("area", points, crossed).reasons[0]


def test_what_a_calibration_moves_together_cancels(plane, corners):
    rig, picture = plane
    points = [ImagePoint(tuple(p)) for p in corners[0][:2]]
    found = measure(picture, rig, "length", points, DEPTHS)
    together = np.broadcast_to(np.array([0.3, 0.2, 5.0])[:, None], (2, 3, 1))
    assert with_calibration(found, together, np.eye(1)).sigma_calibration == pytest.approx(0, abs=1e-9)
    scaled = 0.01 * found.located.points[..., None]  # a scale that is 1 % wrong
    share = with_calibration(found, scaled, np.array([[4.0]]))
    assert share.sigma_calibration == pytest.approx(0.02 * found.value, rel=1e-6)
    assert share.accuracy == pytest.approx(np.hypot(found.sigma, 0.02 * found.value), rel=1e-6)


def test_wrong_counts_and_kinds_are_named(plane):
    rig, picture = plane
    with pytest.raises(MeasurementError, match="wants 2 or more points"):
        measure(picture, rig, "length", [(1.0, 2.0)], DEPTHS)
    with pytest.raises(MeasurementError, match="choose one of"):
        measure(picture, rig, "volume", [(1.0, 2.0)], DEPTHS)
