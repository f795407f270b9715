"""The main job on small photographs with known depth."""

import numpy as np
import pytest
from scenes import photograph_plane, small_setup
from setups import mirrors_beside

from cyclopean import Plate, Setup
from cyclopean.errors import ImageError, OpticError, SetupError
from cyclopean.pipeline import plan_of, reconstruct


@pytest.fixture(scope="module")
def plane():
    """A slanted plane photographed through three facets, its truth and its reconstruction."""
    rig = small_setup().rig()
    photograph, truth = photograph_plane(rig, 800.0, slope=0.3)
    return rig, photograph, truth, reconstruct(photograph, rig, (500.0, 1200.0))


def common(rig, truth):
    """Pixels (H, W) whose point a second view shows, well inside the region."""
    seen = np.zeros(truth.shape, dtype=bool)
    for k, view in enumerate(rig):
        rows, columns = np.nonzero(view.region.mask)
        rays = view.rays(np.stack([columns, rows], -1))
        points = rays.at_depth(truth[rows, columns])
        others = [other.region.contains(other.project(points)) for j, other in enumerate(rig) if j != k]
        seen[rows, columns] = np.any(others, axis=0)
    return seen


def test_depth_of_a_plane(plane):
    rig, _, truth, result = plane
    seen = common(rig, truth)
    error = np.abs(result.depth / truth - 1)[seen]
    assert np.isfinite(error).mean() > 0.93  # the rest are windows cut by seams
    # 0.05 px rms of matching error; one px is 8 % of depth here (baseline 12.5 mm, focal length 600 px)
    assert np.nanmedian(error) < 0.004
    assert np.nanmean(error > 0.02) < 0.01


def test_points_lie_on_their_rays_and_on_the_plane(plane):
    rig, _, _, result = plane
    for k, view in enumerate(rig):
        mine = result.view[result.pixels[:, 1], result.pixels[:, 0]] == k
        # float32 depth: 1e-7 of 800 mm is 1e-4 mm, a thousandth of that in px
        np.testing.assert_allclose(view.project(result.points[mine]), result.pixels[mine], atol=1e-6)
    off_plane = result.points[:, 2] - 0.3 * result.points[:, 0] - 800.0
    assert np.median(np.abs(off_plane)) < 3.5  # 0.4 % of 800 mm


def test_stated_covariance_matches_the_errors(plane):
    _, _, truth, result = plane
    x, y = result.pixels.T
    error = result.points[:, 2] - truth[y, x]
    sigma = np.sqrt(result.covariance[:, 2, 2])
    assert (np.linalg.eigvalsh(result.covariance.astype(float)) > -1e-6 * sigma.max() ** 2).all()
    # grey levels are rounded and windows overlap: the statement is good to a factor, not to a percent
    assert 0.3 < np.percentile(np.abs(error) / sigma, 68) < 3.0


def test_maps_and_points_agree(plane):
    rig, photograph, _, result = plane
    x, y = result.pixels.T
    known = np.isfinite(result.depth)
    assert known[y, x].all()
    # a point is merged from the maps that have it, so it lies within some sigma of that of its own pixel
    away = np.abs(result.depth[y, x] - result.points[:, 2]) / result.sigma[y, x]
    assert np.percentile(away, 95) < 4
    assert known.sum() / 3 < len(result.points) < known.sum()  # three views: each point at most three times in the maps
    assert set(np.unique(result.views)) <= {1, 2, 3}
    assert (result.confidence[known] > 0).all()
    np.testing.assert_array_equal(result.colours, np.repeat(photograph[y, x][:, None], 3, axis=1))
    assert ((result.view >= 0) == rig.masks.any(0)).all()
    assert result.completeness.shape == (3,)


def test_nothing_is_invented_in_a_blocked_facet(plane):
    rig, photograph, _, _ = plane
    blocked = np.where(rig[0].region.traced, 0, photograph).astype(np.uint8)
    result = reconstruct(blocked, rig, (500.0, 1200.0))
    assert not np.isfinite(result.depth[rig[0].region.mask]).any()
    assert np.isfinite(result.depth[rig[1].region.mask]).any()


def test_a_black_photograph_gives_no_points(plane):
    rig, photograph, _, _ = plane
    result = reconstruct(np.zeros_like(photograph), rig, (500.0, 1200.0))
    assert len(result.points) == 0
    assert np.isnan(result.depth).all()


