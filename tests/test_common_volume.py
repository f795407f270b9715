"""What k of n views see, as traced: against frusta in closed form, projected points, and laws of solids."""

from itertools import pairwise

import numpy as np
import pytest
from scenes import small_setup
from setups import SETUPS

from benchmarks.data import renderer_setup
from cyclopean import Camera, Mirror, Mirrors, Plate, Prism, Rig, Setup
from cyclopean.analysis import field_at
from cyclopean.analysis.common_volume import CommonField, CommonSection, common_volume
from cyclopean.analysis.field_of_view import FieldOfView
from cyclopean.analysis.sensor_use import LOST, sensor_use
from cyclopean.errors import CyclopeanError, OpticError, OutputError, SetupError, ShapeError
from cyclopean.files.meshes import write_mesh
from cyclopean.geometry import Pose
from cyclopean.rigs import PinholeView, Region, fit, pinhole_rig

CAMERA = Camera((200, 100), 400.0)
KINDS = (
    "prism, bent lens",
    "prism, facets to camera, bent lens",
    "biprism in water, straight lens",
    "two mirrors, bent lens",
    "plate, bent lens",
)


def row_of_pinholes(*places):
    """Cameras side by side along x at these places (mm), all looking along z; each sees 200 x 100 px at f = 400 px."""
    region = Region(np.ones((100, 200), dtype=bool), 0.0)
    views = (PinholeView(CAMERA, Pose(np.eye(3), np.array([-x, 0.0, 0.0])), region, name=f"at {x}") for x in places)
    return Rig(tuple(views))


def two_mirrors(turn=0.02):
    mirrors = tuple(Mirror((side * 40.0, 0.0, 200.0), (-side, 0.0, -turn), (300.0, 200.0)) for side in (-1, 1))
    return Setup(Camera((640, 480), 900), Mirrors(mirrors))


def inside_mesh(volume, points):
    """True (N,) where points lie in a closed mesh: a line along x crosses its surface an odd number of times."""
    corners = volume.vertices[volume.faces]
    inside = np.zeros(len(points), dtype=bool)
    for start in range(0, len(points), 100):
        some = points[start : start + 100]
        arms = corners[None, :, :, 1:] - some[:, None, None, 1:]  # (N, M, 3, 2)
        following = np.roll(arms, -1, axis=2)
        sides = arms[..., 0] * following[..., 1] - arms[..., 1] * following[..., 0]
        within = (sides > 0).all(-1) | (sides < 0).all(-1)
        weights = np.roll(sides, -1, axis=-1)  # of the corner across from each side
        with np.errstate(invalid="ignore", divide="ignore"):
            x = (weights * corners[..., 0]).sum(-1) / weights.sum(-1)
        inside[start : start + 100] = (within & (x > some[:, None, 0])).sum(-1) % 2 == 1
    return inside


def test_volume_of_two_parallel_pinholes_is_that_of_their_frusta():
    base, near, far = 30.0, 100.0, 500.0  # views are 0.5 z wide and 0.25 z high
    volumes = CommonField.of(row_of_pinholes(0.0, base)).volumes((near, far))

    def cubes(power):
        return (far**power - near**power) / power

    both = 0.125 * cubes(3) - 0.25 * base * cubes(2)
    # 1e-9: planes of a frustum are straight, so that sampling costs nothing
    assert volumes[1].volume == pytest.approx(both, rel=1e-9)
    assert volumes[0].volume == pytest.approx(2 * 0.125 * cubes(3) - both, rel=1e-9)


def test_k_of_n_counts_what_k_or_more_see():
    common = CommonField.of(row_of_pinholes(0.0, 30.0, 70.0))
    depth = 400.0  # rectangles 200 x 100 mm, moved by 30 and by 70 mm
    for section, width, area in zip(common.sections(depth), (270, 200, 130), (270, 200, 130), strict=True):
        assert section.area == pytest.approx(area * 100.0, rel=1e-6)  # 1e-6: clipping works on a grid
        assert (section.width, section.height) == pytest.approx((width, 100.0), rel=1e-6)
    # where the outer two have parted, two see what is common to either pair
    areas = [section.area for section in common.sections(100.0)]  # 50 x 25 mm
    assert areas == pytest.approx([120 * 25.0, 30 * 25.0, 0.0], abs=1e-3)
    assert common.limits(3) == pytest.approx((70 / 0.5, np.inf), rel=1e-6)
    assert common.limits(2) == pytest.approx((30 / 0.5, np.inf), rel=1e-6)


