"""Three routes to the same rig, judged by the same photographs.

The thesis calibrates virtual cameras, or sketches them from the drawing and puts the drawing right by one field point
(sections 4.1, 5.1 and 6.1); the third route is the physical model with true rays. What a route ends with are views;
all views are judged alike, by boards that they have not seen.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ..errors import CyclopeanError, SetupError
from ..rigs import Setup
from ..targets import DIRECT, Observations, Target
from .judgement import Held, Judgement, hold, judge
from .routes import FIELD_POINT, PHYSICAL, ROUTES, Evidence, FieldPoint, Found
from .validation import neighbours

_FOLDS = 4
_BINS = 4


@dataclass(frozen=True, eq=False)
class Route:
    """What one route came to."""

    name: str
    seconds: float  # of one calibration; NaN where it failed
    judgement: Judgement
    converged: bool
    message: str = ""  # why there are no figures, or what is wrong with them

    @property
    def failed(self) -> bool:
        """Whether there are no figures."""
        return not self.judgement.rows.any()


class Figures(NamedTuple):
    """Figures of a route over some photographs."""

    photographs: int
    rms: float  # px
    rigid: float  # mm
    rigid_max: float  # mm
    rigid_percent: float  # % of depth
    square: float  # mm, mean error of the square's length
    square_sd: float  # mm
    square_percent: float  # %, the mean error
    flatness: float  # mm


class DepthRow(NamedTuple):
    """What a route says about photographs of a board at one known depth."""

    depth: float  # mm, actual
    mean: float  # mm, recovered
    percent: float  # %, error of the mean
    rms: float  # mm, of the points' errors
    largest: float  # mm


@dataclass(frozen=True, eq=False)
class Comparison:
    """Routes judged by the same photographs."""

    routes: tuple[Route, ...]
    photos: tuple[str, ...]  # T, that judged
    depths: np.ndarray  # (T,) mm, mean depth of what each shows of the board; the known one where it is known
    known: np.ndarray  # (T,) mm, known depth of the board; NaN where it is not
    edges: np.ndarray  # (D + 1,) mm, of the depth bins
    spacing: float  # mm, between neighbouring points of the target
    calibrations: int  # photographs through the optic that each calibration saw, at least
    notes: tuple[str, ...] = ()

    def figures(self, route: Route, photos: np.ndarray | None = None) -> Figures:
        """Figures of a route over some photographs (a mask (T,)), or all."""
        chosen = np.ones(len(self.photos), dtype=bool) if photos is None else np.asarray(photos, dtype=bool)
        found = route.judgement.of(chosen)
        square = _mean(found.square, found.pairs)
        spread = _mean(found.square_sd**2 + (found.square - square) ** 2, found.pairs) ** 0.5
        largest = found.rigid_max[np.isfinite(found.rigid_max)]
        return Figures(
            int(np.count_nonzero(found.rows)),
            _mean(found.rms**2, found.rows) ** 0.5,
            _mean(found.rigid**2, found.points) ** 0.5,
            float(largest.max()) if largest.size else np.nan,
            100 * _mean((found.rigid / self.depths[chosen]) ** 2, found.points) ** 0.5,
            square,
            spread,
            100 * square / self.spacing,
            _mean(found.flatness**2, found.points) ** 0.5,
        )

    def bins(self) -> list[tuple[str, np.ndarray]]:
        """Names of the depth bins and the photographs (T,) bool in them, without empty ones."""
        place = np.clip(np.searchsorted(self.edges, self.depths, side="right") - 1, 0, len(self.edges) - 2)
        named = [(f"{a:.0f} to {b:.0f} mm", place == k) for k, (a, b) in enumerate(zip(self.edges, self.edges[1:]))]
        return [(name, mask) for name, mask in named if mask.any()]

    def depth_table(self, route: Route) -> list[DepthRow]:
        """Actual and recovered depth, as in the thesis's tables 4.1, 5.1 and 6.1: a row for each known depth."""
        judged, rows = route.judgement, []
        for depth in np.unique(self.known[np.isfinite(self.known)]):
            mine = (self.known == depth) & np.isfinite(judged.depth)
            weight = judged.points[mine]
            mean = _mean(judged.depth[mine], weight)
            largest = float(judged.depth_max[mine].max()) if mine.any() else np.nan
            spread = _mean(judged.depth_rms[mine] ** 2, weight) ** 0.5
            rows.append(DepthRow(float(depth), mean, 100 * (mean / depth - 1), spread, largest))
        return rows

    def depth_percent(self, route: Route) -> tuple[float, float]:
        """Root mean square and largest error of depth over all points at known depths, %."""
        judged = route.judgement
        relative, largest = 100 * judged.depth_rms / self.known, 100 * judged.depth_max / self.known
        good = largest[np.isfinite(largest)]
        return _mean(relative**2, judged.points) ** 0.5, float(good.max()) if good.size else np.nan


