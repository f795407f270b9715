"""Simulated photographs: their rays, their light, and what is said to be true in them."""

from dataclasses import dataclass, replace

import numba
import numpy as np
import pytest
import trimesh
from setups import DISTORTION, OPTICS, mirrors_beside, trace_slowly

from cyclopean import Camera, Mirrors, Plate, Prism, Setup
from cyclopean.analysis.chromatic import chromatic_pixels
from cyclopean.errors import CyclopeanError
from cyclopean.geometry import Pose, Rays, rotation_from_vector
from cyclopean.simulation import Lamp, Scene, Surface, render, trace_truth
from cyclopean.simulation.intersection import Triangles
from cyclopean.simulation.shapes import plane

SMALL = Camera((160, 120), 225)  # the field of the other tests' camera on fewer pixels
SMALL_BENT = Camera((160, 120), (225, 226), (79.2, 60.5), DISTORTION)
SQUARE = np.array([[-0.5, -0.5, 0.0], [0.5, -0.5, 0.0], [0.5, 0.5, 0.0], [-0.5, 0.5, 0.0]])


@dataclass(frozen=True, eq=False)
class Plain:
    """The same everywhere, or white where a coordinate of the place is positive."""

    colour: tuple = (1.0,)
    step: int | None = None
    dimensions: int = 3

    @property
    def channels(self):
        return len(self.colour)

    def reflectance(self, places):
        light = np.ones(len(places)) if self.step is None else places[:, self.step] > 0
        return light[:, None] * np.array(self.colour)


def wall(depth, *, size=20_000.0, turn=(0, 0, 0), paint=None, luminous=True, shift=(0, 0)):
    """A square across the z axis; places are coordinates from its middle."""
    pose = Pose.from_rotation_vector(turn, [*shift, depth])
    return plane(size, size).painted(paint or Plain(), pose, name="wall", luminous=luminous)


def room(rng, size=3000.0, cells=12):
    """Planes (6, 4) and the triangles, crooked ones, of a closed box around the camera."""
    axes, planes, vertices, faces = rotation_from_vector(rng.normal(size=3)), [], [], []
    ticks = np.linspace(-1, 1, cells + 1)
    for normal in np.vstack([axes, -axes]):
        u = np.cross(normal, axes[0] if abs(normal @ axes[0]) < 0.5 else axes[1])
        v = np.cross(normal, u)
        grid = np.stack(np.meshgrid(ticks, ticks), -1)
        grid[1:-1, 1:-1] += rng.uniform(-0.4, 0.4, grid[1:-1, 1:-1].shape) * 2 / cells
        corners = grid.reshape(-1, 2) @ [u, v] + normal
        first = np.arange(cells * (cells + 1)).reshape(cells, cells + 1)[:, :-1].ravel() + sum(map(len, vertices))
        faces += [np.stack([first, first + 1, first + cells + 2], -1)]
        faces += [np.stack([first, first + cells + 2, first + cells + 1], -1)]
        vertices.append(corners * size)
        planes.append([*normal, size])
    vertices = np.concatenate(vertices)
    return np.array(planes), Surface(vertices, np.concatenate(faces), Plain(), vertices, "room", True)


def brute_force(surface, rays):
    """First hits (N, 3) of rays (N,) among all triangles, in double precision; NaN for none."""
    a, b, c = np.moveaxis(surface.vertices[surface.faces], 1, 0)
    origins, directions = rays.origins[:, None], rays.directions[:, None]
    across = np.cross(directions, c - a)
    with np.errstate(divide="ignore", invalid="ignore"):
        inverse = 1 / np.einsum("ntk,tk->nt", across, b - a)
        u = np.einsum("ntk,ntk->nt", origins - a, across) * inverse
        over = np.cross(origins - a, b - a)
        v = np.einsum("ntk,ntk->nt", np.broadcast_to(directions, over.shape), over) * inverse
        t = np.einsum("tk,ntk->nt", c - a, over) * inverse
        # a ray through an edge meets both neighbours: 1e-13 so that rounding does not let it slip through between them
        hit = (u >= -1e-13) & (v >= -1e-13) & (u + v <= 1 + 1e-13) & (t > 0)
    t = np.where(hit, t, np.inf).min(1)
    return rays.at(np.where(np.isfinite(t), t, np.nan))


