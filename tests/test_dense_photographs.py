"""Faults of photographs that dense matching must put up with, and how far its stated sigma can be trusted.

Limits are what one who measures would ask; `dense_scenes.py` says what counts as wrong.
"""

import numpy as np
import pytest
from dense_scenes import Look, found_on, look, rig_of, sensitivity, shaded, share, slope
from scipy.ndimage import gaussian_filter

from benchmarks.synthetic import (
    DEPTHS,
    Plane,
    colourful,
    fading,
    prism_rig,
    quantised,
    seam_distance,
    take,
    texture,
)
from cyclopean import medium, reconstruct

# ---- the photograph has faults -----------------------------------------------------------------------------------


@pytest.mark.parametrize("facets", [2, 3])
def test_a_blend_band_gives_no_wrong_depth(facets):
    # an open aperture: 8 px of both sub-images, mixed, of which the mask leaves out only 1.5 on each side
    shot = take(rig_of(facets), Plane(800, texture(800), slope=0.2), blend=8.0)
    found = look(shot, shot.light)
    band = (np.abs(seam_distance(shot.rig)).min(axis=0) < 4) & shot.rig.masks.any(0)
    assert found.wrong(band) <= 0.02
    sharp = shot.common & ~band
    assert found.known(sharp) >= found_on(facets).known(sharp) - 0.02
    assert found.wrong(sharp) <= 0.002


def spoiled(light, rig, view, how, seed=4):
    """The picture with one sub-image white or black, with what noise leaves there."""
    level = {"white": 260.0, "black": -1.0}[how]
    noise = np.random.default_rng(seed).normal(0, 2, light.shape)
    return np.where(rig[view].region.traced, level + noise, light)


@pytest.mark.parametrize(("facets", "how"), [(2, "black"), (3, "white")])
def test_a_white_or_black_sub_image_has_no_depth(facets, how):
    shot = slope(facets)
    found = look(shot, spoiled(shot.light, shot.rig, 1, how))
    # half a grey level of rounding is left in the black one, and what clips in the white one
    assert found.known(shot.rig[1].region.mask) <= 0.002
    others = np.delete(shot.views[1], 1, axis=0).sum(axis=0) > 1
    others &= ~shot.rig[1].region.mask
    if facets == 2:
        assert not others.any()
        assert not found.there.any()
    else:
        assert found.known(others) >= 0.95
        assert found.wrong(others) <= 0.002


def test_one_white_and_one_black_sub_image_leave_the_other_two():
    shot = slope(4)
    light = spoiled(spoiled(shot.light, shot.rig, 0, "white"), shot.rig, 1, "black")
    found = look(shot, light)
    assert found.known(shot.rig.masks[:2].any(0)) <= 0.002
    both = shot.views[1][2] & shot.views[1][3] & shot.rig.masks[2:].any(0)
    assert found.known(both) >= 0.95
    assert found.wrong(both) <= 0.002


@pytest.mark.parametrize(("gain", "offset"), [(0.7, 0), (0.7, 25)])
def test_a_darker_sub_image_matches_as_well(gain, offset):
    shot, usual = slope(3), found_on(3)
    light = np.where(shot.rig[1].region.traced, gain * shot.light + offset, shot.light)
    found = look(shot, light)
    assert found.known(shot.common) >= usual.known(shot.common) - 0.02
    assert found.wrong(shot.common) <= usual.wrong(shot.common) + 0.002
    # rounding weighs 1 / 0.7 times as much in one of two views: sqrt((1 + 2) / 2) = 1.2 times the noise
    assert found.median(shot.common) <= 1.3 * usual.median(shot.common)


def test_a_sub_image_out_of_focus_costs_accuracy_but_no_depth():
    shot, usual = slope(3), found_on(3)
    light = np.where(shot.rig[1].region.traced, gaussian_filter(shot.light, 1.0), shot.light)
    found = look(shot, light, 1)
    assert found.known(shot.common) >= usual.known(shot.common) - 0.1
    assert found.wrong(shot.common) <= 0.002


