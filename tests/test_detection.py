"""Boards in photographs: the renderer's true corners, drawn boards under known homographies, and wrong boards."""

import json
from dataclasses import replace
from functools import lru_cache

import cv2
import numpy as np
import pytest
from scipy.special import ndtr

from benchmarks.data import renderer_setup
from cyclopean.errors import ImageError, ShapeError
from cyclopean.targets import DIRECT, Board, curvature, find_board, observe
from cyclopean.targets.agreement import agree
from cyclopean.targets.corners import Surroundings, fit_corners
from cyclopean.targets.prints import outline

CHARUCO = Board("charuco", 7, 6, 20, 15, "DICT_4X4_50")
SIZE = (480, 400)  # px, of drawn photographs
BOARDS = [
    (CHARUCO, 2.2),
    (CHARUCO, 0.8),  # squares of 16 px: markers lie 2 px from the edges
    (Board("charuco", 8, 6, 20, 15, "DICT_4X4_50", legacy=True), 2.0),
    (Board("chessboard", 9, 6, 20), 2.0),
    (Board("chessboard", 9, 6, 20), 0.45),  # squares of 9 px
    (Board("chessboard", 7, 7, 20), 2.0),
    (Board("circles", 7, 6, 20), 2.0),
    (Board("asymmetric_circles", 4, 11, 20), 1.5),
    (Board("apriltags", 6, 5, 24, 18), 2.4),
    (Board("apriltags", 5, 4, 24, 18), 1.5),
]


def homography(board, scale, turn_deg=10.0, shift=(0.0, 0.0)):
    """Picture from board, somewhat tilted; the board's centre in the picture's."""
    left, top, right, bottom = outline(board)
    turn = np.deg2rad(turn_deg)
    view = [[np.cos(turn), -np.sin(turn), 0], [np.sin(turn), np.cos(turn), 0], [2e-4, -1e-4, 1 / scale]]
    centre = [[1, 0, -(left + right) / 2], [0, 1, -(top + bottom) / 2], [0, 0, 1]]
    place = [[1, 0, SIZE[0] / 2 + shift[0]], [0, 1, SIZE[1] / 2 + shift[1]], [0, 0, 1]]
    return np.array(place) @ view @ centre


def mapped(h, xy):
    q = np.c_[xy, np.ones(len(xy))] @ h.T
    return q[:, :2] / q[:, 2:]


def unbent(pixels, bend):
    """Where pixels would be if a quadratic map did not bend the picture."""
    return pixels + bend * (pixels - np.array(SIZE) / 2)[..., ::-1] ** 2


def draw(board, h, blur=0.6, over=3, bend=0.0):
    """The board under a homography, on grey: averaged over 3 x 3 samples a pixel, blurred, 8 bits."""
    x, y = (((np.arange(n * over) + 0.5) / over) - 0.5 for n in SIZE)
    straight = unbent(np.stack(np.meshgrid(x, y), axis=-1), bend)
    q = np.concatenate([straight, np.ones((len(y), len(x), 1))], axis=-1) @ np.linalg.inv(h).T
    xy = q[..., :2] / q[..., 2:]
    left, top, right, bottom = outline(board)
    printed = ((xy >= [left, top]) & (xy <= [right, bottom])).all(-1)
    shade = np.where(printed, np.where(board.shade(xy), 210.0, 25.0), 90.0)
    shade = shade.reshape(SIZE[1], over, SIZE[0], over).mean((1, 3))
    return np.clip(np.rint(cv2.GaussianBlur(shade, (0, 0), blur)), 0, 255).astype(np.uint8)


@lru_cache
def photograph(board, scale):
    h = homography(board, scale)
    return h, draw(board, h)


def error(one, board, h):
    """Errors (N, 2) px under the numbering, of those the print cannot tell apart, that fits best."""
    truth = mapped(h, board.points[:, :2])
    return min((one.pixels - truth[numbers[one.points]] for numbers in board.symmetries), key=np.linalg.norm)


@pytest.mark.parametrize(("board", "scale"), BOARDS, ids=lambda value: str(value)[:24])
@pytest.mark.parametrize("mirrored", [False, True])
def test_every_kind_of_board_is_found_whole(board, scale, mirrored):
    h, image = photograph(board, scale)
    (one,) = find_board(image[:, ::-1] if mirrored else image, board, mirrored=[mirrored])
    assert (one.view, one.mirrored, one.note) == (DIRECT, mirrored, "")
    np.testing.assert_array_equal(np.sort(one.points), np.arange(len(board.points)))
    if mirrored:
        one = replace(one, pixels=one.pixels * [-1, 1] + [SIZE[0] - 1, 0])
    # 0.02: the 9 samples of a pixel shift an edge by up to 1/6 px; tens of pixels share that
    assert np.sqrt((error(one, board, h) ** 2).mean()) < 0.02


