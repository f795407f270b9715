"""The command line as a person meets it: results, and one clear line for every fault."""

import json
import re

import numpy as np
import pytest
import trimesh
from commands import run
from scenes import photograph_plane, small_setup

from cyclopean import read_photograph, write_setup
from cyclopean.files import read_depths, write_image


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    """A folder with photo.png and setup.toml of a small scene."""
    folder = tmp_path_factory.mktemp("cli")
    setup = small_setup()
    photograph, _ = photograph_plane(setup.rig(), 800.0)
    write_image(folder / "photo.png", photograph)
    write_setup(setup, folder / "setup.toml")
    return folder


def test_reconstruct_writes_everything(files, tmp_path, monkeypatch, capsys):
    out = tmp_path / "new" / "out"
    status, said, _ = run(
        monkeypatch, capsys, "reconstruct", files / "photo.png", "--setup", files / "setup.toml", "-o", out
    )
    assert status == 0
    assert "points in" in said
    names = {"points.ply", "depth.npz", "depth.png", "regions.png", "overview.png", "report.html"}
    assert {path.name for path in out.iterdir()} == names
    depths = read_depths(out / "depth.npz")
    known = np.isfinite(depths["depth"])
    assert abs(np.median(depths["depth"][known]) - 800) < 2  # 0.25 %
    cloud = trimesh.load(out / "points.ply")
    assert known.sum() / 3 < len(cloud.vertices) < known.sum()  # what several of the three views show is there once
    assert abs(np.median(cloud.vertices[:, 2]) - 800) < 2
    report = (out / "report.html").read_text()
    assert report.count("data:image/png;base64,") == 3
    assert "http" not in re.sub("base64,[^']*", "", report)  # self-contained
    for picture in ("depth.png", "regions.png", "overview.png"):
        assert read_photograph(out / picture).std() > 10  # not blank


@pytest.mark.parametrize(("apex", "depth", "came"), [(12.0, "1000..1100", "no depth"), (9.0, "500..1200", "% of the")])
def test_few_depths_are_a_warning_also_in_the_report(apex, depth, came, files, tmp_path, monkeypatch, capsys):
    write_setup(small_setup(apex_deg=apex, azimuth_deg=90 if apex == 12 else 60), tmp_path / "setup.toml")
    words = "reconstruct", files / "photo.png", "-s", tmp_path / "setup.toml", "-o", tmp_path, "--depth", depth
    status, said, _ = run(monkeypatch, capsys, *words, "--mesh", "ply")
    assert status == 0
    report = (tmp_path / "report.html").read_text()
    for text in (said, report.partition("class='warning'>")[2]):
        assert came in text
        assert "is this the setup that took" in text


def test_info_prints_the_rig(files, monkeypatch, capsys):
    status, said, _ = run(monkeypatch, capsys, "info", files / "setup.toml", "--depth", "600..1000")
    assert status == 0
    said = " ".join(said.split())  # where lines break depends on the length of the path
    for words in ("3 views", "virtual cameras", "baseline (mm)", "angle of axes", "departure", "sigma of depth"):
        assert words in said


def test_split_writes_the_sub_images(files, tmp_path, monkeypatch, capsys):
    status, _, _ = run(
        monkeypatch, capsys, "split", files / "photo.png", "--setup", files / "setup.toml", "-o", tmp_path
    )
    assert status == 0
    places = json.loads((tmp_path / "views.json").read_text())
    photograph, rig = read_photograph(files / "photo.png"), small_setup().rig()
    for place, view in zip(places, rig, strict=True):
        part = read_photograph(tmp_path / place["file"])
        x, y, width, height = (place[key] for key in ("x", "y", "width", "height"))
        mask = view.region.mask[y : y + height, x : x + width]
        np.testing.assert_array_equal(part, np.where(mask, photograph[y : y + height, x : x + width], 0))


