"""Measuring from points given in one sub-image, on photographs with known truth.

    python -m benchmarks.measuring [SCENE ...] [--points 100]

From every scene of `mitsuba/scenes` (those with dispersion apart) some points are drawn at random from the true
correspondences. Each is given as its exact pixel in the sub-image that it was drawn from, and found in the others with
the true setup, searching 600 to 1600 mm. As rendered, and with Gaussian noise of 2, 4 and 8 grey levels. Scenes of one
surface (bumpy, round, steps) are put together.

- found: the share of those points that another view truly shows that are not refused
- false: the share of the points found that lie more than 1 px off in some view, or more than 1 % off in depth; points
  count that no other view shows, and were found all the same (hidden)
- px, depth: distance of the found pixels from the true ones, and error of depth, medians of all points found
- good: the points graded "good", away from edges in depth: 68th and 95th percentile of the error of depth over its
  stated standard deviation (1 and 2 are ideal), and the share of those beyond three
- edge: the points graded "good" with an edge in depth (2 % or more) less than 12 px away in a sub-image: their share of
  all good ones, and the share of those beyond three standard deviations
- length: error of distances between points found, taken two by two, median in %
"""

import argparse
import json
from itertools import pairwise

import cv2
import numpy as np
from scipy.ndimage import maximum_filter

from benchmarks.data import data_folder, renderer_setup
from benchmarks.results import table, write
from cyclopean import measurement
from cyclopean.correspondence.window_search import prepare
from cyclopean.measurement.images import ImagePoint, evaluate, find_points

DEPTHS = (600.0, 1600.0)  # mm, searched
NOISE = (0.0, 2.0, 4.0, 8.0)  # grey levels
FALSE_PX, FALSE_SHARE = 1.0, 0.01
EDGE_PX, EDGE_SHARE = 12.0, 0.02  # half a window and some; change of depth
PERCENT = (68.27, 95.45)  # of a normal distribution within one and two standard deviations
SURE = 3.0  # standard deviations


def scenes() -> list[str]:
    """Scenes without dispersion."""
    folder = data_folder("mitsuba") / "scenes"
    return sorted(path.stem for path in folder.glob("*.png") if "chroma" not in path.stem)


def edges(truth) -> np.ndarray:
    """(H, W) bool: pixels near an edge in depth, from the true points on every `step`-th pixel."""
    step = int(truth["step"])
    depth, facet = truth["xyz"][..., 2], truth["facet"][::step, ::step]
    jumps = np.zeros(depth.shape, bool)
    for axis in (0, 1):
        first, second = (np.moveaxis(a, axis, 0) for a in (depth, facet))
        apart = np.abs(np.diff(first, axis=0)) > EDGE_SHARE * first[1:]
        found = apart & (second[1:] == second[:-1])
        view = np.moveaxis(jumps, axis, 0)
        view[1:] |= found
        view[:-1] |= found
    near = maximum_filter(jumps, size=2 * int(EDGE_PX / step) + 1)
    return near.repeat(step, 0).repeat(step, 1)


def measure_scene(name: str, count: int, noise: float) -> list[dict]:
    """One record for each point of a scene that was drawn."""
    stem = data_folder("mitsuba") / "scenes" / name
    rig = renderer_setup(json.loads(stem.with_suffix(".json").read_text())["rig"]).rig()
    rng = np.random.default_rng(3)
    photograph = cv2.cvtColor(cv2.imread(str(stem.with_suffix(".png"))), cv2.COLOR_BGR2RGB)
    if noise:
        noisy = photograph + rng.normal(0, noise, photograph.shape)
        photograph = np.clip(noisy.round(), 0, 255).astype(np.uint8)
    truth = np.load(stem.with_suffix(".npz"))
    points, pixels = truth["match_xyz"].astype(float), truth["match_uv"].astype(float)
    home = truth["match_from"].astype(int)
    inside = np.array([rig[k].region.contains(places[k]) for k, places in zip(home, pixels, strict=True)])
    inside &= (points[:, 2] > DEPTHS[0]) & (points[:, 2] < DEPTHS[1])
    rows = rng.permutation(np.flatnonzero(inside))[:count]
    picture, near = prepare(photograph, rig), edges(truth)
    return [measure_point(picture, rig, pixels[i], home[i], points[i], near) for i in rows]


