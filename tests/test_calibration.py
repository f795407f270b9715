"""The joint calibration: laws of least squares, oracles, and the renderer's true parameters."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import least_squares

from benchmarks.data import renderer_setup
from benchmarks.targets import renderer_corners
from cyclopean import Camera, Mirror, Mirrors, Plate, Prism, Setup
from cyclopean.calibration import calibrate, guess_prism, renumbered
from cyclopean.calibration.checks import warnings_of
from cyclopean.calibration.least_squares import minimise
from cyclopean.calibration.prediction import Prediction
from cyclopean.calibration.unknowns import Unknowns
from cyclopean.errors import SetupError, ShapeError
from cyclopean.geometry import Pose
from cyclopean.targets import DIRECT, Board, Observations, together

BOARD = Board("chessboard", 9, 7, 20.0)
CAMERA = Camera((640, 480), 900)
PRISM = Prism(3, 10.0, 1.5168, 60.0, 12.0, azimuth_deg=90.0)
# Mirrors that show the same scene twice: the picture beside each, and its reflection
MIRRORS = Mirrors((Mirror((-60, 0, 200), (1, 0, 0.02), (400, 400)),), direct=True)
PLATE = Plate(1.5168, 60.0, 25.0, tilt_deg=(25.0, 10.0, 0.0))


def board_poses(count: int, seed: int = 3, depth: float = 600.0) -> list[Pose]:
    """Poses of a board in front of the camera, tilted either way."""
    rng = np.random.default_rng(seed)
    middle = np.array([90.0, 70.0, 0.0])
    poses = []
    for _ in range(count):
        turned = Pose.from_rotation_vector(rng.normal(0, 0.35, 3))
        place = np.array([*rng.uniform(-40, 40, 2), depth * rng.uniform(0.8, 1.6)])
        poses.append(Pose(turned.rotation, place - turned.rotation @ middle))
    return poses


def photographed(setup, poses, noise=0.0, seed=1, direct=(), board=BOARD) -> Observations:
    """What the setup's views show of the board; photographs in `direct` are taken without the optic."""
    rng = np.random.default_rng(seed)
    rig = setup.rig(margin=0)
    rows = []
    for photo, pose in enumerate(poses):
        points = pose @ board.points
        pixels = setup.camera.project(points)[:, None] if photo in direct else rig.project(points)
        for k in range(pixels.shape[1]):
            inside = setup.camera.contains(pixels[:, k])
            for point in np.flatnonzero(inside & np.isfinite(pixels[:, k]).all(-1)):
                rows.append((photo, DIRECT if photo in direct else k, point, *pixels[point, k]))
    table = np.array(rows)
    pixels = table[:, 3:] + rng.normal(0, noise, (len(table), 2)) if noise else table[:, 3:]
    numbers = table[:, :3].astype(int).T
    return Observations(*numbers, pixels, tuple(f"photo {k}" for k in range(len(poses))), max(noise, 0.01))


def nominal(setup):
    """The setup as a drawing may have it: 1 degree, 2 mm and 0.3 degrees off."""
    optic = setup.optic
    tilt = tuple(np.add(optic.tilt_deg, (1.0, -0.7, 0.5)))
    return replace(
        setup, optic=replace(optic, apex_deg=optic.apex_deg + 0.3, distance=optic.distance + 2, tilt_deg=tilt)
    )


def truths(setup, names):
    values = np.concatenate([setup.camera.lens, setup.optic.parameters(setup.wavelength_nm)])
    return np.array([values[setup.parameter_names.index(name)] for name in names])


def scores(calibration, setup):
    """Error of each parameter over its stated standard deviation."""
    names = calibration.unknowns.names
    return (calibration.solution.shared - truths(setup, names)) / np.array([calibration.sigma[name] for name in names])


def test_exact_observations_give_the_truth_back():
    setup = Setup(CAMERA, PRISM)
    observations = photographed(setup, board_poses(6))
    found = calibrate(observations, BOARD, nominal(setup), tolerances={"optic.pose": 1e3, "optic.apex": 1.0})
    assert found.solution.converged
    assert found.rms < 1e-6  # px: rounding of the projection, 1e-8 px a Newton step
    assert abs(found.setup.optic.apex_deg - 10.0) < 1e-5
    assert abs(found.setup.optic.distance - 60.0) < 1e-3


