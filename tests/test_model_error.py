"""Errors of virtual cameras: exact pinholes have none, and those of a biprism are known from elsewhere."""

import numpy as np
import pytest
from setups import SETUPS

from cyclopean import Camera, Prism, Setup
from cyclopean.analysis.model_error import model_error
from cyclopean.errors import CyclopeanError
from cyclopean.plotting.model_error import model_error_picture

CAMERA = Camera((2048, 1536), 25 / 0.0055, pixel_pitch=0.0055)
MIRRORS = SETUPS["two mirrors, straight lens"]


def biprism(apex_deg, distance):
    return Setup(CAMERA, Prism(2, apex_deg, 1.5168, distance, 10.0))


@pytest.mark.parametrize(
    ("apex_deg", "distance", "rows"),
    [  # depth, error in the middle %, largest over the field %, largest difference of raw rows px, mm per px
        (6.4, 370.0, [(600, 0.50, 1.65, 0.06, 1.8), (1000, 0.18, 3.43, 1.0, 5.1), (1500, -0.65, 5.38, 1.9, 11.5)]),
        (6.4, 150.0, [(300, 0.46, 2.25, 0.3, 1.1), (600, -0.56, 5.15, 1.8, 4.4), (1200, -3.3, 11.1, 2.9, 17.6)]),
        (10.0, 150.0, [(300, 0.68, 2.49, 0.7, 0.7), (600, -0.72, 5.15, 4.5, 2.8), (1200, -4.2, 11.4, 7.3, 11.3)]),
        (15.0, 100.0, [(300, 0.17, 3.82, 6.9, 0.7), (600, -2.7, 9.0, 13.8, 2.8)]),
    ],
)
def test_ray_sketch_of_a_biprism(apex_deg, distance, rows):
    depths, middle, largest, across, scale = np.array(rows).T
    found = model_error(biprism(apex_deg, distance), depths, "sketch")
    np.testing.assert_allclose(found.middle, middle, atol=0.05)  # half of the last digit that is stated
    # 3 %: theirs is computed on a field found otherwise, and with another way to triangulate
    np.testing.assert_allclose(found.range[:, 1], largest, rtol=0.03)
    np.testing.assert_allclose(found.largest_raw_row, across, rtol=0.03, atol=0.05)
    np.testing.assert_allclose(found.mm_per_px, scale, rtol=0.05, atol=0.05)


def test_on_the_axis_the_sketch_gives_the_crossing_of_two_rays():
    setup = biprism(10.0, 150.0)
    found = model_error(setup, [300.0, 600.0], "sketch")
    first, second = found.cameras
    for k, depth in enumerate((300.0, 600.0)):
        pixel = setup.rig()[0].unbounded().project([0.0, 0.0, depth])
        inwards = np.arctan2(abs(pixel[0] - CAMERA.centre[0]), first.camera.focal[0])
        lean = np.arctan2(np.hypot(*first.axis[:2]), first.axis[2])
        crossing = first.centre[2] + abs(first.centre[0] - second.centre[0]) / 2 / np.tan(lean - inwards)
        assert found.middle[k] == pytest.approx(100 * (crossing / depth - 1), abs=1e-4)  # the middle is found to 1 um


@pytest.mark.parametrize("method", ["sketch", "fit", "distortion"])
def test_plane_mirrors_make_true_pinholes(method):
    near, far = MIRRORS.rig().working_depths
    found = model_error(MIRRORS, np.geomspace(near, far, 3), method)
    # 1e-4 %: where the fit of the pinhole stops; a ray sketch is good to rounding
    assert np.nanmax(np.abs(found.percent)) < 1e-4
    assert np.nanmax(found.residual) < 1e-4
    assert np.nanmax(found.rows) < 1e-4  # what is rectified has equal rows; NaN nowhere that two views see
    np.testing.assert_array_equal(np.isnan(found.rows), np.isnan(found.residual))


def test_rows_of_a_rectified_pair_are_those_of_cameras_turned_by_hand():
    found = model_error(biprism(6.4, 370.0), [600.0, 1000.0], "fit")
    first, second = found.cameras  # their baseline runs along x already, and their axes lean to either side of z
    pixels = biprism(6.4, 370.0).rig().project(found.points)
    rows = []
    for k, camera in enumerate((first, second)):
        directions = camera.rays(pixels[..., k, :]).directions
        rows.append(np.mean(camera.camera.focal) * directions[..., 1] / directions[..., 2])
    np.testing.assert_allclose(found.rows, np.abs(rows[0] - rows[1]), atol=1e-4)  # px: where both fits stop


def test_a_weak_prism_is_nearly_a_pinhole():
    errors = [model_error(biprism(apex, 150.0), [400.0, 500.0], "fit") for apex in (2.0, 8.0)]
    departures = [error.cameras[0].departure_rms for error in errors]
    assert departures[0] < departures[1] / 3  # at least in proportion to the angle


def test_distortion_helps_inside_the_fitted_depths():
    setup, depths = biprism(10.0, 150.0), [300.0, 500.0, 600.0, 700.0, 1200.0]
    plain, bent = (model_error(setup, depths, method, fit_depths=(500.0, 700.0)) for method in ("fit", "distortion"))
    assert (bent.rms < plain.rms / 1.2).all()
    assert bent.rms[2] < bent.rms[1] < bent.rms[0]  # best in the middle of the depths, worst outside
    assert bent.rms[2] < bent.rms[3] < bent.rms[4]


def test_figures_are_those_of_the_points():
    found = model_error(biprism(6.4, 370.0), [600.0, 900.0], "sketch", samples=3)
    percent = 100 * found.error[..., 2] / found.points[..., 2]
    np.testing.assert_allclose(found.percent, percent)
    np.testing.assert_allclose(found.range, [[np.nanmin(p), np.nanmax(p)] for p in percent])
    np.testing.assert_allclose(found.rms, [np.sqrt(np.nanmean(p**2)) for p in percent])
    np.testing.assert_allclose(found.middle, percent[:, 1, 1])
    x = found.points[..., 0]  # the field of a biprism is as wide to both sides
    np.testing.assert_allclose(x[..., 0], -x[..., 2], rtol=1e-6)
    assert len(model_error_picture([found]).axes) == 6  # a curve, two maps, their scales of colours, an empty place


@pytest.mark.parametrize(
    ("words", "change"),
    [
        ("one of sketch, fit, distortion", {"method": "guess"}),
        ("odd number", {"samples": 4}),
        ("reach", {"reach": 1.5}),
        ("no two views", {"depths": [100.0]}),
        ("positive numbers", {"depths": [np.nan]}),
        ("near < far", {"method": "fit", "fit_depths": (900.0, 600.0)}),
        ("boundary", {"method": "sketch", "boundary": "rim"}),
        ("two views", {"setup": SETUPS["plate, straight lens"]}),
    ],
)
def test_wrong_calls_say_what_was_wanted(words, change):
    with pytest.raises(CyclopeanError, match=words):
        model_error(**({"setup": biprism(6.4, 370.0), "depths": [600.0, 900.0], "method": "sketch"} | change))
