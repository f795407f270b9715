"""Rigs of views: round trips, regions, blend bands, and why there is no ray or no pixel."""

import numpy as np
import pytest
from scipy.optimize import root
from setups import DISTORTION, OPTICS, SETUPS, STRAIGHT, random_pixels, trace_slowly

from cyclopean import Camera, Mirror, Mirrors, Plate, Prism, Reason, Rig, Setup
from cyclopean.errors import OpticError, SetupError, ShapeError
from cyclopean.geometry import Rays, clip_by_half_plane, polygon_area
from cyclopean.rigs import Region, View

KINDS = list(SETUPS)


@pytest.fixture
def rng():
    return np.random.default_rng(5)


def miss(rays, points):
    """Distance (mm) of points from their rays, NaN where there is no ray, and how far along the rays they lie."""
    arm = points - rays.origins
    along = np.sum(arm * rays.directions, -1)
    return np.linalg.norm(arm - along[..., None] * rays.directions, axis=-1), along


# Round trips


@pytest.mark.parametrize("facing", ["scene", "camera"])
@pytest.mark.parametrize("facets", range(2, 9))
def test_pixels_come_back_through_prisms_of_every_kind(facets, facing, rng):
    for apex_deg in (2, 5, 10, 15, 20):
        for tilt_deg in ((0, 0, 0), rng.uniform(-5, 5, 3)):
            lens = DISTORTION if rng.random() < 0.5 else (0,) * 5
            camera = Camera((640, 480), 900, distortion=lens)
            prism = Prism(
                facets, apex_deg, 1.5168, 60, 12, facing=facing, azimuth_deg=11, tilt_deg=tilt_deg, shift=(0.7, -0.4)
            )
            for view in Setup(camera, prism).rig():
                pixels = rng.uniform(-0.5, [639.5, 479.5], (150, 2))
                rays = view.rays(pixels)
                seen = np.isfinite(rays.directions).all(-1)
                for distance in (0.5, 50.0, 1000.0, 1e5):
                    back = view.project(rays.at(np.full(150, distance)))
                    # 1e-9 px: 1e5 mm are rounded to 1e-11 mm; Newton ends below that
                    np.testing.assert_allclose(back[seen], pixels[seen], rtol=0, atol=1e-9)
                    assert np.isnan(back[~seen]).all()


@pytest.mark.parametrize("name", KINDS)
def test_every_pixel_belongs_to_a_ray_through_the_point(name, rng):
    for view in SETUPS[name].rig():
        points = rng.uniform([-150, -120, -50], [150, 120, 400], (1500, 3))
        pixels = view.project(points)
        seen = np.isfinite(pixels).all(-1)
        assert seen.any()
        assert not seen.all()
        distance, along = miss(view.rays(pixels[seen]), points[seen])
        # 1e-10 mm: roundings of 100 mm, which grow where rays leave the glass at a flat angle; NaN would fail too
        np.testing.assert_allclose(distance, 0, atol=1e-10)
        assert (along >= 0).all()
        assert view.camera.contains(pixels[seen]).all()


@pytest.mark.parametrize("name", KINDS)
def test_projection_agrees_with_a_slow_search(name):
    setup = SETUPS[name]
    view = setup.rig()[0]
    pixels = random_pixels(setup, 40)
    rays = view.rays(pixels)
    seen = np.flatnonzero(np.isfinite(rays.directions[:, 0]))[:3]
    for pixel, point in zip(pixels[seen], rays[seen].at(np.full(len(seen), 300.0)), strict=True):

        def sideways(guess, point=point):
            ray = trace_slowly(view.path.unbounded(), view.camera.rays(guess))
            return (point - ray.origins - (point - ray.origins) @ ray.directions * ray.directions)[:2]

        solution = root(sideways, pixel + np.array([4, -3]), tol=1e-12)
        # 1e-7 px: where the search stops, with derivatives by differences
        np.testing.assert_allclose(view.project(point), solution.x, rtol=0, atol=1e-7)


@pytest.mark.parametrize("name", [name for name in KINDS if "straight" in name])
def test_rays_agree_with_the_slow_tracer(name):
    setup = SETUPS[name]
    pixels = random_pixels(setup, 300)
    for view in setup.rig():
        if not view.path.blockers:
            slow, fast = trace_slowly(view.path, setup.camera.rays(pixels)), view.rays(pixels)
            # 2e-13: some roundings of 100 mm
            np.testing.assert_allclose(fast.origins, slow.origins, rtol=0, atol=2e-13)
            np.testing.assert_allclose(fast.directions, slow.directions, rtol=0, atol=2e-15)