def compare(
    observations: Observations,
    target: Target,
    setup: Setup,
    routes: Sequence[str] = ROUTES,
    test: Observations | None = None,
    depths: Sequence[float] | None = None,
    field_point: FieldPoint | None = None,
    progress: Callable[[int, int], None] | None = None,
    *,
    test_target: Target | None = None,
    known_depths: Mapping[str, float] | None = None,
    folds: int | None = None,
) -> Comparison:
    """Calibrate by several routes and judge each by photographs that it has not seen.

    Parameters
    ----------
    observations : Observations
        Where photographs show the target, to calibrate from. Those without the optic (view `DIRECT`) calibrate the
        camera, which all routes then start from; the physical model adjusts it together with the optic.
    target : Target
        The known object.
    setup : Setup
        As drawn.
    routes : sequence of names
        Some of `ROUTES`.
    test : Observations, optional
        Photographs to judge by, of `test_target` (the same target where not given). Without them photographs are left
        out of `observations` in turn, in `folds` groups (4, or as many as there are photographs).
    depths : sequence of D + 1 mm, optional
        Edges of the depth bins; four bins with equally many photographs where not given.
    field_point : FieldPoint, optional
        The point that puts the drawing right. Without it, the corner nearest to the axis in a calibration photograph
        of middle depth, at the depth that the physical model gives it.
    progress : callable, optional
        Called as ``progress(done, total)`` after each route.
    known_depths : mapping, optional
        z (mm) of the board in photographs that show it square to the camera's axis, by their names.
    test_target, folds
        See `test`.

    Returns
    -------
    Comparison
        A route that fails keeps its reason instead of figures.

    Raises
    ------
    SetupError
        An unknown route; nothing to calibrate from or to judge by; photographs of different colour channels.
    """
    _check(observations, routes, test)
    groups = _groups(observations, test, folds)
    judged, points = (observations, target) if test is None else (test, test_target or target)
    photos = sorted(k for _, out in groups for k in out)
    known = np.array([(known_depths or {}).get(judged.photos[k], np.nan) for k in photos])
    parts: dict[str, list[_Part]] = {name: [] for name in routes}
    notes = _remarks(routes, field_point)
    for turn, (kept, out) in enumerate(groups):
        fold = Evidence(observations.of_photos(kept), target, setup, field_point)
        seen = judged.of_photos(out).select(judged.of_photos(out).view != DIRECT)
        found, lost = _run(
            fold, routes, seen, points, known[[photos.index(k) for k in out]], _part_of(progress, turn, len(groups))
        )
        notes += [lost] if lost else []
        for name, part in found.items():
            parts[name].append(part._replace(photos=[photos.index(k) for k in out]))
    results = tuple(_joined(name, parts[name], len(photos)) for name in routes)
    middle = np.where(np.isfinite(known), known, _reference(results))
    if depths is None:
        there = middle[np.isfinite(middle)]
        depths = np.unique(np.quantile(there, np.linspace(0, 1, _BINS + 1))) if there.size else np.array([0.0, np.inf])
        depths = depths if len(depths) > 1 else np.repeat(depths, 2)
    least = min(len(np.unique(o.photo[o.view != DIRECT])) for o in (observations.of_photos(kept) for kept, _ in groups))
    names = tuple(judged.photos[k] for k in photos)
    spacing = _spacing(points, judged)
    return Comparison(results, names, middle, known, np.asarray(depths, dtype=float), spacing, least, tuple(notes))


class _Part(NamedTuple):
    """A route's result in one fold."""

    judgement: Judgement | None
    seconds: float
    converged: bool
    message: str
    photos: Sequence[int] = ()


def _check(observations, routes, test):
    unknown = [name for name in routes if name not in ROUTES]
    if unknown or not len(routes):
        raise SetupError(f"routes must be some of {'; '.join(ROUTES)}; got {'; '.join(unknown) or 'none'}")
    for seen, use in ((observations, "calibrate from"), (test, "judge by")):
        if seen is not None and not np.any(seen.view != DIRECT):
            raise SetupError(f"there are no photographs through the optic to {use}")
        if seen is not None and seen.channel.any():
            raise SetupError("routes are compared in one colour channel: give the rows of one, as channel 0")


