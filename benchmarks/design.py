"""Design of prisms: time of the search and how it scales, known rigs, the impossible, and other ways to the optimum.

python -m benchmarks.design
"""

import re
import resource
import subprocess
import sys
import tempfile
import time
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np

from benchmarks.data import renderer_setup
from benchmarks.results import table, write
from benchmarks.timing import median_times, timed
from benchmarks.tolerances import CHECKED, checked
from cyclopean import Camera, Prism
from cyclopean.analysis import tolerance_analysis, usual_plan
from cyclopean.design import Requirements, evaluate, find_designs
from cyclopean.design.catalogue import GRADES, grade, stock_angles_deg
from cyclopean.design.closed_forms import edge_of, screen
from cyclopean.design.grid import azimuths_of
from cyclopean.design.judgement import DIRECT_PHOTOS, DRAWS, keep_accuracy
from cyclopean.design.limits import excesses
from cyclopean.design.pareto import OBJECTIVES, objectives
from cyclopean.design.requirements import Candidate
from cyclopean.errors import CyclopeanError
from cyclopean.rigs.sizing import covering_solid, usual_azimuth

CAMERA = Camera((1280, 960), 25 / 0.0055, pixel_pitch=0.0055)
DEPTHS = (600.0, 1600.0)
EXAMPLE = Requirements(CAMERA, DEPTHS, accuracy=0.001, glasses=("N-BK7", "PMMA"), tolerances=GRADES["commercial"])
COMMAND = (
    "design", "--camera", "1280x960, 5.5 um, f=25 mm", "--depth", "600..1600", "--accuracy", "0.1%", "--facets", "2..5",
    "--glass", "N-BK7,PMMA", "--tolerances", "commercial",
)  # fmt: skip
KINDS = {  # what grows from search to search
    "the example: 2 to 5 facets, 2 glasses": {},
    "2 facets, 1 glass": {"facets": (2,), "glasses": ("N-BK7",)},
    "2 to 5 facets, 1 glass": {"glasses": ("N-BK7",)},
    "2 to 5 facets, 4 glasses": {"glasses": ("N-BK7", "PMMA", "N-SF11", "fused silica")},
    "the example, stock angles": {"angles_deg": stock_angles_deg(("N-BK7",)), "glasses": ("N-BK7",)},
    "the example, a field of 60 x 60 mm": {"field": (60.0, 60.0)},
    "the example, prisms under 60 mm across": {"max_diameter": 60.0},
    "the example, no accuracy asked for": {"accuracy": None},
}
IMPOSSIBLE = {
    "0.01 % with a prism of 30 mm": {"accuracy": 0.0001, "max_diameter": 30.0},
    "a field wider than the picture": {"field": (250.0, 150.0)},
    "60 mm apart, within 100 mm": {"baseline": 60.0, "max_length": 100.0},
    "facets of 0.5 deg and 0.05 %": {"angles_deg": (0.5,), "accuracy": 0.0005},
}
PEER = {"field": (60.0, 60.0), "max_length": 300.0, "glasses": ("N-BK7",), "accuracy": None}


def main():
    figures: dict[str, float] = {}
    find_designs(replace(EXAMPLE, facets=(2,), glasses=("N-BK7",)))  # compiles
    found = find_designs(EXAMPLE)
    for part in (searches, command, candidates_of, sampling, calibrations, known_rigs, impossible, peer):
        figures |= part()
    figures |= steps(found)
    figures |= paper(found)
    write("design", figures)


def searches():
    """Time of whole searches, and how many prisms they look at."""
    rows, figures = [], {}
    for name, changes in KINDS.items():
        requirements = replace(EXAMPLE, **changes)
        found, clock, processor = timed(partial(find_designs, requirements))
        counts = found.screened, found.traced, len(found.candidates), len(found.front), len(found.chosen)
        rows.append((name, clock, processor, *counts))
        figures |= {f"search_{slug(name)}_s": clock, f"search_{slug(name)}_processor_s": processor}
    figures["example_screened"], figures["example_traced"] = rows[0][3], rows[0][4]
    columns = ("search", "s", "processor s", "closed forms", "traced", "fit", "front", "chosen")
    table("Searches: time, prisms screened in closed form, traced exactly, that fit", columns, rows)
    return figures


