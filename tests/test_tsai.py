"""Tsai's method: exact round trips, noise, photographs, and points that tell nothing."""

from dataclasses import replace

import numpy as np
import pytest

from cyclopean import Camera
from cyclopean.calibration.tsai import angles_from_rotation, rotation_from_angles, tsai
from cyclopean.calibration.tsai_camera import TsaiCamera
from cyclopean.calibration.tsai_closed_form import coplanar, non_coplanar
from cyclopean.calibration.zhang import zhang
from cyclopean.errors import SetupError, ShapeError
from cyclopean.geometry import Pose
from cyclopean.targets import DIRECT, Observations
from cyclopean.targets.boards import PointTarget

CAMERA = TsaiCamera((1280, 960), 8.0, (650.0, 470.0), 2e-3, 1e-5, 1.01, (0.0055, 0.0055))
X, Y = np.meshgrid(np.arange(-4, 5) * 20.0, np.arange(-3, 4) * 20.0)
BOARD = np.stack([X.ravel(), Y.ravel(), 0 * X.ravel()], -1)
STEPS = BOARD - np.where(np.abs(BOARD[:, :1]) > 50, 60.0, np.where(np.abs(BOARD[:, :1]) > 10, 30.0, 0.0)) * [0, 0, 1]
POSE = Pose(rotation_from_angles(0.4, -0.3, 0.2), np.array([10.0, -20.0, 500.0]))


def picture(points, camera=CAMERA, pose=POSE, noise=0.0, seed=0):
    """Where a camera sees points."""
    pixels = camera.project(pose @ points)
    return pixels + noise * np.random.default_rng(seed).normal(size=pixels.shape)


def assert_same(found, camera=CAMERA, pose=POSE):
    """Tsai's parameters agree to 1e-6: the residuals end at rounding, 1e-13 px, and nothing amplifies it by 1e5."""
    ours, true = ((c.focal, c.k1, c.k2, c.scale, *c.centre) for c in (found.camera, camera))
    np.testing.assert_allclose(ours, true, rtol=1e-6, atol=1e-9)
    np.testing.assert_allclose(found.camera_from_target.rotation, pose.rotation, atol=1e-9)
    np.testing.assert_allclose(found.camera_from_target.translation, pose.translation, atol=1e-6)
    assert found.rms < 1e-9
    assert found.converged


def test_angles_follow_tsais_matrix():
    yaw, pitch, tilt = 0.3, -0.7, 2.0
    rotation = rotation_from_angles(yaw, pitch, tilt)
    (sy, sp, st), (cy, cp, ct) = np.sin([yaw, pitch, tilt]), np.cos([yaw, pitch, tilt])
    printed = [
        [ct * cy, st * cy, -sy],
        [-st * cp + ct * sy * sp, ct * cp + st * sy * sp, cy * sp],
        [st * sp + ct * sy * cp, -ct * sp + st * sy * cp, cy * cp],
    ]
    np.testing.assert_allclose(rotation, printed, atol=1e-15)  # a few roundings
    np.testing.assert_allclose(angles_from_rotation(rotation), [yaw, pitch, tilt], atol=1e-15)


@pytest.mark.parametrize("move", [(10.0, -20.0, 500.0), (10.0, 0.0, 500.0), (0.0, 0.0, 700.0)])
@pytest.mark.parametrize("angles", [(0.4, -0.3, 0.2), (-0.5, 0.0, 3.0), (0.0, 0.6, -1.5)])
def test_the_closed_form_is_exact_without_distortion(angles, move):
    """With Ty = 0 too, where Tsai's own equations divide by 0."""
    pose = Pose(rotation_from_angles(*angles), np.array(move))
    camera = TsaiCamera((1280, 960), 8.0, (650.0, 470.0), scale=1.02, pitch=(0.0055, 0.0055))
    sensor = camera.sensor(camera.project(pose @ BOARD))
    found = coplanar(BOARD, sensor)
    np.testing.assert_allclose(found.focal, 8.0, rtol=1e-9)  # a null vector to 1e-15, divided by tan(tilt)
    np.testing.assert_allclose(found.pose.rotation, pose.rotation, atol=1e-9)
    np.testing.assert_allclose(found.pose.translation, pose.translation, atol=1e-6)
    sensor = replace(camera, scale=1.0).sensor(camera.project(pose @ STEPS))
    found = non_coplanar(STEPS, sensor, free_scale=True)
    np.testing.assert_allclose([found.focal, found.scale], [8.0, 1.02], rtol=1e-9)
    np.testing.assert_allclose(found.pose.translation, pose.translation, atol=1e-6)


