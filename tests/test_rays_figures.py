"""Ray figures: what is drawn is the true way of the light, and the virtual cameras are those of ray sketching."""

import numpy as np
import pytest
from matplotlib.figure import Figure
from matplotlib.path import Path as Outline

from cyclopean import Camera, Mirror, Mirrors, Plate, Prism, Setup
from cyclopean.errors import SetupError
from cyclopean.plotting.ray_maps import front_view, ray_map, virtual_camera_figure
from cyclopean.plotting.ray_parts import bundle, drawing_plane, sketched_cameras, solid_of
from cyclopean.plotting.rays import drawn_depths, section_figure, side_view
from cyclopean.rigs import sketch

CAMERA = Camera((320, 240), 600)
FOLDED = Mirrors((Mirror((60, 0, 300), (-0.9, 0, -0.3), (100, 150)), Mirror((-60, 0, 300), (0.9, 0, -0.3), (100, 150))))
SETUPS = {
    "biprism": Setup(CAMERA, Prism(2, 10.0, 1.5168, 60.0, thickness=6.0, radius=26.0)),
    "biprism without outline": Setup(CAMERA, Prism(2, 10.0, 1.5168, 60.0, azimuth_deg=20.0)),
    "three facets": Setup(CAMERA, Prism(3, 12.0, 1.5168, 60.0, thickness=7.0, radius=26.0, azimuth_deg=90.0)),
    "four facets, flipped": Setup(CAMERA, Prism(4, 12.0, 1.5168, 60.0, thickness=7.0, radius=26.0, facing="camera")),
    "five facets, tilted": Setup(CAMERA, Prism(5, 12.0, 1.5168, 60.0, tilt_deg=(2.0, -1.0, 0.5), shift=(0.6, -0.4))),
    "mirrors": Setup(CAMERA, FOLDED),
    "plate": Setup(CAMERA, Plate(1.5, 40.0, 15.0, radius=30.0, tilt_deg=(0.0, 20.0, 0.0))),
}
DEPTHS = (300.0, 700.0)


def axes_of(figure=None):
    return (figure or Figure()).subplots()


@pytest.mark.parametrize("name", SETUPS)
def test_drawn_rays_obey_the_laws(name):
    setup = SETUPS[name]
    rig, plane = setup.rig(), drawing_plane(setup)
    for k, (view, path) in enumerate(zip(rig, setup.optic.paths(setup.wavelength_nm), strict=True)):
        drawn = bundle(setup, rig, k, plane, 5)
        assert len(drawn.trails) == 5
        steps = np.diff(drawn.trails, axis=1)
        steps /= np.linalg.norm(steps, axis=-1, keepdims=True)
        steps = np.concatenate([steps, drawn.directions[:, None]], axis=1)
        index = path.index_start
        for s, surface in enumerate(path.interfaces):
            before, after = np.cross(steps[:, s], surface.normal), np.cross(steps[:, s + 1], surface.normal)
            if surface.act == "reflect":
                after, index_after = after, index
                assert (np.sign(steps[:, s] @ surface.normal) == -np.sign(steps[:, s + 1] @ surface.normal)).all()
            else:
                index_after = surface.index_after
            # 1e-9: a direction from points 10 mm apart, known to 1e-14
            np.testing.assert_allclose(index * before, index_after * after, atol=1e-9)
            index = index_after
        ahead = drawn.trails[:, -1] + 200.0 * drawn.directions
        start = view.camera.project(drawn.trails[:, 1] if path.interfaces else drawn.directions)
        # the two at the ends lie on the border of the sub-image; 1e-6 px is what projection solves to
        np.testing.assert_allclose(view.project(ahead[1:-1]), start[1:-1], atol=1e-6)


@pytest.mark.parametrize("name", SETUPS)
def test_virtual_cameras_are_those_of_ray_sketching(name):
    setup = SETUPS[name]
    rig = setup.rig()
    for boundary in ("middle", "edge"):
        for view, found in zip(rig, sketched_cameras(setup, rig, boundary), strict=True):
            wanted = sketch(view, DEPTHS if len(rig) > 1 else (100.0, 700.0), boundary)
            np.testing.assert_allclose(found.centre, wanted.centre, atol=1e-9)
            np.testing.assert_allclose(found.axis, wanted.axis, atol=1e-12)
            assert found.focal == pytest.approx(wanted.camera.focal[0])
            np.testing.assert_allclose(found.segment.mean(0), found.centre, atol=1e-9)
            assert np.linalg.norm(found.segment[1] - found.segment[0]) == pytest.approx(found.gap, abs=1e-12)


def test_virtual_axes_of_a_biprism_leave_by_the_closed_form():
    setup = SETUPS["biprism"]
    alpha = np.deg2rad(10.0)
    deviation = np.arcsin(1.5168 * np.sin(alpha)) - alpha  # flat face towards the camera
    cameras = sketched_cameras(setup, setup.rig())
    for camera, side in zip(cameras, (1, -1), strict=True):
        np.testing.assert_allclose(camera.axis, [-side * np.sin(deviation), 0.0, np.cos(deviation)], atol=1e-12)
        crossing = camera.centre + (66.0 - camera.centre[2]) / camera.axis[2] * camera.axis
        # the axes cross at the apex; the boundary ray is a pixel of the outline, a px off the plane of symmetry at
        # most, so off it by a part of 1/600 rad times the 1.3 mm by which light through this glass is shifted
        np.testing.assert_allclose(crossing, [0, 0, 66.0], atol=2.5e-3)
        assert camera.gap < 5e-3
    assert all(camera.gap > 2e-2 for camera in sketched_cameras(setup, setup.rig(), "edge"))


