"""COLMAP's sparse model: cameras.txt or cameras.bin, and images.txt or images.bin for the poses.

Camera models and their parameters as in src/colmap/sensor/models.h, files as in doc/format.rst of COLMAP. The centre of
the first pixel is (0.5, 0.5) there, so principal points move by half a pixel. Poses are quaternions (w first) and
translations that take world coordinates into the camera's. COLMAP leaves the unit of length open; mm unless told
otherwise. Every image becomes a camera of its own; without images every camera, its place unknown.
"""

from __future__ import annotations

import struct
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np

from ...cameras import Camera
from ...errors import SetupError
from ...geometry import Pose
from ..disk import PathLike, output_folder, read_bytes, replacing
from .named import NamedCamera, brown, make_camera, number, numbers, plain_number, read_text

UNIT_MM = 1.0
# by the number that binary files say: name, and how many parameters
_MODELS = {
    0: ("SIMPLE_PINHOLE", 3),
    1: ("PINHOLE", 4),
    2: ("SIMPLE_RADIAL", 4),
    3: ("RADIAL", 5),
    4: ("OPENCV", 8),
    6: ("FULL_OPENCV", 12),
}
_COUNTS = dict(_MODELS.values())
_HALF = 0.5  # px, from their pixel coordinates to ours
_IMAGE = struct.Struct("<i7di")  # image, quaternion, translation, camera
_POINT_BYTES = 24  # of each point in an image: x, y, number


def read(path: PathLike, size: tuple[int, int] | None, unit_mm: float) -> list[NamedCamera]:
    """The cameras of a model: a folder, or one of its cameras or images files."""
    folder = Path(path) if Path(path).is_dir() else Path(path).parent
    binary = (folder / "cameras.bin").exists() and not str(path).endswith(".txt")
    if not binary and not (folder / "cameras.txt").exists():
        raise SetupError(f"{path}: there is no cameras.txt or cameras.bin in {folder}")
    ending, read_cameras, read_images = (
        ("bin", _binary_cameras, _binary_images) if binary else ("txt", _cameras, _images)
    )
    cameras = read_cameras(folder / f"cameras.{ending}")
    images = folder / f"images.{ending}"
    posed = read_images(images, cameras, unit_mm) if images.exists() else []
    return posed or [NamedCamera(f"camera {key}", camera) for key, camera in cameras.items()]


def _camera(model: str, size, values, where: str) -> Camera:
    if _COUNTS.get(model) is None:
        raise SetupError(f"{where}: the camera model {model} has no place here; wanted one of {', '.join(_COUNTS)}")
    values = numbers(values, (_COUNTS[model],), f"{where}: parameters of {model}")
    focals = 1 if model in ("SIMPLE_PINHOLE", "SIMPLE_RADIAL", "RADIAL") else 2
    fx, fy = values[0], values[focals - 1]
    cx, cy = values[focals : focals + 2] - _HALF
    rest = values[focals + 2 :]
    lens = (*rest[:2], 0.0, 0.0) if focals == 1 and rest.size > 1 else tuple(rest)
    return make_camera(size, (fx, fy, cx, cy), brown(lens, f"{where}: {model}"), where)


def _cameras(path: Path) -> dict[int, Camera]:
    cameras = {}
    for count, line in enumerate(read_text(path).splitlines(), 1):
        words = line.split("#", 1)[0].split()
        if not words:
            continue
        where = f"{path}: line {count}"
        if len(words) < 5:
            raise SetupError(f"{where}: wanted CAMERA_ID MODEL WIDTH HEIGHT PARAMS, got {line!r:.60}")
        cameras[int(number(words[0], where))] = _camera(words[1], words[2:4], words[4:], where)
    if not cameras:
        raise SetupError(f"{path}: no camera in the file")
    return cameras


def _images(path: Path, cameras: dict[int, Camera], unit_mm: float) -> list[NamedCamera]:
    found = []
    lines = enumerate(read_text(path).splitlines(), 1)
    for count, line in lines:
        if not line.strip() or line.lstrip().startswith("#"):
            continue
        next(lines, None)  # the points of this image, often an empty line
        where = f"{path}: line {count}"
        words = line.split(maxsplit=9)
        if len(words) < 10:
            raise SetupError(f"{where}: wanted IMAGE_ID QW QX QY QZ TX TY TZ CAMERA_ID NAME, got {line!r:.60}")
        values = numbers(words[:9], (9,), where)
        found.append(_image(words[9].strip(), values[1:8], int(values[8]), cameras, unit_mm, where))
    return found


