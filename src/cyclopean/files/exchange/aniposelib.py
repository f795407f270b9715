"""aniposelib's TOML: tables cam_0, cam_1, ... with name, size, matrix, distortions, rotation, translation.

Rotation vector and translation take world coordinates into the camera's, distortions are OpenCV's five numbers
(aniposelib, cameras.py; checked against tests/data/calib/7cam-allen-mouse/calibration.toml). Lengths have the unit of
the board that was used; mm unless told otherwise.
"""

from __future__ import annotations

from collections.abc import Sequence

from ...errors import SetupError
from ..disk import PathLike, parse_toml, replacing
from .named import (
    IDENTITY,
    NamedCamera,
    camera_of_matrix,
    find,
    pose_of_vector,
    read_text,
    vector_of,
)

UNIT_MM = 1.0


def read(path: PathLike, size: tuple[int, int] | None, unit_mm: float) -> list[NamedCamera]:
    """The cameras in the order of the file."""
    document = parse_toml(read_text(path), path)
    tables = {key: table for key, table in document.items() if isinstance(table, dict) and "matrix" in table}
    if not tables:
        _refuse_our_own(document, path)
        raise SetupError(f"{path}: no camera; wanted tables cam_0, cam_1, ... with a matrix, got {', '.join(document)}")
    return [_camera(key, table, unit_mm, f"{path}: {key}") for key, table in tables.items()]


def _refuse_our_own(document, path):
    """An error that says which of our own files this is, if it is one."""
    camera, board = (document[key] if isinstance(document.get(key), dict) else {} for key in ("camera", "board"))
    if "size_px" in camera:
        kind, what = (
            ("setup", "for its camera alone") if "optic" in document else ("camera", "in place of a setup's own")
        )
        raise SetupError(
            f"{path}: this is a {kind} file of cyclopean itself, with nothing to import: give it as it is, with "
            f"{'--setup, or with ' if kind == 'setup' else ''}--camera {what}"
        )
    if "kind" in board:
        raise SetupError(f"{path}: this is a board file of cyclopean: there is no camera in it")


def _camera(key, table, unit_mm, where):
    if table.get("fisheye"):
        raise SetupError(f"{where}: this is a fisheye camera, which has no place here")
    camera = camera_of_matrix(find(table, "size", where), table["matrix"], find(table, "distortions", where), where)
    pose = None
    if "rotation" in table or "translation" in table:
        pose = pose_of_vector(find(table, "rotation", where), find(table, "translation", where), unit_mm, where)
    return NamedCamera(str(table.get("name", key)), camera, pose)


def write(path: PathLike, cameras: Sequence[NamedCamera], unit_mm: float) -> list[str]:
    """All cameras in one file."""
    import tomli_w

    document: dict = {}
    for k, named in enumerate(cameras):
        pose = named.pose or IDENTITY
        document[f"cam_{k}"] = {
            "name": named.name,
            "size": list(named.camera.size),
            "matrix": named.camera.matrix.tolist(),
            "distortions": list(named.camera.distortion),
            "rotation": vector_of(pose.rotation).tolist(),
            "translation": (pose.translation / unit_mm).tolist(),
        }
    document["metadata"] = {}
    with replacing(path) as file:
        file.write(tomli_w.dumps(document).encode())
    if any(named.pose is None for named in cameras):
        return ["aniposelib wants a pose: a camera whose place is unknown stands at the origin"]
    return []
