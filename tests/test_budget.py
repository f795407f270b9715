"""The error budget adds up, and to what samples of real setups show."""

from dataclasses import replace

import numpy as np
import pytest
from setups import SETUPS

from cyclopean import Camera, Prism, Setup, triangulate
from cyclopean.analysis.budget import error_budget, source_of, standard_tolerances
from cyclopean.errors import SetupError, ShapeError
from cyclopean.plotting.errors import budget_picture, error_maps

SETUP = Setup(Camera((640, 480), 1200), Prism(3, 10, "N-BK7", distance=60, thickness=10))
DEPTHS = [400.0, 600.0, 900.0]
QUIET = {"temperature_range": 0.0, "samples": 8}


def test_shares_add_up_and_come_sorted():
    budget = error_budget(SETUP, DEPTHS, samples=8)
    for k in range(3):
        *rows, total = budget.table(k)
        shares = [row.share for row in rows]
        assert shares == sorted(shares, reverse=True)
        assert sum(shares) == pytest.approx(1, abs=1e-12)
        assert total.sigma == pytest.approx(np.nanmedian(budget.total[k]))
        assert total.worst == pytest.approx(np.nanmax(budget.total[k]))
    variance = sum(source.sigma**2 for source in budget.sources)
    np.testing.assert_allclose(budget.total**2, variance, rtol=1e-12)
    names = {source.name for source in budget.sources}
    assert {"glass index", "apex angle", "pixel noise", "temperature", "wavelength", "focal length"} <= names


def test_every_parameter_has_a_row():
    mirrors = SETUPS["two mirrors, straight lens"]
    for setup in (SETUP, mirrors):
        assert all(source_of(name) != name for name in setup.parameter_names)


def test_budget_is_the_spread_of_real_setups():
    """400 setups drawn from the tolerances, traced, and triangulated by the believed one with noise."""
    tolerances = {
        "optic.apex": 2e-4,
        "optic.index": 3e-4,
        "optic.distance": 0.3,
        "optic.facet1_angle": 2e-4,
        "camera.focal": 1.0,
    }
    others = dict.fromkeys(standard_tolerances(SETUP), 0.0)
    budget = error_budget(SETUP, [500.0], tolerances=others | tolerances, sigma=0.2, **QUIET)
    sources = [source for source in budget.sources if source.name != "wavelength"]
    place = np.argmin(np.linalg.norm(np.nan_to_num(budget.volume.points[0, ..., :2], nan=1e3), axis=-1))
    point = budget.volume.points[0].reshape(-1, 3)[place]
    seen = budget.volume.seen[0].reshape(-1, 3)[place]
    expected = np.sqrt(sum(source.sigma[0].flat[place] ** 2 for source in sources))
    rng = np.random.default_rng(5)
    values, names = SETUP.optic.parameters(SETUP.wavelength_nm), SETUP.optic.parameter_names
    sigmas = np.array([tolerances.get(f"optic.{name}", 0.0) for name in names])
    pixels = []
    for _ in range(400):
        camera = replace(SETUP.camera, focal=tuple(np.add(SETUP.camera.focal, rng.normal() * 1.0)))
        real = replace(SETUP, camera=camera, optic=SETUP.optic.with_parameters(values + rng.normal(0, sigmas)))
        pixels.append(real.rig().unbounded().project(point) + rng.normal(0, 0.2, (3, 2)))
    pixels = np.where(seen[:, None], np.array(pixels), np.nan)
    found = triangulate(SETUP.rig().unbounded(), pixels).points[:, 2]
    assert found.std() == pytest.approx(expected, rel=0.11)  # of 400 samples: 3.5 % is one sigma
    assert abs(found.mean() - point[2]) < 4 * expected / 20


def test_noise_grows_with_the_square_of_depth_from_where_the_camera_appears():
    budget = error_budget(SETUP, DEPTHS, sigma=0.1, **QUIET)
    noise = next(source for source in budget.sources if source.name == "pixel noise")
    middle = np.array([np.nanmin(noise.sigma[k]) for k in range(3)])
    z = np.array(DEPTHS) - 10 * (1 - 1 / 1.5168)
    np.testing.assert_allclose(middle / middle[0], (z / z[0]) ** 2, rtol=0.02)  # points are not all on the axis


def test_given_tolerances_replace_the_usual_and_zero_leaves_out():
    usual = error_budget(SETUP, DEPTHS, **QUIET)
    other = error_budget(SETUP, DEPTHS, tolerances={"optic.index": 0.001, "optic.facets": 0.0}, **QUIET)
    by_name = {s.name: s for s in usual.sources}, {s.name: s for s in other.sources}
    np.testing.assert_allclose(by_name[1]["glass index"].sigma, 2 * by_name[0]["glass index"].sigma)
    assert "facet angles" in by_name[0]
    assert "facet angles" not in by_name[1]
    assert by_name[1]["glass index"].size == "0.001"
    assert by_name[0]["apex angle"].size == "1 arcmin"


def test_ranges_are_rectangular():
    warm = error_budget(SETUP, DEPTHS, temperature_range=6.0, samples=8)
    kelvin = next(source for source in warm.sources if source.name == "temperature").shifts
    bias = warm.sensitivity.shift(warm.warmth.total)
    np.testing.assert_allclose(kelvin[..., 0], bias * 6 / np.sqrt(3), rtol=1e-12)
    wide, narrow = (
        next(s for s in error_budget(SETUP, DEPTHS, band=band, **QUIET).sources if s.name == "wavelength").sigma
        for band in ((577.5618, 597.5618), (582.5618, 592.5618))
    )
    np.testing.assert_allclose(wide, 2 * narrow, rtol=2e-3)  # the index is nearly straight over 20 nm


