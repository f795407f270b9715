"""Drawings, solids and ray figures of a setup; see `cyclopean drawing` and `cyclopean rays`."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from rich.table import Table

from ..errors import OutputError, SetupError
from ..files import output_folder, read_setup, replacing
from ..optics import Prism
from ..rigs import Setup
from .console import console

SOLIDS = (".stl", ".ply", ".obj")
DRAWINGS = (".pdf", ".svg", ".png")
_IN_FOLDER = ("drawing.pdf", "drawing.svg", "prism.stl")
_FIGURES = ("section", "map", "cameras")
_MOST_RAYS = 500  # of each view: more are one blot


@dataclass(frozen=True)
class DrawingRequest:
    """What the person asked for; see `cyclopean drawing`."""

    setup: Path
    output: tuple[Path, ...]
    page: object  # plotting.workshop.Page
    tolerances: object  # plotting.workshop.Tolerances
    width: float | None
    mesh_tolerance: float


@dataclass(frozen=True)
class RayRequest:
    """What the person asked for; see `cyclopean rays`."""

    setup: Path
    output: Path
    figure: str
    depths: tuple[float, float] | None
    plane: str
    count: int
    boundary: str


def write_drawings(request: DrawingRequest) -> None:
    """Write drawings and solids, and tell the measures."""
    from ..files.meshes import write_mesh
    from ..optics.solid import prism_solid

    setup = read_setup(request.setup)
    prism = setup.optic if isinstance(setup.optic, Prism) else None
    files = list(_files(request.output, DRAWINGS + SOLIDS, _IN_FOLDER if prism else _IN_FOLDER[:2]))
    for path in files:
        if path.suffix.lower() in SOLIDS and prism is None:
            raise OutputError(f"{path}: only a prism is written as a solid; this setup's optic is {setup.optic.kind}")
    _check_mesh(request.mesh_tolerance)
    width = _width(setup, request.width)
    solid = prism_solid(prism, tolerance=request.mesh_tolerance, width=width) if prism else None
    data: dict[str, bytes] = {}
    kinds = {path.suffix.lower() for path in files}
    if kinds & set(DRAWINGS):
        data = _drawn(setup, request, kinds & set(DRAWINGS))
    if prism:
        console.print(measures_table(setup, width))
        _warn(setup)
        if width is not None and request.width is None:
            console.print(f"a biprism without a radius is endless along its ridge: cut to {width:g} mm (--width)")
    for path in files:
        if solid is not None and path.suffix.lower() in SOLIDS:
            write_mesh(path, solid.vertices, solid.triangles)
        else:
            with replacing(path) as file:
                file.write(data[path.suffix.lower()])
        console.print(f"-> {path}")


def _check_mesh(tolerance):
    from ..optics.solid import FINEST

    if not FINEST <= tolerance < np.inf:
        raise SetupError(f"--mesh-tolerance wants a number of mm from {FINEST:g}, got {tolerance:g}")


def _warn(setup):
    """Tell what the prism is too small for, and that nobody can make it, where that is so."""
    from ..plotting.workshop import light_aperture, picture_warning, sharp_edge_advice

    light = light_aperture(setup)
    lines = [picture_warning(setup, light)]
    if setup.optic.radius is None:
        lines.append(sharp_edge_advice(setup.optic, light))
    for line in filter(None, lines):
        console.print(f"warning: {line}", style="yellow")


def _drawn(setup, request, kinds):
    """The drawing as the bytes of each kind of file."""
    from ..plotting.workshop import workshop_drawing
    from ..plotting.workshop_sheet import encoded

    figure = workshop_drawing(setup, request.page, request.tolerances, request.width)
    return {kind: encoded(figure, kind) for kind in kinds}


def _width(setup: Setup, given: float | None) -> float | None:
    """Length along the ridge where the prism needs one."""
    prism = setup.optic
    if given is not None or not isinstance(prism, Prism) or prism.facets != 2 or prism.radius is not None:
        return given
    from ..plotting.workshop_part import prism_width

    return prism_width(setup)


def measures_table(setup: Setup, width: float | None) -> Table:
    """The measures of a setup's prism."""
    from ..optics.dimensions import prism_dimensions
    from ..plotting.workshop import face_text, light_aperture
    from ..plotting.workshop_sheet import degrees_text

    prism = setup.optic
    assert isinstance(prism, Prism)
    measures = prism_dimensions(prism, width)
    light = light_aperture(setup)
    table = Table("measure", "value", box=None)

    def row(name, angles):
        texts = list(dict.fromkeys(degrees_text(angle if abs(angle) > 1e-9 else 0.0) for angle in angles))
        table.add_row(name, ", ".join(texts) + f"  ({', '.join(f'{x:.5f}' for x in _distinct(angles))} deg)")

    row("facet to flat face", measures.facet_angles)
    row("edge between facets to flat face", measures.edge_angles)
    row("dihedral angle between facets", measures.dihedral_angles)
    table.add_row("thickness at the apex", f"{measures.height:.4f} mm")
    if prism.radius is not None:
        table.add_row("outline", f"round, diameter {2 * prism.radius:g} mm")
        table.add_row("rim, least and greatest", f"{measures.rim[0]:.4f}, {measures.rim[1]:.4f} mm")
    elif prism.facets == 2:
        table.add_row("outline", f"rectangle, {width:g} mm along the ridge")
    else:
        table.add_row("outline", "polygon, where the facets cut the flat face")
    table.add_row("volume", f"{measures.volume / 1000:.4f} cm^3")
    flat, facets = (face_text(radius, prism.radius) for radius in (light.flat_face, light.facets))
    table.add_row("clear diameter needed, mm", f"flat face: {flat}, facets: {facets}")
    return table


