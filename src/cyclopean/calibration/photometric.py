"""Corners to a hundredth of a pixel: the whole print around each corner aligned with what the view ought to show."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..errors import SetupError, ShapeError
from ..geometry import Pose
from ..rigs import Setup
from ..targets import DIRECT, Observations
from ..targets.boards import Board
from .least_squares import minimise
from .photometric_picture import Drawing, draw
from .photometric_windows import BLUR, Sheet, grey
from .prediction import direct_view

_PASSES = 4
_SETTLED = 0.005  # px: windows that move less have converged
_SAME_BLUR = 0.02  # px: a change of blur that moves no corner
_DAMPING = 0.7  # the Laplacian of a sampled picture is smaller than the true one, and so overstates the change
_FEWEST = 4  # corners that a view must show


@dataclass(frozen=True, eq=False)
class Refinement:
    """Corners found anew, and how well the photographs resemble the board."""

    observations: Observations  # sigma is that of each corner, from the residual picture around it
    likeness: np.ndarray  # (N,) share of the picture's variance around each corner that the board explains
    blur: np.ndarray  # (B,) px, standard deviation of the lens's point-spread function in each photograph
    added: int  # corners that were not among those given
    lost: int  # corners given that no longer count
    notes: tuple[str, ...] = ()


@dataclass(frozen=True, eq=False)
class BoardPose:
    """Where a rigid flat board stands, from one photograph."""

    pose: Pose  # rig_from_target; NaN where it was not found
    covariance: np.ndarray  # (6, 6) of rotation (rad, in the rig's frame) and translation (mm)
    rms: float  # px, of the corners' coordinates
    likeness: float  # median share of the picture's variance that the board explains
    observations: Observations
    converged: bool
    message: str


def refine(
    photographs: Sequence[np.ndarray],
    observations: Observations,
    board: Board,
    setup: Setup,
    poses: Sequence[Pose],
    *,
    window: float = 1.0,
    drawing: Drawing | None = None,
    complete: bool = True,
) -> Refinement:
    """Find corners anew from the whole picture around them.

    In a window around each corner, the photograph is compared with the board's print as the calibrated view ought
    to show it; the shift between the two says where the corner is. The print is first moved to where the
    corners given say it is, by a smooth field of shifts in each view, so that a wrong calibration does not pull.

    Parameters
    ----------
    photographs : sequence of (H, W) or (H, W, 3) arrays
        In the order of `observations.photos`, which the corners given number; linear or not, of any depth.
    observations : Observations
        Corners found in each view, by a detector. Of colour channels, all are aligned in the luminance.
    board : Board
        A chessboard or ChArUco board.
    setup : Setup
        Roughly calibrated (some pixels).
    poses : sequence of poses
        rig_from_target of each photograph.
    window : float
        Side of the windows, in squares. With 1, they touch, and the noise of neighbours is independent; larger
        ones share pixels, which lowers the noise of each corner and not that of a calibration.
    drawing : Drawing, optional
        What was printed, to the last texel (`Drawing.from_image`): the markers' edges then count as well. Without
        it they do not, as programs that draw in whole texels put each marker elsewhere, by up to half a texel.
    complete : bool
        Whether to add corners that were not given.

    Returns
    -------
    Refinement
        Corners that do not look like the board are left out.

    Raises
    ------
    SetupError, ImageError
        When board, photographs, poses or observations do not belong together.

    References
    ----------
    Lucas and Kanade 1981, An iterative image registration technique. Baker and Matthews 2004, Lucas-Kanade 20
    years on, IJCV 56(3). White 1980, Econometrica 48(4): covariance from the residuals of each group of pixels.
    """
    _check(photographs, observations, board, poses, window)
    given = draw(board, markers=False) if drawing is None else drawing
    views = {DIRECT: direct_view(setup), **dict(enumerate(setup.rig()))}
    pictures = [grey(photograph, setup.camera.size) for photograph in photographs]
    sheets = []
    for photo, number in np.unique(np.stack([observations.photo, observations.view], -1), axis=0):
        mine = (observations.photo == photo) & (observations.view == number)
        if mine.sum() < _FEWEST:
            continue
        sheet = Sheet(pictures[photo], views[int(number)], poses[photo], board, int(photo), int(number))
        sheet.follow(observations.point[mine], observations.pixels[mine], np.full(mine.sum(), 0.05))
        sheets.append(sheet)
    blur = np.full(len(photographs), BLUR)
    _settle(sheets, given, blur, window, drawing is not None)
    return _collect(sheets, observations, blur, complete)


def align(
    photograph: np.ndarray,
    board: Board,
    setup: Setup,
    pose: Pose,
    *,
    drawing: Drawing | None = None,
) -> BoardPose:
    """Find the pose of a flat board from its picture in all views at once.

    Parameters
    ----------
    photograph : (H, W) or (H, W, 3) array
        Shows the board in some views.
    board : Board
        A chessboard or ChArUco board.
    setup : Setup
        Calibrated.
    pose : Pose
        rig_from_target, right to about a fifth of a square.
    drawing : Drawing, optional
        What was printed, as in `refine`.

    Returns
    -------
    BoardPose
        NaN, not converged and with the reason, where the photograph does not look like the board.
    """
    if not np.isfinite(pose.translation).all():
        raise SetupError("the pose to start from is not a number: detect the board first")
    given = draw(board, markers=False) if drawing is None else drawing
    picture = grey(photograph, setup.camera.size)
    sheets = [Sheet(picture, view, pose, board, 0, number) for number, view in enumerate(setup.rig())]
    sheets = [sheet for sheet in sheets if sheet.points.size]
    blur = np.full(1, BLUR)
    whole = draw(board) if drawing is None else drawing
    for coarse in (0.2, 0.07):  # of a square: the more both pictures are blurred, the larger a shift is caught
        for sheet in sheets:
            sheet.run(whole, blur[0], 2.0, True, coarse)
    _settle(sheets, given, blur, 1.0, drawing is not None)
    nothing = Observations(*(np.zeros(0, int),) * 3, np.zeros((0, 2)), ("photograph",))
    found = _collect(sheets, nothing, blur, True)
    return _fit_pose(found, board, setup, pose)


def _check(photographs, observations, board, poses, window):
    count = len(observations.photos)
    if not len(photographs) == len(poses) == count:
        raise ShapeError(
            f"one photograph and one pose for each of the {count} photographs of the observations are needed, got "
            f"{len(photographs)} and {len(poses)}"
        )
    if not 0.3 <= window <= 10:
        raise ShapeError(f"window is the side of the windows in squares, 0.3 to 10, got {window}")
    if len(observations) and observations.point.max() >= len(board.points):
        raise SetupError(
            f"the board has points 0 to {len(board.points) - 1}, but the observations name point "
            f"{observations.point.max()}: is it the right board?"
        )


def _settle(sheets, drawing, blur, window, markers):
    """Measure windows that touch, move the print with them, and again until it stays; then those wanted."""
    for photo in range(len(blur)):
        mine = [sheet for sheet in sheets if sheet.photo == photo]
        for _ in range(_PASSES):
            for sheet in mine:
                sheet.run(drawing, blur[photo], 1.0, markers)
            wider = [sheet.widening for sheet in mine if np.isfinite(sheet.widening)]
            before = blur[photo]
            if wider:
                blur[photo] = np.sqrt(np.clip(before**2 + _DAMPING * np.median(wider), 0.01, 9.0))
            if abs(blur[photo] - before) < _SAME_BLUR and all(sheet.moved < _SETTLED for sheet in mine):
                break
        if window != 1:
            for sheet in mine:
                sheet.run(drawing, blur[photo], window, markers)


def _collect(sheets, observations, blur, complete):
    """The windows' corners as observations, beside those that were given."""
    key = len(sheets[0].board.points) if sheets else 1

    def keys(photo, view, point):
        return (np.asarray(photo) * 1000 + view + 1) * key + point

    before = keys(observations.photo, observations.view, observations.point)
    empty = (np.zeros(0, int), np.zeros(0, int), np.zeros(0, int), np.zeros((0, 2)), np.zeros(0), np.zeros(0))
    rows = [empty, *(sheet.rows() for sheet in sheets)]
    photo, view, point, pixels, sigma, likeness = (np.concatenate(column) for column in zip(*rows, strict=True))
    known = np.isin(keys(photo, view, point), before)
    keep = known | complete
    found = Observations(photo[keep], view[keep], point[keep], pixels[keep], observations.photos, sigma[keep])
    lost = int((~np.isin(before, keys(photo, view, point))).sum())
    notes = []
    if lost:
        notes.append(f"{lost} of {len(before)} corners do not look like the board, or lie at a view's border")
    return Refinement(found, likeness[keep], blur, int((keep & ~known).sum()), lost, tuple(notes))


