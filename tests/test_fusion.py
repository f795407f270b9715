"""Fusion of depth maps: on surfaces of closed form, and on true depths of the renderer."""

import numpy as np
import pytest
from depth_maps import SIGMA, across, depth_map, maps_of, plane, sphere, step
from scenes import small_setup
from scipy.ndimage import gaussian_filter, map_coordinates
from scipy.spatial import cKDTree
from setups import mirrors_beside

from benchmarks.data import renderer_setup
from cyclopean import Camera, Setup
from cyclopean.errors import OpticError, SetupError, ShapeError
from cyclopean.fusion import build_mesh, fuse
from cyclopean.fusion.continuity import connected
from cyclopean.matching import DepthMap


def unfused(rig, maps):
    """Points (N, 3) of all pixels of all maps."""
    points = []
    for view, own in zip(rig, maps, strict=True):
        rows, columns = np.nonzero(np.isfinite(own.inverse_depth))
        pixels = np.stack([columns, rows], -1) + own.origin
        points.append(view.rays(pixels).at_depth(1 / own.inverse_depth[rows, columns].astype(float)))
    return np.concatenate(points)


@pytest.fixture(scope="module")
def rig():
    return small_setup().rig()


# The cloud.


@pytest.mark.parametrize(("surface", "foreshortened"), [(plane, 1.0), (step, 1.0), (sphere, 2.5)])
def test_each_surface_is_there_once(rig, surface, foreshortened):
    maps = maps_of(rig, surface)
    every = unfused(rig, maps)
    cloud = fuse(rig, maps)
    assert len(cloud.points) < 0.75 * len(every)
    tree = cKDTree(cloud.points)
    away = tree.query(every)[0] / (every[:, 2] / 600)  # in pixels on the surface
    if surface is sphere:
        away = away[every[:, 2] < 730]  # at the limb pixels lie far apart
    assert away.max() < 1.5 * foreshortened  # within a pixel's diagonal
    between = tree.query(cloud.points, 2)[0][:, 1] / (cloud.points[:, 2] / 600)
    # along the seam of two samplings points come nearer than a pixel; anywhere else they lie a pixel apart
    assert np.mean(between < 0.6) < 0.01
    assert np.median(between) > 0.9


def test_points_lie_on_the_surface_on_their_rays_and_know_who_sees_them(rig):
    cloud = fuse(rig, maps_of(rig, plane))
    # bilinear between pixels of a plane is exact, but for the bend of rays through a prism; float32 is 1e-4 mm
    assert np.abs(cloud.points[:, 2] - 800 - 0.3 * cloud.points[:, 0]).max() < 2e-3
    seen = np.zeros(len(cloud.points), int)
    for k, view in enumerate(rig):
        mine = cloud.view == k
        np.testing.assert_allclose(view.project(cloud.points[mine]), cloud.pixels[mine], atol=1e-6)
        seen += view.region.contains(view.project(cloud.points))
    assert np.mean(seen == cloud.views) > 0.98  # at its outline a map has points up to a pixel beyond
    assert (np.abs(seen - cloud.views.astype(int)) <= 1).all()


def test_what_hides_in_one_view_comes_from_another(rig):
    maps = maps_of(rig, step)
    cloud = fuse(rig, maps)
    behind = cloud.points[:, 2] > 800
    assert set(np.unique(cloud.view[behind])) == {0, 1, 2}
    assert (np.minimum(np.abs(cloud.points[:, 2] - 700), np.abs(cloud.points[:, 2] - 900)) < 1e-3).all()  # none between


def test_maps_that_disagree_stay_apart(rig):
    maps = maps_of(rig, plane)
    other = maps_of(rig, lambda rays: plane(rays, 740))
    mixed = [maps[0], other[1], other[2]]
    cloud = fuse(rig, mixed)
    assert (cloud.views[cloud.view == 0] == 1).all()
    assert len(cloud.points) > np.isfinite(maps[0].inverse_depth).sum() + len(fuse(rig, other).points) / 2


def test_one_view_alone_keeps_its_points_and_none_gives_none(rig):
    maps = maps_of(rig, plane)
    blind = [maps[0], *(depth_map(view, np.full(rig.size[::-1], np.nan)) for view in rig[1:])]
    cloud = fuse(rig, blind)
    np.testing.assert_allclose(cloud.points, unfused(rig, blind), rtol=1e-7)
    assert (cloud.views == 1).all()
    nothing = [depth_map(view, np.full(rig.size[::-1], np.nan)) for view in rig]
    assert len(fuse(rig, nothing).points) == 0
    assert len(build_mesh(rig, nothing).faces) == 0


# Uncertainty.


