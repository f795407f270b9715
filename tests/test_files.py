"""Files: they appear whole or not at all, what is written comes back, and a wrong file is told from a right one."""

import errno
import os
from pathlib import Path

import numpy as np
import pytest

from cyclopean.cameras import Camera
from cyclopean.errors import ImageError, OutputError, SetupError, ShapeError
from cyclopean.files import (
    check_exposure,
    output_folder,
    read_depths,
    read_photograph,
    read_setup,
    write_depths,
    write_image,
    write_ply,
    write_setup,
)
from cyclopean.optics import Prism
from cyclopean.rigs import Setup

# Reading and writing at all.

SETUP = Setup(Camera((1280, 960), 2400), Prism(3, 12.0, "N-BK7", 60.0))
WRITERS = {
    "rig.toml": lambda path: write_setup(SETUP, path),
    "depth.npz": lambda path: write_depths(path, depth=np.ones((2, 3))),
    "cloud.ply": lambda path: write_ply(path, np.ones((2, 3))),
    "picture.png": lambda path: write_image(path, np.zeros((2, 3), np.uint8)),
}


@pytest.mark.parametrize(
    ("reader", "error"), [(read_setup, SetupError), (read_photograph, ImageError), (read_depths, ImageError)]
)
def test_a_path_that_leads_nowhere_is_said_so(tmp_path, monkeypatch, reader, error):
    with pytest.raises(error, match=f"nothing: there is no such file in {tmp_path}"):
        reader(tmp_path / "nothing")
    with pytest.raises(error, match=f"nothing: there is no folder {tmp_path / 'no'}"):
        reader(str(tmp_path / "no" / "nothing"))
    with pytest.raises(error, match=f"^{tmp_path}: this is a folder; name a file in it"):
        reader(tmp_path)

    def refuse(path):
        raise PermissionError(errno.EACCES, "Permission denied")

    monkeypatch.setattr(Path, "read_bytes", refuse)
    with pytest.raises(error, match="no permission to read the file"):
        reader(tmp_path / "secret")


@pytest.mark.parametrize("name", WRITERS)
def test_files_appear_whole_or_not_at_all(tmp_path, monkeypatch, name):
    write, file = WRITERS[name], tmp_path / name
    write(file)
    write(file)  # over the first
    whole = file.read_bytes()
    assert os.listdir(tmp_path) == [name]

    def fail(source, target):
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(os, "replace", fail)
    with pytest.raises(OutputError, match=f"^{file}: cannot be written: the disk that holds {tmp_path} is full"):
        write(file)
    assert file.read_bytes() == whole
    assert os.listdir(tmp_path) == [name]


@pytest.mark.parametrize("name", WRITERS)
def test_a_place_that_takes_no_file_is_said_so(tmp_path, monkeypatch, name):
    write, (folder, blocker) = WRITERS[name], (tmp_path / name, tmp_path / "blocker")
    folder.mkdir()
    blocker.write_text("")
    with pytest.raises(OutputError, match=f"there is no folder {tmp_path / 'no'}; make it first"):
        write(tmp_path / "no" / name)
    with pytest.raises(OutputError, match=f"{blocker} is a file, not a folder"):
        write(blocker / name)
    with pytest.raises(OutputError, match="this is a folder; name a file in it"):
        write(folder)
    with pytest.raises(OutputError, match="File name too long"):
        write(tmp_path / f"{'a' * 300}{name}")
    with monkeypatch.context() as patched:
        patched.setattr(os, "access", lambda path, mode: False)
        (tmp_path / "old").mkdir()
        (tmp_path / "old" / name).write_text("")
        with pytest.raises(OutputError, match="the file is write-protected"):
            write(tmp_path / "old" / name)
    assert sorted(os.listdir(tmp_path)) == sorted([name, "blocker", "old"])


