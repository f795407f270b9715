"""Dots: found, measured, and named."""

import cv2
import numpy as np
import pytest
from scipy.spatial import KDTree

from cyclopean import errors
from cyclopean.targets.assignment import assign, assign_from_seeds, linear_camera, plane_map, project_linear
from cyclopean.targets.dots import find_dots, noise_level


def dotted(dark=False, noise=1.0, size=320, fine=8):
    """A photograph of discs under uneven light, and their true centres and diameters (N, 3)."""
    rng = np.random.default_rng(3)
    ticks = (np.arange(size * fine) + 0.5) / fine - 0.5
    picture, truth = np.zeros((size * fine, size * fine), np.float32), []
    for place in np.ndindex(12, 12):
        centre, radius = 20 + 25 * np.array(place) + rng.uniform(-3, 3, 2), rng.uniform(2.5, 6)
        x, y = (slice(int((v - 7.5) * fine), int((v + 8.5) * fine)) for v in centre)
        disc = np.hypot(ticks[x] - centre[0], ticks[y][:, None] - centre[1]) < radius
        picture[y, x] = np.maximum(picture[y, x], disc)
        truth.append([*centre, 2 * radius])
    picture = cv2.GaussianBlur(picture.reshape(size, fine, size, fine).mean(axis=(1, 3)), (0, 0), 0.8)
    y, x = np.mgrid[:size, :size]
    light = 0.4 + 0.6 * np.exp(-((x - 100) ** 2 + (y - 220) ** 2) / (2 * 150**2))
    picture = (40 + 120 * (1 - picture if dark else picture)) * light + rng.normal(0, noise, (size, size))
    return np.clip(picture, 0, 255).round().astype(np.uint8), np.array(truth)


@pytest.mark.parametrize("dark", [False, True])
def test_centres_to_a_twentieth_of_a_pixel(dark):
    picture, truth = dotted(dark)
    dots = find_dots(picture)  # it is not told which kind
    assert len(dots) == len(truth)
    distance, nearest = KDTree(dots.pixels).query(truth[:, :2])
    assert distance.max() <= 0.08  # both coordinates, at contrasts down to 50 levels and 1 level of noise
    errors_px = dots.pixels[nearest] - truth[:, :2]
    assert np.sqrt((errors_px**2).mean()) <= 0.025
    assert np.abs(errors_px).max() <= 0.05
    assert np.abs(dots.diameters[nearest] / truth[:, 2] - 1).max() <= 0.15  # blurred by 0.8 px


def test_sigma_is_the_scatter():
    """Sigma against the scatter of one dot's centre over many noisy pictures."""
    rng = np.random.default_rng(8)
    y, x = np.mgrid[:41, :41]
    clean = 50 + 100 * np.exp(-((x - 20.3) ** 2 + (y - 19.8) ** 2) / (2 * 2.5**2))
    found = [
        find_dots((clean + rng.normal(0, 4, clean.shape)).astype(np.float32), dark=False, max_diameter=20)
        for _ in range(150)
    ]
    centres = np.array([dots.pixels[0] for dots in found])
    sigma = np.median([dots.sigma[0] for dots in found])
    assert sigma == pytest.approx(centres.std(axis=0).mean(), rel=0.35)  # 150 samples, and a window that follows
    np.testing.assert_allclose(centres.mean(axis=0), [20.3, 19.8], atol=0.02)


def test_noise_level():
    noisy = np.random.default_rng(1).normal(100, 3, (200, 200)).astype(np.float32)
    assert noise_level(noisy) == pytest.approx(3, rel=0.03)  # 40 000 samples


def test_masks_and_wrong_calls():
    picture, truth = dotted()
    mask = np.zeros(picture.shape, bool)
    mask[:, :150] = True
    dots = find_dots(picture, mask)
    inside = truth[:, 0] < 148
    assert inside.sum() <= len(dots) <= inside.sum() + 12  # one column of dots is near the mask's edge
    assert dots.pixels[:, 0].max() < 151
    assert len(find_dots(np.full((80, 80), 7, np.uint8))) == 0
    with pytest.raises(errors.ShapeError, match="min < max"):
        find_dots(picture, min_diameter=10, max_diameter=5)
    with pytest.raises(errors.ShapeError, match="mask"):
        find_dots(picture, mask[:10])


CAMERA = np.array([[900.0, 10, 320, 2000], [0, 880, 240, 3000], [0.02, -0.01, 1, 400]])


