"""What the person asked of `cyclopean design`, and the requirements that it stands for."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from ..errors import CyclopeanError, MediumError, SetupError
from .design_words import (
    Optics,
    parse_accuracy,
    parse_angles,
    parse_camera,
    parse_facets,
    parse_field,
    parse_names,
    parse_range,
    positive,
)

if TYPE_CHECKING:
    from ..analysis import Tolerance
    from ..cameras import Camera
    from ..design.catalogue import ToleranceGrade
    from ..design.requirements import Requirements

_MOST = 26  # candidates, one for each letter
_NO_LONGER = 2.0  # of which the nearest depth is that many, where no size is limited
_NO_WIDER = 160.0  # mm, then: larger prisms are heavy, and few workshops polish them


@dataclass(frozen=True)
class DesignRequest:
    """What the person asked for; see `cyclopean design`."""

    camera: str
    depths: tuple[float, float]  # mm
    accuracy: str | None
    field: str | None
    facets: str
    glass: Sequence[str]
    angles: str
    baseline: float | None
    max_diameter: float | None
    max_length: float | None
    max_blend: float | None
    max_chromatic: float | None
    distance: str | None
    wavelength: float | None
    band: float
    noise: float
    f_number: float | None
    focus: float | None
    tolerances: str
    photos: int
    camera_photos: int
    draws: int
    choose: int
    judge: bool
    photo: bool
    output: Path


def requirements_of(request: DesignRequest) -> tuple[Requirements, list[str]]:
    """The requirements, and notes on how words were taken.

    Raises
    ------
    SetupError
        What came, what is wanted, and an example, for the first option that is wrong; also where two contradict.
    """
    from ..design.requirements import Requirements

    _check_numbers(request)
    depths = request.depths
    optics = parse_camera(request.camera)
    notes = [f"--camera: {optics.note}"] if optics.note else []
    given: dict[str, object] = {}
    if request.accuracy is not None:
        given["accuracy"], note = parse_accuracy(request.accuracy, depths[1])
        notes += [note] if note else []
    if request.field is not None:
        given["field"] = parse_field(request.field)
    if request.distance is not None:
        given["distances"] = parse_range(request.distance, "--distance", "20..300")
    given |= _lens(request, optics)
    for name in ("baseline", "max_diameter", "max_length", "max_blend", "max_chromatic"):
        given[name] = getattr(request, name)
    if request.max_length is None and request.max_diameter is None and request.distance is None:
        given |= {"max_length": depths[0] / _NO_LONGER, "max_diameter": _NO_WIDER}
        notes.append(
            f"no size is limited: --max-length {depths[0] / _NO_LONGER:g}, half of the nearest depth, and "
            f"--max-diameter {_NO_WIDER:g} are taken; larger prisms are more accurate"
        )
    facets, glasses = parse_facets(request.facets), _glasses(request.glass)
    angles, note = _angles(request.angles, glasses)
    notes += [note] if note else []
    given["tolerances"] = parse_tolerance_words(request.tolerances, optics.camera, facets[0], glasses[0])
    _check_conflicts(request, depths, given)
    found = Requirements(
        optics.camera, depths, facets=facets, glasses=glasses, angles_deg=angles, noise=request.noise,
        bandwidth_nm=request.band, photos=request.photos, **given,  # type: ignore[arg-type]
    )  # fmt: skip
    return found, notes


def _check_numbers(request):
    positive(request.baseline, "--baseline", "mm", "40")
    positive(request.max_diameter, "--max-diameter", "mm", "50")
    positive(request.max_length, "--max-length", "mm", "200")
    positive(request.max_blend, "--max-blend", "px", "30")
    positive(request.max_chromatic, "--max-chromatic", "px", "0.5")
    positive(request.wavelength, "--wavelength", "nm", "632.8")
    positive(request.noise, "--noise", "px", "0.1")
    positive(request.f_number, "--f-number", "no unit", "8")
    positive(request.focus, "--focus", "mm", "900")
    if not 0 <= request.band < 1000:
        raise SetupError(f"--band wants the full width of the light's band in nm, 0 or more, got {request.band:g}")
    if request.wavelength is not None and not 100 < request.wavelength < 20_000:
        raise SetupError(f"--wavelength is in nanometres, for example 632.8, got {request.wavelength:g}")
    if not 1 <= request.choose <= _MOST:
        raise SetupError(f"--choose wants 1 to {_MOST} candidates, got {request.choose}")
    if request.camera_photos < 0:
        raise SetupError(f"--camera-photos wants a number of photographs, 0 or more, got {request.camera_photos}")
    if request.draws < 20:
        raise SetupError(f"--draws wants 20 prisms or more for each candidate, got {request.draws}")
    if request.photos < 1:
        raise SetupError(f"--photos wants one photograph of the board or more, got {request.photos}; 12 are usual")


def _lens(request, optics: Optics) -> dict[str, object]:
    """Wavelength, f-number and focus: of the options, else of the camera's words or file."""
    given: dict[str, object] = {
        "f_number": request.f_number or optics.f_number, "focus_distance": request.focus or optics.focus_distance,
    }  # fmt: skip
    if request.f_number is not None and optics.f_number not in (None, request.f_number):
        raise SetupError(
            f"--f-number {request.f_number:g} and --camera (f/{optics.f_number:g}) contradict each other: give one"
        )
    if given["f_number"] is None and request.max_blend is not None:
        raise SetupError("--max-blend limits what an open lens mixes beside seams: give --f-number as well, such as 8")
    if given["f_number"] is not None and optics.camera.pixel_pitch is None:
        raise SetupError(
            'an f-number needs the size of a pixel: give it in --camera, for example "1280x960, 5.5 um, f=25 mm"'
        )
    wavelength = request.wavelength or optics.wavelength_nm
    return given | ({} if wavelength is None else {"wavelength_nm": wavelength})


