"""Boards with markers: decoded markers tell which point is which, and what is wrong when they do not."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from .boards import DICTIONARIES, Board
from .growth import NOTHING, Found, grow

_FEW = 4  # fewer corners than this say nothing about a view
_AGREE = 0.6  # least share of the markers that must lie as the board says
_ENLARGE = 4  # with fewer markers than this the picture is tried at twice its size ...
_SMALL = 6e6  # ... if it has fewer pixels than this
_SURE = 0.9  # with a lower share, other boards are tried
_QUICK = 60  # random samples that tell whether another board fits
NO_MARKERS = "no markers"
_FAMILIES = (
    "DICT_4X4_1000", "DICT_5X5_1000", "DICT_6X6_1000", "DICT_7X7_1000", "DICT_ARUCO_ORIGINAL",
    "DICT_APRILTAG_16h5", "DICT_APRILTAG_25h9", "DICT_APRILTAG_36h10", "DICT_APRILTAG_36h11",
)  # fmt: skip


@dataclass(frozen=True, eq=False)
class Markers:
    """Decoded markers; M rows."""

    numbers: np.ndarray  # (M,) int
    corners: np.ndarray  # (M, 4, 2) px, clockwise from the dictionary's top left

    def rows(self, rows: np.ndarray) -> Markers:
        """Some of them."""
        return Markers(self.numbers[rows], self.corners[rows])


def decode(picture: np.ndarray, dictionary: str) -> Markers:
    """Markers of an OpenCV dictionary in a picture (H, W) uint8."""
    import cv2

    parameters = cv2.aruco.DetectorParameters()
    parameters.minMarkerPerimeterRate = min(0.03, 40 / max(picture.shape))  # sides of 10 px
    parameters.adaptiveThreshWinSizeMax = 33
    book = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, dictionary))
    corners, numbers, _ = cv2.aruco.ArucoDetector(book, parameters).detectMarkers(picture)
    if numbers is None or not len(numbers):
        return Markers(np.zeros(0, int), np.zeros((0, 4, 2)))
    return Markers(np.asarray(numbers).ravel().astype(int), np.asarray(corners, dtype=float).reshape(-1, 4, 2))


def _decode_enlarged(picture, board):
    """Markers in a picture of twice the size; tags cut loose from the black squares that touch their corners."""
    import cv2

    large = cv2.resize(picture, None, fx=2, fy=2, interpolation=cv2.INTER_CUBIC)
    if board.kind == "apriltags":
        large = cv2.dilate(large, np.ones((3, 3), np.uint8))
    markers = decode(large, board.dictionary)
    return Markers(markers.numbers, (markers.corners - 0.5) / 2)


def find_marked(picture: np.ndarray, image: np.ndarray, valid: np.ndarray, board: Board) -> tuple[Found, str]:
    """Points of a charuco board or a grid of tags in one view that is not mirrored.

    Parameters
    ----------
    picture : (H, W) uint8
        For the decoder; harmless outside the view.
    image, valid : (H, W)
        Brightness, and the pixels of the view.

    Returns
    -------
    Found, str
        The points, and what is wrong ("" when all is well).
    """
    markers = decode(picture, board.dictionary or "")
    if len(markers.numbers) < _ENLARGE and picture.size < _SMALL:
        larger = _decode_enlarged(picture, board)
        markers = larger if len(larger.numbers) > len(markers.numbers) else markers
    if not len(markers.numbers):
        return NOTHING, NO_MARKERS
    twice = _shown_twice(markers)
    if twice:
        return NOTHING, twice
    markers = markers.rows(np.isin(markers.numbers, _once(markers.numbers)))
    agreeing, share = _agreeing(markers, board)
    beyond = markers.numbers[markers.numbers >= len(board.marker_corners)]
    if (agreeing is None or share < _AGREE) and len(markers.numbers) < _ENLARGE:
        return NOTHING, NO_MARKERS
    better = _fitting_board(markers, board, share) if len(beyond) > 1 or share < _SURE else ""
    if better or agreeing is None or share < _AGREE or len(beyond) > max(2, 0.1 * len(markers.numbers)):
        return NOTHING, _contradiction(markers, board, beyond, better)
    found = _grow(image, valid, board, *agreeing)
    if len(found.points) < _FEW:
        return NOTHING, (
            f"{len(markers.numbers)} markers can be read but only {len(found.points)} corners look as they should; "
            "is the photograph blurred, or legacy (the first square's colour) wrong?"
        )
    return found, ""


def _grow(image, valid, board, xy, pixels):
    """Tags may stand free, or touch black squares as Kalibr prints them: take what explains the picture."""
    found = grow(image, valid, board, xy, pixels)
    if board.kind != "apriltags":
        return found
    around = board.surroundings
    free = grow(image, valid, board, xy, pixels, replace(around, white=~around.marked))
    return free if len(free.points) > len(found.points) else found


def _once(numbers):
    values, counts = np.unique(numbers, return_counts=True)
    return values[counts == 1]


def _shown_twice(markers):
    """What to say when several markers are seen at two places, else ""."""
    values, counts = np.unique(markers.numbers, return_counts=True)
    twice = values[counts > 1]
    if len(twice) < 2 or len(twice) < 0.1 * len(values):
        return ""
    return (
        f"shows {len(twice)} markers twice (first: {twice[0]}): two boards, or a mask that spans more than one "
        "sub-image; show one board, and check the masks"
    )


def _agreeing(markers: Markers, board: Board, samples: int = 1000):
    """Marker corners (mm) and pixels (px) that one homography explains, None if there are too few; their share."""
    import cv2

    on_board = markers.rows(markers.numbers < len(board.marker_corners))
    count = len(on_board.numbers)
    if count < (2 if board.kind == "apriltags" else 1):
        return None, 1.0
    pixels = on_board.corners.reshape(-1, 2)
    sides = np.linalg.norm(np.roll(on_board.corners, 1, axis=1) - on_board.corners, axis=-1)
    limit = max(2.0, 0.3 * float(np.median(sides)))
    best, most = None, -1
    for corners in _orders(board):
        xy = corners[on_board.numbers].reshape(-1, 2)
        homography, inside = cv2.findHomography(xy, pixels, cv2.RANSAC, limit, maxIters=samples)
        if homography is None:
            continue
        whole = inside.reshape(-1, 4).all(1)  # all four corners, or the marker is misread
        if whole.sum() > most:
            rows = np.repeat(whole, 4)
            best, most = (xy[rows], pixels[rows]), whole.sum()
    if best is None or most < 1:
        return None, 0.0 if count > 2 else 1.0
    return best, most / count


def _orders(board):
    """Corners (M, 4, 2) mm of the markers as a decoder may give them: tags are printed turned, or from the bottom."""
    corners = board.marker_corners
    if board.kind == "charuco":
        return [corners]
    return [np.roll(way, turn, axis=1) for way in (corners, corners[:, ::-1]) for turn in range(4)]


def _contradiction(markers, board, beyond, better):
    """What to say about markers that do not lie as on the board."""
    said = f"its {len(markers.numbers)} markers do not lie as on a {board}"
    if len(beyond):
        said = f"shows markers up to {beyond.max()}, the {board} has only 0 to {len(board.marker_corners) - 1}"
    return f"{said}; {better or 'is it another board, or bent?'}"


def _fitting_board(markers, board, share):
    """Other columns, or the other first square, that explain a larger share of the markers; "" if none does."""
    best, most = "", max(0.8, share)
    _, count = DICTIONARIES[board.dictionary]
    for legacy in (board.legacy, not board.legacy) if board.kind == "charuco" else (False,):
        for columns in range(2, 31):
            per_row = columns / 2 if board.kind == "charuco" else columns
            rows = max(2, int(np.ceil((markers.numbers.max() + 1) / per_row)), board.rows)
            rows += (rows - board.rows) % 2  # the first square's colour depends on whether rows are even
            if per_row * rows > count:
                continue
            other = replace(board, columns=columns, rows=rows, legacy=legacy)
            found, share = _agreeing(markers, other, _QUICK)
            if found is not None and share > most + 1e-9 and len(found[0]) > 8:
                turned = " with legacy " + ("true" if legacy else "false") if legacy != board.legacy else ""
                best, most = f"they fit columns = {columns}{turned}", share
    return best


def other_dictionary(picture: np.ndarray, dictionary: str) -> str:
    """Name of the smallest common dictionary that the markers in a picture belong to, if not the given one; or ""."""
    bits, _ = DICTIONARIES[dictionary]
    best, most = "", 3
    for family in sorted(_FAMILIES, key=lambda name: DICTIONARIES[name][0] != bits):
        numbers = np.unique(decode(picture, family).numbers)
        if len(numbers) <= most:
            continue
        most = len(numbers)
        typical = np.percentile(numbers, 95)  # a misread marker may have any number
        size = DICTIONARIES[family][0]
        names = [f"DICT_{size}X{size}_{n}" for n in (50, 100, 250, 1000)] if family.endswith("_1000") else [family]
        best = next((name for name in names if DICTIONARIES[name][1] > typical), family)
    return best if best != dictionary else ""
