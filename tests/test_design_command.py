"""`cyclopean design` as a person meets it: words, tables, files, and what is said where nothing fits."""

import dataclasses
import json

import numpy as np
import pytest
import trimesh
from commands import run

from cyclopean import Camera, Prism, Setup
from cyclopean.analysis import Tolerance
from cyclopean.design import evaluate, search
from cyclopean.design.requirements import Candidate, Choice, Designs, Explanation, Requirements
from cyclopean.errors import SetupError
from cyclopean.files import read_board, read_setup, write_setup
from cyclopean.jobs import design_files
from cyclopean.jobs.design_request import parse_tolerance_words
from cyclopean.jobs.design_rounding import rounded
from cyclopean.jobs.design_shopping import stop_advice
from cyclopean.jobs.design_words import parse_accuracy, parse_camera, parse_facets, parse_field
from cyclopean.optics import prism_dimensions

WORDS = "320x240, 22 um, f=25 mm"
CAMERA = Camera((320, 240), 25 / 0.022, pixel_pitch=0.022)
ASKED = ("--camera", WORDS, "--depth", "600..1200", "--facets", "2", "--angles", "8,10", "--draws", 40, "--choose", 2)
FILES = {"setup.toml", "prism.stl", "drawing.pdf", "board.toml", "shopping.md", "candidate.png"}


@pytest.mark.parametrize(
    "text",
    [
        WORDS,
        "320 x 240 px; pitch 22um, focal length 25mm",
        "f=25 mm, sensor 7.04x5.28 mm, 320×240",
        "320x240,25 mm,22 µm",
    ],
)
def test_words_for_a_camera_all_mean_the_same(text):
    camera = parse_camera(text).camera
    assert camera.size == CAMERA.size
    # 1e-12: quotients of the same numbers taken in another order
    assert camera.focal == pytest.approx(CAMERA.focal, rel=1e-12)
    assert camera.pixel_pitch == pytest.approx(0.022, rel=1e-12)


def test_a_camera_takes_pixels_inches_stops_and_files(tmp_path):
    assert parse_camera("640x480, f=900 px").camera.focal == (900.0, 900.0)
    found = parse_camera('1280x960, 2/3", f=25 mm, F/5.6')
    assert found.f_number == 5.6
    # the format's diagonal is that of the pixels
    assert found.camera.pixel_pitch * np.hypot(1280, 960) == pytest.approx(11.0)
    assert "data sheet" in found.note
    setup = Setup(CAMERA, Prism(2, 8.0, "N-BK7", 100.0), 632.8, 8.0, 900.0)
    write_setup(setup, tmp_path / "setup.toml")
    read = parse_camera(str(tmp_path / "setup.toml"))
    assert (read.f_number, read.focus_distance, read.wavelength_nm) == (8.0, 900.0, 632.8)
    assert read.camera.focal == CAMERA.focal


def test_shares_lists_and_sizes():
    assert parse_accuracy("0.1%", 1600)[0] == pytest.approx(0.001)
    share, note = parse_accuracy("0.8 mm", 1600)
    assert share == pytest.approx(0.8 / 1600)
    assert "far depth" in note
    assert parse_facets("2..5") == (2, 3, 4, 5)
    assert parse_facets("5, 2,5") == (2, 5)
    assert parse_field("20x15 cm") == (200.0, 150.0)


