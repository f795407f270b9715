"""The report of `cyclopean design`: tables, the comparison, and the picture and shopping list of each prism."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from .design_tables import CAPTIONS

if TYPE_CHECKING:
    from ..design.requirements import Designs
    from .design_files import CandidateFiles
    from .design_tables import Columns
    from .design_tables import Rows as TableRows


@dataclass(frozen=True)
class _Drawn:
    """A picture that is on disk already, as a report takes figures."""

    path: Path

    def savefig(self, file: Any, **_: object) -> None:
        """Copy it."""
        file.write(self.path.read_bytes())


def write_design_report(
    folder: Path,
    lines: Sequence[str],
    tables: Mapping[str, tuple[Columns, TableRows]],
    remarks: Sequence[str],
    files: Mapping[int, CandidateFiles],
    letters: Mapping[int, str],
    designs: Designs,
) -> None:
    """Write report.html from what is in the folder."""
    from ..plotting.report import write_report

    pictures: dict[str, Any] = {
        "Every prism that fits; those with a letter are written": _Drawn(folder / "comparison.png")
    }
    all_tables: dict[str, tuple[Sequence[str], Sequence[Sequence[object]]]] = dict(tables)
    for k, one in files.items():
        pictures[f"Prism {one.title}"] = _Drawn(one.folder / "candidate.png")
        rows = [(heading, what, value) for heading, part in one.shopping.items() for what, value in part]
        all_tables[f"shopping list of prism {letters[k]}"] = ("", "what", "value"), rows
    write_report(
        folder / "report.html",
        f"Prisms: {designs.requirements.depths[0]:g} to {designs.requirements.depths[1]:g} mm",
        " ".join(f"{line.removesuffix('.')}." for line in lines if line),
        all_tables,
        pictures,
        remarks,
        CAPTIONS,
    )