def test_without_bounds_a_view_is_smooth_across_its_seams():
    view = SETUPS["prism, straight lens"].rig()[0]
    column = np.linspace(0, 639, 641)
    pixels = np.stack([column, np.full_like(column, 200.0)], -1)
    bounded, endless = view.rays(pixels), view.unbounded().rays(pixels)
    inside = np.isfinite(bounded.directions).all(-1)
    assert inside.any()
    assert not inside.all()
    np.testing.assert_array_equal(endless.directions[inside], bounded.directions[inside])
    bend = np.diff(endless.directions, 2, axis=0)
    assert np.abs(bend).max() < 1e-5  # rad a px squared; a facet more or less would turn rays by 0.1
    far = endless.at(np.full(641, 500.0))
    # 1e-10 px: roundings
    np.testing.assert_allclose(view.unbounded().project(far), pixels, rtol=0, atol=1e-10)
    outside_image = view.unbounded().rays([[-500.0, 200]]).at([500.0])
    assert np.isnan(view.project(outside_image)).all()
    np.testing.assert_allclose(view.unbounded().project(outside_image), [[-500, 200]], rtol=0, atol=1e-10)


# Why there is no ray, or no pixel

BESIDE = Mirror((0, 0, 100), (1, 0, -1), (60, 40))
WALL = Mirror((30, 0, 100), (-1, 0, 0))
ROUND = Setup(STRAIGHT, Prism(2, 10, 1.5168, 60, radius=20))
WIDE = Setup(STRAIGHT, Prism(2, 10, 1.5168, 60))
UNDER_WATER = Setup(STRAIGHT, Plate(1.5, 50, 10, tilt_deg=(60, 0, 0), surroundings="water", beyond="air"))
BOTH = Setup(STRAIGHT, Mirrors((BESIDE,), direct=True))
PIXEL_REASONS = [
    (Reason.SEEN, ROUND, 0, (400, 240)),
    (Reason.NOT_A_NUMBER, ROUND, 0, (np.nan, 240)),
    (Reason.MISSED, Setup(STRAIGHT, Mirrors((WALL,))), 0, (100, 240)),
    (Reason.OUTSIDE_OUTLINE, ROUND, 0, (639, 240)),
    (Reason.OUTSIDE_OUTLINE, BOTH, 0, (2, 2)),
    (Reason.WRONG_FACET, ROUND, 0, (200, 240)),
    (Reason.TOTAL_REFLECTION, UNDER_WATER, 0, (320, 470)),
    (Reason.BLOCKED, BOTH, 1, (320, 240)),
    (Reason.SEEN, BOTH, 1, (2, 2)),
]
POINT_REASONS = [
    (Reason.SEEN, ROUND, 0, (0, 0, 300)),
    (Reason.NOT_A_NUMBER, ROUND, 0, (0, np.nan, 300)),
    (Reason.OUTSIDE_OUTLINE, ROUND, 0, (60, 0, 200)),
    (Reason.WRONG_FACET, ROUND, 0, (-60, 0, 300)),
    (Reason.BLOCKED, BOTH, 1, (0, 0, 300)),
    (Reason.BLOCKED, BOTH, 1, (0, 0, 50)),  # before the mirror: its pixel belongs to the mirror
    (Reason.OUTSIDE_IMAGE, WIDE, 0, (0, 120, 300)),
    (Reason.BEHIND, ROUND, 0, (0, 0, 30)),
    (Reason.BEHIND, ROUND, 0, (2, 0, 65)),  # in the glass
    (Reason.BEHIND, ROUND, 0, (0, 0, -300)),
    (Reason.BEHIND, BOTH, 0, (-100, 0, 100)),  # at the back of the mirror
    (Reason.BEHIND, BOTH, 1, (0, 0, -10)),
    (Reason.NO_SOLUTION, ROUND, 0, (800, 0, 40)),  # in front of the facet's plane, but beside the prism
    (Reason.NO_SOLUTION, BOTH, 0, (-150, 0, -80)),  # its mirror image stands behind the camera
]


@pytest.mark.parametrize(("reason", "setup", "view", "pixel"), PIXEL_REASONS)
def test_pixels_without_a_ray_say_why(reason, setup, view, pixel):
    view = setup.rig()[view]
    assert Reason(int(view.explain_pixels(pixel))) is reason
    assert np.isfinite(view.rays(pixel).directions).all() == (reason == Reason.SEEN)
    assert np.isfinite(view.rays(pixel).origins).all() == (reason == Reason.SEEN)


