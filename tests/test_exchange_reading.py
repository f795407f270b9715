"""What other programs write, in their own words, and what is wrong with damaged files."""

import json
import struct
from contextlib import suppress

import cv2
import numpy as np
import pytest
from test_exchange import FULL, LENS, PLACES, POSES, cameras_for, same

from cyclopean.errors import SetupError
from cyclopean.files.exchange import FORMATS, NamedCamera, read_cameras, write_cameras


def test_opencv_stereo_pairs_are_read(tmp_path):
    storage = cv2.FileStorage(str(tmp_path / "stereo.yml"), cv2.FILE_STORAGE_WRITE)
    for name, value in (("M1", FULL.matrix), ("D1", np.zeros((1, 14))), ("M2", FULL.matrix), ("D2", np.array([LENS]))):
        storage.write(name, value)
    storage.write("R", POSES[1].rotation)
    storage.write("T", POSES[1].translation.reshape(3, 1))
    storage.release()
    with pytest.raises(SetupError, match="does not say the size"):
        read_cameras(tmp_path / "stereo.yml")
    first, second = read_cameras(tmp_path / "stereo.yml", size=(640, 480))
    assert first.camera.distortion == (0,) * 5
    same(second, NamedCamera("", FULL, POSES[1]))


def test_opencvs_own_sample_file_is_read(real):
    (found,) = read_cameras(real / "opencv_chess_stereo" / "left_intrinsics.yml")
    assert found.camera.size == (640, 480)
    assert found.camera.focal == pytest.approx((535.915734, 535.915734), abs=1e-6)  # as printed in the file
    printed = (-0.26637261, -0.03858890, 0.00178319, -0.00028122, 0.23839153)
    assert found.camera.distortion == pytest.approx(printed, abs=1e-8)
    assert found.pose is None


def test_mrcal_models_of_both_ages_are_read(tmp_path):
    file = tmp_path / "cam.cameramodel"
    for lens, motion in (("lens_model", "extrinsics"), ("lensmodel", "rt_cam_ref")):
        file.write_text(
            "# generated on a day\n{\n"
            f"    '{lens}':  'LENSMODEL_OPENCV8',\n    # a comment\n"
            "    'intrinsics': [ 1761.1, 1761.2, 1965.7, 1087.5, -0.012, 0.035, -2e-4, 5e-4, 0.019, 0., 0., 0.,],\n"
            f"    '{motion}': [ 2e-2, -3e-1, -1e-2,  1., 2, -3., ],\n    'imagersize': [ 4000, 2200 ],\n"
            "    'optimization_inputs': b'\\x00\"',\n}\n"
        )
        (found,) = read_cameras(file)
        assert found.camera.distortion == (-0.012, 0.035, -2e-4, 5e-4, 0.019)
        np.testing.assert_allclose(found.pose.translation, (1000, 2000, -3000))
    file.write_text(file.read_text().replace("0.019, 0., 0.", "0.019, 0.01, 0."))
    with pytest.raises(SetupError, match=r"goes beyond k1 k2 p1 p2 k3 \(k4 = 0.01\)"):
        read_cameras(file)
    file.write_text(file.read_text().replace("OPENCV8", "SPLINED_STEREOGRAPHIC_order=3"))
    with pytest.raises(SetupError, match=r"SPLINED.*has no place"):
        read_cameras(file)


