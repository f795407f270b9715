"""What warmth does: indices, sizes and mounts change, and triangulated points move."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ..errors import MediumError, SetupError
from ..optics import Medium, Mirrors, medium
from ..rigs import Setup
from .sensitivity import point_sensitivity

SCHOTT = "Schott, optical glass catalogue (Zemax edition of 24 April 2013)"
PLASTICS = "of the order that makers of moulded optics state; it differs between grades"
MOUNTS = {
    "aluminium": 23.6e-6,
    "brass": 20.5e-6,
    "steel": 11.7e-6,
    "stainless steel": 17.2e-6,
    "titanium": 8.6e-6,
    "invar": 1.6e-6,
}
"""Linear expansion of metals per kelvin: Callister, Materials Science and Engineering: An Introduction, table B.6
(6061, C36000, 1020, 304, Ti-6Al-4V)."""


@dataclass(frozen=True)
class ThermalData:
    """How a medium answers to warmth, near 20 C."""

    index: tuple[float, ...]  # D0 D1 D2 E0 E1 and lambda_TK (um) of Schott's formula; or dn/dT relative to vacuum, 1/K
    expansion: float  # linear, 1/K
    citation: str

    def index_per_kelvin(self, index: float, wavelength_nm: float, temperature: float = 20.0) -> float:
        """dn/dT (1/K) relative to vacuum, of a medium of this index, at a temperature in C.

        References
        ----------
        Schott, TIE-19, Temperature coefficient of the refractive index, equation 3.
        """
        if len(self.index) == 1:
            return self.index[0]
        d0, d1, d2, e0, e1, pole = self.index
        warmer = temperature - 20
        dispersion = (e0 + 2 * e1 * warmer) / ((wavelength_nm / 1000) ** 2 - pole**2)
        return (index**2 - 1) / (2 * index) * (d0 + 2 * d1 * warmer + 3 * d2 * warmer**2 + dispersion)


def _schott(expansion, *index):
    return ThermalData(index, expansion, SCHOTT)


THERMAL: Mapping[str, ThermalData] = {
    "N-BK7": _schott(7.1e-6, 1.86e-6, 1.31e-8, -1.37e-11, 4.34e-7, 6.27e-10, 0.170),
    "N-K5": _schott(8.2e-6, -4.13e-7, 1.03e-8, -3.40e-11, 4.73e-7, 5.19e-10, 0.213),
    "N-SK2": _schott(6.0e-6, 3.80e-6, 1.41e-8, 2.28e-11, 6.44e-7, 8.03e-11, 0.108),
    "N-SK16": _schott(6.3e-6, -2.37e-8, 1.32e-8, -1.29e-11, 4.09e-7, 5.17e-10, 0.170),
    "N-BAK4": _schott(6.99e-6, 3.06e-6, 1.44e-8, -2.23e-11, 5.46e-7, 6.05e-10, 0.189),
    "N-BAF10": _schott(6.18e-6, 3.79e-6, 1.28e-8, -1.42e-11, 5.84e-7, 7.60e-10, 0.220),
    "N-LAK8": _schott(5.6e-6, 4.10e-6, 1.25e-8, -1.60e-11, 4.30e-7, 6.29e-10, 0.213),
    "F2": _schott(8.2e-6, 1.51e-6, 1.56e-8, -2.78e-11, 9.34e-7, 1.04e-9, 0.250),
    "N-F2": _schott(7.84e-6, 4.62e-7, 1.17e-8, -2.35e-11, 7.47e-7, 9.81e-10, 0.263),
    "F5": _schott(8.0e-6, 2.13e-6, 1.65e-8, -6.98e-11, 1.02e-6, 6.56e-10, 0.208),
    "SF5": _schott(8.2e-6, 2.59e-6, 1.76e-8, -2.03e-11, 1.17e-6, 1.09e-9, 0.255),
    "N-SF5": _schott(7.94e-6, -2.51e-7, 1.07e-8, -2.40e-11, 7.85e-7, 1.15e-9, 0.278),
    "SF10": _schott(7.5e-6, 5.31e-6, 1.59e-8, -4.07e-11, 1.28e-6, 1.32e-9, 0.270),
    "N-SF10": _schott(9.4e-6, -4.68e-6, 7.41e-9, -1.89e-11, 9.49e-7, 1.42e-9, 0.279),
    "SF11": _schott(6.1e-6, 1.12e-5, 1.81e-8, -5.03e-11, 1.46e-6, 1.58e-9, 0.282),
    "N-SF11": _schott(8.52e-6, -3.56e-6, 9.20e-9, -2.10e-11, 9.65e-7, 1.44e-9, 0.294),
    "fused silica": _schott(0.5e-6, 2.06e-5, 2.51e-8, -2.47e-11, 3.12e-7, 4.22e-10, 0.160),  # Lithosil-Q
    "PMMA": ThermalData((-8.5e-5,), 67e-6, PLASTICS),
    "polycarbonate": ThermalData((-1.18e-4,), 68e-6, f"{PLASTICS}: -11.8e-5 to -14.3e-5, 66 to 70e-6"),
    "polystyrene": ThermalData((-1.4e-4,), 70e-6, f"{PLASTICS}: 60 to 80e-6"),
    "Zeonex E48R": ThermalData((-8.0e-5,), 65e-6, f"{PLASTICS}: 60 to 70e-6"),
    "water": ThermalData((-9.1e-5,), 0.0, "CRC Handbook, against air: 1.33317 at 18 C, 1.33281 at 22 C"),
}
"""By the names of `media()`. What is missing is unknown to this package: give it as a `ThermalData`."""


@dataclass(frozen=True)
class ThermalResponse:
    """Changes of a setup's parameters per kelvin, by what causes them."""

    causes: Mapping[str, Mapping[str, float]]  # cause -> parameter -> mm, rad, px or 1 per K
    unknown: tuple[str, ...]  # what is not in it, in words

    @property
    def total(self) -> dict[str, float]:
        """Changes per kelvin by parameter, all causes together."""
        names = dict.fromkeys(name for changes in self.causes.values() for name in changes)
        return {name: sum(changes.get(name, 0.0) for changes in self.causes.values()) for name in names}


