"""`cyclopean import` and `cyclopean export` as a person meets them."""

import numpy as np
import pytest
from commands import run
from scenes import small_setup
from test_exchange import FULL, NO_K3, POSES, same

from cyclopean import Camera, Mirror, Mirrors, Setup
from cyclopean.errors import SetupError
from cyclopean.files import read_setup, write_setup
from cyclopean.files.exchange import NamedCamera, read_cameras, write_cameras
from cyclopean.rigs.virtual import fit


@pytest.fixture
def setup_file(tmp_path):
    setup = small_setup()
    write_setup(setup, tmp_path / "setup.toml")
    return tmp_path / "setup.toml"


OPTIC = '[optic]\nkind = "prism"\nfacets = 3\napex_deg = 12\nindex = 1.5168\ndistance_mm = 60\n'


def test_an_imported_camera_becomes_part_of_a_setup(tmp_path, monkeypatch, capsys):
    write_cameras(tmp_path / "lens.yml", [NamedCamera("lens", FULL)], "opencv")
    status, said, _ = run(monkeypatch, capsys, "import", tmp_path / "lens.yml", "-o", tmp_path / "camera.toml")
    assert status == 0
    assert "opencv" in said
    camera = tmp_path / "camera.toml"
    with pytest.raises(SetupError, match="optic"):
        read_setup(camera)
    camera.write_text(camera.read_text() + OPTIC)
    same(NamedCamera("", read_setup(camera).camera), NamedCamera("", FULL), digits=0)
    again = (tmp_path / "lens.yml", "--setup", camera, "-o", tmp_path / "other.toml")
    assert run(monkeypatch, capsys, "import", *again)[0] == 0
    same(NamedCamera("", read_setup(tmp_path / "other.toml").camera), NamedCamera("", FULL), digits=0)


def test_one_camera_of_many_must_be_chosen(tmp_path, setup_file, monkeypatch, capsys):
    other = NamedCamera("b", NO_K3, POSES[1])
    write_cameras(tmp_path / "c.toml", [NamedCamera("a", FULL, POSES[0]), other])
    to = ("-o", tmp_path / "camera.toml")
    status, _, errors = run(monkeypatch, capsys, "import", tmp_path / "c.toml", *to)
    assert status == 2
    assert "choose one with --camera: a, b" in errors
    assert run(monkeypatch, capsys, "import", tmp_path / "c.toml", "--camera", "b", *to)[0] == 0
    assert "901.5" in (tmp_path / "camera.toml").read_text()
    assert (
        "no camera has the name 'z'" in run(monkeypatch, capsys, "import", tmp_path / "c.toml", "--camera", "z", *to)[2]
    )
    wrong_size = run(monkeypatch, capsys, "import", tmp_path / "c.toml", "--camera", "b", "--setup", setup_file, *to)
    assert "640 x 480 px, the one of" in wrong_size[2]
    assert "wants WIDTHxHEIGHT" in run(monkeypatch, capsys, "import", tmp_path / "c.toml", "--size", "640", *to)[2]
    write_cameras(tmp_path / "model", [NamedCamera("a", FULL, POSES[0]), NamedCamera("b", FULL, POSES[1])], "colmap")
    assert run(monkeypatch, capsys, "import", tmp_path / "model", *to)[0] == 0  # one camera, two photographs


def test_virtual_cameras_are_exported(tmp_path, setup_file, monkeypatch, capsys):
    status, said, _ = run(
        monkeypatch, capsys, "export", setup_file, "-o", tmp_path / "rig.toml", "--depth", "600..1100"
    )
    assert status == 0
    assert "departure rms (px)" in said
    rig = small_setup().rig()
    for found, view in zip(read_cameras(tmp_path / "rig.toml"), rig, strict=True):
        virtual = fit(view, (600.0, 1100.0))
        same(found, NamedCamera("", virtual.camera, virtual.camera_from_rig), digits=1e-9)
    words = ("export", setup_file, "-o", tmp_path / "pair.caldat", "--view", 0, "--view", 2)
    status, said, _ = run(monkeypatch, capsys, *words)
    assert status == 0
    assert "note: a .caldat file does not say the size" in said
    assert len(read_cameras(tmp_path / "pair.caldat", size=(320, 240))) == 2
    status, said, _ = run(monkeypatch, capsys, "export", setup_file, "-o", tmp_path / "r.yml", "--format", "opencv")
    assert "one file for each camera: r-0.yml, r-1.yml, r-2.yml" in said
    assert (
        "there is no view 7"
        in run(monkeypatch, capsys, "export", setup_file, "-o", tmp_path / "x.toml", "--view", 7)[2]
    )
    assert "does not tell the format" in run(monkeypatch, capsys, "export", setup_file, "-o", tmp_path / "x.yml")[2]


def test_the_real_camera_is_exported(tmp_path, setup_file, monkeypatch, capsys):
    words = ("export", setup_file, "--what", "camera", "-o", tmp_path / "lens.cameramodel")
    assert run(monkeypatch, capsys, *words)[0] == 0
    (found,) = read_cameras(tmp_path / "lens.cameramodel")
    same(found, NamedCamera("", small_setup().camera, POSES[0]))


@pytest.mark.parametrize(
    ("more", "expected"),
    [
        ((), "holds two cameras, but the setup has 3 views: give two views, --what virtual --view 0 --view 1"),
        (("--view", 1), "but --view names 1"),
        (("--what", "camera"), "the real camera is one: give two views, --what virtual --view 0 --view 1"),
    ],
)
@pytest.mark.parametrize("name", ["pair.caldat", "pair.txt"])
def test_matchid_wants_two_views(more, expected, name, tmp_path, setup_file, monkeypatch, capsys):
    words = ("export", setup_file, "-o", tmp_path / name, *(("--format", "matchid") if name != "pair.caldat" else ()))
    status, said, errors = run(monkeypatch, capsys, *words, *more)
    assert status == 2
    assert expected in errors
    assert "departure" not in said  # before the work
    assert not (tmp_path / name).exists()


def test_mirrored_views_are_exported_for_the_flipped_photograph(tmp_path, monkeypatch, capsys):
    mirror = Mirror((40.0, 0.0, 200.0), (-1.0, 0.0, -0.4), (150.0, 150.0))
    setup = Setup(Camera((320, 240), 600), Mirrors((mirror,), ((0,),), direct=True), depths=(500.0, 1200.0))
    write_setup(setup, tmp_path / "mirror.toml")
    words = ("export", tmp_path / "mirror.toml", "-o", tmp_path / "rig.toml")
    status, _, errors = run(monkeypatch, capsys, *words)
    assert status == 2
    assert "mirrored" in errors
    assert "--flip" in errors
    status, said, _ = run(monkeypatch, capsys, *words, "--flip")
    assert status == 0
    assert "camera of the photograph flipped left to right" in said
    rig = setup.rig()
    number = next(k for k, view in enumerate(rig) if view.mirrored)
    found = read_cameras(tmp_path / "rig.toml")[number]
    pixel = rig[number].region.centre
    point = rig[number].rays(pixel).at(500.0)
    seen = found.camera.project(found.pose @ point)
    np.testing.assert_allclose(seen, (319 - pixel[0], pixel[1]), atol=1e-3)  # px; a mirror's view is a pinhole: the fit
