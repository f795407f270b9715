"""The colours of a photograph that is to be matched: which channels, in whose rigs, and what to say about them."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from ..errors import ImageError, SetupError
from ..files import read_setup
from ..rectification import (
    channel_rigs,
    channel_shifts,
    compensated,
    expected_shifts,
    knows_channels,
    middle_inverse_depth,
)
from ..rigs import Rig, Setup
from ..rigs.colours import bends_colours, coloured

COLOURS = ("red", "green", "blue")
_APART = 0.7  # px between channels that nobody accounts for: matching them as one suffers; less is hard to measure
_SURE = 4  # standard deviations of such a measurement: of textures whose colours differ, a few are far off
_FARTHEST = 0.05  # of the width of the photograph: glass moves no channel so far from green


class Coloured(NamedTuple):
    """A photograph as it is to be matched."""

    photograph: np.ndarray  # (H, W) of one channel, or (H, W, 3) brought together where the channels are known
    rig: Rig  # of that channel, or of green
    channels: tuple[Rig, ...] | None  # of red, green and blue, where each has its own; else `rig` serves all
    depths: tuple[float, float]  # mm, to search
    note: str  # what was done with the colours; empty where nothing was
    warnings: list[str]


def read_setups(files: Sequence[Path]) -> tuple[Setup, ...]:
    """The setup of all colours, or those of red, green and blue; SetupError where they cannot be of one photograph."""
    if len(files) not in (1, 3):
        raise SetupError(f"--setup is given once, or three times, for red, green and blue; got {len(files)} files")
    setups = tuple(read_setup(file) for file in files)
    if len({setup.camera.size for setup in setups}) > 1:
        sizes = ", ".join("{}x{} px".format(*setup.camera.size) for setup in setups)
        raise SetupError(f"the setups of red, green and blue are for photographs of different sizes: {sizes}")
    return setups


def chosen_colours(
    photo: Path,
    photograph: np.ndarray,
    setups: Sequence[Setup],
    channel: str,
    depths: tuple[float, float] | None,
) -> Coloured:
    """The photograph as it is to be matched, in one channel or in all.

    Channels are brought together where three setups, or one that knows its channels, tell how far they lie apart.
    """
    if channel == "all" and photograph.ndim == 3 and (photograph == photograph[..., :1]).all():
        photograph = np.ascontiguousarray(photograph[..., 0])  # grey in a file for colours
    if photograph.ndim == 2:
        if channel != "all":
            raise ImageError(f"{photo} is grey: it has no {channel} channel; leave --channel out")
        if len(setups) == 3:
            raise ImageError(f"{photo} is grey, but three setups were given, for red, green and blue: give one")
        return _plain(photograph, setups[0], depths)
    if channel != "all":
        number = COLOURS.index(channel)
        one = _plain(np.ascontiguousarray(photograph[..., number]), _of_channel(setups, number), depths)
        return one._replace(note=f"{channel} alone")
    if len(setups) == 3 or knows_channels(setups[0]):
        return _brought_together(photograph, setups, depths)
    plain = _plain(photograph, setups[0], depths)
    if bends_colours(setups[0]):
        plain.warnings.extend(_unaccounted(photograph, setups[0], plain.rig))
    return plain


def _plain(photograph, setup, depths):
    rig = setup.rig()
    depths = depths if depths is not None else setup.depths or rig.working_depths
    return Coloured(photograph, rig, None, depths, "", [])


def _of_channel(setups, number):
    if len(setups) == 3:
        return setups[number]
    (setup,) = setups
    return coloured(setup, setup.channel_wavelengths_nm[number]) if knows_channels(setup) else setup


def _brought_together(photograph, setups, depths):
    rigs = channel_rigs(setups if len(setups) == 3 else setups[0], depths)
    if rigs[0] is rigs[1]:  # mirrors
        return _plain(photograph, setups[1], depths)
    if depths is None:
        depths = setups[len(setups) // 2].depths or rigs[1].working_depths
    middle = middle_inverse_depth(depths)
    expected = expected_shifts(rigs, middle)
    red, _, blue = np.linalg.norm(expected, axis=-1).max(0)
    limit = _FARTHEST * rigs[1].size[0]
    if not (red < limit and blue < limit):
        raise SetupError(
            f"by these setups red lies up to {red:.0f} px from green and blue up to {blue:.0f} px; no glass bends "
            "colours so differently: are all three of the optic and the camera that took this photograph?"
        )
    note = f"red is brought to green by up to {red:.1f} px, blue by up to {blue:.1f} px at {1 / middle:.0f} mm"
    measured = channel_shifts(photograph, rigs[1])
    missed, warnings = np.linalg.norm(measured.shifts - expected, axis=-1), []
    if _sure(missed, measured).any():
        known = "glass and wavelengths of the channels those of this photograph"
        if len(setups) == 3:
            known = "the setups those of red, green and blue, in this order, and of this photograph"
        view, channel = np.unravel_index(np.argmax(np.where(_sure(missed, measured), missed, 0)), missed.shape)
        warnings.append(
            f"{COLOURS[channel]} still lies {missed[view, channel]:.1f} px from green in view {view}: are {known}? "
            "--channel green matches green alone"
        )
    return Coloured(compensated(photograph, rigs, middle), rigs[1], rigs, depths, note, warnings)


def _sure(apart, measured):
    """Which distances (V, 3) px are too long, beyond what the measurement may be off."""
    return apart > _APART + _SURE * measured.sigma


def _unaccounted(photograph, setup, rig):
    measured = channel_shifts(photograph, rig)
    if not _sure(np.linalg.norm(measured.shifts, axis=-1), measured).any():
        return []
    wavelengths = setup.channel_wavelengths_nm
    if wavelengths is None:
        known = "state channel_wavelengths_nm = [RED, GREEN, BLUE] under [light] in the setup file"
    else:
        known = 'name the glass whose dispersion counts, such as dispersion = "N-BK7", under [light] in the setup file'
    return [
        f"the colours of this photograph lie up to {measured.largest:.1f} px apart, and the setup does not say why: "
        f"match one channel (--channel green), or {known}, or give --setup three times, for red, green and blue"
    ]
