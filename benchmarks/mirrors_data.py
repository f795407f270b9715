"""Real photographs with plane mirrors: corners of the boards that they show, in the order of the boards' points."""

from dataclasses import dataclass
from functools import cache
from itertools import product

import cv2
import numpy as np

from benchmarks.data import data_folder
from cyclopean import Camera
from cyclopean.geometry import Pose
from cyclopean.targets import DIRECT, Observations

SQUARES = (8, 7)  # of the board of lcm_two_mirrors, in x and y; the square at its origin is white
SQUARE = 12.8  # mm
LCM_SIZE = (3264, 1470)
LCM_PHOTOS = ("Image1", "Image2", "Image3", "Image4", "Image6", "Image8")
# Views as `Mirrors` numbers them: over the left mirror, over the right one, over the left and then the right one,
# and the board itself.
LCM_PATHS = ((0,), (1,), (0, 1), ())
LEFT, RIGHT, TWICE, BESIDE = range(4)
SIGMA = 0.3  # px, of a corner: what the residuals of the joint model come to

# Outlines (x, y) px of the sub-images, set by hand. The mirrors stand on black tiles; (1620, 826) is where they meet.
_OUTLINES = {
    LEFT: ((1620, 826), (1072, 1286), (312, 1457), (312, 208), (1072, 545)),
    RIGHT: ((1620, 826), (2571, 1259), (3123, 833), (2706, 312), (1926, 545)),
    BESIDE: ((1620, 826), (1072, 1286), (624, 1469), (2914, 1469), (2571, 1259)),
}
# Where white tape would confuse the detector (Image2), or the board rises above the foot of the mirrors (Image6).
_OWN_OUTLINES = {
    ("Image2", LEFT): ((1171, 715), (1407, 845), (1189, 1022), (959, 860)),
    ("Image2", BESIDE): ((1619, 959), (1961, 1128), (1766, 1411), (1401, 1175)),
    ("Image6", LEFT): ((1602, 730), (1452, 955), (1150, 1000), (1150, 600), (1390, 602), (1600, 708)),
    ("Image6", BESIDE): (
        (1612, 735), (1455, 960), (1300, 1200), (1800, 1300), (2050, 900), (1918, 840), (1640, 718),
    ),
}  # fmt: skip
_TOO_SLANTED = (("Image6", RIGHT),)
_LEFT_OF_POST = 1596  # px: the joint of the mirrors hides what is to the right of this column in view TWICE
_TILE = 50  # grey value of the tiles
_GRIDS = ((7, 6), (6, 5), (5, 4), (6, 4), (4, 3))  # corners to look for: all of them, or some in the middle
_SCALES = (1, 2, 0.5, 0.7)
_AGREES = 0.9  # correlation with the board's colours; a board moved by one square reaches 0.93 at most
_WIN, _WIN_PX = 0.3, (3, 12)  # half width of the windows in which corners are refined, of a square; bounds in px


@dataclass(frozen=True, eq=False)
class KnownPoints:
    """A target of known points."""

    points: np.ndarray  # (P, 3) mm
    name: str = ""


def pycalib_chess() -> tuple[KnownPoints, Observations, Camera]:
    """Chessboard on a monitor, seen in a mirror in five poses: 70 corners found by others."""
    folder = data_folder("real") / "pycalib_mirror" / "chess"
    points = np.loadtxt(folder / "model.txt")
    corners = [np.loadtxt(folder / f"input{k}.txt") for k in range(1, 6)]
    count = len(points)
    observations = Observations(
        np.repeat(np.arange(5), count), np.zeros(5 * count, int), np.tile(np.arange(count), 5),
        np.concatenate(corners), tuple(f"input{k}" for k in range(1, 6)),
        sigma=np.full(5 * count, 0.4), channel=np.zeros(5 * count, int),
    )  # fmt: skip
    camera = Camera.from_matrix(np.loadtxt(folder / "camera.txt"), (1600, 1200))
    return KnownPoints(points, "chessboard on a monitor"), observations, camera


def lcm_board() -> KnownPoints:
    """Inner corners of the hand-held board of lcm_two_mirrors, row by row, from its marked corner."""
    x, y = np.meshgrid(np.arange(1, SQUARES[0]), np.arange(1, SQUARES[1]))
    points = SQUARE * np.stack([x, y, np.zeros_like(x)], -1).reshape(-1, 3)
    return KnownPoints(points.astype(float), "board of 8 x 7 squares")


