"""Scenes as TOML files that people write by hand: light and objects, in the camera's frame.

[light]
ambient = 0.6

[[light.lamp]]
position_mm = [-300, -400, 0]
strength = 0.5

[[object]]
kind = "plane"
size_mm = [400, 300]
centre_mm = [0, 0, 900]
rotation_deg = [0, 20, 0]
texture = "speckle"
texture_size_mm = 3
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ..errors import CyclopeanError, SetupError
from ..geometry import Pose
from ..simulation.paints import Checker, Noise, Picture, Speckle, Uniform, as_share, linear_light
from ..simulation.prints import board_surface
from ..simulation.scene import Lamp, Paint, Scene, Surface
from ..simulation.shapes import Shape, box, cylinder, heightmap, plane, sphere
from ..targets.boards import Board
from ..targets.prints import outline
from .boards import board_from, read_board
from .disk import PathLike, parse_toml, read_text
from .photographs import read_photograph

if TYPE_CHECKING:
    from .scene_tables import BoardTable, HeightmapTable, LampTable, MeshTable, PaintedTable

_MOST_PIXELS = 10**8  # of a picture: 1.2 GB in colour
_FINEST = 1000  # steps of a heightmap along its longer side
_SOLID = ("box", "sphere", "cylinder", "mesh")  # speckle and the like go through them
_GREY = 0.5  # of an object without any texture
_FINE = 1 / 80  # of an object's longest side: dots and grains of a texture without a size


def read_scene(path: PathLike) -> Scene:
    """Read a scene file.

    Parameters
    ----------
    path : path
        A TOML file with tables [[object]] and, if wanted, [light]. Files that it names lie beside it.

    Raises
    ------
    SetupError
        With one line for each thing that is wrong in the file.
    """
    return scene_from(parse_toml(read_text(path, "scene file"), path), path)


def scene_from(document: dict[str, Any], path: PathLike) -> Scene:
    """The scene that a document describes; `path` says where it comes from, and where the files lie that it names."""
    from pydantic import ValidationError

    from .scene_faults import sentences
    from .scene_tables import SceneFile

    try:
        given = SceneFile.model_validate(document)
    except ValidationError as error:
        raise SetupError(_joined(path, sentences(error, document))) from None
    surfaces, faults = [], []
    for number, table in enumerate(given.object, 1):
        name = table.name or f"object {number} ({table.kind})"
        try:
            surfaces.append(_surface(table, name, number, Path(path).parent))
        except CyclopeanError as fault:
            faults.append(f"object {number} ({table.kind}): {fault}")
    if faults:
        raise SetupError(_joined(path, faults))
    lamps = tuple(map(_lamp, given.light.lamp))
    background = given.light.background
    return Scene(
        tuple(surfaces), given.light.ambient, lamps, background if isinstance(background, tuple) else (background,)
    )


def _joined(path, faults):
    if len(faults) == 1:
        return f"{path}: {faults[0]}"
    return "\n  ".join([f"{path}: {len(faults)} things are wrong", *faults])


def _lamp(table: LampTable) -> Lamp:
    return Lamp(table.position_mm, table.direction, table.strength, table.shadows, table.distance_mm)


def _surface(table: Any, name: str, number: int, folder: Path) -> Surface:
    """One object of the file, whatever its kind."""
    if table.kind == "board":
        return _board(table, name, folder)
    turn = Pose.from_rotation_vector(np.deg2rad(table.rotation_deg)).rotation
    if table.kind == "mesh":
        return _mesh(table, name, number, folder, turn)
    shape = _shape(table, folder)
    paint, stretched = _paint(table, number, folder, shape)
    pose = Pose(turn, np.array(table.centre_mm))
    return shape.painted(paint, pose, stretched=stretched, name=name, luminous=table.luminous)


def _shape(table, folder) -> Shape:
    if table.kind == "plane":
        return plane(*table.size_mm)
    if table.kind == "box":
        return box(*table.size_mm)
    if table.kind == "sphere":
        return sphere(table.radius_mm)
    if table.kind == "cylinder":
        return cylinder(table.radius_mm, table.length_mm)
    return _relief(table, folder)


def _relief(table: HeightmapTable, folder: Path) -> Shape:
    """A picture's grey as height, at its own resolution or what is fine enough."""
    import cv2

    grey = as_share(_image(folder / table.file))
    grey = grey.mean(axis=-1) if grey.ndim == 3 else grey
    shrink = _FINEST / max(grey.shape)
    if shrink < 1:
        size = tuple(max(2, round(side * shrink)) for side in grey.shape[::-1])
        grey = cv2.resize(grey, size, interpolation=cv2.INTER_AREA)
    return heightmap(grey * table.height_mm, *table.size_mm)


