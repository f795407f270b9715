"""Sub-images calibrated as ordinary cameras: exact over mirrors, and as good as a pinhole can be through a prism."""

import json
from dataclasses import dataclass

import numpy as np
import pytest
from scenes import small_setup
from setups import DISTORTION, STRAIGHT

from benchmarks.data import renderer_setup
from cyclopean import Camera, Mirror, Mirrors, Setup, triangulate
from cyclopean.calibration.virtual import calibrate_pairwise, calibrate_virtual
from cyclopean.calibration.virtual_frame import aligned
from cyclopean.calibration.virtual_model import Eye, RigModel
from cyclopean.errors import SetupError, ShapeError
from cyclopean.geometry import Pose, rigid_motion
from cyclopean.rigs import Rig, fit, pinhole_rig
from cyclopean.targets import DIRECT, Observations

BENT = Camera((640, 480), (900, 905), (318.0, 243.0), DISTORTION)
# the scene straight ahead, and at both sides its image in a mirror
MIRRORS = Setup(
    BENT,
    Mirrors(
        (Mirror((25, 0, 110), (-1, 0.02, 0.1), (110, 110)), Mirror((-26, 1, 110), (1, 0.03, 0.11), (110, 110))),
        ((0,), (1,)),
        direct=True,
    ),
)
FLIPPED = [True, True, False]


@dataclass(frozen=True)
class Known:
    """A target of known points."""

    points: np.ndarray


BOARD = Known(np.stack([*np.meshgrid(np.arange(9) * 12.0, np.arange(7) * 12.0), np.zeros((7, 9))], -1).reshape(-1, 3))
SOLID = Known(np.random.default_rng(8).uniform([3, -9, -45], [93, 81, 45], (60, 3)))


def poses_of(count, distance, seed=1, middle=(48.0, 36.0, 0.0), spread=40.0):
    """Poses rig_from_target (count,) of a target that is turned by up to 35 degrees before the camera."""
    rng = np.random.default_rng(seed)
    poses = []
    for _ in range(count):
        turn = Pose.from_rotation_vector(rng.uniform(-0.6, 0.6, 3))
        there = np.array([*rng.uniform(-spread, spread, 2), rng.uniform(*distance)])
        poses.append(Pose(turn.rotation, there - turn @ np.array(middle)))
    return poses


def photographed(rig, target, poses, sigma=0.0, seed=0, direct=None):
    """What a rig (and the camera `direct` without the optic) sees of a target at some poses."""
    parts = []
    for photo, pose in enumerate(poses):
        points = pose @ target.points
        seen = [(k, view.project(points)) for k, view in enumerate(rig)]
        seen += (
            []
            if direct is None
            else [(DIRECT, np.where(direct.contains(p := direct.project(points))[:, None], p, np.nan))]
        )
        for view, pixels in seen:
            point = np.flatnonzero(np.isfinite(pixels[:, 0]))
            parts.append((np.full(len(point), photo), np.full(len(point), view), point, pixels[point]))
    photo, view, point, pixels = (np.concatenate(part) for part in zip(*parts, strict=True))
    noise = sigma * np.random.default_rng(seed).normal(size=pixels.shape)
    return Observations(photo, view, point, pixels + noise, tuple(map(str, range(len(poses)))), sigma or 0.05)


@pytest.fixture(scope="module")
def mirrors():
    """A rig over mirrors, for which virtual cameras are exact, and noise-free photographs of a board."""
    rig = MIRRORS.rig()
    poses = poses_of(14, (450, 800))
    return rig, poses, photographed(rig, BOARD, poses)


# Over mirrors: the truth is found


def assert_same_rig(found, rig, depth, atol):
    """The found rig sees points where the true one does, px."""
    for view, true in zip(found, rig, strict=True):
        rows, columns = np.nonzero(true.region.mask)
        pixels = np.stack([columns, rows], -1)[::499]
        points = true.rays(pixels).at(np.full(len(pixels), depth))
        np.testing.assert_allclose(view.unbounded().project(points), pixels, rtol=0, atol=atol)


