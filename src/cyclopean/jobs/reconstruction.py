"""From a photograph and a setup to points, pictures and a report."""

from __future__ import annotations

import time
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from rich.table import Table

from ..errors import ImageError
from ..files import (
    check_exposure,
    output_folder,
    read_photograph,
    read_setup,
    replacing,
    write_depths,
    write_ply,
)
from .console import console, progress_bars, save_figure, use_threads

if TYPE_CHECKING:
    from ..pipeline import Reconstruction

DEMO = Path(__file__).parents[1] / "demo"


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
    from .. import pipeline

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
    from .. import plotting

    sigma = np.sqrt(result.covariance[:, 2, 2])
    write_ply(
        folder / "points.ply", result.points, colors=result.colours, covariance=result.covariance, sigma=sigma
    )  # fmt: skip
    write_depths(
        folder / "depth.npz", depth=result.depth, confidence=result.confidence, sigma=result.sigma, view=result.view
    )
    regions = plotting.outlined_picture(photograph, result.rig)
    depth = plotting.depth_picture(result.depth)
    overview = plotting.overview_picture(photograph, result.rig, result.depth, result.points, result.colours)
    for name, figure in (("regions", regions), ("depth", depth), ("overview", overview)):
        save_figure(figure, folder / f"{name}.png")
    height, width = photograph.shape[:2]
    settings = [
        ("photograph", f"{photo.name}, {width} x {height} px, {photograph.dtype}"),
        ("setup", setup_file.name),
        ("depth range (mm)", f"{result.depths[0]:g} to {result.depths[1]:g}"),
        ("step between hypotheses (px)", f"{step:g}"),
        ("points", f"{len(result.points):,}"),
        ("time without pictures (s)", f"{seconds:.1f}"),
    ]
    pictures = {
        "The photograph with its sub-images": regions,
        "Depth of every pixel, z in the camera's frame": depth,
        "The points, seen from the side": plotting.cloud_picture(result.points, result.colours),
    }
    plotting.write_report(
        folder / "report.html",
        f"Reconstruction of {photo.name}",
        "Lengths in mm. Sigma is the standard deviation that the matcher states for each depth.",
        {"Views": view_table(result), "Settings": (("setting", "value"), settings)},
        pictures,
        warnings,
    )


def view_table(result: Reconstruction) -> tuple[tuple[str, ...], list[tuple[str, ...]]]:
    """Columns and rows of numbers about every view."""
    columns = ("view", "pixels", "with depth (%)", "median depth (mm)", "median sigma (mm)")
    return columns, [view_row(result, k) for k in range(len(result.rig))]


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
    columns, rows = view_table(result)
    table = Table(*columns, box=None)
    for row in rows:
        table.add_row(*row)
    console.print(table)
    if not len(result.points):
        console.print(
            "warning: no depth was found: is this the setup that took the photograph, does the depth range "
            "hold the scene, and is the scene textured?",
            style="yellow",
        )
    console.print(f"{len(result.points):,} points in {seconds:.1f} s -> {folder}/")
    console.print("  points.ply  depth.npz  depth.png  regions.png  overview.png  report.html")
