"""Boards as files and on paper: what is written comes back, and what is drawn is found where the board says."""

import re
import struct
import zlib
from xml.etree import ElementTree

import commands
import cv2
import numpy as np
import pytest
from scipy.spatial import cKDTree

from cyclopean.errors import OutputError, SetupError
from cyclopean.files.boards import read_board, write_board
from cyclopean.plotting.boards import PAPERS, as_pdf, as_picture, as_png, as_svg, board_sheet, describe
from cyclopean.targets.boards import Board, PointTarget

CHARUCO = Board(kind="charuco", columns=14, rows=10, square=20.0, marker=15.0, dictionary="DICT_5X5_250")
BOARDS = {
    "charuco": CHARUCO,
    "legacy charuco": Board(
        kind="charuco", columns=8, rows=6, square=30.0, marker=22.0, dictionary="DICT_4X4_50", legacy=True
    ),
    "chessboard": Board(kind="chessboard", columns=9, rows=6, square=25.5),
    "circles": Board(kind="circles", columns=7, rows=9, square=20.0),
    "asymmetric circles": Board(kind="asymmetric_circles", columns=4, rows=11, square=17.5),
    "apriltags": Board(kind="apriltags", columns=4, rows=3, square=40.0, marker=30.0, dictionary="DICT_APRILTAG_36h11"),
}
CHARUCO_TEXT = (
    '[board]\nkind = "charuco"\ncolumns = 14\nrows = 10\nsquare = 20.0\nmarker = 15.0\ndictionary = "DICT_5X5_250"\n'
)


def fault(folder, text):
    (folder / "board.toml").write_text(text, encoding="utf-8")
    with pytest.raises(SetupError) as caught:
        read_board(folder / "board.toml")
    start = f"{folder / 'board.toml'}: "
    assert str(caught.value).startswith(start)
    return str(caught.value).removeprefix(start)


def same(one, other):
    names = ("kind", "columns", "rows", "square", "marker", "dictionary", "legacy", "name")
    assert [getattr(one, name) for name in names] == [getattr(other, name) for name in names]


@pytest.mark.parametrize("name", BOARDS)
def test_what_is_written_comes_back(name, tmp_path):
    write_board(tmp_path / "board.toml", BOARDS[name])
    same(read_board(tmp_path / "board.toml"), BOARDS[name])


def test_what_people_write_is_read(tmp_path):
    (tmp_path / "board.toml").write_text(
        '\ufeff[board]\r\nkind = "chessboard"\r\ncolumns = 9\r\nrows = 6\r\nsquare = 25\r\nname = "the old one"\r\n'
    )
    same(
        read_board(tmp_path / "board.toml"),
        Board(kind="chessboard", columns=9, rows=6, square=25.0, name="the old one"),
    )


def test_points_in_space_come_back(tmp_path):
    points = np.random.default_rng(2).normal(0, 40, (30, 3))
    write_board(tmp_path / "rig.toml", PointTarget(points, name="dots"))
    found = read_board(tmp_path / "rig.toml")
    np.testing.assert_array_equal(found.points, points)
    assert found.name == "dots"
    (tmp_path / "rig.csv").write_text("id,x,y,z\n1,1,2,3\n\n0,4,5,6\n")  # in any order
    assert read_board(tmp_path / "rig.toml").points.tolist() == [[4, 5, 6], [1, 2, 3]]


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("id,x,y\n", "line 1: the header must read id,x,y,z, got 'id,x,y'"),
        ("id,x,y,z\n0,1,2\n", "line 2: wanted x, y and z in mm, got '1,2'"),
        ("id,x,y,z\n0,1,2,nan\n", "line 2: wanted x, y and z in mm"),
        ("id,x,y,z\n0,1,2,3\na,1,2,3\n", "line 3: wanted a whole number and three numbers"),
        ("id,x,y,z\n0,1,2,3\n0,1,2,3\n", "line 3: id 0 stands twice"),
        ("id,x,y,z\n0,1,2,3\n2,1,2,3\n", "2 points must have the ids 0 to 1, each once; 1 is missing"),
        ("id,x,y,z\n", "there are no points below the header"),
    ],
)
def test_faults_of_point_files_are_named(text, said, tmp_path):
    (tmp_path / "points.csv").write_text(text)
    (tmp_path / "board.toml").write_text('[board]\nkind = "points"\nfile = "points.csv"\n')
    with pytest.raises(SetupError) as caught:
        read_board(tmp_path / "board.toml")
    assert str(caught.value).startswith(f"{tmp_path / 'points.csv'}: {said}")


