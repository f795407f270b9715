"""Points given in one sub-image and found in the others: against planes of known depth, rendered truth, slow twins."""

import json
from dataclasses import replace

import cv2
import numpy as np
import pytest
from scenes import photograph_plane, small_setup
from scipy.ndimage import map_coordinates, spline_filter

from benchmarks.data import renderer_setup
from cyclopean import Camera, Mirror, Mirrors, Plate, Setup
from cyclopean.correspondence.window_search import node_shapes, peaks, prepare, window_at
from cyclopean.correspondence.windows import Limits, locate
from cyclopean.correspondence.windows_kernels import correlate, sample
from cyclopean.errors import ImageError, OpticError, SetupError, ShapeError
from cyclopean.rigs import fit, pinhole_rig

DEPTHS = (550.0, 1100.0)
TWO_MIRRORS = Setup(
    Camera((320, 240), 420),
    Mirrors((Mirror((70, 0, 300), (-1.0, 0, -0.3), (260, 300)),), ((0,),), direct=True),
)


def truth_of(rig, view, pixels, depth, slope=0.0):
    """Points (N, 3) of the plane z = depth + slope x that pixels of a view see, and their pixels (N, V, 2)."""
    rays = rig[view].rays(pixels)
    normal = np.array([-slope, 0.0, 1.0])
    points = rays.at((depth - rays.origins @ normal) / (rays.directions @ normal))
    return points, rig.project(points)


def well_inside(rig, view, depth, count, seed=0, margin=9):
    """Pixels of a view whose windows other views show."""
    rng = np.random.default_rng(seed)
    x, y, width, height = rig[view].region.box
    pixels = rng.uniform([x, y], [x + width, y + height], (4000, 2))
    corners = pixels[:, None] + margin * np.array([[0, 0], [-1, -1], [1, -1], [-1, 1], [1, 1]])
    own = rig[view].region.contains(corners).all(1)
    points = rig[view].unbounded().rays(corners).at_depth(depth)
    others = [rig[k].region.contains(rig[k].project(points)).all(1) for k in range(len(rig)) if k != view]
    good = np.flatnonzero(own & np.any(others, axis=0))
    assert len(good) >= count
    return pixels[good[:count]]


@pytest.fixture(scope="module")
def plane():
    """A three-facet rig, its photograph of a slanted plane, and the same made ready."""
    rig = small_setup().rig()
    photograph, _ = photograph_plane(rig, 800.0, 0.3, pitch=2.0)
    return rig, photograph, prepare(photograph, rig)


def test_a_slanted_plane_is_found_in_every_sub_image(plane):
    rig, _, picture = plane
    for view in range(3):
        pixels = well_inside(rig, view, 800.0, 8)
        points, seen = truth_of(rig, view, pixels, 800.0, 0.3)
        found = locate(picture, rig, view, pixels, DEPTHS)
        assert found.found.all(), found.reason
        away = np.linalg.norm(found.pixels - seen, axis=-1)
        assert np.nanmax(away) < 0.06  # px: 8-bit rounding and the pixel's width; a tenth of what misses would be
        assert np.all(found.strength[:, view] > 0.98)
        np.testing.assert_array_equal(found.pixels[:, view], pixels)
        # the point stands on the given pixel's ray
        np.testing.assert_allclose(rig[view].project(found.points), pixels, atol=1e-6)
        sigma = np.sqrt(found.covariance[:, 2, 2])
        assert np.all(np.abs(found.points[:, 2] - points[:, 2]) < 5 * sigma)


def test_gain_offset_and_colour_do_not_matter(plane):
    rig, photograph, picture = plane
    pixels = well_inside(rig, 0, 800.0, 4)
    dim = photograph.astype(float)
    dim[rig.facets == 1] = 20 + 0.5 * dim[rig.facets == 1]
    dim[rig.facets == 2] = 0.7 * dim[rig.facets == 2] + 3
    colour = np.stack([dim, 0.6 * dim, 250 - dim], -1)
    plain = locate(picture, rig, 0, pixels, DEPTHS)
    for other in (dim.astype(np.float32), colour.astype(np.float32), (colour * 200).astype(np.uint16)):
        found = locate(other, rig, 0, pixels, DEPTHS)
        assert found.found.all()
        np.testing.assert_allclose(
            found.pixels, plain.pixels, atol=0.02
        )  # px: only the rounding of the picture differs


