"""Two views made into a rectified pair, as matchers of ordinary stereo want it, and disparities made into depth."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ..errors import OpticError, ShapeError
from ..geometry import shortest_segment
from ..rigs import ViewLike
from .pinholes import TiltedPinhole

RIM = 8  # px around each rectified picture, for the matcher's windows
LARGEST = 1e8  # pixels of a rectified picture: 8 bytes of maps for each
LONGEST = 32_000  # px of its sides: OpenCV counts in 16 bits
HARDEST = 4e10  # pixels times disparities of a pair, for OpenCV about ten minutes


@dataclass(frozen=True, eq=False)
class Picture:
    """One side of a rectified pair: a part of the plane at unit distance, turned, in px.

    It shows the scene unmirrored even where the view is mirrored.
    """

    view: ViewLike
    camera: TiltedPinhole
    rotation: np.ndarray  # (3, 3) rectified frame <- rig frame
    focal: float  # px
    corner: np.ndarray  # (2,) px, the top-left pixel on that plane

    def places(self, pixels: np.ndarray) -> np.ndarray:
        """Pixels (..., 2) of the photograph -> places (..., 2) in the rectified picture."""
        directions = self.camera.rays(pixels).directions @ self.rotation.T
        return self.focal * directions[..., :2] / directions[..., 2:] - self.corner

    def pixels(self, places: np.ndarray) -> np.ndarray:
        """Places (..., 2) in the rectified picture -> pixels (..., 2) of the photograph."""
        return self.camera.project(self.camera.centre + self.directions(places) @ self.rotation)

    def directions(self, places: np.ndarray) -> np.ndarray:
        """Directions (..., 3) in the rectified frame that places (..., 2) stand for, not of unit length."""
        places = np.asarray(places, dtype=float) + self.corner
        return np.concatenate([places, np.full((*places.shape[:-1], 1), self.focal)], axis=-1)

    def maps(self, size: tuple[int, int]) -> np.ndarray:
        """For `cv2.remap`: where each pixel of a picture of (width, height) comes from, (height, width, 2) float32."""
        import cv2

        matrix = np.array([[self.focal, 0, -self.corner[0]], [0, self.focal, -self.corner[1]], [0, 0, 1]])
        turn = self.rotation @ self.camera.camera_from_rig.rotation.T @ self.camera.flip
        return cv2.initUndistortRectifyMap(
            self.camera.matrix, self.camera.distortion, turn, matrix, size, cv2.CV_32FC2
        )[0]


@dataclass(frozen=True, eq=False)
class Pair:
    """Two rectified pictures, the second shifted so that the least disparity is about zero.

    A point of the scene lies at (x, y) in the first and, as far as the pinholes fit, at (x - disparity, y) in the
    second, with a disparity between 0 and `count`.
    """

    first: Picture
    second: Picture
    maps: tuple[np.ndarray, np.ndarray]  # (h, w, 2) float32 each, for cv2.remap
    count: int  # disparities to try, a multiple of 16

    @property
    def size(self) -> tuple[int, int]:
        """(width, height) of both pictures, px."""
        height, width = self.maps[0].shape[:2]
        return width, height


def rectify(
    views: Sequence[ViewLike], cameras: Sequence[TiltedPinhole], depths: tuple[float, float], focal: float
) -> Pair:
    """Rectify two views by a common rotation, x along their baseline whichever way that points.

    The first is thus always the left one. The pictures are cut so that no pixel of the first view is lost, and each
    has room on its left for all disparities.

    Parameters
    ----------
    views, cameras : sequences of 2
        The views, the reference first, and the pinholes that stand for them (`tilted_pinhole`).
    depths : (2,) mm
        Nearest and farthest depth that disparities must cover.
    focal : float
        Focal length of both pictures, px: the photograph's own, or twice that to match at 2x.

    Raises
    ------
    OpticError
        Where the views have no baseline across their line of sight, so that no rotation rectifies them, or where the
        pictures would be huge.

    References
    ----------
    Fusiello, Trucco, Verri 2000, A compact algorithm for rectification of stereo pairs.
    """
    rotation, baseline = _common_rotation(views, cameras)
    first, second = (Picture(view, camera, rotation, focal, np.zeros(2)) for view, camera in zip(views, cameras))
    places = first.places(_rim(views[0].region.mask))
    rows, columns = np.nonzero(views[0].region.mask)
    sample = cameras[0].rays(np.stack([columns, rows], axis=-1)[::50])
    ahead = np.concatenate([(sample.at_depth(depth) - cameras[0].centre) @ rotation[2] for depth in depths])
    ahead = ahead[np.isfinite(ahead)]
    if not len(ahead) or ahead.min() <= 0 or not np.isfinite(places).all():
        raise _beyond_rectifying(views)
    disparities = focal * baseline / ahead
    offset = int(np.floor(disparities.min())) - 1
    count = 16 * int(np.ceil((disparities.max() + 1 - offset) / 16))
    corner = np.floor(places.min(axis=0)) - [count + RIM, RIM]
    width, height = (np.ceil(places.max(axis=0)) + RIM + 1 - corner).astype(int)
    if width * height * max(count / HARDEST, 1 / LARGEST) > 1 or max(width, height) > LONGEST:
        raise OpticError(
            f"{_names(views)}, rectified, would be pictures of {width} x {height} px with {count} disparities: state a "
            "farther near depth (--depth) or a smaller --scale; our own matcher needs no rectification"
        )
    first = replace(first, corner=corner)
    second = replace(second, corner=corner - [offset, 0])
    return Pair(first, second, (first.maps((int(width), int(height))), second.maps((int(width), int(height)))), count)


def partners(pair: Pair, disparity: np.ndarray, pixels: np.ndarray) -> np.ndarray:
    """Where the second view sees what pixels of the first one see.

    Parameters
    ----------
    pair : Pair
        The rectified views.
    disparity : (h, w) array
        Disparity of each pixel of the first rectified picture, px; NaN unknown.
    pixels : (N, 2) array
        Pixels of the photograph, in the first view.

    Returns
    -------
    (N, 2) array
        Pixels of the photograph; NaN where nothing is known, or what is known lies outside the second view.
    """
    if disparity.shape != pair.size[::-1]:
        raise ShapeError(f"disparity must have shape {pair.size[::-1]}, that of the pictures, got {disparity.shape}")
    places = pair.first.places(pixels)
    places[:, 0] -= sampled(disparity, places)
    found = pair.second.pixels(places)
    return np.where(pair.second.view.region.contains(found)[:, None], found, np.nan)


def sampled(disparity: np.ndarray, places: np.ndarray) -> np.ndarray:
    """Disparity (N,) at places (N, 2): bilinear where the four around differ by less than 1 px, else the nearest."""
    height, width = disparity.shape
    corner = np.floor(places)
    inside = ((corner >= 0) & (corner < [width - 1, height - 1])).all(axis=-1)
    x, y = np.where(inside[:, None], corner, 0).astype(int).T
    a, b = np.where(inside[:, None], places - corner, 0).T
    four = np.stack([disparity[y, x], disparity[y, x + 1], disparity[y + 1, x], disparity[y + 1, x + 1]])
    between = np.sum(np.stack([(1 - b) * (1 - a), (1 - b) * a, b * (1 - a), b * a]) * four, axis=0)
    nearest = disparity[y + (b >= 0.5), x + (a >= 0.5)]
    smooth = four.max(axis=0) - four.min(axis=0) < 1  # False where any is NaN
    return np.where(inside, np.where(smooth, between, nearest), np.nan)


def exact_depth(pair: Pair, pixels: np.ndarray, others: np.ndarray) -> np.ndarray:
    """Depths (N,) mm of pairs of pixels (N, 2) and (N, 2) by the true rays of the views."""
    return _crossing(pair.first.view, pair.second.view, pixels, others)


def pinhole_depth(pair: Pair, pixels: np.ndarray, others: np.ndarray) -> np.ndarray:
    """Depths (N,) mm of pairs of pixels (N, 2) and (N, 2) by the pinholes, as a user without true rays gets them."""
    return _crossing(pair.first.camera, pair.second.camera, pixels, others)


def per_disparity(pair: Pair, pixels: np.ndarray, depth: np.ndarray) -> np.ndarray:
    """How much inverse depth (N,) 1/mm changes with one px of disparity at pixels (N, 2) with depths (N,) mm.

    By the pinholes: Z = f B / d along the rectified axis, and z of the rig frame is linear in Z along a ray.
    """
    baseline = np.linalg.norm(pair.second.camera.centre - pair.first.camera.centre)
    directions = pair.first.camera.rays(pixels).directions
    slope = directions[:, 2] / (directions @ pair.first.rotation[2])  # of z along Z
    ahead = (depth - pair.first.camera.centre[2]) / slope
    return np.abs(ahead**2 * slope) / (pair.first.focal * baseline * depth**2)


def _crossing(first, second, pixels, others):
    """Depth (N,) of the points nearest to the two rays; NaN where they part."""
    rays = first.rays(pixels), second.rays(others)
    ends = shortest_segment(*rays)
    ahead = [((end - ray.origins) * ray.directions).sum(-1) > 0 for end, ray in zip(ends, rays)]
    return np.where(np.logical_and(*ahead), (ends[0][:, 2] + ends[1][:, 2]) / 2, np.nan)


def _common_rotation(views, cameras):
    """Rotation (3, 3) rectified frame <- rig frame, and the length of the baseline, mm."""
    baseline = cameras[1].centre - cameras[0].centre
    length = float(np.linalg.norm(baseline))
    axes = cameras[0].axis + cameras[1].axis
    right = baseline / max(length, 1e-300)
    down = np.cross(axes, right)
    if np.linalg.norm(down) < 0.1 * np.linalg.norm(axes) or length < 1e-6:
        raise _beyond_rectifying(views)
    down /= np.linalg.norm(down)
    return np.array([right, down, np.cross(right, down)]), length


def _rim(mask):
    """Pixels (N, 2) of a mask (H, W) beside others: the outermost places in any picture are among them."""
    inner = np.zeros_like(mask)
    inner[1:-1, 1:-1] = mask[1:-1, 1:-1] & mask[:-2, 1:-1] & mask[2:, 1:-1] & mask[1:-1, :-2] & mask[1:-1, 2:]
    return np.argwhere(mask & ~inner)[:, ::-1]


def _beyond_rectifying(views):
    return OpticError(
        f"{_names(views)} cannot be rectified: one stands before the other, or they look apart; our own matcher needs "
        "no rectification"
    )


def _names(views):
    return f"{views[0].name or 'one view'} and {views[1].name or 'another'}"
