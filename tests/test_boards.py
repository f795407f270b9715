"""Boards: OpenCV's numbering and pictures, what cannot be printed, and what a turn does not change."""

import subprocess
import sys

import cv2
import numpy as np
import pytest

from cyclopean.errors import SetupError
from cyclopean.targets import Board, PointTarget
from cyclopean.targets.prints import outline


@pytest.mark.parametrize("legacy", [False, True])
@pytest.mark.parametrize("size", [(7, 6), (6, 5)])
def test_a_charuco_board_is_opencvs(size, legacy):
    board = Board("charuco", *size, 20, 14, "5x5_100", legacy=legacy)
    other = cv2.aruco.CharucoBoard(size, 20, 14, cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_5X5_100))
    other.setLegacyPattern(legacy)
    np.testing.assert_allclose(board.points, other.getChessboardCorners(), atol=1e-5)  # OpenCV keeps float32
    np.testing.assert_allclose(board.marker_corners, np.array(other.getObjPoints())[..., :2], atol=1e-5)
    image = board.image(5)
    drawn = other.generateImage(image.shape[::-1], marginSize=50, borderBits=1)
    np.testing.assert_array_equal(image, drawn)  # every edge falls between pixels: 14 mm are 7 modules of 10 px


def test_points_and_pictures_of_the_other_kinds():
    circles = Board("circles", 4, 3, 10)
    np.testing.assert_allclose(circles.points[[0, 3, 4]], [[0, 0, 0], [30, 0, 0], [0, 10, 0]])
    asymmetric = Board("asymmetric_circles", 4, 11, 10)
    np.testing.assert_allclose(asymmetric.points[[0, 1, 4, 5]], [[0, 0, 0], [20, 0, 0], [10, 10, 0], [30, 10, 0]])
    tags = Board("apriltags", 3, 2, 24, 18)
    assert tags.dictionary == "DICT_APRILTAG_36h11"
    np.testing.assert_allclose(tags.points[[0, 2, 4, 12]], [[0, 0, 0], [18, 18, 0], [24, 0, 0], [0, 24, 0]])
    assert not tags.shade([[1, 1], [-3, -3], [21, 21]]).any()  # the border; squares beside a tag
    assert tags.shade([[-3, 5], [21, 5], [-7, -7]]).all()
    for board in (circles, asymmetric):
        left, top, right, bottom = outline(board)
        picture = board.image(4)
        ink = (255.0 - picture).sum() / 255 / 16  # mm²
        # the same area as the circles, but for the 4 x 4 samples of the pixels on their rims
        assert ink == pytest.approx(len(board.points) * np.pi * board.diameter**2 / 4, rel=0.01)
        assert picture.shape == (round(4 * (bottom - top)), round(4 * (right - left)))


def test_a_chessboard_begins_with_black():
    board = Board("chessboard", 6, 5, 10)
    assert len(board.points) == 5 * 4
    image = board.image(1)
    assert image[4:6, 4:6].max(initial=0) == 255  # the margin's corner
    assert image[6, 6] == 0
    assert image[6, 16] == 255


@pytest.mark.parametrize(
    ("board", "count"),
    [
        (Board("chessboard", 8, 7, 10), 1),  # odd + even: half a turn exchanges black and white
        (Board("chessboard", 8, 6, 10), 2),
        (Board("chessboard", 7, 7, 10), 4),
        (Board("chessboard", 8, 8, 10), 2),  # a quarter turn exchanges black and white
        (Board("circles", 6, 5, 10), 2),
        (Board("circles", 5, 5, 10), 4),
        (Board("asymmetric_circles", 4, 11, 10), 1),
        (Board("asymmetric_circles", 4, 10, 10), 2),
        (Board("charuco", 5, 5, 10, 7, "DICT_4X4_50"), 1),
    ],
)
def test_symmetries_turn_the_print_onto_itself(board, count):
    assert len(board.symmetries) == count
    left, top, right, bottom = outline(board)
    rng = np.random.default_rng(3)
    xy = rng.uniform([left, top], [right, bottom], (500, 2))
    points = board.points[:, :2]
    for numbers in board.symmetries:
        # the rigid motion that carries each point to the point whose number it takes
        mean, goal = points.mean(0), points[numbers].mean(0)
        u, _, v = np.linalg.svd((points - mean).T @ (points[numbers] - goal))
        turned = (xy - mean) @ (u @ v) + goal
        np.testing.assert_allclose((points - mean) @ (u @ v) + goal, points[numbers], atol=1e-9)
        np.testing.assert_array_equal(board.shade(turned), board.shade(xy))


@pytest.mark.parametrize(
    ("wrong", "said"),
    [
        (dict(kind="charuko"), "did you mean 'charuco'"),
        (dict(kind="charuco", marker=25.0, dictionary="DICT_4X4_50"), "exchanged"),
        (dict(kind="charuco", marker=15.0, dictionary="DICT_5X5_25"), "DICT_5X5_250"),
        (dict(kind="charuco", marker=15.0), "needs the dictionary"),
        (dict(kind="charuco", dictionary="DICT_4X4_50"), "needs marker"),
        (dict(kind="charuco", columns=20, rows=20, marker=15.0, dictionary="DICT_4X4_50"), "needs 200 markers"),
        (dict(kind="chessboard", rows=1), "not inner corners"),
        (dict(kind="chessboard", marker=15.0), "no markers"),
        (dict(kind="chessboard", dictionary="DICT_4X4_50"), "leave dictionary out"),
        (dict(kind="chessboard", legacy=True), "legacy"),
        (dict(kind="circles", columns=2.5), "whole number"),
        (dict(kind="circles", square=-1.0), "positive"),
        (dict(kind="circles", square=np.nan), "positive"),
    ],
)
def test_boards_that_cannot_be_are_refused(wrong, said):
    with pytest.raises(SetupError, match=said):
        Board(**(dict(columns=7, rows=5, square=20.0) | wrong))


def test_a_picture_needs_a_sensible_scale():
    board = Board("chessboard", 6, 5, 10)
    for scale in (0, np.inf, 1e6):
        with pytest.raises(SetupError):
            board.image(scale)


def test_a_point_target_is_checked():
    assert PointTarget([[0, 0, 0], [1, 2, 3]]).points.shape == (2, 3)
    for points in (np.zeros((0, 3)), [[0, 0, np.nan]], np.zeros((2, 2, 3))):
        with pytest.raises(SetupError):
            PointTarget(points)


def test_importing_targets_leaves_opencv_for_later():
    show = "import sys, cyclopean.targets; print(*sys.modules)"
    loaded = subprocess.run([sys.executable, "-c", show], capture_output=True, text=True, check=True).stdout.split()
    assert not {"cv2", "scipy", "numba"} & set(loaded)
