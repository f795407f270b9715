"""Measurements drawn into their photograph."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patheffects import withStroke

from ..correspondence.windows import Located
from ..measurement.images import ImagePoint, Measurement
from ..rigs import Rig
from .pictures import draw_outlines, photo_axes

GRADE_COLOURS = {"good": "#00c27a", "check": "#ffb000", "refused": "#ff5a3c"}
"""Colours of the words; the words themselves stand beside them."""

_WAITING = "#40d0ff"
_ABOVE = 6  # of marks: over the numbers of the sub-images
_HALO = [withStroke(linewidth=3, foreground="black")]


def measurement_picture(
    photograph: np.ndarray, rig: Rig, measurements: Sequence[Measurement], values: Sequence[str]
) -> Figure:
    """The photograph with every measurement, its points in all sub-images, and its value as text."""
    figure, axes = photo_axes(photograph.shape)
    draw_outlines(axes, photograph, rig)
    draw_measurements(axes, measurements, values)
    return figure


def draw_measurements(axes: Axes, measurements: Sequence[Measurement], values: Sequence[str]) -> None:
    """Draw measurements on axes that show the photograph."""
    taken = _marks(axes, measurements)
    for number, (found, value) in enumerate(zip(measurements, values, strict=True), 1):
        colour = GRADE_COLOURS[found.grade]
        places = np.array([point.pixel for point in found.given])
        for line in _lines(found.kind, len(places)):
            axes.plot(*places[line].T, color=colour, linewidth=1.8, path_effects=_HALO)
        if found.kind.startswith("point-to"):
            ends = np.stack([places[0], _foot(found.kind, places)])
            axes.plot(*ends.T, color=colour, linewidth=1.4, ls=":", path_effects=_HALO)
        draw_points(axes, found.given, found.located, colour)
        _label(axes, places, f"{number}  {value if found.result is not None else found.grade}", colour, taken)


def draw_points(axes: Axes, given: Sequence[ImagePoint], located: Located, colour: str = _WAITING) -> None:
    """Round marks where points were given, crosses where they were found, squares where a person put them."""
    for point, pixels in zip(given, located.pixels, strict=True):
        axes.plot(*point.pixel, "o", ms=6, mfc=colour, mec="black", mew=1, zorder=_ABOVE)
        by_hand = np.array(point.by_hand).reshape(-1, 2)
        axes.plot(*by_hand.T, "s", ms=8, mfc="none", mec=colour, mew=1.6, path_effects=_HALO, zorder=_ABOVE, ls="")
        away = np.linalg.norm(pixels - np.array(point.pixel), axis=-1) > 1e-9
        found = pixels[np.isfinite(pixels[:, 0]) & away]
        axes.plot(*found.T, "x", ms=7, mec=colour, mew=1.8, path_effects=_HALO, ls="", zorder=_ABOVE)


def _marks(axes, measurements):
    """Boxes (left, top, right, bottom) px around all marks: no label may cover them."""
    half = 0.011 * np.ptp(axes.get_xlim())
    places = [
        np.array(place)
        for found in measurements
        for group in (*found.located.pixels, *((point.pixel, *point.by_hand) for point in found.given))
        for place in group
    ]
    return [np.concatenate([place - half, place + half]) for place in places if np.isfinite(place).all()]


def _lines(kind: str, count: int) -> list[list[int]]:
    """Which points of a measurement are joined: lists of their numbers."""
    if kind == "area":
        return [[*range(count), 0]]
    if kind == "point-to-line":
        return [[1, 2]]
    if kind == "point-to-plane":
        return [[*range(1, count), 1]]
    return [list(range(count))]


def _foot(kind: str, places: np.ndarray) -> np.ndarray:
    """Where a dotted line from the point ends: on the line, or in the middle of the plane's points."""
    if kind == "point-to-plane":
        return places[1:].mean(0)
    along = places[2] - places[1]
    share = (places[0] - places[1]) @ along / max(along @ along, 1e-12)
    return places[1] + np.clip(share, 0, 1) * along


def _label(axes, places, text, colour, taken):
    """Text beside the points, inside the picture, clear of the boxes (left, top, right, bottom) that are taken."""
    left, right = axes.get_xlim()
    bottom, top = axes.get_ylim()  # y runs down
    letter = 0.008 * (right - left)  # px, its width, about
    half, high = 0.5 * letter * (len(text) + 2), 3.2 * letter
    x = float(np.clip(places[:, 0].mean(), left + half, right - half))
    above, below = places[:, 1].min() - 0.9 * high, places[:, 1].max() + 0.9 * high
    tries = [y for k in range(9) for y in (above - k * high, below + k * high)]
    tries = [y for y in tries if top + high / 2 < y < bottom - high / 2] or [(top + bottom) / 2]
    boxes = [np.array([x - half, y - high / 2, x + half, y + high / 2]) for y in tries]
    free = [k for k, box in enumerate(boxes) if not any(_overlap(box, other) for other in taken)]
    best = free[0] if free else 0
    taken.append(boxes[best])
    axes.annotate(
        text,
        (x, tries[best]),
        ha="center",
        va="center",
        color="black",
        fontsize=9,
        bbox={"boxstyle": "round,pad=0.25", "facecolor": colour, "edgecolor": "black", "linewidth": 0.6},
        zorder=10,
    )


def _overlap(a, b):
    return bool((a[:2] < b[2:]).all() and (b[:2] < a[2:]).all())
