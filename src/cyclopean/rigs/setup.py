"""A setup: what you build and calibrate."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from ..cameras import Camera
from ..cameras.camera import CAMERA_PARAMETERS
from ..errors import SetupError
from ..optics import Medium, Path, Reason, medium
from .rig import Rig
from .view import DEFAULT_MARGIN, View

D_LINE_NM = 587.5618  # helium d, the line that catalogues state glass at


class Optic(Protocol):
    """What a setup asks of the thing in front of its lens."""

    kind: str  # what it is, in a word

    @property
    def parameter_names(self) -> tuple[str, ...]:
        """Names of its parameters."""
        ...

    def paths(self, wavelength_nm: float) -> tuple[Path, ...]:
        """The ways of light through it, one for each view."""
        ...

    def parameters(self, wavelength_nm: float) -> np.ndarray:
        """Values (P,) of its parameters."""
        ...

    def with_parameters(self, values: np.ndarray) -> Optic:
        """The optic with other parameters (P,)."""
        ...


@dataclass(frozen=True, eq=False)
class Setup:
    """A camera and the optic in front of it."""

    camera: Camera
    optic: Optic
    wavelength_nm: float = D_LINE_NM
    f_number: float | None = None  # of the lens; with focus_distance and the camera's pixel pitch: blend bands
    focus_distance: float | None = None  # mm, from the pinhole to what is in focus
    depths: tuple[float, float] | None = None  # mm, nearest and farthest depth of interest
    channel_wavelengths_nm: tuple[float, float, float] | None = None  # of red, green and blue of a colour photograph
    dispersion: str | Medium | None = None  # the glass whose dispersion counts where the optic's index is a number

    def __post_init__(self):
        if not (np.isfinite(self.wavelength_nm) and self.wavelength_nm > 0):
            raise SetupError(f"the wavelength must be a positive number of nm, got {self.wavelength_nm}")
        channels = self.channel_wavelengths_nm
        if channels is not None and (len(channels) != 3 or not all(np.isfinite(nm) and nm > 0 for nm in channels)):
            raise SetupError(
                f"channel_wavelengths_nm must be three positive numbers of nm, (red, green, blue), got {channels}"
            )
        if self.dispersion is not None and medium(self.dispersion).formula == "constant":
            raise SetupError(f"dispersion is the name of a glass, such as N-BK7, got {self.dispersion}")
        if self.depths is not None:
            if len(self.depths) != 2 or not 0 < self.depths[0] < self.depths[1]:
                raise SetupError(f"depths must be (near, far) with 0 < near < far in mm, got {self.depths}")
            object.__setattr__(self, "depths", tuple(float(depth) for depth in self.depths))
        for name in ("f_number", "focus_distance"):
            value = getattr(self, name)
            if value is not None and not (np.isfinite(value) and value > 0):
                raise SetupError(f"{name} must be a positive number, got {value}")
        if self.f_number is not None and self.focus_distance is None:
            raise SetupError(
                f"f_number {self.f_number:g} needs a focus_distance (mm) to tell how wide seams blend; give it, or "
                "leave the f_number out"
            )

    def rig(self, margin: float | None = None) -> Rig:
        """The views that this setup gives.

        Parameters
        ----------
        margin : float, optional
            Pixels to leave out beside seams; half the blend band plus 1.5 px where not given.

        Raises
        ------
        OpticError
            When no light comes through a facet.
        """
        if margin is not None and not 0 <= margin < np.inf:
            raise SetupError(f"the margin beside seams must be 0 px or more, got {margin}")
        views = []
        for path in self.optic.paths(self.wavelength_nm):
            width = DEFAULT_MARGIN + self.blend_band(path) / 2 if margin is None else margin
            view = View(self.camera, path, float(width), path.name)
            view._aim  # noqa: B018  found now, so that a dark view is reported here and not later
            views.append(view)
        return Rig(tuple(views))

    @property
    def pupil_diameter(self) -> float:
        """Diameter D (mm) of the entrance pupil, around the pinhole; 0 for a pinhole.

        A thin lens, whose sensor stands where it is sharp: D = f / f_number, 1 / f = 1 / image distance + 1 / focus
        distance.
        """
        if self.f_number is None or self.focus_distance is None:
            return 0.0
        if self.camera.pixel_pitch is None:
            raise SetupError("f_number and focus_distance need the camera's pixel_pitch (mm) to tell the aperture")
        image = self.camera.focal[0] * self.camera.pixel_pitch  # mm: calibration finds the distance of lens and sensor
        return 1 / (1 / image + 1 / self.focus_distance) / self.f_number

    def blend_band(self, path: Path) -> float:
        """Width (px) of the band around a seam in which the open aperture sees both facets; 0 for a pinhole.

        D (1 / z0 - 1 / Zf) times the camera's focal length in px, for an entrance pupil D, focus at Zf and a seam
        that appears at z0: the pupil as seen through the seam, from where the lens focuses.
        """
        if self.f_number is None or self.focus_distance is None or not path.interfaces:
            return 0.0
        seam = min(_seam_depth(path), self.focus_distance)
        return float(self.pupil_diameter * (1 / seam - 1 / self.focus_distance) * self.camera.focal[0])

    @property
    def parameter_names(self) -> tuple[str, ...]:
        """Names of every parameter: those of the camera, then those of the optic."""
        camera = tuple(f"camera.{name}" for name in CAMERA_PARAMETERS)
        return camera + tuple(f"optic.{name}" for name in self.optic.parameter_names)


def _seam_depth(path):
    """Distance (mm) along z at which a path's seam appears to stand; through glass it looks nearer."""
    appears, depth, index = 0.0, 0.0, path.index_start
    for interface in path.interfaces:
        if interface.normal[2] == 0:
            return np.inf
        there = abs(interface.offset / interface.normal[2])
        appears += abs(there - depth) * path.index_start / index
        depth, index = there, interface.index_after
        if Reason.WRONG_FACET in interface.bounds[:, 4]:
            break  # facets meet here
    return appears
