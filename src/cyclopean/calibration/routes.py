"""The routes to a rig of views: ray sketches, virtual cameras by calibration, the physical model."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple, cast

import numpy as np

from ..errors import SetupError
from ..rigs import PinholeView, Rig, Setup, ViewLike
from ..rigs.virtual import boundary_pixel, sketched
from ..targets import DIRECT, Observations, Target
from .field_point import field_point_test
from .physical import Calibration, calibrate, default_free
from .prediction import views_of
from .virtual import calibrate_pairwise, calibrate_virtual
from .virtual_model import Intrinsics

FIELD_POINT = "ray sketch + field point"
PHYSICAL = "physical model"
ROUTES = (
    "ray sketch (middle)",
    "ray sketch (edge)",
    FIELD_POINT,
    "virtual cameras, intrinsics fixed",
    "virtual cameras, intrinsics tied",
    "virtual cameras, intrinsics free",
    "virtual cameras, each alone then pairs",
    PHYSICAL,
)


@dataclass(frozen=True, eq=False)
class FieldPoint:
    """One point at a known depth."""

    pixels: np.ndarray  # (V, 2) px, NaN where a view does not show it
    depth: float  # mm, z in the camera's frame


class Found(NamedTuple):
    """Views that a route ended with."""

    views: Sequence[ViewLike]
    converged: bool = True
    message: str = ""


class Evidence:
    """What one calibration of each route may see."""

    def __init__(self, observations: Observations, target: Target, setup: Setup, point: FieldPoint | None):
        self.observations, self.target, self.drawn, self.given_point = observations, target, setup, point

    @cached_property
    def setup(self) -> Setup:
        """The drawing, with the camera that photographs without the optic tell."""
        bare = self.observations.view == DIRECT
        if not bare.any():
            return self.drawn
        direct = np.unique(self.observations.photo[bare]).tolist()
        only = self.observations.select(bare).of_photos(direct)
        return calibrate(only, self.target, self.drawn, ("camera",)).setup

    @cached_property
    def through(self) -> Observations:
        """The photographs through the optic."""
        photos = np.unique(self.observations.photo[self.observations.view != DIRECT]).tolist()
        return self.observations.of_photos(photos)

    @cached_property
    def nominal(self) -> Rig:
        """The views of the drawing, traced."""
        rig = self.setup.rig()
        _ = rig.masks, [view.region.outline for view in rig]  # before the clock starts
        return rig

    @cached_property
    def physical(self) -> Calibration:
        """The physical model's calibration."""
        return calibrate(self.observations, self.target, self.drawn, default_free(self.drawn, self.observations))

    @cached_property
    def point(self) -> FieldPoint:
        """The field point."""
        if self.given_point is not None:
            return self.given_point
        found, seen = self.physical, self.physical.observations
        shown = np.unique(seen.photo[seen.view != DIRECT])
        points = np.asarray(self.target.points, dtype=float)
        depth = [(found.poses[k] @ points[seen.point[seen.photo == k]].mean(0))[2] for k in shown]
        chosen: FieldPoint | None = None
        for k in shown[np.argsort(np.abs(depth - np.median(depth)), kind="stable")]:
            with suppress(SetupError):  # of this photograph no two views show the same point
                number, pixels = nearest_to_axis(seen, self.setup, k)
                chosen = chosen or FieldPoint(pixels, float((found.poses[k] @ points[number])[2]))
                if np.isfinite(pixels).all():
                    return FieldPoint(pixels, float((found.poses[k] @ points[number])[2]))
        if chosen is None:
            raise SetupError("no photograph shows a point of the target in two views: there is no field point")
        return chosen

    def run(self, name: str) -> Found:
        """The views that a route ends with."""
        if name.startswith("ray sketch ("):
            return Found(_sketches(self.nominal, name[len("ray sketch (") : -1]))
        if name == FIELD_POINT:
            result = field_point_test(self.setup, self.point.pixels, self.point.depth)
            return Found(result.rig, result.converged, "" if result.converged else result.message)
        if name == PHYSICAL:
            views = views_of(self.physical.setup)
            solution = self.physical.solution
            message = "" if solution.converged else solution.message
            return Found([views[k] for k in range(len(views) - 1)], solution.converged, message)
        given = self.through, self.target, self.setup.camera, self.nominal
        kind = name.rsplit(" ", 1)[1]
        result = calibrate_pairwise(*given) if kind == "pairs" else calibrate_virtual(*given, cast(Intrinsics, kind))
        return Found(result.rig, result.converged, "" if result.converged else result.message)


def _sketches(rig, boundary):
    return Rig(
        tuple(
            PinholeView(*sketched(view, boundary_pixel(view, boundary)), view.region, view.mirrored, view.name)
            for view in rig
        )
    )


def nearest_to_axis(observations: Observations, setup: Setup, photo: int) -> tuple[int, np.ndarray]:
    """The point of a photograph that most views show and whose pixels lie evenly around the principal point.

    Returns
    -------
    int, (V, 2) array
        Number of the point, and its pixels, NaN where a view does not show it.
    """
    views = len(setup.optic.paths(setup.wavelength_nm))
    mine = observations.select((observations.photo == photo) & (observations.view >= 0))
    numbers, row = np.unique(mine.point, return_inverse=True)
    if not len(numbers):
        raise SetupError(f"{observations.photos[photo]} shows no point of the target through the optic")
    pixels = np.full((len(numbers), views, 2), np.nan)
    pixels[row, mine.view] = mine.pixels
    count = np.isfinite(pixels[..., 0]).sum(-1)
    if count.max() < 2:
        raise SetupError(f"{observations.photos[photo]} shows no point of the target in two views")
    full = np.flatnonzero(count == count.max())
    off = np.linalg.norm(np.nanmean(pixels[full], axis=1) - setup.camera.centre, axis=-1)
    best = full[np.argmin(off)]
    return int(numbers[best]), pixels[best]
