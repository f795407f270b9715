"""Whether the stated sigma of dense depth is the error that is found: bins, shares and the reliability diagram.

    python -m benchmarks.reliability [--scenes NAME ...] [--noise LEVEL ...] [--pictures FOLDER]

Scenes are some of `mitsuba/scenes`, rendered by other people's code, and some of `synthetic.py`, whose truth has no
error at all; n2 to n5 is the number of facets. Noise of a standard deviation in grey levels is added to the
photograph (seeded), and the sum rounded to 8 bits. What counts are the pixels whose true point another view sees
(as in `dense.py`), as far as they have a depth; all gross errors are in. Only a run of all the usual scenes and
levels is stored in results/reliability.json.

- complete: the share of the pixels that count that have a depth
- error/sigma: the 68th percentile of the error over its stated sigma; 1 is ideal, more: sigma is too small
- within 1, 2, 3: the share of errors within so many sigma; 68.3, 95.4 and 99.7 % of a normal distribution
- factor: by which stated sigma and the 68th percentile of errors differ, mean over ten bins of equal size; 1 is ideal
- chi: root mean square of the error over sigma; gross errors raise it
"""

import argparse
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from rich.progress import Progress

from benchmarks import dense, synthetic
from benchmarks.results import table, write
from benchmarks.synthetic import Ball, Plane, fading, prism_rig, quantised, take, texture
from cyclopean import Rig, reconstruct
from cyclopean.analysis.reliability import Reliability, reliability

BINS = 10
NOISE = (0.0, 2.0, 5.0, 10.0)  # grey levels
RENDERED = ("n2_round", "n3_bumpy", "n4_steps")  # the usual ones
MADE = {
    "n2_plane": lambda: take(prism_rig(2), Plane(800, texture(800), slope=0.3)),
    "n2_contrast": lambda: take(prism_rig(2), Plane(800, fading(800, 160.0))),
    "n3_soft": lambda: take(prism_rig(3, azimuth_deg=90), Plane(800, texture(800, grain=3.0), slope=0.2)),
    "n3_ball": lambda: take(
        prism_rig(3, azimuth_deg=90), Ball((0, 0, 650), 40, texture(600, at=200)), Plane(1000, texture(1000))
    ),
    "n4_board": lambda: take(
        prism_rig(4, azimuth_deg=45),
        Plane(560, texture(560, at=200), box=(-25, 25, -25, 25)),
        Plane(1000, texture(1000)),
    ),
}


@dataclass(frozen=True, eq=False)
class Scene:
    """A photograph without noise, and the true depth of the pixels that count."""

    rig: Rig
    light: np.ndarray  # (H, W) or (H, W, 3) grey levels
    depths: tuple[float, float]  # mm, to search
    step: int  # px between samples of the truth
    truth: np.ndarray  # (h, w) mm; NaN where a pixel does not count


@dataclass(frozen=True, eq=False)
class Errors:
    """What came of one photograph, for the pixels that count and have a depth."""

    errors: np.ndarray  # (N,) mm
    sigma: np.ndarray  # (N,) mm, as stated
    complete: float  # share of the pixels that count


def scene(name: str) -> Scene:
    """A scene by its name."""
    if name in MADE:
        shot = MADE[name]()
        return Scene(shot.rig, shot.light, synthetic.DEPTHS, 1, np.where(shot.common, shot.depth, np.nan))
    truth = dense.scene(name)
    rig = truth.setup.rig()
    masks = np.moveaxis(rig.masks[:, :: truth.step, :: truth.step], 0, -1)
    counted = masks.any(-1) & (dense.seen_by(rig, truth) & ~masks).any(-1)
    depth = np.where(counted, truth.points[..., 2], np.nan)
    return Scene(rig, truth.photograph.astype(float), dense.DEPTHS, truth.step, depth)


def measured(given: Scene, noise: float) -> Errors:
    """Errors of a scene with noise (grey levels), and their stated sigma."""
    found = reconstruct(quantised(given.light, noise), given.rig, given.depths)
    every = (slice(None, None, given.step),) * 2
    error, sigma = found.depth[every] - given.truth, found.sigma[every]
    known = np.isfinite(error)
    return Errors(error[known], sigma[known], known.sum() / np.isfinite(given.truth).sum())


def figures(found: Errors) -> dict[str, float]:
    """Figures of one photograph; NaN where it has hardly a depth."""
    if len(found.errors) < BINS:
        return {"complete_percent": 100 * found.complete}
    judged = reliability(found.errors, found.sigma, BINS)
    within = {f"within{k}_percent": 100 * share for k, share in enumerate(judged.shares, start=1)}
    return {
        "complete_percent": 100 * found.complete,
        "error_over_sigma_times": judged.ratio,
        **within,
        "factor_times": judged.factor,
        "chi_times": judged.chi,
    }


