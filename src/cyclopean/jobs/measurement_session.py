"""What a person measures in a photograph, point by point: the same for options, typed lines and a window."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from ..correspondence.window_search import Picture
from ..correspondence.windows import Located
from ..errors import MeasurementError
from ..measurement.images import KINDS, ImagePoint, Measurement, check_count, evaluate, find_points, join, view_of
from ..rigs import Rig


@dataclass(frozen=True, eq=False)
class Scene:
    """What is measured in, and how."""

    picture: Picture
    rig: Rig
    depths: tuple[float, float]  # mm, that are searched
    window: int  # px
    pointing: float  # px
    share: Callable[[Measurement], Measurement]  # adds what the calibration's uncertainty does

    def find(self, point: ImagePoint) -> Located:
        """Where one point is seen."""
        return find_points(self.picture, self.rig, [point], self.depths, window=self.window, pointing=self.pointing)


class Session:
    """Points that wait for a measurement, and the measurements made so far."""

    def __init__(self, scene: Scene, keep: Callable[[Sequence[Measurement]], None] = lambda done: None):
        self.scene, self.keep = scene, keep
        self.kind = "length"
        self.points: list[ImagePoint] = []
        self.rows: list[Located] = []
        self.done: list[Measurement] = []
        self.message = "click points of a length"

    def choose(self, kind: str) -> None:
        """Measure another kind; points that wait are dropped."""
        if kind not in KINDS:
            raise MeasurementError(f"there is no measurement {kind!r}: choose one of {', '.join(KINDS)}")
        self.kind, self.points, self.rows = kind, [], []
        self.message = f"{kind}: click {KINDS[kind].points}"

    def add(self, pixel: Sequence[float]) -> None:
        """A point is pointed at; it is looked for in the other sub-images at once."""
        point = ImagePoint((float(pixel[0]), float(pixel[1])))
        self.points.append(point)
        self.rows.append(self.scene.find(point))
        self._say_point()
        if len(self.points) == KINDS[self.kind].most:
            self.finish()

    def correct(self, pixel: Sequence[float]) -> None:
        """The last point is seen at this pixel of another sub-image, whatever the match says."""
        if not self.points:
            self.message = "there is no point to correct: click one first"
            return
        last, view = self.points[-1], view_of(self.scene.rig, pixel)
        if view == view_of(self.scene.rig, last.pixel):
            self.message = "correct a point in another sub-image than its own"
            return
        kept = tuple(p for p in last.by_hand if view_of(self.scene.rig, p) != view)
        self.points[-1] = ImagePoint(last.pixel, (*kept, (float(pixel[0]), float(pixel[1]))))
        self.rows[-1] = self.scene.find(self.points[-1])
        self._say_point()

    def finish(self) -> Measurement | None:
        """Measure the points that wait; None, with a message, when they are too few."""
        try:
            check_count(self.kind, len(self.points))
        except MeasurementError as error:
            self.message = str(error)
            return None
        found = self.scene.share(evaluate(self.kind, self.points, join(self.rows)))
        self.points, self.rows = [], []
        self._done(found)
        return found

    def take(self, kind: str, points: Sequence[ImagePoint]) -> Measurement:
        """Measure points that were given all at once."""
        check_count(kind, len(points))
        found = self.scene.share(evaluate(kind, points, join([self.scene.find(point) for point in points])))
        self._done(found)
        return found

    def undo(self) -> None:
        """Take back the last point, or the last measurement when no point waits."""
        if self.points:
            self.points.pop()
            self.rows.pop()
            self.message = f"point taken back, {len(self.points)} left"
        elif self.done:
            taken = self.done.pop()
            self.keep(self.done)
            self.message = f"{taken.kind} taken back, {len(self.done)} measurements left"
        else:
            self.message = "there is nothing to take back"

    def _done(self, found):
        self.done.append(found)
        self.keep(self.done)
        self.message = f"{found.kind}: {shown_value(found)}, {found.grade}"
        if found.reasons:
            self.message += f" ({found.reasons[0]})"

    def _say_point(self):
        row, point = self.rows[-1], self.points[-1]
        k = view_of(self.scene.rig, point.pixel)
        if row.reason[0]:
            self.message = f"point {len(self.points)} refused: {row.reason[0]}; u takes it back"
        elif point.by_hand:
            self.message = f"point {len(self.points)} by hand: {row.residual[0]:.2f} px beside the epipolar curves"
        else:
            depth, sigma = row.points[0, 2], np.sqrt(row.covariance[0, 2, 2])
            self.message = (
                f"point {len(self.points)}: strength {row.strength[0, k]:.2f}, z {depth:.1f} +- {sigma:.2g} mm"
            )


def shown_value(found: Measurement) -> str:
    """Value and accuracy index with their unit; angles in degrees."""
    if found.result is None:
        return "-"
    value, accuracy, unit = in_print(found)
    digits = 1 if accuracy <= 0 else int(np.clip(1 - np.floor(np.log10(accuracy)), 0, 6))
    return f"{value:.{digits}f} +- {accuracy:.{digits}f} {unit}"


def in_print(found: Measurement) -> tuple[float, float, str]:
    """Value, accuracy index and unit as they are printed: angles in degrees."""
    if found.unit == "rad":
        return float(np.degrees(found.value)), float(np.degrees(found.accuracy)), "deg"
    return found.value, found.accuracy, found.unit.replace("mm2", "mm^2")
