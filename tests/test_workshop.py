"""Workshop drawings: every length on the sheet is the part's, times the scale; every number is the part's."""

import re
import xml.etree.ElementTree as ElementTree

import numpy as np
import pytest
import trimesh
from commands import run

from cyclopean import Camera, Mirror, Mirrors, Plate, Prism, Setup, write_setup
from cyclopean.errors import OpticError, OutputError, SetupError
from cyclopean.optics.dimensions import prism_dimensions
from cyclopean.optics.solid import prism_solid
from cyclopean.plotting.workshop import Page, Tolerances, aperture_margin, workshop_drawing
from cyclopean.plotting.workshop_others import mirror_halves
from cyclopean.plotting.workshop_sheet import SCALES, degrees_text, encoded, length_text, scale_text
from cyclopean.plotting.workshop_view import visible_edges

CAMERA = Camera((1280, 960), 2400, pixel_pitch=0.0055)
TRIPRISM = Setup(CAMERA, Prism(3, 12.0, "N-BK7", 60.0, thickness=7.5, radius=26.0, azimuth_deg=37.0))
SPACE = "{http://www.w3.org/2000/svg}"
MM = 72 / 25.4  # points
FOLDED = Mirrors(
    (Mirror((60, 0, 300), (-0.9, 0.2, -0.3), (100, 150)), Mirror((-60, 5, 300), (0.9, 0, -0.3), (90, 150)))
)


class Drawn:
    """An SVG drawing: its texts, and its named lines in mm from the lower left corner of the sheet."""

    def __init__(self, svg):
        root = ElementTree.fromstring(svg)
        left, top, width, height = map(float, root.get("viewBox").split())
        self.size = width / MM, height / MM
        self.stated = root.get("width"), root.get("height")
        self.texts = ["".join(node.itertext()).strip() for node in root.iter(SPACE + "text")]
        self.lines = {}
        for group in root.iter(SPACE + "g"):
            path = group.find(SPACE + "path")
            name = group.get("id", "patch")
            if not name.startswith(("patch", "line", "text")) and path is not None:
                numbers = np.array(re.findall(r"-?[\d.]+", path.get("d")), dtype=float).reshape(-1, 2)
                self.lines[name] = (numbers * [1, -1] + [-left, height + top]) / MM

    def extent(self, name):
        return np.ptp(self.lines[name], axis=0)


def drawn(setup, page=None, **options):
    return Drawn(encoded(workshop_drawing(setup, page, **options), ".svg"))


def angle_between(first, second):
    cosine = first @ second / np.linalg.norm(first) / np.linalg.norm(second)
    return np.degrees(np.arccos(cosine))


@pytest.mark.parametrize(("sheet", "scale"), [("A4", 1.0), ("A4", 0.5), ("A3", 2.0), ("A3", 1.0)])
def test_lengths_on_the_sheet_are_true(sheet, scale):
    drawing = drawn(TRIPRISM, Page(sheet=sheet, scale=scale))
    # an SVG holds six decimals of a point
    np.testing.assert_allclose(drawing.size, {"A4": (297, 210), "A3": (420, 297)}[sheet], atol=1e-4)
    assert drawing.stated[0].endswith("pt")
    assert float(drawing.stated[0][:-2]) / MM == pytest.approx(drawing.size[0])
    np.testing.assert_allclose(drawing.extent("outline"), 52.0 * scale, atol=1e-4)
    np.testing.assert_allclose(drawing.extent("section"), np.array([7.5, 52.0]) * scale, atol=1e-4)
    edge = drawing.lines["edge-0"]
    assert np.linalg.norm(edge[-1] - edge[0]) == pytest.approx(26.0 * scale, abs=1e-4)
    assert scale_text(scale) in drawing.texts


