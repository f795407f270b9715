"""Rectified pairs, and the matchers that work on them."""

import cv2
import numpy as np
import pytest
from scenes import photograph_plane, small_setup
from setups import SETUPS, mirrors_beside

from cyclopean import Camera, Rig, Setup
from cyclopean.errors import ImageError, OpticError, SetupError, ShapeError
from cyclopean.geometry import Pose
from cyclopean.matching.pairwise import as_disparity, sgbm
from cyclopean.pipeline import reconstruct_by_pairs
from cyclopean.pipeline.pairs import merged
from cyclopean.rectification import exact_depth, partners, per_disparity, pinhole_depth, rectify, tilted_pinhole
from cyclopean.rectification.pinholes import TiltedPinhole
from cyclopean.rigs import PinholeView, Region, fit, pinhole_rig

DEPTHS = (500.0, 1200.0)


def pinholes(rig):
    """Ordinary cameras, with distortion, that look about as a rig does."""
    return pinhole_rig([fit(view, DEPTHS) for view in rig], rig.views)


@pytest.fixture(scope="module")
def rigs():
    """Three rigs with the pinholes that stand for their views."""
    prism = small_setup().rig()
    every = {
        "prism": prism,
        "mirrors": Setup(small_setup().camera, mirrors_beside()).rig(),
        "pinholes": pinholes(prism),
    }
    return {name: (rig, [tilted_pinhole(view, DEPTHS) for view in rig]) for name, rig in every.items()}


def pair_of(rig, cameras, i, j, scale=1.0):
    return rectify((rig[i], rig[j]), (cameras[i], cameras[j]), DEPTHS, scale * rig[i].camera.focal[0])


def seen_points(rig, i, j, count=400):
    """Points (N, 3) between the depths that both views see, and their pixels (N, 2) in each."""
    rng = np.random.default_rng(3)
    pixels = rng.permutation(np.argwhere(rig[i].region.mask)[:, ::-1])[:count].astype(float)
    points = rig[i].rays(pixels).at_depth(rng.uniform(*DEPTHS, len(pixels)))
    others = rig[j].project(points)
    both = rig[j].region.contains(others)
    return points[both], pixels[both], others[both]


NAMES = ["prism", "mirrors", "pinholes"]
# facets of the prism lie below and above each other, those of the mirrors left and right, some of these mirrored
PAIRS = [("prism", 0, 1), ("prism", 1, 2), ("mirrors", 0, 2), ("mirrors", 2, 1), ("pinholes", 2, 0)]


@pytest.mark.parametrize(("name", "i", "j"), PAIRS)
def test_rectified_rows_are_level(rigs, name, i, j):
    rig, cameras = rigs[name]
    for scale in (1.0, 2.0):
        pair = pair_of(rig, cameras, i, j, scale)
        _, pixels, others = seen_points(rig, i, j)
        assert len(pixels) > 20
        left, right = pair.first.places(pixels), pair.second.places(others)
        # each pinhole may be off by its departure; turning may stretch the picture by a half
        bound = 1.5 * scale * (cameras[i].departure_max + cameras[j].departure_max) + 1e-6
        assert bound < 1.5  # else the test says nothing
        assert np.abs(left[:, 1] - right[:, 1]).max() < bound
        disparity = left[:, 0] - right[:, 0]
        assert disparity.min() > 0
        assert disparity.max() < pair.count - 1
        assert pair.count % 16 == 0
        assert (left[:, 0] > pair.count).all()  # room on its left for all disparities


@pytest.mark.parametrize("name", NAMES)
def test_places_and_pixels_are_inverse(rigs, name):
    rig, cameras = rigs[name]
    pair = pair_of(rig, cameras, 0, 1)
    pixels = np.argwhere(rig[0].region.mask)[::7, ::-1]
    places = pair.first.places(pixels)
    np.testing.assert_allclose(pair.first.pixels(places), pixels, atol=1e-6)  # undistorting ends at 1e-12 of a slope
    assert (places >= 0).all()
    assert (places <= np.array(pair.size) - 1).all()  # no pixel of the first view is lost
    rows, columns = np.rint(places[::50, 1]).astype(int), np.rint(places[::50, 0]).astype(int)
    exact = pair.first.pixels(np.stack([columns, rows], -1))
    np.testing.assert_allclose(pair.maps[0][rows, columns], exact, atol=1e-4)  # float32 of some hundreds


