"""Cameras in other programs' files: what is written comes back, and each program's own formulas see the same pixels."""

import json

import cv2
import numpy as np
import pytest

from cyclopean.cameras import Camera
from cyclopean.errors import OutputError, SetupError
from cyclopean.files.exchange import FORMATS, NamedCamera, flipped, guess_format, read_cameras, write_cameras
from cyclopean.geometry import Pose

LENS = (-0.11, 0.07, 1.5e-3, -1e-5, 0.02)  # 1e-5: YAML 1.1 takes 1e-05 for text
FULL = Camera((640, 480), (905.25, 901.5), (318.4, 243.75), LENS)
NO_K3 = Camera((640, 480), (905.25, 901.5), (318.4, 243.75), (*LENS[:4], 0.0))
POSES = (
    Pose.from_rotation_vector((0.0, 0.0, 0.0), (0.0, 0.0, 0.0)),
    Pose.from_rotation_vector((0.03, -0.31, 0.02), (61.2, -1.7, 8.3)),
    Pose.from_rotation_vector((-0.2, 0.1, 1.2), (-20.0, 35.5, 4.0)),
)
PLACES = {
    "opencv": "rig.yml", "ros": "rig.yaml", "kalibr": "chain.yaml", "mrcal": "rig.cameramodel", "colmap": "model",
    "aniposelib": "calibration.toml", "matchid": "pair.caldat", "dice": "cal.xml", "nerfstudio": "transforms.json",
}  # fmt: skip
ONE_A_FILE = ("opencv", "ros", "mrcal")
POINTS = np.random.default_rng(5).uniform((-150, -110, 500), (150, 110, 900), (40, 3))  # mm, in every camera's sight


def cameras_for(format):
    """Cameras as many and as general as the format holds."""
    camera = NO_K3 if format == "kalibr" else FULL
    count = 2 if format == "matchid" else 3
    return [NamedCamera(f"view_{k}", camera, POSES[k]) for k in range(count)]


def same(one, other, digits=1e-12):
    np.testing.assert_allclose(one.camera.lens, other.camera.lens, rtol=digits, atol=1e-15)
    assert one.camera.size == other.camera.size
    if other.pose is None:
        assert one.pose is None
        return
    # a rotation goes through angles or a quaternion, a translation through metres: a few roundings
    np.testing.assert_allclose(one.pose.rotation, other.pose.rotation, atol=1e-14)
    np.testing.assert_allclose(one.pose.translation, other.pose.translation, atol=1e-12)


def read_back(path, format, count):
    size = (640, 480) if format == "matchid" else None
    if format in ONE_A_FILE and count > 1:
        files = [path.with_name(f"{path.stem}-{k}{path.suffix}") for k in range(count)]
        return [camera for file in files for camera in read_cameras(file, format)]
    return read_cameras(path, format, size=size)


@pytest.mark.parametrize("format", FORMATS)
def test_what_is_written_comes_back(format, tmp_path):
    cameras = cameras_for(format)
    write_cameras(tmp_path / PLACES[format], cameras, format)
    back = read_back(tmp_path / PLACES[format], format, len(cameras))
    assert len(back) == len(cameras)
    for found, given in zip(back, cameras, strict=True):
        same(found, given if format != "ros" else NamedCamera(given.name, given.camera))
    if format not in ("opencv", "mrcal", "matchid"):  # these have no place for names, or the file's name is the name
        assert [found.name for found in back] == [given.name for given in cameras]


@pytest.mark.parametrize("format", [name for name in FORMATS if name != "matchid"])
def test_a_lone_camera_comes_back(format, tmp_path):
    camera = NO_K3 if format == "kalibr" else FULL
    path = tmp_path / PLACES[format]
    write_cameras(path, [NamedCamera("lens", camera)], format)
    (back,) = read_cameras(path, format)
    same(NamedCamera("lens", back.camera), NamedCamera("lens", camera))


@pytest.mark.parametrize("format", FORMATS)
def test_the_format_is_guessed(format, tmp_path):
    path = tmp_path / PLACES[format]
    write_cameras(path, cameras_for(format)[: 2 if format == "matchid" else 1], format)
    assert guess_format(path) == format