@pytest.mark.parametrize("case", ["mirror", "pinholes", "facets to the camera", "two facets"])
def test_other_optics_and_virtual_cameras(case):
    setups = {
        "mirror": TWO_MIRRORS,
        "pinholes": small_setup(),
        "facets to the camera": small_setup(facing="camera", tilt_deg=(2, -1, 5)),
        "two facets": small_setup(facets=2, azimuth_deg=0.0),
    }
    rig = setups[case].rig()
    photograph, _ = photograph_plane(rig, 800.0, pitch=2.0)
    if case == "pinholes":
        rig = pinhole_rig([fit(view, (700.0, 900.0)) for view in rig], rig.views)
    pixels = well_inside(rig, 1, 800.0, 6)
    points, seen = truth_of(rig, 1, pixels, 800.0)
    found = locate(photograph, rig, 1, pixels, DEPTHS)
    assert found.found.all(), found.reason
    # px: exact rays to the rounding of the picture; a fitted pinhole is some 0.05 px off by itself
    assert np.nanmax(np.linalg.norm(found.pixels - seen, axis=-1)) < (0.25 if case == "pinholes" else 0.06)
    assert any(view.mirrored for view in rig) == (case == "mirror")
    np.testing.assert_allclose(found.points[:, 2], points[:, 2], rtol=0.02)


def test_stated_sigma_is_the_scatter_under_noise(plane):
    rig, photograph, _ = plane
    rng = np.random.default_rng(3)
    pixels = well_inside(rig, 0, 800.0, 6)
    depths, sigmas = [], []
    for _ in range(24):
        noisy = np.clip((photograph + rng.normal(0, 3, photograph.shape)).round(), 0, 255).astype(np.uint8)
        found = locate(noisy, rig, 0, pixels, DEPTHS)
        assert found.found.all()
        depths.append(found.points[:, 2])
        sigmas.append(np.sqrt(found.covariance[:, 2, 2]))
    scatter = np.std(depths, axis=0, ddof=1)
    # 24 draws of 6 points: the pooled ratio is known to 6 %; stated sigmas are estimated from some 25 blocks each
    ratio = np.sqrt(np.mean((scatter / np.mean(sigmas, axis=0)) ** 2))
    assert 0.7 < ratio < 1.35


def test_pointing_moves_a_point_along_its_surface(plane):
    rig, _, picture = plane
    pixels = well_inside(rig, 0, 800.0, 8, margin=15)
    rng = np.random.default_rng(8)
    away = rng.normal(0, 0.5, (4000, 1, 2))
    pointed = truth_of(rig, 0, pixels + away, 800.0, 0.3)[0]
    wanted = np.mean([np.cov(pointed[:, k].T) for k in range(len(pixels))], axis=0)
    exact, given = (
        locate(picture, rig, 0, pixels, DEPTHS, window=41, pointing=p).covariance.mean(0) for p in (0.0, 0.5)
    )
    # 4000 draws tell a variance to 2.2 %; the slope of a surface is fitted to some 10 % in so small sub-images
    scale = np.sqrt(np.outer(np.diag(wanted), np.diag(wanted)))
    np.testing.assert_allclose((given - exact) / scale, wanted / scale, atol=0.15)


@pytest.mark.parametrize("noise", [3.0, 8.0])
def test_stated_sigma_holds_for_single_points_in_noisy_pictures(plane, noise):
    rig, photograph, _ = plane
    rng = np.random.default_rng(6)
    pixels = well_inside(rig, 0, 800.0, 30)
    points, _ = truth_of(rig, 0, pixels, 800.0, 0.3)
    over = []
    for _ in range(5):
        noisy = np.clip((photograph + rng.normal(0, noise, photograph.shape)).round(), 0, 255).astype(np.uint8)
        found = locate(noisy, rig, 0, pixels, DEPTHS)
        over.append(np.abs(found.points[:, 2] - points[:, 2]) / np.sqrt(found.covariance[:, 2, 2]))
    over = np.concatenate(over)
    assert np.isfinite(over).mean() > 0.8
    # a normal distribution has 1 and 2 there; 150 points that share windows tell the percentiles to 10 to 15 %
    one, two = np.nanpercentile(over, [68.27, 95.45])
    assert 0.7 < one < 1.3
    assert two < 2.6