def test_tolerances_of_a_file_are_those_of_the_tolerance_command(tmp_path):
    path = tmp_path / "mine.txt"
    path.write_text("optic.distance=0.2  # a stop\n\noptic.apex=0.05 deg:uniform\n")
    found = parse_tolerance_words(str(path), CAMERA, 2, "N-BK7")
    assert found == (Tolerance("optic.distance", 0.2), Tolerance("optic.apex", np.deg2rad(0.05), "uniform"))
    path.write_text("optic.colour=3\n")
    with pytest.raises(SetupError, match=r"mine\.txt"):
        parse_tolerance_words(str(path), CAMERA, 2, "N-BK7")


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("--camera", "320x240, 22 um"), "lacks the focal length"),
        (("--camera", "320x240, f=25 mm"), "needs the pixel pitch"),
        (("--camera", "320x240, 22 um, 5 um, f=25 mm"), "say the same thing twice"),
        (("--camera", "320x240, 9x3 mm, f=25 mm"), "must be square"),
        (("--camera", "big, 22 um, f=25 mm"), "says nothing about a camera"),
        (("--depth", "1600..600"), "0 < NEAR < FAR"),
        (("--accuracy", "0.1"), "with its unit"),
        (("--accuracy", "70%"), "less than 50 %"),
        (("--facets", "1..3"), "2 is a biprism"),
        (("--glass", "N-BK77"), "N-BK7"),
        (("--angles", "steep"), "any, stock, or degrees"),
        (("--angles", "stock", "--glass", "PMMA"), "not kept in stock"),
        (("--field", "200"), "200x150"),
        (("--tolerances", "sloppy"), "commercial"),
        (("--max-blend", "20"), "--f-number"),
        (("--distance", "700..900"), "stand behind the nearest"),
        (("--distance", "200..400", "--max-length", "150"), "contradict each other"),
        (("--baseline", "900"), "exceeds the nearest depth"),
        (("--choose", "0"), "1 to 26"),
        (("--max-diameter", "-3"), "above 0"),
    ],
)
def test_wrong_words_are_told(words, said, tmp_path, monkeypatch, capsys):
    given = {"--camera": WORDS, "--depth": "600..1200", "-o": tmp_path / "out"}
    given |= dict(zip(words[::2], words[1::2], strict=True))
    status, _, wrong = run(monkeypatch, capsys, "design", *(word for pair in given.items() for word in pair))
    assert status == 2
    assert said in wrong
    assert not (tmp_path / "out").exists()


def test_a_stop_is_advised_where_defocus_and_diffraction_are_least():
    requirements = Requirements(CAMERA, (600.0, 1200.0))
    stop = float(stop_advice(requirements).removeprefix("f/").split()[0])
    blurs = {}
    for number in (2.0, 2.8, 4.0, 5.6, 8.0, 11.0, 16.0, 22.0):
        # the circle on the sensor of a point at 600 mm, by similar triangles behind the lens, and the Airy disc, mm
        image, focus = 25.0, requirements.focus
        lens = 1 / (1 / image + 1 / focus)
        sharp = 1 / (1 / lens - 1 / 600)
        blurs[number] = np.hypot(image / number * abs(image / sharp - 1), 2.44 * 587.6e-6 * number)
    assert stop == min(blurs, key=blurs.get)


@pytest.fixture(scope="module")
def small_designs():
    """Two biprisms with figures, as a search would hand them over."""
    requirements = Requirements(CAMERA, (600.0, 1200.0), accuracy=0.01, facets=(2,))
    candidates = []
    for apex, distance in ((8.0, 150.03), (10.0, 170.02)):
        setup = requirements.setup(Prism(2, apex, "N-BK7", distance, 9.123, 40.0))
        candidates.append(Candidate(setup, evaluate(setup, requirements)))
    choices = (Choice(1, ("most accurate",)), Choice(0, ("smallest",)))
    return Designs(requirements, tuple(candidates), (0, 1), choices, 2, 2, Explanation({}, {}, (), None, ""))


def test_round_measures_still_fit(small_designs):
    requirements = small_designs.requirements
    found = rounded(small_designs.candidates[0], requirements)
    prism = found.prism
    # 150 mm, some 60 mm and some 10 mm, to 1 % at most
    for length, step in ((prism.distance, 1.0), (2 * prism.radius, 0.5), (prism.thickness, 0.05)):
        assert length / step == pytest.approx(round(length / step), abs=1e-6)
    assert search.fits(found, requirements)
    # a limit that leaves no room for rounding up is kept
    tight = dataclasses.replace(requirements, max_diameter=2 * prism.radius - 0.01)
    raw = small_designs.candidates[0]
    assert rounded(raw, tight).figures.diameter <= max(tight.max_diameter, raw.figures.diameter)