@pytest.mark.parametrize("camera", [SMALL, SMALL_BENT], ids=["straight lens", "bent lens"])
@pytest.mark.parametrize("optic", OPTICS)
def test_truth_is_where_light_meets_a_room_s_walls(optic, camera):
    setup = Setup(camera, OPTICS[optic])
    planes, surface = room(np.random.default_rng(3))
    truth = trace_truth(setup, Scene((surface,)))
    np.testing.assert_array_equal(truth.facet, setup.rig().facets)
    assert (truth.facet >= 0).any()
    for k, path in enumerate(setup.optic.paths(setup.wavelength_nm)):
        rows, columns = np.nonzero(truth.facet == k)
        rays = trace_slowly(path, camera.rays(np.stack([columns, rows], -1)))
        along = rays.directions @ planes[:, :3].T
        distance = (planes[:, 3] - rays.origins @ planes[:, :3].T) / along
        expected = rays.at(np.where(along > 0, distance, np.inf).min(-1))
        # 1e-9: roundings of double precision at 5 m, grown by grazing rays; single precision would leave 1e-4
        np.testing.assert_allclose(truth.points[rows, columns], expected, atol=1e-9)
    np.testing.assert_array_equal(np.isfinite(truth.depth), truth.facet >= 0)
    np.testing.assert_array_equal(truth.surface, np.where(truth.facet >= 0, 0, -1))


def test_hits_are_those_of_brute_force_even_at_edges():
    ball = trimesh.creation.icosphere(3, 150.0)
    corners = ball.triangles.reshape(-1, 3) + np.array([30, -20, 900])  # a soup: no triangle knows its neighbours
    corners = np.concatenate([corners, corners[:1].repeat(3, 0), corners[:2], corners[1:2]])  # and two without area
    surface = Surface(corners, np.arange(len(corners)).reshape(-1, 3), Plain(), corners)
    rng = np.random.default_rng(0)
    facing = np.flatnonzero(ball.face_normals[:, 2] < -0.5)  # away from the silhouette, where 1e-4 mm would decide
    chosen = rng.choice(facing, 600)
    weights = rng.dirichlet((1, 1, 1), 600)
    weights[:300, 0] = 0.0  # on an edge ...
    weights[:150, 1] = 0.0  # ... or a corner,
    weights /= weights.sum(1, keepdims=True)
    aims = np.einsum("nk,nkc->nc", weights, ball.triangles[chosen]) + np.array([30, -20, 900])
    aims[:300] += rng.uniform(-2e-5, 2e-5, (300, 3))  # or beside it by less than single precision can tell
    origins = rng.uniform(-20, 20, (600, 3))
    directions = aims - origins
    rays = Rays(origins, directions / np.linalg.norm(directions, axis=-1, keepdims=True))
    expected = brute_force(surface, rays)
    # 1e-9 mm: roundings at 1 m; the plane of the wrong neighbour would be 1e-6 mm off
    np.testing.assert_allclose(Triangles(Scene((surface,))).meet(rays).points, expected, atol=1e-9)


@pytest.mark.parametrize("distortion", [(-0.6, 0.1, 0, 0, 0), (0.5, -1.5, 0.01, 0.02, 0)])
def test_a_lens_that_folds_has_no_rays_beyond(distortion):
    camera = Camera((61, 47), 30, None, distortion)
    facing = Scene((wall(100, size=1e5),))  # farther to the sides than any ray goes
    light = render(Setup(camera, Plate(1.5, 20, 5)), facing, samples=16, with_optic=False)
    rows, columns = np.indices(light.shape)
    rays = np.isfinite(camera.normalise(np.stack([columns, rows], -1).astype(float))).all(-1)
    assert 0.2 < rays.mean() < 0.6
    np.testing.assert_array_equal(light[~rays], 0.0)
    surrounded = np.all([np.roll(rays, move, (0, 1)) for move in np.ndindex(2, 2)], axis=0)
    surrounded &= np.all([np.roll(rays, (-y, -x), (0, 1)) for y, x in np.ndindex(2, 2)], axis=0)
    np.testing.assert_allclose(light[surrounded], 1.0, rtol=1e-6)
    # what a ray meets projects back into its pixel: none has jumped over the fold
    step = Scene((wall(100, size=1e5, paint=Plain(step=0)),))
    right = render(Setup(camera, Plate(1.5, 20, 5)), step, samples=16, with_optic=False)
    np.testing.assert_array_equal(right[rays & (columns < 29)], 0.0)
    np.testing.assert_array_equal(right[surrounded & (columns > 31)], 1.0)