@pytest.mark.parametrize("name", SETUPS)
def test_side_views_are_in_one_scale_and_hold_the_light(name):
    setup = SETUPS[name]
    axes = axes_of()
    side_view(axes, setup, depths=DEPTHS, until=200.0)
    assert axes.get_aspect() == 1.0
    low, high = sorted(axes.get_ylim())
    rig = setup.rig()
    for k in range(len(rig)):
        trails = drawing_plane(setup).flat(bundle(setup, rig, k, drawing_plane(setup), 5).trails)
        assert low < trails[..., 1].min()
        assert trails[..., 1].max() < high
        on_the_sheet = [np.asarray(line.get_xydata()) for line in axes.lines]
        for trail in trails:  # each is there as it is, with its way on into the scene
            assert any(len(line) > len(trail) and np.allclose(line[: len(trail)], trail) for line in on_the_sheet)


@pytest.mark.parametrize("name", ["biprism", "three facets", "four facets, flipped", "five facets, tilted"])
def test_the_glass_is_drawn_where_it_is(name):
    setup = SETUPS[name]
    axes, cut = axes_of(), drawing_plane(setup)
    side_view(axes, setup, depths=DEPTHS, field=False, virtual=False)
    (glass,) = axes.patches
    corners = cut.lifted(glass.get_xy())
    solid = solid_of(setup, setup.rig())
    normals, offsets = solid.planes
    depth = solid.from_rig(corners) @ normals.T - offsets
    assert depth.max() < 1e-9  # inside the glass
    assert np.abs(depth).min(1).max() < 1e-9  # and on its skin
    assert glass.get_path().contains_point(cut.flat(solid.in_rig(solid.vertices.mean(0))))


def test_the_shaded_field_is_what_both_views_see():
    setup = SETUPS["biprism"]
    axes, rig = axes_of(), setup.rig()
    side_view(axes, setup, depths=DEPTHS, until=400.0)
    shaded = next(c for c in axes.collections if c.get_paths())
    half = axes.get_ylim()[1]
    points = np.random.default_rng(2).uniform((70.0, -half), (395.0, half), (400, 2))
    cut = drawing_plane(setup)
    near = np.stack([cut.lifted(points + np.array([0.0, step])) for step in (-0.03 * half, 0.0, 0.03 * half)])
    seen = np.isfinite(rig.project(near)[..., 0]).all(-1)
    plain = (seen[0] == seen[1]) & (seen[1] == seen[2])  # not beside the border, which is drawn to a cell
    inside = np.any([Outline(p.vertices, p.codes).contains_points(points) for p in shaded.get_paths()], axis=0)
    np.testing.assert_array_equal(inside[plain], seen[1][plain])
    assert seen[1].sum() > 30
    assert plain.sum() > 300


def test_planes_and_their_names():
    setup = SETUPS["four facets, flipped"]
    # facets towards the camera: the solid is turned about y, so facet 0 stands at the left
    np.testing.assert_allclose(np.abs(drawing_plane(setup).across), [1, 0, 0], atol=1e-9)
    assert drawing_plane(setup, "yz").label == "y (mm)"
    assert drawing_plane(setup, np.deg2rad(30)).label == "across, at 30 degrees from x (mm)"
    plane = drawing_plane(setup, 0.3)
    points = plane.lifted(np.array([[10.0, -2.0]]))
    np.testing.assert_allclose(plane.flat(points), [[10.0, -2.0]])
    np.testing.assert_allclose(points @ plane.normal, 0.0, atol=1e-12)
    for wrong in ("top", np.nan):
        with pytest.raises(SetupError, match="azimuth"):
            drawing_plane(setup, wrong)


def test_depths_are_those_given_or_useful_ones():
    setup = SETUPS["biprism"]
    rig = setup.rig()
    assert drawn_depths(setup, rig, (10.0, 20.0)) == (10.0, 20.0)
    near, far = drawn_depths(setup, rig, None)
    assert near == rig.working_depths[0]
    assert near < far <= rig.working_depths[1]
    plate = SETUPS["plate"]  # one view has no working depths
    near, far = drawn_depths(plate, plate.rig(), None)
    assert 55.0 < near < far
    for wrong in ((20.0, 10.0), (np.nan, 5.0)):
        with pytest.raises(SetupError, match="0 < near < far"):
            drawn_depths(setup, rig, wrong)
    with pytest.raises(SetupError, match="one ray"):
        side_view(axes_of(), setup, rays=0)


def test_the_front_view_shows_where_light_passes():
    setup = SETUPS["three facets"]
    axes = axes_of()
    front_view(axes, setup)
    assert axes.yaxis_inverted()  # y runs down, as in the picture
    filled = [patch.get_xy() for patch in axes.patches]
    assert len(filled) == 3
    for polygon, view in zip(filled, setup.rig(), strict=True):
        hits = view.rays(view.region.centre).origins[:2]  # on the facet
        assert Outline(polygon).contains_point(hits)


@pytest.mark.parametrize("name", ["biprism without outline", "five facets, tilted", "mirrors", "plate"])
def test_every_figure_is_made(name, tmp_path, recwarn):
    setup = SETUPS[name]
    for k, figure in enumerate((section_figure(setup, DEPTHS), ray_map(setup, DEPTHS), virtual_camera_figure(setup))):
        figure.savefig(tmp_path / f"{k}.png", dpi=40)
    texts = [cell.get_text().get_text() for cell in figure.axes[1].tables[0].get_celld().values()]
    cameras = sketched_cameras(setup, setup.rig(), "edge")
    assert all(f"{camera.gap:.4f}" in texts for camera in cameras)
    assert not recwarn.list