def index_per_kelvin(material: Any, wavelength_nm: float, temperature: float = 20.0) -> float | None:
    """dn/dT (1/K) of a medium relative to vacuum at a temperature in C; None where it is not known.

    That of air is Schott's TIE-19 at constant pressure: (n - 1) falls as 1 / (1 + 3.4785e-3 (T - 15)).
    """
    known = medium(material)
    if known.name == "vacuum":
        return 0.0
    index = float(known.index(wavelength_nm))
    if known.name == "air":
        return -(index - 1) * 3.4785e-3 / (1 + 3.4785e-3 * (temperature - 15)) ** 2
    data = THERMAL.get(known.name)
    return None if data is None else data.index_per_kelvin(index, wavelength_nm, temperature)


def thermal_response(
    setup: Setup,
    *,
    mount: str | float = "aluminium",
    glass: str | Medium | ThermalData | None = None,
    lens_per_kelvin: float | None = None,
    temperature: float = 20.0,
) -> ThermalResponse:
    """How camera and optic change when all becomes one kelvin warmer.

    Parameters
    ----------
    setup : Setup
    mount : str or float
        What holds the optic before the lens: a name of `MOUNTS`, or its linear expansion, 1/K.
    glass : str, Medium or ThermalData, optional
        What the optic is made of, where the setup gives its glass as a number, or where the table does not have it.
    lens_per_kelvin : float, optional
        Relative change of the camera's focal length in px, 1/K; unknown, and left out, where not given.
    temperature : float
        In C, where the coefficients are taken.

    Returns
    -------
    ThermalResponse
        Angles between faces do not change when a solid warms evenly: only its size and its index do.
    """
    causes: dict[str, dict[str, float]] = {}
    unknown = []
    if lens_per_kelvin is None:
        unknown.append("the camera's own change with temperature")
    elif not abs(lens_per_kelvin) < 1e-2:
        raise SetupError(f"the lens's relative change is a small number per K, as 1e-5, got {lens_per_kelvin}")
    else:
        focal = setup.camera.focal
        causes["camera"] = {f"camera.focal_{axis}": f * lens_per_kelvin for axis, f in zip("xy", focal, strict=True)}
    causes["mount"] = _mounted(setup, _expansion(mount))
    material = glass if glass is not None else getattr(setup.optic, "glass", None)
    if material is not None:
        data, name = _thermal_data(material)
        if data is None:
            unknown.append(f"how {name} answers to warmth")
        else:
            causes |= _of_glass(setup, data, temperature, unknown)
    return ThermalResponse({cause: changes for cause, changes in causes.items() if changes}, tuple(unknown))


