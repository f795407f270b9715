"""Bundle adjustment: Levenberg-Marquardt that eliminates the pose of the target in each photograph."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple, Protocol

import numpy as np

from ..errors import SetupError
from ..geometry import Pose, launch, rotation_from_vector
from ..targets import Observations

_FLOOR = 1e-3  # of sigma: residuals below are rounding, and must not make every other one an outlier
_LOST = 10.0  # thresholds: what a point that left its view costs
_RAYLEIGH_MEDIAN = 1.1774  # median length of a 2-vector of unit normal deviates


class Predict(Protocol):
    """Pixels (N, 2) of points (N, 3) mm in the rig's frame, with derivatives to shared (N, 2, S) and point (N, 2, 3).

    Row i belongs to observation i. NaN where a point cannot be seen. Without `jacobian` the derivatives are None.
    """

    def __call__(
        self, shared: np.ndarray, points: np.ndarray, jacobian: bool
    ) -> tuple[np.ndarray, np.ndarray | None, np.ndarray | None]: ...


@dataclass(frozen=True, eq=False)
class Solution:
    """The most likely parameters, and what the observations say about them."""

    shared: np.ndarray  # (S,)
    poses: tuple[Pose, ...]  # rig_from_target of each photograph
    residuals: np.ndarray  # (N, 2) px, observed - predicted; NaN where the point could not be seen
    weights: np.ndarray  # (N,) of the robust loss: 1 trusted, towards 0 an outlier
    sigma0: float  # what the stated sigmas of the pixels must be multiplied by to explain the residuals
    information: np.ndarray  # (S, S), of the photographs alone, poses eliminated, scaled by sigma0
    covariance: np.ndarray  # (S, S), with the prior
    pose_covariance: np.ndarray  # (B, 6, 6) of rotation (rad, in the rig's frame) and translation (mm)
    converged: bool
    message: str
    iterations: int
    costs: tuple[float, ...] = field(default=(), repr=False)

    @property
    def rms(self) -> float:
        """Root mean square of the residuals' coordinates, px, outliers included."""
        return float(np.sqrt(np.nanmean(self.residuals**2)))


class _State(NamedTuple):
    shared: np.ndarray
    rotations: np.ndarray  # (B, 3, 3)
    translations: np.ndarray  # (B, 3)


class _Normal(NamedTuple):
    """Blocks of the normal equations: shared (S, S), cross (B, S, 6), poses (B, 6, 6) and the gradients."""

    shared: np.ndarray
    cross: np.ndarray
    poses: np.ndarray
    shared_gradient: np.ndarray
    pose_gradient: np.ndarray


def minimise(
    predict: Predict,
    shared: np.ndarray,
    poses: Sequence[Pose],
    observations: Observations,
    points: np.ndarray,
    *,
    prior: tuple[np.ndarray, np.ndarray] | None = None,
    loss: str = "huber",
    threshold: float = 3.0,
    iterations: int = 60,
    tolerance: float = 1e-9,
) -> Solution:
    """Parameters and target poses that explain observed pixels best.

    Parameters
    ----------
    predict : callable
        The model; see `Predict`.
    shared : (S,) array
        Start values of the parameters that all photographs share; S may be 0.
    poses : sequence of B poses
        Start values of rig_from_target for each photograph.
    observations : Observations
        N rows.
    points : (N, 3) array
        The target's point of each row, mm, in the target's frame.
    prior : (mean (S,), sigma (S,)), optional
        Gaussian knowledge about the shared parameters; infinite sigma for none.
    loss : "huber", "cauchy" or "none"
        How residuals beyond the threshold count.
    threshold : float
        In standard deviations, which are estimated from the residuals themselves (median absolute deviation).
    iterations : int
        At most so many evaluations of the derivatives.
    tolerance : float
        Stop when a step lowers the cost by less than this fraction.

    Returns
    -------
    Solution

    References
    ----------
    Triggs, McLauchlan, Hartley, Fitzgibbon 2000, Bundle adjustment, a modern synthesis, sections 4 and 6: Schur
    complement of the poses. Holland and Welsch 1977: iteratively reweighted least squares.
    """
    if loss not in _WEIGHTS:
        raise SetupError(f"loss must be one of {', '.join(_WEIGHTS)}, got {loss!r}")
    return _Solver(predict, observations, np.asarray(points, dtype=float), prior, loss, threshold, tolerance).solve(
        np.asarray(shared, dtype=float), poses, iterations
    )


