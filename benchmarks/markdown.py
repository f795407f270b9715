"""Tables as pages of text have them."""

import re
from collections.abc import Iterable, Sequence


def markdown(columns: Sequence[str], rows: Iterable[Sequence[object]]) -> str:
    """A table: text to the left, numbers to the right with two or three figures."""
    rows = [[shown(cell) for cell in row] for row in rows]
    text = [all(not re.match(r"-?\d", row[k]) for row in rows) for k in range(len(columns))]
    lines = [columns, [":--" if left else "--:" for left in text], *rows]
    return "".join("| " + " | ".join(line) + " |\n" for line in lines)


def shown(cell: object) -> str:
    """Text of one cell."""
    if not isinstance(cell, float):
        return str(cell or "")
    if cell == 0:
        return "0"
    return f"{cell:.0f}" if cell >= 100 else f"{cell:.3g}" if cell >= 1 else f"{cell:.2g}"
