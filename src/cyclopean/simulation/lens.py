"""The rays that make a pixel: spread over its square, the lens's pupil and the colours of its light."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from ..errors import SetupError
from ..optics import Path
from ..rigs import Setup
from ..rigs.colours import bends_colours, coloured, dispersing

CHANNELS_NM = (610.0, 540.0, 460.0)  # of red, green and blue, where a setup states none
LINES = 32  # wavelengths that stand for a band, at most


@dataclass(frozen=True, eq=False)
class Samples:
    """How the samples of a pixel lie; each pixel flips other bits of the places, which leaves them well spread."""

    places: np.ndarray  # (S, 4) uint32, over pixel x, pixel y and two coordinates of the pupil
    line: np.ndarray  # (S,) int, which of the band's wavelengths


@dataclass(frozen=True, eq=False)
class Band:
    """Light that travels together: the ways of each of its wavelengths, and which channels it makes."""

    lines: tuple[tuple[Path, ...], ...]  # paths of each wavelength
    channels: tuple[int, ...]  # of the picture


def spread(samples: int, lines: int, seed: int) -> Samples:
    """Samples (S,) spread well over pixel, pupil and wavelengths at once.

    References
    ----------
    Sobol' 1967; scrambled as Matousek 1998 does.
    """
    from scipy.stats import qmc

    sequence = qmc.Sobol(5, scramble=True, bits=32, rng=np.random.default_rng(seed))
    places = sequence.random_base2(math.ceil(math.log2(samples)))[:samples]
    rank = np.argsort(np.argsort(places[:, 4]))
    return Samples((places[:, :4] * 2.0**32).astype(np.uint32), rank * lines // samples)


def pupil(setup: Setup) -> tuple[float, float]:
    """Radius of the entrance pupil around the pinhole, and z of the plane in focus, mm; radius 0 for a pinhole.

    As `Setup.pupil_diameter` has it.
    """
    if setup.f_number is None or setup.focus_distance is None:
        return 0.0, 1.0
    return setup.pupil_diameter / 2, setup.focus_distance


def bands(setup: Setup, samples: int, colour: bool, bandwidth_nm: float, with_optic: bool) -> tuple[Band, ...]:
    """The light that makes a picture: one band where no glass splits its colours, else one for each channel."""
    if not (np.isfinite(bandwidth_nm) and bandwidth_nm >= 0):
        raise SetupError(f"the bandwidth must be a number of nm, 0 or more, got {bandwidth_nm}")
    channels = (0, 1, 2) if colour else (0,)
    if not with_optic:
        return (Band(((Path((), 1.0),),), channels),)
    splits = bends_colours(setup) and dispersing(setup) is not None
    if not bends_colours(setup) or (not splits and bandwidth_nm == 0):
        return (Band((setup.optic.paths(setup.wavelength_nm),), channels),)
    if not colour:
        return (Band(_lines(setup, setup.wavelength_nm, bandwidth_nm, samples), channels),)
    wavelengths = setup.channel_wavelengths_nm or CHANNELS_NM
    return tuple(Band(_lines(setup, nm, bandwidth_nm, samples), (c,)) for c, nm in enumerate(wavelengths))


def _lines(setup, middle_nm, bandwidth_nm, samples):
    """Paths at wavelengths evenly spread over a band, a tuple for each."""
    if bandwidth_nm >= 2 * middle_nm:
        raise SetupError(f"a band {bandwidth_nm:g} nm wide around {middle_nm:g} nm has no shortest wavelength")
    if bandwidth_nm == 0:
        return (_paths(setup, middle_nm),)
    count = min(samples, LINES)
    offsets = (np.arange(count) + 0.5) / count - 0.5
    return tuple(_paths(setup, float(middle_nm + bandwidth_nm * offset)) for offset in offsets)


def _paths(setup, wavelength_nm):
    if wavelength_nm == setup.wavelength_nm:
        return setup.optic.paths(wavelength_nm)
    return coloured(setup, wavelength_nm).optic.paths(setup.wavelength_nm)
