"""The main job, step by step: a photograph and a setup become points with covariance."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from .errors import ImageError, OpticError, SetupError
from .geometry import as_rgb
from .matching import DepthMap, agreement, match
from .rectification import inverse_depths, sweep
from .rigs import Rig

MAPS_MIB = 1536  # of a sweep: with 1 GiB for matching, a 12-megapixel photograph fits into 4 GiB
SPACING = 8  # px between the points of a sweep that are projected exactly

Progress = Callable[[str, int, int], None]  # what is being done, steps done, steps in all


@dataclass(frozen=True, eq=False)
class Reconstruction:
    """What one photograph tells about the scene.

    The maps cover the photograph, pixel by pixel; the points are those of all pixels with a depth, row by row.
    """

    rig: Rig
    depths: tuple[float, float]  # mm, that were searched
    depth: np.ndarray  # (H, W) float32 mm, z in the rig frame; NaN unknown
    sigma: np.ndarray  # (H, W) float32 mm, standard deviation of depth; NaN unknown
    confidence: np.ndarray  # (H, W) float32, 0 to 1; 0 unknown
    view: np.ndarray  # (H, W) int8, the view that each pixel belongs to; -1 none
    points: np.ndarray  # (N, 3) mm, rig frame
    covariance: np.ndarray  # (N, 3, 3) float32 mm^2
    colours: np.ndarray  # (N, 3) uint8
    pixels: np.ndarray  # (N, 2) the pixel of each point

    @property
    def completeness(self) -> np.ndarray:
        """Share (V,) of each view's pixels that have a depth."""
        known = np.isfinite(self.depth)
        return np.array([known[self.view == k].mean() if (self.view == k).any() else 0.0 for k in range(len(self.rig))])


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


def assemble(photograph: np.ndarray, rig: Rig, depths: tuple[float, float], maps: Sequence[DepthMap]) -> Reconstruction:
    """One reconstruction from the depth maps of all views."""
    shape = photograph.shape[:2]
    depth, sigma = np.full((2, *shape), np.nan, dtype=np.float32)
    confidence, view_of = np.zeros(shape, np.float32), np.full(shape, -1, np.int8)
    clouds, picture = [], as_rgb(photograph)
    for k, (view, own) in enumerate(zip(rig, maps, strict=True)):
        mask = view.region.mask
        view_of[mask] = k
        rows, columns = np.nonzero(np.isfinite(own.inverse_depth))
        inverse = own.inverse_depth[rows, columns].astype(float)
        spread = own.sigma[rows, columns].astype(float)
        pixels = np.stack([columns, rows], -1) + own.origin
        y, x = pixels[:, 1], pixels[:, 0]
        depth[y, x] = 1 / inverse
        sigma[y, x] = spread / inverse**2
        confidence[y, x] = own.score[rows, columns]
        points, covariance = _located(rig, k, pixels, inverse, spread)
        clouds.append((points, covariance, picture[y, x], pixels))
    points, covariance, colours, pixels = (np.concatenate(parts) for parts in zip(*clouds, strict=True))
    return Reconstruction(rig, depths, depth, sigma, confidence, view_of, points, covariance, colours, pixels)


def _surface(view, own):
    """Points (h, w, 3) of a depth map; NaN where it knows nothing."""
    height, width = own.inverse_depth.shape
    grid = np.stack(np.meshgrid(np.arange(width), np.arange(height)), -1) + np.array(own.origin)
    with np.errstate(divide="ignore"):
        return view.rays(grid).at_depth(1 / own.inverse_depth.astype(float))


def _located(rig, k, pixels, inverse, spread):
    """Points (N, 3) of pixels (N, 2) at inverse depths (N,), and their covariance (N, 3, 3).

    A correspondence is as uncertain in the reference view as in the others: along the ray by the spread of
    inverse depth, across it by the pixels that this spread stands for in the most sensitive other view.
    """
    view = rig[k].unbounded()
    depth = 1 / inverse
    points = view.rays(pixels).at_depth(depth)
    further = view.rays(pixels).at_depth(1 / (inverse + spread))
    along = further - points
    moves = [
        np.linalg.norm(other.unbounded().project(further) - other.unbounded().project(points), axis=-1)
        for j, other in enumerate(rig)
        if j != k
    ]
    noise = np.nanmax(moves, axis=0)[:, None]
    across = [
        noise * (view.rays(pixels + half).at_depth(depth) - view.rays(pixels - half).at_depth(depth))
        for half in np.array([[0.5, 0.0], [0.0, 0.5]])
    ]
    factor = np.stack([along, *across], -1).astype(np.float32)
    return points, factor @ np.swapaxes(factor, -1, -2)


def _named(progress, name):
    return None if progress is None else lambda done, total: progress(name, done, total)
