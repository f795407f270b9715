"""The light that comes back from where rays meet a scene."""

from __future__ import annotations

import numpy as np

from ..geometry import launch
from .scene import Lamp, Scene


class Shading:
    """A scene ready to be asked how bright it is."""

    def __init__(self, scene: Scene):
        self.scene, self.triangles = scene, scene.triangles
        self.first = np.searchsorted(self.triangles.surface, np.arange(len(scene.surfaces)))  # triangle of each surface
        self.channels = scene.channels

    def values(self, origins: np.ndarray, directions: np.ndarray, hits: np.ndarray, out: np.ndarray) -> np.ndarray:
        """Light (N, channels) that travels back along rays (N, 3) which first meet triangles `hits` (N,); fills `out`.

        A matte surface sends its reflectance times the ambient light and the light of the lamps that it sees
        (Lambert); a luminous one its paint. What meets nothing shows the background.
        """
        from . import kernels

        light = self._light(origins, directions, hits)
        for number, rows in self._by_surface(hits):
            if number < 0:
                out[rows] = self.scene.background
                continue
            surface = self.scene.surfaces[number]
            places = np.empty((len(rows), surface.places.shape[1]))
            own = surface.vertices, surface.faces, surface.places
            launch(kernels.find_places, len(rows), rows, origins, directions, hits, self.first[number], *own, places)
            shown = surface.paint.reflectance(places)
            if not surface.luminous:
                shown = shown * (light[rows, None] if isinstance(light, np.ndarray) else light)
            out[rows] = shown
        return out

    def _by_surface(self, hits):
        """Number of each surface that was met, -1 for none, with the rays (M,) that met it."""
        numbers = np.where(hits >= 0, self.triangles.surface[hits], np.int32(-1))
        if len(self.scene.surfaces) < 2**15:
            numbers = numbers.astype(np.int16)  # sorted by counting
        lowest, highest = int(numbers.min()), int(numbers.max())
        if lowest == highest:
            return [(lowest, np.arange(len(hits)))]
        order = np.argsort(numbers, kind="stable")
        starts = np.flatnonzero(np.diff(numbers[order])) + 1
        groups = np.split(order, starts)
        return [(int(numbers[rows[0]]), rows) for rows in groups]

    def _light(self, origins, directions, hits):
        """Light on what rays meet, (N,) or one number for all of them."""
        if not self.scene.lamps:
            return self.scene.ambient
        light = np.full(len(hits), self.scene.ambient)
        for lamp in self.scene.lamps:
            light += lamp.strength * self._lamp(lamp, origins, directions, hits)
        return light

    def _lamp(self, lamp: Lamp, origins, directions, hits):
        from . import kernels

        solid = self.triangles
        parallel = lamp.direction is not None
        place, distance = np.array(lamp.position if lamp.direction is None else lamp.direction), 1.0
        if parallel:
            place = -place / np.linalg.norm(place)
        else:
            distance = lamp.distance or max(float(np.linalg.norm(place - solid.middle)), solid.resolution)
        gain = np.empty(len(hits))
        near = np.empty((2, len(hits), 3), dtype=np.float32)
        lift = 4 * solid.resolution
        geometry = solid.vertices, solid.faces
        launch(
            kernels.lamp_light, len(hits), origins, directions, hits, *geometry,
            place, parallel, distance, lift, solid.middle, gain, near[0], near[1],
        )  # fmt: skip
        if lamp.shadows:
            reach = np.full(len(hits), np.inf if parallel else 1.0, dtype=np.float32)
            gain[solid.blocked(near[0], near[1], reach)] = 0.0
        return gain