@pytest.mark.parametrize("optic", [MIRRORS, PLATE], ids=["mirror", "plate"])
def test_mirrors_and_plates_calibrate_with_the_same_code(optic):
    setup = Setup(CAMERA, optic)
    observations = photographed(setup, board_poses(8), noise=0.05)
    values = optic.parameters(setup.wavelength_nm)
    off = np.zeros(len(values))
    off[:2] = 0.01  # rad
    start = replace(setup, optic=optic.with_parameters(values + off))
    found = calibrate(observations, BOARD, start)
    assert found.solution.converged
    assert abs(found.solution.sigma0 - 1) < 0.1  # over a thousand residuals: 2 % expected
    informed = found.unknowns.spread > 3 * np.array(list(found.sigma.values()))  # the drawing does not hold these
    assert informed.sum() >= 2
    assert np.abs(scores(found, setup))[informed].max() < 4


def test_the_camera_is_found_with_the_optic():
    setup = Setup(replace(CAMERA, distortion=(0.05, -0.1, 1e-3, -5e-4, 0.0)), PRISM)
    observations = photographed(setup, board_poses(12), noise=0.05, direct=range(6))
    start = replace(nominal(setup), camera=replace(CAMERA, focal=870.0))
    found = calibrate(observations, BOARD, start)
    assert {name for name in found.unknowns.names if name.startswith("camera.")} >= {"camera.focal_x", "camera.k1"}
    assert abs(found.setup.camera.focal[0] / 900 - 1) < 0.002
    assert np.abs(scores(found, setup)).max() < 4


def test_stated_sigmas_are_those_of_repeated_noise():
    """Over 30 repeats of 7 parameters the mean squared score is 1 to within 0.1 (1 sigma): 3 sigma allowed."""
    setup = Setup(CAMERA, PRISM)
    poses = board_poses(5)
    squares = [scores(calibrate(photographed(setup, poses, 0.1, seed), BOARD, setup), setup) ** 2 for seed in range(30)]
    assert 0.7 < np.mean(squares) < 1.3


@pytest.mark.parametrize("rig", ["n2", "n3_pose", "n2_flip", "t4_b45"])
def test_renderer_parameters_lie_within_three_sigma(mitsuba, rig):
    corners = renderer_corners(f"calib_{rig}", noise=0.046)
    setup = renderer_setup(rig)
    found = calibrate(corners.observations, corners.board, nominal(setup))
    assert found.rms == pytest.approx(0.046, rel=0.1)
    assert abs(found.setup.optic.apex_deg - setup.optic.apex_deg) < 0.02
    assert np.abs(scores(found, setup)).max() < 3.5  # of 7 parameters, four rigs: 3.5 is passed in 1 of 80 runs
    assert not found.outliers.mean() > 0.03


def test_one_photograph_is_enough_when_the_camera_is_known(mitsuba):
    corners = renderer_corners("calib_n3", noise=0.046)
    setup = renderer_setup("n3")
    found = calibrate(corners.observations.of_photos([4]), corners.board, nominal(setup))
    assert abs(found.setup.optic.apex_deg - 12.0) < 0.02
    assert np.abs(scores(found, setup)).max() < 3.5


@pytest.mark.parametrize("rig", ["n4", "n2_flip"])
def test_no_drawing_is_needed(mitsuba, rig):
    corners = renderer_corners(f"calib_{rig}", noise=0.046)
    setup = renderer_setup(rig)
    facets = setup.optic.facets
    observations = renumbered(corners.observations, -np.arange(facets) % facets)  # numbered the other way round
    start, observations = guess_prism(observations, corners.board, setup.camera, facets, 1.5168)
    assert start.optic.facing == setup.optic.facing
    found = calibrate(observations, corners.board, start, ("optic.pose", "optic.apex", "optic.thickness"))
    assert found.rms == pytest.approx(0.046, rel=0.1)
    assert abs(found.setup.optic.apex_deg - setup.optic.apex_deg) < 0.02