def test_a_device_is_not_replaced_and_a_link_stays(tmp_path):
    with pytest.raises(OutputError, match="this is no ordinary file"):
        write_setup(SETUP, os.devnull)
    (tmp_path / "link").symlink_to(tmp_path / "target")
    write_setup(SETUP, tmp_path / "link")
    assert (tmp_path / "link").is_symlink()
    assert read_setup(tmp_path / "target").optic.facets == 3


def test_an_output_folder_is_made_or_refused_before_the_work(tmp_path, monkeypatch):
    folder = output_folder(tmp_path / "a" / "b")
    assert folder.is_dir()
    assert output_folder(str(folder)) == folder
    assert os.listdir(folder) == []
    (folder / "file").write_text("")
    for place in (folder / "file", folder / "file" / "c"):
        with pytest.raises(
            OutputError, match=f"^{place}: results cannot be written there: {folder / 'file'} is a file"
        ):
            output_folder(place)

    def refuse(*_, **__):
        raise PermissionError(errno.EACCES, "Permission denied")

    monkeypatch.setattr("tempfile.TemporaryFile", refuse)
    with pytest.raises(OutputError, match=f"no permission to write in {folder}"):
        output_folder(folder)

    def not_here(*_, **__):  # as Linux says of /proc/out
        raise FileNotFoundError(errno.ENOENT, "No such file or directory")

    monkeypatch.setattr(Path, "mkdir", not_here)
    with pytest.raises(OutputError, match=f"nothing can be made in {tmp_path};"):
        output_folder(tmp_path / "out" / "a")


@pytest.mark.skipif(not hasattr(os, "geteuid") or os.geteuid() == 0, reason="root may write anywhere")
def test_a_read_only_folder_is_refused(tmp_path):
    tmp_path.chmod(0o555)
    with pytest.raises(OutputError, match="no permission to write"):
        output_folder(tmp_path)


# Photographs.

rng = np.random.default_rng(3)
COLOUR = rng.integers(0, 255, (40, 60, 3), dtype=np.uint8)
SMOOTH = np.broadcast_to(np.arange(60, dtype=np.uint8)[:, None] + np.array([0, 60, 120], dtype=np.uint8), (40, 60, 3))


@pytest.mark.parametrize("ending", [".png", ".tif", ".tiff", ".bmp", ".PNG"])
@pytest.mark.parametrize("colours", [True, False])
@pytest.mark.parametrize("kind", [np.uint8, np.uint16, np.float32])
def test_a_picture_comes_back_as_it_was(tmp_path, ending, colours, kind):
    picture = (COLOUR if colours else COLOUR[..., 0]).astype(kind) * kind(1 if kind == np.uint8 else 200)
    file = tmp_path / f"bild é 写真{ending}"
    if (kind == np.float32 and "tif" not in ending) or (kind == np.uint16 and ending == ".bmp"):
        with pytest.raises(OutputError, match=f"{ending.lower()} files hold uint8.*got {np.dtype(kind)}"):
            write_image(file, picture)
        return
    write_image(file, picture)
    back = read_photograph(file, (60, 40))
    assert back.dtype == kind
    assert back.flags.c_contiguous
    np.testing.assert_array_equal(back, picture)


def test_a_jpeg_comes_back_nearly(tmp_path):
    write_image(tmp_path / "a.jpg", SMOOTH)
    difference = read_photograph(tmp_path / "a.jpg").astype(int) - SMOOTH
    assert np.abs(difference).max() < 12  # JPEG at OpenCV's quality of 95; swapped colours would differ by 120


@pytest.mark.parametrize("kind", [np.uint8, np.uint16])
def test_an_alpha_channel_is_dropped(tmp_path, kind):
    import cv2

    alpha = np.full((40, 60, 1), 7)
    with_alpha = np.concatenate([COLOUR[..., ::-1], alpha], axis=-1).astype(kind)
    (tmp_path / "a.png").write_bytes(cv2.imencode(".png", with_alpha)[1].tobytes())
    np.testing.assert_array_equal(read_photograph(tmp_path / "a.png"), COLOUR)


