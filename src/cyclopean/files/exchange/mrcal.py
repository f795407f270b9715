"""mrcal's .cameramodel: a Python dictionary, one camera in each file.

lensmodel, intrinsics [fx, fy, cx, cy, distortion ...], imagersize, and rt_cam_ref (formerly extrinsics): a rotation
vector and a translation that take reference coordinates into the camera's (mrcal documentation, "Camera model
representation in memory and on disk"; checked against the models in mrcal's own test/data). LENSMODEL_OPENCV5 is
k1 k2 p1 p2 k3. mrcal leaves the unit of length open and uses metres in practice: that is what we take.
"""

from __future__ import annotations

import ast
import re
import warnings
from collections.abc import Sequence
from pathlib import Path

from ...errors import SetupError
from ..disk import PathLike, replacing
from .named import (
    NamedCamera,
    brown,
    file_of_camera,
    find,
    make_camera,
    numbers,
    plain_list,
    pose_of_vector,
    read_text,
    vector_of,
)

UNIT_MM = 1000.0
_LENS = re.compile(r"LENSMODEL_(PINHOLE|OPENCV(4|5|8|12))$")


def read(path: PathLike, size: tuple[int, int] | None, unit_mm: float) -> list[NamedCamera]:
    """The one camera of the file."""
    text = read_text(path).strip()
    try:
        with warnings.catch_warnings():  # Python wonders aloud at damaged numbers
            warnings.simplefilter("ignore", SyntaxWarning)
            document = ast.literal_eval(text)
    except (ValueError, SyntaxError, RecursionError, MemoryError, TypeError):
        raise SetupError(f"{path}: this is no mrcal camera model: wanted a Python dictionary") from None
    where = str(path)
    lens = document.get("lensmodel", document.get("lens_model")) if isinstance(document, dict) else None
    if lens is None:
        lens = find(document, "lensmodel", where)
    match = _LENS.match(str(lens))
    if match is None:
        raise SetupError(
            f"{path}: {lens} has no place here; wanted LENSMODEL_OPENCV4, LENSMODEL_OPENCV5 or LENSMODEL_PINHOLE"
        )
    count = 4 + int(match.group(2) or 0)
    values = numbers(find(document, "intrinsics", where), (count,), f"{where}: intrinsics of {lens}")
    camera = make_camera(find(document, "imagersize", where), values[:4], brown(values[4:], f"{where}: {lens}"), where)
    key = "rt_cam_ref" if "rt_cam_ref" in document else "extrinsics"
    motion = numbers(find(document, key, where), (6,), f"{where}: {key}")
    return [NamedCamera(Path(path).stem, camera, pose_of_vector(motion[:3], motion[3:], unit_mm, where))]


def write(path: PathLike, cameras: Sequence[NamedCamera], unit_mm: float) -> list[str]:
    """One file for each camera."""
    for k, named in enumerate(cameras):
        camera = named.camera
        motion = [0.0] * 6
        if named.pose is not None:
            motion = [*vector_of(named.pose.rotation), *named.pose.translation / unit_mm]
        text = (
            "{\n"
            "    'lensmodel': 'LENSMODEL_OPENCV5',\n\n"
            "    # fx, fy, cx, cy, k1, k2, p1, p2, k3\n"
            f"    'intrinsics': {plain_list([*camera.focal, *camera.centre, *camera.distortion])},\n\n"
            "    # rt_fromref: rotation vector and translation that take the reference frame into the camera's\n"
            f"    'extrinsics': {plain_list(motion)},\n\n"
            f"    'imagersize': {list(camera.size)}\n"
            "}\n"
        )
        with replacing(file_of_camera(path, k, len(cameras))) as file:
            file.write(text.encode())
    if any(named.pose is None for named in cameras):
        return ["mrcal wants a pose: a camera whose place is unknown stands at the reference frame's origin"]
    return []
