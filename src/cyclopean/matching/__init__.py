"""Dense matching: photographs and maps in, inverse depth out. No lens in sight."""

from ..geometry import Warps
from .agreement import agreement
from .dense import DepthMap, match

__all__ = ["DepthMap", "Warps", "agreement", "match"]
