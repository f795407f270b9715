"""The thesis's experiments: set up, calibrate, place a target at known depths, recover depth by each approach."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ..lazy import lazy

if TYPE_CHECKING:
    from .experiment import ALL, TRUE, USUAL, Experiment, Material, Recovered, Row, Seen, Summary, perform
    from .setups import DrawingError, baseline, prism_of, standard_setup, virtual_centres
    from .simulated import board_for, calibration_poses, observe_boards, synthetic, target_poses
    from .tables import as_latex, as_markdown, cameras_table, long_table, summary_table, thesis_table

_HOMES = {
    "ALL": "experiment",
    "DrawingError": "setups",
    "Experiment": "experiment",
    "Material": "experiment",
    "Recovered": "experiment",
    "Row": "experiment",
    "Seen": "experiment",
    "Summary": "experiment",
    "TRUE": "experiment",
    "USUAL": "experiment",
    "as_latex": "tables",
    "as_markdown": "tables",
    "baseline": "setups",
    "board_for": "simulated",
    "calibration_poses": "simulated",
    "cameras_table": "tables",
    "long_table": "tables",
    "observe_boards": "simulated",
    "perform": "experiment",
    "prism_of": "setups",
    "standard_setup": "setups",
    "summary_table": "tables",
    "synthetic": "simulated",
    "target_poses": "simulated",
    "thesis_table": "tables",
    "virtual_centres": "setups",
}
__all__ = [  # in the order of an experiment
    # set up
    "DrawingError",
    "baseline",
    "prism_of",
    "standard_setup",
    "virtual_centres",
    # take photographs, or compute them
    "Material",
    "Seen",
    "board_for",
    "calibration_poses",
    "observe_boards",
    "synthetic",
    "target_poses",
    # recover depth
    "ALL",
    "Experiment",
    "Recovered",
    "Row",
    "Summary",
    "TRUE",
    "USUAL",
    "perform",
    # tell
    "as_latex",
    "as_markdown",
    "cameras_table",
    "long_table",
    "summary_table",
    "thesis_table",
]
__getattr__ = lazy(__name__, _HOMES)


def __dir__():
    return sorted(__all__)
