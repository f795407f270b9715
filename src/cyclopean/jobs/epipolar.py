"""The true epipolar curves of pixels; see `cyclopean epipolar`."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from rich.table import Table

from ..epipolar import EpipolarCurves, epipolar_curves, line_distances, pinholes, sample_pixels
from ..errors import SetupError
from ..files import output_folder, read_photograph, read_setup
from ..files.calibrations import read_calibration
from ..files.disk import write_csv
from ..optics import Reason
from ..rigs import Rig, Setup
from .console import chosen_depths, console, save_figure

COLUMNS = (
    "pixel", "x_px", "y_px", "view", "other_view", "depth_mm", "point_x_mm", "point_y_mm",
    "other_x_px", "other_y_px", "sigma_across_px", "line_departure_px",
)  # fmt: skip


@dataclass(frozen=True, eq=False)
class PixelCurves:
    """The curves of one pixel, and how far straight lines are off them."""

    pixel: np.ndarray  # (2,)
    curves: EpipolarCurves  # of shape ()
    off: np.ndarray  # (V, D) px, from the line of two virtual cameras to the curve


def draw_curves(
    photo: Path | None,
    setup_file: Path,
    pixels: Sequence[str],
    view: int | None,
    depths: tuple[float, float] | None,
    noise_px: float,
    calibration: Path | None,
    output: Path,
) -> None:
    """Trace, print, draw and write the curves; see `cyclopean epipolar`."""
    given = [parse_pixel(text) for text in pixels]
    setup = read_setup(setup_file)
    photograph = None if photo is None else read_photograph(photo, setup.camera.size)
    names, covariance = ((), None) if calibration is None else read_uncertainty(calibration, setup)
    rig = setup.rig()
    if len(rig) < 2:
        raise SetupError(f"{setup_file} has one view: epipolar curves need a second one that sees the same points")
    if view is not None and not 0 <= view < len(rig):
        raise SetupError(f"--view must be 0 to {len(rig) - 1}, got {view}")
    places = [find_view(rig, pixel, view) for pixel in given]
    folder = output_folder(output)
    with console.status("tracing"):
        depths = chosen_depths(depths, setup, rig)
        if not given:
            places = [k for k in range(len(rig)) if view in (None, k)]
            given = [telling_pixel(rig, k, depths) for k in places]
        cameras = pinholes(rig, depths)
        found = []
        for pixel, place in zip(given, places, strict=True):
            curves = epipolar_curves(rig, place, pixel, depths, sigma=noise_px, names=names, covariance=covariance)
            off = [line_distances(cameras[place], cameras[k], pixel, curves.pixels[k]) if k != place
                   else np.full(len(curves.inverse_depths), np.nan) for k in range(len(rig))]  # fmt: skip
            found.append(PixelCurves(pixel, curves, np.array(off)))
    console.print(f"depths {depths[0]:g} to {depths[1]:g} mm; pixel noise {noise_px:g} px")
    for number, curve in enumerate(found):
        say_curves(rig, number, curve)
    write_curves(folder / "epipolar.csv", found)
    from ..plotting.epipolar import epipolar_picture

    figure = epipolar_picture(
        photograph, rig, [c.pixel for c in found], [c.curves for c in found], [c.off for c in found]
    )
    save_figure(figure, folder / "epipolar.png")
    console.print(f"-> {folder}/  epipolar.png  epipolar.csv")


def parse_pixel(text: str) -> np.ndarray:
    """The pixel (2,) that X,Y stands for."""
    try:
        x, y = (float(part) for part in text.split(","))
    except ValueError:
        raise SetupError(f"--pixel wants X,Y in px, for example 400,300, got {text!r}") from None
    if not (np.isfinite(x) and np.isfinite(y)):
        raise SetupError(f"--pixel wants two numbers of px, got {text!r}")
    return np.array([x, y])


def find_view(rig: Rig, pixel: np.ndarray, wanted: int | None) -> int:
    """The number of the view that a pixel lies in; a SetupError where it lies in none, or not in the one wanted."""
    place = f"pixel {pixel[0]:g},{pixel[1]:g}"
    width, height = rig.size
    if not rig[0].camera.contains(pixel):
        raise SetupError(f"{place} is not on the photograph of {width} x {height} px")
    inside = [k for k, view in enumerate(rig) if np.isfinite(view.rays(pixel).directions).all()]
    if not inside:
        reasons = sorted({Reason(int(view.explain_pixels(pixel))).text for view in rig})
        raise SetupError(f"{place} belongs to no view: {'; '.join(reasons)}")
    if wanted is not None and wanted not in inside:
        raise SetupError(f"{place} lies in view {inside[0]}, not in view {wanted}; leave --view out to find it")
    return inside[0] if wanted is None else wanted


def telling_pixel(rig: Rig, k: int, depths: tuple[float, float]) -> np.ndarray:
    """The pixel (2,) of a view whose curves are the longest in the other views, the one nearest to its middle."""
    pixels = sample_pixels(rig[k], 12).round()
    pixels = pixels[rig[k].region.contains(pixels)]
    seen = np.isfinite(epipolar_curves(rig, k, pixels, depths, samples=9).pixels[..., 0]).sum((-2, -1))
    away = np.linalg.norm(pixels - rig[k].region.centre, axis=-1)
    return pixels[np.lexsort((away, -seen))[0]]


def read_uncertainty(path: Path, setup: Setup) -> tuple[tuple[str, ...], np.ndarray]:
    """Names of parameters of a setup and their covariance (P, P), from a calibration.json."""
    document = read_calibration(path)
    names = [entry["name"] for entry in document["parameters"]]
    known = setup.parameter_names
    moves = np.zeros((len(known), len(names)))
    for column, name in enumerate(names):
        if name == "camera.focal_tied":
            moves[:2, column] = 1.0, setup.camera.focal[1] / setup.camera.focal[0]
        elif name in known:
            moves[known.index(name), column] = 1.0
        else:
            raise SetupError(f"{path}: {name} is no parameter of this setup: is it the calibration of another one?")
    used = np.flatnonzero(moves.any(1))
    if not np.isfinite(document["covariance"]).all():
        raise SetupError(f"{path}: parts of the covariance are not known (null), so there is no band to draw from it")
    covariance = np.einsum("pi,ij,qj->pq", moves[used], document["covariance"], moves[used])
    return tuple(known[row] for row in used), covariance


def say_curves(rig: Rig, number: int, found: PixelCurves) -> None:
    """Print one row for each view that sees the pixel's ray, and why others do not."""
    curves = found.curves
    title = f"pixel {number} at ({found.pixel[0]:g}, {found.pixel[1]:g}) in {rig[curves.view].name}"
    table = Table(title=title, title_justify="left", box=None, padding=(0, 1, 0, 0))
    table.add_column("in view", no_wrap=True)
    headings = ("far end (px)", "at (mm)", "near end (px)", "at (mm)", "long (px)", "sigma (px)", "px/mm", "at (mm)")
    for heading in (*headings, "line off (px)"):
        table.add_column(heading, justify="right", no_wrap=True)
    unseen = []
    for k, view in enumerate(rig):
        if k == curves.view:
            continue
        if np.isfinite(curves.pixels[k, :, 0]).sum() >= 2:
            table.add_row(view.name, *_row(curves, k, found.off[k]))
            continue
        reasons = view.explain_points(curves.points)
        reason = Reason(int(np.bincount(reasons[reasons != Reason.SEEN]).argmax()))
        unseen.append(f"not seen in {view.name}: {reason.text}")
    console.print(table if table.row_count else title)
    for text in unseen:
        console.print(text)


