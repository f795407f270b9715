"""The tables of dense depth for README.md and docs/dense.md, from the stored figures."""

from benchmarks.markdown import markdown


def short(figures: dict[str, float]) -> str:
    """Our depth maps beside OpenCV's."""
    keys = ["complete_percent", "bad1_percent", "median_percent", "match_seconds"]
    keys += ["sgbm2x_exact_bad1_percent", "sgbm2x_exact_median_percent", "sgbm2x_match_seconds", "grey1x_match_seconds"]
    heads = ["complete %", "bad-1 %", "median %", "s", "SGBM 2x bad-1 %", "median %", "s", "SGBM grey 1x s"]
    return _by_scene(figures, heads, keys)


def accuracy(figures: dict[str, float]) -> str:
    """Errors of our depth beside those of OpenCV at 2x, and how they compare."""
    keys = ["complete_percent", *(f"bad{n}_percent" for n in (1, 2, 5)), "median_percent", "rms98_percent", "rms98_px"]
    keys += ["error_over_sigma_times"]
    keys += [f"sgbm2x_exact_{key}" for key in ("complete_percent", "bad1_percent", "median_percent", "rms98_px")]
    keys += ["bad1_over_sgbm2x_times", "median_over_sgbm2x_times"]
    heads = ["complete %", "bad-1 %", "bad-2 %", "bad-5 %", "median %", "rms %", "rms px", "error / sigma"]
    heads += ["SGBM: complete %", "bad-1 %", "median %", "rms px", "ours / its bad-1", "ours / its median"]
    return _by_scene(figures, heads, keys)


def pairs(figures: dict[str, float]) -> str:
    """OpenCV's pairs pooled, by pinholes and by exact rays, at both scales."""
    kinds = [f"sgbm{scale}x_{way}_pairs" for scale in (1, 2) for way in ("pinhole", "exact")]
    keys = [f"{kind}_{key}_percent" for kind in kinds for key in ("bad1", "median")]
    names = ("1x, pinholes", "1x, exact rays", "2x, pinholes", "2x, exact rays")
    return _by_scene(figures, [head for name in names for head in (f"{name}: bad-1 %", "median %")], keys)


def seconds(figures: dict[str, float]) -> str:
    """Seconds of our matching and of the whole job beside those of OpenCV."""
    peers = {"grey1x": "grey 1x", "grey3way1x": "3WAY grey 1x", "sgbm1x": "colour 1x", "sgbm2x": "colour 2x"}
    heads, keys = ["match", "first", "further"], ["match_seconds", "first_seconds", "further_seconds"]
    for peer, name in peers.items():
        heads, keys = [*heads, name, "+ remap"], [*keys, f"{peer}_match_seconds", f"{peer}_seconds"]
    heads += ["grey 1x, two at once", "grey 1x / match", "colour 2x / match"]
    keys += ["grey1x_pairs_at_once_seconds", "grey1x_match_over_ours_times", "sgbm2x_match_over_ours_times"]
    return _by_scene(figures, heads, keys)


def work(figures: dict[str, float]) -> str:
    """Hypotheses a second, and memory."""
    keys = ["hypotheses", "effective_million_per_s", "tried_million_per_s", "match_mib", "whole_mib"]
    keys += ["sgbm1x_match_mib", "sgbm2x_match_mib"]
    heads = ["hypotheses", "million a second, effective", "tried", "match MiB", "whole job MiB"]
    return _by_scene(figures, [*heads, "SGBM 1x MiB", "SGBM 2x MiB"], keys)


def calibrated(figures: dict[str, float]) -> str:
    """Our depth with our own calibration beside that with the true setup."""
    keys = [f"calibrated_{key}_percent" for key in ("complete", "bad1", "median", "rms98")]
    keys += [f"calibrated_{key}_over_true_times" for key in ("bad1", "median", "rms98")]
    heads = ["complete %", "bad-1 %", "median %", "rms %", "bad-1 / true setup's", "median / true", "rms / true"]
    return _by_scene(figures, heads, keys)


