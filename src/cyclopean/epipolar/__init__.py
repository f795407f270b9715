"""Epipolar geometry: the true curve of a pixel in every other view, and the lines of virtual cameras beside it."""

from ..rigs.two_views import essential_matrix, fundamental_matrix, redistorted, undistorted
from .curves import EpipolarCurves, epipolar_curves
from .departure import LineDeparture, line_departure, line_departures, line_distances, pinholes, sample_pixels
from .distances import distance_to_curves
from .fitting import fitted_fundamental, sampson_distance
from .lines import distance_to_line, epipolar_line, epipoles, straight_line

__all__ = [
    "EpipolarCurves",
    "LineDeparture",
    "distance_to_curves",
    "distance_to_line",
    "epipolar_curves",
    "epipolar_line",
    "epipoles",
    "essential_matrix",
    "fitted_fundamental",
    "fundamental_matrix",
    "line_departure",
    "line_departures",
    "line_distances",
    "pinholes",
    "redistorted",
    "sample_pixels",
    "sampson_distance",
    "straight_line",
    "undistorted",
]
