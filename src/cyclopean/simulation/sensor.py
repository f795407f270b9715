"""From light to the numbers in a photograph: blur of the lens, exposure, noise, bits."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from ..errors import SetupError, ShapeError

BITS = (8, 12, 16)
_LARGEST = {  # beyond this a number is a slip
    "exposure": 1e6,
    "full_well_electrons": 1e9,
    "read_noise_electrons": 1e9,
    "noise": 1e6,
    "black_level": 2.0**16,
    "blur_sigma": 100.0,
}
_BRIGHT, _SHARE = 0.9, 99.9  # automatic exposure: 99.9 % of the pixels stay below 0.9 of the full scale


@dataclass(frozen=True)
class Sensor:
    """A camera's electronics, linear in light, by the model of EMVA 1288.

    A pixel collects a Poisson number of electrons (shot noise), reading adds normal noise, and the sum becomes a
    whole number of grey levels. A full pixel (`full_well_electrons`) is the highest level.

    References
    ----------
    EMVA Standard 1288, release 4.0 Linear, 2021, section 2.
    """

    bits: int = 8  # 8, 12 (0 to 4095, in 16 bits) or 16
    exposure: float | None = None  # share of the full scale that light 1 gives; None: what suits the picture
    full_well_electrons: float | None = None  # that fill a pixel; None: no shot noise
    read_noise_electrons: float = 0.0  # standard deviation; needs full_well_electrons
    noise: float = 0.0  # further normal noise, in grey levels of 8 bits
    black_level: float = 0.0  # grey levels that no light gives
    blur_sigma: float = 0.0  # px, of the lens, a Gaussian

    def __post_init__(self):
        if self.bits not in BITS:
            raise SetupError(f"bits must be one of {', '.join(map(str, BITS))}, got {self.bits}")
        for name in ("exposure", "full_well_electrons"):
            value = getattr(self, name)
            if value is not None and not 0 < value <= _LARGEST[name]:
                raise SetupError(f"{_said(name)} must be a number above 0, {_LARGEST[name]:g} at most, got {value}")
        for name in ("read_noise_electrons", "noise", "black_level", "blur_sigma"):
            value = getattr(self, name)
            if not 0 <= value <= _LARGEST[name]:
                raise SetupError(
                    f"{_said(name)} must be a number of 0 or more, {_LARGEST[name]:g} at most, got {value}"
                )
        if self.black_level >= self.highest:
            raise SetupError(f"the black level must lie below {self.highest}, the highest, got {self.black_level:g}")
        if self.read_noise_electrons and self.full_well_electrons is None:
            raise SetupError(
                "read noise is a number of electrons, so it needs the number that fills a pixel (full well), such as "
                "10000; noise in grey levels of 8 bits needs nothing"
            )

    @property
    def highest(self) -> int:
        """The highest grey level."""
        return 2**self.bits - 1

    def exposure_of(self, light: ArrayLike) -> float:
        """Share of the full scale that light 1 gives: as stated, else so that the brightest 0.1 % reach 0.9."""
        if self.exposure is not None:
            return self.exposure
        brightness = np.asarray(light)
        top = float(np.percentile(brightness.max(axis=-1) if brightness.ndim == 3 else brightness, _SHARE))
        top = top or float(brightness.max())
        return _BRIGHT / top if top > 0 else 1.0

    def expose(self, light: ArrayLike, seed: int = 0) -> np.ndarray:
        """The photograph of what falls on the sensor.

        Parameters
        ----------
        light : (H, W) or (H, W, 3) array
            As `render` gives it: 1 is a white matte surface in full light.
        seed : int
            Of the noise: the same seed gives the same photograph.

        Returns
        -------
        array of the same shape
            uint8, or uint16 for 12 and 16 bits.
        """
        light = np.asarray(light, dtype=np.float32)
        if light.ndim not in (2, 3) or not light.size:
            raise ShapeError(f"light must have shape (H, W) or (H, W, 3), got {light.shape}")
        if not np.isfinite(light).all() or light.min() < 0:
            raise ShapeError("light must be numbers of 0 or more; some are negative, NaN or infinite")
        rng = np.random.default_rng(seed)
        share = self._blurred(light) * np.float32(self.exposure_of(light))
        if self.full_well_electrons is not None:
            electrons = rng.poisson(np.minimum(share, 2.0) * self.full_well_electrons)  # beyond full it is clipped
            share = (electrons + rng.normal(0, self.read_noise_electrons, share.shape)) / self.full_well_electrons
        levels = self.black_level + share * (self.highest - self.black_level)
        if self.noise:
            levels = levels + rng.normal(0, self.noise * self.highest / 255, levels.shape)
        return np.clip(np.rint(levels), 0, self.highest).astype(np.uint8 if self.bits == 8 else np.uint16)

    def _blurred(self, light):
        if not self.blur_sigma:
            return light
        from scipy.ndimage import gaussian_filter

        return gaussian_filter(light, self.blur_sigma, mode="nearest", axes=(0, 1))

    @property
    def text(self) -> str:
        """The sensor in words."""
        parts = [f"{self.bits} bits"]
        if self.full_well_electrons is not None:
            parts.append(f"full well {self.full_well_electrons:g} electrons, read noise {self.read_noise_electrons:g}")
        if self.noise:
            parts.append(f"noise {self.noise:g} grey levels of 8 bits")
        if self.full_well_electrons is None and not self.noise:
            parts.append("no noise")
        if self.blur_sigma:
            parts.append(f"blur {self.blur_sigma:g} px")
        return ", ".join(parts)


def _said(name):
    return name.replace("_", " ").removesuffix(" electrons").removesuffix(" sigma")
