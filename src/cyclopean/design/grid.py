"""The prisms that a search looks at: every number of facets, glass, apex angle and distance worth a look."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from ..errors import OpticError, SetupError
from ..optics import Prism
from ..rigs.sizing import axis_deviation, covering_solid, flat_distance, reach, usual_azimuth
from .closed_forms import Screen, edge_of, glass_index, screen
from .evaluation import evaluate, traced_baseline
from .requirements import Candidate, Requirements

_ANGLES_DEG = np.concatenate([np.arange(0.25, 1, 0.25), np.arange(1, 12, 0.5), np.arange(12, 20), np.arange(20, 46, 2)])
_DISTANCES = 40
_FARTHEST = 0.95  # of the nearest depth: no apex lies farther
_WITHIN = 1 - 1e-9  # of a limit, so that what stands at it is within it
_BETTER = 1.05  # times the field, for which a prism is turned from its usual azimuth
_STEPS = 4  # of the search for the distance that gives a baseline
_CLOSE = 0.02  # of the baseline, from where one more step comes within 0.001


def angles_of(requirements: Requirements) -> np.ndarray:
    """Apex angles (A,) degrees that are looked at."""
    return _ANGLES_DEG if requirements.angles_deg is None else np.asarray(requirements.angles_deg)


def azimuths_of(facets: int) -> tuple[float, float]:
    """Azimuths (degrees) of facet 0: the usual one, and the one that turns the prism across the picture."""
    return usual_azimuth(facets), 90.0 if facets == 2 else 0.0


def distance_range(requirements: Requirements, apex_deg: np.ndarray) -> tuple[float, np.ndarray]:
    """Least distance, and most (A,), mm, at which prisms with apex angles (A,) can stand; NaN where none covers."""
    farthest = _FARTHEST * requirements.depths[0]
    most = flat_distance(requirements.camera, apex_deg, farthest, edge_of(requirements))
    return requirements.distances[0], np.minimum(most, requirements.distances[1])


def all_prisms(requirements: Requirements) -> Screen:
    """Figures in closed form of all prisms that are looked at, some ten thousand."""
    parts = []
    for facets in requirements.facets:
        for glass, name in enumerate(requirements.glasses):
            apex, distance, solved = _places(requirements, facets, name)
            part = _both_ways(requirements, facets, glass, apex, distance)
            keys = {(float(a), float(d)) for a, d in zip(apex[solved], distance[solved], strict=True)}
            there = [(float(a), float(d)) in keys for a, d in zip(part.apex_deg, part.distance, strict=True)]
            parts.append(replace(part, solved=np.array(there, dtype=bool)))
    return Screen.joined(parts)


def _places(requirements, facets, glass):
    """Apex angles and distances (N,) of prisms of one glass, and whether exact rays give the baseline wanted there."""
    apexes, distances, solved = [np.empty(0)], [np.empty(0)], [np.empty(0, dtype=bool)]
    index, share = glass_index(glass, requirements.wavelength_nm), 1.0
    for apex in angles_of(requirements):
        low, high = (float(limit) for limit in distance_range(requirements, apex))
        if not (low <= high and np.isfinite(axis_deviation(index, apex))):
            continue
        special, found = _special(requirements, apex), np.nan
        if requirements.baseline is not None:
            found, share = solved_distance(requirements, facets, float(apex), index, share)
        special = [value for value in (*special, found) if low <= value <= high]
        place = np.union1d(np.geomspace(low, high, _DISTANCES), special)
        apexes.append(np.full(len(place), apex))
        distances.append(place)
        solved.append(place == found)
    return np.concatenate(apexes), np.concatenate(distances), np.concatenate(solved)


def _special(requirements, apex):
    """Distances (mm) at which a limit is just kept."""
    lengths = []
    if requirements.max_length is not None:
        lengths.append(_WITHIN * requirements.max_length)
    if requirements.max_diameter is not None:
        lengths.append(_WITHIN * requirements.max_diameter / 2 / reach(requirements.camera))
    return flat_distance(requirements.camera, apex, lengths, edge_of(requirements)).tolist()


def solved_distance(
    requirements: Requirements, facets: int, apex_deg: float, index: float, share: float = 1.0
) -> tuple[float, float]:
    """Distance (mm) at which exact rays give the baseline wanted, and that baseline over the one in closed form.

    NaN where no prism can stand there; `share` is where the search begins, best that of a similar prism.
    """
    wanted: float = requirements.baseline  # type: ignore[assignment]
    low, high = (float(limit) for limit in distance_range(requirements, np.asarray(apex_deg)))
    thin = wanted / (2 * np.tan(float(axis_deviation(index, apex_deg))) * np.sin(np.pi / facets))  # closed-form length

    def place(length):
        return float(flat_distance(requirements.camera, apex_deg, length, edge_of(requirements)))

    for _ in range(_STEPS):
        distance = place(thin / share)
        if not low / 2 <= distance <= min(2 * high, requirements.depths[0]):
            return np.nan, share
        try:
            prism = covering_prism(requirements, facets, apex_deg, index, distance, usual_azimuth(facets))
            found = traced_baseline(requirements.setup(prism))
        except (OpticError, SetupError):
            return np.nan, share
        share *= found / wanted
        if abs(found / wanted - 1) < _CLOSE:
            break
    return place(thin / share), share


def _both_ways(requirements, facets, glass, apex, distance):
    """Prisms at their usual azimuth, and turned ones where that gives more field and no less use of the sensor."""
    usual, turned = (screen(requirements, facets, glass, apex, distance, turn) for turn in azimuths_of(facets))
    if requirements.field is not None:
        better = turned.field[:, 0] > _BETTER * usual.field[:, 0]
    else:
        better = (turned.area > _BETTER * usual.area) & (turned.use >= usual.use)
    better &= np.isfinite(turned.accuracy)
    return Screen.joined([usual, turned[better]])


def covering_prism(
    requirements: Requirements,
    facets: int,
    apex_deg: float,
    glass: str | float,
    distance: float,
    azimuth_deg: float,
) -> Prism:
    """The smallest prism that covers the picture at a distance.

    As thin as its rim allows. Thicker glass moves the apex away from the flat face, which a greater distance does as
    well: baseline, field and noise follow the depth of the apex, and only the apparent place of the seams, and so the
    blend band, tells the two apart, by less than the thickness times (1 - 1 / n).
    """
    thickness, radius = covering_solid(requirements.camera, apex_deg, distance, edge_of(requirements))
    return Prism(facets, apex_deg, glass, distance, thickness, radius, azimuth_deg=azimuth_deg)


def traced(requirements: Requirements, prism: Prism) -> Candidate | None:
    """A candidate with figures by exact rays; None where no light comes through a facet."""
    try:
        setup = requirements.setup(prism)
        return Candidate(setup, evaluate(setup, requirements))
    except (OpticError, SetupError):
        return None


def prisms_of(requirements: Requirements, rows: Screen) -> Iterator[Prism]:
    """The prisms of a screen's rows, one after the other."""
    for k in range(len(rows)):
        yield covering_prism(
            requirements,
            int(rows.facets[k]),
            float(rows.apex_deg[k]),
            requirements.glasses[rows.glass[k]],
            float(rows.distance[k]),
            float(rows.azimuth_deg[k]),
        )
