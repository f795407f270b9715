"""Features of the sub-images, matched by where they lie and what they look like."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from ..errors import ImageError, SetupError, ShapeError
from ..geometry import as_rgb
from ..rigs import Rig
from .alignment import REFINED_SIGMA, align
from .frames import facing
from .matches import Matches, check_views
from .points import match_points, within

Detector = Literal["sift", "orb", "akaze"]
SIGMAS = {"sift": 0.3, "orb": 0.6, "akaze": 0.3}
"""Standard deviation of a coordinate of the features of each detector, px, measured on rendered scenes."""

_BESIDE = 5  # px beside the border of a view, where what lies beyond would count
_APART = {"sift": 0.5, "orb": 3.0, "akaze": 1.0}  # px; of features that lie nearer together the strongest stays
_UPRIGHT = np.deg2rad(10)  # views turned by less are not turned for features
_DETECTION = 0.5  # share of the features of one view that are found again in another


@dataclass(frozen=True, eq=False)
class Features:
    """N features of one view, the strongest first."""

    pixels: np.ndarray  # (N, 2) px in the photograph
    descriptors: np.ndarray  # (N, D) float32, or uint8 whose bits are compared
    strength: np.ndarray  # (N,) the detector's own measure


def match_features(
    photograph: ArrayLike,
    rig: Rig,
    depths: tuple[float, float] | None = None,
    *,
    detector: Detector = "sift",
    sigma: float | None = None,
    most: int = 4000,
    ratio: float = 0.8,
    refine: bool = True,
    min_views: int = 2,
    max_ambiguity: float = 0.2,
    progress: Callable[[str, int, int], None] | None = None,
) -> Matches:
    """Find features in every sub-image, and which of them show the same point of the scene.

    Descriptors are compared only among the candidates within the epipolar band and the depth range; `match_points`
    does the rest.

    Parameters
    ----------
    photograph : (H, W) or (H, W, 3) array
        8 or 16 bits, or float.
    rig : Rig
        V views, two or more.
    depths : (near, far), optional
        Depths between which the scene lies, mm; the rig's working depths without it.
    detector : "sift", "orb" or "akaze"
        What to look for; OpenCV finds it.
    sigma : float, optional
        Standard deviation of each coordinate, px: noise of the features, and what the setup may be off. Without it
        that of `SIGMAS` while matching, and `REFINED_SIGMA` for refined pixels.
    most : int
        Features of each view that are kept, the strongest.
    refine : bool
        Whether pixels of the other views are then shifted until they show what the first one shows (`align`); else
        they are as the detector gives them.
    ratio, min_views, max_ambiguity, progress
        As in `match_points`.

    Returns
    -------
    Matches

    Raises
    ------
    ImageError
        When fewer than two views show features.
    SetupError, ShapeError
        For options out of range, and a photograph of another size.

    References
    ----------
    Lowe 2004 (SIFT); Rublee, Rabaud, Konolige, Bradski 2011 (ORB); Alcantarilla, Nuevo, Bartoli 2013 (AKAZE).
    """
    given = sigma
    sigma = SIGMAS[_known(detector)] if given is None else given
    check_views(rig, min_views)
    depths = rig.working_depths if depths is None else depths
    found = find_features(photograph, rig, depths, detector=detector, most=most, progress=progress)
    counts = [len(one.pixels) for one in found]
    if np.count_nonzero(counts) < 2:
        told = ", ".join(
            f"{view.name or f'view {k}'}: {n}" for k, (view, n) in enumerate(zip(rig, counts, strict=True))
        )
        raise ImageError(
            f"{detector} finds features in fewer than two views ({told}): is the scene textured, sharp and bright "
            "enough? try another detector"
        )
    matches = match_points(
        rig,
        [one.pixels for one in found],
        depths,
        sigma=sigma,
        descriptors=[one.descriptors for one in found],
        ratio=ratio,
        detection=_DETECTION,
        min_views=min_views,
        max_ambiguity=max_ambiguity,
        progress=progress,
    )
    if not refine:
        return matches
    matches = align(photograph, rig, matches, sigma=REFINED_SIGMA if given is None else given)
    return within(matches, depths)


def find_features(
    photograph: ArrayLike,
    rig: Rig,
    depths: tuple[float, float] | None = None,
    *,
    detector: Detector = "sift",
    most: int = 4000,
    progress: Callable[[str, int, int], None] | None = None,
) -> tuple[Features, ...]:
    """The features of every sub-image; those near its border are left out.

    Views are known to be turned and flipped against each other, so features are described upright (as the x axis of
    the rig runs at middle depth), in a mirrored view in its mirror picture: this tells more than descriptors that
    turn with the feature.
    """
    _known(detector)
    image = np.asarray(photograph)
    if image.shape[:2] != rig.size[::-1] or image.ndim not in (2, 3):
        wanted = f"({rig.size[1]}, {rig.size[0]}) or ({rig.size[1]}, {rig.size[0]}, 3)"
        raise ShapeError(f"the photograph must have shape {wanted} as the setup's camera, got {image.shape}")
    near, far = rig.working_depths if depths is None else depths
    grey = as_rgb(image).mean(-1)
    features = []
    for number, view in enumerate(rig):
        features.append(_in_view(grey, view, 2 / (1 / near + 1 / far), detector, most))
        if progress is not None:
            progress("features", number + 1, len(rig))
    return tuple(features)


def _known(detector):
    if detector not in SIGMAS:
        raise SetupError(f"detector must be one of {', '.join(SIGMAS)}, got {detector!r}")
    return detector


def _in_view(grey, view, depth, detector, most):
    """Features of one view of the photograph (H, W)."""
    import cv2

    x, y, width, height = view.region.box
    box = np.s_[y : y + height, x : x + width]
    mask = np.pad(view.region.mask[box], 1).astype(np.uint8)
    inside = cv2.distanceTransform(mask, cv2.DIST_L2, cv2.DIST_MASK_PRECISE)[1:-1, 1:-1] > _BESIDE
    if not inside.any():
        return Features(np.zeros((0, 2)), np.zeros((0, 1), np.float32), np.zeros(0))
    picture = _stretched(grey[box], mask[1:-1, 1:-1].astype(bool))
    flipped, angle = facing(view, depth)
    if flipped:
        picture, inside = np.ascontiguousarray(picture[:, ::-1]), inside[:, ::-1]
    pixels, descriptors, strength = _detect(picture, np.ascontiguousarray(inside), angle, detector, most)
    if flipped:
        pixels = np.array([width - 1, 0]) + np.array([-1, 1]) * pixels
    return Features(pixels + np.array([x, y]), descriptors, strength)


def _stretched(grey, valid):
    """A picture (H, W) uint8, stretched to the range of the valid pixels, which are all that it shows."""
    values = grey[valid]
    low, high = np.percentile(values, [0.5, 99.5])
    filled = np.where(valid, grey, values.mean())
    return ((filled - low) * (255 / max(high - low, 1e-9))).clip(0, 255).astype(np.uint8)


def _detect(picture, inside, angle, detector, most):
    """Pixels (N, 2), descriptors (N, D) and strengths (N,) in a picture, described upright to an angle."""
    import cv2

    mask = inside.astype(np.uint8)
    if detector == "akaze":
        upright = abs(angle) < _UPRIGHT
        finder = _akaze(upright)
    elif detector == "orb":
        finder = cv2.ORB_create(nfeatures=4 * most, nlevels=4, fastThreshold=7)
    else:
        finder = cv2.SIFT_create(contrastThreshold=0.02)
    found = _strongest(finder.detect(picture, mask), most, _APART[detector])
    if detector != "akaze":
        for point in found:
            point.angle = float(np.degrees(angle) % 360)
    found, descriptors = finder.compute(picture, found)
    if descriptors is None or not len(found):
        width = {"sift": 128, "orb": 32, "akaze": 61}[detector]
        return np.zeros((0, 2)), np.zeros((0, width), np.float32 if detector == "sift" else np.uint8), np.zeros(0)
    pixels = np.array([point.pt for point in found], dtype=float)
    return pixels, descriptors, np.array([point.response for point in found])


def _akaze(upright):
    """OpenCV's AKAZE, which OpenCV 5 keeps among its extra modules."""
    import cv2

    create = getattr(cv2, "AKAZE_create", None) or getattr(getattr(cv2, "xfeatures2d", None), "AKAZE_create", None)
    if create is None:
        raise SetupError(
            f"this OpenCV ({cv2.__version__}) has no AKAZE: take sift or orb, or put opencv-contrib-python-headless in "
            "the place of opencv-python-headless"
        )
    return create(descriptor_type=4 if upright else 5, threshold=3e-4)  # MLDB, upright or turned with the feature


def _strongest(found, most, apart):
    """The strongest keypoints, some px apart."""
    from scipy.spatial import KDTree

    found = sorted(found, key=lambda point: -point.response)
    if not found:
        return []
    near = KDTree(np.array([point.pt for point in found])).query_ball_point([point.pt for point in found], apart)
    taken, kept = np.zeros(len(found), bool), []
    for number, point in enumerate(found):
        if not taken[number]:
            kept.append(point)
            taken[near[number]] = True
        if len(kept) == most:
            break
    return kept
