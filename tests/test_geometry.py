"""Poses, rays and polygons against their laws, closed forms and brute force."""

import numpy as np
import pytest
from scipy.linalg import expm
from scipy.stats import chi2

from cyclopean.errors import ShapeError
from cyclopean.geometry import (
    Pose,
    Rays,
    as_pixels,
    as_points,
    clip_by_half_plane,
    nearest_point,
    polygon_area,
    rotation_from_vector,
    rotation_vector_jacobian,
    shortest_rotation,
    shortest_segment,
)


@pytest.fixture
def rng():
    return np.random.default_rng(5)


def random_poses(rng, count):
    return [Pose.from_rotation_vector(rng.normal(size=3), rng.normal(size=3)) for _ in range(count)]


def unit(vectors):
    return vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)


def cross_matrix(vector):
    return np.cross(vector, np.eye(3)).T


# Poses


@pytest.mark.parametrize("shape", [(), (2, 0), (3, 1, 2)])
def test_poses_cancel(shape, rng):
    c_from_b, b_from_a = random_poses(rng, 2)
    points = rng.normal(size=(*shape, 3))
    # 1e-14: a few roundings of numbers near 1
    np.testing.assert_allclose((c_from_b @ b_from_a) @ points, c_from_b @ (b_from_a @ points), atol=1e-14)
    np.testing.assert_allclose(b_from_a.inverse @ (b_from_a @ points), points, atol=1e-14)


def test_rotation_is_the_exponential_of_its_vector():
    for vector in ([0, 0, 0], [1e-9, 0, 0], [0.3, -0.2, 0.5], [0, np.pi, 0]):
        # 1e-14: a few roundings of numbers near 1
        np.testing.assert_allclose(rotation_from_vector(vector), expm(cross_matrix(vector)), atol=1e-14)


@pytest.mark.parametrize("angle", [0.0, 1e-6, 0.99e-4, 1.01e-4, 0.1, 3.0])
def test_rotation_vector_jacobian_predicts_small_steps(angle):
    vector = angle * unit(np.array([0.6, -0.3, 0.7]))
    jacobian, h = rotation_vector_jacobian(vector), 1e-3
    for axis in np.eye(3):
        ahead, behind = (rotation_from_vector(vector + step * axis) for step in (h, -h))
        turn = (ahead - behind) / (2 * h) @ rotation_from_vector(vector).T
        # 1e-6: the error of central differences, h^2
        np.testing.assert_allclose(turn, cross_matrix(jacobian @ axis), atol=1e-6)


def test_rotation_vector_jacobian_is_smooth_where_its_series_ends():
    direction = unit(np.array([0.6, -0.3, 0.7]))
    below, above = (rotation_vector_jacobian(angle * direction) for angle in (0.9999999e-4, 1.0000001e-4))
    # the Jacobian itself changes by 1e-11 in between; 2e-12: what cancels in 1 - cos(1e-4)
    np.testing.assert_allclose(above - below, 0.5 * 2e-11 * cross_matrix(direction), atol=2e-12)


def test_shortest_rotation_takes_start_to_end_by_the_angle_between_them(rng):
    x = np.array([1.0, 0, 0])
    nearly = np.array([-1.0, 1e-9, 0])
    pairs = [*unit(rng.normal(size=(20, 2, 3))), (x, x), (x, -x), (x, nearly)]
    for start, end in pairs:
        rotation = shortest_rotation(3 * start, 0.5 * end)  # of any length
        np.testing.assert_allclose(rotation @ start, unit(end), atol=1e-14)  # a few roundings
        np.testing.assert_allclose(rotation @ rotation.T, np.eye(3), atol=1e-14)
        angle = np.arctan2(np.linalg.norm(np.cross(start, end)), start @ end)
        # 1e-14: a few roundings
        assert np.trace(rotation) == pytest.approx(1 + 2 * np.cos(angle), abs=1e-14)


# Arrays


