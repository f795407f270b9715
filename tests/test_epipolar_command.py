"""`cyclopean epipolar` as a person meets it."""

import csv
import json
import re
import warnings

import cv2
import numpy as np
import pytest
from commands import run
from setups import SETUPS

from cyclopean import Camera, Mirror, Mirrors, Plate, Prism, Setup, write_setup
from cyclopean.errors import SetupError

BIPRISM = Setup(Camera((640, 480), 1200), Prism(2, 10, 1.5168, 60))


@pytest.fixture
def setup_file(tmp_path):
    path = tmp_path / "setup.toml"
    write_setup(BIPRISM, path)
    return path


def test_command_writes_picture_and_samples(monkeypatch, capsys, tmp_path, setup_file):
    out = tmp_path / "out"
    words = ["epipolar", "--setup", setup_file, "--pixel", "150,240", "--pixel", "500,200", "--depth", "300..900"]
    status, printed, _ = run(monkeypatch, capsys, *words, "-o", out)
    assert status == 0
    assert "pixel 0 at (150, 240) in" in printed
    picture = cv2.imread(str(out / "epipolar.png"))
    assert picture.shape[1] > 1000
    with open(out / "epipolar.csv") as file:
        rows = list(csv.DictReader(file))
    rig = BIPRISM.rig()
    assert {row["pixel"] for row in rows} == {"0", "1"}
    for row in rows[::7]:
        point = [float(row[f"{key}_mm"]) for key in ("point_x", "point_y", "depth")]
        # 1e-3 px: seven digits of points 900 mm away
        np.testing.assert_allclose(
            rig[int(row["other_view"])].project(point), [float(row["other_x_px"]), float(row["other_y_px"])], atol=1e-3
        )
        np.testing.assert_allclose(
            rig[int(row["view"])].project(point), [float(row["x_px"]), float(row["y_px"])], atol=1e-3
        )


def test_command_takes_a_photograph_and_a_calibration(monkeypatch, capsys, tmp_path, setup_file):
    photo, calibration = tmp_path / "photo.png", tmp_path / "calibration.json"
    cv2.imwrite(str(photo), np.full((480, 640), 90, np.uint8))
    names = ["camera.focal_tied", "optic.tilt_z"]
    document = {
        "kind": "cyclopean calibration",
        "parameters": [{"name": name} for name in names],
        "covariance": [[4.0, 0.0], [0.0, 1e-6]],
    }
    calibration.write_text(json.dumps(document))
    words = ["epipolar", photo, "--setup", setup_file, "--depth", "300..900", "--pixel", "150,400"]
    words += ["-o", tmp_path / "out"]
    spreads = []
    for more in ([], ["--calibration", calibration]):
        assert run(monkeypatch, capsys, *words, *more)[0] == 0
        with open(tmp_path / "out" / "epipolar.csv") as file:
            spreads.append([float(row["sigma_across_px"]) for row in csv.DictReader(file)])
    assert (np.array(spreads[1]) > np.array(spreads[0])).all()
    document["covariance"][0][0] = None
    calibration.write_text(json.dumps(document))
    status, _, errors = run(monkeypatch, capsys, *words, "--calibration", calibration)
    assert status == 2
    assert "parts of the covariance are not known" in errors


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--pixel", "150"], "--pixel wants X,Y in px"),
        (["--pixel", "nan,3"], "--pixel wants two numbers"),
        (["--pixel", "9000,3"], "is not on the photograph of 640 x 480 px"),
        (["--pixel", "150,240", "--view", "1"], "lies in view"),
        (["--view", "7"], "--view must be 0 to 1, got 7"),
        (["--depth", "900..300"], "0 < NEAR < FAR"),
        (["--depth", "1e-3..1e9"], "inside the optic"),
        (["--noise-px", "-1"], "pixel noise"),
        (["missing.png"], "there is no such file"),
        (["--calibration", "missing.json"], "there is no such file"),
    ],
)
def test_command_explains_what_is_wrong(monkeypatch, capsys, tmp_path, setup_file, words, message):
    if "--view" in words and words[-1] == "1":
        rig = BIPRISM.rig()
        words = [*words[:-1], "1" if rig[0].region.contains([150, 240]) else "0"]
    status, _, errors = run(monkeypatch, capsys, "epipolar", *words, "--setup", setup_file, "-o", tmp_path / "out")
    assert status == 2
    assert message in " ".join(errors.split())


def test_command_wants_a_second_view(monkeypatch, capsys, tmp_path):
    path = tmp_path / "plate.toml"
    write_setup(Setup(Camera((640, 480), 900), Plate(1.5, 40, 8)), path)
    status, _, errors = run(monkeypatch, capsys, "epipolar", "--setup", path, "-o", tmp_path / "out")
    assert status == 2
    assert "need a second one" in errors


def test_depths_begin_behind_the_optic():
    """Whatever the optic, points just behind the limit that the message names are on rays of two views."""
    for name, setup in SETUPS.items():
        rig = setup.rig()
        with pytest.raises(SetupError, match="inside the optic") as told:
            rig.check_depths((1.0, 1e6))
        near = float(re.search(r"use ([\d.]+) mm", str(told.value))[1])
        assert rig.check_depths((near, 1e6)) == (near, 1e6), name
        started = [np.isfinite(view.rays(pixels_of(view)).at_depth(near)).all(-1) for view in rig]
        assert sum(rays.any() for rays in started) >= min(2, len(rig))
    for wrong in ((900, 300), (-5, 300), (300, np.inf), (np.nan, 300), (300,), 300):
        with pytest.raises(SetupError, match="near"):
            rig.check_depths(wrong)


def test_beside_a_mirror_there_may_be_a_scene():
    """A wall mirror from 50 to 450 mm beside the axis: what lies at 300 mm is seen directly and in the mirror."""
    wall = Mirrors((Mirror((40, 0, 250), (-1, 0, 0), (400, 300)),), ((0,),), direct=True)
    rig = Setup(Camera((640, 480), 900), wall).rig()
    assert rig.check_depths((300, 900)) == (300.0, 900.0)


def test_curves_of_a_short_range_are_drawn_without_a_warning(monkeypatch, capsys, tmp_path, setup_file):
    with warnings.catch_warnings():
        warnings.simplefilter("error", UserWarning)
        rig = BIPRISM.rig()
        near = rig._last_surface + 0.1
        words = ("epipolar", "--setup", setup_file, "--depth", f"{near}..{near + 0.1}", "-o", tmp_path)
        status, _, errors = run(monkeypatch, capsys, *words)
    assert status in (0, 2)
    assert "Warning" not in errors


def pixels_of(view):
    y, x = np.nonzero(view.region.mask)
    return np.stack([x, y], -1)[::97].astype(float)