def test_each_colour_has_its_own_index():
    indices = (1.514, 1.517, 1.522)
    setups = [Setup(CAMERA, replace(PRISM, glass=index)) for index in indices]
    poses = board_poses(6)
    parts = [photographed(setup, poses, 0.05, seed) for seed, setup in enumerate(setups)]
    joined = Observations(
        *(np.concatenate([getattr(part, name) for part in parts]) for name in ("photo", "view", "point", "pixels")),
        parts[0].photos,
        0.05,
        np.repeat(np.arange(3), [len(part) for part in parts]),
    )
    start = [nominal(setups[1])] * 3
    found = calibrate(joined, BOARD, start, ("optic.pose", "optic.apex", "optic.index"))
    assert len({setup.optic.apex_deg for setup in found.setups}) == 1
    got = np.array([setup.optic.glass for setup in found.setups])
    sigma = np.array([found.sigma[f"optic.index[{k}]"] for k in range(3)])
    assert (np.abs(got - indices) < 4 * sigma).all()
    # what separates the colours is known far better than each index, which trades off against the apex angle
    np.testing.assert_allclose(np.diff(got), np.diff(indices), atol=5e-5)


def test_gross_outliers_are_reported_and_do_no_harm():
    setup = Setup(CAMERA, PRISM)
    observations = photographed(setup, board_poses(6), noise=0.05)
    rng = np.random.default_rng(2)
    wrong = rng.random(len(observations)) < 0.03
    pixels = np.where(
        wrong[:, None], observations.pixels + rng.choice([-8, 8], (len(observations), 2)), observations.pixels
    )
    found = calibrate(replace(observations, pixels=pixels), BOARD, nominal(setup))
    order = np.lexsort((found.observations.point, found.observations.view, found.observations.photo))
    same = np.lexsort((observations.point, observations.view, observations.photo))
    np.testing.assert_array_equal(found.outliers[order] >= wrong[same], True)  # every wrong row is found
    assert abs(found.setup.optic.apex_deg - 10.0) < 0.01


def misnumbered(observations, rows):
    """Observations in which the corners of some rows are numbered from the other end of the board."""
    last = len(BOARD.points) - 1
    return replace(observations, point=np.where(rows, last - observations.point, observations.point))


def test_a_view_that_contradicts_the_others_is_left_out():
    setup = Setup(CAMERA, PRISM)
    observations = photographed(setup, board_poses(6), noise=0.05)
    wrong = misnumbered(observations, (observations.photo == 2) & (observations.view == 1))
    found = calibrate(wrong, BOARD, nominal(setup))
    (said,) = found.left_out
    assert "view 1 of photo 2" in said
    assert len(found.observations) == np.count_nonzero((wrong.photo != 2) | (wrong.view != 1))
    assert np.abs(scores(found, setup)).max() < 4


def test_a_photograph_that_contradicts_the_others_is_left_out():
    setup = Setup(CAMERA, PRISM)
    observations = photographed(setup, board_poses(6), noise=0.05)
    other = np.where(observations.photo == 4, np.array([0, 2, 1])[observations.view], observations.view)
    found = calibrate(replace(observations, view=other), BOARD, nominal(setup))
    assert "photo 4" in found.left_out[0]
    assert "photo 4" not in found.observations.photos
    assert np.abs(scores(found, setup)).max() < 4


def test_facets_drawn_to_the_wrong_side_are_named():
    setup = Setup(CAMERA, PRISM)
    observations = photographed(setup, board_poses(6), noise=0.05)
    drawn = replace(setup, optic=replace(PRISM, facing="camera"))
    assert any('facing = "scene"' in line for line in warnings_of(calibrate(observations, BOARD, drawn)))


def test_views_without_the_target_are_named():
    setup = Setup(CAMERA, PRISM)
    observations = photographed(setup, board_poses(6), noise=0.05)
    found = calibrate(observations.select(observations.view < 2), BOARD, setup)
    assert any("view 2 never shows the target" in line for line in warnings_of(found))


def test_a_wrong_thickness_is_found_and_not_hidden_in_the_distance():
    setup = Setup(CAMERA, PRISM)
    observations = photographed(setup, board_poses(8), noise=0.01)
    drawn = replace(setup, optic=replace(PRISM, thickness=13.0))
    found = calibrate(observations, BOARD, drawn)
    assert abs(found.setup.optic.distance - 60) < 4 * found.sigma["optic.distance"]
    assert abs(found.setup.optic.thickness - 12) < 4 * found.sigma["optic.thickness"]


