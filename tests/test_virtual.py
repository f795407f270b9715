"""Virtual cameras: exact for mirrors, honest for glass."""

import json

import numpy as np
import pytest
from setups import OPTICS, SETUPS, STRAIGHT

from benchmarks.data import renderer_setup
from cyclopean import Camera, Mirror, Mirrors, Plate, Prism, Setup
from cyclopean.errors import OpticError
from cyclopean.geometry import nearest_point
from cyclopean.rigs import fit, sketch

DEPTHS = (300, 1500)
MAKERS = {
    "sketch, middle": lambda view, depths: sketch(view, depths),
    "sketch, edge": lambda view, depths: sketch(view, depths, "edge"),
    "fit": fit,
    "fit, no distortion": lambda view, depths: fit(view, depths, distortion=False),
}


@pytest.mark.parametrize("maker", MAKERS)
@pytest.mark.parametrize("number", range(3))
def test_over_plane_mirrors_a_virtual_camera_is_exact(number, maker):
    view = SETUPS["two mirrors, straight lens"].rig()[number]
    virtual = MAKERS[maker](view, (200, 900))
    # 1e-6 px: the angle of a sketch comes from an arc cosine, which loses half of the digits at worst
    assert virtual.departure_max < 1e-6
    assert virtual.mirrored == view.mirrored == (number == 1)
    centre = np.zeros(3)
    for interface in view.path.interfaces:
        centre = centre - 2 * (centre @ interface.normal - interface.offset) * interface.normal
    # 1e-9 mm, 1e-8 of the focal length: the same
    np.testing.assert_allclose(virtual.centre, centre, rtol=0, atol=1e-9)
    np.testing.assert_allclose(virtual.camera.focal, STRAIGHT.focal, rtol=1e-8)
    assert np.linalg.det(virtual.camera_from_rig.rotation) == pytest.approx(1, abs=1e-12)


def test_over_a_mirror_a_fit_finds_the_lens():
    camera = Camera((640, 480), (900, 905), (318, 243), (0.1, -0.05, 1e-3, -2e-3, 0))
    virtual = fit(Setup(camera, Mirrors((Mirror((0, 0, 90), (1, 0.1, -1)),))).rig()[0], (200, 900))
    assert virtual.departure_max < 1e-6  # px: the solver's end
    np.testing.assert_allclose(virtual.camera.distortion, camera.distortion, atol=1e-7)
    np.testing.assert_allclose(virtual.camera.centre, camera.centre, atol=1e-4)  # px


def test_the_direct_view_beside_a_mirror_is_the_camera():
    view = SETUPS["two mirrors, straight lens"].rig()[2]
    virtual = fit(view, (200, 900))
    # 1e-9: the solver's end
    np.testing.assert_allclose(virtual.camera_from_rig.rotation, np.eye(3), atol=1e-9)
    np.testing.assert_allclose(virtual.centre, 0, atol=1e-9)


@pytest.mark.parametrize("optic", [OPTICS["prism"], Mirrors((Mirror((0, 0, 90), (1, 0.1, -1)),))])
def test_a_virtual_camera_is_a_pinhole(optic):
    virtual = sketch(Setup(STRAIGHT, optic).rig()[0], DEPTHS)
    pixels = np.random.default_rng(5).uniform(0, [639, 479], (3, 1, 2))
    rays = virtual.rays(pixels)
    assert rays.shape == (3, 1)
    # 1e-10: some roundings of 1000 mm and 1000 px
    np.testing.assert_allclose(virtual.project(rays.at(np.full((3, 1), 700.0))), pixels, rtol=0, atol=1e-10)
    np.testing.assert_allclose(rays.origins, np.broadcast_to(virtual.centre, (3, 1, 3)))
    np.testing.assert_allclose(virtual.rays(virtual.camera.centre).directions, virtual.axis, atol=1e-14)
    assert np.isnan(virtual.project(virtual.centre - 10 * virtual.axis)).all()  # behind it


# Against the renderer: the points nearest to its exit rays


