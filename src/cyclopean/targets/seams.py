"""Sub-images found by their seams, without a setup; and compared with what a setup predicts."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ..errors import ImageError, ShapeError
from ..rigs import Rig

VIEWS = range(2, 9)  # numbers of sub-images that are looked for
# Confidence that is trusted with many photographs, and what one alone needs more (less with each further one). Set
# from 104 rendered photographs: the best wrong star in one alone has 0.59, in all 12 without a prism together 0.11.
TRUSTED, _ALONE = 0.42, 0.19
_SIDE = 320  # px, longer side of the pictures that are searched
_MOST = 24  # photographs; more add time but no seam
_START = np.deg2rad(-5)  # numbering starts a little before +x, so that a sub-image centred on +x is number 0
_TIE = 0.7  # of the best confidence: fewer sub-images are preferred from there on, since more lines fit more easily
_ADVICE = "take several photographs, of a scene with texture all over the picture that moves in between"


@dataclass(frozen=True, eq=False)
class Seams:
    """Half-lines through one apex that part a photograph into n sub-images.

    Sub-images are numbered by the azimuth atan2(y, x) of their middle about the apex, y down, so clockwise on the
    screen, counted from 5 degrees before +x: one whose middle points right is always number 0. Without a setup nobody
    can know which facet is the first; `reconcile` finds it where there is a setup.
    """

    apex: np.ndarray  # (2,) px; for two sub-images, the point of the one line nearest to the picture's centre
    angles: np.ndarray  # (n,) rad in 0..2 pi, ascending: directions of the half-lines
    confidence: float  # 0 (other lines are as good) to 1 (nothing comes near)
    size: tuple[int, int]  # (width, height) of the photograph, px
    band: float = float("nan")  # px, width in which both sides of a seam mix; NaN where it cannot be told
    photographs: int = 1  # that the seams were found in
    message: str = ""  # what to mind; empty when all is well

    def __post_init__(self):
        angles = np.sort(np.mod(np.asarray(self.angles, dtype=float), 2 * np.pi))
        if angles.ndim != 1 or len(angles) < 2:
            raise ShapeError(f"angles must hold two or more directions, got shape {angles.shape}")
        object.__setattr__(self, "angles", angles)
        object.__setattr__(self, "apex", np.asarray(self.apex, dtype=float))

    def __len__(self) -> int:
        return len(self.angles)

    @property
    def trusted(self) -> bool:
        """Whether the seams stand out clearly enough from all other lines of the photographs."""
        return self.confidence >= wanted_confidence(self.photographs)

    @cached_property
    def sectors(self) -> np.ndarray:
        """(n, 2) rad: the angle at which each sub-image begins, and the larger one at which it ends."""
        ends = np.append(self.angles[1:], self.angles[0] + 2 * np.pi)
        sectors = np.stack([self.angles, ends], axis=-1)
        return sectors[np.argsort(np.mod(sectors.mean(axis=-1) - _START, 2 * np.pi))]

    @cached_property
    def labels(self) -> np.ndarray:
        """(H, W) int8: the sub-image in which the centre of each pixel lies."""
        offset = self._offsets()
        azimuth = np.arctan2(offset[..., 1], offset[..., 0])
        labels = np.zeros(azimuth.shape, np.int8)
        for k, (begin, end) in enumerate(self.sectors):
            labels[np.mod(azimuth - begin, 2 * np.pi) < end - begin] = k
        return labels

    def masks(self, margin: float = 1.5) -> np.ndarray:
        """(V, H, W) bool: the pixels of each sub-image whose centres are `margin` px or more away from all seams."""
        clear = np.ones(self.labels.shape, bool)
        for angle in self.angles:
            clear &= distance_to_half_line(self._offsets(), angle) >= margin
        return (self.labels == np.arange(len(self))[:, None, None]) & clear

    @property
    def lines(self) -> np.ndarray:
        """(n, 2, 2) px: the apex, and where each half-line leaves the picture."""
        from .seam_search import reach

        lengths = reach(self.apex[None], self.angles, self.size)
        ends = self.apex + lengths * np.stack([np.cos(self.angles), np.sin(self.angles)], axis=-1)
        return np.stack([np.broadcast_to(self.apex, ends.shape), ends], axis=1)

    @property
    def shares(self) -> np.ndarray:
        """(n,) share of the picture's pixels that each sub-image has."""
        return np.bincount(self.labels.ravel(), minlength=len(self)) / self.labels.size

    def _offsets(self):
        width, height = self.size
        return np.stack(np.meshgrid(np.arange(width), np.arange(height)), axis=-1) - self.apex


def wanted_confidence(photographs: int) -> float:
    """The confidence from which on seams found in so many photographs are trusted."""
    return TRUSTED + _ALONE / max(photographs, 1)


