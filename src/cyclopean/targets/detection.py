"""Boards in the sub-images of photographs: which point of the board each view shows, and at which pixel."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from ..errors import ImageError, ShapeError
from ..geometry.arrays import white_level
from .boards import Board
from .observations import DIRECT, Observations

_FEW_MARKERS = "no or very few markers"
_MARGIN = 2  # px around a view's box, so that windows see where the view ends


@dataclass(frozen=True, eq=False)
class Sighting:
    """What one view of one photograph shows of the board; N points, none when it shows no board."""

    view: int  # number of the view; DIRECT without masks
    points: np.ndarray  # (N,) int, rows of the board's points, ascending
    pixels: np.ndarray  # (N, 2) px in the whole photograph
    sigma: np.ndarray  # (N,) px, standard deviation of a coordinate
    mirrored: bool  # whether the board was found in the flipped picture
    note: str = ""  # what is wrong, "" when all is well


def find_board(
    photograph: ArrayLike,
    board: Board,
    masks: ArrayLike | None = None,
    mirrored: Sequence[bool | None] | None = None,
) -> tuple[Sighting, ...]:
    """Find a board in every sub-image of a photograph, each by itself.

    Parameters
    ----------
    photograph : (H, W) or (H, W, 3) array
        8 or 16 bits, or float; linear in brightness or not.
    board : Board
        What to look for.
    masks : (V, H, W) array of bool, optional
        The pixels of each view (`Rig.masks`); without them the whole photograph is one view, numbered DIRECT.
    mirrored : sequence of V bools, optional
        Which views show the world flipped (`View.mirrored`); None for a view, or at all: markers tell, other boards
        are taken as not mirrored, since their print looks the same in a mirror.

    Returns
    -------
    tuple of Sighting
        One for each view. No returned point lies outside the view's mask. For boards that look the same when
        turned, the points are numbered alike in all views; the first number may be at any end of the board. A view
        flipped top to bottom then counts as turned by half a turn: use a board with markers there.

    Raises
    ------
    ShapeError
        When the masks do not fit the photograph.

    Notes
    -----
    Circles: the mean of the covered pixels, moved by the perspective's offset between a circle's centre and its
    picture's (Heikkila and Silven 1997).
    """
    image = _brightness(photograph)
    views, allowed = _masks(masks, image.shape)
    wanted = list(mirrored) if mirrored is not None else [None] * len(views)
    if len(wanted) != len(views):
        raise ShapeError(f"mirrored must have one value for each of the {len(views)} views, got {len(wanted)}")
    finite = np.isfinite(image)
    sightings = [
        _find_in_view(image, finite & mask, board, view, flip)
        for view, mask, flip in zip(views, allowed, wanted, strict=True)
    ]
    from .agreement import agree

    return agree(sightings, board)


def observe(
    photographs: Iterable[tuple[str, ArrayLike]],
    board: Board,
    masks: ArrayLike | None,
    mirrored: Sequence[bool | None] | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> tuple[Observations, list[str]]:
    """Find a board in many photographs.

    Parameters
    ----------
    photographs : sequence of (name, image)
        Images as in `find_board`, all of the masks' size.
    board, masks, mirrored
        As in `find_board`.
    progress : callable, optional
        Called as ``progress(done, total)`` after each photograph.

    Returns
    -------
    Observations, list of str
        All photographs, those without a board too; and a sentence for each view that is not as it should be.

    Raises
    ------
    ImageError
        When no photograph shows the board in any view; the message says why.
    """
    photographs = list(photographs)
    if not photographs:
        raise ImageError("no photographs of the board were given")
    sightings: list[tuple[Sighting, ...]] = []
    with ThreadPoolExecutor() as pool:  # OpenCV and the corner fit run without Python's lock
        for views in pool.map(lambda one: find_board(one[1], board, masks, mirrored), photographs):
            sightings.append(views)
            if progress is not None:
                progress(len(sightings), len(photographs))
    names = tuple(name for name, _ in photographs)
    notes = [note for name, views in zip(names, sightings, strict=True) for note in _notes(name, views)]
    rows = [(photo, one) for photo, views in enumerate(sightings) for one in views if len(one.points)]
    if not rows:
        hint = _other_board(photographs[0], board) if any(_FEW_MARKERS in note for note in notes) else ""
        which = "the photograph" if len(names) == 1 else f"the {len(names)} photographs"
        raise ImageError(f"no view of {which} shows the {board}.{hint} " + _shortened(notes))
    found = [one for _, one in rows]
    counts = [len(one.points) for one in found]
    observations = Observations(
        photo=np.repeat([photo for photo, _ in rows], counts),
        view=np.repeat([one.view for one in found], counts),
        point=np.concatenate([one.points for one in found]),
        pixels=np.concatenate([one.pixels for one in found]),
        photos=names,
        sigma=np.concatenate([one.sigma for one in found]),
    )
    return observations, notes


def _notes(name, found):
    """Sentences about one photograph."""
    said = [(f"view {one.view}" if one.view != DIRECT else "the photograph", one) for one in found]
    if len(found) > 1 and not any(len(one.points) for one in found):
        reasons = "; ".join(dict.fromkeys(one.note for one in found))
        return [f"{name}: no view shows the board: {reasons}"]
    return [f"{name}, {where}: {one.note}" for where, one in said if one.note]


def _shortened(notes, most=5):
    more = f" (and {len(notes) - most} more like these)" if len(notes) > most else ""
    return " ".join(f"{note}." for note in notes[:most]) + more


def _other_board(photograph, board):
    """Which dictionary's markers a photograph without the board shows, as a sentence."""
    from .markers import other_dictionary

    picture = _picture(_brightness(photograph[1]))
    for flip in (False, True):
        name = other_dictionary(np.ascontiguousarray(picture[:, ::-1]) if flip else picture, board.dictionary)
        if name:
            return f" {photograph[0]} shows markers of {name}: is that the board's dictionary?"
    return ""


