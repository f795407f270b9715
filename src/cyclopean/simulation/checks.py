"""What a photograph cannot be simulated of, said before any time is spent."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ..errors import OpticError, SetupError
from ..geometry import rotation_from_vector
from ..optics import Path
from ..rigs import Setup
from ..rigs.regions import pixel_grid
from .lens import pupil
from .scene import Scene

_GRID = 64  # rays along the picture's longer side that the checks look along


def check_optic(setup: Setup, paths: tuple[Path, ...]) -> None:
    """An OpticError where the lens stands in the glass, or no light reaches it."""
    if _in_glass(setup, paths):
        diameter = 2 * pupil(setup)[0]
        what = f"its lens, {diameter:.3g} mm wide around the pinhole" if diameter else "its pinhole"
        raise OpticError(
            f"the camera stands in the glass: {what} (0, 0, 0) lies in the {setup.optic.kind}; make the optic's "
            "distance larger, or its tilt or shift smaller"
        )


def check_scene(setup: Setup, scene: Scene, paths: tuple[Path, ...]) -> None:
    """A SetupError where no surface stands in front of the optic, or one reaches into it.

    Parameters
    ----------
    setup : Setup
        The camera.
    scene : Scene
        What stands in front of it.
    paths : tuple of Path
        The ways of light.
    """
    camera_rays = setup.camera.rays(_grid(setup.camera.size))
    lit, ahead = False, False
    for path in paths:
        rays = path.trace(camera_rays)
        good = np.isfinite(rays.directions).all(-1)
        if path.blockers:
            good &= ~path.obstructed(camera_rays)
        if not good.any():
            continue
        lit = True
        if path.interfaces:
            _check_free(scene, path, camera_rays[good])
        ahead = ahead or bool(_in_front(path, rays[good], scene.triangles.vertices).any())
    if not lit:
        raise OpticError("no light reaches the camera: every ray of the picture misses the optic or is lost in it")
    if not ahead:
        raise SetupError(
            f"the whole scene lies behind the camera or its optic: its z goes from {scene.box[0, 2]:.6g} to "
            f"{scene.box[1, 2]:.6g} mm, and the camera at z = 0 looks along +z; are lengths in mm?"
        )


def _in_front(path, rays, points):
    """True (N,) for points (N, 3) on the side to which rays leave a path."""
    front = np.ones(len(points), dtype=bool)
    if path.interfaces:
        last = path.interfaces[-1]
        side = np.sign(np.median(rays.directions @ last.normal))
        front = side * (points @ last.normal - last.offset) > 0
    if all(surface.act == "refract" for surface in path.interfaces):
        front &= points[:, 2] > 0  # no mirror turns light backwards
    return front


def _check_free(scene, path, rays):
    """A SetupError where a surface of the scene stands between the camera and the optic's last surface."""
    triangles, start = scene.triangles, rays.origins
    for count in range(1, len(path.interfaces) + 1):
        end = replace(path, interfaces=path.interfaces[:count], blockers=()).trace(rays).origins
        near, step = (start - triangles.middle).astype(np.float32), (end - start).astype(np.float32)
        blocked = triangles.blocked(near, step, np.full(len(near), 1 - 1e-5, dtype=np.float32))
        if blocked.any():
            met = triangles.first(near[blocked], step[blocked])
            name = scene.surfaces[triangles.surface[np.bincount(np.maximum(met, 0)).argmax()]].called
            raise SetupError(
                f"{name} reaches into the optic: it stands between the camera and the optic's last surface, in the "
                f"way of {100 * blocked.mean():.3g} % of the light of {path.name or 'the view'}; move it away from "
                f"the camera, beyond z = {end[..., 2].max():.5g} mm"
            )
        start = end


def _in_glass(setup, paths):
    """Whether a point of the lens's pupil lies in the glass of a prism or a plate."""
    optic = setup.optic
    if not hasattr(optic, "thickness"):
        return False
    depth = np.array([0.0, 0.0, optic.thickness / 2])
    within = np.array([*optic.shift, optic.distance]) + rotation_from_vector(np.deg2rad(optic.tilt_deg)) @ depth
    radius, _ = pupil(setup)
    angles = np.linspace(0, 2 * np.pi, 64, endpoint=False)
    points = radius * np.stack([np.cos(angles), np.sin(angles), np.zeros(64)], -1)
    points = np.concatenate([np.zeros((1, 3)), points])
    inside = np.ones(len(points), dtype=bool)
    for surface in (surface for path in paths for surface in path.interfaces):
        side = within @ surface.normal - surface.offset
        inside &= (points @ surface.normal - surface.offset) * side > 0
        if surface.disc is not None:
            arm = np.cross(points - surface.disc.centre, surface.disc.axis)
            inside &= np.linalg.norm(arm, axis=-1) < surface.disc.radius
    return bool(inside.any())


def _grid(size):
    """Pixels (N, 2) spread over a picture."""
    step = max(1, max(size) // _GRID)
    return np.ascontiguousarray(pixel_grid(size)[step // 2 :: step, step // 2 :: step].reshape(-1, 2))
