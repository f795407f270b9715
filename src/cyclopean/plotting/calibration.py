"""The pictures of a calibration: residuals, coverage, errors of depth, photographs."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator

from ..calibration.depths import DepthErrors, largest, rig_points, rms
from ..calibration.physical import Calibration
from ..errors import CyclopeanError
from ..targets import DIRECT
from .colours import BLUE, GREY, LIGHT_GREY, ORANGE, RED, SKY_BLUE, VERMILION, VIEW_COLOURS, view_colour

_ARROWS = 2500  # more do not show
_ARROW_LENGTH = 0.035  # of the picture's width, that of the 95th percentile of the residuals
_LONGEST = 0.1  # of the picture's width; longer arrows are cut
_BINS = 61
_NARROW = 4  # largest over smallest value, below which a logarithmic axis wants numbers between 1, 2 and 5


def residual_picture(calibration: Calibration) -> Figure:
    """Residual arrows over the photograph, and the histogram of their coordinates with a normal curve.

    The curve has the robust sigma of the coordinates, 1.4826 times the median of their distances from their median.
    """
    kinds = _kinds(calibration)
    figure = Figure(figsize=(6.4 * len(kinds) + 4.2, 5.6), dpi=110, layout="constrained")
    axes = figure.subplots(1, len(kinds) + 1, width_ratios=[6] * len(kinds) + [4])
    length = np.linalg.norm(calibration.residuals, axis=-1)
    usual = float(np.nanpercentile(length[~calibration.outliers], 95)) if (~calibration.outliers).any() else 1.0
    unit = _round_number(max(usual, 1e-6))
    for one, (title, rows) in zip(axes, kinds, strict=False):
        _draw_arrows(one, calibration, rows, unit)
        one.set_title(title)
    _draw_histogram(axes[-1], calibration)
    return figure


def _kinds(calibration):
    """Titles and rows of the photographs through the optic and without it, as far as there are any."""
    direct = calibration.observations.view == DIRECT
    kinds = (("residuals, through the optic", ~direct), ("residuals, without the optic", direct))
    return [(title, rows) for title, rows in kinds if rows.any()]


def _draw_arrows(axes: Axes, calibration: Calibration, rows: np.ndarray, unit: float) -> None:
    seen, residuals = calibration.observations, calibration.residuals
    width, _ = calibration.setup.camera.size
    per_px = _ARROW_LENGTH * width / unit
    _draw_seams(axes, calibration, rows)
    _label_views(axes, calibration, rows)
    good = np.flatnonzero(rows & ~calibration.outliers & np.isfinite(residuals).all(-1))
    good = np.sort(np.random.default_rng(0).permutation(good)[:_ARROWS])
    colours = np.array([*VIEW_COLOURS, GREY])
    shades = colours[np.where(seen.view[good] == DIRECT, -1, seen.view[good] % len(VIEW_COLOURS))]
    shown = residuals[good] * per_px
    length = np.linalg.norm(shown, axis=-1)
    cut = length > _LONGEST * width
    shown[cut] *= (_LONGEST * width / length[cut])[:, None]
    arrows = axes.quiver(
        *seen.pixels[good].T,
        *shown.T,
        color=shades,
        angles="xy",
        scale_units="xy",
        scale=1,
        width=0.0016,
        headwidth=4,
    )
    lost = rows & calibration.outliers
    if lost.any():
        count = int(lost.sum())
        label = f"{count:,} outlier{'' if count == 1 else 's'}"
        axes.plot(*seen.pixels[lost].T, "x", color=RED, markersize=5, label=label)
        axes.legend(loc="upper right", bbox_to_anchor=(1.0, 0.0), fontsize=8, frameon=False)
    key = f"{unit:g} px" + (f"; {cut.sum():,} longer than {_LONGEST * width / per_px:.3g} px cut" if cut.any() else "")
    axes.quiverkey(arrows, 0.08, -0.035, unit * per_px, key, labelpos="E", color="black")
    _frame(axes, calibration.setup.camera.size)


def _label_views(axes, calibration, rows):
    """The number of each view in the middle of what it shows, in the colour of its arrows."""
    seen = calibration.observations
    for number in np.unique(seen.view[rows & (seen.view != DIRECT)]):
        middle = np.median(seen.pixels[rows & (seen.view == number)], axis=0)
        colour = view_colour(number)
        box = {"boxstyle": "round", "facecolor": "white", "edgecolor": colour, "linewidth": 1.5, "alpha": 0.85}
        axes.annotate(f"view {number}", middle, ha="center", va="center", fontsize=9, bbox=box, zorder=4)


def _draw_seams(axes, calibration, rows):
    """Outlines of the calibrated sub-images, where there are any in these rows."""
    if (calibration.observations.view[rows] == DIRECT).all():
        return
    try:
        rig = calibration.setup.rig()
    except CyclopeanError:
        return
    for view in rig:
        for line in view.region.outline:
            axes.plot(*line.T, color=LIGHT_GREY, linewidth=0.8, zorder=0)


def _frame(axes, size):
    axes.set(xlim=(-0.5, size[0] - 0.5), ylim=(size[1] - 0.5, -0.5), aspect="equal", xticks=[], yticks=[])


def _draw_histogram(axes: Axes, calibration: Calibration) -> None:
    values = calibration.residuals[~calibration.outliers].ravel()
    values = values[np.isfinite(values)]
    sigma = 1.4826 * float(np.median(np.abs(values - np.median(values)))) if values.size else 0.0
    sigma = sigma or float(values.std()) or 1.0
    middle, limit = float(np.median(values)) if values.size else 0.0, 5 * sigma
    edges = np.linspace(-limit, limit, int(np.clip(np.sqrt(values.size), 16, _BINS)))
    axes.hist(np.clip(values, -limit, limit), edges.tolist(), color=SKY_BLUE)
    x = np.linspace(-limit, limit, 300)
    height = values.size * (edges[1] - edges[0]) / (sigma * np.sqrt(2 * np.pi))
    label = f"normal curve of the robust sigma, {sigma:.3g} px"
    axes.plot(x, height * np.exp(-0.5 * ((x - middle) / sigma) ** 2), color="black", label=label)
    axes.set(xlabel="residual coordinate (px)", yticks=[])
    axes.set_title(f"{values.size:,} coordinates, {rms(values):.3g} px rms", pad=26)
    axes.legend(loc="lower left", bbox_to_anchor=(0.0, 1.0), fontsize=8, frameon=False)
    axes.spines[["top", "left", "right"]].set_visible(False)


def _round_number(value: float) -> float:
    """The largest of 1, 2, 5 times a power of ten that is not above a value."""
    power = 10.0 ** np.floor(np.log10(value))
    return float(f"{max(step * power for step in (1, 2, 5) if step * power <= value * (1 + 1e-9)):.1g}")


def coverage_picture(calibration: Calibration) -> Figure:
    """Where the detected points of all photographs lie in the picture, coloured by their depth."""
    kinds = [(title.replace("residuals", "points found"), rows) for title, rows in _kinds(calibration)]
    figure = Figure(figsize=(6.4 * len(kinds) + 1, 5.2), dpi=110, layout="constrained")
    axes = np.atleast_1d(figure.subplots(1, len(kinds)))
    depths = rig_points(calibration)[:, 2]
    low, high = np.percentile(depths, [1, 99])
    shown = None
    for one, (title, rows) in zip(axes, kinds, strict=True):
        _draw_seams(one, calibration, rows)
        order = np.flatnonzero(rows)[np.argsort(-depths[rows])]
        x, y = calibration.observations.pixels[order].T
        shown = one.scatter(x, y, c=depths[order], s=5, cmap="viridis_r", vmin=low, vmax=high, linewidths=0)
        photos = len(np.unique(calibration.observations.photo[rows]))
        one.set_title(f"{title}: {rows.sum():,} in {photos} photograph{'s' if photos > 1 else ''}")
        _frame(one, calibration.setup.camera.size)
    if shown is not None:
        figure.colorbar(shown, ax=axes, label="depth z (mm)", fraction=0.04, pad=0.02)
    return figure


def depth_error_picture(errors: DepthErrors) -> Figure:
    """Standard deviation of depth over the field at the nearest, middle and farthest depth, and over depth.

    The upper row shows noise and calibration together, the lower one the calibration's part.
    """
    figure = Figure(figsize=(16, 6.6), dpi=110, layout="constrained")
    places = sorted({0, len(errors.depths) // 2, len(errors.depths) - 1})
    grid = figure.add_gridspec(2, len(places) + 1, width_ratios=[4] * len(places) + [5.5])
    for row, (what, values) in enumerate((("total", errors.total), ("by calibration", errors.calibration))):
        for column, k in enumerate(places):
            axes = figure.add_subplot(grid[row, column])
            axes.set_title(f"{what}, depth {errors.depths[k]:.0f} mm")
            _draw_map(axes, errors.points[k], values[k])
    _draw_curves(figure.add_subplot(grid[:, -1]), errors)
    return figure


def _draw_map(axes, points, values):
    """A map (H, W) of standard deviations (mm) over points (H, W, 3)."""
    if not np.isfinite(values).any():
        axes.text(0.5, 0.5, "seen by fewer\nthan two views", ha="center", va="center", transform=axes.transAxes)
        axes.set(xticks=[], yticks=[])
        return
    shown = axes.pcolormesh(
        points[..., 0], points[..., 1], np.ma.masked_invalid(values), cmap="magma_r", shading="nearest"
    )
    axes.set(xlabel="x (mm)", ylabel="y (mm)", aspect="equal")
    axes.invert_yaxis()
    axes.figure.colorbar(shown, ax=axes, label="sigma of depth (mm)", shrink=0.85)


def _draw_curves(axes, errors):
    parts = (
        (f"noise of {errors.pixel_sigma:g} px", errors.noise, BLUE, "o-"),
        ("calibration", errors.calibration, VERMILION, "s-"),
        ("total", errors.total, "black", ":"),
    )
    for label, values, colour, style in parts:
        axes.plot(errors.depths, [rms(value) for value in values], style, color=colour, label=label, markersize=4)
    sizes = [rms(value) for _, values, *_ in parts for value in values]
    if np.nanmin(sizes) > 0:
        axes.set_yscale("log")
        axes.yaxis.set_major_formatter("{x:g}")
        axes.yaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
        axes.yaxis.set_minor_formatter("{x:g}" if np.nanmax(sizes) < _NARROW * np.nanmin(sizes) else "")
    axes.set(xlabel="depth z (mm)", ylabel="sigma of depth, rms over the field (mm)")
    axes.set_title(f"sigma of depth is {largest(errors.total):.3g} mm at most", pad=26)
    axes.grid(alpha=0.3, which="both")
    axes.legend(fontsize=8, ncols=3, loc="lower left", bbox_to_anchor=(0.0, 1.0), frameon=False, columnspacing=1.0)


def photo_picture(calibration: Calibration, held_out: Sequence[float] | np.ndarray | None = None) -> Figure:
    """Residuals of each photograph as bars; `held_out` (B,) px are those by calibrations that did not see it."""
    seen = calibration.observations
    count = len(seen.photos)
    good = ~calibration.outliers
    sizes = [rms(calibration.residuals[(seen.photo == k) & good]) for k in range(count)]
    figure = Figure(figsize=(float(np.clip(0.45 * count + 3, 6, 18)), 4.2), dpi=110, layout="constrained")
    axes = figure.add_subplot()
    places = np.arange(count)
    width = 0.4 if held_out is not None else 0.7
    direct = np.array([np.all(seen.view[seen.photo == k] == DIRECT) for k in range(count)])
    for mine, colour, label in ((~direct, BLUE, "calibrated with it"), (direct, GREY, "without the optic")):
        if mine.any():
            shift = -width / 2 if held_out is not None else 0.0
            axes.bar(places[mine] + shift, np.array(sizes)[mine], width, color=colour, label=label)
    if held_out is not None:
        axes.bar(places + width / 2, np.asarray(held_out), width, color=ORANGE, label="calibrated without it")
    axes.axhline(rms(calibration.residuals[good]), color="black", linewidth=0.8, linestyle="--", label="all")
    axes.set_xticks(places, _short(seen.photos), rotation=60, ha="right", fontsize=8 if count < 40 else 5)
    axes.set(ylabel="residuals (px rms)", xlim=(-0.7, count - 0.3))
    axes.spines[["top", "right"]].set_visible(False)
    axes.legend(fontsize=8, ncols=4, loc="lower left", bbox_to_anchor=(0, 1.0), frameon=False)
    return figure


def _short(names):
    return [name if len(name) <= 24 else f"...{name[-22:]}" for name in names]
