"""Kalibr's camera chain (camchain YAML), pinhole cameras with radtan distortion.

Each camN has camera_model, intrinsics [fu, fv, pu, pv], distortion_model, distortion_coeffs [k1, k2, r1, r2],
resolution, and from the second on T_cn_cnm1 (4x4), which takes points of camera N - 1 into camera N, in metres
(Kalibr wiki, "Yaml formats"; checked against camera chains that Kalibr wrote). radtan is OpenCV's k1 k2 p1 p2.
The first camera's frame is the world. What belongs to an IMU is left out.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ...errors import OutputError, SetupError
from ...geometry import Pose
from ..disk import PathLike, replacing
from .named import (
    IDENTITY,
    NamedCamera,
    brown,
    find,
    make_camera,
    make_pose,
    numbers,
    plain_list,
    relative_poses,
)
from .yaml_text import quoted, read_yaml

UNIT_MM = 1000.0


def read(path: PathLike, size: tuple[int, int] | None, unit_mm: float) -> list[NamedCamera]:
    """The cameras of the chain, in its order."""
    document = read_yaml(path)
    names = sorted((key for key in document if _is_camera(key)), key=lambda key: int(key[3:]))
    if not names:
        raise SetupError(f"{path}: no camera; wanted tables cam0, cam1, ..., got {', '.join(map(str, document))}")
    cameras: list[NamedCamera] = []
    for name in names:
        where = f"{path}: {name}"
        table = document[name]
        camera = _camera(table, where)
        pose: Pose | None = IDENTITY if not cameras else None
        if cameras and "T_cn_cnm1" in table and cameras[-1].pose is not None:
            matrix = numbers(table["T_cn_cnm1"], (4, 4), f"{where}: T_cn_cnm1")
            pose = make_pose(matrix[:3, :3], matrix[:3, 3], unit_mm, f"{where}: T_cn_cnm1") @ cameras[-1].pose
        label = str(table.get("rostopic") or name).strip("/").removesuffix("/image_raw")
        cameras.append(NamedCamera(label, camera, pose))
    return cameras


def _is_camera(key):
    return isinstance(key, str) and key.startswith("cam") and key[3:].isdigit()


def _camera(table, where):
    model = find(table, "camera_model", where)
    if model != "pinhole":
        raise SetupError(f"{where}: camera_model is {model!r}; only pinhole has a place here")
    lens = table.get("distortion_model", "none")
    if lens not in ("radtan", "none", None):
        raise SetupError(f"{where}: distortion_model is {lens!r}; only radtan (k1 k2 p1 p2) and none have a place here")
    coefficients = find(table, "distortion_coeffs", where) if lens == "radtan" else ()
    distortion = brown(coefficients, f"{where}: distortion_coeffs")
    return make_camera(find(table, "resolution", where), find(table, "intrinsics", where), distortion, where)


def write(path: PathLike, cameras: Sequence[NamedCamera], unit_mm: float) -> list[str]:
    """One chain of all cameras; poses are told from one camera to the next."""
    lines: list[str] = []
    poses = relative_poses(cameras, "a Kalibr camera chain")
    for k, (named, pose) in enumerate(zip(cameras, poses, strict=True)):
        camera = named.camera
        if camera.distortion[4] != 0:
            raise OutputError(
                f"{named.name}: radtan has k1 k2 p1 p2 but no k3 (it is {camera.distortion[4]:g}); calibrate with k3 "
                "fixed at 0, or choose opencv, ros, mrcal, colmap or aniposelib"
            )
        others = [other for other in range(len(cameras)) if other != k]
        lines += [
            f"cam{k}:",
            f"  cam_overlaps: {others}",
            "  camera_model: pinhole",
            f"  intrinsics: {plain_list([*camera.focal, *camera.centre])}",
            "  distortion_model: radtan",
            f"  distortion_coeffs: {plain_list(camera.distortion[:4])}",
            f"  resolution: {list(camera.size)}",
            f"  rostopic: {quoted(named.name)}",
        ]
        if k:
            step = pose @ poses[k - 1].inverse
            rows = np.column_stack([step.rotation, step.translation / unit_mm])
            lines += ["  T_cn_cnm1:", *(f"  - {plain_list(row)}" for row in rows), "  - [0.0, 0.0, 0.0, 1.0]"]
    with replacing(path) as file:
        file.write(("\n".join(lines) + "\n").encode())
    if cameras[0].pose is not None and not _is_identity(cameras[0].pose):
        return ["a Kalibr camera chain takes its first camera for the world: the rig's own frame is not in the file"]
    return []


def _is_identity(pose):
    return np.allclose(pose.rotation, np.eye(3)) and np.allclose(pose.translation, 0)
