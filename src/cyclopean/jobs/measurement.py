"""Lengths and the like in one photograph: from options, from typed lines, or from clicks in a window."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from rich.table import Table

from ..correspondence.window_search import prepare
from ..errors import CyclopeanError, ImageError, MeasurementError, OpticError, SetupError
from ..files import check_exposure, output_folder, read_photograph, read_setup
from ..measurement.images import KINDS, ImagePoint, Measurement, check_count, with_calibration
from ..rigs import Setup
from .console import chosen_depths, console, counted
from .measurement_files import Source, value_table, write_measurements, write_pictures
from .measurement_session import Scene, Session

_STYLES = {"good": "green", "check": "yellow", "refused": "red"}
_TIED_FOCAL = "camera.focal_tied"  # one free focal length of a calibration
_HELP = """\
  KIND x,y x,y ...   measure; KIND is one of {kinds}
  x,y=x2,y2          a point with its pixel in another sub-image, given by hand
  undo               take back the last measurement
  list               show all measurements
  quit               end; everything is saved already"""


@dataclass(frozen=True)
class MeasureRequest:
    """What the person asked for."""

    photo: Path
    setup: Path
    output: Path
    points: Mapping[str, Sequence[str]]  # kind -> texts such as "512,300 640,310"
    depths: tuple[float, float] | None
    window: int
    pointing: float
    channel: str
    calibration: Path | None
    prompt: bool


def run_measurement(request: MeasureRequest) -> None:
    """Measure and write everything; see `cyclopean measure`."""
    wanted = [(kind, parse_points(text)) for kind, texts in request.points.items() for text in texts]
    for kind, points in wanted:
        check_count(kind, len(points))
    if not wanted and not request.prompt:
        from .measurement_window import check_display

        check_display()
    setup = read_setup(request.setup)
    photograph = _channel(read_photograph(request.photo, setup.camera.size), request)
    scene = _scene(setup, photograph, request)
    for warning in check_exposure(photograph, scene.rig.masks):
        console.print(f"warning: {warning}", style="yellow")
    folder = output_folder(request.output)
    source = Source(
        request.photo, request.setup, scene.depths, request.window, request.pointing, request.channel,
        request.calibration,
    )  # fmt: skip
    session = Session(scene, lambda done: write_measurements(folder, source, done))
    near, far = scene.depths
    console.print(f"{request.photo.name}: {len(scene.rig)} sub-images, searching depths {near:g} to {far:g} mm")
    _measure_all(session, wanted, request.prompt, photograph, lambda: _draw(folder, source, photograph, session))
    if session.done:
        console.print(f"{counted(len(session.done), 'measurement')} -> {folder}/")
        console.print("  measurements.json  measurements.csv  measurements.png  report.html")


def _draw(folder, source, photograph, session):
    if session.done:
        write_pictures(folder, source, photograph, session.scene.rig, session.done)


def _measure_all(session, wanted, prompt, photograph, draw):
    """Take what was given, typed or clicked; pictures are drawn even when it is interrupted."""
    try:
        if wanted:
            for kind, points in wanted:
                session.take(kind, points)
            say_measurements(session.done)
        elif prompt:
            listen(session, sys.stdin)
        else:
            from .measurement_window import measure_in_window

            measure_in_window(session, photograph, draw)
            say_measurements(session.done)
    finally:
        draw()


def parse_points(text: str) -> list[ImagePoint]:
    """Points from a text such as "512,300 640,310=980,312": pixels, each with those of other sub-images behind a =."""
    points = []
    for word in text.replace(";", " ").split():
        pixels = []
        for part in word.split("="):
            try:
                x, y = (float(number) for number in part.split(","))
            except ValueError:
                raise MeasurementError(
                    f'points are given as "x,y x,y ..." in px, for example "512,300 640,310", got {text!r}'
                ) from None
            if not np.isfinite([x, y]).all():
                raise MeasurementError(f"a point must have two finite coordinates in px, got {part!r}")
            pixels.append((x, y))
        points.append(ImagePoint(pixels[0], tuple(pixels[1:])))
    if not points:
        raise MeasurementError('no points were given; wanted "x,y x,y ..." in px, for example "512,300 640,310"')
    return points


def listen(session: Session, lines: Iterable[str]) -> None:
    """Measure what is typed, line by line, until "quit" or the end."""
    console.print('type "length 512,300 640,310"; "help" shows what else, "quit" ends')
    for line in _asked(lines):
        word, _, rest = line.strip().partition(" ")
        if word in ("quit", "exit", "q"):
            break
        if word:
            _obey(session, word, rest)


def _asked(lines):
    if lines is not sys.stdin or not sys.stdin.isatty():
        yield from lines
        return
    while True:
        try:
            yield input("measure> ")
        except EOFError:
            return


def _obey(session, word, rest):
    if word == "help":
        console.print(_HELP.format(kinds=", ".join(KINDS)))
    elif word == "undo":
        session.undo()
        console.print(session.message)
    elif word in ("list", "save"):
        say_measurements(session.done)
    else:
        try:
            found = session.take(word, parse_points(rest))
            console.print(session.message, style=_STYLES[found.grade])
        except CyclopeanError as error:
            console.print(str(error), style="red")


def say_measurements(done: Sequence[Measurement]) -> None:
    """Print all measurements as a table."""
    if not done:
        console.print("nothing was measured")
        return
    columns, rows = value_table(done)
    table = Table(*columns, box=None)
    for found, row in zip(done, rows, strict=True):
        table.add_row(*row, style=_STYLES[found.grade])
    console.print(table)
    for k, found in enumerate(done, 1):
        for reason in found.reasons:
            console.print(f"  {k} {found.grade}: {reason}", style=_STYLES[found.grade])


def _channel(photograph, request):
    if request.channel == "all":
        return photograph
    if photograph.ndim == 2:
        raise ImageError(f"{request.photo} is grey: it has no {request.channel} channel; leave --channel out")
    return np.ascontiguousarray(photograph[..., ("red", "green", "blue").index(request.channel)])


def _scene(setup, photograph, request):
    rig = setup.rig()
    if len(rig) < 2:
        raise OpticError(
            f"{request.setup}: measuring wants two views or more; this {setup.optic.kind} gives {len(rig)}"
        )
    depths = chosen_depths(request.depths, setup, rig)
    share = calibration_share(setup, request.calibration) if request.calibration else lambda found: found
    return Scene(prepare(photograph, rig), rig, depths, request.window, request.pointing, share)


def calibration_share(setup: Setup, path: Path) -> Callable[[Measurement], Measurement]:
    """A function that adds to a measurement what the uncertainty of a calibration (JSON) does to it.

    Raises
    ------
    SetupError
        When the file is no calibration, or is one of another kind of setup.
    """
    from ..analysis.sensitivity import point_sensitivity
    from ..files.calibrations import read_calibration

    document = read_calibration(path)
    names = [entry["name"] for entry in document["parameters"]]
    columns = np.stack([_column(setup, name, path) for name in names], -1)  # (all parameters, free ones)
    covariance = np.nan_to_num(document["covariance"])

    def share(found: Measurement) -> Measurement:
        if found.result is None:
            return found
        seen = np.isfinite(found.located.pixels).all(-1)
        shifts = point_sensitivity(setup, found.located.points, seen=seen).matrix @ columns
        if not np.isfinite(shifts).all():
            return replace(found, reasons=(*found.reasons, "the share of the calibration cannot be told there"))
        return with_calibration(found, shifts, covariance)

    return share


def _column(setup, name, path):
    """What one free parameter of a calibration moves: (all parameters of the setup,)."""
    full = list(setup.parameter_names)
    column = np.zeros(len(full))
    if name in full:
        column[full.index(name)] = 1.0
    elif name == _TIED_FOCAL:
        column[full.index("camera.focal_x")] = 1.0
        column[full.index("camera.focal_y")] = setup.camera.focal[1] / setup.camera.focal[0]
    else:
        raise SetupError(
            f"{path} is a calibration of another setup: it has the parameter {name}, this {setup.optic.kind} has "
            f"{', '.join(full)}"
        )
    return column