@pytest.mark.parametrize("format", ["kalibr", "matchid"])
def test_a_chain_keeps_relative_poses_and_says_what_it_loses(format, tmp_path):
    cameras = cameras_for(format)[:2]
    turned = Pose.from_rotation_vector((0.1, 0.2, -0.3), (5.0, 6.0, 7.0))  # the rig seen from another frame
    moved = [NamedCamera(given.name, given.camera, given.pose @ turned) for given in cameras]
    notes = write_cameras(tmp_path / PLACES[format], moved, format)
    assert any("rig's own frame is not in the file" in note for note in notes)
    for found, given in zip(read_back(tmp_path / PLACES[format], format, 2), cameras, strict=True):
        same(found, given)


# Each program's own way from a point in the world (mm) to its pixels, from what stands in its file.


def brown(x, y, k1, k2, p1, p2, k3=0.0):
    r2 = x * x + y * y
    radial = 1 + k1 * r2 + k2 * r2**2 + k3 * r2**3
    return x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x * x), y * radial + p1 * (r2 + 2 * y * y) + 2 * p2 * x * y


def ours(named, points):
    return named.camera.project(named.pose @ points)


def test_colmap_sees_half_a_pixel_further(tmp_path):
    given = cameras_for("colmap")[1]
    write_cameras(tmp_path / "model", [given], "colmap")
    words = (tmp_path / "model" / "cameras.txt").read_text().splitlines()[1].split()
    assert words[1] == "FULL_OPENCV"
    fx, fy, cx, cy, k1, k2, p1, p2, k3, *rest = map(float, words[4:])
    assert rest == [0, 0, 0]
    words = (tmp_path / "model" / "images.txt").read_text().splitlines()[2].split(maxsplit=9)
    w, x, y, z, *t = map(float, words[1:8])
    xyz, axis = POINTS, np.array([x, y, z])
    # Hamilton's product q p q*, as Eigen does it
    turned = xyz + 2 * np.cross(axis, np.cross(axis, xyz) + w * xyz) + t
    u, v = brown(turned[:, 0] / turned[:, 2], turned[:, 1] / turned[:, 2], k1, k2, p1, p2, k3)
    theirs = np.stack([fx * u + cx, fy * v + cy], -1)
    np.testing.assert_allclose(theirs - 0.5, ours(given, xyz), atol=1e-9)  # px; sums of a few hundred


def test_colmap_gets_names_of_one_word(tmp_path):
    given = [NamedCamera("left view\n1", FULL, POSES[0])]
    assert any("spaces are written as _" in note for note in write_cameras(tmp_path / "model", given, "colmap"))
    assert read_cameras(tmp_path / "model")[0].name == "left_view_1"


def test_nerfstudio_looks_backwards_and_counts_from_the_corner(tmp_path):
    given = cameras_for("nerfstudio")[1]
    write_cameras(tmp_path / "transforms.json", [given])
    document = json.loads((tmp_path / "transforms.json").read_text())
    world_from_camera = np.array(document["frames"][0]["transform_matrix"])
    local = (POINTS - world_from_camera[:3, 3]) @ world_from_camera[:3, :3]  # OpenGL: x right, y up, z backwards
    lens = [document[name] for name in ("k1", "k2", "p1", "p2", "k3")]
    u, v = brown(local[:, 0] / -local[:, 2], -local[:, 1] / -local[:, 2], *lens)
    theirs = np.stack([document["fl_x"] * u + document["cx"], document["fl_y"] * v + document["cy"]], -1)
    np.testing.assert_allclose(theirs - 0.5, ours(given, POINTS), atol=1e-9)


def test_opencv_reads_and_projects_the_same(tmp_path):
    given = cameras_for("opencv")[1]
    for name in ("camera.yml", "camera.xml", "camera.json"):
        write_cameras(tmp_path / name, [given], "opencv")
        storage = cv2.FileStorage(str(tmp_path / name), cv2.FILE_STORAGE_READ)
        matrix, lens = storage.getNode("camera_matrix").mat(), storage.getNode("distortion_coefficients").mat()
        vector, _ = cv2.Rodrigues(storage.getNode("R").mat())
        theirs, _ = cv2.projectPoints(POINTS, vector, storage.getNode("T").mat(), matrix, lens)
        np.testing.assert_allclose(theirs[:, 0], ours(given, POINTS), atol=1e-9)
        assert storage.getNode("image_width").real() == 640
        same(read_cameras(tmp_path / name)[0], given)