def test_uneven_light_within_sub_images_does_not_matter():
    shot, usual = slope(3), found_on(3)
    found = look(shot, shaded(shot.light))
    assert found.known(shot.common) >= usual.known(shot.common) - 0.02
    assert found.wrong(shot.common) <= usual.wrong(shot.common) + 0.002
    # a gain that changes within a window is not taken out: a hundredth of a px is left
    assert found.median(shot.common) <= max(1.3 * usual.median(shot.common), 0.012)


@pytest.mark.parametrize(("facets", "flaw"), [(2, "dust"), (3, "glare")])
def test_glare_or_dust_on_one_view_gives_no_wrong_depth(facets, flaw):
    shot = slope(facets)
    height, width = shot.depth.shape
    x, y = np.meshgrid(np.arange(width), np.arange(height))
    centre = {2: (215, 120), 3: (215, 80)}[facets]  # in one view, where others see the same points
    spot = gaussian_filter((np.hypot(x - centre[0], y - centre[1]) < 10).astype(float), 1.5)
    light = shot.light + 400 * spot if flaw == "glare" else shot.light * (1 - 0.7 * spot)
    found = look(shot, light, 1)
    assert found.wrong(np.isfinite(shot.depth)) <= 0.0005  # of all: a tenth of the spot
    if flaw == "glare":
        assert found.known(np.hypot(x - centre[0], y - centre[1]) < 6) <= 0.02  # white: nothing to match
    if facets == 3:  # the point of a pixel that the spot hides in one view is seen by a third
        clear = (shot.views[1].sum(axis=0) == 3) & (spot < 0.01)
        assert found.known(clear) >= 0.95


def test_a_bright_rim_along_the_seam_gives_no_wrong_depth():
    # edges of facets shine: a line 1 px wide, 3 px inside each view, the same in all of them
    shot = slope(3)
    border = seam_distance(shot.rig).max(axis=0)
    light = np.where(np.abs(border - 3) < 0.5, 250.0, shot.light)
    found = look(shot, light, 1)
    assert found.wrong(shot.rig.masks.any(0) & (border < 12)) <= 0.02
    assert found.wrong(shot.common & (border >= 12)) <= 0.002


# ---- colour, and numbers of other kinds -------------------------------------------------------------------------


RED_GREEN_BLUE_NM = (610.0, 540.0, 465.0)  # middle of what a colour camera's filters let through


def colour_shift(colours, shot):
    """How far (px) the matches of the channels lie from green's, at the most."""
    green, shifts = colours[1].unbounded(), []
    for colour in colours:
        other = colour.unbounded()
        for own, view in enumerate(shot.rig):
            rows, columns = (index[::97] for index in np.nonzero(view.region.mask))
            pixels, depth = np.stack([columns, rows], -1), shot.depth[rows, columns]
            matches = [rig.project(rig[own].rays(pixels).at_depth(depth)) for rig in (other, green)]
            shifts.append(np.linalg.norm(matches[0] - matches[1], axis=-1).max())
    return max(shifts)


@pytest.mark.parametrize(("glass", "apex_deg", "paint"), [("N-BK7", 12, colourful), ("N-SF11", 8, texture)])
def test_dispersion_that_nobody_states_gives_no_depth_beyond_its_own(glass, apex_deg, paint):
    # the glass is stated by its index in green light alone
    indices = [float(medium(glass).index(nm)) for nm in RED_GREEN_BLUE_NM]
    colours = [prism_rig(3, azimuth_deg=90, glass=index, apex_deg=apex_deg) for index in indices]
    shot = take(colours[1], Plane(800, paint(800)), colours=colours)
    found = look(shot, shot.light, 1)
    # between the matches of its channels there is nothing to choose; a quarter of a px for matching itself
    shift = colour_shift(colours, shot)
    assert 0.5 < shift < 3
    assert found.wrong(shot.common, by=shift + 0.25) <= 0.005


