"""What words on the command line stand for."""

from __future__ import annotations

from typing import Annotated

from cyclopts import Parameter


def whole_number(_, tokens) -> int:
    """The whole number that a word stands for; 2.5 is refused, not rounded."""
    text = tokens[0].value
    try:
        return int(text)
    except ValueError:
        raise ValueError(f"it must be a whole number, got {text!r}") from None


Whole = Annotated[int, Parameter(converter=whole_number)]
