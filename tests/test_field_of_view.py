"""The closed forms of the common field of view against true rays, brute force and each other."""

import numpy as np
import pytest

from cyclopean import Camera, Mirror, Mirrors, Plate, Prism, Setup
from cyclopean.analysis.common_volume import CommonField
from cyclopean.analysis.field_of_view import FieldOfView, upright
from cyclopean.errors import OpticError

GAMMA = np.deg2rad(12.0)
# focal lengths (px) that make the three classes with a biprism of 10 degrees, gamma 10.54 degrees
CLASSES = {"convergent": 8000, "semi-divergent": 4000, "divergent": 2400}


def biprism(focal=2400, **changes):
    given = {"facets": 2, "apex_deg": 10.0, "glass": 1.5168, "distance": 150.0, "thickness": 12.0} | changes
    return Setup(Camera((1280, 960), focal), Prism(**given))


def pyramid(facets, apex_deg=12.0, focal=2400, **changes):
    given = {"glass": 1.5168, "distance": 60.0, "thickness": 12.0, "azimuth_deg": 20.0} | changes
    return Setup(Camera((1280, 960), focal), Prism(facets, apex_deg, **given))


def views_of(rig, points):
    """How many views see each point (...,)."""
    return np.isfinite(rig.project(points)[..., 0]).sum(-1)


def seen_by_pinholes(field, points):
    """True (N, n) where points (N, 3) lie in the sector of each virtual camera, by projecting them."""
    seen = []
    for k, azimuth in enumerate(field.azimuths):
        out, round_ = np.array([np.cos(azimuth), np.sin(azimuth), 0]), np.array([-np.sin(azimuth), np.cos(azimuth), 0])
        up = np.array([0.0, 0.0, 1.0])
        local = points - (field.baselines[k] / 2 * out + field.centres[k] * up)
        axis = np.cos(field.deviation) * up - np.sin(field.deviation) * out
        right = np.cos(field.deviation) * out + np.sin(field.deviation) * up
        depth = local @ axis
        radial, around = local @ right / depth, local @ round_ / depth
        inside = (np.abs(np.arctan2(around, radial)) <= np.pi / field.facets) & (depth > 0)
        seen.append(inside & (radial <= np.tan(field.half_angles[k])))
    return np.stack(seen, -1)


@pytest.mark.parametrize("facets", [2, 3, 4, 5, 8])
def test_classes_change_exactly_at_their_thresholds(facets):
    for step, kind in ((-1e-9, "convergent"), (1e-9, "semi-divergent")):
        field = FieldOfView.from_angles(GAMMA * (1 + step), GAMMA, 40.0, facets)
        assert field.kind == kind
        assert np.isfinite(field.far) == (kind == "convergent")
    second = field.divergence
    if facets == 2:
        assert second == pytest.approx(2 * GAMMA, rel=1e-15)
    else:  # sectors are narrower than half-planes: boundaries must only reach the circle that touches their sides
        assert GAMMA < second < 2 * GAMMA
    for step, kind in ((-1e-6, "semi-divergent"), (1e-6, "divergent")):
        field = FieldOfView.from_angles(second * (1 + step), GAMMA, 40.0, facets)
        assert field.kind == kind
        assert np.isfinite(field.kink) == (kind == "semi-divergent")


@pytest.mark.parametrize("share", [0.5, 0.9, 1.1, 1.5, 1.9])
def test_two_facets_have_the_kink_and_the_limits_of_crossing_lines(share):
    field = FieldOfView.from_angles(share * GAMMA, GAMMA, 40.0, depth=3.0)
    delta, h = GAMMA / 2, share * GAMMA / 2
    assert field.near == pytest.approx(3.0 + 40 / 2 / np.tan(delta), rel=1e-12)
    assert field.kink == pytest.approx(3.0 + 40 / (np.tan(delta) - np.tan(h - delta)), rel=1e-9)  # a bisection
    far = 3.0 + 40 / (2 * np.tan(delta - h)) if share < 1 else np.inf
    assert field.far == pytest.approx(far, rel=1e-12)
    # both lines meet at the kink, and the field closes at the far limit
    at_kink = (field.kink - field.near) * np.tan(delta)
    assert field.half_width(field.kink) == pytest.approx(at_kink, rel=1e-9)
    if share < 1:
        assert field.half_width(field.far * (1 + 1e-9)) == 0.0
        assert 0 < field.half_width(field.far * (1 - 1e-6)) < 1e-3


@pytest.mark.parametrize("facets", [3, 4, 6])
def test_kink_of_a_pyramid_is_where_the_circle_meets_the_boundary(facets):
    field = FieldOfView.from_angles(1.2 * GAMMA, GAMMA, 40.0, facets, depth=3.0)
    delta, sine = GAMMA / 2, np.sin(np.arctan(np.tan(np.pi / facets) * np.cos(GAMMA / 2)))
    kink = 3.0 + 20.0 * (1 + sine) / (np.tan(delta) * sine - np.tan(0.2 * delta))
    assert field.kink == pytest.approx(kink, rel=1e-9)  # a bisection


