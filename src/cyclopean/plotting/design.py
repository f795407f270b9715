"""Prisms that fit the requirements, in one picture: depth accuracy against field, and against size."""

from __future__ import annotations

from collections.abc import Sequence
from string import ascii_lowercase
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

from .colours import GREY, GRID, LIGHT_GREY, RED, view_colour

if TYPE_CHECKING:
    from ..design.requirements import Candidate, Designs

_PLAIN = FuncFormatter(lambda value, _: f"{value:g}")
_MARKERS = "osD^vPX*"
_SMALL, _LARGE = 14.0, 130.0  # points^2, of the markers of the least and the largest diameter
_WIDE = 2.5  # ratio of largest to smallest, from which a scale is logarithmic
_LETTER = 16.0  # points from a marker to its letter
_TURNS = np.deg2rad([45, 135, -45, -135, 90, 0, 180, -90])


def comparison_picture(designs: Designs, written: Sequence[int]) -> Figure:
    """Every prism that fits as a dot: accuracy against field, against size, and against use of the sensor.

    Parameters
    ----------
    designs : Designs
        What a search found.
    written : sequence of int
        Candidates (by index) that are called a, b, c, ...
    """
    figure = Figure(figsize=(15.5, 6.0), dpi=120, layout="constrained")
    panels = figure.subplots(1, 3, sharey=True)
    columns = (
        ("what two views share at middle depth, side of a square (mm)", _field, True),
        ("size: cube root of diameter x diameter x length (mm)", _size, False),
        ("sensor pixels that two views or more use (%)", lambda candidate: 100 * candidate.figures.use, True),
    )
    values = [np.array([value(candidate) for candidate in designs.candidates]) for _, value, _ in columns]
    for axes, along, (label, _, more) in zip(panels, values, columns, strict=True):
        _draw_panel(axes, designs, written, along, more)
        axes.set_xlabel(label)
        axes.set_title(f"lower and further {'right' if more else 'left'} is better", fontsize=10, loc="left")
    panels[0].set_ylabel("standard deviation of depth at the worst depth (% of depth)")
    near, far = designs.requirements.depths
    figure.suptitle(
        f"prisms that fit: {len(designs.candidates)}, for depths from {near:g} to {far:g} mm; letters: those written",
        fontsize=12,
    )
    _legend(figure, designs)
    figure.draw_without_rendering()  # then the places of the panels are known
    for axes, along in zip(panels, values, strict=True):
        _write_letters(figure, axes, designs, written, along)
    return figure


def _field(candidate: Candidate) -> float:
    """Side (mm) of a square as large as what two views or more share at the middle depth."""
    return float(np.sqrt(candidate.figures.area_two[candidate.figures.middle]))


def _size(candidate: Candidate) -> float:
    """Side (mm) of a cube as large as the box from the pinhole to the prism's end."""
    return float(np.cbrt(candidate.figures.diameter**2 * candidate.figures.length))


def _draw_panel(axes: Axes, designs: Designs, written: Sequence[int], values: np.ndarray, more: bool) -> None:
    """All candidates pale, the Pareto front in full colour, and the steps that nothing betters in these two figures."""
    paper = np.array([100 * c.figures.accuracy for c in designs.candidates])
    sizes = _marker_sizes(designs.candidates)
    for rows, good in _groups(designs, paper):
        first = designs.candidates[rows[0]]
        axes.scatter(
            values[rows], paper[rows], sizes[rows], facecolor=_colour(first) if good else "none",
            alpha=0.9 if good else 0.35, edgecolor="white" if good else _colour(first), linewidth=0.7,
            marker=_marker(first, designs), zorder=3 if good else 2,
        )  # fmt: skip
    _draw_steps(axes, values, paper, more)
    for k in written:
        kept = designs.candidates[k].kept
        if kept is not None and np.isfinite(kept.worst):
            axes.plot([values[k]] * 2, [paper[k], 100 * kept.worst], color=GREY, linewidth=1.2, zorder=3.5)
            axes.plot(values[k], 100 * kept.worst, "_", color="black", markersize=10, markeredgewidth=1.8, zorder=4)
    if designs.requirements.accuracy is not None:
        axes.axhline(100 * designs.requirements.accuracy, color=RED, linestyle="--", linewidth=1.0)
    low, high = axes.get_ylim()
    if high > _WIDE * max(low, 0.0):
        axes.set_yscale("log")
        axes.yaxis.set_major_locator(LogLocator(subs=(1.0, 1.5, 2.0, 3.0, 4.0, 5.0, 7.0)))
        axes.yaxis.set_major_formatter(_PLAIN)
        axes.yaxis.set_minor_formatter(NullFormatter())
    axes.grid(**GRID)
    axes.set_axisbelow(True)
    axes.spines[["top", "right"]].set_visible(False)


