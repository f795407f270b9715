"""Corners from the whole print around them: photographs computed by brute force, and the renderer's."""

import json
from dataclasses import replace

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter
from scipy.stats import norm, qmc

from benchmarks.data import renderer_setup
from cyclopean import Camera, Mirror, Mirrors, Prism, Setup
from cyclopean.calibration.photometric import align, refine
from cyclopean.calibration.photometric_picture import Drawing, draw, predict_picture
from cyclopean.errors import CyclopeanError, ImageError, SetupError, ShapeError
from cyclopean.geometry import Pose
from cyclopean.targets import Observations
from cyclopean.targets.boards import Board

BOARD = Board("charuco", 9, 7, 16.0, 12.0, "DICT_4X4_50")
SETUP = Setup(Camera((400, 300), 800), Prism(2, 12.0, 1.5168, 60.0))
POSE = Pose.from_rotation_vector([0.2, -0.3, 0.1], [-65.0, -50.0, 480.0])
BLUR = 0.5  # px


def offsets(count=128):
    """Places (count, 2) px spread as a Gaussian lens and a square pixel spread light, each with its opposite."""
    quantiles = np.linspace(-4, 4, 4001)
    share = np.cumsum(norm.cdf((quantiles + 0.5) / BLUR) - norm.cdf((quantiles - 0.5) / BLUR))
    points = np.interp(qmc.Sobol(2, scramble=True, rng=3).random(count // 2), share / share[-1], quantiles)
    return np.concatenate([points, -points])


def photograph(setup, board, pose, gain=180.0, offset=30.0):
    """Grey values (H, W) float: every pixel averages the print at many places around it."""
    width, height = setup.camera.size
    image = np.full((height, width), offset)
    for view in setup.rig():
        row, column = np.nonzero(view.region.traced)
        pixels = np.stack([column, row], -1).astype(float)

        def on_board(at, view=view):
            rays = view.unbounded().rays(at)
            start, along = pose.inverse @ rays.origins, rays.directions @ pose.rotation
            return (start - along * (start[:, 2:] / along[:, 2:]))[:, :2]

        place = on_board(pixels)
        step = [on_board(pixels + half) - on_board(pixels - half) for half in ((0.5, 0), (0, 0.5))]
        total = np.zeros(len(pixels))
        for x, y in offsets():
            total += board.shade(place + x * step[0] + y * step[1])
        image[row, column] = offset + gain * total / len(offsets())
    return image


def truth(setup, board, pose, noise=0.05, seed=2):
    """Where all views show the board's points, with noise as a detector's; and without."""
    pixels = setup.rig(margin=12).project(pose @ board.points)
    point, view = np.nonzero(np.isfinite(pixels[..., 0]))
    masks = setup.rig(margin=12).masks
    column, row = np.rint(pixels[point, view]).astype(int).T
    clear = masks[view, row, column]
    exact = Observations(np.zeros(clear.sum(), int), view[clear], point[clear], pixels[point, view][clear], ("one",))
    return replace(exact, pixels=exact.pixels + np.random.default_rng(seed).normal(0, noise, exact.pixels.shape)), exact


def errors(found, exact):
    """Found minus true pixels of the corners in both (N, 2), and their stated standard deviations (N,)."""
    rows = {key: k for k, key in enumerate(zip(exact.photo, exact.view, exact.point, strict=True))}
    where = np.array([rows.get(key, -1) for key in zip(found.photo, found.view, found.point, strict=True)])
    return (found.pixels - exact.pixels[where])[where >= 0], found.sigma[where >= 0]


def rms(values):
    return float(np.sqrt(np.mean(np.square(values))))


@pytest.fixture(scope="module")
def scene():
    """A photograph, the corners that a detector finds, and the true ones."""
    return photograph(SETUP, BOARD, POSE), *truth(SETUP, BOARD, POSE)


def test_the_drawing_has_the_shades_of_the_board():
    drawing = draw(BOARD)
    places = np.random.default_rng(0).uniform(0, [144, 112], (5000, 2))
    column = np.searchsorted(drawing.x, places[:, 0]) - 1
    row = np.searchsorted(drawing.y, places[:, 1]) - 1
    np.testing.assert_array_equal(drawing.cells[row, column], BOARD.shade(places))


def test_a_printed_image_draws_what_was_drawn():
    drawing = draw(BOARD)  # lines at multiples of 2 mm: the gaps and the modules of a marker are 2 mm wide
    places = 2 * np.arange(72) + 1.0
    image = BOARD.shade(np.stack(np.meshgrid(places, places[:56]), -1)) * 200 + 20
    again = Drawing.from_image(image, 144.0, 112.0)
    cell = (np.searchsorted(drawing.y, places[:56]) - 1, np.searchsorted(drawing.x, places) - 1)
    other = (np.searchsorted(again.y, places[:56]) - 1, np.searchsorted(again.x, places) - 1)
    np.testing.assert_array_equal(again.cells[np.ix_(*other)], drawing.cells[np.ix_(*cell)])


def test_the_expected_picture_is_the_average_of_the_print(scene):
    picture = (scene[0] - 30) / 180
    for view in SETUP.rig():
        wanted = view.region.mask
        expected = predict_picture(view.unbounded(), POSE, draw(BOARD), (0, 0), wanted, BLUR)
        inside = wanted & (expected.board > 4).all(0) & (expected.board[0] < 140) & (expected.board[1] < 108)
        miss = (expected.values - picture)[inside]
        # 128 places say the share of black and white to about a hundredth, at the pixels that have an edge
        assert rms(miss) < 0.01
        assert abs(miss.mean()) < 1e-3


def test_slopes_are_differences_of_shifted_pictures():
    view = SETUP.rig()[0]
    given = (view.unbounded(), POSE, draw(BOARD), (0, 0), view.region.mask, BLUR)
    step = 1e-2
    for axis in range(2):
        moves = (sign * step * np.eye(2)[axis] for sign in (-1, 1))
        ahead, back = (predict_picture(*given, lambda at, m=move: np.broadcast_to(m, at.shape)) for move in moves)
        slope = (ahead.values - back.values) / (2 * step)
        # 1e-3 of about 1 per px: float32 values differ by roundings of 1e-7 / 1e-2, curvature by 1e-4
        np.testing.assert_allclose(predict_picture(*given).slopes[axis], slope, atol=2e-3)


def test_corners_are_found_to_a_hundredth_of_a_pixel(scene):
    image, given, exact = scene
    found = refine([image], given, BOARD, SETUP, [POSE])
    miss, sigma = errors(found.observations, exact)
    assert len(miss) > 0.9 * len(given)
    assert rms(errors(given, exact)[0]) > 0.04
    assert rms(miss) < 0.01  # px: windows of 16 px hold 40 px of edges, each known to 0.01 px from 128 places
    assert 0.5 < rms(miss / sigma[:, None]) < 1.6  # some 80 corners, whose errors are not Gaussian
    assert abs(found.blur[0] - BLUR) < 0.1
    assert np.median(found.likeness) > 0.99


def test_a_wrong_calibration_does_not_pull(scene):
    image, given, _ = scene
    right = refine([image], given, BOARD, SETUP, [POSE]).observations
    wrong = replace(SETUP, optic=replace(SETUP.optic, glass=1.50, distance=62.0))
    off = np.linalg.norm(wrong.rig().unbounded()[0].project(POSE @ BOARD.points) - SETUP.rig().unbounded()[0].project(
        POSE @ BOARD.points), axis=-1)  # fmt: skip
    assert off.min() > 1  # px: the calibration is indeed wrong
    moved = refine([image], given, BOARD, wrong, [POSE]).observations
    miss, _ = errors(moved, right)
    assert len(miss) == len(right)
    assert np.abs(miss).max() < 0.005  # px, a tenth of a detector's noise


def test_a_larger_window_lowers_the_noise(scene):
    image, given, exact = scene
    noisy = image + np.random.default_rng(1).normal(0, 4, image.shape)
    found = {w: refine([noisy], given, BOARD, SETUP, [POSE], window=w).observations for w in (0.6, 1.0, 2.0)}
    noise = {w: rms(errors(observations, exact)[0]) for w, observations in found.items()}
    assert noise[2.0] < noise[1.0] < noise[0.6] < 0.1


@pytest.mark.parametrize("kind", ["16 bit", "colour", "gamma", "shaded", "saturated", "float"])
def test_the_photograph_may_be_of_any_kind(kind, scene):
    image, given, exact = scene
    x = np.linspace(-1, 1, image.shape[1])
    changed = {
        "16 bit": lambda: (image * 250).astype(np.uint16),
        "colour": lambda: np.stack([image * 0.5, image, image * 0.8], -1).astype(np.uint8),
        "gamma": lambda: (255 * (image / 255) ** (1 / 2.2)).astype(np.uint8),
        "shaded": lambda: (image * (1 + 0.2 * x)).astype(np.float32),
        "saturated": lambda: np.clip(image * 1.4, 0, 255).astype(np.uint8),
        "float": lambda: (image / 255).astype(np.float32),
    }[kind]()
    miss, _ = errors(refine([changed], given, BOARD, SETUP, [POSE]).observations, exact)
    assert len(miss) > 0.9 * len(given)
    # px: as above, twice that where pixels at the top of the range say nothing or edges are no longer symmetric
    assert rms(miss) < (0.02 if kind in ("gamma", "saturated") else 0.01)


def test_mirrored_views():
    camera = Camera((400, 300), 800)
    mirrors = Mirrors((Mirror((0.0, 2.0, 62.0), (0.0, -1.0, 0.0), (120.0, 120.0)),), ((0,),), direct=True)
    setup = Setup(camera, mirrors)
    assert any(view.mirrored for view in setup.rig())
    pose = Pose.from_rotation_vector([0.03, 0.1, 0.0], [-70.0, -115.0, 640.0])
    image = photograph(setup, BOARD, pose)
    given, exact = truth(setup, BOARD, pose)
    found = refine([image], given, BOARD, setup, [pose]).observations
    assert len(np.unique(found.view)) == 2
    miss, _ = errors(found, exact)
    assert len(miss) > 0.8 * len(given)
    assert rms(miss) < 0.01  # px, as through the prism


def test_corners_that_the_detector_missed_are_added_and_wrong_ones_left_out(scene):
    image, given, exact = scene
    some = np.arange(len(given)) % 2 == 0
    pixels = given.pixels.copy()
    pixels[::10] += 4.0  # found at the wrong place
    found = refine([image], replace(given, pixels=pixels).select(some), BOARD, SETUP, [POSE])
    assert found.added > 0.3 * len(given)
    assert rms(errors(found.observations, exact)[0]) < 0.01
    kept = refine([image], given.select(some), BOARD, SETUP, [POSE], complete=False)
    assert kept.added == 0
    assert len(kept.observations) + kept.lost == some.sum()
    spoilt = image.copy()
    x, y = np.rint(exact.pixels[5]).astype(int)
    spoilt[y - 12 : y + 13, x - 12 : x + 13] = 120.0  # something lies on the board
    after = refine([spoilt], given, BOARD, SETUP, [POSE])
    assert after.lost > 0
    assert after.notes
    keys = set(zip(after.observations.view, after.observations.point, strict=True))
    assert (exact.view[5], exact.point[5]) not in keys


def test_the_pose_of_the_whole_board(scene):
    image, _, _ = scene
    start = Pose.from_rotation_vector([0.005, -0.005, 0.005]) @ POSE
    start = Pose(start.rotation, start.translation + np.array([0.5, -0.5, 2.0]))
    found = align(image, BOARD, SETUP, start)
    assert found.converged
    miss = found.pose.translation - POSE.translation
    sigma = np.sqrt(np.diag(found.covariance))[3:]
    assert (np.abs(miss) < 4 * sigma + 1e-4).all()  # four standard deviations
    depth = (found.pose @ BOARD.points)[:, 2] - (POSE @ BOARD.points)[:, 2]
    assert rms(depth) < 0.1  # mm of 480: 0.01 px of 800 px at a baseline of some 10 mm, over 40 corners a view
    assert found.rms < 0.01


@pytest.mark.parametrize("kind", ["black", "noise", "texture", "another board", "far off"])
def test_no_board_no_pose(kind, scene):
    image, start = scene[0], POSE
    rng = np.random.default_rng(4)
    picture = {
        "black": lambda: np.zeros((300, 400), np.uint8),
        "noise": lambda: rng.uniform(0, 255, (300, 400)),
        "texture": lambda: 128 + 600 * gaussian_filter(rng.normal(size=(300, 400)), 3),
        "another board": lambda: photograph(SETUP, Board("chessboard", 9, 7, 13.0), POSE),
        "far off": lambda: image,
    }[kind]()
    if kind == "far off":
        start = Pose(POSE.rotation, POSE.translation + np.array([8.0, 0.0, 0.0]))  # half a square: black on white
    found = align(picture, BOARD, SETUP, start)
    assert not found.converged
    assert np.isnan(found.pose.translation).all()
    assert "corners" in found.message


def test_wrong_calls_are_explained(scene):
    image, given, _ = scene
    with pytest.raises(ImageError, match="400 x 300"):
        refine([image[:-1]], given, BOARD, SETUP, [POSE])
    with pytest.raises(ShapeError, match="one photograph and one pose"):
        refine([], given, BOARD, SETUP, [POSE])
    with pytest.raises(ShapeError, match="window"):
        refine([image], given, BOARD, SETUP, [POSE], window=0.0)
    with pytest.raises(SetupError, match="chessboards"):
        refine([image], given, Board("circles", 9, 7, 16.0), SETUP, [POSE])
    with pytest.raises(CyclopeanError, match="right board"):
        refine([image], given, Board("chessboard", 4, 4, 16.0), SETUP, [POSE])
    with pytest.raises(CyclopeanError, match="not a number"):
        align(image, BOARD, SETUP, Pose(np.eye(3), np.full(3, np.nan)))
    with pytest.raises(ShapeError, match="grey"):
        Drawing.from_image(np.zeros((3, 3, 3)), 1.0, 1.0)


@pytest.mark.parametrize(("name", "limit"), [("calib_t3_b40", 0.006), ("targets_t3_b40", 0.02), ("calib_n3", 0.006)])
def test_corners_of_rendered_photographs(name, limit, mitsuba):
    import cv2

    facts = json.loads((mitsuba / name / "views.json").read_text())
    b, shot = facts["board"], facts["views"][4]
    board = Board("charuco", b["squares_x"], b["squares_y"], b["square"], b["marker"], b["dictionary"])
    pose = Pose(np.array(shot["R_cam_board"]), np.array(shot["t_cam_board"]))
    setup = renderer_setup(name.split("_", 1)[1])
    image = cv2.imread(str(mitsuba / name / shot["file"]), cv2.IMREAD_GRAYSCALE)
    given, exact = truth(setup, board, pose, 0.046)
    found = refine([image], given, board, setup, [pose])
    miss, sigma = errors(found.observations, exact)
    assert len(miss) > 0.9 * len(given)
    # px: a few thousandths from the 16 samples of a pixel; where all edges run along rows and columns, a
    # hundredth, as every pixel of an edge then errs alike
    assert rms(miss) < limit
    assert 0.5 < rms(miss / sigma[:, None]) < 2  # what is claimed is so
