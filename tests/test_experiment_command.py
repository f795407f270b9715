"""``cyclopean experiment`` as a person types it."""

import csv
import io
import json
import re

import pytest

from cyclopean import Camera, Prism, Setup, write_setup
from cyclopean.optics import Plate
from tests.commands import run

RIGHT = ("--corner-noise-px", "0", "--drawing-apex-deg", "0", "--drawing-distance", "0", "--drawing-tilt-deg", "0")
QUICK = ("--depths", "700,1000", "--photos", "4")
FILES = ("table.csv", "table.md", "table.tex", "errors.png", "cameras.png", "ray_map.png", "boards.png",
         "disparity.png", "epipolar.png", "report.html")  # fmt: skip


@pytest.fixture(scope="module")
def small(tmp_path_factory):
    """A setup file with a small camera and five facets."""
    path = tmp_path_factory.mktemp("experiment") / "five.toml"
    write_setup(Setup(Camera((640, 480), 1200), Prism(5, 14, "N-BK7", 150, 45)), path)
    return path


def test_an_experiment_writes_tables_pictures_and_a_page(monkeypatch, capsys, small, tmp_path):
    """A setup file of any camera and prism; every number of the table on the screen stands in the CSV file."""
    words = ("experiment", "multiocular", "--setup", small, *QUICK, *RIGHT, "-o", tmp_path)
    status, out, err = run(monkeypatch, capsys, *words)
    assert (status, err) == (0, "")
    assert sorted(path.name for path in tmp_path.iterdir()) == sorted(FILES)
    rows = list(csv.DictReader(io.StringIO((tmp_path / "table.csv").read_text())))
    assert {row["actual_depth_mm"] for row in rows} == {"700", "1000"}
    for row in rows:
        shown = f"{float(row['recovered_mean_mm']):.2f} ({float(row['error_of_mean_percent']):+.2f})"
        assert shown in out
        assert float(row["recovered_mean_mm"]) == pytest.approx(
            float(row["actual_depth_mm"]) * (1 + float(row["error_of_mean_percent"]) / 100), rel=1e-5
        )
    assert "5 facets of 14 degrees" in out
    (line,) = [line for line in out.splitlines() if line.startswith("physical model")]
    assert [float(x) for x in re.findall(r"[-+]?\d+\.\d+", line)[:3]] == [0, 0, 0]  # exact corners, right drawing
    page = (tmp_path / "report.html").read_text()
    assert page.count("<img") == 6
    assert "src='data:image/png" in page  # needs no other file


@pytest.fixture
def few(mitsuba, tmp_path):
    """A folder with some of the renderer's photographs through the biprism."""
    (tmp_path / "rigs").mkdir()
    (tmp_path / "rigs" / "t2_b40.json").write_bytes((mitsuba / "rigs" / "t2_b40.json").read_bytes())
    for name, kept in (("camera_only", range(4)), ("calib_t2_b40", range(4)), ("targets_t2_b40", (1, 2, 4))):
        (tmp_path / name).mkdir()
        told = json.loads((mitsuba / name / "views.json").read_text())
        told["views"] = [told["views"][k] for k in kept]
        (tmp_path / name / "views.json").write_text(json.dumps(told))
        for view in told["views"]:
            (tmp_path / name / view["file"]).symlink_to(mitsuba / name / view["file"])
    return tmp_path


def test_an_experiment_runs_on_photographs(monkeypatch, capsys, few, tmp_path):
    """On the renderer's photographs the physical model recovers depth to some hundredths of a percent."""
    words = ("experiment", "biprism", "--data", few, "--depths", "700,1000", "-o", tmp_path / "out")
    status, out, _ = run(monkeypatch, capsys, *words)
    assert status == 0
    rows = list(csv.DictReader(io.StringIO((tmp_path / "out" / "table.csv").read_text())))
    errors = {float(row["actual_depth_mm"]): float(row["rms_percent"]) for row in rows if "physical" in row["approach"]}
    assert set(errors) == {700, 1000}
    assert max(errors.values()) < 0.05
    assert "corners found in photographs" in out
    status, _, err = run(monkeypatch, capsys, *words[:4], "--depths", "650", "-o", tmp_path / "out")
    assert status == 2
    assert "there are those at 700, 800, 1000 mm" in " ".join(err.split())


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("multiocular", "--facets", "1"), "2 (a biprism) to 60"),
        (("multiocular", "--facets", "nan"), "must be a whole number"),
        (("multiocular", "--facets", "inf"), "must be a whole number"),
        (("multiocular", "--apex-deg", "nan"), "--apex-deg must lie between 0 and 90"),
        (("biprism", "--drawing-apex-deg", "nan"), "--drawing-apex-deg must be a number"),
        (("biprism", "--photos", "2"), "--photos: calibration wants 3"),
        (("multiocular", "--facets", "2.5"), "must be a whole number"),
        (("biprism", "--baseline", "400"), "out of reach with 2 facets of 12 degrees: the prism would reach"),
        (("biprism", "--depths", "700,600"), "rising numbers"),
        (("biprism", "--depths", "abc"), "for example 600,700,800"),
        (("biprism", "--depths", "nan"), "above 0"),
        (("biprism", "--glass", "unobtainium"), "unknown medium"),
        (("biprism", "--corner-noise-px", "-1"), "0 px or more"),
        (("biprism", "--seed", "-1"), "0 or more"),
        (("biprism", "--data", "nowhere"), "no such folder"),
        (("biprism", "--data", "."), "wants the folders camera_only, calib_t2_b40"),
        (("biprism", "--data", ".", "--corner-noise-px", "1"), "leave --corner-noise-px out"),
        (("biprism", "--setup", "missing.toml"), "no such file"),
        (("biprism", "--setup", "five.toml"), "this prism has 5 facets, but the experiment is about 2"),
        (("multiocular", "--setup", "five.toml", "--apex-deg", "10"), "leave --apex-deg out"),
        (("multiocular", "--setup", "five.toml", "--depths", "100,200"), "before or inside the prism"),
        (("multiocular", "--setup", "plate.toml"), "about prisms"),
    ],
)
def test_bad_input_gets_advice(monkeypatch, capsys, small, tmp_path, words, message):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "five.toml").write_bytes(small.read_bytes())
    write_setup(Setup(Camera((640, 480), 1200), Plate("N-BK7", 40, 10)), tmp_path / "plate.toml")
    status, _, err = run(monkeypatch, capsys, "experiment", *words, "-o", tmp_path / "out")
    assert status == 2
    assert message in " ".join(err.split())


def test_photographs_of_an_experiment_must_be_described(monkeypatch, capsys, tmp_path):
    for name in ("camera_only", "calib_t2_b40", "targets_t2_b40", "rigs"):
        (tmp_path / name).mkdir()
    for text, message in (("{}", "does not describe a rig"), ("no json", "this is not JSON"), ("[]", "JSON object")):
        (tmp_path / "rigs" / "t2_b40.json").write_text(text)
        words = ("experiment", "biprism", "--data", tmp_path, "-o", tmp_path / "out")
        status, _, err = run(monkeypatch, capsys, *words)
        assert status == 2
        assert message in err