def test_exif_tags_do_not_turn_the_picture(tmp_path):
    write_image(tmp_path / "a.jpg", SMOOTH)
    data = (tmp_path / "a.jpg").read_bytes()
    turned = b"Exif\0\0MM\0*\0\0\0\x08\0\x01\x01\x12\0\x03\0\0\0\x01\0\x06\0\0\0\0\0\0"  # orientation 6: a quarter turn
    (tmp_path / "a.jpg").write_bytes(data[:2] + b"\xff\xe1" + (len(turned) + 2).to_bytes(2, "big") + turned + data[2:])
    assert read_photograph(tmp_path / "a.jpg").shape == (40, 60, 3)


def test_double_precision_is_read_as_float32_and_signed_pixels_are_refused(tmp_path):
    import cv2

    def write(kind):
        (tmp_path / "a.tif").write_bytes(cv2.imencode(".tif", COLOUR[..., 0].astype(kind))[1].tobytes())

    write(np.float64)
    assert read_photograph(tmp_path / "a.tif").dtype == np.float32
    write(np.int16)
    with pytest.raises(ImageError, match=r"a.tif: pixels must be 8 or 16 bits without sign, or float, got int16"):
        read_photograph(tmp_path / "a.tif")


@pytest.mark.parametrize(("ending", "name"), [(".png", "PNG"), (".jpg", "JPEG"), (".tif", "TIFF"), (".bmp", "BMP")])
@pytest.mark.parametrize("share", [0.1, 0.5, 0.99])
def test_a_truncated_photograph_is_told_from_a_whole_one(tmp_path, capfd, ending, name, share):
    file = tmp_path / f"a{ending}"
    write_image(file, COLOUR)
    data = file.read_bytes()
    file.write_bytes(data[: int(share * len(data))])
    with pytest.raises(ImageError, match=f"the file begins as {name} but cannot be read: it is truncated or damaged"):
        read_photograph(file)
    assert "OpenCV" not in capfd.readouterr().err


@pytest.mark.parametrize("content", [b"", b"hello" * 100])
def test_what_is_no_photograph_is_said_so(tmp_path, content):
    (tmp_path / "a.png").write_bytes(content)
    with pytest.raises(ImageError, match="is empty" if not content else "this is no image that can be read"):
        read_photograph(tmp_path / "a.png")


@pytest.mark.parametrize(
    ("size", "hint"),
    [
        ((40, 60), " It is turned by a quarter turn: turn it back"),
        ((120, 80), " It is exactly 0.5 times that size: take the original photograph"),
        ((20, 10), None),
    ],
)
def test_a_photograph_of_the_wrong_size_is_refused(tmp_path, size, hint):
    write_image(tmp_path / "a.png", COLOUR)
    with pytest.raises(ImageError) as caught:
        read_photograph(tmp_path / "a.png", size)
    said = f"{tmp_path / 'a.png'} is 60x40 px but the setup's camera has {size[0]}x{size[1]} px: "
    assert str(caught.value) == said + "is it the right setup, or was the photograph scaled?" + (hint or "")


HALVES = np.zeros((3, 40, 60), dtype=bool)
HALVES[0, :, :30] = HALVES[1, :, 30:] = True


@pytest.mark.parametrize("kind", [np.uint8, np.uint16, np.float32])
@pytest.mark.parametrize("colours", [True, False])
@pytest.mark.parametrize(
    ("level", "said"),
    [
        (None, []),
        (0, ["view 1 is black: is that facet blocked?"]),
        (2, ["view 1 is black: is that facet blocked?"]),
        (100, ["view 1 has the same value everywhere, 100"]),
        (255, ["view 1 is overexposed: 100 % of its pixels are white; take a shorter exposure"]),
    ],
)
def test_a_view_that_shows_nothing_is_named(kind, colours, level, said):
    image = COLOUR.astype(kind)
    if level is not None:
        image[:, 30:] = level
    warnings = check_exposure(image if colours else image[..., 0], HALVES[:2])
    assert [warning[: len(text)] for warning, text in zip(warnings, said, strict=True)] == said


