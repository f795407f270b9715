"""Zhang's method: exact boards, noise, published answers, and boards that tell nothing."""

from dataclasses import replace

import cv2
import numpy as np
import pytest

from cyclopean import Camera
from cyclopean.calibration.zhang import zhang
from cyclopean.errors import SetupError, ShapeError
from cyclopean.geometry import Pose
from cyclopean.targets import DIRECT, Observations
from cyclopean.targets.boards import PointTarget

CAMERA = Camera((1280, 960), (1500.0, 1510.0), (650.0, 470.0), (-0.2, 0.1, 1e-3, -5e-4, 0.05))
X, Y = np.meshgrid(np.arange(-4, 5) * 20.0, np.arange(-3, 4) * 20.0)
BOARD = np.stack([X.ravel(), Y.ravel(), 0 * X.ravel()], -1)
POSES = [
    Pose.from_rotation_vector(np.radians(turn), move)
    for turn, move in [
        ((25, 10, 0), (0, 0, 500)),
        ((-25, 20, 10), (50, 20, 600)),
        ((15, -30, 20), (-60, -30, 450)),
        ((-20, -25, 90), (20, -40, 550)),
        ((5, 30, -20), (-40, 30, 480)),
    ]
]


def photographs(poses, camera=CAMERA, points=BOARD, noise=0.0, seed=0, sigma=0.05):
    """Observations of a target in several poses."""
    pixels = np.concatenate([camera.project(pose @ points) for pose in poses])
    pixels = pixels + noise * np.random.default_rng(seed).normal(size=pixels.shape)
    count, names = len(points), tuple(f"photograph {k}" for k in range(len(poses)))
    return Observations(
        np.repeat(np.arange(len(poses)), count), DIRECT, np.tile(np.arange(count), len(poses)), pixels, names, sigma
    )


def bent(height):
    """The board, warped by `height` mm."""
    return BOARD + np.array([0.0, 0.0, height]) * np.random.default_rng(3).normal(size=(len(BOARD), 1))


TURN = Pose.from_rotation_vector((1.0, 0.5, 0.2), (5.0, -3.0, 40.0))


@pytest.mark.parametrize(
    ("points", "guess"),
    [(BOARD, None), (TURN @ BOARD, None), (bent(0.1), None), (bent(30.0), Camera((1280, 960), 1200.0))],
    ids=["plane", "plane elsewhere", "board not quite flat", "solid with a guess"],
)
def test_exact_pictures_give_the_camera_back(points, guess):
    found = zhang(photographs(POSES, points=points), PointTarget(points), CAMERA.size, guess=guess)
    assert found.converged
    # 1e-6: the residuals end at 1e-10 px or less, and k3, the weakest number, moves by 1e3 of a pixel's error
    np.testing.assert_allclose(found.camera.lens, CAMERA.lens, rtol=1e-6, atol=1e-6)
    for pose, true in zip(found.poses, POSES, strict=True):
        np.testing.assert_allclose(pose.rotation, true.rotation, atol=1e-7)
        np.testing.assert_allclose(pose.translation, true.translation, atol=1e-4)
    assert found.rms < 1e-8


@pytest.mark.parametrize("distortion", [0, 2, 4, 5])
@pytest.mark.parametrize("free_aspect", [True, False])
def test_what_is_not_free_stays(distortion, free_aspect):
    numbers = (-0.2, 0.1, 1e-3, -5e-4, 0.05)
    kept = tuple(k if i < distortion else 0.0 for i, k in enumerate(numbers))
    true = replace(CAMERA, distortion=kept, focal=(1500.0, 1500.0) if not free_aspect else CAMERA.focal)
    seen = photographs(POSES, true, noise=0.05)
    found = zhang(seen, PointTarget(BOARD), CAMERA.size, distortion, free_aspect=free_aspect)
    assert np.all(found.camera.lens[4 + distortion :] == 0)
    assert np.all(found.sigma[4 + distortion :] == 0)
    assert np.all(found.sigma[: 4 + distortion] > 0)
    if not free_aspect:
        assert found.camera.focal[0] == found.camera.focal[1]
    assert np.all(np.abs(found.camera.lens - true.lens) <= 4 * found.sigma)  # 4 sigma: 1 in 16 000 each
    with_centre = zhang(seen, PointTarget(BOARD), CAMERA.size, distortion, guess=true, free_centre=False)
    assert with_centre.camera.centre == true.centre


def test_stated_sigmas_are_those_of_repeats():
    camera = replace(CAMERA, distortion=(-0.2, 0.1, 0.0, 0.0, 0.0))
    poses, points = POSES[:4], BOARD[::2]
    squares, sigma0 = [], []
    for seed in range(60):
        found = zhang(photographs(poses, camera, points, 0.1, seed, sigma=0.1), PointTarget(points), camera.size, 2)
        off, some = (found.camera.lens - camera.lens)[:6], found.covariance[:6, :6]
        squares.append(off @ np.linalg.solve(some, off))
        sigma0.append(found.sigma0)
    # chi-square with 6 degrees: mean 6, variance 12; 4 standard deviations of a mean of 60
    assert abs(np.mean(squares) - 6) < 4 * np.sqrt(12 / 60)
    assert np.mean(sigma0) == pytest.approx(1, abs=0.02)  # each is known to 1/sqrt(2 * 226), the mean 8 times better


