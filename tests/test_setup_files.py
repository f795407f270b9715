"""Setup files: what is written comes back to the last digit, and every fault is named."""

import os
import subprocess
import sys
from contextlib import suppress
from dataclasses import asdict, replace
from pathlib import Path

import numpy as np
import pytest
import tomli_w
from hypothesis import given
from hypothesis import strategies as st

from cyclopean.cameras import Camera
from cyclopean.errors import OutputError, SetupError
from cyclopean.files import read_setup, tables, write_setup
from cyclopean.optics import Mirror, Mirrors, Plate, Prism, medium
from cyclopean.rigs import Setup

CAMERA = "[camera]\nsize_px = [1280, 960]\nfocal_px = 2400.0\n"
PRISM = '[optic]\nkind = "prism"\nfacets = 3\napex_deg = 12\nglass = "N-BK7"\ndistance_mm = 60\n'
PLATE = '[optic]\nkind = "plate"\nindex = 1.5\ndistance_mm = 60\nthickness_mm = 3\n'
MIRRORS = '[optic]\nkind = "mirrors"\n[[optic.mirrors]]\ncentre_mm = [9, 0, 99]\nnormal = [1, 0, -1]\n'


def read(folder: Path, text: str) -> Setup:
    """Read a setup file that holds this text."""
    file = folder / "rig.toml"
    file.write_text(text, encoding="utf-8")
    return read_setup(file)


def fault(folder: Path, text: str) -> str:
    """What `read_setup` says about a file that holds this text, without the file's name in front."""
    with pytest.raises(SetupError) as caught:
        read(folder, text)
    start = f"{folder / 'rig.toml'}: "
    assert str(caught.value).startswith(start)
    return str(caught.value).removeprefix(start)


# Setups that come back. Bounds keep the drawn optics possible: facets below total reflection, wavelengths with data.

positive = st.floats(1e-3, 1e6)
small = st.floats(-5, 5)
glasses = st.sampled_from(["N-BK7", "PMMA", 1.5, 1.5168, medium("SF10"), medium(1.49)])
cameras = st.builds(
    Camera,
    st.tuples(st.integers(1, 9000), st.integers(1, 9000)),
    st.tuples(positive, positive),
    st.none() | st.tuples(small, positive),
    st.tuples(small, small, small, small, small),
    st.none() | st.floats(1e-6, 10),
)
placed = {"tilt_deg": st.tuples(small, small, small), "shift": st.tuples(small, small)}
prisms = st.builds(
    Prism,
    st.just(3),
    st.floats(1, 20),
    glasses,
    positive,
    st.floats(50, 80),
    st.none() | st.floats(1, 100),
    st.sampled_from(["scene", "camera"]),
    st.floats(-360, 360),
    facet_deviation_deg=st.just(()) | st.tuples(*[st.tuples(st.floats(-0.5, 0.5), small)] * 3),
    surroundings=st.sampled_from(["air", "water", 1.0, 1.1]),
    **placed,
)
plates = st.builds(
    Plate,
    glasses,
    positive,
    positive,
    st.none() | positive,
    surroundings=st.sampled_from(["air", 1.33]),
    beyond=st.sampled_from([None, "water", 1.33]),
    **placed,
)
mirror = st.builds(
    Mirror,
    st.tuples(small, small, positive),
    st.tuples(small, small, positive),
    st.none() | st.tuples(positive, positive),
    st.tuples(small, small),
    small,
)
mirrors = st.builds(
    Mirrors,
    st.tuples(mirror, mirror),
    st.sampled_from([None, ((0,), (1,)), ((0, 1), (1, 0), (0,))]),
    st.booleans(),
    st.sampled_from(["air", "water", 1.33]),
)


def with_names(setup):
    """The fields of a setup, a medium by its name, which is how files hold it."""
    fields = asdict(setup.optic)
    for key in ("glass", "surroundings", "beyond"):
        if isinstance(fields.get(key), dict):
            fields[key] = fields[key]["name"]
    return asdict(replace(setup, optic=None)), fields


