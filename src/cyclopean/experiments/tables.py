"""Tables of an experiment: of the thesis's form (4.1, 5.1 and 6.1), in full, and in Markdown and LaTeX."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..rigs import Rig
from .experiment import Experiment
from .setups import baseline, virtual_centres

Table = tuple[tuple[str, ...], list[tuple[str, ...]]]  # column names, rows

_LONG = (
    "approach", "actual_depth_mm", "points", "recovered_mean_mm", "recovered_sd_mm", "error_of_mean_percent",
    "rms_percent", "largest_percent",
)  # fmt: skip


def thesis_table(experiment: Experiment, approaches: Sequence[str] | None = None) -> Table:
    """Actual depth, and for each approach the mean recovered depth (mm) with its error (%) in brackets."""
    names = experiment.approaches if approaches is None else tuple(approaches)
    cells = {(row.approach, row.actual): row for row in experiment.rows}
    rows = []
    for depth in np.unique(experiment.actual):
        found = [cells[name, float(depth)] for name in names]
        pairs = (f"{_text(row.recovered, '.2f')} ({_text(row.error_percent, '+.2f')})" for row in found)
        rows.append((f"{depth:g}", *pairs))
    return ("actual (mm)", *names), rows


def summary_table(experiment: Experiment) -> Table:
    """Errors of each approach over all points: rms, largest and mean (%), residual (px) and time (s)."""
    columns = ("approach", "rms (%)", "largest (%)", "mean (%)", "residual (px rms)", "time (s)")
    rows: list[tuple[str, ...]] = [
        (
            one.approach,
            _text(one.rms_percent, ".3f"),
            _text(one.largest_percent, ".3f"),
            _text(one.mean_percent, "+.3f"),
            _text(one.residual_px, ".3f"),
            _text(one.seconds, ".2f"),
        )
        for one in experiment.summary
    ]
    return columns, rows


def cameras_table(experiment: Experiment) -> Table:
    """What each approach found: baseline of neighbouring views (mm), centre (mm) and focal length (px) of view 0.

    True rays have no focal length of their own: theirs is the real camera's.
    """
    columns = ("approach", "baseline (mm)", "centre of view 0: x, y, z (mm)", "focal length x, y (px)")
    rows: list[tuple[str, ...]] = []
    for one in experiment.recovered:
        if one.failed:
            rows.append((one.approach, "-", "-", "-"))
            continue
        rig = Rig(tuple(one.views))
        centre, focal = virtual_centres(rig)[0], rig[0].camera.focal
        rows.append(
            (
                one.approach,
                f"{baseline(rig):.3f}",
                ", ".join(f"{x:.3f}" for x in centre),
                ", ".join(f"{f:.1f}" for f in focal),
            )
        )
    return columns, rows


def long_table(experiment: Experiment) -> Table:
    """A row for each approach and each depth, with names of columns that carry their units."""
    rows = []
    for row in experiment.rows:
        numbers = (row.recovered, row.deviation, row.error_percent, row.rms_percent, row.largest_percent)
        rows.append((row.approach, f"{row.actual:g}", str(row.points), *(_text(x, ".6g", "") for x in numbers)))
    return _LONG, rows


def as_markdown(table: Table) -> str:
    """A table in Markdown: the first column to the left, the others to the right."""
    columns, rows = table
    lines = [columns, (":--", *["--:"] * (len(columns) - 1)), *rows]
    return "".join("| " + " | ".join(line) + " |\n" for line in lines)


def as_latex(table: Table, caption: str = "") -> str:
    """A table in LaTeX, for the package booktabs."""
    columns, rows = table
    body = " \\\\\n".join(" & ".join(map(_escaped, line)) for line in rows)
    return (
        "\\begin{table}\n\\centering\n"
        + (f"\\caption{{{_escaped(caption)}}}\n" if caption else "")
        + f"\\begin{{tabular}}{{l{'r' * (len(columns) - 1)}}}\n\\toprule\n"
        + " & ".join(map(_escaped, columns))
        + f" \\\\\n\\midrule\n{body} \\\\\n\\bottomrule\n\\end{{tabular}}\n\\end{{table}}\n"
    )


def _escaped(text):
    for sign in "&%#_":
        text = text.replace(sign, f"\\{sign}")
    return text


def _text(value, form, nothing="-"):
    return format(value, form) if np.isfinite(value) else nothing
