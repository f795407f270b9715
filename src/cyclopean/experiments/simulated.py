"""An experiment without a laboratory: where boards appear through the true setup, by exact projection and noise."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..calibration.prediction import direct_view
from ..errors import SetupError
from ..geometry import Pose
from ..rigs import Setup
from ..targets import DIRECT, Board, Observations, Target
from .experiment import Material, Seen
from .setups import DrawingError, prism_of

_SQUARES = (12, 9)
_SQUARE = 0.0575  # of the picture's width at the middle depth
_OFF_GRID = (0.2, 0.3)  # squares: corners of a centred board would stand on the seams
_LEANS = ((25, 0), (0, 25), (-25, 10), (15, -25), (-15, -20), (20, 20))  # degrees about x and y
_PLACES = ((0, 0), (0.08, 0.05), (-0.08, 0.06), (0.06, -0.07), (-0.06, -0.05))  # of the picture's width
_TURN = 4.0  # degrees in the picture: rows of corners then cross the seams at an angle
_CLEARANCE = 5.0  # mm, from the glass to the nearest point of a board


def synthetic(
    true: Setup,
    depths: Sequence[float],
    *,
    drawing: DrawingError | None = None,
    noise_px: float = 0.05,
    seed: int = 0,
    board: Board | None = None,
    photographs: int = 8,
    board_stays: bool = False,
) -> Material:
    """What an experiment with a setup would have to work from.

    Parameters
    ----------
    true : Setup
        What stands on the bench.
    depths : sequence of T mm
        Known depths of the target, in rising order.
    drawing : DrawingError, optional
        By how much the drawing is wrong; `DrawingError()` where not given.
    noise_px : float
        Standard deviation of each coordinate of a corner, px; 0 for exact corners.
    seed : int
        Of the noise.
    board : Board, optional
        Target and calibration board; `board_for` the setup where not given.
    photographs : int
        Of the board through the optic to calibrate from, and as many without it.
    board_stays : bool
        Whether each calibration photograph is taken twice while the board stands still, without and with the optic:
        virtual cameras are then calibrated in the real camera's frame.

    Raises
    ------
    SetupError
        Depths that are not in order, or where no two views show the target.
    """
    depths = _checked(depths, true)
    if not 0 <= noise_px < np.inf:
        raise SetupError(f"the noise of corners must be 0 px or more, got {noise_px}")
    if photographs < 3:
        raise SetupError(f"calibration wants 3 photographs or more, got {photographs}")
    board = board or board_for(true, depths)
    rng = np.random.default_rng(seed)
    tilted = calibration_poses(true, board, depths, photographs)
    through = observe_boards(true, board, tilted, noise_px, rng, "calibration")
    if board_stays:
        through = _both(through, observe_boards(true, board, tilted, noise_px, rng, "calibration", True))
    return Material(
        true,
        (drawing or DrawingError()).drawn(true),
        Seen(observe_boards(true, board, tilted, noise_px, rng, "camera", True), board),
        Seen(through, board),
        Seen(observe_boards(true, board, target_poses(board, depths), noise_px, rng, "target"), board),
        depths,
    )


def board_for(setup: Setup, depths: Sequence[float] | np.ndarray) -> Board:
    """A chessboard that suits a setup and a range of depths (mm): half the picture at the middle of them."""
    depth = float(np.sqrt(np.min(depths) * np.max(depths)))
    square = _SQUARE * depth * setup.camera.size[0] / setup.camera.focal[0]
    return Board("chessboard", *_SQUARES, float(f"{square:.2g}"))


def target_poses(board: Target, depths: Sequence[float] | np.ndarray) -> list[Pose]:
    """Poses camera_from_board of boards square to the axis, the middle near it, at T depths (mm)."""
    middle = board.points.mean(0)
    off = np.append(np.multiply(_OFF_GRID, getattr(board, "square", 0.0)), 0.0)
    return [Pose(np.eye(3), np.array([0.0, 0.0, depth]) - middle + off) for depth in depths]


def calibration_poses(setup: Setup, board: Target, depths: Sequence[float] | np.ndarray, count: int = 8) -> list[Pose]:
    """Poses camera_from_board of boards that lean all ways, between the nearest and the farthest depth (mm)."""
    middle = board.points.mean(0)
    half = float(np.linalg.norm(np.ptp(board.points, axis=0))) / 2
    apex = prism_of(setup).distance + prism_of(setup).thickness
    poses = []
    for k, depth in enumerate(np.geomspace(np.min(depths), 0.9 * np.max(depths), count)):
        width = depth * setup.camera.size[0] / setup.camera.focal[0]
        room = np.clip((depth - apex - _CLEARANCE) / half, 0.0, 1.0)  # a board near the glass leans less
        lean = np.degrees(np.arcsin(room)) * 0.9
        angles = np.clip(_LEANS[k % len(_LEANS)], -lean, lean)
        turn = Pose.from_rotation_vector(np.deg2rad([*angles, _TURN * (-1) ** k])).rotation
        place = np.array([*np.multiply(_PLACES[k % len(_PLACES)], width), depth])
        poses.append(Pose(turn, place - turn @ middle))
    return poses


def observe_boards(
    setup: Setup,
    board: Target,
    poses: Sequence[Pose],
    noise_px: float,
    rng: np.random.Generator,
    name: str = "photograph",
    direct: bool = False,
) -> Observations:
    """Where the sub-images of a setup show a board in some poses: exact pixels and normally distributed noise.

    Parameters
    ----------
    setup : Setup
    board : Target
        P points, mm.
    poses : sequence of B poses
        camera_from_board of each photograph.
    noise_px : float
        Standard deviation of each coordinate, px.
    rng : numpy Generator
    name : str
        What the photographs are called, with a number.
    direct : bool
        Whether the optic is taken away.

    Returns
    -------
    Observations
        Rows of the points that lie inside each sub-image, its margin left out.
    """
    views = [direct_view(setup)] if direct else list(setup.rig())
    behind = 0.0 if direct else prism_of(setup).distance + prism_of(setup).thickness
    rows: list[tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]] = []
    for k, pose in enumerate(poses):
        points = pose @ board.points
        for number, view in enumerate(views):
            pixels = view.project(points)
            shown = np.flatnonzero(view.region.contains(pixels) & (points[:, 2] > behind))
            views_here = np.full(len(shown), DIRECT if direct else number)
            rows.append((np.full(len(shown), k), views_here, shown, pixels[shown]))
    photo, view_numbers, point, exact = (np.concatenate(part) for part in zip(*rows, strict=True))
    noisy = exact + rng.normal(0.0, noise_px, exact.shape) if noise_px else exact
    names = tuple(f"{name} {k + 1}" for k in range(len(poses)))
    return Observations(photo, view_numbers, point, noisy, names, np.full(len(noisy), noise_px or 0.01))


def _checked(depths, setup):
    """Depths (T,) mm, checked against the prism."""
    depths = np.asarray(depths, dtype=float)
    if depths.ndim != 1 or not depths.size or not np.isfinite(depths).all():
        raise SetupError(f"depths of the target must be numbers of mm such as 600, 700, 800, got {depths}")
    if (np.diff(depths) <= 0).any():
        raise SetupError(f"depths of the target must rise, each once; got {', '.join(f'{z:g}' for z in depths)} mm")
    glass = prism_of(setup).distance + prism_of(setup).thickness + _CLEARANCE
    if depths[0] <= glass:
        raise SetupError(
            f"a target at {depths[0]:g} mm stands before or inside the prism, which ends {glass - _CLEARANCE:.1f} mm "
            "from the pinhole: place it farther away, or ask for a shorter baseline"
        )
    return depths


def _both(through, direct):
    """Photographs of unmoved boards with and without the optic, under the same numbers."""
    parts = {
        key: np.concatenate([getattr(through, key), getattr(direct, key)])
        for key in ("photo", "view", "point", "pixels", "sigma", "channel")
    }
    return Observations(photos=through.photos, **parts)
