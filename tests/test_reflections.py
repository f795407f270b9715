"""Start values for mirrors: exact without noise, honest with noise, the answers of others on real photographs."""

from dataclasses import replace

import numpy as np
import pytest

from benchmarks import mirrors_data as data
from cyclopean import Camera, Mirror, Mirrors, Setup
from cyclopean.calibration.physical import calibrate
from cyclopean.calibration.reflected_board import board_from_reflections
from cyclopean.calibration.reflections import mirror_from_poses, mirrors_from_observations, reflected_points
from cyclopean.errors import OpticError, SetupError, ShapeError
from cyclopean.geometry import Pose
from cyclopean.targets import DIRECT, Observations

FLIP = np.diag([-1.0, 1.0, 1.0])
BOARD = data.lcm_board()
SOLID = data.KnownPoints(np.vstack([BOARD.points, BOARD.points[::5] + np.array([3.0, -2.0, -15.0])]))
PLAIN = Camera((1600, 1000), 750)
BENT = Camera((1600, 1000), (750, 755), (790.0, 510.0), (-0.1, 0.05, 1e-3, -5e-4, 0.0))
# Two mirrors that meet behind the board, which is seen directly, over each and over both.
CORNER = Mirrors(
    (
        Mirror((-81, 0, 398), (0.75, 0.3, -0.6), (240, 300), tilt_deg=(1.5, -2.0), advance=0.7),
        Mirror((92, 0, 408), (-0.65, 0.35, -0.65), (240, 300), tilt_deg=(-1.0, 0.5), advance=-0.4),
    ),
    ((0,), (0, 1)),
    direct=True,
)
PATHS = ((0,), (0, 1), ())  # the second mirror is only seen behind the first
WIDE = Camera((1600, 1200), (2440, 2445), (810, 640))
# Boards and mirrors: rotation vector (rad) and translation (mm) of a board beside the camera that faces forward, and
# mirrors before the camera, leaning some degrees either way.
BESIDE = Pose.from_rotation_vector([0.2, -0.3, 0.1], [-150.0, -30.0, 200.0])
LEANS_DEG = ((9, 3), (15, -6), (11, 7), (7, -3), (17, 4))  # of the normal, sideways and up
DISTANCE = 500.0  # mm, of the mirrors


def random_poses(count, depth, seed=3):
    rng = np.random.default_rng(seed)
    return [
        Pose.from_rotation_vector(rng.uniform(-0.5, 0.5, 3), rng.uniform([25, -45, depth - 15], [55, -15, depth + 15]))
        for _ in range(count)
    ]


def image_of(pose, normal, offset):
    """Pose of the un-flipped picture in a mirror."""
    turn = np.eye(3) - 2 * np.outer(normal, normal)
    # points q of a target that is itself flipped in z look alike, so that both factors make a rotation
    return Pose(FLIP @ turn @ pose.rotation, FLIP @ reflected_points(pose.translation, normal, offset))


def through_mirrors(setup, target, poses, view_of=lambda view: view, noise=0.0, seed=1):
    """What the views of a setup, taken as endless, show of the target."""
    parts = []
    for photo, pose in enumerate(poses):
        for number, view in enumerate(setup.rig()):
            pixels = view.unbounded().project(pose @ target.points)
            seen = np.flatnonzero(np.isfinite(pixels).all(-1))  # the other mirror cuts one corner here and there
            assert len(seen) > 0.9 * len(pixels)
            parts.append((np.full(len(seen), photo), np.full(len(seen), view_of(number)), seen, pixels[seen]))
    photo, view, point, pixels = (np.concatenate(part) for part in zip(*parts, strict=True))
    pixels = pixels + np.random.default_rng(seed).normal(0, noise, pixels.shape) if noise else pixels
    names = tuple(f"photo{k}" for k in range(len(poses)))
    return Observations(photo, view, point, pixels, names, sigma=np.full(len(pixels), noise or 0.05))


def planes_of(mirrors: Mirrors):
    """Rows normal, offset (M, 4), the normal away from the camera."""
    surfaces = [mirror.interface(1.0) for mirror in mirrors.mirrors]
    return np.array([np.append(s.normal, s.offset) * np.sign(s.offset) for s in surfaces])


def leaning(angles_deg):
    """Normals (B, 3) that lean sideways and up by angles (B, 2)."""
    across, up = np.deg2rad(angles_deg).T
    return np.stack([np.sin(across) * np.cos(up), np.sin(up), np.cos(across) * np.cos(up)], -1)


