"""Colours and warmth move pixels and depths as the renderer, closed forms and data sheets say."""

from dataclasses import replace

import numpy as np
import pytest
from setups import SETUPS

from benchmarks.data import renderer_setup
from cyclopean import Camera, Prism, Setup, triangulate
from cyclopean.analysis.chromatic import (
    chromatic_blur,
    chromatic_pixels,
    colour_bias,
    coloured,
    filter_advice,
    index_at,
    index_slope,
)
from cyclopean.analysis.sensitivity import point_sensitivity
from cyclopean.analysis.thermal import (
    THERMAL,
    ThermalData,
    depth_per_kelvin,
    index_per_kelvin,
    thermal_response,
    warmed,
)
from cyclopean.calibration.depths import working_volume
from cyclopean.errors import MediumError, SetupError
from cyclopean.optics import media, medium

CAMERA = Camera((2048, 1536), 25 / 0.0055)  # 25 mm before pixels of 5.5 um
BLUE, GREEN, RED = 486.1327, 587.5618, 656.2725  # F, d, C
SETUP = Setup(Camera((640, 480), 1200), Prism(3, 10, "N-BK7", distance=60, thickness=10))
POINTS = np.array([[0.0, 0.0, 400.0], [5.0, -4.0, 500.0], [0.0, 0.0, 700.0]])
MIRRORS = SETUPS["two mirrors, straight lens"]


def biprism(apex_deg):
    return Setup(CAMERA, Prism(2, apex_deg, "N-BK7", distance=100))


@pytest.mark.parametrize(("apex_deg", "printed"), [(3, 1.9), (6.4, 4.2), (10, 6.7), (15, 10.5), (20, 15.0)])
def test_spread_in_the_middle_is_focal_length_times_tangent_times_dispersion(apex_deg, printed):
    """Light of the axis meets the facet at alpha inside the glass, so d psi = -tan(alpha) dn before it."""
    setup = biprism(apex_deg)
    far = setup.rig()[0].unbounded().rays(CAMERA.centre).at_depth(1e7)
    pixels = chromatic_pixels(setup, far, [BLUE, RED])
    spread = np.linalg.norm(pixels[1, 0] - pixels[0, 0])
    glass = medium("N-BK7")
    dispersion = float(glass.index_in_air(BLUE) - glass.index_in_air(RED))
    expected = CAMERA.focal[0] * np.tan(np.deg2rad(apex_deg)) * dispersion
    np.testing.assert_allclose(spread, expected, rtol=0.01)  # second order of dn = 0.008
    # printed: the spread of the rays behind the prism, tan(alpha) becomes sin(alpha) / cos(what leaves the facet)
    leaves = np.arcsin(float(glass.index_in_air(GREEN)) * np.sin(np.deg2rad(apex_deg)))
    behind = CAMERA.focal[0] * np.sin(np.deg2rad(apex_deg)) / np.cos(leaves) * dispersion
    assert printed == pytest.approx(behind, rel=0.03)


@pytest.mark.parametrize(("low", "high", "printed"), [(440, 460, 1.5), (545, 555, 0.42), (640, 660, 0.53)])
def test_spread_of_narrow_bands(low, high, printed):
    setup = biprism(10)
    far = setup.rig()[0].unbounded().rays(CAMERA.centre).at_depth(1e7)
    pixels = chromatic_pixels(setup, far, [low, high])
    assert np.linalg.norm(pixels[1, 0] - pixels[0, 0]) == pytest.approx(printed, rel=0.05)  # printed to two figures


def test_colours_lie_where_the_renderer_put_them(mitsuba):
    corners = np.load(mitsuba / "calib_n3_chroma" / "corners.npz")
    through = corners["facet"] >= 0
    points, facet = corners["xyz_cam"][through], corners["facet"][through]
    setup = renderer_setup("n3")  # its index is a number, 1.5168
    pixels = chromatic_pixels(setup, points, [RED, GREEN, BLUE], glass="N-BK7")[np.arange(len(points)), :, facet]
    for colour, k in (("R", 0), ("B", 2)):
        true = corners[f"uv_{colour}"][through] - corners["uv_G"][through]
        assert np.abs(true).max() > 1.2  # px: there is something to explain
        # the renderer's indices are rounded to 1e-5: 0.002 px
        np.testing.assert_allclose(pixels[:, k] - pixels[:, 1], true, atol=0.004)