def test_help_and_version_answer(monkeypatch, capsys):
    for words in (["--help"], ["reconstruct", "--help"], ["info", "--help"], ["split", "--help"], ["demo", "--help"]):
        status, said, _ = run(monkeypatch, capsys, *words)
        assert status == 0
        assert "Usage" in said
    assert run(monkeypatch, capsys, "--version")[1].strip()


def written(folder, name, text):
    path = folder / name
    path.write_text(text)
    return path


SETUP = '[camera]\nsize_px = [320, 240]\nfocal_px = 600\n[optic]\nkind = "prism"\nfacets = 3\napex_deg = 12.0\n'
PRISM = SETUP + 'glass = "N-BK7"\ndistance_mm = 60.0\n'


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (PRISM.replace("12.0", "60.0"), ["totally reflected", "apex_deg=60", "below 41"]),
        (PRISM + "thickness_mm = 2.0\nradius_mm = 30.0\n", ["facets cross inside the glass", "thickness"]),
        (PRISM.replace("N-BK7", "N-BK77"), ["N-BK77", "N-BK7"]),
        (PRISM.replace("apex_deg", "apex_angel_deg"), ["apex_angel_deg", "did you mean", "apex_deg"]),
        (PRISM.replace("distance_mm", "distance_cm"), ["distance_cm", "mm"]),
        (PRISM.replace("12.0", "-3"), ["apex_deg", "-3"]),
        (PRISM.replace("facets = 3", "facets = 1"), ["facets", "2"]),
        (PRISM.replace("60.0", '"far"'), ["distance_mm", "far"]),
        ("[camera\n", ["TOML", "line 1"]),
    ],
)
def test_bad_setups_are_named(text, words, files, tmp_path, monkeypatch, capsys):
    path = written(tmp_path, "bad.toml", text)
    for command in (["info", path], ["split", files / "photo.png", "-s", path, "-o", tmp_path / "out"]):
        status, _, error = run(monkeypatch, capsys, *command)
        assert status == 2
        assert "bad.toml" in error or "totally reflected" in error
        for word in words:
            assert word in error


def test_bad_photographs_are_named(files, tmp_path, monkeypatch, capsys):
    write_image(tmp_path / "small.png", np.full((100, 100), 9, np.uint8))
    write_image(tmp_path / "black.png", np.zeros((240, 320), np.uint8))
    cases = {
        tmp_path / "missing.png": ["missing.png"],
        written(tmp_path, "text.png", "no image"): ["text.png"],
        tmp_path / "small.png": ["100x100", "320x240"],
        tmp_path / "black.png": ["black"],
        tmp_path: [str(tmp_path)],
    }
    for photo, words in cases.items():
        status, _, error = run(
            monkeypatch, capsys, "reconstruct", photo, "-s", files / "setup.toml", "-o", tmp_path / "out"
        )
        assert status == 2, photo
        for word in words:
            assert word in error


def test_a_blocked_facet_is_a_warning(files, tmp_path, monkeypatch, capsys):
    rig = small_setup().rig()
    photograph = read_photograph(files / "photo.png").copy()
    photograph[rig[1].region.traced] = 0
    write_image(tmp_path / "blocked.png", photograph)
    out = tmp_path / "out"
    status, said, _ = run(
        monkeypatch, capsys, "reconstruct", tmp_path / "blocked.png", "-s", files / "setup.toml", "-o", out
    )
    assert status == 0
    assert "view 1" in said
    assert "blocked" in said
    depths = read_depths(out / "depth.npz")
    assert not np.isfinite(depths["depth"][rig[1].region.mask]).any()
    assert np.isfinite(depths["depth"]).any()


@pytest.mark.parametrize("depth", ["600", "1000..600", "near..far", "-5..100"])
def test_bad_depth_ranges_are_named(depth, files, tmp_path, monkeypatch, capsys):
    status, _, error = run(
        monkeypatch, capsys, "reconstruct", files / "photo.png", "-s", files / "setup.toml", "-o", tmp_path / "x",
        f"--depth={depth}",
    )  # fmt: skip
    assert status == 2
    assert "NEAR..FAR" in error or "NEAR < FAR" in error


