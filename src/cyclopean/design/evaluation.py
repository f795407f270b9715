"""What a prism before a camera does, by exact rays: a few thousand of them tell all that a design is judged by."""

from __future__ import annotations

import numpy as np

from ..analysis.field_of_view import not_upright
from ..errors import CyclopeanError, OpticError
from ..geometry import Rays, nearest_point
from ..optics import Medium, Prism, medium, prism_dimensions
from ..rigs import Rig, Setup, View
from ..rigs.colours import dispersing, index_at
from ..rigs.sizing import mean_spacing, sample_pixels
from ..rigs.view import DEFAULT_MARGIN
from ..triangulation.sensitivity import point_response
from .outlines import SubImages
from .requirements import Figures, Requirements
from .sections import Sections

DEPTHS = 5
"""How many depths candidates are judged at, from the nearest to the farthest in equal ratios."""
_DENSITIES = {  # g/cm^3, from the makers' data sheets
    "B270": 2.55, "BOROFLOAT 33": 2.23, "F2": 3.60, "H-K9L": 2.52, "N-BAK4": 3.05, "N-BK7": 2.51, "N-SF11": 3.22,
    "PMMA": 1.19, "Zeonex E48R": 1.01, "fused silica": 2.20, "polycarbonate": 1.20, "polystyrene": 1.05,
}  # fmt: skip


def evaluate(setup: Setup, requirements: Requirements) -> Figures:
    """The figures of a setup whose prism stands upright on the axis.

    Parameters
    ----------
    setup : Setup
        As `Requirements.setup` makes it, or another.
    requirements : Requirements
        Its depths, noise, light and proportions of field count; limits do not.

    Returns
    -------
    Figures
        Light is traced from every part of the picture, margins beside seams taken off (half the blend band and
        1.5 px, as in `Setup.rig`). Noise is propagated through n-view triangulation with all views that see a point.

    Raises
    ------
    OpticError
        The optic is no upright pyramid, or no light comes through one of its facets.
    """
    why = not_upright(setup)
    if why:
        raise OpticError(f"designs are upright pyramids, but {why}")
    rig = setup.rig()
    prism: Prism = setup.optic  # type: ignore[assignment]
    depths = np.geomspace(*requirements.depths, DEPTHS)
    images = SubImages.of(setup.camera, prism, max(view.margin for view in rig))
    borders, whole = _borders(rig, images)
    sections = Sections.of([rays.at_depth(depths[:, None])[..., :2] for rays in borders])
    counts = sections.counts
    spans, spacing = _spans(list(rig), images, depths)
    place = sections.cells(spans[..., :2])
    found = np.where(np.isfinite(spans).all(-1), counts[place], 0)
    sigma, worst, chromatic = _noise_and_colour(setup, rig, sections, counts >= 2, depths, requirements)
    blend, defocus = _blurs(setup, rig, requirements.depths)
    return Figures(
        depths,
        sigma,
        worst,
        sections.rectangles(counts >= 2, requirements.field),
        sections.rectangles(counts >= len(rig), requirements.field),
        sections.areas(counts >= 2),
        sections.areas(counts >= len(rig)),
        (found >= 2).mean(-1),
        (found >= len(rig)).mean(-1),
        spacing,
        _deviation(rig),
        _reflection_margin(rig, borders) if whole else 0.0,
        2 * prism.radius if prism.radius is not None else np.inf,
        prism.distance + prism.thickness,
        prism.thickness,
        _mass(prism),
        blend,
        defocus,
        chromatic,
    )


def _borders(rig, images):
    """Rays along the outline of each sub-image, and whether light comes through all of the picture."""
    outlines = [images.pixels(k, view) for k, view in enumerate(rig)]
    return [view.rays(pixels) for view, (pixels, _) in zip(rig, outlines, strict=True)], all(w for _, w in outlines)


def traced_baseline(setup: Setup) -> float:
    """Mean distance (mm) between the virtual cameras of neighbouring facets of an upright prism, by exact rays."""
    prism: Prism = setup.optic  # type: ignore[assignment]
    paths = prism.paths(setup.wavelength_nm)
    views = [View(setup.camera, path, DEFAULT_MARGIN + setup.blend_band(path) / 2, path.name) for path in paths]
    return _spans(views, SubImages.of(setup.camera, prism, views[0].margin), np.empty(0))[1]


