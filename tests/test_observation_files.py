"""Observation files: what is written comes back to the last digit, and the first fault is named with its line."""

from types import SimpleNamespace

import numpy as np
import pytest

from cyclopean.errors import SetupError
from cyclopean.files.observations import read_observations, write_observations
from cyclopean.targets import DIRECT, Observations

HEAD = "image,view,point,x,y\n"
KNOWN = "image,view,point,x,y,sigma,channel"
VIEW = 'must be a whole number from 0, or "direct" (-1) without the optic'
POINT = "must be a whole number from 0 to 3, a point of the target"
TARGET = SimpleNamespace(points=np.zeros((4, 3)))


def read(folder, text, target=None):
    (folder / "corners.csv").write_text(text, encoding="utf-8")
    return read_observations(folder / "corners.csv", target)


def fault(folder, text, target=None):
    with pytest.raises(SetupError) as caught:
        read(folder, text, target)
    start = f"{folder / 'corners.csv'}: "
    assert str(caught.value).startswith(start)
    return str(caught.value).removeprefix(start)


def many(count, channel=0):
    rng = np.random.default_rng(1)
    rows = np.arange(count)
    return Observations(
        rows // 300, rows // 100 % 3 - 1, rows % 100, rng.uniform(-0.5, 4000, (count, 2)),
        tuple(f"board, {k}.png" for k in range(-(-count // 300))), rng.uniform(0.01, 1, count), channel,
    )  # fmt: skip


def same(one, other):
    assert one.photos == other.photos
    for name in ("photo", "view", "point", "pixels", "sigma", "channel"):
        np.testing.assert_array_equal(getattr(one, name), getattr(other, name))


@pytest.mark.parametrize("channel", [0, 2])
def test_what_is_written_comes_back(channel, tmp_path):
    given = many(1500, channel)
    write_observations(tmp_path / "o.csv", given)
    same(read_observations(tmp_path / "o.csv"), given)
    head = (tmp_path / "o.csv").read_text().splitlines()[0]
    assert head == "image,view,point,x,y,sigma" + (",channel" if channel else "")


def test_what_people_write_is_read(tmp_path):
    # columns in any order, spaces, empty lines, a byte order mark, the ends of lines of Windows, quotes
    text = '\ufeffPoint, x, y, view, image\r\n3, 1.5, 2e1, direct, "a, b.png"\r\n\r\n'
    text += "0, 1, 2, -1, c.png\r\n0,1,2,1,c.png\r\n"
    found = read(tmp_path, text, TARGET)
    assert found.photos == ("a, b.png", "c.png")
    assert found.photo.tolist() == [0, 1, 1]
    assert found.view.tolist() == [DIRECT, DIRECT, 1]
    assert found.point.tolist() == [3, 0, 0]
    assert found.pixels.tolist() == [[1.5, 20], [1, 2], [1, 2]]
    assert (found.sigma > 0).all()


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("image,view,point,x\n", f"the column y is missing; the header must read {KNOWN}"),
        (
            "image,view,points,x,y\n",
            f"the column point is missing; the header must read {KNOWN}; 'points' is unknown, did you mean point?",
        ),
        (
            "image,view,point,x,y,sgima\n",
            "the columns are image, view, point, x, y, sigma, channel; 'sgima' is unknown, did you mean sigma?",
        ),
        ("image;view;point;x;y\n", f"the columns are not separated by commas; the header must read {HEAD[:-1]}"),
        ("image,view,point,x,y,x\n", "a column stands twice in the header: image, view, point, x, y, x"),
        (HEAD, "there are no rows below the header"),
        (HEAD + "a,0,0,1,2\na,0,1,1\n", "line 3: wanted 5 values (image, view, point, x, y), got 4"),
        (HEAD + "a,0,0,1,2\n\na,0,1,one,2\n", "line 4: x = 'one' must be a number of px"),
        (HEAD + "a,0,0,1,2\na,0,1,1,nan\n", "line 3: y = 'nan' must be a number of px"),
        (HEAD + "a,0,0,1e999,2\n", "line 2: x = '1e999' must be a number of px"),
        (HEAD + "a,0,0,1,\n", "line 2: y = '' must be a number of px"),
        (HEAD + "a,-2,0,1,2\n", f"line 2: view = '-2' {VIEW}"),
        (HEAD + "a,left,0,1,2\n", f"line 2: view = 'left' {VIEW}"),
        (HEAD + "a,0,1.5,1,2\n", f"line 2: point = '1.5' {POINT}"),
        (HEAD + "a,0,3,1,2\na,0,4,1,2\n", f"line 3: point = '4' {POINT}"),
        (HEAD + ",0,0,1,2\n", "line 2: image is empty; wanted a photograph's name"),
        (HEAD + "a,0,1,1,2\nb,0,1,1,2\na,1,1,1,2\na,0,1,5,6\n", "lines 2 and 5: a, view 0 shows point 1 twice"),
        ("image,view,point,x,y,sigma\na,0,1,1,2,0\n", "line 2: sigma = '0' must be a number of px above 0"),
    ],
)
def test_faults_are_named(text, said, tmp_path):
    assert fault(tmp_path, text, TARGET) == said


def test_a_file_that_is_no_text_is_refused(tmp_path):
    (tmp_path / "corners.csv").write_bytes(b"\xff\xfe\x00image")
    with pytest.raises(SetupError, match="this is no text"):
        read_observations(tmp_path / "corners.csv")


def test_colours_may_show_a_point_more_than_once(tmp_path):
    text = "image,view,point,x,y,channel\na,0,1,1,2,0\na,0,1,1.5,2,2\n"
    assert read(tmp_path, text).channel.tolist() == [0, 2]
    assert "twice" in fault(tmp_path, text + "a,0,1,1,3,2\n")


def test_many_rows_come_back(tmp_path):
    given = many(90_000)
    write_observations(tmp_path / "o.csv", given)
    same(read_observations(tmp_path / "o.csv"), given)