def _remarks(routes, field_point):
    """What the reader of the figures must know."""
    notes = []
    if any(name.startswith("virtual") for name in routes):
        notes.append(
            "photographs of a board tell virtual cameras only up to a rigid motion: their frame, and so their depths, "
            "are the drawing's as nearly as the centres of its views tell"
        )
    if FIELD_POINT in routes and field_point is None:
        notes.append("the depth of the field point is the physical model's, as none was given")
    return notes


def _groups(observations, test, folds) -> list[tuple[list[int], list[int]]]:
    """Photographs to calibrate from and to judge by, for each turn."""
    every = list(range(len(observations.photos)))
    if test is not None:
        return [(every, [int(k) for k in np.unique(test.photo[test.view != DIRECT])])]
    through = [int(k) for k in np.unique(observations.photo[observations.view != DIRECT])]
    if len(through) < 2:
        raise SetupError("one photograph cannot both calibrate and judge: give more, or photographs to judge by")
    count = min(_FOLDS, len(through)) if folds is None else folds
    if not 2 <= count <= len(through):
        raise SetupError(f"folds must lie between 2 and the number of photographs, {len(through)}, got {folds}")
    outs = [through[k::count] for k in range(count)]
    return [([k for k in every if k not in out], out) for out in outs]


def _run(fold, routes, seen, target, known, progress):
    """Each route's part in a fold, and a sentence about corners that no route explains."""
    model = np.asarray(target.points, dtype=float)
    found: dict[str, tuple[Found, Held, float]] = {}
    parts: dict[str, _Part] = {}
    for k, name in enumerate(sorted(routes, key=lambda name: name != PHYSICAL)):  # its poses serve the field point
        try:
            _ = fold.nominal, fold.point if name == FIELD_POINT else None
            start = time.perf_counter()
            result = fold.run(name)
            seconds = time.perf_counter() - start
            found[name] = result, hold(result.views, seen, model[seen.point]), seconds
        except (CyclopeanError, np.linalg.LinAlgError) as fault:
            parts[name] = _Part(None, np.nan, False, str(fault))
        if progress is not None:
            progress(k + 1, len(routes))
    far = [held.far_out for _, held, _ in found.values()]
    wrong = np.all(far, axis=0) if far else np.zeros(len(seen), dtype=bool)
    for name, (result, held, seconds) in found.items():
        judgement = judge(result.views, held, seen, model, ~wrong, known)
        parts[name] = _Part(judgement, seconds, result.converged, result.message)
    count = int(np.count_nonzero(wrong))
    lost = (
        f"{count} corner{'' if count == 1 else 's'} that no route explains, left out: {', '.join(_names(seen, wrong))}"
    )
    return parts, lost if count else ""


def _part_of(progress, turn, turns):
    """Progress (done, total) of one of several turns as that of all of them."""
    return None if progress is None else lambda done, total: progress(turn * total + done, turns * total)


def _names(seen, rows):
    return [seen.photos[k] for k in np.unique(seen.photo[rows])]


def _joined(name, parts, count) -> Route:
    """One route from its parts."""
    whole = Judgement.nothing(count)
    for part in parts:
        if part.judgement is not None:
            whole.put(part.photos, part.judgement)
    message = "; ".join(dict.fromkeys(part.message for part in parts if part.message))
    seconds = [part.seconds for part in parts if np.isfinite(part.seconds)]
    return Route(
        name, float(np.mean(seconds)) if seconds else np.nan, whole, all(part.converged for part in parts), message
    )


def _reference(routes):
    """Depths (T,) mm by fitted poses: the physical model's, or those of the route that fits best."""
    usable = [route for route in routes if not route.failed]
    if not usable:
        return np.full(len(routes[0].judgement.rows), np.nan)
    by_fit = min(usable, key=lambda r: (r.name != PHYSICAL, _mean(r.judgement.rms**2, r.judgement.rows)))
    return by_fit.judgement.pose_depth


def _spacing(target, judged):
    """Median distance of neighbours among the points that judge, mm; other boards may share the target's numbers."""
    places = np.unique(np.asarray(target.points, dtype=float)[np.unique(judged.point[judged.view != DIRECT])], axis=0)
    first, second = neighbours(places)
    return float(np.median(np.linalg.norm(places[first] - places[second], axis=-1)))


def _mean(values, weights):
    """Weighted mean of the values that are numbers; NaN where none is."""
    good = np.isfinite(values) & (weights > 0)
    return float(np.average(values[good], weights=weights[good])) if good.any() else np.nan