def _row(curves, k, off):
    seen = np.isfinite(curves.pixels[k, :, 0])
    line, depths = curves.pixels[k, seen], curves.depths[seen]
    first, last = (f"{x:.1f}, {y:.1f}" for x, y in line[[0, -1]])
    steps = np.linalg.norm(np.diff(line, axis=0), axis=-1)
    middle = len(line) // 2
    rate = abs(steps[middle - 1] / (depths[middle] - depths[middle - 1]))
    sigma = curves.sigma[k, seen]
    return (
        first,
        f"{depths[0]:.0f}",
        last,
        f"{depths[-1]:.0f}",
        f"{steps.sum():.1f}",
        f"{np.nanmax(sigma):.3f}",
        f"{rate:.3g}",
        f"{depths[middle]:.0f}",
        f"{np.nanmax(np.abs(off[seen])):.2f}",
    )


def write_curves(path: Path, found: Sequence[PixelCurves]) -> None:
    """Write every sample that is seen, as a table with the columns `COLUMNS`."""
    rows = []
    for number, one in enumerate(found):
        curves = one.curves
        for k, d in np.argwhere(np.isfinite(curves.pixels[..., 0])):
            x, y, depth = curves.points[d]
            numbers = (depth, x, y, *curves.pixels[k, d], curves.sigma[k, d], one.off[k, d])
            place = (number, f"{one.pixel[0]:.6g}", f"{one.pixel[1]:.6g}", curves.view, k)
            rows.append([*place, *(f"{value:.7g}" for value in numbers)])
    write_csv(path, COLUMNS, rows)
