"""The prism as a body: its mesh against closed forms, the planes that light meets, and the renderer's own mesh."""

import json

import numpy as np
import pytest
import trimesh
from setups import OPTICS, SETUPS, random_pixels, trace_slowly

from benchmarks.data import renderer_setup
from cyclopean import Camera, Prism, Setup
from cyclopean.errors import OpticError
from cyclopean.geometry import Rays
from cyclopean.optics.dimensions import clear_aperture, prism_dimensions
from cyclopean.optics.footprints import meeting_points
from cyclopean.optics.solid import prism_solid, seam_directions

RIGS = ("n2", "n2_flip", "n3", "n3_pose", "n4", "n5", "t2_b40", "t3_b40", "t4_b45")
DEVIATIONS = ((0.2, 0.5), (-0.1, -0.3), (0.15, 0.4), (0.0, -0.2), (0.3, 0.1))


def prism(facets, apex_deg=12.0, **changes):
    return Prism(facets, apex_deg, 1.5, 60.0, **changes)


def every_prism():
    """Prisms with all outlines, regular and not."""
    for facets in (2, 3, 4, 5):
        for deviation in ((), DEVIATIONS[:facets]):
            yield prism(facets, radius=20.0, facet_deviation_deg=deviation)
            yield prism(facets, azimuth_deg=33.0, facing="camera", facet_deviation_deg=deviation)


def solid_of(optic, **options):
    return prism_solid(optic, width=40.0 if optic.radius is None and optic.facets == 2 else None, **options)


def mesh_of(solid):
    return trimesh.Trimesh(solid.vertices, solid.triangles, process=False)


@pytest.mark.parametrize("optic", list(every_prism()), ids=str)
def test_the_mesh_is_closed_and_faces_outward(optic):
    solid = solid_of(optic)
    mesh = mesh_of(solid)
    assert mesh.is_watertight
    assert mesh.is_winding_consistent
    assert mesh.euler_number == 2
    assert solid.volume > 0  # turned inside out it would be negative
    assert mesh.volume == pytest.approx(solid.volume, rel=1e-12)
    normals, offsets = solid.planes
    assert (solid.vertices @ normals.T <= offsets + 1e-9).all()  # convex: no corner lies outside any face


@pytest.mark.parametrize("facets", [2, 3, 4, 5, 8])
@pytest.mark.parametrize("apex_deg", [3.0, 12.0, 30.0])
def test_angles_of_a_regular_pyramid(facets, apex_deg):
    optic, alpha = prism(facets, apex_deg, radius=10.0, thickness=20.0), np.deg2rad(apex_deg)
    solid, measures = solid_of(optic), prism_dimensions(optic)
    normals = solid.planes[0]
    edge = np.arctan(np.tan(alpha) * np.cos(np.pi / facets))
    dihedral = np.arccos(-(np.cos(alpha) ** 2 + np.sin(alpha) ** 2 * np.cos(2 * np.pi / facets)))
    # 1e-12: a few roundings; the mesh's normals come from corners with 16 digits over triangles of 1 mm
    np.testing.assert_allclose(measures.edge_angles, edge, atol=1e-12)
    np.testing.assert_allclose(measures.dihedral_angles, dihedral, atol=1e-12)
    from_mesh = np.pi - np.arccos(np.sum(normals[1 : 1 + facets] * np.roll(normals[1 : 1 + facets], -1, 0), -1))
    np.testing.assert_allclose(from_mesh, dihedral, atol=1e-10)  # the arc cosine near 1 loses digits
    np.testing.assert_allclose(-normals[1 : 1 + facets] @ normals[0], np.cos(alpha), atol=1e-12)