def test_texture_of_colour_alone_is_texture():
    # red changes against green, and their mean stays the same grey
    def paint(x, y):
        change = texture(800)(x, y) - 128
        return 128 + np.stack([change, -change, 0 * change], axis=-1)

    shot = take(rig_of(3), Plane(800, paint))
    found = look(shot, shot.light, 1)
    assert found.known(shot.common) >= 0.9
    assert found.wrong(shot.common) <= 0.01


KINDS = {
    "12 of 16 bits": lambda grey: (grey.astype(np.uint16) * 16).astype(np.uint16),
    "real, up to 1": lambda grey: (grey / 255).astype(np.float32),
    "one channel": lambda grey: grey[..., None],
    "three alike": lambda grey: np.repeat(grey[..., None], 3, axis=-1),
}


@pytest.mark.parametrize("kind", KINDS)
def test_every_kind_of_number_gives_the_same_depth(kind):
    shot, usual = slope(2), found_on(2)
    found = Look(shot, reconstruct(KINDS[kind](quantised(shot.light)), shot.rig, DEPTHS))
    # what decides whether there is depth is in grey levels, and white is found to within a bit
    assert share(found.there ^ usual.there, shot.common) <= 0.02
    both = shot.common & found.there & usual.there
    change = np.abs(1 / found.found.depth - 1 / usual.found.depth)[both] * sensitivity(shot.rig)
    assert np.percentile(change, 99) < 0.05  # px; rounding to 8 bits alone makes errors of about 0.01 px


# ---- sigma -----------------------------------------------------------------------------------------------------


# grey levels of noise: least share with depth, most share wrong, most share off by more than 1 %
NOISES = {0: (0.97, 0.001, 0.002), 5: (0.96, 0.001, 0.01), 10: (0.93, 0.005, 0.1)}


@pytest.mark.parametrize(("facets", "noise"), [(2, 0), (2, 5), (2, 10), (3, 0), (3, 5)])
def test_noise_widens_sigma_as_it_widens_errors(facets, noise):
    shot, (complete, most_wrong, most_bad) = slope(facets), NOISES[noise]
    found = look(shot, shot.light, noise)
    assert found.known(shot.common) >= complete
    assert found.wrong(shot.common) <= most_wrong
    assert found.bad(shot.common) <= most_bad
    deep = shot.common & (seam_distance(shot.rig).max(axis=0) > 8)
    assert 0.7 < found.sigma(deep).ratio < 1.4
    for where in (deep, shot.common):
        assert found.sigma(where).shares[2] >= 0.97  # within 3 sigma; 99.7 % of a normal distribution


@pytest.mark.parametrize("grain", [2.0, 4.0])
def test_soft_texture_has_its_own_sigma(grain):
    shot = take(rig_of(2), Plane(800, texture(800, grain=grain), slope=0.2))
    found = look(shot, shot.light, 2)
    assert found.known(shot.common) >= {2.0: 0.95, 4.0: 0.7}[grain]
    assert found.wrong(shot.common) <= 0.005
    assert 0.7 < found.sigma(shot.common).ratio < 1.4


def test_faint_texture_in_noise_is_left_out_or_right():
    # as much noise as texture: few windows can tell, and those that speak should know how well
    shot = take(rig_of(2), Plane(800, texture(800, contrast=4)))
    found = look(shot, shot.light, 4)
    assert found.wrong(shot.common) <= 0.02
    if (shot.common & found.there).sum() > 500:
        assert 0.6 < found.sigma(shot.common).ratio < 1.6


def test_sigma_follows_the_contrast():
    shot = take(rig_of(2), Plane(800, fading(800, 160.0)))
    found = look(shot, shot.light, 3)
    judged = found.sigma(shot.common, bins=4)
    assert judged.stated[-1] > 3 * judged.stated[0]  # else this says nothing
    assert (np.diff(judged.spread) > 0).all()
    ratio = judged.spread / judged.stated
    assert ((ratio > 0.6) & (ratio < 1.6)).all()
    assert found.wrong(shot.common) <= 0.005
