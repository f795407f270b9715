"""Requirements that contradict each other, told before anything is searched."""

from __future__ import annotations

import numpy as np

from ..errors import SetupError
from ..rigs.sizing import apex_depth, axis_deviation, covering_slope, reach
from .closed_forms import edge_of, glass_index
from .grid import angles_of, distance_range
from .requirements import Requirements

_GENEROUS = 1.25  # steep facets show up to so much more than the bare camera would


def check_feasible(requirements: Requirements) -> None:
    """Raise SetupError where no prism can fit, whatever it is, and name the requirements that stand against each other.

    Only what is certain is told: what is left may still fit nothing.
    """
    _check_axis(requirements)
    _check_field(requirements)
    _check_room(requirements)
    _check_glass(requirements)
    _check_baseline(requirements)


def _check_axis(requirements):
    camera = requirements.camera
    if not camera.contains(camera.denormalise([0.0, 0.0])):
        raise SetupError(
            f"the optical axis, on which the prism's apex stands, lies outside the picture: the camera's centre is "
            f"({camera.centre[0]:g}, {camera.centre[1]:g}) px and its size {camera.size[0]} x {camera.size[1]}"
        )


def _check_field(requirements):
    if requirements.field is None:
        return
    near = requirements.depths[0]
    picture = near * np.divide(requirements.camera.size, requirements.camera.focal) * _GENEROUS
    width, height = requirements.field
    if width > picture[0] or height > picture[1]:
        raise SetupError(
            f"a field of {width:g} x {height:g} mm is more than the whole picture shows at {near:g} mm, which is "
            f"{picture[0] / _GENEROUS:.0f} x {picture[1] / _GENEROUS:.0f} mm: take a shorter lens, a larger near depth "
            "or a smaller field"
        )
    if width * height > picture.prod() / 2:
        raise SetupError(
            f"a field of {width:g} x {height:g} mm seen twice is more than the picture holds at {near:g} mm: it shows "
            f"{picture[0] / _GENEROUS:.0f} x {picture[1] / _GENEROUS:.0f} mm once, so half of that area twice; take a "
            "shorter lens, a larger near depth or a smaller field"
        )


def _check_room(requirements):
    near, least = requirements.depths[0], requirements.distances[0]
    edge, flattest = edge_of(requirements), float(angles_of(requirements).min())
    if np.isnan(covering_slope(requirements.camera, flattest)):
        apex_depth(requirements.camera, flattest, least)  # says why no prism covers the picture
    shortest = apex_depth(requirements.camera, flattest, least, edge)
    if distance_range(requirements, np.array(flattest))[1] < least:
        raise SetupError(
            f"no prism fits between a distance of {least:g} mm and the nearest depth, {near:g} mm: "
            "let it stand nearer to the camera, or take a larger near depth"
        )
    if requirements.max_length is not None and requirements.max_length < shortest:
        raise SetupError(
            f"a length of {requirements.max_length:g} mm contradicts the least distance of {least:g} mm: the flattest "
            f"prism that covers the picture then ends at {shortest:.1f} mm; let it stand nearer, or allow more length"
        )
    diameter = 2 * reach(requirements.camera) * shortest
    if requirements.max_diameter is not None and requirements.max_diameter < diameter:
        raise SetupError(
            f"a diameter of {requirements.max_diameter:g} mm contradicts the least distance of {least:g} mm: a prism "
            f"that covers the picture is {diameter:.1f} mm wide there; let it stand nearer, allow more, or take a "
            "longer lens"
        )


def _deviations(requirements):
    """Largest deviation (rad) of light along the axis by each glass; NaN where all angles reflect it."""
    angles = angles_of(requirements)
    angles = angles[np.isfinite(covering_slope(requirements.camera, angles))]
    indices = [glass_index(glass, requirements.wavelength_nm) for glass in requirements.glasses]
    return np.array([np.nanmax([*axis_deviation(index, angles), -1.0]) for index in indices])


def _check_glass(requirements):
    if (_deviations(requirements) > 0).any():
        return
    limits = [
        np.degrees(np.arcsin(1 / glass_index(glass, requirements.wavelength_nm))) for glass in requirements.glasses
    ]
    raise SetupError(
        f"every glass reflects light along the axis totally at every angle allowed, the flattest of "
        f"{angles_of(requirements).min():g} degrees: stay below {max(limits):.1f} degrees"
    )


def _check_baseline(requirements):
    if requirements.baseline is None:
        return
    deviation = float(np.nanmax(_deviations(requirements)))
    longest = 2 * requirements.depths[0] * np.tan(deviation) * np.sin(np.pi / min(requirements.facets))
    if requirements.baseline > longest:
        raise SetupError(
            f"a baseline of {requirements.baseline:g} mm is out of reach before a near depth of "
            f"{requirements.depths[0]:g} mm: the steepest prism just before it gives {longest:.0f} mm; take a shorter "
            "baseline, steeper facets, or a larger near depth"
        )
