"""Whether the loop closes: simulate, calibrate, reconstruct, and compare the errors with those that are foretold.

    python -m benchmarks.closed_loop [--facets N ...] [--repeats N] [--full] [--pictures FOLDER]

For 2 to 5 facets a prism as in the thesis stands before a camera with an open aperture (f/8), and photographs are
simulated: a board through the prism, the board without it, and a wavy surface that fills the picture, with a ball in
front of it. Half of the surface is speckle, as laboratories spray it, and half smooth random grey, as nature has it, in
patches like a chessboard; dots and bumps are 4 px wide, the middle of the 3 to 5 px that laboratories aim at. The
sensor has a full well of 10000 electrons, 5 of read noise and 8 bits, as machine cameras have. 16 rays a pixel leave
the scatter of the rays far below that noise.

Each repeat is another experiment: another drawing at random that errs by the usual tolerances (`standard_tolerances`),
another texture, other rays and other noise in every photograph. Our detector finds the corners, `calibrate` starts from
the drawing, `reconstruct` takes the calibrated setup. What is foretold is the calibration's covariance and the sigma of
each depth. Every figure is a chi-square over its degrees of freedom, so that 1 is ideal, as the mean of the repeats
with its standard error.

- total: mean of (error / sigma)^2 over all depths, sigma that of matching and calibration together; by texture too
- calibration: parameters against the true setup, with their whole covariance
- matching: as total, of depths by the true setup, so that matching alone is judged; by texture, and without noise
- whole: depths of pixels 16 px apart or more, no point of the scene twice, with the whole covariance: what the
  calibration moves, it moves together
- cloud: the same with the points of the fused cloud, whose sigma counts the maps of several views as one

Depths count where another view sees the point and no edge in depth is within 8 px. `--full` takes 1280 x 960 px
instead of 640 x 480. Only a run of all facets is stored.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from benchmarks.closed_loop_scene import CAMERA, DEPTHS, SAMPLES, Shot, real_setup, shoot
from benchmarks.results import table, write
from cyclopean import Setup, calibrate, observe, reconstruct
from cyclopean.analysis import standard_tolerances, usual_plan
from cyclopean.analysis.chi_square import (
    ChiSquare,
    calibration_chi_square,
    calibration_shifts,
    chi_square,
)
from cyclopean.analysis.tolerance_calibration import observe as foretold_corners
from cyclopean.calibration import Calibration
from cyclopean.calibration.unknowns import Unknowns
from cyclopean.jobs.calibration_photographs import clear_of_seams
from cyclopean.pipeline import Reconstruction
from cyclopean.simulation import Scene, render
from cyclopean.simulation.prints import board_surface
from cyclopean.simulation.sensor import Sensor
from cyclopean.targets import Board, Observations

FACETS = (2, 3, 4, 5)
SENSOR = Sensor(full_well_electrons=10_000, read_noise_electrons=5, exposure=1.0, blur_sigma=0.5)
NOISELESS = Sensor(exposure=1.0, blur_sigma=0.5)
APART = 16  # px between pixels that have nothing in common
EVERY = 3  # px between pixels of which figures of all depths are taken


def drawn(setup: Setup, tolerances: dict[str, float], rng: np.random.Generator) -> Setup:
    """A drawing of the setup that errs by its tolerances (standard deviations, mm, rad, px)."""
    known = Unknowns.of([setup], tuple(tolerances), tolerances)
    return known.setup(known.start + rng.normal(0, known.spread))


def calibrated(
    setup: Setup,
    drawing: Setup,
    tolerances: dict[str, float],
    repeat: int,
    *,
    photos: int = 10,
    direct_photos: int = 5,
    samples: int = SAMPLES,
) -> Calibration:
    """What our calibration finds in simulated photographs of a board in the poses of a usual plan.

    As the command does it: in the sub-images of the drawing first, then in those of what that gave.
    """
    plan = usual_plan(setup, DEPTHS, photos=photos, direct_photos=direct_photos)
    board = plan.target
    assert isinstance(board, Board)
    number = 1000 * repeat

    def photographed(poses, with_optic):
        nonlocal number
        pictures = []
        for pose in poses:
            scene = Scene((board_surface(board, pose),), background=(0.15,))
            light = render(setup, scene, samples=samples, with_optic=with_optic, seed=number)
            pictures.append((str(number), SENSOR.expose(light, number)))
            number += 1
        return pictures

    through = photographed(plan.poses, True)
    without = observe(photographed(plan.direct_poses, False), board, None)[0]

    def fitted(known, margin):
        seen = observe(through, board, known.rig().masks)[0]
        seen = Observations.join([clear_of_seams(seen, known.rig(), margin) if margin else seen, without])
        return calibrate(seen, board, drawing, tuple(tolerances), tolerances=tolerances)

    return fitted(fitted(drawing, 0.02 * drawing.camera.size[0]).setup, 0.0)


def calibrated_by_corners(
    setup: Setup, drawing: Setup, tolerances: dict[str, float], repeat: int, noise: float = 0.01
) -> Calibration:
    """The same from true corners with noise (px) in place of photographs."""
    plan = usual_plan(setup, DEPTHS, photos=10, direct_photos=5, sigma=noise)
    seen = foretold_corners(setup, plan, np.random.default_rng([repeat, 7]))
    return calibrate(seen, plan.target, drawing, tuple(tolerances), tolerances=tolerances)


@dataclass(frozen=True, eq=False)
class Outcome:
    """What came of one experiment."""

    calibration: ChiSquare
    whole: ChiSquare
    cloud: ChiSquare
    total: dict[str, float]  # mean of (error / sigma)^2 of all depths ("all") and of each texture
    matching: dict[str, float]  # the same of depths by the true setup, and of a photograph without noise ("noiseless")
    bias: dict[str, float]  # mean of error / sigma of depths by the true setup, likewise
    normalised: np.ndarray  # (N,) errors over total sigma
    common: float  # mean error of depths over what the calibration foretells for it
    found: float  # mm, root mean square error
    foretold: float  # mm, the same as foretold
    by_calibration: float  # mm, the calibration's part of it
    complete: float  # share of the pixels that count that have a depth
    sigma0: float  # of the calibration: what the corners' stated sigma is to be multiplied by


def experiment(setup: Setup, repeat: int, *, boards: bool = True, alone: bool = True, **plan: int) -> Outcome:
    """One round of the loop.

    `boards` False takes true corners with noise in place of photographs; `alone` judges matching by itself too.
    `plan` goes to `calibrated`.
    """
    tolerances = {name: float(sigma) for name, sigma in standard_tolerances(setup).items()}
    shot = shoot(setup, repeat)
    drawing = drawn(setup, tolerances, np.random.default_rng([len(shot.truth.rig), repeat]))
    if boards:
        calibration = calibrated(setup, drawing, tolerances, repeat, **plan)
    else:
        calibration = calibrated_by_corners(setup, drawing, tolerances, repeat)
    photograph = SENSOR.expose(shot.light, 1000 * repeat + 999)
    matching, bias = {}, {}
    if alone:
        for name, picture in (("", photograph), ("noiseless", NOISELESS.expose(shot.light))):
            scaled, grey = _alone(shot, reconstruct(picture, shot.truth.rig, DEPTHS))
            matching |= {"noiseless": _square(scaled)} if name else _squares(scaled, grey)
            bias[name or "all"] = float(scaled.mean())
    return judged(shot, calibration, reconstruct(photograph, calibration.setup.rig(), DEPTHS), matching, bias)


def judged(
    shot: Shot, calibration: Calibration, found: Reconstruction, matching: dict[str, float], bias: dict[str, float]
) -> Outcome:
    """Errors of a reconstruction against what calibration and matching foretell."""
    truth = shot.truth
    counts = shot.counted & np.isfinite(found.depth) & (found.view == truth.facet)
    rows, columns = np.nonzero(_grid(counts, EVERY))
    error = found.depth[rows, columns] - truth.depth[rows, columns]
    moves = calibration_shifts(calibration, truth.points[rows, columns])[:, 2]
    sigma, common = found.sigma[rows, columns].astype(float), np.linalg.norm(moves, axis=-1)
    known = np.isfinite(error / sigma + common)  # the calibration may place a point beyond another view's edge
    error, moves, sigma, common = (part[known] for part in (error, moves, sigma, common))
    scaled = error / np.hypot(sigma, common)
    whole, cloud = _whole(shot, calibration, found)
    return Outcome(
        calibration=calibration_chi_square(calibration, shot.setup),
        whole=whole,
        cloud=cloud,
        total=_squares(scaled, shot.grey[rows, columns][known]),
        matching=matching,
        bias=bias,
        normalised=scaled,
        common=float(error.mean() / np.linalg.norm(moves.mean(0))),
        found=float(np.sqrt(_square(error))),
        foretold=float(np.sqrt(_square(np.hypot(sigma, common)))),
        by_calibration=float(np.sqrt(_square(common))),
        complete=float(counts.sum() / shot.counted.sum()),
        sigma0=calibration.solution.sigma0,
    )


def _alone(shot, found):
    """Errors of depths by the true setup over their sigma, and which lie on smooth random grey."""
    good = shot.counted & np.isfinite(found.depth) & (found.view == shot.truth.facet)
    return ((found.depth - shot.truth.depth) / found.sigma)[good], shot.grey[good]


def _whole(shot, calibration, found):
    """Chi-square of depths that have nothing in common but the calibration: of the maps, and of the cloud."""
    x, y = found.pixels.T  # each point of the scene once
    chosen = shot.counted[y, x] & (x % APART == 0) & (y % APART == 0) & (found.view[y, x] == shot.truth.facet[y, x])
    x, y, points = x[chosen], y[chosen], found.points[chosen]
    true = shot.truth.depth[y, x]
    moves = calibration_shifts(calibration, points)[:, 2:]
    variance = found.sigma[y, x].astype(float) ** 2
    return (
        chi_square((found.depth[y, x] - true)[:, None], variance[:, None, None], moves),
        chi_square((points[:, 2] - true)[:, None], found.covariance[chosen][:, 2:, 2:], moves),
    )


def _grid(good, step):
    """The good pixels of every row and column number that `step` divides."""
    some = np.zeros_like(good)
    some[::step, ::step] = good[::step, ::step]
    return some


def _squares(values, grey):
    """Mean squares of all values and of those on each texture."""
    return {"all": _square(values), "speckle": _square(values[~grey]), "grey": _square(values[grey])}


def _square(values):
    return float(np.mean(values**2))


def figures(outcomes: Sequence[Outcome]) -> dict[str, float]:
    """Means of the repeats with the same number of facets, and standard errors of the means."""
    values: dict[str, list[float]] = {}
    for one in outcomes:
        each = {f"total_{name}_reduced": value for name, value in one.total.items()}
        each |= {f"matching_{name}_reduced": value for name, value in one.matching.items()}
        each |= {f"bias_{name}_sigma": value for name, value in one.bias.items()}
        each |= {f"{name}_reduced": getattr(one, name).reduced for name in ("calibration", "whole", "cloud")}
        each |= {f"{name}_mm": getattr(one, name) for name in ("found", "foretold", "by_calibration")}
        each |= {f"within{k}_percent": 100 * float(np.mean(np.abs(one.normalised) < k)) for k in (1, 2, 3)}
        each |= {"common_reduced": one.common**2, "complete_share": one.complete, "sigma0_times": one.sigma0}
        for name, value in each.items():
            values.setdefault(name, []).append(value)
    result = {name: float(np.mean(some)) for name, some in values.items()} | {"repeats_count": float(len(outcomes))}
    if len(outcomes) > 1:
        for name, some in values.items():
            result[f"{name}_error"] = float(np.std(some, ddof=1) / np.sqrt(len(some)))
    return result


def draw(found: dict[int, list[Outcome]], path: Path) -> None:
    """Histograms of errors over total sigma, for each number of facets, beside the normal distribution."""
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot

    figure, axes = pyplot.subplots(1, len(found), figsize=(3.2 * len(found), 3), sharey=True, squeeze=False)
    at, bins = np.linspace(-5, 5, 201), np.linspace(-5, 5, 81)
    for axis, (n, outcomes) in zip(axes[0], found.items(), strict=True):
        for one in outcomes:
            axis.hist(one.normalised, bins=bins, density=True, histtype="step", color="0.75")
        values = np.concatenate([one.normalised for one in outcomes])
        axis.hist(values, bins=bins, density=True, histtype="step", color="C0", lw=1.8)
        axis.plot(at, np.exp(-(at**2) / 2) / np.sqrt(2 * np.pi), color="C1", lw=1.5)
        axis.set_title(f"{n} facets: mean square {figures(outcomes)['total_all_reduced']:.2f}", fontsize=10)
        axis.set_xlim(-5, 5)
        axis.set_xlabel("error / foretold sigma")
        axis.spines[["top", "right"]].set_visible(False)
    axes[0, 0].set_ylabel("density")
    figure.suptitle("Depth errors over total sigma: each repeat grey, all repeats blue, normal orange", fontsize=11)
    figure.tight_layout()
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, dpi=120)
    pyplot.close(figure)
    print(f"wrote {path}")


_COLUMNS = {
    "total_all_reduced": "total",
    "total_speckle_reduced": "speckle",
    "total_grey_reduced": "grey",
    "whole_reduced": "whole",
    "calibration_reduced": "calibration",
    "matching_all_reduced": "matching",
    "bias_all_sigma": "bias",
}


def main() -> None:
    """Close the loop for the numbers of facets asked for; a run of all is stored."""
    parser = argparse.ArgumentParser(description="Whether the loop of simulation, calibration and depth closes.")
    parser.add_argument("--facets", nargs="+", type=int, choices=FACETS, default=list(FACETS), metavar="N")
    parser.add_argument("--repeats", type=int, default=6, metavar="N", help="experiments of each; default: 6")
    parser.add_argument("--full", action="store_true", help="1280 x 960 px")
    parser.add_argument("--pictures", type=Path, metavar="FOLDER", help="where to write the histograms")
    chosen = parser.parse_args()
    camera, size = (CAMERA, "full") if chosen.full else (CAMERA.with_larger_pixels(2), "half")
    found: dict[int, list[Outcome]] = {n: [] for n in chosen.facets}
    for repeat in range(chosen.repeats):
        for n in chosen.facets:
            found[n].append(experiment(real_setup(n, camera), repeat))
            values = figures(found[n][-1:])
            print(f"{n} facets, {repeat}: " + ", ".join(f"{key} {values[key]:.2f}" for key in _COLUMNS), flush=True)
        if set(chosen.facets) == set(FACETS):  # what is done is kept
            stored = {n: figures(outcomes) for n, outcomes in found.items()}
            write("closed_loop", {f"{size}_n{n}_{key}": v for n, values in stored.items() for key, v in values.items()})
        if chosen.pictures:
            draw(found, chosen.pictures / f"closed_loop_{size}.png")
    rows = []
    for n, outcomes in found.items():
        values = figures(outcomes)
        spreads = {key: f" +- {values[f'{key}_error']:.2f}" for key in _COLUMNS if len(outcomes) > 1}
        cells = [f"{values[key]:.2f}{spreads.get(key, '')}" for key in _COLUMNS]
        rows.append([f"{n}", *cells])
    table("chi-square over degrees of freedom, with standard errors", ["facets", *_COLUMNS.values()], rows)


if __name__ == "__main__":
    main()
