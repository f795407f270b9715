"""From photographs of a board to a calibrated setup."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ..errors import CalibrationError, CyclopeanError, ImageError, SetupError
from ..files import output_folder, read_board, read_observations, read_setup, write_observations, write_setup
from ..files.calibrations import write_calibration
from ..files.cameras import read_camera
from ..targets import DIRECT, Board, Observations, Target
from ..targets.observations import together
from .calibration_photographs import (
    Pictures,
    clear_of_seams,
    detect,
    find_files,
    named,
    read_pictures,
    seams_moved,
)
from .calibration_request import Request, check, check_names, free_names, parse_tolerances
from .console import console, counted, naming, progress_bars

if TYPE_CHECKING:
    from ..calibration.physical import Calibration
    from ..cameras import Camera
    from ..rigs import Setup

_FIRST_MARGIN = 0.02  # of the picture's width: nearer to the drawing's seams, a first calibration trusts no corner
_SETTLED = 1.0  # px by which seams may move without another look at the photographs
_SEARCHED = 8  # photographs that are searched for seams where the drawing is of no help
_ABSURD = 1.0  # px rms: residuals that no lens explains
_LOOKS = 2  # more looks at the photographs than the first


class NothingFound(ImageError):
    """No sub-image shows the board; `look` looks again, with other sub-images."""

    def __init__(self, message: str, pictures: Pictures, look: Callable[..., Evidence]):
        super().__init__(message)
        self.pictures, self.look = pictures, look


@dataclass(frozen=True, eq=False)
class Evidence:
    """What there is to calibrate from, and how to look at it again."""

    found: Observations  # through the optic and without it
    target: Target  # that `found` numbers the points of
    notes: list[str]  # of the detector
    look: Callable[[np.ndarray, Sequence[bool]], Evidence] | None  # again, with other sub-images; None for a CSV file
    pictures: Pictures | None = None  # through the optic


def run_calibration(request: Request) -> None:
    """Detect, calibrate, judge and write; see `cyclopean calibrate`.

    Raises
    ------
    CalibrationError
        When the calibration cannot be right: everything is written then, the setup under another name.
    """
    from .calibration_failure import as_failed, failure_message, failure_of, numbered_otherwise

    started = time.perf_counter()
    check(request)
    board = read_board(request.board)
    camera = read_camera(request.camera) if request.camera else None
    drawn = _drawn_setup(request, camera)
    for path in (*request.outputs, *([request.save_corners] if request.save_corners else [])):
        output_folder(path.absolute().parent)
    output_folder(request.folder)
    with progress_bars() as progress:
        if drawn is not None:
            evidence, calibration = from_drawing(request, board, drawn, progress)
        else:
            evidence, calibration = _without_drawing(request, board, camera, progress)
    reason = failure_of(calibration)
    if not reason:
        _deliver(request, evidence, calibration, drawn, started)
        return
    hints = []
    if request.corners is not None and drawn is not None:
        with console.status("trying other numberings of the views"):
            hints = list(filter(None, [numbered_otherwise(calibration)]))
    request = as_failed(request)
    warning = f"the calibration failed, nothing below is to be relied on: {reason}"
    calibration = replace(calibration, notes=(warning, *hints, *calibration.notes))
    _deliver(request, evidence, calibration, drawn, started)
    raise CalibrationError(failure_message(request, reason, hints))


def _deliver(request, evidence, calibration, drawn, started) -> None:
    """Write the results, judge them, and write the report."""
    from .calibration_report import judge, say_calibration, write_findings

    folder = request.folder
    for path in (folder / "corners.csv", *([request.save_corners] if request.save_corners else [])):
        write_observations(path, evidence.found)
    for path, setup in zip(request.outputs, calibration.setups, strict=True):
        write_setup(setup if request.depths is None else replace(setup, depths=request.depths), path)
    write_calibration(folder / "calibration.json", calibration)
    (folder / "report.html").unlink(missing_ok=True)  # an older one would not belong to these results
    say_calibration(request, calibration, evidence.notes, time.perf_counter() - started)
    with naming([*request.outputs, folder / "corners.csv", folder / "calibration.json"]):
        with progress_bars() as progress:
            findings = judge(request, calibration, evidence.notes, progress, drawn)
        with console.status("drawing the report"):
            write_findings(request, findings)
    console.print(f"-> {', '.join(map(str, request.outputs))}, report in {folder}/report.html")


def _drawn_setup(request, camera) -> Setup | None:
    if request.setup is None:
        return None
    setup = read_setup(request.setup)
    if camera is not None:
        if camera.size != setup.camera.size:
            raise SetupError(
                f"{request.camera}: this camera has {camera.size[0]} x {camera.size[1]} px, the one of {request.setup} "
                f"{setup.camera.size[0]} x {setup.camera.size[1]} px: calibrate at the size that you photograph at"
            )
        setup = replace(setup, camera=camera)
    return setup


def from_drawing(request, board, drawn: Setup, progress) -> tuple[Evidence, Calibration]:
    """Look at the photographs where a drawing puts the sub-images, and calibrate from what they show.

    Parameters
    ----------
    request : Request
    board : Target
        The known object, as its file says.
    drawn : Setup
        The start.
    progress : callable
        Called as ``progress(what, done, total)``.

    Returns
    -------
    Evidence, Calibration

    Raises
    ------
    ImageError
        When no photograph shows the board, with the drawing's sub-images or with those that its seams give.
    SetupError
        When the request does not fit the drawing, or the photographs show another number of sub-images.
    """
    check_names(request, drawn)
    rig = drawn.rig()
    mirrored = [view.mirrored for view in rig]
    size = drawn.camera.size
    masks = rig.masks
    try:
        evidence = _evidence(request, board, size, lambda pictures: masks, mirrored, progress)
    except NothingFound as fault:  # the drawing may be far off, or of another optic
        masks = _found_sub_images(rig, fault, progress)
        evidence = fault.look(masks, mirrored)
    evidence, calibration = _settle(request, evidence, (drawn,) * len(request.channels), masks)
    if evidence.pictures is not None and not calibration.rms < _ABSURD:
        seams = _seams_of(evidence.pictures, progress)
        if seams.trusted and len(seams) != len(rig):
            calibration = replace(calibration, notes=(_other_count(seams, rig), *calibration.notes))
    return evidence, calibration


def _found_sub_images(rig, fault: NothingFound, progress) -> np.ndarray:
    """Masks (V, H, W) of the views of a rig by the seams in the photographs; raises `fault` where there are none."""
    from ..targets.seams import reconcile

    console.print("no board where the setup puts the sub-images: searching for their seams")
    seams = _seams_of(fault.pictures, progress)
    if not seams.trusted:
        raise fault
    if len(seams) != len(rig):
        raise SetupError(f"no board was found: {_other_count(seams, rig)}")
    return seams.masks()[np.argsort(reconcile(seams, rig).order)]


def _seams_of(pictures: Pictures, progress):
    from ..targets.seams import find_seams

    return find_seams(list(pictures.images[:: max(1, len(pictures.images) // _SEARCHED)]), progress=progress)


def _other_count(seams, rig):
    return (
        f"the photographs seem to show {len(seams)} sub-images, but the setup has {len(rig)} views: is the number of "
        "facets right?"
    )


def _without_drawing(request, board, camera, progress) -> tuple[Evidence, Calibration]:
    """Find the sub-images and a prism that explains them, then calibrate as from a drawing."""
    from ..calibration.guess import guess_prism
    from ..calibration.unknowns import TIED_FOCAL

    size = camera.size if camera is not None else None

    def sub_images(pictures):
        from ..targets.seams import find_seams

        seams = find_seams(list(pictures.images), request.facets, progress=progress)
        if seams.message:
            console.print(f"warning: {seams.message}", style="yellow")
        return seams.masks()

    evidence = _evidence(request, board, size, sub_images, None, progress)
    free: tuple[str, ...] = ("optic.thickness",)  # nobody knows it
    if camera is None:
        camera, guessed = _first_camera(evidence)
        free += (TIED_FOCAL,) if guessed else ()
        how = "guessed from the sub-images" if guessed else "from the camera photographs"
        console.print(f"camera for the start, {how}: focal length {camera.focal[0]:.0f} px")
    glass = request.glass or "N-BK7"
    setup, found = guess_prism(
        evidence.found, evidence.target, camera, request.facets, _number_or_name(glass), progress=progress
    )
    optic: Any = setup.optic
    console.print(
        f"prism for the start: facets to the {optic.facing}, {optic.apex_deg:.2f} deg, {optic.distance:.1f} mm away; "
        f"glass {glass} was assumed"
    )
    evidence = replace(evidence, found=found)
    return _settle(request, evidence, (setup,) * len(request.channels), None, free)


def _number_or_name(glass: str) -> str | float:
    try:
        return float(glass)
    except ValueError:
        return glass


def _first_camera(evidence: Evidence) -> tuple[Camera, bool]:
    """A camera to start from, and whether it is no more than a guess: each sub-image taken as a picture of its own."""
    from ..calibration.zhang import zhang

    assert evidence.pictures is not None  # check
    size, found, target = evidence.pictures.size, evidence.found, evidence.target
    if np.any(found.view == DIRECT):
        return zhang(found, target, size, 4).camera, False
    guesses = []
    for view in np.unique(found.view):
        try:
            guess = zhang(found, target, size, 0, view=int(view), free_centre=False, free_aspect=False)
        except CyclopeanError:
            continue
        if guess.converged:
            guesses.append(guess.camera)
    if not guesses:
        raise SetupError(
            "these photographs do not tell the camera's focal length: give --camera or --camera-photos, or more "
            "photographs with the board tilted by 20 to 40 degrees"
        )
    return sorted(guesses, key=lambda camera: camera.focal[0])[len(guesses) // 2], True


def _evidence(request, board, size, sub_images, mirrored, progress) -> Evidence:
    """Read and look at everything once; `sub_images` gives the masks."""
    if request.corners is not None:
        return Evidence(_read_corners(request.corners, board, size), board, [], None)
    board = _findable(board, request.board)
    pictures, direct, camera_board = _photographs(request, board, size, progress)
    looks = 0

    def look(masks, mirrored):
        nonlocal looks
        looks += 1
        what = "board in the sub-images" + (f", look {looks}" if looks > 1 else "")
        found, notes = detect(pictures, board, masks, mirrored, request.channels, progress, what)
        target: Target = board
        if direct is not None:
            if board == camera_board:
                found = Observations.join([found, direct[0]])
            else:
                found, target = together([(found, board), (direct[0], camera_board)])
            notes = notes + direct[1]
        return Evidence(found, target, notes, look, pictures)

    masks = sub_images(pictures)
    try:
        return look(masks, mirrored)
    except ImageError as fault:
        raise NothingFound(str(fault), pictures, look) from None


def _photographs(request, board, size, progress):
    """Pictures through the optic; what those without it show (or None), and the board in them."""
    camera_board = board if request.camera_board is None else read_board(request.camera_board)
    camera_board = _findable(camera_board, request.camera_board)
    files, remarks = find_files(request.photos, "PHOTOS")
    pictures, copies = read_pictures(files, size, (), progress)
    remarks += copies
    for channel in request.channels:
        pictures.of_channel(channel)  # grey photographs have none: said before the work
    direct = None
    if request.camera_photos:
        files, more = find_files(request.camera_photos, "--camera-photos")
        bare, copies = read_pictures(files, pictures.size, pictures.names, progress, "reading camera photographs")
        remarks += more + copies
        try:
            direct = detect(bare, camera_board, None, None, request.channels, progress, "board without the optic")
        except ImageError as fault:
            raise named("--camera-photos", fault) from None
    for remark in remarks:
        console.print(f"note: {remark}", style="yellow")
    return pictures, direct, camera_board


def _read_corners(path: Path, board: Target, size: tuple[int, int]) -> Observations:
    found = read_observations(path, board)
    outside = ~((found.pixels > -0.5) & (found.pixels < np.array(size) - 0.5)).all(-1)
    if outside.any():
        x, y = found.pixels[outside][0]
        raise SetupError(
            f"{path}: {counted(int(outside.sum()), 'corner')} outside a picture of {size[0]} x {size[1]} px, "
            f"such as ({x:.1f}, {y:.1f}): is it the right setup, or were the photographs scaled?"
        )
    return found


def _findable(board: Target, path: Path) -> Board:
    if not isinstance(board, Board):
        raise SetupError(f"{path}: points in space cannot be found in photographs; give their pixels as --corners")
    return board


def _settle(request, evidence, setups, masks, free_too=()) -> tuple[Evidence, Calibration]:
    """Calibrate, and look again with the calibrated sub-images until their seams stay; `masks` None: not drawn."""
    from ..calibration.physical import calibrate
    from ..calibration.unknowns import Unknowns

    free = free_names(request, setups[0], evidence.found, free_too)
    tolerances = parse_tolerances(request.tolerance, setups[0])
    if "optic.thickness" in free_too and "optic.thickness" in Unknowns.of(setups, free).names:
        tolerances = {"optic.thickness": setups[0].optic.thickness} | tolerances

    def fit(observations):
        return calibrate(observations, evidence.target, setups, free, tolerances=tolerances)

    margin = _FIRST_MARGIN * setups[0].camera.size[0]
    found = evidence.found
    calibration = fit(found if evidence.look is None else clear_of_seams(found, setups[0].rig(), margin))
    for _ in range(_LOOKS if evidence.look is not None else 0):
        try:
            rig = calibration.setup.rig()
            there = rig.masks
        except CyclopeanError:  # the checks will say what cannot be right
            break
        moved = float("inf") if masks is None else seams_moved(masks, there)
        if moved > _SETTLED:
            if masks is not None:
                console.print(f"the seams lie up to {moved:.0f} px from where they were expected: looking again")
            try:
                masks, evidence = there, evidence.look(there, [view.mirrored for view in rig])
            except ImageError:  # it went astray: better the first look than none
                break
        calibration = fit(evidence.found)
        if moved <= _SETTLED:
            break
    return evidence, calibration
