"""Dense matching: kernels against plain numpy, and made-up photographs whose depth is known exactly."""

import numba
import numpy as np
import pytest
from scipy import ndimage

from cyclopean import errors
from cyclopean.matching import Warps, aggregation, agreement, cost, match, refinement, views

SIZE, DEPTHS, MARGIN = (150, 110), 25, 30  # box, hypotheses, free columns around each picture
STEP = 0.5  # px that one hypothesis moves a picture
INVERSE = np.linspace(1 / 1500, 1 / 650, DEPTHS)


class Texture:
    """A smooth random picture that can be looked up anywhere: sums of waves 4 to 20 px long, three channels."""

    def __init__(self, seed=1, waves=60):
        rng = np.random.default_rng(seed)
        angle, length = rng.uniform(0, 2 * np.pi, waves), rng.uniform(4, 20, waves)
        self.wave = 2 * np.pi / length * np.stack([np.cos(angle), np.sin(angle)])
        self.phase, self.weight = rng.uniform(0, 2 * np.pi, (waves, 3)), rng.uniform(3, 9, (waves, 3))

    def __call__(self, x, y):
        angle = np.stack([x, y], axis=-1) @ self.wave
        return 128 + np.sum(self.weight * np.cos(angle[..., None] + self.phase), axis=-2)


def grid():
    width, height = SIZE
    return np.meshgrid(np.arange(width, dtype=float), np.arange(height, dtype=float))


def photograph(pictures):
    """Pictures (h, w + 2 margin, 3) side by side, and a mask for each."""
    image = np.concatenate(pictures, axis=1)
    masks = np.zeros((len(pictures), *image.shape[:2]), bool)
    for mask, left in zip(masks, np.arange(len(pictures)) * pictures[0].shape[1]):
        mask[1:-1, left + 2 : left + pictures[0].shape[1] - 2] = True
    return np.clip(np.rint(image), 0, 255).astype(np.uint8), masks


def shift_warps(masks, signs, spacing=8):
    """Maps for views that lie side by side and move by STEP px a hypothesis, to the right or left."""
    width, height = SIZE
    nx, ny = (width - 2) // spacing + 2, (height - 2) // spacing + 2
    x, y = np.meshgrid(spacing * np.arange(nx), spacing * np.arange(ny))
    nodes = np.empty((len(signs), DEPTHS, ny, nx, 2), np.float32)
    for v, sign in enumerate(signs):
        for k in range(DEPTHS):
            nodes[v, k] = np.stack([x + MARGIN + (v + 1) * (width + 2 * MARGIN) + sign * STEP * k, y], axis=-1)
    return Warps((MARGIN, 0), SIZE, INVERSE, spacing, nodes, masks)


def columns():
    """Columns of a picture with its margins, in the box's x; and rows."""
    width, height = SIZE
    return np.meshgrid(np.arange(-MARGIN, width + MARGIN, dtype=float), np.arange(height, dtype=float))


def slanted(plane, texture=None, signs=(1,)):
    """A photograph of a slanted plane, inverse depth ``plane`` @ (1, x, y) in steps, and its maps."""
    texture = texture or Texture()
    x, y = columns()
    a, b, c = plane
    pictures = [texture(x, y)]
    for sign in signs:  # u = x + sign STEP (a + b x + c y), solved for x
        pictures.append(texture((x - sign * STEP * (a + c * y)) / (1 + sign * STEP * b), y))
    image, masks = photograph(pictures)
    return image, shift_warps(masks, signs)


def steps_of(depth_map):
    return (depth_map.inverse_depth - INVERSE[0]) / (INVERSE[1] - INVERSE[0])


PLANE = (6.0, 0.06, 0.04)


@pytest.fixture(scope="module")
def tilted():
    """Photograph, maps, depth map and truth of a slanted plane."""
    image, warps = slanted(PLANE)
    x, y = grid()
    return image, warps, match(image, warps), PLANE[0] + PLANE[1] * x + PLANE[2] * y


def test_a_slanted_plane_is_found(tilted):
    _, _, found, truth = tilted
    error = steps_of(found) - truth
    assert np.isfinite(error).mean() > 0.97  # the mask takes off one row at top and bottom
    assert np.sqrt(np.nanmean(error**2)) * STEP < 0.02  # px; grey levels are rounded: 0.3 rms
    assert np.nanmax(np.abs(error)) < 1