def test_angles_on_the_sheet_are_true():
    drawing = drawn(TRIPRISM)
    section = drawing.lines["section"]
    apex = section[np.argmax(section[:, 0])]
    upper = section[section[:, 1] > section[:, 1].max() - 1e-3]
    facet = upper[np.argmax(upper[:, 0])] - apex
    assert angle_between(facet, np.array([0.0, 1.0])) == pytest.approx(12.0, abs=1e-3)  # flat face is upright
    left, peak, right = drawing.lines["edge-view"]
    sides = left - peak, right - peak
    expected = np.degrees(prism_dimensions(TRIPRISM.optic).dihedral_angles[0])
    assert angle_between(*sides) == pytest.approx(expected, abs=2e-3)
    directions = [np.arctan2(*(line[-1] - line[0])[::-1]) for line in (drawing.lines[f"edge-{k}"] for k in range(3))]
    turns = np.degrees(np.diff(directions)) % 360
    np.testing.assert_allclose(turns, 120.0, atol=1e-3)  # anticlockwise, seen onto the facets
    assert np.degrees(directions[0]) % 360 == pytest.approx(150.0, abs=1e-3)  # facet 0 looks up


def test_the_sheet_says_what_must_be_made():
    drawing = drawn(TRIPRISM, Page(name="Filter 7", density=2.51, author="N.N.", date="2026-11-22"))
    alpha = np.deg2rad(12.0)
    dihedral = np.arccos(-(np.cos(alpha) ** 2 + np.sin(alpha) ** 2 * np.cos(2 * np.pi / 3)))
    edge = np.arctan(np.tan(alpha) / 2)
    volume = np.pi * 26.0**2 * 7.5 - 2 * np.tan(alpha) * np.sin(np.pi / 3) * 26.0**3
    rim = 7.5 - 26.0 * np.tan(alpha)
    for text in (
        "12° 00' 00\" ± 1'",
        f"({degrees_text(dihedral)})",
        f"({degrees_text(edge)})",
        "Ø52.00  +0 / -0.1",
        "7.50 ± 0.1",
        f"({rim:.2f})",
        f"volume {volume / 1000:.4g} cm^3, mass {2.51 * volume / 1000:.3g} g",
        "N-BK7",
        "n(587.6 nm) = 1.51680, V = 64.17",  # of the maker's catalogue
        "Filter 7",
        "N.N.",
        "2026-11-22",
        "240° 00' 00\"",
    ):
        assert text in drawing.texts
    flat = 60.0 * np.hypot(640, 480) / 2400 * 2
    assert f"plane, Øe {np.ceil(flat * 10 - 1e-6) / 10:.1f}" in drawing.texts


def test_tolerances_and_coating_are_those_asked_for():
    strict = Tolerances(angle_arcmin=0.5, thickness=0.02, flatness_waves=0.1, scratch_dig="20-10", coating="none")
    texts = drawn(TRIPRISM, tolerances=strict).texts
    assert "12° 00' 00\" ± 0.5'" in texts
    assert "7.500 ± 0.02" in texts
    assert "3/0.2  (flat to lambda/10)" in texts  # a fringe is half a wave
    assert "scratch-dig 20-10" in texts
    assert "uncoated" in texts
    assert "MgF2, both sides" in drawn(TRIPRISM, tolerances=Tolerances(coating="MgF2, both sides")).texts


def test_lengths_have_the_decimals_that_their_tolerance_asks_for():
    assert [length_text(7.026471, tolerance) for tolerance in (0.5, 0.1, 0.02, 0.01, 0.005)] == [
        "7.03",
        "7.03",
        "7.026",
        "7.026",
        "7.0265",
    ]


def test_an_outline_that_follows_from_the_facets_has_no_tolerance():
    """Thickness t and angle a end a facet at t / tan(a): with a tolerance of its own it would be stated twice."""
    texts = drawn(Setup(CAMERA, Prism(2, 10.0, "N-BK7", 60.0, thickness=6.0))).texts
    assert f"({2 * 6.0 / np.tan(np.deg2rad(10.0)):.2f})" in texts
    assert not any("+0 / -" in text for text in texts)
    (advice,) = [text for text in texts if "radius_mm" in text]
    radius = float(re.search(r"radius_mm; ([\d.]+)", advice).group(1))
    rim = float(re.search(r"rim of ([\d.]+)", advice).group(1))
    assert rim == pytest.approx(6.0 - radius * np.tan(np.deg2rad(10.0)), abs=0.05)  # a tenth is written


