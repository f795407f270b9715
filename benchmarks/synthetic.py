"""Photographs of planes and balls through a small prism, ray by ray, with the depth of every pixel known exactly.

Textures lie on a surface like a slide projected along z, so that a steep flank shows none finer than a flat one does;
sizes are px at the depth that a texture is painted for. Four rays a pixel mix what a pixel mixes. The tests of hard
cases photograph these, and `reliability.py` does.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property

import cv2
import numpy as np
from scipy.ndimage import gaussian_filter, map_coordinates, spline_filter

from cyclopean import Camera, Prism, Rig, Setup
from cyclopean.geometry import Rays
from cyclopean.rigs.setup import D_LINE_NM

FOCAL, DEPTHS = 600.0, (500.0, 1200.0)  # px; mm: 10 to 25 px of disparity between neighbours

TEXELS, BLUR = 900, 1.2  # the texture repeats after so many texels, of which so many blur it
_NOISE = gaussian_filter(np.random.default_rng(7).normal(size=(TEXELS, TEXELS)), BLUR, mode="wrap")
_TEXTURE = spline_filter((_NOISE - _NOISE.mean()) / _NOISE.std(), mode="grid-wrap")  # cubic B-spline coefficients

Paint = Callable[[np.ndarray, np.ndarray], np.ndarray]  # places x, y (N,) mm -> grey levels (N,) or (N, 3)


def prism_rig(facets: int, *, azimuth_deg: float = 0.0, wavelength_nm: float = D_LINE_NM, **changes) -> Rig:
    """Views of 320 x 240 px through a prism; two facets at azimuth 0 lie side by side."""
    given = {"apex_deg": 12.0, "glass": 1.5168, "distance": 100.0} | changes
    prism = Prism(facets, azimuth_deg=azimuth_deg, **given)
    return Setup(Camera((320, 240), FOCAL), prism, wavelength_nm, depths=DEPTHS).rig()


def texture(depth: float, contrast: float = 32.0, at: float = 0.0, grain: float = 0.8) -> Paint:
    """Random texture whose standard deviation is `contrast` grey levels: white noise blurred by `grain` px.

    `at` picks a part of it.
    """
    pitch = grain / BLUR * depth / FOCAL  # mm, of a texel

    def paint(x, y):
        place = np.stack([y, x]) / pitch + TEXELS / 2 + at
        return 128 + contrast * map_coordinates(_TEXTURE, place, order=3, mode="grid-wrap", prefilter=False)

    return paint


def colourful(depth: float, contrast: float = 32.0) -> Paint:
    """Random texture with three independent channels."""
    channels = [texture(depth, contrast, at) for at in (0.0, 211.3, 407.9)]
    return lambda x, y: np.stack([channel(x, y) for channel in channels], axis=-1)


def fading(depth: float, width: float) -> Paint:
    """Random texture whose contrast grows from 3 to 40 grey levels across a width (mm) in x."""
    base = texture(depth, 1.0)

    def paint(x, y):
        return 128 + (base(x, y) - 128) * 3 * (40 / 3) ** np.clip(x / width + 0.5, 0, 1)

    return paint


def plain(level: float = 128.0, ramp: tuple[float, float] = (0.0, 0.0)) -> Paint:
    """No texture; shading may rise by `ramp` grey levels a mm along x and y."""
    return lambda x, y: level + ramp[0] * x + ramp[1] * y


def stripes(depth: float, contrast: float = 45.0) -> Paint:
    """Random lines along x: nothing changes along them."""
    base = texture(depth, contrast)
    return lambda x, y: base(np.zeros_like(x), y)


def lattice(depth: float, period: float, turn_deg: float = 0.0, contrast: float = 30.0) -> Paint:
    """A square lattice of soft dots with a period in px."""
    wave, turn = 2 * np.pi / (period * depth / FOCAL), np.deg2rad(turn_deg)

    def paint(x, y):
        along, across = np.cos(turn) * x + np.sin(turn) * y, np.cos(turn) * y - np.sin(turn) * x
        return 128 + contrast * (np.cos(wave * along) + np.cos(wave * across))

    return paint


def patched(around: Paint, patch: Paint, box: tuple[float, float, float, float]) -> Paint:
    """A patch inside a box (x from, x to, y from, y to) mm, something else around it."""

    def paint(x, y):
        inside = (x > box[0]) & (x < box[1]) & (y > box[2]) & (y < box[3])
        outer, inner = around(x, y), patch(x, y)
        return np.where(inside[:, None] if outer.ndim == 2 else inside, inner, outer)

    return paint


@dataclass(frozen=True, eq=False)
class Plane:
    """The plane z = depth + slope x within a box (x from, x to, y from, y to)."""

    depth: float  # mm
    paint: Paint
    slope: float = 0.0
    box: tuple[float, float, float, float] = (-np.inf, np.inf, -np.inf, np.inf)  # mm

    def hit(self, rays: Rays) -> np.ndarray:
        """Points (N, 3) where rays meet it; NaN where they miss."""
        normal = np.array([-self.slope, 0.0, 1.0])
        points = rays.at((self.depth - rays.origins @ normal) / (rays.directions @ normal))
        x, y = points[:, 0], points[:, 1]
        inside = (x >= self.box[0]) & (x <= self.box[1]) & (y >= self.box[2]) & (y <= self.box[3])
        return np.where(inside[:, None], points, np.nan)


@dataclass(frozen=True, eq=False)
class Ball:
    """The near side of a ball."""

    centre: tuple[float, float, float]  # mm
    radius: float  # mm
    paint: Paint

    def hit(self, rays: Rays) -> np.ndarray:
        """Points (N, 3) where rays meet it first; NaN where they miss."""
        arm = rays.origins - np.array(self.centre)
        middle = np.sum(arm * rays.directions, axis=-1)
        under = middle**2 - np.sum(arm**2, axis=-1) + self.radius**2
        return rays.at(-middle - np.sqrt(np.where(under >= 0, under, np.nan)))


def first_hit(surfaces: Sequence[Plane | Ball], rays: Rays) -> tuple[np.ndarray, np.ndarray]:
    """Points (N, 3) that rays (N,) meet first, NaN where none, and the surface's number (N,), -1 where none."""
    points = np.stack([surface.hit(rays) for surface in surfaces])
    depth = np.where(np.isfinite(points[..., 2]), points[..., 2], np.inf)
    nearest = depth.argmin(axis=0)
    which = np.where(np.isfinite(depth.min(axis=0)), nearest, -1)
    return points[nearest, np.arange(points.shape[1])], which


