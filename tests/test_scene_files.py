"""Scene files: what they describe, and what they say when they are wrong."""

import re
from pathlib import Path

import cv2
import numpy as np
import pytest
import trimesh
from scenes import small_setup

from cyclopean.errors import SetupError
from cyclopean.files.disk import parse_toml
from cyclopean.files.scene_meshes import read_mesh
from cyclopean.files.scene_starter import starter_scene
from cyclopean.files.scene_tables import OBJECTS
from cyclopean.files.scenes import read_scene, scene_from
from cyclopean.geometry import rotation_from_vector
from cyclopean.simulation.paints import Picture, Speckle, linear_light
from cyclopean.simulation.prints import Print

PLANE = 'kind = "plane"\nsize_mm = [40, 30]\ncentre_mm = [1, 2, 900]\n'


@pytest.fixture
def scene(tmp_path):
    """Read the text of a scene file in a folder of its own."""

    def read(text):
        path = tmp_path / "scene.toml"
        path.write_text(text, encoding="utf-8")
        return read_scene(path)

    return read


def test_light_and_planes_stand_where_the_file_says(scene):
    found = scene(
        "[light]\nambient = 0.6\nbackground = [0.1, 0.2, 0.3]\n"
        "[[light.lamp]]\nposition_mm = [-300, -400, 0]\nstrength = 0.5\nshadows = false\n"
        "[[light.lamp]]\ndirection = [0, 0.5, 1]\n"
        f'[[object]]\n{PLANE}rotation_deg = [0, 20, 0]\ntexture = "speckle"\ntexture_size_mm = 3\nluminous = true\n'
    )
    assert (found.ambient, found.background) == (0.6, (0.1, 0.2, 0.3))
    lamp, sun = found.lamps
    assert (lamp.position, lamp.strength, lamp.shadows) == ((-300.0, -400.0, 0.0), 0.5, False)
    assert (sun.direction, sun.strength, sun.shadows) == ((0.0, 0.5, 1.0), 1.0, True)
    (wall,) = found.surfaces
    corners = np.array([[-20, -15, 0], [20, -15, 0], [20, 15, 0], [-20, 15, 0]])
    turn = rotation_from_vector([0, np.deg2rad(20), 0])
    np.testing.assert_allclose(wall.vertices, corners @ turn.T + [1, 2, 900], atol=1e-12)
    np.testing.assert_allclose(wall.places, corners[:, :2])
    assert wall.paint == Speckle(3.0, seed=1)
    assert (wall.luminous, wall.name) == (True, "object 1 (plane)")


def test_every_kind_of_object_is_as_large_as_the_file_says(scene, tmp_path):
    grey = np.zeros((20, 30), np.uint16)
    grey[5:10] = 65535
    cv2.imwrite(str(tmp_path / "relief.png"), grey)
    found = scene(
        '[[object]]\nkind = "box"\nsize_mm = [30, 20, 10]\ncentre_mm = [0, 0, 500]\ncolor = [0.1, 0.2, 0.3]\n'
        '[[object]]\nkind = "sphere"\nradius_mm = 7\ncentre_mm = [0, 0, 500]\ntexture = "noise"\ntexture_size_mm = 1\n'
        '[[object]]\nkind = "cylinder"\nradius_mm = 7\nlength_mm = 30\ncentre_mm = [0, 0, 500]\ngrey = 0.3\n'
        '[[object]]\nkind = "heightmap"\nfile = "relief.png"\nsize_mm = [30, 20]\nheight_mm = 4\n'
        "centre_mm = [0, 0, 500]\n"
        '[[object]]\nkind = "board"\ncentre_mm = [0, 0, 500]\n'
        'board = { kind = "chessboard", columns = 6, rows = 4, square = 5.0 }\n'
    )
    extents = [np.ptp(surface.vertices, axis=0) for surface in found.surfaces]
    wanted = [(30, 20, 10), (14, 14, 14), (14, 30, 14), (30, 20, 4), (35, 25, 0)]  # the board with its margin
    np.testing.assert_allclose(extents, wanted, atol=1e-9)
    for surface in found.surfaces[:3]:
        np.testing.assert_allclose(surface.vertices.mean(0)[2], 500, atol=0.1)
    relief, board = found.surfaces[3:]
    assert (relief.vertices[:, 2].min(), relief.vertices[:, 2].max()) == (496, 500)  # white stands out
    assert isinstance(board.paint, Print)
    np.testing.assert_allclose(board.vertices.mean(0), [0, 0, 500], atol=1e-9)


def test_a_picture_is_stretched_or_repeated_in_linear_light(scene, tmp_path):
    image = np.random.default_rng(0).integers(0, 256, (4, 8, 3), dtype=np.uint8)
    cv2.imwrite(str(tmp_path / "p.png"), image[..., ::-1])
    found = scene(
        f'[[object]]\n{PLANE}texture = "p.png"\n[[object]]\n{PLANE}texture = "p.png"\ntexture_size_mm = 10\n'
        f'[[object]]\n{PLANE}texture = "p.png"\nlinear = true\n'
    )
    stretched, repeated, linear = found.surfaces
    np.testing.assert_allclose(stretched.paint.image, linear_light(image), atol=1e-6)
    np.testing.assert_allclose(linear.paint.image, image / 255, atol=1e-6)  # float32
    np.testing.assert_allclose(stretched.places, [[0, 0], [1, 0], [1, 1], [0, 1]])
    assert (repeated.paint.size, repeated.paint.repeat) == ((10.0, 5.0), True)


