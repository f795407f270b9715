"""What the words of `cyclopean design` stand for: cameras, ranges, sizes and shares as people write them."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from ..errors import SetupError

if TYPE_CHECKING:
    from ..cameras import Camera

EXAMPLE = '--camera "1280x960, 5.5 um, f=25 mm"'
MOST_FACETS = 12
_LEAST = 16  # px to a side
_NUMBER = r"(\d+(?:\.\d*)?|\.\d+)"
_TIMES = r"\s*[x×*]\s*"
_MM = {"mm": 1.0, "cm": 10.0, "m": 1000.0, "um": 1e-3, "µm": 1e-3, "μm": 1e-3, "": 1.0}
# Diagonals (mm) of the optical formats of sensors; the fraction is a tube's diameter, not the picture's.
_FORMATS = {
    "1/4": 4.5, "1/3.2": 5.7, "1/3": 6.0, "1/2.9": 6.2, "1/2.8": 6.5, "1/2.5": 7.2, "1/2.3": 7.7, "1/2": 8.0,
    "1/1.8": 8.9, "1/1.7": 9.5, "1/1.2": 13.4, "2/3": 11.0, "1": 16.0, "1.1": 17.6, "4/3": 21.6,
}  # fmt: skip


@dataclass(frozen=True, eq=False)
class Optics:
    """A camera with its lens, as far as the person says."""

    camera: Camera
    f_number: float | None = None
    focus_distance: float | None = None  # mm
    wavelength_nm: float | None = None
    note: str = ""  # how the words were taken, where it is not plain


_PARTS = {  # of the words for a camera
    "size": rf"(\d+){_TIMES}(\d+)(?:\s*(?:px|pixels?))?",
    "pitch": rf"(?:(?:pitch|pixels?)\s*=?\s*)?{_NUMBER}\s*(?:um|µm|μm|microns?)",
    "stop": rf"f\s*/\s*{_NUMBER}",
    "focal": rf"(?:f|focal(?:\s+length)?)?\s*=?\s*{_NUMBER}\s*(mm|px)",
    "sensor": rf"(?:sensor\s*=?\s*)?{_NUMBER}{_TIMES}{_NUMBER}\s*mm",
    "format": r"(?:sensor\s*=?\s*)?([\d./]+)\s*(?:\"|''|″|inch|in)",
}


def parse_camera(text: str) -> Optics:
    """The camera that words such as "1280x960, 5.5 um, f=25 mm, f/8" describe, or that of a TOML file."""
    if text.strip().lower().endswith(".toml") or (text.strip() and Path(text).exists()):
        return _camera_of_file(Path(text))
    found: dict[str, re.Match] = {}
    for part in filter(None, (part.strip() for part in re.split(r"[,;]", text))):
        matches = ((name, re.fullmatch(pattern, part, re.IGNORECASE)) for name, pattern in _PARTS.items())
        name, match = next(((name, match) for name, match in matches if match), ("", None))
        if match is None:
            raise SetupError(
                f"--camera: {part!r} says nothing about a camera; write pixels, pixel pitch and focal length, such as "
                f'{EXAMPLE}; "f=2400 px", "f/8", "sensor 7.04x5.28 mm" and "2/3 inch" will do too, or a file'
            )
        if name in found:
            raise SetupError(
                f"--camera {text!r}: {found[name][0]!r} and {part!r} say the same thing twice; leave one out"
            )
        found[name] = match
    for name, what in (("size", "size in pixels"), ("focal", "focal length, in mm or px")):
        if name not in found:
            raise SetupError(f"--camera {text!r} lacks the {what}, for example {EXAMPLE}")
    return _camera_of_words(text, found)


def _camera_of_words(text: str, found: dict[str, re.Match]) -> Optics:
    from ..cameras import Camera

    size = int(found["size"][1]), int(found["size"][2])
    focal, in_mm = float(found["focal"][1]), found["focal"][2].lower() == "mm"
    stop = float(found["stop"][1]) if "stop" in found else None
    if 0 in size or not focal > 0 or stop == 0:
        raise SetupError(f"--camera {text!r}: every number must be above 0, for example {EXAMPLE}")
    if min(size) < _LEAST:
        raise SetupError(f"--camera {text!r}: a picture of {size[0]} x {size[1]} px shows too little to measure")
    pitch, note = _pitch(text, found, size)
    needs = "a focal length in mm" if in_mm else f"f/{stop:g}" if stop else ""
    if pitch is None and needs:
        raise SetupError(f"--camera {text!r}: {needs} needs the pixel pitch in um as well, for example {EXAMPLE}")
    focal_px = focal / pitch if in_mm and pitch else focal
    return Optics(Camera(size, focal_px, pixel_pitch=pitch), stop, note=note)  # type: ignore[arg-type]


def _pitch(text: str, found: dict[str, re.Match], size: tuple[int, int]) -> tuple[float | None, str]:
    """Pixel pitch (mm), as stated or as the size of the sensor says, and how it was taken."""
    if "pitch" in found:
        pitch = float(found["pitch"][1]) / 1000
        if not pitch > 0:
            raise SetupError(f"--camera {text!r}: the pixel pitch must be above 0, for example 5.5 um")
        return pitch, ""
    if "sensor" in found:
        width, height = (float(found["sensor"][k]) / size[k - 1] for k in (1, 2))
        if not width > 0 or abs(height / width - 1) > 0.02:
            raise SetupError(
                f"--camera: {found['sensor'][0]!r} with {size[0]} x {size[1]} pixels makes pixels of "
                f"{1000 * width:.3g} x {1000 * height:.3g} um; they must be square: look at the numbers"
            )
        return width, ""
    if "format" in found:
        name = found["format"][1]
        if name not in _FORMATS:
            raise SetupError(
                f"--camera: no sensor of {name} inch is known; known are {', '.join(_FORMATS)}; or give mm"
            )
        pitch = _FORMATS[name] / float(size[0] ** 2 + size[1] ** 2) ** 0.5
        return pitch, (
            f"pixels of {1000 * pitch:.3g} um, by the usual diagonal of {name} inch, {_FORMATS[name]:g} mm; the "
            "sensor's data sheet knows better"
        )
    return None, ""


def _camera_of_file(path: Path) -> Optics:
    """Camera, lens and light of a setup file, or the camera of a camera file."""
    from ..files import read_setup
    from ..files.cameras import read_camera
    from ..files.disk import parse_toml, read_text

    table = parse_toml(read_text(path, "camera file or setup file"), path)
    if "optic" not in table:
        lens = table.get("camera", {}) if isinstance(table.get("camera"), dict) else {}
        return Optics(read_camera(path), lens.get("f_number"), lens.get("focus_distance_mm"))
    setup = read_setup(path)
    return Optics(
        setup.camera,
        setup.f_number,
        setup.focus_distance,
        setup.wavelength_nm,
        f"its optic ({setup.optic.kind}) is left aside",
    )


def parse_accuracy(text: str, far: float) -> tuple[float, str]:
    """The accuracy as a share of depth, and a note on it: of "0.1%", or of "0.5 mm" at the far depth (mm)."""
    found = re.fullmatch(rf"{_NUMBER}\s*(%|percent|mm|cm|um|µm|μm)", text.strip())
    value = float(found[1]) if found else 0.0
    if not found or not value > 0:
        raise SetupError(
            f"--accuracy wants a share of the depth or a length at the far depth, above 0, with its unit, for example "
            f'0.1% or "0.5 mm", got {text!r}'
        )
    if found[2] in ("%", "percent"):
        return _below_half(value / 100, text), ""
    share = _below_half(value * _MM[found[2]] / far, text)
    return (
        share,
        f"--accuracy {text} is taken at the far depth, {far:g} mm: {100 * share:.3g} % of the depth everywhere",
    )


def _below_half(share, text):
    if share >= 0.5:
        raise SetupError(
            f"--accuracy {text} is {100 * share:.3g} % of the depth: nothing would be measured; ask for less than 50 %"
        )
    return share


def parse_facets(text: str) -> tuple[int, ...]:
    """Numbers of facets: "2..5", "3", "2,3,5"."""
    try:
        if ".." in text:
            low, high = (int(part) for part in text.split(".."))
            found = tuple(range(low, high + 1))
        else:
            found = tuple(sorted({int(part) for part in text.split(",")}))
    except ValueError:
        found = ()
    if not found or found[0] < 2 or found[-1] > MOST_FACETS:
        raise SetupError(
            f"--facets wants whole numbers from 2 to {MOST_FACETS}, as 2..5 or 2,3 (2 is a biprism), got {text!r}"
        )
    return found


def parse_range(text: str, option: str, example: str) -> tuple[float, float]:
    """Two numbers LOW..HIGH with 0 < LOW < HIGH."""
    try:
        low, high = (float(part) for part in text.split(".."))
    except ValueError:
        low, high = 1.0, 0.0
    if not 0 < low < high < float("inf"):
        raise SetupError(f"{option} wants LOW..HIGH in mm with 0 < LOW < HIGH, for example {example}, got {text!r}")
    return low, high


def parse_field(text: str) -> tuple[float, float]:
    """Width and height (mm) of "200x150" or "200x150 mm"."""
    found = re.fullmatch(rf"{_NUMBER}{_TIMES}{_NUMBER}(?:\s*(mm|cm|m))?", text.strip())
    size = [float(found[k]) * _MM[found[3] or ""] for k in (1, 2)] if found else [0.0]
    if min(size) <= 0:
        raise SetupError(f"--field wants WIDTHxHEIGHT in mm, above 0, for example 200x150, got {text!r}")
    return size[0], size[1]


def parse_names(texts: Sequence[str] | str) -> tuple[str, ...]:
    """Names between commas, each once, in their order."""
    parts = [part.strip() for text in ([texts] if isinstance(texts, str) else texts) for part in text.split(",")]
    return tuple(dict.fromkeys(filter(None, parts)))


def parse_angles(text: str) -> tuple[float, ...] | str | None:
    """Apex angles (degrees): None for "any", "stock" as it is, else those of a list such as "4,6,8"."""
    word = text.strip().lower()
    if word in ("any", "stock"):
        return None if word == "any" else word
    try:
        found = tuple(sorted({float(part.strip().rstrip("°")) for part in word.split(",")}))
    except ValueError:
        found = ()
    if not found or not all(0 < angle < 90 for angle in found):
        raise SetupError(
            f"--angles wants any, stock, or degrees between 0 and 90 with commas, for example 4,6,8, got {text!r}"
        )
    return found


def positive(value: float | None, option: str, unit: str, example: str) -> float | None:
    """A number as it is, or SetupError where it is not above 0."""
    if value is not None and not 0 < value < float("inf"):
        raise SetupError(f"{option} wants a number of {unit} above 0, for example {example}, got {value:g}")
    return value
