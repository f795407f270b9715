"""The windows around corners: how far a photograph's picture is shifted from the one expected."""

from __future__ import annotations

import cv2
import numpy as np

from ..errors import ImageError
from .photometric_picture import predict_picture

BLUR = 0.6  # px, standard deviation of a lens's point-spread function to start from
_BORDER = 3  # px beside a seam's margin that blur brings into the picture
_ALIKE = 0.8  # least share of a window's variance that the board must explain
_SIMILAR = 0.5  # the same while the print may still stand elsewhere
_FULL = 0.5  # least share of a window that must be seen
_FAR = 0.7  # px: a window that moves so far in the last pass has not been found
_WORST = 0.05  # px, standard deviation of a corner that still counts
_FEWEST = 4  # corners from which the print is moved
_AROUND = 5  # px on all sides of a corner that must be seen
_MOST = 20_000  # pixels of a window that are used
_COARSE = 800  # the same in blurred pictures
_LEAST = 60  # pixels of a window that must be seen
_RAYLEIGH_MEDIAN = 1.1774  # median length of a 2-vector of unit normal deviates
_GROUP = 4  # px: residuals nearer to each other than this may be alike


def grey(photograph: np.ndarray, size: tuple[int, int]) -> np.ndarray:
    """Luminance (H, W) float32 of a photograph, NaN where it is clipped to black or white."""
    image = np.asarray(photograph)
    if image.ndim not in (2, 3) or image.shape[:2] != size[::-1]:
        raise ImageError(f"the photograph must be {size[0]} x {size[1]} px like the camera's, got shape {image.shape}")
    flat = image if image.ndim == 2 else image[..., :3].min(-1)
    top = image if image.ndim == 2 else image[..., :3].max(-1)
    whole = np.issubdtype(image.dtype, np.integer)
    peak = int(top.max()) + 1 if whole else 0
    clipped = flat <= 0
    if whole and peak >= 256 and peak & (peak - 1) == 0:  # a full range of 8, 10, 12 ... bits
        clipped |= top >= peak - 1
    if image.ndim == 3:
        image = image[..., 0] if image.shape[2] < 3 else image[..., :3] @ np.array([0.299, 0.587, 0.114])  # BT.601
    return np.where(clipped, np.nan, image).astype(np.float32)


class Field:
    """A smooth field of shifts: a polynomial in the pixel, of as high a degree as the corners carry."""

    def __init__(self, pixels, shifts, weights, highest=3):
        count = len(pixels)
        self.centre, self.scale = pixels.mean(0), max(float(np.ptp(pixels, axis=0).max()) / 2, 1.0)
        degree = min(highest, 3 if count >= 30 else 2 if count >= 15 else 1 if count >= 6 else 0)
        self.powers = [(i, j) for i in range(degree + 1) for j in range(degree + 1 - i)]
        self.factors = np.zeros((len(self.powers), 2))
        for _ in range(4):  # Cauchy weights against single wrong corners
            root = np.sqrt(weights)[:, None]
            self.factors = np.linalg.lstsq(self._terms(pixels) * root, shifts * root, rcond=1e-9)[0]
            miss = np.linalg.norm(shifts - self(pixels), axis=-1)
            scale = max(float(np.median(miss)) / 1.18, 1e-3)
            weights = 1 / (1 + (miss / (3 * scale)) ** 2)

    def _terms(self, pixels):
        x, y = np.moveaxis((pixels - self.centre) / self.scale, -1, 0)
        return np.stack([x**i * y**j for i, j in self.powers], -1)

    def __call__(self, pixels):
        """Shifts (..., 2) at pixels (..., 2), those of the nearest place that the corners surround."""
        near = np.clip(pixels, self.centre - 1.6 * self.scale, self.centre + 1.6 * self.scale)
        return self._terms(near) @ self.factors