def test_meshes_bring_unit_place_colours_and_texture(scene, tmp_path):
    part = trimesh.creation.box((2, 4, 6))
    part.apply_translation([100, 0, 0])
    part.export(tmp_path / "part.stl")
    part.visual.vertex_colors = np.random.default_rng(0).integers(0, 256, (8, 4))
    part.export(tmp_path / "coloured.ply")
    cv2.imwrite(str(tmp_path / "p.png"), np.random.default_rng(1).integers(0, 256, (8, 8, 3), dtype=np.uint8))
    (tmp_path / "t.mtl").write_text("newmtl a\nmap_Kd p.png\n")
    corners = "v 0 0 0\nv 10 0 0\nv 10 10 0\nvt 0 0\nvt 1 0\nvt 1 1\nusemtl a\nf 1/1 2/2 3/3\n"
    (tmp_path / "t.obj").write_text(f"mtllib t.mtl\n{corners}")
    found = scene(
        '[[object]]\nkind = "mesh"\nfile = "part.stl"\nunit = "cm"\n'
        '[[object]]\nkind = "mesh"\nfile = "part.stl"\ncentre_mm = [1, 2, 300]\nrotation_deg = [0, 0, 90]\n'
        '[[object]]\nkind = "mesh"\nfile = "coloured.ply"\n'
        '[[object]]\nkind = "mesh"\nfile = "t.obj"\n'
    )
    own, moved, coloured, textured = found.surfaces
    np.testing.assert_allclose([own.vertices.min(0), own.vertices.max(0)], [[990, -20, -30], [1010, 20, 30]])
    np.testing.assert_allclose([moved.vertices.min(0), moved.vertices.max(0)], [[-1, 1, 297], [3, 3, 303]], atol=1e-6)
    colours = coloured.paint.reflectance(coloured.places)
    np.testing.assert_allclose(colours, linear_light(part.visual.vertex_colors[:, :3]), atol=1e-6)
    assert isinstance(textured.paint, Picture)
    # texture files count v from the bottom up
    np.testing.assert_allclose(textured.places, [[0, 1], [1, 1], [1, 0]])


def test_what_is_no_mesh_is_refused(tmp_path):
    files = {
        "text.stl": ("hello", "no triangles"),
        "empty.stl": ("", "empty"),
        "nan.obj": ("v 0 0 0\nv 1 0 0\nv nan 1 0\nf 1 2 3\n", "1 of 3 corners are not numbers"),
        "point.obj": ("v 1 1 1\nv 1 1 1\nv 1 1 1\nf 1 2 3\n", "no surface"),
        "line.obj": ("v 0 0 0\nv 1 0 0\nv 2 0 0\nf 1 2 3\n", "no surface"),
        "far.obj": ("v 0 0 0\nv 1e30 0 0\nv 0 1 0\nf 1 2 3\n", "is the unit right"),
        "alone.obj": ("mtllib gone.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n", "colours are in gone.mtl"),
        "half.glb": ("glTF", "damaged"),
        "part.step": ("ISO-10303", "not from .step"),
    }
    for name, (text, said) in files.items():
        (tmp_path / name).write_text(text)
        with pytest.raises(SetupError, match=said):
            read_mesh(tmp_path / name)
    trimesh.PointCloud(np.random.default_rng(0).normal(size=(10, 3))).export(tmp_path / "cloud.ply")
    with pytest.raises(SetupError, match="10 points and no triangles"):
        read_mesh(tmp_path / "cloud.ply")
    with pytest.raises(SetupError, match="no such file"):
        read_mesh(tmp_path / "gone.stl")


def test_colours_that_a_mesh_brings(scene, tmp_path):
    corners = "v 0 0 0\nv 30 0 0\nv 0 30 0\n"
    (tmp_path / "red.mtl").write_text("newmtl red\nKd 1 0 0\n")
    (tmp_path / "red.obj").write_text(f"mtllib red.mtl\n{corners}usemtl red\nf 1 2 3\n")
    (tmp_path / "alone.obj").write_text(f"mtllib gone.mtl\n{corners}f 1 2 3\n")
    mesh = '[[object]]\nkind = "mesh"\nfile = "{}"\ncentre_mm = [0, 0, 500]\n'
    (red,) = scene(mesh.format("red.obj")).surfaces
    np.testing.assert_allclose(red.paint.reflectance(red.places), [[1, 0, 0]] * 3)
    (grey,) = scene(mesh.format("alone.obj") + "grey = 0.3\n").surfaces  # paint of its own needs no other file
    np.testing.assert_allclose(grey.paint.reflectance(grey.places), 0.3)


