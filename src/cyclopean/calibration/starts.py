"""Start values: where the target stands in each photograph, from nominal views."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..errors import SetupError
from ..geometry import Pose, nearest_point, shortest_rotation
from ..rigs import ViewLike
from ..targets import DIRECT, Observations

_ENOUGH = 4  # points of one view that fix a pose


def start_poses(
    observations: Observations, points: np.ndarray, views: Sequence[ViewLike], direct: ViewLike
) -> list[list[Pose]]:
    """First guesses of rig_from_target for each photograph, each from the rays of one view alone.

    Parameters
    ----------
    observations : Observations
        N rows.
    points : (N, 3) array
        The target's point of each row, mm.
    views : sequence of views
        The sub-images, roughly known.
    direct : view
        The camera without its optic.

    Returns
    -------
    list of lists of Pose
        At most two for each photograph, as a plane seen from afar may lean either way; empty where no view of
        the photograph shows four points or more.
    """
    numbers = [int(view) for view in np.unique(observations.view)]
    if numbers and numbers[-1] >= len(views):
        raise SetupError(
            f"the observations number sub-images up to {numbers[-1]}, but the setup has {len(views)} views (0 to "
            f"{len(views) - 1}): is the number of facets right?"
        )
    by_number = {number: (direct if number == DIRECT else views[number]).unbounded() for number in numbers}
    rays = {number: view.rays(observations.pixels) for number, view in by_number.items()}
    guesses = []
    for photo in range(len(observations.photos)):
        rows = np.flatnonzero(observations.photo == photo)
        seen, counts = np.unique(observations.view[rows], return_counts=True)
        found: list[Pose] = []
        for number in seen[np.argsort(-counts)]:  # the view with most points first
            mine = rows[observations.view[rows] == number]
            found = poses_from_rays(rays[int(number)][mine], points[mine])
            if found:
                break
        guesses.append(found)
    return guesses


def poses_from_rays(rays, points: np.ndarray) -> list[Pose]:
    """Poses rig_from_target (at most two, best first) at which points (N, 3) lie on rays (N,) that nearly meet.

    The rays are taken as those of a pinhole at the point nearest to them all.
    """
    import cv2

    good = np.isfinite(rays.directions).all(-1)
    rays, points = rays[good], np.ascontiguousarray(points[good])
    if len(points) < _ENOUGH:
        return []
    centre = nearest_point(rays).points
    spread = np.linalg.norm(rays.origins - rays.origins.mean(0), axis=-1).max()
    if not np.isfinite(centre).all() or np.linalg.norm(centre - rays.origins.mean(0)) > 100 * (spread + 1.0):
        centre = rays.origins.mean(0)  # nearly parallel rays meet nowhere
    axis = rays.directions.mean(0)
    frame = shortest_rotation(axis, [0.0, 0.0, 1.0])
    local = rays.directions @ frame.T
    flat = np.ascontiguousarray(local[:, :2] / local[:, 2:])
    planar = np.ptp(points[:, 2]) == 0
    flags = cv2.SOLVEPNP_IPPE if planar else cv2.SOLVEPNP_SQPNP
    height = np.array([0.0, 0.0, points[0, 2] if planar else 0.0])
    try:
        count, turns, shifts, _ = cv2.solvePnPGeneric(points - height, flat, np.eye(3), None, flags=flags)
    except cv2.error:  # points on one line
        return []
    found = []
    for k in range(count):
        if not (np.isfinite(turns[k]).all() and np.isfinite(shifts[k]).all()):
            continue
        pose = Pose.from_rotation_vector(turns[k].ravel(), shifts[k].ravel())
        pose = Pose(pose.rotation, pose @ -height)
        found.append(Pose(frame.T, centre) @ pose)
    return found
