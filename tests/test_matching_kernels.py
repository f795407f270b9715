"""The kernels of dense matching beside slow twins in NumPy and SciPy."""

from types import SimpleNamespace

import numpy as np
import pytest
from scipy import ndimage
from shifted_views import Texture, Views, everywhere, in_picture, slow_places, whole

from cyclopean import errors
from cyclopean.geometry import white_level
from cyclopean.matching import cost, pictures, places, plan, sampling
from cyclopean.matching.bands import Bands

VIEWS = Views(ways=(0, 1, -1), size=(90, 76), depths=25, corner=(5, 3))
PLANE = ((Texture(), (6.0, 0.06, 0.05), everywhere),)


@pytest.fixture(scope="module", params=[1, 3], ids=["mean of colours", "each colour"])
def crooked(request):
    """A photograph with all that is made of it and of crooked maps, which lead a px or so astray."""
    warps = VIEWS.warps(crooked=0.5)
    ready = plan(warps, channels=request.param)
    prepared = pictures.prepare(VIEWS.photograph(PLANE), ready)
    return SimpleNamespace(warps=warps, plan=ready, prepared=prepared, channels=request.param)


@pytest.fixture
def rng():
    return np.random.default_rng(5)


def seen_places(crooked, reference, stride, steps):
    """Columns x and rows y of every `stride`-th pixel are seen here, (V-1, h, w, 2), at their hypotheses (h, w)."""
    height, width = steps.shape
    x, y = np.meshgrid(stride * np.arange(width), stride * np.arange(height))
    return slow_places(crooked.warps[reference], x, y, steps)[:, 0]


# Places


