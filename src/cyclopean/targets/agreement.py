"""Whether the views of one photograph tell the same story about the board, and one numbering for all of them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from .boards import Board

_COMMON = 6  # fewer common points than this cannot contradict
_AGREE = 0.7  # least share of the common points that one homography between two views explains


def agree(sightings: list, board: Board) -> tuple:
    """Number points alike in all views of a photograph, and drop views that contradict the others.

    Parameters
    ----------
    sightings : list of detection.Sighting
        The views of one photograph.
    board : Board
        What was looked for.

    Returns
    -------
    tuple of detection.Sighting
        Boards that look the same when turned are numbered so that they are least turned against the view with most
        points. A view whose points lie elsewhere than the other views say is emptied, with a note.
    """
    if not sightings:
        return ()
    first = int(np.argmax([len(one.points) for one in sightings]))
    reference = _ordered(sightings[first])
    out = []
    for place, one in enumerate(sightings):
        if place != first and len(one.points):
            one = _contradiction(_least_turned(_ordered(one), reference, board), reference, board)
        out.append(_ordered(one))
    votes = [one.note.startswith("contradicts") for one in out if one.view != reference.view]
    if sum(votes) > 1 and all(votes) and _alike([one for k, one in enumerate(sightings) if k != first], board):
        return _without(sightings, first, board)
    return tuple(out)


def _alike(sightings, board):
    """Whether views agree with each other."""
    found = [one for one in sightings if len(one.points)]
    return all(not _contradiction(one, found[0], board).note.startswith("contradicts") for one in found[1:])


def _without(sightings, odd, board):
    """The views less the one that stands against all others."""
    rest = agree([one for k, one in enumerate(sightings) if k != odd], board)
    empty = _emptied(sightings[odd], "contradicts all other views: its points lie elsewhere on the board")
    return (*rest[:odd], empty, *rest[odd:])


def _ordered(one):
    rows = np.argsort(one.points)
    return replace(one, points=one.points[rows], pixels=one.pixels[rows], sigma=one.sigma[rows])


def _emptied(one, note):
    return replace(one, points=one.points[:0], pixels=one.pixels[:0], sigma=one.sigma[:0], note=note)


def _common(one, reference):
    """Pixels (C, 2) of the points that two views share; views that flip are flipped back."""
    _, mine, other = np.intersect1d(one.points, reference.points, return_indices=True)
    pixels = [view.pixels[rows] * ([-1, 1] if view.mirrored else [1, 1])
              for view, rows in ((one, mine), (reference, other))]  # fmt: skip
    return pixels[0], pixels[1]


def _least_turned(one, reference, board):
    """The view with the numbering that turns it least against the reference."""
    best, least = one, np.inf
    for numbers in board.symmetries:
        other = _ordered(replace(one, points=numbers[one.points]))
        mine, theirs = _common(other, reference)
        if len(mine) < 3:
            continue
        mine, theirs = mine - mine.mean(0), theirs - theirs.mean(0)
        turn = theirs.T @ mine  # of the best rotation: tan = (xy - yx) / (xx + yy)
        angle = abs(np.arctan2(turn[0, 1] - turn[1, 0], turn[0, 0] + turn[1, 1]))
        if angle < least - 1e-9:
            best, least = other, angle
    return best


def _contradiction(one, reference, board):
    """The view itself, or emptied when no homography carries most of the reference's points to its own."""
    import cv2

    mine, theirs = _common(one, reference)
    if len(mine) < _COMMON:
        return one
    spacing = np.sqrt(np.ptp(mine, axis=0).prod() / len(mine))
    homography, inside = cv2.findHomography(theirs, mine, cv2.RANSAC, max(3.0, 0.3 * spacing))
    if homography is not None and inside.mean() >= _AGREE:
        return one
    return _emptied(one, f"contradicts view {reference.view}: the same points lie elsewhere on the board")
