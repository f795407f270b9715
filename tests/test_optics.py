"""Light through planes against laws, closed forms and a slow obvious tracer."""

import numpy as np
import pytest
from setups import OPTICS, SETUPS, STRAIGHT, random_pixels, trace_slowly

from cyclopean import Mirror, Mirrors, Plate, Prism
from cyclopean.geometry import Rays
from cyclopean.optics import Interface, Path, reflect, refract, refractive_indices

AXIS = Rays(np.zeros(3), np.array([0.0, 0, 1]))


@pytest.fixture
def rng():
    return np.random.default_rng(5)


def unit(vectors):
    vectors = np.asarray(vectors, dtype=float)
    return vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)


def only_path(optic):
    (path,) = optic.paths(587.5618)
    return path


# Laws at one surface


@pytest.mark.parametrize("shape", [(), (1,), (2, 0), (3, 1, 2)])
def test_refraction_obeys_snell(shape, rng):
    normals, directions = unit(rng.normal(size=(2, *shape, 3)))
    refracted = refract(directions, normals, 1.0, 1.5)
    # as vectors, n sin(angle) also keeps the ray in the plane of incidence; 1e-14: a few roundings
    np.testing.assert_allclose(1.5 * np.cross(refracted, normals), np.cross(directions, normals), atol=1e-14)
    np.testing.assert_allclose(np.linalg.norm(refracted, axis=-1), 1, atol=1e-14)
    through = np.sum(refracted * normals, -1) * np.sum(directions * normals, -1)
    assert (through >= 0).all()  # light goes on through the surface


@pytest.mark.parametrize("shape", [(), (1,), (2, 0), (3, 1, 2)])
def test_reflection_turns_the_part_along_the_normal(shape, rng):
    normals, directions = unit(rng.normal(size=(2, *shape, 3)))
    reflected = reflect(directions, normals)
    # 1e-15: a rounding or two
    np.testing.assert_allclose(np.cross(reflected, normals), np.cross(directions, normals), atol=2e-15)
    np.testing.assert_allclose(np.sum(reflected * normals, -1), -np.sum(directions * normals, -1), atol=2e-15)


def test_light_can_travel_back(rng):
    normals, directions = unit(rng.normal(size=(2, 100, 3)))
    inside = refract(directions, normals, 1.0, 1.7)
    # 1e-13: at grazing incidence a rounding of the cosine grows
    np.testing.assert_allclose(-refract(-inside, normals, 1.7, 1.0), directions, atol=1e-13)


def test_total_reflection_sets_in_at_the_critical_angle():
    critical = np.arcsin(1 / 1.5)
    angles = critical + np.array([-1e-9, 1e-9])  # far above the rounding of an angle, 1e-16
    directions = np.stack([np.sin(angles), 0 * angles, np.cos(angles)], -1)
    np.testing.assert_array_equal(np.isnan(refract(directions, [0, 0, 1.0], 1.5, 1.0)).all(-1), [False, True])


# Paths


@pytest.mark.parametrize("name", [name for name in SETUPS if "straight" in name])
def test_compiled_tracing_agrees_with_the_slow_tracer(name):
    setup = SETUPS[name]
    rays = setup.camera.rays(random_pixels(setup, 700))  # more than ten blocks, the last one not full
    for path in setup.optic.paths(setup.wavelength_nm):
        fast, slow = path.trace(rays), trace_slowly(path, rays)
        assert np.isfinite(fast.directions).any()
        # 2e-13: some roundings of lengths of 100 mm; assert_allclose also wants NaN in the same places
        np.testing.assert_allclose(fast.origins, slow.origins, rtol=0, atol=2e-13)
        np.testing.assert_allclose(fast.directions, slow.directions, rtol=0, atol=2e-15)