def test_sigma_says_how_large_errors_are():
    image, warps = slanted(PLANE)
    noisy = np.clip(image + np.random.default_rng(2).normal(0, 6, image.shape), 0, 255).astype(np.uint8)
    found = match(noisy, warps)
    x, y = grid()
    pull = (steps_of(found) - (PLANE[0] + PLANE[1] * x + PLANE[2] * y)) * (INVERSE[1] - INVERSE[0]) / found.sigma
    # median of |N(0, 1)| is 0.674; sigma leaves out that neighbours share interpolation, hence the wide band
    assert 0.5 < np.nanmedian(np.abs(pull)) < 1.0
    assert np.isfinite(pull).mean() > 0.97


def two_depths(signs):
    """A square 10 steps nearer than its background, and the views' maps and truth."""
    near, far = Texture(3), Texture(4)
    x, y = columns()

    def inside(x):
        return (x > 50) & (x < 100) & (y > 30) & (y < 80)

    pictures = []
    for sign in (0, *signs):
        front, back = x - sign * STEP * 16, x - sign * STEP * 4
        pictures.append(np.where(inside(front)[..., None], near(front, y), far(back, y)))
    image, masks = photograph(pictures)
    box = slice(MARGIN, MARGIN + SIZE[0])
    return image, shift_warps(masks, signs), np.where(inside(x), 16.0, 4.0)[:, box]


def test_a_third_view_fills_what_is_hidden_in_the_second():
    right = {}
    for signs in ((1,), (1, -1)):
        image, warps, truth = two_depths(signs)
        right[signs] = np.abs(steps_of(match(image, warps)) - truth) < 0.4
    hidden = np.zeros(truth.shape, bool)
    hidden[34:76, 100 + 1 : 100 + 5] = True  # background right of the square: in front of it in view 1 only
    assert right[1, -1].mean() > 0.95
    assert right[1, -1][hidden].mean() > right[(1,)][hidden].mean() + 0.4


def test_a_blank_patch_stays_unknown():
    texture = Texture()

    def patched(x, y):
        blank = (np.hypot(x - 75, y - 55) < 25)[..., None]
        return np.where(blank, 128, texture(x, y))

    image, warps = slanted((8.0, 0.0, 0.0), patched)
    found = match(image, warps)
    x, y = grid()
    assert np.isnan(found.inverse_depth[np.hypot(x - 75, y - 55) < 15]).all()  # 25 less half a window, corners too
    assert np.isfinite(found.inverse_depth[np.hypot(x - 75, y - 55) > 30][300:-300]).mean() > 0.97


def test_pictures_of_different_things_do_not_match():
    image, warps = slanted(PLANE)
    other = Texture(9)(*columns())
    image[:, other.shape[1] :] = other
    found = match(image, warps)
    assert np.isfinite(found.inverse_depth).mean() < 0.05
    assert np.isnan(found.sigma[np.isnan(found.inverse_depth)]).all()


@pytest.mark.parametrize("kind", [np.uint8, np.uint16, np.float64])
def test_a_black_image_is_unknown_everywhere(tilted, kind):
    image, warps, *_ = tilted
    found = match(np.zeros(image.shape, kind), warps)
    assert np.isnan(found.inverse_depth).all()
    assert (found.score == 0).all()


