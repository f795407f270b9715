"""Photographs from disk, with the checks that save an hour of search later."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..errors import ImageError, OutputError, ShapeError
from .disk import PathLike, read_bytes, replacing

_SIGNATURES = {  # how files of each format begin
    "PNG": (b"\x89PNG",),
    "JPEG": (b"\xff\xd8\xff",),
    "TIFF": (b"II*\0", b"MM\0*", b"II+\0", b"MM\0+"),
    "BMP": (b"BM",),
    "WebP": (b"RIFF",),
}
_HOLDS = {  # what each format can hold without loss of range
    ".png": ("uint8", "uint16"),
    ".tif": ("uint8", "uint16", "float32"),
    ".tiff": ("uint8", "uint16", "float32"),
    ".jpg": ("uint8",),
    ".jpeg": ("uint8",),
    ".bmp": ("uint8",),
}
_DARK = 0.02  # a view this much darker than the brightest one shows no picture
_SATURATED = 0.5  # share of a view's pixels at the top of the range


def read_photograph(path: PathLike, size: tuple[int, int] | None = None) -> np.ndarray:
    """Read a photograph as the sensor saw it: no turning by EXIF tags, no scaling of values.

    Parameters
    ----------
    path : path
        PNG, TIFF, JPEG, BMP or whatever else OpenCV reads.
    size : (width, height), optional
        px, of the setup's camera: the photograph must have this size.

    Returns
    -------
    (H, W) or (H, W, 3) array
        uint8, uint16 or float32 as in the file; red, green, blue.

    Raises
    ------
    ImageError
        When the file is missing, damaged, no image, or does not belong to the setup.
    """
    data = read_bytes(path, ImageError)
    image = _decode(data)
    if image is None:
        raise ImageError(f"{path}: {_why_undecoded(data)}")
    if image.dtype == np.float64:
        image = image.astype(np.float32)
    if image.dtype.name not in ("uint8", "uint16", "float32"):
        raise ImageError(f"{path}: pixels must be 8 or 16 bits without sign, or float, got {image.dtype}")
    if image.ndim == 3:
        image = np.ascontiguousarray(image[..., 2::-1] if image.shape[2] >= 3 else image[..., 0])
    got = (image.shape[1], image.shape[0])
    if size is not None and got != tuple(size):
        raise ImageError(_wrong_size(path, got, (int(size[0]), int(size[1]))))
    return image


def _decode(data):
    """Pixels as OpenCV orders them, or None."""
    import cv2

    logging = getattr(cv2.utils, "logging", cv2)  # since OpenCV 5; before, the functions stood in cv2 itself
    level = logging.getLogLevel()
    logging.setLogLevel(0)  # silent: what OpenCV would print, our exception says
    try:
        return cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED)
    except cv2.error:
        return None
    finally:
        logging.setLogLevel(level)


def _why_undecoded(data):
    for name, beginnings in _SIGNATURES.items():
        if data.startswith(beginnings):
            return f"the file begins as {name} but cannot be read: it is truncated or damaged; copy it again"
    return "this is no image that can be read; take PNG, TIFF or JPEG"


def _wrong_size(path, got, wanted):
    (width, height), (wanted_width, wanted_height) = got, wanted
    said = (
        f"{path} is {width}x{height} px but the setup's camera has {wanted_width}x{wanted_height} px: "
        "is it the right setup, or was the photograph scaled?"
    )
    if (height, width) == wanted:
        return f"{said} It is turned by a quarter turn: turn it back"
    if width * wanted_height == height * wanted_width:
        return f"{said} It is exactly {width / wanted_width:.4g} times that size: take the original photograph"
    return said


def check_exposure(image: np.ndarray, masks: ArrayLike) -> list[str]:
    """Say which views show nothing: black, without any structure, or overexposed.

    Parameters
    ----------
    image : (H, W) or (H, W, 3) array
        The photograph.
    masks : (V, H, W) array of bool
        The pixels of each view.

    Returns
    -------
    list of str
        One warning for each view that shows nothing; empty when all is well.

    Raises
    ------
    ImageError
        When the whole photograph shows nothing.
    """
    masks = np.asarray(masks, dtype=bool)
    if masks.ndim != 3 or masks.shape[1:] != image.shape[:2]:
        raise ShapeError(f"masks must have shape (V, {image.shape[0]}, {image.shape[1]}), got {masks.shape}")
    brightness: NDArray = image.max(axis=-1) if image.ndim == 3 else image
    brightness = np.where(np.isfinite(brightness), brightness, 0)
    if not brightness.max() > 0:
        raise ImageError("the photograph is black: was the lens covered?")
    if (image == image[0, 0]).all():
        raise ImageError(f"every pixel of the photograph is {image[0, 0].tolist()}: is this the right file?")
    white = 255 if image.dtype == np.uint8 else brightness.max()  # of 16 bits a camera may use 10, 12 or 14
    views = [brightness[mask] for mask in masks]
    levels = [float(np.percentile(view, 99)) if view.size else 0.0 for view in views]
    said = (_exposure_fault(view, level, white, max(levels)) for view, level in zip(views, levels, strict=True))
    return [f"view {k} {fault}" for k, fault in enumerate(said) if fault]


def _exposure_fault(view, level, white, brightest):
    if not view.size:
        return "has no pixels in the photograph"
    if level <= _DARK * brightest:
        return "is black: is that facet blocked?"
    share = np.count_nonzero(view >= white) / view.size
    if share > _SATURATED:
        return f"is overexposed: {100 * share:.0f} % of its pixels are white; take a shorter exposure"
    if view.min() == view.max():
        return f"has the same value everywhere, {view[0]}: is that facet blocked?"
    return ""


def write_image(path: PathLike, rgb: ArrayLike) -> None:
    """Write a picture (H, W) or (H, W, 3), red green blue, in the format that the name's ending says.

    Raises
    ------
    OutputError
        When the format cannot hold the values, or the file cannot be written.
    """
    import cv2

    rgb = np.asarray(rgb)
    if rgb.ndim not in (2, 3) or (rgb.ndim == 3 and rgb.shape[2] != 3) or not rgb.size:
        raise ShapeError(f"a picture must have shape (H, W) or (H, W, 3), got {rgb.shape}")
    ending = Path(path).suffix.lower()
    if ending not in _HOLDS:
        raise OutputError(f"{path}: the name must end in one of {', '.join(_HOLDS)}")
    if rgb.dtype.name not in _HOLDS[ending]:
        raise OutputError(f"{path}: {ending} files hold {' or '.join(_HOLDS[ending])}, got {rgb.dtype}")
    bgr = np.ascontiguousarray(rgb[..., ::-1] if rgb.ndim == 3 else rgb)
    plain = [cv2.IMWRITE_TIFF_COMPRESSION, 1] if rgb.dtype == np.float32 else []  # OpenCV 4's own choice is lossy
    _, data = cv2.imencode(ending, bgr, plain)
    with replacing(path) as file:
        file.write(data.tobytes())
