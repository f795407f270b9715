"""A rigid rig of ordinary cameras as a model for bundle adjustment."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np

from ..cameras import Camera
from ..cameras.camera import CAMERA_PARAMETERS
from ..geometry import Pose, rotation_vector, rotation_vector_jacobian
from ..rigs.pinhole import POSE_PARAMETERS, pinhole_derivatives

Intrinsics = Literal["free", "tied", "fixed"]


class Eye(NamedTuple):
    """One camera of a rig, virtual or real."""

    number: int  # of the view in the observations; DIRECT for the real camera
    name: str
    camera: Camera
    pose: Pose  # camera_from_root; the first eye is the root
    mirrored: bool


@dataclass(frozen=True, eq=False)
class RigModel:
    """Which numbers of which camera are free, and how pixels follow from them.

    The columns say where in the vector of free parameters each number stands; -1 where it is not free. The first
    eye's pose is never free.
    """

    eyes: tuple[Eye, ...]  # E
    lens_columns: np.ndarray  # (E, 9) int
    pose_columns: np.ndarray  # (E, 6) int
    names: tuple[str, ...]  # (S,)
    rows: tuple[np.ndarray, ...]  # rows of the observations that each eye has

    @classmethod
    def of(
        cls, eyes: Sequence[Eye], view: np.ndarray, intrinsics: Intrinsics, distortion: int, poses: bool = True
    ) -> RigModel:
        """The model for observations whose rows belong to the views `view` (N,)."""
        names: list[str] = []
        lens, pose = np.full((len(eyes), 9), -1), np.full((len(eyes), 6), -1)
        for e, eye in enumerate(eyes):
            virtual = eye.number >= 0
            for k, parameter in enumerate(CAMERA_PARAMETERS):
                if not virtual or (intrinsics == "fixed" and k < 4) or k >= 4 + distortion:
                    continue
                name = f"{'rig' if intrinsics == 'tied' and k < 4 else eye.name}.{parameter}"
                lens[e, k] = names.index(name) if name in names else len(names)
                names += [] if name in names else [name]
            if e and poses:
                pose[e] = len(names) + np.arange(6)
                names += [f"{eye.name}.{parameter}" for parameter in POSE_PARAMETERS]
        rows = tuple(np.flatnonzero(view == eye.number) for eye in eyes)
        return cls(tuple(eyes), lens, pose, tuple(names), rows)

    @property
    def start(self) -> np.ndarray:
        """Values (S,) of the free parameters in the eyes as they are."""
        shared = np.zeros(len(self.names))
        for eye, lens, pose in zip(self.eyes, self.lens_columns, self.pose_columns, strict=True):
            shared[lens[lens >= 0]] = eye.camera.lens[lens >= 0]
            if pose[0] >= 0:
                shared[pose] = [*rotation_vector(eye.pose.rotation), *eye.pose.translation]
        return shared

    @property
    def prior(self) -> tuple[np.ndarray, np.ndarray]:
        """Mean and sigma (S,) that only stop what no photograph determines from drifting away.

        Focal lengths and principal points may be off by half of the focal length and of the picture's width; a
        distortion term may move the picture's corner by as much as its distance from the middle.
        """
        sigma = np.full(len(self.names), np.inf)
        for eye, lens in zip(self.eyes, self.lens_columns, strict=True):
            camera = eye.camera
            corner = np.hypot(*camera.size) / 2 / max(camera.focal)
            own = [0.5 * f for f in camera.focal] + [0.5 * camera.size[0]] * 2
            own += [1 / corner**power for power in (2, 4, 1, 1, 6)]
            sigma[lens[lens >= 0]] = np.array(own)[lens >= 0]
        return self.start, sigma

    def eyes_at(self, shared: np.ndarray) -> tuple[Eye, ...]:
        """The eyes for values (S,) of the free parameters."""
        return tuple(
            eye._replace(camera=eye.camera.with_lens(values), pose=pose)
            for eye, values, pose in zip(self.eyes, *self._unpacked(shared), strict=True)
        )

    def _unpacked(self, shared):
        lenses, poses = [], []
        for eye, lens, pose in zip(self.eyes, self.lens_columns, self.pose_columns, strict=True):
            lenses.append(np.where(lens >= 0, np.append(shared, 0.0)[lens], eye.camera.lens))
            free = pose[0] >= 0
            poses.append(Pose.from_rotation_vector(*shared[pose].reshape(2, 3)) if free else eye.pose)
        return lenses, poses

    def predict(self, shared, points, jacobian):
        """Pixels of points (N, 3) in the root's frame, and derivatives; what `minimise` asks for."""
        pixels, to_point = np.full((len(points), 2), np.nan), np.full((len(points), 2, 3), np.nan)
        to_shared = np.zeros((len(points), 2, len(shared))) if jacobian else None
        both = np.arange(2)
        for e, (eye, lens, pose) in enumerate(zip(self.eyes, *self._unpacked(shared), strict=True)):
            rows = self.rows[e]
            if not lens[:2].min() > 0:
                continue  # a focal length below zero: no camera
            local = pose @ points[rows]
            local = np.where(local[:, 2:] > 0, local, np.nan)
            camera = eye.camera.with_lens(lens)
            pixels[rows], to_local, to_lens = pinhole_derivatives(camera, local, eye.mirrored)
            if to_shared is None:
                continue
            to_point[rows] = to_local @ pose.rotation
            free = self.lens_columns[e] >= 0
            to_shared[np.ix_(rows, both, self.lens_columns[e][free])] = to_lens[..., free]
            if self.pose_columns[e, 0] >= 0:
                to_shared[np.ix_(rows, both, self.pose_columns[e])] = self._to_pose(shared, e, local, pose, to_local)
        return pixels, to_shared, to_point if jacobian else None

    def _to_pose(self, shared, e, local, pose, to_local):
        """Derivatives (n, 2, 6) to a rotation vector and a translation."""
        turned = local - pose.translation
        to_turn = np.cross(turned[:, None, :], to_local) @ rotation_vector_jacobian(shared[self.pose_columns[e, :3]])
        return np.concatenate([to_turn, to_local], -1)
