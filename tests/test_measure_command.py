"""``cyclopean measure`` as a person meets it: options, typed lines, clicks, files and faults."""

import csv
import json
from dataclasses import replace

import commands
import matplotlib.pyplot
import numpy as np
import pytest
from matplotlib.backend_bases import KeyEvent, MouseEvent
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from scenes import photograph_plane, small_setup

from cyclopean import Camera, Plate, Setup, triangulate, write_setup
from cyclopean.correspondence.window_search import prepare
from cyclopean.errors import MeasurementError, SetupError
from cyclopean.files import write_image
from cyclopean.jobs.measurement import calibration_share, listen, parse_points
from cyclopean.jobs.measurement_session import Scene, Session, shown_value
from cyclopean.jobs.measurement_window import MeasuringWindow, check_display, measure_in_window

SETUP = replace(small_setup(), depths=(550.0, 1100.0))
RIG = SETUP.rig()
PHOTOGRAPH = photograph_plane(RIG, 800.0, pitch=2.0)[0]
SQUARE = RIG[0].rays(RIG[0].region.centre).at_depth(800.0) + 10.0 * np.array(
    [[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]]
)
SEEN = RIG.project(SQUARE)  # (4, V, 2)
CORNERS = [f"{x:.4f},{y:.4f}" for x, y in SEEN[:, 0]]
FILES = ("measurements.json", "measurements.csv", "measurements.png", "report.html")


def run(monkeypatch, capsys, *words):
    """Exit status, output and errors of one measuring."""
    return commands.run(monkeypatch, capsys, "measure", *words)


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    """A folder with photo.png and setup.toml."""
    folder = tmp_path_factory.mktemp("measure")
    write_image(folder / "photo.png", PHOTOGRAPH)
    write_setup(SETUP, folder / "setup.toml")
    return folder


@pytest.fixture
def session():
    """A session on the photograph, with a list of what it kept."""
    scene = Scene(prepare(PHOTOGRAPH, RIG), RIG, (550.0, 1100.0), 21, 0.3, lambda found: found)
    kept = []
    session = Session(scene, lambda done: kept.append(len(done)))
    session.kept = kept
    return session


def test_every_kind_is_measured_and_written(monkeypatch, capsys, files, tmp_path):
    out = tmp_path / "out"
    words = (
        files / "photo.png", "-s", files / "setup.toml", "-o", out,
        "--length", " ".join(CORNERS[:2]), "--length", " ".join(CORNERS), "--area", " ".join(CORNERS),
        "--point-to-line", f"{CORNERS[3]} {CORNERS[0]} {CORNERS[1]}", "--angle", " ".join(CORNERS[:3]),
        "--point-to-plane", f"{CORNERS[2]} {CORNERS[0]} {CORNERS[1]} {CORNERS[3]}", "--point", CORNERS[0],
        "--point", "3,3",
    )  # fmt: skip
    status, said, errors = run(monkeypatch, capsys, *words)
    assert (status, errors) == (0, "")
    assert "good" in said
    assert "refused" in said
    assert "+-" in said
    assert all((out / name).stat().st_size > 200 for name in FILES)
    document = json.loads((out / "measurements.json").read_text())
    true = {"length": [20, 60], "area": [400], "point-to-line": [20], "angle": [np.pi / 2], "point-to-plane": [0]}
    for entry in document["measurements"]:
        if entry["kind"] == "point":
            continue
        wanted = true[entry["kind"]].pop(0)
        assert abs(entry["value"] - wanted) < 4 * entry["accuracy"]
        assert entry["accuracy"] > 0
        assert entry["sigma_calibration"] is None
        assert {point["view"] for point in entry["points"]} == {0}
    assert not any(true.values())
    rows = list(csv.DictReader((out / "measurements.csv").open()))
    assert len(rows) == len(document["measurements"]) == 8
    for row, entry in zip(rows, document["measurements"], strict=True):
        assert row["grade"] == entry["grade"]
        assert (row["value"] == "") == (entry["grade"] == "refused") == (entry["value"] is None)
    assert sum(row["grade"] == "refused" for row in rows) == 1


def test_a_match_is_put_right_by_hand(monkeypatch, capsys, files, tmp_path):
    seen = [f"{a}={x:.4f},{y:.4f}" for a, (x, y) in zip(CORNERS[:2], SEEN[:2, 1], strict=True)]
    words = files / "photo.png", "-s", files / "setup.toml", "-o", tmp_path, "--length", " ".join(seen)
    status, said, _ = run(monkeypatch, capsys, *words)
    assert status == 0
    assert "check" in said
    assert "by hand" in said
    (entry,) = json.loads((tmp_path / "measurements.json").read_text())["measurements"]
    assert entry["value"] == pytest.approx(20.0, abs=0.01)  # pixels written to 1e-4 px
    assert entry["points"][0]["pixels"][2] == [None, None]


