"""Fusion of depth maps: on surfaces of closed form, and on true depths of the renderer."""

import numpy as np
import pytest
import trimesh
from commands import run
from scenes import photograph_plane, small_setup
from scipy.ndimage import gaussian_filter, map_coordinates
from scipy.spatial import cKDTree

from benchmarks.data import renderer_setup
from cyclopean import Camera, Mirror, Mirrors, Setup, write_setup
from cyclopean.errors import OpticError, SetupError, ShapeError
from cyclopean.files import write_image, write_ply
from cyclopean.files.meshes import write_mesh
from cyclopean.fusion import build_mesh, fuse, kernels
from cyclopean.fusion.continuity import connected
from cyclopean.matching import DepthMap

SIGMA = 1e-6  # 1/mm: 0.6 mm at 800 mm, 0.008 px of motion


def plane(rays, depth=800.0, slope=0.3):
    """z (N,) of the plane z = depth + slope x."""
    return _hit(rays, np.array([-slope, 0, 1]), depth)


def step(rays):
    """z (N,) of a half-plane at 700 mm left of x = 12 mm, before a plane at 900 mm."""
    near = _hit(rays, np.array([0, 0, 1.0]), 700)
    left = rays.at_depth(near)[:, 0] < 12
    return np.where(left, near, _hit(rays, np.array([0, 0, 1.0]), 900))


def sphere(rays, centre=(5.0, -3.0, 760.0), radius=60.0):
    """z (N,) of a sphere, NaN beside it."""
    arm = rays.origins - np.array(centre)
    b, c = (arm * rays.directions).sum(-1), (arm**2).sum(-1) - radius**2
    with np.errstate(invalid="ignore"):
        return rays.at(-b - np.sqrt(b**2 - c))[:, 2]


def _hit(rays, normal, offset):
    return rays.at((offset - rays.origins @ normal) / (rays.directions @ normal))[:, 2]


def depth_map(view, inverse_depth, sigma=SIGMA):
    """A DepthMap of inverse depths (H, W) of the whole photograph, NaN unknown; only its own region counts."""
    x, y, width, height = view.region.box
    own = np.where(view.region.mask, inverse_depth, np.nan)[y : y + height, x : x + width].astype(np.float32)
    known = np.isfinite(own)
    spread = np.where(known, sigma, np.nan).astype(np.float32)
    return DepthMap((x, y), own, spread, known.astype(np.float32))


def maps_of(rig, surface):
    """The true depth map of a surface in every view."""
    maps = []
    for view in rig:
        rows, columns = np.nonzero(view.region.mask)
        inverse = np.full(rig.size[::-1], np.nan)
        inverse[rows, columns] = 1 / surface(view.rays(np.stack([columns, rows], -1)))
        maps.append(depth_map(view, inverse))
    return maps


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
    mirrors = tuple(Mirror((side * 40.0, 0.0, 200.0), (-side, 0.0, -0.02), (300.0, 200.0)) for side in (-1, 1))
    rig = Setup(small_setup().camera, Mirrors(mirrors, direct=True)).rig()
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


# The mesh.


def across(mesh):
    """Cross products (M, 3) mm^2 of the sides of each triangle: twice its area, towards where it faces."""
    a, b, c = np.moveaxis(mesh.vertices[mesh.faces], 1, 0)
    return np.cross(b - a, c - a)


def seen_share(rig, points):
    """Share of points (N, 3) that fall on the mask of some view."""
    return np.any([view.region.contains(view.project(points)) for view in rig], axis=0).mean()