def _huber(ratio):
    return np.minimum(1.0, 1 / np.maximum(ratio, 1e-300))


def _huber_cost(ratio):
    return np.where(ratio < 1, ratio**2, 2 * ratio - 1)


_WEIGHTS: dict[str, tuple[Callable, Callable]] = {  # of |residual| / threshold: weight, cost
    "huber": (_huber, _huber_cost),
    "cauchy": (lambda ratio: 1 / (1 + ratio**2), lambda ratio: np.log1p(ratio**2)),
    "none": (np.ones_like, np.square),
}


class _Solver:
    """The parts of one minimisation that do not change while it runs."""

    def __init__(self, predict, observations, points, prior, loss, threshold, tolerance):
        self.predict, self.observed, self.points = predict, observations.pixels, points
        self.sigma, self.photo = observations.sigma, observations.photo
        self.count = len(observations.photos)
        order = np.argsort(self.photo, kind="stable")
        edges = np.searchsorted(self.photo[order], np.arange(self.count + 1))
        self.order, self.edges, self.filled = order, edges, np.flatnonzero(np.diff(edges))
        self.starts = edges[:-1][self.filled]
        self.prior, self.loss, self.threshold, self.tolerance = prior, loss, threshold, tolerance

    def solve(self, shared, poses, iterations):
        state = _State(
            shared.copy(), np.array([p.rotation for p in poses]), np.array([p.translation for p in poses], dtype=float)
        )
        used, converged, message = 0, False, ""
        costs: list[float] = []
        scale = np.inf
        for _ in range(10):  # the scale of the residuals and the fit depend on each other
            new = self.scale(self.residuals(state)[0])
            if converged and abs(new - scale) < 0.02 * scale:
                break
            scale = new
            state, spent, converged, message, trace = self.descend(state, scale, iterations - used)
            used, costs = used + spent, [*costs, *trace]
            if self.loss == "none" or used >= iterations:
                break
        return self.finish(state, scale, converged, message, used, costs)

    def rig_points(self, state):
        """The target's points (N, 3) in the rig's frame, and without the translation."""
        turned = np.einsum("nij,nj->ni", state.rotations[self.photo], self.points)
        return turned + state.translations[self.photo], turned

    def residuals(self, state, jacobian=False):
        """Residuals (N, 2) in units of their sigma, with derivatives to shared (N, 2, S) and pose (N, 2, 6)."""
        points, turned = self.rig_points(state)
        pixels, to_shared, to_point = self.predict(state.shared, points, jacobian)
        miss = (self.observed - pixels) / self.sigma[:, None]
        if not jacobian:
            return miss, None, None
        to_pose = np.empty((len(miss), 2, 6))
        to_pose[..., :3] = np.cross(turned[:, None, :], to_point)  # a rotation vector w moves x by w x x
        to_pose[..., 3:] = to_point
        weight = 1 / self.sigma[:, None, None]
        return miss, to_shared * weight, to_pose * weight

    def scale(self, miss):
        """Robust standard deviation of a residual's coordinate in units of its sigma."""
        if self.loss == "none":
            return 1.0
        length = np.linalg.norm(miss, axis=-1)
        length = length[np.isfinite(length)]
        return max(float(np.median(length)) / _RAYLEIGH_MEDIAN, _FLOOR) if length.size else 1.0

    def weigh(self, miss, scale):
        """Weights (N,) of the rows, 0 where lost, and the robust cost."""
        weight, cost = _WEIGHTS[self.loss]
        ratio = np.linalg.norm(miss, axis=-1) / (self.threshold * scale)
        seen = np.isfinite(ratio)
        ratio = np.where(seen, ratio, _LOST)
        total = (self.threshold * scale) ** 2 * float(np.sum(cost(ratio)))
        return np.where(seen, weight(ratio), 0.0), total

    def prior_cost(self, shared, scale):
        if self.prior is None or not shared.size:
            return 0.0
        return scale**2 * float(np.sum(((shared - self.prior[0]) / self.prior[1]) ** 2))

    def descend(self, state, scale, iterations):
        """Levenberg-Marquardt at a fixed scale of the residuals."""
        damping = 1e-4
        costs: list[float] = []
        miss, to_shared, to_pose = self.residuals(state, True)
        weights, cost = self.weigh(miss, scale)
        cost += self.prior_cost(state.shared, scale)
        spent = 1
        while True:
            costs.append(cost)
            normal = self.normal(state, miss, to_shared, to_pose, weights, scale)
            while damping < 1e12:
                factors = _Factors(normal, damping)
                step = factors.solve(normal.shared_gradient, normal.pose_gradient)
                promised = _promised(normal, *step)
                if promised <= 0.01 * self.tolerance * max(cost, 1e-12):
                    return state, spent, True, "converged", costs
                bent = self.bend(state, miss, to_shared, to_pose, weights, factors, step)
                trial, trial_cost = min(
                    (self.tried(state, try_step, scale) for try_step in (bent, step) if try_step is not None),
                    key=lambda tried: tried[1],
                )
                if trial_cost < cost:
                    break
                damping *= 6
            else:
                return state, spent, False, "no step makes the residuals smaller", costs
            gain = (cost - trial_cost) / promised
            damping = max(damping * (0.1 if gain > 0.5 else 1.0), 1e-15)
            done = cost - trial_cost < self.tolerance * cost
            state, cost = trial, trial_cost
            if spent >= iterations:
                return state, spent, False, f"not converged after {spent} iterations", costs
            if done:
                return state, spent, True, "converged", [*costs, cost]
            miss, to_shared, to_pose = self.residuals(state, True)
            weights = self.weigh(miss, scale)[0]
            spent += 1

    def tried(self, state, step, scale):
        """The state after a step, and its cost; infinite where that is not a number."""
        trial = _moved(state, *step)
        cost = self.weigh(self.residuals(trial)[0], scale)[1] + self.prior_cost(trial.shared, scale)
        return trial, cost if np.isfinite(cost) else np.inf

    def bend(self, state, miss, to_shared, to_pose, weights, factors, step):
        """The step bent along the valley (geodesic acceleration); None where it would bend too far to be trusted.

        Transtrum and Sethna 2012, Improvements to the Levenberg-Marquardt algorithm, section 4.
        """
        if not len(step[0]):  # a pose alone is hardly curved
            return None
        ahead = self.residuals(_moved(state, 0.1 * step[0], 0.1 * step[1]))[0]
        # einsum, not @: threads of BLAS and of compiled kernels get in each other's way
        along = np.einsum("nij,j->ni", to_shared, step[0]) + np.einsum("nij,nj->ni", to_pose, step[1][self.photo])
        curved = 20 * ((ahead - miss) / 0.1 + along)
        seen = np.isfinite(curved) & (weights > 0)[:, None]
        curved = np.where(seen, curved, 0.0) * (0.5 * weights[:, None])
        shared = np.einsum("nij,ni->j", np.where(seen[..., None], to_shared, 0.0), curved)
        pulls = np.einsum("nij,ni->nj", np.where(seen[..., None], to_pose, 0.0), curved)
        poses = np.zeros((self.count, 6))
        poses[self.filled] = np.add.reduceat(pulls[self.order], self.starts)
        turn = factors.solve(shared, poses)
        if factors.length(*turn) > 0.375 * factors.length(*step):
            return None
        return step[0] + turn[0], step[1] + turn[1]

    def normal(self, state, miss, to_shared, to_pose, weights, scale):
        """Normal equations of the weighted rows, photograph by photograph."""
        from .kernels import grams

        size = state.shared.size
        blocks = np.empty((self.count, size + 7, size + 7))
        launch(grams, len(miss), self.order, self.edges, weights, to_shared, to_pose, miss, blocks)
        total, total_gradient = blocks[:, :size, :size].sum(0), blocks[:, :size, -1].sum(0)
        if self.prior is not None and size:
            mean, sigma = self.prior
            total[np.diag_indices(size)] += scale**2 / sigma**2
            total_gradient += scale**2 * (mean - state.shared) / sigma**2
        poses = slice(size, size + 6)
        return _Normal(total, blocks[:, :size, poses], blocks[:, poses, poses], total_gradient, blocks[:, poses, -1])

    def finish(self, state, scale, converged, message, used, costs):
        miss, to_shared, to_pose = self.residuals(state, True)
        weights, _ = self.weigh(miss, scale)
        normal = self.normal(state, miss, to_shared, to_pose, weights, scale)
        factors = _Factors(normal, 0.0)
        seen = weights > 0
        freedom = max(2 * np.count_nonzero(seen) - state.shared.size - 6 * self.count, 1)
        squares = float(np.sum(weights[seen] ** 2 * np.sum(miss[seen] ** 2, -1)))  # Huber: clipped at the threshold
        sigma0 = np.sqrt(squares / freedom)
        information, precision = factors.reduced, np.zeros(state.shared.size)
        if self.prior is not None:
            precision = 1 / self.prior[1] ** 2
            information = factors.reduced - np.diag(precision) * scale**2
        information = information / max(sigma0, 1e-300) ** 2
        covariance = _inverse(information + np.diag(precision))
        pose_covariance = sigma0**2 * factors.inverses
        pose_covariance = pose_covariance + np.swapaxes(factors.pulled, -1, -2) @ covariance @ factors.pulled
        return Solution(
            state.shared,
            tuple(Pose(r, t) for r, t in zip(state.rotations, state.translations, strict=True)),
            miss * self.sigma[:, None],
            weights,
            float(sigma0),
            information,
            covariance,
            pose_covariance,
            converged,
            message,
            used,
            tuple(costs),
        )