class Sheet:
    """The board as one view of one photograph shows it."""

    def __init__(self, picture, view, pose, board, photo, number):
        self.pose, self.board, self.photo, self.number = pose, board, photo, number
        self.free = view.unbounded()
        self.field: Field | None = None
        x, y, width, height = view.region.box
        corners = np.array([[0, 0], [board.columns, 0], [board.columns, board.rows], [0, board.rows]]) * board.square
        outline = self.free.project(pose @ np.pad(corners, ((0, 0), (0, 1))))
        if np.isfinite(outline).all():  # only that part of the view where the board is
            low, high = np.floor(outline.min(0) - 8).astype(int), np.ceil(outline.max(0) + 8).astype(int)
            right, bottom = min(x + width, high[0] + 1), min(y + height, high[1] + 1)
            x, y = max(x, low[0]), max(y, low[1])
            width, height = max(right - x, 0), max(bottom - y, 0)
        self.box = (x, y, width, height)
        crop = np.s_[y : y + height, x : x + width]
        self.picture, mask = picture[crop], view.region.mask
        border = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * _BORDER + 1, 2 * _BORDER + 1))
        mask = cv2.erode(mask.astype(np.uint8), border, borderValue=1)[crop] > 0
        self.mask, self.usable = mask, mask & np.isfinite(self.picture)
        around = np.ones((2 * _AROUND + 1, 2 * _AROUND + 1), np.uint8)
        self.clear = cv2.erode(mask.astype(np.uint8), around, borderValue=0) > 0
        self.near = cv2.dilate(self.usable.astype(np.uint8), np.ones((5, 5), np.uint8)) > 0
        self.picture = np.where(np.isfinite(self.picture), self.picture, 0.0).astype(np.float32)
        self.places = np.asarray(board.points, dtype=float)[:, :2]
        self.expected = self.free.project(pose @ np.asarray(board.points, dtype=float))
        inside = np.isfinite(self.expected).all(-1) & (width * height > 0)
        inside &= ((self.expected >= [x, y]) & (self.expected < [x + width, y + height])).all(-1)
        self.points = np.flatnonzero(inside)
        self.result = np.full((len(self.places), 7), np.nan)  # shift x, y; covariance xx, xy, yy; likeness; widening
        self.moved, self.widening = np.inf, np.nan
        self.scatter = 1.0  # how much more the corners scatter about a smooth field than their windows explain

    def follow(self, points, pixels, sigma, highest=3):
        """Move the print to where points are seen; returns the number of terms of the field."""
        good = np.isfinite(self.expected[points]).all(-1)
        if not good.any():
            return 0
        self.field = Field(pixels[good], (pixels - self.expected[points])[good], 1 / sigma[good] ** 2, highest)
        return len(self.field.powers)

    def corners(self):
        """Where the points (P, 2) are seen, as far as is known."""
        if self.field is None:
            return self.expected
        pixels = self.expected
        for _ in range(3):  # the field is that of the place where a point is seen
            pixels = self.expected + self.field(pixels)
        return pixels

    def predict(self, drawing, blur):
        """The expected picture."""
        return predict_picture(self.free, self.pose, drawing, self.box[:2], self.near, blur, self.field)

    def run(self, drawing, blur, window, markers, coarse=0.0):
        """Measure all windows, `window` squares wide, and move the print with them.

        `coarse`: blur both pictures by so much of a square, to catch shifts of twice that.
        """
        self.moved = 0.0
        if not self.points.size:
            return
        picture, corners = self.picture, self.corners()
        expected = self.predict(drawing, blur)
        if coarse:
            wide = coarse * self.square_size(corners)
            picture, expected = _blurred(picture, wide), expected.changed(lambda plane: _blurred(plane, wide))
        given = (expected, picture, self.mask, self.usable, self.places, corners, self.points, self.board)
        self.seen_at, self.result = corners, measure(*given, window, markers, _COARSE if coarse else _MOST)
        self.result[~self.is_clear(corners)] = np.nan
        good = self.good(2 * wide, wide, _SIMILAR) if coarse else self.good()
        if good.sum() < _FEWEST:
            return
        result = self.result[good]
        self.widening = float(np.median(result[:, 6]))
        sigma = np.sqrt(result[:, 2] + result[:, 4])
        found = corners[good] + result[:, :2]
        terms = self.follow(np.flatnonzero(good), found, sigma, 1 if coarse else 3)
        after = self.corners()[good]
        self.moved = float(np.sqrt(np.mean((after - corners[good]) ** 2)))
        ratio = np.linalg.norm(found - after, axis=-1) / sigma
        freedom = np.sqrt(max(1 - terms / len(ratio), 0.1))
        self.scatter = max(float(np.median(ratio)) / _RAYLEIGH_MEDIAN * np.sqrt(2) / freedom, 1.0)

    def is_clear(self, corners):
        """(P,) bool: whether the view shows what is around each corner."""
        x, y, width, height = self.box
        column, row = np.rint(np.nan_to_num(corners, nan=-1e6) - [x, y]).astype(int).T
        inside = (column >= 0) & (column < width) & (row >= 0) & (row < height)
        return inside & self.clear[np.where(inside, row, 0), np.where(inside, column, 0)]

    def square_size(self, corners):
        """Side of a square, px, typically."""
        columns = self.board.columns - 1
        steps = np.linalg.norm(np.diff(corners.reshape(-1, columns, 2), axis=1), axis=-1)
        return float(np.nanmedian(steps)) if np.isfinite(steps).any() else 10.0

    def good(self, far=_FAR, worst=_WORST, alike=_ALIKE):
        """(P,) bool: which windows look like the board, and say where the corner is."""
        shift = np.linalg.norm(self.result[:, :2], axis=-1)
        xx, xy, yy = self.result[:, 2:5].T
        deviation = np.sqrt((xx + yy) / 2 + np.hypot((xx - yy) / 2, xy))  # in the direction that is known worst
        return (self.result[:, 5] >= alike) & (shift < far) & (deviation < worst)

    def rows(self):
        """Photo, view, point, pixels, sigma and likeness of the corners that were found."""
        found = np.flatnonzero(self.good())
        result = self.result[found]
        pixels = self.seen_at[found] + result[:, :2] if found.size else np.zeros((0, 2))
        sigma = np.sqrt((result[:, 2] + result[:, 4]) / 2) * self.scatter
        return np.full(found.size, self.photo), np.full(found.size, self.number), found, pixels, sigma, result[:, 5]


