"""Sub-images found by their seams, against where the renderer put them."""

from functools import partial

import cv2
import numpy as np
import pytest
from commands import run
from scipy.ndimage import gaussian_filter

from benchmarks.data import renderer_setup
from cyclopean import errors, read_photograph
from cyclopean.targets.seam_search import reach
from cyclopean.targets.seams import Seams, distance_to_half_line, find_seams, reconcile

SETS = {  # rig -> sets of photographs, how many of all of them
    "n2": ("calib_n2", 8),
    "n3": ("calib_n3", 6),
    "n4": ("calib_n4", 4),
    "n5": ("calib_n5", 4),
    "n3_pose": ("calib_n3_pose", 8),
    "n2_flip": ("calib_n2_flip", 6),
    "t2_b40": ("*_t2_b40", 17),
    "t3_b40": ("calib_t3_b40", 4),
    "t4_b45": ("calib_t4_b45", 4),
}


def photographs(folder, name, count):
    return [read_photograph(path) for path in sorted(folder.glob(f"{name}/*.png"))[:count]]


def true_borders(labels):
    """Points (N, 2) between neighbouring pixels of different facets."""
    across, down = np.nonzero(labels[:, 1:] != labels[:, :-1]), np.nonzero(labels[1:] != labels[:-1])
    beside, below = np.column_stack(across[::-1]), np.column_stack(down[::-1])
    return np.concatenate([beside + np.array([0.5, 0.0]), below + np.array([0.0, 0.5])])


def worst_distance(seams, labels):
    """The largest distance between true and found seams, both ways."""
    truth = true_borders(labels)
    offsets = truth - seams.apex
    there = np.min([distance_to_half_line(offsets, angle) for angle in seams.angles], axis=0).max()
    found = [line[0] + np.linspace(0, 0.999, 60)[:, None] * (line[1] - line[0]) for line in seams.lines]
    back = max(np.linalg.norm(truth - point, axis=1).min() for point in np.concatenate(found))
    return max(there, back)


@pytest.mark.parametrize("rig", SETS)
def test_seams_and_their_number_are_found(rig, mitsuba):
    folder, count = SETS[rig]
    seams = find_seams(photographs(mitsuba, folder, count))  # the number of views is not told
    facets = np.load(mitsuba / "rigs" / f"{rig}_facets.npz")["facet"].astype(int)
    assert seams.trusted, seams.message
    assert not seams.message
    assert len(seams) == facets.max() + 1
    assert worst_distance(seams, facets) <= 2  # px: what masks with the usual margin can bear
    # each found region is one facet, but for pixels beside a seam: 2 px along at most 4 half-diagonals
    comparison = reconcile(seams, renderer_setup(rig).rig())
    assert comparison.agrees, comparison.message
    assert sorted(comparison.order) == list(range(len(seams)))
    assert comparison.overlap.min() > 0.99
    assert comparison.distance <= 2


def test_seams_of_one_photograph_with_texture(mitsuba):
    seams = find_seams(read_photograph(mitsuba / "calib_t4_b45" / "view_04.png"))
    facets = np.load(mitsuba / "rigs" / "t4_b45_facets.npz")["facet"].astype(int)
    assert seams.trusted
    assert len(seams) == 4
    assert worst_distance(seams, facets) <= 2


def patchwork(angles, apex, count, size=(640, 480), band=0.0, seed=1):
    """Photographs of random texture, another one in each sector; seams blended linearly over a band, px."""
    rng = np.random.default_rng(seed)
    truth = Seams(apex, angles, 1.0, size)
    weights = (truth.labels == np.arange(len(angles))[:, None, None]).astype(np.float32)
    if band:
        weights = np.stack([cv2.blur(weight, (int(band), int(band))) for weight in weights])
    else:
        weights = np.stack([cv2.GaussianBlur(weight, (0, 0), 0.6) for weight in weights])
    pictures = []
    for _ in range(count):
        texture = gaussian_filter(rng.normal(size=(len(angles), size[1], size[0])), (0, 6, 6))
        texture = 128 + 45 * texture / texture.std() + rng.normal(0, 1, texture.shape)
        pictures.append(np.clip((weights * texture).sum(axis=0), 0, 255).round().astype(np.uint8))
    return truth, pictures


@pytest.mark.parametrize("n", [6, 8])
def test_many_facets_that_are_not_quite_alike(n):
    deviation = np.deg2rad(np.random.default_rng(n).uniform(-3, 3, n))
    truth, pictures = patchwork(2 * np.pi * np.arange(n) / n + 0.3 + deviation, (282.3, 191.8), 3, (520, 400))
    seams = find_seams(pictures)
    assert seams.trusted, seams.message
    assert len(seams) == n
    assert worst_distance(seams, truth.labels.astype(int)) <= 2
    np.testing.assert_allclose(seams.apex, truth.apex, atol=1.0)  # px, half of what is asked of the seams


def test_the_width_of_a_blend_is_told():
    angles = np.deg2rad([20, 200])
    widths = [find_seams(patchwork(angles, (162, 120), 2, (320, 240), band)[1], 2).band for band in (0, 9)]
    assert widths[0] <= 3  # px: the sharp seam is blurred by 0.6 px
    assert 6 <= widths[1] <= 14  # a box of 9 px, seen at 20 degrees, is up to 11 px wide


