"""The thesis's tables 4.1, 5.1 and 6.1: depth of planes at 600 to 1600 mm by every approach, 2, 3 and 4 facets.

    python -m benchmarks.thesis [RIG ...]

Each experiment twice: on the renderer's photographs, with the corners that our detector finds, and with computed
corners of the same boards in the same poses, with noise as large as the detector's error in each photograph. The
figures of the second are medians over SEEDS. The drawing is off by 0.05 degrees in the facets' angle, 1 mm in
distance, 0.2 degrees in tilt and 1 % in focal length; some rows say what a perfect drawing, or a frame that nobody
knows, would give.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from benchmarks.data import data_folder, renderer_setup
from benchmarks.results import table, write
from benchmarks.targets import detected_corners
from cyclopean import Setup, triangulate
from cyclopean.experiments import (
    ALL,
    TRUE,
    DrawingError,
    Experiment,
    Material,
    Seen,
    as_markdown,
    observe_boards,
    perform,
    thesis_table,
)
from cyclopean.geometry import rigid_motion
from cyclopean.jobs.experiment_photographs import rendered_set
from cyclopean.rigs import fit, pinhole_rig, sketch

RIGS = ("t2_b40", "t3_b40", "t4_b45")
SEEDS = range(5)
USUAL_NOISE = 0.046  # px, of a corner that cv2.cornerSubPix refined on these photographs
DEPTHS = (600.0, 1600.0)  # mm, of the planes
SKETCHES = ("ray sketch (middle)", "ray sketch (edge)", "ray sketch + field point")
BY_CORNERS = ("physical model", TRUE)


def photographed(rig: str) -> Material:
    """The experiment on the renderer's photographs."""
    true = renderer_setup(rig)
    bare, through, target = (detected_corners(name) for name in _sets(rig))
    return Material(
        true,
        DrawingError().drawn(true),
        Seen(bare.observations, bare.board),
        Seen(through.observations, through.board),
        Seen(target.observations, target.board),
        target.depths,
    )


def computed(rig: str, noise: float | None, seed: int) -> Material:
    """The same boards in the same poses, with exact corners and noise (px): the detector's own where it is None."""
    true, rng = renderer_setup(rig), np.random.default_rng(seed)
    seen, parts = [], [rendered_set(data_folder("mitsuba"), name) for name in _sets(rig)]
    for k, part in enumerate(parts):
        exact = observe_boards(true, part.board, part.poses, 0.0, rng, part.folder.name, k == 0)
        usual = detector_errors(part.folder.name) if noise is None else np.full(len(part.poses), noise)
        sigma = usual[exact.photo]
        pixels = exact.pixels + sigma[:, None] * rng.normal(size=exact.pixels.shape)
        seen.append(Seen(replace(exact, pixels=pixels, sigma=sigma), part.board))
    return Material(true, DrawingError().drawn(true), *seen, parts[-1].depths)


def detector_errors(name: str) -> np.ndarray:
    """Root mean square error (B,) px of the corners that the detector finds in each photograph of a set."""
    corners = detected_corners(name)
    miss, photo = np.nanmean((corners.observations.pixels - corners.truth) ** 2, axis=1), corners.observations.photo
    return np.array([np.sqrt(np.nanmean(miss[photo == k])) for k in range(len(corners.observations.photos))])


def _sets(rig):
    return "camera_only", f"calib_{rig}", f"targets_{rig}"


def errors(experiment: Experiment) -> Iterator[tuple[str, np.ndarray]]:
    """Names and errors (N,) of depth (%) of the approaches of an experiment."""
    for name in experiment.approaches:
        yield name, experiment.errors_percent(name)


def more_errors(experiment: Experiment) -> Iterator[tuple[str, np.ndarray]]:
    """The same of what nobody can do outside a simulation: a perfect drawing, a known frame, the best pinholes."""
    material = experiment.material
    true: Setup = material.true
    perfect = perform(replace(material, drawn=replace(material.drawn, optic=true.optic)), SKETCHES)
    yield from ((f"{name}, perfect drawing", error) for name, error in errors(perfect))
    rig = true.rig()
    inner = pinhole_rig([sketch(view, DEPTHS, view.region.centre) for view in rig], rig)
    yield "ray sketch (middle of the sub-image), perfect drawing", depth_errors(inner, experiment)
    best = pinhole_rig([fit(view, DEPTHS) for view in rig], rig)
    yield "best pinholes for the true rays", depth_errors(best, experiment)
    for one in experiment.recovered:
        if one.approach.startswith("virtual"):
            yield f"{one.approach}, in the true frame", _in_true_frame(one.views, experiment)


