"""`cyclopean tolerance` and `cyclopean model-error` as a person meets them."""

import csv

import numpy as np
import pytest
from commands import run
from setups import SETUPS

from cyclopean.files import write_setup

SETUP = """
[camera]
size_px = [640, 480]
focal_px = 1200.0

[optic]
kind = "prism"
facets = 2
apex_deg = 12.0
glass = "N-BK7"
distance_mm = 60.0
thickness_mm = 8.0

[scene]
depth_mm = [450.0, 900.0]
"""
PLATE = """
[camera]
size_px = [640, 480]
focal_px = 900.0

[optic]
kind = "plate"
glass = "N-BK7"
distance_mm = 40.0
thickness_mm = 15.0
"""
BOARD = """
[board]
kind = "chessboard"
columns = 8
rows = 6
square = 10.0
"""


@pytest.fixture
def setup_file(tmp_path):
    path = tmp_path / "setup.toml"
    path.write_text(SETUP)
    return path


def rows_of(path):
    with open(path, newline="") as file:
        return list(csv.DictReader(file))


def test_tolerance_writes_all_its_results(setup_file, tmp_path, monkeypatch, capsys):
    out = tmp_path / "out"
    status, said, wrong = run(
        monkeypatch, capsys, "tolerance", setup_file, "--draws", 120, "--seed", 3, "--require", 2, "-o", out
    )
    assert (status, wrong) == (0, "")
    assert {path.name for path in out.iterdir()} == {"tolerances.png", "tolerances.csv", "draws.npz", "report.html"}
    rows = rows_of(out / "tolerances.csv")
    assert [row["calibration"] for row in rows] == ["before"] * 5 + ["after"] * 5
    assert [float(row["depth_mm"]) for row in rows[:5]] == pytest.approx(np.geomspace(450, 900, 5), rel=1e-3)
    with np.load(out / "draws.npz") as drawn:
        errors, plane = drawn["errors_before"], drawn["plane"]
        assert drawn["deviations"].shape == (120, len(drawn["names"]))
    # figures of the table are those of the draws; 1e-4: they are kept in single precision
    sizes = np.abs(errors[:, plane == 0])
    assert float(rows[0]["abs_error_95_percent_mm"]) == pytest.approx(np.nanquantile(sizes, 0.95), rel=1e-4)
    share = np.mean(np.nanmax(sizes, axis=1) <= 0.02 * 450)
    assert float(rows[0]["share_under_2_percent"]) == pytest.approx(share)
    for word in ("120 setups", "optic.apex", "noise of corners", "under 2 %"):
        assert word in said
    assert "data:image/png" in (out / "report.html").read_text()


def test_the_same_seed_gives_the_same_table(setup_file, tmp_path, monkeypatch, capsys):
    tables = []
    for name in "ab":
        words = ("--draws", 30, "--photos", 0, "--seed", 1, "-o", tmp_path / name)
        assert run(monkeypatch, capsys, "tolerance", setup_file, *words)[0] == 0
        tables.append((tmp_path / name / "tolerances.csv").read_text())
    assert tables[0] == tables[1]
    assert "after" not in tables[0]


def test_tolerances_take_units_and_shapes(setup_file, tmp_path, monkeypatch, capsys):
    out = tmp_path / "out"
    given = "optic.distance=0.5 mm,optic.facets=0.02:uniform,optic.index=0.001:truncated,camera.centre=0"
    words = ("--draws", 400, "--no-usual", "--tolerance", given, "--photos", 0, "--depth", "500..800", "-o", out)
    status, said, _ = run(monkeypatch, capsys, "tolerance", setup_file, *words)
    assert status == 0
    with np.load(out / "draws.npz") as drawn:
        deviations = dict(zip(drawn["names"].tolist(), drawn["deviations"].T, strict=True))
    assert 0.4 < deviations["optic.distance"].std() < 0.6
    assert 0.9 * np.deg2rad(0.02) < np.abs(deviations["optic.facet1_azimuth"]).max() <= np.deg2rad(0.02)
    assert np.abs(deviations["optic.index"]).max() <= 0.001
    assert not deviations["camera.centre_x"].any()
    assert "optic.apex" not in deviations
    assert "± 1.2 arcmin, uniform" in said


def test_board_and_photographs_without_the_optic(setup_file, tmp_path, monkeypatch, capsys):
    board = tmp_path / "board.toml"
    board.write_text(BOARD)
    words = ("--draws", 30, "--board", board, "--photos", 6, "--camera-photos", 4, "-o", tmp_path / "out")
    status, said, _ = run(monkeypatch, capsys, "tolerance", setup_file, *words)
    assert status == 0
    assert "6 photographs through the optic and 4 without it of a chessboard of 8 x 6 squares" in " ".join(said.split())


def test_what_calibration_takes_as_drawn_is_told(setup_file, tmp_path, monkeypatch, capsys):
    words = ("--draws", 30, "--tolerance", "camera.focal_tied=12", "-o", tmp_path / "out")
    status, said, _ = run(monkeypatch, capsys, "tolerance", setup_file, *words)
    assert status == 0
    assert "comes from camera.focal_tied, which it takes as drawn" in " ".join(said.split())
    assert "--camera-photos" in said


