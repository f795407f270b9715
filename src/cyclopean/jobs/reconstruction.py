"""From a photograph and a setup to points, pictures and a report."""

from __future__ import annotations

import time
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from rich.table import Table

from ..errors import SetupError
from ..files import (
    check_exposure,
    output_folder,
    read_photograph,
    replacing,
    write_depths,
    write_ply,
)
from ..files.meshes import write_mesh
from ..geometry import as_rgb
from .colours import chosen_colours, read_setups
from .console import console, naming, progress_bars, save_figure, use_threads
from .matchers import OURS, chosen_engine

if TYPE_CHECKING:
    from ..pipeline import Reconstruction

_FEW = 0.2  # of the pixels of all views: fewer with a depth, and something is wrong
DEMO = Path(__file__).parents[1] / "demo"


def demo_files() -> tuple[Path, Path]:
    """The photograph and the setup that come with the package."""
    return DEMO / "photo.png", DEMO / "setup.toml"


def run_reconstruction(
    photo: Path,
    setup_file: Path | Sequence[Path],
    output: Path,
    depths: tuple[float, float] | None,
    step: float,
    memory_mib: float,
    threads: int | None,
    channel: str = "all",
    strict: bool = True,
    matcher: str = "cyclopean",
    scale: float = 2,
    mesh: str | None = None,
    mesh_step: int = 2,
) -> None:
    """Read, reconstruct and write everything; see `cyclopean reconstruct`."""
    started = time.perf_counter()
    if mesh and mesh_step < 1:
        raise SetupError(f"--mesh-step must be 1 px or more, got {mesh_step}")
    engine = chosen_engine(matcher, scale, step, memory_mib, strict)
    settings = engine.settings
    setup_files = [setup_file] if isinstance(setup_file, Path) else list(setup_file)
    setups = read_setups(setup_files)
    photograph = read_photograph(photo, setups[0].camera.size)
    folder = output_folder(output)
    use_threads(threads)
    photograph, rig, channels, depths, note, warnings = chosen_colours(photo, photograph, setups, channel, depths)
    warnings += check_exposure(photograph, rig.masks)
    for warning in warnings:
        console.print(f"warning: {warning}", style="yellow")
    console.print(f"{photo.name}: {len(rig)} views, searching depths {depths[0]:g} to {depths[1]:g} mm")
    if note:
        console.print(f"colours: {note}")
        settings = [("colours", note), *settings]
    run = engine.run if channels is None or matcher != OURS else partial(engine.run, channels=channels)
    kept: list[Path] = []

    def keep(k, depth_map):
        path = folder / f"unchecked_view_{k}.npz"
        with replacing(path) as file:
            np.savez(file, origin=depth_map.origin, inverse_depth=depth_map.inverse_depth, sigma=depth_map.sigma)
        kept.append(path)

    with naming(kept):
        with progress_bars() as progress:
            result = run(photograph, rig, depths, progress=progress, keep=keep)
        matched = time.perf_counter() - started
        doubts = few_depths(result)
        with console.status("writing points, pictures and report"):
            write_results(folder, photo, setup_files, photograph, result, matched, settings, warnings + doubts)
            mesh_file = mesh and write_surface(folder / f"mesh.{mesh}", photograph, result, mesh_step)
    for path in kept:
        path.unlink(missing_ok=True)
    say_results(result, folder, time.perf_counter() - started, mesh_file, doubts)


def few_depths(result: Reconstruction) -> list[str]:
    """A warning where so few pixels of the views have a depth that something must be wrong; else nothing."""
    inside = result.view >= 0
    share = float(np.isfinite(result.depth[inside]).mean()) if inside.any() else 0.0
    if share >= _FEW:
        return []
    came = (
        f"only {100 * share:.2g} % of the pixels have a depth, and these may be wrong"
        if share
        else "no depth was found"
    )
    return [
        f"{came}: is this the setup that took the photograph, does the depth range ({result.depths[0]:g} to "
        f"{result.depths[1]:g} mm) hold the scene, and is the scene in focus and textured?"
    ]


def write_surface(path: Path, photograph: np.ndarray, result: Reconstruction, stride: int) -> str:
    """Write the fused surface as a mesh in the colours of the photograph; a few words about it."""
    from ..fusion import build_mesh

    surface = build_mesh(result.rig, result.maps, stride=stride)
    if not len(surface.faces):
        if not len(result.points):
            return "no mesh: no depth was found"
        return f"no mesh: no cell of {stride} px has depth at all corners: try a smaller --mesh-step"
    colours = as_rgb(photograph)[surface.pixels[:, 1], surface.pixels[:, 0]]
    count = write_mesh(path, surface.vertices, surface.faces, colors=colours)
    return f"{path.name}  {count:,} triangles"


def write_results(
    folder: Path,
    photo: Path,
    setup_files: Sequence[Path],
    photograph: np.ndarray,
    result: Reconstruction,
    seconds: float,
    engine: Sequence[tuple[str, str]],
    warnings: list[str],
) -> None:
    """Write the numbers first, then the pictures, then the report; `engine` are its settings, as names and values."""
    from .. import plotting

    sigma = np.sqrt(result.covariance[:, 2, 2])
    write_ply(
        folder / "points.ply", result.points, result.colours, result.normals, result.covariance, sigma, result.views
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
        ("setup", ", ".join(file.name for file in setup_files)),
        ("depth range (mm)", f"{result.depths[0]:g} to {result.depths[1]:g}"),
        *engine,
        ("points", f"{len(result.points):,}, fused from {np.isfinite(result.depth).sum():,} pixels with depth"),
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
        "Lengths in mm. Sigma is the standard deviation that is stated for each depth.",
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


def say_results(
    result: Reconstruction, folder: Path, seconds: float, mesh: str | None = None, doubts: Sequence[str] = ()
) -> None:
    """Tell the person what came out, and the doubts about it."""
    columns, rows = view_table(result)
    table = Table(*columns, box=None)
    for row in rows:
        table.add_row(*row)
    console.print(table)
    for doubt in doubts:
        console.print(f"warning: {doubt}", style="yellow")
    console.print(
        f"{np.isfinite(result.depth).sum():,} pixels with depth fused to {len(result.points):,} points in "
        f"{seconds:.1f} s -> {folder}/"
    )
    console.print("  points.ply  depth.npz  depth.png  regions.png  overview.png  report.html")
    if mesh:
        console.print(f"  {mesh}")