def mirrored_photographs(target, camera, normals, offsets, noise=0.0, seed=1, pose=BESIDE):
    """Photographs of a board that only mirrors show."""
    pixels = np.stack([camera.project(reflected_points(pose @ target.points, *p)) for p in zip(normals, offsets)])
    assert camera.contains(pixels).all()
    pixels = pixels + np.random.default_rng(seed).normal(0, noise, pixels.shape) if noise else pixels
    photos, points = pixels.shape[:2]
    return Observations(
        np.repeat(np.arange(photos), points), np.zeros(photos * points), np.tile(np.arange(points), photos),
        pixels.reshape(-1, 2), tuple(f"photo{k}" for k in range(photos)), np.full(photos * points, noise or 0.05),
    )  # fmt: skip


@pytest.mark.parametrize("count", [1, 5])
@pytest.mark.parametrize("points", [None, BOARD.points])
def test_a_mirror_follows_from_poses(count, points):
    rng = np.random.default_rng(4)
    for _ in range(5):
        normal = rng.normal(size=3)
        normal /= np.linalg.norm(normal)
        offset = rng.uniform(50, 500)
        poses = random_poses(count, 400, seed=6)
        found, distance = mirror_from_poses(poses, [image_of(pose, normal, offset) for pose in poses], points)
        # 1e-9: of lengths near 1000 mm, some hundred roundings
        np.testing.assert_allclose(np.append(found, distance), np.append(normal, offset), atol=1e-9)


def test_poses_that_are_no_mirror_images_are_refused():
    pose = random_poses(1, 400)[0]
    image = image_of(pose, np.array([0.6, 0.0, 0.8]), 360.0)
    other_end = Pose(image.rotation @ np.diag([-1.0, -1.0, 1.0]), image.translation)
    with pytest.raises(OpticError, match="same part of the photograph used twice"):
        mirror_from_poses(pose, pose)
    with pytest.raises(OpticError, match="was the reflected picture un-flipped"):
        mirror_from_poses(pose, other_end)
    with pytest.raises(ShapeError, match="got 2 and 1"):
        mirror_from_poses([pose, pose], [pose])


@pytest.mark.parametrize("camera", [PLAIN, BENT])
@pytest.mark.parametrize("target", [BOARD, SOLID], ids=["plane", "solid"])
@pytest.mark.parametrize("direct", [2, DIRECT])
def test_mirrors_follow_from_observations(camera, target, direct):
    poses = random_poses(4, 300)
    seen = through_mirrors(Setup(camera, CORNER), target, poses, (0, 1, direct).__getitem__)
    found, same = mirrors_from_observations(seen, target, camera, PATHS if direct == 2 else PATHS[:2])
    assert same is camera
    assert (found.sequences, found.direct) == (PATHS[:2], direct == 2)
    # pixels are exact to 1e-9, which lever arms of 600 mm turn into 1e-6 mm
    np.testing.assert_allclose(planes_of(found), planes_of(CORNER), atol=1e-5)


def test_a_camera_of_unknown_focal_length_is_found_with_the_mirrors():
    seen = through_mirrors(Setup(PLAIN, CORNER), BOARD, random_poses(6, 300))
    found, camera = mirrors_from_observations(seen, BOARD, PLAIN.size, PATHS)
    np.testing.assert_allclose(camera.focal, PLAIN.focal, rtol=1e-6)  # no noise: only the solver's last step
    np.testing.assert_allclose(planes_of(found), planes_of(CORNER), atol=1e-3)


def test_calibration_starts_from_the_mirrors_found():
    truth = Setup(BENT, CORNER)
    seen = through_mirrors(truth, BOARD, random_poses(8, 300), noise=0.05)
    start, camera = mirrors_from_observations(seen, BOARD, BENT.size, PATHS)
    found = calibrate(seen, BOARD, Setup(camera, start), ("camera", "camera.k3", "optic.mirrors"), loss="none")
    assert found.solution.converged
    rows = 2 * len(seen)
    # the fit explains all but noise of 0.05 px; its scale is known to 1 / sqrt(2 rows): five of these
    assert found.solution.sigma0 == pytest.approx(1.0, abs=5 / np.sqrt(2 * rows))
    tilt = max(sigma for name, sigma in found.sigma.items() if "_tilt_" in name)  # rad
    np.testing.assert_allclose(planes_of(found.setup.optic)[:, :3], planes_of(CORNER)[:, :3], atol=4 * tilt)
    assert tilt < np.deg2rad(0.2)


