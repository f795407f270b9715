"""Fusion: the depth maps of all views become one cloud of points, or one mesh, in which each surface is there once."""

from .cloud import Cloud, fuse
from .mesh import Mesh, build_mesh

__all__ = ["Cloud", "Mesh", "build_mesh", "fuse"]