def test_a_few_white_pixels_are_no_fault():
    image = COLOUR.copy()
    image[:18, 30:] = 255  # 45 % of the view
    assert check_exposure(image, HALVES[:2]) == []
    image[:22, 30:] = 255
    assert check_exposure(image, HALVES) == [
        "view 1 is overexposed: 55 % of its pixels are white; take a shorter exposure",
        "view 2 has no pixels in the photograph",
    ]


def test_a_photograph_that_shows_nothing_is_refused():
    with pytest.raises(ImageError, match=r"the photograph is black: was the lens covered\?"):
        check_exposure(np.zeros((40, 60, 3), np.uint8), HALVES)
    with pytest.raises(ImageError, match="the photograph is black"):
        check_exposure(np.full((40, 60), np.nan, np.float32), HALVES)
    with pytest.raises(ImageError, match=r"every pixel of the photograph is \[9, 0, 0\]: is this the right file"):
        check_exposure(np.broadcast_to(np.array([9, 0, 0], np.uint8), (40, 60, 3)), HALVES)
    with pytest.raises(ShapeError, match=r"masks must have shape \(V, 40, 60\), got \(40, 60\)"):
        check_exposure(COLOUR, HALVES[0])


def test_a_picture_must_have_a_known_ending_and_a_shape(tmp_path):
    with pytest.raises(OutputError, match=r"a.xyz: the name must end in one of .png, .tif"):
        write_image(tmp_path / "a.xyz", COLOUR)
    for shape in [(4,), (4, 5, 2), (0, 5, 3)]:
        with pytest.raises(ShapeError, match="a picture must have shape"):
            write_image(tmp_path / "a.png", np.zeros(shape, np.uint8))


# Point clouds.


def ply_columns(file):
    """What trimesh reads: its own view of the points, and every column of the file."""
    import trimesh

    cloud = trimesh.load(file)
    return cloud, cloud.metadata["_ply_raw"]["vertex"]["data"]


def test_another_reader_finds_every_column_of_a_cloud(tmp_path):
    points = rng.normal(size=(4, 5, 3))
    points[1, 2, 0] = np.nan
    points[3, 4] = np.inf
    points[0, 0, 2] = 1e39  # beyond float32
    normals, sigma = rng.normal(size=(4, 5, 3)), rng.uniform(size=(4, 5))
    normals[2, 2] = np.nan
    covariance = rng.normal(size=(4, 5, 3, 3))
    count = write_ply(tmp_path / "a.ply", points, COLOUR[:4, :5], normals, covariance, sigma)
    kept = np.ones((4, 5), dtype=bool)
    kept[[1, 3, 0], [2, 4, 0]] = False
    cloud, columns = ply_columns(tmp_path / "a.ply")
    assert count == len(cloud.vertices) == 17
    np.testing.assert_array_equal(cloud.vertices, points[kept].astype(np.float32))
    np.testing.assert_array_equal(cloud.colors[:, :3], COLOUR[:4, :5][kept])
    for k, name in enumerate(("nx", "ny", "nz")):
        np.testing.assert_array_equal(columns[name].ravel(), np.nan_to_num(normals[kept][:, k]).astype(np.float32))
    np.testing.assert_array_equal(columns["sigma"].ravel(), sigma[kept].astype(np.float32))
    np.testing.assert_array_equal(columns["covariance_xz"].ravel(), covariance[kept][:, 0, 2].astype(np.float32))


def test_a_cloud_of_bare_points_and_of_none(tmp_path):
    assert write_ply(tmp_path / "a.ply", [[1, 2, 3.0]]) == 1
    np.testing.assert_array_equal(ply_columns(tmp_path / "a.ply")[0].vertices, [[1, 2, 3]])
    assert write_ply(tmp_path / "a.ply", np.full((3, 3), np.nan)) == 0
    assert b"element vertex 0\n" in (tmp_path / "a.ply").read_bytes()


