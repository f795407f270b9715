"""The command simulate as a person meets it."""

import json

import numpy as np
import pytest
from commands import run

from cyclopean import read_photograph, read_setup
from cyclopean.errors import ImageError
from cyclopean.files import read_board
from cyclopean.files.truths import read_truth
from cyclopean.geometry import Pose, rotation_from_vector
from cyclopean.targets import observe

SETUP = """\
[camera]
size_px = [{width}, {height}]
focal_px = {focal}
pixel_pitch_um = 20
{lens}

[optic]
kind = "prism"
facets = 2
apex_deg = 12.0
glass = "N-BK7"
distance_mm = 60.0

[scene]
depth_mm = [400, 700]
"""
LENS = "f_number = 8\nfocus_distance_mm = 600"
SCENE = """\
[[object]]
kind = "plane"
size_mm = [4000, 3000]
centre_mm = [0, 0, 600]
rotation_deg = [0, 20, 0]
texture = "speckle"
texture_size_mm = 9

[[object]]
name = "ball"
kind = "sphere"
radius_mm = 30
centre_mm = [0, 0, 480]
grey = 0.4

[[object]]
kind = "box"
size_mm = [10, 10, 10]
centre_mm = [0, 0, -300]
"""


def write_setup(path, width=160, height=120, focal=300, lens=""):
    path.write_text(SETUP.format(width=width, height=height, focal=focal, lens=lens), encoding="utf-8")
    return path


@pytest.fixture
def simulate(tmp_path, monkeypatch, capsys):
    """Run ``cyclopean simulate`` on the small setup in an empty folder."""
    monkeypatch.chdir(tmp_path)
    write_setup(tmp_path / "setup.toml")
    (tmp_path / "scene.toml").write_text(SCENE, encoding="utf-8")

    def call(*words):
        status, said, wrong = run(monkeypatch, capsys, "simulate", *words)
        return status, " ".join(said.split()), " ".join(wrong.split())

    return call


def test_a_photograph_comes_with_what_is_true_in_it(simulate, tmp_path):
    words = "--scene", "scene.toml", "--samples", "4", "--bits", "12", "--matches", "300"
    status, said, _ = simulate("setup.toml", *words, "-o", "out/photo.png")
    assert status == 0
    assert "3 objects" in said
    assert "160 x 120 px, 4 rays a pixel: 0.0768 million rays" in said
    assert "no f_number and focus_distance_mm" in said
    assert "object 3 (box) lies behind the camera" in said
    assert {path.name for path in (tmp_path / "out").iterdir()} == {"photo.png", "photo_truth.npz", "photo_truth.png"}
    photo = read_photograph(tmp_path / "out/photo.png", (160, 120))
    assert photo.dtype == np.uint16
    assert 2048 < photo.max() < 4096
    truth = read_truth(tmp_path / "out/photo_truth.npz")
    rig = read_setup(tmp_path / "setup.toml").rig()
    wall = truth["object"] == 0
    assert 0.5 < wall.mean() < 0.97
    assert truth["object_names"].tolist() == ["object 1 (plane)", "ball", "object 3 (box)"]
    normal, middle = rotation_from_vector([0, np.deg2rad(20), 0])[:, 2], np.array([0.0, 0.0, 600.0])
    for k, view in enumerate(rig):
        rows, columns = np.nonzero(wall & (truth["facet"] == k))
        rays = view.rays(np.stack([columns, rows], -1))
        points = rays.at(((middle - rays.origins) @ normal) / (rays.directions @ normal))
        np.testing.assert_allclose(truth["depth"][rows, columns], points[:, 2], atol=1e-6)  # mm; rounding
        np.testing.assert_allclose(truth["xyz"][rows, columns], points, atol=1e-4)  # float32 of 600 mm
    seen = truth["match_uv"]
    np.testing.assert_array_equal(truth["facet"], rig.facets)
    own = seen[np.arange(len(seen)), truth["match_from"]]
    assert np.isfinite(own).all(-1).mean() > 0.95  # but for those in the last hair before an edge
    known = np.isfinite(seen)
    np.testing.assert_allclose(seen[known], rig.project(truth["match_xyz"])[known], atol=1e-6)
    assert known.all((1, 2)).mean() > 0.2


def test_noise_and_colour_are_as_asked(simulate, tmp_path):
    write_setup(tmp_path / "setup.toml", lens=LENS)
    words = "setup.toml", "--scene", "scene.toml", "--samples", "4", "--no-truth", "--exposure", "0.8"
    for name, more in (
        ("a", ()),
        ("b", ("--noise", "4")),
        ("c", ("--noise", "4", "--seed", "5")),
        ("d", ("--colour",)),
    ):
        status, said, _ = simulate(*words, *more, "-o", f"{name}.tif")
        assert status == 0
        assert "pinhole" not in said
    clean, noisy, other, coloured = (read_photograph(tmp_path / f"{name}.tif").astype(float) for name in "abcd")
    # full and dark pixels cut the noise; 1 % for 19 200 pixels and the rounding
    middle = (clean > 20) & (clean < 235)
    assert (noisy - clean)[middle].std() == pytest.approx(4.0, rel=0.04)
    assert (noisy != other).mean() > 0.5
    assert coloured.shape == (120, 160, 3)
    assert (coloured[..., 0] != coloured[..., 2]).mean() > 0.05  # the glass splits colours
    assert not list(tmp_path.glob("*truth*"))


