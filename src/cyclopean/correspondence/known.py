"""Matches of points that are told apart: those of a known target, and those that a person points at."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from ..errors import ImageError
from ..geometry import as_pixels
from ..rigs import Rig
from ..targets import Board, find_board
from ..triangulation import triangulate
from .matches import Counts, Matches, check_views, pixels_of


def match_target(
    photograph: ArrayLike, rig: Rig, board: Board, *, sigma: float = 0.1, min_views: int = 2
) -> tuple[Matches, list[str]]:
    """The points of a known board in the sub-images of a photograph: its own names match them.

    Parameters
    ----------
    photograph : (H, W) or (H, W, 3) array
    rig : Rig
        V views, two or more.
    board : Board
        What to look for.
    sigma : float
        Standard deviation of each pixel coordinate, px: noise of the points, and what the setup may be off.
    min_views : int
        Views that must show a point.

    Returns
    -------
    Matches
        `label` names the board's points. They have no rivals: their ambiguity is 0.
    list of str
        A sentence for each view that is not as it should be.

    Raises
    ------
    ImageError
        When fewer than two views show the board.
    """
    check_views(rig, min_views)
    sightings = find_board(photograph, board, rig.masks, [view.mirrored for view in rig])
    notes = [f"{rig[one.view].name or f'view {one.view}'}: {one.note}" for one in sightings if one.note]
    if sum(len(one.points) > 0 for one in sightings) < 2:
        raise ImageError(f"fewer than two views show the {board}: {'; '.join(notes) or 'is it in the photograph?'}")
    count = max(int(one.points.max(initial=-1)) for one in sightings) + 1
    source = np.full((count, len(rig)), -1)
    for k, one in enumerate(sightings):
        source[one.points, k] = np.arange(len(one.points))
    label = np.flatnonzero((source >= 0).sum(1) >= min_views)
    detected = tuple(one.pixels for one in sightings)
    source = source[label]
    return named_matches(rig, pixels_of(source, detected), source, detected, label, np.zeros(len(label)), sigma), notes


def match_pointed(
    photograph: np.ndarray,
    rig: Rig,
    view: int,
    pixels: ArrayLike,
    depths: tuple[float, float],
    *,
    pointing: float = 0.1,
) -> tuple[Matches, list[str]]:
    """Points that a person gives in one sub-image, found in the others by the windows around them (`locate`).

    Parameters
    ----------
    photograph : (H, W) or (H, W, 3) array
    rig : Rig
        V views, two or more.
    view : int
        The view that shows the pixels.
    pixels : (N, 2) array
        px.
    depths : (near, far)
        Depths to search, mm.
    pointing : float
        Standard deviation of the given pixels, px.

    Returns
    -------
    Matches
        `label` is the row of the given pixel, `next_best` the correlation of the next best place over that of the
        match.
    list of str
        A sentence for each point that was refused.
    """
    from .windows import locate

    pixels = as_pixels(pixels).reshape(-1, 2)
    found = locate(photograph, rig, view, pixels, depths, pointing=pointing)
    rows = np.flatnonzero(found.found)
    notes = [
        f"point {k} at ({x:.1f}, {y:.1f}) px is left out: {reason}"
        for k, ((x, y), reason) in enumerate(zip(pixels, found.reason, strict=True))
        if reason
    ]
    seen = np.isfinite(found.pixels[rows]).all(-1)
    detected = tuple(found.pixels[rows][seen[:, k], k] for k in range(len(rig)))
    source = np.where(seen, np.cumsum(seen, 0) - 1, -1)
    at = found.pixels[rows]
    counts = Counts(np.array([len(one) for one in detected]), 0, 0, 0, 0, len(rows), len(notes))
    return Matches(
        at, found.points[rows], found.covariance[rows], found.residual[rows], seen.sum(1),
        expected_views(rig, found.points[rows]), np.full(len(rows), np.nan), found.ambiguity[rows, view], source, rows,
        np.zeros((0, len(rig)), int), detected, counts,
    ), notes  # fmt: skip


def named_matches(rig, pixels, source, detected, label, ambiguity, sigma) -> Matches:
    """Matches of labelled points: pixels (P, V, 2) triangulated."""
    solved = triangulate(rig, pixels, sigma)
    good = np.isfinite(solved.points).all(1)
    counts = Counts(np.array([len(one) for one in detected]), 0, 0, 0, 0, int(good.sum()), 0)
    return Matches(
        pixels[good], solved.points[good], solved.covariance[good], solved.residual[good], solved.views[good],
        expected_views(rig, solved.points[good]), ambiguity[good], np.full(good.sum(), np.nan), source[good],
        label[good], np.zeros((0, len(rig)), int), detected, counts,
    )  # fmt: skip


def expected_views(rig: Rig, points: np.ndarray) -> np.ndarray:
    """On how many views' pixels points (P, 3) fall, (P,)."""
    inside = [view.region.contains(view.unbounded().project(points)) for view in rig]
    return np.stack(inside, -1).sum(-1)
