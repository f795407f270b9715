"""The setup of an experiment: a prism placed so that its virtual cameras stand a stated distance apart."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ..cameras import Camera
from ..errors import OpticError, SetupError
from ..optics import Prism, medium
from ..rigs import Setup
from ..rigs.setup import D_LINE_NM
from ..rigs.sizing import (
    apex_depth,
    axis_deviation,
    baseline,
    covering_solid,
    flat_distance,
    usual_azimuth,
    virtual_centres,  # noqa: F401  one of the names of this package
)

CAMERA = Camera((1280, 960), (2400.0, 2400.0))
DEPTHS = (600.0, 1600.0)  # mm
_STANDARD = {2: (12.0, 40.0), 3: (12.0, 40.0)}  # facets: apex, baseline
_OTHERS = (15.0, 45.0)
_NEAREST = 5.0  # mm, from the pinhole to the glass
_TOLERANCE = 1e-6  # mm, of the baseline
_ITERATIONS = 20


@dataclass(frozen=True)
class DrawingError:
    """By how much the drawing of a setup departs from what stands on the bench.

    The focal length is where the camera's calibration starts. With photographs without the optic no approach keeps it;
    without them (`Material.camera` is None) sketches do.
    """

    apex_deg: float = 0.05  # degrees, of the facets' angle
    distance: float = 1.0  # mm, of the prism from the pinhole
    tilt_deg: float = 0.2  # degrees, of the prism
    focal_percent: float = 1.0  # %, of the lens's stated focal length

    def __post_init__(self):
        if not np.isfinite([self.apex_deg, self.distance, self.tilt_deg, self.focal_percent]).all():
            wrong = ", ".join(f"{name}={value:g}" for name, value in vars(self).items() if not np.isfinite(value))
            raise SetupError(f"the errors of a drawing must be numbers, got {wrong}")

    def drawn(self, setup: Setup) -> Setup:
        """The setup as its drawing has it, when `setup` is what stands on the bench."""
        optic, camera = prism_of(setup), setup.camera
        tilt = np.add(optic.tilt_deg, np.multiply(self.tilt_deg, (0.8, -0.6, 0.0)))
        wrong = replace(
            optic,
            apex_deg=optic.apex_deg + self.apex_deg,
            distance=optic.distance + self.distance,
            tilt_deg=tuple(tilt.tolist()),
            radius=None,  # where the glass ends is seen in the photographs
        )
        scale = 1 + self.focal_percent / 100
        lens = replace(camera, focal=(scale * camera.focal[0], scale * camera.focal[1]))
        return replace(setup, optic=wrong, camera=lens)


def prism_of(setup: Setup) -> Prism:
    """The prism of a setup; an error where its optic is none."""
    if not isinstance(setup.optic, Prism):
        raise SetupError(f"the experiments are about prisms, but the optic of this setup is of kind {setup.optic.kind}")
    return setup.optic


def standard_setup(
    facets: int,
    baseline: float | None = None,
    *,
    apex_deg: float | None = None,
    glass: str | float = "N-BK7",
    camera: Camera = CAMERA,
    azimuth_deg: float | None = None,
    nearest: float = DEPTHS[0],
    wavelength_nm: float = D_LINE_NM,
) -> Setup:
    """A prism that covers the picture, as far from the camera as its virtual cameras' baseline asks for.

    Parameters
    ----------
    facets : int
        n >= 2.
    baseline : mm, optional
        Between the optical centres of neighbouring virtual cameras (`baseline`). Where it is not given: 40 mm for two
        and three facets, 45 mm for others, as in the thesis.
    apex_deg : degrees, optional
        Angle between the flat face and each facet; 12 for two and three facets, 15 for others.
    glass : str or float
        Name of a glass, or an index.
    camera : Camera
        The real camera.
    azimuth_deg : degrees, optional
        Of facet 0; `usual_azimuth` where it is not given.
    nearest : mm
        Depth of the nearest target: the prism must stand before it.
    wavelength_nm : float

    Raises
    ------
    SetupError
        No such prism can stand between camera and target; the message says which baselines there are.
    OpticError
        There is no such prism: one facet, or light that is totally reflected.

    Notes
    -----
    Light along the axis is bent by delta = asin(n sin a) - a, so that an optical centre lies off the axis by
    rho = z_apex tan(delta), and neighbours 2 rho sin(pi / facets) apart: the first value of the distance. The centres
    that `baseline` measures depend on the whole bundle of rays; the secant method finds the distance that gives them
    the baseline wanted.
    """
    apex, usual = _STANDARD.get(facets, _OTHERS)
    apex = apex if apex_deg is None else float(apex_deg)
    wanted = usual if baseline is None else float(baseline)
    turn = usual_azimuth(facets) if azimuth_deg is None else float(azimuth_deg)
    if not 0 < apex < 90:
        raise SetupError(f"the facets' angle must lie between 0 and 90 degrees, got {apex:g}")
    if not 0 < wanted < np.inf:
        raise SetupError(f"the baseline must be a positive number of mm, got {wanted}")

    def at(distance):
        thickness, radius = covering_solid(camera, apex, distance)
        prism = Prism(facets, apex, glass, distance, thickness, radius, azimuth_deg=turn)
        return Setup(camera, prism, wavelength_nm)

    at(_NEAREST).rig()  # what cannot be a prism at all is said here
    slope = _slope(facets, apex, glass, wavelength_nm)
    shortest, longest = (apex_depth(camera, apex, _NEAREST) * slope, 0.95 * nearest * slope)
    if not shortest <= wanted <= longest:
        raise SetupError(_out_of_reach(wanted, shortest, longest, facets, apex, nearest))
    return _solve(at, wanted, float(flat_distance(camera, apex, wanted / slope)))


def _slope(facets, apex_deg, glass, wavelength_nm):
    """Baseline over depth of the apex, by light along the axis."""
    index = glass if isinstance(glass, float | int) else medium(glass).index_in_air(wavelength_nm)
    return 2 * np.sin(np.pi / facets) * np.tan(axis_deviation(index, apex_deg))


def _solve(at, wanted, first):
    """The setup whose measured baseline is the wanted one."""
    last, value = first, 1.02 * first
    error = baseline(at(last).rig()) - wanted
    for _ in range(_ITERATIONS):
        setup = at(value)
        new = baseline(setup.rig()) - wanted
        if abs(new) < _TOLERANCE:
            return setup
        step = new * (value - last) / (new - error)
        last, error = value, new
        value = max(value - step, _NEAREST / 2)
    raise OpticError(f"no distance found at which neighbouring virtual cameras stand {wanted:g} mm apart")


def _out_of_reach(wanted, shortest, longest, facets, apex_deg, nearest):
    if longest <= shortest:
        return (
            f"no prism of {facets} facets of {apex_deg:g} degrees that covers the picture fits before a target at "
            f"{nearest:g} mm: move the target away, or take a longer lens"
        )
    limit = (
        f"the prism would touch the camera; the shortest there is is {shortest:.1f} mm: take flatter facets"
        if wanted < shortest
        else f"the prism would reach the nearest target, at {nearest:g} mm; the longest there is is {longest:.1f} mm: "
        "take steeper facets, a glass of higher index, or farther targets"
    )
    return f"a baseline of {wanted:g} mm is out of reach with {facets} facets of {apex_deg:g} degrees: {limit}"
