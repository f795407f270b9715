"""Pictures: the photograph with its sub-images, depth, point clouds, and the report that holds them."""

from .pictures import cloud_picture, depth_picture, outlined_picture, overview_picture
from .report import write_report

__all__ = ["cloud_picture", "depth_picture", "outlined_picture", "overview_picture", "write_report"]
