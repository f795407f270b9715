"""How views are turned and flipped against each other."""

from __future__ import annotations

import numpy as np

from ..rigs import ViewLike


def facing(view: ViewLike, depth: float) -> tuple[bool, float]:
    """How a view shows the scene around its middle at a depth (mm).

    Returns
    -------
    bool
        Whether it is flipped.
    float
        Angle (rad) of the rig's x axis in its picture, clockwise; in its mirror picture where it is flipped.
    """
    endless = view.unbounded()
    across = endless.pixel_derivatives(endless.rays(view.region.centre).at_depth(depth)).to_point[:, :2]
    if not np.isfinite(across).all():
        return view.mirrored, 0.0
    flipped = bool(np.linalg.det(across) < 0)
    x, y = across[:, 0]
    return flipped, float(np.arctan2(y, -x if flipped else x))
