"""The main job, step by step: a photograph and a setup become points with covariance."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from weakref import WeakKeyDictionary

import numpy as np

from ..errors import ImageError, OpticError, SetupError
from ..matching import DepthMap, Plan, match, plan
from ..rectification import check_channels, inverse_depths, sweep
from ..rigs import Rig
from .reconstruction import Reconstruction, assemble

Progress = Callable[[str, int, int], None]  # what is being done, steps done, steps in all

# the last plan of each rig, by depths, step and channels; with the rigs of the channels, whose ids are in the key
_PLANS: WeakKeyDictionary[Rig, dict[tuple, tuple[Plan, list[Rig]]]] = WeakKeyDictionary()


def reconstruct(
    photograph: np.ndarray,
    rig: Rig,
    depths: tuple[float, float] | None = None,
    *,
    channels: Sequence[Rig] | None = None,
    step: float = 0.5,
    memory_mib: float = 1024,
    strict: bool = True,
    progress: Progress | None = None,
    keep: Callable[[int, DepthMap], None] | None = None,
) -> Reconstruction:
    """Depth and points of everything that at least two sub-images of a photograph show.

    Parameters
    ----------
    photograph : (H, W) or (H, W, 3) array
        The photograph, grey or RGB, of the size of the rig's camera.
    rig : Rig
        The views that the setup gives.
    depths : (2,) mm, optional
        Nearest and farthest depth to search; the rig's working depths where not given.
    channels : sequence of three Rigs, optional
        The rigs of red, green and blue (`rectification.channel_rigs`) that the photograph is `compensated` for at
        the middle of the depths; each colour is matched along its own rays. `rig` must be that of green then.
    step : float
        Movement between two depth hypotheses in the most sensitive view, px; the search itself takes every second
        one, at half the resolution. Larger is faster, and wrong more often at edges.
    memory_mib : float
        Memory for the search, MiB. Results do not depend on it.
    strict : bool
        Keep only depths that a pixel's own window tells and another view confirms. Otherwise the map is fuller,
        and more of it is wrong.
    progress : callable, optional
        Told (what, done, total) as the work goes on.
    keep : callable, optional
        Given (number of the view, depth map) as soon as each view is matched, so that an interrupted run
        loses nothing.

    Returns
    -------
    Reconstruction
        In colours of the photograph as it is given.

    Raises
    ------
    ImageError
        When the photograph is not of the rig's size, or has no colours where `channels` are given.
    SetupError
        When the rigs of the channels are not those of one photograph, or an option is out of range.
    OpticError
        When the rig has but one view.
    """
    photograph = as_photograph(photograph, rig)
    if channels is not None and photograph.shape[2:] != (len(channels),):
        raise ImageError(
            f"{len(channels)} channels want a photograph of as many colours, got one of shape {photograph.shape}"
        )
    check_views(rig)
    if not 64 <= memory_mib < float("inf"):
        raise SetupError(f"matching needs at least 64 MiB of memory, got {memory_mib}; 1024 is usual")
    depths = rig.check_depths(rig.working_depths if depths is None else depths)
    ready = plan_of(rig, depths, step=step, channels=channels, progress=_named(progress, "maps between the views"))
    if progress is not None:
        progress("matching", 0, ready.steps)
    maps = match(
        photograph, ready, memory_mib=memory_mib, strict=strict, progress=_named(progress, "matching"), keep=keep
    )
    return assemble(photograph, rig, depths, maps)


def plan_of(
    rig: Rig,
    depths: tuple[float, float],
    *,
    step: float = 0.5,
    channels: Sequence[Rig] | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> Plan:
    """What matching needs to know of a rig; that of the last depth range is kept for the next photograph.

    Parameters
    ----------
    rig : Rig
        Two views or more.
    depths : (2,) mm
        Nearest and farthest depth to search.
    step, channels
        As for `reconstruct`.
    progress : callable, optional
        Called as ``progress(done, total)``.
    """
    check_views(rig)
    rigs = check_channels(channels or rig)
    if rigs[len(rigs) // 2] is not rig:
        raise SetupError("of rigs for red, green and blue, rig must be that of green: rig=channels[1]")
    key = (*map(float, depths), float(step), *map(id, rigs))
    kept = _PLANS.get(rig, {})
    if key not in kept:
        hypotheses = inverse_depths(rig, depths, step)
        warps = []
        if progress is not None:
            progress(0, len(rig))
        for k in range(len(rig)):
            warps.append(sweep(rigs, k, hypotheses))
            if progress is not None:
                progress(k + 1, len(rig))
        kept = {key: (plan(warps), [one for one in rigs if one is not rig])}
        _PLANS[rig] = kept
    return kept[key][0]


def as_photograph(photograph: np.ndarray, rig: Rig) -> np.ndarray:
    """The photograph as an array, or an ImageError when it does not belong to the rig."""
    photograph = np.asarray(photograph)
    width, height = rig.size
    if photograph.ndim not in (2, 3) or photograph.shape[:2] != (height, width):
        raise ImageError(
            f"the photograph has shape {photograph.shape}, but the setup's camera takes {width}x{height} px: "
            f"wanted ({height}, {width}) or ({height}, {width}, 3)"
        )
    return photograph


def check_views(rig: Rig) -> None:
    """OpticError where a rig has but one view."""
    if len(rig) < 2:
        raise OpticError(f"depth needs at least two views, but this setup gives {len(rig)}")


def _named(progress, name):
    return None if progress is None else lambda done, total: progress(name, done, total)
