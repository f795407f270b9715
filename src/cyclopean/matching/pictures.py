"""A photograph made ready for matching: each view's part of it, at several scales."""

from dataclasses import dataclass

import cv2
import numpy as np
from numba import njit, prange

from ..errors import ImageError
from ..geometry import white_level
from .places import ALONE, FAST

RIM = 4  # px around each picture that belong to no view
GREY = 128  # grey level that becomes 0: sums of products stay small
_BLUR = 0.6  # px: without it, noise passes for texture
_SEARCH_BLUR = 0.9  # px: for the search, where the nearest pixel is taken
_EVERY = 64  # px between the rows and columns in which texture is looked for
_POLE = np.sqrt(3) - 2  # of the filter that turns samples into B-spline coefficients
_REACH = 7  # px of that filter; what is cut off is 1e-4


@dataclass(frozen=True, eq=False)
class Layout:
    """Where the pictures of all views at one scale lie, one after the other in flat arrays.

    Pixel (i, j) of a view's picture is pixel (left, top) + (i, j) / scale of the photograph. Around each lies a rim
    of pixels that belong to no view.
    """

    starts: np.ndarray  # (V + 1,) int64, where each view's picture begins
    frames: np.ndarray  # (V, 5) float32: left, top, width, height, scale
    weights: np.ndarray  # (N,) float32: 1 where a pixel belongs to the view, else 0
    hidden: np.ndarray  # (N,) float32: 0 where a pixel belongs to the view, else NaN

    @property
    def scale(self) -> float:
        """Pixels for one of the photograph."""
        return float(self.frames[0, 4])

    def inner(self, flat: np.ndarray, view: int) -> np.ndarray:
        """The (..., h, w) part of arrays (..., N) that holds one view's box, without the rim; shares memory."""
        width, height = self.frames[view, 2:4].astype(int)
        whole = flat[..., self.starts[view] : self.starts[view + 1]].reshape(*flat.shape[:-1], height, width)
        return whole[..., RIM:-RIM, RIM:-RIM]

    def packed(self, views) -> np.ndarray:
        """Flat float32 (C, N) from the planes (h, w) of each view and channel; rims repeat the pixels beside them."""
        flat = np.empty((len(views[0]), self.starts[-1]), np.float32)
        for view, planes in enumerate(views):
            width, height = self.frames[view, 2:4].astype(int)
            for channel, plane in enumerate(planes):
                whole = flat[channel, self.starts[view] : self.starts[view + 1]].reshape(height, width)
                cv2.copyMakeBorder(np.asarray(plane, np.float32), RIM, RIM, RIM, RIM, cv2.BORDER_REPLICATE, dst=whole)
        return flat