@pytest.mark.parametrize("frame", [Pose(np.eye(3), np.zeros(3)), POSE])
def test_an_exact_picture_of_a_plane(frame):
    found = tsai(
        frame @ BOARD, picture(BOARD), CAMERA.size, centre=CAMERA.centre, pitch=0.0055, distortion=2, scale=1.01
    )
    assert found.coplanar
    assert_same(found, pose=POSE @ frame.inverse)
    assert found.tilt_deg == pytest.approx(np.degrees(np.arccos(POSE.rotation[2, 2])), abs=1e-6)
    if frame is not POSE:
        np.testing.assert_allclose(found.angles, [0.4, -0.3, 0.2], atol=1e-9)


@pytest.mark.parametrize("points", [STEPS, np.random.default_rng(4).uniform(-80, 80, (40, 3))])
@pytest.mark.parametrize("free", ["", "scale", "centre", "scale and centre"])
def test_an_exact_picture_of_a_solid(points, free):
    known = {"scale": 1.01} if "scale" not in free else {"free_scale": True}
    known |= {"centre": CAMERA.centre} if "centre" not in free else {"centre": (639.5, 479.5), "free_centre": True}
    found = tsai(points, picture(points), CAMERA.size, pitch=0.0055, distortion=2, **known)
    assert not found.coplanar
    assert np.isnan(found.tilt_deg)
    assert_same(found)


def test_a_sub_image_with_its_own_centre():
    """A stepped block in one of four sub-images, whose principal point lies outside the sub-image's middle."""
    camera = TsaiCamera((1024, 1024), 50.0, (240.0, 770.0), 1e-5, pitch=(0.02, 0.02))
    pose = Pose(rotation_from_angles(0.2, 0.1, 0.05), np.array([0.0, 0.0, 1000.0]))
    pixels = picture(STEPS, camera, pose)
    fixed = tsai(STEPS, pixels, camera.size, centre=camera.centre, pitch=0.02)
    free = tsai(STEPS, pixels, camera.size, centre=(255.5, 767.5), pitch=0.02, free_centre=True)
    assert_same(fixed, camera, pose)
    assert_same(free, camera, pose)


def test_pixels_outside_the_picture_are_refused():
    with pytest.raises(ShapeError, match=r"outside a picture of 640 x 480 px.*at full size"):
        tsai(BOARD, picture(BOARD), (640, 480))


def test_the_unit_of_the_pitch_is_that_of_the_focal_length():
    pixels = picture(BOARD, noise=0.05)
    known = {"centre": CAMERA.centre, "distortion": 2, "scale": 1.01}
    mm, px = (tsai(BOARD, pixels, CAMERA.size, pitch=pitch, **known) for pitch in (0.0055, 1.0))
    # 1e-6: two minimisations stop at steps of 1e-8 or so
    assert px.camera.focal * 0.0055 == pytest.approx(mm.camera.focal, rel=1e-6)
    assert px.camera.k1 / 0.0055**2 == pytest.approx(mm.camera.k1, rel=1e-4)
    np.testing.assert_allclose(px.camera.focal_px, mm.camera.focal_px, rtol=1e-6)
    np.testing.assert_allclose(px.residuals, mm.residuals, atol=1e-5)


@pytest.mark.parametrize("solid", [False, True])
def test_stated_sigmas_are_those_of_repeats(solid):
    points = STEPS if solid else BOARD
    known = (
        {"centre": (639.5, 479.5), "free_centre": True, "free_scale": True}
        if solid
        else {"centre": CAMERA.centre, "scale": 1.01}
    )
    camera = replace(CAMERA, k2=0.0)
    squares, variances = [], []
    for seed in range(80):
        found = tsai(points, picture(points, camera, noise=0.1, seed=seed), CAMERA.size, pitch=0.0055, **known)
        turn = found.camera_from_target.rotation @ POSE.rotation.T  # small: its rotation vector, to first order
        values = {"focal": found.camera.focal - 8.0, "k1": found.camera.k1 - 2e-3, "scale": found.camera.scale - 1.01}
        values |= {"centre_x": found.camera.centre[0] - 650.0, "centre_y": found.camera.centre[1] - 470.0}
        values |= {"turn_x": turn[2, 1], "turn_y": turn[0, 2], "turn_z": turn[1, 0]}
        moved = found.camera_from_target.translation - POSE.translation
        values |= dict(zip(("move_x", "move_y", "move_z"), moved, strict=True))
        off = np.array([values[name] for name in found.names])
        # without the scale by the residuals, which are 0.1 px
        exact = found.covariance * 0.1**2 / (np.sum(found.residuals**2) / (found.residuals.size - len(off)))
        squares.append(off @ np.linalg.solve(exact, off))
        variances.append(np.sum(found.residuals**2) / (found.residuals.size - len(off)))
    freedom = len(found.names)
    # chi-square: mean F, variance 2 F; 4 standard deviations of a mean of 80
    assert abs(np.mean(squares) - freedom) < 4 * np.sqrt(2 * freedom / 80)
    assert np.mean(variances) == pytest.approx(0.01, rel=0.06)  # 4 times sqrt(2 / 114 / 80)


