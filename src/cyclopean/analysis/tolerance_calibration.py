"""What a calibration from photographs of a board leaves of the tolerances, foretold without any photograph."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ..calibration.depths import working_volume
from ..calibration.held import pose_columns, reduce_poses
from ..calibration.physical import default_free
from ..calibration.prediction import Prediction, direct_view
from ..calibration.unknowns import Unknowns
from ..errors import SetupError
from ..geometry import Pose
from ..rigs import Rig, Setup
from ..targets import DIRECT, Board, Observations, Target

_ENOUGH = 6  # points of a view that a detector finds a board by
_WHOLE = ("chessboard", "circles", "asymmetric_circles")  # boards that are found whole or not at all
_COLUMNS, _ROWS = 10, 8  # squares of the usual board
_FILLED = 0.8  # of the common field, by the usual board at middle depth
_SPREAD = 0.3  # of the common field's size, by which boards stand to the side
_DIRECT_FILLED = 0.6  # of the picture, by a board that is photographed without the optic
# Rotation vectors of the boards about x and y, and places across the field, taken one after the other.
_TILTS_DEG = ((25, 0), (0, 25), (-25, 0), (0, -25), (20, 25), (-20, 25), (20, -25), (-20, -25), (0, 0))
_PLACES = ((0, 0), (-1, -1), (1, 1), (1, -1), (-1, 1))


@dataclass(frozen=True, eq=False)
class CalibrationPlan:
    """Photographs of a board that a setup is to be calibrated from."""

    target: Target
    poses: tuple[Pose, ...]  # rig_from_target, of photographs through the optic
    direct_poses: tuple[Pose, ...] = ()  # of photographs without the optic
    sigma: float = 0.02  # px, noise of a corner's coordinate
    free: tuple[str, ...] | None = None  # what is found, as `calibrate` takes it; None: all that has a tolerance

    def __post_init__(self):
        if not (np.isfinite(self.sigma) and self.sigma > 0):
            raise SetupError(f"the noise of corners must be a positive number of px, got {self.sigma}")
        if not (self.poses or self.direct_poses):
            raise SetupError("a calibration needs photographs: give poses of the board")

    @property
    def all_poses(self) -> tuple[Pose, ...]:
        """Those of all photographs, in the order of `observe`."""
        return (*self.poses, *self.direct_poses)

    @property
    def text(self) -> str:
        """The plan in words."""
        board = self.target if isinstance(self.target, Board) else f"target of {len(self.target.points)} points"
        direct = f" and {len(self.direct_poses)} without it" if self.direct_poses else ""
        return f"{len(self.poses)} photographs through the optic{direct} of a {board}, corners to {self.sigma:g} px"


def usual_plan(
    setup: Setup,
    depths: tuple[float, float],
    target: Target | None = None,
    *,
    photos: int = 12,
    direct_photos: int = 0,
    sigma: float = 0.02,
    free: Sequence[str] | None = None,
    rig: Rig | None = None,
) -> CalibrationPlan:
    """A plan as a careful person would make it: the board tilted to all sides, in the middle and aside, near and far.

    Parameters
    ----------
    setup : Setup
        The drawing.
    depths : (2,) mm
        Nearest and farthest depth of use.
    target : Target, optional
        The board; a ChArUco board of 10 x 8 squares that fills most of the common field at middle depth where it is
        not given.
    photos, direct_photos : int
        Photographs through the optic, and without it.
    sigma : float
        Noise of a corner's coordinate, px.
    free : sequence of names, optional
        What the calibration finds.
    rig : Rig, optional
        That of the setup, where there is one already: its regions need not be traced again.

    Returns
    -------
    CalibrationPlan
    """
    for what, count in (("photographs", photos), ("photographs without the optic", direct_photos)):
        if count != int(count) or count < 0:
            raise SetupError(f"the number of {what} must be 0 or more, got {count}")
    fields = _fields(setup.rig() if rig is None else rig, np.geomspace(*depths, 3))
    if target is None:
        target = _usual_board(*fields[1])
    poses = tuple(_pose(target, _place(fields, k), k) for k in range(int(photos)))
    direct = tuple(_pose(target, _direct_place(setup, target, k), k) for k in range(int(direct_photos)))
    return CalibrationPlan(target, poses, direct, sigma, None if free is None else tuple(free))


def _fields(rig, depths):
    """Middle (3,) and size (2,) mm of the common field at each depth."""
    volume = working_volume(rig, depths, 12)
    fields = []
    for points, common in zip(volume.points, volume.common, strict=True):
        if common.any():
            low, high = points[common].min(0), points[common].max(0)
            fields.append(((low + high) / 2, (high - low)[:2]))
    return fields if len(fields) == 3 else [fields[len(fields) // 2]] * 3


def _usual_board(_, size):
    square = _FILLED * min(size[0] / _COLUMNS, size[1] / _ROWS) * 1.5
    square = float(f"{max(square, 0.1):.1g}")
    return Board("charuco", _COLUMNS, _ROWS, square, 0.75 * square, "DICT_5X5_100")


def _place(fields, k):
    middle, size = fields[k % 3]
    aside = np.array(_PLACES[(k // 3) % len(_PLACES)]) * _SPREAD * size
    return middle + np.append(aside, 0.0)


def _direct_place(setup, target, k):
    camera, extent = setup.camera, np.ptp(np.asarray(target.points), axis=0)
    depth = max(camera.focal[i] * extent[i] / (_DIRECT_FILLED * camera.size[i]) for i in range(2))
    depth *= (1.0, 1.2, 1.5)[k % 3]
    middle = camera.rays((np.array(camera.size) - 1) / 2).directions
    aside = np.array(_PLACES[k % len(_PLACES)]) * 0.15 * depth * np.array(camera.size) / camera.focal
    return middle / middle[2] * depth + np.append(aside, 0.0)


def _pose(target, there, k):
    """The target with its middle there (3,), tilted as photograph number k is."""
    points = np.asarray(target.points, dtype=float)
    middle = (points.min(0) + points.max(0)) / 2
    turn = Pose.from_rotation_vector(np.deg2rad([*_TILTS_DEG[k % len(_TILTS_DEG)], 3.0])).rotation
    return Pose(turn, there - turn @ middle)


def observe(
    setup: Setup, plan: CalibrationPlan, rng: np.random.Generator | None = None, rig: Rig | None = None
) -> Observations:
    """The corners that photographs of a plan would show, with noise where a generator is given.

    `rig` is that of the setup, where there is one already.

    Raises
    ------
    SetupError
        When no photograph shows enough of the board in any view.
    """
    points = np.asarray(plan.target.points, dtype=float)
    least = len(points) if getattr(plan.target, "kind", "") in _WHOLE else min(_ENOUGH, len(points))
    through, direct = dict(enumerate(setup.rig() if rig is None else rig)), {DIRECT: direct_view(setup)}
    rows, pixels = [], []
    for photo, pose in enumerate(plan.all_poses):
        views = through if photo < len(plan.poses) else direct
        for number, view in views.items():
            here = view.project(pose @ points)
            inside = view.region.contains(here) if number != DIRECT else view.camera.contains(here)
            shown = np.flatnonzero(inside)
            if len(shown) >= least:
                rows.append(np.stack([np.full_like(shown, photo), np.full_like(shown, number), shown]))
                pixels.append(here[shown])
    if not rows:
        raise SetupError(
            "no photograph of the plan shows enough of the board in any view: is the board too large or too far to "
            "the side? Take a smaller one, or other poses"
        )
    photo, number, point = np.concatenate(rows, axis=1)
    found = np.concatenate(pixels)
    if rng is not None:
        found = found + rng.normal(0.0, plan.sigma, found.shape)
    names = tuple(f"photograph {k}" for k in range(len(plan.all_poses)))
    return Observations(photo, number, point, found, names, np.full(len(found), plan.sigma))


@dataclass(frozen=True, eq=False)
class Remainder:
    """What a calibration leaves, to first order at the drawing.

    The real setup differs from the drawing by `toleranced.matrix[0] @ deviation`. What the calibration finds differs
    from the real setup by `carried @ deviation` and a part by the noise of the corners with covariance `noise`.
    """

    toleranced: Unknowns  # T parameters that differ from the drawing
    found: Unknowns  # S parameters that the calibration finds
    carried: np.ndarray  # (F, T): found minus real, of all parameters of the setup
    noise: np.ndarray  # (F, F), covariance by the noise of the corners
    observations: Observations  # exact corners of the drawing

    @property
    def held(self) -> tuple[str, ...]:
        """Names of parameters with a tolerance that the calibration does not find."""
        found = set(self.found.names)
        return tuple(name for name in self.toleranced.names if name not in found)

    @cached_property
    def noise_root(self) -> np.ndarray:
        """(F, F): its product with independent unit normal numbers has the covariance `noise`."""
        values, vectors = np.linalg.eigh(self._even_noise[0])
        return self._even_noise[1][:, None] * vectors * np.sqrt(np.maximum(values, 0.0))

    @cached_property
    def _even_noise(self):
        scale = np.sqrt(np.maximum(np.diag(self.noise), 1e-300))  # rad, mm and px mix badly
        return self.noise / np.outer(scale, scale), scale


def free_of(plan: CalibrationPlan, toleranced: Sequence[str], setup: Setup, observations: Observations):
    """What the calibration of a plan finds, by name.

    Where the plan does not say: all of the optic that has a tolerance or that `calibrate` finds by itself, and the
    camera where photographs without the optic show it.
    """
    if plan.free is not None:
        return plan.free
    camera = bool(plan.direct_poses)
    usual = default_free(setup, observations)
    return (*usual, *(name for name in toleranced if camera or not name.startswith("camera.")))


def remainder(
    setup: Setup, plan: CalibrationPlan, toleranced: Unknowns, sigmas: np.ndarray, rig: Rig | None = None
) -> Remainder:
    """What a calibration would leave of deviations from the drawing.

    Parameters
    ----------
    setup : Setup
        The drawing.
    plan : CalibrationPlan
        Photographs and what is found from them.
    toleranced : Unknowns
        The T parameters that differ from the drawing.
    sigmas : (T,) array
        Standard deviations of their differences; the calibration is told them.
    rig : Rig, optional
        That of the setup, where there is one already.

    Returns
    -------
    Remainder

    Notes
    -----
    The calibration minimises |J (found - real) - noise|^2 / sigma^2 + |found - drawing|^2 / spread^2 with the poses of
    the board free. With H = J^T J / sigma^2, the poses eliminated, and P = 1 / spread^2, what it finds is the drawing
    plus K (H deviation + J^T noise / sigma^2), K = (H + P)^-1 on the free parameters: its error has a part that
    is carried over from the deviations, which for parameters that are held is large, and one of covariance K H K.

    References
    ----------
    Triggs et al. 2000, Bundle adjustment, a modern synthesis, section 6.1 (elimination of the poses).
    """
    observations = observe(setup, plan, rig=rig)
    names = free_of(plan, toleranced.names, setup, observations)
    known = {name: s for name, s in zip(toleranced.names, sigmas, strict=True) if s > 0}
    found = Unknowns.of([setup], names)
    found = Unknowns.of([setup], names, {name: s for name, s in known.items() if name in found.names})
    information = _information(setup, plan, observations)
    free, real = found.matrix[0], toleranced.matrix[0]
    scale = np.outer(found.spread, found.spread)
    inner = free.T @ information @ free
    gain = np.linalg.inv(inner * scale + np.eye(len(found))) * scale
    to_setup = free @ gain
    carried = to_setup @ free.T @ information @ real - real
    return Remainder(toleranced, found, carried, to_setup @ inner @ to_setup.T, observations)


def _information(setup, plan, observations):
    """Information (F, F) of a plan on all parameters of the setup, the poses of the board eliminated."""
    everything = Unknowns.of([setup], setup.parameter_names)
    rotations = np.array([pose.rotation for pose in plan.all_poses])[observations.photo]
    turned = np.einsum("nij,nj->ni", rotations, np.asarray(plan.target.points, dtype=float)[observations.point])
    points = turned + np.array([pose.translation for pose in plan.all_poses])[observations.photo]
    _, to_all, to_point = Prediction(everything, observations)(everything.start, points, True)
    to_pose = pose_columns(turned, to_point)
    good = np.isfinite(to_all).all((1, 2)) & np.isfinite(to_pose).all((1, 2))
    to_all, to_pose = to_all[good] / plan.sigma, to_pose[good] / plan.sigma
    nothing = np.zeros((len(to_all), 2))
    return reduce_poses(to_all, to_pose, nothing, observations.photo[good])[0]