def test_agrees_with_opencv():
    seen = photographs(POSES, noise=0.2, sigma=0.2)
    found = zhang(seen, PointTarget(BOARD), CAMERA.size)
    pixels = list(seen.pixels.reshape(len(POSES), -1, 2).astype(np.float32))
    rms, matrix, numbers, _, _, sigma, _, views = cv2.calibrateCameraExtended(
        [BOARD.astype(np.float32)] * len(POSES), pixels, CAMERA.size, None, None
    )
    theirs = Camera.from_matrix(matrix, CAMERA.size, numbers.ravel()[:5])
    # OpenCV stops early and rounds pixels to single precision: a small part of the standard deviation
    np.testing.assert_array_less(np.abs(found.camera.lens - theirs.lens), 0.05 * found.sigma)
    np.testing.assert_allclose(found.sigma, sigma.ravel()[:9], rtol=0.02)
    assert found.rms == pytest.approx(rms, rel=1e-4)
    np.testing.assert_allclose(found.photo_rms, views.ravel(), rtol=1e-3)


def test_zhangs_own_views(real):
    folder = real / "zhang2000"
    model = np.loadtxt(folder / "Model.txt").reshape(-1, 2)
    pixels = [np.loadtxt(folder / f"data{k}.txt").reshape(-1, 2) for k in range(1, 6)]
    count = len(model)
    seen = Observations(
        np.repeat(range(5), count), DIRECT, np.tile(range(count), 5), np.concatenate(pixels), tuple("12345")
    )
    found = zhang(seen, PointTarget(np.column_stack([model, 0 * model[:, 0]])), (640, 480), distortion=2)
    published = [832.5, 832.53, 303.959, 206.585, -0.228601, 0.190353]
    # he also finds a skew of 0.2 px, known to 0.4 px: within half a standard deviation
    assert np.all(np.abs(found.camera.lens[:6] - published) < 0.5 * found.sigma[:6])
    assert found.rms == pytest.approx(0.3369, abs=5e-4)  # OpenCV's, without skew
    first = found.poses[0]
    np.testing.assert_allclose(first.translation, [-3.84019, 3.65164, 12.791], atol=0.03)  # inches, some sigmas
    np.testing.assert_allclose(first.rotation[0], [0.992759, -0.026319, 0.117201], atol=2e-3)


def test_opencvs_left_camera(real):
    pixels, files = [], sorted((real / "opencv_chess_stereo").glob("left[0-9][0-9].jpg"))
    for file in files:
        grey = cv2.imread(str(file), cv2.IMREAD_GRAYSCALE)
        corners = cv2.findChessboardCorners(grey, (9, 6))[1]
        pixels.append(cv2.cornerSubPix(grey, corners, (11, 11), (-1, -1), (3, 30, 0.01)).reshape(-1, 2))
    x, y = np.meshgrid(np.arange(9) * 25.0, np.arange(6) * 25.0)
    points = np.stack([x.ravel(), y.ravel(), 0 * x.ravel()], -1)
    seen = Observations(
        np.repeat(range(13), 54), DIRECT, np.tile(range(54), 13), np.concatenate(pixels), tuple(f.name for f in files)
    )
    found = zhang(seen, PointTarget(points), (640, 480), free_aspect=False)
    # left_intrinsics.yml; its corners were refined otherwise: within half a standard deviation
    published = [535.9157, 535.9157, 342.2832, 235.5708, -0.2663726, -0.0385889, 1.78319e-3, -2.81221e-4, 0.2383915]
    assert np.all(np.abs(found.camera.lens - published) < 0.5 * found.sigma)
    assert found.rms == pytest.approx(0.409, abs=0.003)
    assert any("left02.jpg" in note for note in found.notes)  # a poor photograph
    assert not any("left05.jpg" in note for note in found.notes)


