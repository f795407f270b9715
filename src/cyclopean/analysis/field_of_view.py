"""The common field of view of an upright pyramid prism in closed form: classes, limits, half width, cross-section."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from ..errors import OpticError
from ..geometry import clip_by_half_plane
from ..optics import Prism
from ..rigs import Setup, ViewLike

Kind = Literal["convergent", "semi-divergent", "divergent"]

_STEP = 1e-6  # of normalised image coordinates, for derivatives along the axis ray
_SEARCH = 4000  # samples along the line on which the boundary pixel is looked for


@dataclass(frozen=True, eq=False)
class FieldOfView:
    """What all n views of an upright pyramid see, from the axis ray and one boundary ray of each virtual camera.

    Each virtual camera stands at distance rho from the optical axis; its own axis leans by delta towards it, and its
    boundary line lies h outside its axis. gamma = 2 delta is the angle between two opposite axes, omega1 = 2 h the
    full angle of one virtual camera about its axis, lambda = 2 rho the baseline of two opposite ones.

    Exact for true rays: the class, `near`, `far`, and for two facets the kink and the half width in the plane
    through both facets. For three facets or more the seams between facets are taken as straight lines with the
    true direction next to the axis, so that the half width and the cross-section are exact near the axis only; and
    the boundary as straight across the middle of its facet: where the border of the picture runs at an angle there,
    it cuts off more.

    References
    ----------
    Xiao, thesis (National University of Singapore), section 4.3.1, names the classes.
    """

    facets: int
    deviation: float  # rad, delta: of each virtual axis from z
    half_angles: np.ndarray  # (n,) rad, h of each view, in the plane through the axis and the middle of its facet
    centres: np.ndarray  # (n,) mm, z of the virtual centres
    crossing: float  # mm, depth at which the virtual axes cross
    start: float = 0.0  # mm, depth at which light leaves the optic on the axis: nothing nearer is seen
    stretch: float = 1.0  # magnification along the facet's slope over that across it, far away; 1 for a pinhole
    foci: tuple[float, float] | None = None  # mm, z of the foci of light next to the axis: along, across the slope
    azimuths: np.ndarray = None  # type: ignore[assignment]  # (n,) rad, where each view's middle looks; None: even

    def __post_init__(self):
        if self.azimuths is None:
            object.__setattr__(self, "azimuths", 2 * np.pi * np.arange(self.facets) / self.facets)
        for name in ("half_angles", "centres"):
            values = np.broadcast_to(np.asarray(getattr(self, name), dtype=float), (self.facets,))
            object.__setattr__(self, name, values)
        if self.facets < 2 or self.facets != int(self.facets):
            raise OpticError(f"a field is common to 2 facets or more, got facets={self.facets}")
        if not 0 < self.deviation < np.pi / 2:
            raise OpticError(f"the deviation must lie between 0 and 90 degrees, got {np.degrees(self.deviation):g}")
        if not ((self.half_angles > 0) & (self.half_angles - self.deviation < np.pi / 2)).all():
            degrees = np.degrees(self.half_angles)
            raise OpticError(f"the half angles must be positive, and less than 90 degrees from z, got {degrees}")
        if not (np.isfinite(self.centres).all() and np.max(self.centres) < self.crossing < np.inf):
            raise OpticError(
                f"the axes must cross in front of the virtual centres, got a crossing at {self.crossing} mm and "
                f"centres at {self.centres} mm"
            )

    @classmethod
    def from_angles(
        cls, omega1: float, gamma: float, baseline: float, facets: int = 2, depth: float = 0.0
    ) -> FieldOfView:
        """The field of equal pinhole cameras.

        Parameters
        ----------
        omega1 : float
            Full angle of one virtual camera about its axis, rad.
        gamma : float
            Angle between two opposite axes, twice the deviation, rad.
        baseline : float
            Between two opposite centres, mm; neighbours are sin(pi / n) of it apart.
        facets : int
            How many.
        depth : float
            z of the centres, mm.
        """
        if not 0 < baseline < np.inf:
            raise OpticError(f"the baseline must be a positive number of mm, got {baseline}")
        if not 0 < gamma < np.pi:
            raise OpticError(f"gamma must lie between 0 and 180 degrees, got {np.degrees(gamma):g}")
        crossing = depth + baseline / 2 / np.tan(gamma / 2)
        return cls(facets, gamma / 2, np.full(facets, omega1 / 2), np.full(facets, depth), crossing, depth)

    @classmethod
    def of(cls, setup: Setup) -> FieldOfView:
        """The field of a setup whose prism stands upright, by tracing an axis ray and n boundary rays.

        Raises
        ------
        OpticError
            When the optic is no prism, or is tilted, shifted or irregular; `upright` sets it straight.
        """
        why = not_upright(setup)
        if why:
            raise OpticError(f"the closed forms hold for an upright pyramid: {why}; trace the common volume instead")
        prism: Prism = setup.optic  # type: ignore[assignment]
        azimuths = picture_azimuths(prism)
        lines = np.stack([_facet_lines(view, turn) for view, turn in zip(setup.rig(0.0), azimuths, strict=True)])
        axis_offset, axis_slope = lines[0, 0]
        deviation = -np.arctan(axis_slope)
        if not deviation > 0:
            raise OpticError("the prism spreads the views apart: nothing is common to them")
        offsets, slopes = lines[:, 1].T
        stretch, foci = _astigmatism(setup.rig(0.0)[0], azimuths[0])
        return cls(
            prism.facets,
            float(deviation),
            np.arctan(slopes) + deviation,
            (axis_offset - offsets) / (slopes - axis_slope),
            float(-axis_offset / axis_slope),
            prism.distance + prism.thickness,
            stretch,
            foci,
            azimuths,
        )

    @property
    def gamma(self) -> float:
        """Angle between two opposite virtual axes, rad."""
        return 2 * self.deviation

    @property
    def omega1(self) -> np.ndarray:
        """Full angle (n,) of each virtual camera about its axis, rad."""
        return 2 * self.half_angles

    @property
    def baselines(self) -> np.ndarray:
        """Twice the distance (n,) of each virtual centre from the axis, mm: lambda of opposite facets."""
        return 2 * (self.crossing - self.centres) * np.tan(self.deviation)

    @property
    def divergence(self) -> float:
        """The omega1 from which boundaries no longer limit the common field, rad: 2 gamma for two facets.

        gamma + 2 atan(sin(b) tan(delta)), where b is half the angle of a sector at far depths.
        """
        sine = np.sin(self.sector(np.inf))
        return float(2 * (self.deviation + np.arctan(sine * np.tan(self.deviation))))

    @property
    def kind(self) -> Kind:
        """Class of the field, that of its narrowest view: omega1 < gamma, omega1 < `divergence`, or wider."""
        omega = float(self.omega1.min())
        if omega < self.gamma:
            return "convergent"
        return "semi-divergent" if omega < self.divergence else "divergent"

    @property
    def near(self) -> float:
        """Depth at which the common field begins, mm: the apex, or where light leaves the optic if that is farther."""
        return max(self.crossing, self.start)

    @property
    def far_limits(self) -> np.ndarray:
        """Depths (n,) mm: the k-th is that up to which k views or more see the axis; inf where it has no end."""
        behind = self.deviation - self.half_angles
        radii = self.baselines / 2
        far = np.where(behind > 0, self.centres + radii / np.tan(np.where(behind > 0, behind, 1.0)), np.inf)
        return np.sort(far)[::-1]

    @property
    def far(self) -> float:
        """Depth at which the field common to all views ends, mm: inf unless it is convergent."""
        return float(self.far_limits[-1])

    @property
    def kink(self) -> float:
        """Depth from which a boundary limits the half width, mm: inf when it is divergent.

        For two facets lambda / (tan delta - tan(h - delta)) behind the virtual centres.
        """
        if self.kind == "divergent":
            return np.inf
        inner, outer = (lambda z: self._sides(z)[0]), (lambda z: self._sides(z)[1])
        low, high = self.crossing, 2 * self.crossing
        while inner(high) < outer(high):
            low, high = high, 2 * high
            if high > 1e12 * self.crossing:
                return np.inf
        for _ in range(200):
            middle = (low + high) / 2
            low, high = (middle, high) if inner(middle) < outer(middle) else (low, middle)
        return max(float(high), self.near)

    def sector(self, depth: ArrayLike) -> np.ndarray:
        """Half (...,) rad of the angle that one view's field spans around the axis's image at depths (...,) mm.

        tan b = tan(pi / n) cos(delta) (Z - across) / (stretch (Z - along)), with the two foci of light next to the
        axis; a pinhole has one focus and no stretch. A right angle for two facets.
        """
        depth = np.asarray(depth, dtype=float)
        if self.facets == 2:
            return np.full(depth.shape, np.pi / 2)
        along, across = self.foci or (self.centres.mean(), self.centres.mean())
        with np.errstate(invalid="ignore"):
            ratio = np.where(np.isinf(depth), 1.0, (depth - across) / (depth - along))
        return np.arctan(np.tan(np.pi / self.facets) * np.cos(self.deviation) / self.stretch * ratio)

    def half_width(self, depth: ArrayLike) -> np.ndarray:
        """Radius (...,) mm of the largest circle about the axis that all views see at depths (...,) mm; 0 outside.

        For two facets half the width of the common field, min((Z - D) tan delta, rho + (Z - z) tan(h - delta)) for
        axes that cross at D and centres at z.
        """
        depth = np.asarray(depth, dtype=float)
        inner, outer = self._sides(depth)
        width = np.minimum(inner, outer)
        return np.where(((depth >= self.near) & (width > 0)) | np.isnan(depth), width, 0.0)

    def cross_section(self, depth: float) -> np.ndarray:
        """Polygon (M, 2) mm that all views of three facets or more see at a depth, in x and y; M = 0: nothing.

        The meeting of n sectors: 2 n sides that touch the circle of radius s sin b, s = (Z - D) tan delta, with normals
        at pi / 2 + b to either side of each facet; then the boundaries, taken across the facets' middles.
        """
        if self.facets == 2:
            raise OpticError("two facets see a strip: half_width tells all; its ends are those of the picture")
        if depth < self.near:
            return np.empty((0, 2))
        half = float(self.sector(depth))
        side = (depth - self.crossing) * np.tan(self.deviation)
        corners = 4 * side * np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])
        corners = corners / np.cos(half)  # a square around all that sectors enclose
        reach = self._outer(depth)
        for facet, azimuth in enumerate(self.azimuths):
            for turn in (azimuth + np.pi / 2 + half, azimuth - np.pi / 2 - half):
                corners = clip_by_half_plane(corners, [np.cos(turn), np.sin(turn)], side * np.sin(half))
            corners = clip_by_half_plane(corners, [np.cos(azimuth), np.sin(azimuth)], reach[facet])
        return corners

    def baseline(self, difference: float) -> float:
        """Baseline of two views whose facets differ by an azimuth (rad), mm: lambda sin(p / 2)."""
        return float(self.baselines.mean() * np.sin(difference / 2))

    def axes_angle(self, difference: float) -> float:
        """Angle (rad) between two virtual axes whose facets differ by an azimuth p (rad).

        cos g = cos^2 delta + sin^2 delta cos p, written as sin(g / 2) = sin delta sin(p / 2): exact.
        """
        return float(2 * np.arcsin(np.sin(self.deviation) * abs(np.sin(difference / 2))))

    def _outer(self, depth):
        """Where the boundaries lie (..., n), mm from the axis towards each facet."""
        behind = np.asarray(depth, dtype=float)[..., None] - self.centres
        return self.baselines / 2 + behind * np.tan(self.half_angles - self.deviation)

    def _sides(self, depth):
        """Distance (...,) mm from the axis to the nearest seam, and to the nearest boundary."""
        depth = np.asarray(depth, dtype=float)
        inner = (depth - self.crossing) * np.tan(self.deviation) * np.sin(self.sector(depth))
        return inner, self._outer(depth).min(-1)


def not_upright(setup: Setup) -> str:
    """Why a setup is no upright pyramid, in words; empty when it is one."""
    optic = setup.optic
    if not isinstance(optic, Prism):
        return f"this optic is of the kind {optic.kind!r}, not a prism"
    faults = []
    if any(optic.tilt_deg[:2]):
        faults.append(f"tilted by {np.hypot(*optic.tilt_deg[:2]):.3g} degrees")
    if any(optic.shift):
        faults.append(f"shifted by {np.hypot(*optic.shift):.3g} mm")
    if np.any(optic.facet_deviation_deg):
        faults.append(f"irregular by up to {np.abs(optic.facet_deviation_deg).max():.3g} degrees")
    return f"this prism is {', '.join(faults)}" if faults else ""


def upright(setup: Setup) -> Setup:
    """The same setup with its prism set upright, on the axis, with equal facets."""
    if not isinstance(setup.optic, Prism):
        raise OpticError(f"only a prism can be set upright, this optic is of the kind {setup.optic.kind!r}")
    tilt = (0.0, 0.0, setup.optic.tilt_deg[2])
    return replace(setup, optic=replace(setup.optic, tilt_deg=tilt, shift=(0.0, 0.0), facet_deviation_deg=()))


def picture_azimuths(prism: Prism) -> np.ndarray:
    """Azimuths (n,) rad, in the camera's frame, of the middles of an upright prism's sub-images."""
    around = np.deg2rad(prism.azimuth_deg) + 2 * np.pi * np.arange(prism.facets) / prism.facets
    normals = np.stack([np.cos(around), np.sin(around), np.zeros_like(around)], -1) @ prism.placement.rotation.T
    return np.arctan2(normals[:, 1], normals[:, 0])


def _facet_lines(view, azimuth):
    """The axis ray and the boundary ray of a facet as lines in its plane, (2, 2): offset and slope of x over z."""
    towards = np.array([np.cos(azimuth), np.sin(azimuth)])
    boundary = boundary_coordinate(view, towards)
    pixels = view.camera.denormalise(np.stack([0 * towards, boundary * towards]))
    rays = view.unbounded().rays(pixels)
    if not np.isfinite(rays.directions).all():
        raise OpticError(f"{view.name}: the axis ray or the boundary ray is lost in the optic")
    slopes = (rays.directions[:, :2] @ towards) / rays.directions[:, 2]
    offsets = rays.origins[:, :2] @ towards - slopes * rays.origins[:, 2]
    return np.stack([offsets, slopes], -1)


def boundary_coordinate(view: ViewLike, towards: np.ndarray) -> float:
    """How far (tangent of the angle to the axis) a view reaches from the principal point towards (2,) unit."""
    camera = view.camera
    corners = np.array([[0, 0], [1, 0], [0, 1], [1, 1]]) * (np.array(camera.size)) - 0.5
    farthest = np.nanmax(np.append(np.linalg.norm(camera.normalise(corners), axis=-1), 0.0))

    def seen(radius):
        pixels = camera.denormalise(np.asarray(radius)[..., None] * towards)
        return camera.contains(pixels) & np.isfinite(view.rays(pixels).directions).all(-1)

    radii = np.linspace(0, 1.01 * farthest, _SEARCH)
    mine = seen(radii)
    if not mine.any():
        raise OpticError(f"{view.name} does not see along the middle of its facet")
    first = int(np.argmax(mine))
    last = first + int(np.argmin(np.append(mine[first:], False))) - 1
    low, high = radii[last], radii[last] + (radii[1] - radii[0])
    for _ in range(60):
        middle = (low + high) / 2
        low, high = (middle, high) if seen(middle) else (low, middle)
    return float(low)


def _astigmatism(view, azimuth):
    """Stretch, and z of the foci along and across the slope of a facet, of light next to the axis ray."""
    view = view.unbounded()
    along = np.array([np.cos(azimuth), np.sin(azimuth)])
    across = np.array([-along[1], along[0]])
    rays = view.rays(view.camera.denormalise(_STEP * np.array([along, -along, across, -across, 0 * along])))
    slopes = rays.directions[:, :2] / rays.directions[:, 2:]
    places = rays.origins[:, :2] - slopes * rays.origins[:, 2:]
    (a, b), (c, d) = (
        [(values[k] - values[k + 1]) @ direction / (2 * _STEP) for values in (places, slopes)]
        for k, direction in ((0, along), (2, across))
    )  # x = a + b z along the slope, c + d z across it, for one unit of image coordinate
    stretch = b / d * np.cos(np.arctan(slopes[4] @ along))
    return float(stretch), (float(-a / b), float(-c / d))