def command():
    """Time of the whole command from its start to its last file, and of the files of one candidate."""
    with tempfile.TemporaryDirectory() as folder:
        words = [str(Path(sys.executable).with_name("cyclopean")), *COMMAND, "-o", folder]
        before = resource.getrusage(resource.RUSAGE_CHILDREN)
        _, clock, _ = timed(partial(subprocess.run, words, check=True, capture_output=True))
        after = resource.getrusage(resource.RUSAGE_CHILDREN)
        parts = [part for part in Path(folder).iterdir() if part.is_dir()]
        ready = sorted(max(file.stat().st_mtime for file in part.iterdir()) for part in parts)
    drawing = float(np.median(np.diff(ready)))
    processor = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    print(
        f"cyclopean {' '.join(COMMAND)}: {clock:.1f} s, {processor:.1f} s of the processor; "
        f"{len(parts)} prisms written, drawings, solid and lists {drawing:.2f} s each\n"
    )
    return {"command_s": clock, "command_processor_s": processor, "candidate_files_s": drawing}


def candidates_of():
    """Time of a candidate at each step."""
    rows, figures = [], {}
    apex, distance = (values.ravel() for values in np.meshgrid(np.linspace(3, 20, 100), np.linspace(30, 500, 100)))
    for facets in (2, 3, 4, 5):
        setup = _setup(EXAMPLE, facets, 12.0, 150.0)
        works = {
            "screen_us": (1e6 / apex.size, partial(screen, EXAMPLE, facets, 0, apex, distance, usual_azimuth(facets))),
            "evaluate_ms": (1e3, partial(evaluate, setup, EXAMPLE)),
            "judge_s": (1.0, partial(keep_accuracy, setup, EXAMPLE)),
        }
        row = [facets]
        for name, (unit, work) in works.items():
            clock, processor = (unit * seconds for seconds in median_times(work, 5))
            row += [clock, processor]
            figures |= {f"candidate_{facets}_facets_{name}": clock}
            figures |= {f"candidate_{facets}_facets_{name.replace('_', '_processor_')}": processor}
        rows.append(row)
    columns = ("facets", "closed, us", "processor", "exact, ms", "processor", f"{DRAWS} draws, s", "processor")
    table("Time of one candidate: closed forms, exact rays, judged by draws", columns, rows)
    return figures


def steps(found):
    """What prisms keep after making and calibrating, beside their accuracy on paper."""
    rows = []
    for candidate in found.options:
        kept, clock, processor = timed(partial(keep_accuracy, candidate, EXAMPLE))
        low, high = kept.share_bounds
        shares = f"{100 * kept.share:.0f} ({100 * low:.0f} to {100 * high:.0f})"
        prism = candidate.prism
        name = f"{prism.facets} x {prism.apex_deg:.3g} deg, {prism.glass}, {prism.distance:.0f} mm"
        errors = candidate.figures.accuracy, kept.worst, kept.worst_before
        rows.append((name, *(100 * error for error in errors), shares, kept.driver_before, clock, processor))
    columns = ("chosen", "paper %", "kept %", "raw %", "keep 0.1 %", "raw driven by", "s", "processor s")
    table("Accuracy on paper; kept by 95 % of prisms of commercial quality; share that keeps 0.1 %", columns, rows)
    return {
        "judged_per_candidate_s": float(np.mean([row[-2] for row in rows])),
        "judged_per_candidate_processor_s": float(np.mean([row[-1] for row in rows])),
    }


