"""What a setup gives: its figures, and its sub-images cut out of a photograph."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from rich.table import Table

from ..files import check_exposure, output_folder, read_photograph, read_setup, replacing, write_image
from .console import console, save_figure

if TYPE_CHECKING:
    from ..analysis import RigSummary


def print_info(setup_file: Path, depths: tuple[float, float] | None, noise_px: float) -> None:
    """Print what a setup gives; see `cyclopean info`."""
    from ..analysis import summarise

    setup = read_setup(setup_file)
    rig = setup.rig()
    with console.status("tracing"):
        summary = summarise(rig, setup.depths if depths is None else depths, noise_px)
    camera = setup.camera
    console.print(
        f"{setup_file}: camera {camera.size[0]} x {camera.size[1]} px, focal length "
        f"{camera.focal[0]:g} px, {setup.optic.kind}, {len(rig)} views, {setup.wavelength_nm:g} nm"
    )
    console.print(f"figures hold between depths {summary.depths[0]:g} and {summary.depths[1]:g} mm\n")
    for table in info_tables(rig, summary):
        console.print(table)


def info_tables(rig, summary: RigSummary) -> Iterator[Table]:
    """The tables of `cyclopean info`."""
    title = "virtual cameras: the pinhole with distortion that fits each view best"
    views = Table("view", "pixels", "centre x, y, z (mm)", "focal x, y (px)", title=title, title_justify="left")
    views.add_column("departure rms, max (px)")
    for view, camera in zip(rig, summary.cameras, strict=True):
        views.add_row(
            view.name + (", mirrored" if view.mirrored else ""),
            f"{view.region.mask.sum():,}",
            ", ".join(f"{value:.2f}" for value in camera.centre),
            ", ".join(f"{value:.1f}" for value in camera.camera.focal),
            f"{camera.departure_rms:.3f}, {camera.departure_max:.3f}",
        )
    yield views
    pairs = Table("views", "baseline (mm)", "angle of axes (deg)", title="pairs of views", title_justify="left")
    for pair in summary.pairs:
        pairs.add_row(
            f"{rig[pair.first].name} and {rig[pair.second].name}",
            f"{pair.baseline:.2f}",
            f"{np.degrees(pair.angle):.3f}",
        )
    if summary.pairs:
        yield pairs
    title = "common field of view and depth resolution"
    fields = Table("depth (mm)", "field (mm)", "seen by 2 (%)", "seen by all (%)", title=title, title_justify="left")
    for who in ("two see it",) if len(rig) == 2 else ("just two see it", "all see it"):
        fields.add_column(f"sigma of depth (mm) for {summary.sigma_px:g} px, {who}")
    for field in summary.fields:
        sigmas = (field.sigma_two,) if len(rig) == 2 else (field.sigma_two, field.sigma_all)
        fields.add_row(
            f"{field.depth:g}",
            f"{field.width:.0f} x {field.height:.0f}",
            f"{100 * field.share_two:.0f}",
            f"{100 * field.share_all:.0f}",
            *(f"{sigma:.3g}" if sigma == sigma else "-" for sigma in sigmas),
        )
    yield fields


def split_photograph(photo: Path, setup_file: Path, output: Path) -> None:
    """Write the sub-images of a photograph; see `cyclopean split`."""
    from .. import plotting

    setup = read_setup(setup_file)
    photograph = read_photograph(photo, setup.camera.size)
    folder = output_folder(output)
    rig = setup.rig()
    for warning in check_exposure(photograph, rig.masks):
        console.print(f"warning: {warning}", style="yellow")
    places = []
    for k, view in enumerate(rig):
        x, y, width, height = view.region.box
        window = np.s_[y : y + height, x : x + width]
        mask = view.region.mask[window]
        cut = np.where(mask if photograph.ndim == 2 else mask[..., None], photograph[window], 0).astype(
            photograph.dtype
        )
        write_image(folder / f"view_{k}.png", cut)
        places.append(
            {"file": f"view_{k}.png", "name": view.name, "x": x, "y": y, "width": width, "height": height,
             "mirrored": view.mirrored}
        )  # fmt: skip
        console.print(f"view_{k}.png  {view.name}: {width} x {height} px at ({x}, {y})")
    with replacing(folder / "views.json") as file:
        file.write((json.dumps(places, indent=1) + "\n").encode())
    save_figure(plotting.outlined_picture(photograph, rig), folder / "regions.png")
