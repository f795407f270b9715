"""What looks wrong in a finished calibration, in plain words."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np

from ..errors import CyclopeanError
from ..targets import DIRECT
from .depths import depth_errors, rig_points, rms, target_depths
from .guess import renumbered
from .held import SIGNIFICANT, HeldTest, freed, sentence, tests_of_held
from .odd_views import odd_views
from .physical import Calibration, calibrate, recalibrate
from .prediction import views_of
from .unknowns import kind_of

_MISFIT = 3.0  # times the stated noise of detected points
_FAR = 3.0  # times what the drawing leaves open
_ALIKE, _ALIKE_ANGLE = 0.03, np.deg2rad(5.0)  # of the distance; between the normals
_OUTSIDE, _OUTSIDE_PX = 0.05, 4  # share of points that may lie so far outside their sub-image
_GROWN = 0.03  # distance and shifts: a factor that a mistaken length of the target may hide behind
_WORTH = 0.1  # share of the residuals' size by which a freed parameter must lower them to explain a misfit


def warnings_of(calibration: Calibration) -> tuple[str, ...]:
    """Plain warnings about a finished calibration; empty where nothing looks wrong.

    Looks at the size of the residuals, photographs and views that disagree with the rest, what the photographs ask
    of held parameters (`tests_of_held`), parameters far from the drawing, seams, the choice of photographs, and
    the scale. The likeliest culprit is tried: one further calibration at most.
    """
    odd = _odd_views(calibration)
    tests = _asked_for(calibration)
    found = [
        *calibration.left_out,
        *odd,
        *_unseen(calibration),
        *_misfit(calibration, tests, bool(odd)),
        *_far(calibration),
        *_seams(calibration),
    ]
    return tuple(found + _alike(calibration) + _scale(calibration))


def _odd_views(calibration):
    """Photographs of which one view, or all, fit much worse than the rest."""
    seen = calibration.observations
    points = np.asarray(calibration.target.points, dtype=float)[seen.point]
    try:
        views = views_of(calibration.setup)
    except CyclopeanError:  # an optic that shows nothing; `_seams` says so
        views = {}
    return [odd.text for odd in odd_views(seen, calibration.residuals, points, views)]


def _unseen(calibration):
    """Views that never show the target."""
    try:
        count = len(calibration.setup.optic.paths(calibration.setup.wavelength_nm))
    except CyclopeanError:
        return []
    unseen = sorted(set(range(count)) - set(np.unique(calibration.observations.view).tolist()))
    if not unseen or count == 1:
        return []
    names = " and ".join(f"view {number}" for number in unseen)
    return [
        f"{names} never show{'s' if len(unseen) == 1 else ''} the target: what only these facets or mirrors tell rests "
        "on the drawing. Has the optic as many views as the setup file says? Photograph the target where they see it"
    ]


def _asked_for(calibration):
    """Tests of held parameters that matter, best explanation first."""
    try:
        known = rms(depth_errors(calibration, target_depths(calibration, 3), samples=12).calibration)
    except CyclopeanError:
        known = 0.0
    return [
        test
        for test in tests_of_held(calibration)
        if abs(test.z) > SIGNIFICANT and test.plausible and test.visible and not test.depth_change < known
    ]


def _misfit(calibration, tests: list[HeldTest], odd):
    """Whether the model fits, and which held parameter would explain it if not."""
    size, lines = calibration.solution.sigma0, []
    best = _tried(calibration, tests[0]) if tests else None
    left = calibration.rms if best is None else best.rms
    explains = left < (1 - _WORTH) * calibration.rms and size * left / calibration.rms < _MISFIT
    if size > _MISFIT:
        lines.append(
            f"residuals are {size:.{0 if size > 9.5 else 1}f} times the noise of the detected points: the model does "
            "not fit"
        )
        if not explains:
            lines += _facing(calibration)
        if not (odd or explains or len(lines) > 1):
            lines[0] += ". Wrong number of facets? Wrong facing? Was the focus changed (free camera.focal)?"
        lines += _facets(calibration, left if explains else calibration.rms)
    if best is None or len(lines) > 1 or ((odd or lines) and not explains):
        return lines
    line = sentence(best, calibration)
    if explains:
        gain = calibration.rms - best.rms
        rivals = [test.name for test in tests if test.name != best.name and calibration.rms - test.rms > 0.8 * gain]
        instead = f"; {' or '.join(rivals[:3])} would do nearly as well" if rivals else ""
        line += f" (residuals of {best.rms:.3f} px instead of {calibration.rms:.3f}{instead})"
    return [*lines, line]


def _facing(calibration):
    """Whether facets to the other side, or numbered the other way round, explain a misfit far better."""
    setup, seen = calibration.unknowns.setups[0], calibration.observations
    facing = getattr(setup.optic, "facing", None)
    if facing is None or len(calibration.setups) > 1:
        return []
    other = replace(
        setup.optic,
        facing="camera" if facing == "scene" else "scene",
        azimuth_deg=180.0 - setup.optic.azimuth_deg,  # turned about y
    )
    backwards = renumbered(seen, -np.arange(setup.optic.facets) % setup.optic.facets)
    turned = f'with facing = "{other.facing}" and azimuth_deg = {other.azimuth_deg:g}'
    reverse = "with the views numbered the other way round"
    tries = ((other, seen, turned), (other, backwards, f"{turned}, and {reverse}"), (setup.optic, backwards, reverse))
    free = [name for name in calibration.unknowns.names if name in setup.parameter_names]
    found = []
    for optic, rows, words in tries:
        try:
            result = calibrate(rows, calibration.target, replace(setup, optic=optic), free, iterations=20)
        except CyclopeanError:
            continue
        found.append((result.rms, words))
    left, words = min(found, default=(np.inf, ""))
    if not left < 0.3 * calibration.rms:
        return []
    return [f"{words}, residuals are {left:.3f} px instead of {calibration.rms:.3f}: correct the drawing"]


def _facets(calibration, size):
    """Whether facets that deviate explain a misfit far better than anything else."""
    free = tuple(re.sub(r"\[\d+\]", "", name) for name in calibration.unknowns.names)
    missing = [name for name in calibration.setup.parameter_names if re.match(r"optic\.facet\d+_", name)]
    if not set(missing) - set(free):
        return []
    try:
        result = recalibrate(calibration, free=(*free, "optic.facets"), poses=calibration.poses)
    except CyclopeanError:
        return []
    if not result.rms < 0.5 * size:
        return []
    return [
        f"the facets deviate from the drawing: free optic.facets (residuals of {result.rms:.3f} px instead of "
        f"{calibration.rms:.3f})"
    ]


def _tried(calibration, test):
    try:
        return freed(calibration, test)
    except CyclopeanError:  # no such optic: the first-order answer must do
        return test


def _far(calibration):
    """Parameters that ended far from the drawing."""
    unknowns = calibration.unknowns
    lines = []
    for name, start, spread, value in zip(
        unknowns.names, unknowns.start, unknowns.spread, calibration.solution.shared, strict=True
    ):
        off = abs(value - start) / spread
        if off > _FAR:
            kind = kind_of(name)
            unit = f" {kind.unit}" if kind.unit else ""
            lines.append(
                f"{name} ended at {kind.factor * value:.4g}{unit}, {off:.1f} times the expected tolerance from the "
                f"drawing's {kind.factor * start:.4g}{unit}: is the drawing right?"
            )
    return lines


def _seams(calibration):
    """Sub-images whose seams lie elsewhere than the calibration puts them."""
    from scipy.ndimage import maximum_filter

    seen, astray = calibration.observations, {}
    for channel, setup in enumerate(calibration.setups):
        try:
            views = setup.rig()
        except CyclopeanError as fault:
            return [f"the calibrated optic cannot be right: {fault}"]
        for number, view in enumerate(views):
            pixels = seen.pixels[(seen.view == number) & (seen.channel == channel)]
            if not len(pixels):
                continue
            near = maximum_filter(view.region.traced, size=2 * _OUTSIDE_PX + 1)
            column, row = np.clip(np.rint(pixels).astype(int), 0, np.array(near.shape)[::-1] - 1).T
            share = float(np.mean(~near[row, column]))
            if share > _OUTSIDE:
                astray[number] = f"{100 * share:.0f} % of those of view {number}"
    if not astray:
        return []
    return [
        f"points lie outside the sub-images that the calibrated optic gives ({', '.join(astray.values())}): the seams "
        "are not where the calibration puts them. Give optic.shift_x and optic.shift_y a smaller tolerance, and look "
        "at what was held"
    ]


def _alike(calibration):
    """Photographs that all say the same."""
    seen = calibration.observations
    numbers = np.unique(seen.photo[seen.view != DIRECT])
    if len(numbers) == 1:
        return ["only one photograph was taken through the optic: take some with the board tilted, near and far"]
    if not len(numbers):
        return []
    points = rig_points(calibration)
    middles = np.array([points[seen.photo == k].mean(0) for k in numbers])
    normals = np.array([calibration.poses[k].rotation[:, 2] for k in numbers])
    mean = normals.mean(0) / np.linalg.norm(normals.mean(0))
    angle = float(np.arccos(np.clip(normals @ mean, -1, 1)).max())
    spread = np.linalg.norm(middles - middles.mean(0), axis=-1).max() / np.linalg.norm(middles.mean(0))
    if angle < _ALIKE_ANGLE and spread < _ALIKE:
        return [
            f"all {len(numbers)} photographs are alike: the board is tilted by {np.degrees(angle):.1f} degrees at most "
            f"between them and moved by {100 * spread:.1f} % of its distance; tilt it by 20 to 40 degrees, and move it"
        ]
    return []


def _scale(calibration):
    """Distance and shifts that grew by one factor: the square length may be wrong."""
    found = calibration.values
    start = dict(zip(calibration.unknowns.names, calibration.unknowns.start, strict=True))
    lengths = [name for name in ("optic.distance", "optic.shift_x", "optic.shift_y") if name in found]
    known = [name for name in lengths if abs(start[name]) > 5 * calibration.sigma[name] and start[name] != 0]
    if len(known) < 2:
        return []
    ratios = np.array([found[name] / start[name] for name in known])
    errors = np.array([calibration.sigma[name] / abs(start[name]) for name in known])
    weights = 1 / errors**2
    factor = float(np.sum(weights * ratios) / np.sum(weights))
    same = np.all(np.abs(ratios - factor) < 3 * errors + 0.1 * abs(factor - 1))
    if same and abs(factor - 1) > _GROWN:
        return [
            f"{', '.join(known[:-1])} and {known[-1]} are all {factor:.3f} times what the drawing says: is the square "
            "length right? A board that is larger by a factor makes all lengths larger by it"
        ]
    return []
