"""Sparse matching in 2 to 5 views: how many false matches two views leave, and how many the others remove.

Points that all look the same: a sheet of dots and the corners of a chessboard, without names. Then corners that are
really detected, and features of textured scenes. `python -m benchmarks.sparse`
"""

import json
import time
from collections.abc import Sequence

import numpy as np
from scipy.ndimage import map_coordinates, maximum_filter, minimum_filter

from benchmarks.data import data_folder, renderer_setup
from benchmarks.results import table, write
from cyclopean import Rig, read_photograph
from cyclopean.correspondence import Matches, match_features, match_points
from cyclopean.epipolar import epipolar_curves

SIGMA = 0.1  # px
DEPTHS = (300.0, 3000.0)  # mm: wide, so that the band holds several points
PITCH = 5.0  # mm, of the dots
LOST = 0.05  # share of the points that a view misses
RIGS = (("n5", 2), ("n5", 3), ("n5", 4), ("n5", 5), ("n2", 2), ("n3", 3), ("n4", 4))  # rig, views used of it
BOARDS = tuple((f"calib_{name}", views) for name, views in RIGS)
PARALLEL = (("targets_t2_b40", 2), ("targets_t3_b40", 3), *(("targets_t4_b45", views) for views in (2, 3, 4)))
COUNTS = ("false", "matched", "found", "shown")  # matches that are wrong, all; points found, all
FALSE = 1.5  # px, a pixel further from the truth is false


def part_of(name: str, views: int) -> Rig:
    """The first views of a rendered rig."""
    return Rig(renderer_setup(name).rig().views[:views])


def sheet_of_dots(rig: Rig, depth: float, turn: float) -> np.ndarray:
    """Dots (P, 3) of a wavy sheet; with no turn their rows run along the epipolar curves of the first two views."""
    way = along_curves(rig, depth)
    roll = np.arctan2(way[1], way[0]) + turn
    side = np.arange(-170, 170, PITCH)
    x, y = (a.ravel() for a in np.meshgrid(side, side))
    x, y = np.cos(roll) * x - np.sin(roll) * y, np.sin(roll) * x + np.cos(roll) * y
    return np.stack([x, y, depth + 0.15 * x - 0.1 * y + 8 * np.sin(x / 40) * np.cos(y / 50)], -1)


def seen(rig: Rig, points: np.ndarray, sigma: float, seed: int) -> tuple[list[np.ndarray], list[np.ndarray]]:
    """Pixels that each view shows of points, in no order, with noise and gaps; and which points they are."""
    random = np.random.default_rng(seed)
    pixels, names = [], []
    for view in rig:
        here = view.project(points)
        rows = np.flatnonzero(view.region.contains(here) & (random.random(len(points)) >= LOST))
        rows = random.permutation(rows)
        pixels.append(here[rows] + random.normal(0, sigma, (len(rows), 2)))
        names.append(rows)
    return pixels, names


def judge(matches: Matches, names: Sequence[np.ndarray], views: int) -> np.ndarray:
    """Matches, false ones, points found, points that at least so many views show."""
    named = np.stack([np.append(name, -1)[rows] for name, rows in zip(names, matches.source.T, strict=True)], 1)
    first = named.max(1, initial=-1)
    right = ((named == first[:, None]) | (matches.source < 0)).all(1)
    shown = np.flatnonzero(np.bincount(np.concatenate(names)) >= views)
    return np.array([len(matches), np.count_nonzero(~right), np.isin(shown, first[right]).sum(), len(shown)])


def joining(matches: Matches, names: Sequence[np.ndarray]) -> np.ndarray:
    """Matches that join the first two views, false ones, points of these two views found, and all of them.

    The same points however many views a rig has: what the others change for them.
    """
    joined = matches.select((matches.source[:, 0] >= 0) & (matches.source[:, 1] >= 0))
    named = np.stack([np.append(name, -1)[rows] for name, rows in zip(names, joined.source.T, strict=True)], 1)
    right = ((named == named[:, :1]) | (joined.source < 0)).all(1)
    both = np.intersect1d(names[0], names[1])
    return np.array([len(joined), np.count_nonzero(~right), np.isin(both, named[right, 0]).sum(), len(both)])


