"""Media, surfaces, paths, and the optics that are made of them: prisms, mirrors, plates."""

from .dimensions import ClearAperture, PrismDimensions, clear_aperture, prism_dimensions
from .indices import refractive_indices
from .media import Medium, media, medium
from .mirrors import Mirror, Mirrors
from .paths import Path
from .plate import Plate
from .prism import Prism
from .solid import PrismSolid, prism_solid
from .surfaces import Disc, Interface, Reason, reflect, refract

__all__ = [
    "ClearAperture",
    "Disc",
    "Interface",
    "Medium",
    "Mirror",
    "Mirrors",
    "Path",
    "Plate",
    "Prism",
    "PrismDimensions",
    "PrismSolid",
    "Reason",
    "clear_aperture",
    "media",
    "medium",
    "prism_dimensions",
    "prism_solid",
    "reflect",
    "refract",
    "refractive_indices",
]
