"""``cyclopean calibrate`` as a person meets it: files, and one clear line for every fault."""

import json
from dataclasses import replace

import commands
import numpy as np
import pytest
from board_views import CAMERA, POSES, observe_exactly, prism_setup, with_noise

from benchmarks.data import renderer_setup
from cyclopean import read_photograph, write_setup
from cyclopean.calibration import validation
from cyclopean.calibration.physical import calibrate
from cyclopean.errors import ImageError, SetupError
from cyclopean.files import read_observations, read_setup, write_board, write_camera, write_image, write_observations
from cyclopean.files.calibrations import read_calibration
from cyclopean.files.cameras import read_camera
from cyclopean.jobs import calibration_report
from cyclopean.jobs.calibration_failure import failure_of
from cyclopean.jobs.calibration_photographs import find_files, read_pictures, seams_moved
from cyclopean.jobs.calibration_request import parse_tolerances
from cyclopean.jobs.calibration_tables import held_out_rows
from cyclopean.targets import Board

BOARD = Board("chessboard", 10, 8, 20.0)
CHARUCO = Board("charuco", 14, 10, 20.0, 15.0, "DICT_5X5_250")
PICTURES = ("residuals.png", "coverage.png", "photos.png", "depth_errors.png")


def run(monkeypatch, capsys, *words):
    """Exit status, output and errors of one calibration."""
    return commands.run(monkeypatch, capsys, "calibrate", *words)


def drawn(setup, **changes):
    """The setup as a drawing that is a little wrong."""
    optic = replace(setup.optic, apex_deg=12.3, distance=62.0, tilt_deg=(0.7, -0.7, 0.0), shift=(1.4, -1.4))
    return replace(setup, optic=replace(optic, **changes))


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    """A folder with board.toml, nominal.toml, camera.toml, and corners.csv of a prism with three facets."""
    folder = tmp_path_factory.mktemp("calibrate")
    setup = prism_setup()
    write_board(folder / "board.toml", BOARD)
    write_setup(replace(drawn(setup), depths=None), folder / "nominal.toml")
    write_camera(folder / "camera.toml", CAMERA)
    write_observations(folder / "corners.csv", with_noise(observe_exactly(setup, POSES, BOARD)))
    return folder


@pytest.fixture(scope="module")
def rendered(tmp_path_factory, mitsuba):
    """A folder with the board and a nominal setup of the renderer's photographs."""
    folder = tmp_path_factory.mktemp("rendered")
    write_board(folder / "board.toml", CHARUCO)
    write_setup(drawn(renderer_setup("n3")), folder / "nominal.toml")
    write_setup(renderer_setup("n3"), folder / "true.toml")
    return folder


@pytest.fixture
def no_pictures(monkeypatch):
    """Leave out pictures and report, which take longer than all the rest."""
    monkeypatch.setattr(calibration_report, "write_findings", lambda *_: None)


def test_rendered_photographs_give_the_prism_that_took_them(rendered, mitsuba, tmp_path, monkeypatch, capsys):
    photos = [mitsuba / "calib_n3" / f"view_{k:02}.png" for k in (0, 3)]
    out = tmp_path / "new" / "found.toml"
    status, said, _ = run(
        monkeypatch, capsys, *photos, "--board", rendered / "board.toml", "--setup", rendered / "nominal.toml",
        "-o", out, "--depth", "500..1000",
    )  # fmt: skip
    assert status == 0
    assert "looking again" in said  # the drawing's seams are 80 px off
    assert len(said.splitlines()) < 60
    found, truth = read_setup(out), renderer_setup("n3").optic
    assert found.depths == (500.0, 1000.0)
    assert abs(found.optic.apex_deg - truth.apex_deg) < 0.005  # 1.5 arc seconds of sigma; 10 times that
    np.testing.assert_allclose(found.optic.shift, (0, 0), atol=0.1)  # mm, known to 0.01
    report = tmp_path / "new" / "found_report"
    assert {path.name for path in report.iterdir()} == {*PICTURES, "report.html", "calibration.json", "corners.csv"}
    for name in PICTURES:
        assert read_photograph(report / name).std() > 10  # not blank
    page = (report / "report.html").read_text()
    assert page.count("data:image/png;base64,") == len(PICTURES)
    assert "http" not in page  # self-contained
    document = read_calibration(report / "calibration.json")
    assert document["rms_px"] < 0.02
    assert [photo["name"] for photo in document["photographs"]] == [photo.name for photo in photos]
    assert document["converged"]
    sigma = [parameter["sigma"] for parameter in document["parameters"]]
    place = [parameter["name"] for parameter in document["parameters"]].index("optic.distance")
    assert abs(found.optic.distance - truth.distance) < 3 * sigma[place]  # thickness and distance are known together
    np.testing.assert_allclose(np.sqrt(np.diag(document["covariance"])), sigma, rtol=1e-12)
    corners = read_observations(report / "corners.csv", CHARUCO)
    assert len(corners) == document["observations"]