def reverse(path):
    """The same surfaces for light that comes from the scene."""
    before = [path.index_start, *(surface.index_after for surface in path.interfaces)]
    back = tuple(
        Interface(surface.normal, surface.offset, surface.act, index)
        for surface, index in zip(path.interfaces[::-1], before[-2::-1], strict=True)
    )
    return Path(back, path.index_end)


@pytest.mark.parametrize("name", [name for name in SETUPS if "straight" in name])
def test_light_travels_back_through_an_optic_to_the_pinhole(name):
    setup = SETUPS[name]
    start = setup.camera.rays(random_pixels(setup, 50))
    for path in setup.optic.paths(setup.wavelength_nm):
        there = path.trace(start)
        seen = np.isfinite(there.directions).all(-1)
        back = reverse(path).trace(Rays(there.at(np.full(seen.shape, 70.0)), -there.directions))
        # 1e-13: a few roundings of directions
        np.testing.assert_allclose(-back.directions[seen], start.directions[seen], atol=1e-13)
        foot = back.origins - np.sum(back.origins * back.directions, -1, keepdims=True) * back.directions
        # 1e-11: roundings of 100 mm, and of directions times 100 mm
        np.testing.assert_allclose(foot[seen], 0, atol=1e-11)


@pytest.mark.parametrize("name", ["prism", "prism, facets to camera", "biprism in water", "plate", "port"])
def test_light_takes_the_path_of_least_time(name, rng):
    path = OPTICS[name].paths(587.5618)[0]
    ray = SETUPS[f"{name}, straight lens"].rig()[0].rays(SETUPS[f"{name}, straight lens"].rig()[0].region.centre)
    first, last = path.interfaces
    goal = ray.at(300.0)
    entry = reverse(path).trace(Rays(ray.at(1.0), -ray.directions)).origins

    def time(a, b):
        legs = [np.linalg.norm(a, axis=-1), np.linalg.norm(b - a, axis=-1), np.linalg.norm(goal - b, axis=-1)]
        return path.index_start * legs[0] + first.index_after * legs[1] + last.index_after * legs[2]

    steps = rng.normal(size=(2, 200, 3))
    for surface, step in zip((first, last), steps, strict=True):
        step -= np.sum(step * surface.normal, -1, keepdims=True) * surface.normal  # stay on the surface
    for size in (1e-2, 1e-1, 1.0):  # mm; 1e-2 changes the path by 1e-6 mm, roundings by 1e-13
        assert (time(entry + size * steps[0], ray.origins + size * steps[1]) > time(entry, ray.origins)).all()


@pytest.mark.parametrize("shape", [(), (2, 0), (3, 1, 2)])
def test_rays_of_any_shape_are_traced(shape, rng):
    path = only_path(Plate(1.5, 50, 10))
    directions = unit(rng.normal((0, 0, 5), size=(*shape, 3)))
    traced = path.trace(Rays(np.zeros(3), directions))  # one origin for all
    assert traced.origins.shape == traced.directions.shape == (*shape, 3)
    # 1e-14: some roundings
    np.testing.assert_allclose(traced.directions, directions, atol=1e-14)


def test_rays_that_do_not_exist_stay_so():
    path = only_path(Plate(1.5, 50, 10))
    nowhere, up = [np.nan, 0, 0], [0, 0, 1.0]
    traced = path.trace(Rays(np.array([nowhere, [0, 0, 0], [0, 0, 70.0]]), np.array([up, nowhere, up])))
    assert np.isnan(traced.origins).all()
    assert np.isnan(traced.directions).all()


# Prisms

ANGLES_DEG = (0.5, 3.0, 6.4, 10.0, 20.0)
INDICES = (1.33, 1.5168, 1.78)