def test_a_design_is_written_from_table_to_shopping_list(tmp_path, monkeypatch, capsys):
    out = tmp_path / "out"
    status, said, wrong = run(monkeypatch, capsys, "design", *ASKED[:-1], 1, "--accuracy", "0.6%", "-o", out)
    assert (status, wrong) == (0, "")
    document = json.loads((out / "designs.json").read_text())
    written = {row["letter"]: row for row in document["candidates"] if row["letter"]}
    assert set(written) == {"a"}
    assert {path.name for path in out.iterdir()} == {"comparison.png", "designs.json", "report.html", *written}
    for letter, row in written.items():
        folder = out / letter
        assert {path.name for path in folder.iterdir()} == FILES
        setup = read_setup(folder / "setup.toml")
        assert setup.optic.apex_deg in (8.0, 10.0)
        requirements = Requirements(CAMERA, (600.0, 1200.0), accuracy=0.006)
        figures = evaluate(setup, requirements)
        assert figures.accuracy <= 0.006
        # six digits are kept in the file
        assert row["figures"]["sigma_of_depth"] == pytest.approx(figures.sigma.tolist(), rel=1e-5)
        assert row["kept"]["after"] is not None
        solid = trimesh.load(folder / "prism.stl")
        # the polygon that stands for the round outline lies 0.005 mm inside it at most
        assert solid.volume == pytest.approx(prism_dimensions(setup.optic).volume, rel=1e-3)
        assert (folder / "drawing.pdf").read_bytes().startswith(b"%PDF")
        assert len(read_board(folder / "board.toml").points) > 10
        shopping = (folder / "shopping.md").read_text()
        for words in (f"{setup.optic.apex_deg:.4f} deg", "N-BK7", f"{2 * setup.optic.radius:g} mm", "filter", "95 %"):
            assert words in shopping
    report = (out / "report.html").read_text()
    assert report.count("data:image/png") == 1 + len(written)
    for words in ("on paper", "kept (%)", "N-BK7", "cyclopean simulate"):
        assert words in said


def test_where_nothing_fits_it_is_explained_and_the_nearest_is_written(small_designs, tmp_path, monkeypatch, capsys):
    nearest = Explanation(
        {"accuracy": 2}, {}, (), small_designs.candidates[1], "Nothing fits: the accuracy is too much."
    )
    nothing = dataclasses.replace(small_designs, candidates=(), front=(), chosen=(), explanation=nearest)
    monkeypatch.setattr(search, "find_designs", lambda *_, **__: nothing)
    out = tmp_path / "out"
    status, said, wrong = run(monkeypatch, capsys, "design", *ASKED, "--accuracy", "0.001%", "--no-photo", "-o", out)
    assert status == 2
    assert "the accuracy is too much" in wrong
    assert "misses by least" in said
    assert {path.name for path in (out / "nearest").iterdir()} == FILES
    document = json.loads((out / "designs.json").read_text())
    assert document["candidates"] == []
    assert document["in_the_way"]["nearest"]["prism"]["apex_deg"] == 10.0


def test_prisms_that_do_not_keep_their_accuracy_are_refused(small_designs, tmp_path, monkeypatch, capsys):
    # on paper it keeps just what is asked for, so that nothing is left for making and calibrating
    only = small_designs.candidates[0]
    accuracy = 1.0001 * only.figures.accuracy
    asked = dataclasses.replace(small_designs.requirements, accuracy=accuracy, angles_deg=(8.0,))
    tight = dataclasses.replace(
        small_designs, requirements=asked, candidates=(only,), front=(0,), chosen=small_designs.chosen[1:]
    )
    monkeypatch.setattr(search, "find_designs", lambda *_, **__: tight)
    monkeypatch.setattr(design_files, "_write_part", lambda *_: None)
    words = (*ASKED, "--accuracy", f"{100 * accuracy:.8f}%", "--no-photo", "-o", tmp_path / "out")
    status, said, wrong = run(monkeypatch, capsys, "design", *words)
    assert status == 2
    assert "none of these prisms keeps" in wrong
    assert "noise of matching" in wrong
    assert "not 95 %" in said
    assert (tmp_path / "out" / "a" / "setup.toml").exists()


def test_what_is_complete_is_kept_when_it_is_interrupted(small_designs, tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(search, "find_designs", lambda *_, **__: small_designs)
    drawn = []

    def stop(folder, *_):
        drawn.append(folder.name)
        if len(drawn) == 2:
            raise KeyboardInterrupt

    monkeypatch.setattr(design_files, "_draw", stop)
    monkeypatch.setattr(design_files, "_write_part", lambda *_: None)
    out = tmp_path / "out"
    status, said, wrong = run(monkeypatch, capsys, "design", *ASKED, "--no-judge", "-o", out)
    assert status == 130
    assert "a/" in wrong
    assert "b/" not in wrong
    assert "kept (%)" not in said  # nobody judged them
    assert json.loads((out / "designs.json").read_text())["candidates"][1]["letter"] == "a"
