"""Sparse correspondences: the same point of the scene in several sub-images."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ..lazy import lazy
from .matches import Counts, Matches

if TYPE_CHECKING:
    from .alignment import align
    from .features import SIGMAS, Features, find_features, match_features
    from .known import match_pointed, match_target
    from .points import match_points
    from .window_search import Picture, prepare
    from .windows import Limits, Located, locate

_LATER = {  # these wait for numba, OpenCV or scipy
    "SIGMAS": "features",
    "Features": "features",
    "Limits": "windows",
    "Located": "windows",
    "Picture": "window_search",
    "align": "alignment",
    "find_features": "features",
    "locate": "windows",
    "match_features": "features",
    "match_pointed": "known",
    "match_points": "points",
    "match_target": "known",
    "prepare": "window_search",
}
__all__ = [
    "SIGMAS",
    "Counts",
    "Features",
    "Limits",
    "Located",
    "Matches",
    "Picture",
    "align",
    "find_features",
    "locate",
    "match_features",
    "match_pointed",
    "match_points",
    "match_target",
    "prepare",
]
__getattr__ = lazy(__name__, _LATER)


def __dir__():
    return sorted(__all__)