@pytest.mark.parametrize("index", INDICES)
@pytest.mark.parametrize("apex_deg", ANGLES_DEG)
@pytest.mark.parametrize("facing", ["scene", "camera"])
def test_the_axis_is_deviated_as_the_closed_form_says(facing, apex_deg, index):
    apex = np.radians(apex_deg)
    deviation = {
        "scene": np.arcsin(index * np.sin(apex)) - apex,
        "camera": np.arcsin(index * np.sin(apex - np.arcsin(np.sin(apex) / index))),
    }[facing]
    for facets in (2, 3, 5):
        prism = Prism(facets, apex_deg, index, 60, facing=facing, azimuth_deg=17)
        for k, path in enumerate(prism.paths(587.5618)):
            azimuth = np.radians(17 + 360 * k / facets)
            if facing == "camera":
                azimuth = np.pi - azimuth  # turned about y
            towards = -np.sin(deviation) * np.array([np.cos(azimuth), np.sin(azimuth)])  # to the axis
            traced = path.unbounded().trace(AXIS).directions
            # 1e-12 rad: many roundings
            np.testing.assert_allclose(traced, [*towards, np.cos(deviation)], rtol=0, atol=1e-12)


@pytest.mark.parametrize("facets", [2, 3, 5])
def test_virtual_axes_cross_at_the_apex(facets):
    prism = Prism(facets, 10, 1.5168, 60, 8)
    for path in prism.paths(587.5618):
        axis = path.unbounded().trace(AXIS)
        # 1e-12: some roundings of 68 mm
        np.testing.assert_allclose(axis.origins, [0, 0, 68], rtol=0, atol=1e-12)


def test_the_deviation_of_a_thin_prism_is_that_of_the_textbook():
    # (n - 1) apex, wrong by about the third power of the angle (Hecht, Optics, section 5.5.1)
    apex = 1e-3
    direction = Prism(2, np.degrees(apex), 1.5168, 60).paths(587.5618)[0].trace(AXIS).directions
    assert -direction[0] == pytest.approx(0.5168 * apex, rel=2e-6)


def test_a_prism_in_water_has_its_relative_index():
    outside, inside = refractive_indices("N-BK7", "water", 587.5618)
    assert refractive_indices(1.3, "water", 587.5618) == (outside, 1.3 * outside)  # numbers: to the surroundings
    wet = Prism(3, 10, "N-BK7", 60, surroundings="water").paths(587.5618)
    dry = Prism(3, 10, inside / outside, 60).paths(587.5618)
    for path, same in zip(wet, dry, strict=True):
        # 1e-15: a rounding or two, since only ratios bend light
        np.testing.assert_allclose(path.trace(AXIS).directions, same.trace(AXIS).directions, atol=2e-15)


@pytest.mark.parametrize("name", OPTICS)
def test_an_optic_is_its_parameters(name):
    optic = OPTICS[name]
    values = optic.parameters(587.5618)
    assert values.shape == (len(optic.parameter_names),)
    copy = optic.with_parameters(values)
    rays = STRAIGHT.rays(random_pixels(SETUPS[f"{name}, straight lens"], 100))
    for path, same in zip(optic.paths(587.5618), copy.paths(587.5618), strict=True):
        ours, theirs = path.trace(rays), same.trace(rays)
        # 2e-13: degrees to radians and back, on lengths of 100 mm
        np.testing.assert_allclose(ours.origins, theirs.origins, rtol=0, atol=2e-13)
        np.testing.assert_allclose(ours.directions, theirs.directions, rtol=0, atol=2e-15)


# Mirrors


def mirrored_point(point, mirror):
    normal = unit(mirror.normal)
    return point - 2 * ((point - np.array(mirror.centre)) @ normal) * normal


LEFT = Mirror((-10, 3, 90), (1, 0.2, -1.5))
RIGHT = Mirror((80, 0, 60), (-1, 0.1, 0.2))


def test_rays_over_a_mirror_come_from_the_mirror_image_of_the_camera():
    image = mirrored_point(np.zeros(3), LEFT)
    path = only_path(Mirrors((LEFT,)))
    traced = path.trace(STRAIGHT.rays(random_pixels(SETUPS["prism, straight lens"], 200)))
    # 1e-12: some roundings of 200 mm
    np.testing.assert_allclose(np.cross(traced.origins - image, traced.directions), 0, atol=1e-12)
    assert path.mirrored