SQUARE = "a number of mm above 0, the side of a square"
KINDS = "charuco, chessboard, circles, asymmetric_circles, apriltags, points"


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (("legacy", "legacy"), None),
        (
            ("square", "sqare"),
            f"2 things are wrong\n  board.square is missing: {SQUARE}\n"
            "  board.sqare = 20.0: unknown key; did you mean square?",
        ),
        (("columns = 14", "columns = 14.5"), "board.columns = 14.5 must be a whole number from 1 to 1000"),
        (("square = 20.0", "square = -1"), f"board.square = -1 must be {SQUARE}"),
        (("square = 20.0", "square = nan"), f"board.square = nan must be {SQUARE}"),
        (("square = 20.0", "square = '20'"), f"board.square = '20' must be {SQUARE}"),
        (("rows = 10\n", ""), "board.rows is missing: a whole number from 1 to 1000"),
        (('"charuco"', '"charuko"'), f"board.kind = 'charuko': wanted one of {KINDS}; did you mean 'charuco'?"),
        (('kind = "charuco"\n', ""), f"board.kind is missing: wanted one of {KINDS}"),
        (("[board]", "[bord]"), "2 things are wrong\n  board is missing: a table, [board], with kind, columns, rows"),
        (("[board]", "x = 1\n[board]"), "x = 1: unknown key; the known ones are board"),
        (("rows = 10", "rows = = 10"), "this is not TOML: "),
    ],
)
def test_faults_are_named(change, said, tmp_path):
    text = CHARUCO_TEXT.replace(*change)
    if said is None:
        (tmp_path / "board.toml").write_text(text)
        same(read_board(tmp_path / "board.toml"), CHARUCO)
        return
    assert fault(tmp_path, text).startswith(said)


@pytest.mark.parametrize("change", [("marker = 15.0", "marker = 25.0"), ("DICT_5X5_250", "DICT_5X5_251")])
def test_a_board_that_cannot_be_is_refused_with_the_name_of_the_file(change, tmp_path):
    fault(tmp_path, CHARUCO_TEXT.replace(*change))


# On paper.


def found_points(board, picture):
    """Numbers and pixels (N, 2) of the board's points that OpenCV finds."""
    if board.kind == "charuco":
        dictionary = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, board.dictionary))
        grid = cv2.aruco.CharucoBoard((board.columns, board.rows), board.square, board.marker, dictionary)
        grid.setLegacyPattern(board.legacy)
        corners, numbers, *_ = cv2.aruco.CharucoDetector(grid).detectBoard(picture)
        return numbers.ravel(), corners.reshape(-1, 2)
    if board.kind == "apriltags":
        dictionary = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, board.dictionary))
        how = cv2.aruco.DetectorParameters()
        how.cornerRefinementMethod = cv2.aruco.CORNER_REFINE_SUBPIX
        tags, numbers, _ = cv2.aruco.ArucoDetector(dictionary, how).detectMarkers(picture)
        return (4 * numbers.reshape(-1, 1) + np.arange(4)).ravel(), np.array(tags).reshape(-1, 2)
    if board.kind == "chessboard":
        found, corners = cv2.findChessboardCorners(picture, board.grid)
        corners = cv2.cornerSubPix(picture, corners, (5, 5), (-1, -1), (3, 50, 1e-4))
    else:
        asymmetric = board.kind == "asymmetric_circles"
        flag = cv2.CALIB_CB_ASYMMETRIC_GRID if asymmetric else cv2.CALIB_CB_SYMMETRIC_GRID
        found, corners = cv2.findCirclesGrid(picture, board.grid, flags=flag)
    assert found
    return None, corners.reshape(-1, 2)


