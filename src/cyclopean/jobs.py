"""What the commands do: read files, run the pipeline, write results, talk to the person."""

from __future__ import annotations

import json
import sys
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from rich.console import Console
from rich.table import Table

from .errors import ImageError, OutputError, SetupError
from .files import (
    check_exposure,
    output_folder,
    read_photograph,
    read_setup,
    replacing,
    write_depths,
    write_image,
    write_ply,
)

if TYPE_CHECKING:
    from .analysis import RigSummary
    from .pipeline import Reconstruction

_AT_TERMINAL = sys.stdout is not None and sys.stdout.isatty()
console = Console(highlight=False, markup=False, width=None if _AT_TERMINAL else 110)  # names may hold [ ]
DEMO = Path(__file__).parent / "demo"


def demo_files() -> tuple[Path, Path]:
    """The photograph and the setup that come with the package."""
    return DEMO / "photo.png", DEMO / "setup.toml"


def run_reconstruction(
    photo: Path,
    setup_file: Path,
    output: Path,
    depths: tuple[float, float] | None,
    step: float,
    memory_mib: float,
    threads: int | None,
    channel: str = "all",
) -> None:
    """Read, reconstruct and write everything; see `cyclopean reconstruct`."""
    from . import pipeline

    started = time.perf_counter()
    setup = read_setup(setup_file)
    photograph = read_photograph(photo, setup.camera.size)
    folder = output_folder(output)
    use_threads(threads)
    rig = setup.rig()
    if channel != "all":
        if photograph.ndim == 2:
            raise ImageError(f"{photo} is grey: it has no {channel} channel; leave --channel out")
        photograph = np.ascontiguousarray(photograph[..., ("red", "green", "blue").index(channel)])
    warnings = check_exposure(photograph, rig.masks)
    for warning in warnings:
        console.print(f"warning: {warning}", style="yellow")
    depths = depths or setup.depths or rig.working_depths
    console.print(f"{photo.name}: {len(rig)} views, searching depths {depths[0]:g} to {depths[1]:g} mm")
    kept: list[Path] = []

    def keep(k, depth_map):
        path = folder / f"unchecked_view_{k}.npz"
        with replacing(path) as file:
            np.savez(file, origin=depth_map.origin, inverse_depth=depth_map.inverse_depth, sigma=depth_map.sigma)
        kept.append(path)

    with progress_bars() as progress:
        result = pipeline.reconstruct(
            photograph, rig, depths, step=step, memory_mib=memory_mib, progress=progress, keep=keep
        )
    matched = time.perf_counter() - started
    with console.status("writing points, pictures and report"):
        write_results(folder, photo, setup_file, photograph, result, matched, step, warnings)
    for path in kept:
        path.unlink(missing_ok=True)
    say_results(result, folder, time.perf_counter() - started)


def write_results(
    folder: Path,
    photo: Path,
    setup_file: Path,
    photograph: np.ndarray,
    result: Reconstruction,
    seconds: float,
    step: float,
    warnings: list[str],
) -> None:
    """Write the numbers first, then the pictures, then the report."""
    from . import plotting

    write_ply(
        folder / "points.ply",
        result.points,
        colors=result.colours,
        covariance=result.covariance,
        sigma=np.sqrt(result.covariance[:, 2, 2]),
    )
    write_depths(
        folder / "depth.npz",
        depth=result.depth,
        confidence=result.confidence,
        sigma=result.sigma,
        view=result.view,
    )
    regions = plotting.outlined_picture(photograph, result.rig)
    depth = plotting.depth_picture(result.depth)
    overview = plotting.overview_picture(photograph, result.rig, result.depth, result.points, result.colours)
    for name, figure in (("regions", regions), ("depth", depth), ("overview", overview)):
        save_figure(figure, folder / f"{name}.png")
    tables: dict[str, tuple[Sequence[str], Sequence[Sequence[object]]]] = {
        "Views": (
            ("view", "pixels", "with depth (%)", "median depth (mm)", "median sigma (mm)"),
            [view_row(result, k) for k in range(len(result.rig))],
        ),
        "Settings": (
            ("setting", "value"),
            [
                (
                    "photograph",
                    f"{photo.name}, {photograph.shape[1]} x {photograph.shape[0]} px, {photograph.dtype}",
                ),
                ("setup", setup_file.name),
                ("depth range (mm)", f"{result.depths[0]:g} to {result.depths[1]:g}"),
                ("step between hypotheses (px)", f"{step:g}"),
                ("points", f"{len(result.points):,}"),
                ("time without pictures (s)", f"{seconds:.1f}"),
            ],
        ),
    }
    pictures = {
        "The photograph with its sub-images": regions,
        "Depth of every pixel, z in the camera's frame": depth,
        "The points, seen from the side": plotting.cloud_picture(result.points, result.colours),
    }
    plotting.write_report(
        folder / "report.html",
        f"Reconstruction of {photo.name}",
        "Lengths in mm. Sigma is the standard deviation that the matcher states for each depth.",
        tables,
        pictures,
        warnings,
    )