@pytest.mark.parametrize("stride", [1, 3])
def test_the_mesh_of_a_plane_has_its_area(rig, stride):
    maps = maps_of(rig, plane)
    mesh = build_mesh(rig, maps, stride=stride)
    x, y = np.meshgrid(np.arange(-350, 350.0), np.arange(-250, 250.0))
    true = seen_share(rig, np.stack([x, y, 800 + 0.3 * x], -1).reshape(-1, 3)) * x.size * np.hypot(1, 0.3)
    # the outline is lost to half a stride, 1.3 mm a pixel, of some 450 x 300 mm; cells overlap at the seams
    assert mesh.area == pytest.approx(true, rel=0.01 * (1 + stride))
    assert len(np.unique(np.sort(mesh.faces, axis=1), axis=0)) == len(mesh.faces)
    assert (across(mesh)[:, 2] < 0).all()
    assert np.abs(mesh.vertices[:, 2] - 800 - 0.3 * mesh.vertices[:, 0]).max() < 5e-3
    edges = np.sort(mesh.faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
    assert (
        np.mean(np.unique(edges, axis=0, return_counts=True)[1] > 2) < 0.005 * stride
    )  # a surface: two faces at an edge


@pytest.mark.parametrize("stride", [1, 2])
def test_the_mesh_of_a_sphere_has_its_area(rig, stride):
    mesh = build_mesh(rig, maps_of(rig, sphere), stride=stride)
    turn = np.pi * (1 + 5**0.5) * np.arange(40_000)
    height = 1 - 2 * (np.arange(40_000) + 0.5) / 40_000
    ring = np.sqrt(1 - height**2)
    points = np.stack([ring * np.cos(turn), ring * np.sin(turn), height], -1)  # Fibonacci's lattice: equal areas
    points = points * 60 + (5.0, -3.0, 760.0)
    facing = ((points - (5.0, -3.0, 760.0)) * points).sum(-1) < 0
    true = seen_share(rig, points[facing]) * facing.mean() * 4 * np.pi * 60**2
    # the last pixel at the limb, which is lost, is 12 mm deep: a cap of radius 60 has its edge there
    assert 0.75 * true < mesh.area < 1.02 * true
    inside = mesh.vertices[mesh.faces][..., 2].mean(1) < 730  # where all is seen well
    cap = np.linalg.norm(across(mesh)[inside], axis=-1).sum() / 2
    assert cap == pytest.approx(2 * np.pi * 60 * 30, rel=0.02)  # a cap of height h has 2 pi r h; overlap at the seam
    away = np.linalg.norm(mesh.vertices - (5.0, -3.0, 760.0), axis=-1)[mesh.vertices[:, 2] < 730]
    assert np.abs(away - 60).max() < 0.15 * stride**2  # planes through 3 mm of a sphere, at up to 60 degrees


@pytest.mark.parametrize("stride", [1, 3])
def test_no_triangle_spans_a_step(rig, stride):
    mesh = build_mesh(rig, maps_of(rig, step), stride=stride)
    depth = mesh.vertices[mesh.faces][:, :, 2]
    assert np.ptp(depth, axis=1).max() < 0.01
    assert {700, 900} == set(np.unique(np.rint(depth)))


# Compiled kernels beside slow twins.


def look_up_slowly(place, depth, sigma, slack, other, right, down, deviations):
    """Inverse depth, its sigma, and whether the map has the point at all."""
    height, width = other.inverse_depth.shape
    left, top = np.floor(np.subtract(place, other.origin)).astype(int)
    near = [(r, c) for r in (top, top + 1) for c in (left, left + 1) if 0 <= r < height and 0 <= c < width]
    whole = len(near) == 4 and right[top, left] and right[top + 1, left] and down[top, left] and down[top, left + 1]
    x, y = np.subtract(place, other.origin) - (left, top)
    weights = np.outer([1 - y, y], [1 - x, x]).ravel()
    if whole:
        found = [
            sum(w * grid[one] for w, one in zip(weights, near, strict=True))
            for grid in (other.inverse_depth, other.sigma)
        ]
        agrees = abs(found[0] - depth) <= deviations * np.hypot(sigma, found[1]) + slack
        return (*found, True) if agrees else (np.nan, np.nan, False)
    limits = [deviations * np.hypot(sigma, other.sigma[one]) + slack for one in near]
    apart = [abs(other.inverse_depth[one] - depth) for one in near]
    return np.nan, np.nan, any(a <= limit for a, limit in zip(apart, limits, strict=True))


def test_looking_up_is_what_it_says():
    rng = np.random.default_rng(3)
    values = 1e-3 + 1e-5 * rng.integers(0, 3, (7, 9)) + 1e-7 * rng.normal(size=(7, 9))
    values[rng.uniform(size=values.shape) < 0.2] = np.nan
    other = DepthMap((20, 30), values, np.full((7, 9), 2e-6), np.ones((7, 9)))
    right, down = rng.uniform(size=(2, 7, 9)) < 0.85
    places = rng.uniform((18, 28), (31, 39), (800, 2))
    depth = 1e-3 + rng.uniform(-1e-5, 3e-5, 800)
    sigma, slack = rng.uniform(0, 2e-6, 800), rng.uniform(0, 5e-6, 800)
    found, agree = np.empty((801, 2)), np.empty(801, bool)
    places, depth, sigma, slack = (np.concatenate([a, a[:1]]) for a in (places, depth, sigma, slack))
    places[-1] = np.nan
    kernels.look_up(places, depth, sigma, slack, 20, 30, values, other.sigma, right, down, 2.0, found, agree)
    assert np.isnan(found[-1]).all()
    assert not agree[-1]
    slow = [
        look_up_slowly(*each, other, right, down, 2.0) for each in zip(places[:-1], depth, sigma, slack, strict=False)
    ]
    np.testing.assert_allclose(np.column_stack([found, agree])[:-1], np.array(slow, dtype=float), rtol=1e-12)
    assert 0.03 < np.isfinite(found[:, 0]).mean() < agree.mean() < 0.8  # all three happen


def reachable(right, down, row, column, radius):
    """Pixels that can be reached along the row, then along columns."""
    found = []
    for towards in (-1, 1):
        for c in range(column, column + towards * (radius + 1), towards):
            if c != column and not right[row, min(c, c - towards)]:
                break
            for rise in (-1, 1):
                for r in range(row, row + rise * (radius + 1), rise):
                    if r != row and not down[min(r, r - rise), c]:
                        break
                    found.append((r, c))
    return sorted(set(found))


def test_planes_are_fitted_to_what_can_be_reached():
    rng = np.random.default_rng(4)
    depth = rng.normal(size=(8, 9))
    sigma, right, down = rng.uniform(0.5, 1, (8, 9)), *(rng.uniform(size=(2, 8, 9)) < 0.75)
    right[:, -1] = down[-1] = False
    rows, columns = (grid.ravel() for grid in np.mgrid[:8, :9])
    found = np.empty((72, 3))
    kernels.planes(rows, columns, depth, sigma, right, down, 3, found)
    for n, (row, column) in enumerate(zip(rows, columns, strict=True)):
        r, c = np.array(reachable(right, down, row, column, 3)).T
        design = np.stack([np.ones(len(r)), c - column, r - row], -1)
        weights = 1 / sigma[r, c]
        if len(r) < 4 or np.linalg.det(np.cov(design[:, 1:].T, aweights=weights**2, ddof=0)) <= 0.05:
            assert np.isnan(found[n]).all()
        else:
            np.testing.assert_allclose(
                found[n], np.linalg.lstsq(weights[:, None] * design, weights * depth[r, c])[0], atol=1e-9
            )
    assert 0.3 < np.isfinite(found[:, 0]).mean() < 1


def test_covering_triangles_are_found():
    rng = np.random.default_rng(5)
    depth = 1 + 0.1 * rng.normal(size=(6, 7))
    cells = rng.integers(kernels.NONE, kernels.ADC + 1, (5, 6)).astype(np.uint8)
    corners = {kernels.ABC: "abc", kernels.BDC: "bdc", kernels.ABD: "abd", kernels.ADC: "adc"}
    at = {"a": (0, 0), "b": (1, 0), "c": (0, 1), "d": (1, 1)}
    places = rng.uniform(-0.5, (6.5, 5.5), (600, 2))
    goal = 1 + 0.1 * rng.normal(size=600)
    found = np.empty(600, int)
    kernels.cover(places, goal, np.full(600, 0.05), depth, cells, found)
    for place, wanted, node in zip(places, goal, found, strict=True):
        column, row = np.floor(place).astype(int)
        expected = -1
        kind = cells[row, column] if 0 <= row < 5 and 0 <= column < 6 else kernels.NONE
        if kind in corners:
            nodes = np.add([at[name] for name in corners[kind]], (column, row))
            weights = np.linalg.solve(np.vstack([nodes.T, np.ones(3)]), [*place, 1])  # barycentric
            value = weights @ depth[nodes[:, 1], nodes[:, 0]]
            if (weights >= 0).all() and abs(value - wanted) <= 0.05:
                x, y = nodes[np.linalg.norm(nodes - place, axis=1).argmin()]
                expected = y * 7 + x
        elif kind == kernels.BOTH:
            x, y = place - (column, row)
            square = depth[row : row + 2, column : column + 2]
            if abs(np.array([1 - y, y]) @ square @ np.array([1 - x, x]) - wanted) <= 0.05:
                expected = (row + round(y)) * 7 + column + round(x)
        assert node == expected
    assert 0.05 < np.mean(found >= 0) < 0.9


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


# Files and the command.


def test_clouds_and_meshes_keep_normals_views_and_colours(rig, tmp_path):
    maps = maps_of(rig, plane)
    cloud, mesh = fuse(rig, maps), build_mesh(rig, maps, stride=8)
    write_ply(tmp_path / "a.ply", cloud.points, normals=cloud.normals, views=cloud.views)
    columns = trimesh.load(tmp_path / "a.ply").metadata["_ply_raw"]["vertex"]["data"]
    np.testing.assert_array_equal(columns["views"].ravel(), cloud.views)
    np.testing.assert_array_equal(columns["nz"].ravel(), np.nan_to_num(cloud.normals[:, 2]))
    colours = np.random.default_rng(1).integers(0, 255, mesh.vertices.shape).astype(np.uint8)
    for ending in ("ply", "obj"):
        write_mesh(tmp_path / f"mesh.{ending}", mesh.vertices, mesh.faces, colors=colours)
        found = trimesh.load(tmp_path / f"mesh.{ending}", process=False)
        assert found.area == pytest.approx(mesh.area, rel=1e-6)
        np.testing.assert_array_equal(found.visual.vertex_colors[:, :3], colours)
    with pytest.raises(ShapeError, match="colors must be uint8"):
        write_mesh(tmp_path / "b.ply", mesh.vertices, mesh.faces, colors=colours / 255)
    with pytest.raises(ShapeError, match="views must be uint8"):
        write_ply(tmp_path / "b.ply", cloud.points, views=cloud.views.astype(int))


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


def test_the_command_writes_a_mesh(tmp_path, monkeypatch, capsys):
    setup = Setup(Camera((160, 120), 300), small_setup().optic)
    photograph, _ = photograph_plane(setup.rig(), 800.0, pitch=2.0)
    write_image(tmp_path / "photo.png", photograph)
    write_setup(setup, tmp_path / "setup.toml")
    words = [
        "reconstruct",
        tmp_path / "photo.png",
        "-s",
        tmp_path / "setup.toml",
        "-o",
        tmp_path / "out",
        "--depth",
        "760..840",
    ]
    status, said, _ = run(monkeypatch, capsys, *words, "--mesh", "stl", "--mesh-step", 6)
    assert status == 0
    assert "mesh.stl" in said
    assert "fused" in said
    mesh = trimesh.load(tmp_path / "out" / "mesh.stl")
    assert abs(np.median(mesh.vertices[:, 2]) - 800) < 4  # 0.5 %, 0.03 px
    columns = trimesh.load(tmp_path / "out" / "points.ply").metadata["_ply_raw"]["vertex"]["data"]
    assert columns["views"].max() == 3
    assert np.median(columns["nz"]) < -0.9
    for wrong in (["--mesh", "pdf"], ["--mesh", "ply", "--mesh-step", "0"], ["--mesh", "ply", "--mesh-step", "1.5"]):
        status, said, error = run(monkeypatch, capsys, *words, *wrong)
        assert status != 0
        assert "mesh" in said + error
