"""Epipolar curves against true correspondences, their bands and distances against samples and slow searches."""

import numpy as np
import pytest
from scipy.optimize import minimize_scalar
from setups import SETUPS

from benchmarks.data import renderer_setup
from cyclopean import Camera, Plate, Prism, Setup
from cyclopean.epipolar import (
    EpipolarCurves,
    distance_to_curves,
    epipolar_curves,
)
from cyclopean.errors import SetupError, ShapeError
from cyclopean.rigs import fit, pinhole_rig

SCENES = ["n2_round", "n3_pose_steps", "n5_bumpy"]
BIPRISM = Setup(Camera((640, 480), 1200), Prism(2, 10, 1.5168, 60))


@pytest.fixture
def rng():
    return np.random.default_rng(5)


def scene_rig(name):
    return renderer_setup(name.rsplit("_", 1)[0]).rig()


# ---- curves


@pytest.mark.parametrize("scene", SCENES)
def test_true_correspondences_lie_on_the_curves_at_their_depth(mitsuba, scene):
    truth = np.load(mitsuba / "scenes" / f"{scene}.npz")
    rig, pixels, points = scene_rig(scene), truth["match_uv"][::4], truth["match_xyz"][::4]
    depths = 0.95 * np.nanmin(points[:, 2]), 1.05 * np.nanmax(points[:, 2])
    for k in range(len(rig)):
        known = np.isfinite(pixels[:, k, 0])
        curves = epipolar_curves(rig, k, pixels[known, k], depths)
        distance, inverse_depth = distance_to_curves(curves, pixels[known])
        others = np.isfinite(pixels[known, :, 0]) & (np.arange(len(rig)) != k)
        assert others.sum() > 200
        assert (np.isfinite(distance) == others).all()  # none is lost, not even beside a border
        # 3e-4 px: the file holds pixels as float32, good to 6e-5 px
        np.testing.assert_allclose(distance[others], 0, atol=3e-4)
        depth = np.broadcast_to(points[known, 2:], others.shape)[others]
        # 0.01 mm: 3e-4 px at the 0.04 px/mm of 8 mm baselines at 1000 mm
        np.testing.assert_allclose(1 / inverse_depth[others], depth, atol=0.015)


def test_corners_of_a_target_lie_on_the_curves(mitsuba):
    corners, rig = np.load(mitsuba / "targets_t3_b40" / "corners.npz"), renderer_setup("t3_b40").rig()
    places = {}
    for view, corner, facet, pixel in zip(*(corners[key] for key in ("view", "corner_id", "facet", "uv")), strict=True):
        places.setdefault((view, corner), np.full((3, 2), np.nan))[facet] = pixel
    pixels = np.array([place for place in places.values() if np.isfinite(place).all()])
    assert len(pixels) > 50
    distance, _ = distance_to_curves(epipolar_curves(rig, 0, pixels[:, 0], (550, 1700)), pixels)
    # 1e-4 px: the curve bends by 0.1 px over 65 samples; between them it is a cubic
    np.testing.assert_allclose(distance[:, 1:], 0, atol=1e-4)


@pytest.mark.parametrize("name", sorted(SETUPS))
def test_a_curve_is_what_the_other_views_see_of_the_ray(name, rng):
    rig = SETUPS[name].rig()
    if len(rig) < 2:
        return
    pixels = rig[0].region.centre + rng.uniform(-8, 8, (2, 3, 2))
    for bounded in (True, False):
        views = rig if bounded else rig.unbounded()
        curves = epipolar_curves(rig, 0, pixels, (200, 800), samples=9, bounded=bounded)
        assert curves.pixels.shape == (2, 3, len(rig), 9, 2)
        assert curves.points.shape == (2, 3, 9, 3)
        assert curves.sigma.shape == (2, 3, len(rig), 9)
        np.testing.assert_allclose(curves.inverse_depths, np.linspace(1 / 800, 1 / 200, 9), rtol=1e-12)
        np.testing.assert_allclose(curves.points[..., 2], np.broadcast_to(curves.depths, (2, 3, 9)), rtol=1e-12)
        assert np.isnan(curves.pixels[:, :, 0]).all()
        for k in range(1, len(rig)):
            np.testing.assert_allclose(curves.pixels[:, :, k], views[k].project(curves.points), atol=1e-9)
        # back along the ray: the points are those of the given pixels
        back = views[0].project(curves.points)
        np.testing.assert_allclose(back - pixels[:, :, None] + 0 * back, 0 * back, atol=1e-8)