@pytest.mark.parametrize("stride", [1, 2])
def test_lines_lead_where_the_nodes_do(crooked, rng, stride):
    warps, margin = crooked.warps[1], places.MARGIN
    lines = places.lines_of(warps, stride, crooked.channels)
    width, height = VIEWS.size
    columns = stride * np.arange(-(-width // stride))
    s = rng.uniform(-1, 1, len(columns)).astype(np.float32)
    count, value = lines.shape[2] // 2, np.empty(len(columns), np.float32)
    assert lines.shape[0] == 2 * crooked.channels
    for y in (0, 5, 8, height - 1):
        steps = (s.astype(float) + 1) / 2 * (VIEWS.depths - 1)
        expected = slow_places(warps, columns, np.full(len(columns), y), steps)[:, 0]
        for k, one in enumerate(lines):
            row = np.empty(one.shape[1:], np.float32)
            places.row_of_polynomials(one, warps.spacing, y, 0, row)
            for axis in range(2):
                part = slice(margin, margin + len(columns))
                places.follow(np.ascontiguousarray(row[axis * count : (axis + 1) * count, part]), s, value)
                # float32 holds numbers near 300 to 3e-5; a few roundings
                np.testing.assert_allclose(value, expected[k // crooked.channels, :, axis], atol=2e-4)
                single = places.place(one, warps.spacing, y, margin + 7, s[7], axis)
                assert single == pytest.approx(value[7], abs=2e-4)


def test_columns_beyond_the_box_repeat_its_last(crooked):
    lines, margin = places.lines_of(crooked.warps[0], 1, 1), places.MARGIN
    last = margin + VIEWS.size[0] - 1
    assert lines.shape[-1] % places.BLOCK == 2 * margin
    np.testing.assert_array_equal(lines[..., :margin], np.broadcast_to(lines[..., margin, None], (*lines.shape[:3], 8)))
    assert (lines[..., last:] == lines[..., last, None]).all()


def test_pixels_without_a_place_are_seen_nowhere():
    warps = VIEWS.warps()[0]
    warps.coefficients[0, :, 3, 4] = np.nan
    lines = places.lines_of(warps, 1, 1)
    assert np.isfinite(lines).all()
    row = np.empty(lines.shape[2:], np.float32)
    x = np.arange(VIEWS.size[0])
    for y in range(VIEWS.size[1]):
        for k in range(2):
            places.row_of_polynomials(lines[k], 8, y, 0, row)
            near = (x >= 24) & (x < 40) & (abs(y - 24) < 8) & (k == 0)  # cells of the node at (32, 24)
            out = row[0, 8 : 8 + len(x)] < -1000  # px, as far from the photograph as it can be
            np.testing.assert_array_equal(out, near)


# Pictures


def test_packed_pictures_come_back_with_repeated_rims(crooked, rng):
    for layout in crooked.plan.layouts:
        shapes = [layout.inner(layout.weights, view).shape for view in range(3)]
        planes = [[rng.normal(size=shape).astype(np.float32) for _ in range(2)] for shape in shapes]
        flat = layout.packed(planes)
        for view, own in enumerate(planes):
            np.testing.assert_array_equal(layout.inner(flat, view), own)
            rimmed = np.pad(own[1], pictures.RIM, mode="edge")
            np.testing.assert_array_equal(whole(layout, flat[1], view), rimmed)


def test_layouts_know_what_belongs_to_a_view(crooked):
    for level, layout in enumerate(crooked.plan.layouts):
        np.testing.assert_array_equal(np.isnan(layout.hidden), layout.weights == 0)
        for view, box in enumerate(crooked.plan.boxes):
            inside = whole(layout, layout.weights, view)
            mask = VIEWS.masks[view][box][:: 2**level, :: 2**level]
            assert inside.sum() == layout.inner(layout.weights, view).sum()  # nothing of the rim
            if level < 2:
                np.testing.assert_array_equal(layout.inner(layout.weights, view), mask)
            else:
                assert (layout.inner(layout.weights, view) <= mask).all()


def test_pixels_of_all_scales_lie_where_their_frames_say(crooked):
    y, x = np.indices(VIEWS.masks.shape[1:])
    ramp = (100 * x + 200 * y).astype(np.uint16)
    prepared = pictures.prepare(ramp if crooked.channels == 1 else np.repeat(ramp[..., None], 3, -1), crooked.plan)
    level = 255 / white_level(ramp)
    for one in (*prepared.search, *prepared.smooth):
        for view in range(3):
            own = one.own(view)[0]
            j, i = (a[4:-4, 4:-4] for a in np.mgrid[: own.shape[0], : own.shape[1]])  # px; blurs reach over borders
            x, y = (one.layout.frames[view, a] + (k + pictures.RIM) / one.layout.scale for a, k in ((0, i), (1, j)))
            found, known = own[4:-4, 4:-4], ~np.isnan(own[4:-4, 4:-4])
            np.testing.assert_allclose(found[known], ((100 * x + 200 * y) * level - 128)[known], atol=0.01)  # float32


def test_splines_reproduce_the_picture(crooked):
    for smooth, spline in zip(crooked.prepared.smooth, crooked.prepared.splines, strict=True):
        for view in range(3):
            picture, coefficients = smooth.own(view)[0], spline.own(view)[0].astype(float)
            j, i = np.mgrid[2 : picture.shape[0] - 2, 2 : picture.shape[1] - 2]
            back = ndimage.map_coordinates(coefficients, [j, i], order=3, prefilter=False)
            np.testing.assert_allclose(back, picture[2:-2, 2:-2], atol=0.05)  # the filter is cut off: 2e-4 of 255


@pytest.mark.parametrize(
    ("image", "words"),
    [
        (np.zeros((4, 4), int), "unsigned"),
        (np.zeros(4, np.uint8), "must have shape"),
        (np.zeros((4, 4), np.uint8), "image of .* rows and columns"),
    ],
)
def test_wrong_images_are_refused(image, words):
    with pytest.raises(errors.ImageError, match=words):
        pictures.prepare(image, plan(VIEWS.warps()))


def test_colours_that_are_missing_are_named():
    with pytest.raises(errors.ImageError, match="3 colour channels"):
        pictures.prepare(np.zeros(VIEWS.masks.shape[1:], np.uint8), plan(VIEWS.warps(), channels=3))


# Samples


@pytest.mark.parametrize("level", [0, 1])
def test_look_is_a_cubic_spline_with_its_slope(crooked, rng, level):
    reference, spline, stride = crooked.plan.references[0], crooked.prepared.splines[level], 2**level
    width, y, half = -(-VIEWS.size[0] // stride), 11, reference.half(1)
    steps = np.zeros(sampling.WIDE, np.float32)
    steps[8 : 8 + width] = rng.uniform(0, VIEWS.depths - 1, width)
    known, own = (rng.random(sampling.WIDE) < 0.8).astype(np.float32), rng.normal(size=sampling.WIDE).astype(np.float32)
    out = np.empty(3 * sampling.WIDE, np.float32)
    for k, lines in enumerate(reference.lines[stride]):
        view, flat = reference.others[k // crooked.channels], spline.values[k % crooked.channels]
        part = slice(spline.layout.starts[view], spline.layout.starts[view + 1])
        sampling.look(
            lines, reference.spacing, y * stride, 0, steps / half - 1, known, half, spline.layout.frames[view],
            flat[part], spline.layout.weights[part], own, sampling.workspace(lines.shape[1]), out,
        )  # fmt: skip
        coefficients, weights = whole(spline.layout, flat, view), whole(spline.layout, spline.layout.weights, view)

        def place(steps, k=k, view=view):
            at = np.stack([stride * np.arange(width), np.full(width, y * stride)])
            pixels = slow_places(crooked.warps[0], *at, steps)[k // crooked.channels, 0]
            return in_picture(spline.layout, view, pixels)

        def value(steps, coefficients=coefficients, place=place):
            return ndimage.map_coordinates(coefficients.astype(float), place(steps)[::-1], order=3, prefilter=False)

        mine, columns = slice(8, 8 + width), steps[8 : 8 + width].astype(float)
        u, v = place(columns)
        inner = (u > 2) & (v > 2) & (u < weights.shape[1] - 3) & (v < weights.shape[0] - 3)
        assert inner.sum() > 20
        seen, difference, slope = (out[a * sampling.WIDE :][mine] for a in range(3))
        expected = ndimage.map_coordinates(weights, [v, u], order=0) * known[mine]
        tie = (abs(u % 1 - 0.5) < 1e-3) | (abs(v % 1 - 0.5) < 1e-3)  # the nearest pixel hangs on roundings
        np.testing.assert_array_equal(seen[inner & ~tie], expected[inner & ~tie])
        # float32 places near 300 are good to 1e-4 px; slopes are some 30 grey levels a px
        np.testing.assert_allclose(difference[inner], (seen * (value(columns) - own[mine]))[inner], atol=0.02)
        numeric = (value(columns + 1e-3) - value(columns - 1e-3)) / 2e-3
        np.testing.assert_allclose(slope[inner], (seen * numeric)[inner], atol=0.02)


# Costs


def plane_of(volume, bands, steps):
    """Costs (h, w) of one hypothesis, -1 where it is in no band."""
    plane = np.full(bands.size[::-1], -1)
    for (ty, tx), start in np.ndenumerate(bands.start):
        part = np.s_[ty * bands.tile : (ty + 1) * bands.tile, tx * bands.tile : (tx + 1) * bands.tile]
        k, stride = steps - bands.first[ty, tx], bands.stride[ty, tx]
        if 0 <= k < bands.count[ty, tx]:
            shape = plane[part].shape
            plane[part] = volume[start : start + shape[0] * shape[1] * stride].reshape(*shape, stride)[..., k]
    return plane


def dimmed(spacing):
    """Four views, the second of half the contrast and darker, the last of a little less contrast."""
    views = Views(ways=(0, 1, -1, 0.6), size=VIEWS.size, depths=VIEWS.depths, corner=VIEWS.corner)
    warps, image = views.warps(spacing, crooked=0.5), views.photograph(PLANE).astype(float)
    ready = plan(warps, channels=3)
    for view, gain, offset in ((1, 0.5, 20), (3, 0.9, 10)):
        image[ready.boxes[view]] = gain * image[ready.boxes[view]] + offset
    prepared = pictures.prepare(np.rint(image).astype(np.uint8), ready)
    return SimpleNamespace(warps=warps, plan=ready, prepared=prepared, channels=3)


def nearest_values(layout, flat, view, pixels):
    """The nearest pixels (...) of a view's picture to places (..., 2) of the photograph, in double precision."""
    picture = whole(layout, flat, view).astype(float)
    u, w = np.floor(in_picture(layout, view, pixels) + 0.5).astype(int)
    return picture[np.clip(w, 0, picture.shape[0] - 1), np.clip(u, 0, picture.shape[1] - 1)]


def gain_and_offset(mine, other):
    """Those that bring another view's grey levels to the mean and standard deviation of mine, where they differ."""
    both = np.isfinite(mine) & np.isfinite(other)
    (mean, there), (spread, away) = ((f(mine[both]), f(other[both])) for f in (np.mean, np.std))
    if abs(mean - there) < 12 and 1 / 1.25 < (spread + 1) / (away + 1) < 1.25:  # grey levels, contrast: alike
        return 1.0, 0.0
    gain = np.clip(spread / away, 1 / 3, 3)
    return gain, mean - gain * there


def order(values):
    """Whether each of 24 neighbours (24, h, w) lies above its pixel (1), below (-1) or within a grey level (0)."""
    near = np.lib.stride_tricks.sliding_window_view(np.pad(values, 2, constant_values=np.nan), (5, 5))
    away = np.delete(near.reshape(*values.shape, 25), 12, axis=-1) - values[..., None]
    away[np.abs(away) <= 1] = 0
    return np.sign(away)


def slow_costs(crooked, number, level, depths, name):
    """Costs (h, w) of each hypothesis of a level, in double precision."""
    reference, finer = crooked.plan.references[number], crooked.prepared.search[level - 1]
    stride, layout = 2**level, finer.layout
    own = finer.own(number)[:, ::2, ::2].astype(float)
    tent = np.outer([1, 2, 1], [1, 2, 1]) / 16

    def mean(values):
        return ndimage.correlate(values, tent, mode="constant", cval=np.nan)

    def unlike(mine, other):
        """0 to 1, of windows."""
        if name == "census":
            return np.minimum(np.abs(order(mine) - order(other)).sum(axis=-1) / 48 / 0.5, 1)
        powers = [mean(a * a) - mean(a) ** 2 + 1 for a in (mine, other)]  # a grey level's noise has variance 1
        zncc = (mean(mine * other) - mean(mine) * mean(other)) / np.sqrt(powers[0] * powers[1])
        return np.minimum(1 - zncc, 0.7) / 0.7

    def others(steps):
        """What each other view shows (V-1, C, h, w) at one hypothesis of the finest level."""
        at = seen_places(crooked, number, stride, np.full(own.shape[1:], float(steps)))
        looks = zip(reference.others, at, strict=True)
        return np.array([[nearest_values(layout, flat, v, places) for flat in finer.values] for v, places in looks])

    lattice = max(crooked.warps[number].spacing // stride, 1)
    middle = others((crooked.warps[number].inverse_depths.size - 1) / 2)[:, :, ::lattice]
    change = [[gain_and_offset(mine[::lattice], one) for mine, one in zip(own, view, strict=True)] for view in middle]
    gain, offset = np.moveaxis(np.array(change), -1, 0)[..., None, None]
    for k in range(depths):
        shown = others(k * stride) * gain + offset
        windows = np.array([[unlike(mine, one) for mine, one in zip(own, view, strict=True)] for view in shown])
        both = windows / 2 + np.minimum(abs(shown - own), 30) / 30 / 2  # half and half, cut off
        views = np.sort(both.mean(axis=1), axis=0)  # NaN last
        seen, best = np.isfinite(views).sum(axis=0), (len(views) + 1) // 2
        total = np.nansum(views, axis=0) / np.maximum(seen, 1)
        total = np.where(seen >= best, (total + views[:best].mean(axis=0)) / 2, total)
        yield np.floor(255 * np.maximum(np.where(seen > 0, total, cost._UNSEEN), 0) + 0.5)


def judged_costs(crooked, rng, number, level, name="zncc"):
    """Differences of costs to those of the slow twin, pixel by pixel, in random bands of hypotheses."""
    reference = crooked.plan.references[number]
    stride = 2**level
    if level == 2:  # as if the range were wide
        lines = reference.lines | {4: places.lines_of(crooked.warps[number], 4, crooked.channels)}
        reference = SimpleNamespace(**{**vars(reference), "lines": lines, "half": reference.half})
    size, depths = tuple(-(-n // stride) for n in VIEWS.size), -(-(VIEWS.depths - 1) // stride) + 1
    shape = (-(-size[1] // cost.TILE), -(-size[0] // cost.TILE))
    first = rng.integers(0, 3, shape)
    bands = Bands(size, depths, cost.TILE, first, rng.integers(3, depths + 1 - first))
    volume = cost.filler(crooked.prepared.search, reference, level, bands, name)(slice(0, size[1]))
    away = []
    for k, expected in enumerate(slow_costs(crooked, number, level, depths, name)):
        found = plane_of(volume, bands, k)
        away.append((found - expected)[found >= 0])
    return np.concatenate(away)


@pytest.mark.parametrize("name", ["zncc", "census"])
@pytest.mark.parametrize("level", [1, 2])
def test_costs_are_of_windows_and_of_pixels(crooked, rng, level, name):
    away = judged_costs(crooked, rng, 1, level, name)
    # the nearest pixel of a few places hangs on a rounding, each in nine windows
    assert (np.abs(away) > 1).mean() < 0.01
    assert len(away) > 1000


@pytest.mark.parametrize("name", ["zncc", "census"])
@pytest.mark.parametrize(("number", "level", "spacing"), [(0, 1, 8), (1, 1, 8), (1, 2, 2)])
def test_costs_see_to_contrast_and_to_the_better_half_of_the_views(rng, number, level, spacing, name):
    away = judged_costs(dimmed(spacing), rng, number, level, name)
    assert (np.abs(away) > 1).mean() < 0.02  # three views look, of three colours: more roundings
    assert len(away) > 1000


def census_of(own, other):
    """Census costs (rows, 64) of two pictures with a margin of 2, by the kernel of a row."""
    out, bits = np.zeros((len(own) - 4, cost.TILE), np.float32), np.empty(3 * cost.TILE, np.float32)
    for row, one in enumerate(out):
        cost._census(*(a[row : row + 5].astype(np.float32).ravel() for a in (other, own)), bits, one)
    return out


def test_gain_offset_and_any_growing_curve_do_not_change_census(rng):
    own, other = 4.0 * rng.integers(-20, 20, (2, 12, cost.TILE + 4))
    costs = census_of(own, other)
    assert 0.3 < np.median(costs) <= 0.5  # half of the whole cost is its most
    assert (census_of(own, own) == 0).all()
    for changed in (0.3 * other + 40, other - 50, np.sign(other) * other**2):  # steps stay above one grey level
        np.testing.assert_array_equal(census_of(own, changed), costs)
    other[5, 30] = np.nan
    unseen = np.isnan(census_of(own, other))
    assert unseen[1:6, 26:31].all()  # rows and columns are those without the margin
    assert unseen.sum() == 25


@pytest.mark.parametrize("name", ["zncc", "census"])
def test_strips_of_costs_are_pieces_of_the_whole(name):
    views = Views(size=(80, 150), depths=9)
    ready = plan(views.warps())
    prepared = pictures.prepare(views.photograph(PLANE), ready)
    bands = Bands.full((40, 75), 5, cost.TILE)
    costs = cost.filler(prepared.search, ready.references[0], 1, bands, name)
    parts = np.concatenate([costs(slice(0, 64)), costs(slice(64, 75))])
    pixels, whole = (volume.reshape(-1, 16)[:, :5] for volume in (parts, costs(slice(0, 75))))
    np.testing.assert_array_equal(pixels, whole)


def test_visible_pixels_are_seen_by_some_view():
    views = Views(ways=(0, 1, 1.3), size=(70, 50), depths=61)
    warps = views.warps()
    for one in warps:
        one.coefficients[..., 0, 0] += 15 * (1 if one is warps[0] else -1)  # else all is seen at the first hypothesis
    ready = plan(warps)
    x, y = (a[::2, ::2] for a in views.grid())
    for number, reference in enumerate(ready.references):
        some = np.zeros(x.shape, bool)
        for steps in np.linspace(0, views.depths - 1, 241):
            at = slow_places(ready.warps[number], x, y, np.full(x.shape, steps))[:, 0]
            for v, view in enumerate(reference.others):
                some |= ndimage.map_coordinates(views.masks[view].astype(float), at[v].T[::-1], order=0).T > 0
        own = views.masks[number][ready.boxes[number]][::2, ::2]
        found = reference.masks[2]
        # looked for at every fourth hypothesis or so: some pixels that come and go between are missed
        assert (found != (own & some)).mean() < 0.02
        assert (own & ~found).any()
