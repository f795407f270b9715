"""A scene to begin with, made to measure for a setup, as the text of a scene file."""

from __future__ import annotations

import numpy as np

from ..calibration.depths import working_volume
from ..errors import SetupError
from ..rigs import Rig

_WALL, _BALL = 0.75, 0.3  # of the depth range, where the wall's middle and the ball's front stand
_SLANT_DEG = 20.0  # of the wall, at most
_DOT_PX = 6.0  # size of a speckle in the photograph
_BORDER = 1.15  # of the field, what the wall covers
_TEXT = """\
# A scene for `cyclopean simulate`. Lengths in mm, angles in degrees, in the camera's frame: x right, y down,
# z forward, the pinhole at the origin. Each object is a plane, box, sphere, cylinder, mesh, heightmap or board.

[light]
ambient = 0.7                  # even light from all sides; white matte paint in light 1 has the value 1
background = 0.0               # where there is nothing

[[light.lamp]]
direction = [0.5, 0.7, 1.0]    # where the light goes; or position_mm = [...]
strength = 0.3
shadows = true

[[object]]
name = "wall"
kind = "plane"
size_mm = [{width}, {height}]
centre_mm = [{wall_x}, {wall_y}, {wall}]
rotation_deg = [0.0, {slant}, 0.0]     # a rotation vector, about the centre
texture = "speckle"            # or "noise", "checker", a picture file; or grey = 0.5, or color = [0.8, 0.2, 0.1]
texture_size_mm = {wall_dot}

[[object]]
name = "ball"
kind = "sphere"
radius_mm = {radius}
centre_mm = [{ball_x}, {ball_y}, {ball}]
texture = "speckle"
texture_size_mm = {ball_dot}
"""


def starter_scene(rig: Rig, depths: tuple[float, float]) -> str:
    """The text of a scene file: a speckled wall, slanted, that fills the photograph, and a ball before it.

    Parameters
    ----------
    rig : Rig
        The views.
    depths : (near, far) mm
        Between these the scene stands.
    """
    near, far = depths
    wall, (low, high) = near + _WALL * (far - near), _seen(rig, near + _WALL * (far - near))
    width, height = _BORDER * (high - low)
    slant = min(_SLANT_DEG, np.degrees(np.arcsin(min(1.0, 0.2 * (far - near) / (width / 2)))))
    front = near + _BALL * (far - near)
    middle, size = _common(rig, front)
    radius = min(0.3 * min(size), 0.3 * (far - near))
    focal = rig[0].camera.focal[0]
    wall_x, wall_y = (low + high) / 2
    numbers = {
        "width": width / np.cos(np.deg2rad(slant)),
        "height": height,
        "wall_x": wall_x,
        "wall_y": wall_y,
        "wall": wall,
        "slant": slant,
        "wall_dot": _DOT_PX * wall / focal,
        "radius": radius,
        "ball_x": middle[0],
        "ball_y": middle[1],
        "ball": front + radius,
        "ball_dot": _DOT_PX * front / focal,
    }
    # three digits, and neither 5e-14 nor -0.0
    return _TEXT.format(**{name: float(f"{round(value, 4):.3g}") + 0.0 for name, value in numbers.items()})


def _seen(rig, depth):
    """Lowest and highest x, y (2,) mm of what the views see at a depth."""
    points = [view.rays(line).at_depth(depth)[:, :2] for view in rig for line in view.region.outline]
    found = np.concatenate(points)
    if not np.isfinite(found).any():
        raise SetupError(f"no view sees anything at {depth:.4g} mm: give other depths (--depth NEAR..FAR)")
    return np.nanmin(found, axis=0), np.nanmax(found, axis=0)


def _common(rig, depth):
    """Middle and size (2,) mm of what two views share at a depth; of what one sees where there is no second."""
    if len(rig) > 1:
        volume = working_volume(rig, [depth], 12)
        points = volume.points[volume.common][:, :2]
        low, high = points.min(0), points.max(0)
    else:
        low, high = _seen(rig, depth)
    return (low + high) / 2, high - low