def test_a_board_that_seems_to_lean_the_wrong_way_is_set_right(mitsuba):
    """With a drawing off by 0.3 degrees, several of these photographs start in the mirrored pose."""
    corners = renderer_corners("calib_n3", noise=0.046)
    found = calibrate(corners.observations, corners.board, nominal(renderer_setup("n3")))
    assert found.solution.sigma0 < 1.1 * 0.046 / 0.05


def test_short_names_stand_for_parameters():
    setup = Setup(CAMERA, PRISM)
    names = Unknowns.of([setup], ("optic.pose", "camera.focal_tied", "optic.apex", "optic.apex")).names
    assert names == (
        "camera.focal_tied", "optic.tilt_x", "optic.tilt_y", "optic.tilt_z", "optic.shift_x", "optic.shift_y",
        "optic.distance", "optic.apex",
    )  # fmt: skip
    tied = Unknowns.of([replace(setup, camera=replace(CAMERA, focal=(900, 990)))], ("camera.focal_tied",))
    assert tied.setup(np.array([1000.0])).camera.focal == pytest.approx((1000, 1100))
    assert tied.setup(np.array([1000.0])).optic.glass == PRISM.glass


@pytest.mark.parametrize(
    ("free", "tolerances", "said"),
    [
        (("optic.apexx",), None, "did you mean optic.apex"),
        (("optic.mirrors",), None, "no parameter"),
        (("optic.apex",), {"optic.apex": -1.0}, "positive"),
        (("optic.apex",), {"optic.apex": np.inf}, "positive"),
        (("optic.apex",), {"optic.glue": 1.0}, "optic.glue"),
        (("optic.apex",), {"optic.thickness": 1.0}, "held"),
    ],
)
def test_wrong_names_and_tolerances_are_told(free, tolerances, said):
    with pytest.raises(SetupError, match=said):
        Unknowns.of([Setup(CAMERA, PRISM)], free, tolerances)


def test_wrong_observations_are_told():
    setup = Setup(CAMERA, PRISM)
    observations = photographed(setup, board_poses(2))
    nothing = observations.select(np.zeros(len(observations), bool))
    with pytest.raises(SetupError, match="no observations"):
        calibrate(nothing, BOARD, setup)
    pixels = observations.pixels.copy()
    pixels[3] = np.nan
    with pytest.raises(ShapeError, match="not numbers"):
        calibrate(replace(observations, pixels=pixels), BOARD, setup)
    with pytest.raises(ShapeError, match="right board"):
        calibrate(replace(observations, point=observations.point + 30), BOARD, setup)
    with pytest.raises(SetupError, match="number of facets"):
        calibrate(observations, BOARD, replace(setup, optic=replace(PRISM, facets=2)))
    with pytest.raises(SetupError, match="colour channels"):
        calibrate(replace(observations, channel=1 + 0 * observations.channel), BOARD, setup)
    with pytest.raises(SetupError, match="four points"):
        calibrate(observations.select(observations.point < 2), BOARD, setup)


def test_photographs_of_two_boards_calibrate_together():
    setup = Setup(CAMERA, PRISM)
    other = Board("chessboard", 7, 6, 25.0)
    parts = [
        (photographed(setup, board_poses(4), 0.05, direct=range(4)), BOARD),
        (photographed(setup, board_poses(4, seed=8), 0.05, board=other), other),
    ]
    observations, target = together(parts)
    assert len(target.points) == len(BOARD.points) + len(other.points)
    found = calibrate(observations, target, nominal(setup))
    assert found.solution.sigma0 == pytest.approx(1, rel=0.1)  # of some 800 residuals: 3 % expected


def small_problem(noise=0.1, every=1):
    """Prediction, start, poses, observations and points of a small calibration, of every so manieth point."""
    setup = Setup(CAMERA, PRISM)
    poses = board_poses(3)
    observations = photographed(setup, poses, noise).select(np.s_[::every])
    start = replace(setup, optic=replace(PRISM, apex_deg=10.1))
    unknowns = Unknowns.of([start], ("optic.distance", "optic.apex"))
    return Prediction(unknowns, observations), unknowns, poses, observations, BOARD.points[observations.point]


def moved(poses, steps):
    return [
        Pose(Pose.from_rotation_vector(step[:3]).rotation @ pose.rotation, pose.translation + step[3:])
        for pose, step in zip(poses, steps.reshape(-1, 6), strict=True)
    ]


