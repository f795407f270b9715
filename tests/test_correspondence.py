"""Points that belong together: found again among noise, gaps and clutter, refused where nothing can tell."""

import numpy as np
import pytest
from scenes import photograph_plane, small_setup
from setups import SETUPS
from unlabelled import (
    DEPTHS,
    RIG,
    SIGMA,
    along_a_ray,
    judged,
    random_scene,
    seen_by,
    triangulated_middle,
    visible,
)

from cyclopean import Camera, Mirror, Mirrors, Rig, Setup
from cyclopean.correspondence import align, match_features, match_points, match_target
from cyclopean.epipolar import epipolar_curves
from cyclopean.errors import ImageError, SetupError, ShapeError
from cyclopean.rigs import fit, pinhole_rig


def test_random_points_are_found_again_among_noise_gaps_and_clutter():
    points = random_scene(RIG)
    pixels, names = seen_by(RIG, points, lost=0.05, clutter=20)
    matches = match_points(RIG, pixels, DEPTHS, sigma=SIGMA)
    right, found = judged(matches, names)
    # 3.5 sigma leave out one in 2000 pairs. A false match must be 5 times likelier than its rivals: at most 1 in 6 of
    # the most doubtful ones, far fewer of all
    assert right.mean() >= 0.98
    both, three = visible(names, 2), visible(names, 3)
    assert np.isin(three, found).mean() >= 0.98  # a third view removes the doubt
    assert np.isin(both, found).mean() >= 0.9  # of two views alone some stay doubtful and are left out


def test_points_are_where_they_are_within_their_covariance():
    points = random_scene(RIG)
    pixels, names = seen_by(RIG, points)
    matches = match_points(RIG, pixels, DEPTHS, sigma=SIGMA)
    right, found = judged(matches, names)
    gap = matches.points[right] - points[found[right]]
    squared = np.einsum("ni,nij,nj->n", gap, np.linalg.inv(matches.covariance[right]), gap)
    # chi-square with 3 degrees of freedom: its mean over 250 points has a standard deviation of sqrt(6 / 250) = 0.15
    assert squared.mean() == pytest.approx(3.0, abs=0.6)
    np.testing.assert_array_equal(matches.views, np.isfinite(matches.pixels[..., 0]).sum(1))
    assert (matches.views <= matches.expected).all()


def test_no_point_is_used_twice():
    points = random_scene(RIG, 400)
    pixels, _ = seen_by(RIG, points, clutter=300)
    matches = match_points(RIG, pixels, DEPTHS, sigma=SIGMA, max_ambiguity=1.0)
    for view, rows in enumerate(matches.source.T):
        used = rows[rows >= 0]
        assert len(used) == len(set(used))
        np.testing.assert_array_equal(matches.pixels[rows >= 0, view], pixels[view][used])
    assert np.isnan(matches.pixels[matches.source < 0]).all()
    assert ((matches.source >= 0).sum(1) >= 2).all()


def test_the_order_of_views_and_points_does_not_matter():
    points = random_scene(RIG, 200)
    pixels, _ = seen_by(RIG, points, clutter=20)
    order = [3, 0, 4, 2, 1]
    turned = Rig(tuple(RIG[k] for k in order))

    def tuples(matches, views):
        back = np.argsort(views)
        return {tuple(row) for row in matches.source[:, back]}

    straight = tuples(match_points(RIG, pixels, DEPTHS, sigma=SIGMA), range(5))
    other = tuples(match_points(turned, [pixels[k] for k in order], DEPTHS, sigma=SIGMA), order)
    # what the first view of a pair stands for is linearised, and densities differ a little: only the doubtful may flip
    assert len(straight & other) >= 0.98 * len(straight | other)
    backwards = match_points(RIG, [one[::-1] for one in pixels], DEPTHS, sigma=SIGMA)
    lengths = np.array([len(one) for one in pixels])
    renamed = {tuple(np.where(row >= 0, lengths - 1 - row, -1)) for row in backwards.source}
    assert renamed == straight


