"""Sub-step depth by Lucas and Kanade's method, and jumps in their place: kernels beside slow twins."""

import numpy as np
import pytest
from scipy import ndimage
from shifted_views import Texture, Views, everywhere, in_picture, slow_places, whole

from cyclopean.matching import jumps, pictures, plan, refinement, surfaces

VIEWS = Views(ways=(0, 1, -1), size=(90, 76), depths=25, corner=(5, 3))
PLANE = (6.0, 0.06, 0.05)


def block(x, y):
    """A block that stands before the rest."""
    return (x > 30) & (x < 62) & (y > 20) & (y < 50)


SCENE = ((Texture(), PLANE, everywhere), (Texture(3), (18.0, 0.0, 0.0), block))


@pytest.fixture(scope="module")
def scene():
    """A plan, a block before a plane made ready for it, and the true hypotheses of view 0."""
    ready = plan(VIEWS.warps())
    return ready, pictures.prepare(VIEWS.photograph(SCENE), ready), VIEWS.truth(SCENE, 0)


@pytest.fixture
def rng():
    return np.random.default_rng(5)


def picture_places(ready, layout, number, steps, view_index):
    """Columns and rows in another view's picture where pixels of view `number` are seen, NaN unknown."""
    stride = round(1 / layout.scale)
    height, width = steps.shape
    x, y = np.meshgrid(stride * np.arange(width), stride * np.arange(height))
    at = slow_places(ready.warps[number], x, y, steps)[view_index, 0]
    return in_picture(layout, ready.references[number].others[view_index], at)


# Lucas-Kanade


def slow_looks(ready, prepared, level, depth):
    """Weights, differences and slopes (V-1, h, w) of view 0 against the others."""
    smooth, spline = prepared.smooth[level], prepared.splines[level]
    looks = []
    for v, view in enumerate(ready.references[0].others):
        coefficients = whole(spline.layout, spline.values[0], view).astype(float)
        known = np.where(np.isnan(depth), 0.0, depth)

        def value(steps, v=v, coefficients=coefficients):
            u, w = picture_places(ready, smooth.layout, 0, steps, v)
            return ndimage.map_coordinates(coefficients, [w, u], order=3, prefilter=False)

        u, w = picture_places(ready, smooth.layout, 0, known, v)
        weight = ndimage.map_coordinates(whole(smooth.layout, smooth.layout.weights, view), [w, u], order=0)
        weight = np.where(np.isnan(depth), 0, weight)
        slope = (value(known + 1e-3) - value(known - 1e-3)) / 2e-3
        looks.append((weight, value(known) - smooth.own(0)[0], slope))
    return looks


def projected(w, r, values):
    """What is left of values (N, M) when the best gain (held back) and offset of each are taken out, and of r."""
    system = np.concatenate([np.sqrt(w)[:, None] * np.stack([r, np.ones_like(r)], -1), [[10.0, 0.0]]])  # 10^2: _GAIN
    rights = np.concatenate([np.sqrt(w)[:, None] * values, np.zeros((1, values.shape[1]))])
    return rights - system @ np.linalg.lstsq(system, rights, rcond=None)[0]