def _groups(designs, paper):
    """Rows of candidates that are drawn alike, and whether they are of the Pareto front."""
    front = np.isin(np.arange(len(paper)), designs.front)
    kinds: dict[tuple, list[int]] = {}
    for k in np.flatnonzero(np.isfinite(paper)):
        prism = designs.candidates[k].prism
        kinds.setdefault((bool(front[k]), prism.facets, str(prism.glass)), []).append(int(k))
    return [(rows, kind[0]) for kind, rows in kinds.items()]


def _draw_steps(axes, values, paper, more):
    """The line of those that no other betters in both figures."""
    known = np.isfinite(values) & np.isfinite(paper)
    order = np.lexsort((paper[known], -values[known] if more else values[known]))
    along, up = values[known][order], paper[known][order]
    best = np.minimum.accumulate(up)
    first = np.append(True, best[1:] < best[:-1])
    axes.step(along[first], up[first], where="post", color=LIGHT_GREY, linewidth=1.2, zorder=1)


def _marker_sizes(candidates: Sequence[Candidate]) -> np.ndarray:
    diameters = np.array([candidate.figures.diameter for candidate in candidates])
    low, high = diameters.min(), diameters.max()
    share = (diameters - low) / (high - low) if high > low else np.full(len(diameters), 0.5)
    return _SMALL + (_LARGE - _SMALL) * share


def _colour(candidate):
    return view_colour(candidate.prism.facets - 2)


def _marker(candidate, designs):
    glasses = designs.requirements.glasses
    return _MARKERS[glasses.index(candidate.prism.glass) % len(_MARKERS)] if len(glasses) > 1 else "o"


def _legend(figure: Figure, designs: Designs) -> None:
    candidates = designs.candidates
    style: dict[str, Any] = {"linestyle": "", "markeredgecolor": "white"}
    handles = []
    for facets in sorted({candidate.prism.facets for candidate in candidates}):
        handles.append(
            Line2D([], [], marker="o", markersize=9, color=view_colour(facets - 2), label=f"{facets} facets", **style)
        )
    glasses = [g for g in designs.requirements.glasses if any(c.prism.glass == g for c in candidates)]
    if len(designs.requirements.glasses) > 1:
        for glass in glasses:
            marker = _MARKERS[designs.requirements.glasses.index(glass) % len(_MARKERS)]
            handles.append(Line2D([], [], marker=marker, markersize=8, color=GREY, label=glass, **style))
    sizes = _marker_sizes(candidates)
    for k in dict.fromkeys((int(np.argmin(sizes)), int(np.argmax(sizes)))):
        text = f"diameter {candidates[k].figures.diameter:.3g} mm"
        handles.append(Line2D([], [], marker="o", markersize=sizes[k] ** 0.5, color=GREY, label=text, **style))
    if len(designs.front) < len(candidates):
        pale = {"markerfacecolor": "none", "markeredgecolor": LIGHT_GREY}
        label = "bettered by another in everything"
        handles.append(Line2D([], [], marker="o", markersize=8, label=label, **(style | pale)))
    if any(candidate.kept is not None for candidate in candidates):
        handles.append(
            Line2D([], [], marker="_", markersize=10, color="black", label="kept after making and calibrating")
        )
    if designs.requirements.accuracy is not None:
        handles.append(Line2D([], [], color=RED, linestyle="--", label="asked for"))
    figure.legend(handles=handles, loc="outside lower center", ncols=min(len(handles), 7), frameon=False, fontsize=9)


def _write_letters(figure: Figure, axes: Axes, designs: Designs, written: Sequence[int], values: np.ndarray) -> None:
    """A letter beside each candidate that is written, where it covers no other."""
    places = np.array([[values[k], 100 * designs.candidates[k].figures.accuracy] for k in written])
    spots = axes.transData.transform(places) * 72 / figure.dpi  # points
    box = np.asarray(axes.get_window_extent().extents) * 72 / figure.dpi
    taken = list(spots)
    for letter, spot, place in zip(ascii_lowercase, spots, places, strict=False):
        tries = [reach * _LETTER * np.array([np.cos(t), np.sin(t)]) for reach in (1.0, 1.7, 2.6) for t in _TURNS]
        inside = [step for step in tries if (spot + step > box[:2] + 6).all() and (spot + step < box[2:] - 6).all()]
        room = [min(np.linalg.norm(spot + step - other) for other in taken) for step in inside or tries]
        enough = [k for k, free in enumerate(room) if free > 0.9 * _LETTER]
        step = (inside or tries)[enough[0] if enough else int(np.argmax(room))]
        taken.append(spot + step)
        axes.annotate(
            letter, place, xytext=(step[0], step[1]), textcoords="offset points", ha="center", va="center", fontsize=11,
            fontweight="bold", zorder=6, arrowprops={"arrowstyle": "-", "color": GREY, "linewidth": 0.7, "shrinkB": 2},
            bbox={"boxstyle": "circle,pad=0.15", "facecolor": "white", "edgecolor": GREY, "linewidth": 0.7},
        )  # fmt: skip
