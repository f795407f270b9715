"""The steps of the matcher, each against a slow and obvious twin."""

from dataclasses import replace

import numpy as np
import pytest
from unlabelled import DEPTHS, RIG, SIGMA, random_scene, seen_by, triangulated_middle

from cyclopean import Rig
from cyclopean.correspondence.hypotheses import Hypotheses, _wrongly_confirmed, gather, trace
from cyclopean.correspondence.kernels import (
    Noise,
    innovation,
    linearised,
    pair_candidates,
    squared_distance,
    update,
)
from cyclopean.correspondence.points import _checked_descriptors, shown_share
from cyclopean.correspondence.resolution_kernels import resolve
from cyclopean.epipolar import distance_to_curves, epipolar_curves
from cyclopean.triangulation import triangulate


def test_binary_descriptors_are_compared_bit_by_bit():
    random = np.random.default_rng(2)
    looks = random.integers(0, 256, (2, 1, 32)).astype(np.uint8)
    arrays, power = _checked_descriptors(looks, [np.zeros((1, 2))] * 2)
    assert power == 1
    differing = np.unpackbits(looks[0] ^ looks[1]).sum()
    assert squared_distance(arrays[0][0], arrays[1][0]) == differing


def test_paths_are_the_epipolar_curves():
    pixels = RIG[1].region.centre + np.array([[0, 0], [12, -7], [-30, 20.0]])
    first = trace(RIG, 1, pixels, DEPTHS)
    curves = epipolar_curves(RIG, 1, pixels, DEPTHS, samples=first.paths.shape[2], bounded=False)
    others = [0, 2, 3, 4]
    np.testing.assert_allclose(first.paths[:, others, :, :2], curves.pixels[:, others], atol=1e-6)  # Newton's end
    finer = epipolar_curves(RIG, 1, pixels, DEPTHS, samples=257, bounded=False)
    middle = first.paths[:, others, :-1, :2] / 2 + first.paths[:, others, 1:, :2] / 2
    whole = np.full((3, middle.shape[2], 5, 2), np.nan)
    whole[:, :, others] = np.moveaxis(middle, 2, 1)
    distance, _ = distance_to_curves(replace_axis(finer), whole)
    assert np.nanmax(np.abs(distance)) < 0.002  # chords of a curve that bends by a few px


def replace_axis(curves):
    """Curves (N,) as (N, 1), to meet many pixels each."""
    return replace(
        curves, pixels=curves.pixels[:, None], points=curves.points[:, None], sigma=curves.sigma[:, None]
    )  # fmt: skip


def test_adding_views_one_by_one_gives_the_residual_of_all_at_once():
    """The filter's chi-square is that of the n-view triangulation, whatever the pixels."""
    rig = Rig(RIG.views[:3])
    point = triangulated_middle(rig)
    pixels = rig.project(point) + np.random.default_rng(8).normal(0, SIGMA, (3, 2))
    inverse = 1 / DEPTHS[0] - 1 / DEPTHS[1]
    first = trace(rig, 0, pixels[:1], DEPTHS)
    place = (1 / point[2] - 1 / DEPTHS[1]) / first.depth_step
    state, covariance = np.zeros(3), np.diag([SIGMA**2, SIGMA**2, (100 * inverse) ** 2])
    model, gain, chi2 = np.empty((2, 4)), np.empty((6, 2)), 0.0
    for view in (1, 2):
        linearised(first.paths[0, view], place, first.depth_step, model)
        distance, _ = innovation(model, state, covariance, SIGMA**2, *pixels[view], gain)
        update(state, covariance, gain)
        chi2 += distance
    solved = triangulate(rig, pixels[None], SIGMA)
    # the curves are chords, 0.001 px off: 1 % of the noise, 2 % of its square
    assert chi2 == pytest.approx(float(solved.residual[0] ** 2) * 6 / SIGMA**2, rel=0.02, abs=0.02)


def test_cells_hold_every_point_once():
    pixels, _ = seen_by(RIG, random_scene(RIG))
    pixels[2] = np.zeros((0, 2))
    pixels[3][0] = np.nan
    gathered = gather(RIG, pixels, None)
    np.testing.assert_array_equal(np.sort(gathered.order), np.arange(len(gathered.pixels)))
    assert gathered.starts[3] - gathered.starts[2] == 0
    assert (np.diff(gathered.begins) >= 0).all()


