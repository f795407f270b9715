"""Keep the figures of a benchmark, and print them as a table."""

import json
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path

from rich.console import Console
from rich.table import Table

FOLDER = Path(__file__).parent / "results"


def write(name: str, figures: Mapping[str, float]) -> Path:
    """Merge figures into `results/NAME.json`; a figure measured again replaces the old one.

    Parameters
    ----------
    name : str
        The benchmark, without a suffix.
    figures : mapping of str to float
        Each key names a figure and ends in its unit, such as `trace_batoid_mrays_per_s`.
    """
    path = FOLDER / f"{name}.json"
    kept = json.loads(path.read_text()) if path.exists() else {}
    kept.update({key: float(f"{value:.4g}") for key, value in figures.items()})
    FOLDER.mkdir(exist_ok=True)
    path.write_text(json.dumps(kept, indent=2, sort_keys=True) + "\n")
    return path


def table(title: str, columns: Sequence[str], rows: Iterable[Sequence[object]]) -> None:
    """Print rows under a title: the first column to the left, the others to the right."""
    grid = Table(title=title, title_justify="left", title_style="bold")
    for number, column in enumerate(columns):
        grid.add_column(column, justify="right" if number else "left", no_wrap=True)
    for row in rows:
        grid.add_row(*(shown(value) for value in row))
    Console(width=None if Console().is_terminal else 120).print(grid)


def shown(value: object) -> str:
    """Text of one cell: three figures for a number, a dash for NaN or nothing."""
    if value is None or value != value:
        return "-"
    return f"{value:.3g}" if isinstance(value, float) else str(value)
