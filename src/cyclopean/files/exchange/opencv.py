"""OpenCV's FileStorage, YAML, XML or JSON: what its calibration samples write.

One camera: ``camera_matrix``, ``distortion_coefficients``, ``image_width``, ``image_height``
(samples/cpp/calibration.cpp; checked against its own left_intrinsics.yml). Two: ``M1 D1 M2 D2`` and ``R T``, which take
points of the first camera into the second (samples/cpp/stereo_calib.cpp). We write one file for each camera, with its
pose as ``R`` and ``T``. Lengths have the unit of the board that was used; mm unless told otherwise.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np

from ...errors import SetupError
from ..disk import PathLike, replacing
from .named import (
    IDENTITY,
    NamedCamera,
    camera_of_matrix,
    file_of_camera,
    make_pose,
    needed_size,
    number,
    numbers,
    read_text,
)
from .yaml_text import read_yaml

UNIT_MM = 1.0
_MATRIX = ("camera_matrix", "cameraMatrix", "Camera_Matrix", "camera_Matrix", "cam_matrix", "K", "mtx")
_DISTORTION = (
    "distortion_coefficients", "Distortion_Coefficients", "distCoeffs", "dist_coeffs", "dist_coeff", "D", "dist",
)  # fmt: skip
_WIDTH = ("image_width", "image_Width", "imageWidth", "width")
_HEIGHT = ("image_height", "image_Height", "imageHeight", "height")
_SIZE = ("image_size", "imageSize", "size")
_PAIRS = (
    ("M1", "D1", "M2", "D2"),
    ("K1", "D1", "K2", "D2"),
    ("cameraMatrix1", "distCoeffs1", "cameraMatrix2", "distCoeffs2"),
)


def read(path: PathLike, size: tuple[int, int] | None, unit_mm: float) -> list[NamedCamera]:
    """The camera, or the pair of cameras, that the file holds."""
    document = _document(path)
    if number(document.get("fisheye_model", 0), f"{path}: fisheye_model"):
        raise SetupError(f"{path}: this is a fisheye camera (fisheye_model = 1), which has no place here")
    size = _size(document, path) or size
    for names in _PAIRS:
        if names[0] in document and names[2] in document:
            return _pair(document, names, size, unit_mm, path)
    matrix = _first(document, _MATRIX)
    if matrix is None:
        raise SetupError(f"{path}: camera_matrix is missing; the file has {', '.join(document) or 'nothing'}")
    distortion = _first(document, _DISTORTION)
    where = str(path)
    camera = camera_of_matrix(needed_size(size, where), matrix, () if distortion is None else distortion, where)
    return [NamedCamera(Path(path).stem, camera, _pose(document, unit_mm, path))]


def _pair(document, names, size, unit_mm, path):
    first, first_lens, second, second_lens = names
    pose = _pose(document, unit_mm, path)
    cameras = [
        camera_of_matrix(needed_size(size, f"{path}"), document[key], document.get(lens, ()), f"{path}: {key}")
        for key, lens in ((first, first_lens), (second, second_lens))
    ]
    stem = Path(path).stem
    return [
        NamedCamera(f"{stem}-0", cameras[0], None if pose is None else IDENTITY),
        NamedCamera(f"{stem}-1", cameras[1], pose),
    ]


def _pose(document, unit_mm, path):
    if document.get("R") is None or document.get("T") is None:
        return None
    return make_pose(document["R"], document["T"], unit_mm, f"{path}: R and T")


def _size(document, path):
    width, height = _first(document, _WIDTH), _first(document, _HEIGHT)
    if width is None or height is None:
        both = _first(document, _SIZE)
        if both is None or np.size(both) != 2:
            return None
        width, height = np.ravel(both)
    return int(number(width, f"{path}: image width")), int(number(height, f"{path}: image height"))


def _first(document, names):
    return next((document[name] for name in names if document.get(name) is not None), None)


def _document(path: PathLike) -> dict[str, Any]:
    """The top level of a file storage: matrices as arrays, lists as lists, numbers and text as they are.

    Not by cv2.FileStorage, which writes beyond its memory when a file is damaged (seen with 5.0.0).
    """
    text = read_text(path)
    start = text.lstrip()
    if start.startswith("%YAML"):
        document = read_yaml(path, start.partition("\n")[2])
    elif start.startswith("{"):
        document = _json(text, path)
    elif start.startswith("<"):
        document = _xml(text, path)
    else:
        raise SetupError(f"{path}: this is no file of OpenCV's FileStorage: it must start with %YAML:1.0, <?xml or {{")
    return {str(key): _matrix(value, f"{path}: {key}") for key, value in document.items()}


def _json(text, path):
    try:
        document = json.loads(text)
    except (ValueError, RecursionError) as fault:
        raise SetupError(f"{path}: this is not JSON: {fault}") from None
    return document


def _xml(text, path):
    try:
        root = ElementTree.fromstring(text)
    except (ElementTree.ParseError, ValueError) as fault:
        raise SetupError(f"{path}: this is not XML: {fault}") from None
    if root.tag != "opencv_storage":
        raise SetupError(f"{path}: the file starts with <{root.tag}>, wanted <opencv_storage>")
    return {child.tag: _element(child) for child in root}


def _element(element):
    words = (element.text or "").split()
    if len(element):
        return {child.tag: _element(child) for child in element}
    return words[0] if len(words) == 1 else words


def _matrix(value, where):
    """An array where a table is a matrix of OpenCV's, else what came."""
    if not isinstance(value, dict) or not {"rows", "cols", "data"} <= set(value):
        return value
    rows, columns = (int(number(value[name], f"{where}: {name}")) for name in ("rows", "cols"))
    data = numbers(value["data"], (-1,), f"{where}: data")
    if data.size != rows * columns:
        raise SetupError(f"{where}: {rows} rows of {columns} are wanted, data has {data.size} numbers")
    return data.reshape(rows, columns)


def write(path: PathLike, cameras: Sequence[NamedCamera], unit_mm: float) -> list[str]:
    """One file for each camera."""
    import cv2

    suffix = Path(path).suffix.lower()
    ending = suffix if suffix in (".xml", ".json") else ".yml"
    for k, named in enumerate(cameras):
        storage = cv2.FileStorage(ending, cv2.FILE_STORAGE_WRITE | cv2.FILE_STORAGE_MEMORY)
        storage.write("camera_name", named.name)
        storage.write("image_width", named.camera.size[0])
        storage.write("image_height", named.camera.size[1])
        storage.write("camera_matrix", named.camera.matrix)
        storage.write("distortion_coefficients", np.array(named.camera.distortion).reshape(5, 1))
        if named.pose is not None:
            storage.write("R", np.ascontiguousarray(named.pose.rotation))
            storage.write("T", named.pose.translation.reshape(3, 1) / unit_mm)
        with replacing(file_of_camera(path, k, len(cameras))) as file:
            file.write(storage.releaseAndGetString().encode())
    return []
