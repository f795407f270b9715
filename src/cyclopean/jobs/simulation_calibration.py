"""Photographs of a board that a setup would take for its calibration; see `cyclopean simulate --calibration`."""

from __future__ import annotations

import time
from pathlib import Path

from ..analysis import usual_plan
from ..errors import OutputError, SetupError
from ..files import output_folder, read_board, write_board, write_image
from ..files.disk import write_json
from ..geometry import Pose
from ..rigs import Setup
from ..simulation import Scene
from ..simulation.prints import board_surface
from ..targets.boards import Board
from .calibration_photographs import ENDINGS
from .console import chosen_depths, console, naming, progress_bars
from .simulation import lens_warnings, rendered
from .simulation_request import Request

_ROOM = 0.15  # light from where there is no board


def photograph_board(setup: Setup, request: Request) -> None:
    """Write the photographs, the board's file and the true poses."""
    started = time.perf_counter()
    rig = setup.rig()
    if len(rig) < 2:
        raise SetupError(
            f"--calibration is for optics with two views or more, and this {setup.optic.kind} has one; photograph a "
            'board in a scene of yours (kind = "board") with --scene'
        )
    depths = chosen_depths(request.depths, setup, rig)
    target = None if request.board is None else read_board(request.board)
    if target is not None and not isinstance(target, Board):
        raise SetupError(f"{request.board}: points in space have no print that could be photographed; name a board")
    count = request.calibration or 0
    plan = usual_plan(setup, depths, target, photos=count, direct_photos=request.direct)
    board: Board = plan.target  # type: ignore[assignment]
    files = _names(request, len(plan.poses), len(plan.direct_poses))
    for warning in lens_warnings(setup):
        console.print(f"warning: {warning}", style="yellow")
    console.print(f"{board}, between {depths[0]:g} and {depths[1]:g} mm: {request.sensor.text}")
    write_board(request.folder / "board.toml", board)
    kept: dict[Path, Pose] = {}
    written: list[Path] = []
    with naming(written), progress_bars() as progress:
        for number, (file, pose) in enumerate(zip(files, plan.all_poses, strict=True)):
            try:
                _photograph(setup, board, pose, request, number, file, progress, len(files))
            except SetupError as fault:  # a tilted board may reach into the optic
                console.print(f"warning: {file.name} is left out: {fault}", style="yellow")
                continue
            kept[file] = pose
            written.append(file)
            _write_poses(request.folder / "poses.json", kept)
    if not kept:
        raise SetupError("no place of the board can be photographed: give other depths (--depth NEAR..FAR)")
    _say(request, kept, time.perf_counter() - started)


def _names(request: Request, count: int, direct: int) -> list[Path]:
    """The photographs to write; those without the optic lie in a folder of their own, as `calibrate` wants them."""
    folder = output_folder(request.folder)
    files = [folder / f"board_{number:02d}.png" for number in range(count)]
    if direct:
        files += [output_folder(folder / "direct") / f"direct_{number:02d}.png" for number in range(direct)]
    for place in (folder, folder / "direct"):
        there = {path for path in place.iterdir() if path.suffix.lower() in ENDINGS} if place.is_dir() else set()
        others = sorted(path.name for path in there - set(files))
        if others:
            raise OutputError(
                f"{place} holds other photographs, such as {others[0]}, that a calibration would take in: name "
                "another folder with -o, or empty this one"
            )
    return files


def _photograph(setup, board, pose: Pose, request: Request, number, file, progress, count) -> None:
    scene = Scene((board_surface(board, pose),), background=(_ROOM,))

    def tell(done, total):
        progress("photographs", number * total + done, count * total)

    direct = number >= (request.calibration or 0)
    seed = request.seed + number
    light, _ = rendered(setup, scene, request, tell, with_optic=not direct, seed=seed)
    write_image(file, request.sensor.expose(light, seed))


def _write_poses(path: Path, kept: dict[Path, Pose]) -> None:
    photographs = [
        {
            "file": file.relative_to(path.parent).as_posix(),
            "through_optic": file.parent == path.parent,
            "rotation": pose.rotation.tolist(),
            "translation_mm": pose.translation.tolist(),
        }
        for file, pose in kept.items()
    ]
    said = "points in the camera's frame = rotation @ points of the board + translation; x right, y down, z forward"
    write_json(path, {"conventions": said, "board": "board.toml", "photographs": photographs})


def _say(request: Request, kept: dict[Path, Pose], seconds: float) -> None:
    folder = request.folder
    console.print(f"{len(kept)} photographs in {seconds:.1f} s -> {folder}/: board.toml, poses.json (the true poses)")
    through = [file for file in kept if file.parent == folder]
    if through:
        direct = f" --camera-photos {folder}/direct" if len(kept) > len(through) else ""
        console.print(
            f"calibrate with: cyclopean calibrate {folder} --board {folder}/board.toml --setup {request.setup}{direct}"
        )