def together(found: Sequence[Errors]) -> Reliability:
    """Photographs pooled."""
    return reliability(
        np.concatenate([each.errors for each in found]), np.concatenate([each.sigma for each in found]), BINS
    )


def report(found: Mapping[tuple[str, float], Errors]) -> None:
    """Print a row for each photograph, and the bins of each level of noise with all scenes pooled."""
    columns = ["", "noise", "complete %", "error/sigma", "within 1 %", "2 %", "3 %", "factor", "chi"]
    keys = ("complete_percent", "error_over_sigma_times", "within1_percent", "within2_percent", "within3_percent")
    rows = []
    for (name, noise), errors in found.items():
        values = figures(errors)
        rows.append([name, f"{noise:g}", *(values.get(key) for key in (*keys, "factor_times", "chi_times"))])
    table("stated sigma against true errors", columns, rows)
    for noise, judged in by_noise(found).items():
        bins = zip(judged.counts.tolist(), judged.stated, judged.spread, judged.rms, strict=True)
        rows = [[k, *map(_number, row), float(row[2] / row[1])] for k, row in enumerate(bins, start=1)]
        columns = ["bin", "depths", "stated mm", "68th percentile mm", "rms mm", "68th / stated"]
        table(f"{noise}, all scenes", columns, rows)


def by_noise(found: Mapping[tuple[str, float], Errors]) -> dict[str, Reliability]:
    """All scenes pooled, for each level of noise."""
    levels = dict.fromkeys(noise for _, noise in found)
    return {f"noise {n:g} grey levels": together([e for (_, noise), e in found.items() if noise == n]) for n in levels}


def by_scene(found: Mapping[tuple[str, float], Errors]) -> dict[str, Reliability]:
    """All levels of noise pooled, for each scene."""
    names = dict.fromkeys(name for name, _ in found)
    return {n: together([errors for (name, _), errors in found.items() if name == n]) for n in names}


def draw(found: Mapping[tuple[str, float], Errors], folder: Path) -> None:
    """Write the diagrams, by noise and by scene."""
    from cyclopean.plotting.reliability import reliability_picture

    folder.mkdir(parents=True, exist_ok=True)
    for name, curves in (("noise", by_noise(found)), ("scenes", by_scene(found))):
        path = folder / f"reliability_{name}.png"
        reliability_picture(curves).savefig(path)
        print(f"wrote {path}")


def main() -> None:
    """Measure the scenes asked for, or the usual ones; store a run of all the usual."""
    usual = (*RENDERED, *MADE)
    parser = argparse.ArgumentParser(description="Whether the stated sigma of dense depth is the error that is found.")
    parser.add_argument("--scenes", nargs="+", metavar="NAME", default=list(usual), help=f"default: {', '.join(usual)}")
    parser.add_argument("--noise", nargs="+", type=float, metavar="LEVEL", default=list(NOISE), help="grey levels")
    parser.add_argument("--pictures", type=Path, metavar="FOLDER", help="where to write the diagrams")
    chosen = parser.parse_args()
    names = {*MADE, *(dense.scene_names() if set(chosen.scenes) - set(MADE) else ())}
    if unknown := set(chosen.scenes) - names:
        parser.error(f"no scene {', '.join(sorted(unknown))}; there are {', '.join(sorted(names))}")
    if not all(0 <= noise < np.inf for noise in chosen.noise):
        parser.error("noise is a standard deviation in grey levels: 0 or more")
    found = {}
    with Progress() as progress:
        task = progress.add_task("", total=len(chosen.scenes) * len(chosen.noise))
        for name in chosen.scenes:
            given = scene(name)
            for noise in chosen.noise:
                progress.update(task, description=f"{name}, noise {noise:g}")
                found[name, noise] = measured(given, noise)
                progress.advance(task)
    report(found)
    if chosen.pictures:
        draw(found, chosen.pictures)
    if set(usual) - set(chosen.scenes) or set(NOISE) - set(chosen.noise):
        print("not stored: that takes all the usual scenes and levels of noise")
        return
    stored = {}
    for (name, noise), errors in found.items():
        stored |= {f"{name}_noise{noise:g}_{key}": value for key, value in figures(errors).items()}
    write("reliability", stored)


def _number(value):
    return value if isinstance(value, int) else float(value)


if __name__ == "__main__":
    main()
