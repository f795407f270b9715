"""From a few points of a board to all of its corners: foretell, look, and believe only what looks right.

Through glass the map from board to picture is smooth but no homography. So it is taken as a homography plus a
correction that is fitted anew around each place, and corners are sought outwards from what is known.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .boards import Board
from .corners import CornerFits, Surroundings, fit_corners
from .curvature import straightened

_AHEAD = 1.7  # squares beyond what is known that are foretold
_ROUNDS = 25
_TRIES = 3  # times that a corner is looked for, each from a better guess
_EXPLAINED = 0.85  # least share of a window's variance that a true corner's model explains
_TURNED = np.deg2rad(12)  # largest departure of an edge from its foretold direction
_FAINT = 0.35  # least contrast, of the view's median
_BLURRED = 0.3  # px, largest standard deviation of a corner that is kept


@dataclass(frozen=True, eq=False)
class Found:
    """Points of a board in a picture; N rows."""

    points: np.ndarray  # (N,) int
    pixels: np.ndarray  # (N, 2) px
    sigma: np.ndarray  # (N,) px

    def rows(self, rows: np.ndarray) -> Found:
        """Some of them."""
        return Found(self.points[rows], self.pixels[rows], self.sigma[rows])


NOTHING = Found(np.zeros(0, int), np.zeros((0, 2)), np.zeros(0))


class LocalMap:
    """Pixels of points of the board near known ones: homography, and a local linear correction.

    Parameters
    ----------
    xy : (N, 2) array
        Known points, mm, N > 3, not on a line.
    pixels : (N, 2) array
        Where they are, px.
    reach : float
        mm, standard deviation of the Gaussian weight around each place asked for.
    """

    def __init__(self, xy: np.ndarray, pixels: np.ndarray, reach: float):
        import cv2

        self.xy, self.pixels, self.reach = xy, pixels, reach
        self.homography, _ = cv2.findHomography(xy, pixels)
        if self.homography is None:
            raise np.linalg.LinAlgError("points on a line")
        self.rest = pixels - homography_pixels(self.homography, xy)[0]

    def __call__(self, xy: np.ndarray, without_itself: bool = False) -> tuple[np.ndarray, np.ndarray]:
        """Pixels (M, 2) of points (M, 2) mm, and px per mm there (M, 2, 2); without a known point's own pixel."""
        pixels, jacobians = homography_pixels(self.homography, xy)
        apart = (self.xy - xy[:, None]) / self.reach
        squares = (apart**2).sum(-1)
        weights = np.exp(-0.5 * squares) + 1e-12
        if without_itself:
            weights[squares < 1e-12] = 0
        terms = np.concatenate([np.ones((*apart.shape[:2], 1)), apart], axis=-1)
        weighted = np.swapaxes(terms * weights[..., None], 1, 2)
        total = weights.sum(1)[:, None, None]
        stiff = np.diag([1e-9, 0.02, 0.02])  # few neighbours on one side say little about slopes
        correction = np.linalg.solve(weighted @ terms / total + stiff, weighted @ self.rest / total)
        return pixels + correction[:, 0], jacobians + np.swapaxes(correction[:, 1:], 1, 2) / self.reach