def sampling():
    """What more draws and more points of the field would change."""
    rows, figures = [], {}
    for facets in (2, 3, 4, 5):
        setup = _setup(EXAMPLE, facets, 12.0, 177.0)
        quick, long = keep_accuracy(setup, EXAMPLE), keep_accuracy(setup, EXAMPLE, draws=4000, samples=9, seed=1)
        low, high = quick.after.quantile_bounds(0.95)[:, -1]
        bounds = f"{100 * low:.4f} to {100 * high:.4f}"
        last = [100 * kept.after.quantile(0.95)[-1] for kept in (quick, long)]
        raw = [100 * kept.before.quantile(0.95)[-1] for kept in (quick, long)]
        rows.append((facets, f"{last[0]:.4f}", bounds, f"{last[1]:.4f}", *raw))
        figures[f"sampling_{facets}_facets_kept_ratio"] = last[0] / last[1]
        figures[f"sampling_{facets}_facets_raw_ratio"] = raw[0] / raw[1]
    columns = ("facets", "kept %", "95 % bounds", "4000 draws, 9 x 9", "raw %", "4000 draws, 9 x 9")
    table(f"Error at 1600 mm that 95 % of prisms keep: {DRAWS} draws, 5 x 5 points, and more", columns, rows)
    return figures


def calibrations():
    """Real calibrations of prisms that were drawn, beside what the judgement foretells for them."""
    figures = {}
    for facets in (2, 3):
        setup = _setup(EXAMPLE, facets, 12.0, 177.0)
        plan = usual_plan(setup, DEPTHS, direct_photos=DIRECT_PHOTOS)
        depths = np.geomspace(*DEPTHS, 5)
        analysis = tolerance_analysis(setup, grade("commercial", setup), depths, draws=CHECKED, plan=plan)
        print(f"{facets} facets of 12 deg at 177 mm, commercial quality: ", end="")
        found = checked(setup, analysis)
        figures |= {f"calibrated_{facets}_facets_{name}": value for name, value in found.items()}
    return figures


def known_rigs():
    """The rigs of the rendered photographs, beside what a search for their baseline and depths finds."""
    rows, figures = [], {}
    for name in ("t2_b40", "t3_b40"):
        setup = replace(renderer_setup(name), depths=DEPTHS)
        requirements = Requirements(
            setup.camera, DEPTHS, facets=(setup.optic.facets,), baseline=40.0, wavelength_nm=setup.wavelength_nm
        )
        named = replace(setup, optic=replace(setup.optic, glass="N-BK7"))  # its index, and a dispersion
        rig = Candidate(named, evaluate(named, requirements))
        found, taken, _ = timed(partial(find_designs, requirements))
        costs, own = objectives(found.candidates), objectives([rig])[0]
        best, even = costs.min(0), (costs - own).max(-1)
        closest = int(even.argmin())
        for k, objective in enumerate(OBJECTIVES):
            change, there = (100 * (np.exp(c - own[k]) - 1) for c in (best[k], costs[closest, k]))
            rows.append((f"{name}: {objective}", change, there))
            figures[f"{name}_best_{objective.replace(' ', '_')}_percent"] = change
        figures[f"{name}_evenly_better_percent"] = 100 * (np.exp(even[closest]) - 1)
        figures[f"{name}_search_s"] = taken
        rows.append((f"{name}: {found.candidates[closest].name}", None, None))
    columns = ("rig: what counts (cost, less is better)", "best found, %", "one prism for all, %")
    table("Found, relative to the rigs of the data", columns, rows)
    return figures


def impossible():
    """What a search says where nothing fits."""
    figures = {}
    for name, changes in IMPOSSIBLE.items():
        start = time.perf_counter()
        try:
            found = find_designs(replace(EXAMPLE, **changes))
            said = f"{len(found.candidates)} prisms fit. {found.explanation.text}"
        except CyclopeanError as error:
            said = f"refused. {error}"
        taken = time.perf_counter() - start
        print(f"{name}, {taken:.1f} s: {said}\n")
        figures[f"impossible_{slug(name)}_s"] = taken
    return figures