@pytest.mark.parametrize("intrinsics", ["free", "tied", "fixed"])
@pytest.mark.parametrize("target", [BOARD, SOLID], ids=["board", "solid"])
def test_over_mirrors_the_rig_is_found(mirrors, intrinsics, target):
    rig, poses, seen = mirrors
    seen = seen if target is BOARD else photographed(rig, target, poses)
    result = calibrate_virtual(seen, target, BENT, rig, intrinsics, 0)
    assert result.converged
    assert result.frame == "nominal"
    assert np.nanmax(np.abs(result.residuals)) < 1e-5  # px: the solver's end
    assert [view.mirrored for view in result.rig] == FLIPPED
    for pose, true in zip(result.poses, poses, strict=True):
        # mm; aligned to the same rig, so that the frame is the true one
        np.testing.assert_allclose(pose @ target.points, true @ target.points, rtol=0, atol=1e-4)
    assert_same_rig(result.rig, rig, 600.0, 1e-4)
    for camera in result.cameras:
        np.testing.assert_allclose(camera.camera.lens, BENT.lens, rtol=1e-5, atol=1e-5)
        assert np.linalg.det(camera.camera_from_rig.rotation) == pytest.approx(1, abs=1e-12)


def test_distortion_is_found_from_a_straight_start(mirrors):
    rig, _, seen = mirrors
    start = Camera(BENT.size, 880.0)
    result = calibrate_virtual(seen, BOARD, start, rig, "free", 5)
    assert result.converged
    assert np.nanmax(np.abs(result.residuals)) < 1e-3  # px: the prior on k3 alone is left, and it is weak
    assert_same_rig(result.rig, rig, 600.0, 0.05)


def test_each_view_alone_and_pairs_find_the_same_rig_over_mirrors(mirrors):
    rig, _, seen = mirrors
    result = calibrate_pairwise(seen, BOARD, BENT, rig, 5)
    # px; OpenCV takes pixels in float32 (3e-5 px) and stops early
    assert np.nanmax(np.abs(result.residuals)) < 0.02
    assert_same_rig(result.rig, rig, 600.0, 0.1)
    assert result.covariance.shape == (0, 0)


def test_photographs_without_the_optic_tie_the_frame(mirrors):
    rig, poses, _ = mirrors
    poses = [*poses_of(10, (500, 800), spread=15.0), *poses_of(2, (500, 800), 5)]
    seen = photographed(rig, BOARD, poses, direct=BENT)
    alone = (seen.photo >= 10) & (seen.view >= 0)
    result = calibrate_virtual(seen.select(~alone), BOARD, BENT, rig.masks, "free", 0, FLIPPED)
    assert result.frame == "real camera"
    assert "no use" in result.notes[0]
    assert result.poses[10] is result.poses[11] is None
    assert_same_rig(result.rig, rig, 600.0, 1e-4)  # no alignment: masks say nothing about the frame


def test_masks_alone_leave_the_frame_of_view_0(mirrors):
    rig, _, seen = mirrors
    result = calibrate_virtual(seen, BOARD, BENT, list(rig.masks), "fixed", 0, FLIPPED)
    assert result.frame == "view 0"
    np.testing.assert_array_equal(result.cameras[0].centre, 0)
    moved = result.moved(aligned(result.rig, rig))
    assert_same_rig(moved.rig, rig, 600.0, 1e-4)
    for pose, again in zip(result.poses, moved.moved(aligned(moved.rig, result.rig)).poses, strict=True):
        np.testing.assert_allclose(again @ BOARD.points, pose @ BOARD.points, rtol=0, atol=1e-6)


def test_stated_covariance_matches_the_spread():
    rig = MIRRORS.rig()
    poses = poses_of(10, (450, 800))
    runs = [
        calibrate_virtual(photographed(rig, BOARD, poses, 0.1, seed), BOARD, BENT, rig, "free", 0, loss="none")
        for seed in range(20)
    ]
    names = runs[0].parameter_names
    truth = {
        f"{view.name}.{part}": value for view in rig for part, value in zip(("focal_x", "centre_x"), (900.0, 318.0))
    }
    scores = []
    for run in runs:
        values = {
            f"{v.name}.{part}": x for v in run.rig for part, x in zip(("focal_x", "centre_x"), v.camera.lens[[0, 2]])
        }
        spread = dict(zip(names, np.sqrt(np.diag(run.covariance)), strict=True))
        scores += [(values[name] - truth[name]) / spread[name] for name in truth]
        assert 0.9 < run.sigma0 < 1.1  # about 1000 residuals: 2 %
    # 120 scores, in each run correlated: their rms is 1 to within about a quarter
    assert 0.75 < np.sqrt(np.mean(np.square(scores))) < 1.3


