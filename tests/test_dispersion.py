"""Channels that glass spreads come together where the renderer, closed forms and brute force say."""

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from commands import run
from scenes import photograph_plane, small_setup
from scipy.ndimage import map_coordinates
from setups import SETUPS

from benchmarks.data import renderer_setup
from cyclopean import Camera, read_setup, reconstruct, write_setup
from cyclopean.errors import ImageError, MediumError, SetupError
from cyclopean.files import write_image
from cyclopean.jobs.colours import chosen_colours, read_setups
from cyclopean.rectification import (
    channel_rigs,
    channel_shifts,
    compensated,
    expected_shifts,
    knows_channels,
    middle_inverse_depth,
    places,
)
from cyclopean.rectification.dispersion import across
from cyclopean.rigs.colours import coloured, index_at

INDICES = (1.51432, 1.5168, 1.52238)  # of the renderer's red, green and blue
DEPTHS = (600.0, 1600.0)
WAVELENGTHS = (610.0, 540.0, 460.0)
FLINT = replace(small_setup(glass="N-SF11", apex_deg=10.0), channel_wavelengths_nm=WAVELENGTHS)


@pytest.fixture(scope="session")
def renderer_rigs(mitsuba):
    base = renderer_setup("n3")
    return channel_rigs([replace(base, optic=replace(base.optic, glass=n)) for n in INDICES], DEPTHS)


def flint_photograph(depth, **more):
    """Each channel in light of its own."""
    rigs = [coloured(FLINT, nm).rig() for nm in WAVELENGTHS]
    return np.stack([photograph_plane(rig, depth, **more)[0] for rig in rigs], -1)


@pytest.fixture(scope="session")
def flint():
    """Rigs, and a colour photograph of a plane far from the middle depth, the same texture in all channels."""
    return channel_rigs(FLINT), flint_photograph(560.0, slope=0.1)


def picture(path):
    return cv2.cvtColor(cv2.imread(str(path)), cv2.COLOR_BGR2RGB)


def test_wavelengths_become_the_indices_of_the_glass():
    rigs = channel_rigs(FLINT)
    for rig, nm in zip(rigs, WAVELENGTHS, strict=True):
        assert rig[0].path.interfaces[0].index_after == pytest.approx(index_at(FLINT, nm), abs=1e-12)
    numbered = replace(FLINT, optic=replace(FLINT.optic, glass=1.79), dispersion="N-SF11")
    assert knows_channels(numbered)
    # as on its own line, moved by as much as the number is off the glass there
    off = 1.79 - index_at(FLINT, FLINT.wavelength_nm)
    assert index_at(numbered, 460.0) == pytest.approx(index_at(FLINT, 460.0) + off, abs=1e-12)


def test_corners_in_red_and_blue_lie_across_from_green(mitsuba, renderer_rigs):
    corners = np.load(mitsuba / "calib_n3_chroma" / "corners.npz")
    for k in range(3):
        mine = corners["facet"] == k
        inverse = 1 / corners["xyz_cam"][mine][:, 2]
        for c, colour in ((0, "R"), (2, "B")):
            found = across(
                renderer_rigs[1][k].unbounded(), renderer_rigs[c][k].unbounded(), corners["uv_G"][mine], inverse
            )
            # the renderer's own corners are good to some 1e-3 px
            np.testing.assert_allclose(found, corners[f"uv_{colour}"][mine], atol=3e-3)


def where_it_is_shown(green, own, raw, middle):
    """The pixel of the compensated photograph that was taken from `raw`, by iteration of the forward map."""
    found = raw.copy()
    for _ in range(60):
        found = found + raw - across(green, own, found, middle)
    return found


def test_places_join_the_renderers_corners_in_every_colour(mitsuba, renderer_rigs):
    corners = np.load(mitsuba / "calib_n3_chroma" / "corners.npz")
    middle, compared = middle_inverse_depth(DEPTHS), 0
    rows = {key: row for row, key in enumerate(zip(*(corners[n] for n in ("view", "corner_id", "facet")), strict=True))}
    pairs = [(row, rows[v, i, b]) for (v, i, a), row in rows.items() if a == 0 for b in (1, 2) if (v, i, b) in rows]
    for first, second in pairs[::9]:
        b, depth = corners["facet"][second], corners["xyz_cam"][first, 2]
        for c, colour in enumerate("RGB"):
            green, own = (tuple(view.unbounded() for view in renderer_rigs[channel]) for channel in (1, c))
            pixel = where_it_is_shown(green[0], own[0], corners[f"uv_{colour}"][first], middle)
            wanted = where_it_is_shown(green[b], own[b], corners[f"uv_{colour}"][second], middle)
            found = places(renderer_rigs, 0, pixel, [1 / depth], middle)[b - 1, 0, c]
            np.testing.assert_allclose(found, wanted, atol=5e-3)  # the renderer's corners again, twice
            compared += 1
    assert compared > 60