@pytest.mark.parametrize("name", KINDS)
def test_meshes_hold_the_points_that_so_many_views_see(name):
    setup = SETUPS[name]
    rig = setup.rig(0.0)
    common = CommonField.of(rig, 100)
    near, far = 1.2 * common.start, 6 * common.start
    volumes = common.volumes((near, far))
    rng = np.random.default_rng(5)
    wide = volumes[0].vertices
    points = rng.uniform(wide.min(0), wide.max(0), (1500, 3))
    counts = np.isfinite(rig.project(points)[..., 0]).sum(-1)
    for volume in volumes:
        seen = counts >= volume.views
        inside = inside_mesh(volume, points)
        assert (inside == seen).mean() >= 0.999
        for point in points[inside != seen]:  # the surface between sampled rays is within 0.1 % of the depth
            edge = common.sections(point[2])[volume.views - 1].clearance(point[None, :2])
            assert abs(edge) < 0.001 * point[2]
        share, size = seen.mean(), np.prod(np.ptp(wide, axis=0))
        spread = np.sqrt(share * (1 - share) / len(points)) * size
        assert abs(volume.volume - share * size) <= 4 * spread  # four standard deviations of the sample


@pytest.mark.parametrize("name", KINDS)
def test_meshes_are_closed_and_enclose_their_volume(name):
    common = CommonField.of(SETUPS[name].rig(), 100)
    depths = 1.2 * common.start, 6 * common.start
    for volume in common.volumes(depths):
        if not len(volume.faces):
            assert volume.volume == 0.0
            continue
        edges = np.concatenate([volume.faces[:, pair] for pair in ([0, 1], [1, 2], [2, 0])])
        assert len(np.unique(edges, axis=0)) == len(edges)
        np.testing.assert_array_equal(np.unique(edges, axis=0), np.unique(edges[:, ::-1], axis=0))
        corners = volume.vertices[volume.faces]
        enclosed = np.linalg.det(corners - corners.mean((0, 1))).sum() / 6  # Gauss; outward faces make it positive
        assert enclosed == pytest.approx(volume.volume, rel=1e-9)
        # sections are cut from the same rays, without any mesh; Simpson's rule, 1e-3 for kinks between its points
        steps = np.linspace(*depths, 41)
        weights = np.ones(41)
        weights[1:-1:2], weights[2:-1:2] = 4, 2
        areas = [common.sections(depth)[volume.views - 1].area for depth in steps]
        assert weights @ areas * (steps[1] - steps[0]) / 3 == pytest.approx(volume.volume, rel=2e-3)


@pytest.mark.parametrize("name", ["n2", "n3"])
def test_fields_hold_exactly_the_points_that_an_independent_renderer_shows(mitsuba, name):
    scene = np.load(mitsuba / "scenes" / f"{name}_bumpy.npz")  # a bumpy wall, that hides nothing of itself
    pick = np.random.default_rng(0).permutation(len(scene["match_xyz"]))[:150]
    points, shown = scene["match_xyz"][pick], np.isfinite(scene["match_uv"][pick]).all(-1)
    rig = renderer_setup(name).rig()
    for k in range(len(rig)):
        common = CommonField.of(rig[k : k + 1])
        inside = [common.sections(point[2])[0].clearance(point[None, :2])[0] > 0 for point in points]
        assert 0.2 < shown[:, k].mean() < 0.95
        np.testing.assert_array_equal(inside, shown[:, k])


def test_the_error_of_sampling_falls_with_its_square():
    rig = Setup(Camera((640, 480), 900), Prism(2, 12.0, 1.5168, 60.0)).rig()
    truth, *rough = (common_volume(rig, (100.0, 600.0), 1, samples).volume for samples in (1200, 60, 120, 240))
    misses = np.abs(np.array(rough) - truth)
    assert misses[0] < 6e-5 * truth
    for coarse, fine in pairwise(misses):
        assert 3 < coarse / fine < 5.5  # 4, and what the finest one still misses


@pytest.mark.parametrize("focal", [8000, 4000, 2400])
def test_limits_of_a_biprism_are_those_of_the_closed_form(focal):
    setup = Setup(Camera((640, 480), focal / 2), Prism(2, 10.0, 1.5168, 150.0, 12.0))
    field, common = FieldOfView.of(setup), CommonField.of(setup.rig())
    near, far = common.limits()
    assert near == pytest.approx(field.near, rel=1e-5)
    # above and below the plane of the closed form seams bow outwards, and see a little farther
    assert far == np.inf if np.isinf(field.far) else field.far * (1 - 1e-5) < far < 1.1 * field.far
    middle = field.near * 1.5
    low, high = common.sections(middle)[1].extent([1.0, 0.0])
    # 1e-4: the border is straight between two samples
    assert (low, high) == pytest.approx((-float(field.half_width(middle)), float(field.half_width(middle))), rel=1e-4)