@pytest.mark.parametrize(("reason", "setup", "view", "point"), POINT_REASONS)
def test_points_without_a_pixel_say_why(reason, setup, view, point):
    view = setup.rig()[view]
    assert Reason(int(view.explain_points(point))) is reason
    assert np.isfinite(view.project(point)).all() == (reason == Reason.SEEN)


def test_every_reason_happens_and_has_words():
    assert {row[0] for row in PIXEL_REASONS + POINT_REASONS} == set(Reason)
    assert len({reason.text for reason in Reason}) == len(Reason)


@pytest.mark.parametrize("name", KINDS)
def test_explanations_agree_with_rays_and_pixels(name, rng):
    for view in SETUPS[name].rig():
        pixels = rng.uniform([-80, -80], [720, 560], (400, 2))
        rays = view.rays(pixels)
        np.testing.assert_array_equal(view.explain_pixels(pixels) == 0, np.isfinite(rays.directions).all(-1))
        points = rng.uniform([-150, -120, -50], [150, 120, 400], (400, 3))
        np.testing.assert_array_equal(view.explain_points(points) == 0, np.isfinite(view.project(points)).all(-1))


@pytest.mark.parametrize("shape", [(), (3,), (2, 0), (3, 1, 2)])
@pytest.mark.parametrize("name", ["prism, bent lens", "two mirrors, straight lens", "plate, straight lens"])
def test_any_shape_will_do(name, shape, rng):
    for view in SETUPS[name].rig():
        pixels = rng.uniform(0, [639, 479], (*shape, 2))
        rays = view.rays(pixels)
        points = rays.at(np.full(shape, 100.0))
        assert rays.origins.shape == rays.directions.shape == (*shape, 3)
        assert view.project(points).shape == (*shape, 2)
        assert view.explain_pixels(pixels).shape == view.explain_points(points).shape == shape
        assert view.region.contains(pixels).shape == shape
        optic = len(SETUPS[name].optic.parameter_names)
        by_pixel, by_point = view.ray_derivatives(pixels), view.pixel_derivatives(points)
        shapes = [by_pixel.to_pixel.shape, by_pixel.to_camera.shape, by_pixel.to_optic.shape]
        assert shapes == [(*shape, 6, 2), (*shape, 6, 9), (*shape, 6, optic)]
        shapes = [by_point.to_point.shape, by_point.to_camera.shape, by_point.to_optic.shape]
        assert shapes == [(*shape, 2, 3), (*shape, 2, 9), (*shape, 2, optic)]


def test_arrays_of_the_wrong_shape_are_named():
    rig = ROUND.rig()
    with pytest.raises(ShapeError, match=r"pixels must have shape \(..., 2\), got \(2, 9\); did you mean pixels.T\?"):
        rig[0].rays(np.zeros((2, 9)))
    with pytest.raises(ShapeError, match=r"points must have shape \(..., 3\), got \(3, 9\); did you mean points.T\?"):
        rig.project(np.zeros((3, 9)))
    with pytest.raises(ShapeError, match=r"points must have shape \(..., 3\), got \(5, 2\)$"):
        rig[0].pixel_derivatives(np.zeros((5, 2)))


# Regions


def test_margins_are_distances_from_the_seam_between_pixels():
    # the seam lies at x = 50.5: pixel 51 is 0.5 px away from it
    for margin, first in ((0.0, 51), (0.5, 51), (0.6, 52), (1.5, 52), (1.6, 53), (9.5, 60)):
        view = Setup(Camera((102, 81), 200), Prism(2, 10, 1.5168, 60)).rig(margin)[0]
        assert view.region.box == (first, 0, 102 - first, 81)  # the border of the image is no seam
        assert view.region.mask.sum() == (102 - first) * 81
        assert view.region.with_margin(20.5).box == (71, 0, 31, 81)


@pytest.mark.parametrize("facets", [2, 3, 5])
def test_outlines_are_the_sectors_between_the_seams(facets):
    # seams of a prism on the axis are straight lines from the principal point, half way between the facets
    azimuth_deg = 20.0
    rig = Setup(STRAIGHT, Prism(facets, 10, 1.5168, 60, azimuth_deg=azimuth_deg)).rig()
    centre, image = np.array(STRAIGHT.centre), np.array([[-0.5, -0.5], [639.5, -0.5], [639.5, 479.5], [-0.5, 479.5]])
    for k, view in enumerate(rig):
        middle = np.radians(azimuth_deg + 360 * k / facets)
        sector = image
        for side in (-1, 1):
            seam = middle + side * np.pi / facets
            normal = side * np.array([-np.sin(seam), np.cos(seam)])
            sector = clip_by_half_plane(sector, normal, normal @ centre)
        (outline,) = view.region.outline
        # 2 px^2: what the outline cuts off at the corners
        assert polygon_area(outline) == pytest.approx(polygon_area(sector), abs=2)
        assert view.region.traced.sum() == pytest.approx(polygon_area(sector), rel=0.005)  # pixels on seams
        np.testing.assert_allclose(outline.min(0), sector.min(0), atol=0.75)  # a corner cut off is 0.5 px
        np.testing.assert_allclose(outline.max(0), sector.max(0), atol=0.75)


