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

_PLANS: WeakKeyDictionary[Rig, dict[tuple, Plan]] = WeakKeyDictionary()  # the last one of each rig


def reconstruct(
    photograph: np.ndarray,
    rig: Rig,
    depths: tuple[float, float] | None = None,
    *,
    channels: Sequence[Rig] | None = None,
    step: float = 0.5,
    memory_mib: float = 1024,
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
        the middle of the depths; each colour is matched along its own rays. `rig` is that of green then.
    step : float
        Movement between two depth hypotheses in the most sensitive view, px.
    memory_mib : float
        Memory for the search, MiB. Results do not depend on it.
    progress : callable, optional
        Told (what, done, total) as the work goes on.
    keep : callable, optional
        Given (number of the view, depth map) as soon as each view is matched, so that an interrupted run
        loses nothing.
    """
    photograph = as_photograph(photograph, rig)
    if not 64 <= memory_mib < float("inf"):
        raise SetupError(f"matching needs at least 64 MiB of memory, got {memory_mib}; 1024 is usual")
    depths = rig.check_depths(depths or rig.working_depths)
    ready = plan_of(rig, depths, step=step, channels=channels, progress=_named(progress, "maps between the views"))
    maps = match(photograph, ready, memory_mib=memory_mib, progress=_named(progress, "matching"), keep=keep)
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
    if len(rig) < 2:
        raise OpticError(f"depth needs at least two views, but this setup gives {len(rig)}")
    rigs = check_channels(channels or rig)
    key = (*map(float, depths), float(step), *map(id, rigs))
    kept = _PLANS.get(rig, {})
    if key not in kept:
        hypotheses = inverse_depths(rig, depths, step)
        warps = []
        for k in range(len(rig)):
            warps.append(sweep(rigs, k, hypotheses))
            if progress is not None:
                progress(k + 1, len(rig))
        kept = {key: plan(warps)}
        _PLANS[rig] = kept
    return kept[key]


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


def _named(progress, name):
    return None if progress is None else lambda done, total: progress(name, done, total)
