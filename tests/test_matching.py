"""Dense matching as a whole: made-up photographs whose depth is known exactly, and laws that must hold."""

import threading

import numba
import numpy as np
import pytest
from shifted_views import STEP, Texture, Views, everywhere

from cyclopean import errors
from cyclopean.matching import aggregation, checked, dense, match, plan

PLANE = (6.0, 0.06, 0.04)
SLANTED = ((Texture(), PLANE, everywhere),)
VIEWS = Views(ways=(0, 1, -1))


def steps_of(views, depth_map):
    """Hypotheses (h, w) of a depth map."""
    return (depth_map.inverse_depth - views.inverse[0]) / (views.inverse[1] - views.inverse[0])


def assert_same(found, expected):
    for one, other in zip(found, expected, strict=True):
        for name in ("inverse_depth", "sigma", "score"):
            np.testing.assert_array_equal(getattr(one, name), getattr(other, name))


@pytest.fixture(scope="module")
def tilted():
    """A plan, the photograph of a slanted plane and its depth maps."""
    ready, image = plan(VIEWS.warps()), VIEWS.photograph(SLANTED)
    return ready, image, match(image, ready)


def errors_of(views, maps, surfaces):
    """Errors in px of the pixels of all views that another view sees, NaN unknown."""
    found = []
    for view, one in enumerate(maps):
        truth = views.truth(surfaces, view)
        found.append(((steps_of(views, one) - truth) * STEP)[views.seen(truth, view)])
    return np.concatenate(found)


def test_a_slanted_plane_is_found(tilted):
    error = errors_of(VIEWS, tilted[2], SLANTED)
    assert np.isfinite(error).mean() > 0.97
    assert np.sqrt(np.nanmean(error**2)) < 0.02  # px; grey levels are rounded: 0.3 rms
    assert np.nanmax(np.abs(error)) < 0.5


@pytest.mark.parametrize("steps", [4.2, 11.0, 17.7])
@pytest.mark.parametrize("ways", [(0, 1), (0.0, 0.7, -0.4, 1.1)])
def test_a_known_motion_comes_back(steps, ways):
    views, surface = Views(ways=ways), ((Texture(2), (steps, 0.0, 0.0), everywhere),)
    maps = match(views.photograph(surface, rounded=False), plan(views.warps()))
    error = errors_of(views, maps, surface)
    assert np.isfinite(error).mean() > 0.97
    assert np.abs(np.nanmean(error)) < 0.01
    assert np.nanmedian(np.abs(error)) < 0.003  # px
    assert np.nanpercentile(np.abs(error), 90) < 0.02  # the rest lies where another view ends


def test_a_wide_range_is_searched_from_coarse_to_fine():
    views = Views(ways=(0, 1), depths=150, size=(150, 84))
    surface = ((Texture(), (30.0, 0.1, 0.05), everywhere),)
    ready = plan(views.warps())
    assert len(ready.references[0].lines) == 3  # every pixel, every other, every fourth
    error = errors_of(views, match(views.photograph(surface), ready), surface)
    assert np.isfinite(error).mean() > 0.95
    assert np.sqrt(np.nanmean(error**2)) < 0.03  # px


def test_sigma_says_how_large_errors_are(tilted):
    ready, image, _ = tilted
    noisy = np.clip(image + np.random.default_rng(2).normal(0, 6, image.shape), 0, 255).astype(np.uint8)
    maps = match(noisy, ready)
    sigma = [one.sigma[VIEWS.seen(VIEWS.truth(SLANTED, k), k)] for k, one in enumerate(maps)]
    error = errors_of(VIEWS, maps, SLANTED) * ready.warps[0].step / STEP
    pull = np.abs(error) / np.concatenate(sigma)
    # median of |N(0, 1)| is 0.674; sigma leaves out that neighbours share interpolation and blur, hence the wide band
    assert 0.4 < np.nanmedian(pull) < 1.1
    assert np.isfinite(pull).mean() > 0.97


def test_a_third_view_fills_what_is_hidden_in_the_second():
    def square(x, y):
        return (x > 45) & (x < 75) & (y > 25) & (y < 60)

    scene = ((Texture(4), (4.0, 0.0, 0.0), everywhere), (Texture(3), (16.0, 0.0, 0.0), square))
    right = {}
    for ways in ((0, 1), (0, 1, -1)):
        views = Views(ways=ways)
        truth = views.truth(scene, 0)
        found = match(views.photograph(scene), plan(views.warps()))[0]
        right[len(ways)] = np.abs(steps_of(views, found) - truth) < 0.4
    hidden = np.zeros(truth.shape, bool)
    hidden[29:56, 75 + 1 : 75 + 5] = True  # background right of the square: in front of it in view 1 only
    seen = views.seen(truth, 0)
    assert right[3][seen].mean() > 0.9
    assert right[3][hidden].mean() > right[2][hidden].mean() + 0.3


