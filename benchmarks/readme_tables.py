"""Write the tables of README.md and of the pages in docs from the stored figures, so that none is typed by hand.

    python -m benchmarks.readme_tables [--check] [FILE ...]

A line `<!-- table: NAME -->` and the next line `<!-- end -->` stand around each table; what is between them is
replaced by the table NAME: one of TABLES, from a file in results/. --check writes nothing, and
fails when a file is not what would be written.
"""

import argparse
import json
import re
from pathlib import Path

from benchmarks import dense_tables, design_tables
from benchmarks.markdown import markdown, shown

ROOT = Path(__file__).resolve().parents[1]
RESULTS = Path(__file__).parent / "results"
BLOCK = re.compile(r"(<!-- table: (\w+) -->\n).*?(<!-- end -->)", re.DOTALL)


def accuracy(figures: dict[str, float]) -> str:
    """Our optics beside the renderer's."""
    keys = ("corners", "missed", "rms_px", "largest_px", "facets_agree_percent")
    rigs = [key.removesuffix("_corners") for key in figures if key.endswith("_corners")]
    rows = [[rig, *(figures[f"{rig}_{key}"] for key in keys)] for rig in rigs]
    return markdown(["rig", "corners", "missed", "rms px", "largest px", "pixels in the same facet %"], rows)


def optics(figures: dict[str, float]) -> str:
    """Rates of tracing rays and projecting points, each beside how many times faster ours is."""
    rows = []
    for job, end in (("trace", "rays"), ("project", "points")):
        rates = {
            key.removeprefix(f"{job}_").removesuffix("_million_per_s"): value
            for key, value in figures.items()
            if key.startswith(f"{job}_") and key.endswith("_million_per_s")
        }
        for name in sorted(rates, key=rates.get, reverse=True):
            faster = figures.get(f"{job}_{name}_ours_over_it_times")
            if faster or name.startswith("cyclopean"):
                rows.append([f"{job} {end}", name.replace("_", " "), rates[name], faster])
    return markdown(["", "", "million per s", "cyclopean is faster, times"], rows)


def calibration(figures: dict[str, float]) -> str:
    """Prisms calibrated from board photographs, beside the truth."""
    keys = ("noise_px", "reprojection_px", "apex_error_deg", "apex_sigma_deg", "largest_score", "seconds")
    end = "_apex_error_deg"
    rigs = [key.removeprefix("parameters_").removesuffix(end) for key in figures if key.endswith(end)]
    rows = [
        [rig, *(figures[f"parameters_{rig}_{key}"] for key in keys), figures[f"camera_{rig}_focal_error_percent"]]
        for rig in rigs
    ]
    heads = ["corners px", "fit px", "apex error deg", "its sigma", "largest error / sigma", "s"]
    return markdown(["rig", *heads, "focal length error %, camera free"], rows)


APPROACHES = {
    "true_setup": "the true setup (limit by these corners)",
    "physical_model": "physical model",
    "virtual_cameras_intrinsics_free": "virtual cameras together, lenses free, k1 k2 p1 p2",
    "virtual_cameras_intrinsics_free_in_the_true_frame": "the same, were their frame known",
    "virtual_cameras_intrinsics_fixed": "virtual cameras together, lens of the camera, k1 k2 p1 p2",
    "virtual_cameras_each_alone_then_pairs": "virtual cameras, each alone, then pairs (OpenCV's way)",
    "best_pinholes_for_the_true_rays": "best pinholes that there are for the true rays",
    "ray_sketch_middle": "ray sketch, middle ray to the rim",
    "ray_sketch_middle_perfect_drawing": "the same, were the drawing perfect",
    "ray_sketch_field_point": "ray sketch after a field point test",
}


def thesis(figures: dict[str, float]) -> str:
    """Depth of planes by every approach: on photographs, and with computed corners beside."""
    rigs = ("t2_b40", "t3_b40", "t4_b45")
    parts = ("photographs_rms", "computed_rms", "photographs_largest")
    rows = [
        [name, *(figures[f"{rig}_{key}_{part}_percent"] for rig in rigs for part in parts)]
        for key, name in APPROACHES.items()
    ]
    heads = [head for facets in (2, 3, 4) for head in (f"{facets} facets rms", "computed", "largest")]
    return markdown(["approach", *heads], rows)