def bumpy_scene():
    """A ball and a crooked sheet in front of a wall."""
    ball = trimesh.creation.icosphere(2, 30.0)
    ball_points = ball.vertices + np.array([10, 5, 300])
    sheet = wall(400, size=90, turn=(0.3, 0.5, 0), shift=(-80, 30))
    return Scene((Surface(ball_points, ball.faces, Plain(), ball_points, "ball"), sheet, wall(900, size=3000)))


def test_matches_are_seen_where_they_say_and_hidden_where_something_is_in_the_way():
    setup = Setup(SMALL, Prism(3, 20, 1.5168, 90))
    scene = bumpy_scene()
    truth = trace_truth(setup, scene)
    points, pixels, first = truth.matches(300, seed=4)
    assert len(points) > 290
    rig = setup.rig()
    expected = rig.project(points)
    solid = np.concatenate([surface.vertices[surface.faces] for surface in scene.surfaces]).reshape(-1, 3)
    everything = Surface(solid, np.arange(len(solid)).reshape(-1, 3), Plain(), solid)
    for k, view in enumerate(rig):
        met = brute_force(everything, view.rays(expected[:, k]))
        hidden = ~(np.linalg.norm(met - points, axis=-1) < 1e-3)  # mm: far less than anything stands apart
        expected[hidden, k] = np.nan
        assert np.isfinite(pixels[first == k, k]).all()  # the view that it was drawn from does see it
    np.testing.assert_array_equal(pixels, expected)
    outside = np.isnan(rig.project(points)[..., 0])
    assert (np.isnan(pixels[..., 0]) & ~outside).sum() > 10  # some are hidden indeed
    assert set(np.unique(truth.surface)) >= {0, 1, 2}


def test_a_small_patch_is_seen_at_its_pixel_in_every_view():
    setup = Setup(SMALL_BENT, Prism(3, 12, 1.5168, 60))
    rig = setup.rig()
    truth = trace_truth(setup, Scene((wall(800),)))
    points, pixels, _ = truth.matches(400, seed=1)
    inside = ((pixels > 9) & (pixels < np.array(SMALL.size) - 10)).all(-1)
    inside &= np.stack([view.region.with_margin(9).contains(pixels[:, k]) for k, view in enumerate(rig)], -1)
    place = points[np.flatnonzero(inside.all(1))[0]]
    light = render(setup, Scene((wall(place[2], size=24.0, shift=place[:2]),)), samples=64, coating=0.0)
    for x, y in rig.project(place):
        column, row = round(x), round(y)
        window = light[row - 7 : row + 8, column - 7 : column + 8].astype(float)
        ticks = np.arange(-7, 8)
        centre = np.array([column + window.sum(0) @ ticks / window.sum(), row + window.sum(1) @ ticks / window.sum()])
        # a patch 7 px wide: 64 samples tell the share of a pixel at its border to 0.015, and there are 26 of those
        np.testing.assert_allclose(centre, [x, y], atol=0.02)


@pytest.mark.parametrize("facets", [2, 3, 4, 5])
def test_no_light_is_lost_in_blend_bands(facets):
    camera = replace(SMALL, pixel_pitch=0.01)
    setup = Setup(camera, Prism(facets, 10, 1.5168, 60), f_number=1.0, focus_distance=800.0)
    assert setup.blend_band(setup.optic.paths(587)[0]) > 3
    light = render(setup, Scene((wall(900, paint=Plain((0.7,))),)), samples=8, coating=0.01)
    # every ray goes one way and one way only, through two surfaces; 1e-6: single precision
    np.testing.assert_allclose(light, 0.7 * 0.99**2, rtol=1e-6)


def test_bare_glass_reflects_as_fresnel_says():
    telescope = Camera((8, 8), 1e6)  # all rays are parallel
    scene = Scene((wall(900),))
    index = 1.6
    upright = Setup(telescope, Plate(index, 50, 5))
    straight = ((index - 1) / (index + 1)) ** 2  # Born and Wolf, section 1.5.2, eq. 36
    # 1e-6: single precision
    np.testing.assert_allclose(render(upright, scene, samples=1), (1 - straight) ** 2, rtol=1e-6)
    brewster = Setup(telescope, Plate(index, 50, 5, tilt_deg=(0, np.degrees(np.arctan(index)), 0)))
    across = ((index**2 - 1) / (index**2 + 1)) ** 2  # light along the plane of incidence passes whole: section 1.5.3
    np.testing.assert_allclose(render(brewster, scene, samples=1), (1 - across / 2) ** 2, rtol=1e-5)  # 8e-6 rad wide


