"""Sweeps through depth against direct projection."""

import numpy as np
import pytest
from setups import SETUPS, STRAIGHT

from benchmarks.data import renderer_setup
from cyclopean import Mirror, Mirrors, Plate, Prism, Setup
from cyclopean.errors import SetupError, ShapeError
from cyclopean.rectification import at_inverse_depths, interpolation_error, inverse_depths, sweep

DEPTHS = (200.0, 600.0)
RIGS = ["prism, straight lens", "prism, facets to camera, bent lens", "two mirrors, bent lens"]


@pytest.fixture
def rng():
    return np.random.default_rng(5)


def own_pixels(view, count, rng):
    """Pixels (count, 2) of the view, margins taken off."""
    rows, columns = np.nonzero(view.region.mask)
    chosen = rng.integers(0, len(rows), count)
    return np.stack([columns, rows], -1)[chosen].astype(float)


def test_points_at_inverse_depths_lie_on_their_rays_at_those_depths(rng):
    view = SETUPS[RIGS[0]].rig()[0]
    rays = view.rays(own_pixels(view, 6, rng).reshape(3, 2, 2))
    points = at_inverse_depths(rays, [1 / 500, 1 / 300, 1 / 10])
    assert points.shape == (3, 3, 2, 3)
    np.testing.assert_allclose(points[0], rays.at_depth(500))
    np.testing.assert_allclose(points[1, ..., 2], 300)
    assert np.isnan(points[2]).all()  # behind the glass


@pytest.mark.parametrize("name", RIGS)
@pytest.mark.parametrize("step", [0.5, 2.0])
def test_one_step_moves_no_picture_further_than_asked(name, step, rng):
    rig = SETUPS[name].rig()
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
        inverse_depths(SETUPS[RIGS[0]].rig(), depths)


def test_views_that_share_nothing_cannot_be_swept():
    one = Plate(1.5, 50, 10)
    apart = Mirrors((Mirror((-9, 0, 60), (-1, 0, -1), (18, 60)), Mirror((9, 0, 60), (1, 0, -1), (18, 60))))
    for optic in (one, apart):
        with pytest.raises(SetupError, match="nothing moves between the depths 200 and 600 mm"):
            inverse_depths(Setup(STRAIGHT, optic).rig(), DEPTHS)


@pytest.mark.parametrize("name", RIGS)
def test_nodes_are_where_the_other_views_see_the_points(name):
    rig = SETUPS[name].rig()
    inverse = np.linspace(1 / 600, 1 / 200, 4)
    for reference in range(len(rig)):
        warps = sweep(rig, reference, inverse, spacing=16)
        others = [k for k in range(len(rig)) if k != reference]
        x, y, width, height = rig[reference].region.box
        assert (warps.origin, warps.size) == ((x, y), (width, height))
        rows, columns = warps.nodes.shape[2:4]
        assert 0 <= 16 * (columns - 1) - (width - 1) < 16  # the lattice covers the box, and not a column more
        assert 0 <= 16 * (rows - 1) - (height - 1) < 16
        np.testing.assert_array_equal(warps.masks, rig.masks[[reference, *others]])
        for row, column in ((0, 0), (3, 5), (rows - 1, columns - 1)):
            ray = rig[reference].unbounded().rays([x + 16 * column, y + 16 * row])
            for k, other in enumerate(others):
                direct = rig[other].unbounded().project(at_inverse_depths(ray, inverse))
                # nodes are float32, which holds 24 bits
                np.testing.assert_allclose(warps.nodes[k, :, row, column], direct, rtol=2.0**-24, atol=1e-9)


def test_depths_behind_the_glass_have_no_nodes():
    rig = SETUPS[RIGS[0]].rig()
    warps = sweep(rig, 0, [1 / 500, 1 / 100, 1 / 50])
    assert np.isnan(warps.nodes[:, 2]).all()
    assert np.isfinite(warps.nodes[:, :2]).all()


def test_two_depths_are_too_few():
    with pytest.raises(ShapeError, match="at least 3 inverse depths, got 2"):
        sweep(SETUPS[RIGS[0]].rig(), 0, [1 / 500, 1 / 400])


@pytest.mark.parametrize("name", ["n2", "n3", "n4", "n5", "n3_pose", "n2_flip", "t2_b40", "t3_b40", "t4_b45"])
def test_interpolating_between_nodes_costs_less_than_a_hundredth_of_a_pixel(name, mitsuba):
    rig = renderer_setup(name).rig()
    warps = sweep(rig, 0, np.linspace(1 / 1500, 1 / 500, 3), spacing=8)
    assert interpolation_error(rig, warps, 0) < 0.01


@pytest.mark.parametrize("spacing", [8, 32])
def test_the_interpolation_error_is_true(spacing, rng):
    rig = Setup(STRAIGHT, Prism(2, 15, 1.5168, 60)).rig()
    inverse = np.linspace(1 / 600, 1 / 200, 3)
    warps = sweep(rig, 1, inverse, spacing)
    pixels = own_pixels(rig[1], 3000, rng)
    place = (pixels - warps.origin) / spacing
    (column, row), (u, v) = np.floor(place).astype(int).T, (place - np.floor(place)).T[..., None]
    direct = rig[0].unbounded().project(at_inverse_depths(rig[1].rays(pixels), inverse))
    worst = 0.0
    for d in range(3):
        nodes = np.pad(warps.nodes[0, d].astype(float), ((0, 1), (0, 1), (0, 0)), mode="edge")
        above = (1 - u) * nodes[row, column] + u * nodes[row, column + 1]
        below = (1 - u) * nodes[row + 1, column] + u * nodes[row + 1, column + 1]
        worst = max(worst, np.linalg.norm((1 - v) * above + v * below - direct[d], axis=-1).max())
    # it looks at the middles of cells, where errors are largest, in the first and last depth; 1e-4 px: float32
    claimed = interpolation_error(rig, warps, 1)
    assert 0.5 * claimed < worst < 1.02 * claimed + 1e-4