@pytest.mark.parametrize("name", ["prism, bent lens", "two mirrors, bent lens", "biprism in water, straight lens"])
def test_the_band_is_the_spread_of_curves_of_noisy_pixels(name, rng):
    setup, noise, draws = SETUPS[name], 0.05, 2000
    rig = setup.rig() if "mirrors" not in name else setup.rig()[::2]
    pixel = rig[0].region.centre
    curves = epipolar_curves(rig, 0, pixel, (250, 600), samples=5, sigma=noise, bounded=False)
    fine = epipolar_curves(rig, 0, pixel + rng.normal(0, noise, (draws, 2)), (200, 800), samples=33, bounded=False)
    for d in range(5):
        distance, _ = distance_to_curves(fine, curves.pixels[:, d])
        spread = np.nanstd(distance[:, 1:], axis=0)
        # 8 %: five standard deviations of a spread of 2000 draws, 1 / sqrt(2 x 2000) = 1.6 %
        np.testing.assert_allclose(spread, curves.sigma[1:, d], rtol=0.08)


def test_the_band_of_many_samples_is_that_of_few():
    rig = SETUPS["prism, bent lens"].rig()
    pixel = rig[0].region.centre
    many, few = (epipolar_curves(rig, 0, pixel, (120, 900), samples, bounded=False).sigma for samples in (129, 9))
    # 1e-4: of many samples the band is computed at 17 and interpolated
    np.testing.assert_allclose(many[1:, ::16], few[1:], rtol=1e-4)
    exact = epipolar_curves(rig, 0, pixel, (120, 900), samples=5, bounded=False).sigma
    np.testing.assert_allclose(few[1:, ::2], exact[1:], rtol=1e-12)
    middle = [1 / np.linspace(1 / 900, 1 / 120, 129)[k] for k in (11, 10, 9)]
    between = epipolar_curves(rig, 0, pixel, (middle[0], middle[2]), samples=3, bounded=False).sigma
    np.testing.assert_allclose(many[1:, 9:12], between[1:], rtol=1e-4)


def test_uncertain_parameters_widen_the_band_as_sampled_setups_do(rng):
    setup = SETUPS["prism, straight lens"]
    names = ("camera.focal_x", "optic.tilt_x", "optic.distance", "optic.facet1_angle")
    scales = np.array([0.5, 2e-4, 0.2, 1e-4])
    mixed = np.eye(4) + 0.3
    covariance = scales[:, None] * mixed * scales
    rig = setup.rig()
    pixel = rig[0].region.centre
    given = {"sigma": 0.0, "bounded": False}
    curves = epipolar_curves(rig, 0, pixel, (250, 600), samples=5, **given, names=names, covariance=covariance)
    distances = []
    for draw in rng.multivariate_normal(np.zeros(4), covariance, 300):
        camera = setup.camera.with_lens(setup.camera.lens + np.eye(9)[0] * draw[0])
        values = setup.optic.parameters(setup.wavelength_nm)
        for name, change in zip(names[1:], draw[1:], strict=True):
            values[setup.optic.parameter_names.index(name.removeprefix("optic."))] += change
        other = Setup(camera, setup.optic.with_parameters(values)).rig()
        moved = epipolar_curves(other, 0, pixel, (200, 800), samples=33, bounded=False)
        distances.append(distance_to_curves(moved, np.moveaxis(curves.pixels, 1, 0), beyond=1e3)[0])
    spread = np.sqrt(np.mean(np.square(distances), axis=0)).T[1:]
    # 20 %: five standard deviations of a spread of 300 draws, 1 / sqrt(2 x 300) = 4 %
    np.testing.assert_allclose(spread, curves.sigma[1:], rtol=0.2)
    # and noise of the pixel adds in quadrature; 1e-9: roundings
    both = epipolar_curves(
        rig, 0, pixel, (250, 600), samples=5, sigma=0.1, bounded=False, names=names, covariance=covariance
    )
    alone = epipolar_curves(rig, 0, pixel, (250, 600), samples=5, sigma=0.1, bounded=False)
    np.testing.assert_allclose(both.sigma[1:], np.hypot(alone.sigma, curves.sigma)[1:], rtol=1e-9)