def test_a_general_solver_finds_the_same_minimum_and_covariance():
    """SciPy's dense least squares, with all poses as ordinary unknowns, is the oracle."""
    predict, unknowns, poses, observations, points = small_problem()
    ours = minimise(predict, unknowns.start, poses, observations, points, loss="none")
    size = len(unknowns)

    def residuals(x):
        placed = moved(poses, x[size:])
        rig = np.stack([placed[photo] @ point for photo, point in zip(observations.photo, points, strict=True)])
        return ((observations.pixels - predict(x[:size], rig, False)[0]) / observations.sigma[:, None]).ravel()

    theirs = least_squares(residuals, np.concatenate([unknowns.start, np.zeros(18)]), x_scale="jac", xtol=1e-12)
    np.testing.assert_allclose(ours.shared, theirs.x[:size], rtol=1e-6)  # their differences are forward ones
    freedom = 2 * len(observations) - len(theirs.x)
    covariance = np.linalg.inv(theirs.jac.T @ theirs.jac) * 2 * theirs.cost / freedom
    np.testing.assert_allclose(ours.covariance, covariance[:size, :size], rtol=1e-3)
    theirs_pose = covariance[size + 6 : size + 12, size + 6 : size + 12]
    scale = np.sqrt(np.diag(theirs_pose))
    # as correlations; their poses are some 1e-3 rad from where their rotation vectors start
    np.testing.assert_allclose(
        ours.pose_covariance[1] / scale / scale[:, None], theirs_pose / scale / scale[:, None], atol=5e-3
    )


def test_ceres_finds_the_same_robust_minimum():
    """Ceres with its Huber loss on the same residuals, if pyceres is installed."""
    pyceres = pytest.importorskip("pyceres")
    predict, unknowns, poses, observations, points = small_problem(every=9)
    rng = np.random.default_rng(4)
    wrong = rng.random(len(observations)) < 0.05
    observations = replace(observations, pixels=observations.pixels + np.where(wrong[:, None], 5.0, 0.0))
    ours = minimise(predict, unknowns.start, poses, observations, points, tolerance=1e-13, iterations=200)
    seen = ours.residuals / observations.sigma[:, None]
    edge = 3 * np.median(np.linalg.norm(seen, axis=-1)) / 1.1774  # where our loss turns linear
    size = len(unknowns)

    class Row(pyceres.CostFunction):
        def __init__(self, row):
            super().__init__()
            self.row = row
            self.set_num_residuals(2)
            self.set_parameter_block_sizes([size, 6])

        def Evaluate(self, parameters, residuals, jacobians):
            def at(shared, step):
                pose = moved([poses[observations.photo[self.row]]], step)[0]
                one = Prediction(unknowns, observations.select([self.row]), predict.aims)
                pixel = one(shared, (pose @ points[self.row])[None], False)[0][0]
                return (pixel - observations.pixels[self.row]) / observations.sigma[self.row]

            shared, step = (np.array(block, dtype=float) for block in parameters)
            residuals[:] = at(shared, step)
            for number, jacobian in enumerate(jacobians or ()):
                if jacobian is None:
                    continue
                columns = []
                for k in range(size if number == 0 else 6):
                    h = np.zeros(size if number == 0 else 6)
                    h[k] = 1e-6
                    ends = [at(shared + s * h, step) if number == 0 else at(shared, step + s * h) for s in (1, -1)]
                    columns.append((ends[0] - ends[1]) / 2e-6)
                jacobian[:] = np.stack(columns, -1).ravel()
            return True

    problem = pyceres.Problem()
    shared, steps = unknowns.start.copy(), [np.zeros(6) for _ in poses]
    rows = [Row(k) for k in range(len(observations))]
    for row in rows:
        problem.add_residual_block(row, pyceres.HuberLoss(edge), [shared, steps[observations.photo[row.row]]])
    options = pyceres.SolverOptions()
    options.max_num_iterations, options.function_tolerance, options.num_threads = 30, 1e-12, 1
    pyceres.solve(options, problem, pyceres.SolverSummary())
    sigma = np.sqrt(np.diag(ours.covariance))
    assert (np.abs(ours.shared - shared) < 0.01 * sigma).all()