def test_camera_photographs_free_the_camera(rendered, mitsuba, tmp_path, monkeypatch, capsys, no_pictures):
    wrong = drawn(renderer_setup("n3"), tilt_deg=(0, 0, 0), shift=(0, 0))
    write_setup(replace(wrong, camera=replace(wrong.camera, focal=(2350.0, 2350.0))), tmp_path / "nominal.toml")
    photos = [mitsuba / "calib_n3" / "view_03.png"]
    bare = [mitsuba / "camera_only" / f"view_{k:02}.png" for k in (3, 6)]
    status, said, _ = run(
        monkeypatch, capsys, *photos, "-b", rendered / "board.toml", "-s", tmp_path / "nominal.toml",
        "-o", tmp_path / "found.toml", "--camera-photos", *bare, "--no-guide", "--no-validate",
    )  # fmt: skip
    assert status == 0
    assert "without the optic: " in said
    assert np.abs(np.array(read_setup(tmp_path / "found.toml").camera.focal) - 2400).max() < 1  # px, known to 0.1
    document = json.loads((tmp_path / "found_report" / "calibration.json").read_text())
    names = [photo["name"] for photo in document["photographs"]]
    assert names[0] == "view_03.png"
    assert names[1:] == [f"camera_only/{path.name}" for path in bare]  # alike, so that corners.csv tells them apart


def test_colours_get_an_index_each(rendered, mitsuba, tmp_path, monkeypatch, capsys, no_pictures):
    photo = mitsuba / "calib_n3_chroma" / "view_02.png"
    status, said, _ = run(
        monkeypatch, capsys, photo, "-b", rendered / "board.toml", "-s", rendered / "true.toml",
        "-o", tmp_path / "found.toml", "--channel", "each", "--no-guide", "--no-validate",
    )  # fmt: skip
    assert status == 0
    assert "optic.index (blue)" in said
    index = {colour: read_setup(tmp_path / f"found_{colour}.toml").optic.glass for colour in ("red", "green", "blue")}
    # the renderer's, BK7 at 656.3, 587.6 and 486.1 nm; corners of a hundredth of a pixel tell 1e-5
    assert abs(index["green"] - index["red"] - (1.51680 - 1.51432)) < 1e-4
    assert abs(index["blue"] - index["green"] - (1.52238 - 1.51680)) < 1e-4


def test_corners_stand_in_for_photographs(files, tmp_path, monkeypatch, capsys):
    status, said, _ = run(
        monkeypatch, capsys, "--corners", files / "corners.csv", "-b", files / "board.toml", "-s",
        files / "nominal.toml", "-o", tmp_path / "found.toml", "--save-corners", tmp_path / "again.csv",
        "--hold", "optic.tilt_z", "--tolerance", "optic.apex=0.5,optic.distance=3mm",
    )  # fmt: skip
    assert status == 0
    assert "optic.tilt_z 0 deg" in " ".join(said.split())  # among what was held
    found, truth = read_setup(tmp_path / "found.toml").optic, prism_setup().optic
    assert abs(found.apex_deg - truth.apex_deg) < 0.02  # deg; corners of 0.05 px tell 0.003
    first, again = (read_observations(path) for path in (files / "corners.csv", tmp_path / "again.csv"))
    np.testing.assert_array_equal(first.pixels, again.pixels)
    document = read_calibration(tmp_path / "found_report" / "calibration.json")
    priors = {parameter["name"]: parameter["prior_sigma"] for parameter in document["parameters"]}
    np.testing.assert_allclose(priors["optic.apex"], np.deg2rad(0.5))
    assert priors["optic.distance"] == 3.0
    assert len(document["held_out"]) == 5
    assert "cyclopean compare-calibrations" in (tmp_path / "found_report" / "report.html").read_text()


