"""Optics that cannot be, and setups without light, say what came and what to try."""

import numpy as np
import pytest

from cyclopean import Camera, Mirror, Mirrors, Plate, Prism, Setup
from cyclopean.errors import MediumError, OpticError

LEFT = Mirror((-10, 3, 90), (1, 0.2, -1.5))
RIGHT = Mirror((80, 0, 60), (-1, 0.1, 0.2))


def biprism(**changes):
    return Prism(**{"facets": 2, "apex_deg": 10, "glass": 1.5168, "distance": 60, **changes})


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"facets": 1}, "2 facets or more .* got facets=1"),
        ({"facets": 2.5}, "2 facets or more .* got facets=2.5"),
        ({"facets": np.nan}, "2 facets or more .* got facets=nan"),
        ({"apex_deg": 0}, "apex_deg must lie between 0 and 90, got 0"),
        ({"apex_deg": np.nan}, "apex_deg must lie between 0 and 90, got nan"),
        ({"distance": -5}, "distance must be a positive number of mm, got -5"),
        ({"distance": np.inf}, "distance must be a positive number of mm, got inf"),
        ({"thickness": np.nan}, "thickness must be a positive number of mm, got nan"),
        ({"facing": "left"}, "facing must be 'scene' or 'camera', got 'left'"),
        ({"radius": -3}, "radius must be a positive number of mm, or None .* got -3"),
        ({"radius": np.nan}, "radius must be a positive number of mm, or None .* got nan"),
        ({"radius": 70}, r"facets cross inside the glass: .*apex_deg=10 .*thickness at least 12.34 mm"),
        ({"azimuth_deg": np.nan}, "got .*nan.* look at facet_deviation_deg and azimuth_deg"),
        ({"facet_deviation_deg": ((-11, 0), (0, 0))}, r"0 to 90 degrees to the flat face.* got \[-1. 10.\]"),
        ({"facet_deviation_deg": ((1, 0),)}, r"one \(angle, azimuth\) pair for each of the 2 facets, got shape \(1, 2"),
        ({"tilt_deg": (np.nan, 0, 0)}, "tilt_deg must be 3 numbers, got"),
        ({"tilt_deg": (1, 2)}, "tilt_deg must be 3 numbers, got"),
        ({"shift": (np.inf, 0)}, "shift must be 2 numbers, got"),
    ],
)
def test_prisms_that_cannot_be_say_what_came(changes, message):
    with pytest.raises(OpticError, match=message):
        biprism(**changes)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"apex_deg": 42}, "totally reflected: apex_deg=42 .* below 41.25 degrees"),  # asin(1 / 1.5168)
        # n sin(apex - asin(sin(apex) / n)) = 1.05
        ({"apex_deg": 85, "facing": "camera"}, "totally reflected: apex_deg=85 .* make it smaller"),
        ({"glass": 1.0}, "bends no light: its index is that of its surroundings"),
        ({"glass": "water", "surroundings": "water"}, "bends no light: its index is that of its surroundings"),
    ],
)
def test_prisms_that_split_no_picture_are_refused(changes, message):
    with pytest.raises(OpticError, match=message):
        biprism(**changes).paths(587.5618)


def test_the_limit_of_total_reflection_is_where_the_message_says():
    limit = np.degrees(np.arcsin(1 / 1.5168))
    assert len(biprism(apex_deg=limit - 0.01).paths(587.5618)) == 2
    with pytest.raises(OpticError, match=f"below {limit:.2f} degrees"):
        biprism(apex_deg=limit + 0.01).paths(587.5618)


@pytest.mark.parametrize("make", [lambda **k: biprism(**k), lambda **k: Plate(distance=50, thickness=10, **k)])
def test_unknown_media_are_named_when_the_optic_is_made(make):
    with pytest.raises(MediumError, match="unknown medium 'NBK8'; the closest names are N-BK7"):
        make(glass="NBK8")
    with pytest.raises(MediumError, match="between 1 and 5, got nan"):
        make(glass=np.nan)
    with pytest.raises(MediumError, match="unknown medium 'see'"):
        make(glass=1.5, surroundings="see")


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"distance": 0}, "distance must be a positive number of mm, got 0"),
        ({"thickness": np.nan}, "thickness must be a positive number of mm, got nan"),
        ({"radius": np.nan}, "radius must be a positive number of mm, got nan"),
        ({"tilt_deg": (0, 0, np.nan)}, "tilt_deg must be 3 numbers, got"),
    ],
)
def test_plates_that_cannot_be_say_what_came(changes, message):
    with pytest.raises(OpticError, match=message):
        Plate(**{"glass": 1.5, "distance": 50, "thickness": 10, **changes})


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"normal": (0, 0, 0)}, r"normal must be a direction, three numbers, got \(0, 0, 0\)"),
        ({"normal": (1, 0)}, r"normal must be a direction, three numbers, got \(1, 0\)"),
        ({"centre": (0, np.nan, 0)}, "centre must be three numbers of mm, got"),
        ({"size": (5, 0)}, r"size must be two positive numbers of mm, got \(5, 0\)"),
        ({"size": (np.nan, 5)}, "size must be two positive numbers of mm, got"),
        ({"tilt_deg": (np.nan, 0)}, "corrections are two tilts and an advance, got"),
        ({"advance": np.nan}, "corrections are two tilts and an advance, got .* nan mm"),
    ],
)
def test_mirrors_that_cannot_be_say_what_came(changes, message):
    with pytest.raises(OpticError, match=message):
        Mirror(**{"centre": (0, 0, 100), "normal": (0, 0, 1), **changes})


@pytest.mark.parametrize(
    ("mirrors", "sequences", "message"),
    [
        ((), None, "at least one mirror"),
        ((LEFT,), ((1,),), r"numbers 0 to 0, got \(1,\)"),
        ((LEFT,), ((0,), ()), r"numbers 0 to 0, got \(\)"),
        ((LEFT, RIGHT), ((0, 1, 1),), r"twice in a row, got \(0, 1, 1\)"),
    ],
)
def test_sequences_that_cannot_be_say_what_came(mirrors, sequences, message):
    with pytest.raises(OpticError, match=message):
        Mirrors(mirrors, sequences)


@pytest.mark.parametrize(
    ("optic", "message"),
    [
        (Mirrors((Mirror((0, 0, -100), (0, 0, 1)),)), "through mirror 0; .* never meets the surface .100 %"),
        (Plate(1.5, 50, 10, radius=0.01), "through plate; .* outside the outline of the optic .100 %"),
        (Plate(1.5, 50, 10, tilt_deg=(80, 0, 0), surroundings="water", beyond="air"), "totally reflected"),
    ],
)
def test_a_setup_without_light_says_why(optic, message):
    with pytest.raises(OpticError, match=f"no light reaches the camera.*{message}"):
        Setup(Camera((640, 480), 2400), optic).rig()
