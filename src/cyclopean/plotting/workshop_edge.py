"""Section C-C of a prism's drawing: the angle between two facets in its true size."""

from __future__ import annotations

import numpy as np

from ..geometry import clip_by_half_plane
from ..optics.solid import seam_directions
from .workshop import COLUMN
from .workshop_part import Part
from .workshop_sheet import MARGIN, Sheet, degrees_text, scale_text

_REACH = COLUMN / 2 - 7  # mm of the sheet to both sides of the edge; what lies beyond is broken off


def draw_cut_mark(sheet: Sheet, part: Part, origin: np.ndarray, scale: float, room: float) -> None:
    """The trace of section C-C across the edge between facets 0 and 1, seen towards the apex.

    `origin` (2,) is the apex in the front view; the mark reaches no farther than `room` mm of the sheet.
    """
    foot = part.front(part.feet[0]) * scale
    inwards = -foot / np.linalg.norm(foot)
    across = np.array([-inwards[1], inwards[0]])
    middle, reach = origin + foot / 2, min(8.0, room)
    size = min(1.0, 0.3 + 4.0 / part.prism.facets)  # where edges crowd, smaller
    sheet.line([middle - reach * across, middle + reach * across], "centre")
    for side in (-1, 1):
        end = middle + side * (reach + 3.5) * across
        sheet.line([middle + side * reach * across, end], "cut")
        sheet.line([end - 6 * size * inwards, end - 1.4 * inwards], "thin")
        sheet.arrow(end, inwards)
        sheet.text(end - 8.4 * size * inwards, "C", 3.5 * size)


def draw_edge(sheet: Sheet, part: Part, scale: float) -> float:
    """Section C-C through the middle of the edge between facets 0 and 1. Gives the y (mm) of its lower end."""
    flat, half = _section(part), _REACH / scale
    detail = bool((np.abs(flat[:, 0]) > half).any())
    if detail:
        flat = clip_by_half_plane(clip_by_half_plane(flat, [1.0, 0.0], half), [-1.0, 0.0], half)
    depth = -flat[:, 1].min() * scale
    peak = np.array([sheet.size[0] - MARGIN - COLUMN / 2, sheet.size[1] - MARGIN - 19.0])
    _draw_outline(sheet, peak + scale * flat, peak[0] + scale * np.array([-half, half]))
    half_angle = float(np.degrees(part.measures.dihedral_angles[0])) / 2
    text = f"({degrees_text(part.measures.dihedral_angles[0])})"
    sheet.angle(peak, depth + 9.0, 270 - half_angle, 270 + half_angle, text, share=0.5)
    top = int(np.argmax(flat[:, 1]))
    for end in (flat[top - 1], flat[(top + 1) % len(flat)]):
        sheet.text(peak + scale * end / 2 + np.array([0, 2.5]), "F0" if end[0] < 0 else "F1", 1.8)
    sheet.text(peak + np.array([0, 12.0]), "C-C", 3.5)
    kind = "detail, " if detail else ""
    caption = f"{kind}{scale_text(scale)}, at right angles to the edge F0-F1, through its middle"
    sheet.text(peak + np.array([0, 6.5]), caption, 1.6)
    return float(peak[1] - depth - 14.0)


def _section(part):
    """Corners (M, 2) mm of the cut, (to the right, up) from the edge, seen towards the apex."""
    seam = seam_directions(part.prism)[0]
    middle = (part.feet[0] + part.apex) / 2
    cut = part.solid.section(middle, seam) - middle
    level = np.cross([0.0, 0.0, 1.0], seam)
    level /= np.linalg.norm(level)
    up = np.cross(seam, level)
    return np.stack([cut @ level, cut @ up * np.sign(up[2])], -1)


def _draw_outline(sheet, points, sides):
    """A cut (M, 2), with break lines where it lies on one of the two `sides` (x, mm of the sheet)."""
    sheet.fill(points)
    peak = int(np.argmax(points[:, 1]))
    sheet.line(points[[peak - 1, peak, (peak + 1) % len(points)]], name="edge-view")
    for first, second in zip(points, np.roll(points, -1, axis=0), strict=True):
        broken = [x for x in sides if abs(first[0] - x) < 1e-6 and abs(second[0] - x) < 1e-6]
        if broken:
            sheet.break_line(broken[0], *sorted([first[1], second[1]]))
        elif not any(np.array_equal(points[peak], end) for end in (first, second)):
            sheet.line([first, second])
