"""The main job, step by step: a photograph and a setup become points with covariance."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from ..errors import ImageError, OpticError, SetupError
from ..matching import DepthMap, agreement, match
from ..rectification import inverse_depths, sweep
from ..rigs import Rig
from .reconstruction import Reconstruction, assemble

MAPS_MIB = 1536  # of a sweep: with 1 GiB for matching, a 12-megapixel photograph fits into 4 GiB
SPACING = 8  # px between the points of a sweep that are projected exactly

Progress = Callable[[str, int, int], None]  # what is being done, steps done, steps in all


def reconstruct(
    photograph: np.ndarray,
    rig: Rig,
    depths: tuple[float, float] | None = None,
    *,
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
    step : float
        Movement between two depth hypotheses in the most sensitive view, px.
    memory_mib : float
        Memory for matching, MiB.
    progress : callable, optional
        Told (what, done, total) as the work goes on.
    keep : callable, optional
        Given (number of the view, depth map) as soon as each view is matched, so that an interrupted run
        loses nothing.
    """
    photograph = as_photograph(photograph, rig)
    if len(rig) < 2:
        raise OpticError(f"depth needs at least two views, but this setup gives {len(rig)}")
    if not 64 <= memory_mib < float("inf"):
        raise SetupError(f"matching needs at least 64 MiB of memory, got {memory_mib}; 1024 is usual")
    depths = depths or rig.working_depths
    hypotheses = inverse_depths(rig, depths, step)
    check_memory(rig, len(hypotheses))
    maps = []
    for k, view in enumerate(rig):
        warps = sweep(rig, k, hypotheses, SPACING)
        maps.append(match(photograph, warps, memory_mib=memory_mib, progress=_named(progress, view.name)))
        if keep is not None:
            keep(k, maps[-1])
    checked = cross_check(rig, maps, tolerance=hypotheses[1] - hypotheses[0])
    return assemble(photograph, rig, depths, checked)


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


def check_memory(rig: Rig, hypotheses: int) -> None:
    """Raise SetupError when the maps of one sweep would take more than MAPS_MIB: the depth range is too wide."""
    _, _, width, height = max((view.region.box for view in rig), key=lambda box: box[2] * box[3])
    nodes = (width / SPACING + 2) * (height / SPACING + 2) * hypotheses * (len(rig) - 1)
    needed = nodes * 8 / 2**20  # two float32 a node
    if needed > MAPS_MIB:
        raise SetupError(
            f"{hypotheses} depth hypotheses for {len(rig)} views would take {needed:.0f} MiB of maps, more than "
            f"{MAPS_MIB}; state a narrower depth range, or make the step larger"
        )


def cross_check(rig: Rig, maps: Sequence[DepthMap], tolerance: float) -> list[DepthMap]:
    """Depth maps of all views with only those pixels left that the other views' maps agree with.

    `tolerance` (1/mm) is the largest difference of inverse depth between maps that agree.
    """
    checked = []
    for k, (view, own) in enumerate(zip(rig, maps, strict=True)):
        points = _surface(view, own)
        seen = [other.at(rig[j].project(points)) for j, other in enumerate(maps) if j != k]
        good = agreement(own.inverse_depth, np.stack(seen), tolerance)
        checked.append(
            DepthMap(
                own.origin,
                np.where(good, own.inverse_depth, np.float32(np.nan)),
                np.where(good, own.sigma, np.float32(np.nan)),
                np.where(good, own.score, np.float32(0)),
            )
        )
    return checked


def _surface(view, own):
    """Points (h, w, 3) of a depth map; NaN where it knows nothing."""
    height, width = own.inverse_depth.shape
    grid = np.stack(np.meshgrid(np.arange(width), np.arange(height)), -1) + np.array(own.origin)
    with np.errstate(divide="ignore"):
        return view.rays(grid).at_depth(1 / own.inverse_depth.astype(float))


def _named(progress, name):
    return None if progress is None else lambda done, total: progress(name, done, total)
