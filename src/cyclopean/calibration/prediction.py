"""Where a setup with given unknowns shows a target's points, with derivatives: what the solver asks for."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from ..errors import CyclopeanError
from ..optics import Path
from ..rigs import Setup, View
from ..targets import DIRECT, Observations
from .unknowns import Unknowns


class Prediction:
    """Where a setup with given unknowns shows points: what `minimise` asks for."""

    def __init__(self, unknowns: Unknowns, observations: Observations, aims: list[dict[int, View]] | None = None):
        self.unknowns = unknowns
        self.count = len(observations)
        self.aims = aims or [views_of(setup) for setup in unknowns.setups]
        self.kept: dict[tuple[int, bytes], dict[int, View]] = {}  # views of the last few parameters
        self.groups = [
            (int(view), int(channel), _rows((observations.view == view) & (observations.channel == channel)))
            for view, channel in np.unique(np.stack([observations.view, observations.channel], -1), axis=0)
        ]

    def __call__(self, shared, points, jacobian):
        pixels = np.full((self.count, 2), np.nan)
        to_shared, to_point = (np.full((self.count, 2, size), np.nan) for size in (len(shared), 3))
        views: dict[int, dict[int, View]] = {}
        for number, channel, rows in self.groups:
            try:
                if channel not in views:
                    views[channel] = self.views(shared, channel)
            except CyclopeanError:  # a step too far: no such optic; the solver takes a shorter one
                pixels[:] = np.nan
                break
            view = views[channel][number]
            if not jacobian:
                pixels[rows] = view.project(points[rows])
                continue
            derivatives = view.pixel_derivatives(points[rows])
            pixels[rows], to_point[rows] = derivatives.pixels, derivatives.to_point
            to_shared[rows] = derivatives.to_optic
            lens = self.unknowns.lens_matrix[channel]
            if lens.any():
                used = np.flatnonzero(lens.any(1))  # einsum, not @: see `bend`
                to_shared[rows] += np.einsum("nij,js->nis", derivatives.to_camera[..., used], lens[used])
        return (pixels, to_shared, to_point) if jacobian else (pixels, None, None)

    def views(self, shared, channel):
        """Views whose derivatives "to the optic" are those to the shared unknowns, as far as the optic has any."""
        key = (channel, shared.tobytes())
        if key in self.kept:  # a step that was tried and then taken, or one that moves poses alone
            return self.kept[key]
        views = views_of(self.unknowns.setup(shared, channel), self.aims[channel])
        matrix = self.unknowns.optic_matrix[channel]
        for number, view in views.items():
            path = view.path
            old = np.zeros((len(matrix), len(path.interfaces), 5)) if path.derivatives is None else path.derivatives
            new = np.einsum("ps,pij->sij", matrix, old)
            views[number] = view.continued(
                view.camera, replace(path, parameter_names=self.unknowns.names, derivatives=new)
            )
        if len(self.kept) >= 2 * len(self.aims):
            self.kept.clear()
        self.kept[key] = views
        return views


def _rows(mask):
    """The rows of a mask: a slice where they follow each other, which is quicker to read and write."""
    rows = np.flatnonzero(mask)
    return slice(rows[0], rows[-1] + 1) if rows[-1] - rows[0] + 1 == len(rows) else rows


def views_of(setup: Setup, aims: Mapping[int, View] | None = None) -> dict[int, View]:
    """The setup's views by their numbers, continued beyond all borders, and the bare camera as `DIRECT`.

    `aims` are views of a similar setup, from which projections then start.
    """
    if aims is None:
        aims = dict(enumerate(setup.rig())) | {DIRECT: direct_view(setup)}
    paths = dict(enumerate(setup.optic.paths(setup.wavelength_nm))) | {DIRECT: Path((), name="direct")}
    return {number: aims[number].continued(setup.camera, path) for number, path in paths.items()}


def direct_view(setup: Setup) -> View:
    """What the camera sees without its optic."""
    return View(setup.camera, Path((), name="direct"), name="direct")
