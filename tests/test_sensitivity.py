"""Triangulated points answer to what the setup is wrong about as brute force and closed forms say."""

from dataclasses import replace

import numpy as np
import pytest
from setups import SETUPS

from cyclopean import Camera, Plate, Prism, Setup, triangulate
from cyclopean.analysis.sensitivity import point_sensitivity
from cyclopean.calibration.depths import Volume, depth_slopes, working_volume
from cyclopean.errors import SetupError
from cyclopean.triangulation.sensitivity import point_response

CAMERA = Camera((2048, 1536), 25 / 0.0055)  # 25 mm before pixels of 5.5 um
BIPRISM = Setup(CAMERA, Prism(2, 6.4, 1.5168, distance=370, thickness=10))
DEPTHS = np.array([600.0, 1000.0, 1500.0])
ON_AXIS = np.stack([np.zeros(3), np.zeros(3), DEPTHS], -1)


def values_of(setup):
    return np.concatenate([setup.camera.lens, setup.optic.parameters(setup.wavelength_nm)])


def changed(setup, values):
    return replace(setup, camera=setup.camera.with_lens(values[:9]), optic=setup.optic.with_parameters(values[9:]))


def found(believed, real, points, seen=None):
    """Points that the believed setup finds in the pixels of the real one."""
    pixels = real.rig().unbounded().project(points)
    if seen is not None:
        pixels = np.where(seen[..., None], pixels, np.nan)
    return triangulate(believed.rig().unbounded(), pixels).points


def step_of(name):
    """A step that moves pixels by some tenths, so that neither rounding nor the fifth derivative matters."""
    kind = name.split(".")[1]
    if kind.startswith(("focal", "centre")):
        return 1.0
    return 1e-2 if kind.startswith(("shift", "distance", "thickness")) or kind.endswith("advance") else 1e-4


@pytest.mark.parametrize(
    "name",
    ["prism, bent lens", "prism, facets to camera, bent lens", "biprism in water, bent lens", "two mirrors, bent lens"],
)
def test_sensitivity_is_that_of_brute_force(name):
    setup = SETUPS[name]
    near, far = setup.rig().working_depths
    volume = working_volume(setup.rig(), [1.2 * near, np.sqrt(near * far)], 4)
    points, seen = volume.points[volume.common], volume.seen[volume.common]
    sensitivity = point_sensitivity(setup, points, seen=seen)
    assert sensitivity.names == setup.parameter_names
    start = values_of(setup)
    for column, parameter in enumerate(setup.parameter_names):
        step = np.eye(len(start))[column] * step_of(parameter)

        def at(times, step=step):
            return found(setup, changed(setup, start + times * step), points, seen)

        slope = (8 * (at(1) - at(-1)) - (at(2) - at(-2))) / (12 * step_of(parameter))  # fourth order
        matrix = sensitivity.matrix[..., column]
        np.testing.assert_allclose(matrix, slope, atol=1e-6 * max(np.abs(slope).max(), 1e-3))


def test_sensitivity_of_a_thin_biprism_follows_the_closed_forms():
    """Depths from where the camera appears, z = Z - T (1 - 1/n), and A = z / a - 1 with the apex at a = d + T / n.

    A point on the axis is seen at psi = delta (1 - a / z), delta = (n - 1) alpha. With T = 0 the forms are the usual
    dZ/Z = A dn / (n - 1), A dalpha / alpha, A df / f, -da / a, for a real setup that exceeds the believed one.
    """
    distance, thickness, index, apex = 200.0, 4.0, 1.5, 0.5
    setup = Setup(CAMERA, Prism(2, apex, index, distance=distance, thickness=thickness))
    appears = distance + thickness / index
    z = DEPTHS - thickness * (1 - 1 / index)
    amplified = z / appears - 1
    focal = CAMERA.focal[0]
    sensitivity = point_sensitivity(setup, ON_AXIS)
    closed = [
        ({"optic.index": 1e-3}, 1e-3 * amplified * (z / (index - 1) + thickness / index**2)),
        ({"optic.apex": 1e-4}, 1e-4 / np.deg2rad(apex) * amplified * z),
        ({"camera.focal_x": 1e-3 * focal, "camera.focal_y": 1e-3 * focal}, 1e-3 * amplified * z),
        ({"optic.distance": 1.0}, -z / appears),
    ]
    for changes, expected in closed:
        # the next terms are of second order in the angle, (0.5 deg)^2 = 8e-5
        np.testing.assert_allclose(sensitivity.shift(changes)[:, 2], expected, rtol=3e-4)
    # disparity: ds = lambda f dz / z^2 with the baseline lambda = 2 delta a; noise of two views in the difference
    baseline = 2 * (index - 1) * np.deg2rad(apex) * appears
    np.testing.assert_allclose(sensitivity.noise(1.0)[:, 2], np.sqrt(2) * z**2 / (baseline * focal), rtol=3e-4)
    common = sensitivity.shift({"camera.centre_x": 1.0})[:, 2]  # a common shift cancels in the disparity
    assert np.abs(common).max() < 1e-6 * sensitivity.noise(1.0)[:, 2].min()