@dataclass(frozen=True, eq=False)
class Shot:
    """A photograph before the camera's electronics, with its truth."""

    rig: Rig
    surfaces: tuple[Plane | Ball, ...]
    light: np.ndarray  # (H, W) or (H, W, 3) grey levels, 0 to 255, not rounded
    points: np.ndarray  # (H, W, 3) mm, where the central ray of each pixel ends; NaN none
    surface: np.ndarray  # (H, W) number of the surface there; -1 none

    @property
    def depth(self) -> np.ndarray:
        """(H, W) mm."""
        return self.points[..., 2]

    @cached_property
    def views(self) -> tuple[np.ndarray, np.ndarray]:
        """Which views have the point of each pixel in their masks, and which of them see it: (V, H, W) bool each."""
        framed, seen = np.zeros((2, len(self.rig), *self.depth.shape), dtype=bool)
        for own, view in enumerate(self.rig):
            rows, columns = np.nonzero(view.region.mask & np.isfinite(self.depth))
            points = self.points[rows, columns]
            for k, other in enumerate(self.rig):
                pixels = other.project(points)
                there, _ = first_hit(self.surfaces, other.rays(pixels))
                same = np.linalg.norm(there - points, axis=-1) < 1e-6 * points[:, 2]
                framed[k, rows, columns] = other.region.contains(pixels) | (k == own)
                seen[k, rows, columns] = (framed[k, rows, columns] & same) | (k == own)
        return framed, seen

    @cached_property
    def common(self) -> np.ndarray:
        """(H, W) bool: pixels of a mask whose point another view sees too."""
        return self.views[1].sum(axis=0) > 1

    @cached_property
    def hidden(self) -> np.ndarray:
        """(H, W) bool: pixels whose point something hides from every other view that has it in its mask."""
        framed, seen = (views.sum(axis=0) for views in self.views)
        return (framed > 1) & (seen == 1)

    def inside(self, box: tuple[float, float, float, float], margin: float = 0.0) -> np.ndarray:
        """(H, W) bool: points within a box (x from, x to, y from, y to) mm made smaller by a margin (mm)."""
        x, y = self.points[..., 0], self.points[..., 1]
        inside = (x > box[0] + margin) & (x < box[1] - margin)
        return inside & (y > box[2] + margin) & (y < box[3] - margin)


