"""ROS camera_info YAML, as camera_calibration writes it and camera_info_manager reads it.

Keys as in the ROS wiki's page on camera_calibration_parsers: image_width, image_height, camera_name, camera_matrix,
distortion_model, distortion_coefficients, rectification_matrix, projection_matrix. ``plumb_bob`` is k1 k2 p1 p2 k3 of
sensor_msgs/CameraInfo. There is no place for a pose.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from ...errors import SetupError
from ..disk import PathLike, replacing
from .named import NamedCamera, camera_of_matrix, file_of_camera, find, plain_list
from .yaml_text import quoted, read_yaml

UNIT_MM = 1000.0


def read(path: PathLike, size: tuple[int, int] | None, unit_mm: float) -> list[NamedCamera]:
    """The one camera of the file."""
    document = read_yaml(path)
    where = str(path)
    model = document.get("distortion_model", "plumb_bob")
    if model not in ("plumb_bob", "rational_polynomial"):
        raise SetupError(
            f"{path}: distortion_model is {model!r}, which has no place here; calibrate with plumb_bob "
            "(k1 k2 p1 p2 k3), or undistort the photographs first and give the camera of the undistorted ones"
        )
    matrix = find(find(document, "camera_matrix", where), "data", f"{where}: camera_matrix")
    lens = find(find(document, "distortion_coefficients", where), "data", f"{where}: distortion_coefficients")
    given = (find(document, "image_width", where), find(document, "image_height", where))
    camera = camera_of_matrix(given, matrix, lens, where)
    return [NamedCamera(str(document.get("camera_name") or Path(path).stem), camera)]


def write(path: PathLike, cameras: Sequence[NamedCamera], unit_mm: float) -> list[str]:
    """One file for each camera."""
    for k, named in enumerate(cameras):
        with replacing(file_of_camera(path, k, len(cameras))) as file:
            file.write(_text(named).encode())
    if any(named.pose is not None for named in cameras):
        return ["a ROS camera_info file holds no pose: publish the poses as transforms (tf)"]
    return []


def _text(named: NamedCamera) -> str:
    camera = named.camera
    width, height = camera.size
    projection = np.column_stack([camera.matrix, np.zeros(3)])
    return "\n".join(
        [
            f"image_width: {width}",
            f"image_height: {height}",
            f"camera_name: {quoted(named.name)}",
            *_matrix("camera_matrix", camera.matrix),
            "distortion_model: plumb_bob",
            *_matrix("distortion_coefficients", np.array([camera.distortion])),
            *_matrix("rectification_matrix", np.eye(3)),
            *_matrix("projection_matrix", projection),
            "",
        ]
    )


def _matrix(name, values):
    rows, columns = values.shape
    return [f"{name}:", f"  rows: {rows}", f"  cols: {columns}", f"  data: {plain_list(values)}"]