def real(figures: dict[str, float]) -> str:
    """Real photographs by others, beside what they reached."""
    rows = [
        ["four views by a mirror splitter, linear cameras: dots, mm", figures["real_ptv_splitter4_linear_mm"], 0.20],
        [
            "the same, Tsai with k1 in each view, fitted to odd, tested on even dots, mm",
            figures["real_ptv_splitter4_test_mm"],
            0.25,
        ],
        ["a phone and two mirrors, one model: rms px", figures["real_lcm_two_mirrors_rms_px"], 0.653],
        ["a monitor in a mirror at five poses: mean distance px", figures["real_pycalib_mirror_mean_px"], 0.640],
    ]
    return markdown(["photographs", "here", "others"], rows)


def calibration_speed(figures: dict[str, float]) -> str:
    """Seconds of calibrations."""
    rows = [
        ["of 14 photographs, 3 facets, camera known", figures["speed_n3_seconds"]],
        ["of 14 photographs, 3 facets, camera too", figures["speed_n3_camera_too_seconds"]],
        ["the same corners by OpenCV, each facet alone, then pairs", figures["speed_n3_opencv_seconds"]],
    ]
    for photos in (10, 100, 280, 1000):
        count = figures[f"speed_{photos}_photographs_residuals"]
        rows.append(
            [f"of {photos} photographs, {count:,.0f} residuals", figures[f"speed_{photos}_photographs_seconds"]]
        )
    return markdown(["calibration with covariance", "s"], rows)


def sparse(figures: dict[str, float]) -> str:
    """False matches of dots that all look alike, by number of views."""
    keys = ("candidates", "all_false_pct", "clear_false_pct", "clear_found_pct", "three_false_pct", "three_found_pct")
    rows = []
    for part, name in (("aligned", "along the curves"), ("turned", "turned in six ways")):
        for views in (2, 3, 4, 5):
            cells: list[object] = [figures[f"dots_{part}_n5_{views}views_{key}"] for key in keys]
            counts = (figures[f"dots_{part}_n5_{views}views_clear_{key}_count"] for key in ("false", "matched"))
            cells[2] = f"{shown(cells[2])} ({' of '.join(f'{count:.0f}' for count in counts)})"
            rows.append([name, str(views), *(cells if views > 2 else [*cells[:4], "", ""])])
    heads = ["candidates of a dot", "false of all matches %", "false of the clear ones %", "dots found %"]
    return markdown(["rows of dots", "views", *heads, "false of those in three views %", "dots found %"], rows)


def sparse_views(figures: dict[str, float]) -> str:
    """Precision and recall of the points of the first two views, by number of views."""
    cases = {
        "dots_aligned_n5": "dots, 5 mm, aligned",
        "dots_turned_n5": "dots, 5 mm, turned in six ways",
        "board_5mm_aligned_n5": "chessboard, 5 mm, aligned",
        "board_5mm_turned_0_deg_n5": "chessboard, 5 mm, as held",
        "calib_n5_0.1px": "renderer's corners, 20 mm",
        "calib_n5_1px": "renderer's corners, 20 mm, 1 px of noise",
        "targets_t4_b45_0.1px": "renderer's corners, 30 mm, four facets, aligned",
        "board_30mm_turned_10_deg_t4_b45": "the same board turned by 10 degrees",
    }
    rows = []
    for case, name in cases.items():
        for views in (2, 3, 4, 5):
            if f"{case}_{views}views_joining_false_count" not in figures:
                continue
            row: list[object] = [name, str(views)]
            for part in ("joining", "joining_clear"):
                false, matched, found, shown = (
                    int(figures[f"{case}_{views}views_{part}_{count}_count"])
                    for count in ("false", "matched", "found", "shown")
                )
                row += [100 * (1 - false / matched), f"{false} of {matched}", 100 * found / shown]
            rows.append([*row, str(shown)])
    heads = ["precision %", "false", "recall %", "clear: precision %", "false", "recall %", "points"]
    return markdown(["points", "views", *heads], rows)


