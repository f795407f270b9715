"""The picture of a camera's calibration: where the board was seen, and the residuals."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from .colours import view_colour

_LONGEST = 0.035  # of the picture's width: how long the 95th percentile of the residuals is drawn


def camera_picture(size: tuple[int, int], pixels: np.ndarray, residuals: np.ndarray) -> Figure:
    """Residual arrows over the photograph.

    Parameters
    ----------
    size : (2,) int
        Width and height of the photographs, px.
    pixels, residuals : (N, 2) array
        Corners, and observed minus predicted pixels; NaN rows are left out.
    """
    figure = Figure(figsize=(8.0, 1.0 + 8.0 * size[1] / size[0]), dpi=110, layout="constrained")
    axes = figure.subplots()
    known = np.isfinite(residuals).all(-1)
    usual = float(np.percentile(np.linalg.norm(residuals[known], axis=-1), 95)) if known.any() else 0.0
    unit = 10.0 ** np.floor(np.log10(max(usual, 1e-6)))
    arrows = axes.quiver(
        *pixels[known].T,
        *residuals[known].T,
        color=view_colour(0),
        angles="xy",
        scale_units="xy",
        scale=max(usual, 1e-6) / (_LONGEST * size[0]),
        width=0.0016,
        headwidth=4,
    )
    axes.quiverkey(arrows, 0.08, -0.035, unit, f"{unit:g} px", labelpos="E", color="black")
    axes.set(xlim=(-0.5, size[0] - 0.5), ylim=(size[1] - 0.5, -0.5), aspect="equal", xticks=[], yticks=[])
    axes.set_title(f"{known.sum():,} corners")
    return figure
