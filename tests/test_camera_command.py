"""``cyclopean camera`` as a person meets it: the real camera from photographs without the optic."""

from functools import partial

import numpy as np
import pytest
from commands import run

from cyclopean import Camera
from cyclopean.errors import SetupError
from cyclopean.files import write_board, write_image, write_observations
from cyclopean.files.cameras import read_camera
from cyclopean.geometry import Pose
from cyclopean.targets import DIRECT, Board, Observations

CAMERA = Camera((1280, 960), (1500.0, 1510.0), (650.0, 470.0), (-0.2, 0.1, 1e-3, -5e-4, 0.0))
BOARD = Board("chessboard", 10, 8, 20.0)
CHARUCO = Board("charuco", 14, 10, 20.0, 15.0, "DICT_5X5_250")
TURNS = ((25, 10, 0), (-25, 20, 10), (15, -30, 20), (-20, -25, 90), (5, 30, -20))
NOISE = 0.02


def photographs(turns, camera=CAMERA):
    """Observations of the board's middle at 500 mm, turned by rotation vectors in degrees."""
    points = BOARD.points - BOARD.points.mean(0)
    pixels = np.concatenate(
        [camera.project(Pose.from_rotation_vector(np.radians(turn), (0, 0, 500)) @ points) for turn in turns]
    )
    pixels = pixels + NOISE * np.random.default_rng(0).normal(size=pixels.shape)
    count, names = len(points), tuple(f"{k}.png" for k in range(len(turns)))
    photo, point = np.repeat(np.arange(len(turns)), count), np.tile(np.arange(count), len(turns))
    return Observations(photo, DIRECT, point, pixels, names, NOISE)


@pytest.fixture
def command(tmp_path, monkeypatch, capsys):
    """Run ``cyclopean camera`` in a folder with board.toml: exit status, output and errors."""
    write_board(tmp_path / "board.toml", BOARD)
    write_board(tmp_path / "charuco.toml", CHARUCO)
    monkeypatch.chdir(tmp_path)
    return partial(run, monkeypatch, capsys, "camera", "--board")


def from_corners(seen, *more):
    write_observations("corners.csv", seen)
    return ("board.toml", "--corners", "corners.csv", "--size", "1280x960", *more)


def test_zhang_from_corners(command):
    status, said, _ = command(*from_corners(photographs(TURNS), "--distortion", 4, "--report", "report"))
    assert status == 0
    assert "315 corners in 5 photographs" in said
    assert "note" not in said
    rows = {words[0]: words[1:] for words in map(str.split, said.splitlines()) if len(words) in (3, 4)}
    assert rows["k3"][1] == "held"
    found = read_camera("camera.toml")
    for name, value, true in zip(("focal_x", "focal_y"), found.focal, CAMERA.focal, strict=True):
        assert rows[name][2] == "px"
        assert float(rows[name][0]) == pytest.approx(value, abs=float(rows[name][1]))
        assert abs(value - true) < 4 * float(rows[name][1])  # 1 in 16 000 for normal noise
    with open("report/report.html", encoding="utf-8") as page:
        assert "4.png" in page.read()


def test_tsai_from_corners_states_what_the_other_lens_model_costs(command):
    camera = Camera((1280, 960), 1500.0, distortion=(-0.1, 0.0, 0.0, 0.0, 0.0))
    status, said, _ = command(*from_corners(photographs(TURNS[2:3], camera), "--method", "tsai", "-o", "t.toml"))
    assert status == 0
    text = " ".join(said.split())
    assert "1 photograph," in text
    assert "principal point as mid-image" in text
    assert "over the picture they depart by" in text
    found = read_camera("t.toml")
    assert found.centre == (639.5, 479.5)
    assert found.focal[0] == pytest.approx(1500, rel=0.01)  # one photograph, 0.02 px: some standard deviations


def test_the_renderers_camera(command, mitsuba):
    folder = mitsuba / "camera_only"
    photos = [folder / f"view_{k:02d}.png" for k in (3, 5, 11)]
    assert command("charuco.toml", *photos, "--distortion", 0)[0] == 0
    assert read_camera("camera.toml").focal == pytest.approx((2400, 2400), abs=1)  # 0.01 px of detection in 700
    status, said, _ = command("charuco.toml", photos[-1], "--method", "tsai")
    assert status == 0
    assert "tilt of the board" in said
    assert read_camera("camera.toml").focal[0] == pytest.approx(2400, abs=1)
    status, said, _ = command("charuco.toml", *(folder / f"view_0{k}.png" for k in range(3)), "--distortion", 0)
    assert status == 0
    assert "leans by 5.3 degrees at most" in " ".join(said.split())


def test_boards_that_stand_parallel_are_refused(command):
    status, _, error = command(*from_corners(photographs([(20, 0, 0), (20, 0, 0), (20, 0, 0)])))
    assert status == 2
    assert "stand parallel" in error
    status, _, error = command(*from_corners(photographs([(0, 0, 0)]), "--method", "tsai"))
    assert status == 2
    assert "cannot be told apart" in error


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("board.toml",), "which photographs?"),
        (("board.toml", "a.png", "--corners", "corners.csv", "--size", "9x9"), "not both"),
        (("board.toml", "--corners", "corners.csv"), "--corners and --size go together"),
        (("board.toml", "a.png", "--size", "9x9"), "--corners and --size go together"),
        (("board.toml", "a.png", "--distortion", 1), "must be one of 0, 2, 4, 5, got 1"),
        (("board.toml", "a.png", "--distortion", 5, "--method", "tsai"), "must be one of 0, 1, 2, got 5"),
        (("board.toml", "a.png", "-o", "camera.png"), "is a .toml file"),
        (("board.toml", "a.png", "-o", "board.toml"), "overwrite the board"),
        (("board.toml", "a.png", "b.png", "--method", "tsai"), "takes one photograph, got 2"),
        (("board.toml", "a.png"), "a.png: there is no such file"),
        (("charuco.toml", "grey.png"), "no view of the photograph shows"),
        (("board.toml", "--corners", "corners.csv", "--size", "640x480"), "lie outside a picture of 640 x 480 px"),
        (("board.toml", "--corners", "through.csv", "--size", "1280x960"), "no row is of a photograph without"),
        (("board.toml", "--corners", "one.csv", "--size", "1280x960"), "but only 0.png shows it"),
        (("board.toml", "--corners", "corners.csv", "--size", "1280x960", "--method", "tsai"), "takes one photograph"),
    ],
)
def test_faults_are_one_line(words, said, command):
    seen = photographs(TURNS)
    write_observations("corners.csv", seen)
    write_observations("one.csv", seen.of_photos([0]))
    through = Observations(seen.photo, 0, seen.point, seen.pixels, seen.photos)
    write_observations("through.csv", through)
    write_image("grey.png", np.full((60, 80), 90, np.uint8))
    status, _, error = command(*words)
    assert status == 2
    assert said in error
    with pytest.raises(SetupError):
        read_camera("camera.toml")  # nothing was written