def test_smoothing_brings_nothing_over_a_seam(plane):
    rig, photograph, picture = plane
    rows, columns = np.nonzero(rig.facets == 0)
    places = np.stack([columns, rows], -1).astype(float)
    changed = prepare(np.where(rig.facets == 0, photograph, 7).astype(np.uint8), rig)
    values, slopes = np.empty((2, len(places), 1)), np.empty((len(places), 1, 2))
    for made, into in zip((picture, changed), values, strict=True):
        sample(made.spline, picture.masks[0], places, into, slopes)
    assert np.isfinite(values).all(-1).sum() > 10000
    np.testing.assert_allclose(values[0], values[1], atol=1e-3)  # grey levels: the spline's float32


def test_what_cannot_be_trusted_is_refused_with_a_reason(plane):
    rig, photograph, picture = plane
    good = well_inside(rig, 0, 800.0, 1)
    x, y = np.rint(good[0]).astype(int)
    blank, white = photograph.copy(), photograph.copy()
    blank[y - 14 : y + 15, x - 14 : x + 15] = 120
    white[y - 6 : y + 7, x - 6 : x + 7] = 255
    assert "no texture" in locate(blank, rig, 0, good, DEPTHS).reason[0]
    assert "saturated" in locate(white, rig, 0, good, DEPTHS).reason[0]
    assert "not a number" in locate(picture, rig, 0, [[np.nan, 3.0]], DEPTHS).reason[0]
    assert "in sub-image 1, not in" in locate(picture, rig, 0, well_inside(rig, 1, 800.0, 1), DEPTHS).reason[0]
    assert "in no sub-image" in locate(picture, rig, 0, [[-50.0, 3.0]], DEPTHS).reason[0]
    far = locate(picture, rig, 0, good, (1500.0, 3000.0))  # the truth is not among the depths searched
    assert far.reason[0]
    for refused in (locate(blank, rig, 0, good, DEPTHS), far):
        assert np.isnan(refused.points).all()
        assert np.isnan(refused.covariance).all()
        assert np.isnan(refused.pixels[0, 1:]).all()
        assert not refused.found[0]


