"""A setup in light of another colour: what refracts has another index there, all else stays."""

from __future__ import annotations

from dataclasses import replace

from ..errors import MediumError
from ..optics import Medium, medium
from .setup import Setup


def index_at(setup: Setup, wavelength_nm: float, glass: str | Medium | None = None) -> float:
    """Index of the optic relative to its surroundings at a wavelength, nm.

    With `glass` its dispersion is added to the index that the setup states at its own wavelength. Without it that of
    the optic's own glass is, or of the setup's `dispersion` where the optic gives its glass as a number; a number
    alone has none, and that is an error.
    """
    values = setup.optic.parameters(setup.wavelength_nm)
    believed = float(values[setup.optic.parameter_names.index("index")])
    material = dispersing(setup) if glass is None else glass
    if material is None or not has_dispersion(material):
        raise MediumError(
            f"the setup gives its glass as a number ({believed:.5g}), which says nothing about other colours; "
            "name the glass as well, such as N-BK7"
        )
    surroundings = medium(setup.optic.surroundings)  # type: ignore[attr-defined]
    named = medium(material)

    def ratio(nm):
        return float(named.index_in_air(nm)) / float(surroundings.index_in_air(nm))

    return believed + ratio(wavelength_nm) - ratio(setup.wavelength_nm)


def dispersing(setup: Setup) -> str | Medium | None:
    """The glass whose dispersion is the optic's, or None where nobody says."""
    glass = getattr(setup.optic, "glass", None)
    if glass is not None and has_dispersion(glass):
        return glass
    return setup.dispersion


def has_dispersion(material: str | float | Medium) -> bool:
    """Whether a glass is more than a number."""
    return medium(material).formula != "constant"


def bends_colours(setup: Setup) -> bool:
    """Whether the optic refracts: mirrors treat all colours alike."""
    return "index" in setup.optic.parameter_names


def coloured(setup: Setup, wavelength_nm: float, glass: str | Medium | None = None) -> Setup:
    """The setup as light of another wavelength (nm) meets it; its own for an optic of mirrors."""
    if not bends_colours(setup):
        return setup
    values = setup.optic.parameters(setup.wavelength_nm).copy()
    values[setup.optic.parameter_names.index("index")] = index_at(setup, wavelength_nm, glass)
    return replace(setup, optic=setup.optic.with_parameters(values))