def test_mirrors_have_tolerances_too(tmp_path, monkeypatch, capsys):
    mirrors = tmp_path / "mirrors.toml"
    write_setup(SETUPS["two mirrors, straight lens"], mirrors)
    assert run(monkeypatch, capsys, "tolerance", mirrors, "--draws", 10, "-o", tmp_path / "a")[0] == 0


def test_setups_without_depth_are_told(setup_file, tmp_path, monkeypatch, capsys):
    wild = ("--draws", 60, "--tolerance", "optic.apex=8,optic.tilt_x=20", "--noise-px", 0.1, "--depth", "500..2000")
    status, said, wrong = run(monkeypatch, capsys, "tolerance", setup_file, *wild, "-o", tmp_path / "out")
    assert (status, wrong) == (0, "")
    said = " ".join(said.split())
    for words in ("give no depth at all", "of the points get no depth before calibration", "too wide for first-order"):
        assert words in said


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("--draws", 1), "2 draws or more"),
        (("--draws", 10_000_000), "memory"),
        (("--tolerance", "optic.apex"), "NAME=VALUE"),
        (("--tolerance", "optic.apex=wide"), "NAME=VALUE"),
        (("--tolerance", "optic.apex=-1"), "NAME=VALUE"),
        (("--tolerance", "optic.apex=1:flat"), "normal, uniform, truncated"),
        (("--tolerance", "optic.apx=1"), "optic.apex"),
        (("--tolerance", "optic.apx=0"), "optic.apex"),
        (("--tolerance", "optic.apex=1mm"), "is in deg"),
        (("--no-usual",), "nothing to draw"),
        (("--depth", "900..500"), "NEAR < FAR"),
        (("--depth", "1..2"), "inside the optic"),
        (("--no-usual", "--tolerance", "optic.apex=0"), "every tolerance is 0"),
        (("--no-usual", "--tolerance", "optic.distance=1e6", "--photos", 0), "the tolerance of optic.distance is too"),
        (("--require", 0), "positive percentage"),
        (("--noise-px", "nan"), "pixel noise"),
        (("--photos", -2), "0 or more"),
        (("--photos", 0, "--free", "optic.apex"), "no calibration"),
        (("--corner-noise-px", 0), "noise of corners"),
        (("--free", "optic.apx"), "optic.apex"),
        (("--seed", -1), "--seed"),
        (("--board", "nowhere.toml"), "nowhere.toml"),
    ],
)
def test_wrong_options_of_tolerance(words, said, setup_file, tmp_path, monkeypatch, capsys):
    few = () if "--draws" in words else ("--draws", 4)
    given = ("tolerance", setup_file, *few, "-o", tmp_path / "out", *words)
    status, _, wrong = run(monkeypatch, capsys, *given)
    assert status == 2
    assert said in " ".join(wrong.split())
    assert len(wrong.strip().splitlines()) < 4


@pytest.mark.parametrize(("command", "few"), [("tolerance", ("--draws", 10, "--photos", 0)), ("model-error", ())])
def test_depths_without_a_common_field_are_named(command, few, setup_file, tmp_path, monkeypatch, capsys):
    words = (command, setup_file, *few, "-o", tmp_path / "out", "--depth")
    status, said, wrong = run(monkeypatch, capsys, *words, "68.1..600")
    assert (status, wrong) == (0, "")
    assert "anything at 68.1 mm: left out" in " ".join(said.split())
    status, _, wrong = run(monkeypatch, capsys, *words, "10..600")
    assert status == 2
    assert "inside the optic" in wrong


@pytest.mark.parametrize("command", ["tolerance", "model-error"])
def test_setups_that_cannot_be(command, tmp_path, monkeypatch, capsys):
    plate = tmp_path / "plate.toml"
    plate.write_text(PLATE)
    for file, said in ((plate, "two views or more"), (tmp_path / "none.toml", "no such file")):
        status, _, wrong = run(monkeypatch, capsys, command, file, "-o", tmp_path / "out")
        assert status == 2
        assert said in wrong
    assert not (tmp_path / "out").exists()


def test_model_error_writes_table_and_picture(setup_file, tmp_path, monkeypatch, capsys):
    out = tmp_path / "out"
    status, said, wrong = run(monkeypatch, capsys, "model-error", setup_file, "-o", out)
    assert (status, wrong) == (0, "")
    assert {path.name for path in out.iterdir()} == {"model_error.png", "model_error.csv"}
    rows = rows_of(out / "model_error.csv")
    assert [row["method"] for row in rows] == ["sketch"] * 9 + ["fit"] * 9 + ["distortion"] * 9
    rms = {row["method"]: float(row["rms_percent"]) for row in rows if row["depth_mm"] == rows[4]["depth_mm"]}
    assert rms["distortion"] < min(rms["fit"], rms["sketch"])
    assert "ray sketch" in said


def test_model_error_of_one_method_and_wrong_depths(setup_file, tmp_path, monkeypatch, capsys):
    words = ("--method", "fit", "--depth", "500..800", "--fit-depth", "600..700", "-o", tmp_path / "out")
    assert run(monkeypatch, capsys, "model-error", setup_file, *words)[0] == 0
    assert {row["method"] for row in rows_of(tmp_path / "out" / "model_error.csv")} == {"fit"}
    status, _, wrong = run(monkeypatch, capsys, "model-error", setup_file, "--fit-depth", "700..600")
    assert status == 2
    assert "NEAR < FAR" in wrong