def test_a_prism_without_a_drawing_is_found(files, tmp_path, monkeypatch, capsys, no_pictures):
    status, said, _ = run(
        monkeypatch, capsys, "--corners", files / "corners.csv", "-b", files / "board.toml", "--facets", 3,
        "--camera", files / "camera.toml", "-o", tmp_path / "found.toml", "--no-validate", "--no-guide",
    )  # fmt: skip
    assert status == 0
    assert "optic.thickness" in said
    assert abs(read_setup(tmp_path / "found.toml").optic.apex_deg - 12.0) < 0.05  # deg


def test_one_photograph_does_where_the_camera_is_known(files, tmp_path, monkeypatch, capsys, no_pictures):
    write_observations(tmp_path / "one.csv", read_observations(files / "corners.csv").of_photos([0]))
    words = ("--corners", tmp_path / "one.csv", "-b", files / "board.toml", "-s", files / "nominal.toml")
    out = ("-o", tmp_path / "found.toml", "--no-guide")
    status, said, _ = run(monkeypatch, capsys, *words, *out)
    assert status == 0
    assert "from one photograph" not in said
    assert abs(read_setup(tmp_path / "found.toml").optic.apex_deg - 12.0) < 0.1  # deg
    status, said, _ = run(
        monkeypatch, capsys, *words, *out, "--free", "camera.focal,optic.apex", "--free", "optic.pose"
    )
    assert status == 0
    assert "from one photograph, the camera (camera.focal_x" in said


def test_an_interrupted_validation_keeps_the_setup(files, tmp_path, monkeypatch, capsys):
    def interrupted(*arguments, **options):
        raise KeyboardInterrupt

    monkeypatch.setattr(validation, "validate", interrupted)
    status, _, error = run(
        monkeypatch, capsys, "--corners", files / "corners.csv", "-b", files / "board.toml", "-s",
        files / "nominal.toml", "-o", tmp_path / "found.toml",
    )  # fmt: skip
    assert status == 130
    assert "kept" in error
    assert abs(read_setup(tmp_path / "found.toml").optic.apex_deg - 12.0) < 0.02
    assert read_calibration(tmp_path / "found_report" / "calibration.json")["converged"]


def calibrated(monkeypatch, capsys, files, nominal, out, *more):
    """One calibration from the corners of `files`, the setup written to a file of the same folder."""
    return run(
        monkeypatch, capsys, "--corners", files / "corners.csv", "-b", files / "board.toml", "-s", nominal, "-o", out,
        *more,
    )  # fmt: skip


def test_an_absurd_calibration_is_not_delivered(files, tmp_path, monkeypatch, capsys):
    true = prism_setup()
    write_setup(drawn(true, facets=4), tmp_path / "four.toml")
    out = tmp_path / "found.toml"
    status, said, error = calibrated(monkeypatch, capsys, files, tmp_path / "four.toml", out)
    assert status == 1
    assert "the calibration failed" in error
    assert len(error.strip().splitlines()) == 1
    assert "found_failed.toml instead of found.toml" in error
    assert not out.exists()
    assert (tmp_path / "found_failed.toml").exists()
    for absent in ("photographs left out", "depth error from", "standard deviation of depth"):
        assert absent not in said
    page = (tmp_path / "found_report" / "report.html").read_text()
    warning = page.index("the calibration failed, nothing below is to be relied on")
    assert warning < page.index("never shows the target")
    assert warning < page.index("<img")
    assert not (tmp_path / "found_failed_report").exists()
    assert "held_out" not in read_calibration(tmp_path / "found_report" / "calibration.json")


def test_views_that_are_numbered_otherwise_are_told(files, tmp_path, monkeypatch, capsys, no_pictures):
    write_setup(drawn(prism_setup(), azimuth_deg=210.0), tmp_path / "turned.toml")
    words = (tmp_path / "turned.toml", tmp_path / "found.toml")
    status, _, error = calibrated(monkeypatch, capsys, files, *words)
    assert status == 1
    assert "view 0 of the corners is facet 2 of the setup" in error
    assert "azimuth_deg = 90" in error  # the drawing that took the photographs


