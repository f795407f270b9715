"""Photographs that a calibration has not seen: what is reported about them is what is true of them."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from board_views import BOARD, NOISE, POSES, Grid, observe_exactly, pose_at, prism_setup, with_noise

from benchmarks.data import renderer_setup
from cyclopean.calibration.physical import calibrate
from cyclopean.calibration.validation import hold_out, validate
from cyclopean.errors import SetupError
from cyclopean.geometry import Pose, rigid_motion
from cyclopean.targets import Observations

FREE = ("optic.pose", "optic.apex")


@pytest.fixture(scope="module")
def observations():
    return with_noise(observe_exactly(prism_setup(), POSES))


@pytest.fixture(scope="module")
def validation(observations):
    return hold_out(observations, BOARD, prism_setup(), FREE)


def test_residuals_are_the_noise(validation, observations):
    # six numbers of each pose are fitted to some 250 coordinates; 10 %: a standard deviation is 2 %
    assert validation.rms == pytest.approx(NOISE, rel=0.1)
    assert set(validation.view_rms) == {0, 1, 2}
    np.testing.assert_allclose(list(validation.view_rms.values()), NOISE, rtol=0.15)
    np.testing.assert_allclose(validation.depth_rms, NOISE, rtol=0.15)
    assert not validation.outliers.any()
    assert validation.residuals.shape == (len(observations), 2)
    assert validation.shared.shape == (5, 7)
    np.testing.assert_array_equal(validation.fold, np.arange(5))


def test_triangulated_boards_are_as_wrong_as_their_pixels_say(validation):
    seen = validation.triangulated >= 20
    assert seen.any()
    # some 50 points each: their number of degrees of freedom leaves 10 %, the calibration adds a little
    np.testing.assert_allclose(validation.rigid[seen] / validation.expected[seen], 1, atol=0.4)
    # no more than the noise in depth, less than the whole misfit
    assert (validation.flatness[seen] <= validation.rigid[seen]).all()
    assert (validation.flatness[seen] > 0.2 * validation.rigid[seen]).all()
    assert validation.spacing == BOARD.square


def test_exact_pixels_give_an_exact_board():
    setup = prism_setup()
    found = hold_out(observe_exactly(setup, POSES), BOARD, setup, FREE, folds=2)
    for values in (found.flatness, found.square, found.square_sd, found.rigid):
        # 1e-5 mm: the calibration stops when a step is small, and noise of 1e-13 px is not noise
        np.testing.assert_allclose(values[found.triangulated >= 6], 0, atol=1e-5)
    assert found.rms < 1e-6


def test_squares_are_measured_by_the_optic(observations):
    # the optic is right and held, so it measures 20 mm whatever length the squares are said to have
    found = hold_out(observations, Grid(square=1.02 * BOARD.square), prism_setup(), ("optic.tilt_z",), folds=2)
    *_, percent, spread, _ = found.table()[-1]
    tolerance = 5 * spread / np.sqrt(found.triangulated.sum())  # standard deviations; as many pairs as points
    assert percent == pytest.approx(100 / 1.02 - 100, abs=tolerance)
    assert tolerance < 1.9  # %, so that the missing 2 % are seen


def test_photographs_that_were_left_out_do_not_come_back(observations):
    spoilt = observations.pixels.copy()
    mine = observations.photo == 3
    spoilt[mine] += [4.0, -3.0]  # a photograph of a board elsewhere changes only the folds that saw it
    clean = calibrate(observations, BOARD, prism_setup(), FREE, poses=POSES)
    dirty = replace(clean, observations=replace(observations, pixels=spoilt))
    a, b = validate(clean), validate(dirty)
    np.testing.assert_array_equal(a.shared[3], b.shared[3])
    assert not np.allclose(a.shared[2], b.shared[2], rtol=1e-6)


def test_views_without_the_optic_are_spread_over_the_folds(observations):
    poses = [pose_at(0, 0, 500, 20), pose_at(20, 10, 600, -20), pose_at(0, 20, 700, 0, 30)]
    camera = prism_setup().camera
    pixels = [camera.project(pose @ BOARD.points) for pose in poses]
    shown = [camera.contains(there) for there in pixels]
    direct = Observations(
        np.concatenate([np.full(good.sum(), k) for k, good in enumerate(shown)]),
        -1,
        np.concatenate([np.flatnonzero(good) for good in shown]),
        np.concatenate([there[good] for there, good in zip(pixels, shown, strict=True)]),
        tuple(f"direct {k}" for k in range(3)),
        NOISE,
    )
    both = Observations.join([with_noise(direct, 3), observations])
    found = hold_out(both, BOARD, prism_setup(), FREE, folds=3)
    assert sorted(found.fold[:3]) == [0, 1, 2]
    assert found.view_rms[-1] == pytest.approx(NOISE, rel=0.15)
    assert np.isnan(found.rigid[:3]).all()  # one view alone gives no depth
    assert np.isfinite(found.rigid[3:]).any()


def test_colours_count_as_more_points(observations):
    setup = prism_setup()
    both = replace(observations, channel=np.arange(len(observations)) % 2)
    found = hold_out(both, BOARD, [setup, setup], FREE, folds=2)
    single = hold_out(observations, BOARD, setup, FREE, folds=2)
    # every second view of a point has gone to the other colour, so pairs of views are fewer
    assert 0 < found.triangulated.sum() < single.triangulated.sum()
    photo, view, point = (np.tile(part, 2) for part in (both.photo, both.view, both.point))
    pixels, channel = np.tile(both.pixels, (2, 1)), np.repeat([0, 1], len(both))
    twice = Observations(photo, view, point, pixels, both.photos, NOISE, channel)
    doubled = hold_out(twice, BOARD, [setup, setup], FREE, folds=2)
    np.testing.assert_array_equal(doubled.triangulated, 2 * single.triangulated)
    # the same pixels again, so the same squares; 1e-3 mm: the robust scale differs in its rounding
    np.testing.assert_allclose(doubled.square, single.square, atol=1e-2)


def test_progress_counts_calibrations(observations):
    told = []
    hold_out(observations, BOARD, prism_setup(), FREE, folds=2, progress=lambda *numbers: told.append(numbers))
    assert told == [(1, 3), (2, 3), (3, 3)]


def test_a_table_has_a_row_for_each_bin(observations):
    found = validate(calibrate(observations, BOARD, prism_setup(), FREE, poses=POSES), folds=2, depths=[400, 650, 900])
    rows = found.table()
    assert [row[0] for row in rows] == ["400 to 650 mm", "650 to 900 mm", "all"]
    assert [row[1] for row in rows] == [3, 2, 5]
    assert rows[0][3] < rows[1][3]  # farther boards are flat less well


def test_the_best_rigid_motion_is_the_true_one():
    rng = np.random.default_rng(4)
    points, pose = rng.normal(size=(7, 3)), Pose.from_rotation_vector([0.4, -2.0, 1.0], [1.0, 2.0, 3.0])
    for model in (points, points * [1, 1, 0]):
        found = rigid_motion(model, pose @ model)
        np.testing.assert_allclose(found.rotation, pose.rotation, atol=1e-12)
        np.testing.assert_allclose(found.translation, pose.translation, atol=1e-12)


def test_too_few_photographs_are_named(observations):
    with pytest.raises(SetupError, match="two at least"):
        hold_out(observations.of_photos([0]), BOARD, prism_setup(), FREE)
    with pytest.raises(SetupError, match=r"between 2 and the number of photographs, 5, got 9"):
        hold_out(observations, BOARD, prism_setup(), FREE, folds=9)


def test_rendered_boards_come_out_flat_and_of_the_right_size(mitsuba):
    table = np.load(mitsuba / "calib_t3_b40" / "corners.npz")
    x, y = np.meshgrid(np.arange(1, 12), np.arange(1, 9))
    target = SimpleNamespace(points=30.0 * np.stack([x, y, 0 * x], -1).reshape(-1, 3))
    pixels = table["uv"] + np.random.default_rng(0).normal(0, NOISE, table["uv"].shape)
    seen = Observations(table["view"], table["facet"], table["corner_id"], pixels, tuple("abcdef"), NOISE)
    found = hold_out(seen, target, renderer_setup("t3_b40"), FREE, folds=3)
    assert found.rms == pytest.approx(NOISE, rel=0.1)
    np.testing.assert_allclose(found.rigid / found.expected, 1, atol=0.3)
    assert abs(found.table()[-1][4]) < 0.1  # % of the squares: 450 pairs of 0.5 %, and the calibration
