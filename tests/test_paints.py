"""Paints of simulated scenes, shapes that carry them, and the sensor's electronics."""

import numpy as np
import pytest
from scipy.ndimage import map_coordinates

from cyclopean import Board
from cyclopean.errors import CyclopeanError, SetupError
from cyclopean.geometry import Pose
from cyclopean.simulation.paints import Checker, Colours, Noise, Picture, Speckle, Uniform, linear_light
from cyclopean.simulation.prints import Print, board_surface
from cyclopean.simulation.sensor import Sensor
from cyclopean.simulation.shapes import box, cylinder, heightmap, plane, sphere
from cyclopean.targets.prints import outline

BOARDS = (
    Board("charuco", 6, 5, 7.3, 5.1, "DICT_5X5_50"),
    Board("charuco", 5, 4, 10.0, 7.0, "DICT_4X4_50", legacy=True),
    Board("chessboard", 6, 4, 9.1),
    Board("circles", 5, 4, 8.0, 5.0),
    Board("asymmetric_circles", 4, 5, 8.0, 9.0),
    Board("apriltags", 4, 3, 9.0, 6.5, "DICT_APRILTAG_36h11"),
)


def places(count, dimensions=2, reach=200.0, seed=3):
    return np.random.default_rng(seed).uniform(-reach, reach, (count, dimensions))


@pytest.mark.parametrize("board", BOARDS, ids=lambda board: f"{board.kind}{' legacy' * board.legacy}")
def test_a_print_is_the_board_exactly(board):
    left, top, right, bottom = outline(board)
    inside = np.random.default_rng(1).uniform([left, top], [right, bottom], (50_000, 2))
    asked = np.concatenate([inside, places(1000, reach=500.0)])  # far outside as well
    # no tolerance: random places lie on no line
    levels = Print(board, 0.1, 0.7).reflectance(asked)
    np.testing.assert_array_equal(levels[:, 0], np.where(board.shade(asked), np.float32(0.7), np.float32(0.1)))
    assert 0.05 < (levels < 0.5).mean() < 0.9  # there is a pattern


def test_a_board_in_a_scene_lies_where_its_pose_says():
    board, pose = BOARDS[0], Pose.from_rotation_vector([0.3, -0.2, 0.1], [5.0, 6.0, 700.0])
    surface = board_surface(board, pose)
    xyz = np.column_stack([surface.places, np.zeros(4)])
    np.testing.assert_allclose(surface.vertices, pose @ xyz, atol=1e-12)  # rounding
    assert (*surface.places.min(0), *surface.places.max(0)) == pytest.approx(outline(board))


@pytest.mark.parametrize("dimensions", [2, 3])
def test_half_of_a_speckled_surface_is_covered(dimensions):
    levels = Speckle(2.0, 0.0, 1.0, dimensions=dimensions).reflectance(places(400_000, dimensions))
    # 400 mm hold 20 000 dots in the plane: their share spreads by 0.3 %, that of a solid's by less
    assert levels.mean() == pytest.approx(0.5, abs=0.01)
    assert ((levels > 0.01) & (levels < 0.99)).mean() < 0.25  # rims are narrow


@pytest.mark.parametrize("dimensions", [2, 3])
def test_noise_has_the_spread_that_it_states(dimensions):
    levels = Noise(2.0, 0.2, 0.8, dimensions=dimensions).reflectance(places(400_000, dimensions))
    assert levels.mean() == pytest.approx(0.5, abs=0.01)
    # a quarter of the range, less what the cut takes away: 0.238 for a normal distribution
    assert levels.std() / 0.6 == pytest.approx(0.24, abs=0.012)


@pytest.mark.parametrize("paint", [Speckle, Noise])
@pytest.mark.parametrize("dimensions", [2, 3])
def test_random_paints_scale_and_repeat_only_with_their_seed(paint, dimensions):
    asked = places(2000, dimensions, reach=50.0)
    levels = paint(3.0, dimensions=dimensions).reflectance(asked)
    larger = paint(6.0, dimensions=dimensions).reflectance(2 * asked)
    np.testing.assert_allclose(levels, larger, atol=1e-6)  # float32
    other = paint(3.0, seed=1, dimensions=dimensions).reflectance(asked)
    assert abs(np.corrcoef(levels[:, 0], other[:, 0])[0, 1]) < 0.1  # 4.5 standard deviations of 2000 places


def test_no_place_of_noise_tells_those_beyond_its_grain():
    asked = places(20_000)
    noise = Noise(2.0)
    levels, near, far = (noise.reflectance(asked + np.array([step, 0.0]))[:, 0] for step in (0.0, 0.1, 5.0))
    assert np.corrcoef(levels, near)[0, 1] > 0.98
    assert abs(np.corrcoef(levels, far)[0, 1]) < 0.03  # 4 standard deviations of 20 000 places


