"""The two refractive indices that a piece of glass in its surroundings comes down to."""

import numbers

from .media import Medium, medium


def refractive_indices(
    glass: str | float | Medium, surroundings: str | float | Medium, wavelength_nm: float
) -> tuple[float, float]:
    """Indices of the surroundings and of the glass, both relative to air.

    A glass given as a number is taken relative to the surroundings, as makers and textbooks state it.
    """
    outside = float(medium(surroundings).index_in_air(wavelength_nm))
    inside = float(medium(glass).index_in_air(wavelength_nm))
    return outside, inside * outside if isinstance(glass, numbers.Real) else inside