class _Factors:
    """Damped normal equations, reduced to the shared parameters (Schur complement), ready to solve."""

    def __init__(self, normal: _Normal, damping: float):
        blocks = normal.poses.copy()
        diagonal = np.einsum("bii->bi", blocks)
        self.scale = np.sqrt(np.diag(normal.shared)), np.sqrt(diagonal)
        diagonal += damping * diagonal + 1e-12 * np.max(diagonal, axis=-1, keepdims=True) + 1e-300
        self.inverses = np.linalg.inv(blocks)
        self.cross = normal.cross
        shared = normal.shared.copy()
        shared[np.diag_indices(len(shared))] += damping * np.diag(shared)
        self.pulled = self.cross @ self.inverses  # (B, S, 6)
        self.reduced = shared - np.einsum("bsi,bti->st", self.pulled, self.cross, optimize=True)

    def solve(self, shared: np.ndarray, poses: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Steps of the shared parameters (S,) and of the poses (B, 6) for these gradients."""
        step = np.zeros(0)
        if len(shared):
            step = _solve(self.reduced, shared - np.einsum("bsi,bi->s", self.pulled, poses))
        return step, np.einsum("bij,bj->bi", self.inverses, poses) - np.einsum("bsi,s->bi", self.pulled, step)

    def length(self, shared: np.ndarray, poses: np.ndarray) -> float:
        """Length of a step in units of what each parameter does to the residuals."""
        return float(np.sqrt(np.sum((self.scale[0] * shared) ** 2) + np.sum((self.scale[1] * poses) ** 2)))


def _promised(normal, step, poses):
    """How far the cost would fall if the model were linear."""
    curved = (
        step @ normal.shared @ step
        + 2 * np.einsum("s,bsi,bi->", step, normal.cross, poses, optimize=True)
        + np.einsum("bi,bij,bj->", poses, normal.poses, poses, optimize=True)
    )
    return float(2 * (step @ normal.shared_gradient + np.sum(poses * normal.pose_gradient)) - curved)


def _moved(state, step, poses):
    turns = rotation_from_vector(poses[:, :3]) if len(poses) else np.zeros((0, 3, 3))
    return _State(state.shared + step, turns @ state.rotations, state.translations + poses[:, 3:])


def _scaled(matrix):
    """Unit-diagonal version of a symmetric matrix, and the scale of its rows: units of mm and rad mix badly."""
    scale = 1 / np.sqrt(np.maximum(np.diag(matrix), 1e-300))
    scale = np.where(np.diag(matrix) > 0, scale, 1.0)
    return matrix * scale * scale[:, None], scale


def _solve(matrix, vector):
    even, scale = _scaled(matrix)
    try:
        return scale * np.linalg.solve(even, scale * vector)
    except np.linalg.LinAlgError:
        return scale * (np.linalg.pinv(even, rcond=1e-14, hermitian=True) @ (scale * vector))


def _inverse(matrix):
    """Inverse (S, S); infinite variance (S,) where nothing at all is known."""
    if not len(matrix):
        return matrix
    even, scale = _scaled(matrix)
    inverse = np.linalg.pinv(even, rcond=1e-14, hermitian=True) * scale * scale[:, None]
    unknown = np.diag(matrix) <= 0
    inverse[unknown, unknown] = np.inf
    return inverse