def test_arrays_of_the_wrong_shape_are_named():
    with pytest.raises(ShapeError, match=r"pixels must have shape \(..., 2\), got \(2, 7\); did you mean pixels.T"):
        as_pixels(np.zeros((2, 7)))
    with pytest.raises(ShapeError, match=r"points must have shape \(..., 3\), got \(3, 2\); did you mean points.T"):
        as_points(np.zeros((3, 2)))
    with pytest.raises(ShapeError, match=r"points must have shape \(..., 3\), got \(\)$"):
        as_points(1.0)
    assert as_pixels([[1, 2], [3, 4]]).dtype == float


# Rays


def random_rays(rng, *shape):
    return Rays(rng.normal(size=(*shape, 3)), unit(rng.normal(size=(*shape, 3))))


@pytest.mark.parametrize("shape", [(), (2, 0), (3, 1, 2)])
def test_points_at_a_depth_lie_on_the_ray_at_that_depth(shape, rng):
    rays = random_rays(rng, *shape)
    ahead = np.abs(rng.normal(size=shape))
    points = rays.at_depth(rays.at(ahead)[..., 2])
    np.testing.assert_allclose(points, rays.at(ahead), atol=1e-11)  # roundings, divided by a small direction z
    behind = rays.at_depth(rays.at(-ahead)[..., 2])
    assert np.isnan(behind).all()
    assert rays.shape == shape


def test_rays_through_a_point_have_it_nearest(rng):
    points = rng.normal((0, 0, 1e5), size=(3, 2, 3))  # far away: no digits may be lost
    origins = points[..., None, :] + rng.normal(size=(3, 2, 4, 3))
    found = nearest_point(Rays(origins, unit(points[..., None, :] - origins)))
    # 1e-9: a rounding of 1e5 is 1.5e-11, and rays may cross at narrow angles
    np.testing.assert_allclose(found.points, points, rtol=0, atol=1e-9)
    np.testing.assert_allclose(found.rms, 0, atol=1e-10)


def test_nearest_point_is_the_least_squares_solution(rng):
    rays = random_rays(rng, 5)
    weights = rng.uniform(0.1, 3, 5)
    found = nearest_point(rays, weights)
    # the component of (point - origin) across each ray, as equations to solve
    across = np.sqrt(weights)[:, None, None] * (np.eye(3) - np.einsum("ni,nj->nij", rays.directions, rays.directions))
    right = np.einsum("nij,nj->ni", across, rays.origins)
    expected, total, *_ = np.linalg.lstsq(across.reshape(-1, 3), right.ravel(), rcond=None)
    # 1e-12: roundings, times the condition of a few rays
    np.testing.assert_allclose(found.points, expected, atol=1e-12)
    assert found.rms == pytest.approx(np.sqrt(total[0] / weights.sum()), rel=1e-12)


def test_a_weight_counts_like_as_many_rays(rng):
    rays = random_rays(rng, 3)
    thrice = nearest_point(rays[[0, 1, 2, 2, 2]])
    weighted = nearest_point(rays, [1, 1, 3])
    # 1e-12: roundings, times the condition of a few rays
    np.testing.assert_allclose(weighted.points, thrice.points, atol=1e-12)
    np.testing.assert_allclose(weighted.covariance, thrice.covariance, atol=1e-12)


def test_covariance_of_the_nearest_point_is_that_of_samples(rng):
    target, sigma, count = np.array([0.3, -0.2, 5.0]), np.array([0.01, 0.02, 0.015]), 4000
    origins = np.array([[-1.0, 0, 0], [1, 0.2, 0], [0, 1, 0.5]])
    directions = unit(target - origins)
    noise = rng.normal(size=(count, 3, 3)) * sigma[:, None]
    noise -= np.sum(noise * directions, -1, keepdims=True) * directions  # across the rays
    found = nearest_point(Rays(origins + noise, np.broadcast_to(directions, noise.shape)), 1 / sigma**2)
    miss = found.points - target
    squares = np.einsum("ni,nij,nj->n", miss, np.linalg.inv(found.covariance), miss)
    low, high = chi2.ppf([1e-4, 1 - 1e-4], 3 * count)  # fails by chance for one seed in 5000
    assert low < squares.sum() < high