@pytest.mark.parametrize("seed", range(3))
def test_two_points_on_one_epipolar_curve_cannot_be_told_apart_by_two_views(seed):
    pair = Rig(RIG.views[:2])
    shared = triangulated_middle(pair)
    ray = pair[0].project(shared)
    points = along_a_ray(pair, [shared[2], shared[2] + 60], ray)
    second = pair[1].project(points) + np.random.default_rng(seed).normal(0, 1e-3, (2, 2))
    both = match_points(pair, [ray[None], second], DEPTHS, sigma=SIGMA, max_ambiguity=1.0)
    one = match_points(pair, [ray[None], second[:1]], DEPTHS, sigma=SIGMA, max_ambiguity=1.0)
    assert len(both) == len(one) == 1
    # both lie on the curve to 0.01 sigma: the likelihoods differ only by how the two densities are taken
    assert both.ambiguity[0] > 0.8
    assert one.ambiguity[0] < 0.01
    np.testing.assert_allclose(one.points[0], points[0], atol=0.1)
    refused = match_points(pair, [ray[None], second], DEPTHS, sigma=SIGMA)
    assert len(refused) == 0
    assert refused.counts.refused == len(refused.refused) == 1


def test_a_third_view_tells_them_apart():
    three = Rig(RIG.views[:3])
    shared = triangulated_middle(three)
    ray = three[0].project(shared)
    points = along_a_ray(three, [shared[2], shared[2] + 60], ray)
    second, third = three[1].project(points), three[2].project(points[:1])
    matches = match_points(three, [ray[None], second, third], DEPTHS, sigma=SIGMA, max_ambiguity=1.0)
    best = matches.select(matches.views == 3)
    assert len(best) == 1
    np.testing.assert_array_equal(best.source[0], [0, 0, 0])
    assert best.ambiguity[0] < 0.01


def test_a_missing_third_point_speaks_against_a_pair():
    three = Rig(RIG.views[:3])
    shared = triangulated_middle(three)
    pixels = three.project(shared)
    full = match_points(three, [p[None] for p in pixels], DEPTHS, max_ambiguity=1.0)
    far = pixels[2] + [40.0, 40.0]
    missing = match_points(three, [pixels[:1], pixels[1:2], far[None]], DEPTHS, max_ambiguity=1.0)
    assert (full.views[0], full.expected[0]) == (3, 3)
    assert (missing.views[0], missing.expected[0]) == (2, 3)
    assert missing.ambiguity[0] > full.ambiguity[0]


def grid_of_dots(pitch, depth=750.0, roll=0.0):
    """A wavy sheet of dots."""
    x = np.arange(-150, 150, pitch)
    x, y = (a.ravel() for a in np.meshgrid(x, x))
    c, s = np.cos(roll), np.sin(roll)
    x, y = c * x - s * y, s * x + c * y
    return np.stack([x, y, depth + 0.15 * x - 0.1 * y + 10 * np.sin(x / 40)], -1)


def test_more_views_remove_the_false_matches_of_two():
    """On a grid whose rows run along the epipolar curves of the first two views."""
    pair = Rig(RIG.views[:2])
    middle = triangulated_middle(pair)
    way = epipolar_curves(pair, 0, pair[0].project(middle), DEPTHS).pixels[1]
    roll = np.arctan2(*(way[-1] - way[0])[::-1])
    points = grid_of_dots(5.0, roll=roll)
    false = {}
    for views in (2, 3, 5):
        rig = Rig(RIG.views[:views])
        pixels, names = seen_by(rig, points, lost=0.05)
        matches = match_points(rig, pixels, (300, 3000), sigma=SIGMA, max_ambiguity=1.0)
        right, _ = judged(matches, names)
        false[views] = 1 - right.mean()
        if views > 2:
            sure = matches.views >= 3
            assert 1 - right[sure].mean() < 0.02
    assert false[2] > 0.1  # several dots of the band are as good as the right one
    assert false[5] < 0.5 * false[2]


def unnamed_corners(mitsuba, folder, views):
    """The renderer's true corners of four photographs as each view shows them, 0.5 px of noise, without their names."""
    truth, random = np.load(mitsuba / folder / "corners.npz"), np.random.default_rng(6)
    for photo in range(4):
        mine = [np.flatnonzero((truth["view"] == photo) & (truth["facet"] == k)) for k in range(views)]
        mine = [random.permutation(rows) for rows in mine]
        pixels = [truth["uv"][rows] + random.normal(0, 0.5, (len(rows), 2)) for rows in mine]
        yield pixels, [truth["corner_id"][rows] for rows in mine]