def half_disc(across):
    """Part of a disc of radius 1 on one side of a chord at `across`."""
    u = np.clip(across, -1, 1)
    return 0.5 + (u * np.sqrt(1 - u**2) + np.arcsin(u)) / np.pi


def box_filtered(profile, centres):
    """Mean of a function over each pixel."""
    inside = np.linspace(-0.5, 0.5, 41)
    return profile(centres[:, None] + inside).mean(-1)


def test_a_seam_blends_as_wide_as_the_setup_says():
    camera = Camera((120, 9), 2400, pixel_pitch=0.0055)
    setup = Setup(camera, Prism(2, 10, 1.5168, 60), f_number=5.6, focus_distance=900.0)
    band = setup.blend_band(setup.optic.paths(587)[0])
    assert 20 < band < 80
    # two colours for the two sub-images: behind the seam each facet looks to its own side of the wall
    light = render(setup, Scene((wall(900, paint=Plain(step=0)),)), samples=256, coating=0.0).mean(0)
    columns = np.arange(120) - 59.5
    rises = box_filtered(lambda x: half_disc(2 * x / band), columns)
    rises = rises if light[-1] > light[0] else rises[::-1]
    # 0.01: three times the spread of 256 samples in each of nine rows
    np.testing.assert_allclose(light, rises, atol=0.01)


@pytest.mark.parametrize("depth", [500.0, 1500.0])
def test_an_edge_out_of_focus_blurs_as_a_thin_lens_does(depth):
    camera = Camera((80, 9), 2400, pixel_pitch=0.0055)
    setup = Setup(camera, Plate(1.5, 20, 5), f_number=4.0, focus_distance=800.0)
    light = render(setup, Scene((wall(depth, paint=Plain(step=0)),)), samples=256, with_optic=False).mean(0)
    image = 2400 * 0.0055
    pupil = 1 / (1 / image + 1 / 800.0) / 4.0
    circle = pupil * abs(depth - 800.0) / depth * image / 800.0 / 0.0055  # px: similar triangles behind and before
    expected = box_filtered(lambda x: half_disc(2 * x / circle), np.arange(80) - 39.5)
    np.testing.assert_allclose(light, expected, atol=0.01)  # three times the spread of 256 samples in nine rows


def test_dispersion_shifts_channels_as_the_optic_says():
    camera = Camera((400, 24), 2400)
    channels = (650.0, 550.0, 450.0)
    setup = Setup(camera, Prism(2, 12, "N-SF11", 60), channel_wavelengths_nm=channels)
    view = setup.rig()[0]
    depth, middle = 900.0, np.array([view.region.centre[0], 11.5])
    place = view.rays(middle).at_depth(depth)
    scene = Scene((wall(depth, size=2000, paint=Plain((0.9, 0.9, 0.9), step=0), shift=(place[0], 0)),))
    window = slice(int(middle[0]) - 40, int(middle[0]) + 41)
    light = render(setup, scene, samples=16, colour=True, coating=0.0)[:, window].astype(float) / 0.9
    rows = np.arange(24)
    edge = window.stop - 0.5 - light.sum(1)  # px, white lies to the right
    points = np.stack(
        [
            np.full(24, place[0]),
            view.rays(np.stack([np.full(24, middle[0]), rows], -1)).at_depth(depth)[:, 1],
            np.full(24, depth),
        ],
        -1,
    )
    expected = chromatic_pixels(setup, points, channels)[:, :, 0, 0]
    assert np.ptp(expected[12]) > 5
    # 16 samples place an edge to 1/16 px at worst; 24 rows together to 0.01 px
    np.testing.assert_allclose((edge - expected).mean(0), 0, atol=0.01)
    wide = render(replace(setup, wavelength_nm=550.0), scene, samples=64, bandwidth_nm=200.0, coating=0.0)
    rise = np.diff(wide[:, window].mean(0))  # the edge smeared over all colours
    columns = np.arange(len(rise))
    spread = np.sqrt((rise @ columns**2) / rise.sum() - (rise @ columns / rise.sum()) ** 2)
    # a top hat has a standard deviation of width / sqrt(12); a tenth: dispersion is not even over the band
    assert spread == pytest.approx(np.ptp(expected[12]) / np.sqrt(12), rel=0.1)


