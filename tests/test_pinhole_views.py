"""Views that are ordinary cameras do all that views through an optic do."""

import numpy as np
import pytest
from scenes import photograph_plane, small_setup
from setups import DISTORTION, SETUPS

from cyclopean import Camera, Rig, triangulate
from cyclopean.analysis import summarise
from cyclopean.errors import OpticError
from cyclopean.geometry import Pose, rotation_from_vector
from cyclopean.optics import Reason
from cyclopean.pipeline import reconstruct
from cyclopean.rigs import PinholeView, Region, fit, pinhole_rig
from cyclopean.triangulation import point_covariance

CAMERA = Camera((640, 480), (900, 905), (318.0, 243.0), DISTORTION)
LEFT = np.tile(np.arange(640) < 400, (480, 1))


@pytest.fixture(params=[False, True], ids=["as it is", "mirrored"])
def view(request):
    pose = Pose.from_rotation_vector([0.1, -0.15, 0.2], [20.0, -5.0, 3.0])
    return PinholeView(CAMERA, pose, Region(LEFT, 2.0), request.param, "left")


@pytest.mark.parametrize("shape", [(), (1,), (3, 1, 2)])
def test_rays_and_pixels_belong_together(view, shape):
    pixels = np.random.default_rng(5).uniform([0, 0], [399, 479], (*shape, 2))
    rays = view.rays(pixels)
    assert rays.shape == shape
    np.testing.assert_allclose(np.linalg.norm(rays.directions, axis=-1), 1, atol=1e-14)
    # 1e-9 px: roundings of 1000 px and 1000 mm, and the inversion of the distortion
    np.testing.assert_allclose(view.project(rays.at(np.full(shape, 700.0))), pixels, rtol=0, atol=1e-9)


def test_what_lies_outside_the_region_is_lost_and_explained(view):
    pixels = np.array([[100.0, 200.0], [399.4, 10.0], [399.6, 10.0], [500.0, 200.0], [-1.0, 5.0], [np.nan, 1.0]])
    lost = [False, False, True, True, True, True]
    np.testing.assert_array_equal(np.isnan(view.rays(pixels).directions).all(-1), lost)
    np.testing.assert_array_equal(np.isnan(view.rays(pixels).origins).all(-1), lost)
    reasons = [Reason.SEEN] * 2 + [Reason.WRONG_FACET] * 2 + [Reason.OUTSIDE_IMAGE, Reason.NOT_A_NUMBER]
    np.testing.assert_array_equal(view.explain_pixels(pixels), reasons)
    points = np.concatenate([view.unbounded().rays(pixels).at(np.full(6, 500.0)), [[0.0, 0.0, -500.0]]])
    np.testing.assert_array_equal(np.isnan(view.project(points)).all(-1), [*lost, True])
    np.testing.assert_array_equal(view.explain_points(points), [*reasons, Reason.BEHIND])
    assert np.isfinite(view.unbounded().project(points[:5])).all()
    assert (view.unbounded().explain_pixels(pixels[:5]) == Reason.SEEN).all()


def moved(view, step):
    """The view with its lens (9,) and pose (6,) changed a little."""
    pose = Pose(rotation_from_vector(step[9:12]), step[12:]) @ view.camera_from_rig
    camera = view.camera.with_lens(view.camera.lens + step[:9])
    return PinholeView(camera, pose, view.region, view.mirrored)


def test_derivatives_are_those_of_differences(view):
    rng = np.random.default_rng(3)
    pixels = rng.uniform([5, 5], [395, 475], (2, 20, 2))
    points = view.rays(pixels).at(rng.uniform(400, 900, (2, 20)))
    found, rays = view.pixel_derivatives(points), view.ray_derivatives(pixels)
    np.testing.assert_allclose(found.pixels, pixels, atol=1e-9)
    # central differences with a step h: an error of h^2 of the derivative's own scale, 1e-6 of it here
    for k, axis in enumerate(np.eye(3)):
        slope = (view.project(points + 1e-3 * axis) - view.project(points - 1e-3 * axis)) / 2e-3
        np.testing.assert_allclose(found.to_point[..., k], slope, rtol=1e-6, atol=1e-6)
    for k, axis in enumerate(np.eye(2)):
        both = [view.unbounded().rays(pixels + sign * 1e-3 * axis) for sign in (1, -1)]
        slope = (both[0].directions - both[1].directions) / 2e-3
        np.testing.assert_allclose(rays.to_pixel[..., 3:, k], slope, rtol=1e-6, atol=1e-10)
        np.testing.assert_array_equal(rays.to_pixel[..., :3, k], 0)
    to_all = np.concatenate([found.to_camera, found.to_optic], -1)
    rays_to_all = np.concatenate([rays.to_camera, rays.to_optic], -1)
    for k, axis in enumerate(np.eye(15)):
        step = 1e-5 if k >= 4 else 1e-3
        a, b = (moved(view, sign * step * axis).unbounded() for sign in (1, -1))
        slope = (a.project(points) - b.project(points)) / (2 * step)
        np.testing.assert_allclose(to_all[..., k], slope, rtol=1e-5, atol=1e-5)
        a, b = a.rays(pixels), b.rays(pixels)
        both = [np.concatenate([r.origins, r.directions], -1) for r in (a, b)]
        np.testing.assert_allclose(rays_to_all[..., k], (both[0] - both[1]) / (2 * step), rtol=1e-5, atol=1e-8)
    lost = view.pixel_derivatives(view.unbounded().rays([500.0, 100.0]).at(500.0))
    assert all(np.isnan(part).all() for part in (lost.pixels, lost.to_point, lost.to_camera, lost.to_optic))


