"""Routes compared: each is judged by what is true of the views it ends with."""

import json
from dataclasses import replace

import numpy as np
import pytest
from board_views import BOARD, NOISE, POSES, observe_exactly, prism_setup, with_noise

from cyclopean import Mirror, Mirrors, Setup
from cyclopean.calibration.comparison import compare
from cyclopean.calibration.judgement import hold, judge
from cyclopean.calibration.routes import FIELD_POINT, PHYSICAL, ROUTES, FieldPoint, nearest_to_axis
from cyclopean.cli import app
from cyclopean.errors import SetupError
from cyclopean.files import write_board, write_observations, write_setup
from cyclopean.geometry import Pose
from cyclopean.jobs.comparison_report import comparison_remarks, comparison_table
from cyclopean.targets import Board, Observations

DEPTHS = (500.0, 600.0, 700.0)
FLAT = [Pose(np.eye(3), np.array([0, 0, depth]) - BOARD.points.mean(0) * [1, 1, 0]) for depth in DEPTHS]
DRAWN = prism_setup(apex_deg=12.3, distance=62.0, tilt_deg=(0.7, 0.7, 0.0))


@pytest.fixture(scope="module")
def seen():
    return with_noise(observe_exactly(prism_setup(), POSES))


@pytest.fixture(scope="module")
def flat():
    return replace(with_noise(observe_exactly(prism_setup(), FLAT), 1), photos=("a", "b", "c"))


@pytest.fixture(scope="module")
def comparison(seen, flat):
    return compare(seen, BOARD, DRAWN, test=flat, known_depths=dict(zip("abc", DEPTHS, strict=True)))


def by_name(comparison):
    return {route.name: route for route in comparison.routes}


def test_the_model_that_made_the_photographs_explains_them(comparison):
    route = by_name(comparison)[PHYSICAL]
    # six numbers of each pose are fitted to some 200 coordinates, the calibration errs by less than the noise
    assert comparison.figures(route).rms == pytest.approx(NOISE, rel=0.15)
    assert route.converged
    assert not route.message
    # no route that lays other rays through the optic comes near it
    for other in comparison.routes:
        if other is not route:
            assert comparison.figures(other).rms > 1.5 * NOISE
            assert comparison.figures(other).rigid > comparison.figures(route).rigid


def test_every_route_is_there_and_judged_alike(comparison):
    assert tuple(route.name for route in comparison.routes) == ROUTES
    for route in comparison.routes:
        np.testing.assert_array_equal(route.judgement.rows, comparison.routes[-1].judgement.rows)
        assert route.seconds >= 0
    np.testing.assert_array_equal(comparison.depths, DEPTHS)
    assert comparison.spacing == BOARD.square
    assert comparison.calibrations == len(POSES)
    assert sum(mask.sum() for _, mask in comparison.bins()) == len(DEPTHS)


def test_exact_pixels_through_the_true_views_leave_nothing():
    setup = prism_setup()
    flat = observe_exactly(setup, FLAT)
    rig = setup.rig()
    held = hold(rig, flat, BOARD.points[flat.point])
    found = judge(rig, held, flat, BOARD.points, np.ones(len(flat), dtype=bool), np.array([500.0, 600.0, 710.0]))
    # 1e-5 mm: the solver stops when a step is small
    for values in (found.rigid, found.rigid_max, found.flatness, found.square, found.square_sd):
        np.testing.assert_allclose(values, 0, atol=1e-5)
    np.testing.assert_allclose(found.depth, DEPTHS, atol=1e-5)
    np.testing.assert_allclose(found.pose_depth, DEPTHS, atol=1e-5)
    # the third photograph is said to be 10 mm farther than it is
    np.testing.assert_allclose(found.depth_rms, [0, 0, 10], atol=1e-5)
    np.testing.assert_allclose(found.depth_max, [0, 0, 10], atol=1e-5)