@pytest.mark.parametrize("dimensions", [2, 3])
def test_a_checker_changes_at_every_step(dimensions):
    asked = places(5000, dimensions)
    odd = np.floor(asked / 7.0).sum(axis=1) % 2
    np.testing.assert_array_equal(Checker(7.0, 0.0, 1.0, dimensions).reflectance(asked)[:, 0], odd)


def test_a_side_of_a_box_at_a_whole_step_has_no_noise():
    asked = places(5000, 3, reach=3.0) * [1, 1, 0] + [3.5, 3.5, 0]
    jitter = asked + [[0, 0, 1e-12]] * np.random.default_rng(0).choice([-1, 1], (5000, 1))
    checker = Checker(7.0, dimensions=3)
    np.testing.assert_array_equal(checker.reflectance(asked), checker.reflectance(jitter))


@pytest.mark.parametrize("repeat", [False, True])
def test_a_picture_is_bilinear(repeat):
    image = np.random.default_rng(2).uniform(size=(6, 9, 3))
    paint = Picture(image, size=(18.0, 6.0), corner=(-4.0, 1.0), repeat=repeat)
    asked = places(3000, reach=30.0)
    column, row = (asked[:, 0] + 4) / 2 - 0.5, (asked[:, 1] - 1) / 1 - 0.5
    mode = "grid-wrap" if repeat else "nearest"
    wanted = np.stack([map_coordinates(image[..., c], [row, column], order=1, mode=mode) for c in range(3)], axis=1)
    np.testing.assert_allclose(paint.reflectance(asked), wanted, atol=1e-6)  # float32


def test_screen_values_become_light():
    light = linear_light(np.array([[0, 10, 128, 255]], np.uint8))
    # IEC 61966-2-1: 10 lies on the straight part; 128 is 0.2158605
    np.testing.assert_allclose(light, [[0, 10 / 255 / 12.92, 0.2158605, 1]], atol=1e-6)
    np.testing.assert_allclose(linear_light(np.uint16([[65535]])), [[1.0]])


def test_plain_paints():
    assert Uniform((0.2, 0.4, 0.6)).reflectance(places(5)).tolist() == np.float32([[0.2, 0.4, 0.6]] * 5).tolist()
    assert Colours().reflectance(np.array([[0.5, 1.5, -1.0]])).tolist() == [[0.5, 1.0, 0.0]]


SHAPES = {
    "plane": (plane(30, 20), 600),
    "box": (box(30, 20, 10), 2 * (600 + 200 + 300)),
    "sphere": (sphere(10), 4 * np.pi * 100),
    "cylinder": (cylinder(10, 30), 2 * np.pi * 10 * 40),
    "heightmap": (heightmap(np.zeros((5, 7)), 30, 20), 600),
}


@pytest.mark.parametrize("name", SHAPES)
def test_shapes_have_their_area_and_show_pictures_the_right_way_round(name):
    shape, area = SHAPES[name]
    a, b, c = np.moveaxis(shape.vertices[shape.faces], 1, 0)
    normals = np.cross(b - a, c - a) / 2
    # 360 steps around: a sphere's triangles lose 1 part in 20 000
    assert np.linalg.norm(normals, axis=1).sum() == pytest.approx(area, rel=1e-4)
    outward = np.sum(normals * (a + b + c), axis=1) if name in ("box", "sphere", "cylinder") else -normals[:, 2]
    for coordinates in (shape.flat, shape.share):
        p, q, r = np.moveaxis(coordinates[shape.faces], 1, 0)
        turn = (q - p)[:, 0] * (r - p)[:, 1] - (q - p)[:, 1] * (r - p)[:, 0]
        # x to the right and y down, seen from outside: the turn of a triangle on its picture is against the normal
        assert (turn * outward < 0)[np.abs(turn) > 1e-9 * np.abs(turn).max()].all()
        assert np.abs(turn).sum() > 0


@pytest.mark.parametrize(("name", "half"), [("box", 10), ("cylinder", 15)])
def test_pictures_above_and_below_are_upright_when_tipped_to_the_viewer(name, half):
    shape = SHAPES[name][0]
    for side, towards_viewer in ((-half, 1), (half, -1)):  # of the side above the near edge is the lower one
        corners = shape.vertices[shape.faces].reshape(-1, 3, 3)
        faces = shape.faces[(corners[..., 1] == side).all(1)].ravel()
        for coordinates in (shape.flat, shape.share):
            x, y = (coordinates[faces] - coordinates[faces].mean(0)).T
            assert np.corrcoef(x, shape.vertices[faces, 0])[0, 1] == pytest.approx(1)
            assert np.corrcoef(y, -towards_viewer * shape.vertices[faces, 2])[0, 1] == pytest.approx(1)


def test_flat_paint_is_not_stretched_on_flat_sides():
    for shape in (plane(30, 20), box(30, 20, 10)):
        edges = shape.faces[:, [0, 1]]
        on_paint = np.linalg.norm(np.diff(shape.flat[edges], axis=1), axis=-1)
        in_space = np.linalg.norm(np.diff(shape.vertices[edges], axis=1), axis=-1)
        np.testing.assert_allclose(on_paint, in_space, atol=1e-12)  # rounding