def measure(expected, picture, mask, usable, places, corners, points, board, window, markers, most=_MOST):
    """Shift, covariance, likeness and widening (P, 7) of the window around each of `points`; NaN where none is found.

    Without `markers`, pixels nearer to the edges of markers than to those of the squares do not count. At most
    `most` pixels of each window are used.
    """
    result = np.full((len(places), 7), np.nan)
    half = window / 2 * board.square
    laplacian = cv2.Laplacian(expected.values, cv2.CV_32F)
    limit = -1.0 if markers or not board.marker else (board.square + board.marker) / 4
    reach = 1.5 * half * _pixels_per_mm(expected) + 3
    end = np.array([[[board.columns]], [[board.rows]]]) * board.square
    for point in points:
        x, y = corners[point] - expected.corner
        rows = slice(max(int(y - reach), 0), max(int(y + reach) + 2, 0))
        columns = slice(max(int(x - reach), 0), max(int(x + reach) + 2, 0))
        board_place = expected.board[:, rows, columns].astype(float)
        inside = np.abs(board_place - places[point][:, None, None]).max(0) <= half
        if limit > 0:
            inside &= np.abs(np.mod(board_place, board.square) - board.square / 2).max(0) > limit
        seen = inside & mask[rows, columns] & ((board_place > 0) & (board_place < end)).all(0)
        mine = seen & usable[rows, columns]
        if seen.sum() < _FULL * inside.sum() or mine.sum() < _LEAST:
            continue
        at = np.nonzero(mine)
        if at[0].size > most:
            at = tuple(axis[:: -(-axis.size // most)] for axis in at)
        fields = (picture, expected.values, *expected.slopes, laplacian)
        result[point] = _shift(*(field[rows, columns][at] for field in fields), *at)
    return result


def _blurred(plane, sigma):
    return cv2.GaussianBlur(plane, (0, 0), sigma, borderType=cv2.BORDER_REPLICATE)


def _pixels_per_mm(expected):
    step = np.abs(np.diff(expected.board[:, ::16, ::16], axis=2))
    step = np.hypot(step[0], step[1])
    step = step[np.isfinite(step) & (step > 0)]
    return 16 / float(np.median(step)) if step.size else 1.0


def _shift(picture, values, slope_x, slope_y, laplacian, rows, columns):
    """Shift, covariance, likeness and widening (7,) of one window of n pixels.

    The picture is gain * values(moved) + offset with gain and offset that change linearly across the window, an
    unknown widening of the blur, and edges moved towards the dark by an unknown bleed of the print.
    """
    x, y = columns - columns.mean(), rows - rows.mean()
    x, y = x / max(np.abs(x).max(), 1), y / max(np.abs(y).max(), 1)
    steep, one = np.hypot(slope_x, slope_y), np.ones_like(values)
    terms = [slope_x, slope_y, values, one, laplacian, steep, x, y, x * values, y * values]
    terms = np.stack(terms, 1).astype(float)
    size = np.maximum(np.sqrt((terms**2).mean(0)), 1e-6)
    terms /= size
    normal = terms.T @ terms
    normal[np.diag_indices(len(normal))] += 1e-9 * len(terms)
    try:
        inverse = np.linalg.inv(normal)
    except np.linalg.LinAlgError:
        return np.full(7, np.nan)
    target = picture.astype(float)
    factors = inverse @ (terms.T @ target)
    residual = target - terms @ factors
    gain = factors[2] / size[2]
    spread = ((target - target.mean()) ** 2).sum()
    if not (gain > 0 and spread > 0):
        return np.full(7, np.nan)
    pull = (terms @ inverse[:, :2]) * residual[:, None]  # what each pixel's residual does to the shift
    group = (rows // _GROUP) * (columns.max() // _GROUP + 1) + columns // _GROUP
    pulls = np.stack([np.bincount(group, pull[:, k]) for k in range(2)], 1) / (gain * size[:2])
    covariance = pulls.T @ pulls * len(target) / max(len(target) - len(normal), 1)
    shift = -factors[:2] / size[:2] / gain
    likeness = 1 - (residual**2).sum() / spread
    widening = 2 * factors[4] / size[4] / gain
    return np.array([*shift, covariance[0, 0], covariance[0, 1], covariance[1, 1], likeness, widening])