def test_a_long_cut_is_broken_off():
    """At 2:1 the 52 mm of glass do not fit the column: both ends lie on the glass, at the angle of the facets."""
    left, peak, right = drawn(TRIPRISM, Page(sheet="A3", scale=2.0)).lines["edge-view"]
    assert right[0] - left[0] < 88.0 < 2.0 * 45.0
    sides = angle_between(left - peak, right - peak)
    assert sides == pytest.approx(np.degrees(prism_dimensions(TRIPRISM.optic).dihedral_angles[0]), abs=2e-3)
    whole, broken = (drawn(TRIPRISM, Page(sheet="A3", scale=s)).texts for s in (1.0, 2.0))
    assert any(text.startswith("detail, 2:1") for text in broken)
    assert not any(text.startswith("detail") for text in whole)


def test_the_azimuth_of_a_calibrated_facet_is_its_own():
    deviation = ((0.0, 0.25), (0.0, 0.0), (0.0, 0.0))
    optic = Prism(3, 12.0, "N-BK7", 60.0, thickness=7.5, radius=26.0, azimuth_deg=30.0, facet_deviation_deg=deviation)
    assert any("F0 at 30.25°" in text for text in drawn(Setup(CAMERA, optic)).texts)


def test_a_prism_too_small_for_the_picture_says_so(monkeypatch, capsys, tmp_path):
    small = Setup(CAMERA, Prism(3, 12.0, "N-BK7", 100.0, thickness=7.5, radius=26.0))  # the picture wants 33 mm
    assert drawn(small).texts.count("plane, whole face") == 2
    thin = Setup(CAMERA, Prism(12, 12.0, "N-SF11", 199.0, thickness=8.3, radius=30.0))
    assert drawn(thin).texts.count("plane, whole face") == 2
    for setup, word in ((small, "cuts its corners"), (thin, "looks past the facets")):
        write_setup(setup, tmp_path / "setup.toml")
        status, out, _ = run(monkeypatch, capsys, "drawing", tmp_path / "setup.toml", "-o", tmp_path / "a.svg")
        assert status == 0
        assert "flat face: whole face" in out
        assert word in " ".join(out.split())
        assert "nan" not in out


def test_a_prism_beside_the_picture_says_so():
    aside = Setup(CAMERA, Prism(3, 12.0, "N-BK7", 60.0, thickness=7.5, radius=26.0, tilt_deg=(0.0, 179.0, 0.0)))
    assert "plane, the camera looks past it" in drawn(aside).texts


def test_the_largest_standard_scale_is_taken():
    for radius in (6.0, 12.0, 26.0, 60.0, 130.0):
        thickness = radius * np.tan(np.deg2rad(12.0)) + 1.5
        setup = Setup(CAMERA, Prism(3, 12.0, "N-BK7", 200.0, thickness=thickness, radius=radius))
        drawing = drawn(setup, Page(sheet="A4"))
        scale = drawing.extent("outline")[0] / (2 * radius)
        assert min(abs(scale - standard) for standard in SCALES) < 1e-4
        larger = min(s for s in SCALES if s > scale + 1e-3)
        with pytest.raises(SetupError, match="does not fit"):
            workshop_drawing(setup, Page(sheet="A4", scale=larger))


def test_nothing_leaves_the_sheet():
    for setup in (TRIPRISM, Setup(CAMERA, Prism(2, 10.0, "PMMA", 120.0)), Setup(CAMERA, Prism(5, 9.0, 1.6, 60.0))):
        drawing = drawn(setup)
        for line in drawing.lines.values():
            assert (line > 0).all()
            assert (line < drawing.size).all()


def test_the_same_setup_gives_the_same_file():
    for kind in (".pdf", ".svg", ".png"):
        first, second = (encoded(workshop_drawing(TRIPRISM), kind) for _ in range(2))
        assert first == second


def test_a_pdf_has_the_size_of_the_sheet():
    data = encoded(workshop_drawing(TRIPRISM, Page(sheet="A3")), ".pdf")
    box = np.array(re.search(rb"/MediaBox \[([^]]*)\]", data).group(1).split(), dtype=float)
    np.testing.assert_allclose(box[2:] / MM, (420, 297), atol=0.01)