@pytest.mark.parametrize("views", [2, 3, 4, 5])
def test_chessboard_corners_without_names(mitsuba, views):
    """A coarse board: no view leaves a doubt, and more views leave no fewer of the points of the first two."""
    from benchmarks.data import renderer_setup

    rig = Rig(renderer_setup("n5").rig().views[:views])
    matched, points = 0, 0
    for pixels, names in unnamed_corners(mitsuba, "calib_n5", views):
        matches = match_points(rig, pixels, (300, 3000), sigma=0.5)
        right, found = judged(matches, names)
        assert right.all()  # 20 mm stand for 50 px, and no two corners share a band of 3.5 x 0.7 px for long
        both = np.intersect1d(names[0], names[1])
        matched, points = matched + np.isin(both, found).sum(), points + len(both)
    assert matched >= 0.85 * points  # those that another corner's band crosses stay doubtful in two views


def test_more_views_remove_false_matches_of_a_board_along_both_baselines(mitsuba):
    """A square board parallel to the sensor behind a square prism: each view confirms the lattice shifted by a row."""
    from benchmarks.data import renderer_setup

    every = renderer_setup("t4_b45").rig()
    joined = {}
    for pair in ((0, 1), (0, 2)):
        for order in (pair, (*pair, *(k for k in range(4) if k not in pair))):
            rig, false, count = Rig(tuple(every[k] for k in order)), 0, 0
            for pixels, names in unnamed_corners(mitsuba, "targets_t4_b45", 4):
                given = [pixels[k] for k in order], [names[k] for k in order]
                matches = match_points(rig, given[0], (300, 3000), sigma=0.5, max_ambiguity=1.0)
                right, _ = judged(matches, given[1])
                both = (matches.source[:, :2] >= 0).all(1)
                false, count = false + np.count_nonzero(~right[both]), count + both.sum()
            joined[pair, len(order)] = false / count
        assert joined[pair, 2] > 0.1  # without a third view many corners fit several partners
        assert joined[pair, 4] < 0.75 * joined[pair, 2]


def test_unrelated_points_are_not_matched():
    """Points drawn anew in every view: the sets that fit best are those that chance made fit."""
    random = np.random.default_rng(8)
    pixels = []
    for view in RIG:
        y, x = np.nonzero(view.region.mask)
        some = random.integers(0, len(y), 300)
        pixels.append(np.stack([x[some], y[some]], -1) + random.uniform(-0.5, 0.5, (300, 2)))
    assert match_points(RIG, pixels, DEPTHS, sigma=SIGMA, max_ambiguity=1.0).counts.matched > 20
    assert len(match_points(RIG, pixels, DEPTHS, sigma=SIGMA)) <= 3  # of 1500 points


def test_a_photograph_of_noise_has_no_matches():
    noise = np.random.default_rng(0).integers(0, 255, RIG.size[::-1], dtype=np.uint8)
    doubtful = match_features(noise, RIG, DEPTHS, detector="orb", max_ambiguity=1.0, refine=False, most=1500)
    assert len(doubtful) > 30
    assert len(match_features(noise, RIG, DEPTHS, detector="orb", refine=False, most=1500)) <= 1


def test_features_at_edges_in_depth_are_refused(mitsuba):
    from benchmarks.data import renderer_setup
    from benchmarks.sparse import off_every_depth
    from cyclopean.files import read_photograph

    rig, scene = renderer_setup("n3").rig(), mitsuba / "scenes" / "n3_steps"
    photograph, depth = read_photograph(scene.with_suffix(".png")), np.load(scene.with_suffix(".npz"))["xyz"][..., 2]
    matches = match_features(photograph, rig, (600, 1600))
    assert len(matches) > 3000
    # windows over an edge see two surfaces; those whose halves disagree by less than 0.4 px remain
    assert off_every_depth(matches, rig, depth).mean() < 0.004


