"""Rigs of virtual cameras as TOML files: what a calibration without a model of the optic leaves for later sessions.

kind = "virtual cameras"
size_px = [1280, 960]

[[view]]
name = "facet 0"
focal_px = [2391.2, 2405.7]
centre_px = [652.3, 480.1]
distortion = [0.01, -0.2, 0.0, 0.001, 0.0]
rotation_deg = [0.1, 6.3, -0.1]
translation_mm = [-20.1, 0.0, 2.2]
mirrored = false
margin_px = 1.5
region_px = [[[639.5, -0.5], [1279.5, -0.5], [1279.5, 959.5], [639.5, 959.5]]]

The rotation vector and the translation turn coordinates of the rig's frame into those of the view's own camera. A
region is one polygon or more; a pixel belongs to it when an odd number of them go round its centre.
"""

from __future__ import annotations

import difflib
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from .. import __version__
from ..cameras import Camera
from ..errors import OutputError, SetupError
from ..geometry import Pose, rotation_vector
from ..rigs import PinholeView, Region, Rig
from .disk import PathLike, on_one_line, parse_toml, read_text, replacing

if TYPE_CHECKING:
    from pydantic import BaseModel

KIND = "virtual cameras"
FORMAT = 1
HEADER = f"""\
# cyclopean virtual cameras, format {FORMAT}, written by cyclopean {__version__}
# Units stand in the names. Pixel (0, 0) is the centre of the top-left one. Rotation vector and translation turn
# coordinates of the rig's frame (x right, y down, z forward) into those of the view's own camera.

"""
_SIMPLER = (0.48, 0.3, 0.1, 0.03, 0.01)  # px by which a written outline may differ, as long as no pixel changes sides


def write_pinholes(rig: Rig, path: PathLike) -> None:
    """Write a rig of virtual cameras so that `read_pinholes` gives the same views, with the same pixels.

    Raises
    ------
    OutputError
        With the reason, when the file cannot be written or a view is no `PinholeView`.
    """
    import tomli_w

    views = []
    for view in rig:
        if not isinstance(view, PinholeView):
            raise OutputError(
                f"{path}: cannot be written: {view.name} looks through an optic (write_setup keeps its setup); "
                "pinhole_rig makes virtual cameras of views"
            )
        views.append(_table(view))
    document = {"kind": KIND, "size_px": list(rig.size), "view": views}
    with replacing(path) as file:
        file.write((HEADER + on_one_line(tomli_w.dumps(document))).encode())


def read_pinholes(path: PathLike) -> Rig:
    """Read a rig of virtual cameras.

    Raises
    ------
    SetupError
        With one line for each thing that is wrong in the file.
    """
    from pydantic import ValidationError

    from .pinhole_tables import RigTable

    document = parse_toml(read_text(path, "file of virtual cameras"), path)
    if document.get("kind") != KIND:
        raise SetupError(f'{path}: kind must be "{KIND}", got {document.get("kind")!r}; read_setup reads setups')
    try:
        table = RigTable.model_validate(document)
    except ValidationError as error:
        faults = list(dict.fromkeys(_sentence(detail, document, RigTable) for detail in error.errors()))
        raise SetupError("\n  ".join([f"{path}: {len(faults)} wrong", *faults])) from None
    return Rig(tuple(_view(view, table.size_px) for view in table.view))


def _table(view: PinholeView) -> dict[str, Any]:
    table = {
        "name": view.name,
        "focal_px": list(view.camera.focal),
        "centre_px": list(view.camera.centre),
        "distortion": list(view.camera.distortion),
        "rotation_deg": np.degrees(rotation_vector(view.camera_from_rig.rotation)).tolist(),
        "translation_mm": np.asarray(view.camera_from_rig.translation, dtype=float).tolist(),
        "mirrored": bool(view.mirrored),
        "margin_px": float(view.margin),
        "shot": int(view.shot),
    }
    if view.channel is not None:
        table["channel"] = int(view.channel)
    return table | {"region_px": [polygon.tolist() for polygon in polygons(view.region)]}


def _view(table: Any, size: tuple[int, int]) -> PinholeView:
    pose = Pose.from_rotation_vector(np.deg2rad(table.rotation_deg), table.translation_mm)
    camera = Camera(size, table.focal_px, table.centre_px, table.distortion)
    region = Region(inside([np.array(polygon) for polygon in table.region_px], size), table.margin_px)
    return PinholeView(camera, pose, region, table.mirrored, table.name, table.shot, table.channel)


def polygons(region: Region) -> list[np.ndarray]:
    """Few-cornered polygons (N, 2) px around a region's traced pixels, which `inside` turns back into just these."""
    plain = Region(region.traced, region.margin).outline  # between pixels; region.outline knows better, but may graze
    found = [_simplified(outline, region.traced) for outline in (region.outline, plain)]
    return min((lines for lines in found if lines is not None), key=lambda lines: sum(map(len, lines)), default=plain)


def _simplified(outline: list[np.ndarray], traced: np.ndarray) -> list[np.ndarray] | None:
    """The polygons with fewer corners, as long as they go round just the traced pixels; None where they do not."""
    import cv2

    for tolerance in _SIMPLER:
        lines = [cv2.approxPolyDP(line.astype(np.float32), tolerance, True)[:, 0] for line in outline]
        rounded = [np.round(line.astype(float), 3) for line in lines if len(line) >= 3]
        if np.array_equal(inside(rounded, traced.shape[::-1]), traced):
            return rounded
    return None


def inside(outlines: Sequence[np.ndarray], size: tuple[int, int]) -> np.ndarray:
    """Pixels (H, W) bool whose centres an odd number of closed polygons (N, 2) px go round.

    References
    ----------
    Hormann and Agathos 2001, The point in polygon problem for arbitrary polygons: the even-odd rule.
    """
    width, height = size
    crossings = np.zeros((height, width + 1), dtype=np.int64)
    for outline in outlines:
        for (x0, y0), (x1, y1) in zip(outline, np.roll(outline, -1, axis=0), strict=True):
            if y0 > y1:
                x0, y0, x1, y1 = x1, y1, x0, y0
            rows = np.arange(max(int(np.ceil(y0)), 0), min(int(np.ceil(y1)), height))
            if rows.size:
                x = x0 + (rows - y0) * (x1 - x0) / (y1 - y0)
                crossings[rows, np.clip(np.ceil(x), 0, width).astype(int)] += 1
    return np.cumsum(crossings, axis=1)[:, :width] % 2 == 1


def _sentence(detail: Any, document: dict[str, Any], table: type[BaseModel]) -> str:
    """What is wrong with a key, and what it takes."""
    from .pinhole_tables import ViewTable

    place = list(detail["loc"])
    here: type[BaseModel] = table
    if place[:1] == ["view"] and len(place) > 2 and isinstance(place[1], int):
        document, here = document["view"][place[1]], ViewTable
    key = str(place[2] if here is ViewTable else place[0])
    name = f"view[{place[1]}].{key}" if here is ViewTable else key
    if detail["type"] == "extra_forbidden":
        close = difflib.get_close_matches(key, here.model_fields, n=1)
        return f"{name}: unknown key; " + (
            f"did you mean {close[0]}?" if close else f"known: {', '.join(here.model_fields)}"
        )
    wanted = here.model_fields[key].description if key in here.model_fields else "a table [[view]]"
    if key not in document:
        return f"{name} is missing: {wanted}"
    value = str(document[key])
    return f"{name} = {value if len(value) <= 60 else value[:60] + '...'} must be {wanted}"