def distance_to_half_line(offsets: np.ndarray, angle: float) -> np.ndarray:
    """Distance (...,) of points, given relative to its start (..., 2), from the half-line of direction `angle`."""
    direction = np.array([np.cos(angle), np.sin(angle)])
    along = offsets @ direction
    across = offsets[..., 0] * direction[1] - offsets[..., 1] * direction[0]
    return np.where(along >= 0, np.abs(across), np.hypot(offsets[..., 0], offsets[..., 1]))


def find_seams(
    photographs: np.ndarray | Sequence[np.ndarray],
    views: int | None = None,
    progress: Callable[[str, int, int], None] | None = None,
) -> Seams:
    """Find the sub-images of photographs by their seams.

    Parameters
    ----------
    photographs : (H, W) or (H, W, C) array, or a sequence of them
        Photographs of one setup: seams stay where they are while the scene moves, so a dozen are far better than
        one. From one alone they are found where there is texture all along the seams.
    views : int, optional
        Number of sub-images, 2 to 8, if known.
    progress : callable, optional
        Called with (what, done, total).

    Returns
    -------
    Seams
        With two views one straight line, with n views n half-lines through one apex inside the picture, up to 15 % of
        a sector away from equal angles. Look at `trusted` and `message`: other lines may stand out as much.

    Raises
    ------
    ImageError
        When the photographs differ in size, or hold no structure.
    """
    from .seam_refinement import blend_width, refine
    from .seam_search import search, shrink

    pictures = _same_size(photographs)
    if views is not None and views not in VIEWS:
        raise ShapeError(f"views must be {VIEWS[0]} to {VIEWS[-1]}, or None where it is not known, got {views}")
    pictures = [pictures[k] for k in np.unique(np.linspace(0, len(pictures) - 1, _MOST).round().astype(int))]
    _check_structure(pictures)
    small = [shrink(picture, _SIDE) for picture in pictures]
    stars = search(small, VIEWS if views is None else [views], progress)
    best = max(star.confidence for star in stars.values())
    star = next(star for _, star in sorted(stars.items()) if star.confidence >= _TIE * best)
    height, width = pictures[0].shape[:2]
    apex = (star.apex + 0.5) * width / small[0].shape[1] - 0.5
    if progress is not None:
        progress("following seams", 0, 1)
    apex, angles = refine(pictures, apex, star.angles, 2 * _SIDE, star.step_weight, shrink)
    full = [shrink(picture, max(width, height)) for picture in pictures]
    band = blend_width(full, apex, angles, (width, height))
    if progress is not None:
        progress("following seams", 1, 1)
    count = len(pictures)
    return Seams(apex, angles, star.confidence, (width, height), band, count, _doubt(star.confidence, count))


def _same_size(photographs):
    alone = isinstance(photographs, np.ndarray) and photographs.ndim in (2, 3) and photographs.dtype != object
    pictures = [np.asarray(photograph) for photograph in ([photographs] if alone else photographs)]
    if not pictures:
        raise ImageError("no photograph was given; seams need at least one")
    for picture in pictures:
        if picture.ndim not in (2, 3) or min(picture.shape[:2]) < 64:
            raise ImageError(f"photographs must be (H, W) or (H, W, C), 64 px or more, got shape {picture.shape}")
        if picture.shape[:2] != pictures[0].shape[:2]:
            (height, width), (other_height, other_width) = pictures[0].shape[:2], picture.shape[:2]
            raise ImageError(
                f"photographs of one setup have one size, got {width}x{height} px and {other_width}x{other_height} px"
            )
    return pictures


def _check_structure(pictures):
    for picture in pictures:
        low, high = np.percentile(picture[np.isfinite(picture)], [1, 99]) if np.isfinite(picture).any() else (0, 0)
        if high - low > 0.02 * max(abs(high), 1e-9):
            return
    raise ImageError(f"the photographs show nothing: their pixels hardly differ, so no seam can be seen; {_ADVICE}")


def _doubt(confidence, count):
    wanted = wanted_confidence(count)
    if confidence >= wanted:
        return ""
    which = "in this photograph" if count == 1 else f"in these {count} photographs"
    return (
        f"the seams are not certain: {which} other straight lines stand out nearly as much (confidence "
        f"{confidence:.2f}, wanted {wanted:.2f}); {_ADVICE}, or state the number of views if you know it"
    )


@dataclass(frozen=True, eq=False)
class Reconciliation:
    """How found sub-images compare with the views that a setup predicts."""

    order: np.ndarray  # (n,) int: the view that each found sub-image is, -1 for none
    overlap: np.ndarray  # (n,) share of each found sub-image's pixels that the view has too
    offset: np.ndarray  # (2,) px: shift of the predicted seams that brings them onto those found; NaN if n differs
    rotation: float  # rad about the found apex, from +x to +y: the turn that goes with it
    distance: float  # px, the largest distance of a predicted seam from the one found
    message: str  # what to mind; empty when all is well

    @property
    def agrees(self) -> bool:
        """Whether every sub-image is one of the views, and nothing is to be minded."""
        return not self.message


