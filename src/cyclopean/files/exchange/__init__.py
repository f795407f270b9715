"""Cameras in the files of other programs.

>>> cameras = read_cameras("camchain.yaml")  # the format is guessed from name and content
>>> notes = write_cameras("model/", cameras, "colmap")  # what the format cannot hold, in words

One module for each format, with `read(path, size, unit_mm)` and `write(path, cameras, unit_mm)`; its docstring says
where the format is described and what it was checked against.
"""

from __future__ import annotations

import importlib
from collections.abc import Sequence
from pathlib import Path

from ...errors import OutputError, SetupError
from ..disk import PathLike
from .camera_file import write_camera
from .named import NamedCamera, file_of_camera, flipped

__all__ = ["FORMATS", "NamedCamera", "flipped", "guess_format", "read_cameras", "write_camera", "write_cameras"]

FORMATS = ("opencv", "ros", "kalibr", "mrcal", "colmap", "aniposelib", "matchid", "dice", "nerfstudio")
ONE_A_FILE = ("opencv", "ros", "mrcal")  # formats with one file for each camera
_BY_SUFFIX = {".cameramodel": "mrcal", ".caldat": "matchid", ".toml": "aniposelib", ".bin": "colmap"}
_BY_NAME = {"cameras.txt": "colmap", "images.txt": "colmap", "transforms.json": "nerfstudio"}
# what the beginning of a file holds, for suffixes that several formats share
_BY_CONTENT = (
    ("%YAML:1.0", "opencv"),
    ("opencv_storage", "opencv"),
    ("opencv-matrix", "opencv"),
    ("<ParameterList", "dice"),
    ("camera_matrix:", "ros"),
    ("camera_model: pinhole", "kalibr"),
    ("T_cn_cnm1", "kalibr"),
    ("cam0:", "kalibr"),
    ('"frames"', "nerfstudio"),
    ('"fl_x"', "nerfstudio"),
    ('"camera_angle_x"', "nerfstudio"),
    ("lensmodel", "mrcal"),
    ("lens_model", "mrcal"),
    ("Cam0_Fx", "matchid"),
    ("Cam1_Fx", "matchid"),
)
_SCANNED = 100_000  # characters


def read_cameras(
    path: PathLike, format: str | None = None, size: tuple[int, int] | None = None, unit_mm: float | None = None
) -> list[NamedCamera]:
    """Cameras from another program's file.

    Parameters
    ----------
    path : path
        A file, or for COLMAP the folder of a sparse model.
    format : str, optional
        One of `FORMATS`; guessed from the file's name and content where not given.
    size : (width, height) px, optional
        Of the image, for files that do not say it (MatchID, some of OpenCV's).
    unit_mm : float, optional
        What one unit of length of the file is, mm. Metres for ROS, Kalibr and mrcal, mm for the others where not
        given; several programs leave it open.

    Returns
    -------
    list of NamedCamera
        Pixels count as everywhere here: (0, 0) is the centre of the top-left pixel.

    Raises
    ------
    SetupError
        When the file is missing or damaged, or holds what a camera here cannot be: skew, a fisheye lens, distortion
        beyond k1 k2 p1 p2 k3.
    """
    name = format or guess_format(path)
    module = _module(name)
    return module.read(path, size, _unit(unit_mm, module))


def write_cameras(
    path: PathLike, cameras: Sequence[NamedCamera], format: str | None = None, unit_mm: float | None = None
) -> list[str]:
    """Write cameras for another program.

    Parameters
    ----------
    path : path
        Where to write: a file; for COLMAP a folder. Formats of one camera a file (OpenCV, ROS, mrcal) write
        rig-0.yml, rig-1.yml, ... when there are several.
    cameras : sequence of NamedCamera
    format : str, optional
        One of `FORMATS`; guessed from the file's name where not given.
    unit_mm : float, optional
        As in `read_cameras`.

    Returns
    -------
    list of str
        What the format does not hold, and where else something was written, in words.

    Raises
    ------
    OutputError
        When the format cannot hold the cameras: a mirrored one (no format here can; see `flipped`), k3, or a number of
        cameras.
    """
    if not cameras:
        raise OutputError(f"{path}: there is no camera to write")
    mirrored = ", ".join(named.name for named in cameras if named.mirrored)
    if mirrored:
        raise OutputError(
            f"{path}: {mirrored}: mirrored, which the file cannot say; flip the photograph left to right and write "
            "flipped(camera) (cyclopean export --flip)"
        )
    module = _module(format or _guess_by_name(path))
    notes = module.write(path, cameras, _unit(unit_mm, module))
    if module.__name__.endswith(ONE_A_FILE) and len(cameras) > 1:
        files = (file_of_camera(path, k, len(cameras)).name for k in range(len(cameras)))
        notes.insert(0, f"one file for each camera: {', '.join(files)}")
    if any(named.camera.pixel_pitch is not None for named in cameras):
        notes.append("the distance between pixels (mm) is not in the file")
    return notes


def guess_format(path: PathLike) -> str:
    """The format that the name of a file, or its beginning, speaks for.

    Raises
    ------
    SetupError
        When neither does.
    """
    path = Path(path)
    name = _by_name(path)
    if name is not None or path.is_dir():
        return name or "colmap"
    from .named import read_text

    text = read_text(path)[:_SCANNED]
    for sign, name in _BY_CONTENT:
        if sign in text:
            return name
    if path.suffix.lower() == ".json":
        return "opencv"
    raise SetupError(f"{path}: no format is known by this name or content; say which: {', '.join(FORMATS)}")


def _by_name(path: Path) -> str | None:
    return _BY_NAME.get(path.name.lower()) or _BY_SUFFIX.get(path.suffix.lower())


def _guess_by_name(path: PathLike) -> str:
    name = _by_name(Path(path))
    if name is None:
        raise OutputError(f"{path}: the name does not tell the format; say which: {', '.join(FORMATS)}")
    return name


def _module(name: str):
    if name not in FORMATS:
        raise SetupError(f"unknown format {name!r}; known are {', '.join(FORMATS)}")
    return importlib.import_module(f".{name}", __name__)


def _unit(unit_mm: float | None, module) -> float:
    if unit_mm is None:
        return module.UNIT_MM
    if not 0 < unit_mm < float("inf"):
        raise SetupError(f"unit_mm must be a number of mm above 0, got {unit_mm}")
    return float(unit_mm)
