"""transforms.json of nerfstudio and instant-ngp.

Keys fl_x fl_y cx cy w h k1 k2 k3 k4 p1 p2, once for all frames or in each frame, and for each frame transform_matrix,
which takes camera coordinates into the world's; the camera looks along -z, y up (nerfstudio documentation, "Data
conventions"; distortion as in nerfstudio/cameras/camera_utils.py, k3 as OpenCV's). Pixels count from the corner of
the image, so principal points move by half a pixel. The unit of length is open; mm unless told otherwise.
"""

from __future__ import annotations

import json
from collections.abc import Sequence

import numpy as np

from ...cameras import Camera
from ...errors import SetupError
from ...geometry import Pose
from ..disk import PathLike, replacing
from .named import NamedCamera, find, make_camera, make_pose, number, numbers, read_text

UNIT_MM = 1.0
_HALF = 0.5  # px, from their pixel coordinates to ours
_FLIP = np.array([1.0, -1.0, -1.0])  # of the camera's axes: y up and z backwards there
_MODELS = ("OPENCV", "PINHOLE", "SIMPLE_PINHOLE", "SIMPLE_RADIAL", "RADIAL")


def read(path: PathLike, size: tuple[int, int] | None, unit_mm: float) -> list[NamedCamera]:
    """One camera for each frame, or a single one, its place unknown, where there are no frames."""
    try:
        document = json.loads(read_text(path))
    except (ValueError, RecursionError) as fault:
        raise SetupError(f"{path}: this is not JSON: {fault}") from None
    if not isinstance(document, dict):
        raise SetupError(f"{path}: wanted an object with frames, got {type(document).__name__}")
    frames = document.get("frames") or []
    if not frames:
        return [NamedCamera("camera", _camera(document, str(path)))]
    cameras = []
    for k, frame in enumerate(frames):
        where = f"{path}: frame {k}"
        matrix = numbers(find(frame, "transform_matrix", where), (-1, 4), f"{where}: transform_matrix")
        if len(matrix) not in (3, 4):
            raise SetupError(f"{where}: transform_matrix must have 3 or 4 rows of 4, got {len(matrix)}")
        world_from_camera = make_pose(matrix[:3, :3] * _FLIP, matrix[:3, 3], unit_mm, where)
        name = str(frame.get("file_path", f"frame {k}"))
        cameras.append(NamedCamera(name, _camera(document | frame, where), world_from_camera.inverse))
    return cameras


def _camera(table, where) -> Camera:
    model = table.get("camera_model", "OPENCV")
    if model not in _MODELS:
        raise SetupError(f"{where}: camera_model {model} has no place here; wanted OPENCV or PINHOLE")
    if number(table.get("k4", 0.0), f"{where}: k4"):
        raise SetupError(f"{where}: k4 = {table['k4']} is a term of r^8, which a camera here does not have")
    width, height = number(find(table, "w", where), f"{where}: w"), number(find(table, "h", where), f"{where}: h")
    if "fl_x" in table:
        fx = number(table["fl_x"], f"{where}: fl_x")
    else:
        fx = width / 2 / np.tan(number(find(table, "camera_angle_x", where), f"{where}: camera_angle_x") / 2)
    fy = number(table.get("fl_y", fx), f"{where}: fl_y")
    cx, cy = number(table.get("cx", width / 2), f"{where}: cx"), number(table.get("cy", height / 2), f"{where}: cy")
    lens = [number(table.get(name, 0.0), f"{where}: {name}") for name in ("k1", "k2", "p1", "p2", "k3")]
    return make_camera((width, height), (fx, fy, cx - _HALF, cy - _HALF), lens, where)


def write(path: PathLike, cameras: Sequence[NamedCamera], unit_mm: float) -> list[str]:
    """One frame for each camera whose place is known; a lone camera may be without."""
    lenses = [_entries(named.camera) for named in cameras]
    shared = lenses[0] if all(lens == lenses[0] for lens in lenses) else {}
    frames = [
        {"file_path": named.name, **({} if shared else lens), "transform_matrix": _matrix(named.pose, unit_mm)}
        for named, lens in zip(cameras, lenses, strict=True)
        if named.pose is not None
    ]
    document = {"camera_model": "OPENCV", **shared, "frames": frames}
    with replacing(path) as file:
        file.write((json.dumps(document, indent=1) + "\n").encode())
    notes = (
        ["nerfstudio takes file_path for the file of a photograph: rename the views, or the files"] if frames else []
    )
    if len(frames) < len(cameras) and not (len(cameras) == 1 and shared):
        notes.append("cameras whose place is unknown are not in the file")
    return notes


def _entries(camera: Camera) -> dict[str, float]:
    lens = dict(zip(("k1", "k2", "p1", "p2", "k3"), camera.distortion, strict=True))
    return {
        "w": camera.size[0],
        "h": camera.size[1],
        "fl_x": camera.focal[0],
        "fl_y": camera.focal[1],
        "cx": camera.centre[0] + _HALF,
        "cy": camera.centre[1] + _HALF,
        **lens,
    }


def _matrix(pose: Pose, unit_mm: float) -> list[list[float]]:
    back = pose.inverse
    rows = np.column_stack([back.rotation * _FLIP, back.translation / unit_mm])
    return [*rows.tolist(), [0.0, 0.0, 0.0, 1.0]]