def test_light_falls_from_a_lamp_as_lambert_says_and_a_ball_throws_its_shadow():
    setup = Setup(SMALL, Mirrors(mirrors_beside().mirrors, direct=True))
    lamp = Lamp(position=(300.0, -200.0, 100.0), strength=0.8, distance=500.0)
    ball = trimesh.creation.icosphere(4, 40.0)
    middle = np.array([60.0, 10.0, 500.0])
    places = ball.vertices + middle
    back = wall(900, size=4000, turn=(0.1, 0.2, 0), paint=Plain((0.5,)), luminous=False)
    scene = Scene((Surface(places, ball.faces, Plain((0.5,)), places), back), ambient=0.1, lamps=(lamp,))
    light = render(setup, scene, with_optic=False, samples=4)
    truth = trace_truth(setup, scene, with_optic=False)
    towards = lamp.position - truth.points
    distance = np.linalg.norm(towards, axis=-1)
    normal = rotation_from_vector(np.array([0.1, 0.2, 0])) @ [0, 0, -1]
    matte = 0.5 * (0.1 + 0.8 * (500 / distance) ** 2 * (towards @ normal) / distance)
    closest = np.linalg.norm(np.cross(truth.points - middle, towards), axis=-1) / distance
    alone = trace_truth(setup, replace(scene, surfaces=(back,)), with_optic=False).surface == 0
    steady = np.ones(light.shape, dtype=bool)
    for move in ((0, 1), (0, -1), (1, 0), (-1, 0)):
        steady &= np.roll(truth.surface, move, (0, 1)) == 1
    lit, dark = steady & alone & (closest > 45), steady & alone & (closest < 35)
    assert dark.sum() > 100
    # four samples a pixel, over which light changes by up to a hundredth
    np.testing.assert_allclose(light[lit], matte[lit], rtol=5e-3)
    np.testing.assert_allclose(light[dark], 0.5 * 0.1, rtol=1e-6)
    behind = replace(scene, lamps=(Lamp(direction=(0, 0, -1)),))
    assert render(setup, behind, with_optic=False, samples=1).max() == pytest.approx(0.05)  # only the far side is lit
    parallel = replace(scene, surfaces=(back,), lamps=(Lamp(direction=tuple(-2 * normal), strength=0.5),))
    np.testing.assert_allclose(render(setup, parallel, with_optic=False, samples=1), 0.5 * 0.6, rtol=1e-6)


def test_natural_vignetting_is_the_fourth_power_of_the_cosine():
    setup = Setup(SMALL_BENT, Plate(1.5, 40, 5))
    light = render(setup, Scene((wall(900),)), with_optic=False, natural_vignetting=True, samples=16)
    rows, columns = np.indices(light.shape)
    cosine = SMALL_BENT.rays(np.stack([columns, rows], -1).astype(float)).directions[..., 2]
    np.testing.assert_allclose(light, cosine**4, rtol=1e-3)  # 16 samples over a pixel; the corner falls 0.3 % a pixel


def test_mirrors_show_light_where_they_lead_it_and_black_elsewhere():
    setup = Setup(SMALL, replace(OPTICS["two mirrors"], sequences=((0, 1), (0,)), direct=False))
    _, surface = room(np.random.default_rng(1))
    light = render(setup, Scene((surface,)), samples=4)
    facets = setup.rig().facets
    inside, outside = np.ones((2, *facets.shape), dtype=bool)
    for move in np.ndindex(3, 3):
        around = np.roll(facets, np.array(move) - 1, (0, 1))
        inside &= around >= 0
        outside &= around < 0
    assert len(np.unique(facets[inside])) == 2
    assert outside.sum() > 100
    np.testing.assert_allclose(light[inside], 1.0, rtol=1e-6)
    np.testing.assert_array_equal(light[outside], 0.0)


def test_colours_come_through_and_grey_is_their_mean():
    setup = Setup(SMALL, mirrors_beside())
    colours = (0.2, 0.4, 0.9)
    scene = Scene((wall(900, size=150, paint=Plain(colours)), wall(950, size=200)), background=(0.0, 0.1, 0.3))
    light = render(setup, scene, samples=1, colour=True, with_optic=False)
    surface = trace_truth(setup, scene, with_optic=False).surface
    assert set(np.unique(surface)) == {-1, 0, 1}
    for place, colour in ((0, colours), (1, (1.0, 1.0, 1.0)), (-1, scene.background)):
        rows, columns = (int(np.median(index)) for index in np.nonzero(surface == place))
        rows, columns = (rows, columns) if surface[rows, columns] == place else np.argwhere(surface == place)[0]
        np.testing.assert_allclose(light[rows, columns], colour, rtol=1e-6)
    grey = render(setup, scene, samples=1, with_optic=False)
    np.testing.assert_allclose(grey, light.mean(-1), rtol=1e-6)  # the same rays: the seed is the same


