"""Dense depth of real photographs by ordinary cameras, with true disparities, beside OpenCV's.

    python -m benchmarks.dense_real [--maps FOLDER]

The sets are Tsukuba (five pictures on one line, of Nakamura and Ohta, truth in the third) and Aloe (two pictures),
both of the Middlebury pages (Scharstein and Szeliski, IJCV 47, 2002; Hirschmueller and Scharstein, CVPR 2007). There
is no prism: each picture is a view of its own, a pinhole camera one unit of length beside the last, and all lie side
by side in one array that stands for the photograph. Focal length and unit are arbitrary; disparity is focal length
over depth. Ours and OpenCV's StereoSGBM search the same disparities, but for zero, which lies at infinity.

What counts: the pixels with a true disparity. "bad-N, none counted" is the share that is off by more than N px or
has no disparity; "bad-N" is the share of those that have one, "complete" is how many have one. Seconds are medians
of three repeats with two threads: ours of all pictures as references, OpenCV's of one picture.

Rows named "fuller" also keep weak depths (`strict=False`). Some constants of the matcher were chosen with these two
sets in view, so their figures flatter it.

With --maps, pictures of the disparities and of where they are wrong are written into that folder.
"""

import argparse
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import ArrayLike

from benchmarks.data import data_folder
from benchmarks.results import table, write
from benchmarks.timing import few_threads, median_seconds
from cyclopean import Camera, Rig, reconstruct
from cyclopean.geometry import Pose
from cyclopean.matching import match
from cyclopean.pipeline import plan_of
from cyclopean.rigs import PinholeView, Region

FOCAL = 500.0  # px; any number will do
GAP = 16  # px between the pictures, so that no window reaches into its neighbour
REPEATS, THREADS = 3, 2
FINEST_DISPARITY = 1.0  # px, the least that ours searches


@dataclass(frozen=True, eq=False)
class Line:
    """Pictures by equal cameras that stand one unit apart on a line, with a true disparity for one of them."""

    pictures: tuple[np.ndarray, ...]  # (h, w, 3) uint8 RGB each, from left to right
    reference: int  # which of them the truth belongs to
    truth: np.ndarray  # (h, w) px to the next picture; NaN unknown
    disparities: int  # that StereoSGBM tries: 0 to one less


def tsukuba() -> Line:
    """Five pictures of a room; the border of 18 px has no truth."""
    folder = data_folder("real") / "tsukuba5"
    pictures = tuple(_rgb(folder / f"tsukuba_c{k}.ppm") for k in range(1, 6))
    return Line(pictures, 2, _truth(folder / "truedisp_c3.pgm", 16), 16)


def aloe() -> Line:
    """Two pictures of a plant."""
    folder = data_folder("real") / "opencv_aloe"
    return Line(tuple(_rgb(folder / f"aloe{k}.jpg") for k in "LR"), 0, _truth(folder / "aloeGT.png", 1), 256)


