"""Command ``experiment``: the thesis's experiments, on computed corners or on rendered photographs."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import cyclopts
from cyclopts import Parameter

from ..jobs.experiment_request import Options
from .app import OutFolder, Whole, app

experiment = cyclopts.App(
    name="experiment",
    help="The thesis's experiments: set up, calibrate, place a target at known depths, recover depth by each approach.",
)
app.command(experiment)


Chosen = Annotated[Options, Parameter(name="*")]
_USUAL = Options()


@experiment.command
def biprism(*, options: Chosen = _USUAL, output: OutFolder = Path("experiment")) -> None:
    """Two views by a biprism: the thesis's table 4.1.

    Parameters
    ----------
    output
        Folder for table.csv, table.md, table.tex, the pictures and report.html.
    """
    _run("biprism", 2, options, output)


@experiment.command
def trinocular(*, options: Chosen = _USUAL, output: OutFolder = Path("experiment")) -> None:
    """Three views by a prism of three facets: the thesis's table 5.1.

    Parameters
    ----------
    output
        Folder for table.csv, table.md, table.tex, the pictures and report.html.
    """
    _run("trinocular", 3, options, output)


@experiment.command
def multiocular(
    *, facets: Whole | None = None, options: Chosen = _USUAL, output: OutFolder = Path("experiment")
) -> None:
    """Many views by a prism of n facets: the thesis's table 6.1.

    Parameters
    ----------
    facets
        How many facets the prism has, a whole number from 2: 4 without it, or those of the setup file.
    output
        Folder for table.csv, table.md, table.tex, the pictures and report.html.
    """
    _run("multiocular", facets, options, output)


def _run(name, facets, options, output):
    from ..jobs.experiments import run_experiment

    run_experiment(name, facets, options, output)
