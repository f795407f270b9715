"""Points from pixels: exact ones, the likeliest ones, and how far noise throws them."""

import numpy as np
import pytest
from scipy.optimize import least_squares
from scipy.stats import chi2
from setups import SETUPS, STRAIGHT

from cyclopean import Camera, Prism, Setup
from cyclopean.errors import ShapeError
from cyclopean.triangulation import point_covariance, triangulate

RIGS = ["prism, straight lens", "prism, facets to camera, bent lens", "biprism in water, bent lens"]
RIGS += ["two mirrors, bent lens"]


@pytest.fixture
def rng():
    return np.random.default_rng(5)


def points_in_view(rig, count, rng, inset=5):
    """Points (count, 3) that all views see, `inset` px or more from their borders."""
    points = rng.uniform([-60, -50, 150], [60, 50, 500], (60000, 3))
    seen = np.isfinite(rig.project(points)).all((-1, -2))
    points = points[seen]
    pixels = rig.project(points)
    around = inset * np.array([[1, 0], [-1, 0], [0, 1], [0, -1]])
    for k, view in enumerate(rig):
        inside = np.isfinite(view.rays(pixels[:, k, None] + around).directions).all((-1, -2))
        points, pixels = points[inside], pixels[inside]
    assert len(points) >= count
    return points[:count]


def common_rig(name):
    """The views of a rig that have something in common: of the mirrors, the one over both and the direct one."""
    rig = SETUPS[name].rig()
    return rig if "mirrors" not in name else rig[::2]


@pytest.mark.parametrize("name", RIGS[:3])
@pytest.mark.parametrize("shape", [(), (2, 0), (2, 1, 3)])
def test_exact_pixels_give_the_point_back(name, shape, rng):
    rig = common_rig(name)
    points = points_in_view(rig, 6, rng)[: int(np.prod(shape))].reshape(*shape, 3)
    found = triangulate(rig, rig.project(points))
    # 1e-8 mm: roundings of pixels, 1e-13, times the worst mm a px
    np.testing.assert_allclose(found.points, points, rtol=0, atol=1e-8)
    np.testing.assert_allclose(found.residual, 0, atol=1e-9)
    assert found.covariance.shape == (*shape, 3, 3)
    assert found.residual.shape == found.views.shape == shape
    assert (found.views == len(rig)).all()


@pytest.mark.parametrize("name", RIGS[:3])
def test_noisy_pixels_give_the_likeliest_point(name, rng):
    rig = common_rig(name)
    points = points_in_view(rig, 4, rng)
    pixels = rig.project(points) + rng.normal(0, 0.5, (4, len(rig), 2))
    found = triangulate(rig, pixels)
    for point, pixel, likeliest, residual in zip(points, pixels, found.points, found.residual, strict=True):
        search = least_squares(
            lambda x, pixel=pixel: (rig.unbounded().project(x) - pixel).ravel(), point, xtol=1e-15, ftol=1e-15
        )
        # 1e-3 of a standard deviation: both stop well before that matters
        spread = np.sqrt(np.diag(point_covariance(rig, point[None], 0.5)[0]))
        np.testing.assert_allclose((likeliest - search.x) / spread, 0, atol=1e-3)
        assert residual == pytest.approx(np.sqrt(np.mean(search.fun**2)), rel=1e-5)


@pytest.mark.parametrize("name", RIGS[:3])
def test_covariance_is_that_of_samples(name, rng):
    rig, sigma, count = common_rig(name), 0.05, 1000
    points = points_in_view(rig, 4, rng)
    pixels = rig.project(points)[:, None] + rng.normal(0, sigma, (4, count, len(rig), 2))
    found = triangulate(rig, pixels, sigma)
    miss = found.points - points[:, None]
    for covariance in (found.covariance, point_covariance(rig, points, sigma)[:, None]):
        squares = np.einsum("...i,...ij,...j->...", miss, np.linalg.inv(covariance), miss)
        # chance fails one seed in 5000; 1 %: the noise is small, yet not infinitely so
        low, high = chi2.ppf([1e-4, 1 - 1e-4], 3 * squares.size)
        assert 0.99 * low < squares.sum() < 1.01 * high
    # what is left over: 2 V coordinates less 3
    left = found.residual**2 * 2 * len(rig) / sigma**2
    low, high = chi2.ppf([1e-4, 1 - 1e-4], (2 * len(rig) - 3) * left.size)
    assert 0.99 * low < left.sum() < 1.01 * high


