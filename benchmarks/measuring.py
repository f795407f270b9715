"""Measuring from points given in one sub-image, on photographs with known truth.

    python -m benchmarks.measuring [SCENE ...] [--points 200]

From every scene of `mitsuba/scenes` (those with dispersion apart) some points are drawn at random from the true
correspondences. Each is given as its exact pixel in the sub-image that it was drawn from, and found in the others with
the true setup, searching 600 to 1600 mm. Once as rendered, and once with Gaussian noise of 2 grey levels.

- found: the share of those points that another view truly shows that are not refused
- false: the share of the points found that lie more than 1 px off in some view, or more than 1 % off in depth; points
  count that no other view shows, and were found all the same
- px: distance of the found pixels from the true ones, median and 95th percentile
- depth: error of depth, median, in mm; and the 68th percentile of the error over its stated standard deviation, for all
  points found, false ones included; 1 is ideal
- length: error of distances between points found, taken two by two, median in mm and in %; and again over their stated
  standard deviation
"""

import argparse
import json
from itertools import pairwise

import cv2
import numpy as np

from benchmarks.data import data_folder, renderer_setup
from benchmarks.results import table, write
from cyclopean import measurement
from cyclopean.correspondence.window_search import prepare
from cyclopean.correspondence.windows import locate

DEPTHS = (600.0, 1600.0)  # mm, searched
NOISE = (0.0, 2.0)  # grey levels
FALSE_PX, FALSE_SHARE = 1.0, 0.01
ONE_SIGMA_PERCENT = 68.27


def scenes() -> list[str]:
    """Scenes without dispersion."""
    folder = data_folder("mitsuba") / "scenes"
    return sorted(path.stem for path in folder.glob("*.png") if "chroma" not in path.stem)


def measure_scene(name: str, count: int, noise: float) -> dict[str, float]:
    """Figures of one scene."""
    stem = data_folder("mitsuba") / "scenes" / name
    rig = renderer_setup(json.loads(stem.with_suffix(".json").read_text())["rig"]).rig()
    rng = np.random.default_rng(3)
    photograph = cv2.cvtColor(cv2.imread(str(stem.with_suffix(".png"))), cv2.COLOR_BGR2RGB)
    if noise:
        noisy = photograph + rng.normal(0, noise, photograph.shape)
        photograph = np.clip(noisy.round(), 0, 255).astype(np.uint8)
    truth = np.load(stem.with_suffix(".npz"))
    true_points, true_pixels = truth["match_xyz"].astype(float), truth["match_uv"].astype(float)
    home = truth["match_from"].astype(int)
    inside = np.array([rig[k].region.contains(pixels[k]) for k, pixels in zip(home, true_pixels, strict=True)])
    inside &= (true_points[:, 2] > DEPTHS[0]) & (true_points[:, 2] < DEPTHS[1])
    rows = rng.permutation(np.flatnonzero(inside))[:count]
    picture = prepare(photograph, rig)
    found = [locate(picture, rig, int(home[i]), true_pixels[i, home[i]], DEPTHS) for i in rows]
    return judged(rows, found, true_points, true_pixels, home)


def judged(rows, found, true_points, true_pixels, home):
    """Figures of points found beside the true ones."""
    accepted = np.array([f.found[0] for f in found])
    shown = np.isfinite(true_pixels[rows, :, 0]).sum(1) >= 2
    pixels, points = np.array([f.pixels[0] for f in found]), np.array([f.points[0] for f in found])
    covariance = np.array([f.covariance[0] for f in found])
    away = np.linalg.norm(pixels - true_pixels[rows], axis=-1)
    away[np.arange(len(rows)), home[rows]] = np.nan
    depth = np.abs(points[:, 2] - true_points[rows, 2])
    wrong = (np.nan_to_num(away).max(1) > FALSE_PX) | (depth > FALSE_SHARE * true_points[rows, 2])
    error, share, ratio = lengths(points[accepted], covariance[accepted], true_points[rows][accepted])
    known = away[accepted][np.isfinite(away[accepted])]
    over = depth[accepted] / np.sqrt(covariance[accepted, 2, 2])
    return {
        "found_percent": 100 * accepted[shown].mean(),
        "false_percent": 100 * (wrong | ~shown)[accepted].mean(),
        "error_median_px": np.median(known),
        "error_95_px": np.percentile(known, 95),
        "depth_median_mm": np.median(depth[accepted]),
        "depth_over_sigma_times": np.percentile(over, ONE_SIGMA_PERCENT),
        "length_median_mm": np.median(error),
        "length_median_percent": 100 * np.median(share),
        "length_over_sigma_times": np.percentile(ratio, ONE_SIGMA_PERCENT),
    }


def lengths(points, covariance, truth):
    """Errors of distances between neighbours in the list: mm, share, over the stated standard deviation."""
    rows = []
    for a, b in pairwise(range(len(points))):
        measured = measurement.distance(points[[a, b]], covariance[[a, b]])
        length = np.linalg.norm(truth[a] - truth[b])
        error = abs(measured.value - length)
        rows.append((error, error / length, error / measured.sigma))
    return np.array(rows).T


def main() -> None:
    """Measure, print and store."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scenes", nargs="*")
    parser.add_argument("--points", type=int, default=200)
    given = parser.parse_args()
    figures = {}
    for noise in NOISE:
        rows = []
        for name in given.scenes or scenes():
            found = measure_scene(name, given.points, noise)
            figures |= {f"{name}_noise{noise:g}_{key}": value for key, value in found.items()}
            rows.append((name, *found.values()))
        head = ("scene", "found %", "false %", "px", "px 95 %", "depth mm", "/sigma", "length mm", "length %", "/sigma")
        table(f"noise of {noise:g} grey levels", head, rows)
    if not given.scenes:
        write("measuring", figures)


if __name__ == "__main__":
    main()
