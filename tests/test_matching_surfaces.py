"""Depth maps as surfaces, their cross-check, and the plans that all of matching works by."""

import numpy as np
import pytest
from scipy import ndimage
from shifted_views import Views, slow_places

from cyclopean import errors
from cyclopean.matching import Warps, agreement, plan, surfaces

VIEWS = Views(ways=(0, 1, -1), size=(90, 76), depths=25, corner=(5, 3))


@pytest.fixture
def rng():
    return np.random.default_rng(5)


def holed(rng, shape=(23, 31)):
    depth = (5 + rng.integers(0, 2, shape) * 4 + rng.normal(0, 0.3, shape)).astype(np.float32)
    depth[rng.random(shape) < 0.2] = np.nan
    return depth


def test_smooth_is_the_mean_of_like_neighbours(rng):
    depth = holed(rng)
    found = surfaces.smooth(depth, 2, np.float32(1))
    np.testing.assert_array_equal(np.isnan(found), np.isnan(depth))
    for y, x in np.argwhere(~np.isnan(depth)):
        near = depth[max(0, y - 2) : y + 3, max(0, x - 2) : x + 3]
        like = near[np.abs(near - depth[y, x]) < 1]
        assert found[y, x] == pytest.approx(like.mean(), abs=1e-5)  # float32


def test_a_jump_stays_sharp():
    depth = np.repeat(np.float32([[3, 3, 3, 9, 9, 9]]), 6, 0)
    np.testing.assert_array_equal(surfaces.smooth(depth, 2, np.float32(2)), depth)


def test_extremes_are_the_least_and_largest_around(rng):
    depth = holed(rng)
    depth[:8, :8] = np.nan
    low, high = surfaces.extremes(depth, 3)
    for y, x in np.ndindex(depth.shape):
        near = depth[max(0, y - 3) : y + 4, max(0, x - 3) : x + 4]
        if np.isnan(near).all():
            assert low[y, x] > high[y, x]
        else:
            assert (low[y, x], high[y, x]) == (np.nanmin(near), np.nanmax(near))


def test_doubled_repeats_and_closes_single_holes(rng):
    depth = np.float32(rng.uniform(0, 9, (6, 7)))
    np.testing.assert_array_equal(surfaces.doubled(depth, (13, 12)), np.kron(depth, np.ones((2, 2)))[:12, :13])
    depth[2, 3] = np.nan
    depth[4:, 4:] = np.nan
    found = surfaces.doubled(depth, (14, 12))
    around = np.delete(depth[1:4, 2:5].ravel(), 4)
    np.testing.assert_allclose(found[4:6, 6:8], around.mean(), rtol=1e-6)  # float32
    assert np.isnan(found[10:, 10:]).all()
    assert np.isfinite(found[8:10, 8:10]).all()


def test_median_takes_unknown_for_farthest(rng):
    depth = holed(rng)
    found = surfaces.median(depth)
    twin = ndimage.median_filter(np.where(np.isnan(depth), -1, depth), 5, mode="nearest")
    expected = np.where(np.isnan(depth) | (twin < 0), depth, twin)
    np.testing.assert_array_equal(found, expected)


# Cross-check


@pytest.mark.parametrize("hidden", [False, True])
def test_agreement_counts_witnesses(rng, hidden):
    ready = plan(VIEWS.warps(crooked=0.3))
    maps = [rng.integers(0, 4, VIEWS.size[::-1]).astype(np.float32) * 3 for _ in range(3)]
    for one in maps:
        one[rng.random(one.shape) < 0.2] = np.nan
    tolerances = (1.0, 4.0, 1.0)  # hypotheses; maps are whole multiples of 3
    for number, found in enumerate(agreement.agreement(ready, maps, tolerances, hidden=hidden)):
        depth, (x, y) = maps[number], VIEWS.grid()
        at = slow_places(ready.warps[number], x, y, np.nan_to_num(depth))[:, 0]
        (agree, against), tie = np.zeros((2, *depth.shape), int), np.zeros(depth.shape, bool)
        for v, view in enumerate(ready.references[number].others):
            u, w = np.moveaxis(at[v] - (VIEWS.left(view), VIEWS.corner[1]), -1, 0)
            tie |= (abs(u % 1 - 0.5) < 1e-3) | (abs(w % 1 - 0.5) < 1e-3)
            i, j = np.floor(u + 0.5).astype(int), np.floor(w + 0.5).astype(int)
            inside = (i >= 0) & (j >= 0) & (i < VIEWS.size[0]) & (j < VIEWS.size[1])
            there = np.where(inside, maps[view][np.where(inside, j, 0), np.where(inside, i, 0)], np.nan)
            box = VIEWS.masks[view][ready.boxes[view]]
            there = np.where(inside & box[np.where(inside, j, 0), np.where(inside, i, 0)], there, np.nan)
            nearer = depth - there
            agree += (nearer <= tolerances[number]) if hidden else (np.abs(nearer) <= tolerances[number])
            against += nearer > tolerances[number]
        expected = (agree > 0) & (agree >= against)
        np.testing.assert_array_equal(found[~tie], expected[~tie])
        assert 0.1 < found.mean() < 0.9


# Plans


def test_plans_want_the_maps_of_every_view():
    warps = VIEWS.warps()
    with pytest.raises(errors.ShapeError, match="every view into all others"):
        plan(warps[:2])
    with pytest.raises(errors.ShapeError, match="every view into all others"):
        plan(warps[:1])
    with pytest.raises(errors.ShapeError, match=r"at \[25, 26\] inverse depths"):
        plan([*warps[:2], Views(ways=VIEWS.ways, size=VIEWS.size, depths=26, corner=VIEWS.corner).warps()[2]])
    with pytest.raises(errors.ShapeError, match="3 colour channels: all of them"):
        plan(VIEWS.warps(channels=3), channels=1)


def test_wide_ranges_have_more_levels():
    for depths, levels in ((25, 1), (129, 1), (130, 2), (300, 3)):
        ready = plan(Views(depths=depths).warps())
        assert sorted(ready.references[0].lines) == [2**k for k in range(levels + 1)]
        assert sorted(ready.references[0].masks) == [2**k for k in range(1, levels + 1)]
        assert len(ready.layouts) == max(levels, 2)


def test_maps_that_do_not_fit_are_refused():
    one = VIEWS.warps()[0]
    fields = dict(origin=one.origin, size=one.size, inverse_depths=one.inverse_depths, spacing=8, masks=one.masks)
    with pytest.raises(errors.ShapeError, match="coefficients must have shape"):
        Warps(**fields, coefficients=one.coefficients[:, :, 1:])
    with pytest.raises(errors.ShapeError, match="at least 3 inverse depths, got 2"):
        Warps(**(fields | {"inverse_depths": one.inverse_depths[:2]}), coefficients=one.coefficients)
