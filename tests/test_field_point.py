"""One point at a known depth puts a drawing right; two do without one."""

from dataclasses import replace

import numpy as np
import pytest
from scenes import small_setup

from cyclopean import Camera, Mirror, Mirrors, Prism, Setup, triangulate
from cyclopean.calibration.field_point import field_point_test, separation, two_depths
from cyclopean.errors import SetupError, ShapeError

BUILT = small_setup()
POINT = np.array([4.0, -6.0, 700.0])
FIELDS = {"apex": ("apex_deg", 12.0), "distance": ("distance", 60.0), "index": ("glass", 1.5168)}


def drawn(parameter, factor):
    """The setup as drawn: one parameter off by a factor."""
    field, value = FIELDS[parameter]
    return replace(BUILT, optic=replace(BUILT.optic, **{field: value * factor}))


@pytest.mark.parametrize("factor", [0.97, 1.004])
@pytest.mark.parametrize("parameter", FIELDS)
def test_with_true_rays_the_wrong_number_is_found(parameter, factor):
    setup = drawn(parameter, factor)
    pixels = BUILT.rig().project(POINT)
    result = field_point_test(setup, pixels, POINT[2], parameter, "rays")
    assert result.converged
    # 1e-7: the search stops at 1e-9 of the depth, which moves by at least 0.05 of the parameter's relative change
    assert result.after == pytest.approx(FIELDS[parameter][1], rel=1e-7)
    assert result.before == pytest.approx(FIELDS[parameter][1] * factor)
    assert result.depth == pytest.approx(POINT[2], rel=1e-8)
    assert not abs(result.depth_before / POINT[2] - 1) < 1e-3  # NaN where the rays parted
    others = np.array([[20.0, 30.0, 500.0], [-25.0, 5.0, 1000.0]])
    found = triangulate(result.rig.unbounded(), BUILT.rig().unbounded().project(others)).points
    np.testing.assert_allclose(found, others, rtol=1e-6, atol=1e-4)


@pytest.mark.parametrize("parameter", FIELDS)
def test_depth_errs_by_the_first_order_law(parameter):
    """dZ/Z = -A da/a = -A dn/(n - 1) and + dz/z, with A = Z/z - 1, for a thin prism far away."""
    setup = Setup(Camera((640, 480), 1500), Prism(2, 4.0, 1.5, 300.0, thickness=2.0))
    pixels = setup.rig().project([3.0, 2.0, 900.0])
    wrong = {"apex": 4.0 * 1.002, "distance": 300.0 * 1.002, "index": 1.5 + 0.5 * 0.002}[parameter]
    field = FIELDS[parameter][0]
    result = field_point_test(
        replace(setup, optic=replace(setup.optic, **{field: wrong})), pixels, 900.0, parameter, "rays"
    )
    assert result.converged
    law = {"apex": -2.0, "index": -2.0, "distance": 1.0}[parameter] * 0.002
    assert result.depth_before / 900.0 - 1 == pytest.approx(law, rel=0.06)  # a prism of 4 degrees is not quite thin


@pytest.mark.parametrize("boundary", ["middle", "edge", "pixels"])
def test_sketched_cameras_meet_the_field_point(boundary):
    rig = BUILT.rig()
    pixels = rig.project(POINT)
    rims = [view.region.centre for view in rig] if boundary == "pixels" else boundary
    result = field_point_test(drawn("apex", 1.01), pixels, POINT[2], boundary=rims)
    assert result.converged
    assert result.depth == pytest.approx(POINT[2], rel=1e-8)
    assert triangulate(result.rig, pixels).points[2] == pytest.approx(POINT[2], rel=1e-8)
    assert "sketch" not in result.parameter
    assert result.after == pytest.approx(12.0, rel=0.03)  # what is left stands for the sketch's own error
    near = np.array([[0.0, 10.0, 680.0], [-5.0, 0.0, 730.0]])
    found = triangulate(result.rig.unbounded(), rig.unbounded().project(near)).points
    np.testing.assert_allclose(found[:, 2], near[:, 2], rtol=0.02)  # a sketch is good to a few percent off its point


def test_stated_uncertainty_matches_the_spread():
    rng, pixels = np.random.default_rng(3), BUILT.rig().project(POINT)
    runs = [
        field_point_test(BUILT, pixels + rng.normal(0, 0.05, pixels.shape), POINT[2], method="rays", sigma_px=0.05)
        for _ in range(40)
    ]
    spread = np.std([run.after for run in runs])
    assert spread == pytest.approx(np.median([run.sigma for run in runs]), rel=0.3)  # 40 samples: 11 %, and 3 sigma


