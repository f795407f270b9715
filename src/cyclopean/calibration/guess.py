"""A first setup from photographs alone: no drawing, only the number of facets and a guess of the glass."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Literal

import numpy as np

from ..cameras import Camera
from ..errors import CyclopeanError, SetupError
from ..geometry import Pose
from ..optics import Prism
from ..rigs import Setup
from ..targets import DIRECT, Observations, Target
from .physical import Calibration, calibrate
from .starts import poses_from_rays

_DISTANCES = (20.0, 60.0, 150.0, 350.0)  # mm, from lens to prism: what people build
_THICKNESS = 10.0  # mm
_LOOSE = {"optic.distance": 200.0, "optic.apex": np.deg2rad(5.0), "optic.tilt_z": np.deg2rad(10.0)}


def guess_prism(
    observations: Observations,
    target: Target,
    camera: Camera,
    facets: int,
    glass: str | float = "N-BK7",
    *,
    thickness: float = _THICKNESS,
    progress: Callable[[str, int, int], None] | None = None,
) -> tuple[Setup, Observations]:
    """A prism that roughly explains the observations, for `calibrate` to start from.

    The target seems to stand somewhere else in each view. How those apparent poses are turned against each other
    gives the deviation of light and so the angle of the facets; which way, their azimuths. The distance is tried
    from a few millimetres to half a metre, with the facets to either side, and the best of all is kept.

    Parameters
    ----------
    observations : Observations
        Views numbered around the prism, in either sense.
    target : Target
        The known object.
    camera : Camera
        Known at least roughly.
    facets : int
        How many the prism has.
    glass : str or float
        Its glass, or index.
    thickness : float
        From the flat face to the apex, mm; photographs say little about it.
    progress : callable (what, done, total), optional
        Told about each try.

    Returns
    -------
    Setup, Observations
        The setup, and the observations with views numbered as its facets are.

    Raises
    ------
    SetupError
        When no prism of this kind explains the photographs.
    """
    used = observations.select(observations.view != DIRECT)
    views = np.unique(used.view)
    if len(views) < 2 or views.max() >= facets:
        raise SetupError(
            f"a prism with {facets} facets gives views 0 to {facets - 1}, of which two must show the target; "
            f"the observations show it in {', '.join(map(str, views)) or 'none'}"
        )
    deviation, azimuths = apparent_deviation(used, target, camera, facets)
    sides: tuple[Literal["scene", "camera"], ...] = ("scene", "camera")
    tries = [(facing, distance) for facing in sides for distance in _DISTANCES]
    best: Calibration | None = None
    order = np.arange(facets)
    for done, (facing, distance) in enumerate(tries):
        if progress:
            progress("trying prisms", done, len(tries))
        turned, first = _numbering(azimuths, facets, facing)
        optic = Prism(facets, 10.0, glass, distance, thickness, facing=facing, azimuth_deg=float(np.degrees(first)))
        found = _try(renumbered(used, turned), target, Setup(camera, optic), deviation)
        if found is not None and (best is None or found.solution.sigma0 < best.solution.sigma0):
            best, order = found, turned
    if progress:
        progress("trying prisms", len(tries), len(tries))
    if best is None:
        raise SetupError(
            f"no prism with {facets} facets of {glass} explains these photographs: check the number of facets, the "
            "glass and the board, or draw a nominal setup file"
        )
    return best.setup, renumbered(observations, order)


def apparent_deviation(
    observations: Observations, target: Target, camera: Camera, facets: int
) -> tuple[float, np.ndarray]:
    """Deviation (rad) of light through each facet, and the azimuths (V,) rad in the picture towards each view.

    Every view's target pose, as if the camera looked straight at it, is the true pose turned by that view's
    deviation; over the facets of a pyramid those turns cancel.
    """
    rays = camera.rays(observations.pixels)
    points = np.asarray(target.points, dtype=float)[observations.point]
    turns: list[list[np.ndarray]] = [[] for _ in range(facets)]
    for photo in range(len(observations.photos)):
        poses = {}
        for view in range(facets):
            rows = (observations.photo == photo) & (observations.view == view)
            found = poses_from_rays(rays[rows], points[rows]) if np.count_nonzero(rows) >= 6 else []
            if found:
                poses[view] = found
        if len(poses) == facets:
            axes = _agreeing_axes(poses, facets)
            for view in range(facets):
                turns[view].append(axes[view])
    if not turns[0]:
        raise SetupError(
            "no photograph shows the target in all views, which a start without a drawing needs: "
            "photograph the board in the middle, where all views see it, or give a nominal setup file"
        )
    axes = np.array([np.median(rows, axis=0) for rows in turns])  # (V, 3), a rotation vector each
    # a turn by delta about (sin p, -cos p, 0) belongs to the facet at azimuth p of the picture
    return float(np.median(np.linalg.norm(axes[:, :2], axis=-1))), np.arctan2(axes[:, 0], -axes[:, 1])


def _agreeing_axes(poses, facets):
    """Rotation vectors (V, 3) of the views of one photograph against their mean.

    A plane may lean either way: of the two poses of each view those are taken that differ least from each other.
    """
    from scipy.spatial.transform import Rotation

    choices = [[start, *(_nearest(poses[view], start) for view in range(1, facets))] for start in poses[0]]
    best = min(choices, key=lambda chosen: sum(_angle(pose, chosen[0]) for pose in chosen))
    apparent = Rotation.from_matrix([pose.rotation for pose in best])
    return (apparent.mean() * apparent.inv()).as_rotvec()  # true = turn after apparent


def _nearest(poses, start):
    return min(poses, key=lambda pose: _angle(pose, start))


def _angle(first: Pose, second: Pose) -> float:
    return float(np.arccos(np.clip((np.trace(first.rotation.T @ second.rotation) - 1) / 2, -1, 1)))


def _numbering(azimuths, facets, facing):
    """Which facet each view is (V,), and the azimuth of facet 0 in the prism's own frame."""
    own = azimuths if facing == "scene" else np.pi - azimuths  # turned about y, azimuths run the other way
    steps = 2 * np.pi * np.arange(facets) / facets
    rising = np.abs(np.mean(np.exp(1j * (own - steps)))) >= np.abs(np.mean(np.exp(1j * (own + steps))))
    order = np.arange(facets) if rising else -np.arange(facets) % facets
    first = np.angle(np.mean(np.exp(1j * (own - steps[order]))))
    return order, first


