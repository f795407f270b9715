"""Point clouds as PLY: the format that every viewer opens."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from ..errors import ShapeError
from ..geometry import as_points
from .disk import PathLike, replacing

_PLY_TYPES = {"<f4": "float", "|u1": "uchar"}


def write_ply(
    path: PathLike,
    points: ArrayLike,
    colors: ArrayLike | None = None,
    normals: ArrayLike | None = None,
    sigma: ArrayLike | None = None,
) -> int:
    """Write points as binary PLY; points that are NaN are left out.

    Parameters
    ----------
    path : path
        Where to write.
    points : (..., 3) array
        mm in the camera's frame.
    colors : (..., 3) uint8 array, optional
        Red, green and blue.
    normals : (..., 3) array, optional
        Unit vectors; an unknown one (NaN) is written as zeros.
    sigma : (...,) array, optional
        Standard deviation of each point's depth, mm.

    Returns
    -------
    int
        How many points were written.
    """
    points = as_points(points)
    columns = [(("x", "y", "z"), "<f4", points)]
    if normals is not None:
        columns.append((("nx", "ny", "nz"), "<f4", np.nan_to_num(np.asarray(normals, dtype=float))))
    if colors is not None:
        colors = np.asarray(colors)
        if colors.dtype != np.uint8:
            raise ShapeError(f"colors must be uint8, 0 to 255, got {colors.dtype}")
        columns.append((("red", "green", "blue"), "|u1", colors))
    if sigma is not None:
        columns.append((("sigma",), "<f4", np.asarray(sigma, dtype=float)[..., None]))
    table = _structured(columns, points.shape[:-1])
    with replacing(path) as file:
        file.write(_header(table))
        file.write(memoryview(table).cast("B") if table.size else b"")
    return table.size


def _structured(columns, shape):
    """One record (N,) for each finite point."""
    keep = np.isfinite(columns[0][2].astype(np.float32)).all(-1)
    types = [(name, kind) for names, kind, _ in columns for name in names]
    table = np.empty(np.count_nonzero(keep), dtype=types)
    for names, _, values in columns:
        if values.shape != (*shape, len(names)):
            wanted = (*shape, 3) if len(names) == 3 else shape
            got = values.shape if len(names) == 3 else values.shape[:-1]
            raise ShapeError(f"{' '.join(names)} must have shape {wanted}, as the points do, got {got}")
        kept = values[keep]
        for k, name in enumerate(names):
            table[name] = kept[:, k]
    return table


def _header(table):
    lines = ["ply", "format binary_little_endian 1.0"]
    lines.append("comment cyclopean; mm in the camera frame: x right, y down, z forward")
    if "sigma" in table.dtype.names:
        lines.append("comment sigma: standard deviation of depth, mm")
    lines.append(f"element vertex {table.size}")
    lines += [f"property {_PLY_TYPES[table.dtype[name].str]} {name}" for name in table.dtype.names]
    return ("\n".join([*lines, "end_header"]) + "\n").encode("ascii")
