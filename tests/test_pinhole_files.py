"""Rigs of virtual cameras go to disk and come back the same."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from scenes import small_setup
from setups import BENT, OPTICS

from cyclopean import Camera, Setup
from cyclopean.errors import OutputError, SetupError
from cyclopean.files.pinholes import inside, polygons, read_pinholes, write_pinholes
from cyclopean.geometry import Pose
from cyclopean.rigs import PinholeView, Region, Rig, fit, pinhole_rig


def fitted(setup):
    rig = setup.rig()
    return pinhole_rig([fit(view, (300, 900)) for view in rig], rig)


@pytest.mark.parametrize(
    "setup",
    [small_setup(), small_setup(facets=2, radius=8.0), Setup(BENT, OPTICS["two mirrors"])],
    ids=["three facets", "a round biprism", "mirrors"],
)
def test_a_rig_comes_back_with_the_same_pixels(setup, tmp_path):
    rig = fitted(setup)
    path = tmp_path / "rig.toml"
    write_pinholes(rig, path)
    again = read_pinholes(path)
    assert [(v.name, v.mirrored, v.margin, v.shot, v.channel) for v in again] == [
        (v.name, v.mirrored, v.margin, v.shot, v.channel) for v in rig
    ]
    np.testing.assert_array_equal(again.masks, rig.masks)
    np.testing.assert_array_equal(again.facets, rig.facets)
    for one, other in zip(again, rig, strict=True):
        np.testing.assert_array_equal(one.camera.lens, other.camera.lens)
        # 1e-14 rad: into degrees and back
        np.testing.assert_allclose(one.camera_from_rig.rotation, other.camera_from_rig.rotation, rtol=0, atol=1e-14)
        np.testing.assert_array_equal(one.camera_from_rig.translation, other.camera_from_rig.translation)
    assert path.stat().st_size < 20_000  # outlines of few corners
    second = tmp_path / "again.toml"
    write_pinholes(again, second)
    np.testing.assert_array_equal(read_pinholes(second).masks, rig.masks)


@given(arrays(bool, (7, 9)))
def test_polygons_go_round_just_the_pixels_of_a_region(mask):
    np.testing.assert_array_equal(inside(polygons(Region(mask, 0.0)), (9, 7)), mask)


@given(st.lists(st.tuples(st.floats(-3, 12), st.floats(-3, 12)), min_size=3, max_size=8))
def test_pixels_inside_are_those_whose_ray_crosses_the_border_oddly(corners):
    outline = np.array(corners)
    found = inside([outline], (9, 7))
    for y in range(7):
        for x in range(9):
            odd = False
            for (x0, y0), (x1, y1) in zip(outline, np.roll(outline, -1, axis=0), strict=True):
                if (y0 <= y) != (y1 <= y):
                    at = x0 + (y - y0) * (x1 - x0) / (y1 - y0)
                    if abs(at - x) < 1e-9:
                        break  # on the border: either will do
                    odd ^= at < x
            else:
                assert found[y, x] == odd


def test_what_is_no_virtual_camera_is_not_written(tmp_path):
    with pytest.raises(OutputError, match="pinhole_rig"):
        write_pinholes(small_setup().rig(), tmp_path / "rig.toml")
    assert not (tmp_path / "rig.toml").exists()


GOOD = """\
kind = "virtual cameras"
size_px = [64, 48]
[[view]]
focal_px = [90, 91.5]
centre_px = [31.5, 23.5]
rotation_deg = [0, 5, 0]
translation_mm = [-10, 0, 0]
region_px = [[[-0.5, -0.5], [31.5, -0.5], [31.5, 47.5], [-0.5, 47.5]]]
"""


def test_a_file_written_by_hand_is_read(tmp_path):
    (tmp_path / "rig.toml").write_text(GOOD)
    (view,) = read_pinholes(tmp_path / "rig.toml")
    assert view.camera.distortion == (0, 0, 0, 0, 0)
    assert not view.mirrored
    np.testing.assert_array_equal(view.region.traced, np.tile(np.arange(64) <= 31, (48, 1)))
    np.testing.assert_allclose(view.centre, Pose.from_rotation_vector([0, np.deg2rad(-5), 0]) @ np.array([10.0, 0, 0]))


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ('"virtual cameras"', '"prism"', "read_setup"),
        ("size_px = [64, 48]", "size_px = [64]", r"size_px = \[64\] must be two whole numbers"),
        ("focal_px = [90, 91.5]", "", r"view\[0\].focal_px is missing: two numbers of px above 0"),
        ("focal_px = [90, 91.5]", "focal_px = [90, -1]", r"view\[0\].focal_px = \[90, -1\] must be two numbers"),
        ("centre_px", "center_px", r"view\[0\].center_px: unknown key; did you mean centre_px"),
        ("[[view]]", "[view]", "view = .* must be one table"),
        ("kind =", "kind", "not TOML"),
        ("[0, 5, 0]", "[0, nan, 0]", "must be three numbers of degrees"),
        ("region_px = [[[-0.5, -0.5], ", "region_px = [[[-0.5], ", "must be polygons"),
    ],
)
def test_faults_are_named(old, new, message, tmp_path):
    (tmp_path / "rig.toml").write_text(GOOD.replace(old, new))
    with pytest.raises(SetupError, match=message):
        read_pinholes(tmp_path / "rig.toml")


def test_an_absent_file_is_named(tmp_path):
    with pytest.raises(SetupError, match="no such file"):
        read_pinholes(tmp_path / "rig.toml")


def test_channels_and_shots_are_kept(tmp_path):
    view = PinholeView(
        Camera((64, 48), 90), Pose(np.eye(3), np.zeros(3)), Region(np.ones((48, 64), bool), 0.0), True, "ü", 2, 1
    )
    write_pinholes(Rig((view,)), tmp_path / "rig.toml")
    (again,) = read_pinholes(tmp_path / "rig.toml")
    assert (again.name, again.shot, again.channel, again.mirrored) == ("ü", 2, 1, True)
    assert again.region.mask.all()
