"""What every test may ask for."""

import os
from pathlib import Path

import pytest
from hypothesis import settings

from benchmarks.data import data_folder

# No deadline, since a kernel's first call compiles it; and the checks try the same examples at every run.
settings.register_profile("cyclopean", deadline=None, derandomize="CI" in os.environ)
settings.load_profile("cyclopean")


def folder_or_skip(name: str) -> Path:
    """Find a data folder; skip its tests where it is absent, unless someone pointed at a wrong place."""
    try:
        return data_folder(name)
    except FileNotFoundError as missing:
        if "CYCLOPEAN_DATA" in os.environ:
            raise
        pytest.skip(str(missing))


@pytest.fixture(scope="session")
def mitsuba() -> Path:
    """The folder of rendered photographs, with the true point of every pixel."""
    return folder_or_skip("mitsuba")


@pytest.fixture(scope="session")
def real() -> Path:
    """The folder of real photographs."""
    return folder_or_skip("real")
