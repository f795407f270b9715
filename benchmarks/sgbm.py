"""Depth the usual way, as a peer: virtual pinhole cameras, rectification and OpenCV's semi-global matcher.

What someone who knows OpenCV well gets from the same photograph and the same setup. The pinhole with
distortion that fits each view best stands for it. Each ordered pair of views is rectified by a rotation that
the two share, x along their baseline whichever way it points, so that the first is always the left one, with
one focal length; the pictures are cut so that no pixel of the first view is lost. Disparities become pairs
of pixels of the photograph, and those become depth in two ways: with the pinholes, and with the exact rays.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from cyclopean import Rays, Rig
from cyclopean.geometry import nearest_point
from cyclopean.rigs import View, VirtualCamera

RIM = 8  # px around each rectified picture, for the matcher's windows


@dataclass(frozen=True, eq=False)
class Picture:
    """One side of a rectified pair: a part of the plane at unit distance, turned, in px."""

    view: View
    camera: VirtualCamera
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

    def maps(self, size: tuple[int, int]) -> tuple[np.ndarray, np.ndarray]:
        """For `cv2.remap`: maps (h, w, 2) float32, and the mask (h, w) of what belongs to the view."""
        pixels = self.pixels(np.stack(np.meshgrid(np.arange(size[0]), np.arange(size[1])), axis=-1))
        return np.nan_to_num(pixels, nan=-1e4).astype(np.float32), self.view.region.contains(pixels)


@dataclass(frozen=True, eq=False)
class Pair:
    """Two rectified pictures; a disparity of theirs is `offset` more than what the matcher sees."""

    first: Picture
    second: Picture
    size: tuple[int, int]  # (width, height) of both pictures
    offset: int  # px
    count: int  # disparities to try


def rectify(views: Sequence[View], cameras: Sequence[VirtualCamera], depths: tuple[float, float], focal: float) -> Pair:
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
    return Pair(first, second, (int(width), int(height)), offset, count)


def match(photograph: np.ndarray, pair: Pair, block: int = 5) -> np.ndarray:
    """Disparities (h, w) float32 px of the first rectified picture, NaN where the matcher gives none.

    The customary numbers: P1 and P2 8 and 32 times the block's pixels and channels, a left-right check to 1 px,
    a margin of 10 % over the second best, specks of fewer than 100 px taken out.
    """
    pictures = []
    for picture in (pair.first, pair.second):
        maps, mask = picture.maps(pair.size)
        warped = cv2.remap(photograph, maps, None, cv2.INTER_CUBIC)
        warped[~mask] = 0
        pictures.append(warped)
    weight = block**2 * pictures[0].shape[2]
    matcher = cv2.StereoSGBM.create(
        minDisparity=0,
        numDisparities=pair.count,
        blockSize=block,
        P1=8 * weight,
        P2=32 * weight,
        disp12MaxDiff=1,
        preFilterCap=63,
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


def virtual_cameras(rig: Rig, depths: tuple[float, float]) -> list[VirtualCamera]:
    """The pinhole with distortion that fits each view best between two depths."""
    from cyclopean.rigs import fit

    return [fit(view, depths) for view in rig]


def _crossing(first, second, pixels, others):
    """Depth (N,) of the points nearest to the two rays."""
    rays = [first.rays(pixels), second.rays(others)]
    bundle = Rays(np.stack([r.origins for r in rays], axis=-2), np.stack([r.directions for r in rays], axis=-2))
    return nearest_point(bundle).points[:, 2]
