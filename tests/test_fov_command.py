"""The command fov as a person meets it."""

import json

import numpy as np
import pytest
import trimesh
from commands import run

from cyclopean import read_setup
from cyclopean.analysis.common_volume import CommonField
from cyclopean.analysis.field_of_view import FieldOfView, upright
from cyclopean.jobs.field_of_view import closed_forms

CAMERA = "[camera]\nsize_px = [320, 240]\nfocal_px = 600.0\n"
PRISM = CAMERA + (
    '[optic]\nkind = "prism"\nfacets = {facets}\napex_deg = 12.0\nindex = 1.5168\ndistance_mm = 60.0\n'
    "thickness_mm = 12.0\nazimuth_deg = 90.0\n"
)
MIRRORS = CAMERA + (
    '[optic]\nkind = "mirrors"\nsequences = [[0], [1]]\nmirrors = [\n'
    "  { centre_mm = [40.0, 0.0, 200.0], normal = [-1.0, 0.0, -0.02], size_mm = [300.0, 200.0] },\n"
    "  { centre_mm = [-40.0, 0.0, 200.0], normal = [1.0, 0.0, -0.02], size_mm = [300.0, 200.0] },\n]\n"
)
PLATE = CAMERA + '[optic]\nkind = "plate"\nindex = 1.5\ndistance_mm = 40.0\nthickness_mm = 10.0\n'
PICTURES = {"fov.png", "sections.png", "sensor.png", "fov.json", "report.html"}


@pytest.fixture
def fov(tmp_path, monkeypatch, capsys):
    """Run ``cyclopean fov`` on the text of a setup file; the folder of its results stands in front of what it said."""

    def call(text, *words):
        path = tmp_path / "setup.toml"
        path.write_text(text, encoding="utf-8")
        folder = tmp_path / "out"
        return folder, *run(monkeypatch, capsys, "fov", path, "-o", folder, *words)

    return call


def names(folder):
    return {file.name for file in folder.iterdir()}


def test_a_pyramid_gets_its_class_tables_volumes_and_pictures(fov, tmp_path):
    folder, status, said, _ = fov(PRISM.format(facets=3), "--depth", "200..900")
    assert status == 0
    assert names(folder) == PICTURES | {f"volume_{k}.{ending}" for k in (2, 3) for ending in ("stl", "ply")}
    setup = read_setup(tmp_path / "setup.toml")
    field, document = FieldOfView.of(setup), json.loads((folder / "fov.json").read_text())
    assert f"class: {field.kind}" in said
    assert f"gamma {np.degrees(field.gamma):.3f}" in said
    closed = document["closed_form"]
    assert closed["class"] == field.kind
    assert closed["near_mm"] == pytest.approx(72.0)
    assert closed["far_mm"] is None  # no end
    for entry in document["volumes"]:
        if entry["views"] > 1:
            mesh = trimesh.load(folder / f"volume_{entry['views']}.ply")
            assert mesh.is_watertight
            assert mesh.volume == pytest.approx(entry["volume_mm3"], rel=1e-4)
    areas = [entry["area_mm2"] for entry in document["sections"] if entry["views"] == 3]
    sections = [CommonField.of(setup.rig()).sections(depth)[2].area for depth in (200.0, 900.0)]
    assert [areas[0], areas[-1]] == pytest.approx(sections)
    for row in document["traced"]:
        # straight seams and sampling: 1 % (tests/test_field_of_view.py); 0.02 mm where there is hardly any width
        assert row["half_width_mm"] == pytest.approx(float(field.half_width(row["depth_mm"])), rel=0.01, abs=0.02)
    report = (folder / "report.html").read_text()
    assert report.count("data:image/png") == 3
    assert "limits and volume" in report


def test_a_tilted_prism_is_traced_and_its_upright_twin_described(fov, tmp_path):
    text = PRISM.format(facets=2) + "tilt_deg = [0.3, 0.4, 5.0]\n"
    folder, status, said, _ = fov(text, "--depth", "200..900", "--views", "1")
    assert status == 0
    assert names(folder) == PICTURES | {"volume_1.stl", "volume_1.ply"}
    assert "tilted by 0.5 degrees" in said
    assert "set upright" in " ".join(said.split())
    setup = read_setup(tmp_path / "setup.toml")
    document = json.loads((folder / "fov.json").read_text())
    assert document["closed_form"]["gamma_deg"] == pytest.approx(np.degrees(FieldOfView.of(upright(setup)).gamma))
    volume = CommonField.of(setup.rig()).volumes((200.0, 900.0))[1].volume
    assert document["volumes"][1]["volume_mm3"] == pytest.approx(volume, rel=1e-9)


def test_a_prism_far_from_upright_gets_no_closed_form(tmp_path):
    path = tmp_path / "setup.toml"
    for line in ("tilt_deg = [9.0, 0.0, 0.0]\n", "shift_mm = [4.0, 0.0]\n"):
        path.write_text(PRISM.format(facets=3) + line, encoding="utf-8")
        field, note = closed_forms(read_setup(path))
        assert field is None
        assert note.startswith("no closed form")


def test_mirrors_have_no_closed_form_and_depths_without_a_common_field_no_mesh(fov):
    folder, status, said, _ = fov(MIRRORS, "--depth", "900..1200")
    assert status == 0
    words = " ".join(said.split())
    assert "no closed form: it is that of an upright pyramid, and this optic is of the kind 'mirrors'" in words
    assert "see nothing together at these depths (from 3" in words
    assert names(folder) == PICTURES
    assert json.loads((folder / "fov.json").read_text())["closed_form"] is None


def test_one_view_has_its_own_field(fov):
    folder, status, _, _ = fov(PLATE, "--depth", "100..200", "--views", "1")
    assert status == 0
    assert names(folder) == PICTURES | {"volume_1.stl", "volume_1.ply"}


@pytest.mark.parametrize(
    ("text", "words", "told"),
    [
        (PRISM.format(facets=3), ("--depth", "900..200"), "0 < NEAR < FAR"),
        (PRISM.format(facets=3), ("--depth", "nan..200"), "0 < NEAR < FAR"),
        (PRISM.format(facets=3), ("--depth", "20..200"), "within the optic"),
        (PRISM.format(facets=3), ("--views", "4"), "between 1 and 3"),
        (PRISM.format(facets=3), ("--views", "0"), "between 1 and 3"),
        (PLATE, (), "two views or more, and this plate gives 1; --views 1 shows"),
        (PLATE, ("--views", "1"), "state the depth range"),
        ("", (), "empty"),
    ],
)
def test_bad_input_is_told(fov, text, words, told):
    _, status, _, errors = fov(text, *words)
    assert status == 2
    assert told in " ".join(errors.split())


def test_a_missing_setup_and_a_file_in_the_way(monkeypatch, capsys, tmp_path):
    status, _, errors = run(monkeypatch, capsys, "fov", tmp_path / "none.toml")
    assert status == 2
    assert "no such file" in errors
    setup = tmp_path / "setup.toml"
    setup.write_text(PRISM.format(facets=2), encoding="utf-8")
    status, _, errors = run(monkeypatch, capsys, "fov", setup, "-o", setup)
    assert status == 2
    assert "is a file, not a folder" in errors