def measure_point(picture, rig, pixels, home, point, near):
    """What was found of one point, beside the truth."""
    given = [ImagePoint(tuple(pixels[home]))]
    located = find_points(picture, rig, given, DEPTHS, pointing=0.0)
    found = evaluate("point", given, located)
    seen = np.isfinite(pixels[:, 0])
    column, row = np.rint(pixels[seen]).astype(int).T
    away = np.linalg.norm(located.pixels[0] - pixels, axis=-1)
    away[home] = np.nan
    depth = abs(located.points[0, 2] - point[2])
    wrong = np.nanmax(away, initial=0.0) > FALSE_PX or depth > FALSE_SHARE * point[2]
    return {
        "point": located.points[0], "covariance": located.covariance[0], "truth": point, "away": away, "depth": depth,
        "found": bool(located.found[0]), "shown": seen.sum() >= 2, "wrong": bool(wrong or seen.sum() < 2),
        "good": found.grade == "good", "edge": bool(near[row, column].any()),
    }  # fmt: skip


def judged(records: list[dict]) -> dict[str, float]:
    """Figures of many points."""
    column = {key: np.array([record[key] for record in records]) for key in records[0] if key != "away"}
    found, good, edge = column["found"], column["good"], column["edge"]
    away = np.concatenate([record["away"] for record in records if record["found"]])
    with np.errstate(invalid="ignore"):
        over = column["depth"] / np.sqrt(column["covariance"][:, 2, 2])
    one, two = np.percentile(over[good & ~edge], PERCENT)
    return {
        "found_percent": 100 * found[column["shown"]].mean(),
        "false_percent": 100 * column["wrong"][found].mean(),
        "hidden_points": float(np.sum(~column["shown"])),
        "hidden_points_found": float(np.sum(found & ~column["shown"])),
        "error_median_px": np.nanmedian(away),
        "depth_median_mm": np.median(column["depth"][found]),
        "good_68_percent_over_sigma_times": one,
        "good_95_percent_over_sigma_times": two,
        "good_beyond_3_sigma_percent": 100 * (over[good & ~edge] > SURE).mean(),
        "edge_share_of_good_percent": 100 * edge[good].mean(),
        "edge_beyond_3_sigma_percent": 100 * (over[good & edge] > SURE).mean() if (good & edge).any() else np.nan,
        "length_median_percent": 100 * np.median(lengths(column["point"][found], column["truth"][found])),
    }


def lengths(points, truth):
    """Errors of distances between neighbours in the list, as shares of them."""
    pairs = np.array(list(pairwise(range(len(points)))))
    true = np.linalg.norm(np.diff(truth[pairs], axis=1)[:, 0], axis=-1)
    return abs(measurement.distance(points[pairs]).value - true) / true


def main() -> None:
    """Measure, print and store."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scenes", nargs="*")
    parser.add_argument("--points", type=int, default=100, help="of each scene")
    given = parser.parse_args()
    names = given.scenes or scenes()
    kinds = sorted({name.split("_")[-1] for name in names})
    figures, rows = {}, []
    for kind in kinds:
        for noise in NOISE:
            alike = [name for name in names if name.split("_")[-1] == kind]
            found = judged([record for name in alike for record in measure_scene(name, given.points, noise)])
            figures |= {f"{kind}_noise{noise:g}_{key}": value for key, value in found.items() if np.isfinite(value)}
            rows.append((kind, f"{noise:g}", *found.values()))
    head = (
        "surface",
        "noise",
        "found %",
        "false %",
        "hidden",
        "found",
        "px",
        "depth mm",
        "68 %/s",
        "95 %/s",
        "> 3 s %",
    )
    table("error over stated sigma: points graded good", (*head, "edge %", "edge > 3 s %", "length %"), rows)
    if not given.scenes:
        write("measuring", figures)


if __name__ == "__main__":
    main()
