"""Sparse correspondences: the same point of the scene in several sub-images."""
