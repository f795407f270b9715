"""Depth the usual way, as a peer: virtual pinhole cameras, rectification and OpenCV's semi-global matcher.

What someone who knows OpenCV well gets from the same photograph and the same setup. A pinhole stands for each
view. Each ordered pair of views is rectified by a rotation that the two share, x along their baseline
whichever way that points, so that the first is always the left one, with one focal length; the pictures are
cut so that no pixel of the first view is lost. Disparities become pairs of pixels of the photograph, and those
become depth in two ways: with the pinholes, and with the exact rays.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from scipy.optimize import least_squares

from cyclopean import Rays
from cyclopean.geometry import Pose, nearest_point
from cyclopean.rigs import View, fit

SAMPLES, DEPTHS = 24, 5  # samples across a sub-image, and depths, that a pinhole is fitted to
RIM = 8  # px around each rectified picture, for the matcher's windows


@dataclass(frozen=True, eq=False)
class Pinhole:
    """A camera of OpenCV's that stands for a view."""

    matrix: np.ndarray  # (3, 3) px
    distortion: np.ndarray  # (14,) in OpenCV's order
    camera_from_rig: Pose

    @property
    def centre(self) -> np.ndarray:
        """Optical centre (3,) mm in the rig frame."""
        return self.camera_from_rig.inverse.translation

    @property
    def axis(self) -> np.ndarray:
        """Direction (3,) of the optical axis in the rig frame."""
        return self.camera_from_rig.rotation[2]

    def project(self, points: np.ndarray) -> np.ndarray:
        """Pixels (..., 2) of points (..., 3) mm in the rig frame."""
        local = (self.camera_from_rig @ points).reshape(-1, 3)
        pixels = cv2.projectPoints(local, np.zeros(3), np.zeros(3), self.matrix, self.distortion)[0]
        return pixels.reshape(*points.shape[:-1], 2)

    def rays(self, pixels: np.ndarray) -> Rays:
        """Rays (N,) of pixels (N, 2) in the rig frame."""
        pixels = np.asarray(pixels, dtype=float)
        criteria = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_COUNT, 100, 1e-12)
        slopes = cv2.undistortPoints(pixels[:, None], self.matrix, self.distortion, criteria=criteria)[:, 0]
        directions = np.concatenate([slopes, np.ones((len(pixels), 1))], axis=-1) @ self.camera_from_rig.rotation
        directions /= np.linalg.norm(directions, axis=-1, keepdims=True)
        return Rays(np.broadcast_to(self.centre, directions.shape), directions)


def pinhole(view: View, depths: tuple[float, float]) -> Pinhole:
    """The pinhole that fits the true rays of a view best, in px, between two depths (mm).

    It has OpenCV's radial, tangential, thin-prism and tilt terms: a wedge shears the picture, and only the
    last two can follow that. The rational terms are left out, which add nothing here but folds.
    """
    x, y, width, height = view.region.box
    step = max(width, height) / SAMPLES
    pixels = np.stack(np.meshgrid(np.arange(x, x + width, step), np.arange(y, y + height, step)), -1).reshape(-1, 2)
    pixels = pixels[view.region.contains(pixels)]
    rays = view.rays(pixels)
    points = np.concatenate([rays.at_depth(1 / w) for w in np.linspace(1 / depths[1], 1 / depths[0], DEPTHS)])
    pixels = np.tile(pixels, (DEPTHS, 1))
    start = fit(view, depths)
    free = np.delete(np.arange(24), [15, 16, 17])  # not k4, k5, k6
    turn = cv2.Rodrigues(start.camera_from_rig.rotation)[0].ravel()
    first = np.concatenate([turn, start.camera_from_rig.translation, start.camera.lens, np.zeros(9)])
    scale = np.repeat([1e-3, 1.0, 10.0, 0.1], [3, 3, 4, 11])

    def unpacked(change):
        x = first.copy()
        x[free] += change * scale
        return x[:3], x[3:6], np.array([[x[6], 0, x[8]], [0, x[7], x[9]], [0, 0, 1]]), x[10:]

    def miss(change):
        return (cv2.projectPoints(points, *unpacked(change))[0][:, 0] - pixels).ravel()

    def derivatives(change):
        return cv2.projectPoints(points, *unpacked(change))[1][:, free] * scale

    found = least_squares(miss, np.zeros(len(free)), derivatives, method="lm", max_nfev=200)
    turn, shift, matrix, distortion = unpacked(found.x)
    return Pinhole(matrix, distortion, Pose(cv2.Rodrigues(turn)[0], shift))


@dataclass(frozen=True, eq=False)
class Picture:
    """One side of a rectified pair: a part of the plane at unit distance, turned, in px."""

    view: View
    camera: Pinhole
    rotation: np.ndarray  # (3, 3) rectified frame <- rig frame
    focal: float  # px
    corner: np.ndarray  # (2,) px, the top-left pixel on that plane

    def places(self, pixels: np.ndarray) -> np.ndarray:
        """Pixels (..., 2) of the photograph -> places (..., 2) in the rectified picture."""
        directions = self.camera.rays(pixels).directions @ self.rotation.T
        return self.focal * directions[..., :2] / directions[..., 2:] - self.corner

    def pixels(self, places: np.ndarray) -> np.ndarray:
        """Places (..., 2) in the rectified picture -> pixels (..., 2) of the photograph."""
        places = np.asarray(places, dtype=float) + self.corner
        directions = np.concatenate([places, np.full((*places.shape[:-1], 1), self.focal)], axis=-1)
        return self.camera.project(self.camera.centre + directions @ self.rotation)

    def maps(self, size: tuple[int, int]) -> np.ndarray:
        """For `cv2.remap`: where each pixel of a picture of (width, height) comes from, (height, width, 2) float32."""
        places = np.stack(np.meshgrid(np.arange(size[0]), np.arange(size[1])), axis=-1)
        return self.pixels(places).astype(np.float32)