def test_depths_of_colours_are_those_of_the_renderer(mitsuba):
    """Corners in red and blue, triangulated by the setup for green, lie where `colour_bias` says."""
    corners = np.load(mitsuba / "calib_n3_chroma" / "corners.npz")
    setup = renderer_setup("n3")
    keys = np.stack([corners["view"], corners["corner_id"]], -1)
    every, row = np.unique(keys, axis=0, return_inverse=True)
    points = np.full((len(every), 3), np.nan)
    points[row] = corners["xyz_cam"]
    compared = 0
    for colour, nm in (("R", RED), ("B", BLUE)):
        pixels = np.full((len(every), 3, 2), np.nan)
        through = corners["facet"] >= 0
        pixels[row[through], corners["facet"][through]] = corners[f"uv_{colour}"][through]
        seen = np.isfinite(pixels).all(-1)
        both = seen.sum(-1) >= 2
        found = triangulate(setup.rig().unbounded(), pixels[both]).points
        bias = colour_bias(setup, points[both], [nm], seen=seen[both], glass="N-BK7")[:, 0]
        assert np.abs(bias[:, 2]).min() > 5  # mm: many times what is left
        np.testing.assert_allclose(found - points[both], bias, rtol=1e-3, atol=0.06)  # rounded indices
        compared += both.sum()
    assert compared > 300


def test_bias_of_colour_is_sensitivity_times_dispersion():
    near = GREEN + 1
    bias = colour_bias(SETUP, POINTS, [GREEN, near])
    np.testing.assert_allclose(bias[:, 0], 0, atol=1e-9)  # its own colour: no error
    first = point_sensitivity(SETUP, POINTS).shift({"optic.index": index_at(SETUP, near) - index_at(SETUP, GREEN)})
    np.testing.assert_allclose(bias[:, 1, 2], first[:, 2], rtol=2e-3)  # second order: 0.1 % of depth
    slope = index_slope(SETUP)
    assert slope < 0
    assert slope == pytest.approx(index_at(SETUP, near) - index_at(SETUP, GREEN), rel=0.02)


def test_an_index_takes_the_dispersion_of_a_named_glass():
    numbered = replace(SETUP, optic=replace(SETUP.optic, glass=1.5170))
    named = index_at(numbered, BLUE, "N-BK7")
    assert named - 1.5170 == pytest.approx(index_at(SETUP, BLUE) - index_at(SETUP, GREEN), abs=1e-12)
    with pytest.raises(MediumError, match="says nothing about other colours"):
        index_at(numbered, BLUE)


def test_advised_filters_reach_their_limits_and_blue_ones_are_narrower():
    volume = np.array([[0.0, 0.0, z] for z in (400.0, 500.0, 700.0)])
    advice = filter_advice(SETUP, volume, (450.0, 550.0, 650.0), blur=0.5, bias_percent=0.2)
    assert advice[0].width < advice[1].width < advice[2].width
    for row in advice:
        here = coloured(SETUP, row.centre_nm)
        here = replace(here, optic=replace(here.optic, glass=SETUP.optic.glass), wavelength_nm=row.centre_nm)
        half = row.width_for_blur / 2
        ends = chromatic_pixels(here, volume, [row.centre_nm - half, row.centre_nm + half])
        worst = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=-1).max()
        assert worst == pytest.approx(0.5, rel=0.02)  # pixels follow the index to first order
        half = row.width_for_bias / 2
        bias = colour_bias(here, volume, [row.centre_nm - half, row.centre_nm + half])[..., 2] / volume[:, None, 2]
        assert 100 * np.abs(bias).max() == pytest.approx(0.2, rel=0.02)


