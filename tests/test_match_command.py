"""`cyclopean match` as a person meets it."""

import csv
import itertools

import numpy as np
import pytest
from commands import run
from scenes import photograph_plane, small_setup

from cyclopean.errors import SetupError
from cyclopean.files import write_image, write_setup
from cyclopean.files.matches import read_points, write_matches


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A setup, and its photograph of a textured plane."""
    place = tmp_path_factory.mktemp("match")
    setup = small_setup()
    photograph, _ = photograph_plane(setup.rig(), 800.0, slope=0.3, pitch=1.3)
    write_setup(setup, place / "setup.toml")
    write_image(place / "photo.png", photograph)
    return place


@pytest.fixture(scope="module")
def rig():
    return small_setup().rig()


def rows_of(path):
    with open(path, newline="", encoding="utf-8") as file:
        return list(csv.DictReader(file))


def match(monkeypatch, capsys, folder, *words, photo="photo.png", setup="setup.toml"):
    return run(monkeypatch, capsys, "match", folder / photo, "--setup", folder / setup, *words)


def test_features(monkeypatch, capsys, folder, tmp_path, rig):
    status, out, _ = match(monkeypatch, capsys, folder, "-o", tmp_path / "out")
    assert status == 0
    assert "refused as ambiguous" in out
    rows = rows_of(tmp_path / "out" / "matches.csv")
    assert len(rows) > 40
    for row in itertools.islice(rows, 0, None, 7):
        point = np.array([float(row[name]) for name in "xyz"])
        slope = point[2] - 0.3 * point[0]
        # the plane is z = 800 + 0.3 x; the CSV says how well z is known
        assert abs(slope - 800) < 5 * float(row["sigma_z"]) + 0.5
        seen = [k for k in range(3) if row[f"u{k}"]]
        assert len(seen) == int(row["views"])
        for k in seen:
            pixel = np.array([float(row[f"u{k}"]), float(row[f"v{k}"])])
            assert np.linalg.norm(rig[k].project(point) - pixel) < 1.0
    for name in ("points.ply", "matches.png", "report.html"):
        assert (tmp_path / "out" / name).stat().st_size > 1000


def points_file(path, rig, views, header="view,x,y"):
    """The pixels of five points of the plane in some views."""
    x, y = np.array([-20.0, 0, 12, 25, 40]), np.array([-12.0, 5, -20, 8, 15])
    points = np.stack([x, y, 800 + 0.3 * x], -1)
    lines = [header]
    for k in views:
        pixels = rig[k].project(points)
        lines += [f"{k},{u:.3f},{v:.3f}" for u, v in pixels[rig[k].region.contains(pixels)]]
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return points


def test_points_of_several_views(monkeypatch, capsys, folder, tmp_path, rig):
    points = points_file(tmp_path / "points.csv", rig, range(3))
    given = match(
        monkeypatch, capsys, folder, "--points", tmp_path / "points.csv", "--max-ambiguity", 1, "-o", tmp_path
    )
    assert given[0] == 0
    rows = rows_of(tmp_path / "matches.csv")
    found = np.array([[float(row[name]) for name in "xyz"] for row in rows])
    assert len(found) >= 3
    # pixels are rounded to 0.0005 px; 0.1 px stand for some 5 mm of depth
    gap = np.linalg.norm(found[:, None] - points, axis=-1).min(1)
    assert gap.max() < 0.1


def test_points_of_one_view_are_looked_for_in_the_picture(monkeypatch, capsys, folder, tmp_path, rig):
    points = points_file(tmp_path / "points.csv", rig, [0])
    status, out, _ = match(monkeypatch, capsys, folder, "--points", tmp_path / "points.csv", "-o", tmp_path)
    assert status == 0
    assert "view 0" in out
    rows = rows_of(tmp_path / "matches.csv")
    assert rows
    for row in rows:
        found = np.array([float(row[name]) for name in "xyz"])
        sigma = float(row["sigma_z"])
        assert np.linalg.norm(points - found, axis=1).min() < 5 * sigma + 1
        # 0.1 px of 600 px focal length move a point at 800 mm by 0.13 mm sideways
        assert float(row["sigma_x"]) == pytest.approx(0.13, rel=0.3)
        assert "ambiguity" not in row
        assert 0 <= float(row["next_best"]) < 1
    report = (tmp_path / "report.html").read_text(encoding="utf-8")
    assert "0.1" in report.partition("pixel noise (px)")[2][:40]
    words = ("--points", tmp_path / "points.csv", "--max-ambiguity", 0.5, "-o", tmp_path)
    status, _, errors = match(monkeypatch, capsys, folder, *words)
    assert (status, "points of several views" in " ".join(errors.split())) == (2, True)


def test_stricter_means_fewer(monkeypatch, capsys, folder, tmp_path):
    match(monkeypatch, capsys, folder, "--min-views", 3, "-o", tmp_path)
    rows = rows_of(tmp_path / "matches.csv")
    assert rows
    assert {row["views"] for row in rows} == {"3"}


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("--depth", "900..500"), "NEAR"),
        (("--depth", "5..3000"), "inside the optic"),
        (("--noise-px", "0"), "--noise-px"),
        (("--noise-px", "nan"), "--noise-px"),
        (("--max-ambiguity", "2"), "--max-ambiguity"),
        (("--min-views", "1"), "--min-views"),
        (("--min-views", "4"), "3 views"),
        (("--detector", "sift", "--points", "a.csv"), "one of --detector"),
        (("--points", "missing.csv"), "missing.csv"),
        (("--board", "missing.toml"), "missing.toml"),
    ],
)
def test_wrong_options_are_told(monkeypatch, capsys, folder, tmp_path, words, said):
    status, _, errors = match(monkeypatch, capsys, folder, *words, "-o", tmp_path)
    assert status == 2
    assert said in errors
    assert not (tmp_path / "matches.csv").exists()


def test_a_wrong_photograph_is_told(monkeypatch, capsys, folder, tmp_path):
    write_image(folder / "small.png", np.full((100, 120), 90, np.uint8))
    status, _, errors = match(monkeypatch, capsys, folder, photo="small.png")
    assert (status, "120x100" in errors) == (2, True)
    status, _, errors = match(monkeypatch, capsys, folder, photo="none.png")
    assert (status, "no such file" in errors) == (2, True)
    noise = np.full((240, 320), 90, np.uint8)
    noise[0, 0] = 91
    write_image(folder / "flat.png", noise)
    status, _, errors = match(monkeypatch, capsys, folder, "-o", tmp_path, photo="flat.png")
    assert (status, "fewer than two views" in errors) == (2, True)


def test_one_view_cannot_be_matched(monkeypatch, capsys, folder, tmp_path):
    text = '[camera]\nsize_px = [320, 240]\nfocal_px = 600.0\n[optic]\nkind = "plate"\nindex = 1.5\n'
    (folder / "plate.toml").write_text(text + "distance_mm = 40.0\nthickness_mm = 5.0\n", encoding="utf-8")
    status, _, errors = match(monkeypatch, capsys, folder, "--depth", "500..900", "-o", tmp_path, setup="plate.toml")
    assert status == 2
    assert "view" in errors


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("", "empty"),
        ("view,x,y\n", "no rows"),
        ("x,y\n1,2\n", "column view"),
        ("view,x,y\n0,1\n", "line 2: wanted 3"),
        ("view,x,y\n\n0,1,2\n3,1,2\n", "line 4: view"),
        ("view,x,y\n-1,1,2\n", "line 2: view"),
        ("view,x,y\n0,nan,2\n", "line 2: x"),
        ("view,x,y\n0,1,two\n", "line 2: y"),
    ],
)
def test_faults_of_a_table_of_points(tmp_path, text, said):
    (tmp_path / "points.csv").write_text(text, encoding="utf-8")
    with pytest.raises(SetupError, match=said):
        read_points(tmp_path / "points.csv", 3)


def test_points_may_come_in_any_order(tmp_path):
    (tmp_path / "points.csv").write_text("\ufeffX, Y, View\n1.5,2,2\n3,4,0\n5,6,2\n", encoding="utf-8")
    found = read_points(tmp_path / "points.csv", 3)
    assert [one.tolist() for one in found] == [[[3.0, 4.0]], [], [[1.5, 2.0], [5.0, 6.0]]]


def test_numbers_come_back_from_the_table(tmp_path, rig):
    from cyclopean.correspondence import match_points

    points = points_file(tmp_path / "points.csv", rig, range(3))
    matches = match_points(rig, read_points(tmp_path / "points.csv", 3), (500, 1200), max_ambiguity=1.0)
    write_matches(tmp_path / "matches.csv", matches)
    rows = rows_of(tmp_path / "matches.csv")
    assert len(rows) == len(matches) <= len(points)
    for k, row in enumerate(rows):
        # four decimals of a mm, three of a px
        np.testing.assert_allclose([float(row[name]) for name in "xyz"], matches.points[k], atol=6e-5)
        pixels = [float(row[f"{axis}{v}"] or "nan") for v in range(3) for axis in "uv"]
        np.testing.assert_allclose(pixels, matches.pixels[k].ravel(), atol=6e-4)
