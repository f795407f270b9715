"""The thesis's experiments: setups of a stated baseline, computed corners, depth by each approach."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from benchmarks.data import renderer_setup
from cyclopean import Camera, Mirror, Mirrors, Setup, triangulate
from cyclopean.calibration.comparison import compare
from cyclopean.errors import OpticError, SetupError
from cyclopean.experiments import (
    ALL,
    TRUE,
    USUAL,
    DrawingError,
    Material,
    Seen,
    as_latex,
    as_markdown,
    baseline,
    board_for,
    calibration_poses,
    cameras_table,
    long_table,
    observe_boards,
    perform,
    standard_setup,
    summary_table,
    synthetic,
    target_poses,
    thesis_table,
    virtual_centres,
)
from cyclopean.jobs.experiment_photographs import detected, rendered_set, rendered_setup
from cyclopean.rigs import pinhole_rig, sketch
from cyclopean.targets import DIRECT, together
from cyclopean.triangulation import point_covariance

DEPTHS = (600.0, 800.0, 1100.0, 1600.0)
RIGHT = DrawingError(0, 0, 0, 0)


@cache
def setup_of(facets):
    """A standard setup with a small camera, quickly traced."""
    return standard_setup(facets, camera=Camera((640, 480), 1200))


@pytest.fixture(scope="module", params=(2, 3))
def exact(request):
    """An experiment with exact corners and the right drawing."""
    return perform(synthetic(setup_of(request.param), DEPTHS, drawing=RIGHT, noise_px=0))


@pytest.fixture(scope="module")
def noisy():
    return perform(synthetic(setup_of(3), DEPTHS, noise_px=0.05, seed=4))


@pytest.mark.parametrize(("facets", "wanted"), [(2, 40), (3, 40), (4, 45), (5, 30), (8, 20)])
def test_the_baseline_is_the_one_that_was_asked_for(facets, wanted):
    rig = standard_setup(facets, wanted, camera=Camera((640, 480), 1200)).rig()
    centres = virtual_centres(rig)
    apart = np.linalg.norm(np.roll(centres, 1, axis=0) - centres, axis=-1)
    assert baseline(rig) == pytest.approx(wanted, abs=1e-6)  # what the search ends at
    assert apart == pytest.approx(wanted, rel=0.02)  # sectors of a picture that is no circle differ


@pytest.mark.parametrize(("name", "facets"), [("t2_b40", 2), ("t3_b40", 3), ("t4_b45", 4)])
def test_standard_setups_are_the_renderers(mitsuba, name, facets):
    """The renderer's rigs were placed for 40, 40 and 45 mm by somebody else's trace."""
    theirs, ours = renderer_setup(name).optic, standard_setup(facets).optic
    assert (ours.apex_deg, ours.azimuth_deg) == (theirs.apex_deg, theirs.azimuth_deg)
    assert ours.distance == pytest.approx(theirs.distance, rel=0.003)  # how one averages the centres of a bundle
    assert ours.thickness == pytest.approx(theirs.thickness, rel=0.02)  # how far the glass reaches


def test_the_baseline_grows_with_the_closed_form():
    """lambda = 2 rho sin(pi / n), rho = z_apex tan(delta), delta = asin(n sin a) - a, for light along the axis."""
    setup = standard_setup(4, 30.0)
    optic, angle = setup.optic, np.deg2rad(setup.optic.apex_deg)
    bend = np.arcsin(1.5168 * np.sin(angle)) - angle
    closed = 2 * (optic.distance + optic.thickness) * np.tan(bend) * np.sin(np.pi / 4)
    assert closed == pytest.approx(30.0, rel=0.1)  # centres lie a few mm behind or before the pinhole


def test_the_prism_covers_the_picture():
    rig = setup_of(5).rig(margin=0)
    assert (rig.facets >= 0).all()


@pytest.mark.parametrize(
    ("given", "error", "words"),
    [
        ({"facets": 1}, OpticError, "2 facets or more"),
        ({"facets": 2, "baseline": 400}, SetupError, "the longest there is is 12"),
        ({"facets": 2, "baseline": 0.1}, SetupError, "the shortest there is"),
        ({"facets": 2, "baseline": float("nan")}, SetupError, "positive number"),
        ({"facets": 3, "apex_deg": 50}, OpticError, "totally reflected"),
        ({"facets": 3, "camera": Camera((1280, 960), 200)}, SetupError, "rim would be thinner"),
    ],
)
def test_setups_that_cannot_be_built_name_what_limits(given, error, words):
    with pytest.raises(error, match=words):
        standard_setup(**given)


def test_the_longest_baseline_is_told_rightly():
    """Just below the stated limit there is a setup, and its prism ends before the target."""
    with pytest.raises(SetupError, match=r"the longest there is is (\d+\.\d)") as found:
        standard_setup(3, 500)
    longest = float(str(found.value).split("longest there is is ")[1].split(" mm")[0])
    optic = standard_setup(3, longest - 1).optic
    assert optic.distance + optic.thickness < 600


def test_a_drawing_is_off_by_what_is_stated():
    setup = setup_of(3)
    drawn = DrawingError(0.1, -2.0, 0.5, 2.0).drawn(setup)
    assert drawn.optic.apex_deg - setup.optic.apex_deg == pytest.approx(0.1)
    assert drawn.optic.distance - setup.optic.distance == pytest.approx(-2)
    assert np.linalg.norm(np.subtract(drawn.optic.tilt_deg, setup.optic.tilt_deg)) == pytest.approx(0.5)
    assert drawn.camera.focal == pytest.approx(np.multiply(setup.camera.focal, 1.02))


def test_without_error_depth_is_exact(exact):
    """Exact corners leave only rounding: 1e-6 of depth is a thousandth of what 0.01 px would do."""
    for approach in ("physical model", TRUE):
        assert np.abs(exact.errors_percent(approach)).max() < 1e-4


def test_sketches_err_as_their_model_does(exact):
    """With exact corners and the right drawing the error is the pinhole's own, independently triangulated here."""
    true = exact.material.true
    rig = true.rig()
    pinholes = pinhole_rig([sketch(view, (600, 1600)) for view in rig], rig).unbounded()
    points = triangulate(pinholes, exact.pixels).points
    # the boundary ray is one of a traced outline's, which may come out a little different: 1e-4 of depth
    assert exact.of("ray sketch (middle)").points[:, 2] == pytest.approx(points[:, 2], rel=1e-4)


