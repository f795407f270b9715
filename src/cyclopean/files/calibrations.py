"""Calibrations as JSON: every free parameter with its covariance, the target's poses, and what went in.

Angles in rad, lengths in mm, image coordinates in px; a number that is not known is null.
"""

from __future__ import annotations

import json
import platform
from collections.abc import Mapping
from typing import Any

import numpy as np

from .. import __version__
from ..calibration.physical import Calibration
from ..calibration.unknowns import kind_of
from ..errors import SetupError
from ..geometry import rotation_vector
from ..targets import DIRECT
from .disk import PathLike, read_bytes, replacing

KIND = "cyclopean calibration"
FORMAT = 1


def write_calibration(path: PathLike, calibration: Calibration, more: Mapping[str, Any] | None = None) -> None:
    """Write what a calibration found, for programs to read.

    Parameters
    ----------
    path : path
        Where to write.
    calibration : Calibration
    more : mapping, optional
        Further entries of the document: numbers, texts, lists and mappings of them.
    """
    document = _plain(_document(calibration) | dict(more or {}))
    text = json.dumps(document, indent=1, ensure_ascii=False, allow_nan=False) + "\n"
    with replacing(path) as file:
        file.write(text.encode())


def read_calibration(path: PathLike) -> dict[str, Any]:
    """The document that `write_calibration` wrote; "covariance" (S, S) becomes an array, unknown numbers NaN.

    Raises
    ------
    SetupError
        When the file is missing, damaged, or no calibration.
    """
    data = read_bytes(path, SetupError)
    try:
        document = json.loads(data.decode())
    except ValueError:
        raise SetupError(f"{path}: this is not JSON, so it is no calibration") from None
    if not isinstance(document, dict) or document.get("kind") != KIND or "covariance" not in document:
        raise SetupError(f'{path}: this is no calibration: "kind" must be "{KIND}"')
    size = len(document["parameters"])
    covariance = np.array(document["covariance"], dtype=float).reshape(size, size)  # null becomes NaN
    return document | {"covariance": covariance}


def _document(calibration: Calibration) -> dict[str, Any]:
    unknowns, solution, seen = calibration.unknowns, calibration.solution, calibration.observations
    parameters = [
        {"name": name, "unit": _unit(name), "start": start, "value": value, "sigma": calibration.sigma[name],
         "prior_sigma": spread}
        for name, start, value, spread in zip(
            unknowns.names, unknowns.start, solution.shared, unknowns.spread, strict=True)
    ]  # fmt: skip
    return {
        "kind": KIND,
        "format": FORMAT,
        "versions": {"cyclopean": __version__, "numpy": np.__version__, "python": platform.python_version()},
        "rms_px": calibration.rms,
        "sigma0": solution.sigma0,
        "converged": solution.converged,
        "message": solution.message,
        "iterations": solution.iterations,
        "observations": len(seen),
        "outliers": calibration.outliers.sum(),
        "parameters": parameters,
        "covariance": solution.covariance,
        "photographs": [_photograph(calibration, k) for k in range(len(seen.photos))],
        "notes": calibration.notes,
    }


def _photograph(calibration, k):
    seen, pose = calibration.observations, calibration.poses[k]
    mine = seen.photo == k
    views, counts = np.unique(seen.view[mine], return_counts=True)
    good = calibration.residuals[mine & ~calibration.outliers]
    return {
        "name": seen.photos[k],
        "points": {"direct" if view == DIRECT else str(view): count for view, count in zip(views, counts, strict=True)},
        "rms_px": np.sqrt(np.mean(good**2)) if good.size else np.nan,
        "rig_from_target": {"rotation_vector": rotation_vector(pose.rotation), "translation": pose.translation},
    }


def _unit(name):
    unit = kind_of(name).unit
    return "rad" if unit == "deg" else unit


def _plain(value):
    """Built-in numbers, texts, lists and dictionaries; None for numbers that are not finite."""
    if isinstance(value, Mapping):
        return {str(key): _plain(item) for key, item in value.items()}
    if isinstance(value, np.ndarray | np.generic):
        return _plain(value.tolist())
    if isinstance(value, list | tuple):
        return [_plain(item) for item in value]
    if isinstance(value, float):
        return value if np.isfinite(value) else None
    return value
