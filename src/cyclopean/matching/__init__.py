"""Dense matching: photographs and maps in, inverse depth out. No lens in sight."""

from cyclopean.matching.match import DepthMap, match
from cyclopean.matching.warps import Warps

__all__ = ["DepthMap", "Warps", "match"]