def test_a_sketched_biprism_errs_by_what_is_known_near_the_axis():
    """The model error over depth of a biprism with facets of 6.4 degrees, 370 mm away, traced independently.

    On the axis +0.50 % at 600 mm, +0.18 % at 1000 mm and -0.65 % at 1500 mm, with the boundary ray through the middle.
    """
    camera = Camera((2048, 1536), 25 / 0.0055)
    setup = standard_setup(2, 44.5, apex_deg=6.4, camera=camera)
    rig = setup.rig()
    depths = np.array([600.0, 1000.0, 1500.0])
    axis = np.stack([0 * depths, 0 * depths, depths], -1)
    pinholes = pinhole_rig([sketch(view, (600, 1500)) for view in rig], rig).unbounded()
    error = 100 * (triangulate(pinholes, rig.unbounded().project(axis)).points[:, 2] / depths - 1)
    assert setup.optic.distance == pytest.approx(370, rel=0.03)
    assert error == pytest.approx([0.50, 0.18, -0.65], abs=0.1)  # their distance and thickness were not quite these


def test_noise_spreads_depth_as_its_covariance_says(noisy):
    """Each error over its own propagated sigma has unit variance; 1 +- 4 / sqrt(2 N) for N independent points."""
    score = (noisy.of(TRUE).points[:, 2] - noisy.actual) / noisy.of(TRUE).deviation
    limit = 4 / np.sqrt(2 * len(score))
    assert np.mean(score**2) == pytest.approx(1, abs=2 * limit)  # of a square: twice that of a root
    again = point_covariance(noisy.material.true.rig().unbounded(), noisy.of(TRUE).points, 0.05,
                             np.isfinite(noisy.pixels[..., 0]))  # fmt: skip
    assert noisy.of(TRUE).deviation == pytest.approx(np.sqrt(again[:, 2, 2]), rel=1e-3)  # linear in the noise


def test_the_physical_model_is_nearly_as_good_as_the_truth(noisy):
    """Eight boards of 1200 corners say more than one point: its rms is at most half above the limit by noise."""
    found, limit = (row.rms_percent for row in noisy.summary if row.approach in ("physical model", TRUE))
    assert found < 1.5 * limit


def test_a_wrong_drawing_reaches_sketches_but_not_calibrations():
    """Depth errs by A times the relative error of the facets' angle: 0.5 degrees of 12 are 30 % at 1600 mm."""
    setup = setup_of(2)
    runs = [
        perform(synthetic(setup, (800, 1600), drawing=drawing, noise_px=0), USUAL)
        for drawing in (RIGHT, DrawingError(0.5, 0, 0, 0))
    ]
    right, wrong = (
        {row.approach: row.recovered for row in run.rows if row.actual == 1600} for run in runs
    )  # fmt: skip
    apex = setup.optic.distance + setup.optic.thickness
    expected = -(1600 / apex - 1) * 0.5 / 12
    assert wrong["ray sketch (middle)"] / right["ray sketch (middle)"] - 1 == pytest.approx(expected, rel=0.3)
    assert wrong["physical model"] == pytest.approx(1600, rel=1e-6)
    assert abs(wrong["virtual cameras, intrinsics free"] / 1600 - 1) < 0.05  # only their frame is the drawing's