def test_paths_must_be_those_of_the_views():
    seen = through_mirrors(Setup(PLAIN, CORNER), BOARD, random_poses(2, 300))
    for paths, fault in [
        (((0,), (), (0, 1)), "direct view comes last"),
        (((0,), (0, 2), ()), "number the mirrors 0, 1"),
        (((0,), (0, 1)), "paths describe 2 views"),
        (((), (), ()), "must number the mirrors"),
    ]:
        with pytest.raises(SetupError, match=fault):
            mirrors_from_observations(seen, BOARD, PLAIN, paths)
    with pytest.raises(SetupError, match="do not tell where mirror 0, 1 stands"):
        mirrors_from_observations(seen.select(seen.view != 2), BOARD, PLAIN, PATHS)
    turned = replace(seen, point=np.where(seen.view == 1, len(BOARD.points) - 1 - seen.point, seen.point))
    with pytest.raises(OpticError, match="numbered alike"):
        mirrors_from_observations(turned, BOARD, PLAIN, PATHS)


@pytest.mark.parametrize("target", [BOARD, SOLID], ids=["plane", "solid"])
@pytest.mark.parametrize("count", [3, 5])
def test_a_board_is_found_from_its_reflections(target, count):
    normals, offsets = leaning(LEANS_DEG[:count]), DISTANCE + 20 * np.arange(count)
    found = board_from_reflections(mirrored_photographs(target, WIDE, normals, offsets), target, WIDE)
    # the linear solution is exact already, but for OpenCV's pose from rounded pixels; px
    assert np.abs(found.start_residuals).max() < 1e-3
    assert found.converged
    assert found.rms < 1e-7
    np.testing.assert_allclose(found.pose.rotation, BESIDE.rotation, atol=1e-7)
    np.testing.assert_allclose(found.pose.translation, BESIDE.translation, atol=1e-5)
    np.testing.assert_allclose(found.planes, np.column_stack([normals, offsets]), atol=1e-5)


def test_the_covariance_of_a_reflected_board_is_that_of_its_errors():
    normals, offsets = leaning(LEANS_DEG), DISTANCE + 20 * np.arange(5)
    centres = 2 * offsets[:, None] * normals
    distances, scales = [], []
    for seed in range(20):
        seen = mirrored_photographs(BOARD, WIDE, normals, offsets, noise=0.1, seed=seed)
        found = board_from_reflections(seen, BOARD, WIDE)
        turn = found.pose.rotation @ BESIDE.rotation.T
        error = np.concatenate([
            0.5 * np.array([turn[2, 1] - turn[1, 2], turn[0, 2] - turn[2, 0], turn[1, 0] - turn[0, 1]]),
            found.pose.translation - BESIDE.translation,
            (2 * found.planes[:, 3:] * found.planes[:, :3] - centres).ravel(),
        ])  # fmt: skip
        distances.append(error @ np.linalg.solve(found.covariance, error))
        scales.append(found.sigma0)
    freedom, rows = len(error), 2 * len(seen)
    # the squared errors in units of their covariance follow chi-squared; the mean of 20 within four deviations
    assert np.mean(distances) == pytest.approx(freedom, abs=4 * np.sqrt(2 * freedom / 20))
    assert np.mean(scales) == pytest.approx(1.0, abs=4 / np.sqrt(2 * rows * 20))


@pytest.mark.parametrize(
    ("leans_deg", "offsets"),
    [([(11, 5)] * 4, (450, 480, 500, 520)), ([(5, 0), (9, 0), (14, 0)], (500, 510, 520))],
    ids=["parallel", "turned about one axis"],
)
def test_mirrors_that_tell_nothing_are_named(leans_deg, offsets):
    seen = mirrored_photographs(BOARD, WIDE, leaning(leans_deg), offsets)
    with pytest.raises(SetupError, match="turn the mirror both sideways and up and down"):
        board_from_reflections(seen, BOARD, WIDE)


def test_too_few_photographs_are_refused():
    seen = mirrored_photographs(BOARD, WIDE, leaning(LEANS_DEG), np.full(5, DISTANCE))
    with pytest.raises(SetupError, match=r"needs three photographs.*got 2"):
        board_from_reflections(seen.of_photos([0, 1]), BOARD, WIDE)
    with pytest.raises(SetupError, match="too few points in photo3"):
        board_from_reflections(seen.select((seen.photo != 3) | (seen.point < 3)), BOARD, WIDE)
    with pytest.raises(SetupError, match="lie on a line"):
        board_from_reflections(seen.select(seen.point < 7), BOARD, WIDE)