@pytest.mark.parametrize("facets", [3, 4, 5, 7])
@pytest.mark.parametrize("share", [0.9, 1.3, 2.5])
def test_cross_section_is_what_n_pinholes_see(facets, share):
    field = FieldOfView.from_angles(share * GAMMA, GAMMA, 40.0, facets)
    rng = np.random.default_rng(3)
    for depth in (field.near * 1.3, field.near * 2.5):
        corners = field.cross_section(depth)
        radius = 1.3 * np.linalg.norm(corners, axis=-1).max()
        places = rng.uniform(-radius, radius, (4000, 2))
        seen = seen_by_pinholes(field, np.column_stack([places, np.full(len(places), depth)])).all(-1)
        assert 0.1 < seen.mean() < 0.9
        edges = np.roll(corners, -1, axis=0) - corners
        arms = places[:, None] - corners
        turns = edges[:, 0] * arms[..., 1] - edges[:, 1] * arms[..., 0]
        np.testing.assert_array_equal(seen, (turns >= 0).all(-1))  # convex, counter-clockwise


@pytest.mark.parametrize("facets", [2, 3, 4, 5])
def test_half_width_is_the_radius_of_a_circle_that_all_pinholes_see(facets):
    field = FieldOfView.from_angles(1.2 * GAMMA, GAMMA, 40.0, facets)
    around = np.linspace(0, 2 * np.pi, 3601)  # a step of 0.1 degrees misses the touching point by 1e-6 of the radius
    circle = np.column_stack([np.cos(around), np.sin(around)])
    for depth in (field.near * 1.1, field.kink * 0.95, field.kink * 1.4):
        for share, inside in ((1 - 1e-9, True), (1 + 1e-5, False)):
            ring = np.column_stack([circle * share * field.half_width(depth), np.full(len(circle), depth)])
            assert seen_by_pinholes(field, ring).all() == inside


@pytest.mark.parametrize("kind", CLASSES)
@pytest.mark.parametrize("facing", ["scene", "camera"])
def test_half_width_of_a_biprism_is_exact_for_true_rays(kind, facing):
    setup = biprism(CLASSES[kind], facing=facing)
    field, rig = FieldOfView.of(setup), setup.rig(0.0)
    assert field.kind == kind
    far = field.far if np.isfinite(field.far) else 4 * field.near
    for depth in np.linspace(field.near * 1.01, 0.99 * far, 9):
        width = float(field.half_width(depth))
        for share, count in ((1 - 1e-6, 2), (1 + 1e-6, 1)):
            points = [[side * share * width, 0.0, depth] for side in (-1, 1)]
            assert (views_of(rig, points) == count).all()


@pytest.mark.parametrize("facets", [2, 3, 4, 5, 6])
@pytest.mark.parametrize("facing", ["scene", "camera"])
def test_limits_on_the_axis_are_exact_for_true_rays(facets, facing):
    setup = pyramid(facets, focal=9000, facing=facing)
    field, rig = FieldOfView.of(setup), setup.rig(0.0)
    assert field.kind == "convergent"
    assert views_of(rig, [0, 0, field.near * (1 + 1e-7)]) == facets
    for count, limit in enumerate(field.far_limits, start=1):
        if np.isfinite(limit):
            assert views_of(rig, [0, 0, limit * (1 - 1e-7)]) >= count
            assert views_of(rig, [0, 0, limit * (1 + 1e-7)]) < count


def test_near_limit_is_the_apex_for_any_number_of_facets():
    for facets in (2, 3, 4, 5):
        # the flat face looks at the camera: the axes cross at the apex, at 72 mm; 1e-9: derivatives by differences
        assert FieldOfView.of(pyramid(facets)).near == pytest.approx(72.0, rel=1e-9)


@pytest.mark.parametrize("facets", [3, 4, 5, 6, 7, 8])
def test_half_width_of_a_pyramid_is_exact_near_the_apex_and_close_far_away(facets):
    setup = pyramid(facets, azimuth_deg=90.0 if facets % 2 else 0.0)  # borders across the middle of a facet
    field, common = FieldOfView.of(setup), CommonField.of(setup.rig(0.0), 800)
    for depth, tolerance in ((73.0, 2e-4), (80.0, 2e-4), (150.0, 0.003), (900.0, 0.01), (3000.0, 0.01)):
        traced = common.sections(depth)[-1].clearance([[0.0, 0.0]])[0]
        # near the apex what is left is sampling; farther out seams bend, by up to 0.9 % at gamma = 12.8 degrees
        assert field.half_width(depth) == pytest.approx(traced, rel=tolerance)
        if depth == 900.0:
            assert 0.002 < 1 - field.half_width(depth) / traced < 0.009  # too small, as documented
        if depth > 80:
            continue
        section = common.sections(depth)[-1]
        assert (section.clearance(field.cross_section(depth)) > -1e-3 * traced).all()


