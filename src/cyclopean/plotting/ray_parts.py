"""What the drawings of rays are made of: the plane of the drawing, bundles of rays, virtual cameras, symbols."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes

from ..errors import OpticError, SetupError
from ..optics import Prism
from ..optics.footprints import meeting_points
from ..optics.solid import PrismSolid, prism_solid
from ..rigs import Rig, Setup, ViewLike
from ..rigs.virtual import boundary_pixel, sketched

GLASS, MIRROR, DIMENSION = "#bcdcf0", "#6b7a86", "#333333"
_IN_PLANE = np.deg2rad(12.0)  # sub-images off the plane by less are drawn in it
_SAMPLES = 600  # along a line through a sub-image


@dataclass(frozen=True, eq=False)
class DrawingPlane:
    """A plane through the camera's optical axis; it is drawn with z to the right."""

    azimuth: float  # rad, of the plane's own axis, from image right towards image down

    @property
    def across(self) -> np.ndarray:
        """Unit vector (3,) of the plane that is upright to z, rig frame."""
        return np.array([np.cos(self.azimuth), np.sin(self.azimuth), 0.0])

    @property
    def normal(self) -> np.ndarray:
        """Unit normal (3,) of the plane."""
        return np.array([-np.sin(self.azimuth), np.cos(self.azimuth), 0.0])

    def flat(self, points: np.ndarray) -> np.ndarray:
        """Points (..., 3) of the rig frame as (..., 2): z, and how far across."""
        return np.stack([points[..., 2], points @ self.across], axis=-1)

    def lifted(self, flat: np.ndarray) -> np.ndarray:
        """Points (..., 2) of the drawing in the rig frame, (..., 3)."""
        return flat[..., :1] * np.array([0.0, 0.0, 1.0]) + flat[..., 1:] * self.across

    @property
    def label(self) -> str:
        """What its upright axis is called."""
        turn = np.degrees(self.azimuth) % 180
        names = {0.0: "x (mm)", 90.0: "y (mm)"}
        return names.get(round(turn, 6), f"across, at {turn:.4g} degrees from x (mm)")


@dataclass(frozen=True, eq=False)
class Bundle:
    """True rays of one view along a line through its sub-image."""

    view: int
    in_plane: bool  # the line lies in the plane of the drawing
    trails: np.ndarray  # (N, S + 1, 3) mm: the pinhole, then where each ray meets each surface
    directions: np.ndarray  # (N, 3) of the rays in the scene


@dataclass(frozen=True, eq=False)
class SketchedCamera:
    """A virtual camera found by ray sketching, with the axis ray and the boundary ray that made it."""

    centre: np.ndarray  # (3,) mm
    axis: np.ndarray  # (3,) unit
    focal: float  # px
    gap: float  # mm, of the shortest segment between the two rays
    trails: np.ndarray  # (2, S + 1, 3) mm of the axis ray and the boundary ray: pinhole, surfaces
    directions: np.ndarray  # (2, 3) in the scene
    segment: np.ndarray  # (2, 3) mm: ends of the shortest segment, on the axis ray and on the boundary ray


def drawing_plane(setup: Setup, plane: str | float = "facet") -> DrawingPlane:
    """The plane that `plane` names: "facet" (that of facet 0, or of the first mirror), "xz", "yz", or an azimuth (rad).

    Raises SetupError for any other name.
    """
    named = {"xz": 0.0, "yz": np.pi / 2}
    if isinstance(plane, str):
        if plane in named:
            return DrawingPlane(named[plane])
        if plane != "facet":
            raise SetupError(f'plane must be "facet", "xz", "yz" or an azimuth in rad, got {plane!r}')
        sides = [
            surface.normal[:2] * np.sign(surface.normal[2] or 1.0)
            for path in setup.optic.paths(setup.wavelength_nm)[:1]
            for surface in path.interfaces
        ]
        steepest = max(sides, key=np.linalg.norm, default=np.zeros(2))
        if np.linalg.norm(steepest) < 1e-9:
            return DrawingPlane(0.0)
        return DrawingPlane(float(np.round(np.arctan2(steepest[1], steepest[0]), 12)))
    if not np.isfinite(plane):
        raise SetupError(f"the azimuth of a drawing's plane must be a number of rad, got {plane}")
    return DrawingPlane(float(plane))


def bundle(setup: Setup, rig: Rig, view: int, plane: DrawingPlane, count: int) -> Bundle:
    """Rays of a view, `count` of them: along the plane where its sub-image lies there, else through its middle."""
    this = rig[view]
    camera = this.camera
    offset = this.region.centre - camera.centre
    straight = len(rig) == 1 or np.linalg.norm(offset) < 2  # its sub-image lies around the optical axis
    turn = plane.azimuth if straight else np.arctan2(offset[1], offset[0])
    off = np.mod(turn - plane.azimuth + np.pi / 2, np.pi) - np.pi / 2
    in_plane = abs(off) < _IN_PLANE
    if in_plane:
        turn = plane.azimuth
    pixels = _along(this, turn)
    if len(pixels) == 0:
        pixels = this.region.centre[None]
    pixels = pixels[np.unique(np.linspace(0, len(pixels) - 1, count).round().astype(int))]
    return Bundle(view, bool(in_plane), _trails(setup, view, camera.rays(pixels)), this.rays(pixels).directions)