@pytest.mark.parametrize("name", ["prism, facets to camera, bent lens", "two mirrors, bent lens"])
def test_places_of_one_rig_are_plain_projections(name):
    rig = SETUPS[name].rig()
    rng = np.random.default_rng(3)
    inverse = np.linspace(1 / 600, 1 / 250, 4)
    for reference in range(len(rig)):
        x, y, width, height = rig[reference].region.box
        pixels = rng.uniform((x, y), (x + width - 1, y + height - 1), (3, 5, 2))
        found = places(rig, reference, pixels, inverse)
        assert found.shape == (len(rig) - 1, 4, 1, 3, 5, 2)
        points = rig[reference].unbounded().rays(pixels).at_depth((1 / inverse)[:, None, None])
        others = [view for k, view in enumerate(rig) if k != reference]
        for j, other in enumerate(others):
            np.testing.assert_array_equal(found[j, :, 0], other.unbounded().project(points))
    if name.startswith("prism"):
        # three rigs of the same glass, each built by itself: all the ways to and fro end where they began
        alike = places([SETUPS[name].rig() for _ in range(3)], 1, pixels, inverse)
        np.testing.assert_allclose(alike, np.broadcast_to(places(rig, 1, pixels, inverse), alike.shape), atol=1e-8)


def test_the_same_glass_in_all_channels_changes_nothing():
    rigs = [small_setup().rig() for _ in range(3)]
    photograph = np.random.default_rng(1).integers(0, 256, (240, 320, 3), dtype=np.uint8)
    np.testing.assert_array_equal(compensated(photograph, rigs, 1 / 800), photograph)
    np.testing.assert_allclose(expected_shifts(rigs, 1 / 800), 0, atol=1e-9)  # there and back by Newton


def test_mirrors_have_one_rig_for_all_colours():
    rigs = channel_rigs(replace(SETUPS["two mirrors, straight lens"], channel_wavelengths_nm=WAVELENGTHS))
    assert rigs[0] is rigs[1] is rigs[2]


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16, np.float32])
def test_a_channel_shows_at_a_pixel_what_it_had_across(flint, dtype):
    rigs, _ = flint
    y, x = np.mgrid[:240, :320]

    def shade(x, y):
        return 50 + 0.4 * x + 0.2 * y + 1e-3 * (x - 100) * (y - 80)

    scale = 256 if dtype == np.uint16 else 1
    photograph = np.repeat(np.asarray(scale * shade(x, y) + (dtype != np.float32) * 0.5, dtype)[..., None], 3, -1)
    got = compensated(photograph, rigs, 1 / 700)
    assert got.dtype == dtype
    tolerance = {np.uint8: 1.01, np.uint16: 2, np.float32: 1e-3}[dtype]  # two roundings; 0.4 a px, float32 of 200
    np.testing.assert_array_equal(got[..., 1], photograph[..., 1])
    for k, view in enumerate(rigs[1]):
        inside = view.region.mask & (np.abs(x - 159.5) < 145) & (np.abs(y - 119.5) < 105)  # splines know borders
        pixels = np.argwhere(inside)[:, ::-1].astype(float)
        for c in (0, 2):
            there = across(view, rigs[c][k].unbounded(), pixels, 1 / 700)
            assert np.abs(there - pixels).max() > 1  # px: something moves
            np.testing.assert_allclose(got[inside][:, c], scale * shade(*there.T), atol=tolerance)
    beside = ~np.any([view.region.traced for view in rigs[1]], axis=0)
    np.testing.assert_array_equal(got[beside], photograph[beside])