def test_without_a_scene_there_is_one_to_see_and_to_change(simulate, tmp_path):
    status, said, _ = simulate("setup.toml", "--preview")
    assert status == 0
    assert "no --scene: a speckled wall and a ball between 400 and 700 mm" in said
    assert "2 rays a pixel" in said
    photo = read_photograph(tmp_path / "photo.png")
    assert photo.std() > 30  # speckles from 0.1 to 0.8
    assert (photo == 0).mean() < 0.01  # the wall fills it
    assert simulate("setup.toml", "--write-scene", "mine.toml")[0] == 0
    assert simulate("setup.toml", "--scene", "mine.toml", "--preview", "-o", "same.png")[0] == 0
    assert (read_photograph(tmp_path / "same.png") == photo).all()
    status, _, wrong = simulate("setup.toml", "--write-scene", "mine.toml")
    assert status == 2
    assert "mine.toml is there already" in wrong


def test_photographs_for_a_calibration_show_the_board_where_the_poses_say(simulate, tmp_path):
    write_setup(tmp_path / "setup.toml", 480, 360, 900)
    (tmp_path / "board.toml").write_text('[board]\nkind = "chessboard"\ncolumns = 6\nrows = 5\nsquare = 9.0\n')
    words = "--calibration", "1", "--direct", "1", "--board", "board.toml", "--samples", "8", "-o", "calib"
    status, said, _ = simulate("setup.toml", *words)
    assert status == 0
    assert "cyclopean calibrate calib --board calib/board.toml --setup setup.toml --camera-photos calib/direct" in said
    setup, board = read_setup(tmp_path / "setup.toml"), read_board(tmp_path / "calib/board.toml")
    through, direct = json.loads((tmp_path / "calib/poses.json").read_text())["photographs"]
    assert (through["file"], through["through_optic"]) == ("board_00.png", True)
    assert (direct["file"], direct["through_optic"]) == ("direct/direct_00.png", False)
    rig = setup.rig()
    for place, masks in ((through, rig.masks), (direct, None)):
        photo = read_photograph(tmp_path / "calib" / place["file"], setup.camera.size)
        found, _ = observe([("photo", photo)], board, masks)
        points = Pose(np.array(place["rotation"]), np.array(place["translation_mm"])) @ board.points
        views = rig.project(points) if masks is not None else setup.camera.project(points)[:, None]
        miss = found.pixels - views[found.point, np.maximum(found.view, 0)]
        assert len(found) >= 20
        assert np.sqrt(np.mean(miss**2)) < 0.05  # px; 8 rays a pixel leave 0.02, 32 leave 0.01
    status, _, wrong = simulate("setup.toml", "--calibration", "0", "--direct", "1", "-o", "calib")
    assert status == 2
    assert "calib holds other photographs, such as board_00.png" in wrong


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("gone.toml",), "gone.toml: there is no such file"),
        (("setup.toml", "--scene", "gone.toml"), "gone.toml: there is no such file"),
        (("setup.toml", "-o", "photo.jpg"), "must end in .png"),
        (("setup.toml", "-o", "folder.png"), "is a folder"),
        (("setup.toml", "--seed", "9" * 30), "--seed must be"),
        (("plate.toml", "--calibration", "2"), "two views or more"),
        (("setup.toml", "--samples", "0"), "--samples must be 1 or more"),
        (("setup.toml", "--samples", "2.5"), "whole number"),
        (("setup.toml", "--bits", "10"), "8, 12, 16"),
        (("setup.toml", "--noise", "nan"), "noise must be a number of 0 or more"),
        (("setup.toml", "--read-noise", "3"), "full well"),
        (("setup.toml", "--coating", "120"), "--coating is a loss in percent"),
        (("setup.toml", "--direct", "3"), "--direct belongs to --calibration"),
        (("setup.toml", "--calibration", "0"), "1 or more"),
        (("setup.toml", "--calibration", "2", "--scene", "scene.toml"), "leave --scene"),
        (("setup.toml", "--calibration", "2", "--without-optic"), "--direct M"),
        (("setup.toml", "--depth", "30..100"), "lies inside the optic"),
        (("setup.toml", "--depth", "400..600", "--scene", "scene.toml"), "where there is no --scene"),
        (("setup.toml", "--scene", "scene.toml", "--write-scene", "b.toml"), "one of them"),
        (("setup.toml", "--scene", "inside.toml"), "glass sheet"),
        (("setup.toml", "--scene", "behind.toml"), "behind the camera"),
    ],
)
def test_what_makes_no_sense_is_refused(simulate, tmp_path, words, said):
    sheet = '[[object]]\nname = "{}"\nkind = "plane"\nsize_mm = [90, 90]\ncentre_mm = [0, 0, {}]\n'
    (tmp_path / "inside.toml").write_text(sheet.format("glass sheet", 30))
    (tmp_path / "behind.toml").write_text(sheet.format("sheet", -30))
    (tmp_path / "folder.png").mkdir()
    plate = 'kind = "plate"\nindex = 1.5\ndistance_mm = 50\nthickness_mm = 10\n'
    (tmp_path / "plate.toml").write_text(f"[camera]\nsize_px = [40, 30]\nfocal_px = 90\n[optic]\n{plate}")
    status, _, wrong = simulate(*words)
    assert status in (1, 2)
    assert said in wrong
    assert not (tmp_path / "photo.png").exists()


def test_what_is_no_truth_is_refused(tmp_path):
    (tmp_path / "a.npz").write_text("hello")
    np.savez(tmp_path / "b.npz", depth=np.zeros((2, 2)))
    for name, said in (("a.npz", "no NPZ file"), ("b.npz", "it holds no xyz"), ("c.npz", "no such file")):
        with pytest.raises(ImageError, match=said):
            read_truth(tmp_path / name)