@pytest.mark.parametrize("name", [name for name in KINDS if "prism" in name])
def test_no_pixel_belongs_to_two_facets(name):
    rig = SETUPS[name].rig()
    # but for pixels on the very seam: 1e-12 mm, roundings
    inside = np.sum([view.region.clearance > 1e-12 for view in rig], axis=0)
    assert inside.max() == 1
    assert (rig.facets[inside > 0] >= 0).all()
    assert rig.masks.sum(0).max() == 1
    for k, view in enumerate(rig):
        assert (rig.facets[view.region.mask] == k).all()


def test_regions_tell_which_pixels_they_hold():
    region = Region(np.pad(np.ones((4, 6), bool), ((2, 3), (1, 2))), 0.0)
    inside, outside = [[1, 2], [6.49, 5.49], [0.51, 1.51]], [[0.49, 2], [6.51, 2], [3, 5.51], [np.nan, 3], [-9, 99]]
    assert region.contains(inside).all()
    assert not region.contains(outside).any()
    assert region.box == (1, 2, 6, 4)
    np.testing.assert_array_equal(region.centre, [3.5, 3.5])
    assert Region(np.zeros((5, 5), bool), 1.5).box == (0, 0, 0, 0)


# Rigs and setups


def test_a_rig_is_a_sequence_of_views():
    rig = SETUPS["prism, straight lens"].rig()
    assert len(rig) == len(list(rig)) == 3
    assert isinstance(rig[1:], Rig)
    assert rig[1:][0] is rig[1]
    points = rig[0].rays([[320, 300.0], [330, 250]]).at([200.0, 300])
    np.testing.assert_array_equal(rig.project(points)[:, 2], rig[2].project(points))
    with pytest.raises(OpticError, match="at least one view"):
        Rig(())


def test_working_depths_are_where_two_views_see_well():
    rig = Setup(Camera((1280, 960), 2400), Prism(2, 10, 1.5168, 60)).rig()
    near, far = rig.working_depths
    baseline = 2 * (60 + 10) * np.tan(np.arcsin(1.5168 * np.sin(np.radians(10))) - np.radians(10))
    # a pixel of disparity is worth Z^2 / (f baseline); 6 %: the ladder's step of 2.4 %, and where the centres stand
    assert far == pytest.approx(0.1 * 2400 * baseline, rel=0.06)

    def shared(depth):
        grid = np.stack(np.meshgrid(np.arange(645, 1280, 10.0), np.arange(5, 960, 10.0)), -1)
        return np.isfinite(rig[1].project(rig[0].rays(grid).at_depth(depth))[..., 0]).mean()

    assert shared(0.9 * near) < 0.2 < shared(1.1 * near)


def test_views_that_never_overlap_have_no_working_depths():
    apart = Mirrors((Mirror((-20, 0, 60), (1, 0, -0.2), (40, 60)), Mirror((20, 0, 60), (-1, 0, -0.2), (40, 60))))
    outward = Mirrors((Mirror((-9, 0, 60), (-1, 0, -1), (18, 60)), Mirror((9, 0, 60), (1, 0, -1), (18, 60))))
    assert Setup(STRAIGHT, apart).rig().working_depths[0] > 0
    with pytest.raises(OpticError, match="no depth is seen well by two views"):
        _ = Setup(STRAIGHT, outward).rig().working_depths