@pytest.mark.parametrize(
    ("columns", "said"),
    [
        ({"colors": np.zeros((4, 3))}, "colors must be uint8, 0 to 255, got float64"),
        ({"colors": np.zeros((4,), np.uint8)}, r"colors must have shape \(4, 3\), as the points do, got \(4,\)"),
        ({"normals": np.zeros((3, 3))}, r"normals must have shape \(4, 3\), as the points do, got \(3, 3\)"),
        ({"sigma": np.zeros((4, 1))}, r"sigma must have shape \(4,\), as the points do, got \(4, 1\)"),
        ({"covariance": np.zeros((4, 6))}, r"covariance must have shape \(4, 3, 3\), as the points do, got \(4, 6\)"),
    ],
)
def test_columns_that_do_not_fit_the_points_are_refused(tmp_path, columns, said):
    with pytest.raises(ShapeError, match=said):
        write_ply(tmp_path / "a.ply", np.zeros((4, 3)), **columns)
    assert os.listdir(tmp_path) == []


# Depth maps.


def test_a_depth_map_comes_back(tmp_path):
    depth = rng.uniform(500, 900, (4, 5))
    depth[1, 1] = np.nan
    view = rng.integers(-1, 3, (4, 5))
    write_depths(tmp_path / "a", depth=depth, confidence=depth / 900, sigma=depth / 9e4, view=view)
    assert os.listdir(tmp_path) == ["a"]  # the name is kept, no ending is added
    back = read_depths(tmp_path / "a")
    assert {name: array.dtype.name for name, array in back.items()} == {
        "depth": "float32", "confidence": "float32", "sigma": "float32", "view": "int8"
    }  # fmt: skip
    np.testing.assert_array_equal(back["depth"], depth.astype(np.float32))
    np.testing.assert_array_equal(back["view"], view)
    with np.load(tmp_path / "a") as file:
        assert "depth: mm, z of what the pixel shows, in the camera frame" in str(file["conventions"])


@pytest.mark.parametrize(
    ("arrays", "said"),
    [
        ({}, "a depth file holds depth and, if known"),
        ({"depth": np.ones((2, 3)), "deptth": 1}, "got depth, deptth"),
        ({"depth": np.ones(3)}, r"depth must have shape \(H, W\)"),
        ({"depth": np.ones((2, 3)), "sigma": np.ones((3, 2))}, r"and sigma the same, got \(2, 3\) and \(3, 2\)"),
        (
            {"depth": np.ones((2, 3)), "view": np.ones((2, 3))},
            "view must hold whole numbers from -1 to 127, got float64",
        ),
        ({"depth": np.ones((2, 3)), "view": np.full((2, 3), 128)}, "view must hold whole numbers from -1 to 127"),
    ],
)
def test_arrays_that_are_no_depth_map_are_refused(tmp_path, arrays, said):
    with pytest.raises(ShapeError, match=said):
        write_depths(tmp_path / "a.npz", **arrays)


def test_what_is_no_depth_map_is_said_so(tmp_path):
    file = tmp_path / "a.npz"
    write_depths(file, depth=rng.uniform(size=(40, 50)))
    data = file.read_bytes()
    damaged = bytearray(data)
    damaged[len(data) // 2] ^= 255
    for content in (data[: len(data) // 2], bytes(damaged)):
        file.write_bytes(content)
        with pytest.raises(ImageError, match=r"a.npz: the depth map is truncated or damaged; copy it again"):
            read_depths(file)
    np.savez(file, x=np.ones(3))
    with pytest.raises(ImageError, match="this NPZ file holds no array named depth"):
        read_depths(file)
    with open(file, "wb") as stream:
        np.save(stream, np.ones(3))
    with pytest.raises(ImageError, match="this is no NPZ file"):
        read_depths(file)