@given(cameras, prisms | plates | mirrors, st.floats(450, 650), st.none() | st.just((123.4, 1e4)))
def test_a_setup_comes_back_to_the_last_digit(tmp_path_factory, camera, optic, wavelength_nm, depths):
    setup = Setup(camera, optic, wavelength_nm, depths=depths)
    file = tmp_path_factory.getbasetemp() / "drawn.toml"
    write_setup(setup, file)
    assert with_names(read_setup(file)) == with_names(setup)


@pytest.mark.parametrize("pitch", [0.0055, 0.1 + 0.2, 1 / 3, 5e-3 / 7, 1e-6])
def test_a_pixel_pitch_survives_the_change_of_unit(tmp_path, pitch):
    camera = Camera((1280, 960), 2400, pixel_pitch=pitch)
    setup = Setup(camera, Prism(2, 10, 1.5, 60), f_number=8.0, focus_distance=1e5)
    write_setup(setup, tmp_path / "rig.toml")
    back = read_setup(tmp_path / "rig.toml")
    assert (back.camera.pixel_pitch, back.f_number, back.focus_distance) == (pitch, 8.0, 1e5)


def test_numbers_of_numpy_are_written_as_numbers(tmp_path):
    prism = Prism(np.int64(3), np.float64(12), "N-BK7", np.float32(60))
    prism = prism.with_parameters(prism.parameters(587.6) + 1e-3)  # as a calibration would
    mirror = Mirror(tuple(np.array([9.0, 0, 99])), tuple(np.array([1, 0, -1])))
    for optic in (prism, Mirrors((mirror,), ((np.int64(0),),), direct=np.bool_(True))):
        setup = Setup(Camera(tuple(np.array([1280, 960])), np.float64(2400)), optic)
        write_setup(setup, tmp_path / "rig.toml")
        assert with_names(read_setup(tmp_path / "rig.toml")) == with_names(setup)


def test_a_written_setup_reads_well(tmp_path):
    write_setup(Setup(Camera((1280, 960), 2400), Prism(3, 12.0, "N-BK7", 60.0), depths=(500.0, 900.0)), tmp_path / "a")
    lines = (tmp_path / "a").read_text().splitlines()
    assert lines[0].startswith("# cyclopean setup, format 1, written by cyclopean ")
    assert {"[camera]", "size_px = [1280, 960]", 'kind = "prism"', "distance_mm = 60.0"} <= set(lines)
    assert lines[-2:] == ["[scene]", "depth_mm = [500.0, 900.0]"]


def test_a_camera_may_be_given_by_its_lens_and_its_pixels(tmp_path):
    lens = "[camera]\nsize_px = [1280, 960]\nfocal_mm = {}\npixel_pitch_um = 5\ndistortion = [-0.1]\n"
    camera = read(tmp_path, lens.format("12") + PRISM).camera
    assert camera.focal == (2400.0, 2400.0)
    assert camera.distortion == (-0.1, 0, 0, 0, 0)
    assert camera.centre == (639.5, 479.5)
    assert read(tmp_path, lens.format("[12, 12.5]") + PRISM).camera.focal == (2400.0, 2500.0)


def test_what_a_file_leaves_out_is_the_default(tmp_path):
    setup = read(tmp_path, "\ufeff" + CAMERA + PRISM.replace("= 3\n", "= 3.0  # a whole number all the same\n"))
    wanted = Setup(Camera((1280, 960), 2400), Prism(3, 12.0, "N-BK7", 60.0))
    assert with_names(setup) == with_names(wanted)


def test_importing_the_files_does_not_import_pydantic():
    show = "import sys, cyclopean.files; print(*sys.modules)"
    run = subprocess.run([sys.executable, "-c", show], capture_output=True, text=True, check=True)
    assert {"pydantic", "cv2", "numba"} & set(run.stdout.split()) == set()


# Setups that are wrong.


def with_line(text: str, section: str, line: str) -> str:
    """A setup file with a line in one of its tables, in place of the one with the same key."""
    key = line.split(" ")[0]
    lines = [old for old in text.splitlines() if old.split(" ")[0] != key]
    if f"[{section}]" not in lines:
        lines += [f"[{section}]"]
    place = lines.index(f"[{section}]") + 1
    return "\n".join([*lines[:place], line, *lines[place:]])