@pytest.mark.parametrize("facets", [2, 3, 4, 5, 12])
def test_a_prism_without_an_outline_is_drawn_to_its_sharp_edge(facets):
    setup = Setup(CAMERA, Prism(facets, 10.0, "N-BK7", 60.0, thickness=6.0))
    inradius = 6.0 / np.tan(np.deg2rad(10.0))
    drawing = drawn(setup, Page(sheet="A3", scale=1.0), width=50.0 if facets == 2 else None)
    height = drawing.extent("outline")[1]
    below = inradius if facets % 2 == 0 else inradius / np.cos(np.pi / facets)
    assert height == pytest.approx(inradius + below, abs=1e-3)
    if facets == 2:
        assert drawing.extent("outline")[0] == pytest.approx(50.0, abs=1e-3)
        assert "50.00 ± 0.1" in drawing.texts


def test_a_biprism_without_an_outline_is_as_wide_as_its_light():
    setup = Setup(CAMERA, Prism(2, 10.0, "N-BK7", 60.0, thickness=6.0))
    across = drawn(setup, Page(sheet="A3", scale=1.0)).extent("outline")[0]
    flat = 60.0 * 960 / 2400  # along the ridge, on the flat face; the facet is 6 mm farther at most
    assert 1.2 * flat < across < 1.2 * flat * 66 / 60 + 2


def test_the_apex_that_looks_at_the_camera_is_drawn_alike():
    flipped = Setup(CAMERA, Prism(3, 12.0, "N-BK7", 60.0, thickness=7.5, radius=26.0, facing="camera"))
    first, second = drawn(TRIPRISM), drawn(flipped)
    np.testing.assert_allclose(first.lines["section"], second.lines["section"], atol=1e-4)
    np.testing.assert_allclose(first.lines["edge-view"], second.lines["edge-view"], atol=1e-4)


def test_each_facet_has_its_own_row():
    deviation = ((0.02, 0.05), (-0.01, -0.03), (0.0, 0.0))
    optic = Prism(3, 12.0, "N-BK7", 60.0, thickness=7.5, radius=26.0, facet_deviation_deg=deviation)
    texts = drawn(Setup(CAMERA, optic)).texts
    for angle, azimuth in ((12.02, 0.0), (11.99, 120 - 0.08), (12.0, 240 - 0.05)):
        assert degrees_text(np.deg2rad(angle)) in texts
        assert degrees_text(np.deg2rad(azimuth)) in texts


def test_plates_and_mirrors_have_their_sheets():
    plate = drawn(Setup(CAMERA, Plate("N-BK7", 60.0, 8.0, radius=25.0)), Page(sheet="A4", scale=1.0))
    np.testing.assert_allclose(plate.extent("outline"), 50.0, atol=1e-3)
    np.testing.assert_allclose(plate.extent("section"), (8.0, 50.0), atol=1e-3)
    assert "parallel to S1 within 1'" in plate.texts
    mirrors = drawn(Setup(Camera((1280, 960), 1500), FOLDED), Page(sheet="A3", scale=0.5))
    for k, mirror in enumerate(FOLDED.mirrors):
        u, v, normal = mirror.axes()
        span = np.abs(u) * mirror.size[0] + np.abs(v) * mirror.size[1]  # of a rectangle, along each axis
        np.testing.assert_allclose(mirrors.extent(f"front-{k}"), 0.5 * span[:2], atol=1e-3)
        np.testing.assert_allclose(mirrors.extent(f"above-{k}"), 0.5 * span[[2, 0]], atol=1e-3)
        assert ", ".join(f"{x + 0.0:.5f}" for x in normal) in mirrors.texts
    gap = mirrors.lines["front-0"].mean(0) - mirrors.lines["front-1"].mean(0)
    assert gap[0] > 0  # mirror 0 stands at the camera's right