@pytest.mark.parametrize(
    ("option", "words"),
    [
        ("--step=0", "between 0.01 and 10 px"),
        ("--step=nan", "between 0.01 and 10 px"),
        ("--memory=0", "64 MiB"),
        ("--memory=nan", "64 MiB"),
        ("--threads=999", "--threads must lie between"),
    ],
)
def test_bad_options_are_named(option, words, files, tmp_path, monkeypatch, capsys):
    status, _, error = run(
        monkeypatch, capsys, "reconstruct", files / "photo.png", "-s", files / "setup.toml", "-o", tmp_path, option
    )
    assert status == 2
    assert words in error


def test_results_that_cannot_be_written_fail_before_the_work(files, tmp_path, monkeypatch, capsys):
    taken = written(tmp_path, "taken", "a file, not a folder")
    status, _, error = run(
        monkeypatch, capsys, "reconstruct", files / "photo.png", "-s", files / "setup.toml", "-o", taken
    )
    assert status == 2
    assert "taken" in error
    assert taken.read_text() == "a file, not a folder"


def test_an_interrupted_run_keeps_what_was_made(files, tmp_path, monkeypatch, capsys):
    from cyclopean.matching import dense

    real, calls = dense.search, []

    def interrupted(*arguments, **options):
        if calls:
            raise KeyboardInterrupt
        calls.append(1)
        return real(*arguments, **options)

    monkeypatch.setattr(dense, "search", interrupted)
    out = tmp_path / "out"
    out.mkdir()
    written(out, "points.ply", "earlier results")
    status, said, error = run(
        monkeypatch, capsys, "reconstruct", files / "photo.png", "-s", files / "setup.toml", "-o", out
    )
    assert status == 130
    assert "kept" in said + error
    assert "unchecked_view_0.npz" in error
    assert "unchecked_view_1.npz" not in error
    assert (out / "points.ply").read_text() == "earlier results"
    with np.load(out / "unchecked_view_0.npz") as kept:
        assert np.isfinite(kept["inverse_depth"]).any()


def test_an_interrupted_run_without_results_promises_none(files, tmp_path, monkeypatch, capsys):
    from cyclopean import pipeline

    def interrupted(*arguments, **options):
        raise KeyboardInterrupt

    monkeypatch.setattr(pipeline, "reconstruct", interrupted)
    status, _, error = run(
        monkeypatch, capsys, "reconstruct", files / "photo.png", "-s", files / "setup.toml", "-o", tmp_path
    )
    assert (status, error) == (130, "cyclopean: interrupted\n")


def test_a_fault_of_ours_is_one_line(files, monkeypatch, capsys):
    from cyclopean.jobs import setups

    monkeypatch.setattr(setups, "print_info", lambda *arguments: 1 / 0)
    status, _, error = run(monkeypatch, capsys, "info", files / "setup.toml")
    assert status == 70
    assert "ZeroDivisionError" in error


def test_the_demo_files_are_there():
    from cyclopean.jobs.reconstruction import demo_files

    photo, setup = demo_files()
    assert photo.is_file()
    assert setup.is_file()


@pytest.mark.parametrize(
    "words",
    [
        ("tolerance", "setup.toml", "--draws", "2.5"),
        ("fov", "setup.toml", "--views", "nan"),
        ("experiment", "biprism", "--photos", "7.5"),
        ("reconstruct", "photo.png", "--setup", "setup.toml", "--threads", "one"),
    ],
)
def test_a_count_is_a_whole_number(words, monkeypatch, capsys):
    status, said, complaint = run(monkeypatch, capsys, *words)
    assert status != 0
    assert f"whole number, got '{words[-1]}'" in " ".join((said + complaint).split())