def tally(rig: Rig, scenes: list, sigma: float, depths: tuple[float, float]) -> dict[str, float]:
    """Shares of false matches and of points found, in percent, over scenes of (pixels, names)."""
    sums = {key: np.zeros(4) for key in ("all", "clear", "three", "joining", "joining_clear")}
    candidates, least = [], min(3, len(rig))
    for pixels, names in scenes:
        every = match_points(rig, pixels, depths, sigma=sigma, max_ambiguity=1.0)
        clear = match_points(rig, pixels, depths, sigma=sigma)
        candidates.append(every.counts.per_point(every.counts.in_band))
        sums["all"] += judge(every, names, 2)
        sums["clear"] += judge(clear, names, 2)
        sums["joining"] += joining(every, names)
        sums["joining_clear"] += joining(clear, names)
        sums["three"] += judge(clear.select(clear.views >= least), names, least)
    figures = {"candidates": float(np.mean(candidates)) * (len(rig) - 1)}
    for key, (matched, false, found, shown) in sums.items():
        figures[f"{key}_false_pct"] = 100 * false / matched if matched else np.nan
        figures[f"{key}_found_pct"] = 100 * found / shown if shown else np.nan
        counts = zip(COUNTS, (false, matched, found, shown), strict=True)
        figures |= {f"{key}_{name}_count": value for name, value in counts}
    return figures


def dots(turns: Sequence[float], part: str) -> dict[str, float]:
    """Sheets of dots at two depths."""
    rows, figures = [], {}
    for name, views in RIGS:
        rig = part_of(name, views)
        sheets = [sheet_of_dots(rig, depth, np.deg2rad(turn)) for depth in (600.0, 800.0) for turn in turns]
        scenes = [seen(rig, points, SIGMA, seed) for seed, points in enumerate(sheets)]
        rows.append((name, views, tally(rig, scenes, SIGMA, DEPTHS)))
    show(f"dots {PITCH:g} mm apart, {part}", rows)
    for name, views, one in rows:
        figures |= {f"dots_{part.split()[0]}_{name}_{views}views_{key}": value for key, value in one.items()}
    return figures


def held(folder: str, pitch: float, turn_deg: float | None = 0.0) -> list[np.ndarray]:
    """Inner corners (P, 3) mm of boards as large as the renderer's, where it held them, turned in their own plane.

    Without a turn their rows run along the epipolar curves of the first two views.
    """
    document = json.loads((data_folder("mitsuba") / folder / "views.json").read_text())
    board = document["board"]
    size = np.array([board["squares_x"], board["squares_y"]]) * board["square"]
    x, y = np.meshgrid(*(np.arange(pitch, length - 1e-6, pitch) for length in size))
    flat = np.stack([x.ravel(), y.ravel()], -1) - size / 2
    boards, way = [], along_curves(part_of(folder.partition("_")[2], 2), 900.0)
    for pose in document["views"][:6]:
        turned = np.array(pose["R_cam_board"])
        x, y = np.linalg.solve(turned[:2, :2], way)
        roll = np.arctan2(y, x) if turn_deg is None else np.deg2rad(turn_deg)
        c, s = np.cos(roll), np.sin(roll)
        board = np.column_stack([flat @ np.array([[c, s], [-s, c]]) + size / 2, np.zeros(len(flat))])
        boards.append(board @ turned.T + pose["t_cam_board"])
    return boards


def along_curves(rig: Rig, depth: float) -> np.ndarray:
    """The way (2,) mm in a plane across the axis that epipolar curves of the first view follow in the second one."""
    middle = (rig[0].region.centre + rig[1].region.centre) / 2
    endless = rig.unbounded()
    curve = epipolar_curves(rig, 0, middle, DEPTHS, bounded=False).pixels[1]
    along = endless[0].rays(middle + np.diff(curve[[0, -1]], axis=0)[0]).at_depth(depth)
    return (along - endless[0].rays(middle).at_depth(depth))[:2]


def chessboards(folder: str, pitch: float, most: int, turn_deg: float | None) -> dict[str, float]:
    """Corners of a chessboard, computed where the renderer held its board, seen by the first views of its rig."""
    rows, figures, name = [], {}, folder.partition("_")[2]
    boards = held(folder, pitch, turn_deg)
    how = "aligned" if turn_deg is None else f"turned {turn_deg:g} deg"
    for views in range(2, most + 1):
        rig = part_of(name, views)
        scenes = [seen(rig, points, SIGMA, seed) for seed, points in enumerate(boards)]
        rows.append((name, views, tally(rig, scenes, SIGMA, DEPTHS)))
        key = f"board_{pitch:g}mm_{how.replace(' ', '_')}_{name}_{views}views"
        figures |= {f"{key}_{what}": value for what, value in rows[-1][2].items()}
    show(f"corners of a chessboard {pitch:g} mm apart where the renderer held its board, {how}", rows)
    return figures