def _by_scene(figures, heads, keys):
    """A row for each scene that has the first of some keys."""
    scenes = [key.removesuffix("_hypotheses") for key in figures if key.endswith("_hypotheses")]
    scenes = [scene for scene in scenes if f"{scene}_{keys[0]}" in figures]
    return markdown(["scene", *heads], [[scene, *(figures.get(f"{scene}_{key}") for key in keys)] for scene in scenes])


def real(figures: dict[str, float]) -> str:
    """Real photographs by ordinary cameras, beside OpenCV's."""
    cases = {
        "tsukuba_sgbm": "Tsukuba, OpenCV, 2 views",
        "tsukuba_2views": "Tsukuba, 2 views",
        "tsukuba_3views": "Tsukuba, 3 views",
        "tsukuba_5views": "Tsukuba, 5 views",
        "tsukuba_2views_fuller": "Tsukuba, 2 views, weak kept",
        "tsukuba_5views_fuller": "Tsukuba, 5 views, weak kept",
        "aloe_sgbm": "Aloe, OpenCV, 2 views",
        "aloe_2views": "Aloe, 2 views",
        "aloe_2views_fuller": "Aloe, 2 views, weak kept",
    }
    keys = ("bad1_or_none_percent", "bad1_percent", "bad2_or_none_percent", "bad2_percent", "complete_percent")
    rows = [[name, *(figures[f"{case}_{key}"] for key in (*keys, "seconds"))] for case, name in cases.items()]
    heads = ["bad-1 or none %", "bad-1 %", "bad-2 or none %", "bad-2 %", "complete %", "s"]
    return markdown(["photographs", *heads], rows)


def scaling(figures: dict[str, float]) -> str:
    """Time and memory of dense depth by what grows, with the exponents."""
    names = {"megapixels": "million pixels", "disparities": "px of disparity", "views": "views", "threads": "threads"}
    shown_keys = ("seconds", "processor_seconds", "match_seconds", "match_processor_seconds", "plan_seconds", "mib")
    shown_keys += ("process_mib", "complete_percent")
    rows: list[list[object]] = []
    for what, name in names.items():
        end = "_plan_seconds"
        keys = [key for key in figures if key.startswith(f"{what}_") and key.endswith(end)]
        values = sorted((key.removeprefix(f"{what}_").removesuffix(end) for key in keys), key=float)
        rows += [[f"{name}: {value}", *(figures[f"{what}_{value}_{key}"] for key in shown_keys)] for value in values]
        found = {key: figures.get(f"{what}_{key}_exponent") for key in shown_keys} if values else {}
        exponents = ["" if found.get(key) is None else f"{found[key]:.2f}" for key in shown_keys]
        rows += [[f"exponent of {name}", *exponents]] if values else []
    heads = ["s", "processor s", "match s", "processor s", "maps s", "MiB", "whole process MiB", "complete %"]
    return markdown(["", *heads], rows)


def limits(figures: dict[str, float]) -> str:
    """Stages of the matcher beside the limits of one core."""
    end = "_lookups_percent"
    keys = ("bytes", "operations", "lookups", "million_per_s", "nanoseconds")
    keys += ("bandwidth_percent", "arithmetic_percent", "lookups_percent")
    stages = [key.removesuffix(end) for key in figures if key.endswith(end)]
    rows = [[stage.replace("_", " "), *(figures[f"{stage}_{key}"] for key in keys)] for stage in stages]
    heads = ["bytes", "operations", "lookups", "million/s", "ns", "of memory %", "of arithmetic %", "of lookups %"]
    return markdown(["stage", *heads], rows)


def machine(figures: dict[str, float]) -> str:
    """The limits of one core that stages are compared to."""
    rows: list[list[object]] = [
        ["memory, GB/s", figures["triad_gigabytes_per_s"]],
        ["additions and minima of 16 bits, 10^9/s", figures["int16_gigaops_per_s"]],
        ["multiplications and additions of 32 bits, 10^9/s", figures["float32_gigaops_per_s"]],
        ["lookups in the cache, 10^9/s", figures["lookups_giga_per_s"]],
    ]
    return markdown(["limit of one core", "rate"], rows)