DISTANCE = "a number of mm above 0, from the pinhole to the glass along the axis"
ANGLE = "a number of degrees between 0 and 90, from the flat face to each facet"
TILT = "three numbers of degrees, [x, y, z]: a rotation vector in the camera's axes"
DEVIATION = "a pair of degrees for each facet, [[angle, azimuth], ...]"
GLASS = 'the name of a glass, such as "N-BK7" (an index is a number and goes into the key index)'
MEDIUM = 'the name of a medium, such as "water", or an index from 1 to 5'


@pytest.mark.parametrize(
    ("section", "line", "said"),
    [
        # unknown keys
        ("optic", "apex_angel_deg = 12", ": unknown key; did you mean apex_deg?"),
        ("optic", "distance_cm = 6", ": lengths are in mm: distance_mm"),
        ("optic", "distance = 60", ": lengths are in mm: distance_mm"),
        ("optic", "apex_rad = 0.2", ": angles are in degrees: apex_deg"),
        ("light", "wavelength_um = 0.5", ": wavelengths are in nm: wavelength_nm"),
        ("camera", "pixel_pitch_mm = 0.0055", ": the distance between pixels is in micrometres: pixel_pitch_um"),
        ("camera", "focal_cm = 2", ": lengths on the picture are in px: focal_px; lengths are in mm: focal_mm"),
        ("camera", "wavelength_nm = 500", ": this key belongs in [light]"),
        ("optic", "beyond = 1.5", ': this key belongs in [optic] of kind "plate"'),
        (
            "light",
            'colour = "red\\nish"',
            ": unknown key; the known ones are wavelength_nm, channel_wavelengths_nm, dispersion",
        ),
        # wrong types and ranges
        ("camera", "size_px = [1280, 960.5]", " must be two whole numbers of px from 1 to 100000, [width, height]"),
        ("camera", "focal_px = -3", " must be a number of px above 0, or two, [x, y]"),
        ("camera", "focal_px = [1, 2, 3]", " must be a number of px above 0, or two, [x, y]"),
        ("camera", "focal_mm = 12", ": give one of focal_px, a number of px, and focal_mm, a number of mm"),
        ("camera", "centre_px = [1, true]", " must be two numbers of px, [x, y]"),
        ("camera", "distortion = []", " must be one to five numbers, [k1, k2, p1, p2, k3]"),
        ("camera", "distortion = [1, 2, 3, 4, 5, 6]", " must be one to five numbers, [k1, k2, p1, p2, k3]"),
        ("camera", 'pixel_pitch_um = "5.5"', " must be a number of micrometres above 0 and below 1000000"),
        ("optic", "kind = 3", ' must be "prism", "mirrors" or "plate"'),
        ("optic", 'kind = "prizm"', ' must be "prism", "mirrors" or "plate"; did you mean "prism"?'),
        ("optic", "facets = 1", " must be a whole number from 2 to 127"),
        ("optic", "facets = 2.5", " must be a whole number from 2 to 127"),
        ("optic", "apex_deg = 90", f" must be {ANGLE}"),
        ("optic", "apex_deg = true", f" must be {ANGLE}"),
        ("optic", 'distance_mm = "60 mm"', f" must be {DISTANCE}"),
        ("optic", "distance_mm = 1E+999", f" must be {DISTANCE}"),
        ("optic", "tilt_deg = [1, 2]", f" must be {TILT}"),
        ("optic", "facet_deviation_deg = [[1], [2], [3]]", f" must be {DEVIATION}"),
        ("optic", 'facing = "up"', ' must be "scene" or "camera": where the facets look'),
        ("optic", "surroundings = 0.3", f" must be {MEDIUM}"),
        ("optic", "surroundings = [1.3]", f" must be {MEDIUM}"),
        ("optic", "index = 1.5", ': give one of glass, a name such as "N-BK7", and index, a number from 1 to 5'),
        ("optic", "glass = 1.5", f" must be {GLASS}"),
        ("light", "wavelength_nm = 0", " must be a number of nm above 0"),
        ("scene", "depth_mm = [9, 5]", ": must be two numbers of mm above 0, [near, far], the nearer first"),
    ],
)  # fmt: skip
def test_a_fault_is_named_with_its_key_its_value_and_what_was_wanted(tmp_path, section, line, said):
    assert fault(tmp_path, with_line(CAMERA + PRISM, section, line)) == f"{section}.{line}{said}"


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (PRISM, "camera is missing: a table, with size_px and focal_px"),
        (CAMERA, 'optic is missing: a table, with kind = "prism", "mirrors" or "plate"'),
        (CAMERA + "[optic]", 'optic.kind is missing: "prism", "mirrors" or "plate"'),
        ("camera = 3\n" + PRISM, "camera = 3 must be a table, with size_px and focal_px"),
        ("optic = []\n" + CAMERA, 'optic = [] must be a table, with kind = "prism", "mirrors" or "plate"'),
        (CAMERA + PRISM + "[lamp]", "lamp = {...}: unknown key; the known ones are camera, optic, light, scene"),
        (CAMERA + PRISM.replace("distance_mm = 60", ""), f"optic.distance_mm is missing: {DISTANCE}"),
        (CAMERA + PRISM.replace('glass = "N-BK7"', ""), "optic.index: give one of glass, a name such as"),
        (CAMERA + PRISM.replace("glass", "index"), 'optic.index = "N-BK7" must be a number from 1 to 5, relative to'),
        (CAMERA.replace("focal_px = 2400.0", "") + PRISM, "camera.focal_mm: give one of focal_px, a number of px"),
        (CAMERA.replace("focal_px", "focal_mm") + PRISM, "camera.pixel_pitch_um: focal_mm needs the distance between"),
        (CAMERA + "f_number = 8\nfocus_distance_mm = 900\n" + PRISM, "camera.pixel_pitch_um: f_number and"),
        (CAMERA + "pixel_pitch_um = 5\nf_number = 8\n" + PRISM, "camera: f_number needs focus_distance_mm"),
        (CAMERA + "pixel_pitch_um = 5\nfocus_distance_mm = 9\n" + PRISM, "camera: focus_distance_mm must exceed"),
        (CAMERA + "pixel_pitch_um = 1e-999\n" + PRISM, "camera: the pixel pitch must be positive mm"),
        (CAMERA.replace("960", "9" * 400) + PRISM, f"camera.size_px = [1280, {'9' * 53}... must be two whole numbers"),
        (CAMERA.replace("960", "nan") + PRISM, "camera.size_px = [1280, NaN] must be two whole numbers"),
        (CAMERA + PLATE.replace("3", "nan"), "optic.thickness_mm = NaN must be a number of mm above 0"),
        (CAMERA + PLATE + "beyond = true", f"optic.beyond = true must be {MEDIUM}"),
        (CAMERA + '[optic]\nkind = "mirrors"\nmirrors = []', "optic.mirrors = [] must be one or more tables"),
        (CAMERA + '[optic]\nkind = "mirrors"\nmirrors = [3]', "optic.mirrors[0] = 3 must be a table"),
        (CAMERA + MIRRORS + "size_cm = [1, 2]", "optic.mirrors[0].size_cm = [1, 2]: lengths are in mm: size_mm"),
        (CAMERA + MIRRORS.replace("[9, 0, 99]", "[9, 0]"), "optic.mirrors[0].centre_mm = [9, 0] must be three"),
        (with_line(CAMERA + MIRRORS, "optic", "direct = 1"), "optic.direct = 1 must be true or false"),
        # what an optic says itself is kept
        (CAMERA + PRISM.replace("BK7", "BK9"), "optic.glass = \"N-BK9\": unknown medium 'N-BK9'; the closest"),
        (CAMERA + PLATE + "beyond = 'watr'", "optic.beyond = \"watr\": unknown medium 'watr'; the closest"),
        (CAMERA + PRISM + "radius_mm = 90", "optic: the facets cross inside the glass"),
        (CAMERA + PRISM + "facet_deviation_deg = [[0, 1]]", "optic: facet_deviation_deg needs one"),
        (CAMERA + PRISM.replace("12", "50"), "light along the prism's axis is totally reflected: apex_deg=50"),
        (CAMERA + PRISM + "[light]\nwavelength_nm = 0.5", "air has data from 185 to 14100 nm, got 0.5 nm"),
        (CAMERA + MIRRORS.replace("[1, 0, -1]", "[0, 0, 0]"), "optic.mirrors[0]: a mirror's normal must"),
        (with_line(CAMERA + MIRRORS, "optic", "sequences = [[0, 1]]"), "optic: a sequence lists mirrors by their"),
    ],
)  # fmt: skip
def test_a_fault_of_a_whole_table_is_named_too(tmp_path, text, said):
    assert fault(tmp_path, text).startswith(said)


