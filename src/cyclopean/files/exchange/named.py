"""What every format has in common: cameras with a name and a place, and the checks on what files say."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ...cameras import Camera
from ...errors import OutputError, SetupError
from ...geometry import Pose, nearest_rotation
from .. import disk
from ..disk import PathLike

IDENTITY = Pose(np.eye(3), np.zeros(3))
_ROTATION_SLACK = 1e-3  # how far a matrix may be from a rotation: some programs write four digits
_BEYOND_BROWN = ("k4", "k5", "k6", "s1", "s2", "s3", "s4", "tilt x", "tilt y")  # OpenCV's order, after k3


@dataclass(frozen=True, eq=False)
class NamedCamera:
    """A pinhole camera with a name and, where it is known, its place."""

    name: str
    camera: Camera
    pose: Pose | None = None  # camera_from_world, mm; None: unknown
    mirrored: bool = False  # x of the camera's own frame is flipped before it projects, as in `VirtualCamera`


def flipped(named: NamedCamera) -> NamedCamera:
    """The plain camera that stands for a mirrored one once the photograph is flipped left to right.

    Pixel x becomes width - 1 - x; a camera that is not mirrored stays as it is.
    """
    if not named.mirrored:
        return named
    camera = named.camera
    k1, k2, p1, p2, k3 = camera.distortion
    centre = (camera.size[0] - 1 - camera.centre[0], camera.centre[1])
    return replace(named, camera=replace(camera, centre=centre, distortion=(k1, k2, p1, -p2, k3)), mirrored=False)


def read_text(path: PathLike) -> str:
    """The text of a file."""
    return disk.read_text(path, "file of this format")


def find(table: Mapping[str, Any], key: str, where: str) -> Any:
    """What a table holds under a key that it must have."""
    if not isinstance(table, Mapping):
        raise SetupError(f"{where}: wanted a table with the key {key}, got {table!r:.60}")
    if key not in table:
        raise SetupError(f"{where}: {key} is missing; the file has {', '.join(map(str, table))}")
    return table[key]


def numbers(value: Any, shape: tuple[int, ...], where: str) -> np.ndarray:
    """Finite numbers of a given shape; -1 in the shape lets any length pass."""
    try:
        array = np.array(value, dtype=float)  # text such as "1e-5", which YAML does not take for a number, passes
    except (TypeError, ValueError):
        raise SetupError(f"{where}: wanted numbers, got {value!r:.60}") from None
    fits = array.ndim == len(shape) and all(want in (-1, got) for want, got in zip(shape, array.shape, strict=True))
    if not fits and array.size == np.prod(shape):
        array, fits = array.reshape(shape), True
    if not fits:
        raise SetupError(f"{where}: wanted numbers of shape {shape}, got shape {array.shape}")
    if not np.isfinite(array).all():
        raise SetupError(f"{where}: every number must be finite, got {value!r:.60}")
    return array


def number(value: Any, where: str) -> float:
    """One finite number."""
    return float(numbers(value, (), where))


def brown(coefficients: ArrayLike, where: str) -> tuple[float, ...]:
    """k1 k2 p1 p2 k3 of distortion numbers in OpenCV's order, whose later terms must be zero."""
    given = numbers(np.ravel(np.asarray(coefficients, dtype=object)), (-1,), where)
    beyond = {name: value for name, value in zip(_BEYOND_BROWN, given[5:], strict=False) if value != 0}
    if beyond or given.size > 14:
        terms = ", ".join(f"{name} = {value:g}" for name, value in beyond.items()) or f"{given.size} numbers"
        raise SetupError(
            f"{where}: the lens model goes beyond k1 k2 p1 p2 k3 ({terms}), which is all that a camera here has; "
            "calibrate with five coefficients, or undistort the photographs and take a camera without distortion"
        )
    return (*given[:5], 0.0, 0.0, 0.0, 0.0, 0.0)[:5]


