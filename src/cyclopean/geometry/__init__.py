"""Poses, rays, polygons and maps: geometry that knows no optics."""

from .arrays import as_pixels, as_points, as_rgb, check_inside, white_level
from .polygons import clip_by_half_plane, polygon_area
from .poses import (
    Pose,
    nearest_rotation,
    rigid_motion,
    rotation_from_vector,
    rotation_vector,
    rotation_vector_jacobian,
    shortest_rotation,
)
from .rays import NearestPoint, Rays, nearest_point, shortest_segment
from .threads import launch
from .warps import Warps

__all__ = [
    "NearestPoint",
    "Pose",
    "Rays",
    "Warps",
    "as_pixels",
    "as_points",
    "as_rgb",
    "check_inside",
    "clip_by_half_plane",
    "launch",
    "nearest_point",
    "nearest_rotation",
    "polygon_area",
    "rigid_motion",
    "rotation_from_vector",
    "rotation_vector",
    "rotation_vector_jacobian",
    "shortest_rotation",
    "shortest_segment",
    "white_level",
]