def test_no_prism_is_never_trusted(mitsuba):
    pictures = photographs(mitsuba, "camera_only", 6)
    together = find_seams(pictures)
    assert not together.trusted
    assert "not certain" in together.message
    assert not find_seams(pictures[0]).trusted  # of all alone, the one with the highest confidence


def test_what_cannot_be_searched_is_said():
    with pytest.raises(errors.ImageError, match="show nothing"):
        find_seams(np.full((240, 320), 90, np.uint8))
    with pytest.raises(errors.ImageError, match="640x480 px and 320x240 px"):
        find_seams([np.zeros((480, 640), np.uint8), np.zeros((240, 320), np.uint8)])
    with pytest.raises(errors.ImageError, match="no photograph"):
        find_seams([])
    with pytest.raises(errors.ShapeError, match="2 to 8"):
        find_seams(np.eye(100), views=9)


def test_sub_images_are_numbered_clockwise_from_the_right():
    seams = Seams((320, 240), np.deg2rad([300.0, 60.0, 180.0]), 1.0, (640, 480))
    assert [int(seams.labels[y, x]) for x, y in ((600, 240), (200, 400), (200, 80))] == [0, 1, 2]
    turned = Seams((320, 240), seams.angles - 0.05, 1.0, (640, 480))  # its middle now lies just before +x
    assert int(turned.labels[240, 600]) == 0
    assert seams.shares.sum() == pytest.approx(1)


def test_masks_keep_away_from_seams():
    seams = Seams((320, 240), np.deg2rad([0.0, 180.0]), 1.0, (640, 480))
    masks = seams.masks(2.5)
    assert masks.shape == (2, 480, 640)
    gaps = np.flatnonzero(~masks.any(axis=0)[:, 100])
    np.testing.assert_array_equal(gaps, np.arange(238, 243))  # |y - 240| < 2.5
    assert not (masks[0] & masks[1]).any()


def test_half_lines_end_at_the_border():
    ends = reach(np.array([[100.0, 50.0]]), np.deg2rad([0, 90, 180, 270, 45]), (640, 480))[:, 0]
    np.testing.assert_allclose(ends, [539.5, 429.5, 100.5, 50.5, 429.5 * np.sqrt(2)])


def test_a_shifted_and_turned_setup_is_measured(mitsuba):
    rig = renderer_setup("n4").rig()
    turn, shift = np.deg2rad(0.4), np.array([6.0, -4.0])
    seams = Seams(np.array([639.5, 479.5]) + shift, np.deg2rad([0, 90, 180, 270]) + turn, 1.0, rig.size)
    comparison = reconcile(seams, rig)
    # first order in the turn: the square of 0.007 rad over 640 px is 0.03 px
    np.testing.assert_allclose(comparison.offset, shift, atol=0.1)
    assert comparison.rotation == pytest.approx(turn, abs=1e-4)
    assert comparison.distance == pytest.approx(4 + 639.5 * np.sin(turn) + 6 * np.sin(turn), abs=1.0)
    assert comparison.agrees
    far = reconcile(Seams(seams.apex + 60, seams.angles, 1.0, rig.size), rig)
    assert "shift it by" in far.message
    assert "has 4 views but 3" in reconcile(Seams((640, 480), [0, 2, 4], 1.0, rig.size), rig).message


@pytest.fixture
def command(monkeypatch, capsys):
    """Run ``cyclopean`` with some words: exit status, output and errors."""
    return partial(run, monkeypatch, capsys)


def test_regions_command(command, tmp_path):
    import json

    from cyclopean.files import write_image

    truth, pictures = patchwork(np.deg2rad([25, 150, 268]), (330, 250), 3)
    paths = [tmp_path / f"photo_{k}.png" for k in range(3)]
    for path, picture in zip(paths, pictures, strict=True):
        write_image(path, picture)
    status, said, _ = command("regions", *paths, "-o", tmp_path / "out")
    assert status == 0
    assert "3 sub-images" in said
    assert {path.name for path in (tmp_path / "out").iterdir()} == {"regions.png", "regions.json"}
    written = json.loads((tmp_path / "out" / "regions.json").read_text())
    np.testing.assert_allclose(np.deg2rad(written["angles_deg"]), truth.angles, atol=0.01)  # 2 px at 200 px
    (tmp_path / "photos").mkdir()
    for path, picture in zip(paths, pictures, strict=True):
        write_image(tmp_path / "photos" / path.name, picture)
    (tmp_path / "empty").mkdir()
    assert command("regions", tmp_path / "photos", "-o", tmp_path / "again")[0] == 0
    assert json.loads((tmp_path / "again" / "regions.json").read_text()) == written
    write_image(tmp_path / "small.png", pictures[0][:200])
    write_image(tmp_path / "grey.png", np.full((480, 640), 90, np.uint8))
    for words, wanted in (
        ([tmp_path / "missing.png"], "missing.png"),
        ([paths[0], tmp_path / "small.png"], "640x200 px"),
        ([tmp_path / "empty"], "no photographs"),
        ([tmp_path / "grey.png"], "show nothing"),
        ([paths[0], "--views=1"], "--views must be 2 to 8"),
        ([], "no photograph"),
    ):
        status, _, error = command("regions", *words, "-o", tmp_path / "none")
        assert status == 2
        assert wanted in error
