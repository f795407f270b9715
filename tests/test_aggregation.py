"""Semi-global aggregation against plain loops over pixels, and the bands of hypotheses it works on."""

import numba
import numpy as np
import pytest

from cyclopean import errors
from cyclopean.matching import aggregation
from cyclopean.matching.bands import Bands, store

SMALL = 9
WAYS = ((1, 0), (0, 1), (1, 1), (-1, 1), (-1, 0), (0, -1), (-1, -1), (1, -1))  # (dx, dy) of the paths
ALONG = tuple(way for way in WAYS if 0 in way)


def problem(seed, size=(45, 38), tile=8, depths=50, widest=40):
    """Random costs, bands, mask and penalties; costs as (h, w, D), so large where there is none that it shows."""
    rng = np.random.default_rng(seed)
    shape = (-(-size[1] // tile), -(-size[0] // tile))
    count = rng.integers(1, widest + 1, shape)
    bands = Bands(size, depths, tile, rng.integers(0, depths - count + 1), count)
    costs = rng.integers(0, 256, (*size[::-1], depths)).astype(np.uint8)
    large = rng.integers(SMALL, 7001, size[::-1]).astype(np.uint16)
    return (
        costs,
        bands,
        rng.random(size[::-1]) < 0.9,
        np.where(rng.random(large.shape) < 0.5, large, 30).astype(np.uint16),
    )


def tiles_of(bands, rows):
    """Place, rows, columns, first and count of each tile of some rows, from nothing but the layout as it is told."""
    place = 0
    for ty in range(rows.start // bands.tile, -(-rows.stop // bands.tile)):
        for tx in range(bands.first.shape[1]):
            top, left = ty * bands.tile, tx * bands.tile
            bottom, right = min(top + bands.tile, bands.size[1]), min(left + bands.tile, bands.size[0])
            first, count = int(bands.first[ty, tx]), int(bands.count[ty, tx])
            yield place, slice(top, bottom), slice(left, right), first, count
            place += (bottom - top) * (right - left) * (-(-count // 16) * 16)


def filler(costs, bands):
    """What `search` asks for; the places of no hypothesis hold zeros, the most tempting costs."""

    def fill(rows):
        volume = np.zeros(bands.places(rows), np.uint8)
        for place, high, wide, first, count in tiles_of(bands, rows):
            planes = np.moveaxis(costs[high, wide, first : first + count], -1, 0).copy()
            store(planes, volume, place)
        return volume

    return fill


def band(bands, y, x):
    first = int(bands.first[y // bands.tile, x // bands.tile])
    return first, first + int(bands.count[y // bands.tile, x // bands.tile])


def path_sums(costs, bands, mask, large, way):
    """Costs of the best paths of one direction, (h, w, D), infinite outside of the bands. Loops, as in the paper."""
    (dx, dy), (height, width, depths) = way, costs.shape
    sums = np.full(costs.shape, np.inf)
    for y in range(height)[:: dy or 1]:
        for x in range(width)[:: dx or 1]:
            low, high = band(bands, y, x)
            sums[y, x, low:high] = costs[y, x, low:high]
            if not (0 <= x - dx < width and 0 <= y - dy < height and mask[y - dy, x - dx]):
                continue
            before = sums[y - dy, x - dx]
            for k in range(low, high):
                beside = min(before[k - 1] if k else np.inf, before[k + 1] if k + 1 < depths else np.inf)
                sums[y, x, k] += min(before[k], beside + SMALL, before.min() + large[y, x]) - before.min()
    return sums


def slow_search(costs, bands, mask, large, ways):
    sums = sum(path_sums(costs, bands, mask, large, way) for way in ways)
    steps, margin = np.full((2, *mask.shape), np.nan, np.float32)
    for y, x in np.argwhere(mask):
        low, high = band(bands, y, x)
        values = sums[y, x, low:high]
        k = int(np.argmin(values))
        steps[y, x] = low + k
        if 0 < k < len(values) - 1:
            left, right = values[[k - 1, k + 1]] - values[k]
            steps[y, x] += np.float32(0.5) * np.float32(left - right) / np.float32(max(left + right, 1))
        others = np.delete(values, [i for i in (k - 1, k, k + 1) if 0 <= i < len(values)])
        margin[y, x] = (others.min() - values[k]) / (255 * len(ways)) if len(others) else np.inf
    return steps, margin


def assert_same(found, expected):
    np.testing.assert_array_equal(found[0], expected[0])
    np.testing.assert_allclose(found[1], expected[1], rtol=1e-6)  # the twin divides in double precision


@pytest.mark.parametrize(("paths", "ways"), [(8, WAYS), (4, ALONG)])
def test_paths_are_those_of_the_plain_loops(paths, ways):
    costs, bands, mask, large = problem(1)
    found = aggregation.search(filler(costs, bands), bands, mask, SMALL, large, paths=paths)
    assert_same(found, slow_search(costs, bands, mask, large, ways))


@pytest.mark.parametrize("depths", [1, 2, 16, 21, 32])
def test_full_bands_are_the_plain_algorithm(depths):
    costs, _, mask, large = problem(2, size=(19, 21), depths=max(depths, 2), widest=2)
    bands = Bands.full((19, 21), depths, tile=8)
    found = aggregation.search(filler(costs, bands), bands, mask, SMALL, large)
    assert_same(found, slow_search(costs[..., :depths], Bands.full((19, 21), depths, tile=64), mask, large, WAYS))


@pytest.mark.parametrize("rows", [8, 24, 32, 80])
@pytest.mark.parametrize("threads", [1, 2, 3])  # three and more take turns block by block, however many there are
def test_strips_and_threads_do_not_show(rows, threads, monkeypatch):
    costs, bands, mask, large = problem(3, size=(150, 75))
    used = numba.get_num_threads()
    numba.set_num_threads(1)
    whole = aggregation.search(filler(costs, bands), bands, mask, SMALL, large)
    numba.set_num_threads(min(threads, numba.config.NUMBA_NUM_THREADS))
    monkeypatch.setattr(aggregation, "get_num_threads", lambda: threads)
    try:
        parts = aggregation.search(filler(costs, bands), bands, mask, SMALL, large, rows_per_strip=rows)
    finally:
        numba.set_num_threads(used)
    np.testing.assert_array_equal(parts, whole)


def test_the_largest_costs_and_penalties_do_not_overflow():
    costs, bands, mask, large = problem(4)
    costs[:], large[:] = np.where(costs < 128, 0, 255), 7000
    found = aggregation.search(filler(costs, bands), bands, mask, SMALL, large)
    assert_same(found, slow_search(costs, bands, mask, large, WAYS))


def ramp(size=(96, 64), depths=64):
    """Noisy costs about a known tilted plane."""
    rng, (width, height) = np.random.default_rng(5), size
    truth = 10 + 0.3 * np.arange(width) + 0.2 * np.arange(height)[:, None]
    costs = np.minimum(20 * np.abs(np.arange(depths) - truth[..., None]), 150) + rng.integers(
        0, 100, (height, width, depths)
    )
    return np.minimum(costs, 255).astype(np.uint8), truth


def test_bands_about_the_truth_find_what_all_hypotheses_find():
    costs, truth = ramp()
    mask, large = np.ones(truth.shape, bool), np.full(truth.shape, 100, np.uint16)
    full = Bands.full((96, 64), 64)
    narrow = Bands.around(truth, mask, 6, 64, tile=16).rounded()
    assert narrow.count.max() <= 32
    everywhere, _ = aggregation.search(filler(costs, full), full, mask, 10, large)
    near, _ = aggregation.search(filler(costs, narrow), narrow, mask, 10, large)
    # where costs are far off already, more hypotheses only change by how much: the winner is the same all but always
    assert np.mean(np.rint(everywhere) == np.rint(near)) > 0.99
    assert np.abs(near - truth).max() < 3


def test_margin_tells_a_clear_winner_from_two_alike():
    costs = np.full((16, 16, 20), 200, np.uint8)
    costs[..., 4] = 0
    costs[:, 8:, 12] = 0
    bands, mask = Bands.full((16, 16), 20), np.ones((16, 16), bool)
    mask[:, 7] = False  # so that no path comes over from the clear side
    _, margin = aggregation.search(filler(costs, bands), bands, mask, 5, np.full((16, 16), 50, np.uint16))
    assert (margin[:, 8:] == 0).all()
    assert (margin[:, :7] >= np.float32(200 / 255)).all()
    assert np.isnan(margin[:, 7]).all()


def test_a_ridge_parts_two_valleys_from_one():
    valleys = np.full((16, 16, 20), 200, np.uint8)
    valleys[..., 4] = 0
    valleys[:, :8, 12] = 20  # on the left, a second one beyond a ridge
    valleys[:, 8:, 5:7] = [10, 20]  # on the right, the second best lies on the slope of the best
    bands, mask, ridge = Bands.full((16, 16), 20), np.ones((16, 16), bool), np.empty((16, 16), np.float32)
    mask[:, 7:9] = False
    large = np.full((16, 16), 250, np.uint16)
    steps, margin = aggregation.search(filler(valleys, bands), bands, mask, 5, large, ridge=ridge)
    assert (np.abs(steps - 4)[mask] < 1).all()
    assert (ridge[:, :7] > 2 * margin[:, :7]).all()
    assert (ridge[:, 9:] == margin[:, 9:]).all()


@pytest.mark.parametrize("shape", [(3, 2, 5), (16, 3, 16), (37, 4, 21), (32, 2, 32)])
def test_stored_planes_lie_pixel_by_pixel(shape):
    planes = (
        np.random.default_rng(6).integers(0, 256, (*shape[:2], shape[2] + 7)).astype(np.uint8)[..., 3 : 3 + shape[2]]
    )
    stride = -(-shape[0] // 16) * 16
    volume = np.zeros(10 + shape[1] * shape[2] * stride, np.uint8)
    store(planes, volume, 10)
    pixels = volume[10:].reshape(*shape[1:], stride)[..., : shape[0]]
    np.testing.assert_array_equal(pixels, np.moveaxis(planes, 0, -1))


def test_places_are_counted_tile_by_tile():
    _, bands, _, _ = problem(7)
    tiles = list(tiles_of(bands, slice(0, 38)))
    np.testing.assert_array_equal(bands.start.ravel(), [tile[0] for tile in tiles])
    assert bands.places(slice(0, 38)) == bands.places(slice(0, 16)) + bands.places(slice(16, 38))


def test_bands_lie_around_what_is_known():
    steps = np.full((64, 64), np.nan, np.float32)
    steps[:16, :16], steps[3, 3], steps[0, 19] = 20.5, 12.2, 30
    bands = Bands.around(steps, np.ones(steps.shape, bool), 2, 100, tile=16)
    last = bands.first + bands.count - 1
    assert (bands.first[0, 0], last[0, 0]) == (10, 32)  # the 30 lies next door, no more than 4 px off
    assert (bands.first[0, 1], last[0, 1]) == (18, 32)  # its own 30 and the 20.5 beside, not the 12.2 in the middle
    assert (bands.first[0, 2], last[0, 2]) == (18, 32)  # nothing known: as its neighbours
    assert (bands.first[3, 3], last[3, 3]) == (0, 99)  # nor in the neighbours
    outside = Bands.around(steps, np.isfinite(steps), 2, 100, tile=16)
    assert outside.count[3, 3] == 1


def test_rounded_bands_hold_the_old_ones():
    _, bands, _, _ = problem(9)
    wide = bands.rounded()
    assert ((wide.count % 16 == 0) | (wide.count == bands.depths)).all()
    assert (wide.first <= bands.first).all()
    assert (wide.first + wide.count >= bands.first + bands.count).all()


def test_memory_is_counted():
    _, bands, _, _ = problem(10, size=(150, 75))
    whole, part = (aggregation.strip_bytes(bands, rows) for rows in (75, 8))
    assert part < whole
    assert whole > 3 * bands.places(slice(0, 75))


def test_wrong_calls_are_refused():
    costs, bands, mask, large = problem(11)
    fill = filler(costs, bands)
    with pytest.raises(errors.ShapeError, match="multiple of 8"):
        aggregation.search(fill, bands, mask, SMALL, large, rows_per_strip=10)
    with pytest.raises(errors.ShapeError, match="uint16"):
        aggregation.search(fill, bands, mask, SMALL, large.astype(int))
    with pytest.raises(errors.ShapeError, match="7000"):
        aggregation.search(fill, bands, mask, SMALL, large + np.uint16(7000))
    with pytest.raises(errors.ShapeError, match="4 or 8"):
        aggregation.search(fill, bands, mask, SMALL, large, paths=5)
    with pytest.raises(errors.ShapeError, match="flat array"):
        aggregation.search(lambda rows: costs, bands, mask, SMALL, large)
    with pytest.raises(errors.ShapeError, match="hypotheses from 0 to 49"):
        Bands(bands.size, 50, 8, bands.first + 50, bands.count)