@pytest.mark.parametrize(
    ("model", "values", "focal", "lens"),
    [
        ("SIMPLE_PINHOLE", "2559.81 320 240", (2559.81, 2559.81), (0, 0, 0, 0, 0)),
        ("PINHOLE", "2560.5 2561 320 240", (2560.5, 2561), (0, 0, 0, 0, 0)),
        ("SIMPLE_RADIAL", "900 320 240 -0.0218531", (900, 900), (-0.0218531, 0, 0, 0, 0)),
        ("RADIAL", "900 320 240 -0.02 0.01", (900, 900), (-0.02, 0.01, 0, 0, 0)),
        ("OPENCV", "900 901 320 240 -0.02 0.01 1e-3 2e-3", (900, 901), (-0.02, 0.01, 1e-3, 2e-3, 0)),
        ("FULL_OPENCV", "900 901 320 240 .1 .2 .3 .4 .5 0 0 0", (900, 901), (0.1, 0.2, 0.3, 0.4, 0.5)),
    ],
)
def test_colmap_models_are_read_as_text_and_binary(model, values, focal, lens, tmp_path):
    (tmp_path / "cameras.txt").write_text(f"# Camera list\n7 {model} 640 480 {values}\n")
    (tmp_path / "images.txt").write_text(
        "# Image list\n3 1 0 0 0 1 2 3 7 left 01.png\n\n9 0.6 0.8 0 0 4 5 6 7 b.png\n10 20 -1\n"
    )
    text = read_cameras(tmp_path)
    assert [found.name for found in text] == ["left 01.png", "b.png"]
    folder = tmp_path / "binary"
    folder.mkdir()
    numbers = [float(word) for word in values.split()]
    number = ("SIMPLE_PINHOLE", "PINHOLE", "SIMPLE_RADIAL", "RADIAL", "OPENCV", "", "FULL_OPENCV").index(model)
    (folder / "cameras.bin").write_bytes(struct.pack(f"<QiiQQ{len(numbers)}d", 1, 7, number, 640, 480, *numbers))
    image = struct.pack("<i7di", 3, 1, 0, 0, 0, 1, 2, 3, 7) + b"left 01.png\0" + struct.pack("<Qddq", 1, 10, 20, -1)
    image += struct.pack("<i7di", 9, 0.6, 0.8, 0, 0, 4, 5, 6, 7) + b"b.png\0" + struct.pack("<Q", 0)
    (folder / "images.bin").write_bytes(struct.pack("<Q", 2) + image)
    for found, binary in zip(text, read_cameras(folder), strict=True):
        same(binary, found)
        assert binary.name == found.name
        assert found.camera.focal == focal
        assert found.camera.centre == (319.5, 239.5)  # theirs, (320, 240), counts from the corner
        assert found.camera.distortion == lens
    np.testing.assert_allclose(text[1].pose.rotation[1:, 1:], [[-0.28, -0.96], [0.96, -0.28]], atol=1e-15)
    (folder / "images.bin").write_bytes((struct.pack("<Q", 2) + image)[:-3])
    with pytest.raises(SetupError, match="ends too early"):
        read_cameras(folder)


def test_ros_files_with_plain_text_numbers_are_read(tmp_path):
    (tmp_path / "ost.yaml").write_text(
        "image_width: 1280\nimage_height: 800\ncamera_name: narrow_stereo\ncamera_matrix:\n  rows: 3\n  cols: 3\n"
        "  data: [415.12614,   0.     , 665.52373,\n           0.     , 410.49986, 460.14929,\n"
        "           0.     ,   0.     ,   1.     ]\ndistortion_model: plumb_bob\ndistortion_coefficients:\n"
        "  rows: 1\n  cols: 5\n  data: [-0.017697, -0.007270, 0.005751, -1.39e-04, 0.000000]\n"
        "projection_matrix:\n  rows: 3\n  cols: 4\n  data: [415, 0, 665, 0, 0, 410, 459, 0, 0, 0, 1, 0]\n"
    )
    (found,) = read_cameras(tmp_path / "ost.yaml")
    assert found.name == "narrow_stereo"
    assert found.camera.focal == (415.12614, 410.49986)
    assert found.camera.distortion == (-0.017697, -0.00727, 0.005751, -1.39e-4, 0)


def test_instant_ngps_field_angle_is_read(tmp_path):
    frame = {"file_path": "a.png", "transform_matrix": np.eye(4).tolist()}
    document = {"camera_angle_x": 2 * np.arctan(320 / 800), "w": 640, "h": 480, "frames": [frame]}
    (tmp_path / "transforms.json").write_text(json.dumps(document))
    (found,) = read_cameras(tmp_path / "transforms.json")
    assert found.camera.focal == pytest.approx((800, 800))
    assert found.camera.centre == (319.5, 239.5)
    np.testing.assert_allclose(found.pose.rotation, np.diag([1, -1, -1]))