def test_blur_covers_the_sub_images_and_follows_the_band():
    blur = chromatic_blur(SETUP, (540, 560), 500, samples=12)
    assert blur.blur.shape == (3, 12, 12)
    for k, view in enumerate(SETUP.rig()):
        np.testing.assert_array_equal(np.isfinite(blur.blur[k]), view.region.contains(blur.pixels[k]))
    wide = chromatic_blur(SETUP, (530, 570), 500, samples=12)
    np.testing.assert_allclose(np.nanmean(wide.blur) / np.nanmean(blur.blur), 2, rtol=0.01)  # the index bends a little
    with pytest.raises(SetupError, match="shortest, longest"):
        chromatic_blur(SETUP, (560, 540), 500)


def test_mirrors_treat_all_colours_alike():
    assert coloured(MIRRORS, BLUE) is MIRRORS
    assert index_slope(MIRRORS) == 0
    advice = filter_advice(MIRRORS, POINTS, (450.0,))
    assert advice[0].width == np.inf


def test_glass_warms_as_its_data_sheet_says():
    """Schott's sheet of N-BK7 at 20 to 40 C: 1.1, 1.6, 2.1e-6 /K at 1060, 546.1 and 435.8 nm, absolute."""
    for nm, printed in ((1060.0, 1.1e-6), (546.07, 1.6e-6), (435.83, 2.1e-6)):
        assert index_per_kelvin("N-BK7", nm, temperature=30) == pytest.approx(printed, abs=0.06e-6)  # one digit
    # relative to air, printed 3.0e-6 at 546.1 nm: what bends light is the ratio
    setup = replace(SETUP, wavelength_nm=546.07)
    change = thermal_response(setup, temperature=30).total["optic.index"]
    assert change == pytest.approx(3.0e-6, abs=0.06e-6)


def test_every_glass_of_the_table_is_a_medium():
    assert set(THERMAL) <= set(media())


def test_bias_per_kelvin_is_that_of_a_warm_setup():
    response = thermal_response(SETUP, lens_per_kelvin=1e-5)
    assert set(response.causes) == {"camera", "mount", "size of the glass", "index of the glass", "index of air"}
    bias = depth_per_kelvin(SETUP, POINTS, response)
    np.testing.assert_allclose(sum(v for k, v in bias.items() if k != "all"), bias["all"], atol=1e-12)
    shifted = []
    for kelvin in (-1.0, 1.0):
        pixels = warmed(SETUP, kelvin, response).rig().unbounded().project(POINTS)
        shifted.append(triangulate(SETUP.rig().unbounded(), pixels).points[:, 2])
    np.testing.assert_allclose(bias["all"], (shifted[1] - shifted[0]) / 2, rtol=1e-4)  # of third order


@pytest.mark.parametrize("setup", [MIRRORS, SETUP], ids=["mirrors", "prism"])
def test_what_grows_evenly_only_changes_the_scale(setup):
    """All lengths grow by 1e-5 and no index changes: the scene seems smaller by as much."""
    grown = ThermalData((0.0,), 1e-5, "a glass whose index stays")
    response = thermal_response(setup, mount=1e-5, glass=None if setup is MIRRORS else grown)
    causes = {name: change for name, change in response.causes.items() if not name.startswith("index")}
    volume = working_volume(setup.rig(), [np.prod(setup.rig().working_depths) ** 0.5], 4)
    points = volume.points[volume.common]
    sensitivity = point_sensitivity(setup, points, seen=volume.seen[volume.common])
    shift = sum(sensitivity.shift(change) for change in causes.values())
    np.testing.assert_allclose(shift, -1e-5 * points, atol=1e-9)


def test_what_is_not_known_about_warmth_is_said():
    numbered = replace(SETUP, optic=replace(SETUP.optic, glass=1.5))
    unknown = thermal_response(numbered).unknown
    assert "how a glass given as a number answers to warmth" in unknown
    assert "the camera's own change with temperature" in unknown
    assert "optic.index" not in thermal_response(numbered).total
    for wrong, words in (
        ({"mount": "cheese"}, "aluminium"),
        ({"mount": 23.6}, "small number"),
        ({"lens_per_kelvin": 3.0}, "small"),
    ):
        with pytest.raises(SetupError, match=words):
            thermal_response(SETUP, **wrong)
