"""Which parameters a calibration finds: named once, and all flattening, scales and reports derive from it."""

from __future__ import annotations

import difflib
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from ..errors import SetupError
from ..rigs import Setup

_CAMERA_COUNT = 9  # CAMERA_PARAMETERS come first in the parameters of a setup

# Short names for several parameters: patterns that are matched against the full names.
GROUPS = {
    "camera": r"camera\.(focal_[xy]|centre_[xy]|k1|k2|p1|p2)",
    "camera.focal": r"camera\.focal_[xy]",
    "camera.centre": r"camera\.centre_[xy]",
    "camera.distortion": r"camera\.(k1|k2|p1|p2)",
    "camera.radial": r"camera\.(k1|k2)",
    "optic": r"optic\.(?!azimuth).*",
    "optic.pose": r"optic\.(tilt_[xyz]|shift_[xy]|distance)",
    "optic.facets": r"optic\.facet\d+_(angle|azimuth)",
    "optic.mirrors": r"optic\.mirror\d+_\w+",
}
TIED_FOCAL = "camera.focal_tied"  # one focal length; its ratio in x and y stays that of the start
DEFAULT_FREE = {
    "prism": ("optic.pose", "optic.apex", "optic.thickness"),
    "mirrors": ("optic.mirrors",),
    "plate": ("optic.pose", "optic.thickness"),
}

# (pattern, unit, how to print, standard deviation of what a drawing says: a number, or relative to the value)
_KINDS: tuple[tuple[str, str, float, float, bool], ...] = (
    (r"camera\.focal", "px", 1.0, 0.3, True),
    (r"camera\.centre", "px", 1.0, 200.0, False),
    (r"camera\.k1", "", 1.0, 0.5, False),
    (r"camera\.k[23]", "", 1.0, 3.0, False),
    (r"camera\.p[12]", "", 1.0, 0.02, False),
    (r"optic\.tilt", "deg", np.degrees(1.0), np.deg2rad(5.0), False),
    (r"optic\.(shift|advance)", "mm", 1.0, 10.0, False),
    (r"optic\.distance", "mm", 1.0, 0.2, True),
    (r"optic\.thickness", "mm", 1.0, 0.1, True),
    (r"optic\.apex", "deg", np.degrees(1.0), 0.2, True),
    (r"optic\.azimuth", "deg", np.degrees(1.0), np.deg2rad(5.0), False),
    (r"optic\.facet\d+_", "deg", np.degrees(1.0), np.deg2rad(0.2), False),
    (r"optic\.mirror\d+_tilt", "deg", np.degrees(1.0), np.deg2rad(20.0), False),
    (r"optic\.mirror\d+_advance", "mm", 1.0, 100.0, False),
    (r"optic\.index", "", 1.0, 0.05, False),
)


@dataclass(frozen=True)
class Kind:
    """What sort of number a parameter is."""

    unit: str  # that it is printed in: "px", "mm", "deg" or none
    factor: float  # printed value / value
    spread: float  # standard deviation of what a drawing is expected to know, in units of the parameter
    relative: bool  # spread is a fraction of the value


def kind_of(name: str) -> Kind:
    """Unit and expected spread of a parameter by its full name."""
    for pattern, unit, factor, spread, relative in _KINDS:
        if re.match(pattern, name):
            return Kind(unit, factor, spread, relative)
    return Kind("", 1.0, 1.0, False)