def test_descriptors_decide_where_place_cannot():
    pair = Rig(RIG.views[:2])
    shared = triangulated_middle(pair)
    ray = pair[0].project(shared)
    points = along_a_ray(pair, [shared[2], shared[2] + 60], ray)
    random = np.random.default_rng(1)
    filler = random.normal(size=(2, 40, 16))  # points elsewhere, so that there is a background
    far = [view.region.centre + random.uniform(-3, 3, (40, 2)) + [0, 25] for view in pair]
    look, other = random.normal(size=(2, 16))
    pixels = [np.vstack([ray[None], far[0]]), np.vstack([pair[1].project(points), far[1]])]
    for right in (0, 1):
        looks = [np.vstack([look, filler[0]]), np.vstack([[look, other] if right == 0 else [other, look], filler[1]])]
        matches = match_points(pair, pixels, DEPTHS, descriptors=looks, max_ambiguity=1.0)
        mine = matches.select(matches.source[:, 0] == 0)
        assert mine.source[0, 1] == right
        assert mine.ambiguity[0] < 0.2


@pytest.mark.parametrize("name", ["prism, bent lens", "two mirrors, bent lens", "biprism in water, straight lens"])
def test_other_optics(name):
    """Refraction in water, mirrors that flip, distortion: the matcher knows only views."""
    setup = SETUPS[name]
    rig = setup.rig()
    depths = rig.working_depths
    depths = depths[0], min(depths[1], 5 * depths[0])
    first = rig[0]
    random = np.random.default_rng(5)
    y, x = np.nonzero(first.region.mask)
    pick = random.integers(0, len(y), 3000)
    inverse = random.uniform(1 / depths[1], 1 / depths[0], len(pick))
    points = first.rays(np.stack([x[pick], y[pick]], 1).astype(float)).at_depth(1 / inverse)
    points = points[(np.isfinite(rig.project(points)[..., 0]).sum(1) >= 2)][:60]
    assert len(points) > 20
    pixels, names = seen_by(rig, points)
    matches = match_points(rig, pixels, depths, sigma=SIGMA)
    right, found = judged(matches, names)
    assert right.mean() >= 0.95  # at most a few of some 60 by chance
    assert np.isin(visible(names, 2), found).mean() >= 0.8


def test_nothing_to_match_is_no_error():
    empty = [np.zeros((0, 2))] * 5
    matches = match_points(RIG, empty, DEPTHS)
    assert len(matches) == 0
    assert matches.pixels.shape == (0, 5, 2)
    one = [RIG[0].region.centre[None], *empty[1:]]
    assert len(match_points(RIG, one, DEPTHS)) == 0
    lost = [np.full((3, 2), np.nan)] * 5
    assert len(match_points(RIG, lost, DEPTHS)) == 0


@pytest.mark.parametrize(
    ("changes", "fault", "said"),
    [
        ({"rig": Rig(RIG.views[:1])}, SetupError, "one view"),
        ({"points": [np.zeros((0, 2))] * 4}, ShapeError, "5 arrays"),
        ({"points": [np.zeros((4, 3))] * 5}, ShapeError, r"\(N, 2\)"),
        ({"points": [np.full((4, 2), -50.0)] * 5}, ShapeError, "order of the views"),
        ({"depths": (900, 500)}, SetupError, "near"),
        ({"sigma": 0.0}, SetupError, "sigma"),
        ({"sigma": np.nan}, SetupError, "sigma"),
        ({"min_views": 6}, SetupError, "from 2 to 5"),
        ({"max_ambiguity": 1.5}, SetupError, "max_ambiguity"),
        ({"detection": 1.0}, SetupError, "detection"),
        ({"ratio": 0.0}, SetupError, "ratio"),
        ({"descriptors": [np.zeros((1, 4))] * 5}, ShapeError, "descriptors"),
    ],
)
def test_wrong_calls_are_refused(changes, fault, said):
    given = {"rig": RIG, "points": [np.zeros((0, 2))] * 5, "depths": DEPTHS} | changes
    with pytest.raises(fault, match=said):
        match_points(**given)