def test_outliers_do_little_harm(mirrors):
    rig, _, _ = mirrors
    poses = poses_of(10, (450, 800))
    seen = photographed(rig, BOARD, poses, 0.05)
    wrong = np.random.default_rng(4).random(len(seen)) < 0.03
    pixels = seen.pixels + wrong[:, None] * np.random.default_rng(5).normal(0, 20, (len(seen), 2))
    spoilt = Observations(seen.photo, seen.view, seen.point, pixels, seen.photos, seen.sigma)
    clean, result = (calibrate_virtual(o, BOARD, BENT, rig, "free", 0) for o in (seen, spoilt))
    assert np.sqrt(np.mean(result.residuals[~wrong] ** 2)) < 1.2 * np.sqrt(np.mean(clean.residuals**2))


# Through glass


def test_intrinsics_are_whose_they_are_said_to_be():
    setup = small_setup()
    rig = setup.rig()
    seen = photographed(rig, BOARD, poses_of(12, (450, 800), spread=60.0), 0.05)
    free, tied, fixed = (
        calibrate_virtual(seen, BOARD, setup.camera, rig, kind, 2) for kind in ("free", "tied", "fixed")
    )
    assert all(tuple(v.camera.lens[:4]) == tuple(tied.rig[0].camera.lens[:4]) for v in tied.rig)
    assert tied.rig[0].camera.focal != setup.camera.focal
    assert all(tuple(v.camera.lens[:4]) == tuple(setup.camera.lens[:4]) for v in fixed.rig)
    assert len({v.camera.focal for v in free.rig}) == 3
    assert len({v.camera.distortion for v in fixed.rig}) == 3
    assert all(v.camera.distortion[2:] == (0, 0, 0) for v in fixed.rig)
    assert "rig.focal_x" in tied.parameter_names
    assert sum("turn" in name for name in fixed.parameter_names) == 6  # of views 1 and 2: three each
    assert (free.rms <= fixed.rms * 1.05).all()


@pytest.mark.parametrize(("name", "limit"), [("t2_b40", 0.5), ("t3_b40", 0.5), ("t4_b45", 0.85)])
def test_depth_of_rendered_corners(name, limit, mitsuba):
    """Calibrated from corners with 0.046 px of noise, in percent of depth, planes 600 to 1600 mm.

    A pinhole cannot do better through glass: the best fit to the true rays errs by 0.6 to 0.8 %.
    """
    setup = renderer_setup(name)
    rig = setup.rig()
    seen, points, board = rendered(mitsuba / f"calib_{name}", 0)
    result = calibrate_virtual(seen, board, setup.camera, rig.masks, "free", 4)
    assert result.converged
    pixels, truth = together(seen, points, len(rig))
    motion = rigid_motion(triangulate(result.rig.unbounded(), pixels).points, truth)
    pixels, truth = together(*rendered(mitsuba / f"targets_{name}", 1)[:2], len(rig))
    found = motion @ triangulate(result.rig.unbounded(), pixels).points
    error = 100 * (found[:, 2] / truth[:, 2] - 1)
    assert np.sqrt(np.nanmean(error**2)) < limit


def rendered(folder, seed):
    """Observations with noise, the true point (N, 3) of each, and the board."""
    facts = json.loads((folder / "views.json").read_text())["board"]
    x, y = np.meshgrid(np.arange(1, facts["squares_x"]), np.arange(1, facts["squares_y"]))
    board = Known(np.stack([x, y, 0 * x], -1).reshape(-1, 3) * float(facts["square"]))
    with np.load(folder / "corners.npz") as c:
        pixels = c["uv"] + 0.046 * np.random.default_rng(seed).normal(size=c["uv"].shape)
        names = tuple(map(str, range(c["view"].max() + 1)))
        return Observations(c["view"], c["facet"], c["corner_id"], pixels, names, 0.046), c["xyz_cam"], board


def together(seen, points, views):
    """Pixels (P, V, 2) and points (P, 3) of the corners that two views see."""
    keys, row = np.unique(seen.photo * 10_000 + seen.point, return_inverse=True)
    pixels, truth = np.full((len(keys), views, 2), np.nan), np.empty((len(keys), 3))
    pixels[row, seen.view], truth[row] = seen.pixels, points
    two = np.isfinite(pixels[..., 0]).sum(-1) >= 2
    return pixels[two], truth[two]


# Parts