def test_independent_calibration_is_the_same_as_tolerances():
    names = ["optic.apex", "optic.index", "optic.distance"]
    sigmas = np.array([2e-4, 3e-4, 0.2])
    calibrated = error_budget(SETUP, DEPTHS, covariance=(names, np.diag(sigmas**2)), **QUIET)
    others = dict.fromkeys(standard_tolerances(SETUP), 0.0)
    drawn = error_budget(SETUP, DEPTHS, tolerances=others | dict(zip(names, sigmas, strict=True)), **QUIET)
    np.testing.assert_allclose(calibrated.total, drawn.total, rtol=1e-9)
    assert calibrated.within["correlations"] == pytest.approx(0, abs=1e-9)
    assert sum(calibrated.within.values()) == pytest.approx(1)


def test_correlations_count():
    """An angle and an index that make up for each other leave depth alone, though each is badly known."""
    names = ["optic.apex", "optic.index"]
    one = error_budget(SETUP, [600.0], covariance=(names, np.diag([1e-8, 1e-8])), **QUIET)
    k = [SETUP.parameter_names.index(name) for name in names]
    apex, index = np.nanmedian(one.sensitivity.depth[0].reshape(-1, len(SETUP.parameter_names)), axis=0)[k]
    direction = np.array([index, -apex]) * 1e-6
    tied = error_budget(SETUP, [600.0], covariance=(names, np.outer(direction, direction)), **QUIET)
    calibration = next(source for source in tied.sources if source.name == "calibration")
    alone = np.abs(tied.sensitivity.depth[0][..., k[0]] * direction[0])
    assert np.nanmax(calibration.sigma[0]) < 0.02 * np.nanmin(alone)  # not all: they differ a little over the field
    assert tied.within["correlations"] < -100
    assert any("calibration held" in note for note in tied.notes)


def test_free_focal_and_coloured_indices_are_understood():
    names = ["camera.focal_tied", "optic.index[1]"]
    budget = error_budget(SETUP, [600.0], covariance=(names, np.diag([0.5**2, 0.0])), **QUIET)
    calibration = next(source for source in budget.sources if source.name == "calibration")
    expected = budget.sensitivity.shift({"camera.focal_x": 0.5, "camera.focal_y": 0.5})[..., 2]
    np.testing.assert_allclose(calibration.sigma, np.abs(expected), rtol=1e-9)


def test_what_is_left_out_is_said():
    numbered = replace(SETUP, optic=replace(SETUP.optic, glass=1.5168))
    budget = error_budget(numbered, [600.0], samples=6)
    assert "wavelength" not in {source.name for source in budget.sources}
    notes = " ".join(budget.notes)
    assert "says nothing about other colours" in notes
    assert "a glass given as a number" in notes
    named = error_budget(numbered, [600.0], glass="N-BK7", samples=6)
    assert "wavelength" in {source.name for source in named.sources}
    off = error_budget(SETUP, [600.0], band=(440.0, 460.0), samples=6)
    assert any("the middle of the band is 450 nm" in note for note in off.notes)


def test_mirrors_have_neither_glass_nor_colour():
    mirrors = SETUPS["two mirrors, straight lens"]
    budget = error_budget(mirrors, samples=6)
    names = {source.name for source in budget.sources}
    assert {"mirror tilts", "mirror positions", "temperature"} <= names
    assert not names & {"glass index", "wavelength", "apex angle"}


@pytest.mark.parametrize(
    ("wrong", "words"),
    [
        ({"sigma": 0.0}, "pixel noise"),
        ({"sigma": np.nan}, "pixel noise"),
        ({"temperature_range": -1.0}, "half width"),
        ({"tolerances": {"optic.apex": -1.0}}, "standard deviation"),
        ({"tolerances": {"optic.apx": 1.0}}, "did you mean"),
        ({"band": (560.0, 540.0)}, "shortest, longest"),
        ({"depths": [20.0]}, "no two views share"),
        ({"covariance": (["optic.apex"], np.diag([-1.0]))}, "negative eigenvalue"),
        ({"covariance": (["optic.colour"], np.eye(1))}, "no parameter"),
        ({"glass": "unobtainium"}, "unknown medium"),
    ],
)
def test_wrong_calls_say_what_was_wanted(wrong, words):
    with pytest.raises((SetupError, ValueError), match=words):
        error_budget(SETUP, **({"depths": [600.0], "samples": 4} | wrong))


def test_a_covariance_of_the_wrong_size_is_refused():
    with pytest.raises(ShapeError, match=r"\(2, 2\)"):
        error_budget(SETUP, [600.0], covariance=(["optic.apex", "optic.index"], np.eye(3)), samples=4)


def test_pictures_show_every_source():
    budget = error_budget(SETUP, DEPTHS, samples=6)
    picture = budget_picture(budget)
    labels = [text.get_text().split("\n")[0] for text in picture.axes[0].get_yticklabels()]
    assert labels[0] == "all together"
    assert labels[1:] == [row.name for row in budget.table()[:-1]]
    assert any("all together" in axes.get_title() for axes in error_maps(budget).axes)
    assert budget_picture(error_budget(SETUP, [600.0], samples=6)).axes  # one depth has no curve over depth
