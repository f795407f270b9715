"""Point clouds as PLY: the format that every viewer opens."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from ..errors import ShapeError
from ..geometry import as_points
from .disk import PathLike, replacing

_PLY_TYPES = {"<f4": "float", "|u1": "uchar"}
_COVARIANCE = {"xx": (0, 0), "xy": (0, 1), "xz": (0, 2), "yy": (1, 1), "yz": (1, 2), "zz": (2, 2)}


def write_ply(
    path: PathLike,
    points: ArrayLike,
    colors: ArrayLike | None = None,
    normals: ArrayLike | None = None,
    covariance: ArrayLike | None = None,
    sigma: ArrayLike | None = None,
    views: ArrayLike | None = None,
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
    covariance : (..., 3, 3) array, optional
        mm^2; the six numbers of its upper half become covariance_xx to covariance_zz.
    sigma : (...,) array, optional
        Standard deviation of each point's depth, mm.
    views : (...,) uint8 array, optional
        How many views have each point.

    Returns
    -------
    int
        How many points were written.
    """
    points = as_points(points)
    with np.errstate(over="ignore"):  # what float32 cannot hold is no point either
        keep = np.isfinite(points.astype(np.float32)).all(-1)

    def kept(name, values, *components):
        values = np.asarray(values)
        if values.shape != (*keep.shape, *components):
            wanted = (*keep.shape, *components)
            raise ShapeError(f"{name} must have shape {wanted}, as the points do, got {values.shape}")
        return values[keep]

    columns = dict(zip("xyz", points[keep].T, strict=True))
    if normals is not None:
        columns |= zip(("nx", "ny", "nz"), np.nan_to_num(kept("normals", normals, 3)).T, strict=True)
    if colors is not None:
        columns |= zip(("red", "green", "blue"), _as_bytes("colors", kept("colors", colors, 3)).T, strict=True)
    if views is not None:
        columns["views"] = _as_bytes("views", kept("views", views))
    if sigma is not None:
        columns["sigma"] = kept("sigma", sigma).astype(np.float32)
    if covariance is not None:
        matrices = kept("covariance", covariance, 3, 3)
        columns |= {f"covariance_{name}": matrices[:, i, j] for name, (i, j) in _COVARIANCE.items()}
    table = _table(columns)
    with replacing(path) as file:
        file.write(_header(table))
        file.write(table.tobytes())
    return table.size


def _as_bytes(name, values):
    if values.dtype != np.uint8:
        raise ShapeError(f"{name} must be uint8, 0 to 255, got {values.dtype}")
    return values


def _table(columns):
    """Columns (N,) as records (N,)."""
    types = [(name, "|u1" if values.dtype == np.uint8 else "<f4") for name, values in columns.items()]
    table = np.empty(len(columns["x"]), dtype=types)
    for name, values in columns.items():
        table[name] = values
    return table


def _header(table):
    lines = ["ply", "format binary_little_endian 1.0"]
    lines.append("comment cyclopean; mm in the camera frame: x right, y down, z forward")
    lines.append("comment sigma: standard deviation of depth, mm; covariance: mm^2")
    lines.append(f"element vertex {table.size}")
    lines += [f"property {_PLY_TYPES[table.dtype[name].str]} {name}" for name in table.dtype.names]
    return ("\n".join([*lines, "end_header"]) + "\n").encode("ascii")