@pytest.mark.parametrize("kind", ["charuco", "apriltags"])
def test_markers_tell_by_themselves_whether_a_view_is_mirrored(kind):
    board = next(board for board, _ in BOARDS if board.kind == kind)
    _, image = photograph(board, BOARDS[0][1] if kind == "charuco" else 2.4)
    assert not find_board(image, board)[0].mirrored
    assert find_board(image[:, ::-1], board)[0].mirrored
    said = find_board(image[:, ::-1], board, mirrored=[False])[0]
    assert not len(said.points)
    assert "not mirrored, but the board can only be read as mirrored" in said.note


def test_a_board_turned_upside_down_keeps_kalibrs_numbers():
    # Kalibr prints its tags from the bottom row up: y points up, so the picture is a reflection of the numbering
    board = Board("apriltags", 4, 3, 24, 18)
    tags = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_APRILTAG_36h11)
    image = np.full((400, 480), 255, np.uint8)
    for number in range(12):
        left, top = 40 + 96 * (number % 4), 300 - 96 * (number // 4)
        image[top : top + 72, left : left + 72] = tags.generateImageMarker(number, 72)
    (one,) = find_board(cv2.GaussianBlur(image, (0, 0), 0.7), board)
    assert len(one.points) == 48
    # pixel edges lie half a pixel before pixel centres; these tags stand free, without squares between them
    truth = [39.5, 371.5] + board.points[one.points, :2] * [4, -4]
    np.testing.assert_allclose(one.pixels, truth, atol=0.02)  # edges along the pixel grid are the least favourable


def test_a_cut_charuco_board_gives_every_corner_that_can_be_seen():
    h = homography(CHARUCO, 2.6)
    image = draw(CHARUCO, h)
    x, y = np.meshgrid(np.arange(SIZE[0]), np.arange(SIZE[1]))
    seam = 0.8 * (x - 240) + 0.6 * (y - 200)  # px from a slanted line
    masks = np.stack([seam < -2, seam > 2])
    found = find_board(image, CHARUCO, masks)
    truth = mapped(h, CHARUCO.points[:, :2])
    for view, one in enumerate(found):
        clear = (truth - [240, 200]) @ [0.8, 0.6] * (-1, 1)[view] > 8
        assert set(np.flatnonzero(clear)) <= set(one.points)
        assert np.abs(one.pixels - truth[one.points]).max() < 0.06
        assert masks[view][tuple(np.rint(one.pixels[:, ::-1]).astype(int).T)].all()


def test_corners_hidden_by_a_hand_are_not_made_up():
    h, image = photograph(CHARUCO, 2.2)
    image, rng = image.copy(), np.random.default_rng(4)
    hand = np.s_[120:260, 150:300]
    image[hand] = cv2.GaussianBlur(rng.uniform(0, 255, image[hand].shape), (0, 0), 3).astype(np.uint8)
    (one,) = find_board(image, CHARUCO)
    truth = mapped(h, CHARUCO.points[:, :2])
    assert np.abs(one.pixels - truth[one.points]).max() < 0.06
    hidden = ((truth > [152, 122]) & (truth < [298, 258])).all(-1)
    assert hidden.sum() > 5
    assert not set(np.flatnonzero(hidden)) & set(one.points)
    assert len(one.points) > 0.7 * (~hidden).sum()


@pytest.mark.parametrize(
    ("board", "scale"),
    [BOARDS[0], (CHARUCO, 1.1), BOARDS[3], BOARDS[6]],
    ids=["charuco", "small charuco", "chessboard", "circles"],
)
def test_curved_grid_lines_do_not_shift_points(board, scale, monkeypatch):
    bend = 3e-4  # 1/px: lines leave their tangents by bend length², 0.036 px at the end of a window
    h = homography(board, scale, turn_deg=20)
    truth = straight = mapped(h, board.points[:, :2])
    for _ in range(30):
        truth = truth + straight - unbent(truth, bend)
    image = draw(board, h, bend=bend)

    def shift():
        (one,) = find_board(image, board)
        assert len(one.points) == len(board.points)
        means = [(one.pixels - truth[numbers[one.points]]).mean(0) for numbers in board.symmetries]
        return min(map(np.linalg.norm, means))

    # 0.003: points scatter by 0.005 to 0.01 px since pixels are samples, so the mean of 30 by 0.001 to 0.002 px
    assert shift() < 0.003
    monkeypatch.setattr(curvature, "_FEWEST", np.inf)
    # two straight edges each miss by a third of the 0.036 px, where markers leave them their whole length;
    # discs of 10 px radius are shifted alike
    assert 0.012 < shift() < 0.024


def test_second_derivatives_of_the_map_from_board_to_picture():
    board, bend, step = BOARDS[3][0], 1e-4, 1e-3
    h, xy = homography(board, 2.0), board.points[:, :2]
    first, second = curvature.second_order(xy, unbent(mapped(h, xy), bend))

    def slopes(at):  # of the map itself, by central differences
        ahead, behind = ([unbent(mapped(h, at + sign * one), bend) for one in step * np.eye(2)] for sign in (1, -1))
        return (np.stack(ahead, axis=-1) - np.stack(behind, axis=-1)) / (2 * step)

    along_x, along_y = ((slopes(xy + one) - slopes(xy - one)) / (2 * step) for one in step * np.eye(2))
    true = np.stack([along_x[..., 0], along_x[..., 1], along_y[..., 1]], axis=1)
    # what is left is the fourth order of bend and perspective together, which a homography and a cubic have not
    np.testing.assert_allclose(first, slopes(xy), atol=1e-3)
    assert np.abs(second - true).max() < 0.02 * np.abs(true).max()


def test_a_board_whose_y_points_up_is_fitted_alike_on_curved_lines():
    board = BOARDS[0][0]
    h = homography(board, 2.2)
    image, xy = draw(board, h, bend=3e-4), board.points[:, :2]
    (one,) = find_board(image, board)
    first, second = curvature.second_order(xy, one.pixels)
    around = board.surroundings
    up = Surroundings(
        *(a[:, [2, 3, 0, 1]] for a in (around.white, around.marked)), around.extent, around.gap, around.clear
    )
    down = fit_corners(image, image >= 0, one.pixels, first, around, second)
    turned = fit_corners(image, image >= 0, one.pixels, first * [1, -1], up, second * [[1], [-1], [1]])
    np.testing.assert_allclose(turned.pixels, down.pixels, atol=1e-9)  # the same sums in another frame


@pytest.mark.parametrize("noise", [2.0, 8.0])
def test_the_standard_deviation_is_honest(noise):
    rng = np.random.default_rng(6)
    board, scaled = Board("chessboard", 9, 7, 20), []
    h = homography(board, 1.7, turn_deg=20)
    clean = draw(board, h, blur=1.0).astype(float)
    for _ in range(4):
        (one,) = find_board(np.clip(clean + rng.normal(0, noise, clean.shape), 0, 255), board)
        assert len(one.points) > 45
        scaled.append(error(one, board, h) / one.sigma[:, None])
    # 1 in the mean; 384 values leave 4 %, the rest is what Gauss-Newton's linearisation may cost
    assert np.sqrt((np.concatenate(scaled) ** 2).mean()) == pytest.approx(1, abs=0.2)


def test_the_compiled_fit_finds_the_least_squares_of_the_plain_model():
    rng = np.random.default_rng(8)
    x, y = np.meshgrid(np.arange(41.0), np.arange(41.0))
    white = np.array([[False, True, True, False]])
    for _ in range(5):
        corner, blur = rng.uniform(19, 21, 2), rng.uniform(0.6, 1.5)
        a, b = rng.uniform(-0.3, 0.3), np.pi / 2 + rng.uniform(-0.3, 0.3)  # directions of the edges' normals
        first, second = (ndtr(((x - corner[0]) * np.cos(t) + (y - corner[1]) * np.sin(t)) / blur) for t in (a, b))
        cover = first * (1 - second) + (1 - first) * second
        image = 30 + cover * (150 + 0.8 * (x - 20) - 0.5 * (y - 20))
        jacobian = np.linalg.inv([[np.cos(a), np.sin(a)], [np.cos(b), np.sin(b)]])
        around = Surroundings(white, np.zeros((1, 4), bool), 9.0)
        fits = fit_corners(image, np.ones(image.shape, bool), corner[None] + 0.7, jacobian[None], around)
        np.testing.assert_allclose(fits.pixels[0], corner, atol=1e-4)  # steps end below 2e-4
        assert fits.blur[0] == pytest.approx(blur, rel=1e-3)
        assert fits.explained[0] > 1 - 1e-4
        swapped = fit_corners(255 - image, np.ones(image.shape, bool), corner[None], jacobian[None], around)
        assert swapped.contrast[0] < 0
        outside = np.ones(image.shape, bool)
        outside[:, 20:] = False  # a seam through the innermost pixels
        assert np.isnan(fit_corners(image, outside, corner[None], jacobian[None], around).pixels).all()


@pytest.mark.parametrize(
    ("name", "view"),
    [("calib_n3", 0), ("calib_n5", 2), ("targets_t4_b45", 4), ("calib_n2_flip", 1), ("camera_only", 3)],
)
def test_rendered_corners_are_found_and_placed(mitsuba, name, view):
    """All true corners at least 10 px from seams and the image's border, to hundredths of a pixel, and no other."""
    said = json.loads((mitsuba / name / "views.json").read_text())
    drawn, truth = said["board"], np.load(mitsuba / name / "corners.npz")
    board = Board("charuco", *(drawn[k] for k in ("squares_x", "squares_y", "square", "marker", "dictionary")))
    masks, facets = None, np.full((960, 1280), DIRECT)
    if said["rig"]:
        masks = renderer_setup(said["rig"]).rig().masks
        facets = np.load(mitsuba / "rigs" / f"{said['rig']}_facets.npz")["facet"]
    image = cv2.imread(str(mitsuba / name / f"view_{view:02d}.png"), cv2.IMREAD_GRAYSCALE)
    wanted, got, scaled = 0, 0, []
    for one in find_board(image, board, masks):
        assert one.note == ""
        rows = (truth["view"] == view) & (truth["facet"] == one.view)
        uv = dict(zip(truth["corner_id"][rows].tolist(), truth["uv"][rows]))
        inside = np.pad((facets == one.view).astype(np.uint8), 1)
        room = cv2.distanceTransform(inside, cv2.DIST_L2, cv2.DIST_MASK_PRECISE)[1:-1, 1:-1]
        clear = {number for number, (x, y) in uv.items() if room[round(y.clip(0, 959)), round(x.clip(0, 1279))] > 10}
        wanted, got = wanted + len(clear), got + len(clear & set(one.points.tolist()))
        assert set(one.points.tolist()) <= set(uv)
        errors = one.pixels - [uv[number] for number in one.points.tolist()]
        assert np.abs(errors).max() < 0.1
        scaled.append(np.column_stack([errors, errors / one.sigma[:, None]]))
    assert wanted >= 100
    assert got >= 0.98 * wanted
    rms = np.sqrt((np.concatenate(scaled) ** 2).mean(0))
    assert rms[:2].max() < 0.02  # 16 samples a pixel, along sharp edges
    assert 0.5 < rms[2:].mean() < 2  # the standard deviations say so


def test_observations_of_many_photographs(mitsuba):
    board = Board("charuco", 14, 10, 20, 15, "DICT_5X5_250")
    masks = renderer_setup("n3").rig().masks
    photographs = [(f"{k}", cv2.imread(str(mitsuba / "calib_n3" / f"view_0{k}.png"))[..., ::-1]) for k in (0, 1)]
    covered = photographs[0][1].copy()
    covered[masks[1]] = 0
    photographs += [("covered", covered), ("nothing", np.full((960, 1280), 90, np.uint8))]
    ticks = []
    seen, notes = observe(photographs, board, masks, progress=lambda *tick: ticks.append(tick))
    assert ticks == [(k, 4) for k in range(1, 5)]
    assert seen.photos == ("0", "1", "covered", "nothing")
    assert {(p, v) for p, v in zip(seen.photo, seen.view)} == {
        (0, 0),
        (0, 1),
        (0, 2),
        (1, 0),
        (1, 1),
        (1, 2),
        (2, 0),
        (2, 2),
    }
    assert len(notes) == 2
    assert notes[0].startswith("covered, view 1: the view shows nothing")
    assert notes[1].startswith("nothing: no view shows the board")
    first = seen.select((seen.photo == 0) & (seen.view != 1))
    again = seen.select(seen.photo == 2)
    np.testing.assert_allclose(first.pixels, again.pixels, atol=1e-9)


@pytest.mark.parametrize("dtype", [np.uint16, np.float32])
def test_depth_and_colour_of_the_picture_do_not_matter(dtype):
    _, image = photograph(CHARUCO, 2.2)
    (plain,) = find_board(image, CHARUCO)
    scaled = (image.astype(float) * (16 if dtype == np.uint16 else 1 / 255)).astype(dtype)
    (one,) = find_board(np.repeat(scaled[..., None], 3, axis=-1), CHARUCO)
    np.testing.assert_array_equal(one.points, plain.points)
    np.testing.assert_allclose(one.pixels, plain.pixels, atol=1e-3)  # only the decoder's start differs


def test_numbers_agree_between_views_of_a_board_that_looks_the_same_when_turned():
    board = Board("circles", 6, 5, 20)
    narrow = [homography(board, 1.4, turn, (place, 0)) for turn, place in ((170.0, -120), (-175.0, 120))]
    pictures = [draw(board, h) for h in narrow]
    image = np.concatenate([pictures[0][:, :240], pictures[1][:, 240:]], axis=1)
    masks = np.zeros((2, *image.shape), bool)
    masks[0, :, :239], masks[1, :, 241:] = True, True
    left, right = find_board(image, board, masks)
    assert len(left.points) == len(right.points) == 30
    slope = np.linalg.lstsq(np.c_[left.pixels, np.ones(30)], right.pixels, rcond=None)[0][:2]
    np.testing.assert_allclose(slope, np.eye(2), atol=0.35)  # 15 degrees apart, not 165


def test_a_view_that_contradicts_the_others_is_named():
    (one,) = find_board(photograph(CHARUCO, 2.2)[1], CHARUCO)
    views = [replace(one, view=view) for view in range(3)]
    shuffled = replace(views[0], points=np.random.default_rng(1).permutation(one.points))
    odd, *rest = agree([shuffled, *views[1:]], CHARUCO)
    assert not len(odd.points)
    assert "contradicts" in odd.note
    assert all(len(view.points) == len(one.points) and not view.note for view in rest)


@pytest.mark.parametrize(
    ("stated", "said"),
    [
        (replace(CHARUCO, columns=8), "they fit columns = 7"),
        (replace(CHARUCO, columns=5, rows=4), "shows markers up to 20.*only 0 to 9.*columns = 7"),
        (replace(CHARUCO, legacy=True), "columns = 7 with legacy false"),
        (replace(CHARUCO, dictionary="DICT_5X5_50"), "DICT_4X4_50: is that the board's dictionary"),
        (Board("chessboard", 12, 9, 20), "not all 11 x 8 inner corners"),
        (Board("circles", 12, 9, 20), "not all 12 x 9 circles"),
    ],
)
def test_a_wrong_board_is_told(stated, said):
    _, image = photograph(CHARUCO, 2.2)
    with pytest.raises(ImageError, match=said):
        observe([("one", image)], stated, None)


def test_miscounted_chessboards_are_told():
    board = Board("chessboard", 9, 6, 20)
    image = draw(board, homography(board, 2.0))
    (inner,) = find_board(image, Board("chessboard", 8, 5, 20))
    assert not len(inner.points)
    assert "9 x 6" in inner.note or "more squares" in inner.note


def test_a_mask_that_spans_two_boards_is_told():
    tops = [draw(CHARUCO, homography(CHARUCO, 1.3, 5.0, (shift, 0))) for shift in (-120, 120)]
    (one,) = find_board(np.concatenate([tops[0][:, :240], tops[1][:, 240:]], axis=1), CHARUCO)
    assert not len(one.points)
    assert "twice" in one.note


def test_wrong_calls_are_refused():
    image = np.zeros((40, 50), np.uint8)
    with pytest.raises(ShapeError, match="masks must have shape"):
        find_board(image, CHARUCO, np.ones((2, 50, 40), bool))
    with pytest.raises(ShapeError, match="2 views, got 1"):
        find_board(image, CHARUCO, np.ones((2, 40, 50), bool), mirrored=[True])
    with pytest.raises(ShapeError, match="photograph"):
        find_board(np.zeros((4, 5, 6, 7)), CHARUCO)
    with pytest.raises(ImageError, match="no photographs"):
        observe([], CHARUCO, None)
    with pytest.raises(ImageError, match="shows nothing"):
        observe([("black", image)], CHARUCO, None)
