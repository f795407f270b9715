"""The scene of the closed loop: a wavy surface and a ball, speckle and smooth random grey."""

from __future__ import annotations

from dataclasses import dataclass, replace

import cv2
import numpy as np

from cyclopean import Camera, Setup
from cyclopean.experiments import standard_setup
from cyclopean.geometry import Pose
from cyclopean.simulation import Scene, Truth, render, trace_truth
from cyclopean.simulation.paints import Noise, Speckle
from cyclopean.simulation.shapes import heightmap, sphere

CAMERA = Camera((1280, 960), 2400.0, pixel_pitch=0.0055)
SAMPLES = 16  # rays a pixel
DEPTHS = (750.0, 1250.0)  # mm
GRAIN, PATCH = 4.0, 64.0  # px in the middle of the depths: dots and bumps; sides of the patches of one texture
STANDS = Pose.from_rotation_vector([0.12, -0.2, 0.3], (0.0, 0.0, float(np.mean(DEPTHS))))  # the surface
EDGE, JUMP = 8, 0.015  # px from an edge in depth; what an edge is, as a share of depth


@dataclass(frozen=True)
class Patches:
    """Speckle and smooth random grey by turns, in squares like a chessboard's."""

    pixel: float  # mm, as large as a pixel in the middle of the depths
    seed: int
    dimensions: int = 2
    channels: int = 1

    def grey(self, places: np.ndarray) -> np.ndarray:
        """(N,) bool: smooth random grey at places (N, 2)."""
        return np.floor(places / (PATCH * self.pixel)).sum(-1) % 2 == 1

    def reflectance(self, places: np.ndarray) -> np.ndarray:
        """(N, 1) at places (N, 2)."""
        speckle, noise = (kind(GRAIN * self.pixel, seed=self.seed) for kind in (Speckle, Noise))
        return np.where(self.grey(places)[:, None], noise.reflectance(places), speckle.reflectance(places))


@dataclass(frozen=True, eq=False)
class Shot:
    """The light of a photograph of the scene, and what is true of it."""

    setup: Setup
    light: np.ndarray  # (H, W)
    truth: Truth
    counted: np.ndarray  # (H, W) bool, pixels whose point another view sees, away from edges in depth
    grey: np.ndarray  # (H, W) bool, pixels on smooth random grey, the others on speckle


def real_setup(facets: int, camera: Camera = CAMERA) -> Setup:
    """A prism of the thesis with an open aperture."""
    return replace(standard_setup(facets, camera=camera), f_number=8.0, focus_distance=1000.0, depths=DEPTHS)


def shoot(setup: Setup, repeat: int, samples: int = SAMPLES) -> Shot:
    """Photograph a tilted, wavy surface with a ball in front of it; each repeat has a texture and rays of its own."""
    middle = float(np.mean(DEPTHS))
    across = 1.6 * middle * max(setup.camera.size) / setup.camera.focal[0]  # mm
    x, y = np.meshgrid(*2 * [np.linspace(-0.5, 0.5, 200)])
    heights = 12 * np.sin(9 * x + 1) * np.cos(7 * y) + 6 * np.sin(16 * x - 11 * y)
    paint = Patches(middle / setup.camera.focal[0], repeat)
    surface = heightmap(heights, across, across).painted(paint, STANDS, name="surface")
    ball = sphere(25.0).painted(
        Speckle(0.87 * GRAIN * paint.pixel, seed=repeat, dimensions=3),
        Pose(np.eye(3), np.array([0.0, 0.0, 0.87 * middle])),
        name="ball",
    )
    scene = Scene((surface, ball))
    truth = trace_truth(setup, scene)
    places = STANDS.inverse @ np.nan_to_num(truth.points)
    grey = paint.grey(places[..., :2]) & (truth.surface == 0)
    light = render(setup, scene, samples=samples, seed=1000 * repeat + 999)
    return Shot(setup, light, truth, _counted(truth), grey)


def _counted(truth):
    """(H, W) bool: pixels whose point another view sees, away from edges in depth."""
    depth = np.nan_to_num(truth.depth, nan=0.0).astype(np.float32)
    square = np.ones((2 * EDGE + 1, 2 * EDGE + 1), np.uint8)
    even = cv2.dilate(depth, square) - cv2.erode(depth, square) < JUMP * depth
    # facets part neighbouring pixels whose points lie far apart: that is no edge of the scene
    for k in range(len(truth.rig)):
        own = truth.facet == k
        low, high = np.where(own, depth, np.float32(1e9)), np.where(own, depth, np.float32(0))
        even |= own & (cv2.dilate(high, square) - cv2.erode(low, square) < JUMP * depth)
    seen = np.zeros(depth.shape, bool)
    for k, view in enumerate(truth.rig):
        rows, columns = np.nonzero((truth.facet != k) & even & np.isfinite(truth.depth))
        pixels = view.unbounded().project(truth.points[rows, columns])
        inside = view.region.contains(pixels)
        rows, columns, rays = rows[inside], columns[inside], view.rays(pixels[inside])
        apart = truth.triangles.meet(rays).points - truth.points[rows, columns]
        seen[rows, columns] |= np.linalg.norm(apart, axis=-1) < 1e-3  # mm: far above any rounding
    return seen & even
