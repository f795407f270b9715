"""How many threads a compiled kernel is worth."""

from __future__ import annotations

from collections.abc import Callable

_ITEMS_PER_THREAD = 16_384  # below this, waiting for a second thread costs more than it brings


def launch(kernel: Callable, count: int, *arguments) -> None:
    """Call a parallel kernel on `count` items with no more threads than they are worth.

    On a busy machine a thread that has little to do can hold all others up for milliseconds.
    """
    import numba

    allowed = numba.get_num_threads()
    wanted = min(allowed, 1 + count // _ITEMS_PER_THREAD)
    if wanted == allowed:
        kernel(*arguments)
        return
    numba.set_num_threads(wanted)
    try:
        kernel(*arguments)
    finally:
        numba.set_num_threads(allowed)
