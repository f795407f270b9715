"""What `summarise` says about rigs whose numbers are known otherwise."""

import numpy as np
import pytest

from cyclopean import Camera, Mirror, Mirrors, Prism, Setup, summarise
from cyclopean.analysis import field_at
from cyclopean.errors import OpticError, SetupError


def test_biprism_baseline_and_angle_follow_the_closed_forms():
    setup = Setup(Camera((1280, 960), 2400), Prism(2, 6.4, 1.5168, distance=150.0, thickness=10.0))
    summary = summarise(setup.rig(), (400.0, 900.0))
    deviation = np.arcsin(1.5168 * np.sin(np.deg2rad(6.4))) - np.deg2rad(6.4)
    pair = summary.pairs[0]
    assert pair.angle == pytest.approx(2 * deviation, abs=1e-12)
    # the virtual centres lie within millimetres of the pinhole's depth, of 160 mm: 2 %
    assert pair.baseline == pytest.approx(2 * 160.0 * np.tan(deviation), rel=0.02)


def test_depth_resolution_is_that_of_two_cameras():
    setup = Setup(Camera((1280, 960), 2400), Prism(2, 6.4, 1.5168, distance=150.0, thickness=10.0))
    summary = summarise(setup.rig(), (400.0, 900.0), sigma_px=0.1)
    for field in summary.fields:
        # sigma of disparity is sqrt(2) times that of a pixel; Z^2 / (baseline f) each px; axes converge: 2 %
        expected = field.depth**2 / (summary.pairs[0].baseline * 2400) * 0.1 * np.sqrt(2)
        assert field.sigma_two == field.sigma_all == pytest.approx(expected, rel=0.03)


def test_more_views_resolve_depth_better():
    rig = Setup(Camera((1280, 960), 2400), Prism(4, 12, 1.5168, distance=60.0)).rig()
    field = field_at(rig, 700.0)
    assert 0.4 < field.sigma_all / field.sigma_two < 0.9  # between 1/2 and 1/sqrt(2) for like baselines


def test_mirror_cameras_are_exact_pinholes():
    mirrors = tuple(Mirror((side * 40.0, 0.0, 200.0), (-side, 0.0, -0.02), (300.0, 200.0)) for side in (-1, 1))
    rig = Setup(Camera((640, 480), 900), Mirrors(mirrors)).rig()
    summary = summarise(rig, (500.0, 1000.0))
    for mirror, camera in zip(mirrors, summary.cameras, strict=True):
        normal = np.array(mirror.normal) / np.linalg.norm(mirror.normal)
        reflected = 2 * (normal @ np.array(mirror.centre)) * normal  # the pinhole's mirror image
        np.testing.assert_allclose(camera.centre, reflected, atol=1e-4)
        assert camera.departure_max < 1e-4


def test_mirrors_along_the_optical_axis_are_described_too():
    mirrors = tuple(Mirror((side * 60.0, 0.0, 150.0), (-side, 0.0, 0.0), (300.0, 200.0)) for side in (-1, 1))
    summary = summarise(Setup(Camera((640, 480), 700), Mirrors(mirrors)).rig(), (400.0, 900.0))
    pair = summary.pairs[0]
    # the pinhole's mirror images; 1e-6: the solver's end
    assert (pair.baseline, pair.angle) == pytest.approx((240.0, 0.0), abs=1e-6)
    assert all(camera.departure_max < 1e-6 for camera in summary.cameras)


def test_nothing_is_shared_before_the_apex():
    rig = Setup(Camera((1280, 960), 2400), Prism(2, 10.0, 1.5168, distance=60.0)).rig()
    assert field_at(rig, 71.0).share_two < 0.05  # rays have only just left the facets
    assert field_at(rig, 900.0).share_two > 0.5


def test_views_that_never_overlap_are_an_error():
    mirrors = tuple(Mirror((side * 60.0, 0.0, 100.0), (-side, 0.0, -0.9), (100.0, 100.0)) for side in (-1, 1))
    rig = Setup(Camera((640, 480), 500), Mirrors(mirrors)).rig()
    with pytest.raises(OpticError, match="overlap"):
        _ = rig.working_depths


def test_depths_may_be_an_array():
    setup = Setup(Camera((640, 480), 1200), Prism(3, 12.0, 1.5168, 60.0), depths=np.array([400.0, 900.0]))
    assert setup.depths == (400.0, 900.0)
    rig = setup.rig()
    assert summarise(rig, np.array([400.0, 900.0])).depths == summarise(rig, (400.0, 900.0)).depths
    with pytest.raises(SetupError, match="near, far"):
        Setup(setup.camera, setup.optic, depths=(400.0, 600.0, 900.0))