def view_row(result: Reconstruction, k: int) -> tuple[str, ...]:
    """One row of numbers about a view."""
    mine = result.view == k
    depth, sigma = result.depth[mine], result.sigma[mine]
    known = np.isfinite(depth)
    share = 100 * known.mean() if mine.any() else 0.0
    median, spread = (np.median(depth[known]), np.median(sigma[known])) if known.any() else (np.nan, np.nan)
    return str(k), f"{mine.sum():,}", f"{share:.1f}", f"{median:.1f}", f"{spread:.3f}"


def say_results(result: Reconstruction, folder: Path, seconds: float) -> None:
    """Tell the person what came out."""
    table = Table("view", "pixels", "with depth (%)", "median depth (mm)", "median sigma (mm)", box=None)
    for k in range(len(result.rig)):
        table.add_row(*view_row(result, k))
    console.print(table)
    if not len(result.points):
        console.print(
            "warning: no depth was found: is this the setup that took the photograph, does the depth range "
            "hold the scene, and is the scene textured?",
            style="yellow",
        )
    console.print(f"{len(result.points):,} points in {seconds:.1f} s -> {folder}/")
    console.print("  points.ply  depth.npz  depth.png  regions.png  overview.png  report.html")


def print_info(setup_file: Path, depths: tuple[float, float] | None, noise_px: float) -> None:
    """Print what a setup gives; see `cyclopean info`."""
    from .analysis import summarise

    setup = read_setup(setup_file)
    rig = setup.rig()
    with console.status("tracing"):
        summary = summarise(rig, depths or setup.depths, noise_px)
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
    fields.add_column(f"sigma of depth (mm) for {summary.sigma_px:g} px")
    for field in summary.fields:
        fields.add_row(
            f"{field.depth:g}",
            f"{field.width:.0f} x {field.height:.0f}",
            f"{100 * field.share_two:.0f}",
            f"{100 * field.share_all:.0f}",
            f"{field.sigma_depth:.3g}",
        )
    yield fields


def split_photograph(photo: Path, setup_file: Path, output: Path) -> None:
    """Write the sub-images of a photograph; see `cyclopean split`."""
    from . import plotting

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


def save_figure(figure, path: Path) -> None:
    """Write a figure as PNG, or raise OutputError."""
    try:
        figure.savefig(path)
    except OSError as error:
        raise OutputError(f"cannot write {path}: {error.strerror or error}") from error


def use_threads(threads: int | None) -> None:
    """Limit the threads of compiled kernels and of OpenCV."""
    if threads is None:
        return
    import cv2
    import numba

    if not 1 <= threads <= numba.config.NUMBA_NUM_THREADS:
        raise SetupError(f"--threads must lie between 1 and {numba.config.NUMBA_NUM_THREADS}, got {threads}")
    numba.set_num_threads(threads)
    cv2.setNumThreads(threads)


@contextmanager
def progress_bars():
    """A callable (what, done, total) that shows one bar for each `what`."""
    from rich.progress import BarColumn, Progress, TaskID, TextColumn, TimeElapsedColumn, TimeRemainingColumn

    columns = (TextColumn("{task.description}"), BarColumn(), TimeElapsedColumn(), TimeRemainingColumn())
    tasks: dict[str, TaskID] = {}
    with Progress(*columns, console=console) as bars:

        def show(what, done, total):
            if what not in tasks:
                tasks[what] = bars.add_task(what, total=total)
            bars.update(tasks[what], completed=done, total=total)

        yield show
