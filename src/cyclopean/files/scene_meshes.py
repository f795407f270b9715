"""Meshes from files, with whatever colour they bring."""

from __future__ import annotations

import io
from pathlib import Path
from typing import Any

import numpy as np

from ..errors import SetupError
from ..simulation.paints import Colours, Picture, linear_light
from ..simulation.scene import Paint
from ..simulation.shapes import Shape
from .disk import PathLike, read_bytes
from .meshes import UNITS

ENDINGS = (".stl", ".ply", ".obj", ".glb", ".off")
_FARTHEST = 1e7  # mm, of a corner from the file's origin
_FLAT = 1e-12  # of the square of a mesh's size: a triangle with less area is a line


def read_mesh(
    path: PathLike, unit: str = "mm", own_paint: bool = True
) -> tuple[Shape, Paint | None, np.ndarray | None]:
    """Read a mesh file.

    Parameters
    ----------
    path : path
        STL, PLY, OBJ, GLB or OFF; several parts become one.
    unit : str
        That of the file's numbers; a GLB file is in metres by its standard, whatever is said here.
    own_paint : bool
        Whether the file's own colours are wanted: then the files that it names for them must be there.

    Returns
    -------
    Shape
        In mm, at the file's own place.
    Paint or None
        The file's own texture picture, its vertices' colours, or the colour of its material.
    (N, 2 or 3) array or None
        The places of the vertices on that paint.

    Raises
    ------
    SetupError
        When the file is missing or no mesh, or a file that it names is missing.
    """
    path = Path(path)
    ending = path.suffix.lower()
    if ending not in ENDINGS:
        raise SetupError(f"{path}: a mesh is read from {', '.join(ENDINGS)}, not from {ending or 'a file of no kind'}")
    data = read_bytes(path, SetupError)
    mesh = _loaded(path, data, ending)
    vertices = np.asarray(mesh.vertices, dtype=float) / UNITS["m" if ending == ".glb" else unit]
    faces = np.asarray(mesh.faces, dtype=np.int64)
    _check(path, vertices, faces)
    if own_paint and ending == ".obj":
        _check_companions(path, data)
    share = _texture_places(mesh, len(vertices))
    paint, places = _own_paint(mesh, share, len(vertices), ending) if own_paint else (None, None)
    return Shape(vertices, faces, None, share), paint, places


def _check(path: Path, vertices: np.ndarray, faces: np.ndarray) -> None:
    """A SetupError where corners or triangles are none."""
    if faces.min() < 0 or faces.max() >= len(vertices):
        wrong = faces.min() if faces.min() < 0 else faces.max()
        raise SetupError(f"{path}: a triangle names corner {wrong}, but there are {len(vertices)}; export it again")
    count = np.count_nonzero(~np.isfinite(vertices).all(1))
    if count:
        raise SetupError(
            f"{path}: {count} of {len(vertices)} corners are not numbers; repair the mesh or export it again"
        )
    if np.abs(vertices).max() > _FARTHEST:
        raise SetupError(
            f"{path}: corners lie up to {np.abs(vertices).max():.3g} mm from the origin, more than {_FARTHEST:g}; is "
            "the unit right, and the file whole?"
        )
    a, b, c = np.moveaxis(vertices[faces], 1, 0)
    area = np.linalg.norm(np.cross(b - a, c - a), axis=1) / 2
    if not (area > _FLAT * np.ptp(vertices, axis=0).max() ** 2).any():
        raise SetupError(f"{path}: every triangle is a line or a point: the mesh has no surface; export it again")


def _check_companions(path: Path, data: bytes) -> None:
    """A SetupError where a material file that an OBJ file names, or a picture that this names, is missing."""
    materials = _named(data, "mtllib")
    pictures = [name for file in materials if (path.parent / file).is_file()
                for name in _named((path.parent / file).read_bytes(), "map_Kd")]  # fmt: skip
    missing = [name for name in (*materials, *pictures) if not (path.parent / name).is_file()]
    if missing:
        raise SetupError(
            f"{path}: its colours are in {', '.join(missing)}, which is not there; copy it beside the mesh, or give "
            "the object a grey, color or texture"
        )


def _named(data: bytes, word: str) -> list[str]:
    """The files that lines such as `mtllib part.mtl` of OBJ and MTL files name; options before the name left out."""
    lines = [line.strip().split(maxsplit=1) for line in data.decode("utf-8", "replace").splitlines()]
    rest = [line[1] for line in lines if len(line) == 2 and line[0] == word]
    return [name.split()[-1] if name.startswith("-") else name for name in rest]


def _loaded(path: Path, data: bytes, ending: str) -> Any:
    import trimesh

    folder = trimesh.resolvers.FilePathResolver(str(path)) if ending == ".obj" else None
    try:
        parts = trimesh.load_scene(io.BytesIO(data), file_type=ending[1:], resolver=folder, process=False)
        mesh = parts.to_mesh()
        count = sum(len(part.vertices) for part in parts.geometry.values())
    except Exception as fault:  # a damaged file makes trimesh raise nearly anything
        said = f"this is no {ending[1:].upper()} mesh, or it is truncated or damaged{_short(fault)}; export it again"
        raise SetupError(f"{path}: {said}") from None
    if not len(mesh.faces):
        held, advice = (f"{count} points and ", "make a surface of them first") if count else ("", "export it again")
        raise SetupError(f"{path}: this is no mesh: it holds {held}no triangles; {advice}")
    return mesh


def _short(fault):
    if isinstance(fault, ImportError):  # trimesh looks for help with a text that is none
        return ""
    return f" ({type(fault).__name__}: {' '.join(str(fault).split())}"[:80] + ")"


def _texture_places(mesh, count):
    """Where the corners lie on the texture's picture (N, 2), x right and y down, or None."""
    uv = getattr(getattr(mesh, "visual", None), "uv", None)
    if uv is None or np.shape(uv)[:1] != (count,) or not np.isfinite(uv).all():
        return None
    uv = np.asarray(uv, dtype=float)
    return np.stack([uv[:, 0], 1 - uv[:, 1]], axis=1)


def _own_paint(mesh, share, count, ending):
    """Paint and places from the file: its picture, else its vertices' colours, else its material's, else None."""
    visual = mesh.visual
    material = getattr(visual, "material", None)
    image = getattr(material, "image", None) or getattr(material, "baseColorTexture", None)
    if share is not None and image is not None:
        return Picture(linear_light(np.asarray(image.convert("RGB"))), repeat=True), share
    if visual.kind == "vertex" and len(visual.vertex_colors) == count:
        return Colours(), _light(visual.vertex_colors, ending)
    if material is not None and image is None:
        return Colours(), np.tile(_light(material.main_color, ending), (count, 1))
    return None, None


def _light(colours, ending):
    """Red, green and blue as light, 0 to 1, of colours (..., 4) uint8: sRGB, but in GLB files, which state light."""
    colours = np.asarray(colours)[..., :3]
    return colours / 255 if ending == ".glb" else linear_light(colours).astype(float)