def reconcile(seams: Seams, rig: Rig, tolerance: float = 20.0) -> Reconciliation:
    """Match found sub-images with the views of a rig.

    Parameters
    ----------
    seams : Seams
        What `find_seams` found.
    rig : Rig
        What the setup predicts, for photographs of the same size.
    tolerance : float
        px, distance between seams from which on the message says that they disagree.

    Returns
    -------
    Reconciliation
        The pairing with the largest common area. Offset and rotation are the least-squares rigid motion of the
        predicted seams; along a single straight line (two views) no shift can be seen, and none is stated.
    """
    from scipy.optimize import linear_sum_assignment

    if tuple(rig.size) != tuple(seams.size):
        raise ImageError(
            f"the setup's camera has {rig.size[0]}x{rig.size[1]} px but the photographs have "
            f"{seams.size[0]}x{seams.size[1]} px: is it the right setup, or were they scaled?"
        )
    predicted = rig.facets.astype(int)
    common = np.stack(
        [np.bincount(predicted[seams.labels == k] + 1, minlength=len(rig) + 1) for k in range(len(seams))]
    )
    rows, columns = linear_sum_assignment(-common[:, 1:])
    order, overlap = np.full(len(seams), -1), np.zeros(len(seams))
    order[rows] = columns
    overlap[rows] = common[rows, columns + 1] / np.maximum(common[rows].sum(axis=1), 1)
    message = _disagreement(len(seams), len(rig), seams)
    offset, rotation, distance = np.full(2, np.nan), float("nan"), float("nan")
    if len(seams) == len(rig):
        offset, rotation, distance = _motion(seams, predicted, order)
        if not distance <= tolerance:
            message = (
                f"the seams lie up to {distance:.0f} px from where the setup puts them: shift it by "
                f"({offset[0]:.1f}, {offset[1]:.1f}) px, turn it by {np.degrees(rotation):.2f} degrees, or calibrate"
            )
    return Reconciliation(order, overlap, offset, rotation, distance, message or seams.message)


def _disagreement(found, wanted, seams):
    if found == wanted:
        return ""
    doubt = "" if seams.trusted else ", though not with certainty"
    return (
        f"the setup has {wanted} views but {found} sub-images were found{doubt}: is it the right setup, or is a facet "
        f"outside the picture? With views={wanted} the best {wanted} sub-images are sought"
    )


def _motion(seams, predicted, order):
    """Offset (2,) px, rotation rad and largest distance px from predicted seams to those found."""
    points, pairs = _borders(predicted)
    rows, gaps = [], []
    view_of = order[np.argsort(seams.sectors[:, 0])]  # the view after each seam, in the order of `angles`
    after, before = view_of, np.roll(view_of, 1)
    for angle, pair in zip(seams.angles, np.sort(np.stack([before, after], -1), axis=1), strict=True):
        mine = (pairs == pair).all(axis=1)
        offsets = points[mine] - seams.apex
        if len(seams) == 2:  # both half-lines part the same two views: each takes the points on its side
            offsets = offsets[offsets @ [np.cos(angle), np.sin(angle)] >= 0]
        normal = np.array([-np.sin(angle), np.cos(angle)])
        turned = offsets[:, 0] * normal[1] - offsets[:, 1] * normal[0]  # normal . (turn by a quarter) offset
        rows.append(np.column_stack([np.broadcast_to(normal, offsets.shape), turned]))
        gaps.append((offsets, angle, -offsets @ normal))
    if not sum(map(len, rows)):
        return np.full(2, np.nan), float("nan"), float("nan")
    matrix, gap = np.concatenate(rows), np.concatenate([gap for *_, gap in gaps])
    scale = np.array([1, 1, 1 / max(seams.size)])
    motion = np.linalg.lstsq(matrix * scale, gap, rcond=1e-3)[0] * scale
    worst = max(distance_to_half_line(offsets, angle).max(initial=0) for offsets, angle, _ in gaps)
    return motion[:2], float(motion[2]), float(worst)


def _borders(labels):
    """Points (N, 2) px between neighbouring pixels of different views, and the two views (N, 2), the lower first."""
    points, pairs = [], []
    for first, second, shift in (
        (labels[:, :-1], labels[:, 1:], (0.5, 0.0)),
        (labels[:-1], labels[1:], (0.0, 0.5)),
    ):
        rows, columns = np.nonzero((first != second) & (first >= 0) & (second >= 0))
        points.append(np.column_stack([columns, rows]) + shift)
        pairs.append(np.sort(np.column_stack([first[rows, columns], second[rows, columns]]), axis=1))
    return np.concatenate(points), np.concatenate(pairs)