@cache
def lcm_observations() -> tuple[KnownPoints, Observations, dict[tuple[str, int], np.ndarray], tuple[int, int]]:
    """Six photographs of a board beside two mirrors.

    Returns
    -------
    KnownPoints
        (42, 3) mm.
    Observations
        Views LEFT, RIGHT and BESIDE, as `LCM_PATHS` numbers them; `with_twice_reflected` adds the fourth.
    dict
        Outline (N, 2) px of each (photograph, view).
    (int, int)
        Width and height of the photographs.

    Notes
    -----
    The dark tile round the board looks like a row of dark squares, so a detector may find the grid moved by one
    square. The grid found is therefore only a first homography: of all its shifts and quarter turns that one is
    kept in which the 8 x 7 squares have the right colours. Since the number of corners is odd in one direction and
    even in the other, colours also tell the board from the board turned by half a turn.
    """
    target = lcm_board()
    outlines = {
        (name, view): np.array(_OWN_OUTLINES.get((name, view), _OUTLINES[view]), dtype=float)
        for name, view in product(LCM_PHOTOS, (LEFT, RIGHT, BESIDE))
        if (name, view) not in _TOO_SLANTED
    }
    parts = []
    for (name, view), outline in outlines.items():
        corners = find_corners(_photograph(name), outline, mirrored=view != BESIDE)
        if corners is not None:
            parts.append((LCM_PHOTOS.index(name), view, np.arange(len(corners)), corners))
    return target, _observations(parts), outlines, LCM_SIZE


def with_twice_reflected(observations: Observations, predicted: dict[int, np.ndarray]) -> Observations:
    """The observations with the corners of view TWICE, which only a prediction (42, 2) px for each photograph finds.

    The joint of the mirrors hides a part of the board in this view, so that no detector knows which part it sees.
    """
    parts = []
    for photo, pixels in predicted.items():
        window = _window(pixels)
        seen = np.flatnonzero(pixels[:, 0] < _LEFT_OF_POST - window)
        if len(seen):
            found = _refine(_photograph(LCM_PHOTOS[photo]), pixels[seen], window)
            good = np.linalg.norm(found - pixels[seen], axis=-1) < window
            parts.append((photo, TWICE, seen[good], found[good]))
    more = _observations(parts)
    return Observations(
        *(np.concatenate([getattr(observations, n), getattr(more, n)]) for n in ("photo", "view", "point", "pixels")),
        observations.photos,
        *(np.concatenate([getattr(observations, n), getattr(more, n)]) for n in ("sigma", "channel")),
    )


def with_direct(observations: Observations) -> Observations:
    """The same rows with the board seen beside the mirrors as a photograph without them (view `DIRECT`)."""
    rows = np.arange(len(observations))
    other = observations.select(rows)
    other.view[other.view == BESIDE] = DIRECT
    return other


def find_corners(picture: np.ndarray, outline: np.ndarray, mirrored: bool) -> np.ndarray | None:
    """Inner corners (42, 2) px of the board inside an outline, in the order of its points; None if not found."""
    mask = np.zeros(picture.shape, np.uint8)
    cv2.fillPoly(mask, [np.int32(np.round(outline))], 1)
    left, top, width, height = cv2.boundingRect(mask)
    part = np.s_[top : top + height, left : left + width]
    view = np.where(mask[part] > 0, picture[part], _TILE).astype(np.uint8)
    view = np.ascontiguousarray(view[:, ::-1]) if mirrored else view
    grid = _first_grid(view)
    if grid is None:
        return None
    board = _corner_grid()
    for _ in range(2):
        corners = _moved(board, grid)
        corners = _refine(view, corners, _window(corners))
        grid = cv2.findHomography(board, corners, cv2.RANSAC, 3.0)[0]
    if mirrored:
        corners[:, 0] = width - 1 - corners[:, 0]
    return corners + np.array([left, top])


