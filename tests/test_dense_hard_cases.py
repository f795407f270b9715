"""Scenes that dense matching must not fall for: no depth where nothing tells it, and edges where they are.

Limits are what one who measures would ask; `dense_scenes.py` says what counts as wrong.
"""

from functools import cache

import numpy as np
import pytest
from dense_scenes import look, rig_of, shaded, share
from scipy.ndimage import distance_transform_edt, map_coordinates

from benchmarks.synthetic import Ball, Plane, lattice, patched, plain, stripes, take, texture

WINDOW = 10 * 800 / 600  # mm, 10 px at the depth of most planes here: windows reach across a border so far
PATCH = (-40.0, 40.0, -40.0, 40.0)  # mm: 60 x 60 px


@cache
def step(facets):
    """A near board before a far wall: 10 px of disparity between them."""
    board = Plane(560, texture(560, at=200), box=(-25, 25, -25, 25))
    return take(rig_of(facets), board, Plane(1000, texture(1000)))


def test_the_photographs_show_what_their_truth_says():
    shot = step(3)
    for own, view in enumerate(shot.rig):
        rows, columns = np.nonzero(view.region.mask)
        # a pixel's ray ends at its point, on the board or the wall
        np.testing.assert_allclose(view.project(shot.points[rows, columns]), np.stack([columns, rows], -1), atol=1e-6)
        assert set(np.unique(shot.depth[rows, columns].round(6))) == {560.0, 1000.0}
        for other in range(len(shot.rig)):
            both = view.region.mask & shot.views[1][other]
            places = shot.rig[other].project(shot.points[both])
            seen = map_coordinates(shot.light, places.T[::-1], order=3)
            # where the truth says that views see the same point, they show the same grey; edges mix within a pixel
            assert np.percentile(np.abs(seen - shot.light[both]), 95) < (8 if other != own else 1e-6)


# ---- nothing to see: no depth ----------------------------------------------------------------------------------


@pytest.mark.parametrize(("facets", "noise", "shade"), [(2, 0, False), (2, 2, True), (3, 2, False)])
def test_a_patch_without_texture_has_no_depth(facets, noise, shade):
    shot = take(rig_of(facets), Plane(800, patched(texture(800), plain(), PATCH)))
    light = shaded(shot.light) if shade else shot.light
    found = look(shot, light, noise)
    inner, around = shot.inside(PATCH, WINDOW), shot.common & ~shot.inside(PATCH, -WINDOW)
    assert found.known(inner) <= 0.01
    assert found.known(around) >= 0.95
    assert found.wrong(around) <= 0.005
    assert found.wrong(shot.inside(PATCH)) <= 0.01  # its rim may have depth, but not a wrong one


@pytest.mark.parametrize("facets", [2, 4])
def test_noise_alone_gives_no_depth(facets):
    shot = take(rig_of(facets), Plane(800, plain()))
    found = look(shot, shot.light, noise=4)
    assert found.known(shot.rig.masks.any(0)) <= 0.01


def test_lines_along_the_baseline_tell_two_views_nothing():
    shot = take(rig_of(2), Plane(800, stripes(800)))
    found = look(shot, shot.light, 2)
    assert found.known(shot.common) <= 0.02
    assert found.wrong(shot.common) <= 0.01


def test_lines_along_one_baseline_are_no_trouble_for_four_views():
    shot = take(rig_of(4), Plane(800, stripes(800)))
    found = look(shot, shot.light, 2)
    across = shot.common & (shot.views[1].sum(axis=0) == 4)
    assert found.known(across) >= 0.85  # on crests of the lines, wider than windows, there is little to hold on to
    assert found.wrong(across) <= 0.01


def test_what_is_nearer_than_the_depths_searched_has_no_depth():
    shot = take(rig_of(3), Plane(800, texture(800)))
    found = look(shot, shot.light, 2, depths=(1000.0, 1500.0))
    assert found.known(shot.common) <= 0.01  # 4 px of disparity beyond the range


# ---- repeated texture -------------------------------------------------------------------------------------------


@pytest.mark.parametrize("depth", [760, 1050])
def test_two_views_of_a_repeated_texture_hold_back(depth):
    # a period of 6 px in a range of 16 px of disparity: two or three depths look alike
    shot = take(rig_of(2), Plane(depth, lattice(depth, 6.0)))
    assert look(shot, shot.light, 1).wrong(shot.common) <= 0.05


@pytest.mark.parametrize("depth", [760, 1050])
def test_a_patch_of_repeated_texture_has_the_depth_around_it_or_none(depth):
    patch = patched(texture(depth), lattice(depth, 6.0), PATCH)
    shot = take(rig_of(2), Plane(depth, patch))
    found = look(shot, shot.light, 1)
    assert found.wrong(shot.inside(PATCH)) <= 0.05
    assert found.wrong(shot.common & ~shot.inside(PATCH, -WINDOW)) <= 0.005