@dataclass(frozen=True, eq=False)
class Unknowns:
    """The free parameters of a setup, or of several that differ in colour only.

    All parameters of colour channel c are `base[c] + matrix[c] @ shared`.
    """

    setups: tuple[Setup, ...]  # the start, one for each colour channel; they share all but the index
    names: tuple[str, ...]  # (S,) of the shared vector
    base: np.ndarray  # (C, F): held values, zero at free ones
    matrix: np.ndarray  # (C, F, S)
    start: np.ndarray  # (S,)
    spread: np.ndarray  # (S,) standard deviation of the start values

    @classmethod
    def of(
        cls,
        setups: Sequence[Setup],
        free: Sequence[str],
        tolerances: Mapping[str, float] | None = None,
    ) -> Unknowns:
        """The unknowns that `free` names, such as ("optic.apex", "optic.pose", "camera.focal").

        `tolerances` gives standard deviations of start values, by full or short name, in mm, rad, px.
        """
        setups = tuple(setups)
        full = setups[0].parameter_names
        values = np.stack([_values(setup) for setup in setups])
        chosen = _expand(free, full)
        names, columns = [], []
        for name in chosen:
            for channel in range(len(setups)) if name == "optic.index" and len(setups) > 1 else [None]:
                column = np.zeros((len(setups), len(full)))
                rows = slice(None) if channel is None else channel
                for target, factor in _entries(name, values[0], full):
                    column[rows, full.index(target)] = factor
                names.append(name if channel is None else f"optic.index[{channel}]")
                columns.append(column)
        matrix = np.stack(columns, -1) if columns else np.zeros((*values.shape, 0))
        start = np.array([_start(name, values, full) for name in names])
        base = np.where(np.any(matrix != 0, axis=-1), 0.0, values)
        spread = np.array([_spread(name, value, tolerances or {}) for name, value in zip(names, start, strict=True)])
        _check_tolerances(tolerances or {}, full, names)
        return cls(setups, tuple(names), base, matrix, start, spread.reshape(-1))

    def __len__(self) -> int:
        return len(self.names)

    @property
    def lens_matrix(self) -> np.ndarray:
        """(C, 9, S): how the lens depends on the shared vector."""
        return self.matrix[:, :_CAMERA_COUNT]

    @property
    def optic_matrix(self) -> np.ndarray:
        """(C, P, S): how the optic depends on the shared vector."""
        return self.matrix[:, _CAMERA_COUNT:]

    def parameters(self, shared: np.ndarray, channel: int = 0) -> np.ndarray:
        """All parameters (F,) of a channel's setup."""
        return self.base[channel] + self.matrix[channel] @ shared

    def setup(self, shared: np.ndarray, channel: int = 0) -> Setup:
        """The setup that has these values; its glass keeps its name unless the index is free."""
        start, values = self.setups[channel], self.parameters(shared, channel)
        optic = start.optic.with_parameters(values[_CAMERA_COUNT:]) if self._optic_free else start.optic
        if self._optic_free and not self._index_free and hasattr(optic, "glass"):
            optic = replace(optic, glass=start.optic.glass)  # type: ignore[type-var, attr-defined]
        return replace(start, camera=start.camera.with_lens(values[:_CAMERA_COUNT]), optic=optic)

    @cached_property
    def _optic_free(self) -> bool:
        return any(name.startswith("optic.") for name in self.names)

    @cached_property
    def _index_free(self) -> bool:
        return any(name.startswith("optic.index") for name in self.names)


def _values(setup):
    return np.concatenate([setup.camera.lens, setup.optic.parameters(setup.wavelength_nm)])


def _expand(free, full):
    """Full names, each once, in the order of the setup's parameters."""
    found = set()
    for name in free:
        if name == TIED_FOCAL:
            found.add(name)
            continue
        pattern = GROUPS.get(name)
        hits = [other for other in full if (re.fullmatch(pattern, other) if pattern else other == name)]
        if not hits:
            known = [*GROUPS, TIED_FOCAL, *full]
            near = difflib.get_close_matches(name, known, 3)
            raise SetupError(
                f"this setup has no parameter {name!r}; "
                + (f"did you mean {' or '.join(near)}?" if near else f"it has {', '.join(full)}")
            )
        found.update(hits)
    if TIED_FOCAL in found:
        found -= {"camera.focal_x", "camera.focal_y"}
    order = {name: row for row, name in enumerate((TIED_FOCAL, *full))}
    return sorted(found, key=order.__getitem__)


def _entries(name, values, full):
    if name == TIED_FOCAL:
        ratio = values[full.index("camera.focal_y")] / values[full.index("camera.focal_x")]
        return (("camera.focal_x", 1.0), ("camera.focal_y", ratio))
    return ((name, 1.0),)


def _start(name, values, full):
    channel = re.fullmatch(r"optic\.index\[(\d+)\]", name)
    if channel:
        return values[int(channel[1]), full.index("optic.index")]
    return values[0, full.index("camera.focal_x" if name == TIED_FOCAL else name)]


def _spread(name, value, tolerances):
    plain = re.sub(r"\[\d+\]", "", name)
    for given, spread in tolerances.items():
        if given == plain or (given in GROUPS and re.fullmatch(GROUPS[given], plain)):
            return float(spread)
    kind = kind_of(plain)
    return kind.spread * abs(value) if kind.relative else kind.spread


def _check_tolerances(tolerances, full, free):
    plain = {re.sub(r"\[\d+\]", "", name) for name in free}
    for name, spread in tolerances.items():
        if name not in GROUPS and name not in full and name != TIED_FOCAL:
            raise SetupError(f"a tolerance is given for {name!r}, which this setup does not have: {', '.join(full)}")
        if not 0 < spread < np.inf:
            raise SetupError(f"the tolerance of {name} must be a positive, finite standard deviation, got {spread}")
        if not any(name == other or re.fullmatch(GROUPS.get(name, "$"), other) for other in plain):
            raise SetupError(
                f"a tolerance is given for {name}, which is held: free it as well, or leave the tolerance out"
            )
