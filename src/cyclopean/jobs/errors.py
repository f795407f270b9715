"""What makes depth uncertain: tables, maps and a report."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from rich.table import Table

from ..errors import SetupError
from ..files import output_folder, read_setup
from ..files.disk import write_csv, write_json
from .calibration_request import parse_tolerances
from .console import chosen_depths, console, save_figure

if TYPE_CHECKING:
    from ..analysis.budget import Budget
    from ..rigs import Setup

_SHOWN = 40  # wavelengths in the curve of the colours
_COLUMNS = ("source", "how large", "sigma (mm)", "% of depth", "worst (mm)", "share (%)")


@dataclass(frozen=True)
class Request:
    """What the person asked for; see `cyclopean errors`."""

    setup: Path
    output: Path
    depths: tuple[float, float] | None = None
    tolerance: Sequence[str] = ()
    calibration: Path | None = None
    noise_px: float = 0.1
    temperature_range: float = 5.0
    band: tuple[float, float] | None = None
    glass: str | None = None
    mount: str = "aluminium"
    lens_ppm: float | None = None
    blur_px: float = 0.3
    bias_percent: float = 0.1


def run_errors(request: Request) -> None:
    """Find the budget, print and write it; see `cyclopean errors`."""
    setup = read_setup(request.setup)
    for name, limit in (("--blur-px", request.blur_px), ("--bias-percent", request.bias_percent)):
        if not 0 < limit < np.inf:
            raise SetupError(f"{name} is a limit above 0, got {limit}")
    with console.status("tracing"):
        budget = _budget(setup, request)
        colours = _Colours.of(budget, request)
    folder = output_folder(request.output)
    _say(budget, colours, request)
    with console.status("writing"):
        _write(folder, budget, colours, request)
    console.print(f"-> {folder}/  report.html  budget.csv  budget.png  maps.png  errors.json", end="")
    console.print("  chromatic.png" if colours is not None else "")


def _budget(setup: Setup, request: Request) -> Budget:
    from ..analysis.budget import error_budget
    from ..analysis.sensitivity import check_views

    check_views(setup)
    rig = setup.rig()
    near, far = chosen_depths(request.depths, setup, rig)
    return error_budget(
        setup,
        [float(f"{depth:.4g}") for depth in np.geomspace(near, far, 5)],
        tolerances=_tolerances(request.tolerance, setup),
        sigma=request.noise_px,
        temperature_range=request.temperature_range,
        band=request.band,
        covariance=_covariance(request.calibration),
        mount=_mount(request.mount),
        glass=request.glass,
        lens_per_kelvin=_lens(request.lens_ppm),
    )


def _tolerances(given, setup):
    """Standard deviations by name; NAME=0 leaves a parameter out, which a calibration could not."""
    zero = [text for text in given if _is_zero(text)]
    found = parse_tolerances([text for text in given if text not in zero], setup)
    return found | {text.partition("=")[0].strip(): 0.0 for text in zero}


def _is_zero(text):
    try:
        return float(re.sub(r" *(mm|deg|px)$", "", text.partition("=")[2].strip())) == 0
    except ValueError:
        return False


def _covariance(path):
    from ..files.calibrations import read_calibration

    if path is None:
        return None
    document = read_calibration(path)
    return [parameter["name"] for parameter in document["parameters"]], document["covariance"]


def _mount(text):
    """A name of a metal as it is, a number of ppm/K as 1/K."""
    from ..analysis.thermal import MOUNTS

    try:
        expansion = float(text)
    except ValueError:
        expansion = np.nan
    if text not in MOUNTS and not _is_ppm(expansion):
        raise SetupError(f"--mount wants {', '.join(MOUNTS)}, or the expansion in ppm per K: 23.6, got {text!r}")
    return text if text in MOUNTS else 1e-6 * expansion


def _lens(ppm):
    """ppm/K as 1/K."""
    if ppm is not None and not _is_ppm(ppm):
        raise SetupError(f"--lens-ppm wants a number in ppm per K: 23.6, not 23.6e-6; got {ppm:g}")
    return None if ppm is None else 1e-6 * ppm


def _is_ppm(number):
    return number == 0 or 0.01 <= abs(number) < 1000  # per K; smaller ones were changed to 1/K already


@dataclass(frozen=True, eq=False)
class _Colours:
    """What the band does."""

    blur: Any  # Blur
    wavelengths: np.ndarray  # (L,) nm
    percent: np.ndarray  # (D, L) error of depth in the middle of the field
    depths: Sequence[float]  # (D,) mm
    channels: dict[str, np.ndarray]  # colour -> (D,) percent
    advice: list[Any]  # FilterAdvice

    @classmethod
    def of(cls, budget: Budget, request: Request) -> _Colours | None:
        """What the band does, or None where the optic bends all colours alike or its dispersion is not known."""
        from ..analysis import chromatic

        setup = budget.setup
        glass = request.glass or getattr(setup.optic, "glass", None)
        if glass is None or not chromatic.bends_colours(setup) or not chromatic.has_dispersion(glass):
            return None
        band = request.band or (setup.wavelength_nm - 5, setup.wavelength_nm + 5)
        blur = chromatic.chromatic_blur(setup, band, budget.depths[budget.middle], glass=glass)
        places = sorted({0, budget.middle, len(budget.depths) - 1})
        points, seen = _middles(budget, places)
        low, high = _shown_band(setup, band, glass)
        wavelengths = np.linspace(low, high, _SHOWN)
        names = [name for name, nm in chromatic.CHANNELS.items() if low <= nm <= high]
        every = [*wavelengths, *(chromatic.CHANNELS[name] for name in names)]
        shifts = chromatic.colour_bias(setup, points, every, seen=seen, glass=glass)
        percent = 100 * shifts[..., 2] / points[:, None, 2]
        channels = {name: percent[:, _SHOWN + k] for k, name in enumerate(names)}
        common = budget.volume.common
        advice = chromatic.filter_advice(
            setup, budget.volume.points[common], seen=budget.volume.seen[common], blur=request.blur_px,
            bias_percent=request.bias_percent, glass=glass,
        )  # fmt: skip
        depths = [float(z) for z in budget.depths[places]]
        return cls(blur, wavelengths, percent[:, :_SHOWN], depths, channels, advice)


def _middles(budget, places):
    """At each depth the point (D, 3) of the common field nearest to its middle, and which views (D, V) see it."""
    points, seen = [], []
    for k in places:
        common = budget.volume.common[k]
        inside, views = budget.volume.points[k][common], budget.volume.seen[k][common]
        if not len(inside):
            points.append(np.full(3, np.nan))
            seen.append(np.zeros(budget.volume.seen.shape[-1], dtype=bool))
            continue
        nearest = np.argmin(np.linalg.norm(inside - inside.mean(0), axis=-1))
        points.append(inside[nearest])
        seen.append(views[nearest])
    return np.array(points), np.array(seen)


def _shown_band(setup, band, glass):
    """From blue to red, and the whole band, as far as the glass has data."""
    from ..optics import medium

    low, high = medium(glass).range_nm
    return max(min(430.0, band[0]), low), min(max(680.0, band[1]), high)


def _say(budget: Budget, colours: _Colours | None, request: Request) -> None:
    k = budget.middle
    rows = budget.table(k)
    table = Table(*_COLUMNS, title=f"depth at {budget.depths[k]:g} mm: standard deviations", title_justify="left")
    for column in table.columns[2:]:
        column.justify = "right"
    for row in rows:
        table.add_row(*_cells(row), style="bold" if row.share == 1.0 and row is rows[-1] else None)
    console.print(table)
    ends = [budget.table(n)[-1] for n in _there(budget)]
    console.print(
        "over depth: "
        + ", ".join(f"{r.percent:.3g} % at {budget.depths[n]:g} mm" for n, r in zip(_there(budget), ends, strict=True))
    )
    first = rows[0]
    console.print(f"look first after: {first.name} ({100 * first.share:.0f} % of the variance)")
    for note in budget.notes:
        console.print(f"note: {note}", style="yellow")
    if colours is None:
        return
    here = min(colours.advice, key=lambda advice: abs(advice.centre_nm - budget.setup.wavelength_nm))
    best = max(colours.advice, key=lambda advice: advice.width)
    for row in dict.fromkeys((here, best)):
        console.print(
            f"filter at {row.centre_nm:g} nm: at most {_width(row.width_for_blur)} wide for a blur of "
            f"{request.blur_px:g} px, {_width(row.width_for_bias)} for {request.bias_percent:g} % of depth at its ends"
        )


def _there(budget):
    """Numbers of the depths at which two views share anything."""
    return np.flatnonzero(np.isfinite(budget.total).any((1, 2)))


def _width(width):
    return f"{width:.3g} nm" if np.isfinite(width) else "any"


def _cells(row):
    return (
        row.name, row.size, f"{row.sigma:.3g}", f"{row.percent:.3g}", f"{row.worst:.3g}", f"{100 * row.share:.3g}"
    )  # fmt: skip


def _write(folder: Path, budget: Budget, colours: _Colours | None, request: Request) -> None:
    from ..plotting.errors import budget_picture, chromatic_picture, error_maps
    from ..plotting.report import write_report

    write_csv(folder / "budget.csv", _COLUMNS, _rows(budget))
    write_json(folder / "errors.json", _document(budget, colours))
    pictures = {
        "What makes depth uncertain: standard deviations in percent of depth": budget_picture(budget),
        "Where in the common field: each map has its own scale; a sign says which way depth goes when the real "
        "setup exceeds the believed one": error_maps(budget),
    }
    names = ["budget.png", "maps.png"]
    if colours is not None:
        bias = (colours.wavelengths, colours.percent, colours.depths)
        limits = (request.blur_px, request.bias_percent)
        picture = chromatic_picture(budget.setup.rig(), colours.blur, bias, colours.advice, limits)
        pictures["Colour: blur in the photograph, depth in light of other colours, and how wide a filter may be"] = (
            picture
        )
        names.append("chromatic.png")
    for name, figure in zip(names, pictures.values(), strict=True):
        save_figure(figure, folder / name)
    tables, captions = _tables(budget, colours, request)
    write_report(
        folder / "report.html",
        f"What makes depth uncertain: {request.setup.name}",
        "Standard deviations, to first order, over what at least two views share. Lengths in mm.",
        tables,
        pictures,
        budget.notes,
        captions,
    )


_COLUMNS = ("depth_mm", "source", "size", "sigma_mm", "sigma_percent", "worst_mm", "share_percent")


def _rows(budget):
    """Rows of `_COLUMNS`."""
    for k in _there(budget):
        for row in budget.table(k):
            numbers = (row.sigma, row.percent, row.worst, 100 * row.share)
            yield [f"{budget.depths[k]:g}", row.name, row.size, *(f"{number:.6g}" for number in numbers)]


def _document(budget, colours):
    depths = [
        {
            "depth_mm": float(budget.depths[k]),
            "sources": [
                {"name": row.name, "size": row.size, "sigma_mm": row.sigma, "worst_mm": row.worst, "share": row.share}
                for row in budget.table(k)
            ],
        }
        for k in _there(budget)
    ]
    document = {"kind": "cyclopean error budget", "format": 1, "depths": depths, "notes": list(budget.notes)}
    if budget.within:
        document["calibration_shares"] = dict(budget.within)
    document["depth_per_kelvin_percent"] = _per_kelvin(budget)
    if colours is not None:
        document["blur_max_px"] = float(np.nanmax(colours.blur.blur))
        document["filters"] = [
            {
                "centre_nm": row.centre_nm,
                "index_per_nm": row.slope,
                "width_for_blur_nm": row.width_for_blur if np.isfinite(row.width_for_blur) else None,
                "width_for_bias_nm": row.width_for_bias if np.isfinite(row.width_for_bias) else None,
            }
            for row in colours.advice
        ]
    return document


def _per_kelvin(budget):
    """Bias of depth per kelvin in percent, in the middle of the field at the middle depth, by cause."""
    cause = budget.warmth
    k = budget.middle
    names = budget.sensitivity.names
    depth = np.nanmedian(budget.sensitivity.depth[k].reshape(-1, len(names)), axis=0) * (100 / budget.depths[k])
    changes = {name: np.array([each.get(one, 0.0) for one in names]) for name, each in cause.causes.items()}
    found = {name: float(depth @ change) for name, change in changes.items()}
    return found | {"all together": sum(found.values())}


def _tables(budget, colours, request):
    """Tables of the report and what to know about them, both by heading."""
    tables: dict[str, tuple[Sequence[str], Sequence[Sequence[object]]]] = {}
    captions = {}
    heading = f"Budget at {budget.depths[budget.middle]:g} mm"
    tables[heading] = (_COLUMNS, [_cells(row) for row in budget.table()])
    captions[heading] = (
        "Sigma: median over the common field. Worst: largest in it. Share: of the mean variance of depth in it."
    )
    rows = [(f"{budget.depths[k]:g}", *_cells(budget.table(k)[-1])[2:5]) for k in _there(budget)]
    tables["All together, over depth"] = (("depth (mm)", *_COLUMNS[2:5]), rows)
    if budget.within:
        parts = sorted(budget.within.items(), key=lambda part: -abs(part[1]))
        tables["Within the calibration"] = (
            ("parameter", "its own share (%)"),
            [(name, f"{100 * share:.3g}") for name, share in parts],
        )
        captions["Within the calibration"] = (
            "Shares that the parameters would have if they were independent. Those that make up for each other have "
            "large ones, and the row of correlations takes most of it away again."
        )
    elif not request.calibration:
        tables["Usual tolerances"] = (("parameters", "standard deviation", "from"), _usual(budget, request))
        captions["Usual tolerances"] = "Taken where --tolerance does not say otherwise. Makers' limits count as sigma."
    per_kelvin = [(name, f"{value:+.3g}") for name, value in _per_kelvin(budget).items()]
    tables["Warmth"] = (("cause", f"depth at {budget.depths[budget.middle]:g} mm (% per K)"), per_kelvin)
    captions["Warmth"] = "Error of depth while the setup is one kelvin warmer than it was measured or calibrated."
    if colours is not None:
        _add_colours(tables, captions, colours, request)
    return tables, captions


def _usual(budget, request):
    from ..analysis.budget import USUAL_TOLERANCES, source_of
    from ..calibration.unknowns import Unknowns

    given = {text.partition("=")[0].strip() for text in request.tolerance}
    changed = {source_of(name) for name in Unknowns.of([budget.setup], sorted(given)).names}
    sizes = {source.name: source.size for source in budget.sources}
    origins = {one.source: one.origin for one in reversed(USUAL_TOLERANCES) if one.sigma > 0}
    return [
        (name, sizes[name], "--tolerance" if name in changed else origins[name]) for name in sizes if name in origins
    ]


def _add_colours(tables, captions, colours, request):
    depths = [f"at {depth:g} mm (%)" for depth in colours.depths]
    rows = [
        (f"{name}, {_channel_nm(name):g} nm", *(f"{value:+.3g}" for value in values))
        for name, values in colours.channels.items()
    ]
    tables["Depth by colour"] = (("channel", *depths), rows)
    captions["Depth by colour"] = (
        "Error of depth in the middle of the field when each channel is measured by itself with this setup."
    )
    tables["Filters"] = (
        ("middle (nm)", "index per nm", "widest for blur (nm)", "widest for depth (nm)"),
        [
            (f"{row.centre_nm:g}", f"{row.slope:.3g}", _width(row.width_for_blur), _width(row.width_for_bias))
            for row in colours.advice
        ],
    )
    captions["Filters"] = (
        f"From end to end, for a blur of {request.blur_px:g} px and an error of depth of {request.bias_percent:g} % in "
        "light of either end, anywhere in the field, when the setup is stated for the middle of the band."
    )


def _channel_nm(name):
    from ..analysis.chromatic import CHANNELS

    return CHANNELS[name]