def test_pixels_are_resampled_as_a_spline_says(flint):
    rigs, _ = flint
    photograph = np.random.default_rng(2).uniform(0, 1, (240, 320, 3)).astype(np.float32)
    got = compensated(photograph, rigs, 1 / 700)
    for k, view in enumerate(rigs[1]):
        y, x = np.nonzero(view.region.mask)
        for c in (0, 2):
            there = across(view, rigs[c][k].unbounded(), np.stack([x, y], -1), 1 / 700)
            slow = map_coordinates(photograph[..., c], there.T[::-1], order=3, mode="mirror")
            # slopes reach 2 / px, and places between those traced are off by less than 1e-3 px
            np.testing.assert_allclose(got[y, x, c], slow, atol=2e-3)


def test_every_channel_looks_through_the_facet_at_all_pixels_of_a_view(flint):
    rigs, _ = flint
    middle = middle_inverse_depth(FLINT.depths)
    for k, view in enumerate(rigs[1]):
        own = FLINT.rig()[k].region.mask
        assert all(rig[k].region is view.region for rig in rigs)
        pixels = np.argwhere(view.region.mask)[:, ::-1].astype(float)
        for rig in rigs:
            there = across(view, rig[k].unbounded(), pixels, middle)
            # at the edge of the region nearest pixels count, and its margin is wider than that
            assert np.isfinite(rig[k].rays(there).directions).all()
            assert rig[k].camera.contains(there).all()
        assert 0.9 < view.region.mask.sum() / own.sum() < 1.02  # some pixels along seams and borders


def test_away_from_the_middle_each_channel_is_found_at_its_own_place(flint):
    """Of one texture, all channels show at their `places` what they show in the reference; at green's they do not."""
    rigs, middle, depth = flint[0], middle_inverse_depth(FLINT.depths), 505.0
    shown = compensated(flint_photograph(depth, pitch=1.5).astype(np.float32), rigs, middle)
    rows, columns = np.nonzero(rigs[1][0].region.mask)
    pixels = np.stack([columns, rows], -1)[::7]
    found = places(rigs, 0, pixels, [1 / depth], middle)[:, 0]
    off: dict[bool, list] = {True: [], False: []}
    for j, view in enumerate((1, 2)):
        kept = cv2.erode(rigs[1][view].region.mask.astype(np.uint8), np.ones((15, 15)))  # the splines' reach
        inside = replace(rigs[1][view].region, traced=kept > 0).contains(found[j, 1])
        assert inside.sum() > 300
        own = shown[pixels[inside, 1], pixels[inside, 0]]
        for c in (0, 2):
            for by_channel in off:
                at = found[j, c if by_channel else 1][inside].T[::-1]
                off[by_channel].append(map_coordinates(shown[..., c], at, order=3) - own[:, c])
    rms, rms_as_green = (np.std(np.concatenate(off[by_channel])) for by_channel in (True, False))
    assert rms < 0.7  # grey values: four roundings to whole ones, 0.3 each
    assert rms_as_green > 2 * rms


def test_photographs_come_together(mitsuba, renderer_rigs):
    """The renderer's scene: shifts of px fall by what the rigs say. Colours of its texture differ, hence relative."""
    middle = middle_inverse_depth(DEPTHS)
    photograph = picture(mitsuba / "scenes" / "n3_chroma_round.png")
    after = compensated(photograph, renderer_rigs, middle)
    before, after = (channel_shifts(image, renderer_rigs[1]) for image in (photograph, after))
    expected = expected_shifts(renderer_rigs, middle)
    assert np.linalg.norm(expected, axis=-1).max(0) == pytest.approx([1.2, 0, 2.7], abs=0.1)
    np.testing.assert_allclose(before.shifts - after.shifts, expected, atol=0.05)  # mean of a window, not its middle
    left = np.linalg.norm(after.shifts, axis=-1)[:, [0, 2]]
    assert (left < 4 * after.sigma[:, [0, 2]]).all()  # colours of this texture differ, and sigma says so
    assert (after.sigma[:, [0, 2]] < 0.3).all()


def test_a_board_at_the_middle_depth_has_no_colour_left(mitsuba, renderer_rigs):
    corners = np.load(mitsuba / "calib_n3_chroma" / "corners.npz")
    depth = 1 / np.mean(1 / corners["xyz_cam"][corners["view"] == 2][:, 2])
    photograph = picture(mitsuba / "calib_n3_chroma" / "view_02.png")
    assert channel_shifts(photograph, renderer_rigs[1]).largest > 3  # px
    after = channel_shifts(compensated(photograph, renderer_rigs, 1 / depth), renderer_rigs[1])
    assert after.largest < 0.02
    assert after.sigma.max() < 0.02