def test_over_mirrors_a_pinhole_view_is_the_view():
    rig = SETUPS["two mirrors, straight lens"].rig()
    pinholes = pinhole_rig([fit(view, (200, 900)) for view in rig], rig)
    assert [v.mirrored for v in pinholes] == [v.mirrored for v in rig]
    np.testing.assert_array_equal(pinholes.masks, rig.masks)
    for pinhole, view in zip(pinholes, rig, strict=True):
        rows, columns = np.nonzero(view.region.mask)
        pixels = np.stack([columns, rows], -1)[::997]
        points = view.rays(pixels).at(np.full(len(pixels), 400.0))
        np.testing.assert_allclose(pinhole.project(points), pixels, rtol=0, atol=1e-6)  # px: the fit's end


@pytest.fixture(scope="module")
def pinholes():
    """A small prism setup's rig, and the rig of pinholes that fit it best."""
    rig = small_setup().rig()
    return rig, pinhole_rig([fit(view, (600, 1000)) for view in rig], rig)


def test_a_photograph_is_reconstructed_with_pinholes(pinholes):
    rig, virtual = pinholes
    photograph, truth = photograph_plane(rig, 800.0, slope=0.3)
    result = reconstruct(photograph, virtual, (600.0, 1000.0))
    error = np.abs(result.depth / truth - 1)[np.isfinite(result.depth)]
    assert error.size > 0.4 * photograph.size
    # 0.4 % as with true rays, and 0.2 % that pinholes miss by in the corners of sub-images
    assert np.median(error) < 0.006


def test_corners_are_triangulated_with_pinholes(pinholes):
    rig, virtual = pinholes
    points = np.stack(np.meshgrid([-30.0, 0.0, 30.0], [-30.0, 0.0, 30.0], [650.0, 800.0, 950.0]), -1).reshape(-1, 3)
    pixels = rig.project(points)
    seen = np.isfinite(pixels[..., 0]).sum(-1) >= 2
    found = triangulate(virtual, pixels[seen], sigma=0.1)
    departure = max(fit(view, (600, 1000)).departure_max for view in rig)
    # each view is at most `departure` px off; 12.3 mm between the centres, f = 600 px
    limit = 2 * departure * points[seen, 2] ** 2 / (12.0 * 600)
    assert (np.abs(found.points[:, 2] - points[seen, 2]) < limit).all()
    exact = triangulate(virtual, virtual.project(points[seen]))  # the triangulation itself: 1e-6 mm, Gauss-Newton's end
    np.testing.assert_allclose(exact.points[exact.views >= 2], points[seen][exact.views >= 2], atol=1e-6)


def test_a_rig_of_pinholes_is_described_like_any_other(pinholes):
    rig, virtual = pinholes
    theirs, ours = summarise(rig, (600, 1000)), summarise(virtual, (600, 1000))
    for a, b in zip(theirs.pairs, ours.pairs, strict=True):
        assert b.baseline == pytest.approx(a.baseline, rel=1e-3)  # the same fit to views that differ by its departure
    assert all(camera.departure_max < 1e-6 for camera in ours.cameras)  # px: a pinhole fits a pinhole
    for a, b in zip(theirs.fields, ours.fields, strict=True):
        assert (b.width, b.share_two, b.share_all) == pytest.approx((a.width, a.share_two, a.share_all), rel=0.02)
        assert (b.sigma_two, b.sigma_all) == pytest.approx((a.sigma_two, a.sigma_all), rel=0.05)
    points = rig[0].rays(np.stack(np.meshgrid(np.arange(100, 220, 10.0), np.arange(125, 200, 10.0)), -1)).at_depth(800)
    spread = point_covariance(virtual, points)[..., 2, 2] / point_covariance(rig, points)[..., 2, 2]
    assert np.nanmax(np.abs(spread - 1)) < 0.05  # a prism stretches the picture by up to 2 %, fitted in the mean
    # steps of the search are 2.4 %, and the two searches start elsewhere
    np.testing.assert_allclose(virtual.working_depths, rig.working_depths, rtol=0.06)


def test_wrong_calls_say_so(pinholes):
    rig, virtual = pinholes
    with pytest.raises(OpticError, match="640x480"):
        PinholeView(Camera((320, 240), 600), Pose(np.eye(3), np.zeros(3)), Region(LEFT, 0.0))
    with pytest.raises(OpticError, match="3 views"):
        pinhole_rig([], rig)
    assert len(Rig(virtual.views[:2])) == 2