def test_a_blank_patch_stays_unknown():
    def patched(x, y):
        blank = (np.hypot(x - 55, y - 42) < 22)[..., None]
        return np.where(blank, 128, Texture()(x, y))

    surface = ((patched, (8.0, 0.0, 0.0), everywhere),)
    maps = match(VIEWS.photograph(surface), plan(VIEWS.warps()))
    x, y = VIEWS.grid()
    for view, found in enumerate(maps):
        away = np.hypot(x - 55 - VIEWS.ways[view] * STEP * 8, y - 42)
        assert np.isnan(found.inverse_depth[away < 12]).all()  # 22 less half a window, corners and blur too
        assert np.isfinite(found.inverse_depth[(away > 30) & VIEWS.seen(np.full(x.shape, 8.0), view)]).mean() > 0.95


@pytest.mark.parametrize("level", [0, 77, 255])
@pytest.mark.parametrize("kind", [np.uint8, np.uint16, np.float64])
def test_a_flat_image_is_unknown_everywhere(tilted, kind, level):
    ready, image, _ = tilted
    for found in match(np.full(image.shape, level, kind), ready):
        assert np.isnan(found.inverse_depth).all()
        assert np.isnan(found.sigma).all()
        assert (found.score == 0).all()


def test_pictures_of_different_things_do_not_match(tilted):
    ready, image, _ = tilted
    image = image.copy()
    for view, box in enumerate(ready.boxes):
        image[box] = Texture(9 + view)(*VIEWS.grid())
    known = [np.isfinite(found.inverse_depth).mean() for found in match(image, ready)]
    assert max(known) < 0.12  # maps agree by chance within a step, of 25 that there are


def test_a_view_without_light_has_no_depth(tilted):
    ready, image, _ = tilted
    image = image.copy()
    image[ready.boxes[1]] = 0
    maps = match(image, ready)
    assert np.isnan(maps[1].inverse_depth[:, 8:-8]).all()  # beside it there is light
    assert np.isfinite(maps[0].inverse_depth).mean() > 0.7  # the third view is left


@pytest.mark.parametrize("cost", ["zncc", "census"])
def test_gain_and_offset_of_a_view_do_not_matter(tilted, cost):
    ready, image, _ = tilted
    maps = match(image, ready, cost=cost)
    other = image / 255
    other[0, ready.boxes[0][1].stop] = 1  # between the views, so that white stays white
    other[ready.boxes[1]] = 0.75 * other[ready.boxes[1]] + 0.1
    for found, before in zip(match(other, ready, cost=cost), maps, strict=True):
        change = steps_of(VIEWS, found) - steps_of(VIEWS, before)
        assert np.sqrt(np.nanmean(change**2)) * STEP < 0.01  # px
        assert np.isfinite(change).sum() > 0.98 * np.isfinite(before.inverse_depth).sum()


def test_census_finds_the_same_plane(tilted):
    ready, image, _ = tilted
    error = errors_of(VIEWS, match(image, ready, cost="census"), SLANTED)
    assert np.isfinite(error).mean() > 0.97
    assert np.sqrt(np.nanmean(error**2)) < 0.02  # px, as by ZNCC


def test_costs_of_other_names_are_refused(tilted):
    ready, image, _ = tilted
    with pytest.raises(errors.SetupError, match=r"'zncc'.* got 'sad'"):
        match(image, ready, cost="sad")


@pytest.mark.parametrize("change", [lambda i: i.astype(np.uint16) * 257, lambda i: i / 255], ids=["16 bits", "real"])
def test_types_do_not_matter(tilted, change):
    ready, image, maps = tilted
    for view, (found, before) in enumerate(zip(match(change(image), ready), maps, strict=True)):
        difference = np.abs(steps_of(VIEWS, found) - steps_of(VIEWS, before))
        step = VIEWS.inverse[1] - VIEWS.inverse[0]
        # real numbers are scaled by their brightest pixels: here the contrast becomes 3 % higher
        assert np.nanpercentile(difference[VIEWS.seen(VIEWS.truth(SLANTED, view), view)], 99) < 0.005  # steps
        # at a rim that no other view shows all costs are alike, and the search may choose otherwise: but within sigma
        assert np.nanpercentile(difference * step / before.sigma, 99) < 1
        assert np.isfinite(difference).sum() > 0.98 * np.isfinite(before.inverse_depth).sum()


def test_grey_and_each_colour_do_as_well(tilted):
    ready, image, _ = tilted
    for photograph, wanted in ((image[..., 1], ready), (image, plan(VIEWS.warps(), channels=3))):
        error = errors_of(VIEWS, match(photograph, wanted), SLANTED)
        assert np.sqrt(np.nanmean(error**2)) < 0.05  # px
        assert np.isfinite(error).mean() > 0.95


