"""Dense matching: photographs and maps in, inverse depth out. No lens in sight."""

from ..geometry import Warps
from .dense import DepthMap, checked, match
from .pairwise import PairMatcher, sgbm
from .plans import Plan, plan

__all__ = ["DepthMap", "PairMatcher", "Plan", "Warps", "checked", "match", "plan", "sgbm"]