def homography_pixels(homography: np.ndarray, xy: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Pixels (..., 2) of points (..., 2) under a homography, NaN behind it, and their derivatives (..., 2, 2)."""
    mapped = xy @ homography[:, :2].T + homography[:, 2]
    depth = np.where(mapped[..., 2:] > 0, mapped[..., 2:], np.nan)
    pixels = mapped[..., :2] / depth
    return pixels, (homography[:2, :2] - pixels[..., None] * homography[2, :2]) / depth[..., None]


def grow(
    image: np.ndarray,
    valid: np.ndarray,
    board: Board,
    xy: np.ndarray,
    pixels: np.ndarray,
    around: Surroundings | None = None,
) -> Found:
    """Find all corners of a board, given some points of it.

    Parameters
    ----------
    image : (H, W) array
        Brightness.
    valid : (H, W) array of bool
        Pixels that belong to the view.
    board : Board
        Its points are the corners sought; nothing else is ever returned.
    xy, pixels : (N, 2) arrays
        Points of the board (mm) and roughly where they are (px), wrong ones taken out.
    around : Surroundings, optional
        What lies around the corners, if not `board.surroundings`.

    Returns
    -------
    Found
        Corners that look as they should, where their neighbours say they should be.
    """
    search = _Search(image, valid, board, around or board.surroundings)
    try:
        for _ in range(_ROUNDS):
            found = search.found
            known = (xy, pixels) if found.sum() < 8 else (search.places[found], search.fits[found, :2])
            if not search.look(LocalMap(known[0], known[1], 2.5 * board.square), known[0]):
                break
        return search.believed()
    except np.linalg.LinAlgError:
        return NOTHING


class _Search:
    """Corners found so far."""

    def __init__(self, image, valid, board, around):
        self.image, self.valid, self.around = image, valid, around
        self.places, self.square = board.points[:, :2], board.square
        self.fits = np.full((len(self.places), 6), np.nan)  # columns of CornerFits, the last but one left out
        self.found = np.zeros(len(self.places), bool)
        self.tries = np.zeros(len(self.places), int)
        self.slack = 0.15  # squares; after the first round 0.08

    def look(self, local: LocalMap, xy: np.ndarray) -> bool:
        """One round: look at the corners next to known points; whether there may be more."""
        near = np.linalg.norm(self.places[:, None] - xy, axis=-1).min(1) < _AHEAD * self.square
        rows = np.flatnonzero(near & ~self.found & (self.tries < _TRIES))
        guesses, jacobians = local(self.places[rows])
        place = np.nan_to_num(np.rint(guesses), nan=-1).astype(int)
        inside = ((place >= 0) & (place < self.valid.shape[::-1])).all(-1)
        inside[inside] = self.valid[place[inside, 1], place[inside, 0]]
        rows, guesses, jacobians = rows[inside], guesses[inside], jacobians[inside]
        if not rows.size:
            return False
        fits = fit_corners(self.image, self.valid, guesses, jacobians, self.around.rows(rows))
        side = np.sqrt(np.abs(np.linalg.det(jacobians))) * self.square
        good = self._looks_right(fits, np.linalg.norm(fits.pixels - guesses, axis=-1), side)
        self.tries[rows] += 1
        self.found[rows[good]] = True
        self.fits[rows[good]] = np.column_stack([fits.pixels, fits.sigma, fits.contrast, fits.explained, side])[good]
        self.slack = 0.08
        return bool(good.any()) or bool((self.tries[rows] == 1).any())

    def _looks_right(self, fits: CornerFits, moved, side):
        """Which fits are corners of the board: in place, upright, black and white as they should be, and sharp."""
        seen = np.concatenate([self.fits[self.found, 3], fits.contrast[fits.explained > _EXPLAINED]])
        contrast = np.median(seen) if seen.size else np.inf
        with np.errstate(invalid="ignore"):
            good = (fits.explained > _EXPLAINED) & (fits.turned < _TURNED) & (fits.sigma < _BLURRED)
            good &= (moved < np.maximum(1.0, self.slack * side)) & (fits.blur < 0.3 * side)
            return good & (fits.contrast > _FAINT * max(contrast, 0.0))

    def believed(self) -> Found:
        """The corners that agree with their neighbours."""
        rows = np.flatnonzero(self.found)
        if len(rows) > 5:
            pixels = self.fits[rows, :2]
            foretold, _ = LocalMap(self.places[rows], pixels, reach=1.5 * self.square)(self.places[rows], True)
            apart = np.linalg.norm(pixels - foretold, axis=-1)
            limit = np.maximum(6 * 1.4826 * np.median(apart), 0.02 * self.fits[rows, 5]) + 5 * self.fits[rows, 2]
            unlike = 1 - self.fits[rows, 4]  # share of the variance left unexplained: large where half is hidden
            rows = rows[(apart < np.maximum(limit, 0.3)) & (unlike < 0.02 + 5 * np.median(unlike))]
        places, around = self.places[rows], self.around.rows(rows)
        return Found(
            rows, *straightened(self.image, self.valid, places, self.fits[rows, :2], self.fits[rows, 2], around)
        )