@pytest.mark.parametrize("facets", [3, 4, 5, 7])
def test_a_pyramid_has_the_height_and_volume_of_the_textbook(facets):
    inradius = 25.0
    alpha = np.deg2rad(14.0)
    optic = prism(facets, 14.0, thickness=inradius * np.tan(alpha))
    solid, measures = solid_of(optic), prism_dimensions(optic)
    side = 2 * inradius * np.tan(np.pi / facets)
    base = facets * side * inradius / 2
    assert solid.volume == pytest.approx(base * optic.thickness / 3, rel=1e-12)
    assert measures.volume == pytest.approx(base * optic.thickness / 3, rel=1e-12)
    assert measures.flat_area == pytest.approx(base, rel=1e-12)
    np.testing.assert_allclose(measures.facet_areas, base / facets / np.cos(alpha), rtol=1e-12)
    corners = solid.vertices[solid.faces[0]]
    sides = np.linalg.norm(corners - np.roll(corners, 1, 0), axis=-1)
    np.testing.assert_allclose(sides, side, rtol=1e-12)
    assert measures.rim == (0.0, 0.0)


def test_a_biprism_without_an_outline_is_a_roof():
    optic, width = prism(2, 10.0, thickness=8.0, azimuth_deg=20.0), 30.0
    solid = prism_solid(optic, width=width)
    span = 2 * 8.0 / np.tan(np.deg2rad(10.0))
    assert solid.volume == pytest.approx(span * 8.0 / 2 * width, rel=1e-12)
    assert prism_dimensions(optic, width).dihedral_angles[0] == pytest.approx(np.deg2rad(160.0), abs=1e-12)
    along = np.array([-np.sin(np.deg2rad(20.0)), np.cos(np.deg2rad(20.0))])
    assert np.ptp(solid.vertices[:, :2] @ along) == pytest.approx(width, rel=1e-12)


@pytest.mark.parametrize("deviation", [(), DEVIATIONS])
@pytest.mark.parametrize("facets", [2, 3, 5])
def test_measures_of_a_round_prism_are_those_of_its_mesh(facets, deviation):
    optic = prism(facets, radius=20.0, facet_deviation_deg=deviation[:facets])
    measures = prism_dimensions(optic)
    previous = None
    for tolerance in (1e-2, 1e-4):
        solid = prism_solid(optic, tolerance=tolerance)
        missing = measures.volume - solid.volume
        # the polygon lies inside the circle: each arc's segment is 2/3 chord x sagitta, and as high as the rim at most
        assert 0 < missing <= 2 / 3 * 2 * np.pi * 20.0 * tolerance * measures.rim[1]
        areas = [solid.area(f"facet {k}") for k in range(facets)]
        np.testing.assert_allclose(areas, measures.facet_areas, rtol=2 * tolerance / 20.0)
        if previous is not None:
            assert missing < previous / 50  # it goes with the tolerance, so the limit is the closed form
        previous = missing
    tops = solid.vertices[(solid.vertices[:, 2] > 0) & (np.hypot(*solid.vertices[:, :2].T) > 1)]
    assert tops[:, 2].max() == pytest.approx(measures.rim[1], abs=1e-9)  # at an edge, where the mesh has a corner
    # the least lies between two corners: a step along the rim of sqrt(8 r tolerance) hides half its square over 2 r
    assert 0 <= tops[:, 2].min() - measures.rim[0] <= 2e-4


def test_a_round_outline_keeps_its_tolerance():
    for tolerance in (0.5, 0.01):
        solid = prism_solid(prism(3, radius=20.0), tolerance=tolerance)
        corners = solid.vertices[solid.faces[0]]
        middles = (corners + np.roll(corners, 1, 0)) / 2
        assert np.allclose(np.hypot(*corners[:, :2].T), 20.0, rtol=1e-14)
        deepest = 20.0 - np.hypot(*middles[:, :2].T).min()
        assert deepest <= tolerance
        assert deepest == pytest.approx(solid.tolerance, rel=1e-6)


def test_a_rim_of_no_thickness_still_closes():
    optic = prism(4, 10.0, radius=20.0, thickness=20.0 * np.tan(np.deg2rad(10.0)))
    mesh = mesh_of(prism_solid(optic))
    assert mesh.is_watertight
    assert prism_dimensions(optic).rim[0] == pytest.approx(0.0, abs=1e-12)


