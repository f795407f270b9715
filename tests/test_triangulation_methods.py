"""Other ways to points than reprojection, each against brute force and against sampled noise."""

import cv2
import numpy as np
import pytest
from scipy.optimize import least_squares
from scipy.stats import chi2
from setups import SETUPS

from benchmarks.data import renderer_setup
from cyclopean import Camera, Mirror, Mirrors, Setup
from cyclopean.errors import OpticError, SetupError, ShapeError
from cyclopean.geometry import Pose, rotation_from_vector, shortest_segment
from cyclopean.rigs import PinholeView, Region, VirtualCamera, fit
from cyclopean.rigs.two_views import fundamental_matrix
from cyclopean.triangulation import (
    canonical_stereo,
    midpoint,
    nearest_pair,
    nearest_to_rays,
    optimal,
    point_covariance,
    triangulate,
)

BENT = (-0.2, 0.1, 2e-3, -1e-3, 0.0)


@pytest.fixture
def rng():
    return np.random.default_rng(5)


def pinhole(centre, turn=(0.0, 0.0, 0.0), mirrored=False, distortion=(0.0,) * 5, focal=(900, 880)):
    """A camera of 640 x 480 px that stands at `centre`; the whole picture belongs to it."""
    camera = Camera((640, 480), focal, (310.0, 250.0), distortion)
    rotation = rotation_from_vector(turn)
    pose = Pose(rotation, -rotation @ np.asarray(centre, dtype=float))
    return PinholeView(camera, pose, Region(np.ones((480, 640), dtype=bool), 0.0), mirrored)


PAIRS = {
    "side by side": (pinhole((-20, 0, 0)), pinhole((20, 0, 0))),
    "turned": (pinhole((-60, 5, 0), (0.02, 0.15, 0.01)), pinhole((50, -10, 20), (-0.03, -0.12, 0.4))),
    "one behind the other": (pinhole((0, 0, -400), (0.0, 0.02, 0.0)), pinhole((60, 0, 60), (0.0, -0.2, 0.1))),
    "one mirrored": (pinhole((-30, 0, 0), (0.0, 0.1, 0.0)), pinhole((40, 8, 0), (0.02, -0.1, 0.0), mirrored=True)),
}
POINTS = np.array([[5.0, -10.0, 420.0], [-30.0, 25.0, 600.0], [40.0, 10.0, 500.0]])


def assert_covariance_is_that_of_samples(estimate, project, points, sigma, rng, draws=4000):
    """Mean and spread of many noisy estimates are those that the estimate states."""
    pixels = project(points)
    noisy = pixels[:, None] + rng.normal(0, 1, (len(points), draws, *pixels.shape[1:])) * np.reshape(sigma, (-1, 1))
    found = estimate(noisy)
    stated = estimate(pixels).covariance[:, None]
    miss = found.points - points[:, None]
    squares = np.einsum("...i,...ij,...j->...", miss, np.linalg.inv(stated), miss)
    # chance fails one seed in 5000; 1 %: the noise is small, yet not infinitely so
    low, high = chi2.ppf([1e-4, 1 - 1e-4], 3 * squares.size)
    assert 0.99 * low < squares.sum() < 1.01 * high
    mean = miss.mean(1)
    squares = draws * np.einsum("...i,...ij,...j->...", mean, np.linalg.inv(stated[:, 0]), mean)
    assert (squares < chi2.ppf(1 - 1e-5, 3)).all()  # no bias that 4000 draws can see


def brute_force(views, pixel, sigma, starts):
    """The lowest minimum of the reprojection error from several starts."""
    views, scale = [view.unbounded() for view in views], np.reshape(sigma, (-1, 1))

    def miss(x):
        return ((np.stack([view.project(x) for view in views]) - pixel) / scale).ravel()

    limits = {"xtol": 1e-14, "ftol": 1e-14, "gtol": 1e-14, "x_scale": (1, 1, 10)}
    found = [least_squares(miss, start, **limits) for start in starts]
    return min(found, key=lambda one: one.cost)


# ---- canonical stereo