def test_views_are_kept_as_they_are_made(plane):
    rig, photograph, _, _ = plane
    kept, told = [], []
    reconstruct(
        photograph,
        rig,
        (700.0, 900.0),
        keep=lambda k, depth_map: kept.append((k, depth_map)),
        progress=lambda what, done, total: told.append((what, done, total)),
    )
    assert [k for k, _ in kept] == [0, 1, 2]
    assert all(depth_map.inverse_depth.shape == rig[k].region.box[:1:-1] for k, depth_map in kept)
    steps = {what: [(done, total) for name, done, total in told if name == what] for what, *_ in told}
    assert list(steps) == ["maps between the views", "matching"]
    for done in steps.values():
        assert [at for at, _ in done] == list(range(done[0][1] + 1))


def test_mirrors_are_nothing_special():
    setup = Setup(small_setup().camera, mirrors_beside())
    rig = setup.rig()
    assert [view.mirrored for view in rig] == [True, True, False]
    depth = 700.0
    photograph, truth = photograph_plane(rig, depth)
    result = reconstruct(photograph, rig, (500.0, 1000.0))
    seen = common(rig, truth)
    assert seen.any()
    error = np.abs(result.depth / truth - 1)[seen]
    assert np.isfinite(error).mean() > 0.8
    assert np.nanmedian(error) < 0.004


def test_wrong_photograph_and_too_few_views(plane):
    rig, photograph, _, _ = plane
    with pytest.raises(ImageError, match="320x240"):
        reconstruct(photograph.T, rig)
    plate = Setup(small_setup().camera, Plate(1.5, distance=50.0, thickness=10.0)).rig()
    with pytest.raises(OpticError, match="at least two views"):
        reconstruct(photograph, plate)


@pytest.mark.parametrize("scale", [4, 16, 257])
def test_sixteen_bits_of_any_depth_give_the_same(plane, scale):
    rig, photograph, _, result = plane
    deep = reconstruct((photograph.astype(np.uint16) * scale).astype(np.uint16), rig, (500.0, 1200.0))
    # 10, 12 and 16 bits: white is found to within a bit, so only the noise floor's scale differs
    assert np.isfinite(deep.depth).mean() > 0.97 * np.isfinite(result.depth).mean()
    assert deep.colours.max() > 120


def test_a_hot_pixel_does_not_matter(plane):
    rig, photograph, _, result = plane
    hot = photograph.astype(np.float32) / 255
    hot[5, 5] = 50
    found = reconstruct(hot, rig, (500.0, 1200.0))
    assert np.isfinite(found.depth).mean() > 0.97 * np.isfinite(result.depth).mean()


def test_pixels_that_are_no_numbers_do_not_spread(plane):
    rig, photograph, truth, result = plane
    holed = photograph / np.float32(255)
    rng = np.random.default_rng(2)
    rows, columns = rng.integers(0, photograph.shape[0], 40), rng.integers(0, photograph.shape[1], 40)
    holed[rows, columns] = rng.choice([np.nan, np.inf, -np.inf], 40).astype(np.float32)
    found = reconstruct(holed, rig, (500.0, 1200.0))
    assert np.isfinite(found.depth).mean() > 0.9 * np.isfinite(result.depth).mean()
    error = np.abs(found.depth / truth - 1)[common(rig, truth)]
    assert np.nanmean(error > 0.02) < 0.02


def test_a_plan_is_made_once_for_a_rig_and_a_range(plane):
    rig = plane[0]
    ready = plan_of(rig, (500.0, 1200.0))
    assert plan_of(rig, (500, 1200)) is ready
    assert plan_of(rig, (500.0, 1200.0), channels=[rig, rig, rig]) is not ready
    other = plan_of(rig, (600.0, 1200.0))
    assert other is not ready
    assert plan_of(rig, (600.0, 1200.0), step=1.0) is not other
    assert plan_of(small_setup().rig(), (500.0, 1200.0)) is not ready


def test_channels_belong_to_a_colour_photograph_of_the_rig_of_green(plane):
    rig, photograph, _, _ = plane
    with pytest.raises(ImageError, match="3 channels want"):
        reconstruct(photograph, rig, (500.0, 1200.0), channels=[rig, rig, rig])
    others = [rig, small_setup().rig(), rig]
    with pytest.raises(SetupError, match="must be that of green"):
        plan_of(rig, (500.0, 1200.0), channels=others)


@pytest.mark.parametrize("memory", [0, 63.9, np.nan, np.inf])
def test_too_little_memory_is_refused(plane, memory):
    rig, photograph, _, _ = plane
    with pytest.raises(SetupError, match="at least 64 MiB"):
        reconstruct(photograph, rig, memory_mib=memory)