def slow_step(own, looks, window, prior):
    """Change, its standard deviation, and how much less alike than the best each view is, of one pixel."""
    middle, sums, powers = tuple(n // 2 for n in window.shape), [], []
    for weight, difference, slope in looks:
        if weight[middle] == 0:
            continue
        w = (window * weight).ravel()
        left = projected(w, own.ravel(), np.stack([difference.ravel(), slope.ravel()], -1))
        sums.append((left[:, 1] @ left[:, 1], -left[:, 0] @ left[:, 1], left[:, 0] @ left[:, 0], w.sum()))
        value = (own + difference).ravel()
        powers.append(w @ (value - np.average(value, weights=w)) ** 2)
    if not sums:
        return np.nan, np.nan, np.inf
    sums = np.array(sums)

    def solve(a, b, e, w):
        change = b / (a + max(e / max(w, 1), refinement._NOISE) * prior)
        left = max(e + change * (change * a - 2 * b), 0)
        return change, np.sqrt(max(left / max(w - 3, 1), refinement._NOISE) / a)

    change, _ = solve(*sums.sum(0))
    left = sums[:, 2] + change * (change * sums[:, 0] - 2 * sums[:, 1])
    alike = np.sqrt(np.clip(1 - left / powers, 0, 1))
    below = alike.max() - alike
    return *solve(*sums[below <= refinement._DROP].sum(0)), np.abs(below - refinement._DROP).min()


def bumpy(truth, rng, by=0.4):
    """The truth with smooth errors of some steps."""
    noise = ndimage.gaussian_filter(rng.normal(size=truth.shape), 2)
    return (truth + by * noise / np.abs(noise).max()).astype(np.float32)


@pytest.mark.parametrize(("level", "passes"), [(0, 3), (0, 2), (1, 2)])
def test_a_step_is_the_least_squares_of_its_window(scene, rng, level, passes):
    ready, prepared, truth = scene
    depth = bumpy(truth[:: 2**level, :: 2**level], rng)
    depth[5:8, 5:8] = np.nan
    reach, prior = 1.5, 0.5
    pair = prepared.smooth[level], prepared.splines[level]
    found, sigma, _ = refinement.refined(*pair, ready.references[0], depth, passes=passes, reach=reach, prior=prior)
    looks = slow_looks(ready, prepared, level, depth)
    hidden = np.all([look[0] == 0 for look in looks], axis=0)
    assert np.isnan(found[hidden | np.isnan(depth)]).all()
    assert np.isfinite(found[8:-8, 8:-8][~np.isnan(depth)[8:-8, 8:-8]]).all()
    own = prepared.smooth[level].own(0)[0].astype(float)
    low, high = surfaces.extremes(depth, 2 * passes - 1)
    jump = high - low > reach
    line = np.convolve([1, 2, 1], [1, 0, 2, 0, 1] if passes == 2 else [1, 0, 4, 0, 6, 0, 4, 0, 1])
    compared = {True: 0, False: 0}
    height, width = depth.shape
    for y, x in rng.integers((8, 8), (height - 8, width - 8), (400, 2)):
        start = x // refinement.SUB * refinement.SUB
        near = bool(jump[y, start : start + refinement.SUB].any())
        if np.isnan(depth[y, x]) or compared[near] > 60:
            continue
        n = 3 if near else 2 * passes - 1
        at = np.s_[y - n : y + n + 1, x - n : x + n + 1]
        window = np.outer(line, line) / line.max() ** 2
        if near:  # neighbours of like depth only
            tent = (4 - np.abs(np.arange(-3, 4))) / 4
            away = np.nan_to_num(depth[at] - depth[y, x], nan=99) / reach
            window = np.outer(tent, tent) * np.maximum(0, 1 - away**2) ** 2
        change, spread, doubt = slow_step(own[at], [[a[at] for a in look] for look in looks], window, 1 / prior**2)
        if np.isnan(change) or abs(change) > 1 or doubt < 0.05:
            continue  # steps are cut off at 1; one view may hide the point
        compared[near] += 1
        # float32 sums of squares up to 1e5 of differences that are some tens
        assert found[y, x] - depth[y, x] == pytest.approx(change, abs=5e-3)
        assert sigma[y, x] == pytest.approx(spread, rel=0.05)
    assert min(compared.values()) > 15


def test_steps_lead_to_the_truth(scene):
    ready, *_ = scene
    flat = pictures.prepare(VIEWS.photograph(SCENE[:1], rounded=False) / 255, ready)
    truth = VIEWS.truth(SCENE[:1], 0)
    depth = (truth + 0.5).astype(np.float32)
    for _ in range(2):
        depth, _, score = refinement.refined(
            flat.smooth[0], flat.splines[0], ready.references[0], depth, passes=3, reach=2.0, prior=1.0
        )
    error = np.abs(depth - truth)[VIEWS.seen(truth, 0)]
    # steps of 0.5 px; without noise, what is left comes of the blur, which is not that of the other view's pixels
    assert np.median(error) < 0.01
    assert np.percentile(error, 95) < 0.05
    assert np.percentile(score[VIEWS.seen(truth, 0)], 5) > 0.99


def test_a_view_that_shows_something_else_is_dropped():
    ready = plan(VIEWS.warps())
    image, truth = VIEWS.photograph(SCENE[:1]), VIEWS.truth(SCENE[:1], 0)
    spoilt, box = image.copy(), ready.boxes[2]
    spoilt[box] = Texture(11)(*VIEWS.grid())
    depth, found = (truth + 0.4).astype(np.float32), []
    for picture in (image, spoilt):
        prepared, step = pictures.prepare(picture, ready), depth
        for _ in range(2):
            step, _, _ = refinement.refined(
                prepared.smooth[0], prepared.splines[0], ready.references[0], step, passes=3, reach=2.0, prior=0.5
            )
        found.append(np.abs(step - truth)[VIEWS.seen(truth, 0)])
    assert np.median(found[0]) < 0.02
    assert np.median(found[1]) < 0.04  # one view of two is left: worse by the square root of two and some
    assert np.mean(found[1] > 0.5) < 0.02


@pytest.mark.parametrize("channels", [1, 3])
def test_gain_and_offset_do_not_move_a_step(channels, rng):
    ready, truth = plan(VIEWS.warps(), channels=channels), VIEWS.truth(SCENE[:1], 0)
    image, depth = VIEWS.photograph(SCENE[:1]) / 300, bumpy(truth, rng)
    image[0, 0] = 1  # stays the brightest
    other = image.copy()
    other[ready.boxes[1]] = 0.8 * other[ready.boxes[1]] + 0.1
    found = []
    for picture in (image, other):
        prepared = pictures.prepare(picture, ready)
        found.append(
            refinement.refined(
                prepared.smooth[0], prepared.splines[0], ready.references[0], depth, passes=3, reach=2.0, prior=0.5
            )[0]
        )
    seen = VIEWS.seen(truth, 0)
    # the gain is held back a little where there is hardly any texture
    assert np.percentile(np.abs(found[1] - found[0])[seen], 95) < 0.04


# Jumps


def slow_unlike(ready, smooth, depth, candidate):
    """1 - ZNCC (h, w) of 3 x 3 pixels of view 0 at candidate depths, windows sloping as the maps do halfway."""
    layout, own = smooth.layout, np.pad(smooth.own(0)[0].astype(float), 1, mode="edge")
    height, width = depth.shape
    x, y = np.meshgrid(np.arange(width), np.arange(height))
    total, count = np.zeros((2, height, width))
    for v, view in enumerate(ready.references[0].others):

        def at(x, y, steps, v=v, view=view):
            pixels = slow_places(ready.warps[0], np.minimum(x, width - 1), y, steps)[v, 0]
            return in_picture(layout, view, pixels)

        middle = np.full(depth.shape, (VIEWS.depths - 1) / 2)
        span = jumps._SPAN
        first = x // span * span  # slopes serve as many columns as they are taken over
        here = at(first, y, middle)
        right, down = (at(first + span, y, middle) - here) / span, (at(first, y + span, middle) - here) / span
        picture, weights = (whole(layout, a, view).astype(float) for a in (smooth.values[0], layout.weights))
        u0, w0 = at(x, y, candidate)
        mine, other = [], []
        for j, i in np.ndindex(3, 3):
            u, w = (c + (i - 1) * r + (j - 1) * d for c, r, d in zip((u0, w0), right, down, strict=True))
            value = ndimage.map_coordinates(picture, [w, u], order=1)
            corner = ndimage.map_coordinates(weights, [np.floor(w), np.floor(u)], order=0)
            inside = (u >= 1) & (w >= 1) & (u < picture.shape[1] - 2) & (w < picture.shape[0] - 2) & (corner > 0)
            other.append(np.where(inside, value, np.nan))
            mine.append(own[j : j + height, i : i + width])
        mine, other = np.array(mine), np.array(other)
        both = (mine * other).mean(0) - mine.mean(0) * other.mean(0)
        unlike = 1 - both / np.sqrt((mine.var(0) + jumps._NOISE) * (other.var(0) + jumps._NOISE))
        total += np.where(np.isnan(unlike), 0, np.minimum(unlike, jumps._CEILING))
        count += ~np.isnan(unlike)
    return np.where(count > 0, total / np.maximum(count, 1), jumps._UNSEEN)


def displaced(truth):
    """Jumps two pixels to the right of where they are."""
    return np.roll(truth, 2, axis=1).astype(np.float32)


def test_pixels_near_jumps_choose_what_looks_most_like_them(scene):
    ready, (_, prepared, truth) = plan(VIEWS.warps(crooked=0.2)), scene
    depth = displaced(truth)
    low, high = surfaces.extremes(depth, jumps.RADIUS)
    near = high - low > jumps.REACH
    costs = np.array([slow_unlike(ready, prepared.smooth[0], depth, candidate) for candidate in (depth, low, high)])
    for k, candidate in enumerate((low, high)):
        costs[1 + k][np.abs(candidate - depth) <= jumps.REACH] = np.inf
    expected = np.where(near, np.choose(np.argmin(costs, axis=0), [depth, low, high]), depth)
    found = jumps.placed(prepared.smooth[0], ready.references[0], depth)
    clear = np.abs(np.sort(costs, axis=0)[1] - costs.min(0)) > 1e-3  # else roundings choose
    np.testing.assert_array_equal(found[clear | ~near], expected[clear | ~near])
    assert (clear & near).sum() > 200


def test_jumps_come_to_their_place():
    ready, fine = plan(VIEWS.warps()), [Texture(seed, lengths=(2.5, 10)) for seed in (1, 3)]
    scene = ((fine[0], PLANE, everywhere), (fine[1], (18.0, 0.0, 0.0), block))
    prepared, truth = pictures.prepare(VIEWS.photograph(scene), ready), VIEWS.truth(scene, 0)
    depth, seen = displaced(truth), VIEWS.seen(truth, 0)
    wrong = np.abs(depth - truth) > 2
    found = surfaces.median(jumps.placed(prepared.smooth[0], ready.references[0], depth))
    # half of what lies beside a jump is hidden from one of the two other views
    assert ((np.abs(found - truth) > 2) & seen).sum() < 0.5 * (wrong & seen).sum()