def side_by_side(pictures: Sequence[np.ndarray], centres: ArrayLike) -> tuple[np.ndarray, Rig]:
    """Pictures of equal pinhole cameras as one photograph, and the rig whose views they are.

    Parameters
    ----------
    pictures : sequence of (h, w) or (h, w, C) arrays
        All of one size.
    centres : (V, 2) array
        Where the cameras stand, x and y in mm; all look along z, with the focal length FOCAL.
    """
    height, width = pictures[0].shape[:2]
    edges = (0, 0, GAP // 2, GAP // 2)
    photograph = np.concatenate([cv2.copyMakeBorder(p, *edges, cv2.BORDER_REPLICATE) for p in pictures], axis=1)
    size = photograph.shape[1], height
    views = []
    for k, centre in enumerate(np.asarray(centres, dtype=float)):
        left = k * (width + GAP) + GAP // 2
        traced = np.zeros((height, size[0]), bool)
        traced[:, left : left + width] = True
        camera = Camera(size, FOCAL, (left + (width - 1) / 2, (height - 1) / 2))
        pose = Pose(np.eye(3), np.array([*-centre, 0.0]))
        views.append(PinholeView(camera, pose, Region(traced, 0.0), name=f"picture {k + 1}"))
    return photograph, Rig(tuple(views))


def ours(line: Line, chosen: Sequence[int], repeats: int = 1, strict: bool = True) -> tuple[np.ndarray, float]:
    """Disparity (h, w) px of the reference from some of the pictures, NaN where there is none.

    And the median of the seconds of matching alone, all pictures as references, the maps between them ready.
    """
    photograph, rig = side_by_side([line.pictures[k] for k in chosen], [(k, 0) for k in chosen])
    depths = FOCAL / (line.disparities - 1), FOCAL / FINEST_DISPARITY
    found, plan = reconstruct(photograph, rig, depths, strict=strict), plan_of(rig, depths)
    seconds = median_seconds(lambda: match(photograph, plan, strict=strict), repeats)
    x, y, width, height = rig[list(chosen).index(line.reference)].region.box
    return FOCAL / found.depth[y : y + height, x : x + width], seconds


def opencv(line: Line, repeats: int = 1) -> tuple[np.ndarray, float]:
    """Disparity (h, w) px of the reference by StereoSGBM and the next picture, NaN where there is none; and seconds.

    It gets grey pictures: in colour it has fewer wrong on Tsukuba, and fewer right on Aloe.
    """
    first, second = (cv2.cvtColor(line.pictures[k + line.reference], cv2.COLOR_RGB2GRAY) for k in (0, 1))
    matcher = cv2.StereoSGBM.create(  # as those set it who measured what the tests compare with
        minDisparity=0,
        numDisparities=line.disparities,
        blockSize=5,
        P1=8 * 5**2,
        P2=32 * 5**2,
        disp12MaxDiff=1,
        preFilterCap=0,
        uniquenessRatio=10,
        speckleWindowSize=100,
        speckleRange=2,
    )
    found = matcher.compute(first, second)
    seconds = median_seconds(lambda: matcher.compute(first, second), repeats)
    return np.where(found > 0, found / np.float32(16), np.float32(np.nan)), seconds


def judged(disparity: np.ndarray, truth: np.ndarray) -> dict[str, float]:
    """Figures of a disparity (h, w) px beside the true one, both NaN where unknown."""
    counted = np.isfinite(truth)
    error = np.abs(disparity - truth)[counted]
    known = np.isfinite(error)
    figures = {"complete_percent": 100 * known.mean(), "median_px": np.median(error[known])}
    for limit in (1, 2):
        figures[f"bad{limit}_percent"] = 100 * np.mean(error[known] > limit)
        figures[f"bad{limit}_or_none_percent"] = 100 * np.mean(~(error <= limit))
    return {name: float(value) for name, value in figures.items()}


CASES = {  # name -> set, pictures; each is measured strictly, and with weak depths kept (`strict=False`)
    "tsukuba_2views": ("tsukuba", (2, 3)),
    "tsukuba_3views": ("tsukuba", (1, 2, 3)),
    "tsukuba_5views": ("tsukuba", (0, 1, 2, 3, 4)),
    "aloe_2views": ("aloe", (0, 1)),
}
SETS = {"tsukuba": tsukuba, "aloe": aloe}


def measured(maps: Path | None = None) -> dict[str, dict[str, float]]:
    """All figures, by case and matcher."""
    few_threads(THREADS)
    figures = {}
    lines = {name: read() for name, read in SETS.items()}
    ours(lines["tsukuba"], (2, 3))  # compiles
    for name, line in lines.items():
        jobs = {case: pictures for case, (of, pictures) in CASES.items() if of == name}
        found = {f"{name}_sgbm": opencv(line, REPEATS)}
        for strict, ending in ((True, ""), (False, "_fuller")):
            found |= {f"{case}{ending}": ours(line, pictures, REPEATS, strict) for case, pictures in jobs.items()}
        for case, (disparity, seconds) in found.items():
            figures[case] = judged(disparity, line.truth) | {"seconds": seconds}
            if maps is not None:
                cv2.imwrite(str(maps / f"{case}.png"), pictured(disparity, line)[..., ::-1])
    return figures


def pictured(disparity: np.ndarray, line: Line) -> np.ndarray:
    """Truth, disparity and its faults side by side, (h, 3 w, 3) uint8 RGB.

    In the faults, red is off by more than 1 px (2 on Aloe), blue has no disparity; the rest is the photograph.
    """
    low, high = np.nanmin(line.truth) - 1, np.nanmax(line.truth) + 1
    shades = []
    for values in (line.truth, disparity):
        level = np.nan_to_num(255 * np.clip((values - low) / (high - low), 0, 1)).astype(np.uint8)
        shade = cv2.applyColorMap(level, cv2.COLORMAP_TURBO)[..., ::-1]
        shades.append(np.where(np.isfinite(values)[..., None], shade, 0).astype(np.uint8))
    faults = cv2.cvtColor(cv2.cvtColor(line.pictures[line.reference], cv2.COLOR_RGB2GRAY), cv2.COLOR_GRAY2RGB)
    counted, limit = np.isfinite(line.truth), 1 if line.disparities < 100 else 2
    faults[counted & (np.abs(disparity - line.truth) > limit)] = (230, 0, 0)
    faults[counted & np.isnan(disparity)] = (0, 90, 255)
    return np.concatenate([*shades, faults], axis=1)


def report(figures: dict[str, dict[str, float]]) -> None:
    """Print the table."""
    keys = [f"bad{limit}{none}_percent" for limit in (1, 2) for none in ("_or_none", "")]
    keys += ["complete_percent", "median_px", "seconds"]
    columns = ["bad-1, none counted %", "bad-1 %", "bad-2, none counted %", "bad-2 %", "complete %", "median px", "s"]
    table("Real photographs", ["", *columns], [[case, *(row[key] for key in keys)] for case, row in figures.items()])


def main() -> None:
    """Measure, print and store."""
    parser = argparse.ArgumentParser(description="Dense depth of real photographs, beside OpenCV's.")
    parser.add_argument("--maps", type=Path, metavar="FOLDER", help="write pictures of the disparities there")
    chosen = parser.parse_args()
    if chosen.maps is not None:
        chosen.maps.mkdir(parents=True, exist_ok=True)
    figures = measured(chosen.maps)
    report(figures)
    write("dense_real", {f"{case}_{key}": value for case, row in figures.items() for key, value in row.items()})


def _rgb(path):
    return cv2.cvtColor(cv2.imread(str(path)), cv2.COLOR_BGR2RGB)


def _truth(path, levels):
    """Disparity px from a grey picture with so many levels a px; 0 is unknown."""
    level = cv2.imread(str(path), cv2.IMREAD_GRAYSCALE).astype(np.float32)
    return np.where(level > 0, level / levels, np.float32(np.nan))


if __name__ == "__main__":
    main()