def test_lost_pixels_have_no_curves():
    rig = BIPRISM.rig()
    inside = rig[0].region.centre
    other = rig[1].region.centre
    curves = epipolar_curves(rig, 0, [inside, other, [np.nan, 1]], (300, 900))
    seen = np.isfinite(curves.pixels[:, 1]).all(-1).any(-1)
    np.testing.assert_array_equal(seen, [True, False, False])
    assert np.isnan(curves.sigma[1:]).all()
    # nothing is seen inside the glass: samples there are NaN, those in front of it are not
    near = epipolar_curves(rig, 0, inside, (30, 900), bounded=False)
    known = np.isfinite(near.pixels[1, :, 0])
    assert known[:2].all()
    assert not known[-1]


def test_wrong_calls_are_explained():
    rig, pixel = BIPRISM.rig(), [100.0, 200.0]
    with pytest.raises(SetupError, match="one view has no epipolar curves"):
        epipolar_curves(Setup(Camera((640, 480), 900), Plate(1.5, 40, 8)).rig(), 0, pixel, (300, 900))
    for view in (2, -1, 0.5, True):
        with pytest.raises(SetupError, match="the views of this rig are 0 to 1"):
            epipolar_curves(rig, view, pixel, (300, 900))
    for depths in ((900, 300), (0, 300), (300, np.inf), (300,), (np.nan, 300)):
        with pytest.raises(SetupError, match="a depth range is"):
            epipolar_curves(rig, 0, pixel, depths)
    with pytest.raises(SetupError, match="pixel noise"):
        epipolar_curves(rig, 0, pixel, (300, 900), sigma=-1)
    with pytest.raises(SetupError, match="3 samples or more"):
        epipolar_curves(rig, 0, pixel, (300, 900), samples=2)
    with pytest.raises(SetupError, match=r"optic\.size is no parameter of this setup; it has camera\.focal_x"):
        epipolar_curves(rig, 0, pixel, (300, 900), names=["optic.size"], covariance=[[1.0]])
    with pytest.raises(SetupError, match="covariance is missing"):
        epipolar_curves(rig, 0, pixel, (300, 900), names=["optic.apex"])
    with pytest.raises(ShapeError, match="2 named parameters"):
        epipolar_curves(rig, 0, pixel, (300, 900), names=["optic.apex", "optic.index"], covariance=[[1.0]])
    pinholes = pinhole_rig([fit(view, (300, 900)) for view in rig], rig)
    with pytest.raises(SetupError, match="other views"):
        epipolar_curves(pinholes, 0, pixel, (300, 900), names=["optic.apex"], covariance=[[1.0]])
    curves = epipolar_curves(rig, 0, pixel, (300, 900))
    with pytest.raises(ShapeError, match=r"\(..., 2, 2\)"):
        distance_to_curves(curves, pixel)
    with pytest.raises(ShapeError, match="do not broadcast"):
        distance_to_curves(epipolar_curves(rig, 0, [pixel, pixel], (300, 900)), np.zeros((3, 2, 2)))


# ---- distances


def circle(radius, samples, ends=(0.5, 2.0)):
    """A curve of which distance and foot are known: an arc around (50, 60), its angle the inverse depth."""
    angles = np.linspace(*ends, samples)
    arc = np.array([50.0, 60.0]) + radius * np.stack([np.cos(angles), np.sin(angles)], -1)
    sigma = np.full((2, samples), 0.1)
    return EpipolarCurves(np.stack([0 * arc + np.nan, arc]), angles, np.zeros((samples, 3)), sigma, 0)


def test_distance_and_foot_of_an_arc(rng):
    curves = circle(300.0, 65)
    angle, radius = rng.uniform(0.5, 2.0, 200), rng.uniform(280, 320, 200)
    pixels = np.array([50.0, 60.0]) + radius[:, None] * np.stack([np.cos(angle), np.sin(angle)], -1)
    distance, place = distance_to_curves(curves, np.stack([pixels, pixels], 1))
    assert np.isnan(distance[:, 0]).all()
    # with y down, growing angles walk clockwise around the centre, which then lies to the right
    # 1e-5 px: a cubic over 1/42 rad misses a circle of 300 px by 300 (1/42)^3 / 100 at the ends, less inside
    np.testing.assert_allclose(distance[:, 1], 300 - radius, atol=5e-5)
    # 1e-4 rad: slopes of parabolas are off by a step squared over six
    np.testing.assert_allclose(place[:, 1], angle, atol=2e-5)