def _distinct(angles):
    return list(dict.fromkeys(np.round(np.degrees(angles), 5) + 0.0))


def draw_rays(request: RayRequest) -> None:
    """Write ray figures."""
    setup = read_setup(request.setup)
    plane = _plane(request.plane)
    if not 1 <= request.count <= _MOST_RAYS:
        raise SetupError(f"--count wants 1 to {_MOST_RAYS} rays of each view, got {request.count}")
    if request.depths is not None:
        setup.rig().check_depths(request.depths)
    (path,) = _files((request.output,), DRAWINGS, ("",))
    wanted = (
        {path: request.figure} if path.suffix.lower() in DRAWINGS else {path / f"{name}.png": name for name in _FIGURES}
    )
    from ..plotting.workshop_sheet import encoded

    for file_path, name in wanted.items():
        with console.status(f"drawing {name}"):
            figure = _ray_figure(setup, name, request, plane)
            data = encoded(figure, file_path.suffix.lower())
        with replacing(file_path) as file:
            file.write(data)
        console.print(f"-> {file_path}")


def _ray_figure(setup, name, request, plane):
    from ..plotting.ray_maps import ray_map, virtual_camera_figure
    from ..plotting.rays import section_figure

    if name == "map":
        return ray_map(setup, request.depths)
    if name == "cameras":
        return virtual_camera_figure(setup, request.depths, request.boundary)
    return section_figure(setup, request.depths, plane=plane, rays=request.count)


def _plane(text: str) -> str | float:
    """A plane by name, or an azimuth in degrees, as rad."""
    if text in ("facet", "xz", "yz"):
        return text
    try:
        azimuth = float(text)
    except ValueError:
        azimuth = np.nan
    if not np.isfinite(azimuth):
        raise SetupError(f"--plane wants facet, xz, yz, or an azimuth in degrees, got {text!r}")
    return float(np.deg2rad(azimuth))


def _files(output: tuple[Path, ...], kinds: tuple[str, ...], in_folder: tuple[str, ...]) -> Iterator[Path]:
    """The files to write, their folders made: those named, and the usual ones for each folder that is named."""
    if not output:
        raise OutputError("which file? name one after -o")
    for path in output:
        kind = path.suffix.lower()
        if kind in kinds:
            output_folder(path.absolute().parent)
            yield path
        elif kind and not path.is_dir():
            raise OutputError(f"{path}: the file must end in {', '.join(kinds)}, not in {path.suffix}")
        else:
            folder = output_folder(path)
            yield from (folder / name if name else folder for name in in_folder)
