"""The camera against OpenCV, round trips, and lenses that fold the picture over."""

from dataclasses import replace

import cv2
import numpy as np
import pytest

from cyclopean import Camera
from cyclopean.cameras.camera import CAMERA_PARAMETERS
from cyclopean.errors import SetupError, ShapeError

# k1 k2 p1 p2 k3: none, a barrel, a cushion, a crooked lens
LENSES = [(0,) * 5, (-0.25, 0.08, 0, 0, -0.01), (0.2, 0.1, 0, 0, 0.05), (0.1, -0.05, 4e-3, -7e-3, 0.02)]


@pytest.fixture
def rng():
    return np.random.default_rng(5)


def camera_of(distortion):
    return Camera((1280, 960), (1400, 1390), (630, 470), distortion)


@pytest.mark.parametrize("distortion", LENSES)
def test_projection_agrees_with_opencv(distortion, rng):
    camera = camera_of(distortion)
    points = np.concatenate([rng.uniform(-0.45, 0.45, (500, 2)), np.ones((500, 1))], 1) * rng.uniform(10, 1e4, (500, 1))
    theirs, _ = cv2.projectPoints(points, np.zeros(3), np.zeros(3), camera.matrix, np.array(camera.distortion))
    # 1e-9 px: roundings of pixels up to 1300, 1e-13, and no more than that
    np.testing.assert_allclose(camera.project(points), theirs[:, 0], rtol=0, atol=1e-9)


@pytest.mark.parametrize("distortion", LENSES)
def test_undistorting_agrees_with_opencv(distortion, rng):
    camera = camera_of(distortion)
    pixels = rng.uniform(0, [1279, 959], (500, 2))
    tight = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 1000, 1e-15)
    theirs = cv2.undistortPoints(pixels, camera.matrix, np.array(camera.distortion), criteria=tight)[:, 0]
    # 1e-9 px: OpenCV iterates to within 1e-12
    np.testing.assert_allclose(camera.normalise(pixels) * camera.focal, theirs * camera.focal, rtol=0, atol=1e-9)


@pytest.mark.parametrize("shape", [(), (2, 0), (3, 1, 2)])
@pytest.mark.parametrize("distortion", LENSES)
def test_pixels_come_back(distortion, shape, rng):
    camera = camera_of(distortion)
    pixels = rng.uniform(0, [1279, 959], (*shape, 2))
    rays = camera.rays(pixels)
    assert rays.shape == shape
    # 1e-11: Newton ends within 1e-15 of the normalised coordinates, times 1400 px
    np.testing.assert_allclose(camera.project(rays.at(np.full(shape, 7.0))), pixels, rtol=0, atol=1e-11)
    np.testing.assert_allclose(camera.denormalise(camera.normalise(pixels)), pixels, rtol=0, atol=1e-11)
    np.testing.assert_array_equal(rays.origins, np.zeros((*shape, 3)))


def radial(camera, radius):
    k1, k2, _, _, k3 = camera.distortion
    return radius * (1 + k1 * radius**2 + k2 * radius**4 + k3 * radius**6)


@pytest.mark.parametrize("distortion", [(-0.3, 0, 0, 0, 0), (0.1, -0.2, 0, 0, 0), (-0.25, 0.08, 0, 0, -0.01)])
def test_beyond_the_fold_of_a_lens_there_is_nothing(distortion):
    camera = camera_of(distortion)
    fold = camera.fold_radius
    radii = np.linspace(0, fold, 1001)
    distorted = radial(camera, radii)
    assert (np.diff(distorted) > 0).all()  # one-to-one up to there
    assert radial(camera, 1.001 * fold) < radial(camera, fold)  # and no further
    for direction in ([1, 0], [0.6, -0.8]):
        outward = np.array([[0.99], [1.01]]) * direction
        inside, outside = np.isfinite(camera.denormalise(outward * fold)).all(-1)
        assert inside
        assert not outside
        pixels = outward * distorted[-1] * camera.focal + camera.centre
        inside, outside = np.isfinite(camera.normalise(pixels)).all(-1)
        assert inside
        assert not outside


def test_a_lens_that_never_folds_takes_wide_angles():
    camera = camera_of((0.2, 0.1, 0, 0, 0.05))
    wide = np.array([2.5, -2.0])  # 73 degrees off the axis
    # 1e-14: some roundings
    np.testing.assert_allclose(camera.normalise(camera.denormalise(wide)), wide, rtol=1e-14)


def test_points_behind_the_camera_and_what_is_no_number_are_not_seen():
    camera = camera_of(LENSES[3])
    nan = np.nan
    points = np.array([[0, 0, -1], [0, 0, 0], [1, 0, 0], [nan, 0, 1], [0, 0, nan], [0, 0, 1.0]])
    np.testing.assert_array_equal(np.isnan(camera.project(points)).all(-1), [True] * 5 + [False])
    rays = camera.rays([[nan, 0], [0, nan], [5, 5]])
    np.testing.assert_array_equal(np.isnan(rays.origins).all(-1), [True, True, False])
    np.testing.assert_array_equal(np.isnan(rays.directions).all(-1), [True, True, False])