def test_a_calibration_that_was_cut_short_failed(files):
    seen = read_observations(files / "corners.csv", BOARD)
    start = read_setup(files / "nominal.toml")
    whole, short = (calibrate(seen, BOARD, start, iterations=count) for count in (60, 1))
    assert failure_of(whole) == ""
    assert failure_of(short)
    lost = replace(whole.solution, weights=np.where(np.arange(len(seen)) % 3 > 0, 0.0, 1.0))
    assert "explains no more than 33 % of the corners" in failure_of(replace(whole, solution=lost))
    assert "did not converge (cut short)" in failure_of(
        replace(whole, solution=replace(whole.solution, converged=False, message="cut short"))
    )


def test_noise_that_was_stated_too_small_is_no_failure(files):
    seen = read_observations(files / "corners.csv", BOARD)
    result = calibrate(replace(seen, sigma=1e-3), BOARD, read_setup(files / "nominal.toml"))
    assert result.solution.sigma0 > 20  # 0.05 px of noise for the 0.001 that was stated
    assert failure_of(result) == ""


def test_the_report_compares_routes_and_names_what_was_held(files, tmp_path, monkeypatch, capsys):
    words = (files / "nominal.toml", tmp_path / "found.toml", "--no-guide", "--no-validate")
    status, said, _ = calibrated(monkeypatch, capsys, files, *words, "--compare", "--hold", "optic.tilt_z")
    assert status == 0
    page = (tmp_path / "found_report" / "report.html").read_text()
    for name in ("ray sketch (middle)", "virtual cameras, intrinsics free", "physical model"):
        assert name in said
        assert f"<td>{name}</td>" in page
    document = read_calibration(tmp_path / "found_report" / "calibration.json")
    sketch, virtual, physical = (route["figures"]["rms"] for route in document["routes"])
    assert physical < virtual < sketch  # these photographs are of a real prism, and its drawing is off
    assert "not what --free, --hold" in page
    assert "of the free parameters, for errors of the corners that are independent" in page
    for name, value in (("optic.tilt_z", "0"), ("optic.index", "1.5168"), ("camera.focal_x", "1200")):
        assert f"<td>{name}</td><td class=number>{value}" in page
    assert page.count("<td>held</td>") == 13  # nine of the lens, tilt, azimuth, index; facets are one row


def test_depths_without_photographs_are_left_out():
    class Found:
        def table(self):
            return [("1 to 2 mm", 0, 0.1, *[float("nan")] * 4), ("all", 1, 0.1, 0.2, 0.3, 0.4, float("nan"))]

    assert held_out_rows(Found()) == [("all", "1", "0.1", "0.2", "+0.300", "0.4", "-")]


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        ([], ["which photographs", "--corners"]),
        (["missing.png"], ["missing.png", "no such file"]),
        (["small.png"], ["320x240", "640x480"]),
        (["grey.png", "--channel", "red"], ["grey.png is grey"]),
        (["grey.png"], ["no view", "chessboard"]),
        (["empty"], ["there are no photographs"]),
        (["nominal.toml"], ["is no photograph"]),
        (["*.jpg"], ["no file has a name like this"]),
        (["--camera-photos", "grey.png"], ["which photographs", "--camera-photos"]),
        (["grey.png", "--corners", "corners.csv"], ["not both"]),
        (["grey.png", "--facets", "3"], ["--facets", "setup file"]),
        (["grey.png", "--camera-board", "board.toml"], ["--camera-photos"]),
        (["grey.png", "--camera", "board.toml"], ["no [camera] table"]),
        (["grey.png", "--free", "optic.apx"], ["optic.apx", "did you mean optic.apex"]),
        (["grey.png", "--tolerance", "optic.apex"], ["NAME=VALUE"]),
        (["grey.png", "--depth", "900..600"], ["NEAR < FAR"]),
        (["--corners", "wide.csv"], ["outside a picture of 640 x 480 px"]),
        (["--corners", "corners.csv", "--hold", "optic.index"], ["held anyway"]),
        (["grey.png", "--free", "optic.pose", "--tolerance", "optic.apex=1"], ["optic.apex", "held"]),
        (["grey.png", "-o", "nominal.toml"], ["overwrite"]),
        (["grey.png", "-o", "found.json"], [".toml"]),
        (["grey.png", "--board", "wrong.toml"], ["wrong.toml", "board.columns"]),
    ],
)
def test_bad_requests_are_named(words, expected, files, tmp_path, monkeypatch, capsys):
    for name in ("board.toml", "nominal.toml", "corners.csv"):
        (tmp_path / name).write_bytes((files / name).read_bytes())
    (tmp_path / "wrong.toml").write_text('[board]\nkind = "chessboard"\nrows = 8\nsquare = 20.0\n')
    corners = read_observations(files / "corners.csv")
    write_observations(tmp_path / "wide.csv", replace(corners, pixels=2 * corners.pixels))
    noise = np.random.default_rng(3).integers(0, 255, (480, 640), dtype=np.uint8)
    write_image(tmp_path / "grey.png", noise)
    write_image(tmp_path / "small.png", noise[:240, :320])
    (tmp_path / "empty").mkdir()
    monkeypatch.chdir(tmp_path)
    usual = [("--board", "board.toml"), ("--setup", "nominal.toml"), ("-o", "found.toml")]
    given = [word for option in usual if option[0] not in words for word in option]
    status, _, error = run(monkeypatch, capsys, *words, *given)
    assert status == 2
    assert len(error) < 1000
    for text in expected:
        assert text in error
    assert not (tmp_path / "found.toml").exists()