def test_a_field_point_is_right_where_it_was_taken():
    experiment = perform(synthetic(setup_of(2), DEPTHS, noise_px=0), ("ray sketch + field point",))
    point = experiment.field_point
    there = np.argmin(np.nansum(np.linalg.norm(experiment.pixels - point.pixels, axis=-1), axis=-1))
    assert experiment.actual[there] == point.depth
    assert experiment.recovered[0].points[there, 2] == pytest.approx(point.depth, rel=1e-6)  # the test's tolerance


def test_boards_that_stay_give_the_real_frame():
    """With the board photographed before the prism is put on, no drawing sets the frame of virtual cameras."""
    setup, name = setup_of(3), "virtual cameras, intrinsics free"
    offs = []
    for stays in (False, True):
        wrong = DrawingError(0.05, 8.0, 0.2, 0.0)
        material = synthetic(setup, DEPTHS, drawing=wrong, noise_px=0, board_stays=stays)
        assert (DIRECT in material.calibration.observations.view) == stays
        offs.append(abs(perform(material, (name,)).summary[0].mean_percent))
    assert offs[1] < offs[0] / 3


def test_computed_corners_are_where_the_views_project_them():
    setup = setup_of(4)
    board = board_for(setup, (600, 1600))
    poses = calibration_poses(setup, board, (600, 1600), 5)
    seen = observe_boards(setup, board, poses, 0.0, np.random.default_rng(0))
    rig = setup.rig()
    for k, pose in enumerate(poses):
        there = rig.project(pose @ board.points)
        rows = seen.photo == k
        assert seen.pixels[rows] == pytest.approx(there[seen.point[rows], seen.view[rows]], abs=1e-9)
    assert set(seen.view) == {0, 1, 2, 3}


def test_noise_has_the_stated_size():
    setup = setup_of(2)
    board = board_for(setup, (600, 1600))
    poses = target_poses(board, (600, 1000, 1600))
    exact, noisy = (observe_boards(setup, board, poses, sigma, np.random.default_rng(1)).pixels for sigma in (0.0, 0.2))
    limit = 4 / np.sqrt(2 * exact.size)  # four standard deviations of a sample's standard deviation
    assert np.std(noisy - exact) == pytest.approx(0.2, rel=limit)


def test_boards_near_the_prism_do_not_stand_in_it():
    setup = standard_setup(2, 30.0, nearest=200.0)
    board = board_for(setup, (200, 400))
    end = setup.optic.distance + setup.optic.thickness
    for pose in calibration_poses(setup, board, (200, 400)):
        assert (pose @ board.points)[:, 2].min() > end


def test_tables_hold_what_was_recovered(noisy):
    columns, rows = thesis_table(noisy)
    assert columns == ("actual (mm)", *USUAL)
    assert [float(row[0]) for row in rows] == list(DEPTHS)
    cells = {(row.approach, row.actual): row for row in noisy.rows}
    for row in rows:
        for name, cell in zip(USUAL, row[1:], strict=True):
            one = cells[name, float(row[0])]
            depths = noisy.of(name).points[noisy.actual == one.actual, 2]
            assert cell == f"{depths.mean():.2f} ({100 * (depths.mean() / one.actual - 1):+.2f})"
            assert one.rms_percent**2 == pytest.approx(one.error_percent**2 + (100 * one.deviation / one.actual) ** 2)
    assert len(long_table(noisy)[1]) == len(USUAL) * len(DEPTHS)
    whole = {row[0]: float(row[1]) for row in summary_table(noisy)[1]}
    error = noisy.errors_percent(TRUE)
    assert whole[TRUE] == pytest.approx(np.sqrt(np.mean(error**2)), abs=1e-3)


def test_virtual_cameras_stand_where_they_were_placed(noisy):
    """The baseline of the true setup is the one asked for; that of the physical model as nearly as noise lets it."""
    found = {row[0]: row for row in cameras_table(noisy)[1]}
    assert float(found[TRUE][1]) == pytest.approx(40, abs=1e-3)
    assert float(found["physical model"][1]) == pytest.approx(40, rel=0.005)
    focal = [float(x) for x in found["physical model"][3].split(", ")]
    assert focal == pytest.approx([1200, 1200], rel=0.005)