def _angles(text: str, glasses: tuple[str, ...]) -> tuple[tuple[float, ...] | None, str]:
    """Apex angles in degrees, None for any, and a note on those from stock."""
    found = parse_angles(text)
    if not isinstance(found, str):
        return found, ""
    from ..design.catalogue import stock_angles_deg

    angles = stock_angles_deg(glasses)
    return angles, f"--angles stock: {', '.join(f'{angle:g}' for angle in angles)} degrees"


def _glasses(texts: Sequence[str]) -> tuple[str, ...]:
    """Names of glasses, as the table of media spells them."""
    from ..optics import medium

    names = parse_names(texts)
    if not names:
        raise SetupError("--glass wants one name or more, for example N-BK7,PMMA")
    found = []
    for name in names:
        try:
            glass = medium(name)
        except MediumError as error:
            said = str(error).partition("; an index")[0].removesuffix(". media() lists all")
            raise MediumError(f"--glass: {said}") from None
        if glass.formula == "constant" or glass.name in ("air", "vacuum"):
            raise SetupError(f"--glass {name}: a prism is made of a glass or a plastic, for example N-BK7 or PMMA")
        found.append(glass.name)
    return tuple(dict.fromkeys(found))


def parse_tolerance_words(text: str, camera: Camera, facets: int, glass: str) -> ToleranceGrade | tuple[Tolerance, ...]:
    """A grade of tolerances by name, or those of a file with lines NAME=VALUE or NAME=VALUE:SHAPE.

    The file's names are looked up in a prism of so many facets, the fewest that are asked for.
    """
    from ..design.catalogue import GRADES
    from ..files.disk import read_text
    from ..optics import Prism
    from ..rigs import Setup
    from .tolerances import drawn_tolerances

    if text in GRADES:
        return GRADES[text]
    path = Path(text)
    if not text.strip() or not path.exists():
        raise SetupError(
            f"--tolerances wants {', '.join(GRADES)}, or a file with lines such as optic.distance=0.2, got {text!r}, "
            "which is neither"
        )
    lines = [line.partition("#")[0] for line in read_text(path, "file of tolerances").splitlines()]
    nominal = Setup(camera, Prism(facets, 5.0, glass, 100.0))
    try:
        return tuple(drawn_tolerances(parse_names(lines), nominal, usual=False))
    except CyclopeanError as error:
        raise SetupError(f"{path}: {str(error).replace('--tolerance', 'a line')}") from None


def _check_conflicts(request, depths, given):
    """Requirements that cannot hold together, whatever the prism."""
    low = given["distances"][0] if "distances" in given else None
    if low is not None and low >= depths[0]:
        raise SetupError(
            f"--distance {request.distance} and --depth {depths[0]:g}..{depths[1]:g} contradict each other: the glass "
            f"would stand behind the nearest depth, {depths[0]:g} mm; let it begin nearer"
        )
    if low is not None and request.max_length is not None and low >= request.max_length:
        raise SetupError(
            f"--distance {request.distance} and --max-length {request.max_length:g} contradict each other: the glass "
            f"begins at {low:g} mm from the pinhole, and must end before {request.max_length:g} mm"
        )
    focus = given.get("focus_distance")
    if focus is not None and focus < 0.2 * depths[0]:
        raise SetupError(
            f"--focus {focus:g} mm lies far before the nearest depth, {depths[0]:g} mm: nothing would be sharp; the "
            "harmonic mean of the depths is taken without --focus"
        )
    baseline = given.get("baseline")
    if baseline is not None and baseline > depths[0]:
        raise SetupError(
            f"--baseline {baseline:g} mm exceeds the nearest depth, {depths[0]:g} mm: no prism before the camera does "
            "this; ask for a smaller one"
        )