def test_a_mirror_without_a_size_is_as_large_as_its_light():
    setup = Setup(Camera((640, 480), 800), Mirrors((Mirror((0, 0, 100), (0.7, 0, -0.7)),)))
    (half,) = mirror_halves(setup)
    pixels = np.stack(np.meshgrid(np.linspace(-0.5, 639.5, 41), np.linspace(-0.5, 479.5, 31)), -1)
    hits = setup.rig()[0].rays(pixels).origins  # rays begin where they leave the mirror
    local = np.abs((hits - [0, 0, 100]) @ setup.optic.mirrors[0].axes()[:2].T)
    np.testing.assert_allclose(half, local.reshape(-1, 2).max(0), rtol=1e-5)  # the outline runs 1e-6 px outside
    assert any(text.startswith("(") and " x " in text for text in drawn(setup).texts)


def test_the_open_lens_needs_a_larger_face():
    def margin(distance, focus):
        return aperture_margin(Setup(CAMERA, Plate(1.5, distance, 5.0), f_number=4.0, focus_distance=focus))

    pupil = 1 / (1 / (2400 * 0.0055) + 1 / 600.0) / 4.0  # thin lens
    assert margin(1e-9, 600.0) == pytest.approx(pupil / 2)
    assert margin(300.0, 600.0) == pytest.approx(pupil / 4)  # half way the cone has half its width
    assert margin(700.0, 600.0) == 0.0
    assert aperture_margin(Setup(CAMERA, Plate(1.5, 60.0, 5.0))) == 0.0


def test_only_edges_that_face_the_viewer_are_seen():
    pyramid = prism_solid(Prism(4, 20.0, 1.5, 60.0))
    assert len(visible_edges(pyramid, np.array([0.0, 0.0, 1.0]))) == 8  # four down the facets, four around the base
    assert len(visible_edges(pyramid, np.array([0.0, 0.0, -1.0]))) == 4
    tower = prism_solid(Prism(3, 10.0, 1.5, 60.0, radius=20.0), tolerance=0.01)
    edges = visible_edges(tower, np.array([1.0, 0.3, 0.4]) / np.linalg.norm([1.0, 0.3, 0.4]))
    upright = np.abs(edges[:, 0, :2] - edges[:, 1, :2]).max(1) < 1e-9
    assert upright.sum() == 2  # the two sides of the cylinder, no strips between
    bottom = (edges[:, :, 2] == 0).all(1)
    corners = np.count_nonzero(tower.vertices[:, 2] == 0)
    assert bottom.sum() == pytest.approx(corners / 2, abs=1.5)  # the half of the lower rim that faces the viewer


def test_degrees_text_comes_back():
    for angle in np.random.default_rng(4).uniform(0, 2 * np.pi, 200):
        degrees, minutes, seconds = (int(part) for part in re.findall(r"\d+", degrees_text(angle)))
        assert minutes < 60
        assert seconds < 60
        # half a second of arc
        assert np.deg2rad(degrees + minutes / 60 + seconds / 3600) == pytest.approx(angle, abs=2.5e-6)
    assert degrees_text(np.deg2rad(12 - 1e-9)) == "12° 00' 00\""
    assert degrees_text(np.deg2rad(120.0), short=True) == "120°"


def test_wrong_pages_are_refused():
    for wrong in ({"sheet": "A9"}, {"scale": np.nan}, {"density": 0.0}):
        with pytest.raises(SetupError):
            Page(**wrong)
    for wrong in ({"angle_arcmin": 0.0}, {"chamfer": -1.0}, {"flatness_waves": np.inf}, {"scratch_dig": "40"}):
        with pytest.raises(SetupError):
            Tolerances(**wrong)
    with pytest.raises(OpticError, match="width"):
        workshop_drawing(TRIPRISM, width=20.0)
    with pytest.raises(SetupError, match=r"fits no sheet|does not fit"):
        workshop_drawing(Setup(CAMERA, Prism(3, 0.01, "N-BK7", 60.0)))
    with pytest.raises(OutputError, match=r"\.pdf"):
        encoded(workshop_drawing(TRIPRISM), ".dxf")


@pytest.fixture
def setup_file(tmp_path):
    path = tmp_path / "prism.toml"
    write_setup(TRIPRISM, path)
    return path


