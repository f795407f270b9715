"""MatchID's .caldat: a stereo pair, one ``name;value`` on each line.

MatchID is closed; the names, units and the sense of the angles are those that pyvale (blender/stereosystem.py) and
OpenCorr write and read: Cam0_* and Cam1_* (older files count from 1) with Fx Fy Fs Cx Cy [pixels], Kappa 1 to 3, P1,
P2, and Tx Ty Tz [mm], Theta Phi Psi [deg]. Points of the first camera go into the second by
Rz(Psi) Ry(Phi) Rx(Theta) and then T. The file does not say the size of the image.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path

from ...errors import OutputError, SetupError
from ..disk import PathLike, replacing
from .named import (
    IDENTITY,
    NamedCamera,
    find,
    make_camera,
    make_pose,
    needed_size,
    no_skew,
    number,
    plain_number,
    read_text,
    relative_poses,
)

UNIT_MM = 1.0
_LENS = ("kappa1", "kappa2", "p1", "p2", "kappa3")


def read(path: PathLike, size: tuple[int, int] | None, unit_mm: float) -> list[NamedCamera]:
    """The two cameras; the first one's frame is the world."""
    from scipy.spatial.transform import Rotation

    values = _values(path)
    size = needed_size(size, str(path))
    prefixes = ("cam0_", "cam1_") if "cam0_fx" in values else ("cam1_", "cam2_")
    cameras = [_camera(values, prefix, size, f"{path}") for prefix in prefixes]
    angles = [find(values, name, str(path)) for name in ("theta", "phi", "psi")]
    rotation = Rotation.from_euler("xyz", angles, degrees=True).as_matrix()
    pose = make_pose(rotation, [find(values, name, str(path)) for name in ("tx", "ty", "tz")], unit_mm, str(path))
    stem = Path(path).stem
    return [NamedCamera(f"{stem}-{k}", camera, (IDENTITY, pose)[k]) for k, camera in enumerate(cameras)]


def _camera(values, prefix, size, where):
    fx, fy, cx, cy = (find(values, f"{prefix}{name}", where) for name in ("fx", "fy", "cx", "cy"))
    no_skew(values.get(f"{prefix}fs", 0.0), f"{where}: {prefix}fs")
    return make_camera(size, (fx, fy, cx, cy), [values.get(f"{prefix}{name}", 0.0) for name in _LENS], where)


def _values(path: PathLike) -> dict[str, float]:
    """The numbers by name, in small letters, without units and spaces."""
    values: dict[str, float] = {}
    for count, line in enumerate(read_text(path).splitlines(), 1):
        if not line.strip():
            continue
        name, separator, value = line.partition(";")
        if not separator:
            raise SetupError(f"{path}: line {count}: wanted name;value, got {line!r:.60}")
        key = re.sub(r"\[.*?\]|\s", "", name).lower()
        values[key] = number(value.strip().rstrip(";"), f"{path}: line {count}: {name.strip()}")
    return values


def write(path: PathLike, cameras: Sequence[NamedCamera], unit_mm: float) -> list[str]:
    """A pair of cameras; the first one's frame is the world."""
    from scipy.spatial.transform import Rotation

    if len(cameras) != 2:
        raise OutputError(f"{path}: a .caldat file holds two cameras, got {len(cameras)}; choose two views")
    lines = []
    for k, named in enumerate(cameras):
        camera = named.camera
        k1, k2, p1, p2, k3 = camera.distortion
        entries = {
            "Fx [pixels]": camera.focal[0],
            "Fy [pixels]": camera.focal[1],
            "Fs [pixels]": 0.0,
            "Kappa 1": k1,
            "Kappa 2": k2,
            "Kappa 3": k3,
            "P1": p1,
            "P2": p2,
            "Cx [pixels]": camera.centre[0],
            "Cy [pixels]": camera.centre[1],
        }
        lines += [f"Cam{k}_{name};{plain_number(value)}" for name, value in entries.items()]
    pose = relative_poses(cameras, "a .caldat file")[1]
    angles = Rotation.from_matrix(pose.rotation).as_euler("xyz", degrees=True)
    lines += [
        f"T{axis} [mm];{plain_number(value)}" for axis, value in zip("xyz", pose.translation / unit_mm, strict=True)
    ]
    lines += [
        f"{name} [deg];{plain_number(value)}" for name, value in zip(("Theta", "Phi", "Psi"), angles, strict=True)
    ]
    with replacing(path) as file:
        file.write(("\n".join(lines) + "\n").encode())
    width, height = cameras[0].camera.size
    return [
        f"a .caldat file does not say the size of the image ({width} x {height} px), nor the names of the views",
        "it takes its first camera for the world: the rig's own frame is not in the file",
    ]
