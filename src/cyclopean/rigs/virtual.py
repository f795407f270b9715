"""Virtual cameras: the pinhole that best stands for a view, and how far it departs from it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from ..cameras import Camera
from ..errors import OpticError
from ..geometry import (
    Pose,
    Rays,
    as_points,
    nearest_point,
    nearest_rotation,
    rotation_from_vector,
    shortest_rotation,
    shortest_segment,
)
from .view import ViewLike


@dataclass(frozen=True, eq=False)
class VirtualCamera:
    """A pinhole camera that stands for a view, a summary: light through glass has no single centre.

    `departure_rms` and `departure_max` say by how many px it misses the view's true pixels between the depths
    `depths`. In a mirrored view x of the virtual camera's own frame is flipped before it projects.
    """

    camera: Camera  # focal length, principal point, distortion, px
    camera_from_rig: Pose
    mirrored: bool
    method: str  # how it was found
    depths: tuple[float, float]  # mm, between which the departure was measured
    departure_rms: float  # px
    departure_max: float  # px

    @property
    def centre(self) -> np.ndarray:
        """Optical centre (3,) in the rig frame, mm."""
        return self.camera_from_rig.inverse.translation

    @property
    def axis(self) -> np.ndarray:
        """Direction (3,) of the optical axis in the rig frame."""
        return self.camera_from_rig.rotation[2]

    def project(self, points: ArrayLike) -> np.ndarray:
        """Pixels (..., 2) of points (..., 3) mm in the rig frame; NaN behind the virtual camera."""
        local = self.camera_from_rig @ as_points(points)
        return self.camera.project(local * [-1, 1, 1] if self.mirrored else local)

    def rays(self, pixels: ArrayLike) -> Rays:
        """Rays of pixels (..., 2) in the rig frame."""
        directions = self.camera.rays(pixels).directions
        if self.mirrored:
            directions = directions * [-1, 1, 1]
        directions = directions @ self.camera_from_rig.rotation
        return Rays(np.broadcast_to(self.centre, directions.shape), directions)


def sketch(
    view: ViewLike, depths: tuple[float, float], boundary: Literal["middle", "edge"] | ArrayLike = "middle"
) -> VirtualCamera:
    """Virtual camera by ray sketching: from two traced rays, without any calibration.

    The ray of the camera's optical axis and one boundary ray are traced to the scene and extended back; the
    middle of the shortest segment between them is the optical centre, the extended axis ray the optical axis,
    and the angle between the two gives the focal length.

    Parameters
    ----------
    view : View
        The view to stand for.
    depths : (2,) mm
        Nearest and farthest depth at which the departure from the true view is measured.
    boundary : "middle", "edge" or a pixel (2,)
        Which boundary ray: where the line from the principal point through the middle of the sub-image leaves
        it, the farthest corner of the sub-image, or any pixel. The choice matters; it is not unique.

    References
    ----------
    Xiao, thesis (National University of Singapore), sections 4.1.3, 5.1.2 and 6.1.2.
    """
    camera, pose = sketched(view, boundary_pixel(view, boundary))
    name = boundary if isinstance(boundary, str) else "pixel"
    return _qualified(view, camera, pose, f"ray sketch, {name} ray", depths)


def sketched(view: ViewLike, rim: np.ndarray) -> tuple[Camera, Pose]:
    """What `sketch` finds with the ray of a boundary pixel `rim` (2,): lens, and pose camera_from_rig."""
    centre_pixel = np.asarray(view.camera.centre)
    axis_ray, boundary_ray = (view.unbounded().rays(pixel) for pixel in (centre_pixel, rim))
    if not (np.isfinite(axis_ray.directions).all() and np.isfinite(boundary_ray.directions).all()):
        raise OpticError(f"ray sketching of {view.name}: the axis ray or the boundary ray is lost in the optic")
    centre = np.mean(shortest_segment(axis_ray, boundary_ray), axis=0)
    if not np.isfinite(centre).all():
        raise OpticError(f"ray sketching of {view.name}: the axis ray and the boundary ray are parallel")
    angle = np.arccos(np.clip(axis_ray.directions @ boundary_ray.directions, -1, 1))
    offset = np.linalg.norm(view.camera.normalise(rim))  # tangent of the angle before the optic
    focal = float(offset * view.camera.focal[0] / np.tan(angle))
    focals = (focal, focal * view.camera.focal[1] / view.camera.focal[0])
    rotation = _roll_like(view, axis_ray, centre_pixel)
    camera = Camera(view.camera.size, focals, view.camera.centre, view.camera.distortion)
    return camera, Pose(rotation, -rotation @ centre)


def fit(view: ViewLike, depths: tuple[float, float], distortion: bool = True, samples: int = 12) -> VirtualCamera:
    """Virtual camera that fits the view's true rays best, in px, between two depths.

    Parameters
    ----------
    view : View
        The view to stand for.
    depths : (2,) mm
        Nearest and farthest depth; samples lie evenly in inverse depth between them.
    distortion : bool
        Also fit k1, k2, p1, p2; without it only pose, focal lengths and principal point.
    samples : int
        About the number of sample pixels across the sub-image.

    Returns
    -------
    VirtualCamera
        Pose, lens and departure. Some of its parameters trade off against each other (a wedge stretches the
        picture much as a shifted principal point does); the picture as a whole is what fits.
    """
    from scipy.optimize import least_squares

    points, pixels = _samples(view, depths, samples)
    start = _start(view)
    count = 14 if distortion else 10

    def unpack(x):
        rotation = rotation_from_vector(x[:3]) @ start.rotation
        focal = np.array(view.camera.focal) * np.exp(x[6:8])
        numbers = (*x[10:14], 0.0) if distortion else (0.0,) * 5
        camera = Camera(view.camera.size, tuple(focal), tuple(view.camera.centre + 100 * x[8:10]), tuple(numbers))
        return camera, Pose(rotation, -rotation @ (start.inverse.translation + x[3:6]))

    def residuals(x):
        camera, pose = unpack(x)
        local = pose @ points * ([-1, 1, 1] if view.mirrored else [1, 1, 1])
        flat = local[:, :2] / local[:, 2:]
        return (distorted(flat, camera) - pixels).ravel()

    solution = least_squares(residuals, np.zeros(count), method="lm", x_scale="jac")
    camera, pose = unpack(solution.x)
    return _qualified(view, camera, pose, "best fit with distortion" if distortion else "best fit", depths)


def _start(view):
    """A pose camera_from_rig near the best: by ray sketching or, where the optical axis misses the optic, beside it."""
    try:
        return sketched(view, boundary_pixel(view, "middle"))[1]
    except OpticError:
        pixels = view.region.centre + np.array([[0.0, 0.0], [9.0, 0.0], [-9.0, 0.0], [0.0, 9.0], [0.0, -9.0]])
        rays = view.unbounded().rays(pixels)
        centre = nearest_point(rays).points
        # turn the camera's own frame so that its rays through these pixels fall onto the true ones
        straight = view.camera.rays(pixels).directions * ([-1, 1, 1] if view.mirrored else [1, 1, 1])
        rotation = nearest_rotation(straight.T @ rays.directions)
        return Pose(rotation, -rotation @ centre)


def distorted(flat: np.ndarray, camera: Camera) -> np.ndarray:
    """`Camera.denormalise`, (..., 2) to (..., 2), without its guard against folding: smooth for a solver."""
    x, y = flat[..., 0], flat[..., 1]
    k1, k2, p1, p2, k3 = camera.distortion
    r2 = x * x + y * y
    radial = 1 + r2 * (k1 + r2 * (k2 + r2 * k3))
    xd = x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x * x)
    yd = y * radial + p1 * (r2 + 2 * y * y) + 2 * p2 * x * y
    return np.stack([xd, yd], -1) * camera.focal + camera.centre


def _samples(view, depths, samples=12):
    """Points (N, 3) on true rays at five depths, and the pixels (N, 2) that see them."""
    near, far = depths
    if not 0 < near < far:
        raise OpticError(f"a depth range is (near, far) with 0 < near < far in mm, got {depths}")
    x, y, width, height = view.region.box
    if not width or not height:
        raise OpticError(f"{view.name} has no pixels, so no virtual camera can stand for it")
    step = max(width, height) / samples
    columns = np.arange(x + (width - 1) % step / 2, x + width, step)
    rows = np.arange(y + (height - 1) % step / 2, y + height, step)
    pixels = np.stack(np.meshgrid(columns, rows), -1).reshape(-1, 2)
    pixels = pixels[view.region.contains(pixels)]
    rays = view.rays(pixels)
    points = np.concatenate([rays.at_depth(1 / w) for w in np.linspace(1 / far, 1 / near, 5)])
    pixels = np.tile(pixels, (5, 1))
    good = np.isfinite(points).all(-1)
    if np.count_nonzero(good) < 8:
        raise OpticError(f"{view.name}: too few rays reach the depths {near:g} to {far:g} mm to fit a virtual camera")
    return points[good], pixels[good]


def _qualified(view, camera, pose, method, depths):
    virtual = VirtualCamera(camera, pose, view.mirrored, method, tuple(depths), np.nan, np.nan)
    points, pixels = _samples(view, depths, 96)  # finely: it is farthest off in the corners
    miss = np.linalg.norm(virtual.project(points) - pixels, axis=-1)
    miss = miss[np.isfinite(miss)] if np.isfinite(miss).any() else np.array([np.nan])
    rms, largest = float(np.sqrt(np.mean(miss**2))), float(miss.max())
    return VirtualCamera(camera, pose, view.mirrored, method, tuple(depths), rms, largest)


def boundary_pixel(view: ViewLike, boundary: Literal["middle", "edge"] | ArrayLike) -> np.ndarray:
    """The pixel (2,) of the boundary ray that `sketch` takes for this choice."""
    if not isinstance(boundary, str):
        return np.asarray(boundary, dtype=float)
    if boundary not in ("middle", "edge"):
        raise OpticError(f"boundary must be 'middle', 'edge' or a pixel, got {boundary!r}")
    rim = np.concatenate(view.region.outline)
    offset = rim - view.camera.centre
    if boundary == "edge":
        return rim[np.argmax(np.linalg.norm(offset, axis=-1))]
    towards = view.region.centre - view.camera.centre
    # a sub-image in the middle of the picture leaves the direction open: take x
    length = np.linalg.norm(towards)
    towards = towards / length if length > 1e-6 else np.array([1.0, 0.0])
    sideways = np.abs(offset @ [-towards[1], towards[0]])
    ahead = offset @ towards
    near_line = sideways <= np.min(sideways[ahead > 0]) + 1.0
    return rim[np.argmax(np.where(near_line, ahead, -np.inf))]


def _roll_like(view, axis_ray, centre_pixel):
    """Rotation rig -> virtual camera (3, 3): its z along the axis ray, its roll that of the picture there."""
    axis = axis_ray.directions
    step = view.unbounded().rays(centre_pixel + np.array([[1.0, 0.0], [-1.0, 0.0], [0.0, 1.0], [0.0, -1.0]])).directions
    right, down = step[0] - step[1], step[2] - step[3]
    if view.mirrored:
        right = -right
    base = shortest_rotation([0, 0, 1], axis)
    x, y = base[:, 0], base[:, 1]
    roll = np.arctan2(right @ y - down @ x, right @ x + down @ y)
    return np.array([np.cos(roll) * x + np.sin(roll) * y, -np.sin(roll) * x + np.cos(roll) * y, axis])