def test_tolerances_are_read_in_the_units_of_the_tables():
    setup = prism_setup()
    found = parse_tolerances(["optic.apex=0.5", "optic.shift_x = 2 mm", "camera.focal=10px"], setup)
    assert found == pytest.approx({"optic.apex": np.deg2rad(0.5), "optic.shift_x": 2.0, "camera.focal": 10.0})
    for wrong in ("optic.pose=1", "optic.apex=1mm", "optic.apex=-1", "optic.apex=e", "optic.nothing=1", "=1"):
        with pytest.raises(SetupError):
            parse_tolerances([wrong], setup)


def test_photographs_are_taken_once(tmp_path):
    picture = np.arange(64, dtype=np.uint8).reshape(8, 8)
    (tmp_path / "a").mkdir()
    for name, value in (("one.png", 0), ("two.png", 1), ("a/one.png", 2), ("a/copy.png", 1)):
        write_image(tmp_path / name, picture + np.uint8(value))
    (tmp_path / "a" / "notes.txt").write_text("no photograph")
    files, remarks = find_files([tmp_path / "one.png", tmp_path / "*.png", tmp_path / "a"], "PHOTOS")
    assert [path.name for path in files] == ["one.png", "two.png", "copy.png", "one.png"]
    assert len(remarks) == 1
    assert "one.png" in remarks[0]
    pictures, remarks = read_pictures(files, None, (), lambda *_: None)
    assert pictures.names == (f"{tmp_path.name}/one.png", f"{tmp_path.name}/two.png", "a/one.png")
    assert remarks == ["copy.png is a copy of two.png: left out"]
    write_image(tmp_path / "wide.png", np.zeros((8, 9), np.uint8))
    with pytest.raises(ImageError, match=r"8x8 px.*9x8 px"):
        read_pictures([*files, tmp_path / "wide.png"], None, (), lambda *_: None)


def test_seams_move_by_as_much_as_their_masks():
    left = np.zeros((2, 40, 60), bool)
    left[0, :, :30], left[1, :, 30:] = True, True
    right = np.zeros_like(left)
    right[0, :, :37], right[1, :, 37:] = True, True
    assert seams_moved(left, left) == 0
    assert abs(seams_moved(left, right) - 7) < 0.2  # OpenCV's distances are good to a few per cent
    assert seams_moved(left, np.zeros_like(left)) == np.inf


def test_a_camera_is_read_from_its_own_file_and_from_a_setup(files):
    assert read_camera(files / "camera.toml").focal == CAMERA.focal
    assert read_camera(files / "nominal.toml").size == CAMERA.size


def test_what_is_no_calibration_is_named(files, tmp_path):
    (tmp_path / "other.json").write_text("{}")
    for path, words in ((tmp_path / "no.json", "no such file"), (tmp_path / "other.json", "no calibration"),
                        (files / "board.toml", "not JSON")):  # fmt: skip
        with pytest.raises(SetupError, match=words):
            read_calibration(path)
