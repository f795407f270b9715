"""Views of the rendered photographs, against what the renderer saw."""

import json
from dataclasses import replace

import numpy as np
import pytest

from benchmarks.data import renderer_setup

RENDERED = {
    "n2": ("calib_n2",),
    "n3": ("calib_n3", "calib_n3_ghosts"),
    "n4": ("calib_n4",),
    "n5": ("calib_n5",),
    "n3_pose": ("calib_n3_pose",),
    "n2_flip": ("calib_n2_flip",),
    "t2_b40": ("calib_t2_b40", "targets_t2_b40"),
    "t3_b40": ("calib_t3_b40", "targets_t3_b40"),
    "t4_b45": ("calib_t4_b45", "targets_t4_b45"),
}
SCENES = [f"n{n}_{kind}" for n in (2, 3, 4) for kind in ("bumpy", "round", "steps")]
SCENES += ["n3_chroma_round", "n3_pose_steps", "n5_bumpy"]


@pytest.mark.parametrize("name", RENDERED)
def test_board_corners_are_seen_where_the_renderer_sees_them(name, mitsuba):
    rig = renderer_setup(name).rig()
    for photographs in RENDERED[name]:
        with np.load(mitsuba / photographs / "corners.npz") as corners:
            facet, points, pixels = corners["facet"], corners["xyz_cam"], corners["uv"]
        ours = rig.project(points)[np.arange(len(facet)), facet]
        # 1e-11 px: both are exact but for some roundings of 1000 mm and 1000 px; NaN would fail too
        np.testing.assert_allclose(ours, pixels, rtol=0, atol=1e-11)


def test_board_corners_without_a_prism_are_seen_where_the_renderer_sees_them(mitsuba):
    with np.load(mitsuba / "camera_only" / "corners.npz") as corners:
        ours = renderer_setup("n2").camera.project(corners["xyz_cam"])
        np.testing.assert_allclose(ours, corners["uv"], rtol=0, atol=1e-11)  # roundings


@pytest.mark.parametrize(("channel", "index"), [("R", 1.51432), ("G", 1.51680), ("B", 1.52238)])
def test_colours_are_bent_as_by_the_renderer(channel, index, mitsuba):
    setup = renderer_setup("n3")
    rig = replace(setup, optic=replace(setup.optic, glass=index)).rig()
    with np.load(mitsuba / "calib_n3_chroma" / "corners.npz") as corners:
        facet, points, pixels = corners["facet"], corners["xyz_cam"], corners[f"uv_{channel}"]
    ours = rig.project(points)[np.arange(len(facet)), facet]
    seen = np.isfinite(pixels).all(-1)
    np.testing.assert_allclose(ours[seen], pixels[seen], rtol=0, atol=1e-11)  # roundings


@pytest.mark.parametrize("name", RENDERED)
def test_pixels_look_through_the_facets_of_the_renderer(name, mitsuba):
    rig = renderer_setup(name).rig()
    with np.load(mitsuba / "rigs" / f"{name}_facets.npz") as truth:
        np.testing.assert_array_equal(rig.facets, truth["facet"])


@pytest.mark.parametrize("name", SCENES)
def test_scene_points_are_seen_where_the_renderer_sees_them(name, mitsuba):
    facts = json.loads((mitsuba / "scenes" / f"{name}.json").read_text())
    rig = renderer_setup(facts["rig"]).rig()
    with np.load(mitsuba / "scenes" / f"{name}.npz") as scene:
        points, pixels, step, xyz = (scene[key].astype(float) for key in ("match_xyz", "match_uv", "step", "xyz"))
        # a bumpy scene is a mesh, and a ray along a seam may slip through it: some pixels in 1e6
        assert (rig.facets == scene["facet"]).mean() > 0.99999
    ours = rig.project(points)
    seen = np.isfinite(pixels[..., 0])
    # 1e-4 px: the file rounds pixels by up to 3e-5 px, points of 1000 mm by 3e-5 mm, both as float32
    np.testing.assert_allclose(ours[seen], pixels[seen], rtol=0, atol=1e-4)
    # what we see and the renderer does not is hidden: something stands nearer, there or at the pixels around
    point, view = np.nonzero(np.isfinite(ours[..., 0]) & ~seen)
    column, row = np.rint(ours[point, view] / step).astype(int).T
    around = np.pad(xyz[..., 2], 2, mode="edge")
    nearest = np.fmin.reduce([around[row + i, column + j] for i in (1, 2, 3) for j in (1, 2, 3)])
    assert (nearest < points[point, 2] - 5).all()  # mm: far above any rounding, below the depth of every object