@pytest.mark.parametrize(("facets", "turn_deg"), [(3, 0), (4, 45)])
def test_more_views_see_through_a_repeated_texture(facets, turn_deg):
    # along one baseline two or three depths look alike, along the others only the right one does
    shot = take(rig_of(facets), Plane(800, lattice(800, 6.0, turn_deg)))
    found = look(shot, shot.light, 1)
    where = shot.views[1].sum(axis=0) >= 3
    assert found.known(where) >= 0.9
    assert found.wrong(where) <= 0.01


# ---- edges ------------------------------------------------------------------------------------------------------


def edge_distance(shot):
    """(H, W) px from each pixel to the nearest one of another surface in the same view."""
    distance = np.full(shot.depth.shape, np.inf)
    for view in shot.rig:
        traced = view.region.traced
        for k in range(len(shot.surfaces)):
            other = traced & (shot.surface != k)
            if other.any():
                mine = traced & (shot.surface == k)
                distance[mine] = distance_transform_edt(~other)[mine]
    return distance


@pytest.mark.parametrize("facets", [2, 4])
def test_an_occlusion_edge_is_an_edge(facets):
    shot = step(facets)
    found = look(shot, shot.light, 2)
    distance = edge_distance(shot)
    depth = found.found.depth
    between = (depth > 560 * 1.03) & (depth < 1000 * 0.96)  # more than half a px from both
    assert share(between, distance <= 8) <= 0.01
    assert found.wrong(shot.common & (distance > 3) & (distance <= 10)) <= 0.01
    assert found.known(shot.common & (distance > 3)) >= 0.93
    if facets == 2:  # more views leave hardly a pixel hidden from all others
        assert found.known(shot.hidden) <= 0.05


def test_a_board_does_not_grow_over_a_plain_wall():
    # the board's outline is the only texture in the windows beside it: their depth would be the board's
    board = Plane(560, texture(560, at=200), box=(-25, 25, -25, 25))
    shot = take(rig_of(3), board, Plane(1000, plain()))
    found = look(shot, shot.light, 1)
    distance, wall = edge_distance(shot), shot.common & (shot.surface == 1)
    assert found.known(shot.common & (shot.surface == 0) & (distance > 3)) >= 0.95
    assert found.wrong(wall & (distance > 3) & (distance <= 10)) <= 0.1
    assert found.known(wall & (distance > 10)) <= 0.01


def test_a_plain_board_does_not_sink_into_the_wall():
    board = Plane(560, plain(90.0), box=(-25, 25, -25, 25))
    shot = take(rig_of(3), board, Plane(1000, texture(1000)))
    found = look(shot, shot.light, 1)
    distance = edge_distance(shot)
    assert found.wrong((shot.surface == 0) & (distance > 3)) <= 0.02
    assert found.known(shot.common & (shot.surface == 1) & (distance > 12)) >= 0.95
    assert found.wrong(shot.common & (shot.surface == 1) & (distance > 3)) <= 0.005


def test_bars_4_px_wide_are_left_out_or_right():
    bars = [Plane(600, texture(600, at=50 * k), box=(x - 2, x + 2, -60, 60)) for k, x in enumerate((-30, 0, 30))]
    shot = take(rig_of(3), *bars, Plane(800, texture(800)))
    found = look(shot, shot.light, 1)
    distance, wall = edge_distance(shot), shot.common & (shot.surface == 3)
    assert found.wrong(shot.surface < 3) <= 0.12  # windows are wider than they are
    assert found.wrong(wall & (distance > 3)) <= 0.005
    assert found.known(wall & (distance > 3)) >= 0.93


def test_a_ball_has_no_skirt():
    ball = Ball((0, 0, 650), 40, texture(600, at=200))
    shot = take(rig_of(3), ball, Plane(1000, texture(1000)))
    found = look(shot, shot.light, 2)
    distance = edge_distance(shot)
    between = (found.found.depth > 660) & (found.found.depth < 1000 * 0.96)
    assert share(between, distance <= 8) <= 0.01
    assert found.known(shot.common & (shot.surface == 0) & (distance > 6)) >= 0.9
    assert found.wrong(shot.common) <= 0.01


def test_a_steep_plane_is_found():
    shot = take(rig_of(3), Plane(800, texture(800), slope=3.5))  # at 74 deg, 580 to 1000 mm
    found = look(shot, shot.light, 2)
    assert found.known(shot.common) >= 0.8
    assert found.wrong(shot.common) <= 0.002
    assert found.median(shot.common) <= 0.04  # px; planes held upright in windows give 0.06
