"""The thesis's experiments, end to end: material, depth by each approach, tables and pictures."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from ..errors import SetupError
from ..files import output_folder, read_setup
from .console import console, counted, progress_bars
from .experiment_report import say_experiment, write_experiment
from .experiment_request import Options

if TYPE_CHECKING:
    from ..experiments import DrawingError, Material
    from ..rigs import Setup

DEPTHS = tuple(range(600, 1601, 100))  # mm
_FACETS = {"biprism": 2, "trinocular": 3, "multiocular": 4}
_MOST_FACETS = 60  # with more, sub-images hold no board
Progress = Callable[[str, int, int], None]


def run_experiment(name: str, facets: int | None, options: Options, output: Path) -> None:
    """Perform one experiment; see `cyclopean experiment`."""
    from ..experiments import ALL, USUAL, DrawingError, perform

    _check(options, facets, name)
    depths = parse_list(options.depths)
    drawing = DrawingError(options.drawing_apex_deg, options.drawing_distance, options.drawing_tilt_deg)
    folder = output_folder(output)
    with progress_bars() as progress:
        if options.data is None:
            with console.status("setting up"):
                folders = None
                material = _computed(name, facets, options, drawing, DEPTHS if depths is None else depths)
        else:
            material, folders = _photographed(name, options.data, drawing, depths, progress)
        experiment = perform(
            material,
            USUAL if options.approaches == "usual" else ALL,
            lambda done, total: progress("recovering depth by each approach", done, total),
        )
    say_experiment(name, experiment, options)
    with console.status("drawing"):
        written = write_experiment(folder, name, experiment, options, folders)
    console.print(f"\n{folder}: {', '.join(written)}")


def parse_list(text: str | None) -> tuple[float, ...] | None:
    """Depths as a person writes them, 600,700,800, mm."""
    if text is None:
        return None
    try:
        depths = tuple(float(word) for word in text.split(","))
    except ValueError:
        raise SetupError(f"--depths wants numbers of mm, for example 600,700,800, got {text!r:.60}") from None
    if not (np.isfinite(depths).all() and min(depths) > 0):
        raise SetupError(f"--depths wants numbers of mm above 0, got {text!r:.60}")
    if (np.diff(depths) <= 0).any():
        raise SetupError(f"--depths wants rising numbers of mm, each once, got {text!r:.60}")
    return depths


def _check(options: Options, facets: int | None, name: str) -> None:
    """Options that exclude each other."""
    usual = Options()
    shape = [key for key in ("baseline", "apex_deg", "glass") if getattr(options, key) != getattr(usual, key)]
    computed = [
        key
        for key in ("corner_noise_px", "seed", "photos", "board_stays")
        if getattr(options, key) != getattr(usual, key)
    ]

    if facets is not None and not 2 <= facets <= _MOST_FACETS:
        raise SetupError(f"--facets must be 2 (a biprism) to {_MOST_FACETS}, got {facets}")
    _check_numbers(options)

    def spoken(keys):
        return ", ".join("--" + key.replace("_", "-") for key in keys)

    if options.setup is not None and shape:
        raise SetupError(f"--setup says what stands on the bench: leave {spoken(shape)} out, or change the file")
    if options.data is not None and (options.setup is not None or shape or computed):
        given = [*(["setup"] if options.setup is not None else []), *shape, *computed]
        raise SetupError(f"--data takes photographs as they were taken: leave {spoken(given)} out")
    if options.data is not None and name == "multiocular" and facets not in (None, 4):
        raise SetupError(f"the photographs of this experiment are of four facets, not of {facets}: leave --facets out")


def _check_numbers(options: Options) -> None:
    """Numbers that make no sense, named as they were typed."""
    if options.seed < 0:
        raise SetupError(f"--seed must be 0 or more, got {options.seed}")
    for option, value in (
        ("--drawing-apex-deg", options.drawing_apex_deg),
        ("--drawing-distance", options.drawing_distance),
        ("--drawing-tilt-deg", options.drawing_tilt_deg),
    ):
        if not np.isfinite(value):
            raise SetupError(f"{option} must be a number, got {value:g}")
    if options.baseline is not None and not 0 < options.baseline < np.inf:
        raise SetupError(f"--baseline must be a positive number of mm, got {options.baseline:g}")
    if options.apex_deg is not None and not 0 < options.apex_deg < 90:
        raise SetupError(f"--apex-deg must lie between 0 and 90, got {options.apex_deg:g}")
    if not 0 <= options.corner_noise_px < np.inf:
        raise SetupError(f"--corner-noise-px must be 0 px or more, got {options.corner_noise_px:g}")
    if options.photos < 3:
        raise SetupError(f"--photos: calibration wants 3 photographs or more, got {options.photos}")


def _computed(
    name: str, facets: int | None, options: Options, drawing: DrawingError, depths: Sequence[float]
) -> Material:
    """Corners by exact projection and noise."""
    from ..experiments import synthetic

    return synthetic(
        _setup(name, facets, options, depths),
        depths,
        drawing=drawing,
        noise_px=options.corner_noise_px,
        seed=options.seed,
        photographs=options.photos,
        board_stays=options.board_stays,
    )


def _setup(name: str, facets: int | None, options: Options, depths: Sequence[float]) -> Setup:
    """What stands on the bench."""
    from ..experiments import standard_setup
    from ..optics import Prism

    span = depths[0], max(depths[-1], depths[0] * 1.001)
    if options.setup is None:
        given = standard_setup(
            _FACETS[name] if facets is None else facets,
            options.baseline,
            apex_deg=options.apex_deg,
            glass=_glass(options.glass),
            nearest=depths[0],
        )
        return replace(given, depths=span)
    given = read_setup(options.setup)
    if not isinstance(given.optic, Prism):
        raise SetupError(
            f"{options.setup}: the experiments are about prisms, but this optic is of kind {given.optic.kind!r}"
        )
    wanted = _FACETS[name] if name != "multiocular" else facets
    if wanted is not None and given.optic.facets != wanted:
        raise SetupError(
            f"{options.setup}: this prism has {given.optic.facets} facets, but the experiment is about {wanted}; "
            "cyclopean experiment multiocular takes any number"
        )
    return replace(given, depths=given.depths or span)


def _glass(text: str) -> str | float:
    """A glass by its name, or an index."""
    try:
        return float(text)
    except ValueError:
        return text


def _photographed(
    name: str, data: Path, drawing: DrawingError, depths: Sequence[float] | None, progress: Progress
) -> tuple[Material, tuple[Path, ...]]:
    """Corners found in rendered photographs, and the folders that hold these."""
    from .experiment_photographs import RIGS, rendered_folder, rendered_material

    console.print(f"photographs of {counted(_FACETS[name], 'facet')} in {data}")
    material = rendered_material(data, RIGS[name], drawing, depths, progress)
    span = float(material.depths.min()), float(material.depths.max())
    drawn = replace(material.drawn, depths=span if span[0] < span[1] else None)
    folder = rendered_folder(data, RIGS[name])
    folders = tuple(folder / part for part in ("camera_only", f"calib_{RIGS[name]}", f"targets_{RIGS[name]}"))
    return replace(material, drawn=drawn), folders