def test_limits_of_views_that_never_meet_and_that_meet_only_near():
    assert np.isnan(CommonField.of(two_mirrors(turn=-0.4).rig()).limits()).all()
    near, far = CommonField.of(two_mirrors().rig()).limits(2)
    assert near < far < np.inf
    rig = two_mirrors().rig()
    common = CommonField.of(rig)
    assert common.sections(0.999 * far)[1].area > 0
    assert common.sections(1.001 * far)[1].area == 0.0
    assert common.limits(1) == (pytest.approx(common.start), np.inf)


def test_virtual_cameras_see_almost_the_same_volume():
    rig = small_setup().rig()
    depths = (500.0, 1200.0)
    stand_ins = pinhole_rig([fit(view, depths) for view in rig], rig)
    for views in (1, 2, 3):
        # the border of a pinhole view is that of whole pixels: 1 px of the 100 px of a sub-image, each side
        assert common_volume(stand_ins, depths, views, 60).volume == pytest.approx(
            common_volume(rig, depths, views, 60).volume, rel=0.02
        )


@pytest.mark.parametrize(
    ("corners", "centre", "radius"),
    [
        ([[0, 0], [4, 0], [4, 4], [0, 4]], (2, 2), 2),
        ([[0, 0], [3, 0], [0, 4]], (1, 1), 1),  # the incircle of the 3-4-5 triangle
        ([[0, 0], [9, 0], [9, 2], [2, 2], [2, 3], [0, 3]], None, 1.1715728752538097),  # an L; 3 - sqrt 2 r corner
    ],
)
def test_inscribed_circle(corners, centre, radius):
    section = CommonSection(1.0, 1, (np.array(corners, dtype=float),), 1.0)
    place, size = section.inscribed_circle
    if centre is None:  # it touches two walls and the inner corner: (2 - r)^2 + (2 - r)^2 = r^2
        radius = 2 * np.sqrt(2) / (1 + np.sqrt(2))
        centre = (radius, radius)
    assert size == pytest.approx(radius, abs=1e-3)
    assert place == pytest.approx(centre, abs=0.05)


def test_clearance_and_extent_of_a_section_with_a_hole():
    outer = np.array([[-3, -3], [3, -3], [3, 3], [-3, 3]], dtype=float)
    hole = np.array([[-1, -1], [-1, 1], [1, 1], [1, -1]], dtype=float)
    section = CommonSection(1.0, 1, (outer, hole), 32.0)
    points = [[0, 0], [2, 0], [2.5, 0], [4, 0], [0, 0.5]]
    np.testing.assert_allclose(section.clearance(points), [-1, 1, 0.5, -1, -0.5], atol=1e-12)
    assert section.extent([1, 1]) == pytest.approx((-np.sqrt(18), np.sqrt(18)))
    nothing = CommonSection(1.0, 2, (), 0.0)
    assert nothing.inscribed_circle[1] == nothing.width == nothing.height == 0.0
    assert np.isnan(nothing.extent([1, 0])).all()
    assert (nothing.clearance(points) == -np.inf).all()


@pytest.mark.parametrize("facets", [2, 3, 5])
def test_use_of_the_sensor_agrees_with_the_sections(facets):
    rig = small_setup(facets=facets).rig(2.0)
    depth = 700.0
    use, sections = sensor_use(rig, depth, 5), CommonField.of(rig).sections(depth)
    rows, columns = np.indices(use.counts.shape) * 5 + 2
    for view in rig:
        mine = view.region.contains(np.stack([columns, rows], -1))
        points = view.rays(np.stack([columns, rows], -1)[mine]).at_depth(depth)[:, :2]
        counts = use.counts[mine]
        for section in sections:
            clearance = section.clearance(points)
            sure = np.abs(clearance) > 0.02  # mm, of the border between its samples
            assert sure.mean() > 0.99
            np.testing.assert_array_equal((clearance > 0)[sure], (counts >= section.views)[sure])
    assert use.share(1) + use.lost + use.unused == pytest.approx(1.0)
    assert use.share(1) > use.share(2) >= use.share(facets) > 0


def test_use_of_the_sensor_agrees_with_the_summary():
    rig = small_setup().rig()
    use, field = sensor_use(rig, 800.0), field_at(rig, 800.0)
    section = CommonField.of(rig).sections(800.0)
    # the summary samples 48 x 48 px of each view, and counts only pixels of views
    assert use.share(2) / use.share(1) == pytest.approx(field.share_two, abs=0.02)
    assert use.share(3) / use.share(1) == pytest.approx(field.share_all, abs=0.02)
    assert (section[1].width, section[1].height) == pytest.approx((field.width, field.height), rel=0.05)