@pytest.mark.parametrize("name", BOARDS)
def test_opencv_finds_the_points_where_the_board_says(name):
    board = BOARDS[name]
    dpi = 100 if "circles" in name else 200  # larger circles OpenCV takes for no blobs
    sheet = board_sheet(board)
    numbers, pixels = found_points(board, as_picture(sheet, dpi))
    places = (pixels + 0.5) * 25.4 / dpi - sheet.origin  # mm in the board's frame
    if numbers is None:  # OpenCV may begin at another end of the board
        numbers = np.argmin(np.linalg.norm(places[:, None] - board.points[:, :2], axis=-1), axis=1)
    assert sorted(numbers) == list(range(len(board.points)))
    # a point is found to a tenth of a pixel of 0.13 or 0.25 mm; the corners of tags, dark on one side only, to a fifth
    slack = 0.03 if board.kind == "apriltags" else 0.02
    np.testing.assert_allclose(places, board.points[numbers, :2], atol=slack)


@pytest.mark.parametrize("name", BOARDS)
def test_the_print_is_black_where_the_board_says(name):
    board, dpi = BOARDS[name], 60
    sheet = board_sheet(board)
    grey = as_picture(sheet, dpi)
    row, column = np.indices(grey.shape)
    xy = (np.stack([column, row], -1) + 0.5) * 25.4 / dpi - sheet.origin
    (x0, y0), (x1, y1) = board.points[:, :2].min(0) - board.square, board.points[:, :2].max(0) + board.square
    there = (xy[..., 0] > x0) & (xy[..., 0] < x1) & (xy[..., 1] > y0) & (xy[..., 1] < y1)
    there &= (grey == 0) | (grey == 255)  # grey pixels lie on edges
    strip = sheet.size[0] - 12 < (xy + sheet.origin)[..., 0], sheet.size[1] - 12 < (xy + sheet.origin)[..., 1]
    there &= ~(strip[0] | strip[1])  # the ruler
    assert there.sum() > 5e4
    np.testing.assert_array_equal(board.shade(xy[there]), grey[there] == 255)


@pytest.mark.parametrize("name", BOARDS)
def test_svg_and_pdf_hold_the_same_edges_in_mm(name):
    sheet = board_sheet(BOARDS[name])
    x, y, w, h = sheet.rectangles.T
    edges = np.stack([x, y, x + w, y + h], -1)

    root = ElementTree.fromstring(as_svg(sheet))
    assert (root.get("width"), root.get("height")) == tuple(f"{length:g}mm" for length in sheet.size)
    assert root.get("viewBox") == f"0 0 {sheet.size[0]:g} {sheet.size[1]:g}"
    path = next(element.get("d") for element in root if element.tag.endswith("path"))
    numbers = np.array(re.findall(r"-?[\d.]+", path), dtype=float).reshape(-1, 5)
    np.testing.assert_allclose(numbers[:, :4], edges, atol=1e-4)  # four digits
    assert sum(element.tag.endswith("circle") for element in root) == len(sheet.circles)

    pdf = as_pdf(sheet)
    box = re.search(rb"/MediaBox \[ ?0 0 ([\d.]+) ([\d.]+) ?\]", pdf)
    np.testing.assert_allclose([float(size) * 25.4 / 72 for size in box.groups()], sheet.size, atol=1e-3)
    drawing = max((inflated(part) for part in pdf.split(b"stream\n")[1:]), key=lambda text: text.count(b" l\n"))
    points = np.array(re.findall(rb"([\d.-]+) ([\d.-]+) [ml]\n", drawing), dtype=float) * 25.4 / 72
    points[:, 1] = sheet.size[1] - points[:, 1]  # PDF counts from the bottom
    corners = np.stack([edges[:, :2], edges[:, [2, 1]], edges[:, 2:], edges[:, [0, 3]]], 1).reshape(-1, 2)
    apart, _ = cKDTree(points).query(corners)
    assert apart.max() < 1e-3