def depth_errors(rig, experiment: Experiment, motion=None) -> np.ndarray:
    """Errors (N,) of depth (%) of the target's points by other views, after a rigid motion."""
    points = triangulate(rig.unbounded(), experiment.pixels).points
    points = points if motion is None else motion @ points
    return 100 * (points[:, 2] / experiment.actual - 1)


def _in_true_frame(views, experiment):
    """Errors of calibrated views, moved to where the true setup has the calibration photographs' points."""
    from cyclopean import Rig

    rig, seen = Rig(tuple(views)), experiment.material.calibration.observations
    keys, row = np.unique(seen.photo * 10_000 + seen.point, return_inverse=True)
    pixels = np.full((len(keys), len(rig), 2), np.nan)
    pixels[row, seen.view] = seen.pixels
    theirs, true = (triangulate(one.unbounded(), pixels).points for one in (rig, experiment.material.true.rig()))
    good = np.isfinite(theirs).all(-1) & np.isfinite(true).all(-1)
    return depth_errors(rig, experiment, rigid_motion(theirs[good], true[good]))


def figures_of(rig: str) -> dict[str, float]:
    """Print the tables of one rig, and its figures."""
    noise = detector_errors(f"targets_{rig}")
    experiment = perform(photographed(rig), ALL)
    print(f"\n{rig}: the thesis's table on photographs; mean recovered depth, mm, and its error, %\n")
    print(as_markdown(thesis_table(experiment)))
    found = {name: [error] for name, error in (*errors(experiment), *more_errors(experiment))}
    twins: dict[str, list[np.ndarray]] = {}
    for seed in SEEDS:
        twin = perform(computed(rig, None, seed), ALL)
        usual = perform(computed(rig, USUAL_NOISE, seed), BY_CORNERS)
        extra = ((f"{name}, corners of {USUAL_NOISE} px", error) for name, error in errors(usual))
        for name, error in (*errors(twin), *more_errors(twin), *extra):
            twins.setdefault(name, []).append(error)
    figures = {f"{rig}_target_corners_nearest_rms_px": noise[0], f"{rig}_target_corners_farthest_rms_px": noise[-1]}
    rows = []
    for name in dict.fromkeys((*found, *twins)):
        row = []
        for kind, source in (("photographs", found), ("computed", twins)):
            for key, figure in (("rms", _rms), ("largest", _largest)):
                value = float(np.median([figure(e) for e in source[name]])) if name in source else np.nan
                row.append(value)
                if np.isfinite(value):
                    figures[f"{rig}_{slug(name)}_{kind}_{key}_percent"] = value
        rows.append([name, *row])
    columns = ["approach", "photographs rms", "largest", "computed rms", "largest"]
    spread = f"corners of {noise.min():.4f} to {noise.max():.4f} px; computed: median of {len(SEEDS)}"
    table(f"{rig}: error of depth, % ({spread})", columns, rows)
    for one in experiment.rows:
        if one.approach == "physical model":
            figures[f"{rig}_physical_model_{one.actual:g}mm_error_percent"] = one.error_percent
            figures[f"{rig}_physical_model_{one.actual:g}mm_rms_percent"] = one.rms_percent
    return figures


def slug(name: str) -> str:
    """The name of an approach as part of a key."""
    return "_".join("".join(c if c.isalnum() else " " for c in name).split())


def _rms(error):
    return np.sqrt(np.nanmean(error**2))


def _largest(error):
    return np.nanmax(np.abs(error))


def main(rigs: tuple[str, ...]) -> None:
    """Print the tables and keep the figures."""
    for rig in rigs:
        write("thesis", figures_of(rig))


if __name__ == "__main__":
    main(tuple(name for name in sys.argv[1:] if name in RIGS) or RIGS)