def test_shifts_are_measured(flint):
    rigs, photograph = flint
    grey = np.repeat(photograph[..., 1:2], 3, -1)
    rig = rigs[1]
    np.testing.assert_allclose(channel_shifts(grey, rig).shifts, 0, atol=1e-3)
    moved = grey.astype(np.float32)
    moved[..., 2] = map_coordinates(moved[..., 2], np.mgrid[:240, :320] - np.array([-1.3, 4.2])[:, None, None], order=3)
    moved = np.float32([[[0.5, 1, 0.7]]]) * moved + 10  # nor do brightness and contrast matter
    shifts = channel_shifts(moved, rig).shifts
    np.testing.assert_allclose(shifts[:, 0], 0, atol=1e-3)
    np.testing.assert_allclose(shifts[:, 2], np.tile([4.2, -1.3], (3, 1)), atol=0.02)  # the splines of a shift
    assert channel_shifts(grey, rig).sigma.max() < 1e-3
    nothing = channel_shifts(np.full((240, 320, 3), 100, np.uint8), rig)
    assert np.isnan(nothing.shifts[:, [0, 2]]).all()
    assert nothing.largest == 0


def test_wrong_calls_are_explained(flint):
    rigs, photograph = flint
    numbered = replace(FLINT, optic=replace(FLINT.optic, glass=1.79))
    assert not knows_channels(numbered)
    for setups, words, kind in (
        (small_setup(), "does not state the wavelengths", SetupError),
        (numbered, "says nothing about other colours", MediumError),
        (replace(FLINT, channel_wavelengths_nm=(0.61, 0.54, 0.46)), "did you mean 610", MediumError),
        ([FLINT, FLINT], "give one setup, or three for red, green and blue, got 2", SetupError),
        ([FLINT, FLINT, small_setup(facets=2)], "different views, 3, 3, 2", SetupError),
    ):
        with pytest.raises(kind, match=words):
            channel_rigs(setups)
    with pytest.raises(ImageError, match=r"got \(240, 320\)"):
        compensated(photograph[..., 0], rigs, 1e-3)
    with pytest.raises(ImageError, match=r"channels want a photograph of as many colours, got one of shape \(240"):
        reconstruct(photograph[..., 1], rigs[1], channels=rigs)
    with pytest.raises(SetupError, match="rig must be that of green"):
        reconstruct(photograph, FLINT.rig(), channels=rigs)
    with pytest.raises(SetupError, match="three positive numbers of nm"):
        replace(FLINT, channel_wavelengths_nm=(600.0, 500.0))
    with pytest.raises(SetupError, match="name of a glass"):
        replace(FLINT, dispersion=1.5)


def test_a_setup_file_states_its_channels(tmp_path):
    for setup in (FLINT, replace(FLINT, optic=replace(FLINT.optic, glass=1.79), dispersion="N-SF11")):
        write_setup(setup, tmp_path / "rig.toml")
        back = read_setup(tmp_path / "rig.toml")
        assert back.channel_wavelengths_nm == setup.channel_wavelengths_nm
        assert back.dispersion == setup.dispersion
    text = (tmp_path / "rig.toml").read_text()
    for said, wanted in (
        ("610.0,", "channel_wavelengths_nm"),
        ('"N-SF11"', "must be the name of a glass"),
    ):
        (tmp_path / "wrong.toml").write_text(text.replace(said, "-1," if said.endswith(",") else "1.5"))
        with pytest.raises(SetupError, match=wanted):
            read_setup(tmp_path / "wrong.toml")