def corners(sets: Sequence[tuple[str, int]], title: str, sigma: float) -> dict[str, float]:
    """The corners of rendered chessboards without their names, with noise."""
    rows, figures = [], {}
    for folder, views in sets:
        name = folder.partition("_")[2]
        rig = part_of(name, views)
        truth = np.load(data_folder("mitsuba") / folder / "corners.npz")
        random, scenes = np.random.default_rng(0), []
        for photo in range(6):
            mine = [np.flatnonzero((truth["view"] == photo) & (truth["facet"] == k)) for k in range(views)]
            mine = [random.permutation(some) for some in mine]
            pixels = [truth["uv"][some] + random.normal(0, sigma, (len(some), 2)) for some in mine]
            scenes.append((pixels, [truth["corner_id"][some] for some in mine]))
        rows.append((name, views, tally(rig, scenes, sigma, DEPTHS)))
        figures |= {f"{folder}_{sigma:g}px_{views}views_{key}": value for key, value in rows[-1][2].items()}
    show(f"{title}, noise {sigma:g} px", rows)
    return figures


def show(title: str, rows: list) -> None:
    """Print one table of `tally`."""
    columns = ("rig", "views", "candidates", "false", "found", "clear: false", "found", "by 3: false", "found of these")
    keys = [f"{key}_{what}_pct" for key in ("all", "clear", "three") for what in ("false", "found")]
    cells = [(name, views, one["candidates"], *(one[key] for key in keys)) for name, views, one in rows]
    table(f"{title}; shares in %", columns, cells)
    columns = ("rig", "views", "all: false", "matches", "found", "points", "clear: false", "matches", "found", "points")
    names = [f"{key}_{name}_count" for key in ("joining", "joining_clear") for name in COUNTS]
    cells = [(name, views, *(int(one[key]) for key in names)) for name, views, one in rows]
    table(f"{title}; counts of what joins the first two views", columns, cells)


def saddles(image: np.ndarray, mask: np.ndarray) -> np.ndarray:
    """Places (N, 2) where a picture has a saddle, as at every corner of a chessboard, and in its markers."""
    import cv2

    smooth = cv2.GaussianBlur(image.astype(np.float32), (0, 0), 1.5)
    xx, yy = (cv2.Sobel(smooth, cv2.CV_32F, *way, ksize=3) for way in ((2, 0), (0, 2)))
    xy = cv2.Sobel(smooth, cv2.CV_32F, 1, 1, ksize=3)
    strength = xy**2 - xx * yy
    inside = cv2.erode(mask.astype(np.uint8), np.ones((13, 13), np.uint8)).astype(bool)
    best = (strength == maximum_filter(strength, 9)) & (strength > 0.1 * np.percentile(strength, 99.9)) & inside
    start = np.argwhere(best)[:, ::-1].astype(np.float32)[:, None]
    stop = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_COUNT, 40, 1e-3)
    found = cv2.cornerSubPix(image, start.copy(), (4, 4), (-1, -1), stop) if len(start) else start
    near = np.linalg.norm(found - start, axis=-1)[:, 0] < 3
    return found[near, 0].astype(float)


def detected() -> dict[str, float]:
    """Saddles that are really detected in the pictures, markers' and all; the truth is the plane of the board."""
    rows, figures = [], {}
    for name, views in RIGS:
        rig, folder = part_of(name, views), data_folder("mitsuba") / f"calib_{name}"
        poses = json.loads((folder / "views.json").read_text())["views"]
        sums = {1.0: np.zeros(2), 0.2: np.zeros(2)}
        by_three = np.zeros(2)
        for pose in poses[:4]:
            image = read_photograph(folder / pose["file"])
            grey = image if image.ndim == 2 else image.mean(-1).astype(np.uint8)
            points = [saddles(grey, view.region.mask) for view in rig]
            for limit in sums:
                matches = match_points(rig, points, DEPTHS, sigma=SIGMA, detection=0.8, max_ambiguity=limit)
                false = off_plane(matches, rig, pose) > FALSE
                sums[limit] += [len(false), false.sum()]
                if limit < 1:
                    sure = matches.views >= min(3, views)
                    by_three += [sure.sum(), false[sure].sum()]
        one = [100 * bad / max(total, 1) for total, bad in (*sums.values(), by_three)]
        rows.append((name, views, int(sums[1.0][0]), one[0], int(sums[0.2][0]), one[1], int(by_three[0]), one[2]))
        for key, value in zip(("all", "clear", "three"), one, strict=True):
            figures[f"detected_{name}_{views}views_{key}_false_pct"] = value
    columns = ("rig", "views", "matched", "false (%)", "clear", "false (%)", "by 3 views", "false (%)")
    table("saddles detected in four photographs of a ChArUco board", columns, rows)
    return figures


