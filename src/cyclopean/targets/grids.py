"""Chessboards and grids of circles: nothing in them tells points apart, so a view must show the whole board."""

from __future__ import annotations

import numpy as np

from .boards import Board, turns
from .corners import Surroundings, fit_corners
from .curvature import bent_disc_offset, straightened
from .growth import NOTHING, Found, LocalMap, homography_pixels

_EXPLAINED = 0.85  # least share of a window's variance that a true corner's model explains
_FLOOR = 0.01  # px; no circle's centre is known better than this


def find_grid(picture: np.ndarray, image: np.ndarray, valid: np.ndarray, board: Board) -> tuple[Found, str]:
    """Points of a chessboard or a grid of circles in one view that is not mirrored.

    Parameters
    ----------
    picture : (H, W) uint8
        For OpenCV's detectors; harmless outside the view.
    image, valid : (H, W)
        Brightness, and the pixels of the view.

    Returns
    -------
    Found, str
        The points, and what is wrong ("" when all is well). Of all numberings that fit the board, any.
    """
    if board.kind == "chessboard":
        pixels = _seek_corners(picture, *board.grid)
    else:
        pixels = _seek_circles(picture, *board.grid, asymmetric=board.kind == "asymmetric_circles")
    if pixels is None:
        return NOTHING, _why_nothing(picture, board)
    pixels = _right_handed(pixels, board)
    if pixels is None:
        return NOTHING, "the board can only be read as mirrored: does the setup say that this view is?"
    try:
        local = LocalMap(board.points[:, :2], pixels, reach=2.5 * board.square)
        if board.kind == "chessboard":
            return _corners(image, valid, board, local)
        return _centres(image, valid, board, local)
    except np.linalg.LinAlgError:
        return NOTHING, "the points found lie on a line"


def _seek_corners(picture, columns, rows):
    """Rough pixels (P, 2) of inner corners, or None."""
    import cv2

    found, pixels = cv2.findChessboardCornersSB(picture, (columns, rows), flags=cv2.CALIB_CB_NORMALIZE_IMAGE)
    if not found:
        flags = cv2.CALIB_CB_ADAPTIVE_THRESH | cv2.CALIB_CB_NORMALIZE_IMAGE | cv2.CALIB_CB_FAST_CHECK
        found, pixels = cv2.findChessboardCorners(picture, (columns, rows), flags=flags)
    return np.asarray(pixels, dtype=float).reshape(-1, 2) if found else None


def _seek_circles(picture, columns, rows, asymmetric=False):
    """Rough pixels (P, 2) of centres, or None: OpenCV's blob detector as it is, then one for small or large circles."""
    import cv2

    kind = cv2.CALIB_CB_ASYMMETRIC_GRID if asymmetric else cv2.CALIB_CB_SYMMETRIC_GRID
    tuned = cv2.SimpleBlobDetector.Params()
    tuned.minArea, tuned.maxArea, tuned.minDistBetweenBlobs = 12, picture.size / (2 * columns * rows), 3
    tuned.minCircularity, tuned.filterByCircularity = 0.6, True
    tuned.minInertiaRatio, tuned.minConvexity = 0.1, 0.8
    detectors = [cv2.SimpleBlobDetector.create(p) for p in (cv2.SimpleBlobDetector.Params(), tuned)]
    for detector, flags in ((0, kind), (1, kind), (1, kind | cv2.CALIB_CB_CLUSTERING)):
        found, pixels = cv2.findCirclesGrid(picture, (columns, rows), flags=flags, blobDetector=detectors[detector])
        if found:
            return np.asarray(pixels, dtype=float).reshape(-1, 2)
    return None


def _why_nothing(picture, board):
    what = "inner corners" if board.kind == "chessboard" else "circles"
    said = f"not all {board.grid[0]} x {board.grid[1]} {what} can be seen: show the whole board in every view"
    if board.kind != "chessboard":
        return f"{said}, or take a charuco board"
    for change in (1, -1):
        columns, rows = board.grid[0] + change, board.grid[1] + change
        if min(columns, rows) > 2 and _seek_corners(picture, columns, rows) is not None:
            return f"the board has {columns + 1} x {rows + 1} squares, not {board.columns} x {board.rows} (not corners)"
    return f"{said}, or take a charuco board, which a seam may cut"


def _right_handed(pixels, board):
    """The same pixels numbered so that the board is seen from its front, or None if no numbering does that."""
    xy = board.points[:, :2]
    for numbers in turns(xy, reflected=True):
        numbered = np.empty_like(pixels)
        numbered[numbers] = pixels
        slope = np.linalg.lstsq(np.column_stack([xy, np.ones(len(xy))]), numbered, rcond=None)[0][:2]
        if np.linalg.det(slope) > 0:
            return numbered
    return None