def test_a_point_that_two_of_three_views_show_will_do():
    pixels = BUILT.rig().project(POINT)
    pixels[1] = np.nan
    result = field_point_test(drawn("apex", 0.99), pixels, POINT[2], method="rays")
    assert result.after == pytest.approx(12.0, rel=1e-7)


def test_an_impossible_point_does_not_converge():
    pixels = BUILT.rig().project(POINT)
    apart = field_point_test(BUILT, pixels, 2.0, method="rays")  # nearer than the prism
    assert not apart.converged
    assert "near the drawn one" in apart.message


def test_wrong_calls_say_so():
    pixels = BUILT.rig().project(POINT)
    alone = np.where([[True], [False], [False]], pixels, np.nan)
    with pytest.raises(SetupError, match="two views"):
        field_point_test(BUILT, alone, 700.0)
    with pytest.raises(ShapeError, match=r"\(3, 2\)"):
        field_point_test(BUILT, pixels[:2], 700.0)
    with pytest.raises(SetupError, match="positive number of mm"):
        field_point_test(BUILT, pixels, -700.0)
    with pytest.raises(SetupError, match="apex, distance, index"):
        field_point_test(BUILT, pixels, 700.0, "tilt")
    with pytest.raises(SetupError, match="'sketch' or from 'rays'"):
        field_point_test(BUILT, pixels, 700.0, method="guess")
    with pytest.raises(ShapeError, match="boundary"):
        field_point_test(BUILT, pixels, 700.0, boundary=pixels[0])
    mirrors = Setup(BUILT.camera, Mirrors((Mirror((10, 0, 90), (-1, 0, 0.1), (80, 80)),), direct=True))
    with pytest.raises(SetupError, match="no apex"):
        field_point_test(mirrors, pixels[:2], 700.0)


# Two known depths


def test_two_depths_give_the_law_back():
    law = two_depths([200.0, 350.0], [500.0, 1250.0])
    np.testing.assert_allclose(law.separation([500.0, 1250.0]), [200.0, 350.0], rtol=1e-12)
    depths = np.array([[400.0, 900.0], [1500.0, 3000.0]])
    np.testing.assert_allclose(law.depth(law.separation(depths)), depths, rtol=1e-12)
    step = law.depth(law.separation(900.0) + 1e-3) - law.depth(law.separation(900.0) - 1e-3)
    assert step / 2e-3 == pytest.approx(law.depth_per_px(900.0), rel=1e-6)
    assert np.isnan(law.depth([law.gamma_f, law.gamma_f * 1.1])).all()  # beyond infinity
    more = two_depths(law.separation([500.0, 800.0, 2000.0]), [500.0, 800.0, 2000.0])
    assert (more.gamma_f, more.apex_depth) == pytest.approx((law.gamma_f, law.apex_depth))


@pytest.mark.parametrize("azimuth_deg", [0.0, 90.0, -30.0])
def test_a_thin_biprism_obeys_the_law_on_its_axis(azimuth_deg):
    focal, angle, index = 1500, 3.0, 1.5
    setup = Setup(Camera((640, 480), focal), Prism(2, angle, index, 300.0, thickness=2.0, azimuth_deg=azimuth_deg))
    rig = setup.rig().unbounded()
    depths = np.linspace(500, 1500, 11)
    points = np.stack([0 * depths, 0 * depths, depths], -1)
    apart = separation(rig.project(points), azimuth_deg)
    law = two_depths(apart[[0, -1]], depths[[0, -1]])
    np.testing.assert_allclose(law.depth(apart), depths, rtol=7e-4)  # the square of the angle, 0.026 rad
    assert law.gamma_f == pytest.approx(2 * (index - 1) * np.deg2rad(angle) * focal, rel=0.01)  # thin prism
    assert law.apex_depth == pytest.approx(300 + 2 / index, rel=0.01)  # seen through the glass


def test_wrong_depths_say_so():
    with pytest.raises(SetupError, match="all depths are the same, 500 mm"):
        two_depths([200.0, 201.0], [500.0, 500.0])
    with pytest.raises(ShapeError, match="as many depths"):
        two_depths([200.0], [500.0])
    with pytest.raises(SetupError, match="swapped"):
        two_depths([-200.0, -350.0], [500.0, 1250.0])
    with pytest.raises(SetupError, match="must be numbers"):
        two_depths([np.nan, 350.0], [500.0, 1250.0])
    with pytest.raises(ShapeError, match="two views"):
        separation([[1.0, 2.0, 3.0]])