def test_sensitivity_of_the_published_biprism():
    """dn 0.001, 1 arcmin, f 0.1 %, distance 1 mm, each raised in the believed setup: percent of depth."""
    focal = CAMERA.focal[0]
    printed = {
        "optic.index": (1e-3, (-0.113, -0.315, -0.560)),
        "optic.apex": (np.deg2rad(1 / 60), (-0.153, -0.426, -0.757)),
        "camera.focal": (1e-3 * focal, (-0.059, -0.163, -0.288)),
        "optic.distance": (1.0, (0.264, 0.264, 0.264)),
    }
    start = values_of(BIPRISM)
    for name, (size, percent) in printed.items():
        step = np.array([size if full.startswith(name) else 0.0 for full in BIPRISM.parameter_names])
        moved = found(changed(BIPRISM, start + step), BIPRISM, ON_AXIS)[:, 2]
        # printed for triangulation by pairs of principal rays; its own first-order figures are 2 % apart at the far end
        np.testing.assert_allclose(100 * (moved / DEPTHS - 1), percent, rtol=0.035)
        believed = -point_sensitivity(BIPRISM, ON_AXIS).matrix[:, 2] @ step  # believed exceeds real: the other sign
        np.testing.assert_allclose(believed, moved - DEPTHS, rtol=0.02)  # second order: 0.8 % of depth, doubled


def test_noise_is_that_of_sampled_pixels():
    setup = SETUPS["prism, bent lens"]
    volume = working_volume(setup.rig(), [300.0], 3)
    point, seen = volume.points[volume.common][0], volume.seen[volume.common][0]
    rng = np.random.default_rng(5)
    pixels = setup.rig().unbounded().project(point) + rng.normal(0, 0.1, (4000, 3, 2))
    sampled = triangulate(setup.rig().unbounded(), np.where(seen[:, None], pixels, np.nan)).points.std(0)
    expected = point_sensitivity(setup, point, seen=seen).noise(0.1)
    np.testing.assert_allclose(sampled, expected, rtol=0.05)  # of 4000 samples: 1.1 % is one sigma


def test_one_piece_of_truth_for_calibrations_and_budgets():
    """Calibrations raise the believed parameter, so their slopes have the other sign."""
    points = ON_AXIS[:, None, None]
    spread, slopes = depth_slopes(BIPRISM, Volume(DEPTHS, points, np.ones((3, 1, 1, 2), dtype=bool)))
    sensitivity = point_sensitivity(BIPRISM, ON_AXIS)
    np.testing.assert_array_equal(slopes[:, 0, 0], -sensitivity.depth)
    np.testing.assert_allclose(spread[:, 0, 0], sensitivity.noise(1.0)[:, 2], rtol=1e-12)


def test_points_that_one_view_sees_have_no_depth():
    one_view = np.array([[True, False], [True, True], [False, False]])
    sensitivity = point_sensitivity(BIPRISM, ON_AXIS, seen=one_view)
    np.testing.assert_array_equal(np.isnan(sensitivity.depth[:, 0]), [True, False, True])
    aside = point_sensitivity(BIPRISM, [5000.0, 0.0, 1000.0])  # far outside the picture
    assert np.isnan(aside.matrix).all()


def test_views_along_one_line_tell_no_depth():
    view = BIPRISM.rig()[0]
    assert np.isnan(point_response([view, view], ON_AXIS[1]).gain).all()


def test_wrong_calls_say_what_was_wanted():
    flat = Setup(CAMERA, Plate("N-BK7", 50, 10))
    with pytest.raises(SetupError, match="two views or more, and this plate gives 1"):
        point_sensitivity(flat, ON_AXIS)
    with pytest.raises(SetupError, match=r"no parameter 'optic.colour'"):
        point_sensitivity(BIPRISM, ON_AXIS).shift({"optic.colour": 1.0})