def test_a_narrow_gamma_leaves_less_to_the_straight_seams():
    misses = []
    for apex_deg in (12.0, 6.0, 3.0):
        setup = pyramid(4, apex_deg)
        traced = CommonField.of(setup.rig(0.0), 800).sections(900.0)[-1].clearance([[0.0, 0.0]])[0]
        misses.append(abs(float(FieldOfView.of(setup).half_width(900.0)) / traced - 1))
    # the bend of a seam grows with the square of the angle: half the angle, a quarter of the miss; 2.5 for the rest
    assert misses[0] > 2.5 * misses[1] > 2.5**2 * misses[2]


@pytest.mark.parametrize("facing", ["scene", "camera"])
def test_angles_and_baselines_of_pairs_are_those_of_the_rays(facing):
    setup = pyramid(5, facing=facing)
    field, rig = FieldOfView.of(setup), setup.rig(0.0)
    axes = [view.unbounded().rays(view.camera.centre).directions for view in rig]
    for other in range(1, 5):
        angle = np.arccos(axes[0] @ axes[other])
        # 1e-9: the arc cosine of numbers near 1
        assert field.axes_angle(2 * np.pi * other / 5) == pytest.approx(angle, abs=1e-9)
    apex = np.deg2rad(12.0)
    inside = apex - np.arcsin(np.sin(apex) / 1.5168) if facing == "camera" else apex
    delta = np.arcsin(1.5168 * np.sin(inside)) - (0 if facing == "camera" else apex)
    assert field.deviation == pytest.approx(delta, abs=1e-13)
    assert field.gamma == 2 * field.deviation
    # adjacent facets of five: 2 rho sin 36 degrees
    assert field.baseline(2 * np.pi / 5) == pytest.approx(field.baselines.mean() * np.sin(np.pi / 5), rel=1e-12)


def test_a_lens_off_centre_and_with_distortion_keeps_the_forms_exact():
    camera = Camera((1280, 960), (8000, 8100), (700.0, 470.0), (0.3, 0.1, 0.0, 0.0, 0.0))
    setup = Setup(camera, Prism(2, 10.0, 1.5168, 150.0, 12.0))
    field, rig = FieldOfView.of(setup), setup.rig(0.0)
    assert field.half_angles[0] < field.half_angles[1]  # less picture to the right of the axis
    assert field.kind == "convergent"
    assert views_of(rig, [0, 0, field.far * (1 - 1e-7)]) == 2
    assert views_of(rig, [0, 0, field.far * (1 + 1e-7)]) < 2


def test_what_is_no_upright_pyramid_is_refused_with_the_reason():
    mirror = Mirror((40.0, 0.0, 200.0), (-1, 0.0, -0.02), (300.0, 200.0))
    for setup, words in (
        (Setup(Camera((640, 480), 900), Mirrors((mirror,), direct=True)), "not a prism"),
        (Setup(Camera((640, 480), 900), Plate("N-BK7", 40, 15)), "'plate'"),
        (pyramid(3, tilt_deg=(3.0, -4.0, 0.0)), "tilted by 5 degrees"),
        (pyramid(3, shift=(0.3, 0.4)), "shifted by 0.5 mm"),
        (pyramid(2, facet_deviation_deg=((0.1, 0.0), (0.0, -0.2))), "irregular by up to 0.2 degrees"),
    ):
        with pytest.raises(OpticError, match=words):
            FieldOfView.of(setup)
    turned = pyramid(3, tilt_deg=(3.0, -4.0, 7.0), shift=(1, 2))
    assert FieldOfView.of(upright(turned)).deviation == pytest.approx(FieldOfView.of(pyramid(3)).deviation, abs=1e-12)
    with pytest.raises(OpticError, match="only a prism"):
        upright(Setup(Camera((640, 480), 900), Plate("N-BK7", 40, 15)))
    with pytest.raises(OpticError, match="apart"):
        FieldOfView.of(pyramid(2, glass="air", surroundings="water"))


@pytest.mark.parametrize(
    ("numbers", "words"),
    [
        ((0.2, 0.2, -40.0), "baseline"),
        ((0.2, np.nan, 40.0), "gamma"),
        ((0.2, 4.0, 40.0), "gamma"),
        ((0.0, 0.2, 40.0), "half angles"),
        ((np.nan, 0.2, 40.0), "half angles"),
        ((3.5, 0.2, 40.0), "90 degrees"),
        ((0.2, 0.2, 40.0, 1), "2 facets or more"),
    ],
)
def test_wrong_numbers_are_refused(numbers, words):
    with pytest.raises(OpticError, match=words):
        FieldOfView.from_angles(*numbers)


def test_depths_of_any_shape_and_depths_that_are_no_numbers():
    field = FieldOfView.from_angles(1.5 * GAMMA, GAMMA, 40.0, 3)
    depths = np.array([[100.0, 300.0, np.nan], [600.0, 1e4, 0.0]])
    widths = field.half_width(depths)
    assert widths.shape == (2, 3)
    assert np.isnan(widths[0, 2])
    assert widths[1, 2] == 0.0
    assert widths[1, 0] == field.half_width(600.0)
    with pytest.raises(OpticError, match="strip"):
        FieldOfView.from_angles(1.5 * GAMMA, GAMMA, 40.0).cross_section(300.0)