def inflated(part):
    try:
        return zlib.decompressobj().decompress(part)
    except zlib.error:
        return b""


def test_the_ruler_is_100_mm_long_and_everything_lies_on_the_page():
    for board in BOARDS.values():
        for paper in (None, "A3", "A2", (600.0, 300.0)):
            sheet = board_sheet(board, paper)
            x, y, w, h = sheet.rectangles.T
            strokes = np.minimum(w, h) < 0.21  # 0.2 mm
            ticks = sheet.rectangles[strokes][1:]
            centres = ticks[:, :2] + ticks[:, 2:] / 2
            assert np.ptp(centres, axis=0).max() == pytest.approx(100, abs=1e-9)
            assert min(x.min(), y.min()) > 3.5
            assert ((x + w).max(), (y + h).max()) <= (sheet.size[0] - 3.5, sheet.size[1] - 3.5)
            board_box = sheet.rectangles[~strokes]
            overlap = (ticks[:, None, :2] < board_box[:, :2] + board_box[:, 2:]) & (
                board_box[:, :2] < ticks[:, None, :2] + ticks[:, None, 2:]
            )
            assert not overlap.all(-1).any()


def test_a_png_says_its_resolution():
    sheet = board_sheet(BOARDS["chessboard"])
    png = as_png(sheet, 150)
    picture = cv2.imdecode(np.frombuffer(png, np.uint8), cv2.IMREAD_UNCHANGED)
    np.testing.assert_array_equal(picture, as_picture(sheet, 150))
    assert picture.shape == tuple(round(length * 150 / 25.4) for length in sheet.size[::-1])
    place = png.index(b"pHYs")
    across, down, unit = struct.unpack(">IIB", png[place + 4 : place + 13])
    assert (across, down, unit) == (5906, 5906, 1)  # per metre: 150 / 0.0254
    assert struct.unpack(">I", png[place + 13 : place + 17])[0] == zlib.crc32(png[place : place + 13])


def test_grey_pixels_hold_the_share_of_white():
    sheet = board_sheet(BOARDS["chessboard"], (300.0, 200.0))
    picture = as_picture(sheet, 25.4 * 3.7)  # 3.7 px a mm, so that edges lie between pixels
    board = BOARDS["chessboard"]
    x0, y0 = (np.array(sheet.origin) * 3.7).astype(int) - 2
    width = int(np.ptp(board.points[:, 0] + 0) * 3.7 + 2 * board.square * 3.7) + 5
    height = int(np.ptp(board.points[:, 1]) * 3.7 + 2 * board.square * 3.7) + 5
    black = (255.0 - picture[y0 : y0 + height, x0 : x0 + width]).sum() / 255 / 3.7**2  # mm^2
    squares = sheet.rectangles[sheet.rectangles[:, 2:].min(1) > 1]
    assert black == pytest.approx(np.prod(squares[:, 2:], axis=1).sum(), rel=1e-4)  # grey levels are whole numbers


def test_the_smallest_paper_is_taken_and_a_small_one_refused():
    assert board_sheet(CHARUCO).size == PAPERS["A4"][::-1]  # 280 x 200 mm: the ruler goes beside it
    assert board_sheet(Board(kind="chessboard", columns=6, rows=9, square=20.0)).size == PAPERS["A4"]
    assert board_sheet(Board(kind="chessboard", columns=6, rows=9, square=20.0), "letter").size == (215.9, 279.4)
    large = Board(kind="chessboard", columns=40, rows=20, square=20.0)
    assert max(board_sheet(large).size) == PAPERS["A1"][1]
    with pytest.raises(OutputError, match="paper A4 is too small; A1 would do"):
        board_sheet(large, "A4")
    with pytest.raises(OutputError, match="no paper up to A0 is large enough; give the paper's size"):
        board_sheet(Board(kind="chessboard", columns=90, rows=20, square=20.0))
    with pytest.raises(OutputError, match="paper 'A5' is unknown"):
        board_sheet(CHARUCO, "A5")
    with pytest.raises(OutputError, match="too large a picture; lower --dpi"):
        as_picture(board_sheet(large), 5000)