def _along(view: ViewLike, azimuth: float) -> np.ndarray:
    """Pixels (N, 2) of a view, close together, on the line through the principal point at this azimuth."""
    camera = view.camera
    reach = np.linalg.norm(np.array(camera.size) / camera.focal)
    slopes = np.linspace(-reach, reach, 2 * _SAMPLES + 1)
    pixels = camera.denormalise(slopes[:, None] * [np.cos(azimuth), np.sin(azimuth)])
    pixels = pixels[camera.contains(np.nan_to_num(pixels, nan=-9.0))]
    return pixels[np.isfinite(view.rays(pixels).directions).all(-1)]


def _trails(setup, view, rays):
    """Pinhole and meeting points (N, S + 1, 3) of camera rays (N,) along one view's path."""
    path = setup.optic.paths(setup.wavelength_nm)[view]
    return np.concatenate([np.asarray(rays.origins)[:, None], meeting_points(path, rays)], axis=1)


def sketched_cameras(setup: Setup, rig: Rig, boundary: str = "middle") -> list[SketchedCamera | None]:
    """Virtual camera of each view by ray sketching; None where its rays do not meet."""
    from ..geometry import shortest_segment

    cameras: list[SketchedCamera | None] = []
    for k, view in enumerate(rig):
        try:
            rim = boundary_pixel(view, boundary)
            camera, pose = sketched(view, rim)
        except (OpticError, ValueError):
            cameras.append(None)
            continue
        pixels = np.array([view.camera.centre, rim])
        rays = view.unbounded().rays(pixels)
        ends = np.array(shortest_segment(rays[0], rays[1]))
        gap = float(np.linalg.norm(ends[1] - ends[0]))
        trails = _trails(setup, k, view.camera.rays(pixels))
        cameras.append(
            SketchedCamera(
                pose.inverse.translation, pose.rotation[2], camera.focal[0], gap, trails, rays.directions, ends
            )
        )
    return cameras


def solid_of(setup: Setup, rig: Rig, tolerance: float = 0.02) -> PrismSolid:
    """The body of a setup's prism; a biprism without an outline is as wide as the camera's light needs, and a fifth."""
    prism = setup.optic
    assert isinstance(prism, Prism)
    width = None
    if prism.facets == 2 and prism.radius is None:
        width = 2.4 * float(reach_along_ridge(setup, rig))
    return prism_solid(prism, tolerance=tolerance, width=width)


def reach_along_ridge(setup: Setup, rig: Rig) -> float:
    """Farthest distance (mm) along a biprism's ridge, from its middle, at which light of the picture meets it."""
    prism = setup.optic
    assert isinstance(prism, Prism)
    middle = np.deg2rad(prism.azimuth_deg) + np.pi / 2
    along = np.array([np.cos(middle), np.sin(middle)])
    farthest = 1.0
    for k, view in enumerate(rig):
        points = _trails(setup, k, view.camera.rays(rim_pixels(view)))[:, 1:]
        local = (points - prism.placement.translation) @ prism.placement.rotation
        farthest = max(farthest, float(np.nanmax(np.abs(local[..., :2] @ along), initial=1.0)))
    return farthest


def rim_pixels(view: ViewLike) -> np.ndarray:
    """Pixels (N, 2) along the rim of a view's sub-image, with the picture's own corners where they belong to it."""
    width, height = view.camera.size
    corners = np.array([[x, y] for x in (-0.5, width - 0.5) for y in (-0.5, height - 0.5)])
    own = np.isfinite(view.rays(corners).directions).all(-1)
    return np.concatenate([*view.region.outline, corners[own]])


def draw_camera(axes: Axes, centre, axis, size: float, half_angle: float, colour, real: bool = False) -> None:
    """A camera at a point (2,) of the drawing, looking along `axis` (2,), with its field and its sensor behind."""
    axis = np.asarray(axis, dtype=float) / np.linalg.norm(axis)
    upright = np.array([-axis[1], axis[0]])
    half = size * np.tan(half_angle)
    sensor = np.array([centre - size * axis - half * upright, centre - size * axis + half * upright])
    cone = np.array([sensor[0], centre, sensor[1]])
    axes.plot(*cone.T, color=colour, linewidth=0.8, zorder=5)
    axes.plot(*sensor.T, color=colour, linewidth=3.2 if real else 2.2, solid_capstyle="butt", zorder=5)
    axes.plot(*centre, "o", color=colour, markersize=5 if real else 4, zorder=6)


def measure(axes: Axes, start, end, text: str, side=(0.0, 0.0), size: float = 8) -> None:
    """A dimension line with arrows at both ends between two points (2,) of the drawing, moved by `side`."""
    start, end = np.asarray(start, dtype=float) + side, np.asarray(end, dtype=float) + side
    arrow = {"arrowstyle": "<|-|>", "color": DIMENSION, "linewidth": 0.8, "shrinkA": 0, "shrinkB": 0}
    arrow["mutation_scale"] = 7
    axes.annotate("", end, start, arrowprops=arrow, annotation_clip=False, zorder=7)
    upright = abs(end[0] - start[0]) < abs(end[1] - start[1])
    axes.annotate(
        text,
        (start + end) / 2,
        xytext=(-4, 0) if upright else (0, 3),
        textcoords="offset points",
        ha="right" if upright else "center",
        va="center" if upright else "bottom",
        fontsize=size,
        rotation=90 if upright else 0,
        color=DIMENSION,
        zorder=8,
        bbox={"facecolor": "white", "edgecolor": "none", "alpha": 0.75, "pad": 0.6},
    )
