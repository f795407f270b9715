"""The fused mesh of surfaces of closed form, its files, and the command that writes it."""

from dataclasses import replace

import numpy as np
import pytest
import trimesh
from commands import run
from depth_maps import across, maps_of, plane, sphere, step
from scenes import photograph_plane, small_setup

from cyclopean import Camera, Setup, write_setup
from cyclopean.errors import SetupError, ShapeError
from cyclopean.files import write_image, write_ply
from cyclopean.files.meshes import write_mesh
from cyclopean.fusion import build_mesh, fuse
from cyclopean.fusion.mesh import _one_sided


@pytest.fixture(scope="module")
def rig():
    return small_setup().rig()


def seen_share(rig, points):
    """Share of points (N, 3) that fall on the mask of some view."""
    return np.any([view.region.contains(view.project(points)) for view in rig], axis=0).mean()


@pytest.mark.parametrize("stride", [1, 3])
def test_the_mesh_of_a_plane_has_its_area(rig, stride):
    maps = maps_of(rig, plane)
    mesh = build_mesh(rig, maps, stride=stride)
    x, y = np.meshgrid(np.arange(-350, 350.0), np.arange(-250, 250.0))
    true = seen_share(rig, np.stack([x, y, 800 + 0.3 * x], -1).reshape(-1, 3)) * x.size * np.hypot(1, 0.3)
    # the outline is lost to half a stride, 1.3 mm a pixel, of some 450 x 300 mm; cells overlap at the seams
    assert mesh.area == pytest.approx(true, rel=0.01 * (1 + stride))
    assert len(np.unique(np.sort(mesh.faces, axis=1), axis=0)) == len(mesh.faces)
    assert (across(mesh)[:, 2] < 0).all()
    assert np.abs(mesh.vertices[:, 2] - 800 - 0.3 * mesh.vertices[:, 0]).max() < 5e-3
    edges = np.sort(mesh.faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
    assert (
        np.mean(np.unique(edges, axis=0, return_counts=True)[1] > 2) < 0.005 * stride
    )  # a surface: two faces at an edge


@pytest.mark.parametrize("stride", [1, 2])
def test_the_mesh_of_a_sphere_has_its_area(rig, stride):
    mesh = build_mesh(rig, maps_of(rig, sphere), stride=stride)
    turn = np.pi * (1 + 5**0.5) * np.arange(40_000)
    height = 1 - 2 * (np.arange(40_000) + 0.5) / 40_000
    ring = np.sqrt(1 - height**2)
    points = np.stack([ring * np.cos(turn), ring * np.sin(turn), height], -1)  # Fibonacci's lattice: equal areas
    points = points * 60 + (5.0, -3.0, 760.0)
    facing = ((points - (5.0, -3.0, 760.0)) * points).sum(-1) < 0
    true = seen_share(rig, points[facing]) * facing.mean() * 4 * np.pi * 60**2
    # the last pixel at the limb, which is lost, is 12 mm deep: a cap of radius 60 has its edge there
    assert 0.75 * true < mesh.area < 1.02 * true
    inside = mesh.vertices[mesh.faces][..., 2].mean(1) < 730  # where all is seen well
    cap = np.linalg.norm(across(mesh)[inside], axis=-1).sum() / 2
    assert cap == pytest.approx(2 * np.pi * 60 * 30, rel=0.02)  # a cap of height h has 2 pi r h; overlap at the seam
    away = np.linalg.norm(mesh.vertices - (5.0, -3.0, 760.0), axis=-1)[mesh.vertices[:, 2] < 730]
    assert np.abs(away - 60).max() < 0.15 * stride**2  # planes through 3 mm of a sphere, at up to 60 degrees


@pytest.mark.parametrize("stride", [1, 3])
def test_no_triangle_spans_a_step(rig, stride):
    mesh = build_mesh(rig, maps_of(rig, step), stride=stride)
    depth = mesh.vertices[mesh.faces][:, :, 2]
    assert np.ptp(depth, axis=1).max() < 0.01
    assert {700, 900} == set(np.unique(np.rint(depth)))


@pytest.mark.parametrize("stride", [1, 2])
def test_neighbouring_triangles_face_the_same_way(rig, stride):
    rough = np.random.default_rng(3)
    noisy = [replace(one, inverse_depth=one.inverse_depth + rough.normal(0, 1e-6, one.inverse_depth.shape).astype("f4"))
             for one in maps_of(rig, sphere)]  # fmt: skip
    mesh = build_mesh(rig, noisy, stride=stride)
    sides = mesh.faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)
    assert len(np.unique(sides, axis=0)) == len(sides)  # each direction of an edge belongs to one triangle
    again = build_mesh(rig, noisy, stride=stride)
    np.testing.assert_array_equal(again.faces, mesh.faces)
    found = trimesh.Trimesh(mesh.vertices, mesh.faces, process=False)
    assert found.is_winding_consistent
    pieces = trimesh.graph.connected_components(found.face_adjacency, nodes=np.arange(len(mesh.faces)))
    assert min(map(len, pieces)) >= 20
    everything = build_mesh(rig, noisy, stride=stride, smallest=0)
    wide = trimesh.Trimesh(everything.vertices, everything.faces, process=False)
    sizes = list(map(len, trimesh.graph.connected_components(wide.face_adjacency, nodes=np.arange(len(wide.faces)))))
    assert sum(size for size in sizes if size >= 20) == len(mesh.faces) < len(wide.faces)
    with pytest.raises(SetupError, match="smallest piece"):
        build_mesh(rig, noisy, smallest=-1)


