"""Matrices and lines of pinholes, and how far they are off the true curves."""

import cv2
import numpy as np
import pytest
from setups import SETUPS

from benchmarks.data import renderer_setup
from cyclopean import Camera, Prism, Rig, Setup
from cyclopean.epipolar import (
    distance_to_line,
    epipolar_curves,
    epipolar_line,
    epipoles,
    essential_matrix,
    fitted_fundamental,
    fundamental_matrix,
    line_departure,
    line_departures,
    line_distances,
    redistorted,
    sampson_distance,
    straight_line,
    undistorted,
)
from cyclopean.errors import OpticError, ShapeError
from cyclopean.geometry import Pose, rotation_from_vector
from cyclopean.rigs import PinholeView, VirtualCamera, fit, pinhole_rig
from cyclopean.triangulation import nearest_pair


@pytest.fixture
def rng():
    return np.random.default_rng(5)


def virtual_camera(rng, mirrored, distortion=(0.0,) * 5):
    """A camera somewhere near the rig's origin, looking forward."""
    camera = Camera((640, 480), (900, 880), (310.0, 250.0), distortion)
    pose = Pose(rotation_from_vector(rng.normal(0, 0.1, 3)), rng.normal(0, 30, 3))
    return VirtualCamera(camera, pose, mirrored, "made up", (300, 900), 0.0, 0.0)


def homogeneous(pixels):
    return np.concatenate([pixels, np.ones((*pixels.shape[:-1], 1))], -1)


@pytest.mark.parametrize("flips", [(False, False), (True, False), (False, True), (True, True)])
def test_the_matrices_tie_the_pixels_of_a_point_together(flips, rng):
    first, second = (virtual_camera(rng, flip, (-0.1, 0.05, 1e-3, -1e-3, 0.0)) for flip in flips)
    points = rng.uniform([-80, -60, 300], [80, 60, 900], (50, 3))
    pixels = [undistorted(c.camera, c.project(points)) for c in (first, second)]
    assert np.isfinite(pixels).all()
    matrix = fundamental_matrix(first, second)
    assert np.linalg.norm(matrix) == pytest.approx(1)
    gap = np.einsum("ni,ij,nj->n", homogeneous(pixels[1]), matrix, homogeneous(pixels[0]))
    # 1e-12: roundings of 600 px twice, and of undoing the distortion
    np.testing.assert_allclose(gap, 0, atol=1e-11)
    np.testing.assert_allclose(distance_to_line(epipolar_line(matrix, pixels[0]), pixels[1]), 0, atol=1e-8)
    np.testing.assert_allclose(distance_to_line(epipolar_line(matrix.T, pixels[1]), pixels[0]), 0, atol=1e-8)
    # the other way round it is the transposed one, but for a sign
    other = fundamental_matrix(second, first)
    np.testing.assert_allclose(other * np.sign(other[0] @ matrix[:, 0]), matrix.T, atol=1e-12)
    essential = essential_matrix(first, second)
    values = np.linalg.svd(essential)[1]
    baseline = np.linalg.norm(first.centre - second.centre)
    np.testing.assert_allclose(values, [baseline, baseline, 0], atol=1e-9)
    # epipoles: each camera in the other's picture
    for epipole, sees, seen in ((epipoles(matrix)[0], first, second), (epipoles(matrix)[1], second, first)):
        local = (sees.camera_from_rig @ seen.centre) * ([-1, 1, 1] if sees.mirrored else [1, 1, 1])
        direction = sees.camera.matrix @ local
        np.testing.assert_allclose(np.cross(epipole, direction / np.linalg.norm(direction)), 0, atol=1e-9)


def test_the_matrix_is_that_of_eight_points(rng):
    first, second = (virtual_camera(rng, False) for _ in range(2))
    points = rng.uniform([-80, -60, 300], [80, 60, 900], (60, 3))
    found, _ = cv2.findFundamentalMat(first.project(points), second.project(points), cv2.FM_8POINT)
    matrix = fundamental_matrix(first, second)
    found = found / np.linalg.norm(found) * np.sign(found.ravel() @ matrix.ravel())
    # 1e-8: eight points take noise free pixels through a least-squares problem of condition 1e6
    np.testing.assert_allclose(found, matrix, atol=1e-8)


@pytest.mark.parametrize("flips", [(False, False), (False, True)])
def test_a_fitted_matrix_is_that_of_the_cameras(flips, rng):
    first, second = (virtual_camera(rng, flip) for flip in flips)
    points = rng.uniform([-80, -60, 300], [80, 60, 900], (60, 3))
    truth, pairs = fundamental_matrix(first, second), (first.project(points), second.project(points))
    found = fitted_fundamental(*pairs)
    # 1e-9: the solver stops where its steps are roundings
    np.testing.assert_allclose(found * np.sign(found.ravel() @ truth.ravel()), truth, atol=1e-9)
    assert np.linalg.det(found) == pytest.approx(0, abs=1e-18)
    # with noise it beats both the true matrix and eight points, by the measure that it minimises
    noisy = [pixels + rng.normal(0, 0.3, pixels.shape) for pixels in pairs]
    eight = cv2.findFundamentalMat(*noisy, cv2.FM_8POINT)[0]
    cost = [np.sum(sampson_distance(f, *noisy) ** 2) for f in (fitted_fundamental(*noisy), truth, eight)]
    assert cost[0] <= min(cost[1:])
    # and what is left are 60 distances less 7 numbers, each of one standard deviation; 4 of theirs
    assert cost[0] / 0.3**2 == pytest.approx(53, abs=4 * np.sqrt(2 * 53))
    with pytest.raises(ShapeError, match="8 pairs of pixels or more"):
        fitted_fundamental(pairs[0][:7], pairs[1][:7])