def test_a_curve_ends_a_band_beyond_its_last_sample():
    curves = circle(300.0, 65)
    for angle, inside in ((0.5 - 0.4 / 300, True), (0.5 - 0.7 / 300, False), (2 + 0.4 / 300, True), (2.1, False)):
        pixel = np.array([50.0, 60.0]) + 300 * np.array([np.cos(angle), np.sin(angle)])
        distance, place = distance_to_curves(curves, [pixel, pixel])
        assert np.isfinite(distance[1]) == np.isfinite(place[1]) == inside
        assert np.isfinite(distance_to_curves(curves, [pixel, pixel], beyond=1000.0)[0][1])


def test_a_curve_that_a_border_cuts_goes_on_to_the_border():
    rig = BIPRISM.rig()
    pixel = np.array([450.0, 240.0])  # its partner crosses the seam
    here = 0 if rig[0].region.contains(pixel) else 1
    cut = epipolar_curves(rig, here, pixel, (150, 900), samples=9)
    full = epipolar_curves(rig, here, pixel, (150, 900), samples=2001)
    line, inverse = full.pixels[1 - here], full.inverse_depths
    assert 2 <= np.isfinite(cut.pixels[1 - here, :, 0]).sum() < 9
    pixels = np.full((2001, 2, 2), np.nan)
    pixels[:, 1 - here] = line
    distance, place = distance_to_curves(cut, pixels)
    seen = np.isfinite(line[:, 0])
    assert np.isfinite(distance[seen, 1 - here]).all()
    # 0.01 px, 0.1 %: eight steps over such a range are coarse
    np.testing.assert_allclose(distance[seen, 1 - here], 0, atol=0.01)
    np.testing.assert_allclose(place[seen, 1 - here], inverse[seen], rtol=1e-3)


def test_feet_are_those_of_a_slow_search(rng):
    rig = SETUPS["prism, bent lens"].rig()
    pixel = rig[0].region.centre
    curves = epipolar_curves(rig, 0, pixel, (150, 900), bounded=False)
    view = rig[1].unbounded()
    ray = rig[0].rays(pixel)
    for w in rng.uniform(1 / 800, 1 / 160, 12):
        target = view.project(ray.at_depth(1 / w)) + rng.normal(0, 2, 2)
        found = minimize_scalar(
            lambda x, target=target: np.sum((view.project(ray.at_depth(1 / x)) - target) ** 2),
            bounds=(1 / 900, 1 / 150), method="bounded", options={"xatol": 1e-12},
        )  # fmt: skip
        distance, place = distance_to_curves(curves, np.full((len(rig), 2), target))
        # 1e-4 px: the search stops at its square root of roundings; the cubic is that good too
        assert abs(distance[1]) == pytest.approx(np.sqrt(found.fun), abs=1e-4)
        assert place[1] == pytest.approx(found.x, rel=1e-4)


def test_all_pairs_by_broadcasting(rng):
    rig = BIPRISM.rig()
    curves = epipolar_curves(rig, 0, rig[0].region.centre + rng.uniform(-40, 40, (3, 2)), (300, 900), bounded=False)
    pixels = rig[1].region.centre + rng.uniform(-40, 40, (4, 2, 2))
    one = EpipolarCurves(*(getattr(curves, name) for name in ("pixels", "inverse_depths", "points", "sigma", "view")))
    rows = EpipolarCurves(one.pixels[:, None], one.inverse_depths, one.points[:, None], one.sigma[:, None], one.view)
    distance, place = distance_to_curves(rows, pixels, beyond=1e4)
    assert distance.shape == place.shape == (3, 4, 2)
    for i in range(3):
        for j in range(4):
            single = EpipolarCurves(one.pixels[i], one.inverse_depths, one.points[i], one.sigma[i], one.view)
            np.testing.assert_array_equal(distance_to_curves(single, pixels[j], beyond=1e4)[0], distance[i, j])
    every, place = distance_to_curves(rows, pixels, beyond=1e4)
    near, where = distance_to_curves(rows, pixels, beyond=1e4, within=15.0)
    wanted = np.abs(every) <= 15
    assert 0 < wanted.sum() < np.isfinite(every).sum()
    np.testing.assert_array_equal(near, np.where(wanted, every, np.nan))
    np.testing.assert_array_equal(where, np.where(wanted, place, np.nan))
    empty, _ = distance_to_curves(epipolar_curves(rig, 0, np.zeros((0, 2)), (300, 900)), np.zeros((0, 2, 2)))
    assert empty.shape == (0, 2)