def test_canonical_stereo_is_what_two_parallel_cameras_see(rng):
    views = PAIRS["side by side"]
    focal, centre = 900.0, views[0].camera.centre
    views = [pinhole(view.centre, focal=(focal, focal)) for view in views]
    pixels = np.stack([view.project(POINTS) for view in views], 1)
    found = canonical_stereo(pixels[:, 0], pixels[:, 1], focal, 40.0, 0.1, centre)
    np.testing.assert_allclose(found.points, POINTS, rtol=1e-12)
    # textbook: Z^2 / (f b) times the noise of a disparity
    spread = np.sqrt(found.covariance[:, 2, 2])
    np.testing.assert_allclose(spread, POINTS[:, 2] ** 2 / (focal * 40) * np.sqrt(2) * 0.1, rtol=1e-12)
    np.testing.assert_allclose(found.covariance, point_covariance(views, POINTS, 0.1), rtol=1e-9)
    # noisy pixels: the mean row is the likeliest, so it is what triangulate finds
    noisy = pixels + rng.normal(0, 0.5, pixels.shape)
    found = canonical_stereo(noisy[:, 0], noisy[:, 1], focal, 40.0, 0.5, centre)
    best = triangulate(views, noisy, 0.5)
    np.testing.assert_allclose(found.points, best.points, rtol=1e-7)
    np.testing.assert_allclose(found.residual, best.residual, rtol=1e-6)
    np.testing.assert_allclose(found.covariance, best.covariance, rtol=1e-6)
    assert_covariance_is_that_of_samples(
        lambda p: canonical_stereo(p[..., 0, :], p[..., 1, :], focal, 40.0, 0.05, centre),
        lambda x: np.stack([view.project(x) for view in views], 1), POINTS, 0.05, rng,
    )  # fmt: skip


def test_canonical_stereo_refuses_what_cannot_be():
    found = canonical_stereo([[10, 0], [0, 0], [-5, 0], [np.nan, 0]], [[0, 0]] * 4, 900, 40)
    np.testing.assert_array_equal(np.isfinite(found.points).all(-1), [True, False, False, False])
    np.testing.assert_array_equal(found.views, [2, 2, 2, 0])
    for wrong in ({"focal": 0}, {"baseline": -4}, {"sigma": np.nan}):
        with pytest.raises(SetupError, match="one positive number"):
            canonical_stereo([10, 0], [0, 0], **({"focal": 900, "baseline": 40} | wrong))
    with pytest.raises(ShapeError, match="pairs"):
        canonical_stereo(np.zeros((3, 2)), np.zeros((4, 2)), 900, 40)


# ---- nearest to rays


def test_midpoint_halves_the_shortest_segment(rng):
    rig = SETUPS["biprism in water, bent lens"].rig()
    points = rng.uniform([-10, -10, 200], [10, 10, 400], (20, 3))
    pixels = rig.unbounded().project(points) + rng.normal(0, 1, (20, 2, 2))
    views = rig.unbounded()
    found = midpoint(views, pixels, 1.0)
    ends = shortest_segment(views[0].rays(pixels[:, 0]), views[1].rays(pixels[:, 1]))
    np.testing.assert_allclose(found.points, np.mean(ends, axis=0), rtol=1e-9)
    miss = views.project(found.points) - pixels
    np.testing.assert_allclose(found.residual, np.sqrt(np.mean(miss**2, axis=(1, 2))), rtol=1e-9)


@pytest.mark.parametrize("weighted", [True, False])
def test_nearest_point_is_that_of_a_search(weighted, rng):
    views = SETUPS["prism, bent lens"].rig().unbounded()
    point = np.array([3.0, -4.0, 300.0])
    pixels = views.project(point) + rng.normal(0, 1, (3, 2))
    found = nearest_to_rays(views, pixels, 1.0, weighted)
    rays = [view.rays(pixel) for view, pixel in zip(views, pixels, strict=True)]
    if weighted:  # how far each ray moves across itself for a px, by differences, at the unweighted point
        there = nearest_to_rays(views, pixels, 1.0, weighted=False).points
        steps = 0.01 * np.array([[1, 0], [-1, 0], [0, 1], [0, -1]])
        moves = []
        for view in views:
            bundle = view.rays(view.project(there) + steps)
            foot = bundle.at(np.linalg.norm(there - bundle.origins, axis=-1))
            moves.append(np.sum((foot[0] - foot[1]) ** 2 + (foot[2] - foot[3]) ** 2) / 0.02**2)
        weights = 2 / np.array(moves)
    else:
        weights = np.ones(3)

    def miss(x):
        arms = [np.cross(x - ray.origins, ray.directions) for ray in rays]
        return (np.sqrt(weights)[:, None] * arms).ravel()

    starts = np.array([[3, -4, 300.0], [8, 1, 340.0], [-2, -4, 240.0]])
    best = min((least_squares(miss, x, xtol=1e-14, ftol=1e-14) for x in starts), key=lambda one: one.cost)
    # 1e-3 of a standard deviation: the weights come from differences
    spread = np.sqrt(np.diag(found.covariance))
    np.testing.assert_allclose((found.points - best.x) / spread, 0, atol=1e-3)