def test_pairs_are_those_within_the_band():
    """Against the distance of every point from every curve, with the curves' own standard deviations."""
    pair = Rig(RIG.views[:2])
    pixels, _ = seen_by(pair, random_scene(pair, 400), clutter=200)
    gathered, first = gather(pair, pixels, None), trace(pair, 0, pixels[0], DEPTHS)
    limit = 3.5**2
    noise = Noise(SIGMA, limit, 0.9, np.array([0, 0, limit]), 0.0)
    found = np.empty((5000, 4))
    count = pair_candidates(gathered, first, 1, noise, found)
    compiled = {(int(i), int(j)) for i, j, _, squared in found[:count] if squared < 0.98 * limit}
    curves = epipolar_curves(pair, 0, pixels[0], DEPTHS, samples=257, sigma=SIGMA, bounded=False)
    second = np.full((len(pixels[1]), 2, 2), np.nan)
    second[:, 1] = pixels[1]
    distance, depth = distance_to_curves(replace_axis(curves), second)
    inside = (depth[..., 1] >= curves.inverse_depths[0]) & (depth[..., 1] <= curves.inverse_depths[-1])
    spread = np.sqrt(np.median(curves.sigma[:, 1], -1)[:, None] ** 2 + SIGMA**2)
    slow = np.abs(distance[..., 1]) / spread
    surely = {(int(i), int(j)) for i, j in np.argwhere(inside & (slow < 0.97 * 3.5))}  # 3 %: sigma along the curve
    beyond = {(int(i), int(j)) for i, j in np.argwhere(slow > 1.03 * 3.5)}
    assert len(surely) > 100
    assert surely <= {(int(i), int(j)) for i, j, _, _ in found[:count]}
    assert not compiled & beyond


def resolve_slowly(rows, evidence, firm):
    """Accepted hypotheses with their ambiguity: the rule of `resolve`, over all pairs of hypotheses."""
    alive, accepted = set(range(len(rows))), {}

    def common(g, h):
        return int(((rows[g] == rows[h]) & (rows[g] >= 0)).sum())

    while True:
        for h in sorted(alive - set(accepted)):
            others = [g for g in alive if g != h and common(g, h)]
            if any(g < h for g in others):
                continue
            rivals = [evidence[g] for g in others if common(g, h) == 1]
            ratio = float(np.exp(max([0.0, *rivals]) - evidence[h]))
            if ratio <= firm:
                accepted[h] = ratio
                alive -= set(others)
                break
        else:
            return accepted


@pytest.mark.parametrize("share", [0.0, 0.2, 0.6])
def test_the_share_of_points_with_a_partner_is_found(share):
    """The log of a likelihood ratio that is normal has the mean -s^2/2 by chance, s^2/2 where there is a partner."""
    random, total = np.random.default_rng(4), 4000
    evidence = random.normal(-4.5, 3.0, total // 2)
    evidence[: round(share * total / 2)] += 9
    rows = np.arange(total).reshape(-1, 2)
    found = Hypotheses(rows, evidence + np.log(0.9), *(np.zeros(total // 2, int),) * 2, 0, 0, 0)
    # 2000 pairs, nearly all of which tell which kind they are: sqrt(0.25 / 2000) = 0.011; 10 points are believed before
    assert shown_share(found, total, 0.9) == pytest.approx(share, abs=0.04)


@pytest.mark.parametrize("seed", range(5))
def test_conflicts_are_resolved_by_the_rule(seed):
    random = np.random.default_rng(seed)
    names = np.array([[0, 6], [6, 12], [12, 18]])
    rows = np.stack([random.integers(a, b, 30) for a, b in names], 1)
    rows[random.random(rows.shape) < 0.25] = -1
    rows = np.unique(rows[(rows >= 0).sum(1) >= 2], axis=0)
    random.shuffle(rows)
    evidence = np.sort(random.uniform(0.5, 40, len(rows)))[::-1].copy()
    order = np.argsort(rows.ravel(), kind="stable")
    begins = np.searchsorted(rows.ravel()[order], np.arange(19))
    alive, ambiguity = np.ones(len(rows), bool), np.full(len(rows), np.nan)
    resolve(rows, evidence, begins, order // 3, 0.5, 0.0, alive, ambiguity)
    slow = resolve_slowly(rows, evidence, 0.5)
    assert slow
    assert set(np.flatnonzero(np.isfinite(ambiguity))) == set(slow)
    np.testing.assert_allclose(ambiguity[list(slow)], list(slow.values()), rtol=1e-12)


def test_a_view_that_confirms_everything_says_little():
    """Share of wrong candidates that other views confirm: none of 10 points' 2 wrong ones each, or all of them."""
    points = np.repeat(np.arange(10), 3)
    out = np.zeros((30, 3))
    out[:, 1:] = [2, 3]
    out[::3, 1] = 3  # the right one of each three is confirmed
    assert _wrongly_confirmed(points, out) == 0
    out[:, 1] = 3
    assert _wrongly_confirmed(points, out) == pytest.approx(20 / 30)  # 20 wrong ones, and 10 that stand for doubt