def test_a_seed_gives_one_picture_on_any_number_of_threads():
    setup = Setup(replace(SMALL, pixel_pitch=0.01), Prism(3, 12, 1.5, 60), f_number=4.0, focus_distance=700.0)
    scene = replace(bumpy_scene(), lamps=(Lamp(position=(0, -300, 0)),))
    told = []
    first = render(setup, scene, samples=5, progress=lambda done, total: told.append(done / total))
    threads = numba.get_num_threads()
    numba.set_num_threads(1)
    try:
        alone = render(setup, scene, samples=5)
    finally:
        numba.set_num_threads(threads)
    np.testing.assert_array_equal(alone, first)
    assert (render(setup, scene, samples=5, seed=1) != first).mean() > 0.01
    assert told[-1] == 1
    assert told == sorted(told)


GLASS = Prism(2, 10, 1.5, 60)


@pytest.mark.parametrize(
    ("setup", "scene", "options", "message"),
    [
        (Setup(SMALL, GLASS), lambda: Scene(()), {}, "the scene is empty"),
        (Setup(SMALL, GLASS), lambda: Scene((wall(-500),)), {}, "behind the camera"),
        (Setup(SMALL, GLASS), lambda: Scene((wall(-500),)), {"with_optic": False}, "behind the camera"),
        (Setup(SMALL, GLASS), lambda: Scene((wall(900), wall(65, size=5))), {}, "'wall' reaches into the optic"),
        (Setup(SMALL, GLASS), lambda: Scene((wall(30, size=5),)), {}, "beyond z = "),
        (Setup(SMALL, Plate(1.5, 3, 40, tilt_deg=(0, 100, 0))), lambda: Scene((wall(900),)), {}, "stands in the glass"),
        (Setup(SMALL, GLASS), lambda: Scene((wall(900),)), {"samples": 0}, "samples must be"),
        (Setup(SMALL, GLASS), lambda: Scene((wall(900),)), {"samples": 1.5}, "samples must be"),
        (Setup(SMALL, GLASS), lambda: Scene((wall(900),)), {"seed": -1}, "seed must be"),
        (Setup(SMALL, GLASS), lambda: Scene((wall(900),)), {"coating": 2.0}, "coating"),
        (Setup(SMALL, GLASS), lambda: Scene((wall(900),)), {"bandwidth_nm": 20.0}, "name the glass"),
        (Setup(SMALL, GLASS), lambda: Scene((wall(900),)), {"bandwidth_nm": -1.0}, "bandwidth must be"),
        (Setup(Camera((90000, 90000), 1e5), GLASS), lambda: Scene((wall(900),)), {}, "too large"),
        (Setup(SMALL, GLASS), lambda: Scene((wall(900),), lamps=(Lamp(),)), {}, "either a position"),
        (Setup(SMALL, GLASS), lambda: Scene((wall(np.nan),)), {}, "4 of 4 vertices are not numbers"),
        (Setup(SMALL, GLASS), lambda: Scene((wall(900),), background=(1.0, 2.0)), {}, "background"),
    ],
)
def test_wrong_input_is_explained(setup, scene, options, message):
    with pytest.raises(CyclopeanError, match=message):
        render(setup, scene(), **options)


@pytest.mark.parametrize(
    ("faces", "places", "message"),
    [
        ([[0, 1, 4]], SQUARE, "asks for vertex 4"),
        ([[0, 1, -1]], SQUARE, "asks for vertex -1"),
        (np.empty((0, 3), int), SQUARE, "faces must be triangles"),
        ([[0, 1, 2, 3]], SQUARE, "faces must be triangles"),
        ([[0.0, 1.0, 2.0]], SQUARE, "whole numbers"),
        ([[0, 1, 2]], SQUARE[:, :2], "as many columns as the paint has dimensions"),
    ],
)
def test_a_surface_that_is_none_is_refused(faces, places, message):
    with pytest.raises(CyclopeanError, match=message):
        Surface(SQUARE, faces, Plain(), places)