def test_typed_lines_are_measured_and_kept_one_by_one(monkeypatch, capsys, session):
    lines = [
        "", "help", f"length {CORNERS[0]} {CORNERS[1]}", "length 1,2", "volume 1,2 3,4", "length a,b c,d",
        f"area {CORNERS[0]} {CORNERS[2]} {CORNERS[1]} {CORNERS[3]}", "undo", "undo", "undo", f"point {CORNERS[0]}",
        "list", "quit", "length 1,1 2,2",
    ]  # fmt: skip
    listen(session, lines)
    said = capsys.readouterr().out
    for expected in ("x,y=x2,y2", "wants 2 or more", "choose one of", "for example", "crosses itself", "taken back",
                     "nothing to take back"):  # fmt: skip
        assert expected in said
    assert session.kept == [1, 2, 1, 0, 1]  # after every measurement and every undo
    assert [found.kind for found in session.done] == ["point"]


def test_prompt_reads_from_a_pipe(monkeypatch, capsys, files, tmp_path):
    monkeypatch.setattr("sys.stdin", [f"length {CORNERS[0]} {CORNERS[1]}\n", "quit\n"])
    monkeypatch.setattr("cyclopean.jobs.measurement._asked", lambda lines: iter(lines))
    words = files / "photo.png", "-s", files / "setup.toml", "-o", tmp_path, "--prompt"
    status, said, _ = run(monkeypatch, capsys, *words)
    assert status == 0
    assert "1 measurement " in said
    assert all((tmp_path / name).exists() for name in FILES)


def test_results_survive_an_interruption(monkeypatch, capsys, files, tmp_path):
    def lines(_):
        yield f"length {CORNERS[0]} {CORNERS[1]}"
        raise KeyboardInterrupt

    monkeypatch.setattr("cyclopean.jobs.measurement._asked", lines)
    words = files / "photo.png", "-s", files / "setup.toml", "-o", tmp_path, "--prompt"
    status, _, errors = run(monkeypatch, capsys, *words)
    assert status == 130
    assert "interrupted" in errors
    assert len(json.loads((tmp_path / "measurements.json").read_text())["measurements"]) == 1


class Hands:
    """Clicks and keys on a window without a display."""

    def __init__(self, session):
        self.saved = []
        figure = Figure(figsize=(8, 6))
        self.canvas = FigureCanvasAgg(figure)
        self.window = MeasuringWindow(figure, session, PHOTOGRAPH, lambda: self.saved.append(True))
        self.canvas.draw()

    def click(self, pixel, button=1):
        """Press a mouse button over a pixel of the photograph."""
        x, y = self.window.axes.transData.transform(pixel)
        self.canvas.callbacks.process("button_press_event", MouseEvent("button_press_event", self.canvas, x, y, button))

    def press(self, *keys):
        """Press keys."""
        for key in keys:
            self.canvas.callbacks.process("key_press_event", KeyEvent("key_press_event", self.canvas, key))


def test_clicks_measure_a_length_and_an_area(session):
    hands = Hands(session)
    hands.click(SEEN[0, 0])
    assert len(session.points) == 1
    assert "strength" in session.message
    hands.click(SEEN[1, 0])
    hands.press("enter")
    assert abs(session.done[0].value - 20.0) < 4 * session.done[0].sigma
    hands.press("a")
    for corner in (0, 1, 2, 3):
        hands.click(SEEN[corner, 0])
    hands.press("u")
    assert len(session.points) == 3
    hands.press("enter", "s", "q")
    assert session.done[1].kind == "area"
    assert abs(session.done[1].value - 200) < 4 * session.done[1].sigma
    assert hands.saved
    assert hands.window.closed
    assert session.kept == [1, 2]
    assert shown_value(session.done[1]).endswith("mm^2")


def test_a_right_click_corrects_the_match(session):
    hands = Hands(session)
    hands.press("g")
    hands.click(SEEN[0, 0], button=3)
    assert "click one first" in session.message
    hands.click(SEEN[0, 0])
    hands.click(SEEN[2, 0], button=3)
    assert "another sub-image" in session.message
    hands.click(SEEN[0, 1], button=3)
    hands.click(SEEN[0, 1] + 1e-3, button=3)  # the later one counts
    np.testing.assert_allclose(session.points[0].by_hand, [SEEN[0, 1]], atol=0.01)
    hands.click(SEEN[1, 0])
    hands.click(SEEN[2, 0])  # three points of an angle: measured without enter
    (found,) = session.done
    assert found.kind == "angle"
    assert found.value == pytest.approx(np.pi / 2, abs=0.1)
    assert found.grade == "check"
    assert shown_value(found).endswith("deg")


def test_a_window_forgives(session):
    hands = Hands(session)
    hands.press("enter")
    assert "wants 2 or more" in session.message
    hands.press("u", "x", "p")
    hands.click((5, 5))
    assert session.done[0].grade == "refused"
    hands.canvas.callbacks.process("button_press_event", MouseEvent("button_press_event", hands.canvas, 1, 1, 1))
    assert not session.points  # beside the picture