def test_rendered_boards(mitsuba):
    with np.load(mitsuba / "camera_only" / "corners.npz") as truth:
        view, corner, uv, xyz = (truth[k] for k in ("view", "corner_id", "uv", "xyz_cam"))
    points = np.stack([corner[:117] % 13 + 1, corner[:117] // 13 + 1, 0 * corner[:117]], -1) * 20.0
    names = tuple(str(k) for k in range(12))
    exact = zhang(Observations(view, DIRECT, corner, uv, names), PointTarget(points), (1280, 960))
    np.testing.assert_allclose(exact.camera.lens, [2400, 2400, 639.5, 479.5, 0, 0, 0, 0, 0], atol=1e-6)  # round trip
    np.testing.assert_allclose(exact.poses[4] @ points[corner[view == 4]], xyz[view == 4], atol=1e-6)
    noise = 0.05 * np.random.default_rng(0).normal(size=uv.shape)
    found = zhang(Observations(view, DIRECT, corner, uv + noise, names), PointTarget(points), (1280, 960))
    off = found.camera.lens - exact.camera.lens
    assert off @ np.linalg.solve(found.covariance, off) < 27.9  # chi-square with 9 degrees: 1 in 1000
    assert found.sigma0 == pytest.approx(1, abs=0.06)  # 3 standard deviations: 1/sqrt(2 * 2700) each
    assert found.sigma[0] < 0.5  # px of 2400


def test_rows_that_are_not_numbers_are_left_out():
    seen = photographs(POSES, noise=0.05)
    pixels = seen.pixels.copy()
    pixels[3], pixels[seen.photo == 4] = np.nan, np.nan
    spoilt = replace(seen, pixels=pixels)
    found, clean = (zhang(rows, PointTarget(BOARD), CAMERA.size, 2) for rows in (spoilt, seen.select(seen.photo < 4)))
    assert np.isnan(found.residuals[3]).all()
    assert np.isnan(found.residuals[seen.photo == 4]).all()
    assert np.isnan(found.poses[4].rotation).all()
    assert np.isnan(found.photo_rms[4])
    assert any("not numbers" in note for note in found.notes)
    assert any("photograph 4" in note for note in found.notes)
    # one point less of 252 moves them by a part of their standard deviation
    assert np.all(np.abs(found.camera.lens - clean.camera.lens)[:6] < 0.5 * clean.sigma[:6])


@pytest.mark.parametrize(("size", "hint"), [((960, 1280), "swap width and height"), ((640, 480), "at full size")])
def test_pixels_outside_the_picture_are_refused(size, hint):
    with pytest.raises(ShapeError, match=f"picture of {size[0]} x {size[1]} px: x goes from .*{hint}"):
        zhang(photographs(POSES), PointTarget(BOARD), size)


def parallel(tilt_deg):
    """Boards at different places that all have the same normal."""
    tilt = Pose.from_rotation_vector(np.radians((tilt_deg, 0, 0)))
    return [
        Pose((tilt @ Pose.from_rotation_vector((0, 0, 0.3 * k))).rotation, pose.translation)
        for k, pose in enumerate(POSES)
    ]


@pytest.mark.parametrize("tilt_deg", [0.0, 30.0])
@pytest.mark.parametrize("noise", [0.0, 0.05, 0.3])
def test_parallel_boards_do_not_tell_the_focal_length(tilt_deg, noise):
    with pytest.raises(SetupError, match="not determined"):
        zhang(photographs(parallel(tilt_deg), noise=noise), PointTarget(BOARD), CAMERA.size)


@pytest.mark.parametrize("noise", [0.0, 0.05])
def test_one_board_tells_one_focal_length_if_it_is_tilted(noise):
    camera = Camera((1280, 960), 1500.0)
    known = {"distortion": 0, "free_centre": False, "free_aspect": False}
    found = zhang(photographs(POSES[:1], camera, noise=noise), PointTarget(BOARD), camera.size, **known)
    assert abs(found.camera.focal[0] - 1500) <= 4 * found.sigma[0] + 1e-6
    facing = photographs([Pose(np.eye(3), np.array([0, 0, 500.0]))], camera, noise=noise)
    with pytest.raises(SetupError, match="not determined"):
        zhang(facing, PointTarget(BOARD), camera.size, **known)


def test_hardly_tilted_boards_get_a_note():
    poses = [
        Pose.from_rotation_vector(np.radians((3 * (-1) ** k, 3 * (-1) ** (k // 2), 10 * k)), pose.translation)
        for k, pose in enumerate(POSES)
    ]
    found = zhang(photographs(poses, noise=0.2, sigma=0.2), PointTarget(BOARD), CAMERA.size, 2)
    assert any("tilt the board more" in note for note in found.notes)


def test_wrong_calls():
    seen, board = photographs(POSES), PointTarget(BOARD)
    with pytest.raises(SetupError, match="distortion"):
        zhang(seen, board, CAMERA.size, 3)
    with pytest.raises(ShapeError, match="target has 10"):
        zhang(seen, PointTarget(BOARD[:10]), CAMERA.size)
    with pytest.raises(SetupError, match="no observation of view 0"):
        zhang(seen, board, CAMERA.size, view=0)
    with pytest.raises(SetupError, match="4 are asked for"):
        zhang(photographs(POSES[:1]), board, CAMERA.size)
    with pytest.raises(SetupError, match="no photograph shows"):
        zhang(seen.select(seen.point < 3), board, CAMERA.size)
    with pytest.raises(SetupError, match="no photograph shows"):
        zhang(seen.select(seen.point < 9), board, CAMERA.size)  # one row of the board
    with pytest.raises(SetupError, match="guess"):
        zhang(seen, PointTarget(bent(30.0)), CAMERA.size)
    with pytest.raises(SetupError, match="guess is a camera of"):
        zhang(seen, board, (640, 480), guess=CAMERA)