def test_depths_are_those_of_compared_calibrations(noisy):
    """`compare` triangulates and judges in another way, and knows nothing of experiments."""
    material = noisy.material
    observations, target = together([material.camera, material.calibration])
    names = ("ray sketch (middle)", "physical model")
    seen, board = material.targets
    known = dict(zip(seen.photos, material.depths, strict=True))
    other = compare(observations, target, material.drawn, names, seen, test_target=board, known_depths=known)
    for route in other.routes:
        ours = [row for row in noisy.rows if row.approach == route.name]
        for row, theirs in zip(ours, other.depth_table(route), strict=True):
            assert row.recovered == pytest.approx(theirs.mean, rel=1e-9)
            assert row.rms_percent == pytest.approx(100 * theirs.rms / theirs.depth, rel=1e-6)


def test_tables_for_documents_have_every_cell(noisy):
    columns, rows = thesis_table(noisy)
    markdown = as_markdown((columns, rows)).strip().split("\n")
    assert [line.strip("| ").split(" | ") for line in markdown[2:]] == [list(row) for row in rows]
    latex = as_latex((("name", "a & b"), [("50 %", "1")]), "x_1")
    for part in ("a \\& b", "50 \\% & 1 \\\\", "\\caption{x\\_1}"):
        assert part in latex


def test_an_approach_that_fails_keeps_its_reason():
    """Calibration photographs that show the board in one view only do not link virtual cameras."""
    material = synthetic(setup_of(2), DEPTHS)
    seen = material.calibration.observations
    alone = Seen(seen.select(seen.view == 0), material.calibration.target)
    name = "virtual cameras, intrinsics free"
    experiment = perform(replace(material, calibration=alone), (name, TRUE))
    assert experiment.of(name).failed
    assert experiment.of(name).message
    assert all(row.points == 0 and np.isnan(row.recovered) for row in experiment.rows if row.approach == name)
    assert thesis_table(experiment)[1][0][1] == "- (-)"
    assert experiment.summary[1].rms_percent < 1


@pytest.mark.parametrize(
    ("depths", "more", "words"),
    [
        ((700, 600), {}, "must rise"),
        ((600, 600), {}, "must rise"),
        ((150, 600), {}, "before or inside the prism"),
        ((), {}, "numbers of mm"),
        ((600, float("nan")), {}, "numbers of mm"),
        (DEPTHS, {"noise_px": -1}, "0 px or more"),
        (DEPTHS, {"photographs": 2}, "3 photographs"),
    ],
)
def test_wrong_conditions_say_what_was_wanted(depths, more, words):
    with pytest.raises(SetupError, match=words):
        synthetic(setup_of(2), depths, **more)


def test_wrong_calls_say_what_was_wanted():
    material = synthetic(setup_of(2), DEPTHS)
    with pytest.raises(SetupError, match="approaches must be some of"):
        perform(material, ("magic",))
    with pytest.raises(SetupError, match="in a simulation only"):
        perform(replace(material, true=None), ALL)
    with pytest.raises(SetupError, match="wants its depth"):
        perform(replace(material, depths=material.depths[:2]))
    with pytest.raises(SetupError, match="has no approach"):
        perform(material, (TRUE,)).of("physical model")
    mirrors = Mirrors((Mirror((20, 0, 60), (-1, 0, -1), (60, 60)),), ((0,),), direct=True)
    with pytest.raises(SetupError, match="about prisms"):
        synthetic(Setup(Camera((640, 480), 900), mirrors), DEPTHS)


def test_targets_in_one_view_only_are_reported():
    material = synthetic(setup_of(2), DEPTHS)
    seen = material.targets.observations
    alone = Seen(seen.select(seen.view == 1), material.targets.target)
    with pytest.raises(SetupError, match="no two views show the same point"):
        perform(replace(material, targets=alone))


def test_rendered_photographs_and_computed_corners_agree(mitsuba):
    """The true setup recovers the renderer's depths to what corners of 0.02 px allow; a sketch errs as computed."""
    true, part = rendered_setup(mitsuba, "t2_b40"), rendered_set(mitsuba, "targets_t2_b40")
    part = replace(part, **{key: [getattr(part, key)[k] for k in (1, 4)] for key in ("files", "poses", "depths")})
    seen = detected(part, true.rig().masks, lambda *_: None)
    material = Material(true, true, None, seen, seen, np.array(part.depths))
    names = ("ray sketch (middle)", TRUE)
    found = perform(material, names)
    assert found.summary[1].rms_percent < 0.03
    exact = observe_boards(true, part.board, part.poses, 0.0, np.random.default_rng(0))
    twin = perform(replace(material, targets=Seen(exact, part.board)), names)
    ours, theirs = (
        {row.actual: row.error_percent for row in e.rows if row.approach == names[0]} for e in (found, twin)
    )
    for depth in (700.0, 1000.0):
        assert ours[depth] == pytest.approx(theirs[depth], abs=0.2)  # the detector misses corners at the borders