def test_unrelated_sub_images_are_refused(plane):
    rig, photograph, _ = plane
    noise = np.random.default_rng(4).integers(20, 230, photograph.shape).astype(np.uint8)
    wrong = np.where(rig.facets == 0, photograph, cv2.GaussianBlur(noise, (0, 0), 1.5) * 3 // 2 - 60).astype(np.uint8)
    found = locate(wrong, rig, 0, well_inside(rig, 0, 800.0, 20), DEPTHS)
    assert not found.found.any()
    assert np.isnan(found.points).all()


def test_repeated_texture_is_ambiguous():
    rig = small_setup(facets=2, azimuth_deg=0.0).rig()
    photograph = np.zeros((240, 320))
    for view in rig:
        rows, columns = np.nonzero(view.region.traced)
        points = view.rays(np.stack([columns, rows], -1)).at_depth(800.0)
        photograph[rows, columns] = 128 + 60 * np.sin(points[:, 0] / 1.3) * np.sin(points[:, 1] / 1.3)
    found = locate(photograph.astype(np.uint8), rig, 0, well_inside(rig, 0, 800.0, 5), (400.0, 3000.0))
    assert not found.found.any()
    assert all("ambiguous" in reason or "way back" in reason for reason in found.reason)
    assert np.all(found.ambiguity[:, 0] > 0.9)


def test_a_setup_that_is_not_the_photographs_is_noticed(plane):
    rig, photograph, _ = plane
    wrong = small_setup(tilt_deg=(0, 0, 2.5)).rig()
    pixels = well_inside(rig, 0, 800.0, 10)
    right, found = (locate(photograph, r, 0, pixels, DEPTHS) for r in (rig, wrong))
    assert right.found.all()
    assert right.residual.max() < 0.05
    # refused, or said to lie beside its curve by far more than in the right setup
    assert (~found.found | (found.residual > 0.2)).all()


def test_colours_that_the_glass_bends_differently_are_noticed():
    rigs = [small_setup(glass=index).rig() for index in (1.509, 1.5168, 1.527)]
    photograph = np.stack([photograph_plane(rig, 800.0, pitch=2.0)[0] for rig in rigs], -1)
    rig = rigs[1]
    pixels = well_inside(rig, 0, 800.0, 8)
    white = locate(photograph, rig, 0, pixels, DEPTHS, limits=Limits(strength=0.5, sigma=2.0, weaker=1.0, middle=5.0))
    green = locate(photograph[..., 1], rig, 0, pixels, DEPTHS)
    assert green.found.all()
    assert not white.found.any()
    assert all("one channel" in reason for reason in white.reason if "colour" in reason)
    assert sum("colours lie" in reason for reason in white.reason) >= 4


@pytest.mark.parametrize(
    ("change", "error", "says"),
    [
        ({"view": 3}, ShapeError, "views 0 to 2"),
        ({"view": -1}, ShapeError, "no view -1"),
        ({"pixels": [[1.0, 2.0, 3.0]]}, ShapeError, "pixels must have shape"),
        ({"depths": (900.0, 500.0)}, SetupError, "near < far"),
        ({"window": 20}, ShapeError, "odd number"),
        ({"pointing": -1.0}, ShapeError, "standard deviation"),
        ({"photograph": np.zeros((10, 10), np.uint8)}, ImageError, "320x240"),
    ],
)
def test_a_wrong_call_says_what_was_wanted(plane, change, error, says):
    rig, photograph, _ = plane
    given = {"photograph": photograph, "rig": rig, "view": 0, "pixels": [[10.0, 20.0]], "depths": DEPTHS} | change
    with pytest.raises(error, match=says):
        locate(**given)


def test_one_view_is_not_enough():
    rig = Setup(Camera((64, 48), 100), Plate(1.5, 40, 15)).rig()
    with pytest.raises(OpticError, match="two views"):
        locate(np.zeros((48, 64), np.uint8), rig, 0, [[3.0, 3.0]], (100.0, 200.0))


def test_no_points_give_no_rows(plane):
    rig, _, picture = plane
    found = locate(picture, rig, 0, np.zeros((0, 2)), DEPTHS)
    assert found.pixels.shape == (0, 3, 2)
    assert found.covariance.shape == (0, 3, 3)
    assert found.reason.shape == (0,)


@pytest.mark.parametrize("name", ["n2_bumpy", "n5_bumpy"])
def test_rendered_truth(mitsuba, name):
    stem = mitsuba / "scenes" / name
    rig = renderer_setup(json.loads(stem.with_suffix(".json").read_text())["rig"]).rig()
    picture = prepare(cv2.cvtColor(cv2.imread(str(stem.with_suffix(".png"))), cv2.COLOR_BGR2RGB), rig)
    truth = np.load(stem.with_suffix(".npz"))
    pixels, home = truth["match_uv"].astype(float), truth["match_from"].astype(int)
    shown = np.isfinite(pixels[..., 0]).sum(1) >= 2
    inside = np.array([rig[k].region.contains(p[k]) for k, p in zip(home, pixels, strict=True)])
    rows = np.random.default_rng(11).permutation(np.flatnonzero(shown & inside))[:25]
    found = [locate(picture, rig, int(home[i]), pixels[i, home[i]], (600.0, 1600.0)) for i in rows]
    accepted = np.array([f.found[0] for f in found])
    assert accepted.mean() >= 0.9  # the benchmark finds 98 % and more
    away = np.array([np.linalg.norm(f.pixels[0] - pixels[i], axis=-1) for f, i in zip(found, rows, strict=True)])
    assert np.nanmedian(np.where(away > 0, away, np.nan)[accepted]) < 0.015  # px; the benchmark measures 0.005
    assert np.nanmax(away[accepted]) < 1.0  # no false match


def test_sampling_agrees_with_scipy():
    rng = np.random.default_rng(1)
    picture = rng.uniform(0, 255, (30, 40, 2))
    spline = np.stack([spline_filter(picture[..., c], order=3, output=np.float32) for c in range(2)], -1)
    places = rng.uniform([2, 2], [36, 26], (50, 2))
    places[7] = [5, 9]
    values, slopes = np.empty((50, 2)), np.empty((50, 2, 2))
    sample(spline, np.ones((30, 40), bool), places, values, slopes)
    for c in range(2):
        wanted = map_coordinates(spline[..., c].astype(float), places[:, ::-1].T, order=3, prefilter=False)
        np.testing.assert_allclose(values[:, c], wanted, atol=1e-9)
    np.testing.assert_allclose(values[7], picture[9, 5], atol=1e-3)  # float32 coefficients
    ends = np.empty((4, 50, 2))
    for k, move in enumerate(1e-4 * np.array([[1, 0], [-1, 0], [0, 1], [0, -1]])):
        sample(spline, np.ones((30, 40), bool), places + move, ends[k], np.empty_like(slopes))
    numeric = np.stack([ends[0] - ends[1], ends[2] - ends[3]], -1) / 2e-4
    np.testing.assert_allclose(slopes, numeric, atol=1e-3)  # the derivative's own truncation
    sample(spline, np.zeros((30, 40), bool), places, values, slopes)
    assert np.isnan(values).all()


def test_correlation_agrees_with_a_slow_twin(plane):
    rig, _, picture = plane
    (pixel,) = well_inside(rig, 0, 800.0, 1)
    window = window_at(picture, rig, 0, pixel, 9)
    nodes = window.places(1 / np.array([700.0, 800.0, 900.0, 1e5]))
    nodes[0, 1, 4] = np.nan
    scores = np.empty((4, 2))
    usable = picture.usable[1:]
    correlate(picture.spline, usable, nodes, window.shapes, window.values, window.weights, 0.6, scores)
    slow = np.full((4, 2), np.nan)
    for d, v in np.ndindex(4, 2):
        places = window.shapes @ nodes[d, v]
        if np.isnan(places).any():
            continue
        seen = np.array([usable[v][int(y + 0.5), int(x + 0.5)] if 1 <= x < 318 and 1 <= y < 238 else False
                         for x, y in places])  # fmt: skip
        weights = window.weights * seen
        if weights.sum() < 0.6 * window.weights.sum():
            continue
        look = map_coordinates(picture.spline[..., 0].astype(float), places[:, ::-1].T, order=3, prefilter=False)
        covariance = np.cov(window.values[:, 0], look, aweights=weights)
        slow[d, v] = covariance[0, 1] / np.sqrt(covariance[0, 0] * covariance[1, 1])
    assert np.isnan(slow[0, 1])
    assert np.isfinite(slow).any()
    np.testing.assert_allclose(scores, slow, atol=1e-9)


def test_node_shapes_carry_any_quadratic_warp():
    rng = np.random.default_rng(2)
    factors = rng.normal(size=(3, 3))

    def warp(x, y):
        return np.einsum("ij,i...,j...->...", factors, np.stack([x**0, x, x**2]), np.stack([y**0, y, y**2]))

    offsets = rng.uniform(-1, 1, (20, 2))
    nodes = warp(*np.array([(x, y) for y in (-1.0, 0.0, 1.0) for x in (-1.0, 0.0, 1.0)]).T)
    np.testing.assert_allclose(node_shapes(offsets) @ nodes, warp(*offsets.T), atol=1e-12)


def test_peaks_are_parted_by_valleys_and_not_by_ripples():
    x = np.arange(200.0)
    scores = np.exp(-(((x - 60) / 10) ** 2)) + 0.8 * np.exp(-(((x - 140) / 10) ** 2)) + 0.005 * np.sin(2 * x)
    found = peaks(scores, 2)
    assert abs(found[0] - 60) <= 2
    assert abs(found[1] - 140) <= 2
    scores[100:] = np.nan
    assert abs(peaks(scores, 1)[0] - 60) <= 2
    assert peaks(np.full(5, np.nan), 3) == []


def test_limits_decide(plane):
    rig, _, picture = plane
    pixels = well_inside(rig, 0, 800.0, 3)
    strict = locate(picture, rig, 0, pixels, DEPTHS, limits=replace(Limits(), strength=1.01))
    assert not strict.found.any()
    assert all("poor correlation" in reason for reason in strict.reason)
    assert np.isfinite(strict.strength).any()  # what was found is still said