def test_depth_tables_say_what_was_recovered(comparison):
    for route in comparison.routes:
        rows = comparison.depth_table(route)
        assert [row.depth for row in rows] == list(DEPTHS)
        for row in rows:
            assert row.percent == pytest.approx(100 * (row.mean / row.depth - 1))
            # the root mean square lies between the mean error and the largest
            assert abs(row.mean - row.depth) <= row.rms * (1 + 1e-9) <= row.largest * (1 + 2e-9)
    true = comparison.depth_percent(by_name(comparison)[PHYSICAL])
    sketched = comparison.depth_percent(by_name(comparison)["ray sketch (middle)"])
    assert true[0] < true[1] < sketched[0]


def test_a_field_point_brings_its_own_depth_right(seen, flat):
    setup = prism_setup(apex_deg=12.3)
    _, pixels = nearest_to_axis(flat, setup, 1)
    names = ("ray sketch (middle)", FIELD_POINT)
    found = compare(seen, BOARD, setup, names, flat, field_point=FieldPoint(pixels, 600.0), known_depths={"b": 600.0})
    ((before,), (after,)) = (found.depth_table(route) for route in found.routes)
    # what is left is how sketched cameras depart from true rays beside the point; the drawing's error is gone
    assert abs(after.percent) < 0.5 * abs(before.percent)
    assert found.notes == ()


def test_without_other_photographs_they_are_left_out_in_turn(seen):
    done = []
    names = ("virtual cameras, intrinsics free", PHYSICAL)
    found = compare(seen, BOARD, DRAWN, names, folds=2, progress=lambda k, total: done.append((k, total)))
    assert done == [(1, 4), (2, 4), (3, 4), (4, 4)]
    assert found.photos == seen.photos
    assert found.calibrations == 2  # of five, in groups of three and two
    free, physical = (found.figures(route) for route in found.routes)
    assert free.photographs == physical.photographs == 5
    # two or three photographs determine the optic less well: twice the noise at most
    assert NOISE * 0.85 < physical.rms < 2 * NOISE < free.rms
    assert np.isnan(found.known).all()
    assert found.depth_table(found.routes[0]) == []
    true = np.array([(pose @ BOARD.points)[:, 2].mean() for pose in POSES])
    np.testing.assert_allclose(found.depths, true, rtol=0.05)  # not all of the board is seen


def test_a_route_that_fails_says_why(seen):
    mirrors = Setup(
        prism_setup().camera,
        Mirrors((Mirror((25, 0, 110), (-1, 0, 0.1), (110, 110)), Mirror((-25, 0, 110), (1, 0, 0.1), (110, 110)))),
    )
    there = observe_exactly(mirrors, [POSES[0], POSES[1]])
    found = compare(there, BOARD, mirrors, (FIELD_POINT,), there, field_point=FieldPoint(there.pixels[:2], 500.0))
    (route,) = found.routes
    assert route.failed
    assert not route.converged
    assert np.isnan(route.seconds)
    assert "no apex to adjust" in route.message
    assert np.isnan(found.figures(route).rms)
    assert np.isnan(found.depth_percent(route)[0])


def test_a_corner_that_no_route_explains_does_not_count(seen, flat):
    pixels = flat.pixels.copy()
    pixels[7] += [60.0, -45.0]
    spoilt = compare(seen, BOARD, DRAWN, (PHYSICAL,), replace(flat, pixels=pixels))
    assert spoilt.routes[0].judgement.rows.sum() == len(flat) - 1
    assert any("1 corner that no route explains, left out: a" in note for note in spoilt.notes)
    assert spoilt.figures(spoilt.routes[0]).rms == pytest.approx(NOISE, rel=0.15)


def test_wrong_calls_say_what_was_wanted(seen):
    with pytest.raises(SetupError, match="routes must be some of"):
        compare(seen, BOARD, DRAWN, ("tsai",))
    with pytest.raises(SetupError, match="folds must lie between 2 and"):
        compare(seen, BOARD, DRAWN, (PHYSICAL,), folds=9)
    with pytest.raises(SetupError, match="no photographs through the optic to judge by"):
        compare(seen, BOARD, DRAWN, (PHYSICAL,), seen.select(np.zeros(len(seen), dtype=bool)))
    with pytest.raises(SetupError, match="one photograph cannot both"):
        compare(seen.of_photos([0]), BOARD, DRAWN, (PHYSICAL,))


