"""A body in space, drawn as one sees it: its visible edges by parallel projection."""

from __future__ import annotations

import numpy as np

from ..optics.solid import WALL, PrismSolid
from .workshop_sheet import Sheet


def visible_edges(solid: PrismSolid, towards: np.ndarray) -> np.ndarray:
    """Edges (E, 2, 3) mm of a convex body that a far viewer sees, `towards` (3,) the direction to the viewer.

    The seams between the flat strips that stand for a round wall are no edges.
    """
    seen = solid.planes[0] @ towards > 1e-9
    walls = np.array([name == WALL for name in solid.names]) & (solid.tolerance > 0)
    beside: dict[tuple[int, int], list[int]] = {}
    for k, face in enumerate(solid.faces):
        for a, b in zip(face.tolist(), np.roll(face, -1).tolist(), strict=True):
            beside.setdefault((min(a, b), max(a, b)), []).append(k)
    edges = []
    for (a, b), faces in beside.items():
        smooth = walls[faces].all()
        if seen[faces].any() and not (smooth and seen[faces].all()):
            edges.append(solid.vertices[[a, b]])
    return np.array(edges)


def draw_in_space(sheet: Sheet, solid: PrismSolid, turn: float, middle: tuple[float, float], size: float) -> None:
    """Draw a body from above its facets and to one side, `size` mm wide at most, not to scale.

    `turn` (rad) turns it about its axis first.
    """
    azimuth, elevation = np.deg2rad(-60.0) - turn, np.deg2rad(32.0)
    towards = np.array([np.cos(elevation) * np.cos(azimuth), np.cos(elevation) * np.sin(azimuth), np.sin(elevation)])
    right = np.array([-np.sin(azimuth), np.cos(azimuth), 0.0])
    onto = np.array([right, np.cross(towards, right)])
    edges = visible_edges(solid, towards) @ onto.T
    low, high = edges.min((0, 1)), edges.max((0, 1))
    scale = size / float((high - low).max())
    sheet.segments((edges - (low + high) / 2) * scale + middle)
    sheet.text((middle[0], middle[1] - scale * (high - low)[1] / 2 - 5), "in space, not to scale", 1.8)