def make_camera(size: ArrayLike, values: ArrayLike, distortion: Sequence[float], where: str) -> Camera:
    """A camera of focal x, focal y, centre x, centre y (px) and k1 k2 p1 p2 k3, or a SetupError that says where."""
    fx, fy, cx, cy = numbers(values, (4,), where)
    width, height = numbers(size, (2,), f"{where}: image size")
    try:
        return Camera((width, height), (fx, fy), (cx, cy), tuple(distortion))  # type: ignore[arg-type]
    except SetupError as fault:
        raise SetupError(f"{where}: {fault}") from None


def camera_of_matrix(size: ArrayLike, matrix: Any, distortion: ArrayLike, where: str) -> Camera:
    """A camera of a 3x3 matrix, which must have no skew, and distortion numbers in OpenCV's order."""
    k = numbers(matrix, (3, 3), f"{where}: camera matrix")
    no_skew(k[0, 1], where)
    return make_camera(size, (k[0, 0], k[1, 1], k[0, 2], k[1, 2]), brown(distortion, f"{where}: distortion"), where)


def no_skew(skew: float, where: str) -> None:
    """Refuse pixels whose axes are not square to each other."""
    if skew != 0:
        raise SetupError(
            f"{where}: a skew of {skew:g} has no place in a camera here; calibrate with the skew fixed at 0"
        )


def needed_size(size: tuple[int, int] | None, where: str) -> tuple[int, int]:
    """The size that a person gave, since the file does not say it."""
    if size is None:
        raise SetupError(
            f"{where}: the file does not say the size of the image; give it: size=(width, height), --size WxH"
        )
    return size


def make_pose(rotation: Any, translation: Any, unit_mm: float, where: str) -> Pose:
    """A pose of a matrix (3, 3), made a rotation to the last digit, and a translation (3,) in units of `unit_mm`."""
    matrix = numbers(rotation, (3, 3), f"{where}: rotation")
    nearest = nearest_rotation(matrix)
    if np.linalg.det(matrix) < 0 or np.abs(nearest - matrix).max() > _ROTATION_SLACK:
        raise SetupError(f"{where}: this matrix is no rotation: {np.round(matrix, 4).tolist()}")
    return Pose(nearest, numbers(translation, (3,), f"{where}: translation") * unit_mm)


def pose_of_vector(vector: Any, translation: Any, unit_mm: float, where: str) -> Pose:
    """A pose of a rotation vector (3,) rad and a translation (3,) in units of `unit_mm`."""
    vector = numbers(vector, (3,), f"{where}: rotation vector")
    return Pose.from_rotation_vector(vector, numbers(translation, (3,), f"{where}: translation") * unit_mm)


def vector_of(rotation: np.ndarray) -> np.ndarray:
    """Rotation vector (3,) rad of a matrix (3, 3)."""
    from scipy.spatial.transform import Rotation

    return Rotation.from_matrix(rotation).as_rotvec()


def relative_poses(cameras: Sequence[NamedCamera], what: str) -> list[Pose]:
    """Each camera's pose with the first camera's frame as the world."""
    if len(cameras) == 1:
        return [IDENTITY]
    missing = ", ".join(named.name for named in cameras if named.pose is None)
    if missing:
        raise OutputError(f"{what} relates its cameras to each other, but the place of {missing} is unknown")
    world_from_first = cameras[0].pose.inverse  # type: ignore[union-attr]
    return [IDENTITY, *(named.pose @ world_from_first for named in cameras[1:])]  # type: ignore[operator]


def plain_number(value: float) -> str:
    """A number with all its digits and a point in it, so that YAML 1.1 takes it for a number (not so 1e-05)."""
    text = repr(float(value))
    return text.replace("e", ".0e") if "e" in text and "." not in text else text


def plain_list(values: ArrayLike) -> str:
    """Numbers as [a, b, c], each with all its digits."""
    return f"[{', '.join(map(plain_number, np.ravel(np.asarray(values, dtype=float))))}]"


def file_of_camera(path: PathLike, index: int, count: int) -> Path:
    """Where the camera of this number goes when each has its own file: rig.yml, or rig-0.yml, rig-1.yml, ..."""
    path = Path(path)
    return path if count == 1 else path.with_name(f"{path.stem}-{index}{path.suffix}")