def test_all_faults_are_reported_at_once_each_on_its_line_and_none_twice(tmp_path):
    camera = CAMERA.replace("1280", "0").replace("2400.0", "'a'")
    optic = PRISM.replace("12", "95").replace("distance_mm", "distance_cm") + "facet_deviation_deg = [[]]\n"
    first, *others = fault(tmp_path, camera + optic + "[scene]\ndepth_m = [1, 2]").split("\n  ")
    assert first == "6 things are wrong"
    assert " ".join(line.split(" ")[0] for line in others) == (
        "camera.size_px camera.focal_px optic.apex_deg optic.facet_deviation_deg optic.distance_cm scene.depth_m"
    )


@pytest.mark.parametrize(
    ("content", "said"),
    [
        (b"", "the file is empty (0 bytes)"),
        (b"[camera]\nsize_px = [1280 960]", "this is not TOML: Unclosed array (at line 2, column 17)"),
        (b"a = 1\na = 2\n", "this is not TOML: Cannot overwrite a value (at line 2, column 6)"),
        (b"a = " + b"9" * 5000, "this is not TOML: "),
        (b"a = " + b"[" * 5000, "this is not TOML: "),
        (b"\x89PNG\r\n\x1a\n", "this is no text (UTF-8), so it is no setup file"),
    ],
)
def test_what_is_no_setup_file_is_said_so(tmp_path, content, said):
    file = tmp_path / "rig.toml"
    file.write_bytes(content)
    with pytest.raises(SetupError) as caught:
        read_setup(file)
    assert str(caught.value).startswith(f"{file}: {said}")