def noisy_maps(rig, correlation, sigma, seed):
    """Maps of a plane with noise of a stated correlation between the views, smooth over some pixels as matching is."""
    rng = np.random.default_rng(seed)

    def field(shape):
        values = gaussian_filter(rng.normal(size=shape), 2.0, mode="wrap")
        return values / values.std()

    shared = field((400, 400))
    maps = []
    for view, own in zip(rig, maps_of(rig, plane), strict=True):
        height, width = own.inverse_depth.shape
        grid = np.stack(np.meshgrid(np.arange(width), np.arange(height)), -1) + own.origin
        points = view.unbounded().rays(grid).at_depth(1 / own.inverse_depth.astype(float))
        place = np.nan_to_num(points[..., 1::-1]) / (800 / 600) + 200  # about a pixel to an element
        common = map_coordinates(shared, np.moveaxis(place, -1, 0), order=1, mode="wrap")
        noise = np.sqrt(correlation) * common + np.sqrt(1 - correlation) * field((height, width))
        spread = np.where(np.isfinite(own.sigma), sigma, np.nan).astype(np.float32)
        maps.append(DepthMap(own.origin, (own.inverse_depth + sigma * noise).astype(np.float32), spread, own.score))
    return maps


@pytest.mark.parametrize("correlation", [0.0, 0.5, 1.0])
def test_merged_depths_err_as_they_state(rig, correlation):
    cloud = fuse(rig, noisy_maps(rig, correlation, 4e-6, 11), correlation=correlation)
    merged = cloud.views == 3
    truth = 800 / (1 - 0.3 * cloud.points[:, 0] / cloud.points[:, 2])
    error = (1 / cloud.points[:, 2] - 1 / truth)[merged]
    stated = np.sqrt(cloud.covariance[merged, 2, 2]) / cloud.points[merged, 2] ** 2
    chi_square = np.mean((error / stated) ** 2)
    # about 400 patches of noise: 7 %; between pixels noise is interpolated, which takes up to 15 % of its variance
    assert 0.7 < chi_square < 1.2
    safe = fuse(rig, noisy_maps(rig, correlation, 4e-6, 11))
    assert np.mean(safe.covariance[merged, 2, 2]) >= 0.999 * np.mean(cloud.covariance[merged, 2, 2])


def test_covariance_is_the_spread_along_the_ray_and_its_pixels_across(rig):
    cloud = fuse(rig, maps_of(rig, plane))
    for n in range(0, len(cloud.points), 2503):
        view, pixel, point = rig[int(cloud.view[n])].unbounded(), cloud.pixels[n], cloud.points[n]
        further = view.rays(pixel).at_depth(1 / (1 / point[2] + SIGMA))
        others = [other.unbounded() for j, other in enumerate(rig) if j != cloud.view[n]]
        noise = max(np.linalg.norm(other.project(further) - other.project(point)) for other in others)
        across = [
            (view.rays(pixel + half).at_depth(point[2]) - view.rays(pixel - half).at_depth(point[2])) * noise
            for half in ([0.5, 0], [0, 0.5])
        ]
        factor = np.stack([further - point, *across], -1)
        # the motion is taken over another step of depth, over which it changes by some 1e-3
        np.testing.assert_allclose(
            cloud.covariance[n], factor @ factor.T, rtol=3e-3, atol=1e-5 * cloud.covariance[n].max()
        )


# Normals.


def test_normals_of_a_plane_and_of_a_sphere(rig):
    cloud = fuse(rig, maps_of(rig, plane))
    normal = np.array([0.3, 0, -1]) / np.hypot(0.3, 1)
    assert np.isfinite(cloud.normals).all(-1).mean() > 0.999
    assert np.nanmax(degrees(cloud.normals, normal)) < 0.2  # inverse depth over a prism's pixels is not quite linear
    cloud = fuse(rig, maps_of(rig, sphere), normal_radius=2)
    normal = (cloud.points - (5.0, -3.0, 760.0)) / 60
    inside = normal[:, 2] < -0.5  # not at the limb
    error = degrees(cloud.normals[inside], normal[inside])
    assert np.median(error) < 1  # the plane spans 5 px, 6 to 12 degrees of the sphere
    assert np.nanmax(error) < 5


def degrees(normals, truth):
    """Angles between unit vectors; those towards the camera and away from it are 180 degrees apart."""
    return np.degrees(np.arccos(np.clip((normals * truth).sum(-1), -1, 1)))


def test_normals_do_not_look_across_a_step(rig):
    cloud = fuse(rig, maps_of(rig, step))
    assert np.nanmax(degrees(cloud.normals, np.array([0, 0, -1.0]))) < 0.2
    assert np.isfinite(cloud.normals[:, 0]).mean() > 0.99