def test_the_command_writes_drawings_and_solids(monkeypatch, capsys, tmp_path, setup_file):
    names = ["a.pdf", "a.svg", "a.png", "a.stl", "a.ply", "a.obj"]
    words = [word for name in names for word in ("-o", tmp_path / "new" / name)]
    status, out, _ = run(monkeypatch, capsys, "drawing", setup_file, *words, "--scale", "1:1")
    assert status == 0
    assert "12° 00' 00\"" in out
    assert "diameter 52 mm" in out
    for name in names[3:]:
        mesh = trimesh.load_mesh(tmp_path / "new" / name)
        mesh.merge_vertices()
        assert mesh.is_watertight
        # millimetres; the polygon lies 5 um inside the circle, and STL holds single precision
        assert mesh.volume == pytest.approx(prism_dimensions(TRIPRISM.optic).volume, rel=5e-4)
    assert Drawn((tmp_path / "new" / "a.svg").read_bytes()).extent("outline")[0] == pytest.approx(52.0, abs=1e-3)


def test_a_folder_gets_the_usual_files(monkeypatch, capsys, tmp_path, setup_file):
    status, _, _ = run(monkeypatch, capsys, "drawing", setup_file, "-o", tmp_path / "shop")
    assert status == 0
    assert {path.name for path in (tmp_path / "shop").iterdir()} == {"drawing.pdf", "drawing.svg", "prism.stl"}


def test_the_commands_refuse_what_cannot_be(monkeypatch, capsys, tmp_path, setup_file):
    mirrors = tmp_path / "mirrors.toml"
    write_setup(Setup(Camera((640, 480), 800), FOLDED), mirrors)
    for words, message in (
        (["drawing", tmp_path / "none.toml"], "no such file"),
        (["drawing", setup_file, "-o", tmp_path / "a.step"], "must end in"),
        (["drawing", mirrors, "-o", tmp_path / "a.stl"], "only a prism"),
        (["drawing", setup_file, "--scale", "big"], "2:1"),
        (["drawing", setup_file, "--scale", "50:1"], "does not fit"),
        (["drawing", setup_file, "--angle-tolerance", "nan"], "--angle-tolerance must be a positive"),
        (["drawing", setup_file, "--index-tolerance", "0"], "--index-tolerance must be a positive"),
        (["drawing", setup_file, "--scratch-dig", "foo"], "such as 40-20"),
        (["drawing", setup_file, "--chamfer", "100"], "does not fit the thinnest place of the rim"),
        (["drawing", setup_file, "--width", "30", "-o", tmp_path / "a.stl"], "width along the ridge"),
        (["drawing", setup_file, "--mesh-tolerance", "1e-12", "-o", tmp_path / "a.stl"], "--mesh-tolerance wants"),
        (["rays", tmp_path / "none.toml"], "no such file"),
        (["rays", setup_file, "--depth", "900..300"], "NEAR < FAR"),
        (["rays", setup_file, "--plane", "up"], "azimuth in degrees"),
        (["rays", setup_file, "--count", "0"], "1 to 500 rays"),
        (["rays", setup_file, "--count", "1000000"], "1 to 500 rays"),
        (["rays", setup_file, "--depth", "40..60"], "inside the optic"),
        (["rays", setup_file, "-o", tmp_path / "a.jpg"], "must end in"),
    ):
        status, _, err = run(monkeypatch, capsys, *words)
        assert status == 2
        assert message in err.replace("\n", " ")
    assert not list(tmp_path.glob("a.*"))


def test_the_rays_command_draws(monkeypatch, capsys, tmp_path, setup_file):
    status, out, _ = run(monkeypatch, capsys, "rays", setup_file, "--depth", "300..600", "-o", tmp_path / "r.svg")
    assert status == 0
    assert "r.svg" in out
    texts = Drawn((tmp_path / "r.svg").read_bytes()).texts
    assert "z (mm)" in texts
    assert any("facet angle" in text and "12" in text for text in texts)
    status, _, _ = run(monkeypatch, capsys, "rays", setup_file, "--depth", "300..600", "-o", tmp_path / "all")
    assert status == 0
    assert {path.name for path in (tmp_path / "all").iterdir()} == {"section.png", "map.png", "cameras.png"}
