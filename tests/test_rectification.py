"""Sweeps through depth against direct projection."""

from functools import cache

import numpy as np
import pytest
from setups import SETUPS, STRAIGHT, mirrors_beside
from shifted_views import slow_places

from benchmarks.data import renderer_setup
from cyclopean import Mirror, Mirrors, Plate, Prism, Setup
from cyclopean.errors import SetupError, ShapeError
from cyclopean.matching import plan
from cyclopean.rectification import at_inverse_depths, inverse_depths, sweep
from cyclopean.rigs import fit, pinhole_rig

DEPTHS = (200.0, 600.0)
RIGS = ["prism, straight lens", "prism, facets to camera, bent lens", "two mirrors, bent lens"]


@pytest.fixture
def rng():
    return np.random.default_rng(5)


@cache
def rig_of(name):
    """Rigs of `SETUPS`, prisms by facets and facing, two mirrored views beside a direct one, and pinholes."""
    if name in SETUPS:
        return SETUPS[name].rig()
    if name == "mirrors beside a direct view":
        return Setup(STRAIGHT, mirrors_beside()).rig()
    if name == "pinholes":
        rig = rig_of(RIGS[1])
        return pinhole_rig([fit(view, DEPTHS) for view in rig], rig.views)
    facets, facing = name.split()
    return Setup(STRAIGHT, Prism(int(facets), 8, 1.5168, 60, facing=facing)).rig()


EVERY = [*RIGS, "2 scene", "2 camera", "4 scene", "5 camera", "mirrors beside a direct view", "pinholes"]


def own_pixels(view, count, rng):
    """Pixels (count, 2) of the view, margins taken off."""
    rows, columns = np.nonzero(view.region.mask)
    chosen = rng.integers(0, len(rows), count)
    return np.stack([columns, rows], -1)[chosen].astype(float)


def test_points_at_inverse_depths_lie_on_their_rays_at_those_depths(rng):
    view = rig_of(RIGS[0])[0]
    rays = view.rays(own_pixels(view, 6, rng).reshape(3, 2, 2))
    points = at_inverse_depths(rays, [1 / 500, 1 / 300, 1 / 10])
    assert points.shape == (3, 3, 2, 3)
    np.testing.assert_allclose(points[0], rays.at_depth(500))
    np.testing.assert_allclose(points[1, ..., 2], 300)
    assert np.isnan(points[2]).all()  # behind the glass


@pytest.mark.parametrize("name", RIGS)
@pytest.mark.parametrize("step", [0.5, 2.0])
def test_one_step_moves_no_picture_further_than_asked(name, step, rng):
    rig = rig_of(name)
    inverse = inverse_depths(rig, DEPTHS, step)
    # roundings
    np.testing.assert_allclose([1 / inverse[-1], 1 / inverse[0]], DEPTHS, rtol=1e-12)
    np.testing.assert_allclose(np.diff(inverse), inverse[1] - inverse[0], rtol=1e-9)
    assert inverse[1] > inverse[0]
    fastest = 0.0
    for reference in rig:
        points = at_inverse_depths(reference.rays(own_pixels(reference, 300, rng)), inverse)
        for other in rig:
            if other is not reference:
                move = np.linalg.norm(np.diff(other.project(points), axis=0), axis=-1)
                fastest = np.nanmax(move, initial=fastest)
    assert 0.6 * step < fastest <= step  # and no more steps than needed


@pytest.mark.parametrize("depths", [(600, 200), (0, 200), (200, np.inf), (np.nan, 200)])
def test_depths_that_cannot_be_are_named(depths):
    with pytest.raises(SetupError, match="0 < near < far in mm, got"):
        inverse_depths(rig_of(RIGS[0]), depths)


def test_views_that_share_nothing_cannot_be_swept():
    one = Plate(1.5, 50, 10)
    apart = Mirrors((Mirror((-9, 0, 60), (-1, 0, -1), (18, 60)), Mirror((9, 0, 60), (1, 0, -1), (18, 60))))
    for optic in (one, apart):
        with pytest.raises(SetupError, match="nothing moves between the depths 200 and 600 mm"):
            inverse_depths(Setup(STRAIGHT, optic).rig(), DEPTHS)


def followed(warps, pixels, inverse):
    """Where maps put pixels (N, 2) of the photograph at inverse depths (N,): (V-1, N, 2) px, of the first channel."""
    x, y = (pixels - warps.origin).T
    return slow_places(warps, x, y, (inverse - warps.inverse_depths[0]) / warps.step)[:, 0]


@pytest.mark.parametrize("name", EVERY)
def test_maps_are_where_the_other_views_see_the_points(name, rng):
    rig = rig_of(name)
    hypotheses = inverse_depths(rig, DEPTHS, 2.0)
    compared = 0
    for reference in range(min(len(rig), 3)):
        warps = sweep(rig, reference, hypotheses)
        others = [k for k in range(len(rig)) if k != reference]
        x, y, width, height = rig[reference].region.box
        assert (warps.origin, warps.size) == ((x, y), (width, height))
        np.testing.assert_array_equal(warps.masks, rig.masks[[reference, *others]])
        pixels, inverse = own_pixels(rig[reference], 1500, rng), rng.uniform(hypotheses[0], hypotheses[-1], 1500)
        rays, found = rig[reference].rays(pixels), followed(warps, pixels, inverse)
        points = rays.at_depth(1 / inverse)
        for k, other in enumerate(others):
            direct = rig[other].project(points)
            seen = rig[other].region.contains(direct)
            away = np.linalg.norm(found[k] - direct, axis=-1)[seen]
            # cells next to where a mirror's view folds have no map
            assert np.isfinite(away).mean() > 0.95 if len(away) > 50 else True
            assert np.nanmax(away, initial=0) < 0.011  # the tolerance is checked in the middles of cells
            compared += len(away)
    assert compared > 500


