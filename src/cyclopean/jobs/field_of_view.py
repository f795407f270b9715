"""What the views of a setup see together; see `cyclopean fov`."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from rich.table import Table

from ..analysis.common_volume import CommonField, CommonSection, CommonVolume, checked_views
from ..analysis.field_of_view import FieldOfView, not_upright, picture_azimuths, upright
from ..analysis.sensor_use import SensorUse, sensor_use
from ..errors import OpticError, SetupError
from ..files import output_folder, read_setup, replacing
from ..files.meshes import write_mesh
from ..optics import Prism
from ..rigs import Rig, Setup
from .console import console, counted, save_figure

_TABLE = 5  # depths of the table and the pictures
_CURVE = 16  # depths of the traced half width
_MOST_TILT = 5.0  # degrees, and share of the distance in percent, up to which the upright prism is worth stating


@dataclass(frozen=True, eq=False)
class Field:
    """All that the command finds."""

    setup: Setup
    rig: Rig
    depths: tuple[float, float]  # mm
    closed: FieldOfView | None  # closed forms, of the prism set upright where it is not
    note: str  # what to know about the closed forms
    limits: tuple[tuple[float, float], ...]  # mm, near and far of what 1, 2, ... n views see
    sections: tuple[tuple[CommonSection, ...], ...]  # at each depth of the table
    uses: tuple[SensorUse, ...]
    volumes: tuple[CommonVolume, ...]  # of 1, 2, ... n views
    traced: np.ndarray  # (N, 2) mm, depth and half width
    start: float  # mm, depth at which the last ray leaves the optic

    @property
    def counts(self) -> range:
        """The numbers of views that tables are about: 2 to n, or the one that there is."""
        return range(min(2, len(self.rig)), len(self.rig) + 1)


def show_field(setup_file: Path, depths: tuple[float, float] | None, views: int | None, output: Path) -> None:
    """Trace, print, draw and write the field of view; see `cyclopean fov`."""
    setup = read_setup(setup_file)
    rig = setup.rig()
    if len(rig) == 1 and views is None:
        raise SetupError(
            f"{setup_file}: a common field needs two views or more, and this {setup.optic.kind} gives 1; "
            "--views 1 shows the field of that view alone"
        )
    wanted = None if views is None else checked_views(len(rig), views)
    folder = output_folder(output)
    with console.status("tracing the borders of every view"):
        found = find_field(setup, rig, depths)
    kept = [volume for volume in found.volumes if volume.views in ([wanted] if wanted else found.counts)]
    say_field(setup_file, found)
    with console.status("writing"):
        files = write_field(folder, setup_file, found, kept)
    console.print(f"-> {folder}/  {'  '.join(files)}")


def find_field(setup: Setup, rig: Rig, depths: tuple[float, float] | None) -> Field:
    """Everything that tracing and the closed forms tell about the field."""
    near, far = depths if depths is not None else setup.depths or rig.working_depths
    closed, note = closed_forms(setup)
    common = CommonField.of(rig)
    volumes = common.volumes((near, far))
    steps = [float(f"{depth:.4g}") for depth in np.geomspace(near, far, _TABLE)]
    steps[0], steps[-1] = near, far
    sections = tuple(common.sections(depth) for depth in steps)
    uses = tuple(sensor_use(rig, depth) for depth in steps)
    limits = tuple(common.limits(k) for k in range(1, len(rig) + 1))
    traced = np.array([
        (depth, traced_width(setup, common.sections(depth)[-1], closed))
        for depth in np.linspace(min(near, 1.02 * common.start), far, _CURVE)
    ])  # fmt: skip
    return Field(setup, rig, (near, far), closed, note, limits, sections, uses, volumes, traced, common.start)


def closed_forms(setup: Setup) -> tuple[FieldOfView | None, str]:
    """The closed forms of a setup, None where they say nothing about it, and a sentence about that."""
    why = not_upright(setup)
    if not isinstance(setup.optic, Prism):
        return None, f"no closed form: it is that of an upright pyramid, and {why}"
    try:
        field = FieldOfView.of(upright(setup))
    except OpticError as error:
        return None, f"no closed form: {error}"
    if not why:
        return field, ""
    tilt = np.hypot(*setup.optic.tilt_deg[:2])
    if tilt > _MOST_TILT or np.hypot(*setup.optic.shift) > _MOST_TILT / 100 * setup.optic.distance:
        return None, f"no closed form: it is that of an upright pyramid, and {why}"
    return field, f"{why}: the closed form is that of the same prism set upright; what is traced is that of the setup"


def traced_width(setup: Setup, section: CommonSection, closed: FieldOfView | None) -> float:
    """Half the width (mm) that the closed form speaks of, as traced; the largest circle where there is none."""
    if closed is None:
        return section.inscribed_circle[1]
    if closed.facets > 2:
        return max(float(section.clearance([[0.0, 0.0]])[0]), 0.0)
    azimuth = picture_azimuths(setup.optic)[0]  # type: ignore[arg-type]
    low, high = section.extent([np.cos(azimuth), np.sin(azimuth)])
    return (high - low) / 2 if np.isfinite(high) else 0.0


def say_field(setup_file: Path, found: Field) -> None:
    """Print the class, the limits and the tables."""
    near, far = found.depths
    optic, count = found.setup.optic.kind, counted(len(found.rig), "view")
    console.print(f"{setup_file}: {optic}, {count}, depths {near:g} to {far:g} mm")
    for line in class_lines(found):
        console.print(line)
    for heading, (columns, rows) in field_tables(found).items():
        table = Table(title=heading, title_justify="left", box=None, padding=(0, 2, 0, 0))
        for column in columns:
            table.add_column(column, justify="right")
        for row in rows:
            table.add_row(*row)
        console.print(table)


def class_lines(found: Field) -> list[str]:
    """The class of the field and its limits, in sentences."""
    field, lines = found.closed, []
    if field is not None:
        omega, gamma = np.degrees(field.omega1), np.degrees(field.gamma)
        spread = f"{omega.min():.3f}" if np.ptp(omega) < 1e-3 else f"{omega.min():.3f} to {omega.max():.3f}"
        wide = np.degrees(field.divergence)
        lines.append(f"class: {field.kind}; omega1 {spread} degrees, gamma {gamma:.3f} degrees")
        lines.append(
            f"  convergent below omega1 = gamma = {gamma:.3f}, divergent from omega1 = "
            f"{'2 gamma = ' if field.facets == 2 else ''}{wide:.3f} degrees"
        )
        lines.append(
            f"  closed form: near {_mm(field.near)}, kink {_mm(field.kink)}, far {_mm(field.far)}, "
            f"lambda {field.baselines.mean():.3f} mm"
        )
    if found.note:
        lines.append(found.note)
    start = found.start
    if found.limits[-1][0] <= start * (1 + 1e-6) and not (field is not None and field.crossing >= start * (1 - 1e-4)):
        lines.append(f"nothing is looked for nearer than {_mm(start)}, where the last ray leaves the optic")
    return lines


def field_tables(found: Field) -> dict[str, tuple[tuple[str, ...], list[tuple[str, ...]]]]:
    """Heading -> columns and rows of what was traced."""
    limits = [
        (f"{volume.views}", *map(_mm, found.limits[volume.views - 1]), f"{volume.volume / 1e3:,.1f}")
        for volume in found.volumes
    ]
    rows = []
    for sections, use in zip(found.sections, found.uses, strict=True):
        for k in found.counts:
            section, first = sections[k - 1], k == found.counts[0]
            rows.append((
                f"{section.depth:g}" if first else "",
                f"{k}",
                f"{section.width:.1f}",
                f"{section.height:.1f}",
                f"{section.area / 100:,.1f}",
                f"{2 * section.inscribed_circle[1]:.1f}",
                f"{100 * use.share(k):.1f}",
                f"{100 * use.lost:.1f}" if first else "",
                f"{100 * use.unused:.1f}" if first else "",
            ))  # fmt: skip
    columns = (
        "depth (mm)", "views", "width (mm)", "height (mm)", "area (cm²)", "circle (mm)", "pixels (%)",
        "seams (%)", "unused (%)",
    )  # fmt: skip
    span = f"{found.depths[0]:g} to {found.depths[1]:g} mm"
    return {
        "limits and volume": (("views or more", "near", "far", f"volume (cm³), {span}"), limits),
        "cross-sections, seen by so many views or more": (columns, rows),
    }


def write_field(folder: Path, setup_file: Path, found: Field, kept: list[CommonVolume]) -> list[str]:
    """Write meshes, figures, numbers and the report; returns the names of the files."""
    from ..plotting import write_report
    from ..plotting.field_of_view import field_picture, sections_picture, sensor_picture

    files = []
    for volume in kept:
        if not len(volume.faces):
            near, far = found.limits[volume.views - 1]
            where = "nowhere" if np.isnan(near) else f"from {_mm(near)} to {_mm(far)}"
            console.print(
                f"{volume.views} views see nothing together at these depths ({where}): no volume_{volume.views}"
            )
            continue
        for ending in ("stl", "ply"):
            files.append(f"volume_{volume.views}.{ending}")
            write_mesh(folder / files[-1], volume.vertices, volume.faces)
    with replacing(folder / "fov.json") as file:
        file.write((json.dumps(as_document(found), indent=1) + "\n").encode())
    pictures = {
        "fov": field_picture(found.setup, found.rig, found.depths, found.traced, found.closed),
        "sections": sections_picture({"": found.sections}),
        "sensor": sensor_picture(found.uses[::2]),
    }
    for name, figure in pictures.items():
        save_figure(figure, folder / f"{name}.png")
    captions = {
        "The field from the side; facets that coincide in this view are drawn as one": pictures["fov"],
        "Cross-sections: how many views see what; dashed: the largest circle that all see": pictures["sections"],
        "The sensor: how many views see what each pixel looks at": pictures["sensor"],
    }
    title = f"Field of view of {setup_file.name}"
    write_report(folder / "report.html", title, " ".join(class_lines(found)), field_tables(found), captions, [])
    return [*files, "fov.png", "sections.png", "sensor.png", "fov.json", "report.html"]


def as_document(found: Field) -> dict:
    """The numbers as a JSON document: null is a limit that does not exist, or a closed form that says nothing."""
    field = found.closed
    closed = None if field is None else {
        "class": field.kind,
        "omega1_deg": np.degrees(field.omega1).tolist(),
        "gamma_deg": float(np.degrees(field.gamma)),
        "divergent_from_deg": float(np.degrees(field.divergence)),
        "lambda_mm": field.baselines.tolist(),
        "near_mm": _number(field.near),
        "kink_mm": _number(field.kink),
        "far_mm": _number(field.far),
    }  # fmt: skip
    names = ("depth_mm", "half_width_mm")
    return {
        "depths_mm": list(found.depths),
        "closed_form": closed,
        "note": found.note,
        "volumes": [
            {"views": volume.views, "near_mm": _number(limit[0]), "far_mm": _number(limit[1]),
             "volume_mm3": volume.volume}
            for volume, limit in zip(found.volumes, found.limits, strict=True)
        ],
        "sections": [
            _section_document(section, use)
            for sections, use in zip(found.sections, found.uses, strict=True) for section in sections
        ],
        "sensor": [
            {"depth_mm": use.depth, "beside_seams": use.lost, "unused": use.unused} for use in found.uses
        ],
        "traced": [dict(zip(names, map(float, row), strict=True)) for row in found.traced],
    }  # fmt: skip


def _section_document(section, use):
    centre, radius = section.inscribed_circle
    return {
        "depth_mm": section.depth,
        "views": section.views,
        "width_mm": section.width,
        "height_mm": section.height,
        "area_mm2": section.area,
        "circle_centre_mm": [_number(value) for value in centre],
        "circle_radius_mm": radius,
        "share_of_pixels": use.share(section.views),
        "polygons_mm": [np.round(polygon, 6).tolist() for polygon in section.polygons],
    }


def _number(value):
    return float(value) if np.isfinite(value) else None


def _mm(value):
    if np.isnan(value):
        return "never"
    return "no end" if np.isinf(value) else f"{value:.4g} mm"
