"""The main job, step by step: a photograph and a setup become points with covariance."""

from .dense import Progress, as_photograph, check_memory, cross_check, reconstruct
from .reconstruction import Reconstruction, assemble

__all__ = ["Progress", "Reconstruction", "as_photograph", "assemble", "check_memory", "cross_check", "reconstruct"]