def test_colours_are_brought_together_where_they_are_known_and_spoken_of_where_not(flint):
    rigs, photograph = flint
    (red, green, blue), photo = (coloured(FLINT, nm) for nm in WAVELENGTHS), Path("photo.png")
    known = chosen_colours(photo, photograph, [FLINT], "all", None)
    assert known.depths == FLINT.depths
    assert len(known.channels) == 3
    # 600 px tan(10 deg) times the steps of the index, 0.0116 and 0.0221, times 1 - 60 / 706 for the middle depth
    assert "red is brought to green by up to 1.1 px, blue by up to 2.2 px at 706 mm" in known.note
    assert known.warnings == []
    np.testing.assert_array_equal(known.photograph, compensated(photograph, rigs, middle_inverse_depth(FLINT.depths)))
    three = chosen_colours(photo, photograph, [red, green, blue], "all", None)
    np.testing.assert_array_equal(three.photograph, known.photograph)
    for wrong, words in (
        (replace(FLINT, channel_wavelengths_nm=None), "state channel_wavelengths_nm = [RED, GREEN, BLUE]"),
        (replace(green, channel_wavelengths_nm=WAVELENGTHS), "name the glass whose dispersion counts"),
        (replace(FLINT, channel_wavelengths_nm=(610.0, 540.0, 500.0)), "are glass and wavelengths of the channels"),
    ):
        (said,) = chosen_colours(photo, photograph, [wrong], "all", None).warnings
        assert words in said
    for setups in ([FLINT], [red, green, blue]):
        one = chosen_colours(photo, photograph, setups, "blue", (500, 900))
        np.testing.assert_array_equal(one.photograph, photograph[..., 2])
        assert one.rig[0].path.interfaces[0].index_after == pytest.approx(index_at(FLINT, 460.0), abs=1e-12)
        assert one.depths == (500, 900)
    swapped = chosen_colours(photo, photograph, [blue, green, red], "all", None)
    assert "the setups those of red, green and blue, in this order" in swapped.warnings[0]
    turned = replace(blue, optic=replace(blue.optic, azimuth_deg=blue.optic.azimuth_deg + 60))
    with pytest.raises(SetupError, match="no glass bends colours so differently"):
        chosen_colours(photo, photograph, [red, green, turned], "all", None)
    mirrors = chosen_colours(photo, photograph, [SETUPS["two mirrors, straight lens"]] * 3, "all", (300, 600))
    assert (mirrors.channels, mirrors.note, mirrors.warnings) == (None, "", [])


def test_grey_photographs_have_no_colours_to_bring_together(flint):
    photograph, photo = flint[1], Path("photo.png")
    for grey in (photograph[..., 1], np.repeat(photograph[..., 1:2], 3, -1)):
        plain = chosen_colours(photo, grey, [FLINT], "all", None)
        np.testing.assert_array_equal(plain.photograph, photograph[..., 1])
        assert (plain.channels, plain.note, plain.warnings) == (None, "", [])
        with pytest.raises(ImageError, match="three setups"):
            chosen_colours(photo, grey, [FLINT] * 3, "all", None)
    with pytest.raises(ImageError, match="has no red channel"):
        chosen_colours(photo, photograph[..., 1], [FLINT], "red", None)


def test_three_setups_are_of_one_size_of_photograph(tmp_path):
    write_setup(FLINT, tmp_path / "one.toml")
    write_setup(replace(FLINT, camera=Camera((640, 480), 600.0)), tmp_path / "other.toml")
    with pytest.raises(SetupError, match="different sizes: 320x240 px, 320x240 px, 640x480 px"):
        read_setups([tmp_path / f"{name}.toml" for name in ("one", "one", "other")])


def test_the_command_matches_all_colours_at_once(monkeypatch, capsys, tmp_path, flint):
    write_image(tmp_path / "photo.png", flint[1])
    write_setup(FLINT, tmp_path / "rig.toml")
    words = "reconstruct", tmp_path / "photo.png", "-o", tmp_path / "out", "-s", tmp_path / "rig.toml"
    status, said, complaint = run(monkeypatch, capsys, *words)
    assert status == 0, complaint
    assert "colours: red is brought to green by up to" in said
    assert "warning" not in said
    assert "<td>red is brought to green by up to" in (tmp_path / "out" / "report.html").read_text()
    depth = np.load(tmp_path / "out" / "depth.npz")["depth"]
    mask = flint[0][1].masks.any(0)
    true = photograph_plane(channel_rigs(FLINT)[1], 560.0, slope=0.1)[1]
    error = np.abs(depth / true - 1)[mask & np.isfinite(depth)]
    assert len(error) > 0.3 * mask.sum()  # of a near plane each view shows the others a part
    assert np.median(error) < 0.004  # a tenth of a px
    status, _, complaint = run(monkeypatch, capsys, *words, "-s", tmp_path / "rig.toml")
    assert status != 0
    assert "given once, or three times, for red, green and blue; got 2 files" in " ".join(complaint.split())