def _brightness(photograph):
    """(H, W) float64; colours by Rec. 601's weights."""
    image = np.asarray(photograph)
    if image.ndim not in (2, 3) or (image.ndim == 3 and image.shape[2] not in (1, 3)) or not image.size:
        raise ShapeError(f"a photograph must have shape (H, W) or (H, W, 3), got {image.shape}")
    scale = 255.0 / white_level(image)
    if image.ndim == 3:
        image = image @ np.array([0.299, 0.587, 0.114]) if image.shape[2] == 3 else image[..., 0]
    return image.astype(float) * scale


def _masks(masks, shape):
    """Numbers of the views, and their masks."""
    if masks is None:
        return [DIRECT], [np.ones(shape, bool)]
    allowed = np.asarray(masks, dtype=bool)
    if allowed.ndim != 3 or allowed.shape[1:] != shape:
        raise ShapeError(f"masks must have shape (V, {shape[0]}, {shape[1]}), like the photograph; got {allowed.shape}")
    return list(range(len(allowed))), list(allowed)


def _picture(image, valid=None):
    """A picture (H, W) uint8 for OpenCV, stretched to the view's range; other pixels take the view's mean."""
    valid = np.isfinite(image) if valid is None else valid
    values = image[valid]
    if not values.size:
        return np.zeros(image.shape, np.uint8)
    low, high = np.percentile(values[:: max(1, values.size // 50_000)], [0.5, 99.5])
    filled = np.where(valid, image, values.mean())
    return ((filled - low) * (255 / max(high - low, 1e-9))).clip(0, 255).astype(np.uint8)


def _find_in_view(image, mask, board, view, mirrored):
    """Look in one view; where nothing tells whether it is mirrored, or the board is not found, both ways."""
    from .markers import NO_MARKERS

    nothing = Sighting(view, np.zeros(0, int), np.zeros((0, 2)), np.zeros(0), bool(mirrored))
    rows, columns = np.flatnonzero(mask.any(1)), np.flatnonzero(mask.any(0))
    if not rows.size:
        return replace(nothing, note="the view has no pixels")
    top, left = max(rows[0] - _MARGIN, 0), max(columns[0] - _MARGIN, 0)
    box = np.s_[top : rows[-1] + 1 + _MARGIN, left : columns[-1] + 1 + _MARGIN]
    part, inside = image[box], mask[box]
    way = bool(mirrored)
    found, note = _find_one_way(part, inside, board, way)
    if note == NO_MARKERS:
        other, said = _find_one_way(part, inside, board, not way)
        if len(other.points) and mirrored is None:
            found, note, way = other, "", not way
        elif len(other.points):
            words = ("mirrored", "not mirrored") if way else ("not mirrored", "mirrored")
            note = f"the setup says the view is {words[0]}, but the board can only be read as {words[1]}"
        else:
            note = said
    if note == NO_MARKERS:
        note = _why_nothing(part, inside, board)
    return Sighting(view, found.points, found.pixels + np.array([left, top]), found.sigma, way, note)


def _find_one_way(part, inside, board, flip):
    """Points and note in a part of the photograph, flipped left to right or not; pixels of the part as it is."""
    from . import grids, markers

    if flip:
        part, inside = (np.ascontiguousarray(a[:, ::-1]) for a in (part, inside))
    find = markers.find_marked if board.dictionary else grids.find_grid
    found, note = find(_picture(part, inside), part, inside, board)
    if flip:
        found = replace(found, pixels=found.pixels * [-1, 1] + [part.shape[1] - 1, 0])
    return found, note


def _why_nothing(part, inside, board):
    """What to say of a view without a single marker of the dictionary."""
    values = part[inside]
    if np.ptp(values) < 10:
        return "the view shows nothing: it is black, white or covered"
    few = f"{_FEW_MARKERS} of {board.dictionary} can be read"
    return f"{few}: is the board in the view, large, sharp and bright enough?"