@pytest.mark.parametrize("mirrored", [False, True])
def test_the_pinhole_is_that_of_opencv(mirrored):
    rng = np.random.default_rng(1)
    distortion = np.concatenate([rng.normal(0, [0.1, 0.1, 0.01, 0.01, 0.05]), np.zeros(3), rng.normal(0, 0.02, 6)])
    matrix = np.array([[600.0, 0, 320], [0, 610, 240], [0, 0, 1]])
    pose = Pose.from_rotation_vector([0.1, -0.2, 0.3], [1.0, 2.0, 3.0])
    points = rng.uniform([-100, -100, 500], [100, 100, 900], (20, 3))
    camera = TiltedPinhole(matrix, distortion, pose, mirrored, 0.0, 0.0)
    local = (pose @ points) * ([-1, 1, 1] if mirrored else [1, 1, 1])
    theirs = cv2.projectPoints(local, np.zeros(3), np.zeros(3), matrix, distortion)[0][:, 0]
    np.testing.assert_allclose(camera.project(points), theirs, atol=1e-9)  # roundings of some hundreds of px
    rays = camera.rays(theirs)
    off = np.cross(points - rays.origins, rays.directions)
    assert np.abs(off).max() < 1e-4  # mm, at some 700: 1e-4 px


def test_a_pinhole_view_is_fitted_to_nothing(rigs):
    for camera in rigs["pinholes"][1]:
        assert camera.departure_max < 1e-6  # of the same model but for the tilt


def plane_disparity(pair, slope=0.3, depth=800.0):
    """The true disparity (h, w) of the first rectified picture of a plane z = depth + slope x."""
    grid = np.stack(np.meshgrid(*(np.arange(n) for n in pair.size)), -1).astype(float)
    rays = pair.first.view.unbounded().rays(pair.first.pixels(grid))
    normal = np.array([-slope, 0.0, 1.0])
    points = rays.at((depth - rays.origins @ normal) / (rays.directions @ normal))
    return (
        grid[..., 0]
        - pair.second.places(pair.second.view.unbounded().project(points).reshape(-1, 2)).reshape(grid.shape)[..., 0]
    )


@pytest.mark.parametrize(("name", "i", "j"), PAIRS)
def test_disparities_become_the_depth_they_came_from(rigs, name, i, j):
    rig, cameras = rigs[name]
    pair = pair_of(rig, cameras, i, j)
    disparity = plane_disparity(pair)
    pixels = np.argwhere(rig[i].region.mask)[::5, ::-1]
    others = partners(pair, disparity, pixels)
    known = np.isfinite(others).all(-1)
    assert known.sum() > 200
    rays = rig[i].rays(pixels[known])
    normal = np.array([-0.3, 0.0, 1.0])
    truth = rays.at((800.0 - rays.origins @ normal) / (rays.directions @ normal))[:, 2]
    found = exact_depth(pair, pixels[known], others[known])
    # what the pinholes are off moves the partner along its column, across its ray: depth hardly notices
    worth = per_disparity(pair, pixels[known], truth) * truth**2
    loose = 1e-6 + 0.01 * (cameras[i].departure_max + cameras[j].departure_max)
    assert (np.abs(found - truth) < loose * worth).all()
    if name == "pinholes":
        by_pinholes = pinhole_depth(pair, pixels[known], others[known])
        np.testing.assert_allclose(by_pinholes, found, rtol=1e-6)  # the same rays


def test_one_px_of_disparity_is_worth_what_it_says(rigs):
    rig, cameras = rigs["pinholes"]
    pair = pair_of(rig, cameras, 0, 2, 2.0)
    disparity = plane_disparity(pair)
    pixels = np.argwhere(rig[0].region.mask)[::5, ::-1]
    inverse = [1 / exact_depth(pair, pixels, partners(pair, disparity + half, pixels)) for half in (-0.5, 0.5)]
    depth = exact_depth(pair, pixels, partners(pair, disparity, pixels))
    slope = np.abs(inverse[1] - inverse[0])
    known = np.isfinite(slope + depth)
    assert known.sum() > 100
    # inverse depth is linear in disparity along each ray
    np.testing.assert_allclose(per_disparity(pair, pixels, depth)[known], slope[known], rtol=1e-4)


def test_a_pair_one_before_the_other_is_refused():
    camera = Camera((64, 48), 100)
    region = Region(np.ones((48, 64), bool), 0.0)
    rig = Rig(tuple(PinholeView(camera, Pose(np.eye(3), np.array([0.0, 0.0, z])), region) for z in (0.0, -40.0)))
    with pytest.raises(OpticError, match="cannot be rectified"):
        rectify(rig.views, [tilted_pinhole(view, DEPTHS) for view in rig], DEPTHS, 100.0)


def test_a_pair_too_large_to_match_is_refused(rigs):
    rig, cameras = rigs["prism"]
    with pytest.raises(OpticError, match=r"farther near depth.*smaller --scale"):
        pair_of(rig, cameras, 0, 1, 300.0)


