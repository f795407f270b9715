"""The table of optical media: numbers and where they come from, no code. `media.py` reads it.

A row holds the fields of `media.Medium`. `coefficients` stand in the order of their `formula`, wavelengths
in micrometres; `range_nm` is where the source has data; `relative_to` says whether the source gives the
index relative to air or to vacuum. Temperatures are 20 C unless the note says otherwise.

Most coefficients also stand in the refractiveindex.info database (public domain, CC0); `citation` names
their source.
"""

from typing import Any

SCHOTT = "Schott, optical glass catalogue (Zemax edition of 20 January 2017)"
SULTANOVA = (
    "N. Sultanova, S. Kasarova and I. Nikolov, Acta Physica Polonica A 116, 585-587 (2009); "
    "Sellmeier fit by M. Polyanskiy, refractiveindex.info"
)
SULTANOVA_NOTE = "measured to 1e-3; the Abbe number of the one-term fit is some percent below the paper's"

GASES_AND_LIQUIDS: tuple[dict[str, Any], ...] = (
    {
        "name": "vacuum",
        "formula": "constant",
        "coefficients": (1.0,),
        "range_nm": (0.0, float("inf")),
        "relative_to": "vacuum",
        "citation": "by definition",
    },
    {
        "name": "air",
        "aliases": ("standard air",),
        "formula": "gases",
        "coefficients": (0.0, 0.05792105, 238.0185, 0.00167917, 57.362),
        "range_nm": (185.0, 14100.0),
        "relative_to": "vacuum",
        "citation": "P. E. Ciddor, Applied Optics 35, 1566-1573 (1996)",
        "note": "dry air at 15 C, 101.325 kPa, 450 ppm CO2. The paper claims 230 to 1690 nm; beyond, the "
        "index is within 2e-6 of Peck and Reeder (1972) from 185 nm, and within 3e-7 of Mathar (2007) in "
        "the four windows that he gives up to 14100 nm",
    },
    {
        "name": "water",
        "aliases": ("H2O", "distilled water", "fresh water"),
        "formula": "sellmeier-2",
        "coefficients": (
            0.0,
            *(5.684027565e-1, 5.101829712e-3, 1.726177391e-1, 1.821153936e-2),
            *(2.086189578e-2, 2.620722293e-2, 1.130748688e-1, 1.069792721e1),
        ),
        "range_nm": (182.0, 1129.0),
        "relative_to": "vacuum",
        "citation": "M. Daimon and A. Masumura, Applied Optics 46, 3811-3820 (2007)",
        "note": "distilled water",
    },
    {
        "name": "seawater",
        "aliases": ("salt water",),
        "formula": "cauchy",  # the paper's ten coefficients at 20 C and 35 per mille, its nm turned to um
        "coefficients": (1.3189575, 0.01618765, -1.0, -0.004382, -2.0, 0.0011455, -3.0),
        "range_nm": (400.0, 700.0),
        "relative_to": "air",
        "citation": "X. Quan and E. S. Fry, Applied Optics 34, 3477-3480 (1995)",
        "note": "salinity 35 per mille",
    },
    {
        "name": "ethanol",
        "aliases": ("ethyl alcohol", "C2H5OH"),
        "formula": "cauchy",
        "coefficients": (1.35265, 0.00306, -2.0, 0.00002, -4.0),
        "range_nm": (476.5, 830.0),
        "relative_to": "air",
        "citation": "J. Rheims, J. Koser and T. Wriedt, Measurement Science and Technology 8, 601-605 (1997)",
    },
)