def _image(name, values, key, cameras, unit_mm, where):
    from scipy.spatial.transform import Rotation

    if key not in cameras:
        raise SetupError(f"{where}: image {name} names camera {key}, which the cameras file does not have")
    w, x, y, z = numbers(values[:4], (4,), where)
    if abs(np.linalg.norm([w, x, y, z]) - 1) > 1e-3:
        raise SetupError(f"{where}: the quaternion of image {name} has not the length 1")
    rotation = Rotation.from_quat([x, y, z, w]).as_matrix()
    return NamedCamera(name, cameras[key], Pose(rotation, numbers(values[4:], (3,), where) * unit_mm))


def _binary_cameras(path: Path) -> dict[int, Camera]:
    def entries(take):
        cameras = {}
        for _ in range(take(struct.Struct("<Q"))[0]):
            key, model, width, height = take(struct.Struct("<iiQQ"))
            if model not in _MODELS:
                raise SetupError(f"{path}: camera {key}: model number {model} has no place here")
            name, count = _MODELS[model]
            cameras[key] = _camera(name, (width, height), take(struct.Struct(f"<{count}d")), f"{path}: camera {key}")
        return cameras

    return _unpacked(path, entries)


def _binary_images(path: Path, cameras: dict[int, Camera], unit_mm: float) -> list[NamedCamera]:
    def entries(take):
        found = []
        for _ in range(take(struct.Struct("<Q"))[0]):
            _, *values, key = take(_IMAGE)
            letters = bytearray()
            while (letter := take(struct.Struct("c"))[0]) != b"\0":
                letters += letter
            take(struct.Struct(f"{take(struct.Struct('<Q'))[0] * _POINT_BYTES}x"))
            name = letters.decode("utf-8", "replace")
            found.append(_image(name, values, key, cameras, unit_mm, f"{path}: image {name}"))
        return found

    return _unpacked(path, entries)


def _unpacked(path: Path, entries: Callable):
    """What `entries` makes of a file that it takes piece by piece."""
    data, place = read_bytes(path, SetupError), 0

    def take(kind: struct.Struct):
        nonlocal place
        values = kind.unpack_from(data, place)
        place += kind.size
        return values

    try:
        return entries(take)
    except (struct.error, OverflowError, MemoryError):
        raise SetupError(f"{path}: the file ends too early, at byte {place}; copy it again") from None


def write(path: PathLike, cameras: Sequence[NamedCamera], unit_mm: float) -> list[str]:
    """A model without points in a folder: cameras.txt, images.txt, points3D.txt."""
    from scipy.spatial.transform import Rotation

    folder = output_folder(path)
    models = ["# CAMERA_ID, MODEL, WIDTH, HEIGHT, PARAMS[]"]
    images = ["# IMAGE_ID, QW, QX, QY, QZ, TX, TY, TZ, CAMERA_ID, NAME", "# POINTS2D[] as (X, Y, POINT3D_ID)"]
    for k, named in enumerate(cameras, 1):
        model, values = _model(named.camera)
        models.append(f"{k} {model} {named.camera.size[0]} {named.camera.size[1]} {_joined(values)}")
        if named.pose is not None:
            x, y, z, w = Rotation.from_matrix(named.pose.rotation).as_quat(canonical=True)
            place = _joined([w, x, y, z, *named.pose.translation / unit_mm])
            images += [f"{k} {place} {k} {_one_word(named.name)}", ""]
    texts = {"cameras.txt": models, "images.txt": images, "points3D.txt": ["# no points"]}
    for name, lines in texts.items():
        with replacing(folder / name) as file:
            file.write(("\n".join(lines) + "\n").encode())
    if any(named.pose is None for named in cameras):
        return ["cameras whose place is unknown are in cameras.txt only, without their names"]
    spaced = any(_one_word(named.name) != named.name for named in cameras)
    return [
        "COLMAP takes NAME in images.txt for the file of a photograph: rename the views, or the files",
        *(["COLMAP reads names up to the first space: spaces are written as _"] if spaced else []),
    ]


def _one_word(name: str) -> str:
    return "_".join(name.split()) or "camera"


def _model(camera: Camera) -> tuple[str, list[float]]:
    centre = [value + _HALF for value in camera.centre]
    k1, k2, p1, p2, k3 = camera.distortion
    if k3 == 0:
        return "OPENCV", [*camera.focal, *centre, k1, k2, p1, p2]
    return "FULL_OPENCV", [*camera.focal, *centre, k1, k2, p1, p2, k3, 0.0, 0.0, 0.0]


def _joined(values) -> str:
    return " ".join(plain_number(value) for value in values)
