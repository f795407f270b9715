"""DICe's camera system, XML: parameter lists CAMERA 0, CAMERA 1, ...

Read by Camera_System::read_camera_system_file (DICe, src/core/DICe_CameraSystem.cpp): CX CY FX FY FS K1 K2 K3 P1 P2,
LENS_DISTORTION_MODEL, IMAGE_HEIGHT_WIDTH, TX TY TZ, and ALPHA BETA GAMMA (deg, Rz Ry Rx) or rotation_3x3_matrix, which
take world coordinates into the camera's; with extrinsics_relative_camera_to_camera the second camera's take those of
the first. Checked against tests/component/cal/sim_white_dot_cal_gold.xml. VIC-3D's own files are refused: how they
distort is not documented.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from xml.etree import ElementTree
from xml.sax.saxutils import quoteattr

import numpy as np

from ...errors import OutputError, SetupError
from ..disk import PathLike, replacing
from .named import (
    IDENTITY,
    NamedCamera,
    brown,
    find,
    make_camera,
    make_pose,
    no_skew,
    number,
    numbers,
    read_text,
)

UNIT_MM = 1.0
_FORMAT = "DICe_xml_camera_system_file"
_OPENCV_ORDER = ("K1", "K2", "P1", "P2", "K3", "K4", "K5", "K6", "S1", "S2", "S3", "S4", "T1", "T2")
_MOST_CAMERAS = 9  # DICe stops at the tenth


def read(path: PathLike, size: tuple[int, int] | None, unit_mm: float) -> list[NamedCamera]:
    """The cameras of the system."""
    document = _document(path)
    if document.get("xml_file_format") != _FORMAT:
        raise SetupError(
            f"{path}: xml_file_format is {document.get('xml_file_format')!r}, wanted {_FORMAT}: this is no camera "
            "system of DICe, or one of an old version; write it anew with DICe 2 or later"
        )
    cameras: list[NamedCamera] = []
    while isinstance(table := document.get(f"CAMERA {len(cameras)}"), dict):
        where = f"{path}: CAMERA {len(cameras)}"
        pose = make_pose(_rotation(table, where), [table.get(name, 0.0) for name in ("TX", "TY", "TZ")], unit_mm, where)
        if cameras and str(document.get("extrinsics_relative_camera_to_camera", "false")).lower() == "true":
            pose = pose @ cameras[0].pose
        name = table.get("CAMERA_ID") or f"CAMERA {len(cameras)}"
        cameras.append(NamedCamera(name, _camera(table, where), pose))
    if not cameras:
        raise SetupError(f"{path}: no camera; wanted a ParameterList named CAMERA 0")
    return cameras


def _camera(table, where):
    height, width = _array(find(table, "IMAGE_HEIGHT_WIDTH", where), 2, f"{where}: IMAGE_HEIGHT_WIDTH")
    no_skew(number(table.get("FS", 0.0), f"{where}: FS"), f"{where}: FS")
    lens = [number(table.get(name, 0.0), f"{where}: {name}") for name in _OPENCV_ORDER]
    model = table.get("LENS_DISTORTION_MODEL", "NO_LENS_DISTORTION")
    if model == "NO_LENS_DISTORTION":
        lens = []
    elif model == "K1R3_K2R5_K3R7":  # of the distance from the axis: what OpenCV has of its square
        lens = [lens[0], lens[1], 0.0, 0.0, lens[4]]
    elif model != "OPENCV_LENS_DISTORTION" and any(lens):
        raise SetupError(f"{where}: LENS_DISTORTION_MODEL {model} has no place here; wanted OPENCV_LENS_DISTORTION")
    values = [find(table, name, where) for name in ("FX", "FY", "CX", "CY")]
    return make_camera((width, height), values, brown(lens, where), where)


def _rotation(table, where):
    from scipy.spatial.transform import Rotation

    if isinstance(rows := table.get("rotation_3x3_matrix"), dict):
        return [_array(find(rows, f"ROW {k}", where), 3, f"{where}: rotation, row {k}") for k in range(3)]
    angles = [number(table.get(name, 0.0), f"{where}: {name}") for name in ("ALPHA", "BETA", "GAMMA")]
    return Rotation.from_euler("xyz", angles, degrees=True).as_matrix()


def _array(text, count, where):
    return numbers(re.sub(r"[{}]", "", str(text)).split(","), (count,), where)


def _document(path: PathLike):
    text = read_text(path)
    if re.search(r"<!DOCTYPE|<!ENTITY", text):
        raise SetupError(
            f"{path}: this looks like a file of VIC-3D, whose lens distortion is not documented; use DICe's"
        )
    try:
        root = ElementTree.fromstring(text)
    except ElementTree.ParseError as fault:
        raise SetupError(f"{path}: this is not XML: {fault}") from None
    if root.tag != "ParameterList":
        raise SetupError(f"{path}: the file starts with <{root.tag}>, wanted <ParameterList>: no camera system of DICe")
    return _table(root)


def _table(element):
    return {
        child.get("name", ""): _table(child) if child.tag == "ParameterList" else child.get("value", "")
        for child in element
    }


def write(path: PathLike, cameras: Sequence[NamedCamera], unit_mm: float) -> list[str]:
    """A camera system; DICe takes one or two cameras for correlation."""
    if len(cameras) > _MOST_CAMERAS:
        raise OutputError(f"{path}: DICe reads at most {_MOST_CAMERAS} cameras, got {len(cameras)}")
    lines = ["<ParameterList>", _parameter("xml_file_format", "string", _FORMAT)]
    lines.append(_parameter("system_type_3D", "string", "OPENCV"))
    for k, named in enumerate(cameras):
        lines += [f'  <ParameterList name="CAMERA {k}">', *_lines(named, unit_mm), "  </ParameterList>"]
    with replacing(path) as file:
        file.write(("\n".join([*lines, "</ParameterList>"]) + "\n").encode())
    if any(named.pose is None for named in cameras):
        return ["DICe wants a pose: a camera whose place is unknown stands at the origin"]
    return []


def _lines(named: NamedCamera, unit_mm: float) -> list[str]:
    camera, pose = named.camera, named.pose or IDENTITY
    names = ("FX", "FY", "CX", "CY", "K1", "K2", "P1", "P2", "K3", "TX", "TY", "TZ")
    values = (*camera.focal, *camera.centre, *camera.distortion, *pose.translation / unit_mm)
    rows = [
        "  " + _parameter(f"ROW {k}", "string", f"{{ {', '.join(repr(float(value)) for value in row)} }}")
        for k, row in enumerate(np.asarray(pose.rotation))
    ]
    return [
        _parameter("CAMERA_ID", "string", named.name),
        *(_parameter(name, "double", repr(float(value))) for name, value in zip(names, values, strict=True)),
        '    <ParameterList name="rotation_3x3_matrix">',
        *rows,
        "    </ParameterList>",
        _parameter("LENS_DISTORTION_MODEL", "string", "OPENCV_LENS_DISTORTION"),
        _parameter("IMAGE_HEIGHT_WIDTH", "string", f"{{ {camera.size[1]}, {camera.size[0]} }}"),
    ]


def _parameter(name: str, kind: str, value: str) -> str:
    return f'    <Parameter name={quoteattr(name)} type="{kind}" value={quoteattr(value)} />'
