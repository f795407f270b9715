"""What virtual cameras do to depth: curves over depth, and maps over the field."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from ..analysis.model_error import METHODS

if TYPE_CHECKING:
    from ..analysis.model_error import ModelError

_COLOURS = {"sketch": "#d55e00", "fit": "#e69f00", "distortion": "#0072b2"}  # Okabe and Ito
_MAPS = 3  # depths that are drawn as maps


def model_error_picture(errors: Sequence[ModelError]) -> Figure:
    """One row for each way to find virtual cameras: error of depth over depth, and over the field at three depths."""
    figure = Figure(figsize=(15, 3.2 * len(errors)), dpi=110, layout="constrained")
    rows = figure.subplots(len(errors), 1 + _MAPS, squeeze=False, width_ratios=[1.35] + [1] * _MAPS)
    for axes, error in zip(rows, errors, strict=True):
        _draw_curve(axes[0], error)
        _draw_maps(figure, axes[1:], error)
    return figure


def _draw_curve(axes: Axes, error: ModelError) -> None:
    colour = _COLOURS[error.method]
    low, high = error.range.T
    axes.fill_between(error.depths, low, high, color=colour, alpha=0.25, linewidth=0, label="over the field")
    axes.plot(error.depths, error.middle, color=colour, marker="o", markersize=4, label="middle of the field")
    axes.axhline(0, color="black", linewidth=0.8)
    if error.method != "sketch":
        for k, depth in enumerate(error.cameras[0].depths):
            axes.axvline(depth, color="#777777", linestyle=":", linewidth=1, label=None if k else "fitted between")
    axes.set_title(METHODS[error.method], fontsize=11)
    axes.set_xlabel("depth, mm")
    axes.set_ylabel("error of depth, %")
    axes.grid(color="#dddddd", linewidth=0.6)
    axes.spines[["top", "right"]].set_visible(False)
    axes.legend(frameon=False, fontsize=8)


def _draw_maps(figure, places, error):
    """The error over the field at the nearest, a middle and the farthest depth, each with its own scale of colours."""
    chosen = np.unique(np.linspace(0, len(error.depths) - 1, _MAPS).round().astype(int))
    for axes in places[len(chosen) :]:
        axes.set_axis_off()
    for axes, k in zip(places, chosen, strict=False):
        known = np.abs(error.percent[k])
        limit = max(float(np.nanpercentile(known, 99)) if np.isfinite(known).any() else 1.0, 1e-9)
        x, y = error.points[k, 0, :, 0], error.points[k, :, 0, 1]
        shades = axes.pcolormesh(
            x, y, np.ma.masked_invalid(error.percent[k]), cmap="RdBu_r", vmin=-limit, vmax=limit, shading="nearest"
        )
        axes.set_aspect("equal")
        axes.set_facecolor("#c8c8c8")  # points that fewer than two views see
        axes.invert_yaxis()
        axes.set_title(f"at {error.depths[k]:g} mm", fontsize=10)
        axes.set_xlabel("x, mm")
        axes.set_ylabel("y, mm")
        figure.colorbar(shades, ax=axes, label="error of depth, %", shrink=0.8)
