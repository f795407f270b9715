"""The frame of a rig that was calibrated alone: a rigid motion towards the setup that it was built as."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal

import numpy as np

from ..errors import SetupError
from ..geometry import Pose, nearest_point, nearest_rotation
from ..rigs import ViewLike
from ..triangulation import triangulate

_ACROSS = 9  # samples across a sub-image


def aligned(
    views: Sequence[ViewLike],
    nominal: Sequence[ViewLike],
    by: Literal["centres", "scene"] = "centres",
    depths: tuple[float, float] | None = None,
) -> Pose:
    """The rigid motion nominal_from_rig that brings calibrated views nearest to those of the setup as drawn.

    Parameters
    ----------
    views : sequence of V views
        The calibrated rig, in a frame of its own.
    nominal : sequence of V views
        The same views of the nominal setup, whose frame is wanted.
    by : "centres" or "scene"
        "centres": the rotation brings the rays of the same pixels parallel as nearly as may be, the translation
        brings the optical centres together. An error of the drawing (apex angle, index, distance) hardly reaches
        it; but the centres of calibrated cameras move along z with their focal lengths.
        "scene": points that the nominal rig triangulates between `depths` come to lie where the calibrated rig has
        them. This undoes such motion; but the nominal rig's error of depth goes into the frame.
    depths : (2,) mm, optional
        Nearest and farthest depth for "scene".

    References
    ----------
    Kabsch 1976, A solution for the best rotation to relate two sets of vectors.
    """
    if len(views) != len(nominal):
        raise SetupError(
            f"{len(views)} calibrated views can only be aligned to as many nominal ones, got {len(nominal)}"
        )
    if by == "scene":
        return _by_scene(views, nominal, depths)
    if by != "centres":
        raise SetupError(f"a rig is aligned by 'centres' or by 'scene', got {by!r}")
    ours, theirs, centres = [], [], []
    for view, drawn in zip(views, nominal, strict=True):
        pixels = _sample(drawn)
        rays, drawn_rays = view.unbounded().rays(pixels), drawn.rays(pixels)
        good = np.isfinite(rays.directions).all(-1) & np.isfinite(drawn_rays.directions).all(-1)
        ours.append(rays.directions[good])
        theirs.append(drawn_rays.directions[good])
        centres.append((nearest_point(rays[good]).points, nearest_point(drawn_rays[good]).points))
    rotation = nearest_rotation(np.concatenate(theirs).T @ np.concatenate(ours))
    own, wanted = np.mean(centres, axis=0)
    return Pose(rotation, wanted - rotation @ own)


def _by_scene(views, nominal, depths):
    if depths is None:
        raise SetupError("to align a rig by its scene, say between which depths: depths=(near, far) in mm")
    inverse = np.linspace(1 / depths[1], 1 / depths[0], 5)
    points = np.concatenate([view.rays(_sample(view)).at_depth(1 / w) for view in nominal for w in inverse])
    pixels = np.stack([view.project(points) for view in nominal], -2)
    found = triangulate([view.unbounded() for view in views], pixels).points
    good = np.isfinite(found).all(-1)
    if np.count_nonzero(good) < 3:
        raise SetupError("the nominal views have too few points in common between these depths to align a rig by")
    weight = 1 / points[good, 2:] ** 2  # a far point is known worse, as the square of its depth
    return _weighted_motion(found[good], points[good], weight**2)


def _weighted_motion(points, wanted, weight):
    share = weight / weight.sum()
    middle, goal = (share * points).sum(0), (share * wanted).sum(0)
    rotation = nearest_rotation((wanted - goal).T @ ((points - middle) * share))
    return Pose(rotation, goal - rotation @ middle)


def _sample(view):
    """Some pixels (N, 2) of a view, all over its sub-image."""
    x, y, width, height = view.region.box
    grid = np.stack(np.meshgrid(np.linspace(x, x + width - 1, _ACROSS), np.linspace(y, y + height - 1, _ACROSS)), -1)
    grid = grid.reshape(-1, 2)
    return grid[view.region.contains(grid)]
