"""Points from the rays that see them, and how far they can be trusted."""

from .canonical import canonical_stereo
from .nearest import midpoint, nearest_to_rays
from .optimal import nearest_pair, optimal
from .points import Points
from .reprojection import point_covariance, triangulate
from .sensitivity import PointResponse, point_response

__all__ = [
    "PointResponse",
    "Points",
    "canonical_stereo",
    "midpoint",
    "nearest_pair",
    "nearest_to_rays",
    "optimal",
    "point_covariance",
    "point_response",
    "triangulate",
]