@pytest.mark.parametrize("weighted", [True, False])
@pytest.mark.parametrize("name", ["prism, straight lens", "biprism in water, bent lens"])
def test_covariance_of_nearest_points_is_that_of_samples(name, weighted, rng):
    views = SETUPS[name].rig().unbounded()
    points = rng.uniform([-10, -10, 200], [10, 10, 400], (2, 3))
    sigma = np.array([0.02, 0.05, 0.03])[: len(views)]
    assert_covariance_is_that_of_samples(
        lambda p: nearest_to_rays(views, p, sigma, weighted), views.project, points, sigma, rng
    )


@pytest.mark.parametrize("name", sorted(PAIRS))
def test_no_method_is_better_than_the_optimum(name, rng):
    views = PAIRS[name]
    pixels = np.stack([view.unbounded().project(POINTS) for view in views], 1)
    best = triangulate([view.unbounded() for view in views], pixels, 0.1).covariance
    for other in (midpoint, nearest_to_rays):
        gain = np.linalg.eigvalsh(other([view.unbounded() for view in views], pixels, 0.1).covariance - best)
        assert (gain > -1e-9 * np.linalg.norm(best, axis=(1, 2))[:, None]).all()
    assert_covariance_is_that_of_samples(
        lambda p: midpoint([view.unbounded() for view in views], p, 0.02),
        lambda x: np.stack([view.unbounded().project(x) for view in views], 1), POINTS, 0.02, rng,
    )  # fmt: skip


def test_a_midpoint_loses_across_the_epipolar_plane_when_one_view_is_farther():
    views = [pinhole((0, 0, -400), focal=(900, 900)).unbounded(), pinhole((60, 0, 0), focal=(900, 900)).unbounded()]
    point = np.array([10.0, 0.0, 400.0])
    pixels = np.stack([view.project(point) for view in views])
    equal, best = (method(views, pixels, 0.1).covariance for method in (midpoint, triangulate))
    # y is a mean of two measures with variances a and b as 800^2 to 400^2: (a + b) / 4 against a b / (a + b)
    assert equal[1, 1] / best[1, 1] == pytest.approx((4 + 1) ** 2 / (4 * 4 * 1), rel=1e-6)
    # depth, which the epipolar plane gives alone, loses next to nothing
    assert equal[2, 2] / best[2, 2] == pytest.approx(1, abs=0.01)
    # between the views that a prism makes nothing is lost: 0.1 %
    rig = SETUPS["biprism in water, straight lens"].rig().unbounded()
    pixels = rig.project([0.0, 0.0, 300.0])
    equal, best = (method(rig, pixels, 0.1).covariance for method in (midpoint, triangulate))
    assert np.linalg.eigvals(np.linalg.solve(best, equal)).real.max() == pytest.approx(1, abs=1e-3)