def test_agrees_with_zhangs_method_on_one_tilted_board():
    """Without distortion, with the centre known, both fit the same model: the same answer."""
    camera = replace(CAMERA, k1=0.0, k2=0.0, scale=1.0)
    pixels = picture(BOARD, camera, noise=0.3)
    count = len(BOARD)
    seen = Observations(np.zeros(count, int), DIRECT, np.arange(count), pixels, ("one",), 0.3)
    guess = Camera(camera.size, 1400.0, camera.centre)
    theirs = zhang(seen, PointTarget(BOARD), camera.size, 0, guess=guess, free_centre=False, free_aspect=False)
    ours = tsai(BOARD, pixels, camera.size, centre=camera.centre, distortion=0)
    assert ours.camera.focal == pytest.approx(theirs.camera.focal[0], rel=1e-6)  # where minimisations stop
    assert ours.sigma["focal"] == pytest.approx(theirs.sigma[0], rel=1e-3)
    np.testing.assert_allclose(ours.residuals, theirs.residuals, atol=1e-4)


@pytest.mark.parametrize(("k1", "k2"), [(2e-3, 1e-5), (-2e-3, 0.0), (8e-3, -2e-5), (0.0, 0.0)])
def test_distortion_and_its_inverse_cancel(k1, k2):
    camera = replace(CAMERA, k1=k1, k2=k2)
    pixels = np.stack(np.meshgrid(np.linspace(0, 1279, 31), np.linspace(0, 959, 31)), -1)
    flat = camera.normalise(pixels)
    np.testing.assert_allclose(camera.denormalise(flat), pixels, atol=1e-9)  # px; roundings
    seen = camera.sensor(pixels)
    square = np.sum(seen**2, -1, keepdims=True)
    np.testing.assert_allclose(flat * 8.0, seen * (1 + k1 * square + k2 * square**2), atol=1e-14)


def test_beyond_the_fold_there_is_nothing():
    camera = replace(CAMERA, k1=-0.02, k2=0.0)
    edge = 1 / np.sqrt(3 * 0.02)  # where r (1 + k1 r^2) stops growing
    assert camera.fold_radius == pytest.approx(edge)
    assert np.isnan(camera.normalise([650 + 1.01 * edge / 0.0055, 470.0])).all()
    highest = edge * (1 - 0.02 * edge**2) / 8.0
    assert np.isnan(camera.denormalise([1.01 * highest, 0.0])).all()
    assert np.isfinite(camera.denormalise([0.99 * highest, 0.0])).all()


@pytest.mark.parametrize(("k1", "bound"), [(0.0, 1e-9), (2e-3, 0.01), (-2e-3, 0.05), (8e-3, 1.0)])
def test_our_camera_departs_by_no_more_than_stated(k1, bound):
    camera = replace(CAMERA, k1=k1, k2=0.0)
    brown = camera.brown()
    assert brown.departure_rms <= brown.departure_max < bound  # px; the series in r^2 ends with k3
    pixels = np.stack(np.meshgrid(np.linspace(3, 1270, 40), np.linspace(3, 950, 40)), -1)
    miss = np.linalg.norm(brown.camera.denormalise(camera.normalise(pixels)) - pixels, axis=-1)
    assert miss.max() <= brown.departure_max + 1e-9
    part = camera.brown((300, 200, 600, 500))
    assert part.departure_max <= brown.departure_max + 1e-9  # less picture, better fit
    assert brown.camera.focal == pytest.approx(camera.focal_px)