@pytest.fixture
def files(tmp_path, seen, flat):
    write_board(tmp_path / "board.toml", Board("chessboard", BOARD.columns + 1, BOARD.rows + 1, BOARD.square))
    write_setup(DRAWN, tmp_path / "nominal.toml")
    write_observations(tmp_path / "corners.csv", Observations.join([seen, flat]))
    (tmp_path / "depths.csv").write_text("photo,depth_mm\nc,700\na,500\n")
    return tmp_path


def command(files, *more):
    given = ["--board", "board.toml", "--setup", "nominal.toml", "--corners", "corners.csv", "-o", "out"]
    words = [str(files / word) if (files / word).exists() or word == "out" else word for word in (*given, *more)]
    app(["compare-calibrations", *words], result_action="return_value")


def test_the_command_writes_tables_and_pictures(files, capsys):
    command(files, "--test", "a", "b", "c", "--test-depths", "depths.csv")
    said = capsys.readouterr().out
    assert all(text in said for text in ("physical model", "700 mm", "largest (%)"))
    document = json.loads((files / "out" / "comparison.json").read_text())
    assert [photo["known_depth"] for photo in document["photographs"]] == [500.0, None, 700.0]
    assert [route["name"] for route in document["routes"]] == list(ROUTES)
    physical = document["routes"][-1]
    # the chessboard's frame starts one square before its first corner, as BOARD's does not: a pose takes that up
    assert physical["figures"]["rms"] == pytest.approx(NOISE, rel=0.15)
    assert [row["depth"] for row in physical["known_depths"]] == [500.0, 700.0]
    page = (files / "out" / "report.html").read_text()
    assert page.count("Recovered depth (mm)") == 1
    assert page.count("<th>ray sketch (edge)</th>") == 3  # shape, errors in %, and depths
    assert "nan" not in said + page
    assert (files / "out" / "comparison.png").stat().st_size > 10_000


def test_figures_that_do_not_exist_are_dashes(comparison):
    route = comparison.routes[1]
    nothing = replace(route.judgement, points=0 * route.judgement.points, rigid=np.nan * route.judgement.rigid)
    lame = replace(comparison, routes=(replace(route, judgement=nothing),))
    columns, (row,) = comparison_table(lame)
    assert "nan" not in "".join(row)
    assert row[3] == "-"
    assert columns[1:4] == ("time (s)", "pixels (px rms)", "shape (mm rms)")


def test_virtual_cameras_that_drifted_are_told(comparison):
    tied = by_name(comparison)["virtual cameras, intrinsics tied"]
    far = replace(tied.judgement, depth=1.175 * comparison.depths)
    drifted = replace(comparison, routes=(replace(tied, judgement=far),))
    (remark,) = [text for text in comparison_remarks(drifted, ()) if "drifted" in text]
    assert "depths are 17.5 % too large wherever the board stood" in remark
    near = replace(tied.judgement, depth=comparison.depths * [1.175, 0.9, 1.0])  # not by one factor
    scattered = replace(comparison, routes=(replace(tied, judgement=near),))
    assert not [text for text in comparison_remarks(scattered, ()) if "drifted" in text]


@pytest.mark.parametrize(
    ("more", "message"),
    [
        (("--test", "z"), "there is no one photograph 'z'"),
        (("--test", "a", "--test-depths", "500,600"), "2 depths for 1 photograph to judge by"),
        (("--test", "a", "--test-depths", "far"), "a depth is a number of mm above 0, got 'far'"),
        (("--field-point", "a"), "--field-point wants PHOTO,DEPTH"),
        (("--test", "a", "--folds", "2"), "give one of the two"),
        (("--test-board", "board.toml"), "--test-board is the board of the photographs --test"),
    ],
)
def test_a_wrong_option_is_named(files, more, message):
    with pytest.raises(SetupError, match=message.replace("(", r"\(")):
        command(files, *more)
