"""The pictures of an experiment, in the order of the thesis's list of figures."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from ..files import read_photograph

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from ..experiments import Experiment


def experiment_pictures(experiment: Experiment, folders: Sequence[Path] | None = None) -> dict[str, tuple[str, Figure]]:
    """File names, captions and figures, in the order of the thesis's list of figures."""
    from ..experiments import baseline
    from ..plotting.experiments import (
        boards_picture,
        depth_errors_picture,
        disparity_picture,
        ray_map_picture,
    )
    from ..plotting.rays import section_figure

    found = experiment.setup if experiment.physical is None else experiment.physical.setup
    setup = experiment.material.true or found
    rig = setup.rig()
    depths = float(experiment.actual.min()), float(max(experiment.actual.max(), 1.001 * experiment.actual.min()))
    return {
        "errors.png": (
            "Error of recovered depth by each approach",
            depth_errors_picture(experiment),
        ),
        "cameras.png": (
            "Position of camera and prism, how the virtual cameras come about, and the field of view that they share. "
            f"Drawn by ray sketching (middle); between the points nearest to all rays lie {baseline(rig):.2f} mm",
            section_figure(setup, depths),
        ),
        "ray_map.png": ("Ray map: how ray sketching finds a virtual camera", ray_map_picture(setup, rig)),
        "boards.png": (
            "Boards that calibrate the camera and the virtual cameras, and the target",
            boards_picture(_sheets(experiment, rig, folders), setup.camera.size),
        ),
        "disparity.png": ("Disparity of the target's points", disparity_picture(experiment, rig)),
        "epipolar.png": (
            "Epipolar curves of a point of the target, beside the straight lines of virtual cameras",
            _epipolar_picture(experiment, rig, depths),
        ),
    }


def _epipolar_picture(experiment, rig, depths):
    """Curves of the pixel in which view 0 shows the field's middle at the middle depth."""
    from ..epipolar import epipolar_curves, line_distances, pinholes
    from ..plotting.epipolar import epipolar_picture

    pixel = experiment.pixels[_middle_point(experiment), 0]
    cameras, curves = pinholes(rig, depths), epipolar_curves(rig, 0, pixel, depths)
    nowhere = np.full(len(curves.inverse_depths), np.nan)
    off = [nowhere] + [line_distances(cameras[0], cameras[k], pixel, curves.pixels[k]) for k in range(1, len(rig))]
    return epipolar_picture(None, rig, [pixel], [curves], [np.array(off)])


def _middle_point(experiment):
    """The point that view 0 shows nearest to the middle of its sub-image, of those near the middle depth."""
    seen = np.isfinite(experiment.pixels[:, 0, 0])
    apart = np.where(seen, np.abs(experiment.actual - np.median(experiment.actual)), np.inf)
    pixels = np.where((apart == apart.min())[:, None], experiment.pixels[:, 0], np.nan)
    return int(np.nanargmin(np.linalg.norm(pixels - np.nanmean(pixels, axis=0), axis=-1)))


def _sheets(experiment, rig, folders):
    """A photograph without the optic, one through it, and one of the target, with the physical model's residuals."""
    from ..plotting.experiments import Sheet

    material, middle = experiment.material, len(experiment.material.depths) // 2
    through, target = material.calibration, material.targets
    sheets = []
    if material.camera is not None:
        sheets.append(Sheet("calibration of the real camera", _photograph(folders, 0, material.camera, 0), None,
                            *_rows(material.camera.observations, 0, False)))  # fmt: skip
    title, picture = "calibration of the virtual cameras", _photograph(folders, 1, through, 0)
    shown: tuple = _rows(through.observations, 0, True)
    if experiment.physical is not None:
        mine, name = experiment.physical.observations, through.observations.photos[0]
        rows = np.array([mine.photos[k] == name for k in mine.photo]) & (mine.view >= 0)
        shown = (mine.view[rows], mine.pixels[rows], experiment.physical.residuals[rows]) if rows.any() else shown
    sheets.append(Sheet(title, picture, rig, *shown))
    title, picture = f"target at {material.depths[middle]:g} mm", _photograph(folders, 2, target, middle)
    return [*sheets, Sheet(title, picture, rig, *_rows(target.observations, middle, True))]


def _rows(seen, photo, through):
    """Views and pixels of one photograph's rows."""
    rows = (seen.photo == photo) & ((seen.view >= 0) == through)
    return seen.view[rows], seen.pixels[rows]


def _photograph(folders, kind, seen, photo):
    """A photograph, where there are any: `folders` of those without the optic, through it, and of the target."""
    return None if folders is None else read_photograph(folders[kind] / seen.observations.photos[photo])