def test_without_a_display_it_says_what_to_do(monkeypatch, capsys, files, tmp_path, session):
    words = files / "photo.png", "-s", files / "setup.toml", "-o", tmp_path / "none"
    status, _, errors = run(monkeypatch, capsys, *words)
    assert status == 2
    assert "--length" in errors
    assert "--prompt" in errors
    assert not (tmp_path / "none").exists()
    with pytest.raises(MeasurementError, match="no display"):
        check_display()
    matplotlib.pyplot.switch_backend("agg")
    with pytest.raises(MeasurementError, match="--prompt"):
        measure_in_window(session, PHOTOGRAPH, lambda: None)


@pytest.mark.parametrize(
    ("text", "says"),
    [("", "no points"), ("1,2,3", "for example"), ("1;2", "for example"), ("nan,2", "finite"), ("1,2=", "for example")],
)
def test_points_that_cannot_be_read(text, says):
    with pytest.raises(MeasurementError, match=says):
        parse_points(text)


def test_points_are_read():
    one, two = parse_points(" 1,2  3.5,-4=5,6=7,8 ")
    assert one.pixel == (1.0, 2.0)
    assert one.by_hand == ()
    assert two.pixel == (3.5, -4.0)
    assert two.by_hand == ((5.0, 6.0), (7.0, 8.0))


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (["--length", "1,2"], "wants 2 or more points"),
        (["--angle", "1,2 3,4 5,6 7,8"], "wants 3 points"),
        (["--length", "1,2 x,4"], "for example"),
        (["--length", "1,2 3,4", "--window", "20"], "odd number"),
        (["--length", "1,2 3,4", "--pointing", "-1"], "standard deviation"),
        (["--length", "1,2 3,4", "--depth", "900..500"], "NEAR < FAR"),
        (["--length", "1,2 3,4", "--channel", "green"], "is grey"),
        (["--length", "1,2 3,4", "--calibration", "none.json"], "no such file"),
    ],
)
def test_faults_are_one_clear_line(monkeypatch, capsys, files, tmp_path, words, says):
    given = files / "photo.png", "-s", files / "setup.toml", "-o", tmp_path, *words
    status, _, errors = run(monkeypatch, capsys, *given)
    assert status == 2
    assert says in errors
    assert errors.count("\n") == 1


def test_wrong_files_are_named(monkeypatch, capsys, files, tmp_path):
    length = ("--length", "1,2 3,4", "-o", tmp_path)
    status, _, errors = run(monkeypatch, capsys, files / "no.png", "-s", files / "setup.toml", *length)
    assert status == 2
    assert "no such file" in errors
    write_image(tmp_path / "small.png", PHOTOGRAPH[:100])
    status, _, errors = run(monkeypatch, capsys, tmp_path / "small.png", "-s", files / "setup.toml", *length)
    assert status == 2
    assert "is 320x100 px" in errors
    write_setup(Setup(Camera((320, 240), 600), Plate(1.5, 40, 15)), tmp_path / "plate.toml")
    status, _, errors = run(monkeypatch, capsys, files / "photo.png", "-s", tmp_path / "plate.toml", *length)
    assert status == 2
    assert "two views" in errors


def calibration_file(path, names, sigmas):
    """A calibration report with independent parameters."""
    document = {
        "kind": "cyclopean calibration",
        "parameters": [{"name": name} for name in names],
        "covariance": np.diag(np.square(sigmas)).tolist(),
    }
    path.write_text(json.dumps(document))
    return path


def test_the_calibration_adds_its_share(monkeypatch, capsys, files, tmp_path):
    sigma = 0.002 * SETUP.camera.focal[0]
    path = calibration_file(tmp_path / "calibration.json", ["camera.focal_tied", "optic.distance"], [sigma, 0.0])
    words = files / "photo.png", "-s", files / "setup.toml", "-o", tmp_path, "--calibration", path
    status, *_ = run(monkeypatch, capsys, *words, "--length", " ".join(CORNERS[:2]))
    (entry,) = json.loads((tmp_path / "measurements.json").read_text())["measurements"]
    assert status == 0
    assert entry["accuracy"] == pytest.approx(np.hypot(entry["sigma"], entry["sigma_calibration"]))
    # the truth: the same pixels, measured with a focal length that is one sigma longer
    other = replace(SETUP, camera=replace(SETUP.camera, focal=(600 + sigma, 600 + sigma))).rig()
    pixels = np.array([point["pixels"] for point in entry["points"]], dtype=float)
    lengths = [np.linalg.norm(np.diff(triangulate(rig, pixels).points, axis=0)) for rig in (RIG, other)]
    assert entry["sigma_calibration"] == pytest.approx(abs(lengths[1] - lengths[0]), rel=0.05)  # first order


def test_a_calibration_of_another_setup_is_named(tmp_path):
    path = calibration_file(tmp_path / "calibration.json", ["optic.mirror0_advance"], [1.0])
    with pytest.raises(SetupError, match="another setup"):
        calibration_share(SETUP, path)