def _corners(image, valid, board, local):
    """Corners of a chessboard, numbered so that its first square is black."""
    xy, around = board.points[:, :2], board.surroundings
    pixels, jacobians = local(xy)
    fits = fit_corners(image, valid, pixels, jacobians, around)
    good = _true(fits, pixels, jacobians, board, _EXPLAINED)
    if good.sum() < 0.5 * len(xy):
        return NOTHING, "a chessboard may be there, but its corners are too blurred or too near to a seam"
    if _goes_on(image, valid, board, local, np.percentile(fits.explained[good], 10) - 0.01):
        return NOTHING, f"the chessboard has more squares than {board.columns} x {board.rows}: count its squares again"
    rows = np.flatnonzero(good)
    numbers = rows
    if np.median(fits.contrast[good]) < 0:  # black and white exchanged: a turn that the pattern does show is right
        shown = [turn for turn in turns(xy) if not any((turn == same).all() for same in board.symmetries)]
        numbers = shown[0][rows] if shown else rows
    around = board.surroundings.rows(rows)
    return Found(numbers, *straightened(image, valid, xy[rows], fits.pixels[rows], fits.sigma[rows], around)), ""


def _true(fits, pixels, jacobians, board, explained):
    """Which fits look like corners, and lie where they were foretold."""
    side = np.sqrt(np.abs(np.linalg.det(jacobians))) * board.square  # px
    return (fits.explained > explained) & (np.linalg.norm(fits.pixels - pixels, axis=-1) < 0.15 * side)


def _goes_on(image, valid, board, local, explained):
    """Whether the pattern goes on beyond the board's outer edges: corners there as good as its own."""
    columns, rows = board.columns + 1, board.rows + 1
    column, row = (a.ravel() for a in np.meshgrid(np.arange(columns), np.arange(rows)))
    ring = (column == 0) | (row == 0) | (column == columns - 1) | (row == rows - 1)
    column, row = column[ring], row[ring]
    even = ((column + row) % 2 == 0)[:, None]
    white = np.where(even, [[False, True, True, False]], [[True, False, False, True]])
    pixels, jacobians = local(np.stack([column, row], axis=-1) * board.square)
    around = Surroundings(white, np.zeros_like(white), 0.45 * board.square)
    fits = fit_corners(image, valid, pixels, jacobians, around)
    return _true(fits, pixels, jacobians, board, explained).sum() > 0.2 * len(column)


def _centres(image, valid, board, local):
    """Centres of circles from the mean of their pixels, less the offset that perspective and bending give it."""
    xy = board.points[:, :2]
    pixels, jacobians = local(xy)
    spacing = board.square * (np.sqrt(2) if board.kind == "asymmetric_circles" else 1)
    reach = (board.diameter + spacing) / 4  # mm, half way from a circle's edge to its neighbour's
    fits = np.array([_centre(image, valid, *one, reach) for one in zip(pixels, np.linalg.inv(jacobians), strict=True)])
    radius = np.sqrt(fits[:, 3] / (np.pi * np.abs(np.linalg.det(jacobians))))
    centres = fits[:, :2] - _perspective_offset(local.homography, xy, radius)
    rows = np.flatnonzero(np.isfinite(fits).all(-1))
    centres[rows] -= bent_disc_offset(xy[rows], centres[rows], radius[rows])
    if len(rows) < 0.5 * len(xy):
        return NOTHING, "circles were found, but they are too faint, or too near to a seam or to each other"
    return Found(rows, centres[rows], fits[rows, 2]), ""


def _centre(image, valid, guess, inverse, reach):
    """Mean pixel x, y, its standard deviation and the area (px²) of a dark circle; NaN when it is not all there."""
    half = int(np.ceil(reach * np.sqrt(1 / np.abs(np.linalg.det(inverse))) * 1.5))
    for _ in range(2):
        column, row = np.rint(guess).astype(int)
        box = np.s_[max(row - half, 0) : row + half + 1, max(column - half, 0) : column + half + 1]
        rows, columns = np.indices(image[box].shape)
        from_guess = np.stack([columns + box[1].start, rows + box[0].start], axis=-1) - guess
        distance = np.linalg.norm(from_guess @ inverse.T, axis=-1)
        inside = distance < reach
        if not inside.any() or not valid[box][inside].all() or min(row, column) < half:
            return np.full(4, np.nan)
        around = image[box][inside & (distance > 0.85 * reach)]
        white, black = np.median(around), np.percentile(image[box][distance < 0.4 * reach], 20)
        noise = max(1.4826 * np.median(np.abs(around - white)), 0.3)  # 0.3: rounding to whole grey levels
        if not white - black > 6 * noise:
            return np.full(4, np.nan)
        share = np.where(inside, (white - image[box]) / (white - black), 0)
        share = np.where(share > 0.05, share.clip(0, 1), 0)
        area = share.sum()
        guess = guess + (share[..., None] * from_guess).sum((0, 1)) / area
    spread = np.sqrt((from_guess[share > 0] ** 2).sum() / 2)
    return np.array([*guess, np.hypot(noise * spread / ((white - black) * area), _FLOOR), area])


def _perspective_offset(homography, xy, radius):
    """Centre of the ellipse less the circle's centre (N, 2) px, under a homography.

    The dual conic of the circle, diag(r², r², 0) - c c^T, maps to H D H^T, whose last column is the ellipse's centre
    (Heikkila and Silven 1997, equation 11).
    """
    centre = np.column_stack([xy, np.ones(len(xy))])
    dual = -centre[:, :, None] * centre[:, None]
    dual[:, 0, 0] += radius**2
    dual[:, 1, 1] += radius**2
    mapped = homography @ dual @ homography.T
    return mapped[:, :2, 2] / mapped[:, 2:, 2] - homography_pixels(homography, xy)[0]
