"""Stock angles against Snell's law, grades of tolerances against each other and against the error budget."""

import numpy as np
import pytest

from cyclopean import Camera, Prism, Setup
from cyclopean.analysis import usual_tolerances
from cyclopean.design.catalogue import (
    GLASSES,
    GRADES,
    HELIUM_NEON_NM,
    glass_fact,
    grade,
    stock_angles_deg,
    stock_wedges,
    tolerance_grade,
)
from cyclopean.errors import SetupError
from cyclopean.optics import medium

CAMERA = Camera((320, 240), 1000.0)


def setup_of(glass="N-BK7", facets=3):
    return Setup(CAMERA, Prism(facets, 8.0, glass, 150.0))


@pytest.mark.parametrize("wedge", stock_wedges(), ids=lambda wedge: f"{wedge.glass} {wedge.deviation_deg:g}")
def test_stock_wedges_bend_light_as_they_say(wedge):
    setup = Setup(CAMERA, Prism(2, wedge.angle_deg, wedge.glass, 100.0), wavelength_nm=HELIUM_NEON_NM)
    axis = setup.rig()[0].unbounded().rays(np.array(CAMERA.centre)).directions
    # 0.005 deg: the angle is rounded to 0.01 deg, and light is bent by half of it
    assert np.degrees(np.arccos(axis[2])) == pytest.approx(wedge.deviation_deg, abs=0.005)


def test_stock_angles_are_those_of_the_glasses_named():
    assert set(stock_angles_deg(("BK7",))) == {w.angle_deg for w in stock_wedges() if w.glass == "N-BK7"}
    assert len(stock_angles_deg()) > len(stock_angles_deg(("N-BK7",)))
    with pytest.raises(SetupError, match="not kept in stock"):
        stock_wedges(("PMMA",))


def test_the_usual_grade_is_the_error_budget():
    setup = setup_of()
    assert grade("usual", setup) == usual_tolerances(setup)


@pytest.mark.parametrize("name", [name for name in GRADES if name != "usual"])
def test_grades_speak_of_all_that_the_budget_does(name):
    setup = setup_of()
    found = {tolerance.name: tolerance for tolerance in grade(name, setup)}
    assert set(found) == {tolerance.name for tolerance in usual_tolerances(setup)}
    assert all(found[key].size > 0 for key in found)
    for limit in GRADES[name].limits:  # a limit holds all that is drawn
        drawn = [t for key, t in found.items() if key.startswith("optic.") and t.size == limit.size]
        assert drawn, limit.what
        assert np.abs(drawn[0].draw(np.random.default_rng(1), 1000)).max() <= limit.size


def test_better_grades_are_finer_in_everything():
    setup = setup_of()
    rough, fine, finest = ({t.name: t.sigma for t in grade(n, setup)} for n in ("commercial", "precision", "high"))
    for name in (name for name in rough if name.startswith("optic.")):
        assert rough[name] > fine[name] > finest[name]
    costs = [GRADES[name].cost for name in ("commercial", "precision", "high")]
    assert costs == sorted(costs)


def test_melt_data_of_glass_are_none_of_plastic():
    for name in ("precision", "high"):
        glass, plastic = (
            {t.name: t.size for t in grade(name, setup_of(material))}["optic.index"] for material in ("N-BK7", "PMMA")
        )
        assert glass < plastic == 0.001  # sheets of PMMA differ by 0.001 (Beadie et al. 2015)


def test_every_limit_and_glass_has_a_source():
    for name, found in GRADES.items():
        assert all(limit.source for limit in found.limits), name
        assert len(found.lines) == len(found.limits)
    for fact in GLASSES:
        assert fact.source
        assert fact.name == medium(fact.name).name
        assert fact.index == pytest.approx(float(medium(fact.name).index_in_air(587.5618)))
    assert glass_fact("acrylic").name == "PMMA"
    assert glass_fact("water") is None


def test_an_unknown_grade_names_those_there_are():
    with pytest.raises(SetupError, match="usual, commercial, precision, high"):
        tolerance_grade("cheap")