def depth_per_kelvin(setup: Setup, points: ArrayLike, response: ThermalResponse | None = None) -> dict[str, np.ndarray]:
    """Bias of depth (...,) mm/K of points (..., 3) by cause, and "all": found while the setup has warmed by 1 K.

    Positive: the point seems farther than it is.
    """
    response = response or thermal_response(setup)
    sensitivity = point_sensitivity(setup, points)
    bias = {cause: sensitivity.shift(changes)[..., 2] for cause, changes in response.causes.items()}
    return bias | {"all": sensitivity.shift(response.total)[..., 2]}


def warmed(setup: Setup, kelvin: float, response: ThermalResponse) -> Setup:
    """The setup after it has warmed by some kelvin."""
    names = setup.parameter_names
    values = np.concatenate([setup.camera.lens, setup.optic.parameters(setup.wavelength_nm)])
    total = response.total
    values = values + kelvin * np.array([total.get(name, 0.0) for name in names])
    count = len(setup.camera.lens)
    camera = setup.camera.with_lens(values[:count])
    return replace(setup, camera=camera, optic=setup.optic.with_parameters(values[count:]))


def _expansion(mount):
    if isinstance(mount, str):
        if mount not in MOUNTS:
            raise SetupError(
                f"the expansion of {mount!r} is not known: take one of {', '.join(MOUNTS)}, or a number, 1/K"
            )
        return MOUNTS[mount]
    if not abs(mount) < 1e-3:
        raise SetupError(f"a linear expansion is a small number per K, as 23.6e-6 of aluminium, got {mount}")
    return float(mount)


def _mounted(setup, expansion):
    """Changes per kelvin of where the optic stands, in a frame that grows evenly from the pinhole."""
    if isinstance(setup.optic, Mirrors):
        return {
            f"optic.mirror{k}_advance": expansion * mirror.interface(1.0).offset
            for k, mirror in enumerate(setup.optic.mirrors)
        }
    values = dict(zip(setup.optic.parameter_names, setup.optic.parameters(setup.wavelength_nm), strict=True))
    moved = {name: expansion * values[name] for name in ("shift_x", "shift_y", "distance") if name in values}
    return {f"optic.{name}": float(change) for name, change in moved.items()}


def _thermal_data(material):
    if isinstance(material, ThermalData):
        return material, "the glass"
    try:
        known = medium(material)
    except MediumError:
        if isinstance(material, str):
            raise
        raise SetupError(f"glass is a name, a Medium or ThermalData, got {material!r}") from None
    if known.formula == "constant" and known.name != "vacuum":
        return None, "a glass given as a number"
    return THERMAL.get(known.name), known.name


def _of_glass(setup, data, temperature, unknown):
    """Causes that lie in the glass and in what surrounds it."""
    values = dict(zip(setup.optic.parameter_names, setup.optic.parameters(setup.wavelength_nm), strict=True))
    causes = {}
    if "thickness" in values:
        causes["size of the glass"] = {"optic.thickness": data.expansion * float(values["thickness"])}
    if "index" not in values:
        return causes
    surroundings = medium(getattr(setup.optic, "surroundings", "air"))
    outside, ratio = float(surroundings.index(setup.wavelength_nm)), float(values["index"])
    inside = data.index_per_kelvin(ratio * outside, setup.wavelength_nm, temperature)
    causes["index of the glass"] = {"optic.index": inside / outside}
    around = index_per_kelvin(surroundings, setup.wavelength_nm, temperature)
    if around is None:
        unknown.append(f"how {surroundings.name} answers to warmth")
    else:
        causes[f"index of {surroundings.name}"] = {"optic.index": -ratio * around / outside}
    return causes
