"""Where the photographs with known truth lie, and what took them; the tests look here too."""

import os
from pathlib import Path

from cyclopean import Setup

ROOT = Path(__file__).resolve().parents[1]


def data_folder(name: str) -> Path:
    """Find a folder of test photographs.

    Parameters
    ----------
    name : str
        `mitsuba` for rendered photographs with the true point of every pixel, `real` for real ones.

    Returns
    -------
    Path
        The folder of that name inside the one that the environment variable `CYCLOPEAN_DATA` names; if unset,
        inside `shared/data` beside the repository.

    Raises
    ------
    FileNotFoundError
        There is no such folder.
    """
    given = os.environ.get("CYCLOPEAN_DATA")
    folder = (Path(given) if given else ROOT.parent / "shared" / "data") / name
    if not folder.is_dir():
        raise FileNotFoundError(f"no folder {folder}; set CYCLOPEAN_DATA to the folder that holds {name}/")
    return folder


def renderer_setup(name: str) -> Setup:
    """The true setup of rendered photographs, from `mitsuba/rigs/NAME.json`."""
    from cyclopean.jobs.experiment_photographs import rendered_setup

    return rendered_setup(data_folder("mitsuba"), name)
