"""A photograph with the seams and the numbers of the sub-images that were found in it."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from ..geometry import as_rgb
from ..targets.seams import Seams
from .colours import view_colour
from .pictures import photo_axes


def seams_picture(photograph: np.ndarray, seams: Seams) -> Figure:
    """The photograph with its seams and the number of each sub-image."""
    figure, axes = photo_axes(photograph.shape)
    axes.imshow(as_rgb(photograph))
    for line in seams.lines:
        axes.plot(*line.T, color="black", linewidth=3)
        axes.plot(*line.T, color="white", linewidth=1.2)
    for k in range(len(seams)):
        rows, columns = np.nonzero(seams.labels == k)
        if not len(rows):
            continue
        axes.annotate(
            f"{k}",
            (columns.mean(), rows.mean()),
            color="black",
            ha="center",
            va="center",
            weight="bold",
            bbox={"boxstyle": "circle", "facecolor": view_colour(k), "edgecolor": "none"},
        )
    width, height = seams.size
    axes.set_xlim(-0.5, width - 0.5)
    axes.set_ylim(height - 0.5, -0.5)
    axes.set_axis_off()
    return figure
