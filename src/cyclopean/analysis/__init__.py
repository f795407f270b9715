"""What a setup can do: field of view, depth resolution, and what its numbers are worth."""

from .budget import Budget, error_budget, standard_tolerances
from .chromatic import chromatic_blur, colour_bias, filter_advice
from .common_volume import CommonField, CommonSection, CommonVolume, common_volume
from .field_of_view import FieldOfView, upright
from .model_error import ModelError, model_error
from .reliability import Reliability, reliability
from .sensitivity import Sensitivity, point_sensitivity
from .sensor_use import SensorUse, sensor_use
from .summary import FieldAtDepth, RigSummary, ViewPair, field_at, summarise
from .thermal import ThermalData, depth_per_kelvin, thermal_response
from .tolerance_calibration import CalibrationPlan, usual_plan
from .tolerances import Tolerance, ToleranceAnalysis, tolerance_analysis, usual_tolerances

__all__ = [
    # in short
    "FieldAtDepth",
    "RigSummary",
    "ViewPair",
    "field_at",
    "summarise",
    # field of view
    "CommonField",
    "CommonSection",
    "CommonVolume",
    "FieldOfView",
    "SensorUse",
    "common_volume",
    "sensor_use",
    "upright",
    # errors
    "Budget",
    "Reliability",
    "Sensitivity",
    "ThermalData",
    "chromatic_blur",
    "colour_bias",
    "depth_per_kelvin",
    "error_budget",
    "filter_advice",
    "point_sensitivity",
    "reliability",
    "standard_tolerances",
    "thermal_response",
    # tolerances, and what pinholes cost
    "CalibrationPlan",
    "ModelError",
    "Tolerance",
    "ToleranceAnalysis",
    "model_error",
    "tolerance_analysis",
    "usual_plan",
    "usual_tolerances",
]