def test_rays_that_do_not_exist_do_not_count(rng):
    rays = random_rays(rng, 4)
    origins, directions = rays.origins.copy(), rays.directions.copy()
    origins[1], directions[3] = np.nan, np.nan
    # 1e-12: roundings, times the condition of two rays
    np.testing.assert_allclose(
        nearest_point(Rays(origins, directions)).points, nearest_point(rays[[0, 2]]).points, atol=1e-12
    )


def test_one_ray_and_parallel_rays_have_no_nearest_point(rng):
    rays = random_rays(rng, 2)
    one = nearest_point(rays, [1.0, 0.0])
    parallel = nearest_point(Rays(rays.origins, np.broadcast_to(rays.directions[0], (2, 3))))
    none = nearest_point(Rays(np.full((2, 3), np.nan), np.full((2, 3), np.nan)))
    for found in (one, parallel, none):
        assert np.isnan(found.points).all()
        assert np.isnan(found.covariance).all()
        assert np.isnan(found.rms)


@pytest.mark.parametrize("shape", [(), (2, 0), (3, 1, 2)])
def test_shortest_segment_is_square_to_both_lines(shape, rng):
    first, second = random_rays(rng, *shape), random_rays(rng, *shape)
    start, end = shortest_segment(first, second)
    for rays, point in ((first, start), (second, end)):
        # 1e-12: roundings, times the condition of nearly parallel lines
        np.testing.assert_allclose(np.cross(point - rays.origins, rays.directions), 0, atol=1e-12)
        np.testing.assert_allclose(np.sum((end - start) * rays.directions, -1), 0, atol=1e-12)


def test_parallel_lines_have_no_shortest_segment(rng):
    rays = random_rays(rng, 1)
    assert np.isnan(shortest_segment(rays, Rays(rays.origins + 1, -rays.directions))).all()


# Polygons

PENTAGON = np.array([[0, 0], [4, -1], [5, 3], [2, 5], [-1, 2.0]])


def test_areas_of_known_polygons():
    assert polygon_area([[0, 0], [3, 0], [3, 2], [0, 2]]) == 6
    assert polygon_area([[0, 2], [3, 2], [3, 0], [0, 0]]) == 6  # the other way round
    angles = 2 * np.pi * np.arange(7) / 7
    heptagon = np.stack([np.cos(angles), np.sin(angles)], -1) + 100
    # 1e-11: roundings of the products of coordinates near 100
    assert polygon_area(heptagon) == pytest.approx(3.5 * np.sin(2 * np.pi / 7), abs=1e-11)


@pytest.mark.parametrize("offset", [-3.0, 0.0, 1.0, 2.5, 10.0])
def test_the_parts_of_a_clipped_polygon_make_the_whole(offset):
    normal = np.array([0.6, 0.8])
    inside, outside = clip_by_half_plane(PENTAGON, normal, offset), clip_by_half_plane(PENTAGON, -normal, -offset)
    assert (inside @ normal <= offset + 1e-12).all()  # roundings
    whole = polygon_area(inside) + polygon_area(outside)
    assert whole == pytest.approx(polygon_area(PENTAGON), rel=1e-14)


def test_clipping_far_away_leaves_all_or_nothing():
    np.testing.assert_array_equal(clip_by_half_plane(PENTAGON, [1, 0], 100), PENTAGON)
    assert clip_by_half_plane(PENTAGON, [1, 0], -100).shape == (0, 2)


def test_polygons_in_space_are_clipped_too():
    square = np.array([[0, 0, 1], [2, 0, 1], [2, 2, 3], [0, 2, 3.0]])
    half = clip_by_half_plane(square, [0, 0, 1], 2)
    np.testing.assert_array_equal(half, [[0, 0, 1], [2, 0, 1], [2, 1, 2], [0, 1, 2]])