def sparse_edges(figures: dict[str, float]) -> str:
    """False matches of features of scenes with edges in depth."""
    cases = [key.removesuffix("_refined_false_count").removeprefix("edges_") for key in figures
             if key.startswith("edges_") and key.endswith("_refined_false_count")]  # fmt: skip
    rows: list[list[object]] = []
    for case in cases:
        row: list[object] = [*case.rsplit("_", 1)]
        for how in ("as_found", "refined"):
            false, matched = (figures[f"edges_{case}_{how}_{what}_count"] for what in ("false", "matches"))
            row += [f"{false:.0f} of {matched:.0f}", 100 * false / matched]
        rows.append(row)
    return markdown(["scene", "features", "as found: false", "%", "refined: false", "%"], rows)


def epipolar(figures: dict[str, float]) -> str:
    """How far straight lines are off the true epipolar curves."""
    models = ("pinholes", "distorted_pinholes", "matrix", "own_line")
    rigs = [key.removeprefix("line_").removesuffix("_matrix_rms_px") for key in figures if "_matrix_rms_px" in key]
    rows = [[rig, *(figures[f"line_{rig}_{model}_{kind}_px"] for model in models for kind in ("rms", "max"))]
            for rig in rigs]  # fmt: skip
    names = ("two pinholes", "with distortion", "fitted matrix", "line of its own")
    return markdown(["rig", *(head for name in names for head in (f"{name}: rms px", "largest"))], rows)


def measuring(figures: dict[str, float]) -> str:
    """Points found and lengths measured in rendered photographs, with and without noise."""
    keys = ("found_percent", "false_percent", "error_median_px", "depth_median_mm", "length_median_percent")
    keys += tuple(f"good_{key}" for key in ("68_percent_over_sigma_times", "95_percent_over_sigma_times"))
    keys += ("good_beyond_3_sigma_percent", "edge_beyond_3_sigma_percent")
    cases = [key.removesuffix("_found_percent") for key in figures if key.endswith("_found_percent")]
    rows = [[*case.split("_noise"), *(figures.get(f"{case}_{key}") for key in keys)] for case in cases]
    heads = ["found %", "false %", "px, median", "depth mm, median", "length %, median", "68 % within, sigma"]
    heads += ["95 % within, sigma", "beyond 3 sigma %", "the same at edges %"]
    return markdown(["surface", "noise, grey levels", *heads], rows)


def tolerances(figures: dict[str, float]) -> str:
    """Depth errors of prisms within their tolerances, before and after calibration."""
    cases = {
        "before": "before calibration, usual tolerances",
        "after": "after 12 photographs through the prism, camera as drawn",
        "after_with_camera_photos": "after 6 more without the prism",
    }
    rows = [
        [
            name,
            figures[f"prism3_{case}_95_percent_at_990mm_percent"],
            *(figures.get(f"prism3_{case}_{key}") for key in ("foretold_rms_mm", "real_rms_mm", "chi_square_of_20")),
        ]
        for case, name in cases.items()
    ]
    heads = ["95 % of the errors, % of depth", "rms foretold mm", "rms of 20 real calibrations mm", "their chi-square"]
    return markdown(["", *heads], rows)


def closed_loop(figures: dict[str, float]) -> str:
    """Chi-squares of the closed loop, each with the standard error of its mean."""
    columns = {
        "total_all_reduced": "all depths",
        "total_speckle_reduced": "on speckle",
        "total_grey_reduced": "on grey",
        "whole_reduced": "whole covariance",
        "calibration_reduced": "calibration",
        "matching_all_reduced": "matching alone",
        "bias_all_sigma": "its mean error / sigma",
        "found_mm": "rms mm",
        "foretold_mm": "foretold mm",
    }
    rows: list[list[object]] = []
    for size, name in (("half", "640 x 480"), ("full", "1280 x 960")):
        for n in (2, 3, 4, 5):
            start = f"{size}_n{n}_"
            if f"{start}repeats_count" not in figures:
                continue
            cells = []
            for key in columns:
                error = figures.get(f"{start}{key}_error")
                cells.append(f"{figures[start + key]:.2f}" + ("" if error is None else f" +- {error:.2f}"))
            rows.append([f"{n}, {name} px", f"{figures[f'{start}repeats_count']:.0f}", *cells])
    return markdown(["facets", "repeats", *columns.values()], rows)