@pytest.mark.parametrize("name", ["n2", "n3", "n4", "n5", "n3_pose", "n2_flip", "t2_b40", "t3_b40", "t4_b45"])
def test_centres_are_those_of_the_renderer(name, mitsuba):
    facts = json.loads((mitsuba / "rigs" / f"{name}.json").read_text())
    rig, theirs = renderer_setup(name).rig(), facts["virtual_cameras"]
    centres = np.array([fit(view, DEPTHS).centre for view in rig])
    for view, their, centre in zip(rig, theirs, centres, strict=True):
        pixels = np.stack(np.meshgrid(np.arange(4, 1280, 16.0), np.arange(4, 960, 16.0)), -1).reshape(-1, 2)
        nearest = nearest_point(view.rays(pixels[view.region.contains(pixels)]))
        # 5 %: the renderer took other pixels; a centre is well known across the axis, and hardly along it
        assert nearest.rms == pytest.approx(their["rms_mm"], rel=0.05)
        for found, along in ((nearest.points, 1.5), (centre, 3)):
            assert np.linalg.norm((found - their["centre"])[:2]) < 0.2 * their["rms_mm"]
            assert abs(found[2] - their["centre"][2]) < along * their["rms_mm"]
    baselines = np.linalg.norm(centres[:, None] - centres, axis=-1)
    # half of what the renderer's own centres are uncertain by
    blur = 0.5 * min(their["rms_mm"] for their in theirs)
    np.testing.assert_allclose(baselines, facts["virtual_centre_distances"], rtol=0, atol=blur)


# Closed forms of ray sketching


@pytest.mark.parametrize("facets", [2, 3, 4])
@pytest.mark.parametrize(("apex_deg", "distance"), [(6.4, 370), (10, 150), (15, 100)])
def test_a_sketch_is_the_closed_form(facets, apex_deg, distance):
    index, thickness, apex = 1.5168, 10.0, np.radians(apex_deg)
    camera = Camera((2049, 1537), 4545)  # 25 mm, pixels of 5.5 um
    view = Setup(camera, Prism(facets, apex_deg, index, distance, thickness)).rig()[0]
    boundary = np.array([2048, camera.centre[1]])  # in the plane of symmetry of the facet on the right
    virtual = sketch(view, DEPTHS, boundary)
    # the same by plane trigonometry, angles from z to the right
    deviation = np.arcsin(index * np.sin(apex)) - apex
    start = np.arctan(1024 / 4545)
    inside = np.arcsin(np.sin(start) / index)
    end = np.arcsin(index * np.sin(inside - apex)) + apex
    depth = (thickness - distance * np.tan(start) * np.tan(apex)) / (1 + np.tan(inside) * np.tan(apex))
    x, z = distance * np.tan(start) + depth * np.tan(inside), distance + depth  # where the ray leaves the facet
    apex_z = distance + thickness
    # the axis ray x = (apex_z - z) tan(deviation) and the boundary ray meet
    zc = (apex_z * np.tan(deviation) - x + z * np.tan(end)) / (np.tan(deviation) + np.tan(end))
    rho = (apex_z - zc) * np.tan(deviation)
    # 1e-9: roundings, divided by the small angle between the lines
    np.testing.assert_allclose(virtual.centre, [rho, 0, zc], rtol=0, atol=1e-9)
    np.testing.assert_allclose(virtual.axis, [-np.sin(deviation), 0, np.cos(deviation)], rtol=0, atol=1e-12)
    assert virtual.camera.focal[0] == pytest.approx(1024 / np.tan(end + deviation), rel=1e-9)


def test_axes_and_baselines_of_sketches_are_those_of_a_regular_pyramid():
    facets = 5
    camera = Camera((1281, 1281), 2400)
    rig = Setup(camera, Prism(facets, 12, 1.5168, 60, 7)).rig()
    azimuths = 2 * np.pi * np.arange(facets) / facets
    ends = camera.centre + 600 * np.stack([np.cos(azimuths), np.sin(azimuths)], -1)
    virtual = [sketch(view, DEPTHS, end) for view, end in zip(rig, ends, strict=True)]
    deviation = np.arcsin(1.5168 * np.sin(np.radians(12))) - np.radians(12)
    for k in range(1, facets):
        between = azimuths[k]
        # cos g = cos^2 d + sin^2 d cos p, and the chord of a circle
        cosine = np.cos(deviation) ** 2 + np.sin(deviation) ** 2 * np.cos(between)
        assert virtual[0].axis @ virtual[k].axis == pytest.approx(cosine, abs=1e-14)
        baseline = np.linalg.norm(virtual[0].centre - virtual[k].centre)
        rho = (67 - virtual[0].centre[2]) * np.tan(deviation)
        assert baseline == pytest.approx(2 * rho * np.sin(between / 2), rel=1e-9)