def test_colours_are_followed_along_their_own_maps():
    views = Views(ways=(0, 1))
    warps = views.warps(channels=3)
    shifts = (-0.6, 0.0, 0.4)  # px that each colour lies beside its place
    image = views.photograph(SLANTED, rounded=False)
    for view, sign in ((0, 1), (1, -1)):
        for c, shift in enumerate(shifts):
            x, y = views.grid()
            if view == 1:
                x = (x + shift - STEP * (PLANE[0] + PLANE[2] * y)) / (1 + STEP * PLANE[1])
            rows, columns = slice(0, views.size[1]), slice(views.left(view), views.left(view) + views.size[0])
            image[rows, columns, c] = SLANTED[0][0](x, y)[..., c]
            warps[view].coefficients[0, c, ..., 0, 0] -= sign * shift
    error = errors_of(views, match(image, plan(warps)), SLANTED)
    assert np.sqrt(np.nanmean(error**2)) < 0.03  # px, far less than the shifts
    assert np.isfinite(error).mean() > 0.95


def test_pixels_without_a_place_stay_unknown(tilted):
    _, image, maps = tilted
    warps = VIEWS.warps()
    for one in warps[1:]:
        one.coefficients[:, :, :, :6] = np.nan  # columns 0 to 47 need one of these
    found = match(image, plan(warps))
    for view in (1, 2):
        assert np.isnan(found[view].inverse_depth[:, :47]).all()
        change = steps_of(VIEWS, found[view])[:, 60:-15] - steps_of(VIEWS, maps[view])[:, 60:-15]
        assert np.nanmedian(np.abs(change)) < 0.01
        assert np.isfinite(change[10:-10]).mean() > 0.9


@pytest.mark.parametrize("depths", [25, 140])
def test_memory_and_threads_do_not_show(depths, monkeypatch):
    views = Views(ways=(0, 1, -0.5), size=(170, 300), depths=depths)
    ready, image = plan(views.warps()), views.photograph(((Texture(), (8.0, 0.03, 0.02), everywhere),))
    used, strips = numba.get_num_threads(), []

    def watched(fill, bands, *arguments, rows_per_strip, **others):
        strips.append(-(-bands.size[1] // rows_per_strip))
        return aggregation.search(fill, bands, *arguments, rows_per_strip=rows_per_strip, **others)

    monkeypatch.setattr(dense, "search", watched)
    whole = match(image, ready, memory_mib=4096)
    assert set(strips) == {1}
    strips.clear()
    try:
        numba.set_num_threads(min(2, numba.config.NUMBA_NUM_THREADS) if used == 1 else 1)
        striped = match(image, ready, memory_mib=0.1)
    finally:
        numba.set_num_threads(used)
    assert max(strips) == 3
    assert np.isfinite(whole[0].inverse_depth).mean() > 0.5
    assert_same(striped, whole)


def test_the_place_in_the_photograph_does_not_matter(tilted):
    moved = Views(ways=VIEWS.ways, corner=(64, 32))
    for found, before in zip(match(moved.photograph(SLANTED), plan(moved.warps())), tilted[2], strict=True):
        assert found.origin == (before.origin[0] + 64, before.origin[1] + 32)
        inner = np.s_[20:-20, 20:-20]  # what lies around the views has changed
        difference = (steps_of(VIEWS, found) - steps_of(VIEWS, before))[inner]
        assert np.nanpercentile(np.abs(difference), 99) < 0.01  # places are rounded otherwise
        assert (np.isnan(found.inverse_depth) == np.isnan(before.inverse_depth))[inner].mean() > 0.99


def test_photographs_may_be_matched_at_the_same_time(tilted):
    ready, image, maps = tilted
    found = [None, None]

    def work(k):
        found[k] = match(image, ready)

    threads = [threading.Thread(target=work, args=(k,)) for k in range(2)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    for one in found:
        assert_same(one, maps)


def test_progress_is_told_and_views_are_kept(tilted):
    ready, image, maps = tilted
    told, kept = [], []
    match(image, ready, progress=lambda *at: told.append(at), keep=lambda *view: kept.append(view))
    assert [done for done, _ in told] == list(range(1, told[0][1] + 1))
    assert [k for k, _ in kept] == [0, 1, 2]
    assert_same(checked(ready, [one for _, one in kept]), maps)


def test_a_depth_map_is_looked_up_in_the_photograph(tilted):
    found = tilted[2][1]
    x, y = found.origin
    pixels = np.array([[[x + 50.4, y + 40.3], [x - 1, 5]], [[np.nan, 3], [1e9, 4]]])
    np.testing.assert_array_equal(found.at(pixels), [[found.inverse_depth[40, 50], np.nan], [np.nan, np.nan]])
    assert np.isfinite(found.inverse_depth[40, 50])


def test_wrong_images_are_refused(tilted):
    ready, image, _ = tilted
    with pytest.raises(errors.ImageError, match="rows and columns"):
        match(image[:-1], ready)
