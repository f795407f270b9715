"""The main job, step by step: a photograph and a setup become points with covariance."""

from .dense import Progress, as_photograph, plan_of, reconstruct
from .pairs import DISPARITY_NOISE, find_disparity, reconstruct_by_pairs
from .reconstruction import Reconstruction, assemble

__all__ = [
    "DISPARITY_NOISE",
    "Progress",
    "Reconstruction",
    "as_photograph",
    "assemble",
    "find_disparity",
    "plan_of",
    "reconstruct",
    "reconstruct_by_pairs",
]