@pytest.mark.parametrize("bits", [8, 12, 16])
def test_noise_of_a_sensor_is_that_of_emva_1288(bits):
    full, dark, light = 9000.0, 30.0, 0.4
    sensor = Sensor(bits, 1.0, full, dark, black_level=3.0)
    levels = sensor.expose(np.full((300, 300), light), seed=2).astype(float)
    gain = (sensor.highest - 3) / full  # grey levels an electron
    variance = gain**2 * (dark**2 + light * full) + 1 / 12  # EMVA 1288 release 4.0, section 2: dark, shot, quantisation
    assert levels.mean() == pytest.approx(3 + light * full * gain, abs=5 * np.sqrt(variance / levels.size))
    assert levels.var() == pytest.approx(variance, rel=5 * np.sqrt(2 / levels.size))
    assert levels.max() <= sensor.highest
    assert sensor.expose(np.full((9, 9), 3.0)).max() == sensor.highest  # full is full


def test_simple_noise_is_in_grey_levels_of_8_bits():
    for bits in (8, 16):
        sensor = Sensor(bits, 0.5, noise=3.0)
        levels = sensor.expose(np.ones((200, 200)), seed=1) * (255 / sensor.highest)
        assert levels.std() == pytest.approx(3.0, rel=5 / np.sqrt(2 * levels.size) + 0.01)  # 1/12 of 8 bits: 0.5 %
        assert (sensor.expose(np.ones((9, 9)), 1) == sensor.expose(np.ones((9, 9)), 1)).all()
        assert (sensor.expose(np.ones((9, 9)), 1) != sensor.expose(np.ones((9, 9)), 2)).any()


def test_automatic_exposure_leaves_room_above_all_but_the_brightest():
    light = np.random.default_rng(0).uniform(0, 7.0, (100, 100, 3))
    top = np.percentile(Sensor(12).expose(light).max(axis=-1), 99.9)
    assert top == pytest.approx(0.9 * 4095, abs=2)  # rounding to whole levels
    assert Sensor().expose(np.zeros((5, 5))).max() == 0
    star = np.zeros((100, 100))
    star[50, 50] = 1.0
    assert Sensor().expose(star).max() == 230  # 0.9 of 255


def test_blur_spreads_light_and_loses_none():
    light = np.zeros((61, 61))
    light[30, 30] = 1.0
    levels = Sensor(16, 1.0, blur_sigma=3.0).expose(light).astype(float)
    share = levels / levels.sum()
    steps = np.arange(61) - 30
    assert levels.sum() == pytest.approx(65535, rel=0.01)  # of rounding: 0.3 levels in 600 pixels
    assert np.sum(share * steps**2) == pytest.approx(9.0, rel=0.02)


@pytest.mark.parametrize(
    ("make", "said"),
    [
        (lambda: Sensor(9), "bits must be one of 8, 12, 16"),
        (lambda: Sensor(exposure=0.0), "exposure must be a number above 0"),
        (lambda: Sensor(full_well_electrons=np.nan), "full well must be"),
        (lambda: Sensor(full_well_electrons=1e30), "1e[+]09 at most"),
        (lambda: Sensor(blur_sigma=1e6), "blur must be a number of 0 or more, 100 at most"),
        (lambda: Sensor(noise=-1.0), "noise must be a number of 0 or more"),
        (lambda: Sensor(read_noise_electrons=3.0), "needs the number that fills a pixel"),
        (lambda: Sensor(black_level=255.0), "black level must lie below 255"),
        (lambda: Sensor().expose(np.full((3, 3), np.nan)), "NaN"),
        (lambda: Sensor().expose(np.ones(3)), r"shape \(H, W\)"),
        (lambda: Speckle(0.0), "size of a speckle"),
        (lambda: Noise(1.0, dark=1.5), "dark must be a reflectance"),
        (lambda: Checker(1.0, dimensions=4), "2 dimensions"),
        (lambda: Speckle(1.0, seed=-1), "seed"),
        (lambda: Speckle(1.0).reflectance(np.ones((4, 3))), r"shape \(N, 2\)"),
        (lambda: Uniform((0.1, 0.2)), "one number, grey, or three"),
        (lambda: Picture(np.full((3, 3), 2.0)), "0 to 1"),
        (lambda: Picture(np.ones(3)), "picture must have shape"),
        (lambda: Print("board"), "needs a Board"),
        (lambda: sphere(10).painted(Uniform((2.0,)), Pose(np.eye(3), np.zeros(3))), "a colour must be"),
        (lambda: heightmap(np.zeros(3), 1, 1), "heights"),
    ],
)
def test_what_makes_no_sense_is_refused(make, said):
    with pytest.raises(CyclopeanError, match=said):
        make()
    assert issubclass(SetupError, CyclopeanError)