def _spans(views, images, depths):
    """Points (D, N, 3) mm of pixels all over the picture, NaN beside seams; mean distance of neighbouring centres."""
    pixels = sample_pixels(images.camera.size)
    labels = images.labels(images.camera.normalise(pixels))
    points, centres = np.full((len(depths), len(pixels), 3), np.nan), []
    for k, view in enumerate(views):
        own = labels == k
        rays = view.rays(pixels[own])
        points[:, own] = rays.at_depth(depths[:, None])
        centres.append(nearest_point(rays).points)
    return points, mean_spacing(np.array(centres))


def _noise_and_colour(setup, rig, sections, shared, depths, requirements):
    """Relative sigma of depth (D,) pooled and at worst, and the largest spread (px) of the light's band."""
    pooled, worst = np.full(len(depths), np.nan), np.full(len(depths), np.nan)
    cells = sections.samples(shared)
    if not len(cells[0]):
        return pooled, worst, np.nan
    seen = sections.seen[(slice(None), *cells)].T
    response = point_response(rig, sections.points(cells, depths), seen)
    sigma = requirements.noise * np.sqrt(response.covariance[:, 2, 2]) / depths[cells[0]]
    for depth in range(len(depths)):
        here = sigma[(cells[0] == depth) & np.isfinite(sigma)]
        if here.size:
            pooled[depth], worst[depth] = np.sqrt(np.mean(here**2)), here.max()
    per_index = np.linalg.norm(response.to_parameters[..., setup.parameter_names.index("optic.index")], axis=-1)
    return pooled, worst, float(np.nanmax(per_index)) * index_range(setup, requirements.band)


def index_range(setup: Setup, band: tuple[float, float]) -> float:
    """By how much the index of a setup's optic changes over a band (nm); NaN where the glass is just a number."""
    if band[0] == band[1]:
        return 0.0
    if dispersing(setup) is None:
        return np.nan
    return abs(index_at(setup, band[1]) - index_at(setup, band[0]))


def _blurs(setup, rig, depths):
    """Width (px) of the blend band, and diameters (px) of the blur circle at both ends of the depths."""
    blend = max(setup.blend_band(view.path) for view in rig)
    if setup.f_number is None or setup.focus_distance is None:
        return blend, (0.0, 0.0)
    open_lens = setup.pupil_diameter * setup.camera.focal[0]
    near, far = (float(open_lens * abs(1 / z - 1 / setup.focus_distance)) for z in depths)
    return blend, (near, far)


def _deviation(rig):
    """Angle (rad) by which light along the axis is bent."""
    first = rig[0]
    axis = first.unbounded().rays(first.camera.denormalise([0.0, 0.0])).directions
    return float(np.arccos(np.clip(axis[2], -1, 1)))


def _reflection_margin(rig: Rig, borders: list[Rays]) -> float:
    """Least angle (rad) between a ray in the glass and total reflection, over the outlines of all sub-images."""
    margins = []
    for view, rays in zip(rig, borders, strict=True):
        last = view.path.interfaces[-1]
        index = view.path.interfaces[-2].index_after / last.index_after
        cosine = np.abs(rays.directions @ last.normal)
        inside = np.arcsin(np.sqrt(np.clip(1 - cosine**2, 0, 1)) / index)
        margins.append(np.arcsin(min(1 / index, 1.0)) - np.nanmax(inside))
    return float(min(margins))


def _mass(prism):
    """Mass (g) of the glass; NaN where its density is not known or the outline is not round."""
    density = glass_density(prism.glass)
    return prism_dimensions(prism).mass(density) if prism.radius is not None else np.nan


def glass_density(glass: str | float | Medium) -> float:
    """Density of a glass, g/cm^3; NaN where it is not known."""
    try:
        return _DENSITIES.get(medium(glass).name, np.nan)
    except CyclopeanError:
        return np.nan