def test_sampson_distance_is_the_distance_to_the_nearest_pair(rng):
    first, second = (virtual_camera(rng, False) for _ in range(2))
    points = rng.uniform([-80, -60, 300], [80, 60, 900], (60, 3))
    pairs = np.stack([camera.project(points) for camera in (first, second)], 1) + rng.normal(0, 0.2, (60, 2, 2))
    matrix = fundamental_matrix(first, second)
    away = np.linalg.norm(nearest_pair(matrix, pairs) - pairs, axis=(1, 2))
    # 1e-3: the next order, 0.2 px over hundreds
    np.testing.assert_allclose(np.abs(sampson_distance(matrix, *pairs.swapaxes(0, 1))), away, rtol=1e-3, atol=1e-6)


@pytest.mark.parametrize("distorted", [False, True])
@pytest.mark.parametrize("optic", ["prism, straight lens", "two mirrors, straight lens"])
def test_curves_of_pinholes_are_the_lines_of_their_matrices(optic, distorted, rng):
    rig = SETUPS[optic].rig()
    rig = rig[::2] if "mirrors" in optic else rig
    cameras = [fit(view, (250, 800), distortion=distorted) for view in rig]
    views = pinhole_rig(cameras, rig)
    pixels = rig[0].region.centre + rng.uniform(-30, 30, (20, 2))
    curves = epipolar_curves(views, 0, pixels, (250, 800), bounded=False)
    for k in range(1, len(rig)):
        known = np.isfinite(curves.pixels[:, k]).all()
        assert known
        # 1e-9 px: roundings of some 1000 px; with distortion as well as it can be undone
        atol = 1e-7 if distorted else 1e-9
        np.testing.assert_allclose(line_distances(cameras[0], cameras[k], pixels, curves.pixels[:, k]), 0, atol=atol)
        straight = undistorted(cameras[k].camera, curves.pixels[:, k])
        np.testing.assert_allclose(distance_to_line(straight_line(straight)[:, None], straight), 0, atol=atol)


def test_undistorting_and_back(rng):
    camera = SETUPS["prism, bent lens"].camera
    pixels = rng.uniform([0, 0], camera.size, (50, 2))
    np.testing.assert_allclose(redistorted(camera, undistorted(camera, pixels)), pixels, atol=1e-8)


def test_same_centre_and_wrong_shapes_are_refused(rng):
    camera = virtual_camera(rng, False)
    with pytest.raises(OpticError, match="same centre"):
        fundamental_matrix(camera, camera)
    with pytest.raises(ShapeError, match=r"\(3, 3\)"):
        epipolar_line(np.eye(2), [0, 0])


def test_the_best_straight_line_is_that_of_a_search(rng):
    pixels = rng.normal(size=(30, 2)) @ np.array([[5.0, 3], [0, 0.4]]) + [100, 200]

    def cost(angle):
        normal = np.array([-np.sin(angle), np.cos(angle)])
        return np.var(pixels @ normal)

    best = min(cost(angle) for angle in np.linspace(0, np.pi, 20001))
    # 1e-5: a search over 20,000 angles
    assert np.mean(distance_to_line(straight_line(pixels), pixels) ** 2) == pytest.approx(best, rel=1e-5)
    pixels[3] = np.nan
    assert np.isfinite(straight_line(pixels)).all()
    assert np.isnan(straight_line(np.full((5, 2), np.nan))).all()


def test_departure_of_straight_lines():
    rig, depths = renderer_setup_or_skip("n3").rig(), (600, 1500)
    one = line_departure(rig, 1, 2, depths)
    assert one.curves > 50
    # a prism keeps each curve straight to a hundredth of a px, but not on the lines of two pinholes
    assert one.straight_max < 0.02
    assert 1.0 < one.virtual_max < 10
    assert one.virtual_rms < one.virtual_max
    assert one.straight_rms < one.straight_max
    # one matrix that is fitted to the curves themselves does better than two pinholes without skew
    assert one.straight_rms < one.best_rms < 0.2 * one.virtual_rms
    assert one.straight_max < one.best_max < 0.2 * one.virtual_max
    every = line_departures(rig, depths)
    assert sorted(every) == [(i, j) for i in range(3) for j in range(3) if i != j]
    assert every[1, 2] == one
    # virtual cameras with distortion stand better for the views; theirs are lines of undistorted pixels
    better = line_departure(rig, 1, 2, depths, [fit(view, depths) for view in rig])
    assert better.virtual_max < 0.5 * one.virtual_max
    # pinholes depart from their own lines by roundings
    cameras = [fit(view, depths, distortion=False) for view in rig]
    none = line_departure(pinhole_rig(cameras, rig), 1, 2, depths, cameras)
    assert none.virtual_max < 1e-8
    assert none.best_max < 1e-5
    with pytest.raises(OpticError, match="name two views"):
        line_departure(rig, 1, 1, depths)
    with pytest.raises(OpticError, match="3 views want as many"):
        line_departure(rig, 0, 1, depths, cameras[:2])


def test_departure_is_unknown_where_nothing_is_shared():
    rig = Setup(Camera((640, 480), 1200), Prism(2, 10, 1.5168, 60)).rig()
    away = Pose(rotation_from_vector([0, 3.0, 0]), np.zeros(3))
    blind = PinholeView(rig[1].camera, away, rig[1].region, name="away")
    nothing = line_departure(Rig((rig[0], blind)), 0, 1, (300, 900), [fit(view, (300, 900)) for view in rig])
    assert nothing.curves == 0
    assert np.isnan([nothing.virtual_max, nothing.straight_rms]).all()


def renderer_setup_or_skip(name):
    try:
        return renderer_setup(name)
    except FileNotFoundError as missing:
        pytest.skip(str(missing))
