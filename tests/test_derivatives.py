"""Analytic derivatives against finite differences of high order."""

from dataclasses import replace

import numpy as np
import pytest
from setups import SETUPS, random_pixels

from cyclopean.cameras.camera import CAMERA_PARAMETERS
from cyclopean.rigs import View

# Central differences of 6th order (Fornberg 1988, table 1): error h^6 times the 7th derivative over 140
STENCIL = {-3: -1 / 60, -2: 3 / 20, -1: -3 / 4, 1: 3 / 4, 2: -3 / 20, 3: 1 / 60}
PIXEL_STEP, POINT_STEP = 0.5, 0.2  # px, mm
LENS_STEPS = np.array([1.0, 1.0, 0.5, 0.5, 3e-3, 3e-3, 3e-4, 3e-4, 3e-3])  # px, then k1 k2 p1 p2 k3
ANGLE_STEP, LENGTH_STEP, INDEX_STEP = 1e-3, 0.05, 1e-3  # rad, mm


def difference(values, step):
    """Derivative of values(offset) at 0."""
    return sum(weight * values(k * step) for k, weight in STENCIL.items()) / step


def optic_step(name):
    if name == "index":
        return INDEX_STEP
    lengths = ("shift", "distance", "thickness", "advance")
    return LENGTH_STEP if any(word in name for word in lengths) else ANGLE_STEP


def moved_view(setup, number, part, column, offset) -> View:
    """View `number` of the setup after one parameter of its "camera" or "optic" has moved, without bounds."""
    if part == "camera":
        values = setup.camera.lens.copy()
        values[column] += offset
        setup = replace(setup, camera=setup.camera.with_lens(values))
    else:
        values = setup.optic.parameters(setup.wavelength_nm)
        values[column] += offset
        setup = replace(setup, optic=setup.optic.with_parameters(values))
    path = setup.optic.paths(setup.wavelength_nm)[number]
    return View(setup.camera, path).unbounded()


def ray_numbers(view, pixels):
    rays = view.rays(pixels)
    return np.concatenate([rays.origins, rays.directions], -1)


def columns(setup):
    """Part, number and step of every parameter."""
    for column, step in enumerate(LENS_STEPS):
        yield "camera", column, step
    for column, name in enumerate(setup.optic.parameter_names):
        yield "optic", column, optic_step(name)


def assert_same(analytic, numeric, step):
    """Equal to 1e-8 of the largest, where differences end, and to roundings of 500 px or mm over the step."""
    np.testing.assert_allclose(analytic, numeric, rtol=0, atol=1e-8 * np.abs(numeric).max() + 1e-12 / step)


NAMES = [name for name in SETUPS if "bent" in name] + ["prism, straight lens"]
CASES = [(name, number) for name in NAMES for number in range(len(SETUPS[name].rig()))]


@pytest.fixture(params=CASES, ids=lambda case: f"{case[0]}, view {case[1]}")
def case(request):
    """A setup, the number of a view, the view without bounds, and a few of its pixels."""
    name, number = request.param
    setup = SETUPS[name]
    view = setup.rig()[number]
    pixels = random_pixels(setup, 60)
    pixels = pixels[np.isfinite(view.rays(pixels).directions).all(-1)][:5]
    assert len(pixels) == 5
    return setup, number, view.unbounded(), pixels


def test_ray_derivatives(case):
    setup, number, view, pixels = case
    found = view.ray_derivatives(pixels)
    np.testing.assert_array_equal(found.rays.origins, view.rays(pixels).origins)
    for axis in range(2):
        numeric = difference(lambda h, axis=axis: ray_numbers(view, pixels + h * np.eye(2)[axis]), PIXEL_STEP)
        for rows in (slice(3), slice(3, 6)):
            assert_same(found.to_pixel[:, rows, axis], numeric[:, rows], PIXEL_STEP)
    for part, column, step in columns(setup):
        numeric = difference(
            lambda h, part=part, column=column: ray_numbers(moved_view(setup, number, part, column, h), pixels), step
        )
        analytic = getattr(found, f"to_{part}")[..., column]
        for rows in (slice(3), slice(3, 6)):  # mm and rad
            assert_same(analytic[:, rows], numeric[:, rows], step)


def test_pixel_derivatives(case):
    setup, number, view, pixels = case
    points = view.rays(pixels).at(np.array([20.0, 60, 200, 400, 5000]))
    found = view.pixel_derivatives(points)
    # 1e-10 px: roundings
    np.testing.assert_allclose(found.pixels, pixels, rtol=0, atol=1e-10)
    for axis in range(3):
        numeric = difference(lambda h, axis=axis: view.project(points + h * np.eye(3)[axis]), POINT_STEP)
        assert_same(found.to_point[..., axis], numeric, POINT_STEP)
    for part, column, step in columns(setup):
        numeric = difference(
            lambda h, part=part, column=column: moved_view(setup, number, part, column, h).project(points), step
        )
        assert_same(getattr(found, f"to_{part}")[..., column], numeric, step)


def test_every_parameter_of_a_prism_moves_its_pixels():
    for name in ("prism, bent lens", "prism, facets to camera, bent lens"):
        setup = SETUPS[name]
        names = (*CAMERA_PARAMETERS, *setup.optic.parameter_names)
        assert setup.parameter_names[0] == "camera.focal_x"
        assert setup.parameter_names[-1] == "optic.index"
        view = setup.rig()[1]
        points = view.rays([view.region.centre]).at([300.0])
        derivatives = view.pixel_derivatives(points)
        moves = np.abs(np.concatenate([derivatives.to_camera, derivatives.to_optic], -1)).max((0, 1))
        assert moves.shape == (len(names),) == (len(setup.parameter_names),)
        still = {name for name, move in zip(names, moves, strict=True) if move == 0}
        # the other facets do nothing to this one
        assert still == {f"facet{k}_{part}" for k in (0, 2) for part in ("angle", "azimuth")}


@pytest.mark.parametrize("name", ["prism, bent lens", "two mirrors, bent lens", "plate, bent lens"])
def test_what_is_not_seen_has_no_derivatives(name):
    view = SETUPS[name].rig()[0]
    pixels = np.array([[np.nan, 5], [-3000, 240], view.region.centre])
    points = np.concatenate([[[0, np.nan, 300], [0, 0, -50]], view.rays(view.region.centre[None]).at([300.0])])
    by_pixel, by_point = view.ray_derivatives(pixels), view.pixel_derivatives(points)
    for values in (by_pixel.to_pixel, by_pixel.to_camera, by_pixel.to_optic):
        np.testing.assert_array_equal(np.isnan(values).all((-2, -1)), [True, True, False])
    for values in (by_point.to_point, by_point.to_camera, by_point.to_optic):
        np.testing.assert_array_equal(np.isnan(values).all((-2, -1)), [True, True, False])