def test_only_glb_states_colours_as_light(tmp_path):
    part = trimesh.creation.box((1, 1, 1))
    colour = np.uint8([128, 64, 255])
    part.visual.vertex_colors = [*colour, 255]
    for name, light in (("part.glb", colour / 255), ("part.ply", linear_light(colour))):
        part.export(tmp_path / name)
        _, _, colours = read_mesh(tmp_path / name)
        np.testing.assert_allclose(colours, np.broadcast_to(light, colours.shape), atol=1e-6)  # single precision


def test_dots_of_a_texture_without_a_size_suit_the_object(scene):
    (wall,) = scene(f'[[object]]\n{PLANE}texture = "speckle"\n').surfaces
    assert wall.paint == Speckle(0.5, seed=1)  # 1/80 of 40 mm


def test_all_faults_of_a_file_are_told_at_once(scene):
    with pytest.raises(SetupError) as caught:
        scene(
            "[light]\nambient = -1\n[[light.lamp]]\nstrength = 1\n"
            '[[object]]\nkind = "plain"\n'
            '[[object]]\nkind = "plane"\nsize = [3, 3]\ncenter_mm = [0, 0, 900]\ntexture = "speckle"\n'
            '[[object]]\nkind = "sphere"\nradius_mm = nan\ncentre_mm = [0, 0, 1]\n'
            '[[object]]\nkind = "box"\nsize_mm = [1, 2, 0]\ncentre_mm = [1, 2, 3]\ngrey = 1.4\n'
        )
    lines = str(caught.value).splitlines()
    assert "8 things are wrong" in lines[0]
    for line in (
        "light.ambient = -1 must be a number of 0 or more",
        "lamp 1: give one of position_mm",
        'object 1: kind = "plain" must be one of plane, box, sphere, cylinder, mesh, heightmap, board; did you mean '
        "plane?",
        "object 2 (plane): size = [3, 3]: lengths are in mm: size_mm",
        "object 2 (plane): center_mm = [0, 0, 900]: unknown key; did you mean centre_mm?",
        "object 3 (sphere): radius_mm = nan must be a number of mm above 0",
        "object 4 (box): grey = 1.4 must be a number from 0 (black) to 1 (white)",
        "object 4 (box): size_mm = [1, 2, 0] must be three numbers of mm above 0",
    ):
        assert any(line in said for said in lines), line


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("object = []", "one or more tables"),
        ("[light]\nambient = 1", "object is missing"),
        ("[[object]]\nsize_mm = [1, 1]", "kind is missing"),
        (f'[[object]]\n{PLANE}texture = "spekle"', 'neither "speckle", "noise" or "checker" nor a picture file'),
        (f'[[object]]\n{PLANE}texture = "gone.png"', "object 1 (plane): "),
        (f'[[object]]\n{PLANE}texture = "speckle"\ntexture_size_mm = 1\ngrey = 0.5', "not texture and grey"),
        ('[[object]]\nkind = "mesh"\nfile = "gone.stl"', "object 1 (mesh): "),
        ('[[object]]\nkind = "board"\ncentre_mm = [0, 0, 9]', "give one of file"),
        ('[[object]]\nkind = "board"\ncentre_mm = [0, 0, 9]\nboard = { kind = "charuco" }', "board.columns is missing"),
        ("[[object]\n", "not TOML"),
    ],
)
def test_a_wrong_file_says_what_is_wrong(scene, text, said):
    with pytest.raises(SetupError) as caught:
        scene(text)
    assert "scene.toml: " in str(caught.value)
    assert said in str(caught.value)


def test_the_scene_to_begin_with_fills_the_photograph_and_keeps_to_its_depths():
    rig = small_setup().rig()
    found = scene_from(parse_toml(starter_scene(rig, (500.0, 1200.0)), "starter"), "starter")
    wall, ball = found.surfaces
    low, high = found.box[:, 2]
    assert 500 < low < high < 1200
    corners = wall.vertices
    for view in rig:
        rays = view.rays(view.region.outline[0])
        normal = np.cross(corners[1] - corners[0], corners[3] - corners[0])
        points = rays.at(((corners[0] - rays.origins) @ normal) / (rays.directions @ normal))
        points = points[np.isfinite(points[:, 0])]
        for edge in (corners[1] - corners[0], corners[3] - corners[0]):
            along = (points - corners[0]) @ edge / (edge @ edge)
            assert along.min() > 0
            assert along.max() < 1
    assert np.isfinite(rig.project(ball.vertices[ball.vertices[:, 2].argmin()])).all(-1).sum() >= 2


def test_the_scene_in_the_documentation_is_valid(scene):
    page = (Path(__file__).resolve().parents[1] / "docs/simulation.md").read_text(encoding="utf-8")
    (text,) = re.findall(r"```toml\n(.*?)```", page, re.DOTALL)
    assert len(scene(text).surfaces) == 3
    for table in OBJECTS.values():  # every key is told
        assert {name for name in table.model_fields if name != "kind" and f"`{name}" not in page} == set()
