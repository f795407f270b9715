"""Media, surfaces, paths, and the optics that are made of them: prisms, mirrors, plates."""

from .indices import refractive_indices
from .media import Medium, media, medium
from .mirrors import Mirror, Mirrors
from .paths import Path
from .plate import Plate
from .prism import Prism
from .surfaces import Disc, Interface, Reason, reflect, refract

__all__ = [
    "Disc",
    "Interface",
    "Medium",
    "Mirror",
    "Mirrors",
    "Path",
    "Plate",
    "Prism",
    "Reason",
    "media",
    "medium",
    "reflect",
    "refract",
    "refractive_indices",
]