@pytest.mark.parametrize("optic", [*every_prism(), OPTICS["prism"], OPTICS["prism, facets to camera"]], ids=str)
def test_faces_lie_in_the_planes_that_light_meets(optic):
    solid = solid_of(optic)
    corners = solid.in_rig()
    for k, path in enumerate(optic.paths(587.6)):
        flat, facet = path.interfaces if optic.facing == "scene" else path.interfaces[::-1]
        for surface, face in ((flat, solid.faces[0]), (facet, solid.faces[1 + k])):
            # 1e-12 mm over 100 mm: roundings
            np.testing.assert_allclose(corners[face] @ surface.normal, surface.offset, atol=1e-12)
            if surface.disc is not None:
                arms = np.cross(corners[face] - surface.disc.centre, surface.disc.axis)
                assert np.linalg.norm(arms, axis=-1).max() <= surface.disc.radius + 1e-12
    np.testing.assert_allclose(solid.from_rig(corners), solid.vertices, atol=1e-12)


@pytest.mark.parametrize("name", RIGS)
def test_the_renderer_had_the_same_body(mitsuba, name):
    data = json.loads((mitsuba / "rigs" / f"{name}.json").read_text())["prism"]
    theirs = trimesh.Trimesh(data["mesh_vertices_prism"], data["mesh_faces"], process=False)
    solid = prism_solid(renderer_setup(name).optic, tolerance=1e-3)
    outside = theirs.vertices @ solid.planes[0][1:].T - solid.planes[1][1:]
    tops = theirs.vertices[:, 2] > 1e-6
    facets = outside[:, : renderer_setup(name).optic.facets]
    np.testing.assert_allclose(facets[tops].max(1), 0.0, atol=2e-9)  # on a facet and below the others; 9 decimals
    assert outside.max() <= 1e-3 + 1e-8  # our polygon lies inside the circle by so much
    assert np.hypot(*theirs.vertices[:, :2].T).max() == pytest.approx(renderer_setup(name).optic.radius, abs=1e-8)


def test_a_section_holds_the_facet_angle():
    optic = prism(4, 17.0, radius=20.0, azimuth_deg=30.0)
    solid = prism_solid(optic, tolerance=1e-4)
    along = np.array([np.cos(np.deg2rad(30.0)), np.sin(np.deg2rad(30.0)), 0.0])
    cut = solid.section(np.zeros(3), np.cross(along, [0, 0, 1.0]))
    across, height = cut @ along, cut[:, 2]
    order = np.argsort(across[height > 1e-9])
    across, height = across[height > 1e-9][order], height[height > 1e-9][order]
    assert np.abs(across).max() == pytest.approx(20.0, abs=1e-4)
    np.testing.assert_allclose(height, 10.0 - np.tan(np.deg2rad(17.0)) * np.abs(across), atol=1e-9)
    assert not len(solid.section(np.array([0.0, 0.0, 11.0]), np.array([0.0, 0.0, 1.0])))


def test_wrong_bodies_are_refused():
    with pytest.raises(OpticError, match="endless along its ridge"):
        prism_solid(prism(2))
    for optic in (prism(3), prism(2, radius=10.0)):
        with pytest.raises(OpticError, match="width along the ridge"):
            prism_solid(optic, width=10.0)
    with pytest.raises(OpticError, match="positive number of mm"):
        prism_solid(prism(2), width=np.nan)
    for tolerance in (0.0, 1e-12, np.nan):
        with pytest.raises(OpticError, match="from 1e-05"):
            prism_solid(prism(3, radius=10.0), tolerance=tolerance)
    with pytest.raises(OpticError, match="do not follow each other"):
        prism_solid(prism(3, radius=10.0, facet_deviation_deg=((0, 0), (0, 130.0), (0, 0))))
    with pytest.raises(OpticError, match="ridge runs into the flat face"):
        prism_solid(prism(2, facet_deviation_deg=((0, 20.0), (0, 0))), width=900.0)


