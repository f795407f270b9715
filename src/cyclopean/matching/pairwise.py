"""Matchers of one rectified pair: the contract that any of them fulfils, and OpenCV's as one of them."""

from __future__ import annotations

from typing import Literal, Protocol

import numpy as np

from ..errors import SetupError, ShapeError
from ..geometry import white_level


class PairMatcher(Protocol):
    """What finds disparities in a rectified pair: any callable of this signature, a function of yours included."""

    def __call__(self, left: np.ndarray, right: np.ndarray, disparities: int, /) -> np.ndarray:
        """Disparities of the left picture.

        Parameters
        ----------
        left, right : (h, w) or (h, w, 3) uint8 or uint16 arrays
            The rectified pictures, grey or RGB, x along the baseline. What the left one shows at (x, y) the right one
            shows at (x - disparity, y). Both may show something else beside the view, and black where there is
            nothing; depth there is not used. The arrays are the matcher's own: it may write into them.
        disparities : int
            How many to try, a multiple of 16: the true ones lie between 0 and disparities - 1.

        Returns
        -------
        (h, w) array of real numbers
            Disparity, px of the pictures. Unknown are NaN and all that lies below 0 or above disparities - 1.
        """
        ...


def sgbm(block: int = 5, mode: Literal["sgbm", "3way", "hh"] = "sgbm", grey: bool = False) -> PairMatcher:
    """OpenCV's semi-global matcher, as someone who knows it well would set it.

    Parameters
    ----------
    block : int
        Side of the matched block, px, odd.
    mode : "sgbm", "3way" or "hh"
        Five directions of aggregation, three (the fastest), or all eight (needs much memory).
    grey : bool
        Match the grey picture where there are colours: faster, and less exact.

    Returns
    -------
    PairMatcher
        Its disparities are multiples of 1/16 px.

    Notes
    -----
    The customary numbers: P1 and P2 8 and 32 times the block's pixels and channels, a left-right check to 1 px, a
    margin of 10 % over the second best, specks of fewer than 100 px taken out. The prefilter cap of 127 was tried
    out to its advantage. Pictures of 16 bits are matched as 8 bits, which is all that it takes.

    References
    ----------
    Hirschmueller 2008, Stereo processing by semiglobal matching and mutual information.
    """
    import cv2

    modes = {
        "sgbm": cv2.StereoSGBM_MODE_SGBM,
        "3way": cv2.StereoSGBM_MODE_SGBM_3WAY,
        "hh": cv2.StereoSGBM_MODE_HH,
    }
    if mode not in modes:
        raise SetupError(f"the mode of OpenCV's matcher is one of {', '.join(modes)}, got {mode!r}")
    if block % 2 != 1 or not 1 <= block <= 31:
        raise SetupError(f"the block of OpenCV's matcher is an odd number of px from 1 to 31, got {block}")

    def match(left, right, disparities):
        pictures = _eight_bits(left, right)
        if grey and left.ndim == 3:
            pictures = [cv2.cvtColor(picture, cv2.COLOR_RGB2GRAY) for picture in pictures]
        weight = block**2 * (pictures[0].shape[2] if pictures[0].ndim == 3 else 1)
        matcher = cv2.StereoSGBM.create(
            minDisparity=0,
            numDisparities=disparities,
            blockSize=block,
            P1=8 * weight,
            P2=32 * weight,
            disp12MaxDiff=1,
            preFilterCap=127,
            uniquenessRatio=10,
            speckleWindowSize=100,
            speckleRange=2,
            mode=modes[mode],
        )
        found = matcher.compute(*pictures)
        return np.where(found >= 0, found / np.float32(16), np.float32(np.nan))

    return match


def as_disparity(found: object, shape: tuple[int, int], disparities: int) -> np.ndarray:
    """What a matcher returned as an array (h, w) float32 with NaN where it knows nothing.

    Raises
    ------
    ShapeError
        Where it is no array of real numbers of this shape.
    """
    try:
        array = np.asarray(found)
    except (TypeError, ValueError) as error:  # rows of many lengths, or a tensor that lies elsewhere
        raise ShapeError(f"it must return an array of shape {shape}, got {type(found).__name__}: {error}") from None
    if array.dtype == object:
        raise ShapeError(f"it must return an array of shape {shape}, got {type(found).__name__}")
    if array.shape != shape:
        hint = "; did it return the transpose?" if array.shape == shape[::-1] else ""
        raise ShapeError(f"it must return an array of shape {shape}, one disparity a pixel, got {array.shape}{hint}")
    if array.dtype.kind != "f":
        hint = "; OpenCV's matchers give 16 times the disparity as int16" if array.dtype == np.int16 else ""
        raise ShapeError(f"it must return real numbers (float32), NaN where unknown, got {array.dtype}{hint}")
    with np.errstate(invalid="ignore", over="ignore"):
        array = array.astype(np.float32, copy=False)
        return np.where((array >= 0) & (array <= disparities - 1), array, np.float32(np.nan))


def _eight_bits(left, right):
    """Both pictures as uint8, by the same scale."""
    if left.dtype == np.uint8:
        return [left, right]
    scale = np.float32(255 / max(white_level(left), white_level(right)))
    return [np.clip(picture.astype(np.float32) * scale + 0.5, 0, 255).astype(np.uint8) for picture in (left, right)]