def closed_loop_short(figures: dict[str, float]) -> str:
    """The same in short, of the smaller photographs, of which there are several experiments."""
    columns = {
        "total_all_reduced": "all depths",
        "whole_reduced": "whole covariance",
        "calibration_reduced": "calibration",
    }
    rows = []
    for n in (2, 3, 4, 5):
        values = [(figures[f"half_n{n}_{key}"], figures[f"half_n{n}_{key}_error"]) for key in columns]
        rows.append([str(n), *(f"{value:.2f} +- {error:.2f}" for value, error in values)])
    return markdown(["facets", *columns.values()], rows)


def simulation_renderer(figures: dict[str, float]) -> str:
    """Our photographs of a board beside an independent renderer's."""
    columns = {
        "corners": "corners",
        "ours_theirs_px": "corners apart px",
        "theirs_exact_px": "theirs off the truth px",
        "ours_exact_px": "ours off the truth px",
        "within_2_percent_of_scale_percent": "levels within 2 % of the scale %",
        "within_2_percent_of_level_percent": "within 2 % of themselves %",
        "largest_levels": "largest difference, levels",
    }
    names = [key.removesuffix("_corners") for key in figures if key.endswith("_corners")]
    rows = [[name, *(figures[f"{name}_{key}"] for key in columns)] for name in names]
    return markdown(["photographs", *columns.values()], rows)


TABLES = {  # name -> file of figures, table
    "accuracy": ("accuracy", accuracy),
    "calibration": ("calibration", calibration),
    "closed_loop": ("closed_loop", closed_loop),
    "closed_loop_short": ("closed_loop", closed_loop_short),
    "dense": ("dense", dense_tables.short),
    "dense_accuracy": ("dense", dense_tables.accuracy),
    "dense_calibrated": ("dense", dense_tables.calibrated),
    "dense_limits": ("dense_limits", dense_tables.limits),
    "dense_machine": ("dense_limits", dense_tables.machine),
    "dense_pairs": ("dense", dense_tables.pairs),
    "dense_real": ("dense_real", dense_tables.real),
    "dense_scaling": ("dense_scaling", dense_tables.scaling),
    "dense_seconds": ("dense", dense_tables.seconds),
    "dense_work": ("dense", dense_tables.work),
    "design_known": ("design", design_tables.known),
    "design_peers": ("design", design_tables.peers),
    "design_seconds": ("design", design_tables.seconds),
    "epipolar": ("epipolar", epipolar),
    "measuring": ("measuring", measuring),
    "optics": ("optics", optics),
    "real": ("calibration", real),
    "rendering": ("simulation", design_tables.rendering),
    "simulation_renderer": ("simulation_renderer", simulation_renderer),
    "sparse": ("sparse", sparse),
    "sparse_edges": ("sparse", sparse_edges),
    "sparse_views": ("sparse", sparse_views),
    "speed": ("calibration", calibration_speed),
    "thesis": ("thesis", thesis),
    "tolerances": ("tolerances", tolerances),
}


def filled(text: str) -> str:
    """A page with its tables written anew."""

    def block(match: re.Match) -> str:
        name, table = TABLES[match[2]]
        stored = RESULTS / f"{name}.json"
        if not stored.exists():  # not measured here: as it was
            return match[0]
        return match[1] + table(json.loads(stored.read_text())) + match[3]

    return BLOCK.sub(block, text)


def pages() -> list[Path]:
    """The pages that hold tables."""
    found = [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md"))]
    return [page for page in found if BLOCK.search(page.read_text())]


def main() -> None:
    """Write the tables, or say whether they are what they should be."""
    parser = argparse.ArgumentParser(description="Write the tables of README.md and docs from the stored figures.")
    parser.add_argument("files", nargs="*", type=Path, help="default: README.md and the pages in docs")
    parser.add_argument("--check", action="store_true", help="write nothing; fail when a table is out of date")
    chosen = parser.parse_args()
    for page in chosen.files or pages():
        old = page.read_text()
        new = filled(old)
        if chosen.check and new != old:
            raise SystemExit(f"{page.name} does not show the stored figures; run python -m benchmarks.readme_tables")
        if not chosen.check:
            page.write_text(new)


if __name__ == "__main__":
    main()