def block():
    """Points (60, 3) mm on three steps."""
    x, y = np.meshgrid(np.arange(10) * 10.0, np.arange(6) * 10.0)
    return np.column_stack([x.ravel() - 45, y.ravel() - 25, 12.0 * (y.ravel() // 20)])


def sightings(seed=4):
    """Points, their dots (some missing, some false, all shuffled, 0.2 px of noise), and the true names."""
    rng = np.random.default_rng(seed)
    points = block()
    seen = rng.permutation(len(points))[:50]
    pixels = project_linear(CAMERA, points)
    dots = pixels[seen] + rng.normal(0, 0.2, (50, 2))
    false = rng.uniform(pixels.min(axis=0), pixels.max(axis=0), (25, 2))
    order = rng.permutation(75)
    return points, np.concatenate([dots, false])[order], np.concatenate([seen, np.full(25, -1)])[order], pixels


@pytest.mark.parametrize("solid", [True, False])
def test_dots_are_named_from_a_guess(solid):
    points, dots, names, pixels = sightings()
    # a guess 9 px off, turned by 1.4 degrees and 2 % too large; the dots stand about 22 px apart
    centre = pixels.mean(axis=0)
    guess = centre + (pixels - centre) @ (1.02 * np.array([[1, 0.025], [-0.025, 1]])) + [7, -6]
    if not solid:  # one plane: a homography mends the guess
        flat = np.column_stack([points[:, :2], np.zeros(len(points))])
        moved = project_linear(CAMERA, flat)
        dots = np.where((names >= 0)[:, None], dots - pixels[names] + moved[names], dots)
        guess = guess - pixels + moved
    ids = assign(dots, guess, points if solid else None, tolerance=1.5)
    real = names >= 0
    assert (ids[real] == names[real]).mean() >= 0.96  # a false dot may lie nearer than the true one
    assert ((ids >= 0) & ~real).sum() <= 2
    used = ids[ids >= 0]
    assert len(np.unique(used)) == len(used)


def test_dots_are_named_from_seeds():
    points, dots, names, pixels = sightings()
    rng = np.random.default_rng(2)
    seeds = {k: pixels[k] + rng.uniform(-2, 2, 2) for k in (0, 9, 25, 34, 50, 59, 44)}
    ids = assign_from_seeds(dots, points, seeds, tolerance=1.5)
    real = names >= 0
    assert (ids[real] == names[real]).mean() >= 0.96
    with pytest.raises(errors.ShapeError, match="six or more"):
        assign_from_seeds(dots, points, {0: (1, 2)})


def test_linear_maps_come_back():
    points = block()
    pixels = project_linear(CAMERA, points)
    found = linear_camera(points, pixels)
    np.testing.assert_allclose(project_linear(found, points), pixels, atol=1e-7)  # px; rounding times condition
    assert np.isnan(linear_camera(points * [1, 1, 0], pixels)).all()  # one plane
    homography = np.array([[1.1, 0.1, 5], [-0.05, 0.9, 3], [1e-4, 2e-4, 1]])
    flat = points[:, :2]
    mapped = project_linear(np.insert(homography, 2, 0, axis=1), points)
    again = plane_map(flat, mapped)
    np.testing.assert_allclose(again / again[2, 2], homography, rtol=1e-7, atol=1e-9)


def test_nothing_in_nothing_out():
    assert assign(np.empty((0, 2)), [[1, 2]]).shape == (0,)
    assert (assign([[1, 2]], [[np.nan, np.nan]]) == -1).all()
    with pytest.raises(errors.ShapeError, match="same length"):
        assign([[1, 2]], [[1, 2]], np.zeros((2, 3)))


def test_four_sub_images_of_a_real_block(real):
    from benchmarks.splitter import linear_figures, splitter_observations

    points, rows = splitter_observations()
    assert points.shape == (135, 3)
    figures = linear_figures(points, rows)
    # measured by others on this photograph: 229 dots, 0.70, 0.92, 0.83, 0.84 px, 0.20 mm
    assert figures["dots"] >= 229
    assert (np.array(figures["rms_px"]) <= [0.70, 0.92, 0.83, 0.84]).all()
    assert figures["rms_mm"] <= 0.20
    pairs = rows["view"] * 135 + rows["point"]
    assert len(np.unique(pairs)) == len(pairs)
