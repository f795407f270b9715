"""What calibration reads: at which pixels photographs show the points of a known target."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np

from ..errors import ShapeError

DIRECT = -1  # the "view" of a photograph that was taken without the optic


class Target(Protocol):
    """What calibration asks of a known object."""

    @property
    def points(self) -> np.ndarray:
        """Its points (P, 3), mm, in the target's own frame."""
        ...


@dataclass(frozen=True, eq=False)
class Observations:
    """One row for each time that a view shows a point of the target; N rows."""

    photo: np.ndarray  # (N,) int, number of the photograph: a row of `photos`
    view: np.ndarray  # (N,) int, number of the sub-image; DIRECT in photographs taken without the optic
    point: np.ndarray  # (N,) int, number of the point: a row of the target's points
    pixels: np.ndarray  # (N, 2) px in the whole photograph
    photos: tuple[str, ...]  # names of the photographs
    sigma: np.ndarray = 0.05  # type: ignore[assignment]  # (N,) px, standard deviation of a pixel coordinate
    channel: np.ndarray = 0  # type: ignore[assignment]  # (N,) int, colour channel; 0 where colours are not told apart

    def __post_init__(self):
        pixels = np.asarray(self.pixels, dtype=float).reshape(-1, 2)
        count = len(pixels)
        object.__setattr__(self, "pixels", pixels)
        object.__setattr__(self, "photos", tuple(str(name) for name in self.photos))
        for name, kind in (("photo", int), ("view", int), ("point", int), ("sigma", float), ("channel", int)):
            values = np.asarray(getattr(self, name), dtype=kind)
            if values.shape not in ((), (count,)):
                raise ShapeError(f"{name} must have one value for each of the {count} pixels, got shape {values.shape}")
            object.__setattr__(self, name, np.broadcast_to(values, (count,)).copy())
        if count and not 0 <= self.photo.min() <= self.photo.max() < len(self.photos):
            raise ShapeError(
                f"photo must number the {len(self.photos)} photographs from 0, got up to {self.photo.max()}"
            )

    def __len__(self) -> int:
        return len(self.pixels)

    def select(self, rows: np.ndarray) -> Observations:
        """Some of the rows (a mask or indices); photographs keep their numbers."""
        return Observations(
            self.photo[rows], self.view[rows], self.point[rows], self.pixels[rows], self.photos, self.sigma[rows],
            self.channel[rows],
        )  # fmt: skip

    def of_photos(self, numbers: Sequence[int] | np.ndarray) -> Observations:
        """The rows of some photographs, which are then numbered anew in the order given."""
        numbers = [int(number) for number in numbers]
        new = np.full(len(self.photos) + 1, -1)
        new[numbers] = np.arange(len(numbers))
        rows = new[self.photo] >= 0
        some = self.select(rows)
        return Observations(
            new[some.photo], some.view, some.point, some.pixels, tuple(self.photos[k] for k in numbers), some.sigma,
            some.channel,
        )  # fmt: skip

    @staticmethod
    def join(parts: Sequence[Observations]) -> Observations:
        """Observations of different photographs as one; photographs of the second part follow those of the first."""
        starts = np.cumsum([0] + [len(part.photos) for part in parts])

        def all_of(name):
            return np.concatenate([getattr(part, name) for part in parts])

        return Observations(
            np.concatenate([part.photo + start for part, start in zip(parts, starts[:-1], strict=True)]),
            all_of("view"),
            all_of("point"),
            all_of("pixels"),
            tuple(name for part in parts for name in part.photos),
            all_of("sigma"),
            all_of("channel"),
        )


@dataclass(frozen=True, eq=False)
class Targets:
    """Several targets as one: the points of the second are numbered after those of the first."""

    parts: tuple[Target, ...]

    @property
    def points(self) -> np.ndarray:
        """The points (P, 3) of all of them, mm, each in its own target's frame."""
        return np.concatenate([part.points for part in self.parts])


def together(parts: Sequence[tuple[Observations, Target]]) -> tuple[Observations, Targets]:
    """Photographs of different targets as one set of observations of one target.

    Each photograph has a pose of its own, so that the targets need not stand in a common frame.
    """
    starts = np.cumsum([0] + [len(target.points) for _, target in parts])
    moved = [
        replace(observations, point=observations.point + start)
        for (observations, _), start in zip(parts, starts[:-1], strict=True)
    ]
    return Observations.join(moved), Targets(tuple(target for _, target in parts))