def test_normals_and_triangles_face_the_camera_in_a_mirror():
    rig = Setup(small_setup().camera, mirrors_beside()).rig()
    maps = maps_of(rig, lambda rays: plane(rays, 700, 0.1))
    cloud, mesh = fuse(rig, maps), build_mesh(rig, maps)
    assert {0, 1} <= set(cloud.view)
    assert np.nanmax(degrees(cloud.normals, np.array([0.1, 0, -1]) / np.hypot(0.1, 1))) < 0.2
    assert (across(mesh)[:, 2] < 0).all()


# Continuity.


@pytest.mark.parametrize(
    ("what", "depths", "torn"),
    [
        ("a slope", [0, 1, 2, 3, 4, 5, 6, 7], []),
        ("a roof", [0, 1, 2, 3, 2, 1, 0, -1], []),
        ("a kink", [0, 0, 0, 0, 1, 2, 3, 4], []),
        ("noise", [0, 0.1, -0.1, 0, 0.1, 0, -0.1, 0], []),
        ("a step", [0, 0, 0, 0, 5, 5, 5, 5], [3]),
        ("a step on a slope", [0, 1, 2, 3, 9, 10, 11, 12], [3]),
        ("a pixel that mixes two sides", [0, 0, 0, 2, 5, 5, 5, 5], [2, 3]),
        ("one wrong pixel", [0, 0, 0, 5, 0, 0, 0, 0], [2, 3]),
        ("steeper than two views can see", [0, 60, 120, 180, 240, 300, 360, 420], [0, 1, 2, 3, 4, 5, 6]),
    ],
)
def test_a_surface_is_torn_where_it_jumps(what, depths, torn):
    depth = 1e-3 + 1e-6 * np.array([depths])
    sigma, motion = np.full_like(depth, 0.05e-6), np.full_like(depth, 2e4)  # a pixel of motion for 50e-6
    right, _ = connected(depth, sigma, motion)
    assert list(np.flatnonzero(~right[0, :-1])) == torn, what
    _, down = connected(depth.T, sigma.T, motion.T)
    assert list(np.flatnonzero(~down[:-1, 0])) == torn, what


# The renderer's scenes.


@pytest.mark.parametrize("name", ["n3_round", "n4_steps"])
def test_true_depths_of_the_renderer_fuse(mitsuba, name):
    truth = np.load(mitsuba / "scenes" / f"{name}.npz")
    full, every = renderer_setup(name[:2]), int(truth["step"])
    width, height = np.array(full.camera.size) // every
    camera = Camera((width, height), full.camera.focal[0] / every, np.array(full.camera.centre) / every)
    rig = Setup(camera, full.optic).rig()  # pixel i of it is pixel `every` i of the photograph
    points = truth["xyz"].astype(float)
    rng = np.random.default_rng(8)
    sigma = 3e-7  # 1/mm, 0.3 mm at 1000 mm
    noise = sigma * np.stack([rng.normal(size=points.shape[:2]) for _ in rig])
    maps = [depth_map(view, 1 / points[..., 2] + error, sigma) for view, error in zip(rig, noise, strict=True)]
    cloud = fuse(rig, maps)
    every_point = points[rig.masks.any(0)]
    every_point = every_point[np.isfinite(every_point[:, 2])]
    tree = cKDTree(cloud.points)
    # pitches of 1 to 2.7 mm at 600 to 1600 mm; a point stays covered if one lies within two of them
    assert np.mean(tree.query(every_point)[0] > 2 * every_point[:, 2] / camera.focal[0]) < 0.002
    pitch = cloud.points[:, 2] / camera.focal[0]
    assert np.mean(tree.query(cloud.points, 2)[0][:, 1] < 0.6 * pitch) < 0.01
    assert len(cloud.points) < 0.6 * len(every_point)
    error = cloud.points[:, 2] - points[cloud.pixels[:, 1], cloud.pixels[:, 0], 2]
    chi_square = np.median((error**2 / cloud.covariance[:, 2, 2])[cloud.views == 2]) / 0.455  # median of chi^2, 1 dof
    # pixels' noise is independent here, which the default does not count on; between pixels it is less: 0.36 to 0.5
    assert 0.3 < chi_square < 0.6


def test_wrong_calls_are_refused(rig):
    maps = maps_of(rig, plane)
    for call, error, said in (
        (lambda: fuse(rig, maps[:2]), ShapeError, "one depth map a view, 3 in all, got 2"),
        (lambda: fuse(rig[:1], maps[:1]), OpticError, "at least two views"),
        (lambda: fuse(rig, maps, tolerance_px=-1), SetupError, "tolerance"),
        (lambda: fuse(rig, maps, correlation=1.5), SetupError, "between 0 and 1, got 1.5"),
        (lambda: fuse(rig, maps, normal_radius=0), SetupError, "normals"),
        (lambda: build_mesh(rig, maps, stride=0), SetupError, "stride"),
        (lambda: build_mesh(rig, maps, stride=1.5), SetupError, "stride"),
    ):
        with pytest.raises(error, match=said):
            call()