BAD = {
    "skew": ("aniposelib", "[cam_0]\nsize=[9,9]\nmatrix=[[9,1,4],[0,9,4],[0,0,1]]\ndistortions=[0]\n", "a skew of 1"),
    "missing": ("aniposelib", "[cam_0]\nmatrix=[[9,0,4],[0,9,4],[0,0,1]]\n", "cam_0: size is missing"),
    "no camera": ("aniposelib", "[board]\nx=1\n", "no camera; wanted tables cam_0"),
    "no rotation": (
        "nerfstudio",
        '{"fl_x": 9, "w": 9, "h": 9, "frames": [{"transform_matrix": [[2,0,0,0],[0,1,0,0],[0,0,1,0]]}]}',
        "this matrix is no rotation",
    ),
    "fisheye": ("kalibr", "cam0: {camera_model: pinhole, distortion_model: equidistant}", "'equidistant'; only radtan"),
    "omni": ("kalibr", "cam0: {camera_model: omni}", "'omni'; only pinhole"),
    "nan": ("matchid", "Cam0_Fx;nan\n", "line 1: Cam0_Fx: every number must be finite"),
    "no table": ("matchid", "hello\n", "line 1: wanted name;value"),
    "text": ("colmap", "1 PINHOLE 640 480 a b c d\n", "line 1: parameters of PINHOLE: wanted numbers"),
    "model": ("colmap", "1 FOV 640 480 1 2 3\n", "camera model FOV has no place"),
    "focal": ("colmap", "1 PINHOLE 640 480 0 1 2 3\n", "line 1: the camera's focal length must be positive"),
    "yaml": ("ros", "a: [1\n", "this is not YAML"),
    "list": ("ros", "- 1\n", "wanted a table"),
    "ros": (
        "ros",
        "distortion_model: equidistant\n",
        "'equidistant', which has no place here; calibrate with plumb_bob",
    ),
    "our setup": ("aniposelib", "[camera]\nsize_px=[9,9]\n[optic]\n", "this is a setup file of cyclopean itself"),
    "our camera": ("aniposelib", "[camera]\nsize_px=[9,9]\n", "this is a camera file of cyclopean itself"),
    "our board": ("aniposelib", "[board]\nkind='charuco'\n", "this is a board file of cyclopean"),
    "json": ("nerfstudio", "{", "this is not JSON"),
    "k4": ("nerfstudio", '{"k4": 1}', "term of r"),
    "xml": ("dice", "<a>", "this is not XML"),
    "vic": ("dice", '<?xml version="1.0"?><!DOCTYPE vpml><project/>', "VIC-3D"),
    "old dice": ("dice", "<ParameterList/>", "no camera system of DICe"),
    "python": ("mrcal", "__import__('os')", "wanted a Python dictionary"),
    "empty": ("opencv", "%YAML:1.0\n---\nhello: 1\n", "camera_matrix is missing; the file has hello"),
    "other": ("opencv", "hello", "no file of OpenCV's FileStorage"),
}


@pytest.mark.parametrize("case", BAD)
def test_faults_are_named(case, tmp_path):
    format, text, said = BAD[case]
    path = tmp_path / ("cameras.txt" if format == "colmap" else "file.txt")
    path.write_text(text)
    with pytest.raises(SetupError) as caught:
        read_cameras(path, format)
    assert said in str(caught.value)
    assert str(path) in str(caught.value)


@pytest.mark.parametrize("format", FORMATS)
def test_damaged_files_end_in_one_error(format, tmp_path):
    cameras = cameras_for(format)[: 2 if format == "matchid" else 1]
    path = tmp_path / PLACES[format]
    write_cameras(path, cameras, format)
    file = path / "cameras.txt" if format == "colmap" else path
    whole = file.read_bytes()
    rng = np.random.default_rng(3)
    for _ in range(40):
        damaged = bytearray(whole[: rng.integers(1, len(whole))])
        damaged[rng.integers(len(damaged))] = rng.integers(256)
        file.write_bytes(bytes(damaged))
        with suppress(SetupError):  # and nothing else
            read_cameras(path, format, size=(640, 480))
