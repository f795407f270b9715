"""Views that are ordinary cameras: what calibration without a model of the optic, or ray sketching, ends with."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from ..cameras import Camera
from ..errors import OpticError
from ..geometry import Pose, Rays, as_pixels, as_points
from ..optics import Reason
from .derivatives import PixelDerivatives, RayDerivatives, lens_derivatives
from .regions import Region
from .rig import Rig
from .view import ViewLike
from .virtual import VirtualCamera, distorted

POSE_PARAMETERS = ("turn_x", "turn_y", "turn_z", "move_x", "move_y", "move_z")  # rad, mm


@dataclass(frozen=True, eq=False)
class PinholeView:
    """A sub-image taken as the picture of an ordinary camera of its own.

    It does all that a `View` does, but all its rays start at one centre. Its derivatives `to_camera` are those to its
    own lens; `to_optic` has the columns of `POSE_PARAMETERS`: a small turn about the virtual camera's own axes, and a
    small move in them, that follow `camera_from_rig`. In a mirrored view x of the camera's own frame is flipped
    before it projects, so that its pose is a rotation all the same.
    """

    camera: Camera  # its own lens, for pixels of the whole photograph
    camera_from_rig: Pose
    region: Region
    mirrored: bool = False
    name: str = ""
    shot: int = 0
    channel: int | None = None
    clip: bool = field(default=True, repr=False)  # False only in what `unbounded` returns

    def __post_init__(self):
        height, width = self.region.traced.shape
        if (width, height) != self.camera.size:
            raise OpticError(
                f"{self.name or 'the view'}: the region is that of a photograph of {width}x{height} px, but the "
                f"camera takes {self.camera.size[0]}x{self.camera.size[1]}"
            )

    @classmethod
    def of(cls, virtual: VirtualCamera, view: ViewLike) -> PinholeView:
        """A virtual camera in the place of the view that it stands for."""
        return cls(
            virtual.camera, virtual.camera_from_rig, view.region, virtual.mirrored, view.name, view.shot, view.channel
        )

    @property
    def margin(self) -> float:
        """Pixels left out beside seams."""
        return self.region.margin

    @property
    def centre(self) -> np.ndarray:
        """Optical centre (3,) in the rig frame, mm."""
        return self.camera_from_rig.inverse.translation

    def rays(self, pixels: ArrayLike) -> Rays:
        """Rays (...,) from the centre through pixels (..., 2), in the rig frame; NaN outside the view's region."""
        pixels = as_pixels(pixels)
        directions = (self.camera.rays(pixels).directions * self._flip) @ self.camera_from_rig.rotation
        if self.clip:
            directions = np.where(self._belongs(pixels)[..., None], directions, np.nan)
        return Rays(np.where(np.isfinite(directions), self.centre, np.nan), directions)

    def project(self, points: ArrayLike) -> np.ndarray:
        """Pixels (..., 2) of points (..., 3) mm in the rig frame; NaN behind the camera and outside the region."""
        pixels = self.camera.project((self.camera_from_rig @ as_points(points)) * self._flip)
        return np.where(self._belongs(pixels)[..., None], pixels, np.nan) if self.clip else pixels

    def pixel_derivatives(self, points: ArrayLike) -> PixelDerivatives:
        """Pixels of points (..., 3) with their derivatives to point, lens and pose (`POSE_PARAMETERS`)."""
        points = as_points(points)
        local = self.camera_from_rig @ points
        _, to_local, to_lens = pinhole_derivatives(self.camera, local, self.mirrored)
        pixels = self.project(points)
        lost = np.where(np.isfinite(pixels), 0.0, np.nan)[..., None]
        to_local, to_lens = to_local + lost, to_lens + lost
        to_pose = np.concatenate([np.cross(local[..., None, :], to_local), to_local], -1)  # a turn w moves x by w x x
        return PixelDerivatives(pixels, to_local @ self.camera_from_rig.rotation, to_lens, to_pose)

    def ray_derivatives(self, pixels: ArrayLike) -> RayDerivatives:
        """Rays of pixels (..., 2) with their derivatives to pixel, lens and pose (`POSE_PARAMETERS`)."""
        pixels = as_pixels(pixels)
        rays, back = self.rays(pixels), self.camera_from_rig.rotation.T
        coordinates = self.camera.normalise(pixels)
        jacobian, to_lens = lens_derivatives(self.camera, coordinates)
        inverse = np.linalg.inv(jacobian)
        own = rays.directions @ self.camera_from_rig.rotation.T
        scale = own[..., 2, None, None]  # one over the length of (x, y, 1)
        to_coordinates = scale * (np.diag(self._flip)[:, :2] - own[..., None] * (own * self._flip)[..., None, :2])
        to_coordinates = back @ to_coordinates
        lost = np.where(np.isfinite(own[..., 0]), 0.0, np.nan)[..., None, None]
        to_turn = -back @ np.cross(np.eye(3), own[..., None, :]).swapaxes(-1, -2)  # -(turn x own)
        still = np.zeros((*own.shape[:-1], 3, 9))
        move = np.broadcast_to(-back, (*own.shape[:-1], 3, 3))
        return RayDerivatives(
            rays,
            np.concatenate([still[..., :2], to_coordinates @ inverse], -2) + lost,
            np.concatenate([still, -to_coordinates @ inverse @ to_lens], -2) + lost,
            np.concatenate(
                [np.concatenate([still[..., :3], move], -1), np.concatenate([to_turn, still[..., :3]], -1)], -2
            )
            + lost,
        )

    def unbounded(self) -> PinholeView:
        """The same view with a picture that has no end."""
        return self._unbounded

    @cached_property
    def _unbounded(self) -> PinholeView:
        return replace(self, clip=False)

    def explain_pixels(self, pixels: ArrayLike) -> np.ndarray:
        """The `Reason` (integer array (...,)) why each pixel (..., 2) has no ray in this view; 0 where it has one."""
        pixels = as_pixels(pixels)
        reasons = np.where(self.camera.contains(pixels), int(Reason.WRONG_FACET), int(Reason.OUTSIDE_IMAGE))
        reasons = np.where(self._belongs(pixels) | (not self.clip), int(Reason.SEEN), reasons)
        reasons = np.where(np.isnan(self.camera.normalise(pixels)).any(-1), int(Reason.NO_SOLUTION), reasons)
        return np.where(np.isfinite(pixels).all(-1), reasons, int(Reason.NOT_A_NUMBER))

    def explain_points(self, points: ArrayLike) -> np.ndarray:
        """The `Reason` (integer array (...,)) why each point (..., 3) has no pixel in this view; 0 where it has one."""
        points = as_points(points)
        pixels = self.unbounded().project(points)
        behind = (self.camera_from_rig @ points)[..., 2] <= 0
        unsolved = np.where(behind, int(Reason.BEHIND), int(Reason.NO_SOLUTION))
        reasons = np.where(np.isfinite(pixels).all(-1), self.explain_pixels(pixels), unsolved)
        return np.where(np.isfinite(points).all(-1), reasons, int(Reason.NOT_A_NUMBER))

    @property
    def _flip(self):
        return np.array([-1.0 if self.mirrored else 1.0, 1.0, 1.0])

    def _belongs(self, pixels):
        """True (...,) where pixels (..., 2) fall on the traced pixels of the region."""
        return self._traced.contains(pixels)

    @cached_property
    def _traced(self) -> Region:
        return self.region.with_margin(0.0)