# What a virtual camera says of itself


@pytest.mark.parametrize("maker", MAKERS)
@pytest.mark.parametrize("name", ["prism, straight lens", "prism, facets to camera, bent lens", "plate, bent lens"])
def test_the_departure_is_true(name, maker):
    view = SETUPS[name].rig()[0]
    virtual = MAKERS[maker](view, DEPTHS)
    rows, columns = np.nonzero(view.region.mask)
    pixels = np.stack([columns, rows], -1)[::5].astype(float)
    miss = []
    for inverse in np.linspace(1 / DEPTHS[1], 1 / DEPTHS[0], 5):
        points = view.rays(pixels).at_depth(1 / inverse)
        miss.append(np.linalg.norm(virtual.project(points) - pixels, axis=-1))
    # 5 %: it looks at some 10 000 of these 100 000 rays
    assert virtual.departure_rms == pytest.approx(np.sqrt(np.mean(np.square(miss))), rel=0.05)
    assert virtual.departure_max == pytest.approx(np.max(miss), rel=0.05)
    assert virtual.depths == DEPTHS


def test_a_better_model_departs_less():
    view = SETUPS["prism, straight lens"].rig()[0]
    full, plain = fit(view, DEPTHS), fit(view, DEPTHS, distortion=False)
    rough = [sketch(view, DEPTHS, boundary) for boundary in ("middle", "edge", (600.0, 300.0))]
    assert 0.01 < full.departure_rms < plain.departure_rms < min(virtual.departure_rms for virtual in rough)
    assert [virtual.method for virtual in rough] == [f"ray sketch, {name} ray" for name in ("middle", "edge", "pixel")]


@pytest.mark.parametrize("optic", [Plate(1.5168, 50, 10), Mirrors((Mirror((0, 0, 90), (1, 0, -1)),))])
def test_a_sub_image_in_the_middle_of_the_picture_is_no_trouble(optic):
    view = Setup(STRAIGHT, optic).rig()[0]
    for maker in MAKERS.values():
        virtual = maker(view, DEPTHS)
        assert np.isfinite(virtual.centre).all()
        if isinstance(optic, Plate):
            # an upright plate moves the pinhole nearer, by t (1 - 1/n) near the axis and more beside it
            assert virtual.centre[2] == pytest.approx(10 * (1 - 1 / 1.5168), rel=0.1)
            np.testing.assert_allclose(virtual.axis, [0, 0, 1], atol=1e-6)


def test_what_cannot_be_done_is_said():
    view = SETUPS["prism, straight lens"].rig()[0]
    for depths in ((500, 400), (0, 400), (np.nan, 400)):
        with pytest.raises(OpticError, match="0 < near < far in mm"):
            fit(view, depths)
    with pytest.raises(OpticError, match="boundary must be 'middle', 'edge' or a pixel, got 'left'"):
        sketch(view, DEPTHS, "left")
    with pytest.raises(OpticError, match="too few rays reach the depths 10 to 20 mm"):
        fit(view, (10, 20))
    with pytest.raises(OpticError, match="the axis ray and the boundary ray are parallel"):
        sketch(view, DEPTHS, view.camera.centre)


def test_sketch_through_a_thin_plate_finds_the_camera_itself():
    camera = Camera((640, 480), 600, distortion=(-0.2, 0.05, 0, 0, 0))
    view = Setup(camera, Plate(1.5, distance=50.0, thickness=0.001)).rig()[0]
    for boundary in ("middle", "edge"):
        virtual = sketch(view, (500.0, 1000.0), boundary)
        assert virtual.camera.focal[0] == pytest.approx(600, rel=1e-4)  # a micrometre of glass
        assert virtual.departure_max < 0.01
