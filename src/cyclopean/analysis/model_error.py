"""What it costs to take a sub-image as the picture of an ordinary camera: errors of depth by the model alone."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import Literal, get_args

import numpy as np
from numpy.typing import ArrayLike

from ..calibration.depths import working_volume
from ..errors import SetupError
from ..rigs import Rig, Setup, VirtualCamera, fit, pinhole_rig, sketch
from ..triangulation import triangulate

Method = Literal["sketch", "fit", "distortion"]
METHODS: dict[str, str] = {
    "sketch": "ray sketch",
    "fit": "fitted pinhole",
    "distortion": "fitted pinhole with distortion",
}
"""Ways to find a virtual camera, in words."""

_DEPTHS = 9
_COARSE = 24  # samples across when the middle of the common field is sought
_HALVINGS = 30  # of the way to the border of the field


@dataclass(frozen=True, eq=False)
class ModelError:
    """Errors of exact points that are triangulated with virtual cameras, at G x G points of Z planes."""

    method: str  # a key of METHODS
    cameras: tuple[VirtualCamera, ...]  # one for each view
    depths: np.ndarray  # (Z,) mm
    points: np.ndarray  # (Z, G, G, 3) mm, rows of x; the middle one is the middle of the common field
    error: np.ndarray  # (Z, G, G, 3) mm, computed minus true; NaN where fewer than two views see the point
    residual: np.ndarray  # (Z, G, G) px, rms of the reprojection error that the virtual cameras leave
    rows: np.ndarray  # (Z, G, G) px, by how much rows differ in pictures that are rectified by the virtual cameras
    raw_rows: np.ndarray  # (Z, G, G) px, by how much pixels of the photograph differ across the direction of disparity
    mm_per_px: np.ndarray  # (Z,) change of depth for one px of disparity, in the middle of the field

    @property
    def percent(self) -> np.ndarray:
        """(Z, G, G) error of depth in percent of the depth."""
        return 100 * self.error[..., 2] / self.depths[:, None, None]

    @property
    def middle(self) -> np.ndarray:
        """(Z,) error of depth in percent, in the middle of the common field."""
        centre = self.points.shape[1] // 2
        return self.percent[:, centre, centre]

    @property
    def range(self) -> np.ndarray:
        """(Z, 2) smallest and largest error of depth in percent over the field."""
        return np.stack([_over_field(np.nanmin, self.percent), _over_field(np.nanmax, self.percent)], -1)

    @property
    def rms(self) -> np.ndarray:
        """(Z,) root mean square error of depth in percent over the field."""
        return np.sqrt(_over_field(np.nanmean, self.percent**2))

    @property
    def largest_row(self) -> np.ndarray:
        """(Z,) largest `rows` over the field, px."""
        return _over_field(np.nanmax, self.rows)

    @property
    def largest_raw_row(self) -> np.ndarray:
        """(Z,) largest `raw_rows` over the field, px."""
        return _over_field(np.nanmax, self.raw_rows)


def _over_field(figure, values):
    """A figure (Z,) of values (Z, G, G); NaN where a plane holds none."""
    return np.array([figure(plane) if np.isfinite(plane).any() else np.nan for plane in values])


def model_error(
    setup: Setup,
    depths: Sequence[float] | np.ndarray | None = None,
    method: Method = "distortion",
    *,
    fit_depths: tuple[float, float] | None = None,
    samples: int = 5,
    reach: float = 0.9,
    boundary: Literal["middle", "edge"] | ArrayLike = "middle",
) -> ModelError:
    """Triangulate exact points of the common field with virtual cameras.

    Parameters
    ----------
    setup : Setup
        Its views, traced along true rays, are the truth.
    depths : sequence of Z mm, optional
        z of the planes to look at; nine from the nearest to the farthest depth of the setup without it.
    method : "sketch", "fit" or "distortion"
        Ray sketches; pinholes that fit the true rays best, without or with k1, k2, p1, p2.
    fit_depths : (2,) mm, optional
        Depths between which pinholes are fitted; the nearest and the farthest of `depths` without it.
    samples : int
        G, an odd number: points across the field.
    reach : float
        How far they go from the middle of the common field towards its border; 1 is the border.
    boundary : "middle", "edge" or a pixel (2,)
        The boundary ray of a ray sketch, see `sketch`.

    Returns
    -------
    ModelError

    Raises
    ------
    SetupError
        Where no two views share anything at one of the depths.

    References
    ----------
    Xiao and Lim 2007, Image and Vision Computing 25(11), 1725-1736, and the theory of Lee and Kweon 2000, IEEE
    Transactions on Robotics and Automation 16(5), 528-538, take the views for pinholes; this is what they neglect.
    """
    _check(method, samples, reach)
    rig = setup.rig()
    if len(rig) < 2:
        raise SetupError(f"depth needs two views or more, and this {setup.optic.kind} gives {len(rig)}")
    if depths is None:
        near, far = setup.depths or rig.working_depths
        depths = [float(f"{depth:.4g}") for depth in np.geomspace(near, far, _DEPTHS)]
    depths = np.sort(np.atleast_1d(np.asarray(depths, dtype=float)))
    if not (np.isfinite(depths).all() and depths[0] > 0):
        raise SetupError(f"depths are positive numbers of mm, got {depths}")
    points = np.stack([_field_points(rig, depth, samples, reach) for depth in depths])
    between = _between(depths) if fit_depths is None else fit_depths
    cameras = tuple(_camera(view, between, method, boundary) for view in rig)
    seen = np.isfinite(rig.project(points))
    pixels = np.where(seen, rig.unbounded().project(points), np.nan)
    found = triangulate(pinhole_rig(cameras, rig).unbounded(), pixels)
    raw_rows, mm_per_px = _raw_rows_and_scale(rig, pixels, points[:, samples // 2, samples // 2])
    rows = _rectified_rows(cameras, pixels)
    return ModelError(method, cameras, depths, points, found.points - points, found.residual, rows, raw_rows, mm_per_px)


def _check(method, samples, reach):
    if method not in get_args(Method):
        raise SetupError(f"a virtual camera is found by one of {', '.join(get_args(Method))}, got {method!r}")
    if samples != int(samples) or samples < 3 or samples % 2 == 0:
        raise SetupError(f"samples across the field must be an odd number, 3 or more, got {samples}")
    if not 0 < reach <= 1:
        raise SetupError(f"reach is a share of the way to the border, above 0 and at most 1, got {reach}")


def _between(depths):
    """Nearest and farthest depth; a little apart where there is one depth only."""
    return (depths[0], depths[-1]) if depths[-1] > depths[0] else (0.99 * depths[0], 1.01 * depths[0])


def _camera(view, between, method, boundary):
    if method == "sketch":
        return sketch(view, between, boundary)
    return fit(view, between, distortion=method == "distortion")


def _field_points(rig, depth, samples, reach):
    """Points (G, G, 3) from the middle of the common field towards its border, along x and y."""
    volume = working_volume(rig, [depth], _COARSE)
    common = volume.points[0][volume.seen[0].sum(-1) == volume.seen[0].sum(-1).max()]
    middle = (common.min(0) + common.max(0)) / 2
    if np.isfinite(rig.project(middle)[..., 0]).sum() < 2:  # a field with a hole: take a point of it
        middle = common[np.argmin(np.linalg.norm(common - middle, axis=-1))]
    steps = np.linspace(-reach, reach, samples)
    across = [_reaches(rig, middle, np.eye(3)[axis], np.ptp(common[:, axis]) + 1e-3 * depth) for axis in range(2)]
    x, y = (np.where(steps < 0, -steps * low, steps * high) * np.sign(steps) for low, high in across)
    return middle + np.stack([*np.meshgrid(x, y), np.zeros((samples, samples))], -1)


def _reaches(rig, middle, axis, far):
    """How far (mm) the common field reaches from its middle, against and along an axis."""
    low, high = np.zeros(2), np.full(2, far)
    for _ in range(_HALVINGS):
        tried = (low + high) / 2
        places = middle + np.array([-tried[0], tried[1]])[:, None] * axis
        inside = np.isfinite(rig.project(places)[..., 0]).sum(-1) >= 2
        low, high = np.where(inside, tried, low), np.where(inside, high, tried)
    return low


def _rectified_rows(cameras, pixels):
    """Differences (Z, G, G) px of the rows on which two views show a point; the larger of all pairs counts.

    Each pair is rectified by its own virtual cameras: both are turned so that x runs along their baseline and z as
    near as can be along the mean of their axes, and have the mean of their focal lengths. NaN where a ray does not
    look along z. Fusiello, Trucco, Verri 2000, Machine Vision and Applications 12(1), 16-22.
    """
    rays = [camera.rays(pixels[..., k, :]).directions for k, camera in enumerate(cameras)]
    rows = np.full(pixels.shape[:-2], np.nan)
    for i, j in combinations(range(len(cameras)), 2):
        x = cameras[j].centre - cameras[i].centre
        y = np.cross(cameras[i].axis + cameras[j].axis, x)
        frame = np.stack([y, np.cross(x, y)], -1)
        frame = frame / np.maximum(np.linalg.norm(frame, axis=0), 1e-300)
        (y_i, z_i), (y_j, z_j) = (np.moveaxis(rays[k] @ frame, -1, 0) for k in (i, j))
        ahead = (z_i > 0) & (z_j > 0)
        focal = np.mean([cameras[i].camera.focal, cameras[j].camera.focal])
        apart = np.abs(y_i / np.where(ahead, z_i, np.nan) - y_j / np.where(ahead, z_j, np.nan))
        rows = np.fmax(rows, focal * apart)
    return rows


def _raw_rows_and_scale(rig: Rig, pixels, middles):
    """Differences of raw pixels across the direction of disparity (Z, G, G) px, and mm of depth for one px of it (Z,).

    The direction is that in which the difference of two views' pixels moves with depth in the middle of the field,
    middles (Z, 3) mm; the larger of all pairs counts.
    """
    moves = [view.unbounded().pixel_derivatives(middles).to_point[..., 2] for view in rig]  # px for one mm of depth
    rows, most = np.full(pixels.shape[:-2], np.nan), np.zeros(len(middles))
    for i, j in combinations(range(len(rig)), 2):
        along = moves[i] - moves[j]
        length = np.linalg.norm(along, axis=-1)
        across = np.stack([-along[:, 1], along[:, 0]], -1) / np.maximum(length, 1e-12)[:, None]
        apart = pixels[..., i, :] - pixels[..., j, :]
        rows = np.fmax(rows, np.abs(np.einsum("zghk,zk->zgh", apart, across)))
        most = np.fmax(most, length)
    return rows, 1 / np.maximum(most, 1e-12)