def renumbered(observations: Observations, order: np.ndarray) -> Observations:
    """The observations with view k called `order[k]`; direct photographs stay."""
    view = observations.view
    return replace(observations, view=np.where(view == DIRECT, DIRECT, order[np.maximum(view, 0)]))


def _apex_for(deviation, setup):
    """Facet angle (deg) at which the prism turns light along its axis by this much."""
    from scipy.optimize import brentq

    index = setup.optic.parameters(setup.wavelength_nm)[-1]

    def turn(angle):
        if setup.optic.facing == "scene":
            return np.arcsin(index * np.sin(angle)) - angle
        return np.arcsin(index * np.sin(angle - np.arcsin(np.sin(angle) / index)))

    steepest = 0.95 * np.arcsin(1 / index)
    return np.degrees(brentq(lambda angle: turn(angle) - deviation, 0.0, steepest))


def _try(observations, target, setup, deviation):
    """A calibration from one guess of distance and facing, or None where it leads nowhere."""
    try:
        optic = replace(setup.optic, apex_deg=_apex_for(deviation, setup))
        return calibrate(
            observations, target, replace(setup, optic=optic), ("optic.distance", "optic.apex", "optic.tilt_z"),
            tolerances=_LOOSE, iterations=25,
        )  # fmt: skip
    except (CyclopeanError, ValueError):  # no such prism: totally reflecting, or the views are not in its picture
        return None