def test_the_pinhole_is_the_one_of_the_textbook():
    camera = Camera((101, 81), 200)
    assert camera.focal == (200, 200)
    assert camera.centre == (50, 40)  # the middle of pixels 0 to 100 and 0 to 80
    # 1e-13: some roundings of 40
    np.testing.assert_allclose(camera.project([[0, 0, 5], [1, -2, 10.0]]), [[50, 40], [70, 0]], atol=1e-13)


def test_the_image_reaches_to_the_outer_edge_of_its_border_pixels():
    camera = Camera((101, 81), 200)
    inside = [[-0.5, -0.5], [100.5, 80.5], [50, 40]]
    outside = [[-0.51, 0], [0, 80.51], [np.nan, 0]]
    np.testing.assert_array_equal(camera.contains([inside, outside]), [[True] * 3, [False] * 3])


def test_a_camera_is_its_parameters():
    camera = camera_of(LENSES[3])
    assert len(camera.lens) == len(CAMERA_PARAMETERS)
    same = camera.with_lens(camera.lens)
    again = Camera.from_matrix(camera.matrix, camera.size, camera.distortion)
    for copy in (same, again):
        assert (copy.size, copy.focal, copy.centre, copy.distortion) == (
            camera.size,
            camera.focal,
            camera.centre,
            camera.distortion,
        )
    assert Camera.from_matrix(camera.matrix, camera.size, [[-0.1, 0.2]]).distortion == (-0.1, 0.2, 0, 0, 0)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"size": (640, 480, 3)}, r"\(width, height\) in whole pixels, got \(640, 480, 3\)"),
        ({"size": 640}, r"\(width, height\) in whole pixels, got 640"),
        ({"size": (640.5, 480)}, r"in whole pixels, got \(640.5, 480\)"),
        ({"size": (np.nan, 480)}, r"in whole pixels, got \(nan, 480\)"),
        ({"focal": -900}, "positive px, .* got -900"),
        ({"focal": np.nan}, "positive px, .* got nan"),
        ({"focal": (900, 900, 1)}, r"one number or \(x, y\), got \(900, 900, 1\)"),
        ({"centre": (np.nan, 0)}, r"centre must be \(x, y\) in px, got \(nan, 0\)"),
        ({"distortion": (0.1, 0.2)}, r"five numbers k1 k2 p1 p2 k3, got \(0.1, 0.2\)"),
        ({"distortion": (0, 0, 0, 0, np.inf)}, "five numbers k1 k2 p1 p2 k3, got"),
        ({"pixel_pitch": 0}, "pixel pitch must be positive mm .* got 0"),
    ],
)
def test_cameras_that_cannot_be_say_what_came(changes, message):
    with pytest.raises(SetupError, match=message):
        Camera(**{"size": (640, 480), "focal": 900, **changes})


def test_matrices_and_pixels_of_the_wrong_shape_are_named():
    with pytest.raises(SetupError, match=r"3x3 matrix and at most k1 k2 p1 p2 k3, got shapes \(3, 3\) and \(8,\)"):
        Camera.from_matrix(np.eye(3), (640, 480), np.zeros(8))
    with pytest.raises(ShapeError, match=r"pixels must have shape \(..., 2\), got \(2, 5\); did you mean pixels.T"):
        Camera((640, 480), 900).rays(np.zeros((2, 5)))
    with pytest.raises(ShapeError, match=r"points must have shape \(..., 3\), got \(5, 2\)"):
        Camera((640, 480), 900).project(np.zeros((5, 2)))


def test_no_two_directions_share_a_pixel_where_tangential_terms_fold():
    camera = Camera((640, 480), 260, distortion=(-0.19, 0.015, -0.009, 0.003, -0.002))
    place = np.stack(np.meshgrid(np.linspace(-1.5, 1.5, 101), np.linspace(-1.5, 1.5, 101)), -1)
    pixels = camera.denormalise(place)
    known = np.isfinite(pixels).all(-1)
    back = camera.normalise(pixels)[known]
    good = np.isfinite(back).all(-1)
    np.testing.assert_allclose(back[good], place[known][good], atol=1e-9)


def test_larger_pixels_see_the_same(rng):
    camera = replace(camera_of(LENSES[3]), pixel_pitch=0.005)
    coarse = camera.with_larger_pixels(4)
    assert coarse.size == (320, 240)
    assert coarse.pixel_pitch == pytest.approx(0.02)
    pixels = rng.uniform(0, 900, (50, 2))
    there = (pixels + 0.5) / 4 - 0.5  # outer edges fall on outer edges
    np.testing.assert_allclose(coarse.normalise(there), camera.normalise(pixels), atol=1e-12)  # roundings of the lens