@pytest.mark.parametrize("name", ["n3", "n3_pose", "n2_flip", "t4_b45"])
def test_maps_of_the_rendered_setups_are_good_to_a_hundredth_of_a_pixel(name, mitsuba, rng):
    rig = renderer_setup(name).rig()
    hypotheses = np.linspace(1 / 1500, 1 / 500, 40)
    warps = sweep(rig, 0, hypotheses)
    pixels, inverse = own_pixels(rig[0], 2000, rng), rng.uniform(hypotheses[0], hypotheses[-1], 2000)
    points = rig[0].rays(pixels).at_depth(1 / inverse)
    found = followed(warps, pixels, inverse)
    for k in range(1, len(rig)):
        away = np.linalg.norm(found[k - 1] - rig[k].project(points), axis=-1)
        assert np.isfinite(away).mean() > 0.1
        assert np.nanmax(away) < 0.011


def test_errors_of_maps_have_no_side(rng):
    # lines between exact nodes would cut every bend on its inner side, and all depths would err alike
    rig = Setup(STRAIGHT, Prism(2, 16, 1.5, 60, azimuth_deg=0)).rig()
    hypotheses = inverse_depths(rig, DEPTHS, 2.0)
    for reference in (0, 1):
        warps = sweep(rig, reference, hypotheses)
        pixels, inverse = own_pixels(rig[reference], 4000, rng), rng.uniform(hypotheses[0], hypotheses[-1], 4000)
        direct = rig[1 - reference].project(rig[reference].rays(pixels).at_depth(1 / inverse))
        errors = (followed(warps, pixels, inverse)[0] - direct)[np.isfinite(direct).all(-1), 0]
        assert len(errors) > 500
        # the mean of 500 is uncertain by 0.04 of their scatter; that of lines between exact nodes is 0.9 of it
        assert abs(errors.mean()) < 0.15 * np.sqrt(np.mean(errors**2))


def test_a_coarser_tolerance_takes_a_coarser_lattice():
    rig = rig_of(RIGS[0])
    hypotheses = inverse_depths(rig, DEPTHS, 2.0)
    sizes = [sweep(rig, 0, hypotheses, tolerance).coefficients.size for tolerance in (0.5, 0.01, 0.002)]
    assert sizes == sorted(sizes)
    assert sizes[0] < sizes[-1]


def test_a_tolerance_that_cannot_be_met_is_named():
    rig = rig_of(RIGS[0])
    with pytest.raises(SetupError, match=r"miss by up to .* px between points 2 px apart, more than 1e-06 px"):
        sweep(rig, 0, inverse_depths(rig, DEPTHS, 2.0), tolerance=1e-6)


def test_depths_behind_the_glass_are_left_out():
    rig = rig_of(RIGS[0])
    hypotheses = np.linspace(1 / 500, 1 / 50, 40)
    warps = sweep(rig, 0, hypotheses)  # the glass ends at 82 mm
    pixels = own_pixels(rig[0], 300, np.random.default_rng(3))
    inverse = np.full(300, 1 / 300)
    direct = rig[1].unbounded().project(rig[0].rays(pixels).at_depth(300))
    away = np.linalg.norm(followed(warps, pixels, inverse)[0] - direct, axis=-1)
    near = rig[1].region.contains(direct)
    assert np.nanmax(away[near]) < 0.011
    assert np.isfinite(away).mean() > 0.9


def test_channels_that_are_alike_have_equal_maps():
    rig = rig_of(RIGS[0])
    hypotheses = inverse_depths(rig, DEPTHS, 2.0)
    one, three = sweep(rig, 1, hypotheses), sweep((rig, rig, rig), 1, hypotheses)
    assert three.coefficients.shape[1] == 3
    for c in range(3):
        np.testing.assert_array_equal(three.coefficients[:, c], one.coefficients[:, 0])


def test_two_depths_are_too_few():
    with pytest.raises(ShapeError, match="at least 3 inverse depths, got 2"):
        sweep(rig_of(RIGS[0]), 0, [1 / 500, 1 / 400])


def test_mirrored_maps_can_be_planned():
    rig = rig_of("mirrors beside a direct view")
    hypotheses = inverse_depths(rig, DEPTHS, 4.0)
    ready = plan([sweep(rig, k, hypotheses) for k in range(len(rig))])
    # what one mirror shows lies behind the other, but the direct view sees it
    assert all(reference.masks[2].mean() > 0.2 for reference in ready.references)
    assert all(np.isfinite(reference.lines[1]).all() for reference in ready.references)