def _paint(table: PaintedTable, number: int, folder: Path, shape: Shape) -> tuple[Paint, bool]:
    """The paint of an object, and whether it is a picture stretched over it once."""
    solid = 3 if table.kind in _SOLID else 2
    if table.texture is None:
        return Uniform(table.color or (_GREY if table.grey is None else table.grey,), solid), False
    seed = number if table.seed is None else table.seed
    size: Any = table.texture_size_mm or _FINE * float(np.ptp(shape.vertices, axis=0).max())  # one number: checked
    if table.texture == "speckle":
        return Speckle(size, table.dark, table.bright, seed, solid), False
    if table.texture == "noise":
        return Noise(size, table.dark, table.bright, seed, solid), False
    if table.texture == "checker":
        return Checker(size, table.dark, table.bright, solid), False
    return _picture(table, table.texture, folder)


def _picture(table: PaintedTable, name: str, folder: Path) -> tuple[Picture, bool]:
    path = folder / name
    if not path.suffix and not path.exists():
        raise SetupError(f'texture = "{name}" is neither "speckle", "noise" or "checker" nor a picture file')
    image = _image(path)
    coded = image.dtype.kind == "u" and not table.linear
    light = linear_light(image) if coded else as_share(image)
    if not np.isfinite(light).all() or light.min() < 0 or light.max() > 1:
        raise SetupError(f"{path}: a texture's values must lie between 0 (black) and 1 (white)")
    if table.texture_size_mm is None:
        return Picture(light, repeat=table.kind == "mesh"), True
    given = table.texture_size_mm
    size = given if isinstance(given, tuple) else (given, given * light.shape[0] / light.shape[1])
    return Picture(light, size, repeat=True), False


def _image(path: Path) -> np.ndarray:
    image = read_photograph(path)
    if image.shape[0] * image.shape[1] > _MOST_PIXELS:
        raise SetupError(
            f"{path}: a picture of {image.shape[1]} x {image.shape[0]} px is too large for a scene; make it smaller, "
            f"{_MOST_PIXELS / 1e6:g} million px at most"
        )
    return image


def _mesh(table: MeshTable, name: str, number: int, folder: Path, turn: np.ndarray) -> Surface:
    from .scene_meshes import read_mesh

    plain = table.texture is None and table.grey is None and table.color is None
    shape, own, places = read_mesh(folder / table.file, table.unit, own_paint=plain)
    middle = (shape.vertices.min(0) + shape.vertices.max(0)) / 2
    there = middle if table.centre_mm is None else np.array(table.centre_mm)
    pose = Pose(turn, there - turn @ middle)
    if own is not None and places is not None:
        return Surface(pose @ shape.vertices, shape.faces, own, places, name, table.luminous)
    paint, stretched = _paint(table, number, folder, shape)
    if isinstance(paint, Picture) and shape.share is None:
        raise SetupError(
            f"{table.file} has no texture coordinates that would say where {table.texture} goes; take "
            '"speckle", "noise" or "checker", which go through the solid'
        )
    if isinstance(paint, Picture) and not stretched:
        raise SetupError("texture_size_mm does not fit a picture on a mesh: its texture coordinates say where it goes")
    return shape.painted(paint, pose, stretched=stretched, name=name, luminous=table.luminous)


def _board(table: BoardTable, name: str, folder: Path) -> Surface:
    board = board_from({"board": table.board}, "board") if table.file is None else read_board(folder / table.file)
    if not isinstance(board, Board):
        raise SetupError(f"{table.file}: points in space have no print; take a board")
    left, top, right, bottom = outline(board)
    turn = Pose.from_rotation_vector(np.deg2rad(table.rotation_deg)).rotation
    middle = np.array([(left + right) / 2, (top + bottom) / 2, 0.0])
    pose = Pose(turn, np.array(table.centre_mm) - turn @ middle)
    return board_surface(board, pose, table.black, table.white, name, table.luminous)