def test_two_mirrors_turn_the_camera_by_twice_the_angle_between_them():
    normals = unit([LEFT.normal, RIGHT.normal])
    first, second = (np.eye(3) - 2 * np.outer(n, n) for n in normals)
    turn = second @ first  # a rotation: about the line in which the mirrors meet
    centre = mirrored_point(mirrored_point(np.zeros(3), LEFT), RIGHT)
    path = only_path(Mirrors((LEFT, RIGHT), ((0, 1),)))
    rays = STRAIGHT.rays(random_pixels(SETUPS["prism, straight lens"], 200))
    traced = path.trace(rays)
    seen = np.isfinite(traced.directions).all(-1)
    assert seen.mean() > 0.9
    # 1e-12: some roundings of 200 mm; 1e-14: of directions
    np.testing.assert_allclose(np.cross(traced.origins - centre, traced.directions)[seen], 0, atol=1e-12)
    np.testing.assert_allclose(traced.directions[seen], rays.directions[seen] @ turn.T, atol=1e-14)
    assert np.trace(turn) == pytest.approx(1 + 2 * np.cos(2 * np.arccos(normals[0] @ normals[1])), abs=1e-14)
    assert not path.mirrored


def test_a_mirror_turns_about_its_own_axes():
    mirror = Mirror((0, 0, 100), (0, 0, -1), tilt_deg=(2.0, 0.0), advance=3.0)
    u, v, normal = mirror.axes()
    # the frame is right-handed with v to the bottom of the image; 1e-15: roundings
    np.testing.assert_allclose(np.cross(u, v), normal, atol=1e-15)
    np.testing.assert_allclose([v[1], -normal[2]], np.cos(np.radians(2)), atol=1e-15)
    traced = only_path(Mirrors((mirror,))).trace(AXIS)
    # the tilt turns the ray twice as far; the advance brings the mirror nearer by 3 / cos(tilt)
    assert np.arccos(-traced.directions[2]) == pytest.approx(np.radians(4), abs=1e-12)
    np.testing.assert_allclose(traced.origins, [0, 0, 100 - 3 / np.cos(np.radians(2))], atol=1e-12)


# Plates


@pytest.mark.parametrize("index", INDICES)
@pytest.mark.parametrize("tilt_deg", [0.0, 15.0, 45.0, 70.0])
def test_a_plate_shifts_a_ray_as_the_closed_form_says(tilt_deg, index):
    thickness, tilt = 12.0, np.radians(tilt_deg)
    traced = only_path(Plate(index, 50, thickness, tilt_deg=(tilt_deg, 0, 0))).trace(AXIS)
    # Hecht, Optics, problem 4.37: the displacement of a ray that crosses a plate
    shift = thickness * np.sin(tilt) * (1 - np.cos(tilt) / np.sqrt(index**2 - np.sin(tilt) ** 2))
    # 1e-12: many roundings
    np.testing.assert_allclose(traced.directions, [0, 0, 1], rtol=0, atol=1e-12)
    assert np.linalg.norm(traced.origins[:2]) == pytest.approx(shift, abs=1e-12)


def test_behind_a_port_the_glass_does_not_matter_to_the_direction(rng):
    directions = unit(rng.normal((0, 0, 3), size=(50, 3)))
    outside, water = refractive_indices("water", "air", 587.5618)
    # one refraction from air into water at the same tilt: 1e-14, some roundings
    path = only_path(Plate(1.7, 30, 8, tilt_deg=(5, -3, 0), beyond="water"))
    expected = refract(directions, path.interfaces[0].normal, outside, water)
    np.testing.assert_allclose(path.trace(Rays(np.zeros(3), directions)).directions, expected, atol=1e-14)