@pytest.fixture(scope="module")
def plane():
    """A photograph of a textured plane, and its setup."""
    setup = small_setup()
    rig = setup.rig()
    photograph, depth = photograph_plane(rig, 800.0, slope=0.3, pitch=1.3)
    return rig, photograph, depth


@pytest.mark.parametrize("detector", ["sift", "orb"])
def test_features_of_a_textured_plane(plane, detector):
    rig, photograph, depth = plane
    matches = match_features(photograph, rig, (500, 1200), detector=detector)
    assert len(matches) > 40
    first = matches.pixels[np.arange(len(matches)), np.argmax(matches.source >= 0, 1)]
    column, row = np.rint(first).astype(int).T
    gap = np.abs(matches.points[:, 2] - depth[row, column])
    sigma = np.sqrt(matches.covariance[:, 2, 2])
    # pixels agree within 0.1 px; half a pixel of rounding moves the plane's depth by 0.3 mm
    assert (gap < 4 * sigma + 1).mean() >= 0.97
    rough = match_features(photograph, rig, (500, 1200), detector=detector, refine=False)
    aligned = align(photograph, rig, rough, sigma=0.1)
    assert np.percentile(aligned.residual, 90) < np.percentile(rough.residual, 90)  # of noise-free SIFT few are off


def test_features_need_a_picture(plane):
    rig, photograph, _ = plane
    with pytest.raises(ImageError, match="fewer than two views"):
        match_features(np.full_like(photograph, 90), rig, (500, 1200))
    with pytest.raises(ShapeError, match="240"):
        match_features(photograph[:-1], rig, (500, 1200))
    with pytest.raises(SetupError, match="detector"):
        match_features(photograph, rig, (500, 1200), detector="surf")
    with pytest.raises(SetupError, match="one view"):
        match_features(photograph, Rig(rig.views[:1]), (500, 1200))


def test_a_board_names_its_points(mitsuba):
    from benchmarks.data import renderer_setup
    from cyclopean.files import read_photograph
    from cyclopean.targets import Board

    rig = renderer_setup("n3").rig()
    board = Board("charuco", 14, 10, 20.0, 15.0, "DICT_5X5_250")
    folder = mitsuba / "calib_n3"
    matches, _ = match_target(read_photograph(folder / "view_02.png"), rig, board)
    truth = np.load(folder / "corners.npz")
    mine = truth["view"] == 2
    where = {int(k): x for k, x in zip(truth["corner_id"][mine], truth["xyz_cam"][mine], strict=True)}
    gap = matches.points - np.array([where[int(k)] for k in matches.label])
    sigma = np.sqrt(np.diagonal(matches.covariance, axis1=1, axis2=2))
    assert len(matches) > 60
    assert (np.abs(gap) < sigma).all()  # sigma is for 0.1 px; rendered corners are good to 0.02 px
    assert (matches.ambiguity == 0).all()


def test_features_of_a_mirrored_view():
    """A wall mirror beside the axis: the plane is seen directly, and flipped."""
    wall = Mirrors((Mirror((40, 0, 250), (-1, 0, 0), (400, 300)),), ((0,),), direct=True)
    rig = Setup(Camera((640, 480), 900), wall).rig()
    assert [view.mirrored for view in rig] == [True, False]
    photograph, _ = photograph_plane(rig, 800.0, slope=0.1, pitch=1.3)
    for detector in ("sift", "orb"):
        matches = match_features(photograph, rig, (500, 1500), detector=detector)
        gap = np.abs(matches.points[:, 2] - 0.1 * matches.points[:, 0] - 800)
        assert len(matches) > 500
        assert np.median(gap) < 0.5  # mm; 0.1 px of disparity stand for some 0.8 mm
        assert (gap < 5).mean() > 0.98


def test_a_rig_of_pinholes():
    rig = pinhole_rig([fit(view, DEPTHS) for view in RIG], RIG)
    points = random_scene(rig, 100)
    pixels, names = seen_by(rig, points)
    matches = match_points(rig, pixels, DEPTHS, sigma=SIGMA)
    right, found = judged(matches, names)
    assert right.mean() >= 0.97
    assert np.isin(visible(names, 3), found).mean() >= 0.97