def test_blend_bands_cost_pixels():
    prism = Prism(3, 12.0, 1.5168, 60.0, 12.0, azimuth_deg=90.0)
    camera = Camera((320, 240), 600, pixel_pitch=0.02)
    wide = Setup(camera, prism, f_number=4.0, focus_distance=800.0)
    band = wide.blend_band(prism.paths(587.56)[0])
    sharp, open_ = sensor_use(Setup(camera, prism).rig(0.0), 800.0, 1), sensor_use(wide.rig(), 800.0, 1)
    assert sharp.lost == 0.0
    lost = np.count_nonzero(open_.counts == LOST)
    # three seams from the middle to the border, each as wide as the band and twice 1.5 px
    lengths = sum(np.linalg.norm(end) for end in ([160, 92], [160, 92], [0, 120]))
    assert lost == pytest.approx(lengths * (band + 3), rel=0.12)  # seams overlap in the middle


def test_wrong_calls_say_what_was_wanted():
    rig = small_setup().rig()
    common = CommonField.of(rig, 50)
    for call, error, words in (
        (lambda: common.volumes((900.0, 300.0)), SetupError, "near < far"),
        (lambda: common.volumes((0.0, 300.0)), SetupError, "near < far"),
        (lambda: common.volumes((300.0, np.nan)), SetupError, "near < far"),
        (lambda: common.volumes((50.0, 300.0)), OpticError, "within the optic"),
        (lambda: common.sections(-1.0), SetupError, "positive"),
        (lambda: common.sections(np.nan), SetupError, "positive"),
        (lambda: common.limits(4), SetupError, "between 1 and 3"),
        (lambda: common_volume(rig, (300.0, 900.0), 0), SetupError, "between 1 and 3"),
        (lambda: CommonField.of(rig, 2), SetupError, "8 samples"),
        (lambda: sensor_use(rig, np.inf), SetupError, "positive"),
        (lambda: sensor_use(rig, 500.0, 0), SetupError, "step"),
        (lambda: sensor_use(rig, 500.0).share(4), SetupError, "between 1 and 3"),
    ):
        with pytest.raises(error, match=words):
            call()


def test_a_view_past_90_degrees_has_no_sections():
    mirror = Mirror((0.0, 0.0, 100.0), (-1.0, 0.0, -1.0), (200.0, 200.0))
    rig = Setup(Camera((640, 480), 900), Mirrors((mirror,))).rig()
    with pytest.raises(OpticError, match="past 90 degrees"):
        CommonField.of(rig).sections(500.0)


@pytest.mark.parametrize("ending", ["stl", "ply", "obj"])
def test_meshes_come_back_from_their_files(tmp_path, ending):
    import trimesh

    volume = common_volume(small_setup().rig(), (500.0, 900.0), 2, 60)
    path = tmp_path / f"volume.{ending}"
    assert write_mesh(path, volume.vertices, volume.faces, "cm") == len(volume.faces)
    mesh = trimesh.load(path)
    assert mesh.is_watertight
    assert mesh.volume * 1000 == pytest.approx(volume.volume, rel=1e-4)  # STL keeps seven digits of coordinates
    assert [child.name for child in tmp_path.iterdir()] == [path.name]


def test_what_is_no_mesh_is_not_written(tmp_path):
    corners, faces = np.eye(3), np.array([[0, 1, 2]])
    for call, error, words in (
        (lambda: write_mesh(tmp_path / "a.txt", corners, faces), OutputError, ".stl"),
        (lambda: write_mesh(tmp_path / "mesh", corners, faces), OutputError, "without ending"),
        (lambda: write_mesh(tmp_path / "a.stl", corners, faces, "feet"), OutputError, "mm, cm, m, inch"),
        (lambda: write_mesh(tmp_path / "a.stl", corners[:, :2], faces), ShapeError, r"\(N, 3\)"),
        (lambda: write_mesh(tmp_path / "a.stl", corners, faces + 0.5), ShapeError, "integers"),
        (lambda: write_mesh(tmp_path / "a.stl", corners, faces + 1), ShapeError, "rows 0 to 2"),
        (lambda: write_mesh(tmp_path / "a.stl", corners, faces[:0]), ShapeError, "no faces"),
        (lambda: write_mesh(tmp_path / "a.stl", corners * np.nan, faces), ShapeError, "finite"),
        (lambda: write_mesh(tmp_path / "no" / "a.stl", corners, faces), OutputError, "no folder"),
    ):
        with pytest.raises(error, match=words):
            call()
    assert not list(tmp_path.iterdir())


def test_plates_have_one_view():
    rig = Setup(Camera((320, 240), 600), Plate("N-BK7", 40, 15)).rig()
    (volume,) = CommonField.of(rig).volumes((100.0, 200.0))
    assert volume.volume > 0
    with pytest.raises(CyclopeanError, match="between 1 and 1"):
        common_volume(rig, (100.0, 200.0), 2)