scalars = (
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=3) | st.sampled_from(["N-BK7", "prism"])
)
values = st.recursive(scalars.filter(lambda x: x is not None), lambda inner: st.lists(inner, max_size=4), max_leaves=6)
TABLES = (tables.CameraTable, tables.PrismTable, tables.PlateTable, tables.MirrorsTable, tables.LightTable)
KEYS = sorted({key for table in TABLES for key in table.model_fields} | {"distance_cm"})


@given(
    st.sampled_from([PRISM, PLATE, MIRRORS]),
    st.dictionaries(st.sampled_from(KEYS), values, max_size=3),
    st.dictionaries(st.sampled_from(KEYS), values, max_size=3),
)
def test_any_file_is_a_setup_or_a_setup_error(tmp_path_factory, optic, in_camera, in_optic):
    text = CAMERA + optic
    for section, changes in (("camera", in_camera), ("optic", in_optic)):
        for line in tomli_w.dumps(changes).replace("\n    ", "").replace("\n]", "]").splitlines():
            text = with_line(text, section, line)
    with suppress(SetupError):
        assert isinstance(read(tmp_path_factory.getbasetemp(), text), Setup)


class Lens:
    """An optic without a file format."""

    kind = "lens"


def test_a_setup_that_no_file_can_hold_is_refused_and_the_old_file_stays(tmp_path):
    file = tmp_path / "rig.toml"
    file.write_text("old")
    camera, own = Camera((1280, 960), 2400), replace(medium("N-BK7"), coefficients=(1.0,) * 6)
    wrong = [
        (Lens(), OutputError, "an optic of type Lens has no place in a setup file; prism, mirrors, plate have"),
        (Prism(3, 12, own, 60), OutputError, "a setup file cannot hold the medium 'N-BK7', which media"),
        (Prism(3, 12, replace(own, name="mine"), 60), OutputError, "a setup file cannot hold the medium 'mine', which"),
        (Prism(3, 50, "N-BK7", 60), SetupError, "totally reflected"),
    ]
    for optic, error, said in wrong:
        with pytest.raises(error, match=f"^{file}: .*{said}"):
            write_setup(Setup(camera, optic), file)
    assert file.read_text() == "old"
    assert os.listdir(tmp_path) == ["rig.toml"]