def test_rows_that_are_not_level_are_told():
    rig = SETUPS["prism, facets to camera, straight lens"].rig()[:2]
    black = np.zeros(rig.size[::-1], np.uint8)
    for depths, count in (((400.0, 900.0), 0), ((75.0, 900.0), 1)):  # close behind the glass no pinhole fits
        told = []
        reconstruct_by_pairs(black, rig, depths, lambda left, *_: left * np.nan, scale=1, warn=told.append)
        assert len(told) == count
        assert all("not level" in text for text in told)


@pytest.fixture(scope="module")
def plane():
    """A slanted plane photographed through three facets, and its true depth."""
    rig = small_setup().rig()
    return rig, *photograph_plane(rig, 800.0, slope=0.3)


@pytest.mark.parametrize("name", NAMES)
def test_depth_of_a_plane_by_sgbm(name, rigs):
    rig = rigs[name][0]
    photograph, truth = photograph_plane(rig, 800.0, slope=0.3)
    result = reconstruct_by_pairs(photograph, rig, DEPTHS, sgbm(), scale=2)
    error = np.abs(result.depth / truth - 1)
    known = np.isfinite(error)
    assert known[result.view >= 0].mean() > (0.15 if name == "mirrors" else 0.5)  # their views overlap less
    # a pixel is worth some 8 % of depth through this prism, 1 % by these mirrors; OpenCV finds it to 0.1 px or so
    assert np.median(error[known]) < 0.006
    assert np.mean(error[known] > 0.04) < 0.02
    if name != "mirrors":
        assert 0.4 < np.percentile(np.abs(result.depth - truth)[known] / result.sigma[known], 68) < 2.5
    assert (result.confidence[known] > 0).all()


def test_mirrored_views_have_depth(rigs):
    rig = rigs["mirrors"][0]
    photograph, truth = photograph_plane(rig, 700.0)
    result = reconstruct_by_pairs(photograph, rig, DEPTHS, sgbm(), scale=1)
    for k, view in enumerate(rig):
        mine = (result.view == k) & np.isfinite(result.depth)
        assert mine.sum() > 1000
        assert np.median(np.abs(result.depth / truth - 1)[mine]) < 0.004, view.name


@pytest.mark.parametrize("white", [255, 65535, 1.0])
@pytest.mark.parametrize("colour", [False, True])
def test_what_a_matcher_is_given(plane, white, colour):
    rig, photograph, _ = plane
    kind = {255: np.uint8, 65535: np.uint16, 1.0: np.float32}[white]
    picture = (photograph.astype(float) * (white / 255)).astype(kind)
    picture = np.repeat(picture[..., None], 3, axis=-1) if colour else picture
    calls = []

    def matcher(left, right, disparities):
        assert left.shape == right.shape
        assert left.shape[2:] == ((3,) if colour else ())
        assert left.dtype == right.dtype == (np.uint8 if white == 255 else np.uint16)
        assert left.max() > 0.7 * np.iinfo(left.dtype).max
        calls.append((left.copy(), disparities))
        left[:] = right[:] = 0  # they are its own
        return np.full(left.shape[:2], np.nan, np.float32)

    result = reconstruct_by_pairs(picture, rig[:2], DEPTHS, matcher, scale=1)
    assert len(calls) == 2
    assert len(result.points) == 0
    assert all(count % 16 == 0 and count > 0 for _, count in calls)


def test_sixteen_bits_match_as_eight_do(plane):
    rig, photograph, _ = plane
    eight = reconstruct_by_pairs(photograph, rig[:2], DEPTHS, sgbm(), scale=1)
    deep = reconstruct_by_pairs(photograph.astype(np.uint16) * 257, rig[:2], DEPTHS, sgbm(), scale=1)
    both = np.isfinite(eight.depth) & np.isfinite(deep.depth)
    assert both.sum() > 0.98 * np.isfinite(eight.depth).sum()
    # remapping rounds to grey levels in one and hardly in the other: now and then a sixteenth of a px
    assert np.mean(np.abs(eight.depth / deep.depth - 1)[both] < 0.02) > 0.98


@pytest.mark.parametrize(("mode", "grey"), [("3way", True), ("sgbm", True), ("3way", False)])
def test_ways_of_opencv(mode, grey):
    rng = np.random.default_rng(0)
    right = cv2.GaussianBlur(rng.integers(0, 256, (60, 200, 3), dtype=np.uint8), (0, 0), 1.5)
    right = cv2.normalize(right, None, 0, 255, cv2.NORM_MINMAX)
    left = np.roll(right, 9, axis=1)
    found = sgbm(mode=mode, grey=grey)(left, right, 16)
    middle = found[8:-8, 32:-8]
    assert np.isfinite(middle).mean() > 0.95
    assert np.nanmax(np.abs(middle - 9)) <= 1 / 8  # a whole shift, in steps of 1/16


