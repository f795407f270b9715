"""Tables of the design and simulation benchmarks, for README.md and the pages in docs."""

from __future__ import annotations

from benchmarks.markdown import markdown

_RENDERED = {
    "base": "base: 100,000 triangles, 3 facets, 16 rays a pixel",
    "1k_triangles": "1,000 triangles",
    "1m_triangles": "1,000,000 triangles",
    "1_sample": "1 ray a pixel",
    "n2": "2 facets",
    "n5": "5 facets",
    "open_aperture": "open aperture",
    "distorted_lens": "distorted lens",
    "lamp_with_shadows": "a lamp with shadows",
    "colour": "three colours, each along its own rays",
}
_RENDERERS = {"mitsuba_llvm_ad_rgb": "Mitsuba 3, llvm_ad_rgb", "mitsuba_scalar_rgb": "Mitsuba 3, scalar_rgb"}
_OBJECTIVES = {"accuracy": "depth error", "field": "common field", "size": "size", "colour": "colour blur"}


def rendering(figures: dict[str, float]) -> str:
    """Primary rays a second of simulated photographs, and of another renderer where it ran."""
    rows = [
        [name, figures.get(f"{key}_clock_mrays_per_s"), figures.get(f"{key}_processor_mrays_per_s")]
        for key, name in _RENDERED.items()
    ]
    rows += [
        [f"the base by {name}", figures.get(f"{key}_clock_msamples_per_s"),
         figures.get(f"{key}_processor_msamples_per_s")]
        for key, name in _RENDERERS.items()
    ]  # fmt: skip
    return markdown(["1280 x 960 px", "million rays per s", "per processor second"], rows)


def peers(figures: dict[str, float]) -> str:
    """The most accurate prism that the search finds, and a general optimiser on the same exact figures."""
    keys = ("ours_percent", "ours_s", "evolution_percent", "evolution_s")
    rows = [[str(n), *(figures[f"peer_{n}_facets_{key}"] for key in keys)] for n in (2, 3, 4, 5)]
    heads = ["depth error found %", "s", "by differential evolution %", "s"]
    return markdown(["facets", *heads], rows)


def known(figures: dict[str, float]) -> str:
    """Prisms found for the thesis's baseline against two that exist: the best in each thing, and one in all."""
    rows = []
    for rig, name in (("t2_b40", "known: 2 facets of 12 deg"), ("t3_b40", "known: 3 facets of 12 deg")):
        best = [figures[f"{rig}_best_{key}_percent"] for key in _OBJECTIVES]
        rows.append([name, *best, figures[f"{rig}_evenly_better_percent"]])
    heads = [f"{name}, best %" for name in _OBJECTIVES.values()]
    return markdown(["against", *heads, "one prism, worst of all %"], rows)


def seconds(figures: dict[str, float]) -> str:
    """Processor time of each step for one candidate, by the number of facets."""
    keys = (
        ("screen_processor_us", "in closed form us"),
        ("evaluate_processor_ms", "exact rays ms"),
        ("judge_processor_s", "Monte Carlo s"),
    )
    rows = [[str(n), *(figures[f"candidate_{n}_facets_{key}"] for key, _ in keys)] for n in (2, 3, 4, 5)]
    return markdown(["facets", *(head for _, head in keys)], rows)