def take(rig: Rig, *surfaces: Plane | Ball, blend: float = 0.0, colours: Sequence[Rig] = (), per_side: int = 2) -> Shot:
    """Photograph surfaces by per_side x per_side rays a pixel.

    An open aperture mixes both sides of a seam within a band `blend` px wide: the share of a view falls linearly
    across it. With `colours` the channels are traced by rigs of their own, as glass that disperses does.
    """
    light = [_exposed(each, surfaces, blend, per_side) for each in colours or [rig]]
    if colours:
        light = [np.stack([one[..., c] if one.ndim == 3 else one for c, one in enumerate(light)], axis=-1)]
    points, surface = np.full((*light[0].shape[:2], 3), np.nan), np.full(light[0].shape[:2], -1)
    for view in rig:
        rows, columns = np.nonzero(view.region.traced)
        points[rows, columns], surface[rows, columns] = first_hit(surfaces, view.rays(np.stack([columns, rows], -1)))
    return Shot(rig, surfaces, light[0], points, surface)


def quantised(light: np.ndarray, noise: float = 0.0, seed: int = 1) -> np.ndarray:
    """Eight bits of a picture, after noise of some grey levels (standard deviation)."""
    if noise:
        light = light + np.random.default_rng(seed).normal(0, noise, light.shape)
    return np.clip(np.rint(light), 0, 255).astype(np.uint8)


def seam_distance(rig: Rig) -> np.ndarray:
    """(V, H, W) px from the centre of each pixel to the border of each view, positive inside it."""
    found = []
    for view in rig:
        inside, outside = (
            cv2.distanceTransform(part.astype(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
            for part in (view.region.traced, ~view.region.traced)
        )
        found.append(np.where(view.region.traced, inside - 0.5, 0.5 - outside))
    return np.stack(found)


def _exposed(rig, surfaces, blend, per_side):
    """Mean light (H, W) or (H, W, 3) of the rays of each pixel; 0 where there is none."""
    offsets = (np.arange(per_side) + 0.5) / per_side - 0.5
    offsets = np.stack(np.meshgrid(offsets, offsets), -1).reshape(-1, 2)
    shares = np.clip(0.5 + seam_distance(rig) / blend, 0, 1) if blend else np.ones((len(rig), *rig.size[::-1]))
    total, weight = None, np.zeros(rig.size[::-1])
    for view, share, distance in zip(rig, shares, seam_distance(rig), strict=True):
        rows, columns = np.nonzero((share > 0) & (distance > -max(blend, 1.5)))
        pixels = np.stack([columns, rows], -1)[:, None] + offsets
        rays = (view.unbounded() if blend else view).rays(pixels.reshape(-1, 2))
        points, which = first_hit(surfaces, rays)
        levels = _painted(surfaces, points, which).reshape(*pixels.shape[:2], -1)
        arrived = np.isfinite(rays.directions[:, 0]).reshape(pixels.shape[:2]).sum(axis=1) * share[rows, columns]
        if total is None:
            total = np.zeros((*weight.shape, levels.shape[-1]))
        total[rows, columns] += levels.sum(axis=1) * share[rows, columns, None]
        weight[rows, columns] += arrived
    mean = total / np.maximum(weight, 1e-9)[..., None]
    return mean[..., 0] if mean.shape[-1] == 1 else mean


def _painted(surfaces, points, which):
    """Grey levels (N, C) of points on surfaces; 0 where there is none."""
    parts = [surface.paint(*points[which == k, :2].T) for k, surface in enumerate(surfaces)]
    parts = [part.reshape(len(part), -1) for part in parts]
    levels = np.zeros((len(points), max(part.shape[1] for part in parts)))
    for k, part in enumerate(parts):
        levels[which == k] = part
    return levels
