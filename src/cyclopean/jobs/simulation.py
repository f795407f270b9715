"""The photograph that a setup would take of a scene, and what is true in it; see `cyclopean simulate`."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np

from ..errors import SetupError
from ..files import output_folder, read_setup, replacing, write_image
from ..files.disk import parse_toml
from ..files.scene_starter import starter_scene
from ..files.scenes import read_scene, scene_from
from ..files.truths import write_truth
from ..rigs import Setup
from ..simulation import Scene, render
from ..simulation.sensor import Sensor
from ..simulation.truth import Truth, trace_truth
from .console import chosen_depths, console, counted, naming, progress_bars, save_figure
from .simulation_request import Request, check

_WHITE = 0.1  # share of a photograph at the highest level that is worth a warning


def run_simulation(request: Request) -> None:
    """Simulate one photograph, or a folder of calibration photographs; see `cyclopean simulate`."""
    check(request)
    setup = read_setup(request.setup)
    if request.calibration is not None:
        from .simulation_calibration import photograph_board

        photograph_board(setup, request)
        return
    if request.write_scene is not None:
        _write_starter(setup, request, request.write_scene)
        return
    scene = _scene(setup, request)
    photo = request.photo
    output_folder(photo.parent)
    behind = (f"{name} lies behind the camera (z below 0)" for name in _behind(scene))
    for warning in (*lens_warnings(setup), *behind):
        console.print(f"warning: {warning}", style="yellow")
    files = [photo.with_name(f"{photo.stem}_truth{ending}") for ending in (".npz", ".png")]
    kept: list[Path] = []
    with naming(kept):
        with progress_bars() as progress:
            light, said = rendered(setup, scene, request, lambda done, total: progress("rays", done, total))
        picture = request.sensor.expose(light, request.seed)
        write_image(photo, picture)
        kept.append(photo)
        console.print(f"{said} -> {photo}: {request.sensor.text}")
        _warn_of_white(picture, request.sensor)
        if request.truth and not request.preview:
            with console.status("writing what is true"):
                truth = trace_truth(setup, scene, with_optic=not request.without_optic)
                _write_truth(truth, scene, picture, request, *files)
            _say_truth(truth, scene, files)
        elif not light.max() > 0:
            console.print(
                "warning: the photograph is black: is the scene in the field of view, and is there light?",
                style="yellow",
            )


def _warn_of_white(picture: np.ndarray, sensor: Sensor) -> None:
    share = np.count_nonzero(picture == sensor.highest) / picture.size
    if share > _WHITE:
        console.print(
            f"warning: {100 * share:.0f} % of the photograph is saturated; take a smaller --exposure", style="yellow"
        )


def rendered(
    setup: Setup, scene: Scene, request: Request, progress: Callable[[int, int], None], **changes
) -> tuple[np.ndarray, str]:
    """The light on the sensor, and a sentence about the work."""
    started, total = time.perf_counter(), 0

    def tell(done, whole):
        nonlocal total
        total = whole
        progress(done, whole)

    options = {**request.options, "with_optic": not request.without_optic, **changes}
    light = render(setup, scene, progress=tell, **options)
    seconds = time.perf_counter() - started
    rays = (total or light.shape[0] * light.shape[1]) * options["samples"]
    height, width = light.shape[:2]
    return light, (
        f"{width} x {height} px, {options['samples']} rays a pixel: {rays / 1e6:.3g} million rays in {seconds:.1f} s"
    )


def lens_warnings(setup: Setup) -> list[str]:
    """What the setup file does not say about the lens, so that the photograph cannot show it."""
    if setup.f_number is None or setup.focus_distance is None:
        return [
            "the setup states no f_number and focus_distance_mm: the lens is taken as a pinhole, so all is in focus "
            "and seams do not blend"
        ]
    return []


def _behind(scene: Scene) -> list[str]:
    """Names of objects that are not in front of the camera at all."""
    return [surface.name for surface in scene.surfaces if not (surface.vertices[:, 2] > 0).any()]


def _scene(setup: Setup, request: Request) -> Scene:
    """The scene that the file describes, or one to begin with."""
    if request.scene is not None:
        scene = read_scene(request.scene)
        count = sum(len(surface.faces) for surface in scene.surfaces)
        objects = counted(len(scene.surfaces), "object")
        console.print(f"{request.scene}: {objects}, {counted(count, 'triangle')}")
        return scene
    text, depths = _starter(setup, request)
    console.print(
        f"no --scene: a speckled wall and a ball between {depths[0]:g} and {depths[1]:g} mm; --write-scene scene.toml "
        "writes that scene for you to change"
    )
    return scene_from(parse_toml(text, "the starting scene"), "the starting scene")


def _starter(setup: Setup, request: Request) -> tuple[str, tuple[float, float]]:
    rig = setup.rig()
    depths = chosen_depths(request.depths, setup, rig)
    return starter_scene(rig, depths), depths


def _write_starter(setup: Setup, request: Request, path: Path) -> None:
    if path.suffix.lower() != ".toml":
        raise SetupError(f"{path}: a scene file is a .toml file; name it so")
    if path.exists():
        raise SetupError(f"{path} is there already: name another file, or simulate it with --scene {path}")
    text, _ = _starter(setup, request)
    output_folder(path.parent)
    with replacing(path) as file:
        file.write(text.encode())
    console.print(f"-> {path}: a speckled wall and a ball; change it, then: cyclopean simulate {request.setup} "
                  f"--scene {path} -o photo.png")  # fmt: skip


def _write_truth(truth: Truth, scene: Scene, picture: np.ndarray, request: Request, arrays: Path, figure: Path) -> None:
    from ..plotting.simulation import truth_picture

    matches = truth.matches(request.matches, request.seed)
    write_truth(arrays, truth, matches, [surface.name for surface in scene.surfaces])
    save_figure(truth_picture(picture, truth, matches), figure)


def _say_truth(truth: Truth, scene: Scene, files: Sequence[Path]) -> None:
    """What the photograph shows, and what it does not."""
    known = np.isfinite(truth.depth)
    if not known.any():
        console.print("warning: nothing of the scene is in the photograph", style="yellow")
        return
    depth, inside = truth.depth[known], truth.facet >= 0
    share = 100 * known[inside].mean()
    console.print(
        f"depths {depth.min():.1f} to {depth.max():.1f} mm, {share:.1f} % of the views' pixels show the scene -> "
        + ", ".join(file.name for file in files)
    )
    seen = np.unique(truth.surface)
    for number, surface in enumerate(scene.surfaces):
        if number not in seen and surface.name not in _behind(scene):
            console.print(f"warning: {surface.name} is not in the photograph", style="yellow")
