"""Very many prisms that differ a little, as the arrays that the compiled projection takes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..geometry import launch, rotation_from_vector
from ..optics import Prism, Reason
from ..rigs import Setup, View
from ..rigs import kernels as rig_kernels

_CAMERA_COUNT = 9  # CAMERA_PARAMETERS come first in the parameters of a setup
_HALF_TURN = np.diag([-1.0, 1.0, -1.0])  # a prism whose facets face the camera, see `Prism`


@dataclass(frozen=True, eq=False)
class PrismFaces:
    """The placed faces of D prisms with n facets; the flat face comes first."""

    planes: np.ndarray  # (D, 1 + n, 4): outward unit normal, offset mm, in the camera's frame
    discs: np.ndarray  # (D, 7): a point of the outline's axis, the axis, the radius; inf: the facets run on
    outside: float  # index of the surroundings
    inside: np.ndarray  # (D,) index of the glass
    possible: np.ndarray  # (D,) bool: False where no such glass could be ground, or it lets no light through


def faces_of(prism: Prism, values: np.ndarray, wavelength_nm: float) -> PrismFaces:
    """Faces of the prisms with parameters (D, P), in the order of `prism.parameter_names`."""
    outside = prism.paths(wavelength_nm)[0].index_start
    towards_scene, count = prism.facing == "scene", prism.facets
    deviation = values[:, 9:-1].reshape(-1, count, 2)
    angles = values[:, 6, None] + deviation[..., 0]
    azimuths = values[:, 7, None] + 2 * np.pi * np.arange(count) / count + deviation[..., 1]
    thickness = values[:, 8]
    normals = np.zeros((len(values), 1 + count, 3))
    normals[:, 0, 2] = -1.0
    sin = np.sin(angles)
    normals[:, 1:] = np.stack([sin * np.cos(azimuths), sin * np.sin(azimuths), np.cos(angles)], -1)
    offsets = np.zeros((len(values), 1 + count))
    if towards_scene:
        offsets[:, 1:] = thickness[:, None] * np.cos(angles)
    else:
        offsets[:, 0] = thickness
    turn = rotation_from_vector(values[:, :3]) @ (np.eye(3) if towards_scene else _HALF_TURN)
    moved = np.einsum("dij,dfj->dfi", turn, normals)
    offsets += np.einsum("dfi,di->df", moved, values[:, 3:6])
    radius = _radii(prism, thickness, angles)
    discs = np.concatenate([values[:, 3:6], turn[:, :, 2], radius[:, None]], -1)
    inside = values[:, -1] * outside
    possible = _possible(values, angles, towards_scene)
    return PrismFaces(np.concatenate([moved, offsets[..., None]], -1), discs, outside, inside, possible)


def _radii(prism, thickness, angles):
    """Radius (D,) of the outlines; inf where the facets would cut through the rim of the glass."""
    radius = np.inf if prism.radius is None else prism.radius
    with np.errstate(invalid="ignore"):
        fits = thickness - radius * np.tan(angles.max(-1)) >= 0
    return np.where(fits, radius, np.inf)


def _possible(values, angles, towards_scene):
    index = values[:, -1]
    good = (values[:, [5, 8]] > 0).all(-1) & (index > 1) & (index <= 5)  # what `medium` takes for an index
    good &= ((angles > 0) & (angles < np.pi / 2)).all(-1)
    with np.errstate(divide="ignore", invalid="ignore"):
        inner = 0.0 if towards_scene else np.arcsin(np.clip(np.sin(angles) / index[:, None], -1, 1))
        return good & (np.abs(np.sin(angles - inner) * index[:, None]) < 1).all(-1)


def prism_pixels(setup: Setup, values: np.ndarray, points: np.ndarray) -> np.ndarray:
    """What `drawn_pixels` finds, for setups with a prism: a hundred times as fast as one setup after the other."""
    assert isinstance(setup.optic, Prism)
    faces = faces_of(setup.optic, values[:, _CAMERA_COUNT:], setup.wavelength_nm)
    folds = _fold_radii(values[:, :_CAMERA_COUNT])
    lenses = np.ascontiguousarray(values[:, :_CAMERA_COUNT])
    good = faces.possible & (lenses[:, :2] > 0).all(-1)
    points = np.ascontiguousarray(points, dtype=float)
    width, height = setup.camera.size
    limits = np.array([-0.5, width - 0.5, -0.5, height - 0.5, 0.0])
    views = list(setup.rig())
    pixels = np.full((len(views), len(values), len(points), 2), np.nan)
    for facet, view in enumerate(views):
        assert isinstance(view, View)
        planes, first_bound, bounds, discs = _packed(faces, facet, setup.optic.facing == "scene")
        for k in np.flatnonzero(good):
            launch(
                rig_kernels.project_points, len(points), points, *view._aim, lenses[k], folds[k], limits,
                faces.outside, planes[k], first_bound, bounds[k], discs[k], pixels[facet, k],
            )  # fmt: skip
    return np.moveaxis(pixels, 0, 2)


def _packed(faces, facet, towards_scene):
    """Planes (D, 2, 6), first bounds (3,), bounds (D, B, 5) and discs (D, 2, 7) of the way through a facet.

    optics/kernels.py says what they hold.
    """
    count = faces.planes.shape[1]
    order = (0, 1 + facet) if towards_scene else (1 + facet, 0)
    planes = np.ones((len(faces.planes), 2, 6))
    planes[:, :, :4] = faces.planes[:, order]
    step = faces.inside**2 - faces.outside**2
    planes[:, 0, 4], planes[:, 1, 4] = step, -step
    rows, firsts = [], [0]
    for face in order:
        free = face == 0 and towards_scene  # light enters the flat face wherever it is
        others = [] if free else [other for other in range(count) if other != face]
        rows += others
        firsts.append(firsts[-1] + len(others))
    bounds = np.full((len(planes), len(rows), 5), float(Reason.WRONG_FACET))
    bounds[:, :, :4] = faces.planes[:, rows]
    discs = np.ascontiguousarray(np.repeat(faces.discs[:, None], 2, axis=1))
    return planes, np.array(firsts, dtype=np.int64), bounds, discs


def _fold_radii(values):
    """`Camera.fold_radius` (D,) of lenses with parameters (D, 9): by the roots u = 1 / r^2 of a monic cubic."""
    k1, k2, k3 = values[:, [4, 5, 8]].T
    companion = np.zeros((len(values), 3, 3))
    companion[:, 0] = np.stack([-3 * k1, -5 * k2, -7 * k3], -1)
    companion[:, 1, 0] = companion[:, 2, 1] = 1.0
    roots = np.linalg.eigvals(companion)
    real = np.abs(roots.imag) < 1e-9 * np.maximum(np.abs(roots), 1)
    largest = np.where(real, roots.real, 0.0).max(-1)
    return np.where(largest > 1e-12, 1 / np.sqrt(np.maximum(largest, 1e-12)), 1e6)