def test_edges_run_down_both_facets():
    for optic in every_prism():
        seams = seam_directions(optic)
        solid = solid_of(optic)
        normals = solid.planes[0][1 : 1 + optic.facets]
        np.testing.assert_allclose(np.sum(seams * normals, -1), 0.0, atol=1e-9)
        np.testing.assert_allclose(np.sum(seams * np.roll(normals, -1, 0), -1), 0.0, atol=1e-9)


@pytest.mark.parametrize("name", SETUPS)
def test_meeting_points_end_where_traced_rays_begin(name):
    setup = SETUPS[name]
    rays = setup.camera.rays(random_pixels(setup, 200))
    for path in setup.optic.paths(setup.wavelength_nm):
        points = meeting_points(path, rays)
        assert points.shape == (200, len(path.interfaces), 3)
        for s, surface in enumerate(path.interfaces):
            here = points[:, s][np.isfinite(points[:, s, 0])]
            np.testing.assert_allclose(here @ surface.normal, surface.offset, atol=1e-9)
        if path.interfaces:
            traced = trace_slowly(path.unbounded(), rays).origins
            known = np.isfinite(traced[:, 0])
            np.testing.assert_allclose(points[known, -1], traced[known], atol=1e-9)


def test_clear_aperture_of_the_flat_face_is_the_field_of_the_camera():
    camera, optic = Camera((1280, 960), 2400), prism(3, radius=26.0)
    border = camera.rays(np.array([[-0.5, -0.5], [1279.5, 959.5], [639.5, 959.5]]))
    found = clear_aperture(optic, 587.6, border)
    assert found.flat_face == pytest.approx(60.0 * np.hypot(640, 480) / 2400, rel=1e-12)  # similar triangles
    assert found.facets > found.flat_face  # light still diverges in the glass


def test_a_picture_that_looks_past_the_facets_needs_more_than_any_face():
    """The flat face ends where the facet cuts it, 6 mm / tan(20 deg) = 16.5 mm from the axis."""
    optic = prism(2, 20.0, thickness=6.0)
    rays = [Camera((1280, 960), 2400).rays(np.array([[639.5 + 2400 * x / 60.0, 479.5]])) for x in (16.0, 17.0)]
    assert clear_aperture(optic, 587.6, rays[0]).flat_face == pytest.approx(16.0)
    assert np.isnan(clear_aperture(optic, 587.6, rays[1]).radius)
    both = Rays(*(np.concatenate([getattr(r, key) for r in rays]) for key in ("origins", "directions")))
    assert clear_aperture(optic, 587.6, both).radius == np.inf


@pytest.mark.parametrize("facing", ["scene", "camera"])
def test_clear_aperture_holds_all_light(facing):
    camera = Camera((320, 240), 500)
    optic = prism(5, 14.0, radius=80.0, thickness=24.0, facing=facing, tilt_deg=(2.0, -1.0, 0.0), shift=(1.0, 2.0))
    u, v = np.linspace(-0.5, 319.5, 81), np.linspace(-0.5, 239.5, 61)
    pixels = np.stack(np.meshgrid(u, v), -1).reshape(-1, 2)
    border = pixels[(np.isin(pixels[:, 0], u[[0, -1]])) | (np.isin(pixels[:, 1], v[[0, -1]]))]
    found = clear_aperture(optic, 587.6, camera.rays(border))
    farthest = []
    for view in Setup(camera, optic).rig():
        local = (view.rays(pixels).origins - optic.placement.translation) @ optic.placement.rotation
        farthest.append(np.nanmax(np.hypot(local[:, 0], local[:, 1])))
    last = found.facets if facing == "scene" else found.flat_face
    assert max(farthest) == pytest.approx(last, rel=1e-9)  # the very same rays of the border reach farthest
    assert found.widened(2.0).radius == pytest.approx(found.radius + 2.0)
    assert found.half_box[0] <= found.radius
    assert found.half_box[1] <= found.radius
