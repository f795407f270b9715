"""Points from the rays that see them, and how far they can be trusted."""

from .reprojection import Points, point_covariance, triangulate

__all__ = ["Points", "point_covariance", "triangulate"]