@dataclass(frozen=True, eq=False)
class Pictures:
    """Pictures of all views at one scale."""

    layout: Layout
    values: np.ndarray  # (C, N) float32 grey levels less GREY, or B-spline coefficients of them

    def own(self, view: int) -> np.ndarray:
        """Values (C, h, w) of a view's box."""
        return self.layout.inner(self.values, view)

    @property
    def arrays(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Frames, starts and values, as kernels want them."""
        return self.layout.frames, self.layout.starts, self.values


@dataclass(frozen=True, eq=False)
class Prepared:
    """A photograph ready for matching."""

    search: tuple[Pictures, ...]  # by level: scale 1, 1/2, 1/4 ...; NaN outside of the views
    smooth: tuple[Pictures, ...]  # scales 1 and 1/2, for refinement
    splines: tuple[Pictures, ...]  # cubic B-spline coefficients of `smooth`


def layouts(masks: np.ndarray, levels: int) -> tuple[Layout, ...]:
    """Layouts of the scales 1, 1/2, ... 1/2^(levels - 1) of views with masks (V, H, W) bool."""
    boxes = [box_of(mask) for mask in masks]
    parts = [mask[box].astype(np.float32) for mask, box in zip(masks, boxes, strict=True)]
    result = []
    for level in range(levels):
        scale = 0.5**level
        rimmed = [np.pad(part, RIM) for part in parts]
        frames = [
            (box[1].start - RIM / scale, box[0].start - RIM / scale, part.shape[1], part.shape[0], scale)
            for box, part in zip(boxes, rimmed, strict=True)
        ]
        starts = np.concatenate([[0], np.cumsum([part.size for part in rimmed])])
        weights = np.concatenate([part.ravel() for part in rimmed])
        hidden = np.where(weights > 0, np.float32(0), np.float32(np.nan))
        result.append(Layout(starts, np.array(frames, np.float32), weights, hidden))
        parts = [cv2.erode(part, np.ones((3, 3)))[::2, ::2] if level else part[::2, ::2] for part in parts]
    return tuple(result)


def box_of(mask: np.ndarray) -> tuple[slice, slice]:
    """Rows and columns that a mask covers."""
    rows, columns = np.flatnonzero(mask.any(1)), np.flatnonzero(mask.any(0))
    if len(rows) == 0:
        raise ImageError("a view has no pixels in the photograph")
    return slice(rows[0], rows[-1] + 1), slice(columns[0], columns[-1] + 1)


def grey_levels(image: np.ndarray, channels: int) -> np.ndarray:
    """Scale a picture so that its white level is 255 and bring it to 1 channel (the mean) or all: (C, H, W) float32."""
    image = np.asarray(image)
    if image.ndim not in (2, 3) or image.size == 0:
        raise ImageError(f"an image must have shape (H, W) or (H, W, C), got {image.shape}")
    if image.ndim == 3 and image.shape[2] == 4:
        image = image[..., :3]  # what is opaque says nothing about the scene
    if image.ndim == 3 and image.shape[2] not in (1, 3):
        raise ImageError(f"an image has 1 channel, 3 (RGB) or 4 (RGBA), got {image.shape[2]}")
    if image.dtype.kind not in "uf":
        raise ImageError(f"an image must hold unsigned integers or real numbers, got {image.dtype}")
    if channels > 1 and (image.ndim == 2 or image.shape[2] != channels):
        raise ImageError(f"the maps are for {channels} colour channels, but the image has shape {image.shape}")
    scale = 255 / white_level(image)
    if channels == 1 and image.ndim == 3:
        share, levels = mixture(image), image if image.dtype in (np.uint8, np.uint16) else image.astype(np.float32)
        grey = np.empty((1, *image.shape[:2]), np.float32)
        with ALONE:
            shares = (scale * share).astype(np.float32)
            _mixed(np.ascontiguousarray(levels), shares, np.float32(GREY * share.sum()), grey[0])
        return grey
    levels = image.astype(np.float32)
    if image.dtype.kind == "f":
        levels = np.nan_to_num(levels, copy=False, posinf=0, neginf=0)
    return np.moveaxis(levels.reshape(*image.shape[:2], -1), -1, 0) * np.float32(scale) - np.float32(GREY)


@njit(parallel=True, cache=True, fastmath=FAST, error_model="numpy")
def _mixed(image, shares, offset, out):
    """Weighted sum of the colours less an offset; 0 before the offset where one is not a finite number."""
    for y in prange(image.shape[0]):
        for x in range(image.shape[1]):
            total = np.float32(0)
            for c in range(image.shape[2]):
                total += shares[c] * np.float32(image[y, x, c])
            out[y, x] = (total if abs(total) < np.float32(1e30) else np.float32(0)) - offset


def mixture(image: np.ndarray) -> np.ndarray:
    """Shares of the colours in the one picture that is matched: their mean, unless that hides most of the texture.

    Texture is the change from pixel to pixel. Where the mean has less than half of that of the direction in colour
    space that has most (the principal axis of the 3 x 3 matrix of products of changes), it is that direction.

    Parameters
    ----------
    image : (H, W, C) array
        Photograph; pixels that are not finite numbers count as black.

    Returns
    -------
    (C,) array
        Of the same length as those of the mean, so that noise counts the same.
    """
    colours = image.shape[2]
    rows, columns = (
        np.nan_to_num(some.astype(np.float32), posinf=0, neginf=0) for some in (image[::_EVERY], image[:, ::_EVERY])
    )
    across, down = np.diff(rows, axis=1), np.diff(columns, axis=0)
    products = sum(np.einsum("ijc,ijd->cd", change, change, dtype=float) for change in (across, down))
    energies, axes = np.linalg.eigh(products)
    mean = np.full(colours, 1 / np.sqrt(colours))
    axis = axes[:, -1] * np.sign(axes[np.argmax(np.abs(axes[:, -1])), -1])
    best = axis if mean @ products @ mean < energies[-1] / 2 else mean
    return best / np.sqrt(colours)


def prepare(image: np.ndarray, plan) -> Prepared:
    """Cut a photograph into its views, blur and shrink them.

    Parameters
    ----------
    image : (H, W) or (H, W, C) array
        Photograph, unsigned integers or real numbers.
    plan : Plan
        Layouts of the scales, boxes of the views, and whether colours are matched by themselves.
    """
    grey = grey_levels(image, plan.channels)
    size = plan.warps[0].masks.shape[1:]
    if grey.shape[1:] != size:
        raise ImageError(
            f"the maps want an image of {size} rows and columns, got {grey.shape[1:]}; "
            "make the maps for the camera that took it"
        )
    coarse = [cv2.GaussianBlur(plane, (0, 0), _SEARCH_BLUR) for plane in grey]
    fine = [cv2.GaussianBlur(plane, (0, 0), _BLUR) for plane in grey]
    views = [[plane[box] for plane in coarse] for box in plan.boxes]
    sharp = [[plane[box] for plane in fine] for box in plan.boxes]
    search, smooth, splines = [], [], []
    for level, layout in enumerate(plan.layouts):
        search.append(Pictures(layout, layout.packed(views) + layout.hidden))
        if level < 2:
            smooth.append(Pictures(layout, layout.packed(sharp)))
            splines.append(Pictures(layout, layout.packed([[_spline(p) for p in planes] for planes in sharp])))
        views = [[plane[::2, ::2] if level == 0 else cv2.pyrDown(plane) for plane in planes] for planes in views]
        sharp = views
    return Prepared(tuple(search), tuple(smooth), tuple(splines))


def _spline(plane):
    """Coefficients of the cubic B-spline through all pixels, by a filter that is cut off (Unser 1999)."""
    line = np.sqrt(3) * _POLE ** np.abs(np.arange(-_REACH, _REACH + 1))
    return cv2.sepFilter2D(plane, -1, line, line, borderType=cv2.BORDER_REFLECT_101)