@dataclass(frozen=True, eq=False)
class Pair:
    """Two rectified pictures, the second shifted so that the least disparity is about zero."""

    first: Picture
    second: Picture
    maps: tuple[np.ndarray, np.ndarray]  # (h, w, 2) float32 each, for cv2.remap
    count: int  # disparities to try


def rectify(views: Sequence[View], cameras: Sequence[Pinhole], depths: tuple[float, float], focal: float) -> Pair:
    """Rectify two views by a common rotation.

    Parameters
    ----------
    views, cameras : sequences of 2
        The views, the reference first, and the pinholes that stand for them.
    depths : (2,) mm
        Nearest and farthest depth that disparities must cover.
    focal : float
        Focal length of both pictures, px: the photograph's own, or twice that to match at 2x.
    """
    baseline = cameras[1].centre - cameras[0].centre
    right = baseline / np.linalg.norm(baseline)
    down = np.cross(cameras[0].axis + cameras[1].axis, right)
    down /= np.linalg.norm(down)
    rotation = np.array([right, down, np.cross(right, down)])
    first, second = (Picture(view, camera, rotation, focal, np.zeros(2)) for view, camera in zip(views, cameras))
    rows, columns = np.nonzero(views[0].region.mask)
    pixels = np.stack([columns, rows], axis=-1)
    places = first.places(pixels)
    points = np.concatenate([cameras[0].rays(pixels[::50]).at_depth(depth) for depth in depths])
    disparities = focal * np.linalg.norm(baseline) / ((points - cameras[0].centre) @ rotation[2])
    offset = int(np.floor(disparities.min())) - 1
    count = 16 * int(np.ceil((disparities.max() + 1 - offset) / 16))
    corner = np.floor(places.min(axis=0)) - [count + RIM, RIM]
    width, height = (np.ceil(places.max(axis=0)) + RIM + 1 - corner).astype(int)
    first = Picture(first.view, first.camera, rotation, focal, corner)
    second = Picture(second.view, second.camera, rotation, focal, corner - [offset, 0])
    maps = (first.maps((width, height)), second.maps((width, height)))
    return Pair(first, second, maps, count)


def match(photograph: np.ndarray, pair: Pair, block: int = 5) -> np.ndarray:
    """Disparities (h, w) float32 px of the first rectified picture, NaN where the matcher gives none.

    The customary numbers: P1 and P2 8 and 32 times the block's pixels and channels, a left-right check to 1 px,
    a margin of 10 % over the second best, specks of fewer than 100 px taken out. Two choices were tried out to
    its advantage: a prefilter cap of 127, and what lies beyond the seams left in the pictures and taken out of
    the result, not blackened before.
    """
    pictures = [cv2.remap(photograph, maps, None, cv2.INTER_CUBIC) for maps in pair.maps]
    weight = block**2 * (photograph.shape[2] if photograph.ndim == 3 else 1)
    matcher = cv2.StereoSGBM.create(
        minDisparity=0,
        numDisparities=pair.count,
        blockSize=block,
        P1=8 * weight,
        P2=32 * weight,
        disp12MaxDiff=1,
        preFilterCap=127,
        uniquenessRatio=10,
        speckleWindowSize=100,
        speckleRange=2,
        mode=cv2.StereoSGBM_MODE_SGBM,
    )
    found = matcher.compute(*pictures)
    return np.where(found >= 0, found / np.float32(16), np.float32(np.nan))


def partners(pair: Pair, disparity: np.ndarray, pixels: np.ndarray) -> np.ndarray:
    """Where the second view sees what pixels (N, 2) of the first one see: pixels (N, 2), NaN unknown."""
    places = pair.first.places(pixels)
    places[:, 0] -= sampled(disparity, places)
    found = pair.second.pixels(places)
    return np.where(pair.second.view.region.contains(found)[:, None], found, np.nan)


def sampled(disparity: np.ndarray, places: np.ndarray) -> np.ndarray:
    """Disparity at places (N, 2): bilinear where the four around it differ by less than 1 px, else the nearest."""
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


def pinhole_depth(pair: Pair, pixels: np.ndarray, others: np.ndarray) -> np.ndarray:
    """Depths (N,) mm of pairs of pixels by the pinholes."""
    return _crossing(pair.first.camera, pair.second.camera, pixels, others)


def exact_depth(pair: Pair, pixels: np.ndarray, others: np.ndarray) -> np.ndarray:
    """Depths (N,) mm of pairs of pixels by the exact rays."""
    return _crossing(pair.first.view, pair.second.view, pixels, others)


def _crossing(first, second, pixels, others):
    """Depth (N,) of the points nearest to the two rays."""
    rays = [first.rays(pixels), second.rays(others)]
    bundle = Rays(np.stack([r.origins for r in rays], axis=-2), np.stack([r.directions for r in rays], axis=-2))
    return nearest_point(bundle).points[:, 2]