CROWNS: tuple[dict[str, Any], ...] = (
    {
        "name": "N-BK7",
        "aliases": ("BK7",),
        "formula": "sellmeier-2",
        "coefficients": (0.0, 1.03961212, 0.00600069867, 0.231792344, 0.0200179144, 1.01046945, 103.560653),
        "range_nm": (300.0, 2500.0),
        "relative_to": "air",
        "citation": SCHOTT,
        "note": "the older BK7, refined with arsenic, has the same n_d and V_d",
    },
    {
        "name": "H-K9L",
        "aliases": ("K9", "K9L"),
        "formula": "sellmeier-2",
        "coefficients": (0.0, 0.614555251, 0.0145987884, 0.656775017, 0.00287769588, 1.02699346, 107.653051),
        "range_nm": (302.0, 2325.0),
        "relative_to": "air",
        "citation": "CDGM, optical glass catalogue (Zemax edition of June 2022)",
        "note": "the Chinese counterpart of N-BK7",
    },
    {
        "name": "N-K5",
        "aliases": ("K5",),
        "formula": "sellmeier-2",
        "coefficients": (0.0, 1.08511833, 0.00661099503, 0.199562005, 0.024110866, 0.930511663, 111.982777),
        "range_nm": (310.0, 2500.0),
        "relative_to": "air",
        "citation": SCHOTT,
    },
    {
        "name": "B270",
        "aliases": ("B 270 Superwite", "Superwite"),
        "formula": "cauchy",  # least squares of the eight printed figures, all met to half of the last digit
        "coefficients": (1.509416, 0.0046811, -2.0),
        "range_nm": (435.8, 656.3),
        "relative_to": "air",
        "citation": "Schott, B 270 data sheet (August 1993), fitted with a two-term Cauchy formula",
        "note": "printed to four decimals",
    },
    {
        "name": "D263T",
        "aliases": ("D263", "D263T eco"),
        "formula": "sellmeier-2",
        "coefficients": (0.0, 1.23795755, 0.00863080926, 0.0466468888, 0.0469074501, 2.46700556, 264.146296),
        "range_nm": (334.0, 2325.0),
        "relative_to": "air",
        "citation": SCHOTT,
        "note": "thin borosilicate sheet; the data are those of D263T eco",
    },
    {
        "name": "BOROFLOAT 33",
        "aliases": ("BOROFLOAT",),
        "formula": "sellmeier",
        "coefficients": (0.3542, 0.78657, 0.10856, 0.18285, 4.427),
        "range_nm": (240.0, 1550.0),
        "relative_to": "air",
        "citation": "Schott, BOROFLOAT 33 data sheet (June 2021); Sellmeier fit by M. Polyanskiy, refractiveindex.info",
        "note": "room temperature",
    },
    {
        "name": "soda-lime glass",
        "aliases": ("soda lime", "float glass", "window glass"),
        "formula": "cauchy",
        "coefficients": (1.5130, -0.003169, 2.0, 0.003962, -2.0),
        "range_nm": (310.0, 4600.0),
        "relative_to": "air",
        "citation": "M. Rubin, Solar Energy Materials 12, 275-288 (1985)",
        "note": "clear window glass",
    },
    {
        "name": "N-SK2",
        "aliases": ("SK2",),
        "formula": "sellmeier-2",
        "coefficients": (0.0, 1.28189012, 0.0072719164, 0.257738258, 0.0242823527, 0.96818604, 110.377773),
        "range_nm": (310.0, 2500.0),
        "relative_to": "air",
        "citation": SCHOTT,
    },
    {
        "name": "N-SK16",
        "aliases": ("SK16",),
        "formula": "sellmeier-2",
        "coefficients": (0.0, 1.34317774, 0.00704687339, 0.241144399, 0.0229005, 0.994317969, 92.7508526),
        "range_nm": (310.0, 2500.0),
        "relative_to": "air",
        "citation": SCHOTT,
    },
    {
        "name": "N-BAK4",
        "aliases": ("BAK4",),
        "formula": "sellmeier-2",
        "coefficients": (0.0, 1.28834642, 0.00779980626, 0.132817724, 0.0315631177, 0.945395373, 105.965875),
        "range_nm": (334.0, 2500.0),
        "relative_to": "air",
        "citation": SCHOTT,
    },
    {
        "name": "N-BAF10",
        "aliases": ("BAF10",),
        "formula": "sellmeier-2",
        "coefficients": (0.0, 1.5851495, 0.00926681282, 0.143559385, 0.0424489805, 1.08521269, 105.613573),
        "range_nm": (350.0, 2500.0),
        "relative_to": "air",
        "citation": SCHOTT,
    },
    {
        "name": "N-LAK8",
        "aliases": ("LAK8",),
        "formula": "sellmeier-2",
        "coefficients": (0.0, 1.33183167, 0.00620023871, 0.546623206, 0.0216465439, 1.19084015, 82.5827736),
        "range_nm": (310.0, 2500.0),
        "relative_to": "air",
        "citation": SCHOTT,
    },
)