def test_wrong_settings_of_opencv():
    with pytest.raises(SetupError, match="one of sgbm, 3way, hh"):
        sgbm(mode="4way")
    with pytest.raises(SetupError, match="odd"):
        sgbm(block=4)


def test_disparities_outside_the_contract_are_unknown():
    found = as_disparity(np.array([[-1.0, 0.0, 14.9, 15.0, 15.1, np.inf, np.nan, 3.5]]), (1, 8), 16)
    np.testing.assert_array_equal(np.isfinite(found)[0], [False, True, True, True, False, False, False, True])
    assert found.dtype == np.float32


@pytest.mark.parametrize(
    ("found", "words"),
    [
        (np.zeros((8, 6)), r"\(6, 8\).*got \(8, 6\).*transpose"),
        (np.zeros((6, 8, 1)), r"got \(6, 8, 1\)"),
        (np.zeros((6, 8), np.int16), "16 times the disparity"),
        (np.zeros((6, 8), bool), "real numbers.*bool"),
        (None, "NoneType"),
        ([1, [2]], "list"),
        ("text", r"got \(\)"),
    ],
)
def test_wrong_results_are_named(found, words):
    with pytest.raises(ShapeError, match=words):
        as_disparity(found, (6, 8), 16)


def test_partners_that_agree_are_averaged_and_strays_are_left_out():
    sigma = np.full((3, 5), 1e-5)
    sigma[2] = 2e-5
    unknown = np.nan
    inverse = 1e-3 + 1e-5 * np.array([
        [0.0, 0.0, 0.0, unknown, 0.0],
        [1.0, 1.0, 500.0, unknown, 500.0],
        [1.0, 500.0, unknown, 3.0, 1000.0],
    ])  # fmt: skip
    found = merged(inverse, sigma, 1e-6)
    weighted = (1.0 + 0.25) / 2.25, 0.5
    np.testing.assert_allclose(found.inverse[:2], 1e-3 + 1e-5 * np.array(weighted), rtol=1e-12)
    assert np.isnan(found.inverse[[2, 4]]).all()  # two or three that all say something else: nothing is known
    np.testing.assert_allclose([found.inverse[3], found.sigma[3]], [1e-3 + 3e-5, 2e-5], rtol=1e-12)
    np.testing.assert_allclose(found.score, [1, 2 / 3, 0, 1 / 3, 0])


@pytest.mark.parametrize("count", [1, 2, 4])
def test_the_stated_sigma_is_that_of_shared_and_own_noise(count):
    rng = np.random.default_rng(2)
    shared, own = rng.normal(0, 1e-5 / np.sqrt(2), (1, 40_000)), rng.normal(0, 1e-5 / np.sqrt(2), (count, 40_000))
    found = merged(1e-3 + shared + own, np.full((count, 40_000), 1e-5), 1e-6)
    good = np.isfinite(found.inverse)
    assert good.mean() > 0.98
    ratio = np.std(found.inverse[good]) / np.sqrt(np.mean(found.sigma[good] ** 2))
    assert 0.85 < ratio < 1.02  # the scatter of the partners is counted a second time, for strays that agree by chance


def test_faults_of_a_matcher_are_told_with_their_place(plane):
    rig, photograph, _ = plane

    def divides(left, right, disparities):
        return deeper(0)

    def deeper(x):
        return 1 / x

    with pytest.raises(
        SetupError, match=r"divides' failed: ZeroDivisionError: division by zero \(.*line \d+\)"
    ) as caught:
        reconstruct_by_pairs(photograph, rig[:2], DEPTHS, divides)
    assert isinstance(caught.value.__cause__, ZeroDivisionError)
    with pytest.raises(SetupError, match=r"called as matcher\(left, right, disparities\)"):
        reconstruct_by_pairs(photograph, rig[:2], DEPTHS, lambda left, right: left)
    with pytest.raises(ShapeError, match=r"matcher.*must return"):
        reconstruct_by_pairs(photograph, rig[:2], DEPTHS, lambda left, right, count: left[:5, :5])


def test_wrong_calls_are_named(plane):
    rig, photograph, _ = plane
    with pytest.raises(ImageError, match="320x240"):
        reconstruct_by_pairs(photograph.T, rig, DEPTHS, sgbm())
    with pytest.raises(OpticError, match="at least two views"):
        reconstruct_by_pairs(photograph, rig[:1], DEPTHS, sgbm())
    with pytest.raises(SetupError, match="scale"):
        reconstruct_by_pairs(photograph, rig, DEPTHS, sgbm(), scale=0)
    with pytest.raises(SetupError, match="depth range"):
        reconstruct_by_pairs(photograph, rig, (900, 400), sgbm())
