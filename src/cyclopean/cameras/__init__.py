"""The real camera: a pinhole with lens distortion."""

from .camera import Camera

__all__ = ["Camera"]