def test_aniposelib_projects_the_same(tmp_path):
    import tomllib

    cameras = cameras_for("aniposelib")
    write_cameras(tmp_path / "c.toml", cameras)
    tables = tomllib.loads((tmp_path / "c.toml").read_text())
    for k, given in enumerate(cameras):
        table = {key: np.array(value) for key, value in tables[f"cam_{k}"].items() if key not in ("name", "size")}
        theirs, _ = cv2.projectPoints(
            POINTS, table["rotation"], table["translation"], table["matrix"], table["distortions"]
        )
        np.testing.assert_allclose(theirs[:, 0], ours(given, POINTS), atol=1e-9)


def test_mrcal_projects_the_same_in_metres(tmp_path):
    import ast

    given = cameras_for("mrcal")[1]
    write_cameras(tmp_path / "c.cameramodel", [given])
    model = ast.literal_eval((tmp_path / "c.cameramodel").read_text())
    fx, fy, cx, cy, *lens = model["intrinsics"]
    matrix = np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1]])
    motion = np.array(model["extrinsics"])
    theirs, _ = cv2.projectPoints(POINTS / 1000, motion[:3], motion[3:], matrix, np.array(lens))
    np.testing.assert_allclose(theirs[:, 0], ours(given, POINTS), atol=1e-9)


def test_kalibr_chains_its_cameras_in_metres(tmp_path):
    import yaml

    cameras = cameras_for("kalibr")
    write_cameras(tmp_path / "chain.yaml", cameras, "kalibr")
    chain = yaml.safe_load((tmp_path / "chain.yaml").read_text())
    xyz = POINTS / 1000
    for k, given in enumerate(cameras):
        table = chain[f"cam{k}"]
        if k:
            step = np.array(table["T_cn_cnm1"])
            xyz = xyz @ step[:3, :3].T + step[:3, 3]
        fu, fv, pu, pv = table["intrinsics"]
        ahead = xyz[:, 2] > 0.1
        u, v = brown(*(xyz[ahead, :2] / xyz[ahead, 2:]).T, *table["distortion_coeffs"])
        assert ahead.sum() > 5
        np.testing.assert_allclose(np.stack([fu * u + pu, fv * v + pv], -1), ours(given, POINTS[ahead]), atol=1e-9)


def test_dice_turns_the_world_into_each_camera(tmp_path):
    angles = (179.9, 9.0, -0.3)  # deg; DICe multiplies Rz(gamma) Ry(beta) Rx(alpha)
    a, b, c = np.radians(angles)
    x = np.array([[1, 0, 0], [0, np.cos(a), -np.sin(a)], [0, np.sin(a), np.cos(a)]])
    y = np.array([[np.cos(b), 0, np.sin(b)], [0, 1, 0], [-np.sin(b), 0, np.cos(b)]])
    z = np.array([[np.cos(c), -np.sin(c), 0], [np.sin(c), np.cos(c), 0], [0, 0, 1]])
    entries = {"CX": 300.5, "CY": 250, "FX": 2000, "FY": 2001, "K1": 0.03, "K3": 1.5, "ALPHA": 179.9, "BETA": 9.0}
    entries |= {"GAMMA": -0.3, "TX": -63.2, "TY": -0.3, "TZ": 518.7}
    lines = "".join(f'<Parameter name="{key}" type="double" value="{value}"/>' for key, value in entries.items())
    lines += '<Parameter name="LENS_DISTORTION_MODEL" type="string" value="OPENCV_LENS_DISTORTION"/>'
    lines += '<Parameter name="IMAGE_HEIGHT_WIDTH" type="string" value="{ 480, 640 }"/>'
    text = '<ParameterList><Parameter name="xml_file_format" type="string" value="DICe_xml_camera_system_file"/>'
    text += '<Parameter name="extrinsics_relative_camera_to_camera" type="bool" value="true"/>'
    text += "".join(f'<ParameterList name="CAMERA {k}">{lines}</ParameterList>' for k in (0, 1)) + "</ParameterList>"
    (tmp_path / "cal.xml").write_text(text)
    first, second = read_cameras(tmp_path / "cal.xml")
    assert first.camera.size == (640, 480)
    assert first.camera.distortion == (0.03, 0, 0, 0, 1.5)
    np.testing.assert_allclose(first.pose.rotation, z @ y @ x, atol=1e-14)
    np.testing.assert_allclose(first.pose.translation, (-63.2, -0.3, 518.7))
    np.testing.assert_allclose(second.pose @ POINTS, first.pose @ (first.pose @ POINTS), atol=1e-10)