def test_missing_views_and_parting_rays(rng):
    views = SETUPS["prism, straight lens"].rig().unbounded()
    point = np.array([3.0, -4.0, 300.0])
    pixels = views.project(point)
    spoilt = pixels.copy()
    spoilt[2] = np.nan
    found = nearest_to_rays(views, np.stack([pixels, spoilt]), [[0.1, 0.1, 0.1], [0.1, 0.1, np.nan]])
    np.testing.assert_array_equal(found.views, [3, 2])
    np.testing.assert_allclose(found.points, [point, point], atol=1e-8)
    two = nearest_to_rays(views[:2], pixels[:2], 0.1)
    np.testing.assert_allclose(found.covariance[1], two.covariance, rtol=1e-9)
    spoilt[1] = np.nan
    assert np.isnan(nearest_to_rays(views, spoilt).points).all()
    pair = [view.unbounded() for view in PAIRS["side by side"]]
    together = np.stack([view.project(POINTS[0]) for view in pair])
    apart = together + np.array([[-100, 0], [100, 0]])
    for method in (midpoint, nearest_to_rays):
        found = method(pair, np.stack([together, apart]))
        np.testing.assert_array_equal(np.isnan(found.points).all(-1), [False, True])


# ---- the optimum of two pinholes


@pytest.mark.parametrize("name", sorted(PAIRS))
def test_optimum_is_that_of_a_search(name, rng):
    views = PAIRS[name]
    pixels = np.stack([view.unbounded().project(POINTS) for view in views], 1)
    pixels = pixels + rng.normal(0, 2.0, pixels.shape)
    found = optimal(views, pixels, 2.0)
    direct = triangulate([view.unbounded() for view in views], pixels, 2.0)
    # 1e-6: both solve the same equations; three steps of Gauss and Newton leave that much of 2 px of noise
    np.testing.assert_allclose(found.points, direct.points, rtol=1e-5)
    np.testing.assert_allclose(found.covariance, direct.covariance, rtol=1e-3)
    for point, pixel, residual, start in zip(found.points, pixels, found.residual, POINTS, strict=True):
        search = brute_force(views, pixel, 1.0, [start, start * [1, 1, 0.7], start * [0.5, 2, 1.5]])
        np.testing.assert_allclose(point, search.x, rtol=1e-6)
        assert residual == pytest.approx(np.sqrt(search.cost * 2 / 4), rel=1e-9)


@pytest.mark.parametrize("name", ["turned", "one behind the other", "one mirrored"])
def test_nearest_pairs_are_those_of_opencv(name, rng):
    views = PAIRS[name]
    pixels = np.stack([view.unbounded().project(POINTS) for view in views], 1)
    pixels = pixels + rng.normal(0, 2.0, pixels.shape)
    matrix = fundamental_matrix(*views)
    found = nearest_pair(matrix, pixels)
    other = cv2.correctMatches(matrix, pixels[None, :, 0], pixels[None, :, 1])
    # 1e-4 px: OpenCV finds roots of a polynomial of degree 6, whose coefficients span many orders
    np.testing.assert_allclose(found, np.stack([other[0][0], other[1][0]], 1), atol=1e-4)
    ends = [np.concatenate([found[:, k], np.ones((3, 1))], -1) for k in (0, 1)]
    # 1e-11 of F's norm: roundings of 600 px twice
    np.testing.assert_allclose(np.einsum("ni,ij,nj->n", ends[1], matrix, ends[0]), 0, atol=1e-11)
    np.testing.assert_allclose(nearest_pair(matrix, found), found, atol=1e-9)


@pytest.mark.parametrize("bent", [False, True])
def test_covariance_of_the_optimum_is_that_of_samples(bent, rng):
    distortion = BENT if bent else (0.0,) * 5
    views = [
        pinhole((-60, 5, 0), (0.02, 0.15, 0.01), distortion=distortion),
        pinhole((50, -10, 20), (-0.03, -0.12, 0.4), mirrored=True, distortion=distortion),
    ]
    assert_covariance_is_that_of_samples(
        lambda p: optimal(views, p, 0.02),
        lambda x: np.stack([view.unbounded().project(x) for view in views], 1), POINTS, 0.02, rng,
    )  # fmt: skip


def test_virtual_cameras_put_points_where_they_are_off():
    """The optimum for pinholes is biased where views are none: triangulate, which follows rays, is not."""
    rig = SETUPS["biprism in water, straight lens"].rig()
    depths = (200, 400)
    cameras = [fit(view, depths) for view in rig]
    assert all(isinstance(camera, VirtualCamera) for camera in cameras)
    point = np.array([[12.0, 25.0, 380.0]])
    pixels = rig.unbounded().project(point)
    off = np.linalg.norm(optimal(cameras, pixels).points - point)
    assert 1e-4 < off < 20
    np.testing.assert_allclose(triangulate(rig.unbounded(), pixels).points, point, atol=1e-7)