FLINTS: tuple[dict[str, Any], ...] = (
    {
        "name": "F2",
        "formula": "sellmeier-2",
        "coefficients": (0.0, 1.34533359, 0.00997743871, 0.209073176, 0.0470450767, 0.937357162, 111.886764),
        "range_nm": (320.0, 2500.0),
        "relative_to": "air",
        "citation": SCHOTT,
    },
    {
        "name": "N-F2",
        "formula": "sellmeier-2",
        "coefficients": (0.0, 1.39757037, 0.00995906143, 0.159201403, 0.0546931752, 1.2686543, 119.248346),
        "range_nm": (365.0, 2500.0),
        "relative_to": "air",
        "citation": SCHOTT,
    },
    {
        "name": "F5",
        "formula": "sellmeier-2",
        "coefficients": (0.0, 1.3104463, 0.00958633048, 0.19603426, 0.0457627627, 0.96612977, 115.011883),
        "range_nm": (320.0, 2500.0),
        "relative_to": "air",
        "citation": SCHOTT,
    },
    {
        "name": "SF5",
        "formula": "sellmeier-2",
        "coefficients": (0.0, 1.46141885, 0.0111826126, 0.247713019, 0.0508594669, 0.949995832, 112.041888),
        "range_nm": (350.0, 2500.0),
        "relative_to": "air",
        "citation": SCHOTT,
    },
    {
        "name": "N-SF5",
        "formula": "sellmeier-2",
        "coefficients": (0.0, 1.52481889, 0.011254756, 0.187085527, 0.0588995392, 1.42729015, 129.141675),
        "range_nm": (370.0, 2500.0),
        "relative_to": "air",
        "citation": SCHOTT,
    },
    {
        "name": "SF10",
        "formula": "sellmeier-2",
        "coefficients": (0.0, 1.61625977, 0.0127534559, 0.259229334, 0.0581983954, 1.07762317, 116.60768),
        "range_nm": (380.0, 2500.0),
        "relative_to": "air",
        "citation": SCHOTT,
    },
    {
        "name": "N-SF10",
        "formula": "sellmeier-2",
        "coefficients": (0.0, 1.62153902, 0.0122241457, 0.256287842, 0.0595736775, 1.64447552, 147.468793),
        "range_nm": (380.0, 2500.0),
        "relative_to": "air",
        "citation": SCHOTT,
    },
    {
        "name": "SF11",
        "formula": "sellmeier-2",
        "coefficients": (0.0, 1.73848403, 0.0136068604, 0.311168974, 0.0615960463, 1.17490871, 121.922711),
        "range_nm": (390.0, 2500.0),
        "relative_to": "air",
        "citation": SCHOTT,
    },
    {
        "name": "N-SF11",
        "formula": "sellmeier-2",
        "coefficients": (0.0, 1.73759695, 0.013188707, 0.313747346, 0.0623068142, 1.89878101, 155.23629),
        "range_nm": (370.0, 2500.0),
        "relative_to": "air",
        "citation": SCHOTT,
    },
)

