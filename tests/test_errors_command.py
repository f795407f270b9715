"""``cyclopean errors`` as a person meets it."""

import csv
import json
from dataclasses import replace

import commands
import numpy as np
import pytest

from cyclopean import Camera, Plate, Prism, Setup, write_setup
from cyclopean.analysis.budget import error_budget

SETUP = Setup(Camera((640, 480), 1200), Prism(3, 10, "N-BK7", distance=60, thickness=10), depths=(400.0, 900.0))
NAMES = ["optic.apex", "optic.distance"]
COVARIANCE = np.array([[4e-8, 1e-6], [1e-6, 0.04]])


def run(monkeypatch, capsys, *words):
    return commands.run(monkeypatch, capsys, "errors", *words)


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    """A folder with setups, and what a calibration of one of them wrote."""
    folder = tmp_path_factory.mktemp("errors")
    write_setup(SETUP, folder / "setup.toml")
    write_setup(replace(SETUP, optic=replace(SETUP.optic, glass=1.5168)), folder / "number.toml")
    write_setup(replace(SETUP, optic=Prism(2, 12, "N-BK7", distance=60, thickness=8)), folder / "two.toml")
    write_setup(replace(SETUP, optic=Plate(1.5, 50, 10)), folder / "plate.toml")
    document = {
        "kind": "cyclopean calibration",
        "parameters": [{"name": name} for name in NAMES],
        "covariance": COVARIANCE.tolist(),
    }
    (folder / "calibration.json").write_text(json.dumps(document), encoding="utf-8")
    document["parameters"][1]["name"] = "optic.mirror0_tilt_u"
    (folder / "other.json").write_text(json.dumps(document), encoding="utf-8")
    (folder / "no.json").write_text("{}", encoding="utf-8")
    return folder


def test_budget_is_printed_and_written(files, tmp_path, monkeypatch, capsys):
    out = tmp_path / "out"
    words = ("--tolerance", "optic.apex=0.05,optic.facets=0", "--band", "540..560nm", "--noise-px", "0.2")
    status, said, _ = run(monkeypatch, capsys, files / "setup.toml", *words, "-o", out)
    assert status == 0
    assert "look first after: apex angle" in said
    assert "facet angles" not in said
    assert "the middle of the band is 550 nm" in " ".join(said.split())
    for name in ("report.html", "budget.csv", "budget.png", "maps.png", "chromatic.png", "errors.json"):
        assert (out / name).stat().st_size > 1000
    with (out / "budget.csv").open(encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    depths = sorted({float(row["depth_mm"]) for row in rows})
    assert depths[0] == 400
    assert depths[-1] == 900
    budget = error_budget(
        SETUP, depths, tolerances={"optic.apex": np.deg2rad(0.05), "optic.facets": 0.0}, sigma=0.2, band=(540, 560)
    )
    for k, depth in enumerate(depths):
        mine = [row for row in rows if float(row["depth_mm"]) == depth]
        expected = budget.table(k)
        assert [row["source"] for row in mine] == [row.name for row in expected]
        written = [float(row["sigma_mm"]) for row in mine]
        np.testing.assert_allclose(written, [row.sigma for row in expected], rtol=1e-5)  # six digits
    page = (out / "report.html").read_text(encoding="utf-8")
    assert "Usual tolerances" in page
    assert "<td>apex angle</td><td class=number>3 arcmin</td><td>--tolerance</td>" in page
    assert "Filters" in page
    document = json.loads((out / "errors.json").read_text(encoding="utf-8"))
    assert [entry["depth_mm"] for entry in document["depths"]] == depths


def test_a_calibration_takes_the_place_of_the_usual_tolerances(files, tmp_path, monkeypatch, capsys):
    out = tmp_path / "out"
    given = ("--calibration", files / "calibration.json", "--temperature-range", "0", "-o", out)
    status, said, _ = run(monkeypatch, capsys, files / "number.toml", *given)
    assert status == 0
    assert "2 parameters, correlated" in said
    assert "apex angle" not in said
    assert "name the glass as well" in said
    assert not (out / "chromatic.png").exists()
    document = json.loads((out / "errors.json").read_text(encoding="utf-8"))
    assert set(document["calibration_shares"]) == {*NAMES, "correlations"}
    assert sum(document["calibration_shares"].values()) == pytest.approx(1)


def test_depths_without_a_common_field_are_named(files, tmp_path, monkeypatch, capsys):
    status, said, _ = run(monkeypatch, capsys, files / "two.toml", "--depth", "68.1..400", "-o", tmp_path / "out")
    assert status == 0
    assert "no two views share anything at 68.1 mm: left out" in " ".join(said.split())


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("missing.toml",), "there is no such file"),
        (("setup.toml", "--depth", "900..400"), "0 < NEAR < FAR"),
        (("setup.toml", "--depth", "5..9"), "inside the optic"),
        (("plate.toml",), "two views or more, and this plate gives 1"),
        (("setup.toml", "--tolerance", "optic.apx=1"), "did you mean optic.apex"),
        (("setup.toml", "--tolerance", "optic.apex"), "NAME=VALUE"),
        (("setup.toml", "--tolerance", "optic.apex=nan"), "NAME=VALUE"),
        (("setup.toml", "--tolerance", "optic.nothing=0"), "no parameter"),
        (("setup.toml", "--noise-px", "nan"), "positive number of px"),
        (("setup.toml", "--temperature-range", "-2"), "half width in K"),
        (("setup.toml", "--band", "560"), "LOW..HIGH"),
        (("setup.toml", "--band", "560..540"), "LOW < HIGH"),
        (("setup.toml", "--glass", "unobtainium"), "unknown medium"),
        (("setup.toml", "--mount", "cheese"), "aluminium"),
        (("setup.toml", "--mount", "1e6"), "ppm per K"),
        (("setup.toml", "--mount", "23.6e-6"), "in ppm per K: 23.6"),
        (("setup.toml", "--lens-ppm", "nan"), "number in ppm per K"),
        (("setup.toml", "--lens-ppm", "-1e-5"), "in ppm per K: 23.6"),
        (("setup.toml", "--depth", "10..300"), "inside the optic"),
        (("setup.toml", "--blur-px", "0"), "limit above 0"),
        (("setup.toml", "--calibration", "none.json"), "there is no such file"),
        (("setup.toml", "--calibration", "no.json"), "no calibration"),
        (("setup.toml", "--calibration", "other.json"), "that of another setup"),
    ],
)
def test_bad_input_is_one_clear_line(files, words, message, monkeypatch, capsys):
    monkeypatch.chdir(files)
    status, _, said = run(monkeypatch, capsys, *words, "-o", files / "never")
    assert status == 2
    assert message in said
    assert not (files / "never").exists()