def test_behind_a_camera_is_nowhere():
    views = PAIRS["side by side"]
    pixels = np.stack([view.project(POINTS[:1]) for view in views], 1)
    crossed = pixels + np.array([[-100, 0], [100, 0]])
    found = optimal(views, np.concatenate([pixels, crossed, pixels * np.nan]))
    np.testing.assert_array_equal(np.isnan(found.points).all(-1), [False, True, True])
    np.testing.assert_array_equal(found.views, [2, 2, 0])


# ---- weights, and wrong calls


def test_weighted_reprojection_is_that_of_a_search(rng):
    views = SETUPS["prism, straight lens"].rig().unbounded()
    sigma = np.array([0.2, 1.5, 0.6])
    pixels = views.project([3.0, -4.0, 300.0]) + rng.normal(0, 1, (3, 2)) * sigma[:, None]
    found = triangulate(views, pixels, sigma)
    search = brute_force(views, pixels, sigma, [[0, 0, 250.0], [5, -5, 320.0], [3, -4, 300.0]])
    spread = np.sqrt(np.diag(found.covariance))
    np.testing.assert_allclose((found.points - search.x) / spread, 0, atol=1e-3)
    np.testing.assert_allclose(found.covariance, np.linalg.inv(search.jac.T @ search.jac), rtol=1e-3)
    assert_covariance_is_that_of_samples(
        lambda p: triangulate(views, p, sigma / 20),
        views.project,
        np.array([[3.0, -4.0, 300.0]]),
        sigma / 20,
        rng,
        2000,
    )


def test_views_over_mirrors_by_every_method(rng):
    wall = Mirror((40.0, 0.0, 120.0), (-1.0, 0.0, 0.25), (200.0, 200.0))
    rig = Setup(Camera((640, 480), 700), Mirrors((wall,), ((0,),), direct=True)).rig().unbounded()
    assert [view.mirrored for view in rig].count(True) == 1
    points = np.array([[5.0, 3.0, 260.0]])
    pixels = rig.project(points)
    assert np.isfinite(pixels).all()
    for method in (midpoint, nearest_to_rays, triangulate):
        np.testing.assert_allclose(method(rig, pixels).points, points, atol=1e-8)


def test_wrong_calls_are_explained():
    views, pixels = PAIRS["turned"], np.zeros((2, 2))
    with pytest.raises(ShapeError, match="a midpoint is that of 2 rays, got 3 views"):
        midpoint([*views, views[0]], np.zeros((3, 2)))
    with pytest.raises(ShapeError, match="for 2 cameras, got 3"):
        optimal([*views, views[0]], np.zeros((3, 2)))
    with pytest.raises(OpticError, match="no pinhole camera: use triangulate"):
        optimal(SETUPS["biprism in water, straight lens"].rig().views, pixels)
    with pytest.raises(ShapeError, match="one number"):
        optimal(views, pixels, np.array([0.1, 0.2]))
    for method in (midpoint, nearest_to_rays, triangulate):
        with pytest.raises(ShapeError, match=r"\(..., 2, 2\), one pixel for each view, got \(5, 2\)"):
            method(views, np.zeros((5, 2)))
        with pytest.raises(SetupError, match="positive and finite"):
            method(views, pixels, -0.1)
        with pytest.raises(ShapeError, match="sigma must be"):
            method(views, pixels, np.ones(3))
    with pytest.raises(ShapeError, match=r"\(3, 3\)"):
        nearest_pair(np.eye(2), pixels)


def test_true_pixels_of_the_renderer_give_true_points(mitsuba):
    truth, rig = np.load(mitsuba / "scenes" / "n3_round.npz"), renderer_setup("n3").rig()
    known = np.isfinite(truth["match_uv"]).all((1, 2))
    pixels, points = truth["match_uv"][known][:300].astype(float), truth["match_xyz"][known][:300]
    found = nearest_to_rays(rig, pixels)
    # 0.02 mm: the file holds pixels to 6e-5 px, and 0.04 px stand for a mm of depth
    np.testing.assert_allclose(found.points, points, atol=0.02)