def test_matchid_has_the_second_camera_where_pyvale_put_it(tmp_path):
    # pyvale's own stereo test scene: cameras 133.0 mm apart along x exactly, the second turned by 15 deg
    lines = [f"Cam{k}_{name};{value}" for k in (0, 1) for name, value in
             (("Fx [pixels]", 4347.826), ("Fy [pixels]", 4347.826), ("Fs [pixels]", 0), ("Kappa 1", 0.0),
              ("Cx [pixels]", 10.0), ("Cy [pixels]", 10.0))]  # fmt: skip
    lines += ["Tx [mm];-128.46813489644606", "Ty [mm];0.0", "Tz [mm];34.42293299863527"]
    lines += ["Theta [deg];0.0", "Phi [deg];15.000000000000009", "Psi [deg];0.0"]
    (tmp_path / "calib.caldat").write_text("\n".join(lines))
    first, second = read_cameras(tmp_path / "calib.caldat", size=(20, 20))
    np.testing.assert_allclose(first.pose.inverse.translation, 0)
    centre = second.pose.inverse.translation
    assert centre[0] == pytest.approx(133.0, abs=0.01)  # they print no figure; the distance rounds to this
    np.testing.assert_allclose(centre[1:], 0, atol=1e-9)
    np.testing.assert_allclose(second.pose.rotation[2] @ (1, 0, 0), -np.sin(np.radians(15)), atol=1e-9)  # looks back


def test_a_mirrored_camera_is_that_of_the_flipped_photograph():
    mirrored = NamedCamera("mirror", FULL, POSES[1], mirrored=True)
    plain = flipped(mirrored)
    local = POSES[1] @ POINTS
    seen = FULL.project(local * [-1, 1, 1])  # what VirtualCamera does
    expected = np.stack([FULL.size[0] - 1 - seen[:, 0], seen[:, 1]], -1)
    np.testing.assert_allclose(plain.camera.project(plain.pose @ POINTS), expected, atol=1e-10)
    assert not plain.mirrored


@pytest.mark.parametrize("format", FORMATS)
def test_a_mirrored_camera_is_refused(format, tmp_path):
    cameras = [NamedCamera("plain", FULL, POSES[0]), NamedCamera("mirror", FULL, POSES[1], mirrored=True)]
    with pytest.raises(OutputError, match=r"mirror: mirrored.*flip"):
        write_cameras(tmp_path / PLACES[format], cameras, format)


def test_what_a_format_cannot_hold_is_said(tmp_path):
    with pytest.raises(OutputError, match="no k3"):
        write_cameras(tmp_path / "chain.yaml", [NamedCamera("a", FULL)], "kalibr")
    with pytest.raises(OutputError, match="two cameras, got 3"):
        write_cameras(tmp_path / "a.caldat", [NamedCamera("a", FULL, POSES[0])] * 3)
    with pytest.raises(OutputError, match="place of b is unknown"):
        write_cameras(tmp_path / "a.caldat", [NamedCamera("a", FULL, POSES[0]), NamedCamera("b", FULL)])
    with pytest.raises(OutputError, match="there is no camera"):
        write_cameras(tmp_path / "a.caldat", [])
    with pytest.raises(OutputError, match="say which: opencv"):
        write_cameras(tmp_path / "rig.xml", [NamedCamera("a", FULL)])
    with pytest.raises(SetupError, match="unknown format 'vic'"):
        write_cameras(tmp_path / "rig.xml", [NamedCamera("a", FULL)], "vic")
    assert list(tmp_path.iterdir()) == []
    assert any("no pose" in note for note in write_cameras(tmp_path / "a.yaml", [cameras_for("ros")[1]], "ros"))
    pitched = NamedCamera("a", Camera((640, 480), 900, pixel_pitch=0.005))
    assert any("between pixels" in note for note in write_cameras(tmp_path / "b.yaml", [pitched], "ros"))


def test_units_of_length_can_be_said(tmp_path):
    given = cameras_for("aniposelib")[:2]
    write_cameras(tmp_path / "cm.toml", given, unit_mm=10.0)
    metres = read_cameras(tmp_path / "cm.toml", unit_mm=1000.0)
    np.testing.assert_allclose(metres[1].pose.translation, given[1].pose.translation * 100)
    with pytest.raises(SetupError, match="above 0"):
        read_cameras(tmp_path / "cm.toml", unit_mm=0)