def _first_grid(view):
    """Homography from corner numbers (column, row) to pixels of an un-flipped view, or None."""
    for (columns, rows), scale in product(_GRIDS, _SCALES):
        scaled = cv2.resize(
            view, None, fx=scale, fy=scale, interpolation=cv2.INTER_CUBIC if scale > 1 else cv2.INTER_AREA
        )
        flags = cv2.CALIB_CB_EXHAUSTIVE | cv2.CALIB_CB_ACCURACY
        ok, corners = cv2.findChessboardCornersSB(scaled, (columns, rows), flags)
        if not ok:
            continue
        numbers = np.array([(c, r) for r in range(rows) for c in range(columns)], dtype=float)
        grid, _ = cv2.findHomography(numbers, (corners.reshape(-1, 2) + 0.5) / scale - 0.5, cv2.RANSAC, 3.0)
        if grid is None:
            continue
        score, grid = max(_placements(view, grid, numbers), key=lambda placed: placed[0], default=(0.0, None))
        if score > _AGREES:
            return grid
    return None


def _placements(view, grid, numbers):
    """How well colours fit, for every shift and quarter turn that keeps the corners found on the board, or one off."""
    for (c, s), across, down in product(((1, 0), (0, 1), (-1, 0), (0, -1)), range(-8, 9), range(-8, 9)):
        moved = np.array([[c, -s, across], [s, c, down], [0, 0, 1.0]])
        places = _moved(numbers, np.linalg.inv(moved))
        if places.min() >= -1 and (places.max(0) <= [SQUARES[0] - 1, SQUARES[1] - 1]).all():
            yield _agreement(view, grid @ moved), grid @ moved


def _agreement(view, grid):
    """Correlation of the squares' brightness with their colours on the board."""
    squares = np.array(list(product(range(SQUARES[0]), range(SQUARES[1]))), dtype=float)
    inside = np.array(list(product((-0.25, 0.0, 0.25), repeat=2)))  # nine samples in each square
    pixels = _moved((squares[:, None] - 0.5 + inside).reshape(-1, 2), grid).astype(np.float32)
    brightness = cv2.remap(view, *pixels.reshape(-1, 9, 2).transpose(2, 0, 1), cv2.INTER_LINEAR, borderValue=_TILE)
    white = squares.sum(1) % 2 == 0
    brightness = brightness.mean(1)
    return np.corrcoef(brightness, white)[0, 1] if np.ptp(brightness) else 0.0


def _corner_grid():
    return np.array([(c, r) for r in range(SQUARES[1] - 1) for c in range(SQUARES[0] - 1)], dtype=float)


def _moved(points, homography):
    return cv2.perspectiveTransform(points[:, None], homography)[:, 0]


def _window(corners):
    """Half width, px, of the windows for corners (42, 2)."""
    grid = corners.reshape(SQUARES[1] - 1, SQUARES[0] - 1, 2)
    side = min(np.linalg.norm(np.diff(grid, axis=axis), axis=-1).min() for axis in (0, 1))
    return int(np.clip(round(_WIN * side), *_WIN_PX))


def _refine(picture, corners, window):
    start = corners.astype(np.float32)[:, None].copy()
    return cv2.cornerSubPix(picture, start, (window, window), (-1, -1), (3, 60, 1e-4))[:, 0].astype(float)


@cache
def _photograph(name):
    picture = cv2.imread(str(data_folder("real") / "lcm_two_mirrors" / "calibration" / f"{name}.jpg"))
    return cv2.cvtColor(picture, cv2.COLOR_BGR2GRAY)


def _observations(parts):
    """Observations from parts (photo, view, points, pixels)."""
    counts = [len(points) for *_, points, _ in parts]
    photo, view = (np.repeat([part[k] for part in parts], counts) for k in (0, 1))
    points, pixels = (np.concatenate([part[k] for part in parts]) for k in (2, 3))
    count = len(points)
    return Observations(
        photo, view, points, pixels, LCM_PHOTOS, sigma=np.full(count, SIGMA), channel=np.zeros(count, int)
    )


def twice_reflected(points: np.ndarray, pose: Pose, planes, camera: Camera) -> np.ndarray:
    """Pixels (P, 2) at which a camera sees target points (P, 3) over the left and then the right mirror."""
    where = pose @ points
    for normal, offset in (planes[1], planes[0]):
        where = where - 2 * (where @ normal - offset)[..., None] * normal
    return camera.project(where)