def test_rendered_boards_one_at_a_time(mitsuba):
    with np.load(mitsuba / "camera_only" / "corners.npz") as truth:
        view, corner, uv = (truth[k] for k in ("view", "corner_id", "uv"))
    points = np.stack([corner % 13 + 1, corner // 13 + 1, 0 * corner], -1) * 20.0
    noise = 0.05 * np.random.default_rng(0).normal(size=uv.shape)
    tilted = 0
    for photo in range(12):
        mine = view == photo
        exact = tsai(points[mine], uv[mine], (1280, 960))
        if exact.tilt_deg < 20:
            continue
        tilted += 1
        assert exact.camera.focal == pytest.approx(2400, abs=1e-4)  # the corners are exact
        found = tsai(points[mine], uv[mine] + noise[mine], (1280, 960))
        assert abs(found.camera.focal - 2400) < 4 * found.sigma["focal"]
        assert found.sigma["focal"] < 24  # 1 percent, from a single photograph
    assert tilted >= 6


def test_corner_of_chessboards(real):
    """26 hand-picked corners: better than others' 2.64 and 3.25 px with k1, 0.84 and 1.71 px with k1, k2."""
    given = np.loadtxt(real / "tsai_corner_cube" / "points.csv", delimiter=",", usecols=range(7))
    points = given[:, :3] * [1, 1, -1]  # the file's frame is left-handed
    for distortion, bounds, baseline in ((1, (2.64, 3.25), 27.8), (2, (0.84, 1.71), 27.0)):
        left, right = (
            tsai(points, given[:, k : k + 2], (3000, 3000), pitch=0.001096, distortion=distortion) for k in (3, 5)
        )
        assert left.rms < bounds[0]
        assert right.rms < bounds[1]
        centres = [one.camera_from_target.inverse.translation for one in (left, right)]
        # others' baseline; hand-picked corners tell it to a millimetre
        assert np.linalg.norm(centres[0] - centres[1]) == pytest.approx(baseline, abs=1.0)
    assert left.camera.focal == pytest.approx(1.9, abs=0.06)  # mm; published 1.89 and 1.93
    with pytest.raises(SetupError, match="left-handed"):
        tsai(given[:, :3], given[:, 3:5], (3000, 3000), pitch=0.001096)


@pytest.mark.parametrize("noise", [0.0, 0.05, 0.5])
@pytest.mark.parametrize("tilt", [0.0, 0.2])
def test_a_plane_that_faces_the_camera_tells_no_focal_length(noise, tilt):
    pose = Pose(rotation_from_angles(np.radians(tilt), 0.0, 0.1), np.array([10.0, 5.0, 500.0]))
    with pytest.raises(SetupError, match="told apart"):
        tsai(BOARD, picture(BOARD, pose=pose, noise=noise), CAMERA.size, centre=CAMERA.centre, scale=1.01)


def test_a_hardly_tilted_plane_gets_a_note():
    pose = Pose(rotation_from_angles(np.radians(6), 0.0, 0.1), np.array([10.0, 5.0, 500.0]))
    found = tsai(BOARD, picture(BOARD, pose=pose, noise=0.3), CAMERA.size, centre=CAMERA.centre, scale=1.01)
    assert any("30 or more" in note for note in found.notes)


def test_rows_that_are_not_numbers_are_left_out():
    pixels = picture(BOARD)
    pixels[5] = np.nan
    found = tsai(BOARD, pixels, CAMERA.size, centre=CAMERA.centre, pitch=0.0055, distortion=2, scale=1.01)
    assert np.isnan(found.residuals[5]).all()
    assert any("not numbers" in note for note in found.notes)
    assert_same(found)


def test_the_fewest_points():
    five = BOARD[[0, 8, 30, 54, 62]] + [[0, 0, 0], [0, 0, 0], [3, 7, 0], [0, 0, 0], [0, 0, 0]]
    camera = replace(CAMERA, k1=0.0, k2=0.0)
    found = tsai(five, picture(five, camera), CAMERA.size, centre=CAMERA.centre, pitch=0.0055, scale=1.01, distortion=0)
    assert_same(found, camera)
    seven = np.random.default_rng(6).uniform(-80, 80, (7, 3))
    found = tsai(seven, picture(seven), CAMERA.size, centre=CAMERA.centre, pitch=0.0055, distortion=2, free_scale=True)
    assert_same(found)
    with pytest.raises(SetupError, match="at least 5 of a plane or 7"):
        tsai(five[:4], picture(five[:4]), CAMERA.size)
    with pytest.raises(SetupError, match="at least 5 of a plane or 7"):
        tsai(seven[:6], picture(seven[:6]), CAMERA.size)


def test_wrong_calls():
    pixels = picture(BOARD)
    with pytest.raises(ShapeError, match=r"pixels \(N, 2\)"):
        tsai(BOARD, pixels[1:], CAMERA.size)
    with pytest.raises(SetupError, match="distortion"):
        tsai(BOARD, pixels, CAMERA.size, distortion=3)
    for free in ("free_scale", "free_centre"):
        with pytest.raises(SetupError, match="a plane tells neither"):
            tsai(BOARD, pixels, CAMERA.size, **{free: True})
    with pytest.raises(SetupError, match="line"):
        tsai(BOARD[:9], pixels[:9], CAMERA.size)
    with pytest.raises(SetupError, match="too few, on a line, or in a plane"):
        tsai(BOARD, pixels, CAMERA.size, coplanar=False)
    with pytest.raises(SetupError, match="positive"):
        TsaiCamera((640, 480), -1.0, (320.0, 240.0))