@pytest.mark.parametrize("by", ["centres", "scene"])
def test_alignment_undoes_a_rigid_motion(by):
    rig = small_setup().rig()
    cameras = pinhole_rig([fit(view, (500, 1000)) for view in rig], rig)
    motion = Pose.from_rotation_vector([0.2, -0.1, 0.3], [12.0, -30.0, 5.0])
    elsewhere = Rig(tuple(type(v)(v.camera, v.camera_from_rig @ motion.inverse, v.region) for v in cameras))
    found = aligned(elsewhere, cameras, by, (500, 1000)) @ motion
    # 1e-7 rad, 1e-4 mm: triangulation's end
    np.testing.assert_allclose(found.rotation, np.eye(3), rtol=0, atol=1e-7)
    np.testing.assert_allclose(found.translation, 0, atol=1e-4)


def test_derivatives_of_the_model_are_those_of_differences():
    rng = np.random.default_rng(2)
    poses = [Pose.from_rotation_vector(*rng.normal(size=(2, 3)) * [[0.2], [20]]) for _ in range(3)]
    eyes = [Eye(DIRECT, "real camera", BENT, Pose(np.eye(3), np.zeros(3)), False)]
    eyes += [Eye(k, f"view {k}", BENT, pose, k == 1) for k, pose in enumerate(poses)]
    view = np.repeat([DIRECT, 0, 1, 2], 5)
    points = rng.uniform([-80, -80, 500], [80, 80, 900], (20, 3))
    for intrinsics in ("free", "tied", "fixed"):
        model = RigModel.of(eyes, view, intrinsics, 5)
        _, to_shared, to_point = model.predict(model.start, points, True)
        assert to_shared.shape == (20, 2, len(model.names))
        # central differences, steps of 1e-5 of each scale
        for k in range(len(model.names)):
            step = np.zeros(len(model.names))
            step[k] = 1e-5 * max(1.0, abs(model.start[k]))
            a, b = (model.predict(model.start + sign * step, points, False)[0] for sign in (1, -1))
            np.testing.assert_allclose(to_shared[..., k], (a - b) / (2 * step[k]), rtol=1e-5, atol=1e-4)
        for k, axis in enumerate(np.eye(3)):
            a, b = (model.predict(model.start, points + sign * 1e-3 * axis, False)[0] for sign in (1, -1))
            np.testing.assert_allclose(to_point[..., k], (a - b) / 2e-3, rtol=1e-6, atol=1e-6)


def test_wrong_calls_say_so(mirrors):
    rig, _, seen = mirrors
    with pytest.raises(SetupError, match="'free', 'tied' or 'fixed'"):
        calibrate_virtual(seen, BOARD, BENT, rig, "shared")
    with pytest.raises(SetupError, match="0, 2, 4 or 5"):
        calibrate_virtual(seen, BOARD, BENT, rig, distortion=3)
    with pytest.raises(ShapeError, match="views up to 2"):
        calibrate_virtual(seen, BOARD, BENT, rig.masks[:2])
    with pytest.raises(ShapeError, match="masks must have shape"):
        calibrate_virtual(seen, BOARD, BENT, rig.masks[:, :-1])
    with pytest.raises(ShapeError, match="the target has 5"):
        calibrate_virtual(seen, Known(BOARD.points[:5]), BENT, rig)
    with pytest.raises(ShapeError, match="mirrored"):
        calibrate_virtual(seen, BOARD, BENT, rig, mirrored=[True])
    apart = seen.select(np.where(seen.photo < 7, seen.view == 0, seen.view > 0))
    with pytest.raises(SetupError, match="several views"):
        calibrate_virtual(apart, BOARD, BENT, rig)
    with pytest.raises(SetupError, match=r"facet|mirror|view"):
        calibrate_pairwise(apart, BOARD, BENT, rig)
    with pytest.raises(SetupError, match="'centres' or by 'scene'"):
        aligned(rig, rig, "hand")
    with pytest.raises(SetupError, match="between which depths"):
        aligned(rig, rig, "scene")
    with pytest.raises(SetupError, match="as many nominal ones"):
        aligned(rig, rig[:2])


def test_a_single_mirror_is_calibrated_alone():
    setup = Setup(STRAIGHT, Mirrors((Mirror((0, 0, 90), (1, 0.1, -1)),)))
    rig = setup.rig()
    assert len(rig) == 1
    back = fit(rig[0], (300, 700)).camera_from_rig.inverse
    poses = [back @ pose for pose in poses_of(8, (400, 700))]
    result = calibrate_virtual(photographed(rig, BOARD, poses), BOARD, STRAIGHT, rig, "free", 0)
    assert result.converged
    np.testing.assert_allclose(result.cameras[0].camera.focal, STRAIGHT.focal, rtol=1e-6)