def peer():
    """The best accuracy under limits: our search, and differential evolution on the same exact figures."""
    from scipy.optimize import differential_evolution

    rows, figures = [], {}
    for facets in (2, 3, 4, 5):
        requirements = replace(EXAMPLE, facets=(facets,), **PEER)
        found, ours, _ = timed(partial(find_designs, requirements))
        best = min((candidate.figures.accuracy for candidate in found.candidates), default=np.nan)
        calls = []

        def cost(place, facets=facets, requirements=requirements, calls=calls):
            calls.append(place)
            try:
                setup = _setup(requirements, facets, *place[:2], azimuths_of(facets)[int(place[2] > 0.5)])
                figures = evaluate(setup, requirements)
            except CyclopeanError:
                return 10.0
            missed = max(max(float(value) for value in excesses(figures, requirements).values()), 1.0)
            return figures.accuracy + min(missed - 1, 5.0) if np.isfinite(figures.accuracy) else 10.0

        ranges = [(1.0, 30.0), (20.0, 290.0), (0.0, 1.0)]  # apex, distance, which way it is turned
        evolve = partial(differential_evolution, cost, ranges, popsize=12, maxiter=25, tol=1e-6, seed=1, polish=False)
        result, theirs, _ = timed(evolve)
        rows.append(
            (
                facets,
                100 * best,
                ours,
                found.traced,
                100 * result.fun,
                theirs,
                len(calls),
                100 * (best / result.fun - 1),
            )
        )
        figures |= {
            f"peer_{facets}_facets_ours_percent": 100 * best,
            f"peer_{facets}_facets_evolution_percent": 100 * result.fun,
            f"peer_{facets}_facets_ours_s": ours,
            f"peer_{facets}_facets_evolution_s": theirs,
        }
    columns = ("facets", "ours, %", "s", "traced", "evolution, %", "s", "traced", "ours worse by, %")
    table("Best accuracy with a field of 60 x 60 mm within 300 mm: search and differential evolution", columns, rows)
    return figures


def paper(found):
    """The rule of thumb sigma_Z / Z = Z sqrt(2) sigma / (baseline f) and the closed forms beside exact rays."""
    rows, figures = [], {}
    for facets in EXAMPLE.facets:
        mine = [c for c in found.candidates if c.prism.facets == facets]
        if not mine:
            continue
        focal = CAMERA.focal[0]
        rule = [c.figures.depths * np.sqrt(2) * EXAMPLE.noise / (c.figures.baseline * focal) for c in mine]
        ratio = np.array([c.figures.sigma / r for c, r in zip(mine, rule, strict=True)])
        forms = [
            screen(
                EXAMPLE,
                facets,
                EXAMPLE.glasses.index(c.prism.glass),
                [c.prism.apex_deg],
                [c.prism.distance],
                c.prism.azimuth_deg,
            )
            for c in mine
        ]
        exact = np.array([c.figures.accuracy / float(form.accuracy[0]) for c, form in zip(mine, forms, strict=True)])
        for name, values in (("rule of thumb", ratio), ("closed forms", exact)):
            low, middle, high = np.nanpercentile(values, [5, 50, 95])
            rows.append((f"{facets} facets: {name}", len(mine), low, middle, high))
            figures[f"exact_over_{name.replace(' ', '_')}_{facets}_facets_ratio"] = middle
    columns = ("exact rays over", "prisms", "5 %", "median", "95 %")
    table("Noise of depth by exact rays, over formulas", columns, rows)
    return figures


def slug(name):
    """A name as a part of the name of a figure."""
    return re.sub(r"\W+", "_", name.replace("%", "percent"))


def _setup(requirements, facets, apex_deg, distance, azimuth_deg=None):
    """A prism that just covers the picture, as the search makes them."""
    thickness, radius = covering_solid(requirements.camera, apex_deg, distance, edge_of(requirements))
    glass = requirements.glasses[0]
    turn = usual_azimuth(facets) if azimuth_deg is None else azimuth_deg
    return requirements.setup(Prism(facets, apex_deg, glass, distance, thickness, radius, azimuth_deg=turn))


if __name__ == "__main__":
    main()