def test_depth_noise_is_that_of_the_textbook():
    distance, thickness, focal, depth, sigma = 200.0, 15.0, 2400, 1000.0, 0.1
    rig = Setup(Camera((1280, 960), focal), Prism(2, 12, 1.5168, distance, thickness)).rig()
    spread = np.sqrt(np.diag(point_covariance(rig, [0, 0, depth], sigma)))
    deviation = np.arcsin(1.5168 * np.sin(np.radians(12))) - np.radians(12)
    baseline = 2 * (distance + thickness) * np.tan(deviation)
    # Z^2 / (f B) times the noise of a disparity, sqrt(2) sigma; 6 %: a wedge magnifies the picture a little
    assert spread[2] == pytest.approx(depth**2 / (focal * baseline) * np.sqrt(2) * sigma, rel=0.06)
    # Z / f times the noise of two views; 3 %: the path through the glass
    assert spread[1] == pytest.approx(depth / focal * sigma / np.sqrt(2), rel=0.03)
    # exactly, by how the disparity changes with depth; 1e-5: a difference over 2 mm in 1000
    disparity = np.diff(rig.project([[0, 0, depth - 1], [0, 0, depth + 1]])[:, :, 0], axis=1)
    assert spread[2] == pytest.approx(np.sqrt(2) * sigma * 2 / abs(np.diff(disparity, axis=0).item()), rel=1e-5)


def test_noise_scales_the_covariance(rng):
    rig = common_rig(RIGS[0])
    points = points_in_view(rig, 3, rng)
    once, many = point_covariance(rig, points, 1.0), point_covariance(rig, points, np.array([1.0, 2, 3]))
    np.testing.assert_allclose(many, once * np.array([1, 4, 9])[:, None, None], rtol=1e-12)
    np.testing.assert_allclose(triangulate(rig, rig.project(points), 0.3).covariance, 0.09 * once, rtol=1e-6)


def test_a_view_that_does_not_see_the_point_does_not_count(rng):
    rig = common_rig(RIGS[0])
    points = points_in_view(rig, 3, rng)
    pixels = rig.project(points) + rng.normal(0, 0.1, (3, 3, 2))
    two = triangulate(rig[:2], pixels[:, :2])
    nowhere, wrong = pixels.copy(), pixels.copy()
    nowhere[:, 2] = np.nan
    wrong[:, 2] = pixels[:, 0]  # a pixel of another facet
    for spoilt in (nowhere, wrong):
        found = triangulate(rig, spoilt)
        # roundings of 500 mm
        np.testing.assert_allclose(found.points, two.points, rtol=1e-12)
        np.testing.assert_allclose(found.covariance, two.covariance, rtol=1e-9)
        np.testing.assert_allclose(found.residual, two.residual, rtol=1e-6)
        np.testing.assert_array_equal(found.views, 2)
    chosen = point_covariance(rig, two.points, seen=[True, True, False])
    np.testing.assert_allclose(chosen, two.covariance, rtol=1e-6)


def test_one_view_is_not_enough(rng):
    rig = common_rig(RIGS[0])
    pixels = rig.project(points_in_view(rig, 2, rng))
    pixels[:, 1:] = np.nan
    pixels[1, 0] = np.nan
    found = triangulate(rig, pixels)
    assert np.isnan(found.points).all()
    assert np.isnan(found.covariance).all()
    assert np.isnan(found.residual).all()
    np.testing.assert_array_equal(found.views, [1, 0])
    assert np.isnan(point_covariance(rig, [0, 0, 30.0])).all()  # behind the glass: no view sees it
    assert np.isnan(point_covariance(rig, [[0, 0, 300.0]], seen=[True, False, False])).all()


def test_rays_that_part_meet_nowhere():
    rig = Setup(STRAIGHT, Prism(2, 10, 1.5168, 60)).rig()
    together = rig.project([0, 0, 300.0])
    apart = together + np.array([[200, 0], [-200, 0]])  # their lines cross behind the camera
    found = triangulate(rig, np.stack([together, apart]))
    np.testing.assert_array_equal(np.isnan(found.points).all(-1), [False, True])
    np.testing.assert_array_equal(np.isnan(found.residual), [False, True])


def test_pixels_of_the_wrong_shape_are_named():
    rig = common_rig(RIGS[0])
    with pytest.raises(ShapeError, match=r"must have shape \(..., 3, 2\), one pixel for each view, got \(7, 2, 2\)"):
        triangulate(rig, np.zeros((7, 2, 2)))
    with pytest.raises(ShapeError, match=r"must have shape \(..., 3, 2\), one pixel for each view, got \(2,\)"):
        triangulate(rig, np.zeros(2))
