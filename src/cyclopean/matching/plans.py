"""What matching needs to know of a rig, made once and used for every photograph."""

from dataclasses import dataclass, replace

import numpy as np

from ..errors import ShapeError
from ..geometry import Warps
from .cost import visible
from .pictures import Layout, box_of, layouts
from .places import ALONE, lines_of

_MOST = 64  # hypotheses that are tried everywhere; of more, coarser levels say which


@dataclass(frozen=True, eq=False)
class Reference:
    """One view as the reference: its maps into the others."""

    number: int  # of the view
    others: np.ndarray  # (V-1,) int64, numbers of the other views
    depths: int  # hypotheses
    spacing: int  # rows of the photograph between lines
    lines: dict[int, np.ndarray]  # by pixels of the photograph between those of the map: see `lines_of`
    masks: dict[int, np.ndarray]  # (h, w) bool likewise, pixels that another view sees at some depth

    def half(self, stride: int) -> np.float32:
        """Half of the last hypothesis number where hypotheses are ``stride`` apart."""
        return np.float32((self.depths - 1) / 2 / stride)


@dataclass(frozen=True, eq=False)
class Plan:
    """Maps and layouts of all views."""

    warps: tuple[Warps, ...]  # of each view as the reference
    layouts: tuple[Layout, ...]  # by level: scale 1, 1/2, ...
    boxes: tuple[tuple[slice, slice], ...]  # rows and columns of each view in the photograph
    references: tuple[Reference, ...]  # each view as the reference
    channels: int  # colours matched by themselves; 1: their mean

    @property
    def steps(self) -> int:
        """Steps of a match that its progress counts: for each view one a resolution, and two more."""
        return len(self.references) * (len(self.references[0].lines) + 2)


def plan(warps, channels: int | None = None) -> Plan:
    """Prepare the matching of all views of photographs of one rig.

    Parameters
    ----------
    warps : sequence of Warps
        The maps of each view into all others, in the order of the views.
    channels : int, optional
        Colour channels to match by themselves, 3 for red, green and blue; by default as many as the maps have: 1,
        the mean of all colours, unless they differ from colour to colour.
    """
    warps = tuple(warps)
    views, depths = len(warps), {len(one.inverse_depths) for one in warps}
    if views < 2 or any(len(one.masks) != views for one in warps) or len(depths) > 1:
        raise ShapeError(
            f"matching needs the maps of every view into all others at the same inverse depths, got {views} maps of "
            f"{sorted({len(one.masks) for one in warps})} views at {sorted(depths)} inverse depths"
        )
    own = warps[0].coefficients.shape[1]
    channels = channels or own
    if channels not in ((own,) if own > 1 else (1, 3)):
        wanted = "all of them" if own > 1 else "1, their mean, or 3"
        raise ShapeError(f"the maps are for {own} colour channels: {wanted} can be matched, not {channels}")
    scales = layouts(np.stack([one.masks[0] for one in warps]), max(_levels(depths.pop()), 2))
    references = tuple(_reference(number, one, scales, channels) for number, one in enumerate(warps))
    return Plan(warps, scales, tuple(box_of(one.masks[0]) for one in warps), references, channels)


def _reference(number, warps, scales, channels):
    """A view as the reference, ready for all levels of the search."""
    others, depths = np.array([k for k in range(len(warps.masks)) if k != number]), len(warps.inverse_depths)
    strides = [2**level for level in range(_levels(depths) + 1)]
    lines = {stride: lines_of(warps, stride, channels) for stride in strides}
    reference = Reference(number, others, depths, warps.spacing, lines, {})
    with ALONE:
        masks = {stride: visible(scales[k], reference, stride) for k, stride in enumerate(strides[1:])}
    return replace(reference, masks=masks)


def _levels(depths):
    """1 where all hypotheses can be tried on every other pixel, more for wider ranges."""
    level = 1
    while (depths - 1) / 2**level > _MOST:
        level += 1
    return level