@pytest.mark.parametrize("facing", ["scene", "camera"])
@pytest.mark.parametrize(("f_number", "focus", "distance"), [(8, 600, 150), (16, 300, 50)])
def test_the_blend_band_is_where_the_pupil_sees_both_facets(facing, f_number, focus, distance):
    pitch, image = 0.0055, 25.0  # mm, image distance: what calibration calls the focal length
    camera = Camera((1280, 960), image / pitch, pixel_pitch=pitch)
    setup = Setup(camera, Prism(2, 6.4, 1.5168, distance, facing=facing), f_number=f_number, focus_distance=focus)
    path = setup.optic.paths(setup.wavelength_nm)[0]
    focal = 1 / (1 / image + 1 / focus)  # of the thin lens
    pixels = np.stack([np.arange(-300, 300, 0.05) + camera.centre[0], np.full(12000, camera.centre[1])], -1)
    sharp = camera.rays(pixels).at_depth(focus)  # where each pixel is in focus, without the prism
    through = []
    for x in np.linspace(-0.5, 0.5, 9) * focal / f_number:  # across the pupil
        arm = sharp - [x, 0, 0]
        rays = Rays(np.array([x, 0, 0]), arm / np.linalg.norm(arm, axis=-1, keepdims=True))
        through.append(np.isfinite(path.trace(rays).directions[:, 0]))
    both = np.any(through, 0) & ~np.all(through, 0)
    # 0.1 px: twice the distance of the pixels tried; 1e-3: the lens looks at the seam slantwise through the glass
    assert setup.blend_band(path) == pytest.approx(0.05 * both.sum(), abs=0.1, rel=1e-3)
    rig = setup.rig()
    assert rig[0].margin == pytest.approx(1.5 + setup.blend_band(path) / 2)
    assert setup.rig(margin=3)[0].margin == 3


def test_a_pinhole_blends_nothing():
    setup = Setup(STRAIGHT, OPTICS["prism"])
    assert setup.blend_band(setup.optic.paths(587.6)[0]) == 0
    assert setup.rig()[0].margin == 1.5


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"wavelength_nm": np.nan}, "positive number of nm, got nan"),
        ({"wavelength_nm": -5}, "positive number of nm, got -5"),
        ({"depths": (500, 400)}, r"0 < near < far in mm, got \(500, 400\)"),
        ({"depths": (np.nan, 400)}, r"0 < near < far in mm, got \(nan, 400\)"),
        ({"f_number": 0}, "f_number must be a positive number, got 0"),
        ({"f_number": 8.0}, "f_number 8 needs a focus_distance"),
        ({"focus_distance": np.nan}, "focus_distance must be a positive number, got nan"),
    ],
)
def test_setups_that_cannot_be_say_what_came(changes, message):
    with pytest.raises(SetupError, match=message):
        Setup(STRAIGHT, OPTICS["prism"], **changes)


def test_a_blend_band_needs_the_size_of_a_pixel():
    with pytest.raises(SetupError, match="need the camera's pixel_pitch"):
        Setup(STRAIGHT, OPTICS["prism"], f_number=8, focus_distance=500).rig()


@pytest.mark.parametrize("side", [4.0, 1.0])
def test_a_small_mirror_makes_a_small_view(side):
    view = Setup(STRAIGHT, Mirrors((Mirror((0, 0, 100), (1, 0, -1), (side, side)),))).rig()[0]
    pixels = np.argwhere(view.region.traced)[:, ::-1].astype(float)
    # the mirror, seen at 45 degrees: side / sqrt(2) by side at 100 mm; half the border pixels either way
    width, height = 9 * side / np.sqrt(2), 9 * side
    assert len(pixels) == pytest.approx(width * height, abs=width + height)
    back = view.project(view.rays(pixels).at(np.full(len(pixels), 300.0)))
    np.testing.assert_allclose(back, pixels, rtol=0, atol=1e-10)  # roundings


def test_mirrors_hide_what_is_behind_them():
    camera = Camera((640, 480), 700)
    wedge = Mirrors((Mirror((0, 0, 300), (1, 0, -1)), Mirror((0, 0, 300), (-1, 0, -1))))
    periscope = Mirrors(
        (Mirror((0, 0, 100), (1, 0, -1), (60, 80)), Mirror((120, 0, 100), (-1, 0, 1.1), (120, 160))),
        sequences=((0,), (0, 1)),
        direct=True,
    )
    half = Setup(camera, wedge).rig(margin=0)
    np.testing.assert_array_equal(half.facets[:, :320], 0)  # endless mirrors that meet: the nearer one is seen
    np.testing.assert_array_equal(half.facets[:, 320:], 1)
    rig = Setup(camera, Mirrors(periscope.mirrors, ((0, 1),), direct=True)).rig(margin=0)
    both = rig[0].region.traced & rig[1].region.traced
    assert not both.any()
    assert rig.facets[240, 320] == 0  # the first mirror stands in the middle
    # a first mirror by itself keeps only the rays that the second one lets pass
    alone = View(camera, periscope.paths(587.6)[0], margin=0.0)
    inside = np.argwhere(rig[0].region.traced)[::97, ::-1]
    assert set(np.unique(alone.explain_pixels(inside))) == {Reason.BLOCKED}
