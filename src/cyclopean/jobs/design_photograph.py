"""A small photograph that a designed setup would take of a simple scene."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from ..design.requirements import Candidate
    from ..simulation import Scene

_WIDE = 360  # px, longer side of the photograph
_SAMPLES = 4  # rays a pixel
_SQUARES = 8.0  # of the board, across the common field


def photograph_of(candidate: Candidate, depths: tuple[float, float]) -> np.ndarray:
    """Grey levels (H, W) uint8 of a wall at the far depth, a tilted board at middle depth and a speckled block near.

    A picture of the same field with larger pixels; light that misses the optic is black.
    """
    from ..simulation import render
    from ..simulation.sensor import Sensor

    camera = candidate.setup.camera
    setup = replace(candidate.setup, camera=camera.with_larger_pixels(max(max(camera.size) / _WIDE, 1.0)))
    light = render(setup, _scene(candidate, depths), samples=_SAMPLES)
    return Sensor().expose(light)


def _scene(candidate: Candidate, depths: tuple[float, float]) -> Scene:
    """Wall, board and block, as large as the common field asks for."""
    from ..geometry import Pose
    from ..simulation import Lamp, Scene
    from ..simulation.paints import Checker, Noise, Speckle
    from ..simulation.shapes import box, plane

    near, far = depths
    camera, figures = candidate.setup.camera, candidate.figures
    reach = 3 * far * max(camera.size) / min(camera.focal)
    middle = float(figures.depths[figures.middle])
    field = float(np.sqrt(max(figures.area_two[figures.middle], 1.0)))
    side = 0.3 * float(np.sqrt(max(figures.area_two[0], 1.0)))
    turn = Pose.from_rotation_vector([0.0, np.deg2rad(30), 0.15]).rotation
    board = plane(0.6 * field, 0.6 * field).painted(
        Checker(field / _SQUARES, 0.05, 0.9), Pose(turn, np.array([0.12 * field, 0.05 * field, middle]))
    )
    leaning = Pose.from_rotation_vector(np.deg2rad([-35.0, 30.0, 15.0])).rotation
    block = box(side, side, side).painted(
        Speckle(side / 8, 0.15, 0.7, dimensions=3), Pose(leaning, np.array([-0.5 * side, 0.3 * side, near + side]))
    )
    wall = plane(reach, reach).painted(Noise(0.12 * field, 0.2, 0.6), Pose(np.eye(3), np.array([0.0, 0.0, far])))
    lamp = Lamp(direction=(0.5, 0.7, 1.0), strength=0.6)
    return Scene((wall, board, block), ambient=0.5, lamps=(lamp,))
