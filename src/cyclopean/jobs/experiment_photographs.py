"""Photographs of an experiment from a folder: those of a renderer, with the setup that took them."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np

from ..cameras import Camera
from ..errors import ImageError, SetupError
from ..experiments import DrawingError, Material, Seen
from ..files import read_photograph
from ..files.disk import read_text
from ..geometry import Pose
from ..optics import Prism
from ..rigs import Setup
from ..targets import Board, observe

RIGS = {"biprism": "t2_b40", "trinocular": "t3_b40", "multiocular": "t4_b45"}
_FACING: dict[str, Literal["scene", "camera"]] = {"apex_scene": "scene", "apex_camera": "camera"}
Progress = Callable[[str, int, int], None]


@dataclass(frozen=True, eq=False)
class RenderedSet:
    """A set of rendered photographs of a board."""

    folder: Path
    board: Board
    files: tuple[str, ...]
    poses: tuple[Pose, ...]  # camera_from_board of each
    depths: np.ndarray  # (B,) mm, of boards square to the axis; NaN of others

    @property
    def paths(self) -> tuple[Path, ...]:
        """Where the photographs lie."""
        return tuple(self.folder / file for file in self.files)


def rendered_setup(folder: Path, rig: str) -> Setup:
    """The true setup of rendered photographs, from `rigs/RIG.json`."""
    told = _read_json(folder / "rigs" / f"{rig}.json")
    try:
        camera, prism = told["camera"], told["prism"]
        return Setup(
            Camera.from_matrix(camera["K"], (camera["width"], camera["height"]), camera["dist_k1k2p1p2k3"]),
            Prism(
                facets=prism["n_facets"],
                apex_deg=prism["alpha_deg"],
                glass=prism["index"],
                distance=prism["standoff"],
                thickness=prism["apex_height"],
                radius=prism["radius"],
                facing=_FACING[prism["orientation"]],
                azimuth_deg=prism["phi0_deg"],
                tilt_deg=tuple(prism["tilt_rvec_deg"]),
                shift=tuple(prism["shift_xy"]),
            ),
        )
    except (KeyError, TypeError) as fault:
        raise SetupError(f"{folder / 'rigs' / rig}.json does not describe a rig: {fault!r}") from None


def rendered_set(folder: Path, name: str) -> RenderedSet:
    """A set of rendered photographs, from `NAME/views.json`."""
    told = _read_json(folder / name / "views.json")
    try:
        board, views = told["board"], told["views"]
        return RenderedSet(
            folder / name,
            Board(
                "charuco", board["squares_x"], board["squares_y"], board["square"], board["marker"],
                board["dictionary"], board.get("legacy_pattern", False),
            ),
            tuple(view["file"] for view in views),
            tuple(Pose(np.array(view["R_cam_board"]), np.array(view["t_cam_board"])) for view in views),
            np.array([view.get("depth_mm", np.nan) for view in views], dtype=float),
        )  # fmt: skip
    except (KeyError, TypeError) as fault:
        raise SetupError(f"{folder / name / 'views.json'} does not describe photographs: {fault!r}") from None


def rendered_folder(data: Path, rig: str) -> Path:
    """The folder of the renderer's photographs: `data` itself, or `mitsuba` in it.

    Raises
    ------
    ImageError
        When what an experiment needs is not there.
    """
    wanted = ("camera_only", f"calib_{rig}", f"targets_{rig}")
    for folder in (data, data / "mitsuba"):
        if (folder / "rigs" / f"{rig}.json").is_file() and all((folder / name).is_dir() for name in wanted):
            return folder
    if not data.is_dir():
        raise ImageError(f"{data}: there is no such folder; --data takes the one that holds mitsuba/")
    raise ImageError(
        f"{data}: an experiment wants the folders {', '.join(wanted)} and rigs/{rig}.json there, or in mitsuba/ there; "
        "for photographs of your own see cyclopean compare-calibrations"
    )


def rendered_material(
    data: Path, rig: str, drawing: DrawingError, depths: Sequence[float] | None, progress: Progress
) -> Material:
    """What an experiment on rendered photographs has to work from: corners that are found in them.

    `depths` chooses some of the depths at which the target was photographed; all of them where it is not given.
    """
    folder = rendered_folder(data, rig)
    true = rendered_setup(folder, rig)
    masks = true.rig().masks  # sub-images are told from a photograph of a white wall, not from a drawing
    target = _chosen(rendered_set(folder, f"targets_{rig}"), depths)
    return Material(
        true,
        drawing.drawn(true),
        detected(rendered_set(folder, "camera_only"), None, progress),
        detected(rendered_set(folder, f"calib_{rig}"), masks, progress),
        detected(target, masks, progress),
        target.depths,
    )


def detected(given: RenderedSet, masks: np.ndarray | None, progress: Progress) -> Seen:
    """The corners that are found in a set of photographs."""
    photographs = [(path.name, read_photograph(path)) for path in given.paths]
    name = given.folder.name
    found, _ = observe(photographs, given.board, masks, None, lambda *done: progress(f"corners in {name}", *done))
    return Seen(found, given.board)


def _chosen(given, depths):
    """The photographs of a set at some depths."""
    if depths is None:
        return given
    missing = [z for z in depths if not np.isclose(given.depths, z).any()]
    if missing:
        raise SetupError(
            f"there is no photograph of the target at {', '.join(f'{z:g}' for z in missing)} mm; there are those at "
            f"{', '.join(f'{z:g}' for z in given.depths)} mm"
        )
    rows = [int(np.argmin(np.abs(given.depths - z))) for z in depths]
    return RenderedSet(
        given.folder, given.board, tuple(given.files[k] for k in rows), tuple(given.poses[k] for k in rows),
        given.depths[rows],
    )  # fmt: skip


def _read_json(path: Path) -> dict[str, Any]:
    try:
        told = json.loads(read_text(path, "JSON file"))
    except ValueError as fault:
        if isinstance(fault, SetupError):
            raise
        raise SetupError(f"{path}: this is not JSON: {fault}") from None
    if not isinstance(told, dict):
        raise SetupError(f"{path}: wanted a JSON object, got {type(told).__name__}")
    return told