CRYSTALS: tuple[dict[str, Any], ...] = (
    {
        "name": "fused silica",
        "aliases": ("SiO2", "silica", "UVFS", "quartz glass"),
        "formula": "sellmeier",
        "coefficients": (0.0, 0.6961663, 0.0684043, 0.4079426, 0.1162414, 0.8974794, 9.896161),
        "range_nm": (210.0, 3710.0),
        "relative_to": "air",
        "citation": "I. H. Malitson, Journal of the Optical Society of America 55, 1205 (1965)",
    },
    {
        "name": "sapphire",
        "aliases": ("Al2O3", "sapphire o"),
        "formula": "sellmeier",
        "coefficients": (0.0, 1.4313493, 0.0726631, 0.65054713, 0.1193242, 5.3414021, 18.028251),
        "range_nm": (200.0, 5000.0),
        "relative_to": "air",
        "citation": "I. H. Malitson and M. J. Dodge, Journal of the Optical Society of America 62, 1405 (1972)",
        "note": "ordinary ray",
    },
    {
        "name": "CaF2",
        "aliases": ("calcium fluoride", "fluorite"),
        "formula": "sellmeier",
        "coefficients": (0.0, 0.5675888, 0.050263605, 0.4710914, 0.1003909, 3.8484723, 34.649040),
        "range_nm": (230.0, 9700.0),
        "relative_to": "air",
        "citation": "I. H. Malitson, Applied Optics 2, 1103-1107 (1963)",
        "note": "24 C",
    },
    {
        "name": "MgF2",
        "aliases": ("magnesium fluoride", "MgF2 o"),
        "formula": "sellmeier",
        "coefficients": (0.0, 0.48755108, 0.04338408, 0.39875031, 0.09461442, 2.3120353, 23.793604),
        "range_nm": (200.0, 7000.0),
        "relative_to": "air",
        "citation": "M. J. Dodge, Applied Optics 23, 1980-1985 (1984)",
        "note": "ordinary ray, 19 C",
    },
    {
        "name": "BaF2",
        "aliases": ("barium fluoride",),
        "formula": "sellmeier",
        "coefficients": (0.0, 0.643356, 0.057789, 0.506762, 0.10968, 3.8261, 46.3864),
        "range_nm": (265.2, 10346.0),
        "relative_to": "air",
        "citation": "I. H. Malitson, Journal of the Optical Society of America 54, 628 (1964)",
        "note": "25 C",
    },
    {
        "name": "ZnSe",
        "aliases": ("zinc selenide",),
        "formula": "sellmeier",
        "coefficients": (0.0, 4.45813734, 0.200859853, 0.467216334, 0.391371166, 2.89566290, 47.1362108),
        "range_nm": (540.0, 18200.0),
        "relative_to": "air",
        "citation": "J. Connolly, B. diBenedetto and R. Donadio, Proceedings of SPIE 181, 141-144 (1979); "
        "Sellmeier fit by B. Tatian, Applied Optics 23, 4477-4485 (1984)",
        "note": "23 C",
    },
)

PLASTICS: tuple[dict[str, Any], ...] = (
    {
        "name": "PMMA",
        "aliases": ("acrylic", "plexiglas", "plexiglass", "perspex", "polymethyl methacrylate"),
        "formula": "polynomial",
        "coefficients": (
            2.1778,
            *(6.1209e-3, 2.0, -1.5004e-3, 4.0, 2.3678e-2, -2.0),
            *(-4.2137e-3, -4.0, 7.3417e-4, -6.0, -4.5042e-5, -8.0),
        ),
        "range_nm": (420.0, 1620.0),
        "relative_to": "air",
        "citation": "G. Beadie, M. Brindza, R. A. Flynn, A. Rosenberg and J. S. Shirk, "
        "Applied Optics 54, F139-F143 (2015)",
        "note": "measured to 2e-4; another sheet may differ by 1e-3",
    },
    {
        "name": "polycarbonate",
        "aliases": ("PC", "lexan", "makrolon"),
        "formula": "sellmeier-2",
        "coefficients": (0.0, 1.4182, 0.021304),
        "range_nm": (436.8, 1052.0),
        "relative_to": "air",
        "citation": SULTANOVA,
        "note": SULTANOVA_NOTE,
    },
    {
        "name": "polystyrene",
        "aliases": ("PS",),
        "formula": "sellmeier-2",
        "coefficients": (0.0, 1.4435, 0.020216),
        "range_nm": (436.8, 1052.0),
        "relative_to": "air",
        "citation": SULTANOVA,
        "note": SULTANOVA_NOTE,
    },
    {
        "name": "Zeonex E48R",
        "aliases": ("Zeonex", "E48R", "cyclo-olefin polymer"),
        "formula": "sellmeier-2",
        "coefficients": (0.0, 1.2969, 0.011721),
        "range_nm": (436.8, 1052.0),
        "relative_to": "air",
        "citation": SULTANOVA,
        "note": SULTANOVA_NOTE,
    },
)

ROWS = GASES_AND_LIQUIDS + CROWNS + FLINTS + CRYSTALS + PLASTICS