def test_captions_say_what_the_board_is():
    assert describe(CHARUCO) == "charuco 14 x 10, square 20 mm, marker 15 mm, DICT_5X5_250"
    assert describe(BOARDS["asymmetric circles"]) == "asymmetric circles 4 x 11, spacing 17.5 mm, diameter 8.75 mm"
    assert describe(BOARDS["apriltags"]) == "apriltags 4 x 3, pitch 40 mm, tag 30 mm, DICT_APRILTAG_36h11"


# The command.


def run(monkeypatch, capsys, *words):
    """Exit status, output and errors of `cyclopean board`."""
    return commands.run(monkeypatch, capsys, "board", *words)


OPTIONS = ("--kind", "charuco", "--columns", "6", "--rows", "5", "--square", "20", "--marker", "15")
OPTIONS += ("--dictionary", "DICT_4X4_50")


def test_the_command_draws_and_writes_the_board(monkeypatch, capsys, tmp_path):
    status, said, _ = run(monkeypatch, capsys, *OPTIONS, "-o", tmp_path / "board.pdf", "--paper", "a4")
    assert status == 0
    assert "297 x 210 mm" in said
    assert (tmp_path / "board.pdf").read_bytes().startswith(b"%PDF")
    board = read_board(tmp_path / "board.toml")
    assert (board.kind, board.columns, board.rows, board.square) == ("charuco", 6, 5, 20)
    for name in ("board.svg", "board.png"):
        assert run(monkeypatch, capsys, tmp_path / "board.toml", "-o", tmp_path / name, "--dpi", 60)[0] == 0
        assert (tmp_path / name).stat().st_size > 1000
    assert run(monkeypatch, capsys, *OPTIONS, "-o", tmp_path / "board.png", "--dpi", 60)[0] == 0  # the same once more


@pytest.mark.parametrize(
    ("words", "said"),
    [
        ((*OPTIONS, "-o", "board.txt"), "is drawn as .pdf, .svg or .png"),
        (("-o", "board.pdf"), "which board?"),
        (("no.toml", "-o", "board.pdf"), "there is no such file"),
        (("no.toml", *OPTIONS, "-o", "board.pdf"), "not both"),
        ((*OPTIONS[:-2], "-o", "board.pdf"), "the options: board.dictionary is missing"),
        ((*OPTIONS, "-o", "board.pdf", "--paper", "70x70"), "paper 70 x 70 mm is too small; A4 would do"),
        ((*OPTIONS, "-o", "board.pdf", "--paper", "0x70"), "--paper wants WIDTHxHEIGHT"),
        ((*OPTIONS, "-o", "board.pdf", "--paper", "B5"), "paper 'B5' is unknown"),
        ((*OPTIONS, "-o", "board.png", "--dpi", "1"), "--dpi wants a number from 10 to 10000"),
        ((*OPTIONS, "-o", "taken.pdf"), "taken.toml exists and is another board or setup"),
        ((*OPTIONS, "-o", "none/board.pdf"), "there is no folder"),
    ],
)
def test_faults_of_the_command_are_one_line(words, said, monkeypatch, capsys, tmp_path):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "taken.toml").write_text("[camera]\n")
    status, _, errors = run(monkeypatch, capsys, *words)
    assert status == 2
    assert said in errors
    assert [path.name for path in tmp_path.iterdir()] == ["taken.toml"]