def _fit_pose(found, board, setup, pose):
    observations = found.observations
    nowhere = Pose(np.full((3, 3), np.nan), np.full(3, np.nan))

    def failed(reason):
        return BoardPose(nowhere, np.full((6, 6), np.nan), np.nan, np.nan, observations, False, reason)

    if len(observations) < 2 * _FEWEST:
        return failed(
            f"only {len(observations)} corners of the photograph look like the board: is the board in the picture, "
            "and the start right to a fifth of a square?"
        )
    views = {number: view.unbounded() for number, view in enumerate(setup.rig())}

    def predict(_, points, jacobian):
        pixels, slope = np.full((len(points), 2), np.nan), np.full((len(points), 2, 3), np.nan)
        for number, view in views.items():
            mine = observations.view == number
            derivatives = view.pixel_derivatives(points[mine])
            pixels[mine], slope[mine] = derivatives.pixels, derivatives.to_point
        return pixels, np.zeros((len(points), 2, 0)), slope

    solution = minimise(predict, np.zeros(0), [pose], observations, board.points[observations.point])
    if not solution.converged:
        return failed(f"the pose did not converge: {solution.message}")
    if not solution.rms < 0.5:
        return failed(f"the corners contradict a flat board by {solution.rms:.2f} px: is the calibration right?")
    likeness = float(np.median(found.likeness))
    covariance = solution.pose_covariance[0]
    return BoardPose(solution.poses[0], covariance, solution.rms, likeness, observations, True, "converged")
