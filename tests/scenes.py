"""Photographs of textured planes, computed by tracing each pixel's ray: small scenes with known depth."""

import numpy as np
from scipy.ndimage import gaussian_filter, map_coordinates

from cyclopean import Camera, Prism, Rig, Setup

TEXTURE = gaussian_filter(np.random.default_rng(7).normal(size=(900, 900)), 1.2)
TEXTURE = ((TEXTURE - TEXTURE.min()) / np.ptp(TEXTURE)).astype(float)


def small_setup(**changes) -> Setup:
    """A three-facet prism in front of a small camera."""
    given = {"facets": 3, "apex_deg": 12.0, "glass": 1.5168, "distance": 60.0, "azimuth_deg": 90.0} | changes
    return Setup(Camera((320, 240), 600), Prism(**given), depths=(500.0, 1200.0))


def photograph_plane(rig: Rig, depth: float, slope: float = 0.0, pitch: float = 0.9) -> tuple[np.ndarray, np.ndarray]:
    """A grey photograph (H, W) uint8 of the textured plane z = depth + slope x, and its true depth (H, W) mm.

    `pitch` is the size of a texture element, mm.
    """
    width, height = rig.size
    picture, truth = np.zeros((height, width)), np.full((height, width), np.nan)
    for view in rig:
        rows, columns = np.nonzero(view.region.traced)
        rays = view.rays(np.stack([columns, rows], -1))
        normal = np.array([-slope, 0.0, 1.0])
        distance = (depth - rays.origins @ normal) / (rays.directions @ normal)
        points = rays.at(distance)
        place = points[:, 1::-1] / pitch + np.array(TEXTURE.shape) / 2
        picture[rows, columns] = map_coordinates(TEXTURE, place.T, order=3, mode="mirror")
        truth[rows, columns] = points[:, 2]
    return (20 + 215 * np.clip(picture, 0, 1)).round().astype(np.uint8), truth