def off_plane(matches: Matches, rig: Rig, pose: dict) -> np.ndarray:
    """Largest distance (P,) px of the pixels from where the board's plane shows the first of them."""
    normal = np.array(pose["R_cam_board"])[:, 2]
    offset = normal @ np.array(pose["t_cam_board"])

    def on_plane(rays, _):
        distance = (offset - rays.origins @ normal) / (rays.directions @ normal)
        return rays.at(distance)

    return apart(matches, rig, on_plane)


def apart(matches: Matches, rig: Rig, hit) -> np.ndarray:
    """Largest distance (P,) px of the pixels from where the scene, hit by the first view's ray, appears."""
    first = np.argmax(matches.source >= 0, 1)
    points = np.full((len(matches), 3), np.nan)
    for k, view in enumerate(rig):
        mine = first == k
        points[mine] = hit(view.unbounded().rays(matches.pixels[mine, k]), mine)
    gap = np.linalg.norm(rig.unbounded().project(points) - matches.pixels, axis=-1)
    return np.where(matches.source >= 0, gap, 0.0).max(1)  # NaN where the truth is not known


def features() -> dict[str, float]:
    """Features of the textured scene `bumpy`."""
    import cv2

    akaze = hasattr(cv2, "AKAZE_create") or hasattr(getattr(cv2, "xfeatures2d", None), "AKAZE_create")
    rows, figures = [], {}
    for name, views in RIGS:
        rig, scene = part_of(name, views), data_folder("mitsuba") / "scenes" / f"{name}_bumpy"
        photograph, xyz = read_photograph(scene.with_suffix(".png")), np.load(scene.with_suffix(".npz"))["xyz"]
        for detector in ("sift", "orb", *(("akaze",) if akaze else ())):
            for refine in (False, True):
                start = time.perf_counter()
                matches = match_features(photograph, rig, (600, 1300), detector=detector, refine=refine)
                seconds = time.perf_counter() - start
                gap = from_map(matches, rig, xyz)
                known = np.isfinite(gap)
                right = 100 * (gap[known] < 1.0).mean()
                how = "refined" if refine else "as found"
                rows.append((name, views, detector, how, len(matches), right, np.median(gap[known]), seconds))
                key = f"features_{name}_{views}views_{detector}_{how.replace(' ', '_')}"
                figures |= {f"{key}_matches": len(matches), f"{key}_within_1px_pct": right}
                figures[f"{key}_median_px"] = float(np.median(gap[known]))
    columns = ("rig", "views", "features", "pixels", "matches", "within 1 px (%)", "median error (px)", "time (s)")
    table("features of the scene bumpy, depths 600 to 1300 mm; largest error over the views", columns, rows)
    return figures


def from_map(matches: Matches, rig: Rig, xyz: np.ndarray) -> np.ndarray:
    """Largest distance (P,) px from the truth; NaN beside edges in depth, which the map is too coarse for."""
    depth = xyz[..., 2].astype(float)
    step = rig.size[1] / len(depth)
    spread = maximum_filter(np.nan_to_num(depth, nan=1e9), 5) - minimum_filter(np.nan_to_num(depth, nan=-1e9), 5)
    smooth = np.where(spread < 0.02 * depth, depth, np.nan)
    first = matches.pixels[np.arange(len(matches)), np.argmax(matches.source >= 0, 1)]
    depths = map_coordinates(smooth, first.T[::-1] / step, order=1, mode="nearest")
    return apart(matches, rig, lambda rays, mine: rays.at_depth(depths[mine]))