def test_rows_that_make_no_sense_are_refused():
    seen = mirrored_photographs(BOARD, WIDE, leaning(LEANS_DEG), np.full(5, DISTANCE))
    with pytest.raises(ShapeError, match="numbered 0 to 41 on this target, but observations name 1 to 42"):
        board_from_reflections(replace(seen, point=seen.point + 1), BOARD, WIDE)
    blank = replace(seen, pixels=np.where(seen.point[:, None] == 3, np.nan, seen.pixels))
    with pytest.raises(ShapeError, match="5 observed pixels are not numbers"):
        board_from_reflections(blank, BOARD, WIDE)
    with pytest.raises(ShapeError, match="5 observed pixels are not numbers"):
        mirrors_from_observations(blank, BOARD, WIDE, ((0,), ()))


def test_the_published_answer_for_a_monitor_in_a_mirror(real):
    target, seen, camera = data.pycalib_chess()
    for photos, published_px, published_mm in [
        (range(5), 0.6401348975, (340.55, 11.66, 354.54)),
        (range(3), 0.6888, (344.84, 15.98, 334.99)),
    ]:
        found = board_from_reflections(seen.of_photos(photos), target, camera)
        assert found.converged
        # the mean distance, as its authors count it: the same minimum up to their solver's last step
        mean = np.linalg.norm(found.residuals, axis=-1).mean()
        assert mean == pytest.approx(published_px, abs=5e-5)
        np.testing.assert_allclose(found.pose.translation, published_mm, atol=0.01)  # printed to 0.01 mm


@pytest.fixture(scope="module")
def two_mirrors(real):
    return data.lcm_observations()


def calibrated(seen, target, size, paths, **options):
    start, camera = mirrors_from_observations(seen, target, size, paths)
    free = ("camera.focal", "camera.centre", "camera.radial", "optic.mirrors")
    return calibrate(seen, target, Setup(camera, start), free, loss="none", **options)


def test_a_phone_and_two_mirrors_calibrate_together(two_mirrors):
    target, seen, _, size = two_mirrors
    assert len(seen) == 17 * 42  # three views in six photographs, but the right mirror of Image6 is too slanted
    seen = data.with_direct(seen)
    found = calibrated(seen, target, size, data.LCM_PATHS[:3])
    assert found.solution.converged
    assert found.rms < 0.35  # 0.31 px here; others reached 0.65 px
    left, right = planes_of(found.setup.optic)[:, :3]
    # others measured 89.96 deg with all photographs, which the joint fit does not know
    assert np.degrees(np.arccos(left @ right)) == pytest.approx(89.96, abs=0.1)
    camera, planes = found.setup.camera, [(p[:3], p[3]) for p in planes_of(found.setup.optic)]
    twice = {k: data.twice_reflected(target.points, pose, planes, camera) for k, pose in enumerate(found.poses)}
    more = data.with_twice_reflected(seen, twice)
    extra = more.view == data.TWICE
    assert np.count_nonzero(extra) > 100
    predicted = np.array([twice[k][p] for k, p in zip(more.photo[extra], more.point[extra])])
    # a view that took no part in the fit; the glass before the silver, which the model leaves out, moves it
    assert np.sqrt(np.mean((more.pixels[extra] - predicted) ** 2)) < 1.5
    assert calibrated(more, target, size, data.LCM_PATHS[:3]).rms < 0.65


def test_a_board_moved_by_one_square_stands_out(two_mirrors):
    target, seen, _, size = two_mirrors
    seen = data.with_direct(seen)
    slipped = (seen.photo == 2) & (seen.view == data.LEFT)  # as the detector has it there
    keep = ~slipped | (seen.point % 7 < 6)
    moved = replace(seen, point=np.where(slipped, seen.point + 1, seen.point)).select(keep)
    right, wrong = (calibrated(s, target, size, data.LCM_PATHS[:2]) for s in (seen, moved))
    assert right.rms < 0.35
    # one square is 30 px or more there; even spread over all views of the photograph much of it remains
    assert np.sqrt(np.mean(wrong.residuals[wrong.observations.photo == 2] ** 2)) > 10 * right.rms
