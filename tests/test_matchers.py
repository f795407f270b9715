"""Matchers that a person asks for by name: a function in a file or a module, and those that ship here."""

import re
from pathlib import Path

import numpy as np
import pytest
from commands import run
from scenes import photograph_plane, small_setup

from cyclopean import write_setup
from cyclopean.errors import SetupError
from cyclopean.files import read_depths, write_image
from cyclopean.jobs.matchers import chosen_engine, find_matcher
from cyclopean.pipeline import reconstruct, reconstruct_by_pairs

ROOT = Path(__file__).resolve().parents[1]


@pytest.mark.parametrize(
    ("source", "words", "told"),
    [
        ("", "sgmb", "did you mean sgbm"),
        ("", "own.py", "wanted own.py:FUNCTION"),
        ("", "own.py:", "package.module:function"),
        ("", "missing.py:f", "no file missing.py"),
        ("", "no_such_module_here:f", "no module no_such_module_here"),
        ("", "a b:f", "'a b' is neither"),
        ("def g(left, right, count): pass", "own.py:f", "no function f; it has g"),
        ("f = 3", "own.py:f", "no function: int"),
        ("import no_such_package", "own.py:f", "needs the module no_such_package"),
        ("\ndef f(:", "own.py:f", r"own.py, line 2"),
        ("\n\n1 / 0", "own.py:f", r"ZeroDivisionError: division by zero \(.*own.py, line 3\)"),
        ("import sys; sys.exit(3)", "own.py:f", "SystemExit"),
    ],
)
def test_matchers_that_cannot_be_had_are_named(source, words, told, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "own.py").write_text(source)
    with pytest.raises(SetupError, match=told):
        find_matcher(words)


def test_a_file_may_import_its_neighbour_and_a_module_lie_in_the_present_folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("sys.path", [])
    (tmp_path / "neighbour_of_mine.py").write_text("def f(left, right, count):\n    return left * 0.5")
    (tmp_path / "mine.py").write_text("from neighbour_of_mine import f")
    for words in ("mine.py:f", "neighbour_of_mine:f"):
        assert find_matcher(words)(np.ones((2, 2)), None, 16).sum() == 2
    assert find_matcher("cyclopean") is None


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    """A folder with photo.png, setup.toml and the matcher that the documentation shows."""
    folder = tmp_path_factory.mktemp("pairs")
    photograph, _ = photograph_plane(small_setup().rig(), 800.0)
    write_image(folder / "photo.png", photograph)
    write_setup(small_setup(), folder / "setup.toml")
    page = (ROOT / "docs" / "matchers.md").read_text(encoding="utf-8")
    (folder / "my_matcher.py").write_text(re.search(r"```python\n(.*?)```", page, re.DOTALL).group(1))
    (folder / "fails.py").write_text("def f(left, right, count):\n    return left.shape[7]")
    return folder


def test_the_command_takes_the_matcher_of_the_documentation(files, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(files)
    words = ("reconstruct", "photo.png", "-s", "setup.toml", "-o", tmp_path, "--matcher", "my_matcher.py:blocks")
    status, said, _ = run(monkeypatch, capsys, *words)
    assert status == 0
    assert "points in" in said
    depth = read_depths(tmp_path / "depth.npz")["depth"]
    assert np.isfinite(depth).sum() > 10_000
    assert abs(np.nanmedian(depth) - 800) < 4  # 0.5 %
    assert "my_matcher.py:blocks, on rectified pairs" in (tmp_path / "report.html").read_text()


def test_the_engine_is_the_one_asked_for():
    for words in ("sgbm", "sgbm-3way"):
        engine = chosen_engine(words, 1, 0.5, 1024)
        assert engine.run.func is reconstruct_by_pairs
        assert engine.run.keywords["scale"] == 1
        assert ("matcher", f"{words}, on rectified pairs") in engine.settings
    ours = chosen_engine("cyclopean", 2, 0.5, 1024)
    assert ours.run.func is reconstruct
    assert ("matcher", "cyclopean") in ours.settings


def test_the_command_names_what_is_wrong_with_a_matcher(files, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(files)
    for matcher, word in (("fails.py:f", "fails.py, line 2"), ("fails.py:g", "no function g"), ("sgbn", "sgbm")):
        status, _, error = run(
            monkeypatch, capsys, "reconstruct", "photo.png", "-s", "setup.toml", "-o", tmp_path, "--matcher", matcher
        )
        assert status == 2
        assert word in error