def test_brightness_of_one_view_does_not_matter(tilted):
    image, warps, found, _ = tilted
    dim = image.astype(float)
    dim[:, dim.shape[1] // 2 :] *= 0.7
    change = steps_of(match(dim.astype(np.uint8), warps)) - steps_of(found)
    assert np.sqrt(np.nanmean(change**2)) * STEP < 0.02  # px: rounded to coarser grey levels again
    assert np.isfinite(change).mean() > 0.97


@pytest.mark.parametrize("change", [np.ndarray.__copy__, lambda i: i.astype(np.uint16) * 257, lambda i: i / 255])
def test_types_and_channels_do_not_matter(tilted, change):
    image, warps, found, _ = tilted
    difference = steps_of(match(change(image), warps)) - steps_of(found)
    assert np.nanmax(np.abs(difference)) < 0.02  # steps; floats are scaled by the brightest pixel
    assert np.isfinite(difference).mean() > 0.97


def test_a_grey_photograph_does_as_well(tilted):
    image, warps, _, truth = tilted
    error = steps_of(match(image[..., 1], warps)) - truth
    assert np.sqrt(np.nanmean(error**2)) * STEP < 0.05  # px
    assert np.isfinite(error).mean() > 0.95


def test_nothing_is_known_where_maps_are_not(tilted):
    image, warps, found, _ = tilted
    nodes = warps.nodes.copy()
    nodes[:, :, :, :6] = np.nan  # columns 0 to 47 need one of these
    holed = match(image, Warps(warps.origin, warps.size, warps.inverse_depths, warps.spacing, nodes, warps.masks))
    assert np.isnan(holed.inverse_depth[:, :47]).all()
    difference = (holed.inverse_depth - found.inverse_depth)[:, 60:]
    assert np.nanmax(np.abs(difference)) < 0.05 * warps.step
    assert np.isfinite(difference).mean() > 0.97


def test_strips_do_not_show(tilted, monkeypatch):
    _, warps, found, _ = tilted
    image = tilted[0]
    monkeypatch.setattr("cyclopean.matching.dense._OVERLAP", 24)  # the picture is small, so are its strips
    done = []
    striped = match(image, warps, memory_mib=1, progress=lambda *at: done.append(at))
    assert done[-1][0] == done[-1][1] == len(done) > 4 * DEPTHS  # several strips
    difference = steps_of(striped) - steps_of(found)
    assert np.nanmax(np.abs(difference)) < 0.1
    assert (np.isnan(striped.inverse_depth) != np.isnan(found.inverse_depth)).mean() < 0.005


def test_threads_do_not_show(tilted):
    image, warps, found, _ = tilted
    threads = numba.get_num_threads()
    try:
        numba.set_num_threads(1)
        alone = match(image, warps)
    finally:
        numba.set_num_threads(threads)
    np.testing.assert_array_equal(alone.inverse_depth, found.inverse_depth)
    np.testing.assert_array_equal(alone.sigma, found.sigma)


def test_a_depth_map_is_looked_up_in_the_photograph(tilted):
    found = tilted[2]
    pixels = np.array([[[MARGIN + 20.4, 50.3], [MARGIN - 1, 5]], [[np.nan, 3], [1e9, 4]]])
    np.testing.assert_array_equal(found.at(pixels), [[found.inverse_depth[50, 20], np.nan], [np.nan, np.nan]])


def test_agreement_counts_witnesses():
    nan = np.nan
    own = np.array([[1.0, 1.0, 1.0, 1.0, 1.0, nan]])
    seen = np.array(
        [
            [[1.05, 0.5, 2.0, nan, 1.0, 1.0]],
            [[nan, 1.0, nan, nan, 0.5, 1.0]],
            [[0.5, 0.5, 1.0, nan, 2.0, 1.0]],
        ]
    )  # one each, two object, hidden in one, alone, one each, nothing to check
    np.testing.assert_array_equal(agreement(own, seen, 0.1), [[True, False, True, False, True, False]])
    with pytest.raises(errors.ShapeError, match="seen must have shape"):
        agreement(own, seen[0], 0.1)


def test_wrong_images_are_refused(tilted):
    image, warps, *_ = tilted
    with pytest.raises(errors.ImageError, match="rows and columns"):
        match(image[:-1], warps)
    with pytest.raises(errors.ImageError, match="must have shape"):
        match(image[0, 0], warps)
    with pytest.raises(errors.ImageError, match="unsigned"):
        match(image.astype(int), warps)


# Kernels and their slow twins


def test_look_is_bilinear_interpolation(tilted):
    image, warps, *_ = tilted
    levels = image.astype(np.float32)
    own, top, k = np.ascontiguousarray(warps.reference_mask()[10:40]), 10, 3
    warped, seen = np.full((3, 30, 200), 7, np.float32), np.full((30, 200), 7, np.float32)
    views.look(levels, warps.masks[1], warps.nodes[0, k], 8, top, own, 8, warped, seen)
    x, y = (a[10:40] for a in grid())
    at = np.stack([y, x + MARGIN + SIZE[0] + 2 * MARGIN + STEP * k])
    inside = ndimage.map_coordinates(warps.masks[1].astype(float), at, order=0) * own
    np.testing.assert_array_equal(seen[:, 8 : 8 + SIZE[0]], inside)
    assert seen[:, :8].max() == seen[:, 8 + SIZE[0] :].max() == warped[:, seen == 0].max() == 0
    for c in range(3):
        twin = ndimage.map_coordinates(levels[..., c], at, order=1) * inside
        np.testing.assert_allclose(warped[c, :, 8 : 8 + SIZE[0]], twin, atol=0.01)  # float32 pixels near 400: 3e-5


def test_sample_is_a_cubic_spline_with_its_slope(tilted):
    image, warps, *_ = tilted
    guess = np.random.default_rng(4).uniform(0, DEPTHS - 1, (20, SIZE[0])).astype(np.float32)
    guess[3, 4] = np.nan
    _, spline = refinement.prepare(image.astype(np.float32))
    values, slopes = np.zeros((2, 3, 30, SIZE[0] + 10), np.float32)
    seen = np.zeros((30, SIZE[0] + 10), np.float32)
    views.sample(spline, warps.masks[1], warps.nodes[0], 8, 40, guess, 5, values, slopes, seen)
    inner = np.s_[..., 5:-5, 5:-5]
    x, y = (a[40:60] for a in grid())

    def twin(steps, c):
        at = np.stack([y, x + MARGIN + SIZE[0] + 2 * MARGIN + STEP * steps])
        return ndimage.map_coordinates(spline[..., c].astype(float), at, order=3, prefilter=False)

    known = np.isfinite(guess)
    np.testing.assert_array_equal(seen[inner], known)
    for c in range(3):
        np.testing.assert_allclose(values[c][inner][known], twin(guess, c)[known], atol=0.02)  # as above
        slope = (twin(guess + 0.01, c) - twin(guess - 0.01, c)) / 0.02
        np.testing.assert_allclose(slopes[c][inner][known], slope[known], atol=0.05)


def test_dissimilarity_is_a_weighted_zncc():
    rng, wide = np.random.default_rng(5), cost.N + 2 * cost.REACH
    width, radius, floor = 40, 2, 1.0
    reference, warped, seen = np.zeros((2, 12, wide)), np.zeros((2, 12, wide)), np.zeros((12, wide))
    part = np.s_[..., cost.REACH : cost.REACH + width]
    reference[part] = rng.uniform(0, 255, (2, 12, width))
    warped[part] = 0.5 * reference[part] + rng.normal(0, 30, (2, 12, width))
    seen[part] = rng.uniform(size=(12, width)) < 0.7
    found = cost.dissimilarity(*(a.astype(np.float32) for a in (reference, warped, seen)), radius, floor, width)
    tent = np.outer([1, 2, 3, 2, 1], [1, 2, 3, 2, 1])
    pad = [(0, 0), (radius, radius), (0, 0)]
    reference, warped, seen = np.pad(reference, pad), np.pad(warped, pad), np.pad(seen, pad[1:])
    for y, x in np.ndindex(12, width):
        window = np.s_[..., y : y + 5, x + cost.REACH - 2 : x + cost.REACH + 3]
        w = tent * seen[window]
        if w[2, 2] == 0 or w.sum() < tent.sum() / 2:
            assert found[y, x] == cost.UNSEEN
            continue
        r, o = (
            a[window] - np.average(a[window], axis=(1, 2), weights=np.broadcast_to(w, (2, 5, 5)))[:, None, None]
            for a in (reference, warped)
        )
        power = [np.sum(w * (a**2 + floor)) for a in (r, o)]
        # 2e-3: sums of float32 squares up to 5e6 lose what their difference, some 1e5, is made of
        assert found[y, x] == pytest.approx(1 - np.sum(w * r * o) / np.sqrt(np.prod(power)), abs=2e-3)


def test_fuse_leaves_out_views_that_do_not_see():
    unseen = cost.UNSEEN
    costs = np.array([[[0.2, 0.2, unseen, 2.0]], [[0.4, unseen, unseen, 0.0]]], np.float32)
    np.testing.assert_array_equal(cost.fuse(costs, 0.8), [[96, 64, 255, 128]])  # 255 mean / 0.8, half up


def path_costs(volume, mask, small, large, dx, dy):
    """One direction of semi-global matching, pixel by pixel."""
    height, width, depths = volume.shape
    out = np.zeros((height, width, depths), int)
    for y in range(height)[:: 1 if dy >= 0 else -1]:
        for x in range(width)[:: 1 if dx >= 0 else -1]:
            if not mask[y, x]:
                continue
            v, u = y - dy, x - dx
            before = out[v, u] if 0 <= v < height and 0 <= u < width else np.zeros(depths, int)
            padded = np.pad(before, 1, constant_values=10**6)
            choices = [before, padded[:-2] + small, padded[2:] + small, np.full(depths, before.min() + large[y, x])]
            out[y, x] = volume[y, x] + np.min(choices, axis=0) - before.min()
    return out


def test_aggregation_walks_eight_paths():
    rng = np.random.default_rng(6)
    volume = rng.integers(0, 256, (21, 37, 9)).astype(np.uint8)
    mask, large = rng.uniform(size=(21, 37)) < 0.9, rng.integers(20, 200, (21, 37)).astype(np.uint16)
    twin = sum(path_costs(volume, mask, 11, large, *way) for way in aggregation.DIRECTIONS)
    total = aggregation.aggregate(volume, mask, 11, large)
    np.testing.assert_array_equal(total, twin)
    best = aggregation.winner(total, mask)
    np.testing.assert_array_equal(np.isnan(best), ~mask)
    assert np.abs(best - np.argmin(twin, axis=-1))[mask].max() <= 0.5


def test_improve_solves_least_squares():
    rng, r, n = np.random.default_rng(7), 2, refinement.N
    reference = rng.uniform(0, 255, (2, 9, n + 2 * r))
    slopes = rng.normal(0, 20, (2, 2, 9, n + 2 * r))
    depth = 5 + rng.uniform(-0.4, 0.4, (9, n + 2 * r))
    values = 0.9 * reference + 10 + slopes * 0.3 + rng.normal(0, 1, slopes.shape)
    seen = (rng.uniform(size=(2, 9, n + 2 * r)) < 0.9).astype(float)
    window, reach, gain, stiff = refinement._window()[3:8, 3:8], 0.8, 50.0, 70.0
    single = [a.astype(np.float32) for a in (reference, values, slopes, seen, depth)]
    change, sigma, *_ = refinement.improve(*single, window, np.float32(reach), gain, stiff, 0.2, 2.0)
    dj, di = np.mgrid[-r : r + 1, -r : r + 1]
    for y, x in ((0, 0), (2, 50), (4, n - 1)):
        at = np.s_[..., y : y + 2 * r + 1, x : x + 2 * r + 1]
        away = depth[at] - depth[y + r, x + r]
        rows, rights = [np.sqrt(stiff) * np.eye(11)[[1, 2]]], [np.zeros(2)]
        for v, c in np.ndindex(2, 2):  # unknowns: height, two slopes; gain - 1 and offset of view and channel
            w = np.sqrt(window * np.maximum(0, 1 - away**2 * reach) ** 2 * seen[v][at])
            w = w * (seen[v][y + r, x + r] > 0)
            g, block = slopes[v, c][at], np.zeros((25, 11))
            block[:, :3] = np.stack([w * g, w * g * di, w * g * dj], axis=-1).reshape(25, 3)
            block[:, 3 + 4 * v + 2 * c] = -(w * reference[c][at]).ravel()
            block[:, 4 + 4 * v + 2 * c] = -w.ravel()
            prior = np.sqrt(gain) * np.eye(11)[[3 + 4 * v + 2 * c]]
            rows += [block, prior]
            rights += [-(w * (values[v, c][at] - reference[c][at] - g * away)).ravel(), np.zeros(1)]
        best = np.linalg.lstsq(np.concatenate(rows), np.concatenate(rights), rcond=None)[0]
        assert change[y, x] == pytest.approx(best[0], abs=2e-3)  # float32 sums of squares
        assert sigma[y, x] > 0
