"""Cameras to and from the files of other programs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from rich.table import Table

from ..errors import OutputError, SetupError
from ..files import read_setup, write_setup
from ..files.exchange import (
    NamedCamera,
    flipped,
    guess_format,
    read_cameras,
    write_camera,
    write_cameras,
)
from .console import console

if TYPE_CHECKING:
    from ..cameras import Camera
    from ..rigs import Setup


def import_camera(
    file: Path,
    output: Path,
    format: str | None,
    setup_file: Path | None,
    name: str | None,
    size: tuple[int, int] | None,
) -> None:
    """Read a camera from another program's file and write it as TOML; see `cyclopean import`."""
    format = format or guess_format(file)
    cameras = read_cameras(file, format, size)
    named = _chosen(cameras, name, file)
    camera = named.camera
    console.print(
        f"{file}: {format}, {len(cameras)} cameras; taking {named.name}" if len(cameras) > 1 else f"{file}: {format}"
    )
    console.print(
        f"{camera.size[0]} x {camera.size[1]} px, focal length {camera.focal[0]:g}, {camera.focal[1]:g} px, "
        f"centre {camera.centre[0]:g}, {camera.centre[1]:g} px, "
        f"distortion {', '.join(f'{k:g}' for k in camera.distortion)}"
    )
    if setup_file is None:
        write_camera(output, camera, f"{file.name} ({format})")
        console.print(f"-> {output}: add an [optic] table to make it a setup")
        return
    setup = read_setup(setup_file)
    if setup.camera.size != camera.size:
        raise SetupError(
            f"{file}: this camera has {camera.size[0]} x {camera.size[1]} px, the one of {setup_file} "
            f"{setup.camera.size[0]} x {setup.camera.size[1]} px: calibrate at the size that you photograph at"
        )
    camera = replace(camera, pixel_pitch=setup.camera.pixel_pitch)
    write_setup(replace(setup, camera=camera), output)
    console.print(f"-> {output}: {setup_file.name} with this camera")


def _chosen(cameras: Sequence[NamedCamera], name: str | None, file: Path) -> NamedCamera:
    """The camera of a name; without one, the only camera, or the one that all photographs share."""
    names = ", ".join(named.name for named in cameras[:20])
    if name is not None:
        found = next((named for named in cameras if named.name == name), None)
        if found is None:
            raise SetupError(f"{file}: no camera has the name {name!r}; there are {names}")
        return found
    first = cameras[0]
    if any(_numbers(named.camera) != _numbers(first.camera) for named in cameras):
        raise SetupError(f"{file}: the file holds {len(cameras)} cameras; choose one with --camera: {names}")
    return first


def _numbers(camera: Camera) -> tuple[float, ...]:
    return (*camera.size, *camera.lens)


def export_cameras(
    setup_file: Path,
    output: Path,
    format: str | None,
    what: str,
    depths: tuple[float, float] | None,
    views: Sequence[int] | None,
    flip: bool,
    unit_mm: float | None = None,
) -> None:
    """Write a setup's camera, or the virtual cameras of its views, for another program; see `cyclopean export`."""
    setup = read_setup(setup_file)
    _check_pair(setup, output, format, what, views)
    if what == "camera":
        from ..geometry import Pose

        cameras = [NamedCamera("camera", setup.camera, Pose.from_rotation_vector((0.0, 0.0, 0.0)))]
    else:
        cameras = _virtual_cameras(setup, depths, views)
    if flip:
        for named in cameras:
            if named.mirrored:
                console.print(
                    f"note: {named.name}: mirrored; this is the camera of the photograph flipped left to right"
                )
        cameras = [flipped(named) for named in cameras]
    try:
        notes = write_cameras(output, cameras, format, unit_mm)
    except SetupError as fault:
        raise OutputError(str(fault)) from None
    for note in notes:
        console.print(f"note: {note}")
    console.print(f"-> {output}: {', '.join(named.name for named in cameras)}")


def _check_pair(setup: Setup, output: Path, format: str | None, what: str, views: Sequence[int] | None) -> None:
    """Say before the work that MatchID's file wants two views."""
    if format != "matchid" and not (format is None and output.suffix.lower() == ".caldat"):
        return
    pair = "give two views, --what virtual --view 0 --view 1"
    if what == "camera":
        raise SetupError(f"{output}: the matchid format holds two cameras, and the real camera is one: {pair}")
    count = len(views or setup.optic.paths(setup.wavelength_nm))
    if count != 2:
        named = f"--view names {count}" if views else f"the setup has {count} views"
        raise SetupError(f"{output}: the matchid format holds two cameras, but {named}: {pair}")


def _virtual_cameras(
    setup: Setup, depths: tuple[float, float] | None, numbers: Sequence[int] | None
) -> list[NamedCamera]:
    """The pinholes that fit the views best between two depths, and a table of how far they depart from them."""
    from ..rigs.virtual import fit

    rig = setup.rig()
    numbers = numbers or range(len(rig))
    wrong = ", ".join(str(k) for k in numbers if not 0 <= k < len(rig))
    if wrong:
        raise SetupError(f"there is no view {wrong}: the setup has views 0 to {len(rig) - 1}")
    depths = depths if depths is not None else setup.depths or rig.working_depths
    title = f"the pinholes that fit best between {depths[0]:g} and {depths[1]:g} mm"
    table = Table(
        "view", "centre x, y, z (mm)", "departure rms (px)", "largest (px)", title=title, title_justify="left", box=None
    )
    cameras = []
    for k in numbers:
        with console.status(f"fitting view {k}"):
            virtual = fit(rig[k], depths)
        name = f"view_{k}"
        place = ", ".join(f"{value:.2f}" for value in virtual.centre)
        label = f"{name}, {rig[k].name}" + (", mirrored" if virtual.mirrored else "")
        table.add_row(label, place, f"{virtual.departure_rms:.3f}", f"{virtual.departure_max:.3f}")
        cameras.append(NamedCamera(name, virtual.camera, virtual.camera_from_rig, virtual.mirrored))
    console.print(table)
    return cameras