def pinhole_derivatives(
    camera: Camera, points: np.ndarray, mirrored: bool = False
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Pixels of points in the camera's own frame, without a guard against folding: smooth for a solver.

    Parameters
    ----------
    camera : Camera
        The lens.
    points : (..., 3) array
        Points in the virtual camera's own frame, mm.
    mirrored : bool
        Whether x is flipped before projecting.

    Returns
    -------
    pixels : (..., 2) array
    to_point : (..., 2, 3) array
        px/mm.
    to_lens : (..., 2, 9) array
        In the order of `CAMERA_PARAMETERS`.
    """
    flip = np.array([-1.0 if mirrored else 1.0, 1.0, 1.0])
    flat = points[..., :2] / points[..., 2:] * flip[:2]
    jacobian, to_lens = lens_derivatives(camera, flat)
    depth = points[..., 2, None, None]
    to_point = np.concatenate([jacobian, -(jacobian @ flat[..., None])], -1) / depth * flip
    return distorted(flat, camera), to_point, to_lens


def pinhole_rig(cameras: Sequence[VirtualCamera], views: Sequence[ViewLike]) -> Rig:
    """A rig of virtual cameras that stand for views, such as `[fit(view, depths) for view in rig]` for `rig`."""
    if len(cameras) != len(views):
        raise OpticError(f"{len(views)} views want as many virtual cameras, got {len(cameras)}")
    return Rig(tuple(PinholeView.of(virtual, view) for virtual, view in zip(cameras, views, strict=True)))