def edges() -> dict[str, float]:
    """Features of scenes with steps and round bodies, edges in depth and all, before and after refinement."""
    rows, figures = [], {}
    for scene in ("n2_steps", "n3_steps", "n3_pose_steps", "n4_steps", "n4_round"):
        rig, path = renderer_setup(scene.rpartition("_")[0]).rig(), data_folder("mitsuba") / "scenes" / scene
        photograph, xyz = read_photograph(path.with_suffix(".png")), np.load(path.with_suffix(".npz"))["xyz"]
        for detector in ("sift", "orb"):
            for refine in (False, True):
                matches = match_features(photograph, rig, (600, 1600), detector=detector, refine=refine)
                false, by_three = off_every_depth(matches, rig, xyz[..., 2]), matches.views >= 3
                how, three = "refined" if refine else "as found", int((false & by_three).sum())
                rows.append((scene, detector, how, len(matches), int(false.sum()), 100 * false.mean(), three))
                key = f"edges_{scene}_{detector}_{how.replace(' ', '_')}"
                figures |= {f"{key}_matches_count": len(matches), f"{key}_false_count": int(false.sum())}
                figures |= {f"{key}_three_views_count": int(by_three.sum()), f"{key}_three_views_false_count": three}
    columns = ("scene", "features", "pixels", "matches", "false", "false (%)", "of these in 3 views or more")
    table("features of scenes with edges in depth, depths 600 to 1600 mm", columns, rows)
    return figures


def off_every_depth(matches: Matches, rig: Rig, depth: np.ndarray) -> np.ndarray:
    """Which matches (P,) lie at none of the true depths of 5 x 5 pixels of the map, to 1 % and 5 sigma, in a view."""
    step = rig.size[1] / len(depth)
    around = np.arange(-2, 3)
    farthest = np.zeros(len(matches))
    for k in range(len(rig)):
        seen = matches.source[:, k] >= 0
        column, row = np.rint(matches.pixels[seen, k] / step).astype(int).T
        rows = np.clip(row[:, None, None] + around[:, None], 0, depth.shape[0] - 1)
        columns = np.clip(column[:, None, None] + around, 0, depth.shape[1] - 1)
        gap = np.abs(depth[rows, columns] - matches.points[seen, 2, None, None])
        farthest[seen] = np.maximum(farthest[seen], np.nan_to_num(gap, nan=np.inf).min((1, 2)))
    sigma = np.sqrt(matches.covariance[:, 2, 2])
    return farthest > np.maximum(0.01 * matches.points[:, 2], 5 * sigma)


def speed() -> dict[str, float]:
    """Time for 2,000 points in each of five views."""
    rig = part_of("n5", 5)
    random = np.random.default_rng(0)
    depth = random.uniform(500, 1000, 40_000)
    points = np.column_stack([random.uniform(-0.27, 0.27, 40_000) * depth, random.uniform(-0.2, 0.2, 40_000) * depth])
    pixels, _ = seen(rig, np.column_stack([points, depth]), SIGMA, 0)
    pixels = [some[:2000] for some in pixels]
    match_points(rig, pixels, (500, 1000), sigma=SIGMA)
    start = time.perf_counter()
    match_points(rig, pixels, (500, 1000), sigma=SIGMA)
    seconds = time.perf_counter() - start
    table("time", ("points", "seconds"), [(" + ".join(str(len(some)) for some in pixels), seconds)])
    return {"five_views_of_2000_points_s": seconds}


def main() -> None:
    """Measure, print and keep everything."""
    print("false: share of the matches that join different points; found: share of the points that are matched.")
    print(f"noise {SIGMA:g} px, depths {DEPTHS[0]:g} to {DEPTHS[1]:g} mm, {100 * LOST:g} % of the dots lost.")
    print("first all matches (max_ambiguity 1), then those that are clear (0.2), then those of these in three views.")
    figures = dots((0.0,), "aligned with the first two views")
    figures |= dots((0.0, 15.0, 30.0, 45.0, 60.0, 75.0), "turned in six ways")
    for sigma in (0.1, 1.0):
        figures |= corners(BOARDS, "corners of a tilted chessboard, 20 mm apart", sigma)
    figures |= corners(PARALLEL, "corners of a chessboard parallel to the sensor, 40 mm baseline", SIGMA)
    for way in (None, 0.0):
        figures |= chessboards("calib_n5", 5.0, 5, way)
    for turn in (0.0, 10.0):
        figures |= chessboards("targets_t4_b45", 30.0, 4, turn)
    figures |= detected()
    figures |= features()
    figures |= edges()
    figures |= speed()
    write("sparse", {key: value for key, value in figures.items() if np.isfinite(value)})


if __name__ == "__main__":
    main()
