"""Surfaces of triangles as STL, PLY or OBJ: what printers, CAD and viewers of meshes open."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from ..errors import OutputError, ShapeError
from .disk import PathLike, replacing

UNITS = {"mm": 1.0, "cm": 0.1, "m": 0.001, "inch": 1 / 25.4}  # of one mm
_KINDS = (".stl", ".ply", ".obj")


def write_mesh(
    path: PathLike, vertices: ArrayLike, faces: ArrayLike, unit: str = "mm", colors: ArrayLike | None = None
) -> int:
    """Write a surface of triangles as binary STL, binary PLY or OBJ, as the ending of the path says.

    None of these formats knows a unit: whoever opens the file must be told.

    Parameters
    ----------
    path : path
        Where to write, ending in .stl, .ply or .obj.
    vertices : (N, 3) array
        Corners, mm.
    faces : (M, 3) array of int
        Rows of `vertices`, counter-clockwise as seen from outside.
    unit : "mm", "cm", "m" or "inch"
        Unit that the file's numbers are in.
    colors : (N, 3) uint8 array, optional
        Red, green and blue of the corners; STL knows no colours and leaves them out.

    Returns
    -------
    int
        How many triangles were written.

    Raises
    ------
    OutputError
        When the ending or the unit is unknown, or the file cannot be written.
    ShapeError
        When the arrays are no mesh.
    """
    ending = Path(path).suffix.lower()
    if ending not in _KINDS:
        raise OutputError(
            f"{path}: a mesh is written as {', '.join(_KINDS)}, not as {ending or 'a file without ending'}"
        )
    if unit not in UNITS:
        raise OutputError(f"unit {unit!r} is unknown; wanted one of {', '.join(UNITS)}")
    vertices, faces = _checked(vertices, faces)
    import trimesh

    mesh = trimesh.Trimesh(vertices * UNITS[unit], faces, process=False, vertex_colors=_as_colors(colors, vertices))
    data = mesh.export(file_type=ending[1:])
    with replacing(path) as file:
        file.write(data.encode("ascii") if isinstance(data, str) else data)  # type: ignore[arg-type]
    return len(faces)


def _as_colors(colors, vertices):
    """Colours (N, 3) uint8 of vertices (N, 3), or None, or an error."""
    if colors is None:
        return None
    colors = np.asarray(colors)
    if colors.shape != vertices.shape or colors.dtype != np.uint8:
        wanted = f"uint8 of shape {vertices.shape}, as the vertices are"
        raise ShapeError(f"colors must be {wanted}, got {colors.dtype} of shape {colors.shape}")
    return colors


def _checked(vertices, faces):
    """Vertices (N, 3) and faces (M, 3) as arrays, or an error."""
    vertices, faces = np.asarray(vertices, dtype=float), np.asarray(faces)
    if vertices.ndim != 2 or vertices.shape[1] != 3:
        raise ShapeError(f"vertices must have shape (N, 3), got {vertices.shape}")
    if faces.ndim != 2 or faces.shape[1] != 3 or not np.issubdtype(faces.dtype, np.integer):
        raise ShapeError(f"faces must be integers of shape (M, 3), got {faces.dtype} of shape {faces.shape}")
    if not len(faces):
        raise ShapeError("there are no faces: nothing to write")
    if faces.min() < 0 or faces.max() >= len(vertices):
        raise ShapeError(f"faces must name rows 0 to {len(vertices) - 1} of vertices, got {faces.min()}..{faces.max()}")
    if not np.isfinite(vertices[np.unique(faces)]).all():
        raise ShapeError("vertices must be finite numbers, got NaN or infinity")
    return vertices, faces