@pytest.mark.parametrize("seed", range(5))
def test_of_triangles_with_a_common_side_the_first_stays(seed):
    rng = np.random.default_rng(seed)
    faces = np.stack([rng.permutation(7)[:3] for _ in range(40)])
    kept, taken = [], set()
    for face in faces.tolist():
        sides = {(face[k], face[k - 2]) for k in range(3)}
        if not sides & taken:
            kept.append(face)
            taken |= sides
    np.testing.assert_array_equal(_one_sided(faces), kept)


def test_clouds_and_meshes_keep_normals_views_and_colours(rig, tmp_path):
    maps = maps_of(rig, plane)
    cloud, mesh = fuse(rig, maps), build_mesh(rig, maps, stride=8)
    write_ply(tmp_path / "a.ply", cloud.points, normals=cloud.normals, views=cloud.views)
    columns = trimesh.load(tmp_path / "a.ply").metadata["_ply_raw"]["vertex"]["data"]
    np.testing.assert_array_equal(columns["views"].ravel(), cloud.views)
    np.testing.assert_array_equal(columns["nz"].ravel(), np.nan_to_num(cloud.normals[:, 2]))
    colours = np.random.default_rng(1).integers(0, 255, mesh.vertices.shape).astype(np.uint8)
    for ending in ("ply", "obj"):
        write_mesh(tmp_path / f"mesh.{ending}", mesh.vertices, mesh.faces, colors=colours)
        found = trimesh.load(tmp_path / f"mesh.{ending}", process=False)
        assert found.area == pytest.approx(mesh.area, rel=1e-6)
        np.testing.assert_array_equal(found.visual.vertex_colors[:, :3], colours)
    with pytest.raises(ShapeError, match="colors must be uint8"):
        write_mesh(tmp_path / "b.ply", mesh.vertices, mesh.faces, colors=colours / 255)
    with pytest.raises(ShapeError, match="views must be uint8"):
        write_ply(tmp_path / "b.ply", cloud.points, views=cloud.views.astype(int))


def test_the_command_writes_a_mesh(tmp_path, monkeypatch, capsys):
    setup = Setup(Camera((160, 120), 300), small_setup().optic)
    photograph, _ = photograph_plane(setup.rig(), 800.0, pitch=2.0)
    write_image(tmp_path / "photo.png", photograph)
    write_setup(setup, tmp_path / "setup.toml")
    words = [
        "reconstruct",
        tmp_path / "photo.png",
        "-s",
        tmp_path / "setup.toml",
        "-o",
        tmp_path / "out",
        "--depth",
        "760..840",
    ]
    status, said, _ = run(monkeypatch, capsys, *words, "--mesh", "stl", "--mesh-step", 6)
    assert status == 0
    assert "mesh.stl" in said
    assert "fused" in said
    mesh = trimesh.load(tmp_path / "out" / "mesh.stl")
    assert abs(np.median(mesh.vertices[:, 2]) - 800) < 4  # 0.5 %, 0.03 px
    columns = trimesh.load(tmp_path / "out" / "points.ply").metadata["_ply_raw"]["vertex"]["data"]
    assert columns["views"].max() == 3
    assert np.median(columns["nz"]) < -0.9
    status, said, _ = run(monkeypatch, capsys, *words, "--mesh", "stl", "--mesh-step", 500)
    assert status == 0
    assert "no cell of 500 px" in said
    for wrong in (["--mesh", "pdf"], ["--mesh", "ply", "--mesh-step", "0"], ["--mesh", "ply", "--mesh-step", "1.5"]):
        status, said, error = run(monkeypatch, capsys, *words, *wrong)
        assert status != 0
        assert "mesh" in said + error
