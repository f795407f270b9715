"""Calibration: from photographs of a known target to a setup that can be trusted."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ..lazy import lazy
from .checks import warnings_of
from .depths import DepthErrors, depth_errors
from .field_point import DepthLaw, FieldPointTest, field_point_test, two_depths
from .guess import guess_prism, renumbered
from .guidance import Guidance, guide
from .physical import Calibration, calibrate, recalibrate, without_outliers
from .reflected_board import ReflectedBoard, board_from_reflections
from .reflections import mirror_from_poses, mirrors_from_observations
from .simple import SimpleCalibration, crossing_lines, simple_calibration
from .trust import Direction, undetermined
from .tsai import TsaiCalibration, tsai  # the functions, from here on, and no longer the modules of these names
from .validation import Validation, hold_out
from .zhang import CameraCalibration, zhang

if TYPE_CHECKING:
    from .comparison import Comparison, compare
    from .photometric import BoardPose, Refinement, align, refine
    from .virtual import VirtualCalibration, calibrate_pairwise, calibrate_virtual

_LATER = {  # these wait for OpenCV and numba
    "BoardPose": "photometric",
    "Comparison": "comparison",
    "Refinement": "photometric",
    "VirtualCalibration": "virtual",
    "align": "photometric",
    "calibrate_pairwise": "virtual",
    "calibrate_virtual": "virtual",
    "compare": "comparison",
    "refine": "photometric",
}
__all__ = [
    # the setup
    "Calibration",
    "calibrate",
    "guess_prism",
    "recalibrate",
    "renumbered",
    "without_outliers",
    # how far to trust it
    "DepthErrors",
    "Direction",
    "Guidance",
    "Validation",
    "depth_errors",
    "guide",
    "hold_out",
    "undetermined",
    "warnings_of",
    # the real camera
    "CameraCalibration",
    "SimpleCalibration",
    "TsaiCalibration",
    "crossing_lines",
    "simple_calibration",
    "tsai",
    "zhang",
    # virtual cameras, and the routes side by side
    "Comparison",
    "DepthLaw",
    "FieldPointTest",
    "VirtualCalibration",
    "calibrate_pairwise",
    "calibrate_virtual",
    "compare",
    "field_point_test",
    "two_depths",
    # mirrors
    "ReflectedBoard",
    "board_from_reflections",
    "mirror_from_poses",
    "mirrors_from_observations",
    # from the picture itself
    "BoardPose",
    "Refinement",
    "align",
    "refine",
]
__getattr__ = lazy(__name__, _LATER)


def __dir__():
    return sorted(__all__)
